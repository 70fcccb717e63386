#include "lab/peer/coverage.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <vector>

#include "format/vec3.h"
#include "kernels/raster/transform.h"
#include "lab/scenes/scene_tables.h"

namespace scree::lab {
namespace {

/// A point of the screen in homogeneous coordinates: (pixels times w, pixels times w, w). w is 1 on the near plane.
using Point = Vec3;

/// The position of a triangle relative to a sample.
struct SampleTest {
  enum { kInside, kNearEdge, kOutside } where;
  double w;  // the triangle's distance at the sample; valid inside
};

class Geometry {
 public:
  Geometry(const synth::Scene& scene, const kernels::View& view)
      : scene_(scene), frame_(kernels::make_frame_view(view)) {
    first_ids_.push_back(0);
    for (const synth::SceneInstance& instance : scene.instances)
      first_ids_.push_back(first_ids_.back() + synth::triangle_count(scene.meshes[instance.mesh]));
  }

  /// Tests triangle `id` against the centre of sample (x, y), in double precision and without snapping.
  /// Edges are lines through the eye's plane, so corners may lie behind the eye (Olano and Greer, 1997).
  SampleTest test(uint64_t id, uint32_t x, uint32_t y) const {
    const auto [corners, mirrored] = project(id);
    const Point sample{x + 0.5, y + 0.5, 1};
    // y points down, so a front turns clockwise on the screen and has a negative determinant.
    const double front = mirrored ? 1 : -1;
    double inside = INFINITY;  // pixels from the nearest edge's line, negative outside
    double inverse_w = 0;
    const double determinant = dot(corners[0], cross(corners[1], corners[2]));
    for (size_t i = 0; i < 3; ++i) {
      const Point line = cross(corners[(i + 1) % 3], corners[(i + 2) % 3]);
      const double value = dot(line, sample);
      inside = std::min(inside, front * value / std::hypot(line[0], line[1]));
      inverse_w += value / determinant;
    }
    const double w = 1 / inverse_w;
    if (!(std::fabs(inside) > kEdgePixels)) return {SampleTest::kNearEdge, w};
    if (inside < 0 || !(w > 0)) return {SampleTest::kOutside, w};
    if (std::fabs(w - 1) < 1e-5) return {SampleTest::kNearEdge, w};
    return {w < 1 ? SampleTest::kOutside : SampleTest::kInside, w};
  }

 private:
  struct Projected {
    std::array<Point, 3> corners;
    bool mirrored;
  };
  Projected project(uint64_t id) const {
    const auto next = std::upper_bound(first_ids_.begin(), first_ids_.end(), id);
    const auto number = static_cast<size_t>(next - first_ids_.begin()) - 1;
    const synth::SceneInstance& instance = scene_.instances[number];
    const synth::MeshRecipe& mesh = scene_.meshes[instance.mesh];
    const auto triangle = static_cast<uint32_t>(id - first_ids_[number]);
    const kernels::Transform transform = kernels::make_transform(frame_, matrix_record(instance), 0, true);
    const double* const rows[3] = {transform.exact_x, transform.exact_y, transform.exact_w};
    uint32_t quad[6];
    synth::quad_indices(mesh, triangle / 2, quad);
    Projected projected{{}, transform.mirrored};
    for (size_t corner = 0; corner < 3; ++corner) {
      const synth::Float3 p = synth::vertex_position(mesh, quad[triangle % 2 * 3 + corner]);
      const float parts[3] = {p.x, p.y, p.z};
      Point& to = projected.corners[corner];
      for (size_t row = 0; row < 3; ++row) {
        to[row] = rows[row][3];
        for (size_t i = 0; i < 3; ++i)
          to[row] += rows[row][i] * (static_cast<double>(parts[i]) - static_cast<double>(transform.center[i]));
      }
      to[0] = to[0] / kernels::kSubpixels + 0.5 * frame_.width * to[2];
      to[1] = to[1] / kernels::kSubpixels + 0.5 * frame_.height * to[2];
    }
    return projected;
  }

  const synth::Scene& scene_;
  kernels::FrameView frame_;
  std::vector<uint64_t> first_ids_;  // of each instance, and the end
};

}  // namespace

Coverage compare_coverage(const synth::Scene& scene, const kernels::View& view, std::span<const uint64_t> samples,
                          std::span<const uint64_t> ids) {
  assert(samples.size() == ids.size() && samples.size() == uint64_t{view.width} * view.height);
  const Geometry geometry(scene, view);
  Coverage coverage;
  for (size_t i = 0; i < samples.size(); ++i) {
    const uint64_t both[2] = {kernels::sample_id(samples[i]), ids[i]};
    if (both[0] == both[1]) {
      if (both[0] != kernels::kIdMask) ++coverage.same;
      continue;
    }
    bool near_edge = false;
    bool outside = false;
    double w[2];
    for (int picture = 0; picture < 2; ++picture) {
      // Where a picture shows the background, the other one's triangle should not cover the sample.
      if (both[picture] == kernels::kIdMask) {
        outside = true;
        continue;
      }
      const SampleTest found =
          geometry.test(both[picture], static_cast<uint32_t>(i % view.width), static_cast<uint32_t>(i / view.width));
      near_edge = near_edge || found.where == SampleTest::kNearEdge;
      outside = outside || found.where == SampleTest::kOutside;
      w[picture] = found.w;
    }
    if (near_edge) {
      ++coverage.edge;
    } else if (outside) {
      ++coverage.other;
    } else {
      ++coverage.depth;
      coverage.depth_gap = std::max(coverage.depth_gap, std::fabs(w[0] - w[1]) / std::min(w[0], w[1]));
    }
  }
  return coverage;
}

}  // namespace scree::lab
