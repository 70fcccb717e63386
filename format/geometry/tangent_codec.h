// Tangents of a chunk's vertices, each a sign and a direction around the vertex's decoded normal. Source:
// spec/codecs.md, tangents.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "format/hd.h"
#include "format/result.h"

namespace scree::format {

inline constexpr uint32_t kMinTangentBits = 3;
inline constexpr uint32_t kMaxTangentBits = 16;

/// `bits` (3 to 16) per vertex: the lowest is 1 if the bitangent is -cross(normal, tangent), the others are the
/// direction. A direction differs from the encoded one by at most 2^(3 - bits) radians. Every code is
/// valid, so check_tangents() checks sizes only. Errors kRange, kTruncated, kTrailing.
uint64_t tangent_stream_bytes(uint64_t vertex_count, uint32_t bits);
/// `tangents`: glTF's x y z and sign per vertex, of any length. `normals`: 3 per vertex, as decode_normals() returns
/// them for the chunk. A tangent that is zero, not finite or parallel to the normal gets direction 0. Returns how many
/// there are.
uint64_t encode_tangents(std::span<std::byte> out, std::span<const float> tangents, std::span<const float> normals,
                         uint32_t bits);
/// `out`: 4 per vertex, of unit length, at right angles to the normals.
Result<void> decode_tangents(std::span<float> out, std::span<const float> normals, uint32_t bits,
                             std::span<const std::byte> bytes);
Result<void> check_tangents(uint64_t vertex_count, uint32_t bits, std::span<const std::byte> bytes);

inline namespace SCREE_ISA {

/// Two unit vectors at right angles to the unit vector `normal` and to each other. Source: T. Duff et al., Building an
/// Orthonormal Basis, Revisited, JCGT 2017.
SCREE_HD inline void tangent_axes(const float normal[3], float first[3], float second[3]) {
  const float sign = normal[2] >= 0 ? 1.0f : -1.0f;
  const float a = -1.0f / (sign + normal[2]);
  const float b = normal[0] * normal[1] * a;
  first[0] = 1.0f + sign * normal[0] * normal[0] * a;
  first[1] = sign * b;
  first[2] = -sign * normal[0];
  second[0] = b;
  second[1] = sign + normal[1] * normal[1] * a;
  second[2] = -normal[1];
}

/// The unit tangent of a code at the unit vector `normal`, and 1 or -1, the sign of its bitangent. A direction is a
/// point of the square |x| + |y| = quarter. All operations are correctly rounded, so that CPU and CUDA agree bit for
/// bit.
SCREE_HD inline float decode_tangent(uint32_t code, uint32_t bits, const float normal[3], float out[3]) {
  const int32_t quarter = 1 << (bits - 3u);
  const int32_t place = static_cast<int32_t>(code >> 1u);
  const bool is_back = place >= 2 * quarter;
  const int32_t x = is_back ? place - 3 * quarter : quarter - place;
  const int32_t y = quarter - (x < 0 ? -x : x);
  const float u = static_cast<float>(x);
  const float v = static_cast<float>(is_back ? -y : y);
  const float length = sqrtf(u * u + v * v);
  float first[3];
  float second[3];
  tangent_axes(normal, first, second);
  for (int i = 0; i < 3; ++i) out[i] = (u * first[i] + v * second[i]) / length;
  return (code & 1u) != 0 ? -1.0f : 1.0f;
}

}  // namespace SCREE_ISA
}  // namespace scree::format
