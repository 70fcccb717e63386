// Simple encoders of BC4, BC5 and BC7 blocks: for generated textures, not for quality. Source: Khronos Data Format
// Specification, RGTC and BPTC.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace scree::synth {

/// 4 x 4 texels, row by row: red, green, blue, alpha.
using BlockTexels = std::array<std::array<uint8_t, 4>, 16>;

/// A block of BC4 (8 bytes) of one channel (0 to 3): eight values from its least to its largest.
void encode_bc4(const BlockTexels& texels, uint32_t channel, std::byte* out);

/// A block of BC5 (16 bytes): red and green as BC4.
void encode_bc5(const BlockTexels& texels, std::byte* out);

/// A block of BC7 (16 bytes) in mode 6: 16 colours with alpha between two ends, which are the texels with the least and
/// the largest luminance.
void encode_bc7(const BlockTexels& texels, std::byte* out);

}  // namespace scree::synth
