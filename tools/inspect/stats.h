// What a .scree file holds and what each part costs, counted from its tables, and on request from the records of
// clusters in its pages.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "format/container/container.h"
#include "format/layout.h"
#include "runtime/scene/camera.h"

namespace scree::inspect {

/// What chunks hold. The data of clusters are indices (steps and distances) and positions, which lie in one piece: how
/// much of it is which stands in the pages alone. With gather()'s `reads_pages` they count there (all of them as
/// positions where the page cannot be read), else under kClusterData.
enum Stream : size_t {
  kIndices,
  kPositions,
  kClusterBounds,
  kClusterRecords,
  kUvs,
  kColors,
  kNormals,
  kSourceIds,
  kClusterData,
  kStreamCount
};

/// Stable names, for --json ("indices", "positions", "uvs", ...) and for people ("texture coordinates", ...).
const char* stream_key(Stream stream);
const char* stream_title(Stream stream);

/// Bytes of one kind of content. `stored`: in the file; of a compressed page each stream and gap has the share of the
/// page's stored bytes that it has of its raw bytes, rounded so that the shares add up to the page. `raw`: before
/// compression.
struct Cost {
  uint64_t stored = 0;
  uint64_t raw = 0;
};

/// Least, middle and most of a list.
struct Spread {
  uint64_t min = 0;
  uint64_t median = 0;
  uint64_t max = 0;
};

struct TableCost {
  format::TableKind kind;
  const char* name;  // "pages", "meshes", ...; "unknown" for kinds this version does not know
  uint64_t records = 0;
  uint64_t record_bytes = 0;
  uint64_t bytes = 0;
};

/// All chunks with one width of index.
struct IndexBits {
  uint64_t chunks = 0;
  uint64_t triangles = 0;
};

/// All clustered chunks. Bytes are raw ones.
struct ClusterStats {
  uint64_t chunks = 0;
  uint64_t clusters = 0;
  uint64_t triangles = 0;
  uint64_t vertices = 0;   // borders counted once a cluster
  uint64_t predicted = 0;  // clusters of which one axis follows from the others; with `reads_pages`
  std::array<uint64_t, kStreamCount> bytes{};
};

/// All meshes with one step (or with float32 positions).
struct LatticeStats {
  bool is_float32 = false;
  int32_t exponent = 0;
  uint64_t meshes = 0;
  uint64_t triangles = 0;
  uint64_t vertices = 0;
  uint64_t stored = 0;   // bytes of the position streams
  double max_error = 0;  // model units
};

struct MeshCost {
  uint32_t mesh = 0;
  uint64_t stored = 0;  // all streams of its chunks
};

struct ImageStats {
  uint64_t images = 0;
  uint64_t pixels = 0;
  Cost cost;
};

/// What a scene's instances draw, in world space.
struct SceneExtent {
  runtime::WorldBox box;          // of their meshes' boxes, so a little larger where they are turned
  double max_position_error = 0;  // world units, per axis
};

struct Stats {
  uint64_t file_bytes = 0;

  // Contents. The sum of all `stored` here and all bytes of the container below is file_bytes.
  std::array<Cost, kStreamCount> streams{};
  bool has_split = false;  // cluster data count as indices and positions
  Cost images;             // and masks

  // Container.
  uint64_t header_bytes = 0;
  uint64_t toc_bytes = 0;
  std::vector<TableCost> tables;  // in file order of the table of contents
  uint64_t tables_bytes = 0;
  Cost page_gaps;              // of geometry pages, in no chunk
  uint64_t other_pages = 0;    // bytes of pages that nothing refers to or whose kind this version does not know
  uint64_t padding_bytes = 0;  // between and after pages and tables

  // Counts.
  uint64_t triangles = 0;                              // stored: over the meshes, not their instances
  uint64_t vertices = 0;                               // stored, as MeshRecord::vertex_count
  uint64_t source_vertices = 0;                        // of the source, as MeshRecord::source_vertex_count
  uint64_t reference_vertices = 0;                     // of the float32 yardstick: the smaller of the two, mesh by mesh
  std::array<uint64_t, kStreamCount> stream_meshes{};  // that have the stream
  std::array<uint64_t, kStreamCount> stream_elements{};  // vertices, or indices, or triangles (source numbers)
  std::array<uint64_t, kStreamCount>
      reference_bytes{};          // as float32 and 32-bit indices, where the stream has such a form
  double max_position_error = 0;  // model units
  double max_uv_error = 0;
  uint32_t min_normal_bits = 0;
  uint64_t float32_meshes = 0;

  std::vector<SceneExtent> extents;  // of the scenes

  Spread mesh_triangles, chunk_triangles, chunk_vertices, chunk_bytes;
  uint64_t pages = 0, compressed_pages = 0, geometry_pages = 0;
  std::array<IndexBits, 33> index_bits{};  // of indexed chunks
  ClusterStats clusters;
  std::vector<LatticeStats> lattices;       // float32 first, then from the coarsest step to the finest
  std::vector<MeshCost> top_meshes;         // the costliest, at most `top`; equal costs by number
  std::array<ImageStats, 5> image_kinds{};  // by ImageCodec, mip levels included
  std::vector<uint32_t> top_images;         // by stored bytes of their page and levels
  uint64_t mip_levels = 0;
  uint64_t level_bytes = 0;   // of them
  uint64_t masks = 0;         // materials with one
  uint64_t opaque_masks = 0;  // materials whose alpha mask hides nothing
  Cost mask_pages;

  uint64_t geometry_bytes() const;   // all streams, stored
  uint64_t attribute_bytes() const;  // uvs, colours, normals, stored
  uint64_t container_bytes() const;  // all but streams and images
};

/// Counts. `bytes`: the whole file that `file` was opened on. `top`: how many meshes and images to list. Takes about 60
/// ns a chunk, 16 bytes a mesh and chunk. `reads_pages`: loads every page of clustered chunks, one after the other, for
/// what their indices take; else only tables are read.
Stats gather(const format::Container& file, std::span<const std::byte> bytes, uint32_t top, bool reads_pages);

/// Stored bytes of an image: its page, and its mip levels.
uint64_t image_bytes(const format::Container& file, uint32_t image);

/// "Rock", or "Rock #2" where the glTF mesh has several primitives, or "mesh 12" where it has no name.
std::string mesh_name(const format::Container& file, uint32_t mesh);

}  // namespace scree::inspect
