// Every vertex and index of the measured scenes; these functions are their definition. They compile for host and
// device, so that a benchmark makes the same vertices on the GPU. They are reproducible bit for bit, because
//   - integers are uint32_t and wrap around; real arithmetic is IEEE double, one operation at a time (no fused
//     multiply-add: -ffp-contract=off, --fmad=false), only + - * / sqrt floor, in the order written here;
//   - each coordinate is rounded once, double to float, at the very end.
// Therefore no expression below may be reordered, factored or simplified.
#pragma once

#include <cmath>
#include <cstdint>

#include "format/hd.h"

namespace scree::synth {

struct Double3 {
  double x, y, z;
};
struct Float3 {
  float x, y, z;
};

// ---- Hashes ----

/// "lowbias32" (Ellis): a bijection of 32 bits.
SCREE_HD inline uint32_t hash32(uint32_t x) {
  x ^= x >> 16;
  x *= 0x7feb352du;
  x ^= x >> 15;
  x *= 0x846ca68bu;
  x ^= x >> 16;
  return x;
}

SCREE_HD inline uint32_t hash2(uint32_t seed, uint32_t a, uint32_t b) {
  uint32_t h = hash32(seed + 0x9e3779b9u);
  h = hash32(h ^ (a * 0x85ebca6bu));
  return hash32(h ^ (b * 0xc2b2ae35u));
}

SCREE_HD inline uint32_t hash3(uint32_t seed, uint32_t a, uint32_t b, uint32_t c) {
  return hash32(hash2(seed, a, b) ^ (c * 0x27d4eb2fu));
}

/// A hash as a number in [0, 1), in steps of 2^-24.
SCREE_HD inline double unit24(uint32_t hash) {
  return static_cast<double>(hash >> 8) * 5.9604644775390625e-08;
}

// ---- Value noise in [-1, 1] ----

SCREE_HD inline double smooth_step(double t) {
  return (t * t) * (3.0 - 2.0 * t);
}

/// 0 below `low`, 1 above `high`, smooth between.
SCREE_HD inline double ramp(double low, double high, double x) {
  const double t = (x - low) / (high - low);
  return smooth_step(t < 0.0 ? 0.0 : t > 1.0 ? 1.0 : t);
}
SCREE_HD inline double mix(double a, double b, double t) {
  return a + (b - a) * t;
}

/// Noise on a lattice of 2^k grid steps; gi, gj >= 0.
SCREE_HD inline double noise2(uint32_t seed, int k, int gi, int gj) {
  const uint32_t ci = static_cast<uint32_t>(gi >> k), cj = static_cast<uint32_t>(gj >> k);
  const int mask = (1 << k) - 1;
  const double inverse = 1.0 / static_cast<double>(1 << k);
  const double wx = smooth_step(static_cast<double>(gi & mask) * inverse);
  const double wy = smooth_step(static_cast<double>(gj & mask) * inverse);
  const double a = mix(unit24(hash2(seed, ci, cj)), unit24(hash2(seed, ci + 1, cj)), wx);
  const double b = mix(unit24(hash2(seed, ci, cj + 1)), unit24(hash2(seed, ci + 1, cj + 1)), wx);
  return 2.0 * mix(a, b, wy) - 1.0;
}

/// x, y, z must be > 0 and below 2^31.
SCREE_HD inline double noise3(uint32_t seed, double x, double y, double z) {
  const double floor_x = std::floor(x), floor_y = std::floor(y), floor_z = std::floor(z);
  const uint32_t i = static_cast<uint32_t>(static_cast<int>(floor_x));
  const uint32_t j = static_cast<uint32_t>(static_cast<int>(floor_y));
  const uint32_t k = static_cast<uint32_t>(static_cast<int>(floor_z));
  const double wx = smooth_step(x - floor_x), wy = smooth_step(y - floor_y), wz = smooth_step(z - floor_z);
  const double a = mix(mix(unit24(hash3(seed, i, j, k)), unit24(hash3(seed, i + 1, j, k)), wx),
                       mix(unit24(hash3(seed, i, j + 1, k)), unit24(hash3(seed, i + 1, j + 1, k)), wx), wy);
  const double b = mix(mix(unit24(hash3(seed, i, j, k + 1)), unit24(hash3(seed, i + 1, j, k + 1)), wx),
                       mix(unit24(hash3(seed, i, j + 1, k + 1)), unit24(hash3(seed, i + 1, j + 1, k + 1)), wx), wy);
  return 2.0 * mix(a, b, wz) - 1.0;
}

// ---- Meshes: one grid of n x n quads (terrain) or six, the faces of a cube (blob) ----

enum class MeshKind : uint32_t { kTerrain, kBlob };
enum class MeshOrder : uint32_t { kRow, kBlock };  // kBlock: blocks of 8 x 8 quads, n % 8 == 0

struct MeshRecipe {
  MeshKind kind = MeshKind::kBlob;
  uint32_t n = 1;  // quads along one side of a grid
  MeshOrder order = MeshOrder::kRow;
  uint32_t seed = 0;
  uint32_t tile_x = 0, tile_y = 0;  // terrain
  uint32_t round8 = 0;              // blob: 0 box to 8 sphere
  uint32_t octaves = 0;             // blob
  double amplitude = 0;             // blob: height of its bumps relative to the radius
  double frequency = 0;             // blob: of the first octave
};

SCREE_HD inline uint32_t face_count(const MeshRecipe& mesh) {
  return mesh.kind == MeshKind::kTerrain ? 1u : 6u;
}
SCREE_HD inline uint64_t vertex_count(const MeshRecipe& mesh) {
  return uint64_t{face_count(mesh)} * (uint64_t{mesh.n} + 1) * (uint64_t{mesh.n} + 1);
}
SCREE_HD inline uint64_t triangle_count(const MeshRecipe& mesh) {
  return uint64_t{face_count(mesh)} * 2 * uint64_t{mesh.n} * uint64_t{mesh.n};
}

/// The number of grid vertex (x, y), 0 <= x, y <= n.
SCREE_HD inline uint32_t grid_vertex(MeshOrder order, uint32_t n, uint32_t x, uint32_t y) {
  if (order == MeshOrder::kRow) return y * (n + 1) + x;
  if (x < n && y < n) return ((y >> 3) * (n >> 3) + (x >> 3)) * 64u + (y & 7u) * 8u + (x & 7u);
  if (x == n) return n * n + y;  // last column, n + 1 vertices
  return n * n + (n + 1) + x;    // last row without its corner, n vertices
}

/// The inverse of grid_vertex.
SCREE_HD inline void grid_place(MeshOrder order, uint32_t n, uint32_t vertex, uint32_t* x, uint32_t* y) {
  if (order == MeshOrder::kRow) {
    *x = vertex % (n + 1);
    *y = vertex / (n + 1);
    return;
  }
  if (vertex < n * n) {
    const uint32_t block = vertex >> 6, local = vertex & 63u;
    *x = (block % (n >> 3)) * 8u + (local & 7u);
    *y = (block / (n >> 3)) * 8u + (local >> 3);
    return;
  }
  const uint32_t rest = vertex - n * n;
  *x = rest <= n ? n : rest - (n + 1);
  *y = rest <= n ? rest : n;
}

/// The six vertex numbers of quad `quad` (< triangle_count / 2): corners counter-clockwise (0,0) (1,0) (1,1) | (0,0)
/// (1,1) (0,1). The index buffer consists of these, quad by quad.
SCREE_HD inline void quad_indices(const MeshRecipe& mesh, uint32_t quad, uint32_t out[6]) {
  const uint32_t n = mesh.n, per_face = n * n;
  const uint32_t face = mesh.kind == MeshKind::kBlob ? quad / per_face : 0;
  const uint32_t q = quad - face * per_face;
  uint32_t x, y;
  if (mesh.order == MeshOrder::kRow) {
    x = q % n;
    y = q / n;
  } else {
    grid_place(MeshOrder::kBlock, n, q, &x, &y);  // the quads of blocks are numbered like their vertices
  }
  const uint32_t base = face * (n + 1) * (n + 1);
  const uint32_t corner00 = base + grid_vertex(mesh.order, n, x, y);
  const uint32_t corner11 = base + grid_vertex(mesh.order, n, x + 1, y + 1);
  out[0] = corner00;
  out[1] = base + grid_vertex(mesh.order, n, x + 1, y);
  out[2] = corner11;
  out[3] = corner00;
  out[4] = corner11;
  out[5] = base + grid_vertex(mesh.order, n, x, y + 1);
}

// ---- Positions ----

inline constexpr uint32_t kTerrainQuads = 4080;  // along one side of a tile, at full scale
inline constexpr uint32_t kTerrainTilesX = 4;
inline constexpr uint32_t kTerrainTilesY = 3;
inline constexpr double kTerrainStep = 0.0625;  // grid spacing, units

/// The terrain at global grid coordinates (>= 0): x right, y forward, z up.
SCREE_HD inline Double3 terrain_position(int gi, int gj) {
  const uint32_t i = static_cast<uint32_t>(gi), j = static_cast<uint32_t>(gj);
  double z = 0.0;
  for (int k = 11; k >= 2; --k) {
    const double a = static_cast<double>(1 << k) * 0.009375;
    z = z + a * noise2(200u + static_cast<uint32_t>(k), k, gi, gj);
  }
  z = z + (unit24(hash2(103u, i, j)) - 0.5) * 0.03;
  Double3 p;
  p.x = (static_cast<double>(gi) + (unit24(hash2(101u, i, j)) - 0.5) * 0.5) * kTerrainStep;
  p.y = (static_cast<double>(gj) + (unit24(hash2(102u, i, j)) - 0.5) * 0.5) * kTerrainStep;
  p.z = z;
  return p;
}

/// The point of the blob for an integer point on the surface of the cube [-n, n]^3.
SCREE_HD inline Double3 blob_position(const MeshRecipe& mesh, int px, int py, int pz) {
  const double n = static_cast<double>(mesh.n);
  const double cx = static_cast<double>(px) / n, cy = static_cast<double>(py) / n, cz = static_cast<double>(pz) / n;
  const double length = std::sqrt((cx * cx + cy * cy) + cz * cz);
  const double sx = cx / length, sy = cy / length, sz = cz / length;
  const double w = static_cast<double>(mesh.round8) * 0.125;
  double r = 1.0;
  if (mesh.octaves > 0) {
    double sum = 0.0, a = 1.0, f = mesh.frequency;
    for (uint32_t octave = 0; octave < mesh.octaves; ++octave) {
      sum = sum + a * noise3(mesh.seed + octave * 7919u, sx * f + 1024.0, sy * f + 1024.0, sz * f + 1024.0);
      a = a * 0.5;
      f = f * 2.0;
    }
    r = 1.0 + mesh.amplitude * sum;
  }
  Double3 p;
  p.x = (cx + (sx - cx) * w) * r;
  p.y = (cy + (sy - cy) * w) * r;
  p.z = (cz + (sz - cz) * w) * r;
  return p;
}

/// Grid point (x, y) of a face, before rounding.
SCREE_HD inline Double3 surface_position(const MeshRecipe& mesh, uint32_t face, int x, int y) {
  const int n = static_cast<int>(mesh.n);
  if (mesh.kind == MeshKind::kTerrain)
    return terrain_position(static_cast<int>(mesh.tile_x) * n + x, static_cast<int>(mesh.tile_y) * n + y);
  const int axis = static_cast<int>(face >> 1), u = (axis + 1) % 3, v = (axis + 2) % 3;
  int c[3];
  // On the negative faces u and v are exchanged, which keeps the outside counter-clockwise.
  const bool positive = (face & 1u) != 0;
  c[axis] = positive ? n : -n;
  c[u] = 2 * (positive ? x : y) - n;
  c[v] = 2 * (positive ? y : x) - n;
  return blob_position(mesh, c[0], c[1], c[2]);
}

/// Vertex `vertex` (< vertex_count) of a mesh.
SCREE_HD inline Float3 vertex_position(const MeshRecipe& mesh, uint32_t vertex) {
  const uint32_t per_face = (mesh.n + 1) * (mesh.n + 1), face = vertex / per_face;
  uint32_t x, y;
  grid_place(mesh.order, mesh.n, vertex - face * per_face, &x, &y);
  const Double3 p = surface_position(mesh, face, static_cast<int>(x), static_cast<int>(y));
  return {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
}

// ---- Order-independent sums, to check that two programs hold the same data ----

/// The term of one value in the sum. The value is position float `place` (3 * vertex + axis; `value`: its bits) or
/// index `place`; key = mesh << 40 | place. The terms of a scene are added modulo 2^64.
SCREE_HD inline uint64_t check_term(uint64_t key, uint32_t value) {
  uint64_t z = (key * 0x9e3779b97f4a7c15ull) ^ (uint64_t{value} * 0xd6e8feb86659fd93ull);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
  return z ^ (z >> 31);
}

}  // namespace scree::synth
