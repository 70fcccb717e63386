#include "tools/convert/passes/guessed_mesh.h"

#include <algorithm>
#include <cstring>

#include "format/geometry/quantize.h"
#include "tools/convert/plan/lattices.h"

namespace scree::convert {
namespace {

/// The box of all points that round to the codes of a box's corners, or to codes between them.
Box all_of_codes(const MeshPlan& plan) {
  constexpr double kReach = 0.499;  // steps: rounding to float must not reach the next code
  const int32_t exponent = plan.lattice.exponent;
  Box box = plan.box;
  for (size_t axis = 0; axis < 3; ++axis) {
    const auto first = static_cast<double>(plan.lattice.min[axis]);
    const auto last = static_cast<double>(format::quantize(box.hi[axis], exponent));
    box.lo[axis] = std::min(box.lo[axis], static_cast<float>((first - kReach) * format::exp2i(exponent)));
    box.hi[axis] = std::max(box.hi[axis], static_cast<float>((last + kReach) * format::exp2i(exponent)));
  }
  return box;
}

}  // namespace

std::optional<PlannedMesh> guess_mesh(const ConvertOptions& options, const SourceScene& scene, uint32_t primitive,
                                      const Measured& so_far) {
  const Primitive& source = scene.primitives[primitive];
  if (!source.stated_box) return std::nullopt;
  Measured measured;
  measured.triangles = source.triangle_count();
  measured.box = *source.stated_box;
  measured.white = so_far.white;
  measured.shows_normals = so_far.shows_normals;
  measured.shows_tangents = so_far.shows_tangents;
  for (size_t axis = 0; axis < 3; ++axis)
    if (measured.box.lo[axis] > measured.box.hi[axis]) return std::nullopt;
  PlannedMesh mesh = plan_mesh(options, scene, primitive, measured, false);
  if (!choose_lattice(options, scene, mesh.plan, mesh.record)) return std::nullopt;
  if (options.float32) return mesh;
  // Documents often state boxes with fewer digits than floats have, so the guess accepts all positions that give the
  // same lattice.
  PlannedMesh wide = mesh;
  wide.plan.box = all_of_codes(mesh.plan);
  if (choose_lattice(options, scene, wide.plan, wide.record) && matches_measured(mesh, wide)) return wide;
  return mesh;
}

bool fits_guess(const ConvertOptions& options, const SourceScene& scene, const PlannedMesh& guess,
                const WindowPlan& window, const Measured& so_far) {
  const Primitive& source = scene.primitives[window.primitive];
  return window.kept == window.count && inside(window.box, guess.plan.box) &&
         stored_attributes(options, source, so_far) == guess.record.attributes;
}

bool matches_measured(const PlannedMesh& guess, const PlannedMesh& measured) {
  return std::memcmp(&guess.record, &measured.record, sizeof guess.record) == 0;
}

}  // namespace scree::convert
