#include "format/bitpack.h"
#include "format/bits.h"
#include "format/geometry/cluster_layout.h"
#include "format/geometry/offset_box.h"
#include "format/geometry/split_streams.h"
#include "format/layout.h"
#include "kernels/cuda/check.h"
#include "kernels/cuda/join.h"
#include "kernels/cuda/warp.cuh"
#include "kernels/math.h"

#pragma nv_diag_suppress 2810  // nvcc 13 takes the assignment of a nodiscard class for an ignored result

namespace scree::kernels {
namespace {

using namespace format::split_streams;
using format::ClusterBounds;
using format::ClusterLayout;
using format::ClusterRecord;
using format::count_bits;
using format::OffsetBox;

constexpr uint32_t kMost = format::kMaxClusterVertices;
static_assert(kMost == format::kMaxClusterTriangles);
constexpr uint32_t kRounds = kMost / kWarpLanes;  // of a warp over a cluster's vertices or triangles
constexpr uint32_t kMostOffset = (1u << format::kMaxPositionBits) - 1;
constexpr uint32_t kNothing = ~0u;

// Each warp of a block does one step for every cluster of a part: while one reads a cluster, the next places the
// vertices of the cluster before, and the last writes the cluster before that.
constexpr uint32_t kThreads = 3 * kWarpLanes;

// Numbers that corners may have instead of a vertex.
constexpr uint32_t kZero = kMost;       // offsets of 0
constexpr uint32_t kFirst = kMost + 1;  // the first vertex of the cluster before
constexpr uint32_t kNumbers = kMost + 2;

/// The offsets of a vertex are (sum + value) mod 2^24. The sum is that of at[0] + at[1] - at[2] over both corners,
/// halved. A corner holds a number per byte, the lowest first. The top byte of the first corner is 2 more than the
/// sum's factor of the vertex just before.
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

/// The vertices of a cluster.
struct PlacedCluster {
  uint32_t at[3][kNumbers];
  OffsetBox box;
};

constexpr uint32_t kLists = 256;

struct ReaderMemory {
  uint8_t largest[kMost];     // vertex of each triangle
  uint8_t begins[kMost];      // the first triangle with that largest vertex, or 0xff
  uint32_t corners[kMost];    // of each triangle; kNothing if it is degenerate
  uint32_t lists[kLists];     // the last edge with that hash, or kNothing
  uint32_t edges[3 * kMost];  // the larger and the smaller vertex, the opposite one, the next edge of the list
};

/// The most words of a cluster's data: prediction, steps, distances of 7 bits, positions.
constexpr uint32_t kMostWords = 2 + 2 * kMost / 32 + 2 * 7 * kMost / 32 + 3 * format::kMaxPositionBits * kMost / 32;

struct BlockMemory {
  ReadCluster read[3];
  PlacedCluster placed[2];
  ReaderMemory reader;
  uint32_t words[kMostWords];
  uint32_t is_bad[2];  // by the parity of the step
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

  /// The sum of the lanes' steps up to this one, from the last lane that has a vertex's number instead.
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

/// The offsets of the last kJoinHistory vertices of a part. If they are narrow, only the low halves are kept: a vertex
/// with larger offsets makes the part bad.
class History {
 public:
  __device__ History(uint32_t* words, bool is_wide) : words_(words), is_wide_(is_wide) {}

  __device__ uint32_t get(uint32_t vertex, uint32_t axis) const {
    const uint32_t place = 3 * (vertex % kJoinHistory) + axis;
    return is_wide_ ? words_[place] : halves()[place];
  }
  __device__ void set(uint32_t vertex, uint32_t axis, uint32_t offset) {
    const uint32_t place = 3 * (vertex % kJoinHistory) + axis;
    if (is_wide_) {
      words_[place] = offset;
    } else {
      halves()[place] = static_cast<uint16_t>(offset);
    }
  }

 private:
  __device__ uint16_t* halves() const { return reinterpret_cast<uint16_t*>(words_); }

  uint32_t* words_;
  bool is_wide_;
};

/// Places the vertices of a cluster. `history`: of the part. `first_vertex`: number of
/// the cluster's first one in the part. `before`: the cluster before, or null.
__device__ void place(ReadCluster& in, const PlacedCluster* before, History history, uint32_t first_vertex,
                      PlacedCluster& out, uint32_t lane) {
  const uint32_t vertices = in.vertex_count;
  for (uint32_t axis = 0; axis < 3; ++axis) {
    for (uint32_t v = lane; v <= kZero; v += kWarpLanes) out.at[axis][v] = 0;
    if (lane == 0) out.at[axis][kFirst] = before != nullptr ? before->at[axis][0] : 0;
  }
  for (uint32_t v = lane; v < vertices; v += kWarpLanes) {
    const uint32_t earlier = in.earlier[v];
    if (earlier == kNothing) continue;
    for (uint32_t axis = 0; axis < 3; ++axis) in.values[axis][v] = history.get(earlier, axis);
  }
  __syncwarp();
  if (lane < 3) {  // an axis each
    uint32_t* const at = out.at[lane];
    const auto sum_of = [at](uint32_t corner) {
      return at[corner & 0xff] + at[corner >> 8 & 0xff] - at[corner >> 16 & 0xff];
    };
    // The vertex just before is 0 in `sum`, which can so be loaded before that vertex is placed.
    Corners corners = in.corners[0];
    uint32_t sum = sum_of(corners.first) + sum_of(corners.second);
    uint32_t last = 0;
    uint32_t smallest = kMostOffset;
    uint32_t largest = 0;
    for (uint32_t v = 0; v < vertices; ++v) {
      const Corners next = in.corners[v + 1];
      const uint32_t next_sum = sum_of(next.first) + sum_of(next.second);
      const uint32_t twice = sum + ((corners.first >> 24) - 2) * last;
      last = (static_cast<uint32_t>(static_cast<int32_t>(twice) >> 1) + in.values[lane][v]) & kMostOffset;
      at[v] = last;
      smallest = min_of(smallest, last);
      largest = max_of(largest, last);
      corners = next;
      sum = next_sum;
    }
    out.box.min[lane] = smallest;
    out.box.max[lane] = largest;
  }
  __syncwarp();
  for (uint32_t v = lane; v < vertices; v += kWarpLanes)
    for (uint32_t axis = 0; axis < 3; ++axis) history.set(first_vertex + v, axis, out.at[axis][v]);
}

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
  __device__ bool write(const ReadCluster& in, const PlacedCluster& placed, uint32_t number, uint32_t lane) {
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
  __device__ static bool predict(const ReadCluster& in, const PlacedCluster& placed, uint32_t bits[3],
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

/// Copies bytes between any addresses by a block.
__device__ void copy_bytes(std::byte* to, const std::byte* from, uint32_t bytes) {
  const uint32_t head = min_of(static_cast<uint32_t>(-reinterpret_cast<uintptr_t>(to) % 4), bytes);
  const uint32_t words = (bytes - head) / 4;
  const uint32_t shift = (reinterpret_cast<uintptr_t>(from) + head) % 4 * 8;
  const auto* const from_words = reinterpret_cast<const uint32_t*>(from + head - shift / 8);
  auto* const to_words = reinterpret_cast<uint32_t*>(to + head);
  for (uint32_t i = threadIdx.x; i < words; i += kThreads)
    to_words[i] = shift == 0 ? from_words[i] : __funnelshift_r(from_words[i], from_words[i + 1], shift);
  for (uint32_t i = threadIdx.x; i < bytes - 4 * words; i += kThreads) {
    const uint32_t place = i < head ? i : i + 4 * words;
    to[place] = from[place];
  }
}

struct JoinSlots {
  uint32_t count = 0;
  JoinSlot slots[kMostJoinSlots] = {};
};

/// A block per task, slot by slot.
__global__ void __launch_bounds__(kThreads) join_part(const __grid_constant__ JoinSlots slots, std::byte* arena) {
  __shared__ BlockMemory block;
  uint32_t number = blockIdx.x;
  uint32_t in = 0;
  for (; number >= slots.slots[in].task_count; ++in) number -= slots.slots[in].task_count;
  const JoinSlot& slot = slots.slots[in];
  const JoinTask task = slot.tasks[number];
  if (task.bytes != 0) return copy_bytes(arena + task.to, slot.bytes + task.from, task.bytes);
  const uint32_t warp = threadIdx.x / kWarpLanes;
  const uint32_t lane = threadIdx.x % kWarpLanes;
  Reader reader(task, slot.bytes, block.reader);
  Writer writer(task, arena, block.words);
  const History history(slot.history + task.history, task.keeps_wide());
  uint32_t first_vertex = 0;
  if (threadIdx.x < 2) block.is_bad[threadIdx.x] = 0;
  __syncthreads();
  for (uint32_t step = 0; step < task.cluster_count + 2; ++step) {
    bool is_good = true;
    if (warp == 0 && step < task.cluster_count) {
      is_good = reader.read(block.read[step % 3], lane);
    } else if (warp == 1 && step >= 1 && step <= task.cluster_count) {
      ReadCluster& cluster = block.read[(step - 1) % 3];
      const PlacedCluster* const before = step >= 2 ? &block.placed[step % 2] : nullptr;
      place(cluster, before, history, first_vertex, block.placed[(step - 1) % 2], lane);
      first_vertex += cluster.vertex_count;
    } else if (warp == 2 && step >= 2) {
      is_good = writer.write(block.read[(step - 2) % 3], block.placed[step % 2], step - 2, lane);
    }
    if (!is_good && lane == 0) block.is_bad[step % 2] = 1;
    __syncthreads();
    if (block.is_bad[step % 2] != 0) {
      if (threadIdx.x == 0) *slot.failed = 1;
      return;
    }
  }
  if (warp == 2 && !writer.finish(lane) && lane == 0) *slot.failed = 1;
}

}  // namespace

Result<void> join_parts(std::span<const JoinSlot> slots, std::byte* arena, cudaStream_t stream) {
  JoinSlots all;
  uint32_t blocks = 0;
  for (const JoinSlot& slot : slots) {
    all.slots[all.count++] = slot;
    blocks += slot.task_count;
  }
  if (blocks == 0) return {};
  join_part<<<blocks, kThreads, 0, stream>>>(all, arena);
  return cuda_check(cudaGetLastError(), "joining clusters");
}

}  // namespace scree::kernels
