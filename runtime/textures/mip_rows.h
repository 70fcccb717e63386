// Mip levels from a picture that comes row by row: each level is the box filter of the picture, in linear light, and no
// level is held.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

namespace scree::runtime {

using Texel = std::array<float, 4>;  // linear colour, or numbers; alpha / 255

/// What 8-bit codes are: sRGB-coded colour, or numbers from 0 to 1 (normals, roughness...). Levels are the mean of that.
enum class TexelCoding { kColor, kNumbers };

/// Levels of a picture of this size down to 1 x 1, the picture itself (level 0) included; level l is max(1, side >> l)
/// a side.
uint32_t mip_level_count(uint32_t width, uint32_t height);

/// The levels below level 0, up to `last` (0: none). Each texel is the mean of the area it covers of the level above,
/// which was not rounded: where a side was odd, of two texels and a fraction, so that no column or row is lost and the
/// picture's mean stays. Holds two rows a level.
class MipRows {
 public:
  using Sink = std::function<void(uint32_t level, uint32_t y, std::span<const Texel> row)>;

  /// `sink`: called with every row of every level from 1 on, each level's from the top, as soon as it is known.
  MipRows(uint32_t width, uint32_t height, uint32_t last, Sink sink);

  /// The next row of level 0, from the top.
  void push(std::span<const Texel> row) { push(0, row); }

 private:
  /// Which texels of a row (or column) one texel of the next level covers, and by how much.
  struct Taps {
    uint32_t first;
    uint32_t count;
    std::array<float, 3> weight;
  };
  struct Level {  // and how it becomes the next
    std::vector<Taps> across;
    std::vector<Taps> down;
    bool is_even;                            // its width
    uint32_t row = 0;                        // that comes next
    uint32_t next = 0;                       // row of the next level that is not complete
    std::array<std::vector<Texel>, 2> sums;  // of rows `next` and `next` + 1, by their last bit
  };

  static std::vector<Taps> make_taps(uint32_t size);
  static void add_row(const Level& level, const Texel* source, float weight, Texel* out);
  void push(uint32_t number, std::span<const Texel> row);

  Sink sink_;
  std::vector<Level> levels_;
};

}  // namespace scree::runtime
