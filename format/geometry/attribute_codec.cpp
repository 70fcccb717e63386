#include "format/geometry/attribute_codec.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <string>

#include "format/geometry/code_scan.h"
#include "format/geometry/normal_codes.h"
#include "format/geometry/packed_values.h"
#include "format/layout.h"
#include "format/processor.h"

namespace scree::format {
namespace {

constexpr int32_t kCoarsestUvExponent = -15;
constexpr uint32_t kMinNormalBits = 2;
constexpr uint32_t kMaxNormalBits = 16;
constexpr uint64_t kColorVertexBytes = 4;

/// The lattice coordinate of a texture coordinate. Within half a step of 2^128 the nearest lattice point is not a
/// float; the result is then the lattice point before it.
int64_t quantize_uv(float value, int32_t exponent) {
  const int64_t coordinate = quantize(value, exponent);
  if (exponent <= 104) return coordinate;  // floats near 2^128 are multiples of 2^104, so they lie on the lattice
  const int64_t last = (int64_t{1} << (128 - exponent)) - 1;
  return std::clamp(coordinate, -last, last);
}

Result<void> check_uv_range(const UvRange& range) {
  if (range.exponent < kMinLatticeExponent || range.exponent > kMaxLatticeExponent) {
    return Error{ErrorCode::kRange, "uvs: exponent " + std::to_string(range.exponent) + ", expected -149 to 127"};
  }
  for (int axis = 0; axis < 2; ++axis) {
    if (range.bits[axis] > kMaxUvBits) {
      return Error{ErrorCode::kRange, "uvs: " + std::to_string(range.bits[axis]) + " bits, expected at most 24"};
    }
    if (range.min[axis] <= -kLatticeLimit || range.min[axis] >= kLatticeLimit) {
      return Error{ErrorCode::kRange,
                   "uvs: origin " + std::to_string(range.min[axis]) + ", expected below 2^52 in magnitude"};
    }
  }
  return {};
}

Result<void> check_uv_values(const UvRange& range, const std::array<uint32_t, 2>& largest) {
  for (int axis = 0; axis < 2; ++axis) {
    if (!std::isfinite(dequantize(range.min[axis], range.exponent)) ||
        !std::isfinite(dequantize(range.min[axis] + int64_t{largest[axis]}, range.exponent))) {
      return Error{ErrorCode::kRange, "uvs: a coordinate exceeds float32"};
    }
  }
  return {};
}

Result<void> check_packed(const char* what, uint64_t count, uint32_t bits, std::span<const std::byte> bytes) {
  const auto size = SCREE_TRY(checked_packed_bytes(what, count, bits));
  return check_stream(what, count * bits, size, bytes);
}

/// Calls sink(vertex, first, second) for each pair of codes. A code has at most 24 bits, so that a pair lies in one
/// 8-byte window.
template <class Sink>
void unpack_pairs(const std::byte* stream, uint64_t count, uint32_t bits0, uint32_t bits1, Sink&& sink) {
  const uint32_t stride = bits0 + bits1;
  const uint64_t mask0 = low_mask(bits0);
  const uint64_t mask1 = low_mask(bits1);
  for (uint64_t i = 0; i < count; ++i) {
    const uint64_t bit = i * stride;
    const uint64_t window = stride == 0 ? 0 : load<uint64_t>(stream + (bit >> 3)) >> (bit & 7u);
    sink(i, static_cast<uint32_t>(window & mask0), static_cast<uint32_t>((window >> bits0) & mask1));
  }
}

/// Packs pair(i), the first code in the low `bits0` bits; bits0 + bits1 at most 48.
template <class Pair>
void pack_pairs(std::span<std::byte> out, uint64_t count, uint32_t stride, Pair&& pair) {
  assert(out.size() == packed_bytes(count, stride));
  if (out.empty()) return;
  std::byte* at = out.data();
  uint64_t word = 0;  // `fill` bits not yet written, fewer than 8
  uint32_t fill = 0;
  for (uint64_t i = 0; i < count; ++i) {
    word |= pair(i) << fill;
    fill += stride;
    store(at, word);  // up to 7 bytes too many, which the next pair overwrites or the slack holds
    at += fill / 8;
    word >>= fill & ~7u;
    fill &= 7u;
  }
  zero_slack(out, count * stride);
}

uint32_t quantize_color(float value) {
  const double clamped = value > 0 ? std::min(static_cast<double>(value), 1.0) : 0;  // NaN is not > 0
  return static_cast<uint32_t>(clamped * 255.0 + 0.5);
}

/// Octahedral codes (u in the low 16 bits, v above) of the direction `normal`: the nearest in angle of the four lattice
/// points around its point in the square.
uint32_t encode_octahedral(const float* normal, uint32_t bits) {
  const int32_t half = (1 << (bits - 1)) - 1;
  const double x = normal[0];
  const double y = normal[1];
  const double z = normal[2];
  const double sum = std::fabs(x) + std::fabs(y) + std::fabs(z);
  const auto codes = [half](int32_t u, int32_t v) {
    return static_cast<uint32_t>(u + half) | static_cast<uint32_t>(v + half) << 16;
  };
  if (!(sum > 0) || !std::isfinite(sum)) return codes(0, 0);  // (0, 0, 1)
  double u = x / sum;
  double v = y / sum;
  if (z < 0) {
    const double folded_u = (1 - std::fabs(v)) * (u < 0 ? -1 : 1);
    v = (1 - std::fabs(u)) * (v < 0 ? -1 : 1);
    u = folded_u;
  }
  // Truncation rounds down for non-negative values (std::floor is a library call on the baseline CPU).
  const int32_t u0 = std::min(static_cast<int32_t>((u + 1) * half), 2 * half) - half;
  const int32_t v0 = std::min(static_cast<int32_t>((v + 1) * half), 2 * half) - half;
  int32_t best_u = u0;
  int32_t best_v = v0;
  double best_dot =
      -1;  // the best candidate's dot product with the normal, times its magnitude, over its squared length
  double best_square = 0;
  for (int32_t candidate_v = v0; candidate_v <= std::min(v0 + 1, half); ++candidate_v) {
    for (int32_t candidate_u = u0; candidate_u <= std::min(u0 + 1, half); ++candidate_u) {
      int32_t point[3];
      octahedral_point(candidate_u, candidate_v, half, point);
      const double dot = x * point[0] + y * point[1] + z * point[2];
      const double square = static_cast<double>(point[0]) * point[0] + static_cast<double>(point[1]) * point[1] +
                            static_cast<double>(point[2]) * point[2];
      const double signed_dot = dot * std::fabs(dot);
      if (signed_dot * best_square > best_dot * square) {  // the larger cosine, without roots and divisions
        best_dot = signed_dot;
        best_square = square;
        best_u = candidate_u;
        best_v = candidate_v;
      }
    }
  }
  return codes(best_u, best_v);
}

Result<void> check_normal_bits(uint32_t bits) {
  if (bits >= kMinNormalBits && bits <= kMaxNormalBits) return {};
  return Error{ErrorCode::kRange, "normals: " + std::to_string(bits) + " bits, expected 2 to 16"};
}

Result<void> check_normal_codes(uint32_t largest, uint32_t bits) {
  if (largest < low_mask(bits)) return {};
  return Error{ErrorCode::kRange,
               "normals: code " + std::to_string(largest) + ", expected at most " + std::to_string(low_mask(bits) - 1)};
}

Result<void> check_source_bits(const SourceIdRange& range) {
  if (range.bits <= kMaxPackedBits) return {};
  return Error{ErrorCode::kRange, "source ids: " + std::to_string(range.bits) + " bits, expected at most 32"};
}

Result<void> check_source_codes(const SourceIdRange& range, uint32_t largest) {
  if (checked_add(range.min, largest)) return {};
  return Error{ErrorCode::kRange,
               "source ids: " + std::to_string(range.min) + " + " + std::to_string(largest) + " exceeds 2^64"};
}

}  // namespace

UvRange choose_uv_range(std::span<const float> uvs, uint32_t bits) {
  assert(uvs.size() % 2 == 0 && bits >= 1 && bits <= kMaxUvBits);
  UvRange range;
  if (uvs.empty()) return range;
  std::array<Interval, 2> axes{Interval{uvs[0], uvs[0]}, Interval{uvs[1], uvs[1]}};
  for (size_t i = 0; i < uvs.size(); i += 2) {
    for (size_t axis = 0; axis < 2; ++axis) {
      const float value = uvs[i + axis];
      assert(std::isfinite(value));
      axes[axis] = {std::min(axes[axis].lo, value), std::max(axes[axis].hi, value)};
    }
  }
  range.exponent = finest_exponent(axes, bits);
  const bool flat = axes[0].lo == axes[0].hi && axes[1].lo == axes[1].hi;
  if (range.exponent > kCoarsestUvExponent && !flat) {
    range.exponent = std::max(kCoarsestUvExponent, finest_exponent(axes, kMaxUvBits));
  }
  for (size_t axis = 0; axis < 2; ++axis) {
    range.min[axis] = quantize_uv(axes[axis].lo, range.exponent);
    const int64_t last = quantize_uv(axes[axis].hi, range.exponent);
    range.bits[axis] = static_cast<uint8_t>(std::bit_width(static_cast<uint64_t>(last - range.min[axis])));
  }
  return range;
}

double uv_error_bound(const UvRange& range) {
  double largest = 0;
  for (size_t axis = 0; axis < 2; ++axis) {
    const double first = static_cast<double>(range.min[axis]);
    const double last = first + static_cast<double>(low_mask(range.bits[axis]));
    largest = std::max({largest, std::fabs(first), std::fabs(last)});
  }
  const double step = exp2i(range.exponent);
  const double magnitude = std::min(largest * step, static_cast<double>(std::numeric_limits<float>::max()));
  const double half_step = (range.exponent > 104 ? 1.0 : 0.5) * step;  // quantize_uv
  return half_step + 0.5 * float_ulp(static_cast<float>(magnitude));
}

uint64_t uv_stream_bytes(uint64_t vertex_count, const UvRange& range) {
  return packed_bytes(vertex_count, range.stride_bits());
}

void encode_uvs(std::span<std::byte> out, std::span<const float> uvs, const UvRange& range) {
  assert(uvs.size() % 2 == 0);
  pack_pairs(out, uvs.size() / 2, range.stride_bits(), [&](uint64_t i) {
    const auto u = static_cast<uint64_t>(quantize_uv(uvs[2 * i], range.exponent) - range.min[0]);
    const auto v = static_cast<uint64_t>(quantize_uv(uvs[2 * i + 1], range.exponent) - range.min[1]);
    assert(u <= low_mask(range.bits[0]) && v <= low_mask(range.bits[1]));
    return u | v << range.bits[0];
  });
}

Result<void> decode_uvs(std::span<float> out, const UvRange& range, std::span<const std::byte> bytes) {
  assert(out.size() % 2 == 0);
  const uint64_t count = out.size() / 2;
  SCREE_TRY(check_uv_range(range));
  SCREE_TRY(check_packed("uvs", count, range.stride_bits(), bytes));
  if (count == 0) return {};
  float* const values = out.data();
  const double step = exp2i(range.exponent);
  const double u0 = static_cast<double>(range.min[0]);
  const double v0 = static_cast<double>(range.min[1]);
  std::array<uint32_t, 2> largest{};
  unpack_pairs(bytes.data(), count, range.bits[0], range.bits[1], [&, values](uint64_t i, uint32_t u, uint32_t v) {
    largest = {std::max(largest[0], u), std::max(largest[1], v)};
    values[2 * i] = static_cast<float>((u0 + static_cast<int32_t>(u)) * step);
    values[2 * i + 1] = static_cast<float>((v0 + static_cast<int32_t>(v)) * step);
  });
  return check_uv_values(range, largest);
}

Result<void> check_uvs(uint64_t vertex_count, const UvRange& range, std::span<const std::byte> bytes) {
  SCREE_TRY(check_uv_range(range));
  SCREE_TRY(check_packed("uvs", vertex_count, range.stride_bits(), bytes));
  if (vertex_count == 0) return {};
  std::array<uint32_t, 2> largest{static_cast<uint32_t>(low_mask(range.bits[0])),
                                  static_cast<uint32_t>(low_mask(range.bits[1]))};
  if (check_uv_values(range, largest)) return {};  // no code can be out of range
  largest = {};
  unpack_pairs(bytes.data(), vertex_count, range.bits[0], range.bits[1], [&](uint64_t, uint32_t u, uint32_t v) {
    largest = {std::max(largest[0], u), std::max(largest[1], v)};
  });
  return check_uv_values(range, largest);
}

uint64_t second_uv_stream_bytes(uint64_t vertex_count, const UvRange& range) {
  return sizeof(SecondUvHeader) + uv_stream_bytes(vertex_count, range);
}

void encode_second_uvs(std::span<std::byte> out, std::span<const float> uvs, const UvRange& range) {
  SecondUvHeader header{};
  std::copy(range.min.begin(), range.min.end(), header.min);
  header.exponent = range.exponent;
  store(out.data(), header);
  encode_uvs(out.subspan(sizeof header), uvs, range);
}

Result<UvRange> open_second_uvs(const uint8_t bits[2], std::span<const std::byte>& bytes) {
  if (bytes.size() < sizeof(SecondUvHeader)) return Error{ErrorCode::kTruncated, "second uvs: no header"};
  const auto header = load<SecondUvHeader>(bytes.data());
  if (header.reserved[0] | header.reserved[1] | header.reserved[2])
    return Error{ErrorCode::kReserved, "second uvs: a reserved field is set"};
  bytes = bytes.subspan(sizeof header);
  return UvRange{header.exponent, {header.min[0], header.min[1]}, {bits[0], bits[1]}};
}

uint64_t color_stream_bytes(uint64_t vertex_count) {
  return align_up(vertex_count * kColorVertexBytes, kChunkAlignment);
}

void encode_colors(std::span<std::byte> out, std::span<const float> rgba) {
  assert(rgba.size() % 4 == 0 && out.size() == color_stream_bytes(rgba.size() / 4));
  for (size_t i = 0; i < rgba.size(); ++i) out[i] = static_cast<std::byte>(quantize_color(rgba[i]));
  zero_slack(out, 8 * rgba.size());
}

Result<void> decode_colors(std::span<float> out, std::span<const std::byte> bytes) {
  assert(out.size() % 4 == 0);
  SCREE_TRY(check_colors(out.size() / 4, bytes));
  for (size_t i = 0; i < out.size(); ++i) out[i] = static_cast<float>(std::to_integer<int32_t>(bytes[i])) / 255.0f;
  return {};
}

Result<void> check_colors(uint64_t vertex_count, std::span<const std::byte> bytes) {
  SCREE_TRY(checked_packed_bytes("colors", vertex_count, 8 * kColorVertexBytes));
  return check_stream("colors", vertex_count * 8 * kColorVertexBytes, color_stream_bytes(vertex_count), bytes);
}

uint64_t normal_stream_bytes(uint64_t vertex_count, uint32_t bits) {
  return packed_bytes(vertex_count, 2 * bits);
}

void encode_normals(std::span<std::byte> out, std::span<const float> normals, uint32_t bits) {
  assert(normals.size() % 3 == 0 && bits >= kMinNormalBits && bits <= kMaxNormalBits);
  const uint64_t count = normals.size() / 3;
  const uint64_t in_fours = isa_avx2::kEncodesNormals && has_avx2() ? count & ~uint64_t{3} : 0;
  std::array<uint32_t, 4> four{};
  pack_pairs(out, count, 2 * bits, [&](uint64_t i) -> uint64_t {
    if (i < in_fours && i % 4 == 0) isa_avx2::encode_octahedral(normals.data() + 3 * i, bits, four.data());
    const uint32_t codes = i < in_fours ? four[i % 4] : encode_octahedral(normals.data() + 3 * i, bits);
    return (codes & 0xffffu) | uint64_t{codes >> 16} << bits;
  });
}

Result<void> decode_normals(std::span<float> out, uint32_t bits, std::span<const std::byte> bytes) {
  assert(out.size() % 3 == 0);
  const uint64_t count = out.size() / 3;
  SCREE_TRY(check_normal_bits(bits));
  SCREE_TRY(check_packed("normals", count, 2 * bits, bytes));
  uint32_t largest = 0;
  unpack_pairs(bytes.data(), count, bits, bits, [&](uint64_t i, uint32_t u, uint32_t v) {
    largest = std::max({largest, u, v});
    decode_octahedral(u, v, bits, out.data() + 3 * i);
  });
  return check_normal_codes(largest, bits);
}

Result<void> check_normals(uint64_t vertex_count, uint32_t bits, std::span<const std::byte> bytes) {
  SCREE_TRY(check_normal_bits(bits));
  SCREE_TRY(check_packed("normals", vertex_count, 2 * bits, bytes));
  uint32_t largest = 0;
  uint64_t done = 0;  // of the stream's codes, two per normal
  if (isa_avx2::kScansCodes && has_avx2())
    done = isa_avx2::scan_codes(bytes.data(), bytes.size(), 2 * vertex_count, bits, largest);
  unpack_pairs(bytes.data() + done / 8 * bits, vertex_count - done / 2, bits, bits,
               [&](uint64_t, uint32_t u, uint32_t v) {
                 largest = std::max({largest, u, v});
               });
  return check_normal_codes(largest, bits);
}

SourceIdRange source_id_range(std::span<const uint64_t> ids) {
  if (ids.empty()) return {};
  const auto [smallest, largest] = std::minmax_element(ids.begin(), ids.end());
  const auto bits = static_cast<uint32_t>(std::bit_width(*largest - *smallest));
  assert(bits <= kMaxPackedBits);
  return {*smallest, bits};
}

void encode_source_ids(std::span<std::byte> out, std::span<const uint64_t> ids, const SourceIdRange& range) {
  pack_values(out, ids.size(), range.bits,
              [values = ids.data(), min = range.min](uint64_t i) { return values[i] - min; });
}

Result<void> decode_source_ids(std::span<uint64_t> out, const SourceIdRange& range, std::span<const std::byte> bytes) {
  SCREE_TRY(check_source_bits(range));
  SCREE_TRY(check_packed("source ids", out.size(), range.bits, bytes));
  if (out.empty()) return {};
  uint32_t largest = 0;
  unpack_values(bytes.data(), out.size(), range.bits,
                [&, values = out.data(), min = range.min](uint64_t i, uint32_t code) {
                  values[i] = min + code;
                  largest = std::max(largest, code);
                });
  return check_source_codes(range, largest);
}

Result<void> check_source_ids(uint64_t triangle_count, const SourceIdRange& range, std::span<const std::byte> bytes) {
  SCREE_TRY(check_source_bits(range));
  SCREE_TRY(check_packed("source ids", triangle_count, range.bits, bytes));
  if (range.bits == 0 || check_source_codes(range, static_cast<uint32_t>(low_mask(range.bits)))) return {};
  uint32_t largest = 0;
  unpack_values(bytes.data(), triangle_count, range.bits,
                [&](uint64_t, uint32_t code) { largest = std::max(largest, code); });
  return check_source_codes(range, largest);
}

}  // namespace scree::format
