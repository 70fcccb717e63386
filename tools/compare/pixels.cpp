#include "tools/compare/pixels.h"

#include <algorithm>

#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"

namespace scree::compare {
namespace {

struct KindText {
  const char* key;
  const char* title;
  std::array<uint8_t, 3> colour;
};

constexpr std::array<KindText, kPixelKinds> kKinds{{
    {"both_background", "background in both", {255, 255, 255}},
    {"same", "same triangle", {160, 160, 160}},
    {"coincident", "coincident triangles", {160, 160, 160}},
    {"background", "background against surface", {0, 0, 255}},
    {"other_mesh", "other mesh or instance", {255, 0, 0}},
    {"apart", "triangle sharing no vertex", {255, 160, 0}},
    {"neighbour", "neighbouring triangle", {0, 130, 0}},
    {"other_triangle", "other triangle", {255, 0, 0}},
}};

const KindText& text_of(PixelKind kind) {
  return kKinds[static_cast<size_t>(kind)];
}

}  // namespace

const char* kind_title(PixelKind kind) {
  return text_of(kind).title;
}

const char* kind_key(PixelKind kind) {
  return text_of(kind).key;
}

std::array<uint64_t, kPixelKinds> PixelReport::counts() const {
  std::array<uint64_t, kPixelKinds> out{};
  for (const PixelKind kind : kinds) ++out[static_cast<size_t>(kind)];
  return out;
}

bool PixelReport::tells(PixelKind kind) const {
  if (kind == PixelKind::kOtherTriangle) return !triangles_known;
  const bool needs_triangles = kind == PixelKind::kCoincident || kind == PixelKind::kOtherMesh ||
                               kind == PixelKind::kApart || kind == PixelKind::kNeighbour;
  return triangles_known || !needs_triangles;
}

uint64_t PixelReport::wrong() const {
  return static_cast<uint64_t>(std::count_if(kinds.begin(), kinds.end(), is_wrong));
}

bool share_vertex(const std::array<std::array<float, 3>, 3>& a, const std::array<std::array<float, 3>, 3>& b) {
  for (const auto& p : a)
    for (const auto& q : b)
      if (p == q) return true;
  return false;
}

Result<void> write_difference(const std::string& path, const PixelReport& report, format::Existing existing) {
  std::vector<uint8_t> pixels;
  pixels.reserve(3 * report.kinds.size());
  for (const PixelKind kind : report.kinds) {
    const auto& colour = text_of(kind).colour;
    pixels.insert(pixels.end(), colour.begin(), colour.end());
  }
  return runtime::write_png(path, {report.width, report.height, 3, pixels}, {}, existing);
}

}  // namespace scree::compare
