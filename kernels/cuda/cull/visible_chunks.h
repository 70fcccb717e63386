// Finds on a GPU which chunks may be visible in a view, and which of them the picture hides. Squares of the depth
// pyramid below 8 x 8 samples are not used.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <span>

#include "format/result.h"
#include "kernels/cuda/common/check.h"
#include "kernels/cull/depth_pyramid.h"
#include "kernels/frame.h"
#include "kernels/raster/transform.h"
#include "kernels/scene_view.h"

namespace scree::kernels {

/// For one scene, on the device that was current at open().
class CudaVisibleChunks {
 public:
  static constexpr uint32_t kFirstLevel = 3;  // of the pyramid: one code per 8 x 8 samples

  /// `host`: the scene's records in host memory, needed only during the call. `device`: the same on the device; it
  /// outlives this. Fewer than 2^32 chunks. Errors kDevice.
  Result<void> open(const SceneView& host, const SceneView& device);

  /// Device memory of open(). The depth pyramid, 1/12 byte per sample, is allocated by the first frame.
  static uint64_t device_bytes(const SceneView& scene);

  /// By chunk, the nearest depth code that it may have in `view`; ~0 if it draws no sample. Waits for the result, which
  /// is valid until the next call. `draws_blended`: as in SceneView. Errors kDevice.
  Result<std::span<const uint32_t>> find_nearest(const View& view, bool draws_blended = false);

  /// Queues the same search on the default stream, for the view of the last find_nearest(). Skips instances of a chunk
  /// that the picture in `samples` (device memory) hides at that time. ~0 if all are hidden or outside the view.
  /// shown() returns the result once the stream is done; it is valid until the next call. Errors kDevice.
  Result<void> start_finding_shown(const uint64_t* samples);
  std::span<const uint32_t> shown() const {
    return {reinterpret_cast<const uint32_t*>(read_shown_.data()), scene_.chunk_count};
  }

 private:
  SceneView scene_{};
  FrameView frame_{};
  dim3 blocks_{};
  DeviceBuffer nearest_;
  DeviceBuffer shown_;
  PinnedBuffer read_nearest_;
  PinnedBuffer read_shown_;
  DeviceBuffer codes_;
  DepthPyramid pyramid_{};
};

}  // namespace scree::kernels
