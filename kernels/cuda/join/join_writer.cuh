// Writes placed clusters as they are stored in pages that are not split, by a warp.
#pragma once

#include "format/bitpack.h"
#include "format/geometry/offset_box.h"
#include "kernels/cuda/join/join_vertices.cuh"

namespace scree::kernels::joining {

using format::ClusterBounds;
using format::ClusterLayout;
using format::ClusterRecord;
using format::OffsetBox;

/// The vertices of a cluster.
struct PlacedCluster {
  uint32_t at[3][kNumbers];
  OffsetBox box;
};

/// The most words of a cluster's data: prediction, steps, distances of 7 bits, positions.
inline constexpr uint32_t kMostWords =
    2 + 2 * kMost / 32 + 2 * 7 * kMost / 32 + 3 * format::kMaxPositionBits * kMost / 32;

/// Writes the clusters of a part one after the other.
class Writer {
 public:
  __device__ Writer(const JoinTask& task, std::byte* arena, uint32_t* words)
      : cluster_count_(task.cluster_count), all_words_(task.cluster_words), words_(words) {
    const uint32_t groups = (cluster_count_ + format::kGroupClusters - 1) / format::kGroupClusters;
    for (uint32_t axis = 0; axis < 3; ++axis) most_[axis] = task.largest[axis];
    group_bounds_ = reinterpret_cast<ClusterBounds*>(arena + task.to);
    bounds_ = group_bounds_ + groups;
    records_ = reinterpret_cast<ClusterRecord*>(bounds_ + cluster_count_);
    data_ = reinterpret_cast<uint32_t*>(records_ + cluster_count_);
  }

  /// Writes cluster `number`, if it is good, and returns whether it is.
  __device__ bool write(const ReadTriangles& in, const PlacedCluster& placed, uint32_t number, uint32_t lane) {
    const OffsetBox box = placed.box;
    uint32_t bits[3];
    for (uint32_t axis = 0; axis < 3; ++axis) {
      if (box.max[axis] > most_[axis]) return false;
      bits[axis] = format::bits_of(box.max[axis] - box.min[axis]);
    }
    uint32_t residuals[kRounds] = {};  // on the predicted axis
    uint32_t bias = 0;
    if (in.axis != format::kNotPredicted && !predict(in, placed, bits, residuals, bias, lane)) return false;
    ClusterRecord record{};
    record.place = in.axis << 29 | in.is_wide << 31;
    record.counts = (in.triangle_count - 1) | (in.vertex_count - 1) << 7 | in.distance_bits << 14;
    for (uint32_t axis = 0; axis < 3; ++axis) record.counts |= bits[axis] << (17 + 5 * axis);
    const ClusterLayout layout = format::cluster_layout(record);
    if (layout.end > all_words_ - done_words_) return false;

    for (uint32_t i = lane; i < layout.end; i += kWarpLanes) words_[i] = 0;
    __syncwarp();
    if (lane == 0 && in.axis != format::kNotPredicted) {
      words_[0] = in.slopes;
      words_[1] = bias;
    }
    const uint32_t step_words = (in.triangle_count + 31) / 32;
    if (lane < step_words) {
      words_[layout.steps + lane] = in.steps[0][lane];
      if (in.is_wide != 0) words_[layout.steps + step_words + lane] = in.steps[1][lane];
    }
    for (uint32_t i = lane; i < in.triangle_count; i += kWarpLanes) {
      const uint32_t both = (in.distances[i] & 0xff) | in.distances[i] >> 8 << in.distance_bits;
      put(layout.distances * 32 + i * 2 * in.distance_bits, both);
    }
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) {
      const uint32_t v = k * kWarpLanes + lane;
      if (v >= in.vertex_count) continue;
      uint32_t bit = layout.positions * 32 + v * (bits[0] + bits[1] + bits[2]);
      for (uint32_t axis = 0; axis < 3; ++axis) {
        put(bit, axis == in.axis ? residuals[k] - bias : placed.at[axis][v] - box.min[axis]);
        bit += bits[axis];
      }
    }
    __syncwarp();
    for (uint32_t i = lane; i < layout.end; i += kWarpLanes) data_[done_words_ + i] = words_[i];
    record.place |= done_words_;
    record.first_triangle = first_triangle_;
    record.first_vertex = first_vertex_;
    write_bounds(record, box, number, lane);
    done_words_ += layout.end;
    first_triangle_ += in.triangle_count;
    first_vertex_ += in.vertex_count;
    return true;
  }

  /// Ends the part. Returns whether its data took the expected words.
  __device__ bool finish(uint32_t lane) const {
    if (done_words_ != all_words_) return false;
    const uint64_t end = format::packed_bytes(all_words_, 32) / 4;
    for (uint64_t i = all_words_ + lane; i < end; i += kWarpLanes) data_[i] = 0;
    return true;
  }

 private:
  /// Computes the residuals of the predicted axis, their smallest one and the bits of their codes. Returns false if an
  /// axis takes too many bits.
  __device__ static bool predict(const ReadTriangles& in, const PlacedCluster& placed, uint32_t bits[3],
                                 uint32_t residuals[kRounds], uint32_t& bias, uint32_t lane) {
    const uint32_t u = in.axis == 2 ? 0 : in.axis + 1;
    const uint32_t v = u == 2 ? 0 : u + 1;
    const OffsetBox& box = placed.box;
    const auto is_wide = [&](uint32_t axis) {
      return box.max[axis] - box.min[axis] >= 1u << format::kMaxPredictorBits;
    };
    if (is_wide(u) || is_wide(v)) return false;
    const int32_t slope_u = static_cast<int16_t>(in.slopes & 0xffff);
    const int32_t slope_v = static_cast<int16_t>(in.slopes >> 16);
    int32_t smallest = INT32_MAX;
    int32_t largest = INT32_MIN;
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) {
      const uint32_t i = k * kWarpLanes + lane;
      if (i >= in.vertex_count) continue;
      const auto code = [&](uint32_t axis) { return static_cast<int32_t>(placed.at[axis][i] - box.min[axis]); };
      const int32_t residual = code(in.axis) - ((slope_u * code(u) + slope_v * code(v)) >> format::kPredictorShift);
      residuals[k] = static_cast<uint32_t>(residual);
      smallest = min_of(smallest, residual);
      largest = max_of(largest, residual);
    }
    smallest = join_lanes(smallest, [](int32_t a, int32_t b) { return min_of(a, b); });
    largest = join_lanes(largest, [](int32_t a, int32_t b) { return max_of(a, b); });
    bias = static_cast<uint32_t>(smallest);
    const uint32_t range = static_cast<uint32_t>(largest) - bias;
    for (uint32_t axis = 0; axis < 3; ++axis)
      if (axis == in.axis) bits[axis] = format::bits_of(range);
    return range <= kMostOffset;
  }

  /// Puts a value at a bit of the words, which are 0 there.
  __device__ void put(uint32_t bit, uint32_t value) {
    if (value == 0) return;
    const uint32_t shift = bit % 32;
    atomicOr(&words_[bit / 32], value << shift);
    if (shift != 0 && value >> (32 - shift) != 0) atomicOr(&words_[bit / 32 + 1], value >> (32 - shift));
  }

  __device__ void write_bounds(const ClusterRecord& record, const OffsetBox& box, uint32_t number, uint32_t lane) {
    const bool begins = number % format::kGroupClusters == 0;
    for (uint32_t axis = 0; axis < 3; ++axis) {
      group_.min[axis] = begins ? box.min[axis] : min_of(group_.min[axis], box.min[axis]);
      group_.max[axis] = begins ? box.max[axis] : max_of(group_.max[axis], box.max[axis]);
    }
    if (lane != 0) return;
    constexpr uint32_t kOrigin[3] = {};
    records_[number] = record;
    bounds_[number] = format::bounds_of(box, kOrigin);
    if ((number + 1) % format::kGroupClusters == 0 || number + 1 == cluster_count_)
      group_bounds_[number / format::kGroupClusters] = format::bounds_of(group_, kOrigin);
  }

  uint32_t cluster_count_;
  uint32_t all_words_;
  uint32_t most_[3];
  uint32_t* words_;  // of a cluster
  ClusterBounds* group_bounds_;
  ClusterBounds* bounds_;
  ClusterRecord* records_;
  uint32_t* data_;
  OffsetBox group_{};
  uint32_t done_words_ = 0;
  uint32_t first_triangle_ = 0;  // of the next cluster
  uint32_t first_vertex_ = 0;
};

}  // namespace scree::kernels::joining
