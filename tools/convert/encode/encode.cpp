#include "tools/convert/encode/encode.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "format/geometry/attribute_codec.h"
#include "format/geometry/index_codec.h"
#include "format/geometry/tangent_codec.h"
#include "tools/convert/encode/chunk_limit.h"

namespace scree::convert {
namespace {

using format::kNone;

constexpr format::PositionRange kFloatRange{{}, {32, 32, 32}};

/// Appends `bytes` zero bytes to the payload and returns them.
std::span<std::byte> extend(std::vector<std::byte>& payload, uint64_t bytes) {
  const size_t before = payload.size();
  payload.resize(before + bytes);
  return std::span<std::byte>(payload).subspan(before);
}

/// Encodes a window whose triangles are loaded, stream by stream, so that only one attribute is in memory at a time.
class WindowEncoder {
 public:
  WindowEncoder(const Primitive& primitive, const MeshPlan& mesh, const WindowPlan& plan, const EncodeOptions& options,
                EncodeScratch& scratch)
      : primitive_(primitive), mesh_(mesh), plan_(plan), options_(options), s_(scratch) {}

  Result<EncodedWindow> run() {
    order();
    quantise();
    SCREE_TRY(read_uvs());
    if (mesh_.clustered && !mesh_.chunks_as_float32) {
      cut_clusters();
    } else {
      cut();
    }
    encode_uvs();
    SCREE_TRY(encode_colors());
    SCREE_TRY(encode_normals());
    encode_source_ids();
    encode_second_uvs();
    SCREE_TRY(encode_tangents());
    return std::move(out_);
  }

 private:
  /// The part of chunk_order_ that belongs to chunk `i`.
  std::span<const uint32_t> chunk_vertices(size_t i) const {
    return chunk_order_.subspan(first_vertex_[i], out_.chunks[i].record.vertex_count);
  }

  /// Whether the triangles keep the source's order until they are cut into chunks.
  bool keeps_order() const {
    const bool has_own_order = mesh_.clustered && options_.clusters == tools::ClusterEffort::kBest;
    return options_.order == Order::kNone || (has_own_order && !mesh_.chunks_as_float32);
  }

  void order() {
    if (keeps_order()) return;
    // Window has checked that there are 3 corners per triangle, each below the number of vertices.
    const auto vertices = static_cast<uint32_t>(s_.window.vertices().size());
    // The optimiser visits neighbouring vertices one after another. If they are numbered by first use, they lie close
    // together in its tables.
    if (s_.window.is_scattered()) number_by_first_use(vertices);
    order_ = s_.fifo.run(s_.window.is_scattered() ? s_.by_use : s_.window.indices(), vertices);
  }

  void number_by_first_use(uint32_t vertices) {
    const std::span<const uint32_t> indices = s_.window.indices();
    uint32_t used = 0;
    s_.use_of.assign(vertices, kNone);
    s_.by_use.resize(indices.size());
    for (size_t i = 0; i < indices.size(); ++i) {
      uint32_t& use = s_.use_of[indices[i]];
      if (use == kNone) use = used++;
      s_.by_use[i] = use;
    }
  }

  /// The triangle of the window at an index of the cutting order.
  uint64_t triangle_at(uint64_t place) const { return order_.empty() ? place : order_[place]; }

  void quantise() {
    if (mesh_.float32) return;
    const std::span<const float> positions = s_.window.positions();
    s_.coordinates.resize(positions.size());
    out_.position_error = format::quantize_positions(s_.coordinates, positions, mesh_.lattice);
  }

  /// Cuts the ordered triangles into chunks, numbers the vertices of each chunk, and encodes indices and positions.
  void cut() {
    const std::span<const uint32_t> indices = s_.window.indices();
    const uint64_t triangles = s_.window.triangle_count();
    const ChunkLimit limit(mesh_, plan_, options_.chunk_triangles);
    s_.slots.assign(s_.window.vertices().size(), kNone);
    s_.chunk_order.clear();
    s_.clustered_triangles.clear();
    if (mesh_.clustered && (mesh_.attributes & format::kHasSourceIds)) s_.clustered_triangles.resize(triangles);
    clustered_triangles_ = s_.clustered_triangles;
    for (uint64_t first = 0; first < triangles;) {
      const size_t first_vertex = s_.chunk_order.size();
      s_.chunk_indices.clear();
      uint32_t vertices = 0;
      uint64_t end = first;
      for (; end < triangles; ++end) {
        const uint32_t* corner = &indices[3 * triangle_at(end)];
        const uint32_t before = vertices;
        uint32_t local[3];
        for (size_t i = 0; i < 3; ++i) {
          uint32_t& slot = s_.slots[corner[i]];
          if (slot == kNone) {
            slot = vertices++;
            s_.chunk_order.push_back(corner[i]);
          }
          local[i] = slot;
        }
        if (end > first && !limit.fits(end + 1 - first, vertices)) {
          for (; vertices > before; --vertices) {
            s_.slots[s_.chunk_order.back()] = kNone;
            s_.chunk_order.pop_back();
          }
          break;
        }
        s_.chunk_indices.insert(s_.chunk_indices.end(), local, local + 3);
      }
      const std::span<uint32_t> used = std::span<uint32_t>(s_.chunk_order).subspan(first_vertex);
      if (options_.order == Order::kNone) {
        std::sort(used.begin(), used.end());
        for (uint32_t i = 0; i < vertices; ++i) s_.slots[used[i]] = i;
        for (size_t i = 0; i < s_.chunk_indices.size(); ++i) s_.chunk_indices[i] = s_.slots[indices[3 * first + i]];
      }
      for (const uint32_t vertex : used) s_.slots[vertex] = kNone;

      add_chunk(first, end - first, first_vertex);
      first = end;
    }
    chunk_order_ = s_.chunk_order;
  }

  /// Adds the chunk of the triangles in chunk_indices, whose vertices are the last ones of chunk_order.
  void add_chunk(uint64_t first_triangle, uint64_t triangles, size_t first_vertex) {
    const std::span<const uint32_t> used = std::span<const uint32_t>(s_.chunk_order).subspan(first_vertex);
    EncodedChunk chunk;
    chunk.record.triangle_count = static_cast<uint32_t>(triangles);
    chunk.record.vertex_count = static_cast<uint32_t>(used.size());
    first_vertex_.push_back(first_vertex);
    first_triangle_.push_back(first_triangle);
    // Every vertex of a chunk is used and numbered from 0, so the range is known. 0 bits are not allowed past
    // kMaxChunkTriangles (spec/container.md, chunks), because a few bytes could then state gigabytes.
    const uint32_t least_bits = triangles > format::kMaxChunkTriangles ? 1 : 0;
    const format::IndexRange indices{0, std::max(least_bits, static_cast<uint32_t>(std::bit_width(used.size() - 1)))};
    const uint64_t index_bytes = format::packed_bytes(s_.chunk_indices.size(), indices.bits);
    const uint64_t float_bytes = index_bytes + format::position_stream_bytes(used.size(), kFloatRange);
    if (mesh_.float32) {
      pick(used, s_.window.positions(), 3, s_.chunk_floats);
    } else {
      pick(used, std::span<const uint32_t>(s_.coordinates), 3, s_.chunk_coordinates);
    }
    if (mesh_.clustered && add_clusters(float_bytes, chunk)) return;

    const format::PositionRange positions = mesh_.float32 ? kFloatRange : format::position_range(s_.chunk_coordinates);
    const uint64_t position_bytes = format::position_stream_bytes(used.size(), positions);
    // Floats never take fewer bytes than codes. The codes of v vertices take at most 9 v bytes plus 8 of slack, floats
    // 12 v; both are rounded up to 16. From 3 vertices on floats take more, 2 vertices take 32 bytes in either form,
    // and the code of a single vertex has 0 bits.
    static_assert(9 * 3 + format::kPackedSlackBytes <= 12 * 3 && 3 * format::kMaxPositionBits == 8 * 9);
    static_assert(format::packed_bytes(2, 3 * format::kMaxPositionBits) <= 32);
    if (mesh_.chunks_as_float32) chunk.saved = static_cast<int64_t>(float_bytes - index_bytes - position_bytes);
    chunk.payload.reserve(index_bytes + position_bytes + attribute_bytes_bound(used.size()));
    chunk.record.index_min = indices.min;
    chunk.record.index_bits = static_cast<uint8_t>(indices.bits);
    format::encode_indices(extend(chunk.payload, index_bytes), s_.chunk_indices, indices);
    const std::span<std::byte> stream = extend(chunk.payload, position_bytes);
    if (mesh_.float32) {
      format::encode_positions_float32(stream, s_.chunk_floats);
    } else {
      format::encode_positions(stream, s_.chunk_coordinates, positions);
    }
    std::copy(positions.min.begin(), positions.min.end(), chunk.record.position_min);
    std::copy(positions.bits.begin(), positions.bits.end(), chunk.record.position_bits);
    out_.chunks.push_back(std::move(chunk));
  }

  /// Adds `chunk`, with the triangles and vertices of add_chunk(), as clusters. Returns false and adds nothing if
  /// clusters take more bytes than floats and a list of indices (`float_bytes`). The comparison includes attributes,
  /// since clusters store the vertices on a common border twice.
  bool add_clusters(uint64_t float_bytes, EncodedChunk& chunk) {
    const format::ClusterSet& set =
        s_.clusters.build(s_.chunk_indices, s_.chunk_coordinates, options_.clusters, most_of_cluster());
    if (set.words.size() > format::kMaxClusterWords || set.vertices.size() >= kNone) return false;
    const std::span<const uint32_t> used = std::span<const uint32_t>(s_.chunk_order).subspan(first_vertex_.back());
    uint32_t uv_bits[2] = {0, 0};  // repeated vertices do not change the range
    const std::pair<uint32_t, const std::vector<float>*> sets[] = {{format::kHasUv, &s_.floats},
                                                                   {format::kHasSecondUv, &s_.second_uvs}};
    for (size_t i = 0; i < 2; ++i) {
      if (!(mesh_.attributes & sets[i].first)) continue;
      pick(used, std::span<const float>(*sets[i].second), 2, s_.chunk_floats);
      uv_bits[i] = format::choose_uv_range(s_.chunk_floats).stride_bits();
    }
    const uint64_t bytes = format::cluster_stream_bytes(set.clusters.size(), set.words.size());
    const uint64_t all_bytes = bytes + attribute_bytes(set.vertices.size(), uv_bits);
    const uint64_t all_float_bytes = float_bytes + attribute_bytes(chunk.record.vertex_count, uv_bits);
    if (all_bytes > all_float_bytes) return false;
    chunk.saved = static_cast<int64_t>(all_float_bytes - all_bytes);
    const format::ClusterRun run{0, set.clusters.size(), 0};
    format::describe_clusters(set, run, chunk.record);
    chunk.payload.reserve(bytes + attribute_bytes_bound(set.vertices.size()));
    format::write_clusters(extend(chunk.payload, bytes), set, run, chunk.record);
    out_.chunks.push_back(std::move(chunk));

    s_.cluster_vertices.resize(set.vertices.size());
    for (size_t i = 0; i < set.vertices.size(); ++i) s_.cluster_vertices[i] = used[set.vertices[i]];
    s_.chunk_order.resize(first_vertex_.back());
    s_.chunk_order.insert(s_.chunk_order.end(), s_.cluster_vertices.begin(), s_.cluster_vertices.end());
    const uint64_t first_triangle = first_triangle_.back();
    for (size_t i = 0; i < set.triangles.size() && !s_.clustered_triangles.empty(); ++i)
      s_.clustered_triangles[first_triangle + i] =
          static_cast<uint32_t>(triangle_at(first_triangle + set.triangles[i]));
    return true;
  }

  uint32_t most_of_cluster() const {
    return options_.chunk_triangles == 0 ? kNone
                                         : static_cast<uint32_t>(std::min<uint64_t>(options_.chunk_triangles, kNone));
  }

  /// Bytes of the attribute streams of `vertices` vertices.
  uint64_t attribute_bytes(uint64_t vertices, const uint32_t uv_bits[2]) const {
    uint64_t bytes = format::packed_bytes(vertices, uv_bits[0]) + format::packed_bytes(vertices, uv_bits[1]);
    if (mesh_.attributes & format::kHasColor) bytes += format::color_stream_bytes(vertices);
    if (mesh_.attributes & format::kHasNormal) bytes += format::normal_stream_bytes(vertices, kNormalBits);
    if (mesh_.attributes & format::kHasTangent) bytes += format::tangent_stream_bytes(vertices, kTangentBits);
    return bytes;
  }

  /// Upper bound of attribute_bytes(), to reserve room.
  uint64_t attribute_bytes_bound(uint64_t vertices) const {
    return (vertices * attribute_bits_bound(mesh_) + 7) / 8 + 6 * (format::kPackedSlackBytes + 16) +
           sizeof(format::SecondUvHeader);
  }

  /// Cuts the triangles into clusters and groups these into chunks. Encodes everything except attributes and source
  /// numbers.
  void cut_clusters() {
    const format::ClusterSet& set =
        s_.clusters.build(s_.window.indices(), s_.coordinates, options_.clusters, most_of_cluster(), order_);
    chunk_order_ = set.vertices;
    clustered_triangles_ = set.triangles;
    const ChunkLimit limit(mesh_, plan_, options_.chunk_triangles);
    format::ClusterRun run;
    uint64_t first_triangle = 0;
    size_t first_vertex = 0;
    while (run.first_cluster < set.clusters.size()) {
      uint64_t triangles = 0, vertices = 0, words = 0;
      for (run.cluster_count = 0; run.first_cluster + run.cluster_count < set.clusters.size(); ++run.cluster_count) {
        const format::PackedCluster& next = set.clusters[run.first_cluster + run.cluster_count];
        const uint64_t more_triangles = triangles + next.triangle_count();
        const uint64_t more_vertices = vertices + next.vertex_count();
        if (run.cluster_count > 0 &&
            !limit.clusters_fit(more_triangles, more_vertices, run.cluster_count + 1, words + next.words))
          break;
        triangles = more_triangles;
        vertices = more_vertices;
        words += next.words;
      }
      EncodedChunk chunk;
      format::describe_clusters(set, run, chunk.record);
      const uint64_t bytes = format::cluster_stream_bytes(run.cluster_count, words);
      chunk.payload.reserve(bytes + attribute_bytes_bound(vertices));
      format::write_clusters(extend(chunk.payload, bytes), set, run, chunk.record);
      out_.chunks.push_back(std::move(chunk));
      first_vertex_.push_back(first_vertex);
      first_triangle_.push_back(first_triangle);
      run.first_cluster += run.cluster_count;
      run.first_word += words;
      first_triangle += triangles;
      first_vertex += vertices;
    }
  }

  /// Copies the `components` values of each vertex of a chunk from the window's values.
  template <class T>
  static void pick(std::span<const uint32_t> vertices, std::span<const T> values, size_t components,
                   std::vector<T>& out) {
    out.resize(vertices.size() * components);
    T* at = out.data();
    if (components == 3) {
      for (const uint32_t vertex : vertices) {
        const T* from = &values[3 * size_t{vertex}];
        at[0] = from[0];
        at[1] = from[1];
        at[2] = from[2];
        at += 3;
      }
      return;
    }
    for (const uint32_t vertex : vertices) at = std::copy_n(&values[components * size_t{vertex}], components, at);
  }

  /// Reads an attribute of the window's vertices into `out` and sets values that are not finite to 0. Returns the
  /// number of vertices with such values.
  Result<uint64_t> read_attribute(const Accessor& accessor, std::vector<float>& out) {
    SCREE_TRY(read_vertices(accessor, s_.window.vertices(), out));
    uint64_t repaired = 0;
    const size_t components = accessor.components;
    for (size_t i = 0; i < out.size(); i += components) {
      bool bad = false;
      for (size_t c = 0; c < components; ++c) {
        if (std::isfinite(out[i + c])) continue;
        out[i + c] = 0;
        bad = true;
      }
      repaired += bad ? 1 : 0;
    }
    return repaired;
  }

  /// Called before chunks are cut, since the size of texture coordinates affects the cuts.
  Result<void> read_uvs() {
    if (!(mesh_.attributes & format::kHasUv)) return {};
    out_.repaired_uvs = SCREE_TRY(read_attribute(*primitive_.uv, s_.floats));
    if (!(mesh_.attributes & format::kHasSecondUv)) return {};
    const uint64_t second = SCREE_TRY(read_attribute(*primitive_.second_uv(), s_.second_uvs));
    out_.repaired_uvs += second;
    return {};
  }

  void encode_uvs() {
    if (!(mesh_.attributes & format::kHasUv)) return;
    for (size_t i = 0; i < out_.chunks.size(); ++i) {
      EncodedChunk& chunk = out_.chunks[i];
      pick(chunk_vertices(i), std::span<const float>(s_.floats), 2, s_.chunk_floats);
      const format::UvRange range = format::choose_uv_range(s_.chunk_floats);
      format::encode_uvs(extend(chunk.payload, format::uv_stream_bytes(chunk.record.vertex_count, range)),
                         s_.chunk_floats, range);
      std::copy(range.min.begin(), range.min.end(), chunk.record.uv_min);
      std::copy(range.bits.begin(), range.bits.end(), chunk.record.uv_bits);
      chunk.record.uv_exponent = range.exponent;
      out_.uv_error = std::max(out_.uv_error, stated_uv_error(range));
    }
  }

  void encode_second_uvs() {
    if (!(mesh_.attributes & format::kHasSecondUv)) return;
    for (size_t i = 0; i < out_.chunks.size(); ++i) {
      EncodedChunk& chunk = out_.chunks[i];
      pick(chunk_vertices(i), std::span<const float>(s_.second_uvs), 2, s_.chunk_floats);
      const format::UvRange range = format::choose_uv_range(s_.chunk_floats);
      format::encode_second_uvs(extend(chunk.payload, format::second_uv_stream_bytes(chunk.record.vertex_count, range)),
                                s_.chunk_floats, range);
      std::copy(range.bits.begin(), range.bits.end(), chunk.record.second_uv_bits);
      out_.uv_error = std::max(out_.uv_error, stated_uv_error(range));
    }
  }

  /// Tangents are coded as angles around the decoded normals.
  Result<void> encode_tangents() {
    if (!(mesh_.attributes & format::kHasTangent)) return {};
    SCREE_TRY(read_vertices(*primitive_.tangent(), s_.window.vertices(), s_.floats));
    for (size_t i = 0; i < out_.chunks.size(); ++i) {
      EncodedChunk& chunk = out_.chunks[i];
      const uint64_t vertices = chunk.record.vertex_count;
      s_.chunk_normals.resize(3 * vertices);
      const auto normals = std::span<const std::byte>(chunk.payload)
                               .subspan(first_normal_[i], format::normal_stream_bytes(vertices, kNormalBits));
      SCREE_TRY(format::decode_normals(s_.chunk_normals, kNormalBits, normals));
      pick(chunk_vertices(i), std::span<const float>(s_.floats), 4, s_.chunk_floats);
      chunk.record.tangent_bits = kTangentBits;
      out_.repaired_tangents +=
          format::encode_tangents(extend(chunk.payload, format::tangent_stream_bytes(vertices, kTangentBits)),
                                  s_.chunk_floats, s_.chunk_normals, kTangentBits);
    }
    return {};
  }

  /// The codec's bound, rounded up to a float.
  static float stated_uv_error(const format::UvRange& range) {
    const double bound =
        std::min(format::uv_error_bound(range), static_cast<double>(std::numeric_limits<float>::max()));
    return std::nextafter(static_cast<float>(bound), std::numeric_limits<float>::max());
  }

  Result<void> encode_colors() {
    if (!(mesh_.attributes & format::kHasColor)) return {};
    out_.repaired_colors = SCREE_TRY(read_attribute(*primitive_.color, s_.floats));
    const size_t components = primitive_.color->components;
    for (size_t i = 0; i < out_.chunks.size(); ++i) {
      EncodedChunk& chunk = out_.chunks[i];
      const std::span<const uint32_t> vertices = chunk_vertices(i);
      s_.chunk_floats.resize(4 * vertices.size());
      for (size_t v = 0; v < vertices.size(); ++v) {
        const float* from = &s_.floats[components * size_t{vertices[v]}];
        for (size_t c = 0; c < 4; ++c) s_.chunk_floats[4 * v + c] = c < components ? from[c] : 1.0f;
      }
      format::encode_colors(extend(chunk.payload, format::color_stream_bytes(vertices.size())), s_.chunk_floats);
    }
    return {};
  }

  Result<void> encode_normals() {
    if (!(mesh_.attributes & format::kHasNormal)) return {};
    SCREE_TRY(read_vertices(*primitive_.normal, s_.window.vertices(), s_.floats));
    for (size_t i = 0; i + 2 < s_.floats.size(); i += 3) {
      float* n = &s_.floats[i];
      const bool finite = std::isfinite(n[0]) && std::isfinite(n[1]) && std::isfinite(n[2]);
      const float largest = std::max({std::fabs(n[0]), std::fabs(n[1]), std::fabs(n[2])});
      if (finite && largest > 0) {
        // The codec adds the three squares, which would overflow for the largest values and lose bits for the smallest.
        if (largest > 1e30f || largest < 1e-30f)
          for (size_t axis = 0; axis < 3; ++axis) n[axis] = static_cast<float>(double{n[axis]} / double{largest});
        continue;
      }
      n[0] = n[1] = 0;
      n[2] = 1;
      ++out_.repaired_normals;
    }
    for (size_t i = 0; i < out_.chunks.size(); ++i) {
      EncodedChunk& chunk = out_.chunks[i];
      pick(chunk_vertices(i), std::span<const float>(s_.floats), 3, s_.chunk_floats);
      chunk.record.normal_bits = kNormalBits;
      first_normal_.push_back(chunk.payload.size());
      format::encode_normals(extend(chunk.payload, format::normal_stream_bytes(chunk.record.vertex_count, kNormalBits)),
                             s_.chunk_floats, kNormalBits);
    }
    return {};
  }

  void encode_source_ids() {
    if (!(mesh_.attributes & format::kHasSourceIds)) return;
    for (size_t i = 0; i < out_.chunks.size(); ++i) {
      EncodedChunk& chunk = out_.chunks[i];
      s_.chunk_ids.resize(chunk.record.triangle_count);
      for (size_t t = 0; t < s_.chunk_ids.size(); ++t) {
        const uint64_t place = first_triangle_[i] + t;
        const bool clustered = chunk.record.encoding == format::ChunkEncoding::kClustered;
        s_.chunk_ids[t] = s_.window.source_id(clustered ? clustered_triangles_[place] : triangle_at(place));
      }
      const format::SourceIdRange range = format::source_id_range(s_.chunk_ids);
      chunk.record.source_min = range.min;
      chunk.record.source_bits = static_cast<uint8_t>(range.bits);
      format::encode_source_ids(extend(chunk.payload, format::packed_bytes(s_.chunk_ids.size(), range.bits)),
                                s_.chunk_ids, range);
    }
  }

  const Primitive& primitive_;
  const MeshPlan& mesh_;
  const WindowPlan& plan_;
  const EncodeOptions& options_;
  EncodeScratch& s_;
  EncodedWindow out_;
  std::span<const uint32_t> chunk_order_;          // window vertices of all chunks, chunk by chunk
  std::vector<size_t> first_vertex_;               // by chunk: its first index in chunk_order_
  std::vector<uint64_t> first_triangle_;           // by chunk: its first triangle in the window
  std::vector<size_t> first_normal_;               // by chunk with normals: the byte of the payload where they begin
  std::span<const uint32_t> order_;                // triangles of the window in cutting order; empty: unchanged
  std::span<const uint32_t> clustered_triangles_;  // triangles of the window by clusters
};

/// Merges vertices that are equal in everything that the mesh stores.
Result<Welded> weld(const Primitive& primitive, const MeshPlan& mesh, EncodeScratch& scratch) {
  Window& window = scratch.window;
  Welder& welder = scratch.welder;
  const bool are_signed = mesh.float32 || mesh.chunks_as_float32;
  welder.start(window.positions(), are_signed ? Welder::Zeros::kSigned : Welder::Zeros::kUnsigned);
  const auto of = [](const std::optional<Accessor>& accessor) { return accessor ? &*accessor : nullptr; };
  const std::pair<uint32_t, const Accessor*> attributes[] = {{format::kHasUv, of(primitive.uv)},
                                                             {format::kHasColor, of(primitive.color)},
                                                             {format::kHasNormal, of(primitive.normal)},
                                                             {format::kHasSecondUv, primitive.second_uv()},
                                                             {format::kHasTangent, primitive.tangent()}};
  std::vector<uint32_t>& numbers = scratch.chunk_indices;  // of the candidates in the source
  for (const auto& [flag, accessor] : attributes) {
    if (!(mesh.attributes & flag) || welder.duplicates() == 0) continue;
    numbers.clear();
    for (const uint32_t place : welder.find_candidates()) numbers.push_back(window.vertices()[place]);
    SCREE_TRY(read_vertices(*accessor, numbers, scratch.floats));
    welder.part(scratch.floats, accessor->components);
  }
  Welded welded;
  welded.vertices = welder.duplicates();
  if (welded.vertices == 0) return welded;
  window.merge(welder.firsts());
  welded.source_bytes = welded.vertices * primitive.positions.element_bytes();
  for (const auto& [flag, accessor] : attributes)
    if (mesh.attributes & flag) welded.source_bytes += welded.vertices * accessor->element_bytes();
  return welded;
}

/// Welded::cost_bits of `vertices` vertices, with the widths of the chunks.
uint64_t cost_bits(uint64_t vertices, const MeshPlan& mesh, const std::vector<EncodedChunk>& chunks) {
  if (vertices == 0 || chunks.empty()) return 0;
  if (mesh.clustered) return Welded::kUnknownCost;
  uint64_t bits = 0, count = 0;
  for (const EncodedChunk& chunk : chunks) {
    const format::ChunkRecord& r = chunk.record;
    const uint64_t color = mesh.attributes & format::kHasColor ? 32 : 0;
    const uint64_t vertex = uint64_t{r.position_bits[0]} + r.position_bits[1] + r.position_bits[2] + r.uv_bits[0] +
                            r.uv_bits[1] + 2 * uint64_t{r.normal_bits} + color + r.second_uv_bits[0] +
                            r.second_uv_bits[1] + r.tangent_bits;
    bits += r.vertex_count * vertex;
    count += r.vertex_count;
  }
  return static_cast<uint64_t>(static_cast<double>(bits) / static_cast<double>(count) * static_cast<double>(vertices));
}

}  // namespace

Result<EncodedWindow> encode_window(const Primitive& primitive, const MeshPlan& mesh, const WindowPlan& plan,
                                    WindowContent* content, const EncodeOptions& options, EncodeScratch& scratch) {
  Window& window = scratch.window;
  if (content != nullptr) {
    assert(content->is_renumbered());
    window.restore(std::move(*content));
  } else if (const Result<void> loaded =
                 window.load(primitive, plan.first, plan.count, options.drop_nonfinite, Window::Find::kTriangles);
             !loaded) {
    return loaded.error();
  }
  // If the file has changed between the passes, a coordinate may lie outside its lattice.
  if (window.triangle_count() != plan.kept || window.vertices().size() != plan.vertices ||
      !inside(box_of(window.positions()), mesh.box))
    return Error{ErrorCode::kFormat, "mesh " + std::to_string(primitive.mesh) + " primitive " +
                                         std::to_string(primitive.place) + " changed while it was converted"};
  Result<Welded> welded = Welded{};
  if (options.weld) welded = weld(primitive, mesh, scratch);
  if (!welded) return welded.error();
  EncodedWindow encoded = SCREE_TRY(WindowEncoder(primitive, mesh, plan, options, scratch).run());
  encoded.welded = *welded;
  encoded.welded.cost_bits = cost_bits(welded->vertices, mesh, encoded.chunks);
  for (EncodedChunk& chunk : encoded.chunks) chunk.record.bytes = chunk.payload.size();
  return encoded;
}

uint64_t encoded_bytes_estimate(const MeshPlan& mesh, const WindowPlan& plan) {
  const uint64_t index_bits = 3 * static_cast<uint64_t>(std::bit_width(uint64_t{plan.vertices}));
  const uint64_t id_bits = source_id_bits(mesh, plan);
  // A cluster's border vertices are stored once per cluster.
  if (mesh.clustered) return (plan.kept * (24 + id_bits) + plan.vertices * vertex_bits_bound(mesh) * 3 / 2) / 8 + 256;
  // A chunk's border vertices are stored once per chunk: a quarter more.
  return (plan.kept * (index_bits + id_bits) + plan.vertices * vertex_bits_bound(mesh) * 5 / 4) / 8 + 256;
}

}  // namespace scree::convert
