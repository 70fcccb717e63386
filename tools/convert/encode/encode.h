// The second pass: a window of triangles becomes chunks, ordered, renumbered, quantised and bit-packed.
#pragma once

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
  kFifo,  // for a FIFO vertex cache (fifo_order.h), vertices by first use
  kNone,  // triangles as in the source, vertices ascending as in the source
};

/// Bits an axis of stored normals: the angle between a normal and its code stays below 0.05 degrees.
inline constexpr uint32_t kNormalBits = 12;

struct EncodeOptions {
  Order order = Order::kFifo;
  tools::ClusterEffort clusters = tools::ClusterEffort::kFast;  // of clustered meshes; kBest has an order of its own
  uint64_t chunk_triangles = format::kMaxChunkTriangles;        // at most; 0: the window is one chunk
  bool drop_nonfinite = false;
  bool weld = true;  // vertices equal in all that is stored of them are one
};

/// A mesh of the output: what its chunks share.
struct MeshPlan {
  uint32_t primitive = 0;   // in SourceScene::primitives
  uint32_t attributes = 0;  // format::AttributeFlags of the streams to write
  bool float32 = false;
  bool clustered = false;  // chunks are clustered; not with float32
  // Cut and welded as with float32, so that a chunk can be held against what it would take then, and none is clustered
  // that would take more.
  bool chunks_as_float32 = false;
  uint64_t sorted_triangles = 0;  // of the source, where those of a window lie anywhere among them; else 0
  format::MeshLattice lattice;
  Box box;  // of the positions measure saw
};

struct EncodedChunk {
  format::ChunkRecord record{};  // page, offset, mesh and first_triangle unset
  std::vector<std::byte> payload;
  int64_t saved = 0;  // bytes that it would take more with float32 positions, where MeshPlan::chunks_as_float32
};

/// Vertices that became another one.
struct Welded {
  // Of vertices in clusters: many of those that a cluster shares with others it has of its own in any case.
  static constexpr uint64_t kNotKnown = UINT64_MAX;

  uint64_t vertices = 0;
  uint64_t source_bytes = 0;
  uint64_t cost_bits = 0;  // with the widths of the vertices that stayed, or kNotKnown

  void add(const Welded& other) {
    vertices += other.vertices;
    source_bytes += other.source_bytes;
    cost_bits = cost_bits == kNotKnown || other.cost_bits == kNotKnown ? kNotKnown : cost_bits + other.cost_bits;
  }
};

struct EncodedWindow {
  std::vector<EncodedChunk> chunks;
  double position_error = 0;  // largest found, model units, per axis
  float uv_error = 0;         // largest possible, per axis
  Welded welded;
  uint64_t repaired_uvs = 0;      // vertices whose texture coordinates were not finite and became 0
  uint64_t repaired_colors = 0;   // likewise; became 0
  uint64_t repaired_normals = 0;  // not finite or zero; became +z
};

/// What one thread reuses from window to window.
struct EncodeScratch {
  Window window;
  tools::FifoOrder fifo;
  std::vector<uint32_t> by_use;       // corners of a scattered window, vertices numbered by first use
  std::vector<uint32_t> use_of;       // that number of a vertex
  std::vector<uint32_t> slots;        // number in the chunk of a window's vertex, or kNone
  std::vector<uint32_t> chunk_order;  // window vertices of all chunks that were cut from the order
  std::vector<uint32_t> coordinates;  // lattice coordinates of the window's vertices
  std::vector<uint32_t> chunk_indices;
  std::vector<uint32_t> cluster_vertices;     // of a chunk: places in the window's vertices
  std::vector<uint32_t> clustered_triangles;  // of all chunks, numbers in the window
  Welder welder;
  tools::ClusterBuilder clusters;
  std::vector<uint32_t> chunk_coordinates;
  std::vector<float> floats;        // one attribute of the window
  std::vector<float> chunk_floats;  // one attribute of a chunk
  std::vector<uint64_t> chunk_ids;
};

/// Encodes one window of `primitive`. Errors as Window::load; kFormat: the window is not what measure saw (the source
/// changed in between). `content`: of the window, renumbered, which is not read again then; or null.
Result<EncodedWindow> encode_window(const Primitive& primitive, const MeshPlan& mesh, const WindowPlan& plan,
                                    WindowContent* content, const EncodeOptions& options, EncodeScratch& scratch);

/// Bytes that encode_window's result takes at most, roughly; for bounding what is in flight.
uint64_t encoded_bytes_estimate(const MeshPlan& mesh, const WindowPlan& plan);

}  // namespace scree::convert
