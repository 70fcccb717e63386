// The second pass: turns a window of triangles into chunks that are ordered, renumbered, quantised and bit-packed.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "format/geometry/position_codec.h"
#include "format/layout.h"
#include "format/result.h"
#include "tools/clusters/cluster_builder.h"
#include "tools/clusters/fifo_order.h"
#include "tools/convert/encode/weld.h"
#include "tools/convert/windows/measure.h"
#include "tools/convert/windows/window.h"
#include "tools/gltf/source.h"

namespace scree::convert {

enum class Order {
  kFifo,  // triangles for a FIFO vertex cache (fifo_order.h), vertices by first use
  kNone,  // triangles as in the source, vertices ascending as in the source
};

/// Bits per axis of stored normals. The angle between a normal and its code stays below 0.05 degrees.
inline constexpr uint32_t kNormalBits = 12;
/// Bits of stored tangents, including the sign. The error of the angle around the normal is at most 1/512 radian, 0.112
/// degrees.
inline constexpr uint32_t kTangentBits = 12;

struct EncodeOptions {
  Order order = Order::kFifo;
  tools::ClusterEffort clusters = tools::ClusterEffort::kFast;  // for clustered meshes; kBest has its own order
  uint64_t chunk_triangles = format::kMaxChunkTriangles;        // at most; 0: the window is one chunk
  bool drop_nonfinite = false;
  bool weld = true;  // vertices that are equal in everything stored are merged
};

/// A mesh of the output: the properties that its chunks share.
struct MeshPlan {
  uint32_t primitive = 0;   // in SourceScene::primitives
  uint32_t attributes = 0;  // format::AttributeFlags of the streams to write
  bool float32 = false;
  bool clustered = false;  // chunks are clustered; never with float32
  // Cuts and welds as with float32, so that each chunk's size can be compared with float32. A chunk that clusters would
  // make larger is indexed.
  bool chunks_as_float32 = false;
  uint64_t sorted_triangles = 0;  // of the source, if a window's triangles may come from anywhere in it; else 0
  format::MeshLattice lattice;
  Box box;  // of the measured positions
};

struct EncodedChunk {
  format::ChunkRecord record{};  // page, offset, mesh and first_triangle unset
  std::vector<std::byte> payload;
  int64_t saved = 0;  // additional bytes that it would take with float32 positions, if MeshPlan::chunks_as_float32
};

/// Vertices that were merged into others.
struct Welded {
  // For clusters: each cluster stores its own copy of a shared vertex in any case.
  static constexpr uint64_t kUnknownCost = UINT64_MAX;

  uint64_t vertices = 0;
  uint64_t source_bytes = 0;
  uint64_t cost_bits = 0;  // with the widths of the remaining vertices, or kUnknownCost

  void add(const Welded& other) {
    vertices += other.vertices;
    source_bytes += other.source_bytes;
    cost_bits =
        cost_bits == kUnknownCost || other.cost_bits == kUnknownCost ? kUnknownCost : cost_bits + other.cost_bits;
  }
};

/// Errors and changes of one window or of several.
struct EncodedFacts {
  double position_error = 0;  // largest found, model units, per axis
  float uv_error = 0;         // largest possible, per axis
  Welded welded;
  uint64_t repaired_uvs = 0;       // vertices whose texture coordinates were not finite and became 0
  uint64_t repaired_colors = 0;    // the same for colours, which became 0
  uint64_t repaired_normals = 0;   // not finite or zero; became +z
  uint64_t repaired_tangents = 0;  // zero, not finite or parallel to the normal; got an arbitrary direction

  void add(const EncodedFacts& other) {
    position_error = std::max(position_error, other.position_error);
    uv_error = std::max(uv_error, other.uv_error);
    welded.add(other.welded);
    repaired_uvs += other.repaired_uvs;
    repaired_colors += other.repaired_colors;
    repaired_normals += other.repaired_normals;
    repaired_tangents += other.repaired_tangents;
  }
};

struct EncodedWindow : EncodedFacts {
  std::vector<EncodedChunk> chunks;
};

/// Memory that a thread reuses from window to window.
struct EncodeScratch {
  Window window;
  tools::FifoOrder fifo;
  std::vector<uint32_t> by_use;       // corners of a scattered window, with vertices numbered by first use
  std::vector<uint32_t> use_of;       // by vertex: that number
  std::vector<uint32_t> slots;        // by window vertex: its number in the chunk, or kNone
  std::vector<uint32_t> chunk_order;  // window vertices of all chunks cut so far
  std::vector<uint32_t> coordinates;  // lattice coordinates of the window's vertices
  std::vector<uint32_t> chunk_indices;
  std::vector<uint32_t> cluster_vertices;     // of a chunk: indices of the window's vertices
  std::vector<uint32_t> clustered_triangles;  // of all chunks: triangle numbers in the window
  Welder welder;
  tools::ClusterBuilder clusters;
  std::vector<uint32_t> chunk_coordinates;
  std::vector<float> floats;         // one attribute of the window
  std::vector<float> second_uvs;     // of the window
  std::vector<float> chunk_floats;   // one attribute of a chunk
  std::vector<float> chunk_normals;  // decoded, for its tangents
  std::vector<uint64_t> chunk_ids;
};

/// Encodes one window of `primitive`. `content`: the window's renumbered content; null: the window is read. Errors as
/// Window::load; kFormat: the window differs from the measured one (the source changed in between).
Result<EncodedWindow> encode_window(const Primitive& primitive, const MeshPlan& mesh, const WindowPlan& plan,
                                    WindowContent* content, const EncodeOptions& options, EncodeScratch& scratch);

/// Approximate upper bound of the bytes of encode_window's result, to limit the work in flight.
uint64_t encoded_bytes_estimate(const MeshPlan& mesh, const WindowPlan& plan);

}  // namespace scree::convert
