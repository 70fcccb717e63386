// Reads clusters from the streams of a split page, by a warp.
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
inline constexpr uint32_t kMostOffset = (1u << format::kMaxPositionBits) - 1;
inline constexpr uint32_t kNothing = ~0u;
inline constexpr uint32_t kNoVertex = 0xff;
inline constexpr uint16_t kNoLink = kNoVertex << 8;
inline constexpr uint16_t kFirstLink = kNoLink | 1;

// Numbers that corners may have instead of a vertex.
inline constexpr uint32_t kZero = kMost;       // offsets of 0
inline constexpr uint32_t kFirst = kMost + 1;  // the first vertex of the cluster before
inline constexpr uint32_t kNumbers = kMost + 2;

/// The offsets of a vertex are (sum + value) mod 2^24. The sum is that of at[0] + at[1] - at[2] over both corners,
/// halved. A corner holds a number per byte, the lowest first. The top byte of the first corner is 2 plus the factor
/// that the sum has for the vertex just before.
struct Corners {
  uint32_t first;
  uint32_t second;
};
__device__ constexpr uint32_t thrice(uint32_t number) {
  return number * 0x010101u;
}

/// A cluster from the streams.
struct ReadCluster {
  uint32_t triangle_count;
  uint32_t vertex_count;
  uint32_t distance_bits;
  uint32_t is_wide;  // steps have two bits
  uint32_t axis;     // the predicted one, or kNotPredicted
  uint32_t slopes;
  uint32_t steps[2][kMost / 32];
  uint16_t distances[kMost];   // the second in the high byte
  Corners corners[kMost + 1];  // the last one is read, but not used
  uint32_t values[3][kMost];
  uint32_t earlier[kMost];  // the part's number of an equal vertex in an earlier cluster, or kNothing
};

struct ReaderMemory {
  uint8_t gates[kMost];    // of each triangle
  uint8_t largest[kMost];  // vertex of each triangle
  uint8_t begins[kMost];   // the first triangle with that largest vertex, or 0xff
  uint16_t links[kMost];   // of each vertex: next() of OpenEdges in the low byte, across() in the high byte
  // Per triangle the other two vertices, and the vertex on the other side of their edge or kNoVertex; kNothing if the
  // triangle does not predict its largest vertex.
  uint32_t corners[kMost];
};

__device__ inline uint32_t byte_at(const std::byte* at) {
  return static_cast<uint32_t>(*at);
}

__device__ inline uint32_t unzigzag(uint32_t code) {
  return code >> 1 ^ (0u - (code & 1));
}

__device__ inline bool all_lanes(bool good) {
  return __ballot_sync(~0u, good) == ~0u;
}

/// Reads the clusters of a part one after the other.
class Reader {
 public:
  __device__ Reader(const JoinTask& task, const std::byte* slot, ReaderMemory& memory)
      : split_(slot + task.from), memory_(memory), planes_(task.planes) {
    for (uint32_t i = 0; i < kStreams; ++i) next_[i] = task.first[i];
    request_counts();
  }

  /// Reads the next cluster. Returns whether it is good; otherwise `out` is unspecified.
  __device__ bool read(ReadCluster& out, uint32_t lane) {
    const uint32_t triangles = counts_[0] + 1;
    const uint32_t vertices = counts_[1] + 1;
    const uint32_t form = counts_[2];
    request_counts();
    const uint32_t bits = form & 7;
    const uint32_t is_wide = form >> 3 & 1;
    const bool is_predicted = (form >> 4 & 3) != format::kNotPredicted;
    uint32_t gates[kRounds];
    uint32_t fresh[kRounds];
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) {  // requests everything before the first use
      const uint32_t i = k * kWarpLanes + lane;
      gates[k] = i < triangles ? byte_at(split_ + next_[kGates] + i) : 0;
      fresh[k] = i < vertices ? byte_at(split_ + next_[kFresh] + i / 8) >> i % 8 & 1 : 0;
    }
    if (lane == 0) {
      out.triangle_count = triangles;
      out.vertex_count = vertices;
      out.distance_bits = bits;
      out.is_wide = is_wide;
      out.axis = form >> 4 & 3;
      if (is_predicted) out.slopes = word_at(next_[kSlopes], 4);
      out.corners[vertices] = {thrice(kZero) | 2u << 24, thrice(kZero)};
    }
    next_[kSlopes] += is_predicted ? 4 : 0;
    for (uint32_t i = lane; i < kMost; i += kWarpLanes) {
      memory_.begins[i] = 0xff;
      memory_.links[i] = i == 0 ? kFirstLink : kNoLink;
    }
    bool good = read_gates(out, gates, triangles, vertices, is_wide, lane);
    if (!all_lanes(good)) return false;  // before vertices become indices
    if (lane == 0) connect(triangles);
    __syncwarp();
    good = put_distances(out, triangles, bits, lane);
    good &= read_vertices(out, fresh, triangles, vertices, lane);
    next_[kGates] += triangles;
    next_[kFresh] += bytes_of_bits(vertices);
    first_vertex_ += vertices;
    return all_lanes(good);
  }

 private:
  /// Requests the counts and the form of the next cluster. Behind the last cluster, other bytes of the page are read.
  __device__ void request_counts() {
    counts_[0] = byte_at(split_ + next_[kTriangles]++);
    counts_[1] = byte_at(split_ + next_[kVertices]++);
    counts_[2] = byte_at(split_ + next_[kForms]++);
  }

  /// The word of `bytes` bytes (up to 4) at an offset of the page.
  __device__ uint32_t word_at(uint32_t offset, uint32_t bytes) const {
    uint32_t word = 0;
    for (uint32_t i = 0; i < bytes; ++i) word |= byte_at(split_ + offset + i) << 8 * i;
    return word;
  }

  /// Reads the steps and the explicit triangles. Returns whether their vertices and the lane's gates exist.
  __device__ bool read_gates(ReadCluster& out, const uint32_t* gates, uint32_t triangles, uint32_t vertices,
                             uint32_t is_wide, uint32_t lane) {
    const uint32_t counted = ~0u >> (kWarpLanes - 1 - lane);
    uint32_t before = 2;
    bool good = true;
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) {
      const uint32_t i = k * kWarpLanes + lane;
      const uint32_t gate = gates[k];
      const bool is_explicit = gate >= kExplicitGate;
      const uint32_t step = is_explicit ? gate & 3 : gate != 0 ? 1 : 0;
      const uint32_t low = __ballot_sync(~0u, (step & 1) != 0);
      const uint32_t high = __ballot_sync(~0u, step >= 2);
      const uint32_t explicits = __ballot_sync(~0u, is_explicit);
      const uint32_t largest = before + count_bits(low & counted) + 2 * count_bits(high & counted);
      before += count_bits(low) + 2 * count_bits(high);
      if (lane == 0) {
        out.steps[0][k] = low;
        out.steps[1][k] = high;
      }
      if (is_explicit) {
        const std::byte* const from = split_ + next_[kDistances] + 2 * count_bits(explicits & (counted >> 1));
        const uint32_t back_a = byte_at(from);
        const uint32_t back_b = byte_at(from + 1);
        good &= max_of(back_a, back_b) <= largest;
        memory_.corners[i] = (largest - back_a) | (largest - back_b) << 8 | kNoVertex << 16;
      }
      next_[kDistances] += 2 * count_bits(explicits);
      if (i >= triangles) continue;
      good &= largest < vertices && (is_explicit || gate <= largest) && (is_wide != 0 || step < 2);
      memory_.gates[i] = static_cast<uint8_t>(gate);
      memory_.largest[i] = static_cast<uint8_t>(largest);
    }
    __syncwarp();
    return good;
  }

  /// Finds the vertices of all triangles, one after the other; by one lane.
  __device__ void connect(uint32_t triangles) {
    uint32_t last = 0;
    for (uint32_t i = 0; i < triangles; ++i) {
      const uint32_t gate = memory_.gates[i];
      const uint32_t largest = memory_.largest[i];
      uint32_t corner;
      if (gate >= kExplicitGate) {
        corner = memory_.corners[i];
      } else {
        const uint32_t a = gate != 0 ? largest - gate : last;
        corner = a | uint32_t{memory_.links[a]} << 8;
        memory_.corners[i] = corner;
      }
      const uint32_t a = corner & 0xff;
      const uint32_t b = corner >> 8 & 0xff;
      memory_.links[a] = static_cast<uint16_t>(largest | b << 8);
      memory_.links[largest] = static_cast<uint16_t>(b | a << 8);
      last = b;
    }
  }

  /// Writes the distances of the triangles, and lists the triangles of each largest vertex. Returns whether the
  /// distances of the lane's triangles have at most `bits`.
  __device__ bool put_distances(ReadCluster& out, uint32_t triangles, uint32_t bits, uint32_t lane) {
    bool good = true;
    for (uint32_t i = lane; i < triangles; i += kWarpLanes) {
      const uint32_t largest = memory_.largest[i];
      const uint32_t corner = memory_.corners[i];
      const uint32_t back_a = largest - (corner & 0xff);
      const uint32_t back_b = largest - (corner >> 8 & 0xff);
      good &= (back_a | back_b) >> bits == 0;
      out.distances[i] = static_cast<uint16_t>(back_a | back_b << 8);
      if (back_a == 0 || back_b == 0) memory_.corners[i] = kNothing;
      if (i == 0 || memory_.largest[i - 1] != largest) memory_.begins[largest] = static_cast<uint8_t>(i);
    }
    __syncwarp();
    return good;
  }

  /// The corners of a vertex after the first that has a residual, as VertexPredictor finds them.
  __device__ Corners corners_of(uint32_t vertex, uint32_t triangles) const {
    const uint32_t begin = memory_.begins[vertex];
    uint32_t first = begin != 0xff ? memory_.corners[begin] : kNothing;
    if (first == kNothing) first = (vertex - 1) * 0x0101 | kNoVertex << 16;
    uint32_t second = first;
    if (begin + 1 < triangles && memory_.largest[begin + 1] == vertex && memory_.corners[begin + 1] != kNothing)
      second = memory_.corners[begin + 1];
    const bool has_first = first >> 16 < vertex;
    const bool has_second = second >> 16 < vertex;
    return {has_first    ? first
            : has_second ? second
                         : thrice(second & 0xff),
            has_second  ? second
            : has_first ? first
                        : thrice(second >> 8 & 0xff)};
  }

  /// Returns whether the vertices to which the lane's vertices refer exist. `fresh`: whether a vertex has a residual.
  __device__ bool read_vertices(ReadCluster& out, const uint32_t* fresh, uint32_t triangles, uint32_t vertices,
                                uint32_t lane) {
    const uint32_t before = (1u << lane) - 1;
    uint32_t references[kRounds];
    uint32_t high[kRounds];
    uint32_t values[kRounds][3];
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) {  // requests everything before the first use
      const bool is_new = fresh[k] != 0;
      const bool is_old = !is_new && k * kWarpLanes + lane < vertices;
      const uint32_t new_lanes = __ballot_sync(~0u, is_new);
      const uint32_t old_lanes = __ballot_sync(~0u, is_old);
      references[k] = is_old ? byte_at(split_ + next_[kReferences] + count_bits(old_lanes & before)) : 0;
      const uint32_t number = next_[kLow] + count_bits(new_lanes & before);
      for (uint32_t axis = 0; axis < 3; ++axis)
        values[k][axis] = is_new ? byte_at(split_ + planes_.low + uint64_t{axis} * planes_.residual_count + number) : 0;
      high[k] = is_new && planes_.high != 0 ? byte_at(split_ + planes_.high + number) : 0;
      next_[kReferences] += count_bits(old_lanes);
      next_[kLow] += count_bits(new_lanes);
    }
    uint32_t far[kRounds];
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) {
      const bool is_far = references[k] == kFarReference;
      const uint32_t far_lanes = __ballot_sync(~0u, is_far);
      const std::byte* const far_at = split_ + planes_.far + next_[kFar] + count_bits(far_lanes & before);
      far[k] = is_far ? byte_at(far_at) | byte_at(far_at + planes_.far_count) << 8 : 0;
      next_[kFar] += count_bits(far_lanes);
      if (planes_.high != 0) add_high(high[k], values[k], before);
    }
    bool good = true;
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) {
      const uint32_t v = k * kWarpLanes + lane;
      const uint32_t number = first_vertex_ + v;
      const bool is_new = fresh[k] != 0;
      const bool is_far = references[k] == kFarReference;
      const uint32_t step = unzigzag(references[k]);
      const uint32_t named = sum_steps(is_far ? number - far[k] : lane == 0 ? named_ + step : step, is_far, lane);
      named_ = __shfl_sync(~0u, named, kWarpLanes - 1);
      if (v >= vertices) continue;
      Corners corners{thrice(kZero), thrice(kZero)};
      uint32_t earlier = kNothing;
      if (is_new) {
        corners = v == 0 ? Corners{thrice(kFirst), thrice(kFirst)} : corners_of(v, triangles);
      } else {
        good &= number - named - 1 < min_of(number, kMostBack);
        if (named < first_vertex_) {
          earlier = named;
        } else {
          corners.first = corners.second = thrice(named - first_vertex_);
        }
      }
      const uint32_t factor = 2 + factor_of(v - 1, corners.first) + factor_of(v - 1, corners.second);
      out.corners[v] = {(corners.first & 0xffffff) | factor << 24, corners.second};
      for (uint32_t axis = 0; axis < 3; ++axis) out.values[axis][v] = unzigzag(values[k][axis]);
      out.earlier[v] = earlier;
    }
    return good;
  }

  /// The vertex of this lane: the number of the last lane up to this one that has a number instead of a step, plus the
  /// steps of the lanes behind that one.
  __device__ static uint32_t sum_steps(uint32_t step, bool is_number, uint32_t lane) {
    uint32_t sum = step;
    uint32_t is_whole = is_number ? 1 : 0;
    for (uint32_t distance = 1; distance < kWarpLanes; distance *= 2) {
      const uint32_t other = __shfl_up_sync(~0u, sum, distance);
      const uint32_t other_is_whole = __shfl_up_sync(~0u, is_whole, distance);
      if (lane < distance || is_whole != 0) continue;
      sum += other;
      is_whole = other_is_whole;
    }
    return sum;
  }

  /// Adds the high bits to the codes of each lane's residual. `before`: a bit per lane before this one.
  __device__ void add_high(uint32_t high, uint32_t codes[3], uint32_t before) {
    uint32_t lanes[3];  // with a tall code
    for (uint32_t axis = 0; axis < 3; ++axis) lanes[axis] = __ballot_sync(~0u, (high >> 2 * axis & 3) == kTallCode);
    uint32_t number = next_[kTall];
    for (const uint32_t tall : lanes) number += count_bits(tall & before);
    for (uint32_t axis = 0; axis < 3; ++axis) {
      uint32_t rest = high >> 2 * axis & 3;
      if (rest == kTallCode) {
        const std::byte* const at = split_ + planes_.tall + number++;
        rest = byte_at(at);
        if (planes_.tall_bytes > 1) rest |= byte_at(at + planes_.tall_count) << 8;
      }
      codes[axis] |= rest << 8;
    }
    for (const uint32_t tall : lanes) next_[kTall] += count_bits(tall);
  }

  /// How often a corner's sum has a vertex; modulo 2^32.
  __device__ static uint32_t factor_of(uint32_t vertex, uint32_t corner) {
    const auto is = [&](uint32_t shift) { return (corner >> shift & 0xff) == vertex ? 1u : 0u; };
    return is(0) + is(8) - is(16);
  }

  const std::byte* split_;
  ReaderMemory& memory_;
  format::split_streams::StreamPlanes planes_;
  uint32_t next_[kStreams];    // as SplitPart::first, of the next cluster
  uint32_t counts_[3];         // triangles less one, vertices less one and form of the next cluster
  uint32_t first_vertex_ = 0;  // of the next cluster, in the part
  uint32_t named_ = 0;         // the vertex referred to last, in the part
};

}  // namespace scree::kernels::joining
