// Reads and compares two visibility buffers of one view, as written by `scree render --visbuffer`.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "format/result.h"
#include "tools/compare/pixels.h"
#include "tools/compare/scene_match.h"

namespace scree::compare {

/// Reads width * height little-endian 64-bit words. Errors kFile, kTruncated or kTrailing (the wrong number of bytes;
/// the message gives the right one).
Result<std::vector<uint64_t>> read_visibility(const std::string& path, uint32_t width, uint32_t height);

/// Compares `a` with `b`, which counts as right. `match`: the scenes of both buffers. Other meshes and neighbours are
/// distinguished by the vertices of the second scene; triangles with the same three corners there coincide. Null: both
/// buffers count as pictures of one file, and different ids are all kOtherTriangle. (Encoding, welding and attributes
/// change the order of triangles.) `view`: of both buffers. It may be null if they are perspective: the ratio of depths
/// then follows from the codes alone. Errors kRange (an id past its scene's triangles), those of SceneMatch. Throws
/// std::bad_alloc.
Result<PixelReport> compare_buffers(std::span<const uint64_t> a, std::span<const uint64_t> b, uint32_t width,
                                    uint32_t height, const SceneMatch* match, const kernels::View* view = nullptr);

}  // namespace scree::compare
