// Normals and tangents of a chunk's triangles, and how much of the camera's light they catch.
#pragma once

#include <cmath>

#include "format/geometry/attribute_codec.h"
#include "format/geometry/tangent_codec.h"
#include "kernels/shade/locate.h"
#include "kernels/shade/shade_inputs.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

SCREE_HD inline double dot3(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

SCREE_HD inline void cross3(const double a[3], const double b[3], double out[3]) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

/// Scales to unit length, or to all zero if there is no direction.
SCREE_HD inline void normalize3(double v[3]) {
  const double largest = max_of(abs_of(v[0]), max_of(abs_of(v[1]), abs_of(v[2])));
  if (!(largest > 0) || !(largest < 1e300)) {
    v[0] = v[1] = v[2] = 0;
    return;
  }
  for (int i = 0; i < 3; ++i) v[i] = v[i] / largest;  // squares of tiny lengths would underflow
  const double length = std::sqrt(dot3(v, v));
  for (int i = 0; i < 3; ++i) v[i] = v[i] / length;
}

/// The vertex normals interpolated between the corners, in object space, not normalised.
template <class Real>
SCREE_HD inline void vertex_normal(const PlacedChunk& at, const uint32_t vertex[3], const Real weights[3],
                                   Real normal[3]) {
  const std::byte* stream = at.page + at.chunk.offset + streams_of(at.mesh, at.chunk).normals.offset;
  const uint32_t bits = at.chunk.normal_bits;
  normal[0] = normal[1] = normal[2] = 0;
  for (int i = 0; i < 3; ++i) {
    const uint64_t bit = uint64_t{vertex[i]} * (2u * bits);
    float unit[3];
    format::decode_octahedral(unpack_bits(stream, bit, bits), unpack_bits(stream, bit + bits, bits), bits, unit);
    for (int j = 0; j < 3; ++j) normal[j] = multiply_add(weights[i], static_cast<Real>(unit[j]), normal[j]);
  }
}

SCREE_HD inline bool has_vertex_normals(const PlacedChunk& at) {
  return (at.mesh.attributes & format::kHasNormal) != 0 && at.chunk.normal_bits >= 2;
}

SCREE_HD inline bool has_tangents(const PlacedChunk& at) {
  return (at.mesh.attributes & format::kHasTangent) != 0 && at.chunk.tangent_bits >= format::kMinTangentBits &&
         has_vertex_normals(at);
}

/// The vertex tangents interpolated between the corners, in object space, not normalised. Returns 1 or -1: where the
/// bitangent lies (corner 0).
SCREE_HD inline float vertex_tangent(const PlacedChunk& at, const uint32_t vertex[3], const float weights[3],
                                     float tangent[3]) {
  const format::ChunkStreams streams = streams_of(at.mesh, at.chunk);
  const std::byte* const normals = at.page + at.chunk.offset + streams.normals.offset;
  const std::byte* const tangents = at.page + at.chunk.offset + streams.tangents.offset;
  const uint32_t normal_bits = at.chunk.normal_bits;
  const uint32_t bits = at.chunk.tangent_bits;
  float side = 1.0f;
  tangent[0] = tangent[1] = tangent[2] = 0;
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
  for (int i = 0; i < 3; ++i) {
    const uint64_t bit = uint64_t{vertex[i]} * (2u * normal_bits);
    float normal[3];
    float unit[3];
    format::decode_octahedral(unpack_bits(normals, bit, normal_bits),
                              unpack_bits(normals, bit + normal_bits, normal_bits), normal_bits, normal);
    const float sign =
        format::decode_tangent(unpack_bits(tangents, uint64_t{vertex[i]} * bits, bits), bits, normal, unit);
    if (i == 0) side = sign;
    for (int j = 0; j < 3; ++j) tangent[j] = multiply_add(weights[i], unit[j], tangent[j]);
  }
  return side;
}

/// The mesh's vertex normals interpolated between the corners, or the normal of the face, in world space. A face's
/// normal points out of glTF's counter-clockwise front, also under mirroring matrices.
template <class Real>
SCREE_HD inline void world_normal(const PlacedChunk& at, const format::MatrixRecord& matrix, const uint32_t vertex[3],
                                  const Corners<double>& corners, const Real weights[3], double normal[3]) {
  const double(*m)[4] = matrix.rows;
  if (has_vertex_normals(at)) {
    Real object[3];
    vertex_normal(at, vertex, weights, object);
    const double wide[3] = {object[0], object[1], object[2]};
    // The inverse transpose is the cofactor matrix over the determinant. Only the determinant's sign matters here.
    const double sign = at.transform.mirrored ? -1.0 : 1.0;
    for (int i = 0; i < 3; ++i) {
      const int a = (i + 1) % 3;
      const int b = (i + 2) % 3;
      double cofactors[3];
      const double row_a[3] = {m[a][0], m[a][1], m[a][2]};
      const double row_b[3] = {m[b][0], m[b][1], m[b][2]};
      cross3(row_a, row_b, cofactors);
      normal[i] = sign * dot3(cofactors, wide);
    }
    normalize3(normal);
    if (dot3(normal, normal) > 0) return;
  }
  double edge[2][3];
  for (int n = 0; n < 2; ++n) {
    for (int j = 0; j < 3; ++j) edge[n][j] = dot3(m[j], corners.edge[n]);
    normalize3(edge[n]);
  }
  cross3(edge[0], edge[1], normal);
  if (at.transform.mirrored) {
    for (int i = 0; i < 3; ++i) normal[i] = -normal[i];
  }
  normalize3(normal);
}

/// |n . l| of the face's normal and the sample's ray. In view space, each edge minus its advance along the ray lies in
/// the picture's plane. The product of the two is the area of intersect_plane().
template <bool kOrthographic>
SCREE_HD inline float face_cosine(const ShadeInputs& in, const PlaneHit<float>& m, float x, float y) {
  float edge[2][3];
  float product = abs_of(m.area) * in.aspect;
  for (int n = 0; n < 2; ++n) {
    float* e = edge[n];
    e[0] = kOrthographic ? m.edge_x[n] : multiply_add(x, m.edge_w[n], m.edge_x[n]);
    e[1] = (kOrthographic ? m.edge_y[n] : multiply_add(y, m.edge_w[n], m.edge_y[n])) * in.aspect;
    e[2] = m.edge_w[n] * in.focal;
    const float scale = inverse_root(e[0] * e[0] + e[1] * e[1] + e[2] * e[2]);
    for (int i = 0; i < 3; ++i) e[i] = e[i] * scale;
    product = product * scale;
  }
  const float nx = edge[0][1] * edge[1][2] - edge[0][2] * edge[1][1];
  const float ny = edge[0][2] * edge[1][0] - edge[0][0] * edge[1][2];
  const float nz = edge[0][0] * edge[1][1] - edge[0][1] * edge[1][0];
  float squared = nx * nx + ny * ny + nz * nz;
  if constexpr (!kOrthographic) {
    const float ray_y = y * in.aspect;
    product = product * in.focal;
    squared = squared * (x * x + ray_y * ray_y + in.focal * in.focal);
  }
  return product * inverse_root(squared);
}

/// A normal of object space in view space, not normalised; it points inwards under mirroring matrices. `focal`: as
/// in.focal.
SCREE_HD inline void view_normal(const ShadeInputs& in, const PlacedChunk& at, const float object[3], float focal,
                                 float normal[3]) {
  // The rows of the transform in view space. Their cofactors are the inverse transpose times a factor.
  float rows[3][3];
  float largest = 0;
  for (int j = 0; j < 3; ++j) {
    rows[0][j] = at.transform.x[j];
    rows[1][j] = at.transform.y[j] * in.aspect;
    rows[2][j] = at.transform.w[j] * focal;
    for (int i = 0; i < 3; ++i) largest = max_of(largest, abs_of(rows[i][j]));
  }
  const float scale = reciprocal(largest);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) rows[i][j] = rows[i][j] * scale;
  }
  for (int i = 0; i < 3; ++i) {
    const float* a = rows[(i + 1) % 3];
    const float* b = rows[(i + 2) % 3];
    normal[i] = (a[1] * b[2] - a[2] * b[1]) * object[0] + (a[2] * b[0] - a[0] * b[2]) * object[1] +
                (a[0] * b[1] - a[1] * b[0]) * object[2];
  }
}

/// |n . l| of the vertex normals; NaN if they have no direction.
template <bool kOrthographic>
SCREE_HD inline float vertex_cosine(const ShadeInputs& in, const PlacedChunk& at, const float object[3], float x,
                                    float y) {
  float normal[3];
  view_normal(in, at, object, in.focal, normal);
  const float ray[3] = {kOrthographic ? 0.0f : x, kOrthographic ? 0.0f : y * in.aspect,
                        kOrthographic ? 1.0f : in.focal};
  float product = 0;
  float normal_squared = 0;
  float ray_squared = 0;
  for (int i = 0; i < 3; ++i) {
    product = multiply_add(normal[i], ray[i], product);
    normal_squared = multiply_add(normal[i], normal[i], normal_squared);
    ray_squared = multiply_add(ray[i], ray[i], ray_squared);
  }
  return abs_of(product) * inverse_root(normal_squared) * inverse_root(ray_squared);
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
