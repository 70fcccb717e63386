// Decodes UASTC LDR blocks, the 4 x 4 blocks of 16 bytes that KTX2 files of KHR_texture_basisu have for pictures of
// high quality. Source: Khronos Data Format Specification 1.4, chapter "Universal ASTC Compressed Texture Images".
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace scree::runtime {

inline constexpr uint64_t kUastcBlockBytes = 16;

/// The block's 16 texels, row by row: RGBA, red in the lowest byte. Colours of sRGB files are interpolated as linear
/// colours are, as in other transcoders; the specification's last bit may differ there. Any bytes are accepted; invalid
/// blocks are magenta, as specified. `block`: kUastcBlockBytes.
void decode_uastc_block(const std::byte* block, std::span<uint32_t, 16> texels);

}  // namespace scree::runtime
