#include <immintrin.h>

#include "format/geometry/cluster_scan.h"
#include "format/geometry/field_pick_avx2.h"
#include "format/geometry/word_writer.h"

// Do not call inline functions of other headers here: the linker could use their copy of this file, which needs AVX2,
// for all callers (tests/CMakeLists.txt checks this).
namespace scree::format::isa_avx2 {
namespace {

struct Tables {
  /// Per byte value: the number of ones among its lowest 1, 2, ... 8 bits, one byte each.
  uint64_t prefix_counts[256];
  /// Spreads the distances of eight triangles to lanes of 32 bits: the source bytes of each lane, and the shift within
  /// them. The index of a Spread is the distance's bits d; a triangle takes 2 * d bits.
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

uint32_t load_word(const std::byte* at) {
  uint32_t word;
  __builtin_memcpy(&word, at, sizeof word);
  return word;
}

/// Checks that no distance leads before the first vertex and no vertex is past the last. `data`: the cluster's own.
bool good_triangles(const ClusterLayout& layout, const std::byte* data) {
  const uint32_t count = layout.triangle_count;
  const uint32_t bits = layout.distance_bits;
  const uint32_t words = (count + 31) / 32;
  const std::byte* steps = data + size_t{4} * (layout.steps - layout.prediction);
  const std::byte* wide = layout.wide_steps ? steps + size_t{4} * words : nullptr;
  const std::byte* distances = data + size_t{4} * (layout.distances - layout.prediction);
  // Steps are never negative, so the last triangle's vertex is the largest.
  uint32_t last = 2;
  for (uint32_t i = 0; i < words; ++i) {
    last += static_cast<uint32_t>(__builtin_popcount(load_word(steps + size_t{4} * i)));
    if (wide != nullptr) last += 2 * static_cast<uint32_t>(__builtin_popcount(load_word(wide + size_t{4} * i)));
  }
  const __m256i bytes = _mm256_load_si256(reinterpret_cast<const __m256i*>(kTables.spreads[bits].bytes));
  const __m256i shift = _mm256_load_si256(reinterpret_cast<const __m256i*>(kTables.spreads[bits].shift));
  const uint32_t longest = (1u << bits) - 1;
  const __m256i mask = _mm256_set1_epi32(static_cast<int>(longest));
  const __m256i lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
  const __m128i width = _mm_cvtsi32_si128(static_cast<int>(bits));
  __m256i bad = _mm256_setzero_si256();
  uint32_t largest = 2;
  // Once the largest vertex has reached the longest possible distance, no later triangle can fail.
  for (uint32_t i = 0; i < count && largest < longest; i += 8) {
    uint64_t sums = kTables.prefix_counts[static_cast<uint8_t>(steps[i / 8])];
    if (wide != nullptr) sums += 2 * kTables.prefix_counts[static_cast<uint8_t>(wide[i / 8])];  // at most 24 per byte
    const __m256i reach = _mm256_add_epi32(_mm256_set1_epi32(static_cast<int>(largest)),
                                           _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(static_cast<long long>(sums))));
    largest += static_cast<uint32_t>(sums >> 56);
    const __m256i packed = _mm256_broadcastsi128_si256(
        _mm_loadu_si128(reinterpret_cast<const __m128i*>(distances + size_t{i} / 8 * 2 * bits)));
    const __m256i both = _mm256_srlv_epi32(_mm256_shuffle_epi8(packed, bytes), shift);
    const __m256i back =
        _mm256_max_epi32(_mm256_and_si256(both, mask), _mm256_and_si256(_mm256_srl_epi32(both, width), mask));
    const __m256i past = _mm256_cmpgt_epi32(back, reach);
    // Lanes behind the last triangle hold positions and do not count.
    const __m256i counted = _mm256_cmpgt_epi32(_mm256_set1_epi32(static_cast<int>(count - i)), lanes);
    bad = _mm256_or_si256(bad, _mm256_and_si256(past, counted));
  }
  return _mm256_testz_si256(bad, bad) != 0 && last < layout.vertex_count;
}

/// The largest code of each axis, eight vertices at a time. `kIsPredicted`: one axis is predicted from the others.
template <bool kIsPredicted>
void scan_positions(const ClusterReader& reader, const std::byte* positions, uint32_t largest[3]) {
  const uint32_t* const bits = reader.layout.position_bits;
  const uint32_t offsets[3] = {0, bits[0], bits[0] + bits[1]};
  // The predicted axis comes last.
  const uint32_t first = kIsPredicted ? (reader.predictor.axis + 1) % 3 : 0;
  const uint32_t axes[3] = {first, (first + 1) % 3, (first + 2) % 3};
  EightRecords records(bits[0] + bits[1] + bits[2]);
  EightRecords::Field fields[3];
  for (int i = 0; i < 3; ++i) fields[i] = records.field(offsets[axes[i]], bits[axes[i]]);
  const __m256i slopes = _mm256_set1_epi32(static_cast<int>((static_cast<uint32_t>(reader.predictor.slope_u) & 0xffff) |
                                                            static_cast<uint32_t>(reader.predictor.slope_v) << 16));
  const __m256i bias = _mm256_set1_epi32(static_cast<int>(reader.predictor.bias));
  __m256i most[3] = {_mm256_setzero_si256(), _mm256_setzero_si256(), _mm256_setzero_si256()};
  const auto codes = [&](__m256i code[3]) {
    for (int i = 0; i < 3; ++i) code[i] = kIsPredicted ? records.low(fields[i]) : records.high(fields[i]);
    if constexpr (kIsPredicted) {
      // Codes have 15 bits and slopes 16, so the sum of the products fits 32 bits.
      const __m256i sum = _mm256_madd_epi16(_mm256_or_si256(code[0], _mm256_slli_epi32(code[1], 16)), slopes);
      code[2] =
          _mm256_add_epi32(code[2], _mm256_add_epi32(bias, _mm256_srai_epi32(sum, static_cast<int>(kPredictorShift))));
    }
  };
  const uint32_t count = reader.layout.vertex_count;
  const std::byte* at = positions;
  __m256i code[3];
  uint32_t v = 0;
  for (; v + 8 <= count; v += 8, at += records.stride()) {
    records.load(at);
    codes(code);
    for (int i = 0; i < 3; ++i) most[i] = _mm256_max_epu32(most[i], code[i]);
  }
  if (v < count) {
    const __m256i counted =
        _mm256_cmpgt_epi32(_mm256_set1_epi32(static_cast<int>(count - v)), EightRecords::record_numbers());
    records.load(at);
    codes(code);
    for (int i = 0; i < 3; ++i) most[i] = _mm256_max_epu32(most[i], _mm256_and_si256(code[i], counted));
  }
  for (int i = 0; i < 3; ++i)
    largest[axes[i]] = kIsPredicted ? largest_lane(most[i]) : largest_high(most[i], bits[axes[i]]);
}

}  // namespace

bool scan_cluster(const ClusterReader& reader, size_t bytes, ClusterScan& scan) {
  const ClusterLayout& layout = reader.layout;
  if (layout.position_bits[0] + layout.position_bits[1] + layout.position_bits[2] > kMostPickedStride) return false;
  const std::byte* data = reader.data + size_t{4} * layout.prediction;
  alignas(32) std::byte copy[4 * kMostClusterWords + kPickReach];
  // Loads read past the bytes that they use, so clusters at the end of the data are copied into a longer buffer.
  if (size_t{4} * layout.end + kPickReach > bytes) {
    __builtin_memcpy(copy, data, size_t{4} * (layout.end - layout.prediction));
    data = copy;
  }
  scan.triangles_are_good = good_triangles(layout, data);
  const std::byte* positions = data + size_t{4} * (layout.positions - layout.prediction);
  if (layout.predicted_axis == kNotPredicted)
    scan_positions<false>(reader, positions, scan.largest);
  else
    scan_positions<true>(reader, positions, scan.largest);
  return true;
}

}  // namespace scree::format::isa_avx2
