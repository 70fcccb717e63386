// Many small pictures of one scene on a GPU, in one set of launches: depths and ids of all views of a batch.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "format/result.h"
#include "kernels/frame.h"

namespace scree::kernels {

/// Draws batches of views on the current device, one batch at a time, on the default stream. Only for scenes that a
/// frame draws in one pass and whose chunks are all clustered: a batch culls each group of clusters for each view,
/// without occlusion.
class CudaViewBatch {
 public:
  /// Whether scenes like this one can be drawn in batches.
  static bool takes(const SceneView& host);

  /// Whether these views, all of one size in samples, can be drawn in a batch, and faster than by one frame each: 4
  /// views or more, of kMostViewSamples or fewer, all perspective or all orthographic, without clipping boxes.
  static bool pays(std::span<const View> views);
  static constexpr uint64_t kFewestViews = 4;
  /// One warp draws a large triangle, 32 samples at a time. With larger views it would take longer than a frame.
  static constexpr uint64_t kMostViewSamples = uint64_t{1} << 18;
  /// Samples in memory at once, 256 MiB. Larger batches take several sets of launches.
  static constexpr uint64_t kMostSamples = uint64_t{1} << 25;

  /// As CudaFrames::create(), for a scene that takes() accepts. Errors kDevice, kMemory.
  static Result<CudaViewBatch> create(const SceneView& host, const SceneView& device,
                                      uint64_t most_samples = kMostSamples);
  CudaViewBatch(CudaViewBatch&&) noexcept;
  CudaViewBatch& operator=(CudaViewBatch&&) noexcept;
  ~CudaViewBatch();

  /// Makes room for batches like this one; they then allocate nothing. Errors kDevice, kMemory.
  Result<void> reserve(std::span<const View> views);

  /// Draws `views`, which pays() must accept, and makes depth, triangle and instance of `out` (its other pointers are
  /// null): device memory for the pixels of all views, view by view. Waits for the device. `samples_per_side`: 1, 2 or
  /// 4; it divides the views' sides. Returns the sums of the frames' counters. Errors kRange (as CudaFrames::draw),
  /// kDevice, kMemory.
  Result<FrameStats> draw(std::span<const View> views, uint32_t samples_per_side, const LayerTargets& out);

 private:
  struct Impl;
  explicit CudaViewBatch(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::kernels
