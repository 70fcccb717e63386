#include "tools/convert/passes/output_bound.h"

#include "tools/convert/encode/encode.h"

namespace scree::convert {

uint64_t most_geometry_bytes(const ConvertOptions& options, std::span<const WindowPlan> windows,
                             std::span<const MeshPlan> plans, std::span<const uint32_t> mesh_of) {
  uint64_t bytes = 0;
  for (const WindowPlan& window : windows) {
    const uint64_t chunks = options.chunk_triangles == 0 ? 1 : window.kept / options.chunk_triangles + 2;
    bytes += encoded_bytes_estimate(plans[mesh_of[window.primitive]], window) + 512 * chunks;
  }
  return bytes;
}

uint64_t most_geometry_bytes(const SourceScene& scene, const std::vector<bool>& wanted, const MemoryPlan& memory) {
  uint64_t bytes = 0;
  for (size_t i = 0; i < wanted.size(); ++i)
    if (wanted[i]) bytes += memory.most_stored_bytes(scene.primitives[i]);
  return bytes;
}

uint64_t most_file_bytes(uint64_t geometry, const SourceScene& scene, const ImagePlan& images, uint64_t masks,
                         uint64_t strings) {
  uint64_t bytes = (uint64_t{1} << 20) + geometry + masks + strings;
  for (const uint64_t cost : images.costs) bytes += 4 * cost;
  bytes += 512 * (scene.nodes.size() + scene.primitives.size());
  for (const SourceNode& node : scene.nodes)
    bytes += node.name.size() + (node.instances ? 256 * node.instances->count : 0);
  return bytes + bytes / 4;
}

}  // namespace scree::convert
