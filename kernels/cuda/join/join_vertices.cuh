// Reads the vertices of clusters from the streams of a split page, by a warp.
#pragma once

#include "kernels/cuda/join/join_triangles.cuh"

namespace scree::kernels::joining {

inline constexpr uint32_t kMostOffset = (1u << format::kMaxPositionBits) - 1;

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

/// How the vertices of a cluster are placed.
struct ReadVertices {
  Corners corners[kMost + 2];  // the two behind the last vertex are read, but not used
  uint32_t values[3][kMost];
  uint32_t earlier[kMost];  // the part's number of an equal vertex in an earlier cluster, or kNothing
};

__device__ inline uint32_t unzigzag(uint32_t code) {
  return code >> 1 ^ (0u - (code & 1));
}

/// Reads the vertices of a part's clusters, one cluster after the other.
class VertexReader {
 public:
  __device__ VertexReader(const JoinTask& task, const std::byte* slot, uint32_t lane)
      : split_(slot + task.from), planes_(task.planes), lane_(lane), left_(task.cluster_count) {
    for (uint32_t i = 0; i < kStreams; ++i) next_[i] = task.first[i];
    request();
  }

  /// Reads the vertices of the next cluster, whose triangles are known. Returns whether all vertices exist to which
  /// others refer.
  __device__ bool read(const ReadTriangles& in, ReadVertices& out) {
    const uint32_t vertices = in.vertex_count;
    uint32_t fresh[kRounds];
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) fresh[k] = fresh_[k];
    request();
    if (lane_ < 2) out.corners[vertices + lane_] = {thrice(kZero) | 2u << 24, thrice(kZero)};
    const bool good = read_vertices(in, fresh, out);
    first_vertex_ += vertices;
    return all_lanes(good);
  }

 private:
  /// Requests the fresh bits of the next cluster, if there is one.
  __device__ void request() {
    if (left_ == 0) return;
    --left_;
    const uint32_t vertices = byte_at(split_ + next_[kVertices]++) + 1;
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) {
      const uint32_t i = k * kWarpLanes + lane_;
      fresh_[k] = i < vertices ? byte_at(split_ + next_[kFresh] + i / 8) >> i % 8 & 1 : 0;
    }
    next_[kFresh] += bytes_of_bits(vertices);
  }

  /// The corners of a vertex after the first that has a residual, as VertexPredictor finds them.
  __device__ static Corners corners_of(const ReadTriangles& in, uint32_t vertex) {
    const uint32_t begin = in.begins[vertex];
    uint32_t first = begin != 0xff ? in.corners[begin] : kNothing;
    if (first == kNothing) first = (vertex - 1) * 0x0101 | kNoVertex << 16;
    uint32_t second = first;
    if (begin + 1 < in.triangle_count && in.largest[begin + 1] == vertex && in.corners[begin + 1] != kNothing)
      second = in.corners[begin + 1];
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
  __device__ bool read_vertices(const ReadTriangles& in, const uint32_t* fresh, ReadVertices& out) {
    const uint32_t vertices = in.vertex_count;
    const uint32_t before = (1u << lane_) - 1;
    uint32_t references[kRounds];
    uint32_t high[kRounds];
    uint32_t values[kRounds][3];
#pragma unroll
    for (uint32_t k = 0; k < kRounds; ++k) {  // requests everything before the first use
      const bool is_new = fresh[k] != 0;
      const bool is_old = !is_new && k * kWarpLanes + lane_ < vertices;
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
      const uint32_t v = k * kWarpLanes + lane_;
      const uint32_t number = first_vertex_ + v;
      const bool is_new = fresh[k] != 0;
      const bool is_far = references[k] == kFarReference;
      const uint32_t step = unzigzag(references[k]);
      const uint32_t named = sum_steps(is_far ? number - far[k] : lane_ == 0 ? named_ + step : step, is_far);
      named_ = __shfl_sync(~0u, named, kWarpLanes - 1);
      if (v >= vertices) continue;
      Corners corners{thrice(kZero), thrice(kZero)};
      uint32_t earlier = kNothing;
      if (is_new) {
        corners = v == 0 ? Corners{thrice(kFirst), thrice(kFirst)} : corners_of(in, v);
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
  __device__ uint32_t sum_steps(uint32_t step, bool is_number) const {
    uint32_t sum = step;
    uint32_t is_whole = is_number ? 1 : 0;
    for (uint32_t distance = 1; distance < kWarpLanes; distance *= 2) {
      const uint32_t other = __shfl_up_sync(~0u, sum, distance);
      const uint32_t other_is_whole = __shfl_up_sync(~0u, is_whole, distance);
      if (lane_ < distance || is_whole != 0) continue;
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
  format::split_streams::StreamPlanes planes_;
  uint32_t lane_;
  uint32_t left_;              // number of clusters whose fresh bits are not requested yet
  uint32_t next_[kStreams];    // as SplitPart::first, of the next cluster; of vertices and fresh bits, behind it
  uint32_t fresh_[kRounds];    // whether the lane's vertices of the next cluster have residuals
  uint32_t first_vertex_ = 0;  // of the next cluster, in the part
  uint32_t named_ = 0;         // the vertex referred to last, in the part
};

}  // namespace scree::kernels::joining
