// Generated textures as KTX2 files of BC blocks with all levels, packed by zstd.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "format/layout.h"
#include "format/result.h"

namespace scree::synth {

enum class BlockPicture : uint8_t {
  kColor,     // BC7 sRGB
  kCutout,    // the same, with holes in its alpha
  kSurface,   // BC5, swizzle 1rg1: roughness in green and metalness in blue, as in glTF
  kNormals,   // BC5: x and y of a normal map
  kSpecular,  // BC4, swizzle 111r: strength in alpha
};

struct BlockTexture {
  BlockPicture picture = BlockPicture::kColor;
  uint32_t width = 4;  // texels, 1 to 8192
  uint32_t height = 4;
  uint32_t seed = 0;
};

format::BlockFormat block_format_of(BlockPicture picture);

/// Bytes of the blocks of all levels whose longer side is at most `longest`.
uint64_t block_bytes_of(const BlockTexture& texture, uint32_t longest = UINT32_MAX);

/// Makes the KTX2 file. Memory: its blocks, and as much again as the largest level to compress it. Errors kFormat (from
/// zstd). Throws std::bad_alloc.
Result<std::vector<std::byte>> make_block_file(const BlockTexture& texture);

}  // namespace scree::synth
