// From a global triangle id back to the triangle, and from a pixel to the point of it that the pixel's ray meets.
// Source: spec/rasterization.md, resolve.
#pragma once

#include "kernels/clip.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// The last place in `values` (count >= 1, ascending, the first <= key) that holds a value <= key.
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

/// Places of empty instances and chunks are passed over: of equal sums the last is taken.
struct InstanceBases {
  const uint64_t* base;
  SCREE_HD uint64_t operator()(uint64_t i) const { return base[i]; }
};
struct ChunkBases {
  const format::ChunkRecord* chunks;
  SCREE_HD uint64_t operator()(uint64_t i) const { return chunks[i].first_triangle; }
};

SCREE_HD inline Hit locate_triangle(const SceneView& scene, uint64_t id) {
  Hit hit;
  hit.instance = last_not_above(scene.instance_count, id, InstanceBases{scene.instance_base});
  const format::MeshRecord& mesh = scene.meshes[scene.instances[hit.instance].mesh];
  const uint64_t triangle = id - scene.instance_base[hit.instance];
  const format::ChunkRecord* chunks = scene.chunks + mesh.first_chunk;
  const uint64_t chunk = last_not_above(mesh.chunk_count, triangle, ChunkBases{chunks});
  hit.chunk = mesh.first_chunk + chunk;
  hit.triangle = static_cast<uint32_t>(triangle - chunks[chunk].first_triangle);
  return hit;
}

/// What the pixels of one (instance, chunk) share; kept while neighbouring pixels fall into the same.
struct ResolvedChunk {
  uint64_t first_id = 1;  // ids first_id .. end_id - 1
  uint64_t end_id = 0;
  uint64_t instance;
  const format::MeshRecord* mesh;
  const format::ChunkRecord* chunk;
  const format::MatrixRecord* matrix;
  const std::byte* payload;
  format::ChunkStreams streams;
  Transform transform;
  ChunkReader reader;
};

SCREE_HD inline void resolve_chunk(const SceneView& scene, const FrameView& view, uint64_t id, ResolvedChunk& out) {
  if (id >= out.first_id && id < out.end_id) return;
  const Hit hit = locate_triangle(scene, id);
  const format::InstanceRecord& instance = scene.instances[hit.instance];
  out.instance = hit.instance;
  out.mesh = &scene.meshes[instance.mesh];
  out.chunk = &scene.chunks[hit.chunk];
  out.matrix = &scene.matrices[instance.matrix];
  out.first_id = id - hit.triangle;
  out.end_id = out.first_id + out.chunk->triangle_count;
  out.streams = streams_of(*out.mesh, *out.chunk);
  out.transform = make_transform(view, *out.matrix, out.mesh->lattice_exponent,
                                 out.mesh->position_encoding == format::PositionEncoding::kFloat32);
  const std::byte* page = scene.pages[out.chunk->page];
  out.payload = page + out.chunk->offset;
  out.reader = make_reader(*out.mesh, *out.chunk, page, out.transform);
}

/// A triangle's corners in double: d, and homogeneous with x and y in sub-pixels from the image's centre times w.
struct ResolvedTriangle {
  uint32_t vertex[3];
  double d[3][3];
  double x[3];
  double y[3];
  double w[3];  // 1 with an orthographic camera
};

SCREE_HD inline ResolvedTriangle resolve_triangle(const ResolvedChunk& chunk, uint32_t triangle, bool orthographic) {
  ResolvedTriangle out;
  chunk.reader.triangle(triangle, out.vertex);
  const Transform& m = chunk.transform;
  for (int i = 0; i < 3; ++i) {
    chunk.reader.exact_relative(out.vertex[i], out.d[i]);
    const double* d = out.d[i];
    out.x[i] = m.exact_x[0] * d[0] + m.exact_x[1] * d[1] + m.exact_x[2] * d[2] + m.exact_x[3];
    out.y[i] = m.exact_y[0] * d[0] + m.exact_y[1] * d[1] + m.exact_y[2] * d[2] + m.exact_y[3];
    out.w[i] = orthographic ? 1.0 : m.exact_w[0] * d[0] + m.exact_w[1] * d[1] + m.exact_w[2] * d[2] + m.exact_w[3];
  }
  return out;
}

/// Where the ray through (x, y), sub-pixels from the image's centre, meets the triangle's plane: weights of the corners
/// in object space, adding up to 1, not clamped to the triangle. False where the ray and the plane are parallel;
/// `turned` is the sign of the plane towards the ray, which differs from the pixel's own where a neighbour's ray meets
/// it only behind.
SCREE_HD inline bool meet_plane(const ResolvedTriangle& triangle, double x, double y, double weights[3], bool& turned) {
  double qx[3];
  double qy[3];
  for (int i = 0; i < 3; ++i) {
    qx[i] = triangle.x[i] - x * triangle.w[i];
    qy[i] = triangle.y[i] - y * triangle.w[i];
  }
  const double e0 = qx[1] * qy[2] - qx[2] * qy[1];
  const double e1 = qx[2] * qy[0] - qx[0] * qy[2];
  const double e2 = qx[0] * qy[1] - qx[1] * qy[0];
  const double sum = e0 + e1 + e2;
  turned = sum < 0;
  if (!(abs_of(sum) > 0) || !(abs_of(sum) < 1e300)) return false;
  weights[0] = e0 / sum;
  weights[1] = e1 / sum;
  weights[2] = e2 / sum;
  return true;
}

/// Brings weights into the triangle: snapping lets a pixel centre lie a little outside, edge-on triangles far outside.
SCREE_HD inline void clamp_weights(double weights[3]) {
  double sum = 0;
  for (int i = 0; i < 3; ++i) {
    weights[i] = weights[i] > 0 ? min_of(weights[i], 1.0) : 0.0;
    sum += weights[i];
  }
  for (int i = 0; i < 3; ++i) weights[i] = sum > 0 ? weights[i] / sum : 1.0 / 3.0;
}

/// Which stage (1, 2 or 3) drew this pixel of the triangle: that of the piece, where it was clipped, that covers the
/// pixel.
template <bool kOrthographic>
SCREE_HD inline int stage_of(const ResolvedChunk& chunk, const ResolvedTriangle& resolved, const FrameView& view,
                             int32_t x, int32_t y) {
  ScreenVertex corners[3];
  uint32_t flags = 0;
  for (int i = 0; i < 3; ++i) {
    float d[3];
    chunk.reader.relative(resolved.vertex[i], d);
    corners[i] = project<kOrthographic>(chunk.transform, view, d[0], d[1], d[2]);
    flags |= corners[i].flags;
  }
  ScreenVertex polygon_corners[kMaxPolygon] = {corners[0], corners[1], corners[2]};
  int count = 3;
  if ((flags & kNeedsClip) != 0) {
    ClipVertex polygon[kMaxPolygon];
    for (int i = 0; i < 3; ++i) polygon[i] = clip_vertex(chunk.transform, resolved.d[i], corners[i]);
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
