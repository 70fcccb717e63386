#include "tools/gltf/nodes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <optional>
#include <queue>
#include <regex>

#include "format/fail.h"

namespace scree::convert {
namespace {

using format::kNone;

// At most 2.7 GB of records in the file. A short JSON can demand any number of instances by naming one accessor in many
// nodes.
constexpr uint64_t kMaxNodeInstances = uint64_t{1} << 26;

constexpr uint64_t kInstanceBlock = 4096;

// libstdc++ compiles and matches recursively, with some hundred bytes of stack per character.
constexpr size_t kMaxMatchedName = 1024;
constexpr size_t kMaxPattern = 1024;

std::string node_place(uint64_t node) {
  return "node " + std::to_string(node);
}

Error not_there(const std::string& place, const char* what, int64_t index, size_t count) {
  return {ErrorCode::kRange, place + ": " + what + " " + std::to_string(index) + " does not exist, the document has " +
                                 std::to_string(count)};
}

Result<void> check_references(const GltfDocument& document) {
  const auto present = [](int32_t index, size_t count) {
    return index == kAbsent || static_cast<size_t>(index) < count;
  };
  for (size_t i = 0; i < document.nodes.size(); ++i) {
    const DocNode& node = document.nodes[i];
    if (!present(node.mesh, document.meshes.size()))
      return not_there(node_place(i), "mesh", node.mesh, document.meshes.size());
    if (!present(node.camera, document.cameras.size()))
      return not_there(node_place(i), "camera", node.camera, document.cameras.size());
    if (!present(node.skin, document.skins)) return not_there(node_place(i), "skin", node.skin, document.skins);
  }
  return {};
}

struct Trees {
  std::vector<uint32_t> parent;  // by node, or kNone
  std::vector<uint32_t> top;     // by node: its topmost ancestor, or itself
  std::vector<bool> sole;        // by node: its ancestors have no other child, no mesh and no camera
};

Result<Trees> find_trees(const GltfDocument& document) {
  const size_t count = document.nodes.size();
  Trees trees;
  std::vector<uint32_t>& parent = trees.parent;
  parent.assign(count, kNone);
  for (uint32_t i = 0; i < count; ++i) {
    for (const uint32_t child : document.nodes[i].children) {
      if (child >= count) return not_there(node_place(i), "child", child, count);
      if (parent[child] != kNone) {
        return fail(ErrorCode::kRange, node_place(child), ": has two parents, nodes ", parent[child], " and ", i);
      }
      parent[child] = i;
    }
  }
  // Each node has at most one parent. So a node that no root reaches is on a cycle or below one, and climbing from it
  // ends on the cycle.
  std::vector<uint32_t>& top = trees.top;
  top.assign(count, kNone);
  trees.sole.assign(count, true);
  std::vector<uint32_t> stack;
  for (uint32_t i = 0; i < count; ++i) {
    if (parent[i] == kNone) stack.push_back(i);
  }
  uint64_t reached_count = 0;
  while (!stack.empty()) {
    const uint32_t node = stack.back();
    stack.pop_back();
    top[node] = parent[node] == kNone ? node : top[parent[node]];
    ++reached_count;
    const DocNode& from = document.nodes[node];
    const auto& children = from.children;
    const bool sole = trees.sole[node] && children.size() == 1 && from.mesh == kAbsent && from.camera == kAbsent;
    for (const uint32_t child : children) trees.sole[child] = sole;
    stack.insert(stack.end(), children.begin(), children.end());
  }
  if (reached_count < count) {
    uint32_t node = static_cast<uint32_t>(std::find(top.begin(), top.end(), kNone) - top.begin());
    std::vector<bool> passed(count, false);
    while (!passed[node]) {
      passed[node] = true;
      node = parent[node];
    }
    return Error{ErrorCode::kRange, node_place(node) + ": is its own ancestor"};
  }
  return trees;
}

Result<std::optional<std::regex>> compile(const std::string& exclude) {
  if (exclude.empty()) return std::optional<std::regex>();
  if (exclude.size() > kMaxPattern)
    return fail(ErrorCode::kUsage, "--exclude: a pattern of ", exclude.size(), " characters, expected at most ",
                kMaxPattern);
  try {
    return std::optional<std::regex>(std::regex(exclude, std::regex::ECMAScript));
  } catch (const std::regex_error& error) {
    return Error{ErrorCode::kUsage, "--exclude \"" + exclude + "\": " + error.what()};
  }
}

Result<bool> matches(const std::regex& pattern, const std::string& name, const std::string& exclude) {
  if (name.size() > kMaxMatchedName)
    return fail(ErrorCode::kUnsupported, "its name has ", name.size(), " characters, but --exclude matches at most ",
                kMaxMatchedName);
  try {
    return std::regex_search(name, pattern);
  } catch (const std::regex_error& error) {
    return Error{ErrorCode::kUsage, "--exclude \"" + exclude + "\": " + error.what()};
  }
}

// The roots of each scene. A scene should list only roots. Some writers also list children. That is accepted if the
// topmost ancestor is listed too, or if the ancestor has no other descendants and nothing of its own to draw.
Result<std::vector<std::vector<uint32_t>>> find_scene_roots(const GltfDocument& document, const Trees& trees) {
  const size_t count = document.nodes.size();
  std::vector<std::vector<uint32_t>> scenes(document.scenes.size());
  std::vector<uint64_t> listed_in(count, 0);  // scene number + 1
  for (size_t s = 0; s < document.scenes.size(); ++s) {
    const std::string place = "scene " + std::to_string(s);
    for (const uint32_t node : document.scenes[s].roots) {
      if (node >= count) return not_there(place, "node", node, count);
      if (listed_in[node] == s + 1) return fail(ErrorCode::kRange, place, ": node ", node, " appears twice");
      listed_in[node] = s + 1;
      if (trees.parent[node] == kNone) scenes[s].push_back(node);
    }
    for (const uint32_t node : document.scenes[s].roots) {
      const uint32_t top = trees.top[node];
      if (listed_in[top] == s + 1) continue;
      if (!trees.sole[node]) {
        return fail(ErrorCode::kRange, place, ": node ", node, " is no root, it is a child of node ",
                    trees.parent[node]);
      }
      listed_in[top] = s + 1;
      scenes[s].push_back(top);
    }
  }
  if (document.scene != kAbsent && static_cast<size_t>(document.scene) >= document.scenes.size())
    return not_there("document", "scene", document.scene, document.scenes.size());
  return scenes;
}

bool finite(const double* values, size_t count) {
  return std::all_of(values, values + count, [](double v) { return std::isfinite(v); });
}

// Scales a quaternion to unit length; false for zero.
template <class T>
bool normalise(T* q) {
  const double length =
      std::sqrt(double{q[0]} * q[0] + double{q[1]} * q[1] + double{q[2]} * q[2] + double{q[3]} * q[3]);
  if (!(length > 1e-12) || !std::isfinite(length)) return false;
  for (int i = 0; i < 4; ++i) q[i] = static_cast<T>(q[i] / length);
  return true;
}

Result<std::optional<Accessor>> instance_accessor(const DocNode& node, const char* name, uint32_t components,
                                                  GltfBuffers& buffers) {
  for (const auto& [attribute, index] : node.instancing) {
    if (attribute != name) continue;
    auto accessor = SCREE_TRY_AT(name, buffers.accessor(index));
    const bool rotation = components == 4;
    const bool typed = accessor.type == ComponentType::kFloat32 ||
                       (rotation && accessor.normalized &&
                        (accessor.type == ComponentType::kInt8 || accessor.type == ComponentType::kInt16));
    if (accessor.components != components || !typed) {
      return fail(ErrorCode::kFormat, name, ": accessor ", index, " is no ",
                  rotation ? "VEC4 of float or normalised byte or short" : "VEC3 of float");
    }
    if (accessor.source == nullptr) {
      return fail(ErrorCode::kUnsupported, name, ": accessor ", index, " has no buffer view");
    }
    return std::optional<Accessor>(std::move(accessor));
  }
  return std::optional<Accessor>();
}

/// Checks all instances of a node.
Result<SourceInstances> check_instances(const DocNode& node, GltfBuffers& buffers, uint64_t most) {
  SourceInstances instances;
  struct Stream {
    const char* name;
    uint32_t components;
    std::optional<Accessor>* accessor;
  };
  const std::array<Stream, 3> streams{{{"TRANSLATION", 3, &instances.translation},
                                       {"ROTATION", 4, &instances.rotation},
                                       {"SCALE", 3, &instances.scale}}};
  std::optional<uint64_t> count;
  for (const Stream& stream : streams) {
    *stream.accessor = SCREE_TRY(instance_accessor(node, stream.name, stream.components, buffers));
    if (!*stream.accessor) continue;
    if (count && *count != (*stream.accessor)->count) {
      return fail(ErrorCode::kRange, stream.name, " has ", (*stream.accessor)->count, " instances, expected ", *count);
    }
    count = (*stream.accessor)->count;
  }
  if (!count) {
    // Without transforms, another attribute (_ID) gives the number of instances, which all have the node's own
    // transform.
    for (const auto& [attribute, index] : node.instancing) {
      auto accessor = SCREE_TRY_AT(attribute.substr(0, 40), buffers.accessor(index));
      if (accessor.source != nullptr) count = accessor.count;
    }
  }
  if (count.value_or(0) == 0) return Error{ErrorCode::kFormat, "no instances"};
  if (*count > most) {
    return fail(ErrorCode::kMemory, "more than ", kMaxNodeInstances, " instances in all nodes");
  }
  instances.count = *count;
  std::vector<format::NodeInstanceRecord> block(std::min(*count, kInstanceBlock));
  for (uint64_t done = 0; done < *count; done += block.size()) {
    SCREE_TRY(buffers.check_stop());
    block.resize(std::min<uint64_t>(block.size(), *count - done));
    SCREE_TRY(read_instances(instances, done, block));
  }
  return instances;
}

}  // namespace

Result<NodePlan> plan_nodes(const GltfDocument& document, const ImportOptions& options) {
  const std::string& exclude = options.exclude;
  const size_t count = document.nodes.size();
  SCREE_TRY(check_references(document));
  auto trees = SCREE_TRY(find_trees(document));
  auto scenes = SCREE_TRY(find_scene_roots(document, trees));
  auto pattern = SCREE_TRY(compile(exclude));

  NodePlan plan{.parent = std::move(trees.parent)};
  if (scenes.empty() && count > 0) {
    plan.implied_scene = true;
    scenes.emplace_back();
    for (uint32_t i = 0; i < count; ++i) {
      if (plan.parent[i] == kNone) scenes.front().push_back(i);
    }
  }

  // Goes down from the scenes' roots. An excluded node excludes everything below it.
  enum : uint8_t { kUnseen, kKept, kExcluded };
  std::vector<uint8_t> state(count, kUnseen);
  std::vector<std::pair<uint32_t, bool>> stack;  // node, whether it is below an excluded one
  for (const std::vector<uint32_t>& roots : scenes) {
    for (const uint32_t root : roots) {
      if (state[root] == kUnseen) stack.emplace_back(root, false);
      while (!stack.empty()) {
        SCREE_TRY(options.check_stop());
        const auto [node, below] = stack.back();
        stack.pop_back();
        bool out = below;
        if (!out && pattern) {
          auto match = matches(*pattern, document.nodes[node].name, exclude);
          if (!match)
            return match.error().code == ErrorCode::kUsage ? match.error() : at(node_place(node), match.error());
          out = *match;
        }
        state[node] = out ? kExcluded : kKept;
        if (out) ++plan.excluded;
        for (const uint32_t child : document.nodes[node].children) stack.emplace_back(child, out);
      }
    }
  }
  plan.outside = static_cast<uint64_t>(std::count(state.begin(), state.end(), kUnseen));

  // Parents first; among the nodes that are ready, the lowest number.
  std::priority_queue<uint32_t, std::vector<uint32_t>, std::greater<>> ready;
  for (uint32_t i = 0; i < count; ++i) {
    if (state[i] == kKept && plan.parent[i] == kNone) ready.push(i);
  }
  plan.place.assign(count, kNone);
  while (!ready.empty()) {
    const uint32_t node = ready.top();
    ready.pop();
    plan.place[node] = static_cast<uint32_t>(plan.order.size());
    plan.order.push_back(node);
    for (const uint32_t child : document.nodes[node].children) {
      if (state[child] == kKept) ready.push(child);
    }
  }

  const size_t drawn = document.scene == kAbsent ? 0 : static_cast<size_t>(document.scene);
  for (size_t s = 0; s < scenes.size(); ++s) {
    SourceSceneRoots roots;
    if (!plan.implied_scene) roots.name = document.scenes[s].name;
    roots.is_default = s == drawn;
    for (const uint32_t root : scenes[s]) {
      if (state[root] == kKept) roots.roots.push_back(plan.place[root]);
    }
    plan.scenes.push_back(std::move(roots));
  }
  return plan;
}

Result<void> read_instances(const SourceInstances& instances, uint64_t first,
                            std::span<format::NodeInstanceRecord> out) {
  std::fill(out.begin(), out.end(), format::NodeInstanceRecord{{0, 0, 0}, {0, 0, 0, 1}, {1, 1, 1}});
  std::array<float, 4 * 1024> values;
  const auto read_stream = [&](const std::optional<Accessor>& accessor, const char* name, auto field) -> Result<void> {
    if (!accessor) return {};
    const uint32_t components = accessor->components;
    for (uint64_t done = 0; done < out.size();) {
      const uint64_t count = std::min<uint64_t>(values.size() / 4, out.size() - done);
      const std::span<float> block(values.data(), count * components);
      SCREE_TRY(read_floats(*accessor, first + done, count, block));
      for (uint64_t i = 0; i < count; ++i) {
        float* const to = field(out[done + i]);
        std::copy_n(block.data() + i * components, components, to);
        const bool usable = std::all_of(to, to + components, [](float v) { return std::isfinite(v); }) &&
                            (components != 4 || normalise(to));
        if (!usable) {
          return fail(ErrorCode::kRange, name, " of instance ", first + done + i,
                      components == 4 ? " is not a rotation" : " is not finite");
        }
      }
      done += count;
    }
    return {};
  };
  using Record = format::NodeInstanceRecord;
  SCREE_TRY(read_stream(instances.translation, "TRANSLATION", [](Record& r) { return r.translation; }));
  SCREE_TRY(read_stream(instances.rotation, "ROTATION", [](Record& r) { return r.rotation; }));
  return read_stream(instances.scale, "SCALE", [](Record& r) { return r.scale; });
}

Result<std::vector<SourceNode>> make_nodes(const GltfDocument& document, const NodePlan& plan,
                                           const std::vector<uint32_t>& group, GltfBuffers& buffers) {
  std::vector<SourceNode> nodes;
  nodes.reserve(plan.order.size());
  uint64_t instances_left = kMaxNodeInstances;
  for (const uint32_t number : plan.order) {
    SCREE_TRY(buffers.check_stop());
    const DocNode& from = document.nodes[number];
    const std::string place = node_place(number);
    SourceNode node{.name = from.name};
    const uint32_t parent = plan.parent[number];
    node.parent = parent == kNone ? kNone : plan.place[parent];
    if (from.mesh != kAbsent) node.group = group[static_cast<size_t>(from.mesh)];
    if (from.camera != kAbsent) node.camera = static_cast<uint32_t>(from.camera);
    node.has_matrix = from.has_matrix;
    if (from.local.is_set()) {
      LocalTransform::Values local = from.local.values();
      if (!finite(local.data(), local.size())) return Error{ErrorCode::kRange, place + ": its transform is not finite"};
      if (!node.has_matrix && !normalise(local.data() + 3))
        return Error{ErrorCode::kRange, place + ": rotation has no length"};
      node.local = LocalTransform(local);
    }
    if (from.has_instancing && node.group != kNone) {
      auto instances =
          SCREE_TRY_AT(place + ": EXT_mesh_gpu_instancing", check_instances(from, buffers, instances_left));
      instances_left -= instances.count;
      node.instances = std::make_shared<SourceInstances>(std::move(instances));
    }
    nodes.push_back(std::move(node));
  }
  return nodes;
}

}  // namespace scree::convert
