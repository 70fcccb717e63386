// Texture coordinates, colours, normals and source triangle numbers of a chunk. Source: spec/codecs.md 6 to 9. Each
// kind has the same functions: range, bytes, encode, decode, and check, which makes the checks of decode without its
// output. Decoders are safe on any bytes and any range and report kTruncated, kTrailing or kRange. All are reentrant
// and allocate only an error's message. Encoders write exactly the stream's bytes; `out` has that size.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "format/bitpack.h"
#include "format/geometry/quantize.h"
#include "format/hd.h"
#include "format/result.h"

namespace scree::format {

/// Texture coordinates lie on a lattice of the chunk: (min + code) * 2^exponent, with u and v codes side by side.
struct UvRange {
  int32_t exponent = 0;
  std::array<int64_t, 2> min{};
  std::array<uint8_t, 2> bits{};  // 0 to 24

  uint32_t stride_bits() const { return uint32_t{bits[0]} + bits[1]; }
};

/// The lattice of a chunk's texture coordinates (2 per vertex, finite): `bits` (1 to 24) over the wider axis. If the
/// step would be above 2^-15, the lattice has more bits (up to 24), because a chunk may span many repeats of its
/// texture. No step is below the spacing of floats of that size.
UvRange choose_uv_range(std::span<const float> uvs, uint32_t bits = 16);
/// Bound of the error per axis: half a step plus half an ulp of the range's largest coordinate.
double uv_error_bound(const UvRange& range);
uint64_t uv_stream_bytes(uint64_t vertex_count, const UvRange& range);
/// `uvs` and `out` of the decoder: 2 floats per vertex.
void encode_uvs(std::span<std::byte> out, std::span<const float> uvs, const UvRange& range);
Result<void> decode_uvs(std::span<float> out, const UvRange& range, std::span<const std::byte> bytes);
Result<void> check_uvs(uint64_t vertex_count, const UvRange& range, std::span<const std::byte> bytes);

/// A chunk's second texture coordinates: `bits` of its record and a header in the stream make the range, and the codes
/// follow as above. open_second_uvs() reads the header and removes it from `bytes`. Errors kTruncated, kReserved.
uint64_t second_uv_stream_bytes(uint64_t vertex_count, const UvRange& range);
void encode_second_uvs(std::span<std::byte> out, std::span<const float> uvs, const UvRange& range);
Result<UvRange> open_second_uvs(const uint8_t bits[2], std::span<const std::byte>& bytes);

/// Linear RGBA8, 4 bytes per vertex, rounded up to 16. Values are clamped to 0 .. 1 and rounded to the nearest 1/255,
/// halves up; NaN becomes 0. `rgba` and `out` of the decoder: 4 floats per vertex.
uint64_t color_stream_bytes(uint64_t vertex_count);
void encode_colors(std::span<std::byte> out, std::span<const float> rgba);
Result<void> decode_colors(std::span<float> out, std::span<const std::byte> bytes);
Result<void> check_colors(uint64_t vertex_count, std::span<const std::byte> bytes);

/// Unit vectors on the octahedron unfolded to a square, `bits` (2 to 16) per axis, side by side. Codes 0 .. 2^bits - 2
/// stand for -1 .. 1, so that the axes are exact. `normals` and `out` of the decoder: 3 floats per vertex. The encoder
/// takes normals of any length; zero and non-finite ones become (0, 0, 1).
uint64_t normal_stream_bytes(uint64_t vertex_count, uint32_t bits);
void encode_normals(std::span<std::byte> out, std::span<const float> normals, uint32_t bits);
Result<void> decode_normals(std::span<float> out, uint32_t bits, std::span<const std::byte> bytes);
Result<void> check_normals(uint64_t vertex_count, uint32_t bits, std::span<const std::byte> bytes);

inline namespace SCREE_ISA {

/// The point of the octahedron |x| + |y| + |z| = half for the square coordinates (u, v), each in -half .. half.
SCREE_HD inline void octahedral_point(int32_t u, int32_t v, int32_t half, int32_t out[3]) {
  const int32_t abs_u = u < 0 ? -u : u;
  const int32_t abs_v = v < 0 ? -v : v;
  const bool below = abs_u + abs_v > half;  // outside the diamond: the lower half, folded outwards
  out[0] = below ? (u < 0 ? abs_v - half : half - abs_v) : u;
  out[1] = below ? (v < 0 ? abs_u - half : half - abs_u) : v;
  out[2] = half - abs_u - abs_v;
}

/// The unit vector of one pair of codes, each at most 2^bits - 2. The fold uses integers, the rest one square root and
/// three divisions, all correctly rounded, so that CPU and CUDA agree bit for bit.
SCREE_HD inline void decode_octahedral(uint32_t code_u, uint32_t code_v, uint32_t bits, float out[3]) {
  const int32_t half = (1 << (bits - 1u)) - 1;
  int32_t point[3];
  octahedral_point(static_cast<int32_t>(code_u) - half, static_cast<int32_t>(code_v) - half, half, point);
  const float x = static_cast<float>(point[0]);
  const float y = static_cast<float>(point[1]);
  const float z = static_cast<float>(point[2]);
  const float length = sqrtf(x * x + y * y + z * z);
  out[0] = x / length;
  out[1] = y / length;
  out[2] = z / length;
}

}  // namespace SCREE_ISA

/// Each triangle's number in the source primitive is min + code.
struct SourceIdRange {
  uint64_t min = 0;
  uint32_t bits = 0;  // 0 to 32
};
/// The tightest range; {0, 0} for no ids. The ids of a chunk must lie within 2^32 of each other.
SourceIdRange source_id_range(std::span<const uint64_t> ids);
/// `ids` and `out` of the decoder: one per triangle. A stream has packed_bytes(triangle_count, range.bits) bytes.
void encode_source_ids(std::span<std::byte> out, std::span<const uint64_t> ids, const SourceIdRange& range);
Result<void> decode_source_ids(std::span<uint64_t> out, const SourceIdRange& range, std::span<const std::byte> bytes);
Result<void> check_source_ids(uint64_t triangle_count, const SourceIdRange& range, std::span<const std::byte> bytes);

}  // namespace scree::format
