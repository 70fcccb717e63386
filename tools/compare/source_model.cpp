#include "tools/compare/source_model.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "format/layout.h"

namespace scree::compare {
namespace {

using Rows = std::array<std::array<double, 4>, 3>;

Rows multiply(const Rows& a, const Rows& b) {
  Rows out{};
  for (size_t i = 0; i < 3; ++i)
    for (size_t j = 0; j < 4; ++j)
      out[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j] + (j == 3 ? a[i][3] : 0.0);
  return out;
}

/// The matrix of a translation, a rotation (quaternion xyzw of any length) and a scale.
Rows from_parts(const std::array<double, 3>& t, const std::array<double, 4>& q, const std::array<double, 3>& s) {
  const double length = std::hypot(std::hypot(q[0], q[1]), std::hypot(q[2], q[3]));
  const double k = length > 0 ? 1 / length : 0;
  const double x = q[0] * k, y = q[1] * k, z = q[2] * k, w = q[3] * k;
  Rows m{};
  m[0] = {(1 - 2 * (y * y + z * z)) * s[0], 2 * (x * y - z * w) * s[1], 2 * (x * z + y * w) * s[2], t[0]};
  m[1] = {2 * (x * y + z * w) * s[0], (1 - 2 * (x * x + z * z)) * s[1], 2 * (y * z - x * w) * s[2], t[1]};
  m[2] = {2 * (x * z - y * w) * s[0], 2 * (y * z + x * w) * s[1], (1 - 2 * (x * x + y * y)) * s[2], t[2]};
  return m;
}

Rows local_rows(const convert::SourceNode& node) {
  const convert::LocalTransform::Values& v = node.local.values();
  if (!node.has_matrix) return from_parts({v[0], v[1], v[2]}, {v[3], v[4], v[5], v[6]}, {v[7], v[8], v[9]});
  Rows m{};
  for (size_t i = 0; i < 3; ++i)
    for (size_t j = 0; j < 4; ++j) m[i][j] = v[4 * j + i];
  return m;
}

Rows instance_rows(const format::NodeInstanceRecord& record) {
  std::array<double, 3> t{}, s{};
  std::array<double, 4> q{};
  std::copy_n(record.translation, 3, t.begin());
  std::copy_n(record.rotation, 4, q.begin());
  std::copy_n(record.scale, 3, s.begin());
  return from_parts(t, q, s);
}

Error other_source(const convert::SourceScene& scene, const std::string& what, uint64_t found, uint64_t expected) {
  return {ErrorCode::kFormat, "not made from " + scene.file_name + " (or with --exclude): " + std::to_string(found) +
                                  " " + what + ", but the source has " + std::to_string(expected)};
}

/// Reads the instances of nodes in blocks.
class NodeCopies {
 public:
  explicit NodeCopies(const convert::SourceScene& scene) : scene_(scene) {}

  /// The world matrix of one copy of a node.
  Result<Rows> world(uint32_t node, uint32_t copy) {
    if (worlds_.empty()) {
      worlds_.resize(scene_.nodes.size());
      for (size_t i = 0; i < worlds_.size(); ++i) {  // parents come before children
        const uint32_t parent = scene_.nodes[i].parent;
        const Rows local = local_rows(scene_.nodes[i]);
        worlds_[i] = parent == format::kNone ? local : multiply(worlds_[parent], local);
      }
    }
    const convert::SourceInstances* const instances = scene_.nodes[node].instances.get();
    if (instances == nullptr) {
      if (copy != 0) return other_source(scene_, "copies of node " + std::to_string(node), uint64_t{copy} + 1, 1);
      return worlds_[node];
    }
    if (copy >= instances->count)
      return other_source(scene_, "copies of node " + std::to_string(node), uint64_t{copy} + 1, instances->count);
    if (node != read_node_ || copy < first_ || copy >= first_ + block_.size()) {
      first_ = copy / kBlock * kBlock;
      block_.resize(std::min<uint64_t>(kBlock, instances->count - first_));
      SCREE_TRY(convert::read_instances(*instances, first_, block_));
      read_node_ = node;
    }
    return multiply(worlds_[node], instance_rows(block_[copy - first_]));
  }

 private:
  static constexpr uint64_t kBlock = 4096;
  const convert::SourceScene& scene_;
  std::vector<Rows> worlds_;
  uint32_t read_node_ = format::kNone;
  uint64_t first_ = 0;
  std::vector<format::NodeInstanceRecord> block_;
};

/// Components [first, end) of colours, clamped to [0, 1]; NaN becomes 0.
Result<void> read_colors(const convert::Accessor& accessor, size_t first, size_t end, std::vector<float>& out) {
  std::vector<float> all(accessor.components * accessor.count);
  SCREE_TRY(convert::read_floats(accessor, 0, accessor.count, all));
  out.reserve((end - first) * accessor.count);
  for (uint64_t vertex = 0; vertex < accessor.count; ++vertex) {
    for (size_t c = first; c < end; ++c) {
      const float value = all[vertex * accessor.components + c];
      out.push_back(value > 0 ? std::min(value, 1.0f) : 0);
    }
  }
  return {};
}

ReferenceMask reference_mask(const convert::SourceScene& scene, const convert::PlannedMask& planned, uint32_t material,
                             std::span<const std::byte> levels) {
  const format::MaterialRecord& record = scene.materials[material].record;
  // A mask of vertex colours is a single texel, so its sampler does not matter.
  const format::TextureRecord texture =
      planned.of_colors ? format::TextureRecord{} : scene.textures[record.texture].record;
  ReferenceMask mask;
  double place[2][3];
  convert::uv_transform(record, place);
  for (size_t c = 0; c < 2; ++c) std::copy_n(place[c], 3, mask.place[c].begin());
  mask.wrap = {texture.wrap_s, texture.wrap_t};
  mask.width = planned.width;
  mask.height = planned.height;
  // A blended surface is part of the opaque picture where its alpha is 1.
  mask.cutoff = planned.blends ? 255 : static_cast<double>(planned.threshold) / 65536;
  mask.magnified_nearest = format::takes_nearest_texel(texture.mag_filter);
  mask.minified_nearest = format::takes_nearest_texel(texture.min_filter);
  for (uint32_t l = 0; !levels.empty() && !(l > 0 && format::takes_finest_level(texture.min_filter)); ++l) {
    const size_t texels = size_t{std::max(1u, mask.width >> l)} * std::max(1u, mask.height >> l);
    const auto* const first = reinterpret_cast<const uint8_t*>(levels.data());
    mask.levels.emplace_back(first, first + texels);
    levels = levels.subspan(texels);
  }
  return mask;
}

/// Reads the mesh's alpha mask and the vertex data for it, if it has one.
Result<void> add_mask(const convert::SourceScene& scene, const convert::MaskPlan& plan, SourceMesh& mesh,
                      std::map<uint32_t, ReferenceMask>& masks) {
  const convert::Primitive& primitive = scene.primitives[mesh.primitive];
  if (plan.kind(primitive) != convert::MaskKind::kMixed) return {};
  mesh.uvs.resize(2 * primitive.vertex_count());
  if (primitive.uv) SCREE_TRY(convert::read_floats(*primitive.uv, 0, primitive.vertex_count(), mesh.uvs));
  for (float& value : mesh.uvs)
    if (!std::isfinite(value)) value = 0;  // as convert does
  if (primitive.color && primitive.color->components == 4) SCREE_TRY(read_colors(*primitive.color, 3, 4, mesh.alphas));
  if (masks.contains(primitive.material)) return {};
  const auto levels = SCREE_TRY(convert::load_mask_levels(scene, plan, primitive.material, true));
  masks[primitive.material] = reference_mask(scene, plan.materials[primitive.material], primitive.material, levels);
  return {};
}

}  // namespace

Result<SourceMesh> load_source_mesh(const convert::SourceScene& scene, uint32_t primitive_number) {
  const convert::Primitive& primitive = scene.primitives[primitive_number];
  SourceMesh mesh{.primitive = primitive_number};
  mesh.positions.resize(3 * primitive.vertex_count());
  SCREE_TRY(convert::read_floats(primitive.positions, 0, primitive.vertex_count(), mesh.positions));
  const uint64_t count = primitive.triangle_count();
  mesh.corners.resize(3 * count);
  SCREE_TRY(convert::read_triangles(primitive, 0, count, mesh.corners));
  mesh.kept.resize(count);
  for (uint64_t t = 0; t < count; ++t) {
    const uint32_t* const c = &mesh.corners[3 * t];
    bool keep = primitive.mode == convert::PrimitiveMode::kTriangles || (c[0] != c[1] && c[1] != c[2] && c[2] != c[0]);
    for (size_t k = 0; k < 3; ++k)
      for (size_t axis = 0; axis < 3; ++axis) keep = keep && std::isfinite(mesh.positions[3 * uint64_t{c[k]} + axis]);
    mesh.kept[t] = keep;
    mesh.kept_count += keep ? 1 : 0;
  }
  if (primitive.color) SCREE_TRY(read_colors(*primitive.color, 0, 3, mesh.colors));
  if (primitive.material == format::kNone) return mesh;
  const format::MaterialRecord& material = scene.materials[primitive.material].record;
  for (size_t c = 0; c < 3; ++c) mesh.base_color[c] = static_cast<double>(material.base_color[c]);
  mesh.double_sided = (material.flags & format::kMaterialDoubleSided) != 0;
  mesh.unlit = (material.flags & format::kMaterialUnlit) != 0;
  return mesh;
}

MeshMatcher::MeshMatcher(const convert::SourceScene& scene, const format::Container& file)
    : scene_(scene), file_(file) {}

Result<void> MeshMatcher::find_stored_groups() {
  if (file_.nodes().size() != scene_.nodes.size())
    return other_source(scene_, "nodes", file_.nodes().size(), scene_.nodes.size());
  stored_as_.assign(scene_.groups.size(), format::kNone);
  kept_.assign(scene_.groups.size(), 0);
  for (size_t i = 0; i < scene_.nodes.size(); ++i) {
    const uint32_t group = scene_.nodes[i].group, stored = file_.nodes()[i].group;
    if (group == format::kNone && stored == format::kNone) continue;
    // All nodes of a glTF mesh must refer to that mesh itself or to one earlier equal mesh.
    if (group == format::kNone || stored > group || (stored_as_[group] != format::kNone && stored_as_[group] != stored))
      return Error{ErrorCode::kFormat, "node " + std::to_string(i) + " draws another mesh in " + scene_.file_name};
    stored_as_[group] = stored;
  }
  return {};
}

Result<void> MeshMatcher::find_masks() {
  convert::WorkerPool pool(1, nullptr);
  const convert::ImageOptions options{.keep_going = true};
  masks_ = SCREE_TRY(
      convert::plan_masks(scene_, std::vector<bool>(scene_.primitives.size(), true), options, pool, [](uint64_t) {}));
  return {};
}

Result<void> MeshMatcher::check_repeat(const SourceMesh& mesh) {
  const uint32_t group = scene_.primitives[mesh.primitive].group;
  const format::GroupRecord& stored = file_.groups()[stored_as_[group]];
  const uint64_t number = uint64_t{stored.first_mesh} + kept_[group] - 1;
  const Error different{ErrorCode::kFormat, "glTF mesh " + std::to_string(group) + " of " + scene_.file_name +
                                                " is stored as a repeat of " + std::to_string(stored_as_[group]) +
                                                ", but they differ"};
  if (kept_[group] > stored.mesh_count || number >= primitive_of_mesh_.size()) return different;
  const SourceMesh other = SCREE_TRY_AT(scene_.file_name, load_source_mesh(scene_, primitive_of_mesh_[number]));
  if (mesh.kept != other.kept || mesh.double_sided != other.double_sided) return different;
  for (size_t corner = 0; corner < mesh.corners.size(); ++corner) {
    if (!mesh.kept[corner / 3]) continue;
    const float* const a = &mesh.positions[3 * size_t{mesh.corners[corner]}];
    const float* const b = &other.positions[3 * size_t{other.corners[corner]}];
    if (a[0] != b[0] || a[1] != b[1] || a[2] != b[2]) return different;
  }
  return {};
}

Result<std::optional<SourceMesh>> MeshMatcher::next() {
  if (stored_as_.empty()) SCREE_TRY(find_stored_groups());
  if (!masks_) SCREE_TRY(find_masks());
  for (; primitive_ < scene_.primitives.size(); ++primitive_) {
    const uint32_t group = scene_.primitives[primitive_].group;
    if (stored_as_[group] == format::kNone) continue;
    if (masks_->kind(scene_.primitives[primitive_]) == convert::MaskKind::kClear) continue;
    SourceMesh mesh = SCREE_TRY_AT(scene_.file_name, load_source_mesh(scene_, primitive_));
    if (mesh.kept_count == 0) continue;
    ++kept_[group];
    if (stored_as_[group] != group) {
      SCREE_TRY(check_repeat(mesh));
      continue;
    }
    if (mesh_ >= file_.meshes().size())
      return other_source(scene_, "meshes", file_.meshes().size(), file_.meshes().size() + 1);
    const format::MeshRecord& record = file_.meshes()[mesh_];
    const std::string place = "mesh " + std::to_string(mesh_);
    if (record.triangle_count != mesh.kept_count)
      return at(place, other_source(scene_, "triangles", record.triangle_count, mesh.kept_count));
    if (record.group != scene_.primitives[primitive_].group)
      return Error{ErrorCode::kFormat, place + ": of glTF mesh " + std::to_string(record.group) + ", but " +
                                           scene_.file_name + " has it in " +
                                           std::to_string(scene_.primitives[primitive_].group)};
    if ((record.attributes & format::kHasSourceIds) == 0)
      return Error{
          ErrorCode::kUnsupported,
          "no source triangle numbers in the file; convert it with --source-ids to compare it with its source"};
    primitive_of_mesh_.push_back(primitive_);
    ++primitive_;
    ++mesh_;
    return std::optional<SourceMesh>(std::move(mesh));
  }
  if (mesh_ != file_.meshes().size()) return other_source(scene_, "meshes", file_.meshes().size(), mesh_);
  for (size_t group = 0; group < kept_.size(); ++group)
    if (stored_as_[group] != format::kNone && kept_[group] != file_.groups()[stored_as_[group]].mesh_count)
      return at("glTF mesh " + std::to_string(group),
                other_source(scene_, "primitives", file_.groups()[stored_as_[group]].mesh_count, kept_[group]));
  return std::optional<SourceMesh>();
}

uint64_t source_model_bytes(const convert::SourceScene& scene) {
  uint64_t bytes = 0;
  for (const convert::Primitive& primitive : scene.primitives) {
    bytes += (primitive.color ? 6 : 3) * sizeof(float) * primitive.vertex_count();
    bytes += 3 * sizeof(uint32_t) * primitive.triangle_count() + primitive.triangle_count() / 8;
    if (primitive.uv && primitive.material != format::kNone &&
        (scene.materials[primitive.material].record.flags & format::kMaterialCutOut) != 0)
      bytes += (primitive.color ? 3 : 2) * sizeof(float) * primitive.vertex_count();
  }
  return bytes;
}

Result<SourceModel> load_source_model(const convert::SourceScene& scene, const format::Container& file,
                                      uint32_t file_scene) {
  SourceModel model;
  MeshMatcher matcher(scene, file);
  for (;;) {
    std::optional<SourceMesh> mesh = SCREE_TRY(matcher.next());
    if (!mesh.has_value()) break;
    SCREE_TRY_AT(scene.file_name, add_mask(scene, matcher.masks(), *mesh, model.masks));
    model.meshes.push_back(std::move(*mesh));
  }
  for (const SourceMesh& mesh : model.meshes) {
    ReferenceMesh view{mesh.positions, mesh.corners, &mesh.kept, mesh.double_sided, nullptr, mesh.uvs, mesh.alphas};
    const convert::Primitive& primitive = scene.primitives[mesh.primitive];
    if (!mesh.uvs.empty()) view.mask = &model.masks.at(primitive.material);
    if (primitive.material != format::kNone) {
      const format::MaterialRecord& material = scene.materials[primitive.material].record;
      const bool is_white = (file.meshes()[model.views.size()].attributes & format::kHasColor) == 0;
      view.is_drawn = (material.flags & format::kMaterialAlphaBlend) == 0 || (material.base_color[3] >= 1 && is_white);
    }
    model.views.push_back(view);
  }
  // The file determines the mesh and node of each instance, the source determines the world matrix.
  NodeCopies copies(scene);
  const format::SceneRecord& record = file.scenes()[file_scene];
  for (uint64_t i = record.first_instance; i < record.first_instance + record.instance_count; ++i) {
    const format::InstanceRecord& instance = file.instances()[i];
    const uint32_t group = scene.primitives[model.meshes[instance.mesh].primitive].group;
    if (file.nodes()[instance.node].group != group)  // for_each_mesh() has checked the node's mesh against the source
      return Error{ErrorCode::kFormat, "instance " + std::to_string(i) + ": node " + std::to_string(instance.node) +
                                           " draws another mesh than its group's"};
    const Rows world = SCREE_TRY(copies.world(instance.node, instance.node_instance));
    model.instances.push_back({instance.mesh, world});
  }
  return model;
}

}  // namespace scree::compare
