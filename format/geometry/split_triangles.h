// Reads the triangles of a cluster from the streams of a split page. Source: spec/codecs.md, split pages.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "format/bytes.h"
#include "format/geometry/split_streams.h"
#include "format/geometry/vertex_predictor.h"

namespace scree::format::split_streams {

/// Bytes of each half of a cluster's steps.
constexpr uint32_t bytes_of_steps(uint32_t triangle_count) {
  return (triangle_count + 7) / 8;
}

/// The bytes of a cluster in the streams of steps and of distances.
struct TriangleBytes {
  const std::byte* steps;
  const std::byte* distances;
  uint32_t triangle_count;
  uint32_t distance_bits;
  bool wide_steps;
};

/// For each byte of steps, eight bytes: the number of ones up to each bit.
inline constexpr auto kOnesUpTo = [] {
  std::array<uint64_t, 256> ones{};
  for (uint32_t byte = 0; byte < 256; ++byte)
    for (uint32_t bit = 0; bit < 8; ++bit)
      ones[byte] |= static_cast<uint64_t>(std::popcount(byte & ((2u << bit) - 1))) << 8 * bit;
  return ones;
}();

/// Computes the largest vertex of each triangle. Returns whether all are below `vertex_count`.
inline bool sum_steps(const TriangleBytes& bytes, uint32_t vertex_count, ClusterTriangles& triangles) {
  std::byte* const largest = reinterpret_cast<std::byte*>(triangles.largest.data());
  const uint32_t step_bytes = bytes_of_steps(bytes.triangle_count);
  uint32_t sum = 2;
  for (uint32_t i = 0; i < step_bytes; ++i) {
    if (sum >= vertex_count) return false;  // from 127 on, eight steps of 3 stay within a byte
    uint64_t eight = sum * 0x0101010101010101u + kOnesUpTo[std::to_integer<uint32_t>(bytes.steps[i])];
    if (bytes.wide_steps) eight += 2 * kOnesUpTo[std::to_integer<uint32_t>(bytes.steps[step_bytes + i])];
    store(largest + 8 * i, eight);
    sum = static_cast<uint32_t>(eight >> 56);
  }
  return triangles.largest[bytes.triangle_count - 1] < vertex_count;
}

/// Returns whether all distances have at most distance_bits, and none passes its triangle's largest vertex.
inline bool unpack_distances(const TriangleBytes& bytes, ClusterTriangles& triangles) {
  const uint32_t count = bytes.triangle_count;
  const bool is_short = bytes.distance_bits <= kShortDistance;
  const std::byte* const pairs = bytes.distances;
  uint8_t* const first = triangles.back[0].data();
  uint8_t* const second = triangles.back[1].data();
  for (uint32_t i = 0; i < count && is_short; ++i) {
    first[i] = std::to_integer<uint8_t>(pairs[i] & std::byte{15});
    second[i] = std::to_integer<uint8_t>(pairs[i] >> 4);
  }
  for (uint32_t i = 0; i < count && !is_short; ++i) {
    first[i] = std::to_integer<uint8_t>(pairs[2 * i]);
    second[i] = std::to_integer<uint8_t>(pairs[2 * i + 1]);
  }
  const uint8_t* const largest = triangles.largest.data();
  uint8_t all = 0;
  uint8_t past = 0;
  for (uint32_t i = 0; i < count; ++i) {
    const uint8_t further = std::max(first[i], second[i]);
    all |= further;
    past |= static_cast<uint8_t>(std::max(further, largest[i]) ^ largest[i]);
  }
  return past == 0 && all >> bytes.distance_bits == 0;
}

/// Returns false if a triangle has vertices that are not below `vertex_count`, or a distance of too many bits; then
/// `triangles` are unspecified.
inline bool read_triangles(const TriangleBytes& bytes, uint32_t vertex_count, ClusterTriangles& triangles) {
  triangles.count = bytes.triangle_count;
  triangles.distance_bits = bytes.distance_bits;
  return sum_steps(bytes, vertex_count, triangles) && unpack_distances(bytes, triangles);
}

}  // namespace scree::format::split_streams
