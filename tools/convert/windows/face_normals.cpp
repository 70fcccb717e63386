#include "tools/convert/windows/face_normals.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "tools/convert/windows/vectors.h"

namespace scree::convert {
namespace {

constexpr double kSineOfFloats = 1.7453283658983088e-3;  // of 0.1 degrees
constexpr double kSineOfBytes = 1.7452406437283513e-2;   // of 1 degree: codes of 1/127 per axis turn up to 0.4,
                                                         // two octahedral codes of 8 bits another 0.6

}  // namespace

bool are_face_normals(const WindowContent& window, std::span<const float> normals, const Accessor& accessor) {
  assert(window.is_renumbered() && normals.size() == 3 * window.vertices().size());
  const bool are_bytes = accessor.type == ComponentType::kInt8;
  const double sine = are_bytes ? kSineOfBytes : kSineOfFloats;
  const std::span<const uint32_t> indices = window.indices();
  for (size_t i = 0; i + 2 < indices.size(); i += 3) {
    Vector corner[3];
    for (size_t c = 0; c < 3; ++c) corner[c] = vector_at(window.positions(), 3 * size_t{indices[i + c]});
    const Vector edge[3] = {corner[1] - corner[0], corner[2] - corner[0], corner[2] - corner[1]};
    const Vector face = cross(edge[0], edge[1]);
    const double largest = std::max({largest_of(corner[0]), largest_of(corner[1]), largest_of(corner[2])});
    const double longest = std::max({dot(edge[0], edge[0]), dot(edge[1], edge[1]), dot(edge[2], edge[2])});
    const double area = dot(face, face);  // squared, twice
    // Moving a corner by the rounding turns the face by an angle whose sine is the rounding divided by the triangle's
    // height. The height is the area over the longest edge.
    const double rounding = kFloatRounding * largest * (kFloatRounding * largest) * longest;
    if (area <= rounding) continue;
    const double allowed = std::max(sine * sine * area, rounding);
    for (size_t c = 0; c < 3; ++c) {
      const Vector normal = vector_at(normals, 3 * size_t{indices[i + c]});
      const double squared = dot(normal, normal);
      if (!(squared > 0) || !std::isfinite(squared)) continue;
      const Vector turned = cross(normal, face);
      if (!(dot(normal, face) > 0) || dot(turned, turned) > squared * allowed) return false;
    }
  }
  return true;
}

}  // namespace scree::convert
