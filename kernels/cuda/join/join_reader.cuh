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

inline constexpr uint32_t kLists = 256;

struct ReaderMemory {
  uint8_t largest[kMost];     // vertex of each triangle
  uint8_t begins[kMost];      // the first triangle with that largest vertex, or 0xff
  uint32_t corners[kMost];    // of each triangle; kNothing if it is degenerate
  uint32_t lists[kLists];     // the last edge with that hash, or kNothing
  uint32_t edges[3 * kMost];  // the larger and the smaller vertex, the opposite one, the next edge of the list
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
      : split_(slot + task.from),
        memory_(memory),
        planes_(task.planes),
        residual_count_(task.residual_count),
        residuals_(task.residuals) {
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
    const bool is_short = bits <= kShortDistance;
    // Everything is requested before the first use.
    uint32_t places[kRounds];
    uint32_t distances[kRounds];
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) {
      const uint32_t i = k * kWarpLanes + lane;
      places[k] = i < vertices ? byte_at(split_ + next_[kPlaces] + i) : 1;
      distances[k] = i < triangles ? distances_at(i, is_short) : 0;
    }
    bool good = read_steps(out, triangles, is_wide, lane);
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
    for (uint32_t i = lane; i < kLists; i += kWarpLanes) memory_.lists[i] = kNothing;
    for (uint32_t i = lane; i < kMost; i += kWarpLanes) memory_.begins[i] = 0xff;
    __syncwarp();
    good &= read_triangles(out, distances, triangles, vertices, bits, lane);
    if (!all_lanes(good)) return false;  // before vertices become indices
    find_corners(out, triangles, lane);
    good = read_vertices(out, places, triangles, vertices, lane);
    next_[kDistances] += is_short ? triangles : 2 * triangles;
    next_[kPlaces] += vertices;
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

  /// Both distances of a triangle, the second in the high byte.
  __device__ uint32_t distances_at(uint32_t triangle, bool is_short) const {
    const std::byte* const from = split_ + next_[kDistances];
    if (!is_short) return byte_at(from + 2 * triangle) | byte_at(from + 2 * triangle + 1) << 8;
    const uint32_t both = byte_at(from + triangle);
    return (both & 15) | both >> 4 << 8;
  }

  /// Returns whether no bit is set after the triangles.
  __device__ bool read_steps(ReadCluster& out, uint32_t triangles, uint32_t is_wide, uint32_t lane) {
    const uint32_t bytes = (triangles + 7) / 8;
    bool good = true;
    if (lane < 2 * kRounds) {
      const uint32_t half = lane / kRounds;
      const uint32_t first = lane % kRounds * 4;
      const uint32_t there = half <= is_wide && first < bytes ? min_of(bytes - first, 4u) : 0;
      const uint32_t word = word_at(next_[kSteps] + half * bytes + first, there);
      out.steps[half][lane % kRounds] = word;
      const uint32_t left = triangles - min_of(triangles, 8 * first);
      good = left >= 32 || word >> left == 0;
    }
    next_[kSteps] += bytes << is_wide;
    return good;
  }

  /// Returns whether the vertices of the lane's triangles exist.
  __device__ bool read_triangles(ReadCluster& out, const uint32_t* distances, uint32_t triangles, uint32_t vertices,
                                 uint32_t bits, uint32_t lane) {
    uint32_t before = 2;
    bool good = true;
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) {
      const uint32_t i = k * kWarpLanes + lane;
      const uint32_t low = out.steps[0][k];
      const uint32_t high = out.steps[1][k];
      const uint32_t counted = ~0u >> (kWarpLanes - 1 - lane);
      const uint32_t largest = before + count_bits(low & counted) + 2 * count_bits(high & counted);
      before += count_bits(low) + 2 * count_bits(high);
      if (i >= triangles) continue;
      const uint32_t further = max_of(distances[k] & 0xff, distances[k] >> 8);
      good &= largest < vertices && further <= largest && further >> bits == 0;
      memory_.largest[i] = static_cast<uint8_t>(largest);
      out.distances[i] = static_cast<uint16_t>(distances[k]);
    }
    return good;
  }

  __device__ static uint32_t edge_of(uint32_t a, uint32_t b) {
    return max_of(a, b) << 7 | min_of(a, b);
  }
  __device__ static uint32_t list_of(uint32_t edge) {
    return ((edge >> 7) * 5 + edge) % kLists;
  }

  /// Finds the corner of each triangle: its smaller vertices, and the vertex opposite to their edge in the last
  /// triangle before it that has the edge, or 0xff.
  __device__ void find_corners(const ReadCluster& in, uint32_t triangles, uint32_t lane) {
    __syncwarp();
    for (uint32_t i = lane; i < triangles; i += kWarpLanes) {
      const uint32_t m = memory_.largest[i];
      const uint32_t a = m - (in.distances[i] & 0xff);
      const uint32_t b = m - (in.distances[i] >> 8);
      const bool is_proper = a != b && a != m && b != m;
      memory_.corners[i] = is_proper ? min_of(a, b) | max_of(a, b) << 8 : kNothing;
      if (i == 0 || memory_.largest[i - 1] != m) memory_.begins[m] = static_cast<uint8_t>(i);
      if (!is_proper) continue;
      list_edge(i, edge_of(a, b), m);
      list_edge(kMost + i, edge_of(m, a), b);
      list_edge(2 * kMost + i, edge_of(m, b), a);
    }
    __syncwarp();
    for (uint32_t i = lane; i < triangles; i += kWarpLanes) {
      const uint32_t corner = memory_.corners[i];
      if (corner != kNothing) memory_.corners[i] = corner | across(i, edge_of(corner & 0xff, corner >> 8)) << 16;
    }
    __syncwarp();
  }

  __device__ void list_edge(uint32_t number, uint32_t edge, uint32_t opposite) {
    const uint32_t next = atomicExch(&memory_.lists[list_of(edge)], number);
    memory_.edges[number] = edge | opposite << 14 | next << 21;
  }

  /// The vertex opposite to `edge` in the last triangle before `triangle` that has it, or 0xff.
  __device__ uint32_t across(uint32_t triangle, uint32_t edge) const {
    constexpr uint32_t kEnd = kNothing << 21;
    uint32_t found = 0xff;
    uint32_t last = 0;  // one more than the triangle of `found`
    for (uint32_t next = memory_.lists[list_of(edge)]; next << 21 != kEnd;) {
      const uint32_t of = next % kMost;
      const uint32_t here = memory_.edges[next];
      if ((here & 0x3fff) == edge && of < triangle && of >= last) {
        last = of + 1;
        found = here >> 14 & 127;
      }
      next = here >> 21;
    }
    return found;
  }

  /// The corners of a vertex after the first that has a residual, as VertexPredictor finds them.
  __device__ Corners corners_of(uint32_t vertex, uint32_t triangles) const {
    uint32_t first = thrice(vertex - 1);  // the vertex completes no triangle
    uint32_t second = first;
    uint32_t found = 0;
    for (uint32_t i = memory_.begins[vertex]; i < triangles && memory_.largest[i] == vertex && found < 2; ++i) {
      const uint32_t corner = memory_.corners[i];
      if (corner == kNothing) continue;
      if (corner >> 16 < vertex) {
        if (found++ == 0) first = corner;
        second = corner;
      } else if (found == 0) {  // the middle of the edge
        first = thrice(corner & 0xff);
        second = thrice(corner >> 8 & 0xff);
      }
    }
    return {first, second};
  }

  /// Returns whether the vertices to which the lane's vertices refer exist.
  __device__ bool read_vertices(ReadCluster& out, const uint32_t* places, uint32_t triangles, uint32_t vertices,
                                uint32_t lane) {
    // Everything is requested before the first use.
    uint32_t far[kRounds];
    uint32_t values[kRounds][3];
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) {
      const bool is_new = places[k] == 0;
      const bool is_far = places[k] == kFarPlace;
      const uint32_t new_lanes = __ballot_sync(~0u, is_new);
      const uint32_t far_lanes = __ballot_sync(~0u, is_far);
      const uint32_t before = (1u << lane) - 1;
      far[k] = is_far ? word_at(next_[kFar] + 2 * count_bits(far_lanes & before), 2) : 0;
      read_residual(next_[kResiduals] + count_bits(new_lanes & before), is_new, values[k]);
      next_[kFar] += 2 * count_bits(far_lanes);
      next_[kResiduals] += count_bits(new_lanes);
    }
    bool good = true;
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) {
      const uint32_t v = k * kWarpLanes + lane;
      const uint32_t number = first_vertex_ + v;
      const bool is_new = places[k] == 0;
      const bool is_far = places[k] == kFarPlace;
      const uint32_t step = is_new ? 0 : unzigzag(places[k] - 1);
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

  /// The codes of a residual, or 0 where it is not `there`.
  __device__ void read_residual(uint32_t number, bool there, uint32_t codes[3]) const {
    for (uint32_t axis = 0; axis < 3; ++axis) {
      const std::byte* at = split_ + residuals_ + uint64_t{axis} * residual_count_ + number;
      codes[axis] = 0;
      for (uint32_t plane = 0; plane < kMaxPlanes; ++plane, at += uint64_t{3} * residual_count_)
        if (there && plane < planes_) codes[axis] |= byte_at(at) << 8 * plane;
    }
  }

  /// How often a corner's sum has a vertex; modulo 2^32.
  __device__ static uint32_t factor_of(uint32_t vertex, uint32_t corner) {
    const auto is = [&](uint32_t shift) { return (corner >> shift & 0xff) == vertex ? 1u : 0u; };
    return is(0) + is(8) - is(16);
  }

  const std::byte* split_;
  ReaderMemory& memory_;
  uint32_t planes_;
  uint32_t residual_count_;
  uint32_t residuals_;         // offset of the stream in the page
  uint32_t next_[kStreams];    // as SplitPart::first, of the next cluster
  uint32_t counts_[3];         // triangles less one, vertices less one and form of the next cluster
  uint32_t first_vertex_ = 0;  // of the next cluster, in the part
  uint32_t named_ = 0;         // the vertex referred to last, in the part
};

}  // namespace scree::kernels::joining
