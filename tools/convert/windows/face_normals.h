// Finds out whether normals can be derived from the faces.
#pragma once

#include <span>

#include "tools/convert/windows/window.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// Whether, at every corner of a window's triangles, the vertex normal equals the triangle's normal. They count as
/// equal if
/// - the angle between the two is at most 0.1 degrees (1 degree if normals are bytes), which changes the camera's light
///   by less than half a code of 8-bit sRGB, or
/// - moving a corner by 2^-22 of the triangle's largest coordinate, the rounding of its positions, could turn the
///   triangle that far.
/// Triangles without an area and normals without a direction are skipped. `normals`: 3 values per vertex of
/// window.vertices(), read from `accessor`. The window must be renumbered. The result is the same on every machine.
bool are_face_normals(const WindowContent& window, std::span<const float> normals, const Accessor& accessor);

}  // namespace scree::convert
