// Which chunks a view may show, and which of them hide behind what is drawn, found on a GPU. The list is what
// runtime/stream/visible_chunks.h finds on the host; squares of the depth pyramid of less than 8 x 8 samples are not
// asked here.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <span>

#include "format/result.h"
#include "kernels/cuda/check.h"
#include "kernels/cull/depth_pyramid.h"
#include "kernels/frame.h"
#include "kernels/raster/transform.h"
#include "kernels/scene_view.h"

namespace scree::kernels {

/// Of one scene, on the device that was current when it was opened.
class CudaVisibleChunks {
 public:
  static constexpr uint32_t kFirstLevel = 3;  // of the pyramid: a code for 8 x 8 samples

  /// `host`: the scene's records in host memory, needed during the call only; `device`: the same on the device, which
  /// outlives this. Fewer than 2^32 chunks. Errors kDevice.
  Result<void> open(const SceneView& host, const SceneView& device);

  /// What open() takes of device memory. The depths' pyramid, 1/12 byte a sample, comes with the first frame.
  static uint64_t device_bytes(const SceneView& scene);

  /// By chunk, the nearest depth code that it may have in `view`; ~0 where it draws no sample. Waits for it; until the
  /// next call. Errors kDevice.
  /// `draws_blended`: as SceneView has it.
  Result<std::span<const uint32_t>> find_nearest(const View& view, bool draws_blended = false);

  /// Queues the same search on the default stream, for the view of the last find_nearest(), restricted to places where
  /// the chunk is not hidden by the picture that `samples` (device memory) then holds; ~0 where it is hidden
  /// everywhere, or not in the view. shown() has the result once the stream is done, until the next call. Errors
  /// kDevice.
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
