// What two visibility buffers disagree about, pixel by pixel.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "format/container/part_file.h"
#include "format/result.h"

namespace scree::compare {

/// How a pixel's two answers stand to each other; the first three are right.
enum class PixelKind : uint8_t {
  kBothBackground,
  kSame,           // one triangle of one instance
  kCoincident,     // two triangles that lie in the same place at this pixel, either of which is right
  kBackground,     // background against surface
  kOtherMesh,      // another mesh, or another instance of it
  kApart,          // one instance, two triangles that share no vertex
  kNeighbour,      // one instance, two triangles that share a vertex
  kOtherTriangle,  // two triangles of which nothing more is known
};
inline constexpr size_t kPixelKinds = 8;

inline bool is_wrong(PixelKind kind) {
  return kind >= PixelKind::kBackground;
}

/// Names for people and for --json.
const char* kind_title(PixelKind kind);
const char* kind_key(PixelKind kind);

/// |a - b| / b of depths: distances from the eye's plane.
class DepthError {
 public:
  void add(double found, double expected) {
    const double error = std::abs(found - expected) / std::abs(expected);
    max_ = std::fmax(max_, error);
    squares_ += error * error;
    ++count_;
  }
  void add(const DepthError& other) {
    max_ = std::fmax(max_, other.max_);
    squares_ += other.squares_;
    count_ += other.count_;
  }
  uint64_t count() const { return count_; }
  double max() const { return max_; }
  double rms() const { return count_ == 0 ? 0 : std::sqrt(squares_ / static_cast<double>(count_)); }

 private:
  uint64_t count_ = 0;
  double max_ = 0;
  double squares_ = 0;
};

struct PixelReport {
  uint32_t width = 0;
  uint32_t height = 0;
  std::vector<PixelKind> kinds;  // width * height, rows top to bottom
  bool triangles_known = true;   // false: wrong triangles are all kOtherTriangle
  DepthError same_depth;         // of pixels of one triangle
  DepthError surface_depth;      // of all pixels with a surface in both

  std::array<uint64_t, kPixelKinds> counts() const;
  /// Whether this comparison can tell a pixel to be of that kind.
  bool tells(PixelKind kind) const;
  uint64_t wrong() const;
};

/// Two triangles by the bits of their nine coordinates each: whether they have a corner in common.
bool share_vertex(const std::array<std::array<float, 3>, 3>& a, const std::array<std::array<float, 3>, 3>& b);

/// A picture of the kinds: right surfaces grey, right background white, wrong pixels a colour each (the legend is in
/// `scree compare --help`). Errors kFile.
Result<void> write_difference(const std::string& path, const PixelReport& report,
                              format::Existing existing = format::Existing::kReplace);

}  // namespace scree::compare
