// The passes on CUDA: the same source as cpu_passes.cpp, run by warps.
#include "kernels/backend_cuda.cuh"
#include "kernels/frame_cuda.h"
#include "kernels/passes.h"

namespace scree::kernels {

QueueSizes cuda_queue_sizes() {
  QueueSizes sizes;
  sizes.blocks = 1u << 20;
  sizes.medium = 1u << 20;
  sizes.large = 1u << 16;
  sizes.tiles = 1u << 20;
  sizes.blocks_at_a_time = 1u << 22;
  sizes.block_triangles = 1024;
  return sizes;
}

Result<FrameStats> draw_cuda(const SceneView& scene, uint64_t triangle_count, const View& view, uint64_t* samples,
                             const QueueSizes& sizes) {
  if (Result<void> checked = check_frame(view, triangle_count); !checked) return checked.error();
  CudaBackend backend;
  FrameStats stats{};
  const bool drawn = !backend.failed() && draw_frame(backend, scene, make_frame_view(view), samples, sizes, stats);
  backend.synchronize("drawing");
  if (backend.failed()) return backend.error();
  if (!drawn) {
    return Error{ErrorCode::kDevice,
                 "no device memory left for the queues of the frame; --backend cpu draws without it"};
  }
  return stats;
}

}  // namespace scree::kernels
