// The cache of decoded groups of JPEG textures in GPU memory, and the resolve of pictures whose textures need it
// (kernels/shade/texture_cache.h) or come in pages (kernels/shade/texel_pager.h).
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

/// Lives across frames. Used on one stream, or on streams that wait for each other.
class CudaTextureCache {
 public:
  CudaTextureCache();
  CudaTextureCache(CudaTextureCache&&) noexcept;
  CudaTextureCache& operator=(CudaTextureCache&&) noexcept;
  ~CudaTextureCache();

  /// `levels`: the scene's JPEG levels by number, with `groups`; all pointers are on the current device, and outlive
  /// this. `bytes`: of colours, rounded down to whole slots (and sets, of 8), at least one. `pager`: of the scene's
  /// paged levels, null if there are none; outlives this. Errors kDevice.
  static Result<CudaTextureCache> create(const JpegLevel* levels, uint64_t bytes, const JpegGroups& groups,
                                         TexelPager* pager = nullptr);

  /// Device memory of create(). The first picture adds a list of its tiles, half a byte per pixel (in parts: per
  /// sample).
  static uint64_t device_bytes(uint64_t bytes, const JpegGroups& groups);

  uint64_t slots() const;
  uint64_t bytes() const;  // of colours

  /// As CudaResolver::resolve, which calls it for pictures of Show::kTexture. Everything is queued on `stream`. Waits
  /// if the picture is larger than all before, to grow the lists, and with a pager for each of its rounds. Errors
  /// kDevice, kMemory, and the errors of TexelPager::bring.
  Result<void> resolve(const ShadeInputs& in, const PixelTiles& tiles, const uint64_t* samples,
                       uint32_t samples_per_side, const float* visibility, uint32_t* pixels, cudaStream_t stream);

  /// As CudaResolver::load, which calls it for such pictures.
  static void load(const ShadeInputs& in, uint32_t samples_per_side);

  /// As CudaResolver::shade_part, which calls it for pictures of Show::kTexture. Otherwise as resolve().
  Result<void> shade_part(const ShadeInputs& in, const PixelTiles& tiles, const uint64_t* samples, float* colors,
                          cudaStream_t stream);

  /// Waits for the last picture, or its last part. Errors kDevice.
  Result<TextureCacheCounts> counts() const;

  /// Removes every group. Errors kDevice.
  Result<void> clear(cudaStream_t stream);

  /// Decodes the first `group_count` groups of `level` (on the device) into `out`, `slot_bytes` apart: a multiple of 64
  /// and at least a group's samples. For tests and measurements. Errors kDevice.
  static Result<void> decode(const JpegLevel* level, uint32_t group_count, uint8_t* out, uint32_t slot_bytes,
                             cudaStream_t stream);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::kernels
