#include "format/geometry/index_codec.h"

#include <algorithm>
#include <string>

#include "format/geometry/code_scan.h"
#include "format/geometry/packed_values.h"
#include "format/processor.h"

namespace scree::format {
namespace {

Result<void> check_size(uint64_t count, IndexRange range, std::span<const std::byte> bytes) {
  if (range.bits > kMaxPackedBits) {
    return Error{ErrorCode::kRange, "indices: " + std::to_string(range.bits) + " bits, expected at most 32"};
  }
  const auto size = SCREE_TRY(checked_packed_bytes("indices", count, range.bits));
  return check_stream("indices", count * range.bits, size, bytes);
}

Result<void> check_largest(uint64_t largest, uint32_t vertex_count) {
  if (largest < vertex_count) return {};
  return Error{ErrorCode::kRange,
               "index " + std::to_string(largest) + ", but " + std::to_string(vertex_count) + " vertices"};
}

}  // namespace

void encode_indices(std::span<std::byte> out, std::span<const uint32_t> indices, IndexRange range) {
  const uint32_t* values = indices.data();
  const uint32_t smallest = range.min;
  pack_values(out, indices.size(), range.bits, [=](uint64_t i) { return values[i] - smallest; });
}

Result<void> decode_indices(std::span<uint32_t> out, uint32_t vertex_count, IndexRange range,
                            std::span<const std::byte> bytes) {
  SCREE_TRY(check_size(out.size(), range, bytes));
  if (out.empty()) return {};
  uint32_t* const values = out.data();
  const uint32_t smallest = range.min;
  uint32_t largest_code = 0;
  unpack_values(bytes.data(), out.size(), range.bits, [&, values, smallest](uint64_t i, uint32_t code) {
    values[i] = smallest + code;
    largest_code = std::max(largest_code, code);
  });
  return check_largest(uint64_t{smallest} + largest_code, vertex_count);
}

Result<void> check_indices(uint64_t index_count, uint32_t vertex_count, IndexRange range,
                           std::span<const std::byte> bytes) {
  SCREE_TRY(check_size(index_count, range, bytes));
  if (index_count == 0) return {};
  if (range.min + low_mask(range.bits) < vertex_count) return {};  // no code can be out of range
  uint32_t largest_code = 0;
  if (range.bits != 0) {
    uint64_t done = 0;
    if (isa_avx2::kScansCodes && has_avx2())
      done = isa_avx2::scan_codes(bytes.data(), bytes.size(), index_count, range.bits, largest_code);
    unpack_values(bytes.data() + done / 8 * range.bits, index_count - done, range.bits,
                  [&](uint64_t, uint32_t code) { largest_code = std::max(largest_code, code); });
  }
  return check_largest(uint64_t{range.min} + largest_code, vertex_count);
}

}  // namespace scree::format
