#include "format/jpeg/picture.h"

#include <algorithm>
#include <string>

namespace scree::format {

std::vector<uint32_t> jpeg_factors(const JpegIndex& index) {
  std::vector<uint32_t> factors;
  factors.reserve(64 * index.quant.size());
  for (const auto& table : index.quant)
    for (size_t k = 0; k < table.size(); ++k) factors.push_back(table[k] | uint32_t{kJpegNaturalOrder[k]} << 16);
  return factors;
}

JpegPicture jpeg_picture(const JpegIndex& index, const uint32_t* factors) {
  JpegPicture picture{};
  picture.view = index.view();
  picture.factors = factors;
  picture.width = index.width;
  picture.height = index.height;
  for (uint32_t i = 0; i < index.component_count; ++i) {
    picture.mcu_width = std::max(picture.mcu_width, 8u * index.components[i].h);
    picture.mcu_height = std::max(picture.mcu_height, 8u * index.components[i].v);
  }
  picture.mcu_width_inverse = jpeg_inverse(picture.mcu_width);
  picture.mcu_height_inverse = jpeg_inverse(picture.mcu_height);
  picture.group_inverse = jpeg_inverse(picture.view.group_mcus);
  for (uint32_t i = 0; i < index.component_count; ++i) {
    const auto share = [](uint32_t part, uint32_t whole) { return ((part << 16) + whole - 1) / whole; };
    picture.scales[i] = {share(8u * index.components[i].h, picture.mcu_width),
                         share(8u * index.components[i].v, picture.mcu_height)};
  }
  picture.mcu_blocks = index.layout.mcu_blocks;
  picture.colour = static_cast<uint32_t>(index.colour);
  return picture;
}

Result<void> decode_jpeg_rows(const JpegIndex& index,
                              const std::function<void(uint32_t y, std::span<const uint8_t> rgb)>& row) {
  const std::vector<uint32_t> factors = jpeg_factors(index);
  const JpegPicture picture = jpeg_picture(index, factors.data());
  const uint64_t stride = uint64_t{3} * picture.mcu_width * picture.view.mcus_across;
  std::vector<uint8_t> strip(stride * picture.mcu_height);
  uint8_t samples[64 * kJpegMaxMcuBlocks];
  JpegCursor cursor{};
  for (uint32_t first = 0; first < picture.height; first += picture.mcu_height) {
    for (uint32_t column = 0; column < picture.view.mcus_across; ++column) {
      if (!decode_jpeg_samples(picture, cursor, samples)) {
        return Error{ErrorCode::kFormat, "indexed JPEG: MCU " + std::to_string(cursor.mcu - 1) +
                                             ": no Huffman code, "
                                             "data that end early, or a coefficient past the 63rd"};
      }
      for (uint32_t y = 0; y < picture.mcu_height; ++y) {
        uint8_t* out = strip.data() + y * stride + uint64_t{3} * picture.mcu_width * column;
        for (uint32_t x = 0; x < picture.mcu_width; ++x) {
          const uint32_t colour = jpeg_colour(picture, {0, 0, x, y}, samples);
          for (uint32_t c = 0; c < 3; ++c) *out++ = static_cast<uint8_t>(colour >> (8 * c));
        }
      }
    }
    const uint32_t end = std::min(first + picture.mcu_height, picture.height);
    for (uint32_t y = first; y < end; ++y)
      row(y, std::span<const uint8_t>(strip.data() + (y - first) * stride, size_t{3} * picture.width));
  }
  return {};
}

}  // namespace scree::format
