// Many small pictures of one scene on a GPU, in one set of launches: depths and ids of all views of a batch.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "format/result.h"
#include "kernels/frame.h"

namespace scree::kernels {

/// Draws batches of views on the current device, one batch at a time, on the default stream. Of scenes that a frame
/// draws in one pass, all clustered: a batch culls each group of clusters for each view, and nothing behind others.
class CudaViewBatch {
 public:
  /// Whether scenes like this can be drawn so.
  static bool takes(const SceneView& host);

  /// Whether these views, all of one size in samples, can be drawn so, and faster than by a frame each: 4 views or more
  /// of kMostViewSamples or fewer, all perspective or all orthographic.
  static bool pays(std::span<const View> views);
  static constexpr uint64_t kFewestViews = 4;
  /// A large triangle is drawn by one warp, 32 samples at a time: more would keep it longer than a frame takes.
  static constexpr uint64_t kMostViewSamples = uint64_t{1} << 18;
  /// Samples that are there at once, 256 MiB: larger batches take several sets of launches.
  static constexpr uint64_t kMostSamples = uint64_t{1} << 25;

  /// As CudaFrames::create(); the scene is one that takes() names. Errors kDevice, kMemory.
  static Result<CudaViewBatch> create(const SceneView& host, const SceneView& device,
                                      uint64_t most_samples = kMostSamples);
  CudaViewBatch(CudaViewBatch&&) noexcept;
  CudaViewBatch& operator=(CudaViewBatch&&) noexcept;
  ~CudaViewBatch();

  /// Makes room for batches like this one; they then allocate nothing. Errors kDevice, kMemory.
  Result<void> reserve(std::span<const View> views);

  /// Draws `views`, which pays() names, and makes depth, triangle and instance of `out` (the others are null): device
  /// memory for the pixels of all views, view by view. Waits for the device. `samples_per_side`: 1, 2 or 4, a whole
  /// part of the views' sides. Sums of what frames count. Errors kRange (as CudaFrames::draw), kDevice, kMemory.
  Result<FrameStats> draw(std::span<const View> views, uint32_t samples_per_side, const LayerTargets& out);

 private:
  struct Impl;
  explicit CudaViewBatch(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::kernels
