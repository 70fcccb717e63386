// The reference rasteriser. It draws the float32 vertices of a source exactly, to judge the pictures that kernels/
// draws from quantised vertices. It casts a ray through every pixel centre in double precision, without quantisation,
// snapping, clipping or depth codes. It shares the type View with kernels/, but no algorithms.
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

/// The alpha mask of a mesh's material (spec/rasterization.md 12). Texture positions are not rounded to 1/256 of a
/// texel, and footprints are exact.
struct ReferenceMask {
  std::array<std::array<double, 3>, 2> place{};  // maps texture coordinates (u, v, 1) to the mask
  std::array<format::Wrap, 2> wrap{};
  uint32_t width = 0;  // texels of level 0; of level l max(1, width >> l)
  uint32_t height = 0;
  std::vector<std::vector<uint8_t>> levels;
  double cutoff = 0;               // smallest 8-bit code that passes the test
  bool magnified_nearest = false;  // the nearest texel where a sample covers less than one
  bool minified_nearest = false;   // and where it covers more
};

/// A mesh in object space. The data that it refers to must outlive it.
struct ReferenceMesh {
  std::span<const float> positions;         // x y z; finite for all vertices of kept triangles
  std::span<const uint32_t> corners;        // 3 per triangle, counter-clockwise from the front
  const std::vector<bool>* kept = nullptr;  // by triangle; null: all are drawn
  bool double_sided = false;
  const ReferenceMask* mask = nullptr;  // null: opaque
  std::span<const float> uvs{};         // u v per vertex, if there is a mask
  std::span<const float> alphas{};      // of the vertex colours, if there is a mask; empty: 1
  bool is_drawn = true;                 // false: no part of it is opaque
};

struct ReferenceInstance {
  uint32_t mesh = 0;                             // index in the list of meshes
  std::array<std::array<double, 4>, 3> world{};  // rows of (x, y, z, translation)
};

/// Roundings that show the loss of a narrower rasteriser, one at a time. All 0: exact.
struct ReferenceMode {
  /// Corners, projected in double precision, are rounded to 1 / snap of a pixel. Coverage and depth are then computed
  /// in exact integers. Even, 2 to 65536; 0: no rounding.
  uint32_t snap = 0;
  /// Depths are rounded to the precision of a depth code: 28 bits (spec/rasterization.md 5) or 32 bits (the float near
  /// / depth); orthographic: fixed point with as many bits. 0: no rounding.
  uint32_t depth_bits = 0;
};

/// The surface under a pixel's centre.
struct ReferencePixel {
  uint32_t instance = format::kNone;                       // kNone: background
  uint64_t triangle = 0;                                   // of the instance's mesh
  double depth = std::numeric_limits<double>::infinity();  // along View::forward, world units

  bool is_background() const { return instance == format::kNone; }
};

/// Draws all instances: width * height pixels, rows top to bottom. A triangle covers a pixel if the ray through the
/// pixel's centre hits it. A centre exactly on an edge belongs to the triangle of which this is a left or top edge
/// (spec/rasterization.md 4). The nearest triangle at or beyond the near plane wins; at equal depths, the first one in
/// order of instances and triangles. Back faces of meshes that are not double-sided are omitted, as are parts that a
/// mask hides. Arithmetic is in double, so positions have errors of about 1e-16 of the distance. The result does not
/// depend on `threads`. Takes 24 bytes per pixel and at most 200 MiB for triangles. Errors kRange (an image side of 0
/// or over kernels::kMaxImageSide), kMemory.
Result<std::vector<ReferencePixel>> draw_reference(std::span<const ReferenceMesh> meshes,
                                                   std::span<const ReferenceInstance> instances,
                                                   const kernels::View& view, uint32_t threads,
                                                   const ReferenceMode& mode = {});

/// The depth of one triangle at a pixel's centre; nullopt if it does not cover the centre.
std::optional<double> reference_depth(const ReferenceMesh& mesh, const ReferenceInstance& instance, uint64_t triangle,
                                      const kernels::View& view, uint32_t x, uint32_t y);

}  // namespace scree::compare
