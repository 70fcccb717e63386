// The cache of decoded groups of JPEG textures in GPU memory, and the resolve of pictures that need it
// (kernels/shade/texture_cache.h).
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <memory>

#include "format/result.h"
#include "kernels/frame.h"
#include "kernels/math.h"
#include "kernels/scene_view.h"

namespace scree::kernels {
inline namespace SCREE_ISA {
struct ShadeInputs;
struct PixelTiles;
}  // namespace SCREE_ISA

/// Lives across frames; used on one stream, or on streams that wait for each other.
class CudaTextureCache {
 public:
  CudaTextureCache();
  CudaTextureCache(CudaTextureCache&&) noexcept;
  CudaTextureCache& operator=(CudaTextureCache&&) noexcept;
  ~CudaTextureCache();

  /// `levels`: the scene's JPEG levels by number, all pointers of the current device; they outlive this. `bytes`: of
  /// samples, rounded down to whole slots (and sets, of 8), but never less than one. `slot_bytes`: of the largest
  /// group. Errors kDevice.
  static Result<CudaTextureCache> create(const JpegLevel* levels, uint64_t bytes, uint32_t slot_bytes);

  /// What create() takes of device memory; a list of the tiles of a picture, half a byte a pixel (of parts, a sample),
  /// comes with the first.
  static uint64_t device_bytes(uint64_t bytes, uint32_t slot_bytes);

  uint64_t slots() const;
  uint64_t bytes() const;  // of samples

  /// As CudaResolver::resolve, which calls it, of a picture of Show::kTexture. Everything is queued on `stream`;
  /// nothing waits, but for the lists of a picture larger than those before. Errors kDevice.
  Result<void> resolve(const ShadeInputs& in, const PixelTiles& tiles, const uint64_t* samples,
                       uint32_t samples_per_side, const float* visibility, uint32_t* pixels, cudaStream_t stream);

  /// As CudaResolver::shade_part, which calls it, of a picture of Show::kTexture. Otherwise as resolve().
  Result<void> shade_part(const ShadeInputs& in, const PixelTiles& tiles, const uint64_t* samples, float* colors,
                          cudaStream_t stream);

  /// Waits for the last picture, or its last part. Errors kDevice.
  Result<TextureCacheCounts> counts() const;

  /// Forgets every group. Errors kDevice.
  Result<void> clear(cudaStream_t stream);

  /// Decodes `group_count` groups of `level` (of the device), from the first on, `slot_bytes` apart, into `out`: a
  /// multiple of 64, not less than a group's samples. For tests and measurements. Errors kDevice.
  static Result<void> decode(const JpegLevel* level, uint32_t group_count, uint8_t* out, uint32_t slot_bytes,
                             cudaStream_t stream);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::kernels
