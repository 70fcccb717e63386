// Reads the triangles of clusters from the streams of a split page, by a warp.
#pragma once

#include "format/bits.h"
#include "format/geometry/cluster_layout.h"
#include "format/geometry/split_streams.h"
#include "format/layout.h"
#include "kernels/cuda/common/warp.cuh"
#include "kernels/join_task.h"
#include "kernels/math.h"

namespace scree::kernels::joining {

using namespace format::split_streams;
using format::count_bits;

inline constexpr uint32_t kMost = format::kMaxClusterVertices;
static_assert(kMost == format::kMaxClusterTriangles);
inline constexpr uint32_t kRounds = kMost / kWarpLanes;  // of a warp over a cluster's vertices or triangles
inline constexpr uint32_t kNothing = ~0u;
inline constexpr uint32_t kNoVertex = 0xff;
inline constexpr uint16_t kNoLink = kNoVertex << 8;
inline constexpr uint16_t kFirstLink = kNoLink | 1;

/// A cluster's counts, form and triangles.
struct ReadTriangles {
  uint32_t triangle_count;
  uint32_t vertex_count;
  uint32_t distance_bits;
  uint32_t is_wide;  // steps have two bits
  uint32_t axis;     // the predicted one, or kNotPredicted
  uint32_t slopes;
  uint32_t steps[2][kMost / 32];
  uint16_t distances[kMost];  // the second in the high byte
  uint8_t largest[kMost];     // vertex of each triangle
  uint8_t begins[kMost];      // the first triangle with that largest vertex, or 0xff
  // Per triangle the other two vertices, and the vertex on the other side of their edge or kNoVertex; kNothing if the
  // triangle does not predict its largest vertex.
  uint32_t corners[kMost];
};

/// A triangle before its vertices are known: its largest vertex in byte 2. An explicit triangle has the other two in
/// bytes 0 and 1. Another one has in byte 0 the vertex where its edge begins, unless that is the last triangle's.
struct Gate {
  uint32_t word;

  static constexpr uint32_t kExplicit = 1u << 31;
  static constexpr uint32_t kFollows = 1u << 30;  // the edge begins at the last vertex of the triangle before

  __device__ uint32_t largest() const { return word >> 16 & 0xff; }
};

struct TriangleMemory {
  Gate gates[kMost + 1];  // of each triangle; the one behind the last triangle is read, but not used
  uint16_t links[kMost];  // of each vertex: next() of OpenEdges in the low byte, across() in the high byte
};

__device__ inline uint32_t byte_at(const std::byte* at) {
  return static_cast<uint32_t>(*at);
}

__device__ inline bool all_lanes(bool good) {
  return __ballot_sync(~0u, good) == ~0u;
}

/// Reads the triangles of a part's clusters, one cluster after the other.
class TriangleReader {
 public:
  __device__ TriangleReader(const JoinTask& task, const std::byte* slot, TriangleMemory& memory, uint32_t lane)
      : split_(slot + task.from), memory_(memory), lane_(lane), left_(task.cluster_count) {
    for (uint32_t i = 0; i < kStreams; ++i) next_[i] = task.first[i];
    request();
  }

  /// Reads the next cluster. Returns whether it is good; otherwise `out` is unspecified.
  __device__ bool read(ReadTriangles& out) {
    const uint32_t triangles = triangles_;
    const uint32_t vertices = byte_at(split_ + next_[kVertices]++) + 1;
    const uint32_t form = byte_at(split_ + next_[kForms]++);
    const uint32_t bits = form & 7;
    const uint32_t is_wide = form >> 3 & 1;
    const bool is_predicted = (form >> 4 & 3) != format::kNotPredicted;
    if (lane_ == 0) {
      out.triangle_count = triangles;
      out.vertex_count = vertices;
      out.distance_bits = bits;
      out.is_wide = is_wide;
      out.axis = form >> 4 & 3;
      if (is_predicted) out.slopes = slopes_at(next_[kSlopes]);
    }
    next_[kSlopes] += is_predicted ? 4 : 0;
    for (uint32_t i = lane_; i < kMost; i += kWarpLanes) {
      out.begins[i] = 0xff;
      memory_.links[i] = i == 0 ? kFirstLink : kNoLink;
    }
    const bool good = read_gates(out, triangles, vertices, is_wide);
    if (!all_lanes(good)) return false;  // before vertices become indices
    request();
    if (lane_ == 0) connect(out, triangles);
    __syncwarp();
    return all_lanes(put_distances(out, triangles, bits));
  }

 private:
  /// Requests the gates of the next cluster, if there is one. This is done while another cluster is connected.
  __device__ void request() {
    if (left_ == 0) return;
    --left_;
    triangles_ = byte_at(split_ + next_[kTriangles]++) + 1;
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) {
      const uint32_t i = k * kWarpLanes + lane_;
      gates_[k] = i < triangles_ ? byte_at(split_ + next_[kGates] + i) : 0;
    }
    next_[kGates] += triangles_;
  }

  __device__ uint32_t slopes_at(uint32_t offset) const {
    uint32_t word = 0;
    for (uint32_t i = 0; i < 4; ++i) word |= byte_at(split_ + offset + i) << 8 * i;
    return word;
  }

  /// Reads the steps and the explicit triangles. Returns whether their vertices and the lane's gates exist.
  __device__ bool read_gates(ReadTriangles& out, uint32_t triangles, uint32_t vertices, uint32_t is_wide) {
    const uint32_t counted = ~0u >> (kWarpLanes - 1 - lane_);
    uint32_t before = 2;
    bool good = true;
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) {
      const uint32_t i = k * kWarpLanes + lane_;
      const uint32_t gate = gates_[k];
      const bool is_explicit = gate >= kExplicitGate;
      const uint32_t step = is_explicit ? gate & 3 : gate != 0 ? 1 : 0;
      const uint32_t low = __ballot_sync(~0u, (step & 1) != 0);
      const uint32_t high = __ballot_sync(~0u, step >= 2);
      const uint32_t explicits = __ballot_sync(~0u, is_explicit);
      const uint32_t largest = before + count_bits(low & counted) + 2 * count_bits(high & counted);
      before += count_bits(low) + 2 * count_bits(high);
      if (lane_ == 0) {
        out.steps[0][k] = low;
        out.steps[1][k] = high;
      }
      uint32_t begin = largest - gate;
      if (is_explicit) {
        const std::byte* const from = split_ + next_[kDistances] + 2 * count_bits(explicits & (counted >> 1));
        const uint32_t back_a = byte_at(from);
        const uint32_t back_b = byte_at(from + 1);
        good &= max_of(back_a, back_b) <= largest;
        begin = (largest - back_a) | (largest - back_b) << 8;
      }
      next_[kDistances] += 2 * count_bits(explicits);
      if (i >= triangles) continue;
      good &= largest < vertices && (is_explicit || gate <= largest) && (is_wide != 0 || step < 2);
      memory_.gates[i] = {begin | largest << 16 | (is_explicit ? Gate::kExplicit : gate == 0 ? Gate::kFollows : 0)};
      out.largest[i] = static_cast<uint8_t>(largest);
    }
    __syncwarp();
    return good;
  }

  /// Finds the vertices of all triangles, one after the other; by one lane. Each waits for a link that an earlier one
  /// may have written, and for nothing else.
  __device__ void connect(ReadTriangles& out, uint32_t triangles) {
    uint32_t last = 0;
    uint32_t next = memory_.gates[0].word;
    for (uint32_t i = 0; i < triangles; ++i) {
      const Gate gate{next};
      next = memory_.gates[i + 1].word;
      const uint32_t largest = gate.largest();
      const uint32_t a = (gate.word & Gate::kFollows) != 0 ? last : gate.word & 0xff;
      const uint32_t link = memory_.links[a];
      const uint32_t corner =
          (gate.word & Gate::kExplicit) != 0 ? (gate.word & 0xffff) | kNoVertex << 16 : a | link << 8;
      const uint32_t b = corner >> 8 & 0xff;
      out.corners[i] = corner;
      memory_.links[a] = static_cast<uint16_t>(largest | b << 8);
      memory_.links[largest] = static_cast<uint16_t>(b | a << 8);
      last = b;
    }
  }

  /// Writes the distances of the triangles, and lists the triangles of each largest vertex. Returns whether the
  /// distances of the lane's triangles have at most `bits`.
  __device__ bool put_distances(ReadTriangles& out, uint32_t triangles, uint32_t bits) const {
    bool good = true;
    for (uint32_t i = lane_; i < triangles; i += kWarpLanes) {
      const uint32_t largest = out.largest[i];
      const uint32_t corner = out.corners[i];
      const uint32_t back_a = largest - (corner & 0xff);
      const uint32_t back_b = largest - (corner >> 8 & 0xff);
      good &= (back_a | back_b) >> bits == 0;
      out.distances[i] = static_cast<uint16_t>(back_a | back_b << 8);
      if (back_a == 0 || back_b == 0) out.corners[i] = kNothing;
      if (i == 0 || out.largest[i - 1] != largest) out.begins[largest] = static_cast<uint8_t>(i);
    }
    return good;
  }

  const std::byte* split_;
  TriangleMemory& memory_;
  uint32_t lane_;
  uint32_t left_;            // number of clusters whose gates are not requested yet
  uint32_t next_[kStreams];  // as SplitPart::first, of the next cluster; of triangles and gates, behind it
  uint32_t triangles_ = 0;   // of the next cluster
  uint32_t gates_[kRounds];  // of its triangles, one per lane
};

}  // namespace scree::kernels::joining
