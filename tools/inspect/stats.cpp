#include "tools/inspect/stats.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <numeric>
#include <utility>

#include "format/bytes.h"
#include "format/container/mip_levels.h"
#include "format/geometry/chunk_layout.h"

namespace scree::inspect {
namespace {

using format::ChunkRecord;
using format::MeshRecord;
using format::PageKind;

/// By TableKind, which counts from 1.
constexpr const char* kTableNames[] = {
    "pages",     "meshes",     "chunks",         "groups",   "nodes",  "instances",   "matrices", "node_instances",
    "materials", "textures",   "images",         "cameras",  "scenes", "scene_roots", "strings",  "source",
    "left_out",  "mip_levels", "left_out_costs", "surfaces", "lights", "masks"};
static_assert(std::size(kTableNames) == static_cast<size_t>(format::TableKind::kMasks));

const char* table_name(format::TableKind kind) {
  const size_t index = static_cast<size_t>(kind) - 1;  // past the end for 0
  return index < std::size(kTableNames) ? kTableNames[index] : "unknown";
}

/// Divides the bytes of chunks among their streams.
class StreamBytes {
 public:
  StreamBytes(const format::Container& file, bool reads_pages) : file_(file), reads_pages_(reads_pages) {}

  /// The bytes of a chunk's streams. Adds a clustered chunk to `clusters`.
  std::array<uint64_t, kStreamCount> of(uint64_t number, ClusterStats& clusters) {
    const ChunkRecord& chunk = file_.chunks()[number];
    const format::ChunkStreams streams = format::chunk_streams(file_.meshes()[chunk.mesh], chunk);
    std::array<uint64_t, kStreamCount> bytes{};
    bytes[kIndices] = streams.indices.bytes;
    bytes[kPositions] = streams.positions.bytes;
    bytes[kUvs] = streams.uvs.bytes;
    bytes[kColors] = streams.colors.bytes;
    bytes[kNormals] = streams.normals.bytes;
    bytes[kSourceIds] = streams.source_ids.bytes;
    bytes[kSecondUvs] = streams.second_uvs.bytes;
    bytes[kTangents] = streams.tangents.bytes;
    if (chunk.encoding != format::ChunkEncoding::kClustered) return bytes;
    bytes[kClusterBounds] = streams.group_bounds.bytes + streams.cluster_bounds.bytes;
    bytes[kClusterRecords] = streams.clusters.bytes;
    if (reads_pages_) {
      bytes[kIndices] = std::min(index_bytes(chunk, streams, clusters), streams.cluster_data.bytes);
      bytes[kPositions] = streams.cluster_data.bytes - bytes[kIndices];
    } else {
      bytes[kClusterData] = streams.cluster_data.bytes;
    }
    ++clusters.chunks;
    clusters.clusters += chunk.cluster_count;
    clusters.triangles += chunk.triangle_count;
    clusters.vertices += chunk.vertex_count;
    for (size_t stream = 0; stream < kStreamCount; ++stream) clusters.bytes[stream] += bytes[stream];
    return bytes;
  }

 private:
  uint64_t index_bytes(const ChunkRecord& chunk, const format::ChunkStreams& streams, ClusterStats& clusters) {
    if (chunk.page != page_) {
      page_ = chunk.page;
      const auto loaded = file_.load_page(page_, scratch_);
      raw_ = loaded ? *loaded : std::span<const std::byte>{};
    }
    if (!format::range_within(chunk.offset, chunk.bytes, raw_.size())) return 0;
    uint64_t words = 0;
    const std::byte* records = raw_.data() + chunk.offset + streams.clusters.offset;
    for (uint64_t i = 0; i < chunk.cluster_count; ++i) {
      const auto record = format::load<format::ClusterRecord>(records + i * sizeof(format::ClusterRecord));
      const format::ClusterLayout layout = format::cluster_layout(record);
      words += layout.positions - layout.steps;
      clusters.predicted += layout.predicted_axis != format::kNotPredicted;
    }
    return 4 * words;
  }

  const format::Container& file_;
  const bool reads_pages_;
  std::vector<std::byte> scratch_;
  std::span<const std::byte> raw_;
  uint32_t page_ = format::kNone;
};

/// Divides the stored bytes of a page among pieces in proportion to their raw bytes. The pieces add up to the page.
class PageShares {
 public:
  void add_raw(uint64_t bytes) { raw_ += bytes; }
  uint64_t raw() const { return raw_; }

  /// Called when all raw bytes are known. `page_raw`: the page's raw bytes, which exceed raw() if it has gaps.
  void start(uint64_t stored, uint64_t page_raw) {
    stored_ = stored;
    total_ = std::max(raw_, page_raw);
    raw_ = 0;
  }
  uint64_t take(uint64_t raw) {
    const uint64_t before = given(raw_);
    raw_ += raw;
    return given(raw_) - before;
  }
  uint64_t left_raw() const { return total_ - raw_; }

 private:
  uint64_t given(uint64_t raw) const {
    if (total_ == 0) return 0;
    __extension__ using Wide = unsigned __int128;
    return static_cast<uint64_t>(Wide{stored_} * raw / total_);
  }

  uint64_t stored_ = 0;
  uint64_t total_ = 0;
  uint64_t raw_ = 0;
};

Spread spread_of(std::vector<uint64_t>& values) {
  if (values.empty()) return {};
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  return {*least, *middle, *most};
}

/// The indices of the `top` largest of `values`, largest first; equal ones by index.
std::vector<uint32_t> largest(const std::vector<uint64_t>& values, uint32_t top) {
  std::vector<uint32_t> order(values.size());
  std::iota(order.begin(), order.end(), 0u);
  const size_t count = std::min<size_t>(top, order.size());
  std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count), order.end(),
                    [&](uint32_t a, uint32_t b) { return values[a] != values[b] ? values[a] > values[b] : a < b; });
  order.resize(count);
  return order;
}

void count_container(const format::Container& file, std::span<const std::byte> bytes, Stats& stats) {
  const format::FileHeader& header = file.header();
  stats.header_bytes = header.header_bytes;
  stats.toc_bytes = uint64_t{header.toc_count} * sizeof(format::TocEntry);
  for (uint32_t i = 0; i < header.toc_count; ++i) {
    const auto entry = format::load<format::TocEntry>(bytes.data() + header.toc_offset + i * sizeof(format::TocEntry));
    const uint64_t table_bytes = entry.record_count * entry.record_bytes;
    stats.tables.push_back({entry.kind, table_name(entry.kind), entry.record_count, entry.record_bytes, table_bytes});
    stats.tables_bytes += table_bytes;
  }
}

/// Counts the bytes of every stream, per mesh and in total.
void count_geometry(const format::Container& file, std::vector<PageShares>& pages, std::vector<uint64_t>& mesh_bytes,
                    std::map<std::pair<bool, int32_t>, LatticeStats>& lattices, Stats& stats) {
  const auto meshes = file.meshes();
  const auto chunks = file.chunks();
  std::vector<uint64_t> triangles, vertices, payloads;
  triangles.reserve(chunks.size());
  vertices.reserve(chunks.size());
  payloads.reserve(chunks.size());
  StreamBytes stream_bytes(file, stats.has_split);
  for (uint64_t i = 0; i < chunks.size(); ++i) {
    const ChunkRecord& chunk = chunks[i];
    const MeshRecord& mesh = meshes[chunk.mesh];
    const auto raw = stream_bytes.of(i, stats.clusters);
    for (size_t stream = 0; stream < kStreamCount; ++stream) {
      const uint64_t stored = pages[chunk.page].take(raw[stream]);
      stats.streams[stream].raw += raw[stream];
      stats.streams[stream].stored += stored;
      mesh_bytes[chunk.mesh] += stored;
      if (stream == kPositions) {
        const bool is_float32 = mesh.position_encoding == format::PositionEncoding::kFloat32;
        lattices[{is_float32, is_float32 ? 0 : mesh.lattice_exponent}].stored += stored;
      }
    }
    triangles.push_back(chunk.triangle_count);
    vertices.push_back(chunk.vertex_count);
    payloads.push_back(chunk.bytes);
    if (chunk.encoding == format::ChunkEncoding::kIndexed) {
      IndexBits& bits = stats.index_bits[std::min<size_t>(chunk.index_bits, 32)];
      ++bits.chunks;
      bits.triangles += chunk.triangle_count;
    }
    if ((mesh.attributes & format::kHasNormal) &&
        (stats.min_normal_bits == 0 || chunk.normal_bits < stats.min_normal_bits)) {
      stats.min_normal_bits = chunk.normal_bits;
    }
    if ((mesh.attributes & format::kHasTangent) &&
        (stats.min_tangent_bits == 0 || chunk.tangent_bits < stats.min_tangent_bits)) {
      stats.min_tangent_bits = chunk.tangent_bits;
    }
  }
  stats.chunk_triangles = spread_of(triangles);
  stats.chunk_vertices = spread_of(vertices);
  stats.chunk_bytes = spread_of(payloads);
}

void count_meshes(const format::Container& file, std::map<std::pair<bool, int32_t>, LatticeStats>& lattices,
                  Stats& stats) {
  const auto meshes = file.meshes();
  std::vector<uint64_t> triangles;
  triangles.reserve(meshes.size());
  for (uint64_t i = 0; i < meshes.size(); ++i) {
    const MeshRecord& mesh = meshes[i];
    const uint64_t reference = std::min(mesh.vertex_count, mesh.source_vertex_count);
    triangles.push_back(mesh.triangle_count);
    stats.triangles += mesh.triangle_count;
    stats.vertices += mesh.vertex_count;
    stats.source_vertices += mesh.source_vertex_count;
    stats.max_position_error = std::max(stats.max_position_error, mesh.max_position_error);

    const auto add = [&](Stream stream, uint64_t elements, uint64_t reference_bytes) {
      ++stats.stream_meshes[stream];
      stats.stream_elements[stream] += elements;
      stats.reference_bytes[stream] += reference_bytes;
    };
    uint64_t clustered = 0;       // triangles
    uint64_t chunk_vertices = 0;  // of all chunks
    uint64_t clustered_vertices = 0;
    for (uint64_t chunk = mesh.first_chunk; chunk < mesh.first_chunk + mesh.chunk_count; ++chunk) {
      const ChunkRecord& record = file.chunks()[chunk];
      chunk_vertices += record.vertex_count;
      if (record.encoding != format::ChunkEncoding::kClustered) continue;
      clustered += record.triangle_count;
      clustered_vertices += record.vertex_count;
    }
    // kClusterData is compared with the float32 size of its triangles and of the same share of vertices.
    const uint64_t unsplit = stats.has_split ? 0 : clustered;
    const double vertex_share = unsplit == 0 || chunk_vertices == 0
                                    ? 0
                                    : static_cast<double>(clustered_vertices) / static_cast<double>(chunk_vertices);
    const auto of_clusters = [&](uint64_t count) {
      return std::min(count, static_cast<uint64_t>(std::llround(vertex_share * static_cast<double>(count))));
    };
    const uint64_t triangles_left = mesh.triangle_count - unsplit;
    if (stats.has_split || triangles_left != 0) add(kIndices, 3 * triangles_left, 12 * triangles_left);
    if (clustered != 0) {
      add(kClusterBounds, clustered, 0);
      add(kClusterRecords, clustered, 0);
    }
    if (stats.has_split || triangles_left != 0)
      add(kPositions, mesh.vertex_count - of_clusters(mesh.vertex_count), 12 * (reference - of_clusters(reference)));
    if (unsplit != 0) add(kClusterData, unsplit, 12 * unsplit + 12 * of_clusters(reference));
    if (mesh.attributes & format::kHasUv) {
      add(kUvs, mesh.vertex_count, 8 * reference);
      stats.max_uv_error = std::max(stats.max_uv_error, static_cast<double>(mesh.max_uv_error));
    }
    if (mesh.attributes & format::kHasColor) add(kColors, mesh.vertex_count, 16 * reference);
    if (mesh.attributes & format::kHasNormal) add(kNormals, mesh.vertex_count, 12 * reference);
    if (mesh.attributes & format::kHasSecondUv) add(kSecondUvs, mesh.vertex_count, 8 * reference);
    if (mesh.attributes & format::kHasTangent) add(kTangents, mesh.vertex_count, 16 * reference);
    if (mesh.attributes & format::kHasSourceIds) add(kSourceIds, mesh.triangle_count, 0);

    const bool is_float32 = mesh.position_encoding == format::PositionEncoding::kFloat32;
    LatticeStats& lattice = lattices[{is_float32, is_float32 ? 0 : mesh.lattice_exponent}];
    lattice.is_float32 = is_float32;
    lattice.exponent = is_float32 ? 0 : mesh.lattice_exponent;
    ++lattice.meshes;
    lattice.triangles += mesh.triangle_count;
    lattice.vertices += mesh.vertex_count;
    lattice.max_error = std::max(lattice.max_error, mesh.max_position_error);
  }
  stats.mesh_triangles = spread_of(triangles);
}

void count_images(const format::Container& file, uint32_t top, Stats& stats) {
  const auto pages = file.pages();
  const auto images = file.images();
  const auto masks = file.masks();
  std::vector<bool> seen(pages.size());
  std::vector<uint64_t> bytes_of(images.size());
  // Images may share a page, whose bytes count once.
  const auto count_pages = [&](const format::ImageRecord& image, uint32_t level, uint32_t first) {
    for (uint32_t page = first; page < first + format::level_page_count(image, level); ++page) {
      if (seen[page]) continue;
      seen[page] = true;
      for (Cost* sum : {&stats.images, &stats.image_kinds[static_cast<size_t>(image.codec)].cost}) {
        sum->stored += pages[page].stored_bytes;
        sum->raw += pages[page].raw_bytes;
      }
    }
  };
  for (uint32_t i = 0; i < images.size(); ++i) {
    const size_t codec = static_cast<size_t>(images[i].codec);
    bytes_of[i] = image_bytes(file, i);
    if (codec < stats.image_kinds.size()) {
      ++stats.image_kinds[codec].images;
      stats.image_kinds[codec].pixels += uint64_t{images[i].width} * images[i].height;
    }
    count_pages(images[i], 0, images[i].page);
  }
  const auto levels = file.mip_levels();
  for (uint64_t i = 0; i < levels.size(); ++i) {
    stats.level_bytes += levels[i].bytes;
    const format::ImageRecord& image = images[levels[i].image];
    count_pages(image, static_cast<uint32_t>(i - image.first_level) + 1, levels[i].page);
  }
  stats.mip_levels = levels.size();
  for (uint64_t i = 0; i < masks.size(); ++i) {
    const uint32_t number = masks[i].page;
    if (seen[number]) continue;
    seen[number] = true;
    for (Cost* sum : {&stats.images, &stats.mask_pages}) {
      sum->stored += pages[number].stored_bytes;
      sum->raw += pages[number].raw_bytes;
    }
  }
  for (uint64_t i = 0; i < file.materials().size(); ++i) {
    const uint32_t flags = file.materials()[i].flags;
    stats.blended += (flags & format::kMaterialAlphaBlend) != 0 ? 1 : 0;
    stats.opaque_masks += (flags & format::kMaterialCutOut) == format::kMaterialAlphaMask ? 1 : 0;
  }
  stats.masks = masks.size();
  for (uint64_t i = 0; i < masks.size(); ++i)
    if ((file.materials()[masks[i].material].flags & format::kMaterialCutOut) == format::kMaterialAlphaMask &&
        stats.opaque_masks != 0)
      --stats.opaque_masks;
  for (uint64_t i = 0; i < pages.size(); ++i) {
    if (pages[i].kind != PageKind::kGeometry && !seen[i]) stats.other_pages += pages[i].stored_bytes;
  }
  stats.top_images = largest(bytes_of, top);
}

std::vector<SceneExtent> scene_extents(const format::Container& file) {
  std::vector<SceneExtent> extents;
  for (uint64_t s = 0; s < file.scenes().size(); ++s) {
    const format::SceneRecord& scene = file.scenes()[s];
    SceneExtent& extent = extents.emplace_back();
    for (uint64_t i = scene.first_instance; i < scene.first_instance + scene.instance_count; ++i) {
      const format::InstanceRecord& instance = file.instances()[i];
      const format::MeshRecord& mesh = file.meshes()[instance.mesh];
      if (mesh.triangle_count == 0) continue;
      const format::MatrixRecord& matrix = file.matrices()[instance.matrix];
      for (const runtime::Vec3& corner : runtime::box_corners(mesh, matrix)) extent.box.add(corner);
      for (const auto& row : matrix.rows) {
        const double scale = std::abs(row[0]) + std::abs(row[1]) + std::abs(row[2]);
        extent.max_position_error = std::max(extent.max_position_error, scale * mesh.max_position_error);
      }
    }
  }
  return extents;
}

}  // namespace

uint64_t image_bytes(const format::Container& file, uint32_t image) {
  const format::ImageRecord& record = file.images()[image];
  const auto own_pages = [&](uint32_t level, uint32_t first) {
    uint64_t sum = 0;
    for (uint32_t page = first; page < first + format::level_page_count(record, level); ++page)
      sum += file.pages()[page].stored_bytes;
    return sum;
  };
  uint64_t bytes = own_pages(0, record.page);
  for (uint32_t i = 0; i < record.level_count; ++i) {
    const format::MipLevelRecord& level = file.mip_levels()[record.first_level + i];
    if (format::level_page_count(record, i + 1) > 1) {
      bytes += own_pages(i + 1, level.page);
      continue;
    }
    const format::PageRecord& page = file.pages()[level.page];
    if (page.raw_bytes == 0) continue;
    bytes += static_cast<uint64_t>(static_cast<double>(page.stored_bytes) / static_cast<double>(page.raw_bytes) *
                                   static_cast<double>(level.bytes));
  }
  return bytes;
}

const char* stream_key(Stream stream) {
  static constexpr const char* kKeys[kStreamCount] = {"indices",    "positions", "cluster_bounds", "cluster_records",
                                                      "uvs",        "colors",    "normals",        "source_ids",
                                                      "second_uvs", "tangents",  "cluster_data"};
  return kKeys[stream];
}

const char* stream_title(Stream stream) {
  static constexpr const char* kTitles[kStreamCount] = {"indices",
                                                        "positions",
                                                        "cluster bounds",
                                                        "cluster records",
                                                        "texture coordinates",
                                                        "vertex colours",
                                                        "normals",
                                                        "source numbers",
                                                        "second texture coordinates",
                                                        "tangents",
                                                        "cluster indices, positions"};
  return kTitles[stream];
}

uint64_t Stats::geometry_bytes() const {
  uint64_t sum = 0;
  for (const Cost& cost : streams) sum += cost.stored;
  return sum;
}

uint64_t Stats::attribute_bytes() const {
  uint64_t sum = 0;
  for (const Stream attribute : kAttributes) sum += streams[attribute].stored;
  return sum;
}

uint64_t Stats::container_bytes() const {
  return header_bytes + toc_bytes + tables_bytes + page_gaps.stored + other_pages + padding_bytes;
}

Stats gather(const format::Container& file, std::span<const std::byte> bytes, uint32_t top, bool reads_pages) {
  Stats stats{.file_bytes = bytes.size(), .has_split = reads_pages};
  count_container(file, bytes, stats);

  const auto pages = file.pages();
  const auto chunks = file.chunks();
  std::vector<PageShares> shares(pages.size());
  // Raw bytes of a chunk equal the sum of its streams, as open() has checked.
  for (uint64_t i = 0; i < chunks.size(); ++i) shares[chunks[i].page].add_raw(chunks[i].bytes);
  uint64_t page_bytes = 0;
  for (uint64_t i = 0; i < pages.size(); ++i) {
    page_bytes += pages[i].stored_bytes;
    ++stats.pages;
    stats.geometry_pages += pages[i].kind == PageKind::kGeometry;
    stats.compressed_pages += pages[i].codec != format::PageCodec::kRaw;
    if (pages[i].kind == PageKind::kGeometry) shares[i].start(pages[i].stored_bytes, pages[i].raw_bytes);
  }

  std::map<std::pair<bool, int32_t>, LatticeStats> lattices;
  std::vector<uint64_t> mesh_bytes(file.meshes().size());
  count_meshes(file, lattices, stats);
  count_geometry(file, shares, mesh_bytes, lattices, stats);
  for (uint64_t i = 0; i < pages.size(); ++i) {
    if (pages[i].kind != PageKind::kGeometry) continue;
    const uint64_t gap = shares[i].left_raw();
    stats.page_gaps.raw += gap;
    stats.page_gaps.stored += shares[i].take(gap);
  }
  for (const uint32_t mesh : largest(mesh_bytes, top)) stats.top_meshes.push_back({mesh, mesh_bytes[mesh]});
  for (auto entry = lattices.rbegin(); entry != lattices.rend(); ++entry) stats.lattices.push_back(entry->second);
  count_images(file, top, stats);
  stats.extents = scene_extents(file);

  stats.padding_bytes = stats.file_bytes - stats.header_bytes - stats.toc_bytes - stats.tables_bytes - page_bytes;
  return stats;
}

std::string mesh_name(const format::Container& file, uint32_t mesh) {
  const format::GroupRecord& group = file.groups()[file.meshes()[mesh].group];
  const std::string_view name = file.string(group.name);
  if (name.empty()) return "mesh " + std::to_string(mesh);
  std::string text(name);
  if (group.mesh_count > 1) text += " #" + std::to_string(mesh - group.first_mesh);
  return text;
}

}  // namespace scree::inspect
