// From the coefficients of an indexed JPEG to its samples and colours; runs in kernels too. Integers alone, so every
// machine has the same bits, those of libjpeg-turbo's exact transform. Source: spec/codecs.md, indexed JPEG.
#pragma once

#include <cstdint>

#include "format/hd.h"
#include "format/jpeg_mcu.h"

namespace scree::format {

/// Blocks of the largest group: 2 MCUs of 3 x 1 blocks in each of 3 components.
inline constexpr uint32_t kJpegMaxGroupBlocks = 18;

/// A picture ready for its pixels; owns nothing. A group's samples are the blocks of its MCUs one after the other, 64
/// bytes each, rows of 8.
struct JpegPicture {
  JpegView view;
  const uint32_t* factors;  // of each quantisation table 64, in zigzag order: factor | row-major place << 16
  uint32_t width;           // pixels
  uint32_t height;
  uint32_t mcu_width;  // pixels, multiples of 8
  uint32_t mcu_height;
  uint32_t mcu_blocks;
  uint32_t colour;  // JpegColour
};

/// The one-dimensional inverse DCT of Loeffler, Ligtenberg and Moschytz with 13 bits of fraction: 8 values, `step`
/// apart, in place, 2^3 times the orthogonal transform's over 2^(shift - 13). Sums wrap where damaged data make them.
SCREE_HD inline void transform_jpeg_line(int32_t* values, uint32_t step, uint32_t shift) {
  const auto at = [&](uint32_t i) { return static_cast<uint32_t>(values[i * step]); };
  const auto put = [&](uint32_t i, uint32_t value) {
    values[i * step] = static_cast<int32_t>(value + (1u << (shift - 1))) >> shift;
  };
  // Constants are round(2^13 * c).
  const uint32_t rotated = (at(2) + at(6)) * 4433u;  // 0.541196100
  const uint32_t even2 = rotated - at(6) * 15137u;   // 1.847759065
  const uint32_t even3 = rotated + at(2) * 6270u;    // 0.765366865
  const uint32_t even0 = (at(0) + at(4)) << 13;
  const uint32_t even1 = (at(0) - at(4)) << 13;
  const uint32_t sum = (at(7) + at(3) + at(5) + at(1)) * 9633u;  // 1.175875602
  const uint32_t shared73 = sum - (at(7) + at(3)) * 16069u;      // 1.961570560
  const uint32_t shared51 = sum - (at(5) + at(1)) * 3196u;       // 0.390180644
  const uint32_t shared71 = (at(7) + at(1)) * 7373u;             // 0.899976223
  const uint32_t shared53 = (at(5) + at(3)) * 20995u;            // 2.562915447
  const uint32_t odd0 = at(7) * 2446u - shared71 + shared73;     // 0.298631336
  const uint32_t odd1 = at(5) * 16819u - shared53 + shared51;    // 2.053119869
  const uint32_t odd2 = at(3) * 25172u - shared53 + shared73;    // 3.072711026
  const uint32_t odd3 = at(1) * 12299u - shared71 + shared51;    // 1.501321110
  put(0, even0 + even3 + odd3);
  put(7, even0 + even3 - odd3);
  put(1, even1 + even2 + odd2);
  put(6, even1 + even2 - odd2);
  put(2, even1 - even2 + odd1);
  put(5, even1 - even2 - odd1);
  put(3, even0 - even3 + odd0);
  put(4, even0 - even3 - odd0);
}

SCREE_HD inline uint32_t clamp_jpeg_sample(int32_t value) {
  return value < 0 ? 0u : value > 255 ? 255u : static_cast<uint32_t>(value);
}

/// 64 coefficients in row-major order, dequantised, become 64 samples; `coefficients` is destroyed.
SCREE_HD inline void transform_jpeg_block(int32_t* coefficients, uint8_t* samples) {
  for (uint32_t i = 0; i < 8; ++i) transform_jpeg_line(coefficients + i, 8, 11);
  for (uint32_t i = 0; i < 8; ++i) transform_jpeg_line(coefficients + 8 * i, 1, 18);
  for (uint32_t i = 0; i < 64; ++i) samples[i] = static_cast<uint8_t>(clamp_jpeg_sample(coefficients[i] + 128));
}

/// Decodes the MCU at the cursor and moves it on: 64 * mcu_blocks bytes of samples. False where the data are none; the
/// blocks not decoded are grey then.
SCREE_HD inline bool decode_jpeg_samples(const JpegPicture& picture, JpegCursor& cursor, uint8_t* samples) {
  uint8_t* const end = samples + 64 * picture.mcu_blocks;
  bool good = cursor.mcu < picture.view.mcu_count;
  if (good) begin_jpeg_mcu(picture.view, cursor);
  for (uint32_t c = 0; good && c < picture.view.component_count; ++c) {
    const JpegViewComponent& component = picture.view.components[c];
    const uint32_t* const factors = picture.factors + 64 * component.quant;
    const uint32_t count = uint32_t{component.h} * component.v;
    for (uint32_t i = 0; good && i < count; ++i) {
      int32_t coefficients[64] = {};
      good = decode_jpeg_block(picture.view, cursor, c, [&](uint32_t k, int32_t value) {
        coefficients[factors[k] >> 16] = value * static_cast<int32_t>(factors[k] & 0xffffu);
      });
      if (!good) break;
      transform_jpeg_block(coefficients, samples);
      samples += 64;
    }
  }
  while (samples < end) *samples++ = 128;
  ++cursor.mcu;
  return good;
}

/// The samples of a whole group, below ceil(mcu_count / group_mcus): 64 * mcu_blocks * group_mcus bytes, of which those
/// of MCUs past the last are left alone. Grey from where the data are none; any bytes are safe.
SCREE_HD inline void decode_jpeg_group(const JpegPicture& picture, uint32_t group, uint8_t* samples) {
  JpegCursor cursor = jpeg_anchor(picture.view, group);
  const uint32_t left = picture.view.mcu_count - cursor.mcu;
  const uint32_t count = left < picture.view.group_mcus ? left : picture.view.group_mcus;
  bool good = true;
  for (uint32_t i = 0; i < count; ++i, samples += 64 * picture.mcu_blocks) {
    if (!good) cursor.bit = picture.view.data_bits + 1;  // which no block begins at
    good = decode_jpeg_samples(picture, cursor, samples);
  }
}

/// Where a pixel lies: its group, and its MCU's first block in the group's samples; the rest is its place in the MCU.
struct JpegPlace {
  uint32_t group;
  uint32_t first_block;
  uint32_t x;  // below mcu_width
  uint32_t y;
};

SCREE_HD inline JpegPlace jpeg_place(const JpegPicture& picture, uint32_t x, uint32_t y) {
  const uint32_t column = x / picture.mcu_width;
  const uint32_t row = y / picture.mcu_height;
  const uint32_t mcu = row * picture.view.mcus_across + column;
  const uint32_t group = mcu / picture.view.group_mcus;
  return {group, (mcu - group * picture.view.group_mcus) * picture.mcu_blocks, x - column * picture.mcu_width,
          y - row * picture.mcu_height};
}

/// A pixel's colour as coded, red in the low byte, from its group's samples. A component of fewer samples is repeated,
/// not interpolated: pixel x of the MCU has sample floor(x * h / h of the largest).
SCREE_HD inline uint32_t jpeg_colour(const JpegPicture& picture, const JpegPlace& place, const uint8_t* samples) {
  const uint8_t* block = samples + 64 * place.first_block;
  int32_t value[kJpegMaxComponents] = {};
  for (uint32_t c = 0; c < picture.view.component_count; ++c) {
    const JpegViewComponent& component = picture.view.components[c];
    const uint32_t x = 8 * component.h == picture.mcu_width ? place.x : place.x * (8 * component.h) / picture.mcu_width;
    const uint32_t y =
        8 * component.v == picture.mcu_height ? place.y : place.y * (8 * component.v) / picture.mcu_height;
    value[c] = block[64 * ((y >> 3) * component.h + (x >> 3)) + 8 * (y & 7u) + (x & 7u)];
    block += 64 * component.h * component.v;
  }
  if (picture.view.component_count == 1) return static_cast<uint32_t>(value[0]) * 0x010101u;
  if (picture.colour != static_cast<uint32_t>(JpegColour::kYcbcr))
    return static_cast<uint32_t>(value[0] | value[1] << 8 | value[2] << 16);
  // Constants are round(2^16 * c).
  constexpr int32_t kHalf = 1 << 15;
  const int32_t blue = value[1] - 128;
  const int32_t red = value[2] - 128;
  const uint32_t r = clamp_jpeg_sample(value[0] + ((91881 * red + kHalf) >> 16));                  // 1.40200
  const uint32_t g = clamp_jpeg_sample(value[0] + ((-22554 * blue - 46802 * red + kHalf) >> 16));  // 0.34414, 0.71414
  const uint32_t b = clamp_jpeg_sample(value[0] + ((116130 * blue + kHalf) >> 16));                // 1.77200
  return r | g << 8 | b << 16;
}

}  // namespace scree::format
