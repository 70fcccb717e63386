// One frame on a GPU: as frame.h's draw_cpu(), over device memory. Every pointer in the scene view, and
// the buffers, are of the current device. The visibility buffer is the CPU's, bit for bit.
#pragma once

#include <cstdint>

#include "format/result.h"
#include "kernels/frame.h"
#include "kernels/passes.h"

namespace scree::kernels {

/// Capacities and shares that suit a GPU: blocks of few triangles, so that a small scene fills it.
QueueSizes cuda_queue_sizes();

/// Draws into `samples` (device memory, view.width * view.height), which is cleared first. `triangle_count`: of the
/// scene, instance_base[instance_count]. Errors kRange (as draw_cpu), kDevice (a CUDA call failed; which and for what),
/// kMemory.
Result<FrameStats> draw_cuda(const SceneView& scene, uint64_t triangle_count, const View& view, uint64_t* samples,
                             const QueueSizes& sizes);

}  // namespace scree::kernels
