// Morton's space-filling curve: points that are close on it are close in space.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <compare>
#include <cstdint>
#include <utility>
#include <vector>

#include "tools/gltf/box.h"

namespace scree::convert {

/// Puts two zeros between the bits of a number below 2^21.
inline uint64_t spread(uint64_t x) {
  x = (x | x << 32) & 0x001f00000000ffffu;
  x = (x | x << 16) & 0x001f0000ff0000ffu;
  x = (x | x << 8) & 0x100f00f00f00f00fu;
  x = (x | x << 4) & 0x10c30c30c30c30c3u;
  x = (x | x << 2) & 0x1249249249249249u;
  return x;
}

/// The position of a point on the curve through a box. Points outside are moved to its border; NaN gives 0.
class Curve {
 public:
  static constexpr uint32_t kAxisBits = 21;
  static constexpr uint32_t kKeyBits = 3 * kAxisBits;

  explicit Curve(const Box& box) : lo_{box.lo[0], box.lo[1], box.lo[2]} {
    double extent = 0;
    for (size_t axis = 0; axis < 3; ++axis) extent = std::max(extent, double{box.hi[axis]} - double{box.lo[axis]});
    scale_ = extent > 0 ? static_cast<double>(uint64_t{1} << kAxisBits) / extent : 0;
  }

  uint64_t key(const float* point) const {
    constexpr double kMost = (1 << kAxisBits) - 1;
    uint64_t key = 0;
    for (size_t axis = 0; axis < 3; ++axis) {
      const double place = (double{point[axis]} - lo_[axis]) * scale_;
      const uint64_t cell = place > 0 ? static_cast<uint64_t>(std::min(place, kMost)) : 0;  // NaN: 0
      key |= spread(cell) << axis;
    }
    return key;
  }

 private:
  std::array<double, 3> lo_;
  double scale_;
};

/// A vertex of a sample.
struct CurveSample {
  std::array<float, 3> point;
  uint32_t number;
};

/// The box of the samples (finite) without the outermost 64th on each side, enlarged by a sixteenth and clipped to
/// `all`, the box of all vertices. With the box of all samples, a few far points could put all others at one position
/// on the curve. Reorders the samples.
Box box_of_most(const Box& all, std::vector<CurveSample>& samples);

/// Vertices ordered along the curve, equal positions by number. This is a total order, so even a scene with equal
/// positions can be divided evenly.
struct CurvePlace {
  uint64_t key;
  uint32_t number;
  auto operator<=>(const CurvePlace&) const = default;
};

/// The curve divided at borders. A border is the first CurvePlace of the part after it.
class CurveParts {
 public:
  CurveParts() : CurveParts(std::vector<CurvePlace>()) {}

  /// `borders`: ascending.
  explicit CurveParts(std::vector<CurvePlace> borders) : borders_(std::move(borders)) {
    const uint64_t last = borders_.empty() ? 0 : borders_.back().key;
    shift_ = static_cast<uint32_t>(std::max(0, static_cast<int>(std::bit_width(last)) - kGuideBits));
    below_.resize((last >> shift_) + 2);
    uint32_t below = 0;
    for (uint64_t bits = 0; bits < below_.size(); ++bits) {
      while (below < borders_.size() && borders_[below].key >> shift_ < bits) ++below;
      below_[bits] = below;
    }
  }

  uint32_t count() const { return static_cast<uint32_t>(borders_.size() + 1); }

  /// The part that contains a vertex.
  uint32_t find(const CurvePlace& place) const {
    const uint64_t bits = std::min<uint64_t>(place.key >> shift_, below_.size() - 1);
    uint32_t part = below_[bits];
    const uint32_t end = bits + 1 < below_.size() ? below_[bits + 1] : part;
    if (end - part > kFew)
      return static_cast<uint32_t>(std::upper_bound(borders_.begin() + part, borders_.begin() + end, place) -
                                   borders_.begin());
    while (part < end && borders_[part] <= place) ++part;
    return part;
  }

  /// The upper bits of a key, relative to the first key of its part.
  uint32_t short_key(uint64_t key, uint32_t part) const {
    const uint64_t lo = part == 0 ? 0 : borders_[part - 1].key;
    const uint64_t hi = part == borders_.size() ? uint64_t{1} << Curve::kKeyBits : borders_[part].key;
    return static_cast<uint32_t>((key - lo) >> std::max(0, static_cast<int>(std::bit_width(hi - lo)) - 32));
  }

 private:
  // A table over the upper bits of a key halves the time of putting vertices into buckets.
  static constexpr int kGuideBits = 14;
  static constexpr uint32_t kFew = 8;

  std::vector<CurvePlace> borders_;
  std::vector<uint32_t> below_;  // by upper bits of a key: number of borders with smaller bits
  uint32_t shift_ = 0;
};

}  // namespace scree::convert
