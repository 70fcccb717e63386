#include "format/geometry/code_scan.h"

#include "format/geometry/field_pick_avx2.h"

// As in cluster_scan_avx2.cpp, do not call inline functions of other headers here.
namespace scree::format::isa_avx2 {

uint64_t scan_codes(const std::byte* stream, size_t bytes, uint64_t count, uint32_t bits, uint32_t& largest) {
  if (bits > kMostPickedBits) return 0;
  EightRecords records(bits);
  const EightRecords::Field field = records.field(0, bits);
  __m256i most = _mm256_setzero_si256();
  uint64_t done = 0;
  for (size_t place = 0; done + 8 <= count && place + kPickReach <= bytes; done += 8, place += bits) {
    records.load(stream + place);
    most = _mm256_max_epu32(most, records.high(field));
  }
  const uint32_t found = largest_high(most, bits);
  if (found > largest) largest = found;
  return done;
}

uint64_t scan_triples(const std::byte* stream, size_t bytes, uint64_t count, const uint8_t* bits, uint32_t* largest) {
  const uint32_t stride = uint32_t{bits[0]} + bits[1] + bits[2];
  if (stride > kMostPickedStride) return 0;
  EightRecords records(stride);
  const EightRecords::Field x = records.field(0, bits[0]);
  const EightRecords::Field y = records.field(bits[0], bits[1]);
  const EightRecords::Field z = records.field(uint32_t{bits[0]} + bits[1], bits[2]);
  __m256i most[3] = {_mm256_setzero_si256(), _mm256_setzero_si256(), _mm256_setzero_si256()};
  uint64_t done = 0;
  for (size_t place = 0; done + 8 <= count && place + kPickReach <= bytes; done += 8, place += stride) {
    records.load(stream + place);
    most[0] = _mm256_max_epu32(most[0], records.high(x));
    most[1] = _mm256_max_epu32(most[1], records.high(y));
    most[2] = _mm256_max_epu32(most[2], records.high(z));
  }
  for (int axis = 0; axis < 3; ++axis) {
    const uint32_t found = largest_high(most[axis], bits[axis]);
    if (found > largest[axis]) largest[axis] = found;
  }
  return done;
}

}  // namespace scree::format::isa_avx2
