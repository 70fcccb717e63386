// Random access to the triangles and positions of a cluster, for kernels and the codec. Source: spec/codecs.md,
// clusters.
#pragma once

#include <cstdint>
#include <cstring>

#include "format/bitpack.h"
#include "format/bits.h"
#include "format/geometry/cluster_layout.h"
#include "format/hd.h"

namespace scree::format {

/// Predicts one axis from the two axes after it, in cyclic order. Sums wrap; in a valid cluster they are codes below
/// 2^24.
struct ClusterPredictor {
  uint32_t axis;  // or kNotPredicted
  int32_t slope_u;
  int32_t slope_v;
  uint32_t bias;

  /// Adds the predicted part to the stored codes of a vertex.
  SCREE_HD void apply(uint32_t code[3]) const {
    if (axis == kNotPredicted) return;
    // Constant indices, so that the codes stay in registers.
    const int32_t u = static_cast<int32_t>(axis == 0 ? code[1] : axis == 1 ? code[2] : code[0]);
    const int32_t v = static_cast<int32_t>(axis == 0 ? code[2] : axis == 1 ? code[0] : code[1]);
    // Codes of 15 bits and slopes of 16: the sum stays within int32.
    const uint32_t sum = bias + static_cast<uint32_t>((slope_u * u + slope_v * v) >> kPredictorShift);
    for (uint32_t i = 0; i < 3; ++i) code[i] += axis == i ? sum : 0;
  }
};

/// Reads a cluster with a validated record. On a GPU `data` must be 4-byte aligned.
struct ClusterReader {
  const std::byte* data;  // cluster data of the chunk
  ClusterLayout layout;
  ClusterPredictor predictor;
  uint32_t first_triangle;  // index in the chunk
  uint32_t first_vertex;
  uint32_t min[3];  // offset of code 0 from the chunk's position_min

  /// Bits of a vertex.
  SCREE_HD uint32_t stride() const {
    return layout.position_bits[0] + layout.position_bits[1] + layout.position_bits[2];
  }

  /// Word `place` of the chunk's cluster data.
  SCREE_HD uint32_t word(uint32_t place) const { return unpack(data, uint64_t{place} * 32, 32); }

  /// The largest vertex of a triangle minus the largest vertex of the triangle before; 2 replaces the latter for the
  /// first triangle.
  SCREE_HD uint32_t step(uint32_t triangle) const {
    const uint32_t words = (layout.triangle_count + 31) / 32;
    const uint32_t low = word(layout.steps + triangle / 32) >> (triangle % 32) & 1;
    if (!layout.wide_steps) return low;
    return low + 2 * (word(layout.steps + words + triangle / 32) >> (triangle % 32) & 1);
  }

  /// Largest vertex of a triangle of the cluster. All vertex and triangle numbers here count from 0 in the cluster.
  SCREE_HD uint32_t largest(uint32_t triangle) const {
    const uint32_t words = (layout.triangle_count + 31) / 32;
    uint32_t sum = 2;
    for (uint32_t i = 0; i <= triangle / 32; ++i) {
      const uint32_t counted = i < triangle / 32 ? 0xffffffffu : 0xffffffffu >> (31 - triangle % 32);
      sum += count_bits(word(layout.steps + i) & counted);
      if (layout.wide_steps) sum += 2 * count_bits(word(layout.steps + words + i) & counted);
    }
    return sum;
  }

  /// The distances from the largest vertex of a triangle back to its second and its third vertex.
  SCREE_HD void distances(uint32_t triangle, uint32_t out[2]) const {
    const uint32_t bits = layout.distance_bits;
    const uint32_t both = unpack(data, uint64_t{layout.distances} * 32 + uint64_t{triangle} * (2 * bits), 2 * bits);
    out[0] = both & ((1u << bits) - 1);
    out[1] = both >> bits;
  }

  /// The three vertices of a triangle, the largest first.
  SCREE_HD void triangle(uint32_t number, uint32_t out[3]) const {
    uint32_t back[2];
    distances(number, back);
    out[0] = largest(number);
    out[1] = out[0] - back[0];
    out[2] = out[0] - back[1];
  }

  /// The stored codes of a vertex, without the prediction.
  SCREE_HD void stored(uint32_t vertex, uint32_t out[3]) const {
    uint64_t bit = uint64_t{layout.positions} * 32 + uint64_t{vertex} * stride();
    for (int i = 0; i < 3; ++i) {
      out[i] = unpack(data, bit, layout.position_bits[i]);
      bit += layout.position_bits[i];
    }
  }

  /// Offset of a vertex from the chunk's position_min.
  SCREE_HD void offset(uint32_t vertex, uint32_t out[3]) const {
    stored(vertex, out);
    predictor.apply(out);
    for (int i = 0; i < 3; ++i) out[i] += min[i];
  }
};

/// `data`: the chunk's cluster data, of which only the record's cluster is read.
SCREE_HD inline ClusterReader make_cluster_reader(const ClusterRecord& record, const ClusterBounds& bounds,
                                                  const std::byte* data) {
  ClusterReader reader;
  reader.data = data;
  reader.layout = cluster_layout(record);
  reader.first_triangle = record.first_triangle;
  reader.first_vertex = record.first_vertex;
  for (int i = 0; i < 3; ++i) reader.min[i] = bounds_min(bounds, i);
  reader.predictor = {reader.layout.predicted_axis, 0, 0, 0};
  if (reader.layout.predicted_axis != kNotPredicted) {
    const uint32_t slopes = reader.word(reader.layout.prediction);
    reader.predictor.slope_u = static_cast<int16_t>(slopes & 0xffffu);
    reader.predictor.slope_v = static_cast<int16_t>(slopes >> 16);
    reader.predictor.bias = reader.word(reader.layout.prediction + 1);
  }
  return reader;
}

}  // namespace scree::format
