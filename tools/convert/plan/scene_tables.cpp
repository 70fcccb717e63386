#include "tools/convert/plan/scene_tables.h"

#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <string>
#include <unordered_map>

#include "format/bytes.h"
#include "format/geometry/rotation.h"

namespace scree::convert {
namespace {

using format::kNone;
using format::MatrixRecord;

constexpr uint64_t kBlockRecords = 4096;

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

MatrixRecord from_trs(const double t[3], const double q[4], const double s[3]) {
  double rotation[3][3];
  format::rotation_matrix(q, rotation);
  MatrixRecord m{};
  for (size_t row = 0; row < 3; ++row) {
    for (size_t column = 0; column < 3; ++column) m.rows[row][column] = rotation[row][column] * s[column];
    m.rows[row][3] = t[row];
  }
  return m;
}

MatrixRecord local_matrix(const SourceNode& node) {
  const LocalTransform::Values& local = node.local.values();
  if (!node.has_matrix) return from_trs(&local[0], &local[3], &local[7]);
  MatrixRecord m{};
  for (size_t row = 0; row < 3; ++row)
    for (size_t column = 0; column < 4; ++column) m.rows[row][column] = local[4 * column + row];
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

void drop_negative_zeros(MatrixRecord& m) {
  for (auto& row : m.rows)
    for (double& value : row) value += 0.0;
}

/// Stores each distinct matrix once. A hash table with open addressing holds the indices of the matrices.
class MatrixSet {
 public:
  explicit MatrixSet(std::vector<MatrixRecord>& matrices) : matrices_(matrices), table_(1024, kNone) {}

  uint32_t add(MatrixRecord m) {
    drop_negative_zeros(m);
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

std::vector<SourceSceneRoots> scenes_of(const SourceScene& scene) {
  if (!scene.scenes.empty()) return scene.scenes;
  SourceSceneRoots all;
  all.is_default = true;
  for (uint32_t i = 0; i < scene.nodes.size(); ++i)
    if (scene.nodes[i].parent == kNone) all.roots.push_back(i);
  return {all};
}

uint64_t copies_of(const SourceNode& node) {
  return node.instances ? node.instances->count : 1;
}

/// Calls `take(first, records)` for all instances of a node, one block at a time.
template <class Take>
Result<void> for_each_block(const SourceScene& scene, uint32_t node, const Take& take) {
  const SourceInstances& instances = *scene.nodes[node].instances;
  std::vector<format::NodeInstanceRecord> block(std::min<uint64_t>(instances.count, kBlockRecords));
  for (uint64_t done = 0; done < instances.count; done += block.size()) {
    block.resize(std::min<uint64_t>(block.size(), instances.count - done));
    SCREE_TRY_AT(node_place(scene, node), read_instances(instances, done, block));
    SCREE_TRY(take(done, std::span<const format::NodeInstanceRecord>(block)));
  }
  return {};
}

/// Calls `take(matrices)` for the world matrices of a node's instances, one block at a time.
template <class Take>
Result<void> for_each_matrix_block(const SourceScene& scene, uint32_t node, const MatrixRecord& world,
                                   const Take& take) {
  std::vector<MatrixRecord> matrices;
  const auto block = [&](uint64_t first, std::span<const format::NodeInstanceRecord> records) -> Result<void> {
    matrices.clear();
    for (const format::NodeInstanceRecord& record : records) {
      matrices.push_back(multiply(world, instance_matrix(record)));
      drop_negative_zeros(matrices.back());
      if (!is_finite(matrices.back()))
        return Error{ErrorCode::kRange, node_place(scene, node) + ": the world matrix of instance " +
                                            std::to_string(first + matrices.size() - 1) + " is not finite"};
    }
    return take(std::span<const MatrixRecord>(matrices));
  };
  return for_each_block(scene, node, block);
}

/// Plans the matrices of each node once, when a scene first draws it.
class MatrixPlanner {
 public:
  MatrixPlanner(const SourceScene& scene, InstancePlan& plan) : scene_(scene), plan_(plan), set_(plan.matrices) {}

  Result<void> add(uint32_t node, const MatrixRecord& world) {
    InstancePlan::Node& place = plan_.nodes[node];
    if (place.first != UINT64_MAX) return {};
    const SourceInstances* const instances = scene_.nodes[node].instances.get();
    if (instances != nullptr && instances->count > kMaxHeldInstances - held_) return add_stream(node, world, place);
    place.first = plan_.matrix_of.size();
    if (instances == nullptr) {
      plan_.matrix_of.push_back(set_.add(world));
      return {};
    }
    held_ += instances->count;
    return for_each_matrix_block(scene_, node, world, [&](std::span<const MatrixRecord> block) -> Result<void> {
      for (const MatrixRecord& matrix : block) plan_.matrix_of.push_back(set_.add(matrix));
      return {};
    });
  }

  /// Streams come after the held matrices, whose number is known only at the end.
  void finish() {
    for (InstancePlan::Node& node : plan_.nodes)
      if (node.is_streamed) node.first += plan_.matrices.size();
  }

 private:
  /// A node that repeats the instances of another, like the parts of a tree in a forest, shares its matrices.
  Result<void> add_stream(uint32_t node, const MatrixRecord& world, InstancePlan::Node& place) {
    const SourceInstances& instances = *scene_.nodes[node].instances;
    std::string key(reinterpret_cast<const char*>(&world), sizeof world);
    for (const std::optional<Accessor>* accessor : {&instances.translation, &instances.rotation, &instances.scale})
      key += " " + std::to_string(*accessor ? (*accessor)->index : kNone);
    key += " " + std::to_string(instances.count);
    const auto [known, is_new] = streams_.try_emplace(std::move(key), streamed_);
    place = {known->second, true};
    if (!is_new) return {};
    streamed_ += instances.count;
    plan_.streams.push_back({node, world});
    return for_each_matrix_block(scene_, node, world, [](std::span<const MatrixRecord>) { return Result<void>(); });
  }

  const SourceScene& scene_;
  InstancePlan& plan_;
  MatrixSet set_;
  std::unordered_map<std::string, uint64_t> streams_;
  uint64_t held_ = 0;
  uint64_t streamed_ = 0;
};

void sort_by_group(const SourceScene& scene, InstancePlan& plan) {
  plan.first_of_group.assign(scene.groups.size() + 1, 0);
  for (const SourceNode& node : scene.nodes)
    if (node.group != kNone) ++plan.first_of_group[node.group];
  std::exclusive_scan(plan.first_of_group.begin(), plan.first_of_group.end(), plan.first_of_group.begin(), uint64_t{0});
  plan.by_group.resize(plan.first_of_group.back());
  std::vector<uint64_t> next = plan.first_of_group;
  for (uint32_t i = 0; i < scene.nodes.size(); ++i)
    if (scene.nodes[i].group != kNone) plan.by_group[next[scene.nodes[i].group]++] = i;
}

/// The nodes that draw meshes, tree by tree. So the nodes of a scene are found without a search through all nodes,
/// which many small scenes would repeat.
class DrawnNodes {
 public:
  /// `order`: nodes, all that have a group among them.
  DrawnNodes(const SourceScene& scene, const format::TableSet& tables, std::span<const uint32_t> order)
      : first_(scene.nodes.size() + 1) {
    std::vector<uint32_t> tree(scene.nodes.size());  // by node: the root above it
    for (uint32_t i = 0; i < tree.size(); ++i)       // parents come before children
      tree[i] = scene.nodes[i].parent == kNone ? i : tree[scene.nodes[i].parent];
    const auto is_drawn = [&](uint32_t node) {
      return scene.nodes[node].group != kNone && tables.groups[scene.nodes[node].group].mesh_count > 0;
    };
    for (const uint32_t node : order)
      if (is_drawn(node)) ++first_[tree[node]];
    std::exclusive_scan(first_.begin(), first_.end(), first_.begin(), uint32_t{0});
    places_.resize(first_.back());
    std::vector<uint32_t> next = first_;
    for (uint32_t i = 0; i < order.size(); ++i)
      if (is_drawn(order[i])) places_[next[tree[order[i]]]++] = i;
  }

  /// The places in `order` of the nodes that a scene draws, ascending. A scene lists each of its roots once.
  std::vector<uint32_t> places(const SourceSceneRoots& scene) const {
    std::vector<uint32_t> found;
    for (const uint32_t root : scene.roots)
      found.insert(found.end(), places_.begin() + first_[root], places_.begin() + first_[root + 1]);
    if (!std::is_sorted(found.begin(), found.end())) std::sort(found.begin(), found.end());
    return found;
  }

 private:
  std::vector<uint32_t> first_;   // by root: the first of its tree in places_; then the end of the last one
  std::vector<uint32_t> places_;  // in `order`, ascending in every tree
};

/// Collects records and passes them on in blocks.
template <class Record>
class RecordBuffer {
 public:
  RecordBuffer(format::ContainerWriter& writer, format::TableKind kind) : writer_(writer), kind_(kind) {}

  Result<void> add(const Record& record) {
    records_.push_back(record);
    return records_.size() < kBlockRecords ? Result<void>() : flush();
  }

  Result<void> flush() {
    const Result<void> written = writer_.append_records(kind_, sizeof(Record), std::as_bytes(std::span(records_)));
    records_.clear();
    return written;
  }

 private:
  format::ContainerWriter& writer_;
  format::TableKind kind_;
  std::vector<Record> records_;
};

}  // namespace

Result<InstancePlan> plan_scenes(const SourceScene& scene, format::TableSet& tables) {
  for (const NamedCamera& camera : scene.cameras) {
    format::CameraRecord record = camera.record;
    record.name = tables.strings.add(camera.name);
    tables.cameras.push_back(record);
  }
  for (const NamedLight& light : scene.lights) {
    format::LightRecord record = light.record;
    record.name = tables.strings.add(light.name);
    tables.lights.push_back(record);
  }

  InstancePlan plan;
  plan.scenes = scenes_of(scene);
  plan.nodes.resize(scene.nodes.size());
  sort_by_group(scene, plan);
  std::vector<MatrixRecord> world(scene.nodes.size());
  for (size_t i = 0; i < scene.nodes.size(); ++i) {  // parents come before children
    const MatrixRecord local = local_matrix(scene.nodes[i]);
    const uint32_t parent = scene.nodes[i].parent;
    world[i] = parent == kNone ? multiply(identity(), local) : multiply(world[parent], local);
    if (!is_finite(world[i]))
      return Error{ErrorCode::kRange, node_place(scene, i) + ": the world matrix is not finite"};
  }

  std::vector<uint32_t> numbers(scene.nodes.size());
  std::iota(numbers.begin(), numbers.end(), 0u);
  const DrawnNodes drawn(scene, tables, numbers);
  // The world matrices of a node's instances are made once, for all scenes that show the node.
  MatrixPlanner planner(scene, plan);
  uint64_t total = 0;
  for (const SourceSceneRoots& source : plan.scenes) {
    format::SceneRecord record{};
    record.name = tables.strings.add(source.name);
    record.flags = source.is_default ? 1u : 0u;
    record.first_instance = total;
    record.first_root = tables.scene_roots.size();
    record.root_count = source.roots.size();
    tables.scene_roots.insert(tables.scene_roots.end(), source.roots.begin(), source.roots.end());
    for (const uint32_t i : drawn.places(source)) {
      const SourceNode& node = scene.nodes[i];
      const format::GroupRecord& group = tables.groups[node.group];
      const auto more = format::checked_mul(copies_of(node), group.mesh_count);
      if (!more || *more > kMaxInstances - total)
        return Error{ErrorCode::kUnsupported,
                     node_place(scene, i) + ": more than " + std::to_string(kMaxInstances) + " instances in all"};
      total += *more;
      for (uint32_t m = 0; m < group.mesh_count; ++m) {
        const auto triangles = format::checked_mul(copies_of(node), tables.meshes[group.first_mesh + m].triangle_count);
        const auto sum = triangles ? format::checked_add(record.triangle_count, *triangles) : std::nullopt;
        if (!sum) return Error{ErrorCode::kUnsupported, scene.file_name + ": a scene draws more than 2^64 triangles"};
        record.triangle_count = *sum;
      }
      SCREE_TRY(planner.add(i, world[i]));
    }
    record.instance_count = total - record.first_instance;
    tables.scenes.push_back(record);
  }
  planner.finish();
  return plan;
}

Result<void> write_nodes(const SourceScene& scene, const InstancePlan& plan, format::TableSet& tables,
                         format::ContainerWriter& writer) {
  RecordBuffer<format::NodeRecord> nodes(writer, format::TableKind::kNodes);
  uint64_t node_instances = 0;
  for (const SourceNode& node : scene.nodes) {
    format::NodeRecord record{};
    record.name = tables.strings.add(node.name);
    record.parent = node.parent;
    record.group = node.group;
    record.camera = node.camera;
    record.flags = node.has_matrix ? uint32_t{format::kNodeHasMatrix} : 0u;
    record.first_node_instance = node_instances;
    record.node_instance_count = node.instances ? node.instances->count : 0;
    node_instances += record.node_instance_count;
    std::copy(node.local.values().begin(), node.local.values().end(), record.local);
    SCREE_TRY(nodes.add(record));
  }
  SCREE_TRY(nodes.flush());

  for (uint32_t node = 0; node < scene.nodes.size(); ++node) {
    if (!scene.nodes[node].instances) continue;
    const auto write = [&](uint64_t, std::span<const format::NodeInstanceRecord> block) {
      return writer.append_records(format::TableKind::kNodeInstances, sizeof(block[0]), std::as_bytes(block));
    };
    SCREE_TRY(for_each_block(scene, node, write));
  }

  const auto write_matrices = [&](std::span<const MatrixRecord> block) {
    return writer.append_records(format::TableKind::kMatrices, sizeof(block[0]), std::as_bytes(block));
  };
  SCREE_TRY(write_matrices(plan.matrices));
  for (const InstancePlan::Stream& stream : plan.streams)
    SCREE_TRY(for_each_matrix_block(scene, stream.node, stream.world, write_matrices));

  RecordBuffer<format::InstanceRecord> instances(writer, format::TableKind::kInstances);
  const auto add_node = [&](uint32_t mesh, uint32_t node) -> Result<void> {
    const InstancePlan::Node& place = plan.nodes[node];
    const uint64_t copies = copies_of(scene.nodes[node]);
    for (uint64_t copy = 0; copy < copies; ++copy) {
      const uint64_t matrix = place.is_streamed ? place.first + copy : plan.matrix_of[place.first + copy];
      SCREE_TRY(instances.add({mesh, node, static_cast<uint32_t>(matrix), static_cast<uint32_t>(copy)}));
    }
    return {};
  };
  const DrawnNodes drawn(scene, tables, plan.by_group);
  for (const SourceSceneRoots& source : plan.scenes) {
    const std::vector<uint32_t> places = drawn.places(source);
    for (auto begin = places.begin(), end = begin; begin != places.end(); begin = end) {
      const uint32_t number = scene.nodes[plan.by_group[*begin]].group;
      end = std::lower_bound(begin, places.end(), plan.first_of_group[number + 1]);
      const format::GroupRecord& group = tables.groups[number];
      for (uint32_t mesh = group.first_mesh; mesh < group.first_mesh + group.mesh_count; ++mesh)
        for (auto place = begin; place != end; ++place) SCREE_TRY(add_node(mesh, plan.by_group[*place]));
    }
  }
  return instances.flush();
}

std::vector<bool> materials_used(const SourceScene& scene, std::span<const Measured> measured) {
  std::vector<bool> used(scene.materials.size());
  for (size_t i = 0; i < scene.primitives.size(); ++i)
    if (measured[i].triangles != 0 && scene.primitives[i].material != kNone) used[scene.primitives[i].material] = true;
  return used;
}

std::optional<std::vector<bool>> materials_known(const SourceScene& scene, const std::vector<bool>& wanted,
                                                 bool drop_nonfinite) {
  std::vector<bool> known(scene.materials.size()), possible(scene.materials.size());
  for (size_t i = 0; i < scene.primitives.size(); ++i) {
    const Primitive& primitive = scene.primitives[i];
    if (!wanted[i] || primitive.material == kNone || primitive.triangle_count() == 0) continue;
    possible[primitive.material] = true;
    if (primitive.mode == PrimitiveMode::kTriangles && !drop_nonfinite) known[primitive.material] = true;
  }
  if (known != possible) return std::nullopt;
  return known;
}

MaterialUse find_material_use(const SourceScene& scene, const std::vector<bool>& materials_used) {
  MaterialUse use;
  std::vector<bool> textures(scene.textures.size());
  std::vector<bool> images(scene.images.size());
  for (size_t i = 0; i < scene.materials.size(); ++i)
    if (materials_used[i]) visit_textures(scene.materials[i], [&](const uint32_t& used) { textures[used] = true; });
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
    NamedMaterial material = scene.materials[i];
    visit_textures(material, [&](uint32_t& texture) { texture = use.textures[texture]; });
    material.record.name = tables.strings.add(material.name);
    if (material.surface) {
      material.surface->material = static_cast<uint32_t>(tables.materials.size());
      tables.surfaces.push_back(*material.surface);
    }
    tables.materials.push_back(material.record);
  }
  for (size_t i = 0; i < scene.textures.size(); ++i) {
    if (use.textures[i] == kNone) continue;
    format::TextureRecord record = scene.textures[i].record;
    record.name = tables.strings.add(scene.textures[i].name);
    record.image = image_places[record.image];
    tables.textures.push_back(record);
  }
}

Result<void> visit_world_matrices(const SourceScene& scene, const InstancePlan& plan, uint32_t group,
                                  const std::function<void(const format::MatrixRecord&)>& take) {
  for (uint64_t i = plan.first_of_group[group]; i < plan.first_of_group[group + 1]; ++i) {
    const uint32_t node = plan.by_group[i];
    const InstancePlan::Node& place = plan.nodes[node];
    if (place.first == UINT64_MAX) continue;
    if (!place.is_streamed) {
      for (uint64_t m = place.first; m < place.first + copies_of(scene.nodes[node]); ++m)
        take(plan.matrices[plan.matrix_of[m]]);
      continue;
    }
    // The streams follow the held matrices, one after another.
    uint64_t first = plan.matrices.size();
    for (const InstancePlan::Stream& stream : plan.streams) {
      if (first == place.first) {
        const auto visit = [&](std::span<const MatrixRecord> block) -> Result<void> {
          for (const MatrixRecord& matrix : block) take(matrix);
          return {};
        };
        SCREE_TRY(for_each_matrix_block(scene, stream.node, stream.world, visit));
        break;
      }
      first += copies_of(scene.nodes[stream.node]);
    }
  }
  return {};
}

std::vector<uint32_t> meshes_sharing_matrices(const InstancePlan& plan, const SourceScene& scene,
                                              const format::TableSet& tables) {
  if (!plan.streams.empty()) return std::vector<uint32_t>(tables.meshes.size(), 0);
  std::vector<uint32_t> parent(tables.meshes.size());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto root = [&](uint32_t mesh) {
    while (parent[mesh] != mesh) mesh = parent[mesh] = parent[parent[mesh]];
    return mesh;
  };
  std::vector<uint32_t> first_mesh(plan.matrices.size(), kNone);
  for (uint32_t node = 0; node < scene.nodes.size(); ++node) {
    if (plan.nodes[node].first == UINT64_MAX) continue;
    const format::GroupRecord& group = tables.groups[scene.nodes[node].group];
    for (uint64_t copy = 0; copy < copies_of(scene.nodes[node]); ++copy) {
      uint32_t& first = first_mesh[plan.matrix_of[plan.nodes[node].first + copy]];
      if (first == kNone) first = group.first_mesh;
      for (uint32_t mesh = group.first_mesh; mesh < group.first_mesh + group.mesh_count; ++mesh) {
        const uint32_t a = root(first);
        const uint32_t b = root(mesh);
        parent[std::max(a, b)] = std::min(a, b);
      }
    }
  }
  for (uint32_t mesh = 0; mesh < parent.size(); ++mesh) parent[mesh] = root(mesh);
  return parent;
}

}  // namespace scree::convert
