// Where the ray of a sample hits a texture, and how large the sample is there.
#pragma once

#include <cmath>
#include <cstddef>

#include "kernels/shade/locate.h"
#include "kernels/shade/shade_inputs.h"
#include "kernels/shade/texture.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

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

}  // namespace SCREE_ISA
}  // namespace scree::kernels
