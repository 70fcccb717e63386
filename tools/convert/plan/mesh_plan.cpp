#include "tools/convert/plan/mesh_plan.h"

#include <algorithm>

#include "tools/convert/plan/convert_options.h"

namespace scree::convert {

uint32_t stored_attributes(const ConvertOptions& options, const Primitive& source, const Measured& measured) {
  uint32_t attributes = 0;
  if (source.uv) attributes |= format::kHasUv;
  if (source.color && !measured.white) attributes |= format::kHasColor;
  if (measured.shows_normals) attributes |= format::kHasNormal;
  if (source.second_uv() != nullptr) attributes |= format::kHasSecondUv;
  if (measured.shows_tangents) attributes |= format::kHasTangent;
  if (options.source_ids) attributes |= format::kHasSourceIds;
  return attributes;
}

PlannedMesh plan_mesh(const ConvertOptions& options, const SourceScene& scene, uint32_t primitive,
                      const Measured& measured, bool is_sorted) {
  const Primitive& source = scene.primitives[primitive];
  PlannedMesh mesh;
  MeshPlan& plan = mesh.plan;
  plan.primitive = primitive;
  plan.float32 = options.float32;
  plan.clustered = options.encoding == Encoding::kClustered && !options.float32;
  plan.chunks_as_float32 = bounds_error(options);
  plan.box = measured.box;
  if (is_sorted) plan.sorted_triangles = source.triangle_count();
  plan.attributes = stored_attributes(options, source, measured);

  format::MeshRecord& record = mesh.record;
  record.triangle_count = measured.triangles;
  record.source_vertex_count = source.vertex_count();
  record.position_encoding = options.float32 ? format::PositionEncoding::kFloat32 : format::PositionEncoding::kLattice;
  record.attributes = plan.attributes;
  record.material = source.material;
  record.group = source.group;
  std::copy(plan.box.lo.begin(), plan.box.lo.end(), record.bounds_min);
  std::copy(plan.box.hi.begin(), plan.box.hi.end(), record.bounds_max);
  return mesh;
}

}  // namespace scree::convert
