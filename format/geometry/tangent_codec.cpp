#include "format/geometry/tangent_codec.h"

#include <cassert>
#include <cmath>
#include <string>

#include "format/bitpack.h"
#include "format/geometry/packed_values.h"

namespace scree::format {
namespace {

/// The code of a tangent's direction, or -1 if the tangent is zero, not finite or parallel to the normal.
int32_t direction_of(const float* tangent, const float* normal, uint32_t bits) {
  float axes[2][3];
  tangent_axes(normal, axes[0], axes[1]);
  double at[2] = {0, 0};
  double squared = 0;
  for (int i = 0; i < 3; ++i) {
    for (int axis = 0; axis < 2; ++axis)
      at[axis] += static_cast<double>(tangent[i]) * static_cast<double>(axes[axis][i]);
    squared += static_cast<double>(tangent[i]) * static_cast<double>(tangent[i]);
  }
  const double sum = std::fabs(at[0]) + std::fabs(at[1]);
  if (!std::isfinite(sum) || !(sum > 1e-6 * std::sqrt(squared))) return -1;
  const double x = at[0] / sum;
  const double quarters = at[1] >= 0 ? 1 - x : 3 + x;  // 0 to 4 around the square
  const int32_t quarter = 1 << (bits - 3);
  return static_cast<int32_t>(quarters * quarter + 0.5) & (4 * quarter - 1);
}

Result<void> check_size(uint64_t count, uint32_t bits, std::span<const std::byte> bytes) {
  if (bits < kMinTangentBits || bits > kMaxTangentBits)
    return Error{ErrorCode::kRange, "tangents: " + std::to_string(bits) + " bits, expected 3 to 16"};
  const auto size = SCREE_TRY(checked_packed_bytes("tangents", count, bits));
  return check_stream("tangents", count * bits, size, bytes);
}

}  // namespace

uint64_t tangent_stream_bytes(uint64_t vertex_count, uint32_t bits) {
  return packed_bytes(vertex_count, bits);
}

uint64_t encode_tangents(std::span<std::byte> out, std::span<const float> tangents, std::span<const float> normals,
                         uint32_t bits) {
  assert(tangents.size() / 4 == normals.size() / 3 && bits >= kMinTangentBits && bits <= kMaxTangentBits);
  uint64_t without = 0;
  pack_values(out, tangents.size() / 4, bits, [&](uint64_t i) {
    const int32_t direction = direction_of(&tangents[4 * i], &normals[3 * i], bits);
    without += direction < 0 ? 1 : 0;
    return uint64_t{direction < 0 ? 0 : static_cast<uint32_t>(direction)} << 1 | (tangents[4 * i + 3] < 0 ? 1u : 0u);
  });
  return without;
}

Result<void> decode_tangents(std::span<float> out, std::span<const float> normals, uint32_t bits,
                             std::span<const std::byte> bytes) {
  assert(out.size() / 4 == normals.size() / 3);
  const uint64_t count = out.size() / 4;
  SCREE_TRY(check_size(count, bits, bytes));
  if (count == 0) return {};
  unpack_values(bytes.data(), count, bits, [&](uint64_t i, uint32_t code) {
    out[4 * i + 3] = decode_tangent(code, bits, &normals[3 * i], &out[4 * i]);
  });
  return {};
}

Result<void> check_tangents(uint64_t vertex_count, uint32_t bits, std::span<const std::byte> bytes) {
  return check_size(vertex_count, bits, bytes);
}

}  // namespace scree::format
