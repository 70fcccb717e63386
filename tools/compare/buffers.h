// Two visibility buffers of one view, as `scree render --visbuffer` writes them.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "format/result.h"
#include "tools/compare/pixels.h"
#include "tools/compare/scene_match.h"

namespace scree::compare {

/// Reads width * height little-endian 64-bit words. Errors kFile, kTruncated or kTrailing (another number of bytes, and
/// which number is expected).
Result<std::vector<uint64_t>> read_visibility(const std::string& path, uint32_t width, uint32_t height);

/// Compares `a` with `b`, which count as the right ones. `match`: the scenes that their ids are of; it tells other
/// meshes and neighbours apart by the second scene's vertices, and calls triangles coincident whose corners are the
/// same three places there. Null: ids count as those of one file (the encoding, welding and attributes change the order
/// of triangles), and triangles of other ids are all kOtherTriangle. Depths are those of perspective views: their ratio
/// follows from the codes alone. Errors kRange (an id past its scene's triangles), those of SceneMatch. Throws
/// std::bad_alloc.
Result<PixelReport> compare_buffers(std::span<const uint64_t> a, std::span<const uint64_t> b, uint32_t width,
                                    uint32_t height, const SceneMatch* match);

}  // namespace scree::compare
