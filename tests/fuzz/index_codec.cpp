// The index stream, and the packed values in it.
#include "format/geometry/index_codec.h"

#include "format/geometry/packed_values.h"
#include "tests/fuzz/input.h"

namespace scree::fuzz {

void index_codec(Bytes bytes) {
  Parameters in(bytes);
  const auto vertex_count = in.take<uint32_t>();
  const format::IndexRange range{in.take<uint32_t>(), in.take<uint8_t>()};
  const uint32_t count = in.take<uint16_t>() % 4096;
  const auto huge_count = in.take<uint64_t>();
  const ExactCopy stream(in.rest());

  std::vector<uint32_t> indices(count);
  const auto decoded = format::decode_indices(indices, vertex_count, range, stream.bytes());
  const auto checked = format::check_indices(count, vertex_count, range, stream.bytes());
  must(bool(decoded) == bool(checked), "decode and check of indices agree");
  if (decoded) {
    for (const uint32_t index : indices) must(index < vertex_count, "an index is below the vertex count");
    std::vector<std::byte> again(format::packed_bytes(count, range.bits));
    format::encode_indices(again, indices, range);
    must(std::ranges::equal(again, stream.bytes()), "indices have one form");
  }
  // Counts that exceed any stream.
  (void)format::checked_packed_bytes("indices", huge_count, range.bits);
  if (huge_count > 8 * (stream.bytes().size() + 1) && range.bits > 0)
    must(!format::check_indices(huge_count, vertex_count, range, stream.bytes()), "too short a stream is refused");
}

}  // namespace scree::fuzz
