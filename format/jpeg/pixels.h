// Computes samples and colours from the coefficients of an indexed JPEG; runs in kernels too. Integer arithmetic only,
// so every machine computes the same bits, equal to libjpeg-turbo's exact transform. Source: spec/codecs.md, indexed
// JPEG.
#pragma once

#include <cstdint>

#include "format/hd.h"
#include "format/jpeg/mcu.h"

namespace scree::format {

/// Blocks of the largest group: 2 MCUs of 3 x 1 blocks for each of 3 components.
inline constexpr uint32_t kJpegMaxGroupBlocks = 18;

/// A picture ready for decoding pixels; owns nothing. A group's samples are the blocks of its MCUs in order, 64 bytes
/// each, rows of 8.
struct JpegPicture {
  JpegView view;
  const uint32_t* factors;  // 64 per quantisation table, in zigzag order: factor | row-major index << 16
  uint32_t width;           // pixels
  uint32_t height;
  uint32_t mcu_width;  // pixels, multiples of 8
  uint32_t mcu_height;
  uint32_t mcu_blocks;
  uint32_t colour;  // JpegColour
  // Fixed-point reciprocals, since a GPU has no instruction for integer division; see divide_jpeg().
  uint32_t mcu_width_inverse;
  uint32_t mcu_height_inverse;
  uint32_t group_inverse;  // for view.group_mcus
  struct Scale {
    uint32_t x;  // 2^16 times the component's samples per pixel, rounded up
    uint32_t y;
  } scales[kJpegMaxComponents];
};

/// Bytes of a group's samples.
SCREE_HD inline uint32_t jpeg_group_bytes(const JpegPicture& picture) {
  return 64 * picture.mcu_blocks * picture.view.group_mcus;
}

/// Pixels of a group's MCUs, including pixels beyond the picture's edges.
SCREE_HD inline uint32_t jpeg_group_pixels(const JpegPicture& picture) {
  return picture.mcu_width * picture.mcu_height * picture.view.group_mcus;
}

/// Fixed-point reciprocal of a divisor of at most 32.
constexpr uint32_t jpeg_inverse(uint32_t divisor) {
  return ((1u << 31) + divisor - 1) / divisor;
}

/// value / divisor for value < 2^26. `inverse` is too large by less than 1, so the product is too large by less than
/// 2^26. It could be off by 2^31 / 32 before the quotient changed.
SCREE_HD inline uint32_t divide_jpeg(uint32_t value, uint32_t inverse) {
  return static_cast<uint32_t>(uint64_t{value} * inverse >> 31);
}

/// The one-dimensional inverse DCT of Loeffler, Ligtenberg and Moschytz with 13 bits of fraction: 8 values, `step`
/// apart, in place. The result is 2^3 times the orthogonal transform over 2^(shift - 13). Sums of damaged data may
/// wrap.
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

/// `value` limited to 0 .. 255.
SCREE_HD inline uint32_t clamp_jpeg_sample(int32_t value) {
  return value < 0 ? 0u : value > 255 ? 255u : static_cast<uint32_t>(value);
}

/// Turns 64 dequantised coefficients in row-major order into 64 samples (in a kernel 8-byte aligned). Overwrites
/// `coefficients`.
SCREE_HD inline void transform_jpeg_block(int32_t* coefficients, uint8_t* samples) {
  for (uint32_t i = 0; i < 8; ++i) transform_jpeg_line(coefficients + i, 8, 11);
  for (uint32_t i = 0; i < 8; ++i) transform_jpeg_line(coefficients + 8 * i, 1, 18);
#if defined(__CUDA_ARCH__)
  for (uint32_t i = 0; i < 64; i += 8) {
    uint32_t words[2] = {0, 0};
    for (uint32_t j = 0; j < 8; ++j) words[j / 4] |= clamp_jpeg_sample(coefficients[i + j] + 128) << (8 * (j % 4));
    *reinterpret_cast<uint2*>(samples + i) = {words[0], words[1]};
  }
#else
  for (uint32_t i = 0; i < 64; ++i) samples[i] = static_cast<uint8_t>(clamp_jpeg_sample(coefficients[i] + 128));
#endif
}

/// Decodes a block of component `c` to 64 samples. Returns false, and writes no samples, for invalid or truncated data.
SCREE_HD inline bool decode_jpeg_block_samples(const JpegPicture& picture, JpegCursor& cursor, uint32_t c,
                                               uint8_t* samples) {
  const uint32_t* const factors = picture.factors + 64 * picture.view.components[c].quant;
  int32_t coefficients[64] = {};
  const bool good = decode_jpeg_block(picture.view, cursor, c, [&](uint32_t k, int32_t value) {
    coefficients[factors[k] >> 16] = value * static_cast<int32_t>(factors[k] & 0xffffu);
  });
  if (good) transform_jpeg_block(coefficients, samples);
  return good;
}

/// Decodes the MCU at the cursor to 64 * mcu_blocks bytes of samples and advances the cursor. Returns false for invalid
/// or truncated data; blocks that were not decoded are then grey.
SCREE_HD inline bool decode_jpeg_samples(const JpegPicture& picture, JpegCursor& cursor, uint8_t* samples) {
  uint8_t* const end = samples + 64 * picture.mcu_blocks;
  bool good = cursor.mcu < picture.view.mcu_count;
  if (good) begin_jpeg_mcu(picture.view, cursor);
  for (uint32_t c = 0; good && c < picture.view.component_count; ++c) {
    const uint32_t count = uint32_t{picture.view.components[c].h} * picture.view.components[c].v;
    for (uint32_t i = 0; good && i < count; ++i) {
      good = decode_jpeg_block_samples(picture, cursor, c, samples);
      if (good) samples += 64;
    }
  }
  while (samples < end) *samples++ = 128;
  ++cursor.mcu;
  return good;
}

/// The number of MCUs in a group. `group`: below ceil(mcu_count / group_mcus).
SCREE_HD inline uint32_t jpeg_group_mcus(const JpegPicture& picture, uint32_t group) {
  const uint32_t left = picture.view.mcu_count - group * picture.view.group_mcus;
  return left < picture.view.group_mcus ? left : picture.view.group_mcus;
}

/// Decodes a whole group to 64 * mcu_blocks * group_mcus bytes. `group`: as for jpeg_group_mcus(). Bytes for MCUs past
/// the last one stay unchanged. Samples are grey from the first invalid or truncated block on. Safe on any data.
SCREE_HD inline void decode_jpeg_group(const JpegPicture& picture, uint32_t group, uint8_t* samples) {
  JpegCursor cursor = jpeg_anchor(picture.view, group);
  const uint32_t count = jpeg_group_mcus(picture, group);
  bool good = true;
  for (uint32_t i = 0; i < count; ++i) {
    if (!good) cursor.bit = picture.view.data_bits + 1;  // past the end, where no block decodes
    good = decode_jpeg_samples(picture, cursor, samples + 64 * i * picture.mcu_blocks);
  }
}

/// The location of a column or row of pixels.
struct JpegLine {
  uint32_t mcu;     // its column or row of MCUs
  uint32_t within;  // its place in the MCU
};

SCREE_HD inline JpegLine jpeg_column(const JpegPicture& picture, uint32_t x) {
  const uint32_t mcu = divide_jpeg(x, picture.mcu_width_inverse);
  return {mcu, x - mcu * picture.mcu_width};
}
SCREE_HD inline JpegLine jpeg_row(const JpegPicture& picture, uint32_t y) {
  const uint32_t mcu = divide_jpeg(y, picture.mcu_height_inverse);
  return {mcu, y - mcu * picture.mcu_height};
}

/// The location of a pixel: its group, the number of its MCU in the group, and its position in the MCU.
struct JpegPlace {
  uint32_t group;
  uint32_t mcu;
  uint32_t x;  // below mcu_width
  uint32_t y;
};

/// The location of a pixel, which must lie in the picture.
SCREE_HD inline JpegPlace jpeg_place(const JpegPicture& picture, const JpegLine& column, const JpegLine& row) {
  const uint32_t mcu = row.mcu * picture.view.mcus_across + column.mcu;
  const uint32_t group = divide_jpeg(mcu, picture.group_inverse);
  return {group, mcu - group * picture.view.group_mcus, column.within, row.within};
}
SCREE_HD inline JpegPlace jpeg_place(const JpegPicture& picture, uint32_t x, uint32_t y) {
  return jpeg_place(picture, jpeg_column(picture, x), jpeg_row(picture, y));
}

/// Index of the pixel's sample among the samples of component `c` in its MCU. Subsampled components are repeated, not
/// interpolated: pixel x of the MCU has sample floor(x * h / largest h).
SCREE_HD inline uint32_t jpeg_sample(const JpegPicture& picture, const JpegPlace& place, uint32_t c) {
  const uint32_t x = place.x * picture.scales[c].x >> 16;
  const uint32_t y = place.y * picture.scales[c].y >> 16;
  return 64 * ((y >> 3) * picture.view.components[c].h + (x >> 3)) + 8 * (y & 7u) + (x & 7u);
}

/// The encoded colour, red in the low byte, from the samples of a pixel's components.
SCREE_HD inline uint32_t jpeg_code(const JpegPicture& picture, const int32_t value[kJpegMaxComponents]) {
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

/// A pixel's encoded colour, from its group's samples.
SCREE_HD inline uint32_t jpeg_colour(const JpegPicture& picture, const JpegPlace& place, const uint8_t* samples) {
  const uint8_t* block = samples + 64 * place.mcu * picture.mcu_blocks;
  int32_t value[kJpegMaxComponents] = {};
  for (uint32_t c = 0; c < picture.view.component_count; ++c) {
    value[c] = block[jpeg_sample(picture, place, c)];
    block += 64 * picture.view.components[c].h * picture.view.components[c].v;
  }
  return jpeg_code(picture, value);
}

/// A pixel's index among the colours of its group: MCU by MCU, rows from the top.
SCREE_HD inline uint32_t jpeg_pixel(const JpegPicture& picture, const JpegPlace& place) {
  return (place.mcu * picture.mcu_height + place.y) * picture.mcu_width + place.x;
}

/// Makes the colours of eight pixels, which lie side by side, from the samples of their group. By jpeg_pixel() the
/// pixels have the numbers 8 * `run` to 8 * `run` + 7. In a kernel `colours` is 16-byte aligned.
SCREE_HD inline void jpeg_run_colours(const JpegPicture& picture, uint32_t run, const uint8_t* samples,
                                      uint32_t* colours) {
  const uint32_t row = divide_jpeg(8 * run, picture.mcu_width_inverse);  // MCUs lie one below the other
  const uint32_t mcu = divide_jpeg(row, picture.mcu_height_inverse);
  const JpegPlace first{0, mcu, 8 * run - row * picture.mcu_width, row - mcu * picture.mcu_height};
  const uint8_t* block = samples + 64 * mcu * picture.mcu_blocks;
  int32_t values[8][kJpegMaxComponents] = {};
  for (uint32_t c = 0; c < kJpegMaxComponents && c < picture.view.component_count; ++c) {
    for (uint32_t i = 0; i < 8; ++i) values[i][c] = block[jpeg_sample(picture, {0, mcu, first.x + i, first.y}, c)];
    block += 64 * picture.view.components[c].h * picture.view.components[c].v;
  }
#if defined(__CUDA_ARCH__)
  for (uint32_t i = 0; i < 8; i += 4)
    *reinterpret_cast<uint4*>(colours + i) = {jpeg_code(picture, values[i]), jpeg_code(picture, values[i + 1]),
                                              jpeg_code(picture, values[i + 2]), jpeg_code(picture, values[i + 3])};
#else
  for (uint32_t i = 0; i < 8; ++i) colours[i] = jpeg_code(picture, values[i]);
#endif
}

/// The colours of up to four pixels, as from jpeg_colour(), for callers without memory for a group's samples. `places`:
/// all in one group. `wanted`: one bit per pixel; colours of other pixels stay unchanged. Decodes the group up to the
/// last wanted pixel.
SCREE_HD inline void decode_jpeg_colours(const JpegPicture& picture, const JpegPlace places[4], uint32_t wanted,
                                         uint32_t colours[4]) {
  int32_t values[4][kJpegMaxComponents];
  uint32_t last_mcu = 0;
  uint32_t group = 0;
  for (uint32_t i = 0; i < 4; ++i) {
    for (uint32_t c = 0; c < kJpegMaxComponents; ++c) values[i][c] = 128;  // kept where the data are invalid
    if ((wanted >> i & 1u) == 0) continue;
    group = places[i].group;
    if (places[i].mcu > last_mcu) last_mcu = places[i].mcu;
  }
  JpegCursor cursor = jpeg_anchor(picture.view, group);
  bool good = true;
  for (uint32_t mcu = 0; good && mcu <= last_mcu && cursor.mcu < picture.view.mcu_count; ++mcu, ++cursor.mcu) {
    begin_jpeg_mcu(picture.view, cursor);
    for (uint32_t c = 0; good && c < picture.view.component_count; ++c) {
      const uint32_t count = uint32_t{picture.view.components[c].h} * picture.view.components[c].v;
      for (uint32_t block = 0; good && block < count; ++block) {
        alignas(8) uint8_t samples[64];
        good = decode_jpeg_block_samples(picture, cursor, c, samples);
        for (uint32_t i = 0; good && i < 4; ++i) {
          if ((wanted >> i & 1u) == 0 || places[i].mcu != mcu) continue;
          const uint32_t sample = jpeg_sample(picture, places[i], c);
          if (sample / 64 == block) values[i][c] = samples[sample % 64];
        }
      }
    }
  }
  for (uint32_t i = 0; i < 4; ++i)
    if ((wanted >> i & 1u) != 0) colours[i] = jpeg_code(picture, values[i]);
}

}  // namespace scree::format
