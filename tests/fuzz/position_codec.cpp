// The position stream.
#include "format/geometry/position_codec.h"

#include <cmath>

#include "tests/fuzz/input.h"

namespace scree::fuzz {

void position_codec(Bytes bytes) {
  Parameters in(bytes);
  format::MeshLattice lattice{.exponent = in.take<int16_t>()};
  for (int64_t& min : lattice.min) min = in.take<int64_t>();
  for (uint8_t& bits : lattice.bits) bits = in.take<uint8_t>();
  format::PositionRange range;
  for (uint32_t& min : range.min) min = in.take<uint32_t>();
  for (uint8_t& bits : range.bits) bits = in.take<uint8_t>();
  const uint32_t count = in.take<uint16_t>() % 2048;
  const auto huge_count = in.take<uint64_t>();
  const ExactCopy stream(in.rest());

  std::vector<float> positions(3 * size_t{count});
  const auto decoded = format::decode_positions(positions, lattice, range, stream.bytes());
  const auto checked = format::check_positions(count, lattice, range, stream.bytes());
  must(bool(decoded) == bool(checked), "decode and check of positions agree");
  if (decoded)
    for (const float value : positions) must(std::isfinite(value), "a position is finite");
  if (huge_count > 8 * (stream.bytes().size() + 1) && range.stride_bits() > 0)
    must(!format::check_positions(huge_count, lattice, range, stream.bytes()), "too short a stream is refused");
}

}  // namespace scree::fuzz
