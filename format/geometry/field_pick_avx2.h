// Extracts one field from each of eight bit-packed records into lanes of 32 bits. Only for sources built with -mavx2:
// all of it is static, so that the linker shares nothing with code for other processors.
#pragma once

#include <cstddef>
#include <cstdint>

#include <immintrin.h>

namespace scree::format::isa_avx2 {
namespace {

/// Widest record and widest field, in bits: two records that begin inside a byte must lie in 16 bytes, a field in 4.
inline constexpr uint32_t kMostPickedStride = 60;
inline constexpr uint32_t kMostPickedBits = 25;

/// Bytes that load() may read, counted from the first of the eight records.
inline constexpr size_t kPickReach = 64;

/// Eight records of `stride` bits (0 to kMostPickedStride). They take `stride` bytes and begin on a byte, and so do the
/// next eight. The lanes hold records 0, 1, 4, 5, 2, 3, 6, 7, because each 16 loaded bytes hold two.
class EightRecords {
 public:
  explicit EightRecords(uint32_t stride)
      : stride_(stride), place1_(2 * stride / 8), place2_(4 * stride / 8), place3_(6 * stride / 8) {}

  /// Loads the eight records that begin at `at`.
  void load(const std::byte* at) {
    const auto two = [at](size_t place) { return _mm_loadu_si128(reinterpret_cast<const __m128i*>(at + place)); };
    records0123_ = _mm256_inserti128_si256(_mm256_castsi128_si256(two(0)), two(place1_), 1);
    records4567_ = _mm256_inserti128_si256(_mm256_castsi128_si256(two(place2_)), two(place3_), 1);
  }

  uint32_t stride() const { return stride_; }
  static __m256i record_numbers() { return _mm256_setr_epi32(0, 1, 4, 5, 2, 3, 6, 7); }

  /// A field of `bits` bits (0 to kMostPickedBits) that begins `offset` bits into a record.
  struct Field {
    __m256i bytes;  // for each lane, the indices of its bytes among the 16 loaded ones
    __m256i right;  // right shift that moves the field to the low end of its lane
    __m256i left;   // left shift that moves it to the high end
    __m256i mask;
  };
  /// Makes the field for low() and high().
  Field field(uint32_t offset, uint32_t bits) const {
    const auto residue = [this](uint32_t records) { return static_cast<int>(records * stride_ % 8); };
    const auto next = static_cast<int>(stride_);
    const __m256i bit = _mm256_add_epi32(_mm256_set1_epi32(static_cast<int>(offset)),
                                         _mm256_setr_epi32(0, next, residue(4), residue(4) + next, residue(2),
                                                           residue(2) + next, residue(6), residue(6) + next));
    // Byte i of a lane gets the index of the field's first byte plus i. If that is above 15, the byte holds no bit of
    // the field.
    const __m256i spread = _mm256_setr_epi8(0, 0, 0, 0, 4, 4, 4, 4, 8, 8, 8, 8, 12, 12, 12, 12,  //
                                            0, 0, 0, 0, 4, 4, 4, 4, 8, 8, 8, 8, 12, 12, 12, 12);
    Field field;
    field.bytes = _mm256_and_si256(
        _mm256_add_epi8(_mm256_shuffle_epi8(_mm256_srli_epi32(bit, 3), spread), _mm256_set1_epi32(0x03020100)),
        _mm256_set1_epi8(15));
    field.right = _mm256_and_si256(bit, _mm256_set1_epi32(7));
    field.left = _mm256_sub_epi32(_mm256_set1_epi32(static_cast<int>(32 - bits)), field.right);
    field.mask = _mm256_set1_epi32(static_cast<int>((1u << bits) - 1));
    return field;
  }

  /// The field in the lowest bits of each lane.
  __m256i low(const Field& field) const {
    return _mm256_and_si256(_mm256_srlv_epi32(lanes(field), field.right), field.mask);
  }
  /// The field in the highest bits, with the record's earlier bits below. Lanes compare as their fields do.
  __m256i high(const Field& field) const { return _mm256_sllv_epi32(lanes(field), field.left); }

 private:
  __m256i lanes(const Field& field) const {
    return _mm256_blend_epi32(_mm256_shuffle_epi8(records0123_, field.bytes),
                              _mm256_shuffle_epi8(records4567_, field.bytes), 0b11001100);
  }

  uint32_t stride_;
  size_t place1_;
  size_t place2_;
  size_t place3_;
  __m256i records0123_{};
  __m256i records4567_{};
};

/// The largest of eight unsigned numbers.
uint32_t largest_lane(__m256i lanes) {
  __m128i most = _mm_max_epu32(_mm256_castsi256_si128(lanes), _mm256_extracti128_si256(lanes, 1));
  most = _mm_max_epu32(most, _mm_srli_si128(most, 8));
  most = _mm_max_epu32(most, _mm_srli_si128(most, 4));
  return static_cast<uint32_t>(_mm_cvtsi128_si32(most));
}

/// The largest of fields of `bits` bits that lie in the highest bits of their lanes.
uint32_t largest_high(__m256i lanes, uint32_t bits) {
  return static_cast<uint32_t>(uint64_t{largest_lane(lanes)} >> (32 - bits));
}

}  // namespace
}  // namespace scree::format::isa_avx2
