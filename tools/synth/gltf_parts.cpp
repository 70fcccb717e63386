#include "tools/synth/gltf_parts.h"

#include <algorithm>
#include <map>
#include <thread>

namespace scree::synth {

using namespace tools;

uint32_t add_stream(GltfWriter& writer, uint64_t offset, uint64_t bytes, GltfAccessor accessor, GltfTarget target) {
  accessor.buffer_view = writer.add_buffer_view({offset, bytes, 0, target});
  return writer.add_accessor(std::move(accessor));
}

Result<void> add_instanced_nodes(GltfWriter& writer, std::span<const Placement> placements,
                                 std::vector<uint32_t>& nodes) {
  struct Streams {
    std::vector<float> translations, rotations, scales;
  };
  std::map<uint32_t, Streams> of_mesh;
  for (const Placement& placement : placements) {
    Streams& streams = of_mesh[placement.mesh];
    for (const double part : placement.translation) streams.translations.push_back(static_cast<float>(part));
    for (const double part : placement.rotation) streams.rotations.push_back(static_cast<float>(part));
    for (const double part : placement.scale) streams.scales.push_back(static_cast<float>(part));
  }
  for (const auto& [mesh, streams] : of_mesh) {
    GltfNode node{.name = "instances of mesh" + std::to_string(mesh), .mesh = mesh};
    const auto attribute = [&](const char* semantic, const std::vector<float>& values, GltfType type,
                               uint64_t components) -> Result<void> {
      const Result<uint32_t> added =
          append_stream(writer, values, {.type = type, .count = values.size() / components}, GltfTarget::kNone);
      if (!added) return added.error();
      node.instancing.emplace_back(semantic, *added);
      return {};
    };
    Result<void> added = attribute("TRANSLATION", streams.translations, GltfType::kVec3, 3);
    if (added) added = attribute("ROTATION", streams.rotations, GltfType::kVec4, 4);
    if (added) added = attribute("SCALE", streams.scales, GltfType::kVec3, 3);
    if (!added) return added;
    nodes.push_back(writer.add_node(std::move(node)));
  }
  return {};
}

uint32_t thread_count(uint32_t wanted, uint64_t items) {
  const uint64_t count = wanted != 0 ? wanted : std::thread::hardware_concurrency();
  return static_cast<uint32_t>(std::max<uint64_t>(1, std::min(count, items)));
}

}  // namespace scree::synth
