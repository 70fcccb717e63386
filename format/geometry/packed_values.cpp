#include "format/geometry/packed_values.h"

#include <algorithm>
#include <limits>
#include <string>

namespace scree::format {

Result<void> check_stream(const char* what, uint64_t data_bits, uint64_t stream_bytes,
                          std::span<const std::byte> bytes) {
  if (bytes.size() != stream_bytes) {
    const bool truncated = bytes.size() < stream_bytes;
    return Error{
        truncated ? ErrorCode::kTruncated : ErrorCode::kTrailing,
        std::string(what) + ": " + std::to_string(bytes.size()) + " bytes, expected " + std::to_string(stream_bytes)};
  }
  if (stream_bytes == 0) return {};
  uint64_t byte = data_bits / 8;
  const uint32_t used_bits = static_cast<uint32_t>(data_bits % 8);
  bool clean = true;
  if (used_bits != 0) clean = (std::to_integer<uint32_t>(bytes[byte++]) >> used_bits) == 0;
  for (; byte < stream_bytes; ++byte) clean = clean && bytes[byte] == std::byte{0};
  if (!clean) return Error{ErrorCode::kTrailing, std::string(what) + ": bits after the data are set, expected zero"};
  return {};
}

Result<uint64_t> checked_packed_bytes(const char* what, uint64_t count, uint32_t bits) {
  const auto data_bits = checked_mul(count, bits);
  if (!data_bits || *data_bits > static_cast<uint64_t>(std::numeric_limits<int64_t>::max())) {
    return Error{ErrorCode::kRange, std::string(what) + ": " + std::to_string(count) + " values of " +
                                        std::to_string(bits) + " bits, expected less than 2^63 bits"};
  }
  return packed_bytes(count, bits);
}

void zero_slack(std::span<std::byte> out, uint64_t data_bits) {
  std::fill(out.begin() + static_cast<std::ptrdiff_t>((data_bits + 7) / 8), out.end(), std::byte{0});
}

}  // namespace scree::format
