// Texture coordinates, colours, normals and source triangle numbers of a chunk. Source: spec/codecs.md, attributes.
// Every family: range, bytes, encode, decode; decoders are safe on any bytes and any range and report kTruncated,
// kTrailing or kRange; all are reentrant and allocate nothing.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "format/bitpack.h"
#include "format/hd.h"
#include "format/quantize.h"
#include "format/result.h"

namespace scree::format {

/// Texture coordinates lie on a lattice of the chunk: (min + code) * 2^exponent, u and v codes side by side.
struct UvRange {
  int32_t exponent = 0;
  std::array<int64_t, 2> min{};
  std::array<uint8_t, 2> bits{};  // 0 to 24

  uint32_t stride_bits() const { return uint32_t{bits[0]} + bits[1]; }
};

/// The lattice of a chunk's texture coordinates (2 a vertex, finite): 16 bits over the wider axis, and more (up to 24) where
/// the step would pass 2^-15, so that a chunk that spans many repeats keeps its texels apart.
UvRange choose_uv_range(std::span<const float> uvs, uint32_t bits = 16);
uint64_t uv_stream_bytes(uint64_t vertex_count, const UvRange& range);
void encode_uvs(std::span<std::byte> out, std::span<const float> uvs, const UvRange& range);
Result<void> decode_uvs(std::span<float> out, const UvRange& range, std::span<const std::byte> bytes);

/// Linear RGBA8, 4 bytes a vertex, rounded up to 16.
uint64_t color_stream_bytes(uint64_t vertex_count);
void encode_colors(std::span<std::byte> out, std::span<const float> rgba);
Result<void> decode_colors(std::span<float> out, std::span<const std::byte> bytes);

/// Unit vectors on the octahedron unfolded to a square, `bits` (2 to 16) an axis, side by side: codes 0 .. 2^bits - 2 for
/// -1 .. 1, so that the axes are exact.
uint64_t normal_stream_bytes(uint64_t vertex_count, uint32_t bits);
void encode_normals(std::span<std::byte> out, std::span<const float> normals, uint32_t bits);
Result<void> decode_normals(std::span<float> out, uint32_t bits, std::span<const std::byte> bytes);

/// The unit vector of one pair of codes.
SCREE_HD void decode_octahedral(uint32_t code_u, uint32_t code_v, uint32_t bits, float out[3]);

/// Each triangle's number in the source primitive: min + code.
struct SourceIdRange {
  uint64_t min = 0;
  uint32_t bits = 0;  // 0 to 32
};
SourceIdRange source_id_range(std::span<const uint64_t> ids);
void encode_source_ids(std::span<std::byte> out, std::span<const uint64_t> ids, const SourceIdRange& range);
Result<void> decode_source_ids(std::span<uint64_t> out, const SourceIdRange& range, std::span<const std::byte> bytes);

}  // namespace scree::format
