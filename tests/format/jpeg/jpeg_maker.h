// Makes JPEG files and reads their coefficients with libjpeg, for the tests.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace scree::tests {

struct JpegRecipe {
  std::string name;
  int width = 0, height = 0;
  std::vector<std::pair<int, int>> factors;  // by component: 1 grey, 3 YCbCr or RGB, 4 CMYK
  int quality = 85;
  int restart = 0;  // in MCUs
  bool is_rgb = false, is_optimised = false, is_progressive = false, is_arithmetic = false;
  bool has_scan_each = false;     // every component has its own scan
  bool has_wide_quant = false;    // 16-bit quantisation tables
  bool has_three_tables = false;  // every component has its own quantisation and Huffman tables
  bool has_segments = false;      // EXIF, a long APP13 and a comment
};

/// A noisy, reproducible picture with this encoding.
std::vector<std::byte> make_jpeg(const JpegRecipe& recipe);

/// A recipe of every kind that encode_jpeg_index accepts, in several sizes.
std::vector<JpegRecipe> indexable_recipes();

/// Blocks of 64 quantised coefficients in row-major order, rows of blocks top to bottom.
struct JpegPlane {
  uint32_t blocks_across = 0, blocks_down = 0;
  std::vector<int16_t> values;
};

/// The coefficients of jpeg_read_coefficients, one plane per component. Ends the program if libjpeg cannot read the
/// file.
std::vector<JpegPlane> read_coefficients(std::span<const std::byte> file);

/// The quantisation table of each component, row-major, as in libjpeg.
std::vector<std::vector<uint16_t>> read_quant_tables(std::span<const std::byte> file);

/// Samples of a component, rows top to bottom.
struct JpegSamples {
  uint32_t width = 0, height = 0;
  std::vector<uint8_t> values;
};

/// The components after libjpeg's JDCT_ISLOW, before upsampling and colour conversion. Missing data of a progressive
/// file are not guessed (no block smoothing).
std::vector<JpegSamples> read_samples(std::span<const std::byte> file);

/// 3 bytes per pixel, by JDCT_ISLOW. `is_fancy`: chroma is interpolated, not repeated.
std::vector<uint8_t> read_rgb(std::span<const std::byte> file, bool is_fancy);

/// libjpeg's J_COLOR_SPACE of the file's components.
int read_colour_space(std::span<const std::byte> file);

}  // namespace scree::tests
