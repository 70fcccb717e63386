// Whether normals say no more than the faces do.
#pragma once

#include <span>

#include "tools/convert/windows/window.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// Whether at every corner of a window's triangles the vertex normal is the triangle's own, as far as either is known:
/// - the angle between the two is at most 0.1 degrees (1 degree where normals are bytes), which changes the camera's
///   light by less than half a code of 8-bit sRGB, or
/// - a corner that moves by 2^-22 of the triangle's largest coordinate, the rounding of its positions, could turn the
///   triangle so far.
/// Triangles without an area and normals without a direction show nothing and count for neither. `normals`: 3 for each
/// of window.vertices(), read from `accessor`. The window is renumbered. Exact but for rounding in double: the same on
/// every machine.
bool are_face_normals(const WindowContent& window, std::span<const float> normals, const Accessor& accessor);

}  // namespace scree::convert
