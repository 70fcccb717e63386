#include "tools/convert/plan/lattices.h"

#include <algorithm>
#include <limits>

#include "format/geometry/quantize.h"
#include "tools/convert/plan/convert_options.h"
#include "tools/convert/plan/pixel_bound.h"

namespace scree::convert {
namespace {

/// By mesh: the largest position error per axis that keeps the pixel bound under every world matrix of its instances.
Result<std::vector<double>> errors_for_pixels(const PixelBound& bound, const SourceScene& scene,
                                              const InstancePlan& instances, const std::vector<MeshPlan>& plans) {
  std::vector<double> gains(scene.groups.size());
  for (uint32_t group = 0; group < gains.size(); ++group) {
    const Result<void> visited = visit_world_matrices(scene, instances, group, [&](const format::MatrixRecord& world) {
      gains[group] = std::max(gains[group], matrix_gain(world));
    });
    if (!visited) return visited.error();
  }
  const double allowed = world_error(bound);
  std::vector<double> errors;
  for (const MeshPlan& plan : plans) {
    const double gain = gains[scene.primitives[plan.primitive].group];
    // The mesh is not drawn, or is a single point. Any error is allowed; the error for a unit matrix is used.
    errors.push_back(std::clamp(allowed / (gain > 0 ? gain : 1), std::numeric_limits<double>::min(),
                                static_cast<double>(std::numeric_limits<float>::max())));
  }
  return errors;
}

void keep_floats(MeshPlan& plan, format::MeshRecord& record) {
  plan.float32 = true;
  plan.clustered = false;
  record.position_encoding = format::PositionEncoding::kFloat32;
}

/// --grid scene. The step of a flat or single-point mesh is only the finest that keeps its one coordinate exact. So
/// such a mesh takes the step of the meshes that share its matrices, if there are any.
Result<void> share_steps(const SourceScene& scene, const InstancePlan& instances, const format::TableSet& tables,
                         std::vector<MeshPlan>& plans) {
  const std::vector<uint32_t> shared = meshes_sharing_matrices(instances, scene, tables);
  constexpr int32_t kUnset = std::numeric_limits<int32_t>::max();
  std::vector<int32_t> exponent(plans.size(), kUnset);
  for (size_t i = 0; i < plans.size(); ++i)
    if (!plans[i].float32 && plans[i].box.lo != plans[i].box.hi)
      exponent[shared[i]] = std::min(exponent[shared[i]], plans[i].lattice.exponent);
  for (size_t i = 0; i < plans.size(); ++i) {
    const int32_t common = exponent[shared[i]];
    if (plans[i].float32 || common == kUnset || common == plans[i].lattice.exponent) continue;
    const Result<format::MeshLattice> lattice =
        format::lattice_of_exponent(plans[i].box.lo.data(), plans[i].box.hi.data(), common);
    if (!lattice) {
      const Error error = at(primitive_place(scene, plans[i].primitive), lattice.error());
      return Error{
          error.code,
          error.message +
              " (--grid scene takes the finest step any mesh needs; --max-error or --max-error-pixels sets one)"};
    }
    plans[i].lattice = *lattice;
  }
  return {};
}

void write_lattice(const MeshPlan& plan, format::MeshRecord& record) {
  std::copy(plan.lattice.min.begin(), plan.lattice.min.end(), record.lattice_min);
  std::copy(plan.lattice.bits.begin(), plan.lattice.bits.end(), record.lattice_bits);
  record.lattice_exponent = plan.lattice.exponent;
  record.max_position_error = plan.lattice.max_error;
  for (size_t axis = 0; axis < 3; ++axis) {
    // Rounding is monotone, so the codes of the box's corners are the extremes of all codes.
    record.bounds_min[axis] = format::dequantize(plan.lattice.min[axis], plan.lattice.exponent);
    record.bounds_max[axis] =
        format::dequantize(format::quantize(plan.box.hi[axis], plan.lattice.exponent), plan.lattice.exponent);
  }
}

Result<format::MeshLattice> lattice_of(const ConvertOptions& options, const MeshPlan& plan, double error) {
  return format::choose_lattice(plan.box.lo.data(), plan.box.hi.data(), options.position_bits, error);
}

}  // namespace

Result<void> choose_lattice(const ConvertOptions& options, const SourceScene& scene, MeshPlan& plan,
                            format::MeshRecord& record) {
  if (options.float32) return {};
  plan.lattice = SCREE_TRY_AT(primitive_place(scene, plan.primitive), lattice_of(options, plan, options.max_error));
  write_lattice(plan, record);
  return {};
}

Result<void> choose_lattices(const ConvertOptions& options, const SourceScene& scene, const InstancePlan& instances,
                             std::vector<MeshPlan>& plans, format::TableSet& tables) {
  if (options.float32) return {};
  const bool by_pixels = options.pixel_bound.pixels > 0;
  std::vector<double> errors(plans.size(), options.max_error);
  if (by_pixels) errors = SCREE_TRY(errors_for_pixels(options.pixel_bound, scene, instances, plans));
  for (size_t i = 0; i < plans.size(); ++i) {
    MeshPlan& plan = plans[i];
    const Result<format::MeshLattice> lattice = lattice_of(options, plan, errors[i]);
    // If rounding to float alone exceeds the bound, no lattice can keep it.
    if (bounds_error(options) && (!lattice || lattice->max_error > errors[i])) {
      keep_floats(plan, tables.meshes[i]);
      continue;
    }
    if (!lattice) return at(primitive_place(scene, plan.primitive), lattice.error());
    plan.lattice = *lattice;
  }
  if (options.grid == Grid::kScene) SCREE_TRY(share_steps(scene, instances, tables, plans));
  for (size_t i = 0; i < plans.size(); ++i)
    if (!plans[i].float32) write_lattice(plans[i], tables.meshes[i]);
  return {};
}

}  // namespace scree::convert
