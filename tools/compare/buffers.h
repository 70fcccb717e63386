// Two visibility buffers of one view, as `scree render --visbuffer` writes them.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "format/container.h"
#include "format/result.h"
#include "runtime/scene.h"
#include "tools/compare/pixels.h"

namespace scree::compare {

/// Reads width * height little-endian 64-bit words. Errors kFile, kTruncated or kTrailing (another number of bytes, and
/// which number is expected).
Result<std::vector<uint64_t>> read_visibility(const std::string& path, uint32_t width, uint32_t height);

/// Compares `a` with `b`, which count as the right ones. Ids are those of one scene, whatever its encoding: neither
/// width nor encoding changes the order or number of triangles. `scene`: tells other meshes and neighbours apart; null:
/// they are all kOtherTriangle. Depths are those of perspective views: their ratio follows from the codes alone. Errors
/// kRange (an id past the scene's triangles), those of reading a chunk.
Result<PixelReport> compare_buffers(std::span<const uint64_t> a, std::span<const uint64_t> b, uint32_t width,
                                    uint32_t height, const runtime::Scene* scene);

}  // namespace scree::compare
