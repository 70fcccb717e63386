// From a global triangle id back to the triangle, and from a sample to the point where its ray hits the triangle.
// Source: spec/rasterization.md, resolve.
#pragma once

#include "kernels/raster/clip.h"
#include "kernels/shade/approximate.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// The first id of each instance. Empty instances are skipped: of equal sums the search returns the last.
struct InstanceBases {
  const uint64_t* base;
  SCREE_HD uint64_t operator()(uint64_t i) const { return base[i]; }
};

/// The chunk of a mesh, as a number in `chunks`, that holds the mesh's triangle. `chunks`: the mesh's own. They have
/// about equally many triangles, so the first guess is usually right or next to it. From there the steps grow.
SCREE_HD inline uint64_t chunk_of_triangle(const format::MeshRecord& mesh, const format::ChunkRecord* chunks,
                                           uint64_t triangle) {
  uint64_t low = 0;
  uint64_t high = mesh.chunk_count;
  const float share = static_cast<float>(triangle) * reciprocal(static_cast<float>(mesh.triangle_count));
  uint64_t guess = min_of(static_cast<uint64_t>(share * static_cast<float>(high)), high - 1);
  for (uint64_t step = 1; high - low > 1; step *= 2) {
    const format::ChunkRecord& chunk = chunks[guess];
    if (chunk.first_triangle > triangle) {
      high = guess;
      guess = max_of(guess, low + step) - step;
    } else if (triangle - chunk.first_triangle >= chunk.triangle_count) {
      low = guess + 1;
      guess = min_of(guess + step, high - 1);
    } else {
      return guess;
    }
  }
  return low;
}

SCREE_HD inline Hit locate_triangle(const SceneView& scene, uint64_t id) {
  Hit hit;
  hit.instance = last_not_above(scene.instance_count, id, InstanceBases{scene.instance_base});
  const format::MeshRecord& mesh = scene.meshes[scene.instances[hit.instance].mesh];
  const uint64_t triangle = id - scene.instance_base[hit.instance];
  const format::ChunkRecord* chunks = scene.chunks + mesh.first_chunk;
  const uint64_t chunk = chunk_of_triangle(mesh, chunks, triangle);
  hit.chunk = mesh.first_chunk + chunk;
  hit.triangle = static_cast<uint32_t>(triangle - chunks[chunk].first_triangle);
  return hit;
}

/// The ids of one (instance, chunk). Kept from sample to sample, because neighbours often share it.
struct Location {
  uint64_t first_id = 0;
  uint64_t instance = 0;
  uint64_t chunk = 0;
  uint32_t count = 0;  // number of ids; 0: no triangle was found yet

  SCREE_HD bool holds(uint64_t id) const { return id - first_id < count; }
};

/// As last_not_above(), for one key with all lanes of a team. Each lane tests the start of one of team.size() parts.
template <class Team, class Value>
SCREE_HD inline uint64_t last_not_above_together(Team team, uint64_t count, uint64_t key, const Value& value) {
  constexpr uint32_t kParts = Team::size() < 2 ? 2 : Team::size();
  uint64_t low = 0;
  uint64_t high = count;
  while (high - low > 1) {
    const uint64_t part = (high - low + kParts - 1) / kParts;
    const uint64_t place = low + part * (team.rank() + 1);
    const bool passed = place < high && value(place) <= key;
    const uint64_t parts = count_bits(team.ballot(passed));
    high = min_of(high, low + part * (parts + 1));
    low = low + part * parts;
  }
  return low;
}

/// Finds the (instance, chunk) of every lane's id. `wanted`: whether the lane has one. All lanes of the team must call
/// it. The lanes of a tile share few instances, and all lanes search for one instance after the other together. After
/// four instances each lane searches alone. Each lane then finds its chunk.
template <class Team>
SCREE_HD inline void locate(Team team, const SceneView& scene, uint64_t id, bool wanted, Location& at) {
  constexpr int kRounds = 4;
  const uint64_t* const base = scene.instance_base;
  wanted = wanted && !at.holds(id);
  bool missing = wanted;
  for (int round = 0; round < kRounds; ++round) {
    const uint32_t lanes = team.ballot(missing);
    if (lanes == 0) break;
    const uint64_t shared_id = team.share(id, lowest_bit(lanes));
    const uint64_t instance = last_not_above_together(team, scene.instance_count, shared_id, InstanceBases{base});
    if (missing && id - base[instance] < base[instance + 1] - base[instance]) {
      at.instance = instance;
      missing = false;
    }
  }
  if (!wanted) return;
  if (missing) at.instance = last_not_above(scene.instance_count, id, InstanceBases{base});
  const format::MeshRecord& mesh = scene.meshes[scene.instances[at.instance].mesh];
  const format::ChunkRecord* const chunks = scene.chunks + mesh.first_chunk;
  const uint64_t chunk = chunk_of_triangle(mesh, chunks, id - base[at.instance]);
  at.chunk = mesh.first_chunk + chunk;
  at.first_id = base[at.instance] + chunks[chunk].first_triangle;
  at.count = chunks[chunk].triangle_count;
}

/// A chunk under a transform: the input of shading a sample of it.
struct PlacedChunk {
  const format::MeshRecord& mesh;
  const format::ChunkRecord& chunk;
  const Transform& transform;
  const std::byte* page;
  uint32_t triangle;  // the reader reads its cluster
  ChunkReader reader;
};

template <ChunkKinds kKinds>
SCREE_HD inline PlacedChunk place_chunk(const SceneView& scene, uint64_t number, uint32_t triangle,
                                        const Transform& transform) {
  const format::ChunkRecord& chunk = scene.chunks[number];
  const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
  const std::byte* page = scene.pages[chunk.page];
  return {mesh, chunk, transform, page, triangle, make_reader<kKinds>(mesh, chunk, page, transform, triangle)};
}

/// Corner 0 relative to the transform's reference or center, and the edges from it to corners 1 and 2. An edge is the
/// difference of two codes, so it is exact at any distance from the camera.
template <class Real>
struct Corners {
  Real first[3];
  Real edge[2][3];
};

// The most bits that unpack_run() returns.
inline constexpr uint32_t kRunBits = 57;

/// Reads `bits` (1 to kRunBits) bits at a bit offset of a packed stream: several adjacent values at once.
SCREE_HD inline uint64_t unpack_run(const std::byte* stream, uint64_t bit, uint32_t bits) {
#if defined(__CUDA_ARCH__)
  const uint32_t* word = reinterpret_cast<const uint32_t*>(stream) + (bit >> 5);
  const uint32_t shift = static_cast<uint32_t>(bit) & 31u;
  const uint32_t middle = word[1];
  const uint32_t last = shift + bits > 64 ? word[2] : 0u;  // otherwise it may lie past the stream
  return uint64_t{__funnelshift_r(middle, last, shift)} << 32 | __funnelshift_r(word[0], middle, shift);
#else
  (void)bits;
  uint64_t window;
  std::memcpy(&window, stream + (bit >> 3), sizeof window);
  return window >> (bit & 7u);
#endif
}

SCREE_HD inline uint32_t low_bits(uint64_t run, uint32_t bits) {
  return static_cast<uint32_t>(run) & ((1u << bits) - 1u);
}

/// As ChunkReader::triangle(), with fewer loads.
SCREE_HD inline void fetch_triangle(const ChunkReader& reader, uint32_t number, uint32_t vertex[3]) {
  const uint32_t bits = reader.index_bits;
  if (bits - 1 >= kRunBits / 3) return reader.triangle(number, vertex);
  const uint64_t run = unpack_run(reader.indices, uint64_t{number} * (3 * bits), 3 * bits);
  for (uint32_t i = 0; i < 3; ++i) vertex[i] = reader.index_min + low_bits(run >> (i * bits), bits);
}

/// As ChunkReader::code(), with fewer loads.
SCREE_HD inline void fetch_code(const ChunkReader& reader, uint32_t vertex, uint32_t code[3]) {
  if (reader.stride - 1 >= kRunBits) return reader.code(vertex, code);
  uint64_t run = unpack_run(reader.positions, uint64_t{vertex - reader.first_vertex} * reader.stride, reader.stride);
  for (int i = 0; i < 3; ++i) {
    code[i] = low_bits(run, reader.bits[i]);
    run >>= reader.bits[i];
  }
  if (reader.clustered) predict_code(reader.cluster.predictor, code);
}

template <class Real>
SCREE_HD inline Corners<Real> fetch_corners(const ChunkReader& reader, const uint32_t vertex[3]) {
  Corners<Real> out;
  if (reader.float32) {
    for (int axis = 0; axis < 3; ++axis) {
      const Real first = static_cast<Real>(reader.float_position(vertex[0], axis));
      out.first[axis] = first - static_cast<Real>(reader.center[axis]);
      for (int n = 0; n < 2; ++n)
        out.edge[n][axis] = static_cast<Real>(reader.float_position(vertex[n + 1], axis)) - first;
    }
    return out;
  }
  uint32_t first[3];
  fetch_code(reader, vertex[0], first);
  for (int axis = 0; axis < 3; ++axis)
    out.first[axis] = static_cast<Real>(reader.base[axis] + static_cast<int64_t>(first[axis]));
  for (int n = 0; n < 2; ++n) {
    uint32_t code[3];
    fetch_code(reader, vertex[n + 1], code);
    for (int axis = 0; axis < 3; ++axis)
      out.edge[n][axis] = static_cast<Real>(static_cast<int32_t>(code[axis]) - static_cast<int32_t>(first[axis]));
  }
  return out;
}

/// A triangle relative to one sample's ray: homogeneous, x and y in sub-pixels from the sample, times w. With a
/// perspective camera all values are divided by the sum of the corners' |w|, which changes no ratio and keeps products
/// within a float's range.
template <class Real>
struct PlaneHit {
  Real x;  // corner 0
  Real y;
  Real w;  // 1 with an orthographic camera
  Real edge_x[2];
  Real edge_y[2];
  Real edge_w[2];  // of the depth row, for both kinds of camera
  Real area;       // twice the triangle's area; 0 if it is seen edge-on
};

/// (x, y): the sample, sub-pixels from the image's centre.
template <bool kOrthographic, class Real>
SCREE_HD inline PlaneHit<Real> intersect_plane(const Transform& transform, const Corners<Real>& corners, Real x,
                                               Real y) {
  const TransformRows<Real> rows = rows_of(transform, Real{});
  PlaneHit<Real> out;
  Real row_x[4];
  Real row_y[4];
  for (int i = 0; i < 4; ++i) {
    row_x[i] = kOrthographic ? rows.x[i] : multiply_add(-x, rows.w[i], rows.x[i]);
    row_y[i] = kOrthographic ? rows.y[i] : multiply_add(-y, rows.w[i], rows.y[i]);
  }
  const auto dot = [](const Real* row, const Real* d, Real start) {
    return multiply_add(row[0], d[0], multiply_add(row[1], d[1], multiply_add(row[2], d[2], start)));
  };
  out.x = dot(row_x, corners.first, kOrthographic ? row_x[3] - x : row_x[3]);
  out.y = dot(row_y, corners.first, kOrthographic ? row_y[3] - y : row_y[3]);
  out.w = kOrthographic ? Real{1} : dot(rows.w, corners.first, rows.w[3]);
  for (int n = 0; n < 2; ++n) {
    out.edge_x[n] = dot(row_x, corners.edge[n], Real{0});
    out.edge_y[n] = dot(row_y, corners.edge[n], Real{0});
    out.edge_w[n] = dot(rows.w, corners.edge[n], Real{0});
  }
  if constexpr (!kOrthographic) {
    const Real scale = reciprocal(abs_of(out.w) + abs_of(out.w + out.edge_w[0]) + abs_of(out.w + out.edge_w[1]));
    out.x = out.x * scale;
    out.y = out.y * scale;
    out.w = out.w * scale;
    for (int n = 0; n < 2; ++n) {
      out.edge_x[n] = out.edge_x[n] * scale;
      out.edge_y[n] = out.edge_y[n] * scale;
      out.edge_w[n] = out.edge_w[n] * scale;
    }
  }
  out.area = out.edge_x[0] * out.edge_y[1] - out.edge_y[0] * out.edge_x[1];
  return out;
}

/// intersect_plane() of the centre of sample (x, y) of the picture, in double precision.
template <bool kOrthographic>
SCREE_HD inline PlaneHit<double> intersect_plane_at(const FrameView& view, const Transform& transform,
                                                    const Corners<double>& corners, int32_t x, int32_t y) {
  const auto center = [](int32_t place, float half) {
    return static_cast<double>(place) * kSubpixels + kSubpixels / 2 - static_cast<double>(half);
  };
  return intersect_plane<kOrthographic>(transform, corners, center(x, view.half_width), center(y, view.half_height));
}

/// The weights of the corners, in object space, of the point where the ray hits the triangle's plane. They are clamped
/// to the triangle: after snapping a sample's centre may lie a little outside, and far outside an edge-on triangle.
template <class Real>
SCREE_HD inline void hit_weights(const PlaneHit<Real>& m, Real weights[3]) {
  const Real inverse = reciprocal(m.area);
  weights[1] = (m.edge_x[1] * m.y - m.edge_y[1] * m.x) * inverse;
  weights[2] = (m.x * m.edge_y[0] - m.y * m.edge_x[0]) * inverse;
  weights[0] = Real{1} - weights[1] - weights[2];
  Real sum{0};
  for (int i = 0; i < 3; ++i) {
    weights[i] = weights[i] > 0 ? min_of(weights[i], Real{1}) : Real{0};  // also catches NaN, from an area of 0
    sum += weights[i];
  }
  const Real share = sum > 0 ? reciprocal(sum) : Real{0};
  for (int i = 0; i < 3; ++i) weights[i] = sum > 0 ? weights[i] * share : Real{1} / Real{3};
}

/// The stage (1, 2 or 3) that drew this pixel of the triangle: if the triangle was clipped, the stage of the piece that
/// covers the pixel.
template <bool kOrthographic>
SCREE_HD inline int stage_of(const PlacedChunk& chunk, const uint32_t vertex[3], const FrameView& view, int32_t x,
                             int32_t y) {
  ScreenVertex corners[3];
  uint32_t flags = 0;
  for (int i = 0; i < 3; ++i) {
    float d[3];
    chunk.reader.relative(vertex[i], d);
    corners[i] = project<kOrthographic>(chunk.transform, view, d[0], d[1], d[2]);
    flags |= corners[i].flags;
  }
  ScreenVertex polygon_corners[kMaxPolygon] = {corners[0], corners[1], corners[2]};
  int count = 3;
  if ((flags & kNeedsClip) != 0) {
    ClipVertex polygon[kMaxPolygon];
    for (int i = 0; i < 3; ++i) {
      double d[3];
      chunk.reader.exact_relative(vertex[i], d);
      polygon[i] = clip_vertex(chunk.transform, d, corners[i]);
    }
    count = clip_polygon<kOrthographic>(polygon);
    for (int i = 0; i < count; ++i) polygon_corners[i] = snap_clipped<kOrthographic>(polygon[i], view);
  }
  for (int i = 2; i < count; ++i) {
    const ScreenVertex& a = polygon_corners[0];
    const ScreenVertex& b = polygon_corners[i - 1];
    const ScreenVertex& c = polygon_corners[i];
    Triangle triangle{{a.x, b.x, c.x}, {a.y, b.y, c.y}, {0, 0, 0}, 0, 0};
    int64_t area;
    if (orient(triangle, area, false, true) == Facing::kCulled) continue;
    const Edges<int64_t> edges = make_edges<int64_t>(triangle, x, y);
    if ((edges.value[0] | edges.value[1] | edges.value[2]) < 0) continue;
    const int64_t pixels = pixel_box(triangle.x, triangle.y, view).pixels();
    return pixels <= kSmallBox ? 1 : pixels < kMediumBox ? 2 : 3;
  }
  return 0;
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
