// One frame on a GPU: as frame.h's draw_cpu() and shade_cpu(), over device memory. Every pointer in the scene view, and
// the buffers, are of the current device. The visibility buffer is the CPU's, bit for bit.
#pragma once

#include <cstdint>

#include "format/result.h"
#include "kernels/frame.h"
#include "kernels/passes.h"

namespace scree::kernels {

/// The nearest and the farthest depth code of a picture.
struct DepthCodes {
  uint32_t nearest;
  uint32_t farthest;
};

/// Capacities and shares that suit a GPU: blocks of few triangles, so that a small scene fills it.
QueueSizes cuda_queue_sizes();

/// Draws into `samples` (device memory, view.width * view.height), which is cleared first. `triangle_count`: of the
/// scene, instance_base[instance_count]. Errors kRange (as draw_cpu), kDevice (a CUDA call failed; which and for what),
/// kMemory.
Result<FrameStats> draw_cuda(const SceneView& scene, uint64_t triangle_count, const View& view, uint64_t* samples,
                             const QueueSizes& sizes);

/// Shades rows [first_row, first_row + row_count) of the picture in `samples` into `rgba` (device memory, 4 *
/// view.width floats a row). `codes`: the depth codes of the whole picture, which only Show::kDepth reads.
/// `srgb_table`: device memory, the linear light of the 256 sRGB codes. Errors kDevice.
Result<void> shade_cuda(const SceneView& scene, const View& view, const uint64_t* samples, const ShadeOptions& options,
                        DepthCodes codes, uint32_t first_row, uint32_t row_count, const float* srgb_table, float* rgba);

}  // namespace scree::kernels
