// The differences of two visibility buffers, pixel by pixel.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "format/container/part_file.h"
#include "format/result.h"

namespace scree::compare {

/// The relation of the two surfaces at a pixel. The first three kinds count as right.
enum class PixelKind : uint8_t {
  kBothBackground,
  kSame,           // one triangle of one instance
  kCoincident,     // two triangles with the same depth at this pixel; either is right
  kBackground,     // background against surface
  kOtherMesh,      // another mesh, or another instance of it
  kApart,          // one instance, two triangles that share no vertex
  kNeighbour,      // one instance, two triangles that share a vertex
  kOtherTriangle,  // two triangles whose relation is not known
};
inline constexpr size_t kPixelKinds = 8;

inline bool is_wrong(PixelKind kind) {
  return kind >= PixelKind::kBackground;
}

/// Names for people and for --json.
const char* kind_title(PixelKind kind);
const char* kind_key(PixelKind kind);

/// Statistics of |a - b| / b over depths (distances from the eye's plane).
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
  bool triangles_known = true;   // false: all different triangles are kOtherTriangle
  DepthError same_depth;         // of pixels that show the same triangle
  DepthError surface_depth;      // of all pixels that show a surface in both

  std::array<uint64_t, kPixelKinds> counts() const;
  /// Whether this comparison can find pixels of that kind.
  bool tells(PixelKind kind) const;
  uint64_t wrong() const;
};

/// Whether two triangles have a corner in common, equal bit for bit.
bool share_vertex(const std::array<std::array<float, 3>, 3>& a, const std::array<std::array<float, 3>, 3>& b);

/// Writes a picture of the kinds: right surfaces grey, right background white, one colour per other kind (`scree
/// compare --help` has the legend). Errors kFile.
Result<void> write_difference(const std::string& path, const PixelReport& report,
                              format::Existing existing = format::Existing::kReplace);

}  // namespace scree::compare
