#include <immintrin.h>

#include "format/cluster_scan.h"

// Nothing inline of the other headers may be called here: the linker would be free to take this copy, which only runs
// with AVX2, for all callers (tests/CMakeLists.txt looks).
namespace scree::format::isa_avx2 {
namespace {

struct Tables {
  /// Sums of the bits of a byte, of the lowest 1, 2, ... 8 of them, a byte each.
  uint64_t prefix_counts[256];
  /// How the distances of eight triangles, 2 * d bits each for d the index, come into lanes of 32 bits: the bytes of a
  /// lane, and the shift within them.
  struct Spread {
    alignas(32) uint8_t bytes[32];
    alignas(32) uint32_t shift[8];
  } spreads[8];
};

constexpr Tables make_tables() {
  Tables tables{};
  for (uint32_t byte = 0; byte < 256; ++byte) {
    uint64_t count = 0;
    for (uint32_t bit = 0; bit < 8; ++bit) {
      count += byte >> bit & 1;
      tables.prefix_counts[byte] |= count << (8 * bit);
    }
  }
  for (uint32_t bits = 0; bits < 8; ++bits) {
    for (uint32_t lane = 0; lane < 8; ++lane) {
      const uint32_t first = lane * 2 * bits;
      for (uint32_t byte = 0; byte < 4; ++byte)  // 14 bits lie within three bytes; 0x80 gives a zero
        tables.spreads[bits].bytes[4 * lane + byte] = static_cast<uint8_t>(byte < 3 ? first / 8 + byte : 0x80);
      tables.spreads[bits].shift[lane] = first % 8;
    }
  }
  return tables;
}
constexpr Tables kTables = make_tables();

bool good_triangles(const ClusterLayout& layout, const std::byte* data) {
  const uint32_t count = layout.triangle_count;
  const uint32_t bits = layout.distance_bits;
  const std::byte* steps = data + size_t{4} * layout.steps;
  const std::byte* wide = layout.wide_steps ? steps + size_t{4} * ((count + 31) / 32) : nullptr;
  const std::byte* distances = data + size_t{4} * layout.distances;
  const __m256i bytes = _mm256_load_si256(reinterpret_cast<const __m256i*>(kTables.spreads[bits].bytes));
  const __m256i shift = _mm256_load_si256(reinterpret_cast<const __m256i*>(kTables.spreads[bits].shift));
  const __m256i mask = _mm256_set1_epi32(static_cast<int>((1u << bits) - 1));
  const __m256i lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
  const __m128i width = _mm_cvtsi32_si128(static_cast<int>(bits));
  __m256i bad = _mm256_setzero_si256();
  uint32_t largest = 2;
  for (uint32_t i = 0; i < count; i += 8) {
    uint64_t sums = kTables.prefix_counts[static_cast<uint8_t>(steps[i / 8])];
    if (wide != nullptr) sums += 2 * kTables.prefix_counts[static_cast<uint8_t>(wide[i / 8])];  // at most 24 a byte
    const __m256i reach = _mm256_add_epi32(_mm256_set1_epi32(static_cast<int>(largest)),
                                           _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(static_cast<long long>(sums))));
    largest += static_cast<uint32_t>(sums >> 56);
    const __m256i packed = _mm256_broadcastsi128_si256(
        _mm_loadu_si128(reinterpret_cast<const __m128i*>(distances + size_t{i} / 8 * 2 * bits)));
    const __m256i both = _mm256_srlv_epi32(_mm256_shuffle_epi8(packed, bytes), shift);
    const __m256i back =
        _mm256_max_epi32(_mm256_and_si256(both, mask), _mm256_and_si256(_mm256_srl_epi32(both, width), mask));
    const __m256i past = _mm256_cmpgt_epi32(back, reach);
    // Behind the last triangle lie positions.
    const __m256i counted = _mm256_cmpgt_epi32(_mm256_set1_epi32(static_cast<int>(count - i)), lanes);
    bad = _mm256_or_si256(bad, _mm256_and_si256(past, counted));
  }
  return _mm256_testz_si256(bad, bad) != 0 && largest < layout.vertex_count;
}

uint32_t smallest_of(__m256i codes) {
  __m128i least = _mm_min_epu32(_mm256_castsi256_si128(codes), _mm256_extracti128_si256(codes, 1));
  least = _mm_min_epu32(least, _mm_srli_si128(least, 8));  // the codes are in the even lanes
  return static_cast<uint32_t>(_mm_cvtsi128_si32(least));
}

uint32_t largest_of(__m256i codes) {
  __m128i most = _mm_max_epu32(_mm256_castsi256_si128(codes), _mm256_extracti128_si256(codes, 1));
  most = _mm_max_epu32(most, _mm_srli_si128(most, 8));
  return static_cast<uint32_t>(_mm_cvtsi128_si32(most));
}

/// The 8 bytes that bit `bit` is in.
long long load_window(const std::byte* data, uint32_t bit) {
  long long window;
  __builtin_memcpy(&window, data + bit / 8, sizeof window);
  return window;
}

/// Four vertices at a time, a 64-bit lane each, in whose low half the codes stand. `kAxis`: the predicted one.
template <uint32_t kAxis>
void scan_codes(const ClusterReader& reader, const std::byte* positions, ClusterScan& scan) {
  const uint32_t* const bits = reader.layout.position_bits;
  const uint32_t stride = bits[0] + bits[1] + bits[2];
  const auto mask_of = [](uint32_t width) { return _mm256_set1_epi64x((1ll << width) - 1); };
  const __m256i mask0 = mask_of(bits[0]);
  const __m256i mask1 = mask_of(bits[1]);
  const __m256i mask2 = mask_of(bits[2]);
  const __m128i shift1 = _mm_cvtsi32_si128(static_cast<int>(bits[0]));
  const __m128i shift2 = _mm_cvtsi32_si128(static_cast<int>(bits[0] + bits[1]));
  const __m256i slope_u = _mm256_set1_epi64x(reader.predictor.slope_u);
  const __m256i slope_v = _mm256_set1_epi64x(reader.predictor.slope_v);
  const __m256i bias = _mm256_set1_epi64x(static_cast<long long>(reader.predictor.bias));
  __m256i least[3];
  __m256i most[3];
  for (int axis = 0; axis < 3; ++axis) {
    least[axis] = _mm256_set1_epi32(-1);
    most[axis] = _mm256_setzero_si256();
  }
  const uint32_t last = reader.layout.vertex_count - 1;
  for (uint32_t v = 0; v <= last; v += 4) {
    // Lanes past the last vertex see it again. Four loads: gathers are slow where processors had to be mended.
    const uint32_t bit0 = v * stride;
    const uint32_t bit1 = (v + 1 < last ? v + 1 : last) * stride;
    const uint32_t bit2 = (v + 2 < last ? v + 2 : last) * stride;
    const uint32_t bit3 = (v + 3 < last ? v + 3 : last) * stride;
    const __m256i window =
        _mm256_srlv_epi64(_mm256_setr_epi64x(load_window(positions, bit0), load_window(positions, bit1),
                                             load_window(positions, bit2), load_window(positions, bit3)),
                          _mm256_setr_epi64x(bit0 % 8, bit1 % 8, bit2 % 8, bit3 % 8));
    __m256i code[3] = {_mm256_and_si256(window, mask0), _mm256_and_si256(_mm256_srl_epi64(window, shift1), mask1),
                       _mm256_and_si256(_mm256_srl_epi64(window, shift2), mask2)};
    if constexpr (kAxis != kNotPredicted) {
      // The product of 16-bit slopes and 15-bit codes, and their sum, are within 32 bits.
      const __m256i sum = _mm256_add_epi64(_mm256_mul_epi32(slope_u, code[(kAxis + 1) % 3]),
                                           _mm256_mul_epi32(slope_v, code[(kAxis + 2) % 3]));
      code[kAxis] = _mm256_add_epi32(code[kAxis],
                                     _mm256_add_epi32(bias, _mm256_srai_epi32(sum, static_cast<int>(kPredictorShift))));
    }
    for (int axis = 0; axis < 3; ++axis) {
      least[axis] = _mm256_min_epu32(least[axis], code[axis]);
      most[axis] = _mm256_max_epu32(most[axis], code[axis]);
    }
  }
  for (int axis = 0; axis < 3; ++axis) {
    scan.smallest[axis] = smallest_of(least[axis]);
    scan.largest[axis] = largest_of(most[axis]);
  }
}

}  // namespace

bool scan_cluster(const ClusterReader& reader, size_t bytes, ClusterScan& scan) {
  const ClusterLayout& layout = reader.layout;
  const uint32_t stride = layout.position_bits[0] + layout.position_bits[1] + layout.position_bits[2];
  // Loads of 16 bytes begin before the cluster's end, loads of 8 bytes at the byte that it may end on.
  if (size_t{4} * layout.end + 16 > bytes || stride > 57) return false;
  scan.triangles_are_good = good_triangles(layout, reader.data);
  const std::byte* positions = reader.data + size_t{4} * layout.positions;
  switch (layout.predicted_axis) {
    case 0:
      scan_codes<0>(reader, positions, scan);
      break;
    case 1:
      scan_codes<1>(reader, positions, scan);
      break;
    case 2:
      scan_codes<2>(reader, positions, scan);
      break;
    default:
      scan_codes<kNotPredicted>(reader, positions, scan);
      break;
  }
  return true;
}

}  // namespace scree::format::isa_avx2
