// Mip levels of a picture that is given row by row. Each level is the box filter of the picture, in linear light; no
// level is held in memory.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace scree::runtime {

using Texel = std::array<float, 4>;  // linear colour, or numbers; alpha / 255

/// The meaning of 8-bit codes: sRGB-coded colour, or numbers from 0 to 1 (normals, roughness...). Mip levels are means
/// of linear light or of these numbers.
enum class TexelCoding { kColor, kNumbers };

/// Levels of a picture of this size down to 1 x 1, including level 0, the picture itself. Sides of level l are max(1,
/// side >> l).
uint32_t mip_level_count(uint32_t width, uint32_t height);

/// Computes the levels below level 0, up to `last` (0: none). Each texel is the mean of the area that it covers in the
/// level above, before rounding. For an odd side that area is two texels and a fraction, so that no column or row is
/// lost and the picture's mean stays the same. Holds two rows per level.
class MipRows {
 public:
  using Sink = std::function<void(uint32_t level, uint32_t y, std::span<const Texel> row)>;

  /// `sink`: called with every row of every level from 1 on as soon as the row is complete, each level from the top.
  MipRows(uint32_t width, uint32_t height, uint32_t last, Sink sink);

  /// The next row of level 0, from the top.
  void push(std::span<const Texel> row) { push(0, row); }

 private:
  /// The texels of a row (or column) that one texel of the next level covers, and their weights.
  struct Taps {
    uint32_t first;
    uint32_t count;
    std::array<float, 3> weight;
  };
  struct Level {  // a level, and how the next one follows from it
    std::vector<Taps> across;
    std::vector<Taps> down;
    bool is_even;                            // its width
    uint32_t row = 0;                        // the row that comes next
    uint32_t next = 0;                       // the first incomplete row of the next level
    std::array<std::vector<Texel>, 2> sums;  // of rows `next` and `next` + 1, indexed by the row's last bit
  };

  static std::vector<Taps> make_taps(uint32_t size);
  static void add_row(const Level& level, const Texel* source, float weight, Texel* out);
  void push(uint32_t number, std::span<const Texel> row);

  Sink sink_;
  std::vector<Level> levels_;
};

}  // namespace scree::runtime
