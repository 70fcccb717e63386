// Simple encoders of BC4, BC5 and BC7 blocks for generated textures. They are not optimised for quality. Source:
// Khronos Data Format Specification, RGTC and BPTC.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace scree::synth {

/// 4 x 4 texels, row by row: red, green, blue, alpha.
using BlockTexels = std::array<std::array<uint8_t, 4>, 16>;

/// Encodes one channel (0 to 3) as a BC4 block (8 bytes): eight values from its least to its largest.
void encode_bc4(const BlockTexels& texels, uint32_t channel, std::byte* out);

/// Encodes red and green as a BC5 block (16 bytes), each as in BC4.
void encode_bc5(const BlockTexels& texels, std::byte* out);

/// Encodes a BC7 block (16 bytes) in mode 6: 16 colours with alpha between two ends, which are the texels with the
/// least and the largest luminance.
void encode_bc7(const BlockTexels& texels, std::byte* out);

}  // namespace scree::synth
