// Whether tangents say no more than texture coordinates do.
#pragma once

#include <span>

#include "tools/convert/windows/window.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// The texture coordinates of a primitive's normal map.
const Accessor& normal_map_uv(const Primitive& primitive, const format::SurfaceRecord& surface);

/// Of each of a window's vertices 3, 2 and 4 values. The texture coordinates are those of the normal map.
struct VertexDirections {
  std::span<const float> normals;
  std::span<const float> uvs;
  std::span<const float> tangents;
};

/// Whether at every corner of a window's triangles the tangent and its sign are those that shading derives from the
/// triangle's texture coordinates (spec/rasterization.md 9), as far as either is known:
/// - the angle between the two around the normal is at most 0.2 degrees (1 degree where tangents are bytes): about
///   what a stored tangent may be off, or
/// - positions and texture coordinates that move by their rounding could turn the derived tangent so far.
/// Triangles without an area in the texture, and normals and tangents without a direction, count for nothing. The
/// window is renumbered. `accessor`: of the tangents. The same on every machine.
bool are_derived_tangents(const WindowContent& window, const VertexDirections& vertices,
                          const format::SurfaceRecord& surface, const Accessor& accessor);

}  // namespace scree::convert
