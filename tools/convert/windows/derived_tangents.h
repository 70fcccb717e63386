// Finds out whether tangents can be derived from texture coordinates.
#pragma once

#include <span>

#include "tools/convert/windows/window.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// The texture coordinates of a primitive's normal map.
const Accessor& normal_map_uv(const Primitive& primitive, const format::SurfaceRecord& surface);

/// Per vertex of a window: 3 values of the normal, 2 texture coordinates of the normal map, 4 values of the tangent.
struct VertexDirections {
  std::span<const float> normals;
  std::span<const float> uvs;
  std::span<const float> tangents;
};

/// Whether, at every corner of a window's triangles, the tangent and its sign equal those that shading derives from the
/// triangle's texture coordinates (spec/rasterization.md 9). They count as equal if
/// - the angle between the two around the normal is at most 0.2 degrees (1 degree if tangents are bytes), about the
///   error of a stored tangent, or
/// - the rounding of positions and texture coordinates could turn the derived tangent that far.
/// Triangles without an area in the texture, and normals and tangents without a direction, are skipped. The window must
/// be renumbered. `accessor`: of the tangents. The result is the same on every machine.
bool are_derived_tangents(const WindowContent& window, const VertexDirections& vertices,
                          const format::SurfaceRecord& surface, const Accessor& accessor);

}  // namespace scree::convert
