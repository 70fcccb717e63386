// Parts that the scene writers share: streams, instances, row-parallel loops.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "format/result.h"
#include "tools/gltf/writer.h"

namespace scree::synth {

/// An instance of a mesh: scaled, rotated (quaternion xyzw), then translated.
struct Placement {
  uint32_t mesh = 0;
  std::array<double, 3> translation{};
  std::array<double, 4> rotation{0, 0, 0, 1};
  std::array<double, 3> scale{1, 1, 1};
};

/// Makes a buffer view of `bytes` at `offset`, with `accessor` as its only accessor. Returns the accessor's index.
uint32_t add_stream(tools::GltfWriter& writer, uint64_t offset, uint64_t bytes, tools::GltfAccessor accessor,
                    tools::GltfTarget target);

/// Appends `values` to the buffer, and calls add_stream() for them.
template <class T>
Result<uint32_t> append_stream(tools::GltfWriter& writer, const std::vector<T>& values, tools::GltfAccessor accessor,
                               tools::GltfTarget target) {
  const std::span<const std::byte> bytes = std::as_bytes(std::span(values));
  const Result<uint64_t> offset = writer.append(bytes);
  if (!offset) return offset.error();
  return add_stream(writer, *offset, bytes.size(), std::move(accessor), target);
}

/// Adds one node per placed mesh, with EXT_mesh_gpu_instancing (float translations, quaternions and scales), and the
/// nodes' indices to `nodes`.
Result<void> add_instanced_nodes(tools::GltfWriter& writer, std::span<const Placement> placements,
                                 std::vector<uint32_t>& nodes);

/// The number of threads for the option's value `wanted`; 0 means one per processor. At most `items`, at least 1.
uint32_t thread_count(uint32_t wanted, uint64_t items);

}  // namespace scree::synth
