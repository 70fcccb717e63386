// The reference rasteriser: what exact arithmetic draws of the source's own float32 vertices, for judging what kernels/
// draws of quantised ones. Brute force in double precision: a ray through every pixel centre, no quantisation, no
// snapping, no clipping, no depth code. It shares the type View with kernels/ and not a line of code.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "format/layout.h"
#include "format/result.h"
#include "kernels/frame.h"

namespace scree::compare {

/// The alpha of a mesh's material: what of its triangles is there (spec/rasterization.md 12), without places of 1/256
/// of a texel and with footprints as they are.
struct ReferenceMask {
  std::array<std::array<double, 3>, 2> place{};  // of texture coordinates (u, v, 1)
  std::array<format::Wrap, 2> wrap{};
  uint32_t width = 0;  // texels of level 0; of level l max(1, width >> l)
  uint32_t height = 0;
  std::vector<std::vector<uint8_t>> levels;
  double cutoff = 0;  // least code of 8 bits that passes
  bool nearest = false;
};

/// A mesh in object space; what it points to outlives it.
struct ReferenceMesh {
  std::span<const float> positions;         // x y z; finite where a kept triangle uses them
  std::span<const uint32_t> corners;        // 3 a triangle, counter-clockwise from the front
  const std::vector<bool>* kept = nullptr;  // by triangle; null: all are drawn
  bool double_sided = false;
  const ReferenceMask* mask = nullptr;  // null: all of every triangle is there
  std::span<const float> uvs{};         // u v a vertex, where there is a mask
  std::span<const float> alphas{};      // of the vertex colours, where there is a mask; empty: 1
  bool is_drawn = true;                 // false: nothing of it is opaque
};

struct ReferenceInstance {
  uint32_t mesh = 0;                             // in the list of meshes
  std::array<std::array<double, 4>, 3> world{};  // rows of (x, y, z, translation)
};

/// How much less than exact the drawing is: what a narrower rasteriser would lose, one thing at a time. All 0: nothing.
struct ReferenceMode {
  /// Corners are rounded to 1 / snap of a pixel before coverage and depth are decided, from double-precision
  /// projections and in exact integers; even, 2 to 65536.
  uint32_t snap = 0;
  /// Depths are rounded to those that a code of 28 bits (as spec/rasterization.md 5 has it) or of 32 (a float of near /
  /// depth, as it is) can tell apart; orthographic: fixed point of as many bits.
  uint32_t depth_bits = 0;
};

/// What lies under a pixel's centre.
struct ReferencePixel {
  uint32_t instance = format::kNone;                       // kNone: background
  uint64_t triangle = 0;                                   // of the instance's mesh
  double depth = std::numeric_limits<double>::infinity();  // along View::forward, world units

  bool is_background() const { return instance == format::kNone; }
};

/// Draws all instances: width * height pixels, rows top to bottom. A triangle covers a pixel when the ray through the
/// pixel's centre meets it, exact ties going to the triangle whose left or top edge it is (as spec/rasterization.md 4);
/// the nearest at or beyond the near plane wins, of equal depths the first in order of instances and triangles. Back
/// faces of meshes that are not double-sided are left out, and what a mask hides. Vertices and rays are rounded to
/// double, once an operation: places are off by some 1e-16 of the distance. The result does not depend on `threads`.
/// Takes 24 bytes a pixel and 200 MiB at most for triangles. Errors kRange (an image side of 0 or over
/// kernels::kMaxImageSide), kMemory.
Result<std::vector<ReferencePixel>> draw_reference(std::span<const ReferenceMesh> meshes,
                                                   std::span<const ReferenceInstance> instances,
                                                   const kernels::View& view, uint32_t threads,
                                                   const ReferenceMode& mode = {});

/// The depth of one triangle at a pixel's centre; nothing where it does not cover it.
std::optional<double> reference_depth(const ReferenceMesh& mesh, const ReferenceInstance& instance, uint64_t triangle,
                                      const kernels::View& view, uint32_t x, uint32_t y);

}  // namespace scree::compare
