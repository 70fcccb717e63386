#include "format/geometry/position_codec.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>

#include "format/geometry/code_scan.h"
#include "format/geometry/packed_values.h"
#include "format/processor.h"

namespace scree::format {
namespace {

constexpr uint32_t kFloatBits = 32;
constexpr uint64_t kFloatVertexBytes = 12;
constexpr char kAxisNames[3] = {'x', 'y', 'z'};

std::string format_double(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.9g", value);
  return text;
}

std::array<Interval, 3> intervals(const float lo[3], const float hi[3]) {
  std::array<Interval, 3> axes;
  for (int axis = 0; axis < 3; ++axis) {
    assert(std::isfinite(lo[axis]) && std::isfinite(hi[axis]) && lo[axis] <= hi[axis]);
    axes[axis] = {lo[axis], hi[axis]};
  }
  return axes;
}

float largest_magnitude(std::span<const Interval> axes) {
  float largest = 0;
  for (const Interval& axis : axes) largest = std::max({largest, std::fabs(axis.lo), std::fabs(axis.hi)});
  return largest;
}

/// The coarsest exponent for which half a step plus `half_ulp` stays within max_error. Below kMinLatticeExponent if
/// half_ulp alone uses up max_error.
int32_t coarsest_exponent(double max_error, double half_ulp) {
  const double half_step =
      std::min(max_error, exp2i(kMaxLatticeExponent)) - half_ulp;  // ilogb of infinity is undefined
  if (!(half_step > 0)) return kMinLatticeExponent - 1;
  int32_t exponent = std::min(std::ilogb(half_step) + 2, kMaxLatticeExponent);
  while (exponent >= kMinLatticeExponent && 0.5 * exp2i(exponent) + half_ulp > max_error) --exponent;
  return exponent;
}

Error bad_lattice(const std::string& message) {
  return Error{ErrorCode::kRange, "position lattice: " + message};
}

/// Constants of an axis's decoder, checked by make_decoder().
struct AxisDecoder {
  double origin;  // coordinate of code 0
  uint32_t last;  // the largest code the lattice allows
};
struct LatticeDecoder {
  std::array<AxisDecoder, 3> axes;
  double step;
};

Result<LatticeDecoder> make_decoder(const MeshLattice& lattice, const PositionRange& range) {
  if (lattice.exponent < kMinLatticeExponent || lattice.exponent > kMaxLatticeExponent) {
    return bad_lattice("exponent " + std::to_string(lattice.exponent) + ", expected -149 to 127");
  }
  LatticeDecoder decoder{{}, exp2i(lattice.exponent)};
  for (int axis = 0; axis < 3; ++axis) {
    const std::string_view place(&kAxisNames[axis], 1);
    if (range.bits[axis] > kMaxPositionBits || lattice.bits[axis] > kMaxPositionBits) {
      return Error{ErrorCode::kRange, "positions: " + std::to_string(std::max(range.bits[axis], lattice.bits[axis])) +
                                          " bits on " + std::string(place) + ", expected at most 24"};
    }
    if (lattice.min[axis] <= -kLatticeLimit || lattice.min[axis] >= kLatticeLimit) {
      return bad_lattice("origin " + std::to_string(lattice.min[axis]) + " on " + std::string(place) +
                         ", expected below 2^52 in magnitude");
    }
    const uint64_t last = low_mask(lattice.bits[axis]);
    if (range.min[axis] > last) {
      return Error{ErrorCode::kRange, "positions: smallest offset " + std::to_string(range.min[axis]) + " on " +
                                          std::string(place) + ", expected at most " + std::to_string(last)};
    }
    const int64_t origin = lattice.min[axis] + static_cast<int64_t>(range.min[axis]);
    decoder.axes[axis] = {static_cast<double>(origin), static_cast<uint32_t>(last - range.min[axis])};
  }
  return decoder;
}

Result<void> check_size(uint64_t vertex_count, const PositionRange& range, std::span<const std::byte> bytes) {
  if (range.is_float32()) {
    if (range.bits != std::array<uint8_t, 3>{32, 32, 32} || range.min != std::array<uint32_t, 3>{}) {
      return Error{ErrorCode::kRange, "positions: float32 on x, expected 32 bits on all axes and no offset"};
    }
    SCREE_TRY(checked_packed_bytes("positions", vertex_count, 8 * kFloatVertexBytes));
    return check_stream("positions", vertex_count * 8 * kFloatVertexBytes,
                        align_up(vertex_count * kFloatVertexBytes, kChunkAlignment), bytes);
  }
  const auto size = SCREE_TRY(checked_packed_bytes("positions", vertex_count, range.stride_bits()));
  return check_stream("positions", vertex_count * range.stride_bits(), size, bytes);
}

/// Calls sink(vertex, x, y, z) with the codes of every vertex; each axis has at most 24 bits.
template <class Sink>
void unpack_positions(const std::byte* stream, uint64_t vertex_count, const std::array<uint8_t, 3>& bits, Sink&& sink) {
  const uint32_t stride = uint32_t{bits[0]} + bits[1] + bits[2];
  if (stride == 0) {
    for (uint64_t vertex = 0; vertex < vertex_count; ++vertex) sink(vertex, 0u, 0u, 0u);
    return;
  }
  if (bits == std::array<uint8_t, 3>{16, 16, 16}) {
    for (uint64_t vertex = 0; vertex < vertex_count; ++vertex) {
      const uint64_t codes = load<uint64_t>(stream + vertex * 6);
      sink(vertex, static_cast<uint32_t>(codes & 0xffffu), static_cast<uint32_t>((codes >> 16) & 0xffffu),
           static_cast<uint32_t>((codes >> 32) & 0xffffu));
    }
    return;
  }
  const uint64_t mask_x = low_mask(bits[0]);
  const uint64_t mask_y = low_mask(bits[1]);
  const uint64_t mask_z = low_mask(bits[2]);
  const uint32_t shift_y = bits[0];
  const uint32_t shift_z = shift_y + bits[1];
  const auto window = [stream](uint64_t bit) { return load<uint64_t>(stream + (bit >> 3)) >> (bit & 7u); };
  if (stride <= 57) {  // 64 bits hold a vertex that starts at any bit of a byte
    for (uint64_t vertex = 0; vertex < vertex_count; ++vertex) {
      const uint64_t codes = window(vertex * stride);
      sink(vertex, static_cast<uint32_t>(codes & mask_x), static_cast<uint32_t>((codes >> shift_y) & mask_y),
           static_cast<uint32_t>((codes >> shift_z) & mask_z));
    }
    return;
  }
  for (uint64_t vertex = 0; vertex < vertex_count; ++vertex) {
    // With a stride over 57 bits z has at least 10 bits, so its window begins inside the data and ends inside the
    // slack.
    const uint64_t codes = window(vertex * stride);
    const uint64_t code_z = window(vertex * stride + shift_z) & mask_z;
    sink(vertex, static_cast<uint32_t>(codes & mask_x), static_cast<uint32_t>((codes >> shift_y) & mask_y),
         static_cast<uint32_t>(code_z));
  }
}

Result<void> check_codes(const LatticeDecoder& decoder, const std::array<uint32_t, 3>& largest) {
  for (int axis = 0; axis < 3; ++axis) {
    const std::string_view place(&kAxisNames[axis], 1);
    const AxisDecoder& limits = decoder.axes[axis];
    if (largest[axis] > limits.last) {
      return Error{ErrorCode::kRange, "positions: code " + std::to_string(largest[axis]) + " on " + std::string(place) +
                                          ", expected at most " + std::to_string(limits.last)};
    }
    const float first = static_cast<float>(limits.origin * decoder.step);
    const float last = static_cast<float>((limits.origin + largest[axis]) * decoder.step);
    if (!std::isfinite(first) || !std::isfinite(last)) {
      return Error{ErrorCode::kRange, "positions: a coordinate on " + std::string(place) + " exceeds float32"};
    }
  }
  return {};
}

Result<void> check_floats(uint64_t vertex_count, std::span<const std::byte> bytes) {
  // Tests a block at a time without branches. Searches a block value by value only if one is not finite.
  constexpr uint64_t kBlock = 1024;
  constexpr uint32_t kExponent = 0x7f800000u;
  const uint64_t count = 3 * vertex_count;
  for (uint64_t first = 0; first < count; first += kBlock) {
    const uint64_t last = std::min(count, first + kBlock);
    uint32_t bad = 0;
    for (uint64_t i = first; i < last; ++i) {
      const uint32_t exponent = load<uint32_t>(bytes.data() + i * sizeof(float)) & kExponent;
      bad |= static_cast<uint32_t>(exponent == kExponent);
    }
    for (uint64_t i = first; bad != 0 && i < last; ++i) {
      if (!std::isfinite(load<float>(bytes.data() + i * sizeof(float)))) {
        return Error{ErrorCode::kFormat,
                     "positions: vertex " + std::to_string(i / 3) + ": " + kAxisNames[i % 3] + " is not finite"};
      }
    }
  }
  return {};
}

}  // namespace

Result<MeshLattice> lattice_of_exponent(const float lo[3], const float hi[3], int32_t exponent) {
  const auto axes = intervals(lo, hi);
  const float largest = largest_magnitude(axes);
  if (exponent < kMinLatticeExponent || exponent > kMaxLatticeExponent) {
    return bad_lattice("step 2^" + std::to_string(exponent) + ", expected 2^-149 to 2^127");
  }
  MeshLattice lattice;
  lattice.exponent = exponent;
  for (int axis = 0; axis < 3; ++axis) {
    const Interval& interval = axes[axis];
    const std::string_view place(&kAxisNames[axis], 1);
    if (!fits_lattice(interval.lo, exponent) || !fits_lattice(interval.hi, exponent)) {
      return bad_lattice("coordinate " + format_double(largest) + " at a step of 2^" + std::to_string(exponent) +
                         " exceeds 2^52 steps: use a coarser step or float32 positions");
    }
    const LatticeAxis on_lattice = lattice_axis(interval.lo, interval.hi, exponent);
    if (on_lattice.bits > kMaxPositionBits) {
      const double extent = static_cast<double>(interval.hi) - static_cast<double>(interval.lo);
      return bad_lattice(std::to_string(on_lattice.bits) + " bits on " + std::string(place) + " (extent " +
                         format_double(extent) + ", step " + format_double(exp2i(exponent)) +
                         "), expected at most 24: use a coarser step or float32 positions");
    }
    // Only a coordinate within half a step of 2^128 can be rounded past the largest float.
    if (!std::isfinite(dequantize(on_lattice.min, exponent)) ||
        !std::isfinite(dequantize(quantize(interval.hi, exponent), exponent))) {
      return bad_lattice("coordinate " + format_double(largest) + " exceeds float32 after rounding to a step of 2^" +
                         std::to_string(exponent) + ": use float32 positions");
    }
    lattice.min[axis] = on_lattice.min;
    lattice.bits[axis] = static_cast<uint8_t>(on_lattice.bits);
  }
  const bool exact = exponent <= exact_exponent(axes) || largest == 0;
  lattice.max_error = exact ? 0 : 0.5 * exp2i(exponent) + 0.5 * float_ulp(largest);
  return lattice;
}

Result<MeshLattice> choose_lattice(const float lo[3], const float hi[3], uint32_t bits, double max_error) {
  assert(bits >= 1 && bits <= kMaxPositionBits);
  assert(max_error >= 0);
  const auto axes = intervals(lo, hi);
  if (max_error == 0) return lattice_of_exponent(lo, hi, finest_exponent(axes, bits));
  const float largest = largest_magnitude(axes);
  const double half_ulp = 0.5 * float_ulp(largest);
  const int32_t coarsest = coarsest_exponent(max_error, half_ulp);
  auto lattice = lattice_of_exponent(lo, hi, std::max(coarsest, exact_exponent(axes)));
  // If half an ulp alone uses up max_error, only a lattice that holds every float of the box exactly keeps it.
  if (!lattice && coarsest < kMinLatticeExponent) {
    return bad_lattice("a maximum error of " + format_double(max_error) + " is not above " + format_double(half_ulp) +
                       ", half the spacing of float32 at " + format_double(largest) +
                       ": allow a larger one or use float32 positions");
  }
  return lattice;
}

Result<void> check_offsets(const MeshLattice& lattice, const PositionRange& range,
                           const std::array<uint32_t, 3>& largest) {
  const auto decoder = SCREE_TRY(make_decoder(lattice, range));
  return check_codes(decoder, largest);
}

MeshLattice lattice_of(const MeshRecord& mesh) {
  MeshLattice lattice;
  lattice.exponent = mesh.lattice_exponent;
  std::copy_n(mesh.lattice_min, 3, lattice.min.begin());
  std::copy_n(mesh.lattice_bits, 3, lattice.bits.begin());
  lattice.max_error = mesh.max_position_error;
  return lattice;
}

PositionRange position_range_of(const ChunkRecord& chunk) {
  PositionRange range;
  std::copy_n(chunk.position_min, 3, range.min.begin());
  std::copy_n(chunk.position_bits, 3, range.bits.begin());
  return range;
}

uint64_t position_stream_bytes(uint64_t vertex_count, const PositionRange& range) {
  if (range.is_float32()) return align_up(vertex_count * kFloatVertexBytes, kChunkAlignment);
  return packed_bytes(vertex_count, range.stride_bits());
}

PositionRange position_range(std::span<const uint32_t> coordinates) {
  assert(coordinates.size() % 3 == 0);
  PositionRange range;
  if (coordinates.empty()) return range;
  std::array<uint32_t, 3> smallest{coordinates[0], coordinates[1], coordinates[2]};
  std::array<uint32_t, 3> largest = smallest;
  for (size_t i = 0; i < coordinates.size(); i += 3) {
    for (size_t axis = 0; axis < 3; ++axis) {
      smallest[axis] = std::min(smallest[axis], coordinates[i + axis]);
      largest[axis] = std::max(largest[axis], coordinates[i + axis]);
    }
  }
  range.min = smallest;
  for (size_t axis = 0; axis < 3; ++axis) {
    range.bits[axis] = static_cast<uint8_t>(std::bit_width(largest[axis] - smallest[axis]));
  }
  return range;
}

double quantize_positions(std::span<uint32_t> out, std::span<const float> positions, const MeshLattice& lattice) {
  assert(out.size() == positions.size() && positions.size() % 3 == 0);
  // Two values at a time, as quantize() and dequantize(): coordinates and their differences are exact as doubles.
  using Doubles2 = double __attribute__((vector_size(16)));
  using Floats2 = float __attribute__((vector_size(8)));
  using Ints2 = int32_t __attribute__((vector_size(8)));
  const double to_lattice = exp2i(-lattice.exponent), step = exp2i(lattice.exponent);
  double min[4];
  for (size_t k = 0; k < 4; ++k) min[k] = static_cast<double>(lattice.min[k % 3]);
  Doubles2 lowest{}, highest{};  // differences of decoded values from the positions
  const auto two = [&](Floats2 values, size_t axis) {
    const auto exact = __builtin_convertvector(values, Doubles2);
    const Doubles2 coordinates = (exact * to_lattice + kRounder) - kRounder;
    const auto decoded = __builtin_convertvector(__builtin_convertvector(coordinates * step, Floats2), Doubles2);
    const Doubles2 difference = decoded - exact;
    lowest = difference < lowest ? difference : lowest;
    highest = difference > highest ? difference : highest;
    return __builtin_convertvector(coordinates - Doubles2{min[axis], min[axis + 1]}, Ints2);
  };
  size_t i = 0, axis = 0;  // of values[i]
  for (; i + 2 <= positions.size(); i += 2, axis = (axis + 2) % 3) {
    Floats2 values;
    std::memcpy(&values, &positions[i], sizeof values);
    const Ints2 offsets = two(values, axis);
    std::memcpy(&out[i], &offsets, sizeof offsets);
  }
  if (i < positions.size()) out[i] = static_cast<uint32_t>(two(Floats2{positions[i], positions[i]}, axis)[0]);
  assert(std::all_of(out.begin(), out.end(), [&, k = size_t{0}](uint32_t offset) mutable {
    return offset <= low_mask(lattice.bits[k++ % 3]);
  }));
  return std::max(std::max(highest[0], highest[1]), -std::min(lowest[0], lowest[1]));
}

void encode_positions(std::span<std::byte> out, std::span<const uint32_t> coordinates, const PositionRange& range) {
  const uint64_t vertex_count = coordinates.size() / 3;
  assert(coordinates.size() % 3 == 0 && !range.is_float32());
  assert(out.size() == position_stream_bytes(vertex_count, range));
  if (out.empty()) return;
  std::byte* at = out.data();
  uint64_t word = 0;  // `fill` bits not yet written, fewer than 32
  uint32_t fill = 0;
  const auto put = [&](uint64_t code, uint32_t bits) {
    word |= code << fill;
    fill += bits;
    if (fill >= 32) {
      store(at, static_cast<uint32_t>(word));
      at += sizeof(uint32_t);
      word >>= 32;
      fill -= 32;
    }
  };
  for (uint64_t vertex = 0; vertex < vertex_count; ++vertex) {
    for (size_t axis = 0; axis < 3; ++axis) {
      const uint32_t code = coordinates[3 * vertex + axis] - range.min[axis];
      assert(code <= low_mask(range.bits[axis]));
      put(code, range.bits[axis]);
    }
  }
  if (fill != 0) store(at, static_cast<uint32_t>(word));  // bytes past the data are part of the slack
  zero_slack(out, vertex_count * range.stride_bits());
}

void encode_positions_float32(std::span<std::byte> out, std::span<const float> positions) {
  assert(positions.size() % 3 == 0 && out.size() == align_up(positions.size_bytes(), kChunkAlignment));
  if (out.empty()) return;
  std::memcpy(out.data(), positions.data(), positions.size_bytes());
  zero_slack(out, 8 * positions.size_bytes());
}

Result<void> decode_positions(std::span<float> out, const MeshLattice& lattice, const PositionRange& range,
                              std::span<const std::byte> bytes) {
  assert(out.size() % 3 == 0);
  const uint64_t vertex_count = out.size() / 3;
  if (range.is_float32()) {
    SCREE_TRY(check_size(vertex_count, range, bytes));
    if (!out.empty()) std::memcpy(out.data(), bytes.data(), out.size_bytes());
    return check_floats(vertex_count, bytes);
  }
  const auto decoder = SCREE_TRY(make_decoder(lattice, range));
  SCREE_TRY(check_size(vertex_count, range, bytes));
  if (out.empty()) return {};
  float* const values = out.data();
  const double step = decoder.step;
  const double x0 = decoder.axes[0].origin;
  const double y0 = decoder.axes[1].origin;
  const double z0 = decoder.axes[2].origin;
  std::array<uint32_t, 3> largest{};
  unpack_positions(bytes.data(), vertex_count, range.bits,
                   [&, values](uint64_t vertex, uint32_t x, uint32_t y, uint32_t z) {
                     largest = {std::max(largest[0], x), std::max(largest[1], y), std::max(largest[2], z)};
                     float* const at = values + 3 * vertex;
                     // Codes have at most 24 bits, so the conversion is exact. It is cheapest from signed 32-bit
                     // integers.
                     at[0] = static_cast<float>((x0 + static_cast<int32_t>(x)) * step);
                     at[1] = static_cast<float>((y0 + static_cast<int32_t>(y)) * step);
                     at[2] = static_cast<float>((z0 + static_cast<int32_t>(z)) * step);
                   });
  return check_codes(decoder, largest);
}

Result<void> check_positions(uint64_t vertex_count, const MeshLattice& lattice, const PositionRange& range,
                             std::span<const std::byte> bytes) {
  if (range.is_float32()) {
    SCREE_TRY(check_size(vertex_count, range, bytes));
    return check_floats(vertex_count, bytes);
  }
  const auto decoder = SCREE_TRY(make_decoder(lattice, range));
  SCREE_TRY(check_size(vertex_count, range, bytes));
  if (vertex_count == 0) return {};
  std::array<uint32_t, 3> widest{};
  for (size_t axis = 0; axis < 3; ++axis) widest[axis] = static_cast<uint32_t>(low_mask(range.bits[axis]));
  if (check_codes(decoder, widest)) return {};  // no code can be out of range
  std::array<uint32_t, 3> largest{};
  uint64_t done = 0;
  if (isa_avx2::kScansCodes && has_avx2() && range.stride_bits() != 0)
    done = isa_avx2::scan_triples(bytes.data(), bytes.size(), vertex_count, range.bits.data(), largest.data());
  unpack_positions(bytes.data() + done / 8 * range.stride_bits(), vertex_count - done, range.bits,
                   [&](uint64_t, uint32_t x, uint32_t y, uint32_t z) {
                     largest = {std::max(largest[0], x), std::max(largest[1], y), std::max(largest[2], z)};
                   });
  return check_codes(decoder, largest);
}

}  // namespace scree::format
