// Parts that the scene writers share: meshes, textures, instances, cameras, row-parallel loops.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "format/result.h"
#include "format/vec3.h"
#include "tools/gltf/write/writer.h"
#include "tools/synth/scene_functions.h"

namespace scree::synth {

inline Vec3 normalized(const Vec3& a) {
  return a * (1.0 / std::sqrt(dot(a, a)));
}

/// Triangles with one material, in the form of glTF.
struct Mesh {
  std::string name;
  std::vector<float> positions;  // 3 per vertex
  std::vector<float> uvs;        // 2 per vertex, or none
  std::vector<uint8_t> colors;   // 4 per vertex, or none: linear, multiplied with the base colour
  std::vector<uint32_t> indices;
  uint32_t material = format::kNone;
  bool may_have_short_indices = false;  // of 16 bits, if they suffice

  uint64_t vertex_count() const { return positions.size() / 3; }
  void add_vertex(const Vec3& at, double u, double v);
  /// The triangles a, b, c and a, c, d.
  void add_quad(uint32_t a, uint32_t b, uint32_t c, uint32_t d);
  /// The quads of a grid that consists of the first `rows` + 1 times `columns` + 1 vertices, row after row. Their
  /// triangles are counter-clockwise for a viewer to whom columns run to the right and rows run up, or down.
  enum class Rows : uint8_t { kUp, kDown };
  void add_grid(uint32_t columns, uint32_t rows, Rows direction);
};

/// Appends the mesh's streams to the buffer.
Result<tools::GltfPrimitive> append_primitive(tools::GltfWriter& writer, const Mesh& mesh);

/// A texture that is filtered trilinearly.
tools::GltfTexture trilinear(uint32_t image, std::string name = {}, format::Wrap wrap = format::Wrap::kRepeat);

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
  const uint64_t offset = SCREE_TRY(writer.append(bytes));
  return add_stream(writer, offset, bytes.size(), std::move(accessor), target);
}

/// A node with the placement's mesh and transform.
tools::GltfNode node_of(const Placement& placement, std::string name);

/// Adds a camera, and a node that takes it to `eye` and turns it to `target`; y is up. Returns the node.
uint32_t add_camera(tools::GltfWriter& writer, const tools::GltfCamera& lens, const Vec3& eye, const Vec3& target);

/// Adds one node per placed mesh, with EXT_mesh_gpu_instancing (float translations, quaternions and scales), and the
/// nodes' indices to `nodes`.
Result<void> add_instanced_nodes(tools::GltfWriter& writer, std::span<const Placement> placements,
                                 std::vector<uint32_t>& nodes);

/// Uniform numbers from 0 to 1, one after the other. `stream`: distinguishes sequences with one seed.
class Random {
 public:
  explicit Random(uint32_t seed, uint32_t stream = 0) : seed_(seed), stream_(stream) {}
  double next() { return unit24(hash2(seed_, count_++, stream_)); }
  double between(double low, double high) { return low + (high - low) * next(); }

 private:
  uint32_t seed_;
  uint32_t stream_;
  uint32_t count_ = 0;
};

/// The number of threads for the option's value `wanted`; 0 means one per processor. At most `items`, at least 1.
uint32_t thread_count(uint32_t wanted, uint64_t items);

}  // namespace scree::synth
