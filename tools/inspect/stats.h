// Counts the content of a .scree file and the bytes of each part, from its tables and, on request, from the records of
// clusters in its pages.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "format/container/container.h"
#include "format/layout.h"
#include "runtime/scene/camera.h"

namespace scree::inspect {

/// Streams of chunks. The data of clusters hold indices (steps and distances) and positions together; only the pages
/// show the share of each. With gather()'s `reads_pages` they count under kIndices and kPositions (all of them as
/// positions if the page cannot be read), else under kClusterData.
enum Stream : size_t {
  kIndices,
  kPositions,
  kClusterBounds,
  kClusterRecords,
  kUvs,
  kColors,
  kNormals,
  kSourceIds,
  kSecondUvs,
  kTangents,
  kClusterData,
  kStreamCount
};

/// Streams of vertex attributes.
inline constexpr Stream kAttributes[] = {kUvs, kSecondUvs, kColors, kNormals, kTangents};

/// Stable names, for --json ("indices", "positions", "uvs", ...) and for people ("texture coordinates", ...).
const char* stream_key(Stream stream);
const char* stream_title(Stream stream);

/// Bytes of one kind of content. `stored`: in the file. The stored bytes of a compressed page are divided among its
/// streams and gaps in proportion to their raw bytes, rounded so that the shares add up to the page. `raw`: before
/// compression.
struct Cost {
  uint64_t stored = 0;
  uint64_t raw = 0;
};

/// Smallest, median and largest of a list.
struct Spread {
  uint64_t min = 0;
  uint64_t median = 0;
  uint64_t max = 0;
};

struct TableCost {
  format::TableKind kind;
  const char* name;  // "pages", "meshes", ...; "unknown" for kinds that this version does not have
  uint64_t records = 0;
  uint64_t record_bytes = 0;
  uint64_t bytes = 0;
};

/// All chunks with the same width of indices.
struct IndexBits {
  uint64_t chunks = 0;
  uint64_t triangles = 0;
};

/// All clustered chunks. Bytes are raw ones.
struct ClusterStats {
  uint64_t chunks = 0;
  uint64_t clusters = 0;
  uint64_t triangles = 0;
  uint64_t vertices = 0;   // border vertices count once per cluster
  uint64_t predicted = 0;  // clusters with a predicted axis; only with `reads_pages`
  std::array<uint64_t, kStreamCount> bytes{};
};

/// All meshes with the same step (or with float32 positions).
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

/// Bounds of everything that a scene's instances draw, in world space.
struct SceneExtent {
  runtime::WorldBox box;          // made from the meshes' boxes, so slightly too large for rotated instances
  double max_position_error = 0;  // world units, per axis
};

struct Stats {
  uint64_t file_bytes = 0;

  // Contents. The sum of all `stored` here and of all bytes of the container below is file_bytes.
  std::array<Cost, kStreamCount> streams{};
  bool has_split = false;  // cluster data are counted as indices and positions
  Cost images;             // with masks

  // Container.
  uint64_t header_bytes = 0;
  uint64_t toc_bytes = 0;
  std::vector<TableCost> tables;  // in file order of the table of contents
  uint64_t tables_bytes = 0;
  Cost page_gaps;              // bytes of geometry pages outside all chunks
  uint64_t other_pages = 0;    // bytes of pages to which no record refers, or of a kind that this version does not have
  uint64_t padding_bytes = 0;  // between and after pages and tables

  // Counts.
  uint64_t triangles = 0;                                // stored: over the meshes, not their instances
  uint64_t vertices = 0;                                 // stored, as MeshRecord::vertex_count
  uint64_t source_vertices = 0;                          // of the source, as MeshRecord::source_vertex_count
  std::array<uint64_t, kStreamCount> stream_meshes{};    // number of meshes with the stream
  std::array<uint64_t, kStreamCount> stream_elements{};  // vertices, or indices, or triangles (source numbers)
  std::array<uint64_t, kStreamCount> reference_bytes{};  // as float32 and 32-bit indices, for streams with such a form
  double max_position_error = 0;                         // model units
  double max_uv_error = 0;
  uint32_t min_normal_bits = 0;
  uint32_t min_tangent_bits = 0;
  std::vector<SceneExtent> extents;  // by scene

  Spread mesh_triangles, chunk_triangles, chunk_vertices, chunk_bytes;
  uint64_t pages = 0, compressed_pages = 0, geometry_pages = 0;
  std::array<IndexBits, 33> index_bits{};  // of indexed chunks
  ClusterStats clusters;
  std::vector<LatticeStats> lattices;       // float32 first, then from the coarsest step to the finest
  std::vector<MeshCost> top_meshes;         // the largest, at most `top`; equal ones by number
  std::array<ImageStats, 5> image_kinds{};  // by ImageCodec, mip levels included
  std::vector<uint32_t> top_images;         // by stored bytes of their page and levels
  uint64_t mip_levels = 0;
  uint64_t level_bytes = 0;   // of the mip levels
  uint64_t masks = 0;         // materials with a mask
  uint64_t blended = 0;       // materials that blend, some with a mask for their alpha
  uint64_t opaque_masks = 0;  // materials whose alpha mask hides no texel
  Cost mask_pages;

  uint64_t geometry_bytes() const;   // all streams, stored
  uint64_t attribute_bytes() const;  // kAttributes, stored
  uint64_t container_bytes() const;  // all except streams and images
};

/// Counts everything. `bytes`: the whole file that `file` was opened on. `top`: number of meshes and images to list.
/// Takes about 60 ns per chunk, and 16 bytes per mesh and chunk. `reads_pages`: loads every page of clustered chunks,
/// one after another, to count their indices; otherwise only tables are read.
Stats gather(const format::Container& file, std::span<const std::byte> bytes, uint32_t top, bool reads_pages);

/// Stored bytes of an image: its page, and its mip levels.
uint64_t image_bytes(const format::Container& file, uint32_t image);

/// "Rock", "Rock #2" if the glTF mesh has several primitives, or "mesh 12" if it has no name.
std::string mesh_name(const format::Container& file, uint32_t mesh);

}  // namespace scree::inspect
