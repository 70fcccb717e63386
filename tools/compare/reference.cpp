#include "tools/compare/reference.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <string>

#include "runtime/threads/parallel.h"
#include "tools/compare/reference_geometry.h"
#include "tools/compare/reference_mask.h"
#include "tools/compare/reference_modes.h"

namespace scree::compare {
namespace {

using kernels::View;

constexpr uint64_t kBlockTriangles = 65536;    // per job of a thread
constexpr uint64_t kGroupTriangles = 1 << 20;  // per group, 160 bytes each

/// Pixels [x0, x1] x [y0, y1]; empty if x0 > x1 or y0 > y1.
struct PixelBox {
  uint32_t x0 = 1, y0 = 1, x1 = 0, y1 = 0;
  bool is_empty() const { return x0 > x1 || y0 > y1; }
};

struct SeenTriangle {
  std::array<SeenPoint, 3> corners;
  PixelBox box;
  uint32_t instance;
  uint64_t triangle;
};

struct Block {
  uint32_t instance;
  uint64_t first, count;  // triangles
};

bool is_mirrored(const ReferenceInstance& instance) {
  const auto& m = instance.world;
  return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
             m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]) <
         0;
}

/// Whether the edge from a to b is a left or top edge of its triangle, which lies on the left of it (y up). A pixel
/// centre on such an edge belongs to the triangle. The edge's line on the picture is A x + B y + C = 0, positive
/// inside.
bool owns_ties(const View& view, const SeenPoint& a, const SeenPoint& b, double orientation) {
  const double wa = view.orthographic ? 1 : a.z, wb = view.orthographic ? 1 : b.z;
  const double across = orientation * (a.y * wb - wa * b.y);
  const double upward = orientation * (wa * b.x - a.x * wb);
  return across > 0 || (across == 0 && upward < 0);
}

/// The depth at which the ray hits the triangle; nullopt if it misses.
std::optional<double> meet(const View& view, const std::array<SeenPoint, 3>& corners, Ray ray, bool mirrored,
                           bool double_sided) {
  const std::array<double, 3> edge = corner_weights(view, corners, ray);  // opposite corner n
  const double sum = edge[0] + edge[1] + edge[2];
  if (!(sum != 0)) return std::nullopt;  // edge-on, or not a number
  const double orientation = sum > 0 ? 1 : -1;
  if (!double_sided && (sum > 0) == mirrored) return std::nullopt;
  for (size_t n = 0; n < 3; ++n) {
    const double inside = orientation * edge[n];
    if (inside > 0) continue;
    if (inside < 0 || !owns_ties(view, corners[(n + 1) % 3], corners[(n + 2) % 3], orientation)) return std::nullopt;
  }
  const double depth = (edge[0] * corners[0].z + edge[1] * corners[1].z + edge[2] * corners[2].z) / sum;
  if (!(depth >= view.z_near) || (view.orthographic && !(depth <= view.z_far))) return std::nullopt;
  return depth;
}

/// A box of the pixels whose centres may lie in the triangle: the slightly enlarged box of its part beyond the near
/// plane. It only saves time.
PixelBox box_of(const View& view, const std::array<SeenPoint, 3>& corners, const ReferenceMode& mode) {
  double low_x = INFINITY, low_y = INFINITY, high_x = -INFINITY, high_y = -INFINITY;
  double slack = 1e-6 + (mode.snap == 0 ? 0 : 1.0 / mode.snap);
  const auto add = [&](double x, double y, double z) {
    const double scale = view.orthographic ? 1 : z;
    const double px = (x / (scale * view.half_width) + 1) * 0.5 * view.width - 0.5;
    const double py = (1 - y / (scale * view.half_height)) * 0.5 * view.height - 0.5;
    low_x = std::min(low_x, px);
    high_x = std::max(high_x, px);
    low_y = std::min(low_y, py);
    high_y = std::max(high_y, py);
  };
  for (size_t n = 0; n < 3; ++n) {
    const SeenPoint &a = corners[n], &b = corners[(n + 1) % 3];
    if (view.orthographic || a.z >= view.z_near) add(a.x, a.y, a.z);
    if (!view.orthographic && (a.z >= view.z_near) != (b.z >= view.z_near)) {
      const double t = (view.z_near - a.z) / (b.z - a.z);
      add(a.x + t * (b.x - a.x), a.y + t * (b.y - a.y), view.z_near);
      slack = 1;
    }
  }
  if (low_x > high_x) return {};  // all of it is nearer than the near plane
  slack += 1e-9 * std::max({std::abs(low_x), std::abs(high_x), std::abs(low_y), std::abs(high_y)});
  PixelBox box;
  if (std::isnan(slack)) return box;
  const double x0 = std::max(0.0, std::ceil(low_x - slack)),
               x1 = std::min(view.width - 1.0, std::floor(high_x + slack));
  const double y0 = std::max(0.0, std::ceil(low_y - slack)),
               y1 = std::min(view.height - 1.0, std::floor(high_y + slack));
  if (!(x0 <= x1 && y0 <= y1)) return box;
  box.x0 = static_cast<uint32_t>(x0);
  box.x1 = static_cast<uint32_t>(x1);
  box.y0 = static_cast<uint32_t>(y0);
  box.y1 = static_cast<uint32_t>(y1);
  return box;
}

/// Cuts the triangles of the instances into groups of blocks and calls `take(blocks)` for each group.
template <class Take>
void for_each_group(std::span<const ReferenceMesh> meshes, std::span<const ReferenceInstance> instances,
                    const Take& take) {
  std::vector<Block> group;
  uint64_t triangles = 0;
  for (uint32_t i = 0; i < instances.size(); ++i) {
    const ReferenceMesh& mesh = meshes[instances[i].mesh];
    const uint64_t count = mesh.is_drawn ? mesh.corners.size() / 3 : 0;
    for (uint64_t first = 0; first < count; first += kBlockTriangles) {
      group.push_back({i, first, std::min(kBlockTriangles, count - first)});
      triangles += group.back().count;
      if (triangles < kGroupTriangles) continue;
      take(group);
      group.clear();
      triangles = 0;
    }
  }
  if (!group.empty()) take(group);
}

/// Draws the rows [first, last] of a triangle.
void draw_rows(const View& view, const SeenTriangle& seen, const ReferenceMesh& mesh, bool mirrored,
               const ReferenceMode& mode, uint32_t first, uint32_t last, std::span<ReferencePixel> pixels) {
  const bool double_sided = mesh.double_sided;
  for (uint32_t y = std::max(first, seen.box.y0); y <= std::min(last, seen.box.y1); ++y) {
    for (uint32_t x = seen.box.x0; x <= seen.box.x1; ++x) {
      std::optional<double> depth = mode.snap == 0
                                        ? meet(view, seen.corners, ray_of(view, x, y), mirrored, double_sided)
                                        : meet_snapped(view, seen.corners, x, y, mode.snap, mirrored, double_sided);
      if (depth && mode.depth_bits != 0) depth = coded_depth(view, *depth, mode.depth_bits);
      ReferencePixel& pixel = pixels[uint64_t{y} * view.width + x];
      // Triangles are drawn in order; at equal depths the first one stays.
      if (!depth || !(*depth < pixel.depth)) continue;
      if (mesh.mask != nullptr && !mask_passes(view, mesh, seen.triangle, seen.corners, x, y)) continue;
      pixel = {seen.instance, seen.triangle, *depth};
    }
  }
}

}  // namespace

Result<std::vector<ReferencePixel>> draw_reference(std::span<const ReferenceMesh> meshes,
                                                   std::span<const ReferenceInstance> instances, const View& view,
                                                   uint32_t threads, const ReferenceMode& mode) try {
  if (view.width < 1 || view.height < 1 || std::max(view.width, view.height) > kernels::kMaxImageSide)
    return Error{ErrorCode::kRange, "a picture of " + std::to_string(view.width) + " x " + std::to_string(view.height) +
                                        " samples, expected 1 to " + std::to_string(kernels::kMaxImageSide) +
                                        " per side"};
  std::vector<ReferencePixel> pixels(uint64_t{view.width} * view.height);
  std::vector<bool> mirrored(instances.size());
  for (size_t i = 0; i < instances.size(); ++i) mirrored[i] = is_mirrored(instances[i]);
  const uint32_t bands = std::min(view.height, 4 * std::max(threads, 1u));
  for_each_group(meshes, instances, [&](const std::vector<Block>& blocks) {
    // Finds the triangles that may be visible, then draws them; each thread draws some rows of the picture.
    std::vector<std::vector<SeenTriangle>> seen(blocks.size());
    runtime::parallel_for(blocks.size(), threads, [&](uint64_t b) {
      const Block& block = blocks[b];
      const ReferenceInstance& instance = instances[block.instance];
      const ReferenceMesh& mesh = meshes[instance.mesh];
      for (uint64_t t = block.first; t < block.first + block.count; ++t) {
        if (mesh.kept != nullptr && !(*mesh.kept)[t]) continue;
        SeenTriangle triangle{seen_corners(view, mesh, instance, t), {}, block.instance, t};
        triangle.box = box_of(view, triangle.corners, mode);
        if (!triangle.box.is_empty()) seen[b].push_back(triangle);
      }
    });
    runtime::parallel_for(bands, threads, [&](uint64_t band) {
      const auto first = static_cast<uint32_t>(band * view.height / bands);
      const auto last = static_cast<uint32_t>((band + 1) * view.height / bands - 1);
      for (const std::vector<SeenTriangle>& block : seen)
        for (const SeenTriangle& triangle : block)
          if (triangle.box.y0 <= last && triangle.box.y1 >= first)
            draw_rows(view, triangle, meshes[instances[triangle.instance].mesh], mirrored[triangle.instance], mode,
                      first, last, pixels);
    });
  });
  return pixels;
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left for the reference picture"};
}

std::optional<double> reference_depth(const ReferenceMesh& mesh, const ReferenceInstance& instance, uint64_t triangle,
                                      const View& view, uint32_t x, uint32_t y) {
  return meet(view, seen_corners(view, mesh, instance, triangle), ray_of(view, x, y), is_mirrored(instance),
              mesh.double_sided);
}

}  // namespace scree::compare
