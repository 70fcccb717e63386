#include "tools/convert/windows/derived_tangents.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "tools/convert/windows/vectors.h"

namespace scree::convert {
namespace {

constexpr uint32_t kNormalMap = static_cast<uint32_t>(format::SurfaceUse::kNormalMap);
constexpr double kSineOfFloatTangents = 3.4906514152237e-3;  // of 0.2 degrees
constexpr double kSineOfByteTangents = 1.7452406437283e-2;   // of 1 degree

/// KHR_texture_transform without its offset.
struct TextureTurn {
  double scale[2];
  double cosine;
  double sine;

  explicit TextureTurn(const format::SurfaceTexture& use)
      : scale{use.uv_scale[0], use.uv_scale[1]},
        cosine(std::cos(static_cast<double>(use.uv_rotation))),
        sine(std::sin(static_cast<double>(use.uv_rotation))) {}

  void place(const float* uv, double out[2]) const {
    const double u = scale[0] * static_cast<double>(uv[0]);
    const double v = scale[1] * static_cast<double>(uv[1]);
    out[0] = cosine * u + sine * v;
    out[1] = cosine * v - sine * u;
  }
};

}  // namespace

const Accessor& normal_map_uv(const Primitive& primitive, const format::SurfaceRecord& surface) {
  const bool is_second = (surface.second_uv >> kNormalMap & 1u) != 0;
  return is_second && primitive.second_uv() != nullptr ? *primitive.second_uv() : *primitive.uv;
}

bool are_derived_tangents(const WindowContent& window, const VertexDirections& vertices,
                          const format::SurfaceRecord& surface, const Accessor& accessor) {
  assert(window.is_renumbered() && vertices.tangents.size() == 4 * window.vertices().size());
  const double sine = accessor.type == ComponentType::kInt8 ? kSineOfByteTangents : kSineOfFloatTangents;
  const TextureTurn turn(surface.textures[kNormalMap]);
  const std::span<const uint32_t> indices = window.indices();
  for (size_t i = 0; i + 2 < indices.size(); i += 3) {
    Vector corner[3];
    double uv[3][2];
    double largest = 0, largest_uv = 0;
    for (size_t c = 0; c < 3; ++c) {
      corner[c] = vector_at(window.positions(), 3 * size_t{indices[i + c]});
      turn.place(&vertices.uvs[2 * size_t{indices[i + c]}], uv[c]);
      largest = std::max(largest, largest_of(corner[c]));
      largest_uv = std::max({largest_uv, std::fabs(uv[c][0]), std::fabs(uv[c][1])});
    }
    const Vector edge[2] = {corner[1] - corner[0], corner[2] - corner[0]};
    const double d[2][2] = {{uv[1][0] - uv[0][0], uv[1][1] - uv[0][1]}, {uv[2][0] - uv[0][0], uv[2][1] - uv[0][1]}};
    const double area = d[0][0] * d[1][1] - d[1][0] * d[0][1];
    const double spread = std::fabs(d[0][0]) + std::fabs(d[0][1]) + std::fabs(d[1][0]) + std::fabs(d[1][1]);
    if (!(std::fabs(area) > kFloatRounding * largest_uv * spread)) continue;
    const double side = area > 0 ? 1 : -1;
    const Vector along_u = (edge[0] * d[1][1] - edge[1] * d[0][1]) * side;
    const Vector along_v = (edge[1] * d[0][0] - edge[0] * d[1][0]) * side;
    // The possible error of both vectors from the rounding of positions and texture coordinates.
    const double blur = kFloatRounding * (largest * spread + largest_uv * (length(edge[0]) + length(edge[1])));
    for (size_t c = 0; c < 3; ++c) {
      const size_t vertex = indices[i + c];
      Vector normal = vector_at(vertices.normals, 3 * vertex);
      const Vector stated = vector_at(vertices.tangents, 4 * vertex);
      const double normal_length = length(normal), stated_length = length(stated);
      if (!(normal_length > 0) || !std::isfinite(normal_length) || !std::isfinite(stated_length)) continue;
      normal = normal * (1 / normal_length);
      const Vector derived = along_u - normal * dot(normal, along_u);
      const Vector tangent = stated - normal * dot(normal, stated);
      const double derived_length = length(derived), tangent_length = length(tangent);
      if (!(derived_length > 2 * blur) || !(tangent_length > 1e-6 * stated_length)) continue;
      const double allowed = std::max(sine, blur / derived_length);
      const double product = derived_length * tangent_length;
      if (!(dot(derived, tangent) > 0) || length(cross(derived, tangent)) > allowed * product) return false;
      const double up = dot(cross(normal, derived), along_v);
      if (std::fabs(up) <= 2 * blur * derived_length) continue;
      if ((up > 0) != (vertices.tangents[4 * vertex + 3] < 0)) return false;
    }
  }
  return true;
}

}  // namespace scree::convert
