// The end of a frame on a GPU: from the visibility buffer to finished pixels, all in device memory.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <memory>

#include "format/result.h"
#include "kernels/cuda/texture_cache.h"
#include "kernels/frame.h"
#include "kernels/raster/transform.h"

namespace scree::kernels {

/// Resolves pictures of any scene; keeps its scratch memory from one to the next, which must be of the same device and
/// stream or waited for.
class CudaResolver {
 public:
  CudaResolver();
  CudaResolver(CudaResolver&&) noexcept;
  CudaResolver& operator=(CudaResolver&&) noexcept;
  ~CudaResolver();

  /// As resolve_cpu() with 4 channels. All pointers, those in `scene` too, are of the current device. `transforms`: of
  /// `view`, by instance number, valid for the instances that `samples` show; null makes them here. `pixels`: one RGBA8
  /// word a pixel, red in the low byte. Everything is queued on `stream`; nothing waits, but for the scratch memory of
  /// a picture larger than those before, and where `times` is given. `cache`: where textures of the scene have JPEG
  /// levels, what was made for them; the picture does not depend on its size. Errors kRange (as resolve_cpu), kDevice
  /// (a CUDA call failed; which and for what).
  Result<void> resolve(const SceneView& scene, const View& view, uint32_t samples_per_side, const uint64_t* samples,
                       const Transform* transforms, const ShadeOptions& options, uint32_t* pixels, cudaStream_t stream,
                       ResolveTimes* times = nullptr, CudaTextureCache* cache = nullptr);

  /// As shade_part_cpu(): colours of the samples whose chunk has its page, 3 floats each, in device memory.
  /// Otherwise as resolve().
  Result<void> shade_part(const SceneView& scene, const View& view, const uint64_t* samples,
                          const Transform* transforms, const ShadeOptions& options, float* colors, cudaStream_t stream,
                          CudaTextureCache* cache = nullptr);

  /// As resolve_colors_cpu(), whose `over` may be null here; otherwise as resolve().
  Result<void> resolve_colors(const View& view, uint32_t samples_per_side, const uint64_t* samples, const float* colors,
                              const float* over, const ShadeOptions& options, uint32_t* pixels, cudaStream_t stream,
                              ResolveTimes* times = nullptr);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::kernels
