#include "tools/convert/scene_tables.h"

#include <xxhash.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numeric>

#include "format/bytes.h"

namespace scree::convert {
namespace {

using format::kNone;
using format::MatrixRecord;

MatrixRecord identity() {
  MatrixRecord m{};
  for (size_t i = 0; i < 3; ++i) m.rows[i][i] = 1;
  return m;
}

MatrixRecord multiply(const MatrixRecord& a, const MatrixRecord& b) {
  MatrixRecord out{};
  for (size_t row = 0; row < 3; ++row) {
    for (size_t column = 0; column < 4; ++column) {
      double sum = column == 3 ? a.rows[row][3] : 0;
      for (size_t k = 0; k < 3; ++k) sum += a.rows[row][k] * b.rows[k][column];
      out.rows[row][column] = sum;
    }
  }
  return out;
}

/// The quaternion (xyzw) is divided by its length: a file holds it rounded.
MatrixRecord from_trs(const double t[3], const double q[4], const double s[3]) {
  const double norm = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
  const double k = norm > 0 ? 2 / norm : 0;
  const double x = q[0], y = q[1], z = q[2], w = q[3];
  const double rotation[3][3] = {
      {1 - k * (y * y + z * z), k * (x * y - z * w), k * (x * z + y * w)},
      {k * (x * y + z * w), 1 - k * (x * x + z * z), k * (y * z - x * w)},
      {k * (x * z - y * w), k * (y * z + x * w), 1 - k * (x * x + y * y)},
  };
  MatrixRecord m{};
  for (size_t row = 0; row < 3; ++row) {
    for (size_t column = 0; column < 3; ++column) m.rows[row][column] = rotation[row][column] * s[column];
    m.rows[row][3] = t[row];
  }
  return m;
}

MatrixRecord local_matrix(const SourceNode& node) {
  if (!node.has_matrix) return from_trs(&node.local[0], &node.local[3], &node.local[7]);
  MatrixRecord m{};
  for (size_t row = 0; row < 3; ++row)
    for (size_t column = 0; column < 4; ++column) m.rows[row][column] = node.local[4 * column + row];
  return m;
}

MatrixRecord instance_matrix(const format::NodeInstanceRecord& instance) {
  double t[3], q[4], s[3];
  std::copy_n(instance.translation, 3, t);
  std::copy_n(instance.rotation, 4, q);
  std::copy_n(instance.scale, 3, s);
  return from_trs(t, q, s);
}

bool is_finite(const MatrixRecord& m) {
  for (const auto& row : m.rows)
    for (const double value : row)
      if (!std::isfinite(value)) return false;
  return true;
}

/// Keeps equal matrices once: open addressing over the numbers of the matrices.
class MatrixSet {
 public:
  explicit MatrixSet(std::vector<MatrixRecord>& matrices) : matrices_(matrices), table_(1024, kNone) {}

  uint32_t add(MatrixRecord m) {
    for (auto& row : m.rows)
      for (double& value : row) value += 0.0;  // -0 becomes 0
    if (2 * (matrices_.size() + 1) > table_.size()) enlarge();
    uint32_t& slot = find(m);
    if (slot == kNone) {
      slot = static_cast<uint32_t>(matrices_.size());
      matrices_.push_back(m);
    }
    return slot;
  }

 private:
  uint32_t& find(const MatrixRecord& m) {
    const uint64_t mask = table_.size() - 1;
    uint64_t at = XXH3_64bits(&m, sizeof m) & mask;
    while (table_[at] != kNone && std::memcmp(&matrices_[table_[at]], &m, sizeof m) != 0) at = (at + 1) & mask;
    return table_[at];
  }

  void enlarge() {
    table_.assign(2 * table_.size(), kNone);
    for (uint32_t i = 0; i < matrices_.size(); ++i) find(matrices_[i]) = i;
  }

  std::vector<MatrixRecord>& matrices_;
  std::vector<uint32_t> table_;
};

std::string node_place(const SourceScene& scene, size_t node) {
  std::string place = scene.file_name + ": node " + std::to_string(node);
  if (!scene.nodes[node].name.empty()) place += " (" + scene.nodes[node].name + ")";
  return place;
}

void add_nodes(const SourceScene& scene, format::TableSet& tables) {
  for (const SourceNode& node : scene.nodes) {
    format::NodeRecord record{};
    record.name = tables.strings.add(node.name);
    record.parent = node.parent;
    record.group = node.group;
    record.camera = node.camera;
    record.flags = node.has_matrix ? uint32_t{format::kNodeHasMatrix} : 0u;
    record.first_node_instance = tables.node_instances.size();
    record.node_instance_count = node.instances.size();
    std::copy(node.local.begin(), node.local.end(), record.local);
    tables.nodes.push_back(record);
    tables.node_instances.insert(tables.node_instances.end(), node.instances.begin(), node.instances.end());
  }
}

std::vector<SourceSceneRoots> scenes_of(const SourceScene& scene) {
  if (!scene.scenes.empty()) return scene.scenes;
  SourceSceneRoots all;
  all.is_default = true;
  for (uint32_t i = 0; i < scene.nodes.size(); ++i)
    if (scene.nodes[i].parent == kNone) all.roots.push_back(i);
  return {all};
}

}  // namespace

Result<void> add_nodes_and_scenes(const SourceScene& scene, format::TableSet& tables) {
  for (const NamedCamera& camera : scene.cameras) {
    format::CameraRecord record = camera.record;
    record.name = tables.strings.add(camera.name);
    tables.cameras.push_back(record);
  }
  add_nodes(scene, tables);

  const std::vector<SourceSceneRoots> scenes = scenes_of(scene);
  std::vector<MatrixRecord> world(scene.nodes.size());
  for (size_t i = 0; i < scene.nodes.size(); ++i) {  // parents come before children
    const MatrixRecord local = local_matrix(scene.nodes[i]);
    const uint32_t parent = scene.nodes[i].parent;
    world[i] = parent == kNone ? multiply(identity(), local) : multiply(world[parent], local);
    if (!is_finite(world[i]))
      return Error{ErrorCode::kRange, node_place(scene, i) + ": the world matrix is not finite"};
  }

  // The world matrices of a node's instances are consecutive in matrix_of; made once, whatever scenes show the node.
  MatrixSet matrices(tables.matrices);
  std::vector<uint64_t> first_matrix(scene.nodes.size(), UINT64_MAX);
  std::vector<uint32_t> matrix_of;
  uint64_t total = 0;
  for (const SourceSceneRoots& source : scenes) {
    std::vector<bool> shown(scene.nodes.size());
    for (const uint32_t root : source.roots) shown[root] = true;
    std::vector<uint64_t> place(tables.meshes.size() + 1,
                                0);  // first the count of each mesh's instances, then their end
    for (size_t i = 0; i < scene.nodes.size(); ++i) {
      const SourceNode& node = scene.nodes[i];
      if (node.parent != kNone && shown[node.parent]) shown[i] = true;
      if (!shown[i] || node.group == kNone) continue;
      const format::GroupRecord& group = tables.groups[node.group];
      if (group.mesh_count == 0) continue;
      const uint64_t copies = std::max<uint64_t>(node.instances.size(), 1);
      const auto more = format::checked_mul(copies, group.mesh_count);
      if (!more || *more > kMaxInstances - total)
        return Error{ErrorCode::kUnsupported,
                     node_place(scene, i) + ": more than " + std::to_string(kMaxInstances) + " instances in all"};
      total += *more;
      for (uint32_t m = 0; m < group.mesh_count; ++m) place[group.first_mesh + m] += copies;
      if (first_matrix[i] != UINT64_MAX) continue;
      first_matrix[i] = matrix_of.size();
      if (node.instances.empty()) matrix_of.push_back(matrices.add(world[i]));
      for (const format::NodeInstanceRecord& instance : node.instances) {
        const MatrixRecord matrix = multiply(world[i], instance_matrix(instance));
        if (!is_finite(matrix))
          return Error{ErrorCode::kRange, node_place(scene, i) + ": the world matrix of an instance is not finite"};
        matrix_of.push_back(matrices.add(matrix));
      }
    }

    format::SceneRecord record{};
    record.name = tables.strings.add(source.name);
    record.flags = source.is_default ? 1u : 0u;
    record.first_instance = tables.instances.size();
    record.first_root = tables.scene_roots.size();
    record.root_count = source.roots.size();
    tables.scene_roots.insert(tables.scene_roots.end(), source.roots.begin(), source.roots.end());
    for (size_t mesh = 0; mesh < tables.meshes.size(); ++mesh) {
      const auto triangles = format::checked_mul(place[mesh], tables.meshes[mesh].triangle_count);
      const auto sum = triangles ? format::checked_add(record.triangle_count, *triangles) : std::nullopt;
      if (!sum) return Error{ErrorCode::kUnsupported, scene.file_name + ": a scene draws more than 2^64 triangles"};
      record.triangle_count = *sum;
    }
    std::exclusive_scan(place.begin(), place.end(), place.begin(), record.first_instance);
    record.instance_count = place.back() - record.first_instance;
    tables.instances.resize(place.back());
    for (uint32_t i = 0; i < scene.nodes.size(); ++i) {
      const SourceNode& node = scene.nodes[i];
      if (!shown[i] || node.group == kNone) continue;
      const format::GroupRecord& group = tables.groups[node.group];
      const uint64_t copies = std::max<uint64_t>(node.instances.size(), 1);
      for (uint32_t m = 0; m < group.mesh_count; ++m) {
        const uint32_t mesh = group.first_mesh + m;
        for (uint64_t copy = 0; copy < copies; ++copy)
          tables.instances[place[mesh]++] = {mesh, i, matrix_of[first_matrix[i] + copy], static_cast<uint32_t>(copy)};
      }
    }
    tables.scenes.push_back(record);
  }
  return {};
}

MaterialUse find_material_use(const SourceScene& scene, const std::vector<bool>& materials_used) {
  MaterialUse use;
  std::vector<bool> textures(scene.textures.size());
  std::vector<bool> images(scene.images.size());
  for (size_t i = 0; i < scene.materials.size(); ++i)
    if (materials_used[i] && scene.materials[i].record.texture != kNone)
      textures[scene.materials[i].record.texture] = true;
  for (size_t i = 0; i < textures.size(); ++i)
    if (textures[i]) images[scene.textures[i].record.image] = true;
  const auto number = [](const std::vector<bool>& used) {
    std::vector<uint32_t> places(used.size(), kNone);
    uint32_t count = 0;
    for (size_t i = 0; i < used.size(); ++i)
      if (used[i]) places[i] = count++;
    return places;
  };
  use.materials = number(materials_used);
  use.textures = number(textures);
  use.images = number(images);
  return use;
}

void add_materials(const SourceScene& scene, const MaterialUse& use, const std::vector<uint32_t>& image_places,
                   format::TableSet& tables) {
  for (size_t i = 0; i < scene.materials.size(); ++i) {
    if (use.materials[i] == kNone) continue;
    format::MaterialRecord record = scene.materials[i].record;
    record.name = tables.strings.add(scene.materials[i].name);
    if (record.texture != kNone) record.texture = use.textures[record.texture];
    tables.materials.push_back(record);
  }
  for (size_t i = 0; i < scene.textures.size(); ++i) {
    if (use.textures[i] == kNone) continue;
    format::TextureRecord record = scene.textures[i].record;
    record.name = tables.strings.add(scene.textures[i].name);
    record.image = image_places[record.image];
    tables.textures.push_back(record);
  }
}

std::vector<uint32_t> meshes_sharing_matrices(const format::TableSet& tables) {
  std::vector<uint32_t> parent(tables.meshes.size());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto root = [&](uint32_t mesh) {
    while (parent[mesh] != mesh) mesh = parent[mesh] = parent[parent[mesh]];
    return mesh;
  };
  std::vector<uint32_t> first_mesh(tables.matrices.size(), kNone);
  for (const format::InstanceRecord& instance : tables.instances) {
    uint32_t& first = first_mesh[instance.matrix];
    if (first == kNone) first = instance.mesh;
    const uint32_t a = root(first);
    const uint32_t b = root(instance.mesh);
    parent[std::max(a, b)] = std::min(a, b);
  }
  for (uint32_t mesh = 0; mesh < parent.size(); ++mesh) parent[mesh] = root(mesh);
  return parent;
}

}  // namespace scree::convert
