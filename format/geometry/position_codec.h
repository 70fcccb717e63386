// The position stream of a chunk: x, y and z codes side by side, vertex by vertex, or three floats per vertex. Source:
// spec/codecs.md, positions.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "format/geometry/quantize.h"
#include "format/layout.h"
#include "format/result.h"

namespace scree::format {

/// The lattice of a mesh's positions, chosen once per mesh from the box of the vertices that its triangles use.
struct MeshLattice {
  int32_t exponent = 0;
  std::array<int64_t, 3> min{};
  std::array<uint8_t, 3> bits{};
  double max_error = 0;  // half a step and half an ulp of the largest coordinate, model units
};

/// The coarsest lattice over the box whose MeshLattice::max_error is at most `max_error` (model units). If `max_error`
/// is 0: the finest lattice with `bits` per axis. Errors kRange: an axis would need more than kMaxPositionBits (the
/// message gives the number).
Result<MeshLattice> choose_lattice(const float lo[3], const float hi[3], uint32_t bits, double max_error);

/// The lattice of a given exponent over the box. Errors kRange as above.
Result<MeshLattice> lattice_of_exponent(const float lo[3], const float hi[3], int32_t exponent);

/// The range of a chunk's codes, relative to MeshLattice::min.
struct PositionRange {
  std::array<uint32_t, 3> min{};
  std::array<uint8_t, 3> bits{};  // all 32: three floats per vertex, 12 bytes, no slack, padded to 16 bytes

  uint32_t stride_bits() const { return uint32_t{bits[0]} + bits[1] + bits[2]; }
  bool is_float32() const { return bits[0] == 32; }
};

/// The lattice and the code range from the records of a file.
MeshLattice lattice_of(const MeshRecord& mesh);
PositionRange position_range_of(const ChunkRecord& chunk);

/// Bytes of the stream: packed_bytes(vertex_count, stride) or 12 * vertex_count rounded up to 16.
uint64_t position_stream_bytes(uint64_t vertex_count, const PositionRange& range);

/// The tightest range of `coordinates` (3 per vertex: x y z lattice offsets from MeshLattice::min).
PositionRange position_range(std::span<const uint32_t> coordinates);

/// Lattice offsets (from lattice.min) of float positions, 3 per vertex; all must be finite and inside the lattice's
/// box. Returns the largest distance along an axis between a position and its decoded value, model units.
double quantize_positions(std::span<uint32_t> out, std::span<const float> positions, const MeshLattice& lattice);

/// Writes exactly position_stream_bytes() bytes; `coordinates` must lie in `range`.
void encode_positions(std::span<std::byte> out, std::span<const uint32_t> coordinates, const PositionRange& range);
/// The same for three floats per vertex: 12 * vertex_count bytes, rounded up to 16.
void encode_positions_float32(std::span<std::byte> out, std::span<const float> positions);

/// Decodes to float model units, 3 per vertex (out.size() / 3 vertices). Safe on any bytes and any range; errors
/// kTruncated, kTrailing, kRange (bits, or a coordinate past the lattice's bits), kFormat (a float that is not finite).
/// Reentrant.
Result<void> decode_positions(std::span<float> out, const MeshLattice& lattice, const PositionRange& range,
                              std::span<const std::byte> bytes);

/// Checks that the range lies on the lattice and that its minimum and the largest code of each axis give finite floats.
/// Errors kRange.
Result<void> check_offsets(const MeshLattice& lattice, const PositionRange& range,
                           const std::array<uint32_t, 3>& largest);

/// The checks of decode_positions() without the output.
Result<void> check_positions(uint64_t vertex_count, const MeshLattice& lattice, const PositionRange& range,
                             std::span<const std::byte> bytes);

}  // namespace scree::format
