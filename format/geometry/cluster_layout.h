// A clustered chunk's records, and the layout of a cluster's data. Runs in kernels too. Source: spec/codecs.md,
// clusters.
#pragma once

#include <cstdint>

#include "format/hd.h"

namespace scree::format {

inline constexpr uint32_t kMaxClusterTriangles = 128;
inline constexpr uint32_t kMaxClusterVertices = 128;
inline constexpr uint32_t kGroupClusters = 32;          // clusters per group of bounds; the last may have fewer
inline constexpr uint32_t kMaxClusterWords = 1u << 29;  // of a chunk's cluster data
inline constexpr uint32_t kMaxPredictorBits = 15;       // of a code on the two axes from which the third is predicted
inline constexpr uint32_t kPredictorShift = 14;         // slopes are multiples of 2^-14
inline constexpr uint32_t kNotPredicted = 3;            // instead of an axis

/// The box of a cluster's or a group's vertices, in lattice offsets from the chunk's position_min. Culling reads
/// nothing else. `axis[i]`: the smallest offset in the low 24 bits, extent code e in the high 8. `shift`: 0 to 16; an
/// offset is at most smallest + ((e + 1) << shift) - 1.
struct ClusterBounds {
  uint32_t axis[3];
  uint32_t shift;
};
static_assert(sizeof(ClusterBounds) == 16);

/// Smallest offset along an axis (0 to 2), from the chunk's position_min.
SCREE_HD constexpr uint32_t bounds_min(const ClusterBounds& bounds, int axis) {
  return bounds.axis[axis] & 0xffffffu;
}
/// Upper bound of (largest offset - smallest offset).
SCREE_HD constexpr uint32_t bounds_extent(const ClusterBounds& bounds, int axis) {
  return (((bounds.axis[axis] >> 24) + 1) << (bounds.shift & 31)) - 1;
}

/// Triangles of a chunk and the vertices they use. Bits of `place`:
/// - 0 to 28: start of its data, in 4-byte words from the start of the chunk's cluster data;
/// - 29 and 30: the axis that is predicted from the other two, or kNotPredicted;
/// - 31: set where steps have two bits.
/// Bits of `counts`:
/// - 0 to 6: triangles less one;
/// - 7 to 13: vertices less one;
/// - 14 to 16: the bits of a distance;
/// - 17 to 21, 22 to 26, 27 to 31: the bits of a position's x, y and z codes; for the predicted axis: of its residuals.
struct ClusterRecord {
  uint32_t place;
  uint32_t first_triangle;  // in the chunk: the sum of the counts before
  uint32_t first_vertex;    // likewise
  uint32_t counts;
};
static_assert(sizeof(ClusterRecord) == 16);

/// A cluster's decoded record and the layout of its data: word offsets from the start of the chunk's cluster data.
struct ClusterLayout {
  uint32_t triangle_count;  // 1 to 128
  uint32_t vertex_count;    // 1 to 128
  uint32_t distance_bits;   // 0 to 7
  uint32_t position_bits[3];
  uint32_t predicted_axis;  // or kNotPredicted
  bool wide_steps;
  uint32_t prediction;  // two words: slopes (i16 low and high), bias (i32); only where an axis is predicted
  uint32_t steps;       // ceil(triangle_count / 32) words: bit 0 of each triangle's step; then, if wide, bit 1
  uint32_t distances;   // 2 * distance_bits per triangle
  uint32_t positions;   // the sum of position_bits per vertex
  uint32_t end;
};

/// Decodes a record. Defined for any record. The caller checks whether the data fit the chunk.
SCREE_HD constexpr ClusterLayout cluster_layout(const ClusterRecord& record) {
  ClusterLayout out{};
  out.triangle_count = (record.counts & 127) + 1;
  out.vertex_count = (record.counts >> 7 & 127) + 1;
  out.distance_bits = record.counts >> 14 & 7;
  for (uint32_t i = 0; i < 3; ++i) out.position_bits[i] = record.counts >> (17 + 5 * i) & 31;
  out.predicted_axis = record.place >> 29 & 3;
  out.wide_steps = record.place >> 31 != 0;
  const uint32_t step_words = (out.triangle_count + 31) / 32;
  out.prediction = record.place & (kMaxClusterWords - 1);
  out.steps = out.prediction + (out.predicted_axis != kNotPredicted ? 2 : 0);
  out.distances = out.steps + (out.wide_steps ? 2 * step_words : step_words);
  out.positions = out.distances + (out.triangle_count * 2 * out.distance_bits + 31) / 32;
  const uint32_t stride = out.position_bits[0] + out.position_bits[1] + out.position_bits[2];
  out.end = out.positions + (out.vertex_count * stride + 31) / 32;
  return out;
}

}  // namespace scree::format
