// Reads the vertices of a chunk and projects them. Source: spec/rasterization.md, vertices.
#pragma once

#include "format/geometry/chunk_layout.h"
#include "format/geometry/cluster_read.h"
#include "kernels/raster/transform.h"
#include "kernels/scene_view.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

// Both builds of cpu/passes.cpp share the symbols of format/'s inline functions. Flattening keeps them inlined here.
SCREE_HD [[gnu::flatten]] inline uint32_t unpack_bits(const void* stream, uint64_t bit_offset, uint32_t bits) {
  return format::unpack(stream, bit_offset, bits);
}
SCREE_HD [[gnu::flatten]] inline format::ChunkStreams streams_of(const format::MeshRecord& mesh,
                                                                 const format::ChunkRecord& chunk) {
  return format::chunk_streams(mesh, chunk);
}

SCREE_HD [[gnu::flatten]] inline format::ClusterReader cluster_reader(const format::ClusterRecord& record,
                                                                      const format::ClusterBounds& bounds,
                                                                      const std::byte* data) {
  return format::make_cluster_reader(record, bounds, data);
}
SCREE_HD [[gnu::flatten]] inline void cluster_triangle(const format::ClusterReader& cluster, uint32_t number,
                                                       uint32_t out[3]) {
  cluster.triangle(number, out);
}
SCREE_HD [[gnu::flatten]] inline uint32_t cluster_largest(const format::ClusterReader& cluster, uint32_t number) {
  return cluster.largest(number);
}
/// The triangle's step and its two distances.
SCREE_HD [[gnu::flatten]] inline uint32_t cluster_step(const format::ClusterReader& cluster, uint32_t number,
                                                       uint32_t distances[2]) {
  cluster.distances(number, distances);
  return cluster.step(number);
}
SCREE_HD [[gnu::flatten]] inline void predict_code(const format::ClusterPredictor& predictor, uint32_t code[3]) {
  predictor.apply(code);
}

/// Flags of a projected vertex. The outside flags are tests against the view's planes; they also hold for vertices
/// behind the eye. A triangle whose three vertices share one of them is outside the picture. kNeedsClip: snapping is
/// not enough.
enum VertexFlags : uint32_t {
  kOutsideLeft = 1,
  kOutsideRight = 2,
  kOutsideTop = 4,
  kOutsideBottom = 8,
  kOutsideNear = 16,
  kOutsideFar = 32,  // orthographic only
  kOutsideMask = 63,
  kNeedsClip =
      64,  // before the near plane, behind the far one, outside the guard band or not finite; x and y are not valid
};

/// A projected vertex: sub-pixels from the image's top left corner, 1/w (perspective) or t (orthographic), VertexFlags.
struct alignas(16) ScreenVertex {
  int32_t x;
  int32_t y;
  float depth;
  uint32_t flags;
};

/// A vertex before snapping: homogeneous in sub-pixels from the image's centre, the same after the division, and
/// whether it can be drawn unclipped (`in_range`). If not, depth and screen are not valid.
struct ProjectedPoint {
  float x;
  float y;
  float w;
  float depth;
  float screen_x;
  float screen_y;
  bool in_range;
};

/// `rows`: x, y and w of a Transform, over (d, 1).
template <bool kOrthographic>
SCREE_HD inline ProjectedPoint project_point(const float row_x[4], const float row_y[4], const float row_w[4], float dx,
                                             float dy, float dz) {
  ProjectedPoint out;
  out.x = fused(row_x[0], dx, fused(row_x[1], dy, fused(row_x[2], dz, row_x[3])));
  out.y = fused(row_y[0], dx, fused(row_y[1], dy, fused(row_y[2], dz, row_y[3])));
  out.w = fused(row_w[0], dx, fused(row_w[1], dy, fused(row_w[2], dz, row_w[3])));
  if constexpr (kOrthographic) {
    // Comparisons are written so that NaN is out of range.
    out.in_range = (out.w <= 1.0f) & (out.w >= 0.0f);
    out.depth = out.w;
    out.screen_x = out.x;
    out.screen_y = out.y;
  } else {
    out.in_range = out.w >= 1.0f;
    out.depth = 1.0f / (out.in_range ? out.w : 1.0f);
    out.screen_x = out.x * out.depth;
    out.screen_y = out.y * out.depth;
  }
  out.in_range = out.in_range & (abs_of(out.screen_x) <= kGuardBand) & (abs_of(out.screen_y) <= kGuardBand);
  return out;
}

/// Snaps to sub-pixels. Out of range the conversion would be undefined (x86 and CUDA differ), so such vertices get 0.
SCREE_HD inline ScreenVertex snap_point(const ProjectedPoint& point, const FrameView& view, uint32_t flags) {
  const int32_t x = to_int_even(point.in_range ? point.screen_x : 0.0f);
  const int32_t y = to_int_even(point.in_range ? point.screen_y : 0.0f);
  return {x + view.width * (kSubpixels / 2), y + view.height * (kSubpixels / 2), point.depth,
          flags | (point.in_range ? 0u : uint32_t{kNeedsClip})};
}

/// The planes of the view that a vertex surely lies outside of: by more than the error of its coordinates. NaN is
/// outside none.
template <bool kOrthographic>
SCREE_HD inline uint32_t plane_flags(const ProjectedPoint& point, const FrameView& view, float error_x, float error_y,
                                     float error_w) {
  uint32_t flags = 0;
  float scale;
  float slack_x;
  float slack_y;
  if constexpr (kOrthographic) {
    flags |= point.w > 1.0f + error_w ? kOutsideNear : 0u;
    flags |= point.w < 0.0f - error_w ? kOutsideFar : 0u;
    scale = 1.0f;
    slack_x = error_x;
    slack_y = error_y;
  } else {
    flags |= point.w < 1.0f - error_w ? kOutsideNear : 0u;
    scale = point.w;
    slack_x = fused(view.half_width, error_w, error_x);
    slack_y = fused(view.half_height, error_w, error_y);
  }
  flags |= point.x < -view.half_width * scale - slack_x ? kOutsideLeft : 0u;
  flags |= point.x > view.half_width * scale + slack_x ? kOutsideRight : 0u;
  flags |= point.y < -view.half_height * scale - slack_y ? kOutsideTop : 0u;
  flags |= point.y > view.half_height * scale + slack_y ? kOutsideBottom : 0u;
  return flags;
}

/// Projects d, a position relative to the transform's reference or center. Has no branches, so the CPU runs it on
/// vectors.
template <bool kOrthographic>
SCREE_HD inline ScreenVertex project(const Transform& transform, const FrameView& view, float dx, float dy, float dz) {
  const ProjectedPoint point = project_point<kOrthographic>(transform.x, transform.y, transform.w, dx, dy, dz);
  return snap_point(point, view,
                    plane_flags<kOrthographic>(point, view, transform.error_x, transform.error_y, transform.error_w));
}

/// Reads a chunk's vertices and indices. In a clustered chunk it reads those of one cluster, by their numbers in the
/// chunk. All its values follow from validated records.
struct ChunkReader {
  const std::byte* indices;    // of an indexed chunk
  const std::byte* positions;  // from first_vertex on
  uint32_t index_min;
  uint32_t index_bits;
  uint32_t bits[3];
  uint32_t stride;  // bits per vertex
  int64_t base[3];  // lattice coordinate of code 0 minus the transform's reference
  float center[3];  // float32 positions
  bool float32;
  bool narrow;  // base + code fits int32 on every axis
  bool clustered;
  uint32_t first_vertex;          // 0 in an indexed chunk
  uint32_t end_triangle;          // end of the triangles that it reads
  format::ClusterReader cluster;  // if the chunk is clustered

  /// The three vertex numbers of a triangle of the chunk.
  SCREE_HD void triangle(uint32_t number, uint32_t out[3]) const {
    if (clustered) {
      cluster_triangle(cluster, number - cluster.first_triangle, out);
      for (int i = 0; i < 3; ++i) out[i] += first_vertex;
      return;
    }
    if (index_bits == 0) {
      out[0] = out[1] = out[2] = index_min;
      return;
    }
    const uint64_t bit = uint64_t{number} * (3 * index_bits);
    for (uint32_t i = 0; i < 3; ++i) out[i] = index_min + unpack_bits(indices, bit + i * index_bits, index_bits);
  }

  /// The code of a lattice position: its offset from `base`.
  SCREE_HD void code(uint32_t vertex, uint32_t out[3]) const {
    uint64_t bit = uint64_t{vertex - first_vertex} * stride;
    for (int i = 0; i < 3; ++i) {
      out[i] = bits[i] == 0 ? 0u : unpack_bits(positions, bit, bits[i]);
      bit += bits[i];
    }
    if (clustered) predict_code(cluster.predictor, out);
  }

  SCREE_HD float float_position(uint32_t vertex, int axis) const {
#if defined(__CUDA_ARCH__)
    return reinterpret_cast<const float*>(positions)[3 * uint64_t{vertex} + static_cast<uint64_t>(axis)];
#else
    float value;
    std::memcpy(&value, positions + 12 * uint64_t{vertex} + 4 * static_cast<uint64_t>(axis), sizeof value);
    return value;
#endif
  }

  /// The relative position, rounded once to float.
  SCREE_HD void relative(uint32_t vertex, float out[3]) const {
    if (float32) {
      for (int i = 0; i < 3; ++i) out[i] = float_position(vertex, i) - center[i];
      return;
    }
    uint32_t codes[3];
    code(vertex, codes);
    if (narrow) {
      for (int i = 0; i < 3; ++i)
        out[i] = static_cast<float>(static_cast<int32_t>(base[i]) + static_cast<int32_t>(codes[i]));
    } else {
      for (int i = 0; i < 3; ++i) out[i] = static_cast<float>(base[i] + static_cast<int64_t>(codes[i]));
    }
  }

  /// The same in double: exact for lattice positions below 2^53, rounded once for float32.
  SCREE_HD void exact_relative(uint32_t vertex, double out[3]) const {
    if (float32) {
      for (int i = 0; i < 3; ++i) {
        out[i] = static_cast<double>(float_position(vertex, i)) - static_cast<double>(center[i]);
      }
      return;
    }
    uint32_t codes[3];
    code(vertex, codes);
    for (int i = 0; i < 3; ++i) out[i] = static_cast<double>(base[i] + static_cast<int64_t>(codes[i]));
  }
};

/// a + b and a - b with wrapping. Lattices beyond 2^62 give wrong pictures, but no undefined behaviour.
SCREE_HD inline int64_t wrapping_add(int64_t a, int64_t b) {
  return static_cast<int64_t>(static_cast<uint64_t>(a) + static_cast<uint64_t>(b));
}
SCREE_HD inline int64_t wrapping_sub(int64_t a, int64_t b) {
  return static_cast<int64_t>(static_cast<uint64_t>(a) - static_cast<uint64_t>(b));
}

/// The last index in `values` (count >= 1, ascending, the first <= key) whose value is <= key.
template <class Value>
SCREE_HD inline uint64_t last_not_above(uint64_t count, uint64_t key, const Value& value) {
  uint64_t low = 0;
  uint64_t high = count;
  while (high - low > 1) {
    const uint64_t middle = low + (high - low) / 2;
    if (value(middle) <= key) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return low;
}

struct ClusterBases {
  const format::ClusterRecord* clusters;
  SCREE_HD uint64_t operator()(uint64_t i) const { return clusters[i].first_triangle; }
};

/// The cluster that holds a triangle of a chunk. It is never before the one that would hold it if all clusters were
/// full. Nearly all are full, so the first cluster tested is usually right.
SCREE_HD inline uint64_t cluster_of_triangle(const format::ClusterRecord* clusters, uint32_t count, uint32_t triangle) {
  uint64_t low = min_of(triangle / format::kMaxClusterTriangles, count - 1);
  uint64_t step = 1;
  while (low + step < count && clusters[low + step].first_triangle <= triangle) {
    low += step;
    step *= 2;
  }
  return low + last_not_above(min_of<uint64_t>(step, count - low), triangle, ClusterBases{clusters + low});
}

/// The cluster records of a chunk's payload. Pages and streams are 16-byte aligned.
SCREE_HD inline const format::ClusterRecord* clusters_of(const std::byte* payload,
                                                         const format::ChunkStreams& streams) {
  return reinterpret_cast<const format::ClusterRecord*>(payload + streams.clusters.offset);
}

template <ChunkKinds kKinds>
SCREE_HD inline bool is_clustered(const format::ChunkRecord& chunk) {
  return kKinds == ChunkKinds::kClustered ||
         (kKinds == ChunkKinds::kMixed && chunk.encoding == format::ChunkEncoding::kClustered);
}

/// `page`: the raw bytes of the chunk's page. `cluster`: the one to read; 0 if the chunk is indexed. `kKinds`: the
/// scene's.
template <ChunkKinds kKinds = ChunkKinds::kMixed>
SCREE_HD inline ChunkReader make_reader_of(const format::MeshRecord& mesh, const format::ChunkRecord& chunk,
                                           const std::byte* page, const Transform& transform,
                                           const format::ChunkStreams& streams, uint64_t cluster) {
  const std::byte* payload = page + chunk.offset;
  ChunkReader reader;
  reader.indices = payload + streams.indices.offset;
  reader.positions = payload + streams.positions.offset;
  reader.index_min = chunk.index_min;
  reader.index_bits = chunk.index_bits;
  reader.float32 = kKinds == ChunkKinds::kFloat32 ||
                   (kKinds == ChunkKinds::kMixed && mesh.position_encoding == format::PositionEncoding::kFloat32);
  reader.clustered = is_clustered<kKinds>(chunk);
  reader.first_vertex = 0;
  reader.end_triangle = chunk.triangle_count;
  for (int i = 0; i < 3; ++i) reader.bits[i] = chunk.position_bits[i];
  uint32_t min[3] = {chunk.position_min[0], chunk.position_min[1], chunk.position_min[2]};
  if (reader.clustered) {
    const auto* bounds = reinterpret_cast<const format::ClusterBounds*>(payload + streams.cluster_bounds.offset);
    reader.cluster =
        cluster_reader(clusters_of(payload, streams)[cluster], bounds[cluster], payload + streams.cluster_data.offset);
    reader.positions = reader.cluster.data + uint64_t{reader.cluster.layout.positions} * 4;
    reader.first_vertex = reader.cluster.first_vertex;
    reader.end_triangle = reader.cluster.first_triangle + reader.cluster.layout.triangle_count;
    for (int i = 0; i < 3; ++i) {
      reader.bits[i] = reader.cluster.layout.position_bits[i];
      min[i] += reader.cluster.min[i];
    }
  }
  reader.stride = reader.bits[0] + reader.bits[1] + reader.bits[2];
  reader.narrow = true;
  constexpr int64_t kNarrow = int64_t{1} << 30;
  // Kept 2^32 away from the ends, so that adding a code cannot overflow.
  constexpr int64_t kEnd = INT64_MAX - (int64_t{1} << 32);
  for (int i = 0; i < 3; ++i) {
    reader.center[i] = transform.center[i];
    const int64_t base = wrapping_sub(wrapping_add(mesh.lattice_min[i], int64_t{min[i]}), transform.reference[i]);
    reader.base[i] = base < kEnd ? base : kEnd;
    reader.narrow = reader.narrow && base < kNarrow && base > -kNarrow;
  }
  return reader;
}

/// The same for the cluster that holds a triangle of the chunk.
template <ChunkKinds kKinds = ChunkKinds::kMixed>
SCREE_HD inline ChunkReader make_reader(const format::MeshRecord& mesh, const format::ChunkRecord& chunk,
                                        const std::byte* page, const Transform& transform, uint32_t triangle) {
  const format::ChunkStreams streams = streams_of(mesh, chunk);
  uint64_t cluster = 0;
  if (is_clustered<kKinds>(chunk))
    cluster = cluster_of_triangle(clusters_of(page + chunk.offset, streams), chunk.cluster_count, triangle);
  return make_reader_of<kKinds>(mesh, chunk, page, transform, streams, cluster);
}

/// The mesh's box. It is widened, because its bounds are rounded to float, which far from the origin is more than a
/// lattice step.
SCREE_HD inline RelativeBox mesh_box(const format::MeshRecord& mesh, const Transform& transform) {
  RelativeBox box;
  const bool float32 = mesh.position_encoding == format::PositionEncoding::kFloat32;
  const double scale = float32 ? 1.0 : format::exp2i(-mesh.lattice_exponent);
  for (int i = 0; i < 3; ++i) {
    const double low = static_cast<double>(mesh.bounds_min[i]);
    const double high = static_cast<double>(mesh.bounds_max[i]);
    const double origin =
        float32 ? static_cast<double>(transform.center[i]) : static_cast<double>(transform.reference[i]);
    box.center[i] = 0.5 * (low + high) * scale - origin;
    box.extent[i] = (0.5 * (high - low) + (abs_of(low) + abs_of(high)) * (1.0 / (1 << 22))) * scale;
  }
  return box;
}

/// The exact box of a chunk of a lattice mesh.
SCREE_HD inline RelativeBox chunk_box(const format::MeshRecord& mesh, const format::ChunkRecord& chunk,
                                      const Transform& transform) {
  RelativeBox box;
  for (int i = 0; i < 3; ++i) {
    const int64_t low = wrapping_sub(wrapping_add(mesh.lattice_min[i], static_cast<int64_t>(chunk.position_min[i])),
                                     transform.reference[i]);
    const double side = static_cast<double>((uint64_t{1} << (chunk.position_bits[i] & 31)) - 1);
    box.extent[i] = 0.5 * side;
    box.center[i] = static_cast<double>(low) + 0.5 * side;
  }
  return box;
}

/// chunk_box() of a chunk on a lattice, in single precision. `chunk`: any record with its position_min and
/// position_bits.
template <typename Chunk>
SCREE_HD RoundedBox rounded_chunk_box(const format::MeshRecord& mesh, const Chunk& chunk, const Transform& transform) {
  RoundedBox box;
  for (int i = 0; i < 3; ++i) {
    const int64_t low = wrapping_sub(wrapping_add(mesh.lattice_min[i], static_cast<int64_t>(chunk.position_min[i])),
                                     transform.reference[i]);
    box.extent[i] = 0.5f * static_cast<float>((uint64_t{1} << (chunk.position_bits[i] & 31)) - 1);
    box.center[i] = static_cast<float>(low) + box.extent[i];
  }
  return box;
}

/// The smallest known box of a chunk's vertices.
SCREE_HD inline RelativeBox vertex_box(const format::MeshRecord& mesh, const format::ChunkRecord& chunk,
                                       const Transform& transform) {
  return mesh.position_encoding == format::PositionEncoding::kFloat32 ? mesh_box(mesh, transform)
                                                                      : chunk_box(mesh, chunk, transform);
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
