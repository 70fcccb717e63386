// The end of a frame on a GPU: from the visibility buffer to finished pixels, all in device memory.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <memory>
#include <span>

#include "format/result.h"
#include "kernels/cuda/shade/texture_cache.h"
#include "kernels/frame.h"
#include "kernels/raster/transform.h"

namespace scree::kernels {

/// Resolves pictures of any scene. Keeps its scratch memory from one picture to the next. The next picture must use the
/// same device and stream, or the caller must wait for the previous one.
class CudaResolver {
 public:
  CudaResolver();
  CudaResolver(CudaResolver&&) noexcept;
  CudaResolver& operator=(CudaResolver&&) noexcept;
  ~CudaResolver();

  /// As resolve_cpu() with 4 channels.
  /// - All pointers, also those in `scene`, are on the current device.
  /// - `transforms`: of `view`, by instance number, valid for the instances that `samples` show. If null, they are made
  ///   here.
  /// - `pixels`: one RGBA8 word per pixel, red in the low byte.
  /// - `cache`: the cache made for the scene's JPEG levels, if its textures have any. The picture does not depend on
  ///   its size.
  /// - `rows`: the ranges of rows of pixels that are written, one after the other. All rows if there are none.
  /// - Everything is queued on `stream`. The call waits only if the picture is larger than all before (for scratch
  ///   memory), and if `times` is given.
  /// Errors kRange (as resolve_cpu), kDevice (a CUDA call failed; which and for what).
  Result<void> resolve(const SceneView& scene, const View& view, uint32_t samples_per_side, const uint64_t* samples,
                       const Transform* transforms, const ShadeOptions& options, uint32_t* pixels, cudaStream_t stream,
                       ResolveTimes* times = nullptr, CudaTextureCache* cache = nullptr,
                       std::span<const RowRange> rows = {});

  /// Loads the code of resolve() for pictures of a scene in perspective. Without this call its first picture takes 10
  /// to 20 ms longer. `scene`: may be in host memory; nothing that it points to is read. `has_cache`: whether resolve()
  /// gets a cache. Reports no error, because resolve() does.
  static void load(const SceneView& scene, uint32_t samples_per_side, const ShadeOptions& options, bool has_cache);

  /// As shade_part_cpu(): colours of the samples whose chunk has its page, 3 floats each, in device memory. Otherwise
  /// as resolve().
  Result<void> shade_part(const SceneView& scene, const View& view, const uint64_t* samples,
                          const Transform* transforms, const ShadeOptions& options, float* colors, cudaStream_t stream,
                          CudaTextureCache* cache = nullptr);

  /// As resolve_colors_cpu(), whose `over` may be null here. Otherwise as resolve().
  Result<void> resolve_colors(const View& view, uint32_t samples_per_side, const uint64_t* samples, const float* colors,
                              const float* over, const ShadeOptions& options, uint32_t* pixels, cudaStream_t stream,
                              ResolveTimes* times = nullptr);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::kernels
