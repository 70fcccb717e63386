// The colour of a sample. Source: spec/rasterization.md, resolve.
#pragma once

#include <cmath>
#include <cstddef>

#include "format/geometry/attribute_codec.h"
#include "format/geometry/tangent_codec.h"
#include "kernels/shade/locate.h"
#include "kernels/shade/srgb.h"
#include "kernels/shade/texture.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

inline constexpr float kAmbient = 0.2f;  // the share of the camera's light on a surface that is seen edge-on

SCREE_HD inline float srgb_to_linear(float value) {
  return value <= 0.04045f ? value / 12.92f : std::pow((value + 0.055f) / 1.055f, 2.4f);
}

SCREE_HD inline uint64_t mix_bits(uint64_t value) {
  value += 0x9e3779b97f4a7c15u;
  value = (value ^ (value >> 30)) * 0xbf58476d1ce4e5b9u;
  value = (value ^ (value >> 27)) * 0x94d049bb133111ebu;
  return value ^ (value >> 31);
}

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

/// The nearest and the farthest depth code of a picture. Show::kDepth spreads its greys over this range.
struct DepthRange {
  uint32_t nearest = kFarthestDepthCode;
  uint32_t farthest = 0;
};

/// Converts view space to world space, for light.
struct LightFrame {
  float axes[3][3];  // world directions of view space: x right, y down, z away
  float unit;        // view space's units (ShadeInputs) per world unit
  float far_plane;   // orthographic: its distance in view space's units
  Lighting lighting;
};

/// A SunShadow::Map as shading reads it.
struct SunMap {
  const uint64_t* samples = nullptr;
  int32_t width = 0;
  int32_t height = 0;
  // From view space to samples from the map's top left corner, and to levels: 2^28 on the map's near plane, 0 on its
  // far one.
  float rows[3][4] = {};
  float half_sample = 0;  // half the side of a sample, in levels
  // Levels per sample by which a plane rises along a row whose product with its normal equals that of the third row.
  float steepness = 0;
};

/// A SunShadow as shading reads it.
struct SunMaps {
  uint32_t light = ~0u;
  uint32_t count = 0;  // 0: no light casts shadows
  SunMap maps[kMostSunMaps];
};

/// The input of all shading of one picture, for every Show.
struct ShadeInputs {
  SceneView scene;
  FrameView view;
  ShadeOptions options;
  const Transform* transforms;  // by instance; null if the team makes its own (Team::kMakesTransforms)
  const SrgbTables* srgb;
  const DepthRange* depth_range;  // for Show::kDepth only
  // Scales view space to sub-pixels on all axes: x is unchanged, y times `aspect`, the depth row times `focal`.
  float aspect;
  float focal;
  LightFrame light;  // for Show::kSurface only
  SunMaps sun;       // likewise
};

/// `unit`: LightFrame::unit of the picture's view.
inline SunMap make_sun_map(const SunShadow::Map& sun, const View& view, double unit) {
  const FrameView map = make_frame_view(sun.view);
  constexpr double kLevels = 1u << kDepthBits;
  SunMap out;
  out.samples = sun.samples;
  out.width = map.width;
  out.height = map.height;
  const double* const world[3] = {map.row_x, map.row_y, map.row_w};
  const double scale[3] = {1.0 / kSubpixels, 1.0 / kSubpixels, kLevels};
  const double start[3] = {0.5 * map.width, 0.5 * map.height, kLevels * map.offset_w};
  for (int r = 0; r < 3; ++r) {
    double eye = start[r];
    for (int i = 0; i < 3; ++i) eye += scale[r] * world[r][i] * (view.eye[i] - map.eye[i]);
    const double* const axes[3] = {view.right, view.up, view.forward};
    for (int a = 0; a < 3; ++a) {
      const double along = world[r][0] * axes[a][0] + world[r][1] * axes[a][1] + world[r][2] * axes[a][2];
      out.rows[r][a] = static_cast<float>((a == 1 ? -1.0 : 1.0) * scale[r] * along / unit);  // view space's y is down
    }
    out.rows[r][3] = static_cast<float>(eye);
  }
  const double sample = 2.0 * sun.view.half_width / sun.view.width;  // world units
  const double levels = kLevels / (sun.view.z_far - sun.view.z_near) * sample;
  out.half_sample = static_cast<float>(0.5 * levels);
  out.steepness = static_cast<float>(levels * levels);
  return out;
}

inline ShadeInputs make_shade_inputs(const SceneView& scene, const View& view, const ShadeOptions& options,
                                     const Transform* transforms, const SrgbTables* srgb,
                                     const DepthRange* depth_range) {
  ShadeInputs out{scene, make_frame_view(view), options, transforms, srgb, depth_range, 1.0f, 1.0f, {}, {}};
  const double per_x = static_cast<double>(out.view.half_width) / view.half_width;
  const double per_y = static_cast<double>(out.view.half_height) / view.half_height;
  out.aspect = static_cast<float>(per_x / per_y);
  out.focal = static_cast<float>(view.orthographic ? per_x * (view.z_far - view.z_near) : per_x);
  for (int i = 0; i < 3; ++i) {
    out.light.axes[0][i] = static_cast<float>(view.right[i]);
    out.light.axes[1][i] = static_cast<float>(-view.up[i]);
    out.light.axes[2][i] = static_cast<float>(view.forward[i]);
  }
  const double unit = view.orthographic ? per_x : per_x / view.z_near;
  out.light.unit = static_cast<float>(unit);
  out.light.far_plane = static_cast<float>(per_x * view.z_far);
  out.light.lighting = lighting_of(scene, options);
  if (options.sun == nullptr) return out;
  out.sun.light = options.sun->light;
  out.sun.count = options.sun->map_count;
  for (uint32_t i = 0; i < out.sun.count; ++i) out.sun.maps[i] = make_sun_map(options.sun->maps[i], view, unit);
  return out;
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

/// `angle`: radians.
SCREE_HD inline void cosine_sine(double angle, double& cosine, double& sine) {
#if defined(__CUDA_ARCH__)
  sincospi(angle * 0.31830988618379067154, &sine, &cosine);  // cos() would need stack memory for large angles
#else
  cosine = std::cos(angle);
  sine = std::sin(angle);
#endif
}

/// A point on a texture.
struct TexturePlace {
  TexturePoint u;
  TexturePoint v;
  float footprint;  // squared, texels of level 0; huge if a neighbouring sample's ray misses the plane
  bool exact;       // single precision was enough
};

/// A triangle's texture coordinates (u, v): corner 0, and the edges from it to corners 1 and 2.
template <class Real>
struct TextureCorners {
  TexturePoint first[2];
  Real edge[2][2];
  int64_t stored[2];  // corner 0 before KHR_texture_transform, times 2^exponent
  int32_t exponent;
};

/// Offset, scale and rotation of KHR_texture_transform: five floats of a MaterialRecord or SurfaceTexture.
template <class Record>
SCREE_HD inline const float* uv_transform(const Record& record) {
  static_assert(offsetof(Record, uv_scale) == offsetof(Record, uv_offset) + 8 &&
                offsetof(Record, uv_rotation) == offsetof(Record, uv_offset) + 16);
  return reinterpret_cast<const float*>(&record) + offsetof(Record, uv_offset) / sizeof(float);
}

/// Whether a uv_transform() is the identity.
SCREE_HD inline bool is_identity(const float* transform) {
  return transform[0] == 0 && transform[1] == 0 && transform[2] == 1 && transform[3] == 1 && transform[4] == 0;
}

/// A uv_transform() without its offset: scale, then rotation. Not inlined, because few textures have one.
struct UvMatrix {
  double rows[2][2];
};
[[gnu::noinline]] SCREE_HD inline UvMatrix uv_matrix(const float* transform) {
  const double scale[2] = {static_cast<double>(transform[2]), static_cast<double>(transform[3])};
  double cosine = 1;
  double sine = 0;
  if (transform[4] != 0) cosine_sine(static_cast<double>(transform[4]), cosine, sine);
  return {{{cosine * scale[0], sine * scale[1]}, {-sine * scale[0], cosine * scale[1]}}};
}

/// 2^exponent, for an exponent of a lattice.
SCREE_HD inline double power_of_two(int32_t exponent, double) {
  return format::exp2i(exponent);
}
SCREE_HD inline float power_of_two(int32_t exponent, float) {
  if (exponent >= -126) return bits_float(static_cast<uint32_t>(exponent + 127) << 23);
  return exponent > -150 ? bits_float(1u << (exponent + 149)) : 0.0f;  // a subnormal number
}

/// The codes of a chunk's first or second texture coordinates, and their range.
struct UvCodes {
  const std::byte* stream;
  const uint8_t* bits;
  const int64_t* min;
  int32_t exponent;
};

SCREE_HD inline UvCodes uv_codes(const PlacedChunk& at, bool is_second) {
  const format::ChunkRecord& chunk = at.chunk;
  const format::ChunkStreams streams = streams_of(at.mesh, chunk);
  const std::byte* const payload = at.page + chunk.offset;
  if (!is_second) return {payload + streams.uvs.offset, chunk.uv_bits, chunk.uv_min, chunk.uv_exponent};
  const auto& header = *reinterpret_cast<const format::SecondUvHeader*>(payload + streams.second_uvs.offset);
  return {payload + streams.second_uvs.offset + sizeof header, chunk.second_uv_bits, header.min, header.exponent};
}

/// `transform`: uv_transform() of the record, or null to leave the coordinates as they are. `is_second`: of the second
/// texture coordinates, which the mesh then has.
template <class Real>
SCREE_HD inline TextureCorners<Real> texture_corners(const PlacedChunk& at, const uint32_t vertex[3],
                                                     const float* transform, bool is_second) {
  const UvCodes codes_of = uv_codes(at, is_second);
  const std::byte* stream = codes_of.stream;
  const uint32_t stride = uint32_t{codes_of.bits[0]} + codes_of.bits[1];
  const Real step = power_of_two(codes_of.exponent, Real{});
  TextureCorners<Real> corners;
  corners.exponent = codes_of.exponent;
  Real(*const edge)[2] = corners.edge;
  uint32_t codes[2];
  for (int n = 0; n < 3; ++n) {
    // Two codes take at most 48 bits.
    uint64_t run = stride == 0 ? 0u : unpack_run(stream, uint64_t{vertex[n]} * stride, stride);
    for (int c = 0; c < 2; ++c) {
      const uint32_t code = low_bits(run, codes_of.bits[c]);
      run >>= codes_of.bits[c];
      if (n == 0) {
        codes[c] = code;
        corners.stored[c] = wrapping_add(codes_of.min[c], static_cast<int64_t>(code));
      } else {
        edge[n - 1][c] = static_cast<Real>(static_cast<int32_t>(code) - static_cast<int32_t>(codes[c])) * step;
      }
    }
  }
  if (transform == nullptr || is_identity(transform)) [[likely]] {
    for (int c = 0; c < 2; ++c) corners.first[c] = texture_point(corners.stored[c], corners.exponent);
    return corners;
  }
  // The map is affine, so it can be applied to the corner and the edges.
  const UvMatrix matrix = uv_matrix(transform);
  double first[2];
  for (int c = 0; c < 2; ++c) first[c] = static_cast<double>(corners.stored[c]) * format::exp2i(corners.exponent);
  for (int c = 0; c < 2; ++c)
    corners.first[c] =
        texture_point(matrix.rows[c][0] * first[0] + matrix.rows[c][1] * first[1] + static_cast<double>(transform[c]));
  for (int n = 0; n < 2; ++n) {
    const Real u = edge[n][0];
    const Real v = edge[n][1];
    for (int c = 0; c < 2; ++c)
      edge[n][c] = static_cast<Real>(matrix.rows[c][0]) * u + static_cast<Real>(matrix.rows[c][1]) * v;
  }
  return corners;
}

/// The point where the ray hits the triangle's plane, in texture coordinates, and how far from it the rays of the
/// samples to the right and below hit.
template <bool kOrthographic, class Real>
SCREE_HD inline TexturePlace texture_place(const ShadeInputs& in, const TextureCorners<Real>& corners, float width,
                                           float height, const PlaneHit<Real>& m, const Real weights[3]) {
  const Real(*const edge)[2] = corners.edge;
  TexturePlace place{};
  place.u = corners.first[0] + texture_point(weights[1] * edge[0][0] + weights[2] * edge[1][0]);
  place.v = corners.first[1] + texture_point(weights[1] * edge[0][1] + weights[2] * edge[1][1]);

  // One sample to the side, corner 0 moves by -256 w and the edges by -256 times their w. This is the resulting change
  // of areas and weights, written so that no large values cancel.
  const Real inverse = reciprocal(m.area);
  const Real share[2] = {(m.edge_x[1] * m.y - m.edge_y[1] * m.x) * inverse,
                         (m.x * m.edge_y[0] - m.y * m.edge_x[0]) * inverse};
  for (int side = 0; side < 2; ++side) {
    const Real* along = side == 0 ? m.edge_y : m.edge_x;
    const Real start = side == 0 ? m.y : m.x;
    const Real sign = static_cast<Real>(side == 0 ? -kSubpixels : kSubpixels);
    const Real g0 = kOrthographic ? Real{0} : m.edge_w[0];
    const Real g1 = kOrthographic ? Real{0} : m.edge_w[1];
    const Real area = sign * (g0 * along[1] - g1 * along[0]);
    const Real e1 = sign * (g1 * start - m.w * along[1]);
    const Real e2 = sign * (m.w * along[0] - g0 * start);
    const Real moved = m.area + area;
    if ((moved > 0) != (m.area > 0)) {
      place.footprint = 1e30f;
      continue;
    }
    const Real scale = reciprocal(moved);
    const Real t1 = (e1 - share[0] * area) * scale;
    const Real t2 = (e2 - share[1] * area) * scale;
    const float du = static_cast<float>(t1 * edge[0][0] + t2 * edge[1][0]) * width;
    const float dv = static_cast<float>(t1 * edge[0][1] + t2 * edge[1][1]) * height;
    place.footprint = max_of(place.footprint, min_of(du * du + dv * dv, 1e30f));
  }
  // Single-precision weights have an error of about 2^-22: of the triangle's extent in texels and, where corners are
  // far more distant than the visible point, of their distance in pixels.
  Real spread{0};
  Real largest_length = static_cast<Real>(max_of(in.view.half_width, in.view.half_height));
  for (int n = 0; n < 2; ++n) {
    spread = max_of(spread, max_of(abs_of(edge[n][0]) * width, abs_of(edge[n][1]) * height));
    largest_length = max_of(largest_length, max_of(abs_of(m.edge_x[n]), abs_of(m.edge_y[n])));
  }
  const Real w = kOrthographic ? m.w : m.w + weights[1] * m.edge_w[0] + weights[2] * m.edge_w[1];
  place.exact = spread < Real{1 << 16} && largest_length < static_cast<Real>(1 << 23) * w;
  return place;
}

/// Returns the transform of a sample's instance: from the frame's array.
template <bool kMakes>
struct TransformSource {
  SCREE_HD const Transform& get(const ShadeInputs& in, uint64_t instance) { return in.transforms[instance]; }
};

/// Without an array, the transform is made whenever the instance changes.
template <>
struct TransformSource<true> {
  Transform own;
  uint64_t own_instance = ~uint64_t{0};

  SCREE_HD const Transform& get(const ShadeInputs& in, uint64_t instance) {
    if (in.transforms != nullptr) return in.transforms[instance];
    if (own_instance != instance) {
      const format::InstanceRecord& record = in.scene.instances[instance];
      const format::MeshRecord& mesh = in.scene.meshes[record.mesh];
      own = make_transform(in.view, in.scene.matrices[record.matrix], mesh.lattice_exponent,
                           mesh.position_encoding == format::PositionEncoding::kFloat32);
      own_instance = instance;
    }
    return own;
  }
};

/// The state that a lane keeps from sample to sample.
template <class Team, class Shader>
struct ShadeState {
  Location at;
  TransformSource<Team::kMakesTransforms> source;
  typename Shader::Texels::Lane texels;
};

/// Show::kSurface: the light of a sample (shade/surface.h).
template <bool kOrthographic, class Shader>
SCREE_HD void shade_surface(const Shader& shader, const PlacedChunk& at, const uint32_t vertex[3],
                            const PlaneHit<float>& m, const Corners<float>& corners, const float weights[3], float x,
                            float y, typename Shader::Texels::Lane& lane, float rgb[3]);

/// The colour of a sample. There is a type for each kind of picture, camera, chunks and textures, so that no kind takes
/// the registers of another.
template <bool kOrthographic, Show kShow, ChunkKinds kKinds = ChunkKinds::kMixed, class TexelSource = SceneTexels>
struct Shader {
  using Texels = TexelSource;

  ShadeInputs in;
  Texels texels;

  /// Computes sample (x, y) of the picture in linear light. All lanes of a team must call it; `wanted`: whether the
  /// lane has a sample that is not background.
  template <class Team>
  SCREE_HD void operator()(Team team, bool wanted, uint64_t sample, int32_t x, int32_t y,
                           ShadeState<Team, Shader>& state, float rgb[3]) const {
    const uint64_t id = sample_id(sample);
    // Debug views hold values, not light: they are converted from sRGB to linear here, so that the picture's 8-bit code
    // is the value.
    if constexpr (kShow == Show::kTriangle) {
      random_color(id, rgb);
    } else if constexpr (kShow == Show::kDepth) {
      rgb[0] = rgb[1] = rgb[2] = srgb_to_linear(depth_grey(sample_depth_code(sample)));
    } else {
      locate(team, in.scene, id, wanted, state.at);
      if (!wanted) return;
      if constexpr (kShow == Show::kMesh) {
        random_color(in.scene.instances[state.at.instance].mesh, rgb);
      } else {
        const uint32_t triangle = static_cast<uint32_t>(id - state.at.first_id);
        const PlacedChunk at =
            place_chunk<kKinds>(in.scene, state.at.chunk, triangle, state.source.get(in, state.at.instance));
        uint32_t vertex[3];
        fetch_triangle(at.reader, triangle, vertex);
        if constexpr (kShow == Show::kCluster) {
          // An indexed chunk counts as one cluster.
          random_color(state.at.chunk << 32 | (at.reader.clustered ? at.reader.cluster.first_triangle : 0u), rgb);
        } else if constexpr (kShow == Show::kStage) {
          const int stage = stage_of<kOrthographic>(at, vertex, in.view, x, y);
          for (int c = 0; c < 3; ++c) rgb[c] = stage == c + 1 ? 1.0f : 0.05f;
        } else {
          const float center_x = static_cast<float>(x * kSubpixels + kSubpixels / 2) - in.view.half_width;
          const float center_y = static_cast<float>(y * kSubpixels + kSubpixels / 2) - in.view.half_height;
          shade(at, state.at.instance, vertex, center_x, center_y, state.texels, rgb);
        }
      }
    }
  }

  /// `corners`: from texture_corners(); `transform` and `is_second` are its.
  SCREE_HD TexturePlace find_place(const PlacedChunk& at, const TextureCorners<float>& corners, const float* transform,
                                   bool is_second, float width, float height, const PlaneHit<float>& m,
                                   const float weights[3], float x, float y) const {
    const TexturePlace place = texture_place<kOrthographic>(in, corners, width, height, m, weights);
    if (place.exact) [[likely]]
      return place;
    return place_alone<double>(in, chunk_number(at), at.triangle, &at.transform, transform, is_second, width, height, x,
                               y);
  }

  /// find_place() for callers that no longer have the corners.
  SCREE_HD TexturePlace find_place_again(const PlacedChunk& at, const float* transform, bool is_second, float width,
                                         float height, float x, float y) const {
    const TexturePlace place =
        place_alone<float>(in, chunk_number(at), at.triangle, &at.transform, transform, is_second, width, height, x, y);
    if (place.exact) [[likely]]
      return place;
    return place_alone<double>(in, chunk_number(at), at.triangle, &at.transform, transform, is_second, width, height, x,
                               y);
  }

  SCREE_HD uint64_t chunk_number(const PlacedChunk& at) const {
    return static_cast<uint64_t>(&at.chunk - in.scene.chunks);
  }

  /// Rarely called, and takes many registers. A call that takes only values, so that on a GPU the caller's values stay
  /// in registers. Only surfaces have second texture coordinates, so other shaders have no code for them.
  template <class Real>
  [[gnu::noinline]] SCREE_HD static TexturePlace place_alone(const ShadeInputs& in, uint64_t chunk, uint32_t triangle,
                                                             const Transform* transform, const float* transform_uv,
                                                             bool is_second, float width, float height, float x,
                                                             float y) {
    const PlacedChunk at = place_chunk<kKinds>(in.scene, chunk, triangle, *transform);
    uint32_t vertex[3];
    fetch_triangle(at.reader, triangle, vertex);
    const PlaneHit<Real> m = intersect_plane<kOrthographic>(at.transform, fetch_corners<Real>(at.reader, vertex),
                                                            static_cast<Real>(x), static_cast<Real>(y));
    Real weights[3];
    hit_weights(m, weights);
    const auto corners = texture_corners<Real>(at, vertex, transform_uv, kShow == Show::kSurface && is_second);
    return texture_place<kOrthographic>(in, corners, width, height, m, weights);
  }

  /// Multiplies `rgb` by the colours of the vertices.
  SCREE_HD static void vertex_color(const PlacedChunk& at, const uint32_t vertex[3], const float weights[3],
                                    float rgb[3]) {
    const std::byte* stream = at.page + at.chunk.offset + streams_of(at.mesh, at.chunk).colors.offset;
    float color[3] = {0, 0, 0};
    for (int i = 0; i < 3; ++i) {
      const uint8_t* texel = reinterpret_cast<const uint8_t*>(stream) + 4 * uint64_t{vertex[i]};
      for (int c = 0; c < 3; ++c) color[c] = multiply_add(weights[i], static_cast<float>(texel[c]), color[c]);
    }
    for (int c = 0; c < 3; ++c) rgb[c] = rgb[c] * (color[c] * (1.0f / 255.0f));
  }

 private:
  SCREE_HD void shade(const PlacedChunk& at, uint64_t instance, const uint32_t vertex[3], float x, float y,
                      [[maybe_unused]] typename Texels::Lane& lane, float rgb[3]) const {
    const Corners<float> corners = fetch_corners<float>(at.reader, vertex);
    const PlaneHit<float> m = intersect_plane<kOrthographic>(at.transform, corners, x, y);
    float weights[3];
    hit_weights(m, weights);
    if constexpr (kShow == Show::kNormal) {
      double normal[3];
      world_normal(at, in.scene.matrices[in.scene.instances[instance].matrix], vertex,
                   fetch_corners<double>(at.reader, vertex), weights, normal);
      for (int c = 0; c < 3; ++c) rgb[c] = srgb_to_linear(static_cast<float>(0.5 + 0.5 * normal[c]));
    } else if constexpr (kShow == Show::kUv) {
      rgb[0] = rgb[1] = rgb[2] = 0;
      if ((at.mesh.attributes & format::kHasUv) == 0) return;
      const auto uv = texture_corners<float>(at, vertex, nullptr, false);
      const TexturePlace place = find_place(at, uv, nullptr, false, 1.0f, 1.0f, m, weights, x, y);
      rgb[0] = srgb_to_linear(static_cast<float>(static_cast<uint32_t>(place.u)) * (1.0f / 4294967296.0f));
      rgb[1] = srgb_to_linear(static_cast<float>(static_cast<uint32_t>(place.v)) * (1.0f / 4294967296.0f));
    } else if constexpr (kShow == Show::kSurface) {
      shade_surface<kOrthographic>(*this, at, vertex, m, corners, weights, x, y, lane, rgb);
    } else if constexpr (kShow == Show::kTexture || kShow == Show::kColor) {
      const format::MaterialRecord* material =
          at.mesh.material != format::kNone ? in.scene.materials + at.mesh.material : nullptr;
      const bool unlit = material != nullptr && (material->flags & format::kMaterialUnlit) != 0;
      const float light = in.options.light && !unlit ? diffuse_light(at, vertex, m, weights, x, y) : 1.0f;
      rgb[0] = rgb[1] = rgb[2] = 1.0f;
      if (material != nullptr) {
        if constexpr (kShow == Show::kTexture) {
          if ((at.mesh.attributes & format::kHasUv) != 0 && material->texture != format::kNone) {
            const TextureView& texture = in.scene.textures[material->texture];
            if (texture.level_count != 0) {
              const float* const transform = uv_transform(*material);
              const TexturePlace place =
                  find_place(at, texture_corners<float>(at, vertex, transform, false), transform, false,
                             static_cast<float>(texture.width), static_cast<float>(texture.height), m, weights, x, y);
              sample_texture(texels, lane, texture, in.srgb->linear, place.u, place.v, place.footprint, rgb);
            }
          }
        }
        for (int c = 0; c < 3; ++c) rgb[c] = rgb[c] * material->base_color[c];
      }
      if ((at.mesh.attributes & format::kHasColor) != 0) vertex_color(at, vertex, weights, rgb);
      for (int c = 0; c < 3; ++c) rgb[c] = rgb[c] * light;
    }
  }

  SCREE_HD float diffuse_light(const PlacedChunk& at, const uint32_t vertex[3], const PlaneHit<float>& m,
                               const float weights[3], float x, float y) const {
    float cosine = -1.0f;
    if (has_vertex_normals(at)) {
      float normal[3];
      vertex_normal(at, vertex, weights, normal);
      cosine = vertex_cosine<kOrthographic>(in, at, normal, x, y);
    }
    if (!(cosine >= 0)) cosine = face_cosine<kOrthographic>(in, m, x, y);
    return kAmbient + (1.0f - kAmbient) * (cosine >= 0 ? min_of(cosine, 1.0f) : 0.0f);
  }

  SCREE_HD static void random_color(uint64_t number, float rgb[3]) {
    const uint64_t bits = mix_bits(number);
    for (int c = 0; c < 3; ++c) {
      rgb[c] = srgb_to_linear(0.2f + 0.8f * static_cast<float>((bits >> (8 * c)) & 255u) * (1.0f / 255.0f));
    }
  }

  /// White for the nearest sample of the picture to nearly black for the farthest; perspective codes are logarithmic.
  SCREE_HD float depth_grey(uint32_t code) const {
    const float range = static_cast<float>(in.depth_range->farthest - in.depth_range->nearest);
    const float place = range > 0 ? static_cast<float>(code - in.depth_range->nearest) / range : 0.0f;
    return 1.0f - 0.95f * min_of(max_of(place, 0.0f), 1.0f);
  }
};

/// Calls visit(shader) with the shader of the picture. `kApart`: with the one built for the scene's kind of chunks;
/// otherwise one shader handles all kinds.
template <bool kApart, bool kOrthographic, Show kShow, class Texels, class Visit>
inline void visit_kinds(const ShadeInputs& in, const Texels& texels, const Visit& visit) {
  if constexpr (kApart) {
    switch (in.scene.chunk_kinds) {
      case ChunkKinds::kMixed:
        break;
      case ChunkKinds::kFloat32:
        return visit(Shader<kOrthographic, kShow, ChunkKinds::kFloat32, Texels>{in, texels});
      case ChunkKinds::kPacked:
        return visit(Shader<kOrthographic, kShow, ChunkKinds::kPacked, Texels>{in, texels});
      case ChunkKinds::kClustered:
        return visit(Shader<kOrthographic, kShow, ChunkKinds::kClustered, Texels>{in, texels});
    }
  }
  visit(Shader<kOrthographic, kShow, ChunkKinds::kMixed, Texels>{in, texels});
}

/// Calls visit(shader) with the shader of the camera and the kind of picture. `kApart`: as for visit_kinds(). A scene
/// without textures uses a shader without texture code.
template <bool kApart, class Visit>
inline void visit_shader(const ShadeInputs& in, const Visit& visit) {
  const SceneTexels texels{in.scene.blocks, in.scene.pager != nullptr ? in.scene.pager->pages() : TexelPages{}};
  const auto with_kinds = [&]<bool kOrthographic, Show kShow>() {
    visit_kinds<kApart, kOrthographic, kShow>(in, texels, visit);
  };
  // One shader for all kinds of chunks, because light takes most of its time.
  const auto with_surfaces = [&]<bool kOrthographic>() { visit(Shader<kOrthographic, Show::kSurface>{in, texels}); };
  const auto with_camera = [&]<bool kOrthographic>() {
    switch (in.options.show) {
      case Show::kSurface:
        return with_surfaces.template operator()<kOrthographic>();
      case Show::kTexture:
        if (shades_surfaces(in.scene, in.options)) return with_surfaces.template operator()<kOrthographic>();
        if (in.scene.texture_count == 0) return with_kinds.template operator()<kOrthographic, Show::kColor>();
        return with_kinds.template operator()<kOrthographic, Show::kTexture>();
      case Show::kColor:
        return with_kinds.template operator()<kOrthographic, Show::kColor>();
      case Show::kUv:
        return visit(Shader<kOrthographic, Show::kUv>{in, {in.scene.blocks}});
      case Show::kNormal:
        return visit(Shader<kOrthographic, Show::kNormal>{in, {in.scene.blocks}});
      case Show::kTriangle:
        return visit(Shader<kOrthographic, Show::kTriangle>{in, {in.scene.blocks}});
      case Show::kCluster:
        return visit(Shader<kOrthographic, Show::kCluster>{in, {in.scene.blocks}});
      case Show::kMesh:
        return visit(Shader<kOrthographic, Show::kMesh>{in, {in.scene.blocks}});
      case Show::kStage:
        return visit(Shader<kOrthographic, Show::kStage>{in, {in.scene.blocks}});
      case Show::kDepth:
        return visit(Shader<kOrthographic, Show::kDepth>{in, {in.scene.blocks}});
    }
  };
  in.view.orthographic ? with_camera.template operator()<true>() : with_camera.template operator()<false>();
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
