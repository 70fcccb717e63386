#include "format/geometry/cluster_pack.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstring>

#include "format/geometry/cluster_read.h"
#include "format/geometry/word_writer.h"

namespace scree::format {
namespace {

constexpr uint8_t kFree = 0xff;

// A compact cluster of 128 triangles is about 10 vertices across, and needs no more in the best case.
constexpr uint32_t kGoodDistanceBits = 4;

constexpr uint32_t kMostDistanceBits = 7;

constexpr uint32_t kGaveUp = ~0u;

// Number of triangles whose corners are prefetched.
constexpr uint32_t kAhead = 16;

constexpr uint64_t kEachByte = 0x0101010101010101;

uint32_t words_for(uint32_t bits) {
  return (bits + 31) / 32;
}

/// The codes of a cluster's vertices, by axis.
struct Codes {
  uint32_t count;
  std::array<std::array<uint32_t, kMaxClusterVertices>, 3> code;
  std::array<uint32_t, 3> bits;
};

/// A predictor for one axis, and the bits of its residuals.
struct Prediction {
  ClusterPredictor predictor{kNotPredicted, 0, 0, 0};
  uint32_t bits = 0;
};

/// The plane's prediction for vertex `i`, on the plane's axis.
int32_t predicted(const Codes& codes, const ClusterPredictor& plane, uint32_t i) {
  const auto u = static_cast<int32_t>(codes.code[(plane.axis + 1) % 3][i]);
  const auto v = static_cast<int32_t>(codes.code[(plane.axis + 2) % 3][i]);
  return (plane.slope_u * u + plane.slope_v * v) >> kPredictorShift;
}

/// Two sums, which take one instruction per addend. The order of the addends is part of the result.
using Pair = double __attribute__((vector_size(16)));

/// The plane nearest to the vertices by least squares, solved for the axis in which its slopes are smallest.
Prediction fit_plane(const Codes& codes) {
  double mean[3] = {};
  for (size_t axis = 0; axis < 3; ++axis) {
    uint32_t sum = 0;  // of at most 128 codes below 2^24
    for (uint32_t i = 0; i < codes.count; ++i) sum += codes.code[axis][i];
    mean[axis] = static_cast<double>(sum) / codes.count;
  }
  Pair sums[3] = {};  // of the products of an axis with itself and with the next axis
  for (uint32_t i = 0; i < codes.count; ++i) {
    double d[3];
    for (size_t axis = 0; axis < 3; ++axis)
      d[axis] = static_cast<double>(static_cast<int32_t>(codes.code[axis][i])) - mean[axis];
    for (size_t axis = 0; axis < 3; ++axis) sums[axis] += Pair{d[axis], d[axis]} * Pair{d[axis], d[(axis + 1) % 3]};
  }
  double covariance[3][3];
  for (size_t axis = 0; axis < 3; ++axis) {
    covariance[axis][axis] = sums[axis][0];
    covariance[axis][(axis + 1) % 3] = covariance[(axis + 1) % 3][axis] = sums[axis][1];
  }

  Prediction best;
  double least = INFINITY;
  double slopes[2] = {};
  for (uint32_t p = 0; p < 3; ++p) {
    const uint32_t u = (p + 1) % 3;
    const uint32_t v = (p + 2) % 3;
    const double determinant = covariance[u][u] * covariance[v][v] - covariance[u][v] * covariance[u][v];
    if (!(determinant > 1e-9 * covariance[u][u] * covariance[v][v])) continue;
    const double slope_u = (covariance[p][u] * covariance[v][v] - covariance[p][v] * covariance[u][v]) / determinant;
    const double slope_v = (covariance[p][v] * covariance[u][u] - covariance[p][u] * covariance[u][v]) / determinant;
    const double steepest = std::max(std::fabs(slope_u), std::fabs(slope_v));
    if (!(steepest < 2) || codes.bits[u] > kMaxPredictorBits || codes.bits[v] > kMaxPredictorBits) continue;
    const double left = covariance[p][p] - slope_u * covariance[p][u] - slope_v * covariance[p][v];
    // The remaining variance over the axis's own: the axis with the smallest ratio saves the most bits.
    const double ratio = left / std::max(covariance[p][p], 1e-30);
    if (ratio >= least) continue;
    least = ratio;
    best.predictor.axis = p;
    slopes[0] = slope_u;
    slopes[1] = slope_v;
  }
  if (best.predictor.axis == kNotPredicted) return best;

  const auto rounded = [](double slope) {
    const double scaled = std::nearbyint(slope * (1 << kPredictorShift));
    return static_cast<int32_t>(std::clamp(scaled, -32768.0, 32767.0));
  };
  best.predictor.slope_u = rounded(slopes[0]);
  best.predictor.slope_v = rounded(slopes[1]);
  const uint32_t p = best.predictor.axis;
  int32_t smallest = INT32_MAX;
  int32_t largest = INT32_MIN;
  for (uint32_t i = 0; i < codes.count; ++i) {
    const int32_t left = static_cast<int32_t>(codes.code[p][i]) - predicted(codes, best.predictor, i);
    smallest = std::min(smallest, left);
    largest = std::max(largest, left);
  }
  best.predictor.bias = static_cast<uint32_t>(smallest);
  best.bits = static_cast<uint32_t>(std::bit_width(static_cast<uint32_t>(largest) - static_cast<uint32_t>(smallest)));
  return best;
}

}  // namespace

uint64_t ClusterPacker::Numbering::steps(uint32_t first) const {
  const auto load = [](const uint8_t* bytes) {
    uint64_t word;
    std::memcpy(&word, bytes, sizeof word);
    return word;
  };
  return load(&largest[first + 1]) - load(&largest[first]);  // no byte borrows from another: the numbers ascend
}

void ClusterPacker::begin(std::span<const uint32_t> indices, std::span<const uint32_t> offsets, uint32_t vertex_count,
                          PackEffort effort) {
  assert(indices.size() % 3 == 0 && offsets.size() == uint64_t{3} * vertex_count);
  indices_ = indices;
  offsets_ = offsets;
  effort_ = effort;
  slots_.assign(vertex_count, kFree);
}

/// Takes triangles as long as they fit, and numbers the vertices by first use.
void ClusterPacker::gather(std::span<const uint32_t> triangles) {
  assert(!triangles.empty());
  // Local copies, because the compiler must assume that a store to a slot may change any member.
  const uint32_t* const indices = indices_.data();
  uint8_t* const slots = slots_.data();
  const auto most = static_cast<uint32_t>(std::min<size_t>(triangles.size(), kMaxClusterTriangles));
  uint32_t limit = kMaxClusterVertices, triangle_count = 0, vertex_count = 0;
  for (; triangle_count < most; ++triangle_count) {
    if (triangle_count + kAhead < triangles.size())
      __builtin_prefetch(&indices[3 * size_t{triangles[triangle_count + kAhead]}]);
    const uint32_t* vertex = &indices[3 * size_t{triangles[triangle_count]}];
    if (vertex[0] == vertex[1] || vertex[1] == vertex[2] || vertex[2] == vertex[0]) limit = kMaxDegenerateVertices;
    auto& corner = corners_[triangle_count];
    uint32_t count = vertex_count;
    for (size_t i = 0; i < 3; ++i) {
      // The next vertex overwrites a vertex that the cluster already has. A branch here would often be mispredicted.
      const uint32_t number = vertex[i];
      const uint8_t slot = slots[number];
      const bool is_new = slot == kFree;
      vertices_[count] = number;
      corner[i] = slots[number] = is_new ? static_cast<uint8_t>(count) : slot;
      count += is_new ? 1 : 0;
    }
    if (count > limit) {
      for (; count > vertex_count; --count) slots[vertices_[count - 1]] = kFree;
      break;
    }
    vertex_count = count;
  }
  triangle_count_ = triangle_count;
  vertex_count_ = vertex_count;
  for (uint32_t v = 0; v < vertex_count; ++v) {
    slots[vertices_[v]] = kFree;
    __builtin_prefetch(&offsets_[3 * size_t{vertices_[v]}]);
  }
  if (limit == kMaxClusterVertices) {  // the usual case: no triangle has two corners at one vertex
    for (uint32_t t = 0; t < triangle_count; ++t)
      for (const uint8_t corner : corners_[t]) at_vertex_[corner].ones[t / 64] |= uint64_t{1} << (t % 64);
    return;
  }
  for (uint32_t t = 0; t < triangle_count; ++t) {
    const uint64_t bit = uint64_t{1} << (t % 64);
    for (const uint8_t corner : corners_[t]) {
      CornerCounts& at = at_vertex_[corner];
      at.twos[t / 64] |= at.ones[t / 64] & bit;
      at.ones[t / 64] ^= bit;
    }
  }
}

/// Numbers the vertices outwards from `start`, in the manner of Cuthill and McKee. Where triangles share edges, the
/// next vertex is one that completes a triangle: the triangle's other two vertices already have numbers. It is then the
/// largest of the triangle, so steps are 0 or 1. Returns the last vertex, or kGaveUp if a distance takes more than
/// `most_bits`.
uint32_t ClusterPacker::number_from(uint32_t start, uint32_t most_bits, Numbering& out) const {
  std::array<uint8_t, kMaxClusterVertices> queue;  // vertices by number
  CornerCounts numbered{};                         // corners that have a number
  uint32_t filled = 0;
  std::fill_n(out.number.begin(), vertex_count_, kFree);
  const auto push = [&](uint8_t vertex) {
    out.number[vertex] = static_cast<uint8_t>(filled);
    queue[filled++] = vertex;
    numbered.add(at_vertex_[vertex]);
  };
  const auto push_corners = [&](uint32_t triangle) {
    const auto& corner = corners_[triangle];
    const size_t first = corner[1] == start ? 1 : corner[2] == start ? 2 : 0;
    for (size_t i = first; i < first + 3; ++i)
      if (out.number[corner[i % 3]] == kFree) push(corner[i % 3]);
  };
  const auto first_of = [](const TriangleSet& set) {
    return static_cast<uint32_t>(set[0] != 0 ? std::countr_zero(set[0]) : 64 + std::countr_zero(set[1]));
  };
  const auto without_first = [](TriangleSet set) {
    set[set[0] != 0 ? 0 : 1] &= set[set[0] != 0 ? 0 : 1] - 1;
    return set;
  };
  const auto neighbour_after = [&](uint32_t triangle, uint32_t vertex) {
    const auto& corner = corners_[triangle];
    return corner[0] == vertex ? corner[1] : corner[1] == vertex ? corner[2] : corner[0];
  };
  const auto corner_left = [&](uint32_t triangle) {  // that without a number
    const auto& corner = corners_[triangle];
    return corner[out.number[corner[0]] == kFree ? 0 : out.number[corner[1]] == kFree ? 1 : 2];
  };
  push(static_cast<uint8_t>(start));
  push_corners(first_of({at_vertex_[start].any(0), at_vertex_[start].any(1)}));
  for (uint32_t at = 0; at < vertex_count_; ++at) {
    if (at == filled)  // the other triangles share no edge with these
      push_corners(first_of({~numbered.three(0), ~numbered.three(1)}));
    const uint32_t vertex = queue[at];
    const TriangleSet here{at_vertex_[vertex].any(0), at_vertex_[vertex].any(1)};
    // Numbers all neighbours of the vertex, triangle by triangle around it. A triangle is left if exactly one corner
    // has no number. The next one is that with the vertex numbered last, if this continues the turn in the one
    // direction of all turns, else the first one in that direction, if any. So most triangles lie across the edge from
    // the vertex numbered before (codecs.md, split pages).
    for (;;) {
      const TriangleSet left{here[0] & numbered.two(0), here[1] & numbered.two(1)};
      if ((left[0] | left[1]) == 0) break;
      const CornerCounts& at_last = at_vertex_[queue[filled - 1]];
      const TriangleSet beside{left[0] & at_last.any(0), left[1] & at_last.any(1)};
      const uint32_t triangle = first_of((beside[0] | beside[1]) != 0 ? beside : left);
      uint8_t neighbour = neighbour_after(triangle, vertex);
      for (TriangleSet others = left; out.number[neighbour] != kFree && (others[0] | others[1]) != 0;
           others = without_first(others))
        neighbour = neighbour_after(first_of(others), vertex);
      if (out.number[neighbour] != kFree) neighbour = corner_left(triangle);
      push(neighbour);
    }
    // The last vertex lies in a triangle with this one or an earlier one.
    if ((filled - 1 - at) >> most_bits != 0) return kGaveUp;
  }
  order_triangles(out);
  return out.distance_bits > most_bits ? kGaveUp : queue[vertex_count_ - 1];
}

/// Sets everything in `out` that follows from the numbers.
void ClusterPacker::order_triangles(Numbering& out) const {
  std::array<uint8_t, kMaxClusterTriangles> largest;
  std::array<uint16_t, kMaxClusterTriangles> distances;
  std::array<uint8_t, kMaxClusterVertices + 1> first{};  // triangles with a smaller largest number
  uint32_t furthest = 0;
  for (uint32_t t = 0; t < triangle_count_; ++t) {
    const auto& corner = corners_[t];
    const uint32_t a = out.number[corner[0]], b = out.number[corner[1]], c = out.number[corner[2]];
    // The largest corner comes first. A rotation of the corners keeps the triangle's orientation.
    const uint32_t most = std::max({a, b, c});
    const uint32_t second = most - (a == most ? b : b == most ? c : a);
    const uint32_t third = most - (a == most ? c : b == most ? a : b);
    furthest |= second | third;
    largest[t] = static_cast<uint8_t>(most);
    distances[t] = static_cast<uint16_t>(second | third << 8);
    ++first[most + 1];
  }
  for (uint32_t v = 0; v < vertex_count_; ++v) first[v + 1] = static_cast<uint8_t>(first[v + 1] + first[v]);
  for (uint32_t t = 0; t < triangle_count_; ++t) {
    const uint32_t place = first[largest[t]]++;
    out.order[place] = static_cast<uint8_t>(t);
    out.largest[place + 1] = largest[t];
    out.distances[place] = distances[t];
  }
  for (uint32_t v = 0, begin = 0; v < vertex_count_; begin = first[v++])
    if (first[v] - begin > 1) order_fan(out, begin, first[v]);
  std::fill_n(out.largest.begin() + triangle_count_ + 1, 7, out.largest[triangle_count_]);
  out.padding = out.largest[1] < 2 ? 2u - out.largest[1] : 0;
  out.largest[0] = static_cast<uint8_t>(2 - out.padding);
  uint64_t steps = 0;
  for (uint32_t i = 0; i < triangle_count_; i += 8) steps |= out.steps(i);
  assert(vertex_count_ + out.padding <= kMaxClusterVertices && (steps & ~(3 * kEachByte)) == 0);
  out.wide_steps = (steps & 2 * kEachByte) != 0;
  out.distance_bits = static_cast<uint32_t>(std::bit_width(furthest));
  out.words =
      words_for(triangle_count_) * (out.wide_steps ? 2 : 1) + words_for(triangle_count_ * 2 * out.distance_bits);
}

/// Orders triangles with the same largest vertex around it: the second corner of a triangle is, where possible, the
/// third corner of the triangle before (codecs.md, split pages).
void ClusterPacker::order_fan(Numbering& out, uint32_t begin, uint32_t end) {
  const auto second = [&](uint32_t i) { return out.distances[i] & 0xffu; };
  const auto third = [&](uint32_t i) { return static_cast<uint32_t>(out.distances[i] >> 8); };
  const auto swap = [&](uint32_t i, uint32_t k) {
    std::swap(out.order[i], out.order[k]);
    std::swap(out.distances[i], out.distances[k]);
  };
  if (end - begin == 2) {  // most often
    if (third(begin + 1) == second(begin) && third(begin) != second(begin + 1)) swap(begin, begin + 1);
    return;
  }
  const auto begins_fan = [&](uint32_t i, uint32_t from) {
    for (uint32_t k = from; k < end; ++k)
      if (k != i && third(k) == second(i)) return false;
    return true;
  };
  for (uint32_t i = begin; i + 1 < end; ++i) {
    uint32_t next = i;
    while (i != begin && next < end && second(next) != third(i - 1)) ++next;
    if (i == begin || next == end) {
      next = i;
      while (next < end && !begins_fan(next, i)) ++next;
    }
    if (next != end) swap(i, next);  // else the triangles close a circle, in which any may be the first
  }
}

void ClusterPacker::choose_numbering() {
  const uint32_t end = number_from(0, kMostDistanceBits, best_);
  const auto try_from = [&](uint32_t start) {
    // If the best numbering has narrow steps, only fewer distance bits are an improvement.
    const uint32_t most_bits = best_.wide_steps ? kMostDistanceBits : std::max(1u, best_.distance_bits) - 1;
    if (number_from(start, most_bits, trial_) != kGaveUp && trial_.words < best_.words) best_ = trial_;
  };
  if (effort_ == PackEffort::kBest) {
    for (uint32_t v = 1; v < vertex_count_; ++v) try_from(v);
  } else if (best_.distance_bits > kGoodDistanceBits) {
    try_from(end);
  }
}

/// Writes steps and distances to `words`; returns the end of both.
uint32_t* ClusterPacker::put_triangles(PackedCluster& cluster, uint32_t* words) const {
  WordWriter writer(words);
  for (uint32_t bit = 0; bit < (best_.wide_steps ? 2u : 1u); ++bit) {
    for (uint32_t i = 0; i < triangle_count_; i += 8)
      writer.put(gather_bits(best_.steps(i), bit), std::min(triangle_count_ - i, 8u));
    writer.end_section();
  }
  const uint32_t bits = best_.distance_bits;
  const auto pair = [&](uint32_t i) {
    return static_cast<uint64_t>((best_.distances[i] & 0xffu) | static_cast<uint32_t>(best_.distances[i] >> 8) << bits);
  };
  uint32_t i = 0;
  static_assert(4 * 2 * kMostDistanceBits <= kMostPutBits);
  for (; i + 4 <= triangle_count_; i += 4)
    writer.put(pair(i) | pair(i + 1) << 2 * bits | pair(i + 2) << 4 * bits | pair(i + 3) << 6 * bits, 8 * bits);
  for (; i < triangle_count_; ++i) writer.put(pair(i), 2 * bits);
  cluster.record.counts |= (triangle_count_ - 1) | best_.distance_bits << 14;
  cluster.record.place |= best_.wide_steps ? 1u << 31 : 0;
  return writer.end_section();
}

/// Appends the cluster's vertices and writes all its data to `words`, which has room for kMostClusterWords +
/// kWriterSlack. Returns the end of the data.
uint32_t* ClusterPacker::put_data(PackedCluster& cluster, std::vector<uint32_t>& vertices, uint32_t* words) const {
  const uint32_t count = vertex_count_ + best_.padding;
  const size_t first = vertices.size();
  vertices.resize(first + count);
  for (uint32_t v = 0; v < vertex_count_; ++v) vertices[first + best_.padding + best_.number[v]] = vertices_[v];
  for (uint32_t i = 0; i < best_.padding; ++i) vertices[first + i] = vertices[first + best_.padding];

  Codes codes;
  codes.count = count;
  for (uint32_t i = 0; i < count; ++i) {
    const uint32_t* offset = &offsets_[3 * size_t{vertices[first + i]}];
    for (size_t axis = 0; axis < 3; ++axis) codes.code[axis][i] = offset[axis];
  }
  std::array<uint32_t, 3>& bits = codes.bits;
  for (size_t axis = 0; axis < 3; ++axis) {
    int32_t min = INT32_MAX, max = 0;  // signed, because SSE2 compares only these
    for (uint32_t i = 0; i < count; ++i) {
      min = std::min(min, static_cast<int32_t>(codes.code[axis][i]));
      max = std::max(max, static_cast<int32_t>(codes.code[axis][i]));
    }
    cluster.min[axis] = static_cast<uint32_t>(min);
    cluster.max[axis] = static_cast<uint32_t>(max);
    for (uint32_t i = 0; i < count; ++i) codes.code[axis][i] -= cluster.min[axis];
    bits[axis] = static_cast<uint32_t>(std::bit_width(cluster.max[axis] - cluster.min[axis]));
  }
  const uint32_t stride = bits[0] + bits[1] + bits[2];

  const Prediction plane = fit_plane(codes);
  const uint32_t axis = plane.predictor.axis;
  if (axis != kNotPredicted && words_for(count * (stride - bits[axis] + plane.bits)) + 2 < words_for(count * stride)) {
    for (uint32_t i = 0; i < count; ++i)
      codes.code[axis][i] -= plane.predictor.bias + static_cast<uint32_t>(predicted(codes, plane.predictor, i));
    bits[axis] = plane.bits;
    cluster.record.place |= axis << 29;
    const uint32_t slopes = (static_cast<uint32_t>(plane.predictor.slope_u) & 0xffffu) |
                            static_cast<uint32_t>(plane.predictor.slope_v) << 16;
    *words++ = slopes;
    *words++ = plane.predictor.bias;
  } else {
    cluster.record.place |= kNotPredicted << 29;
  }
  cluster.record.counts |= (count - 1) << 7 | bits[0] << 17 | bits[1] << 22 | bits[2] << 27;
  WordWriter writer(put_triangles(cluster, words));
  const auto& [x, y, z] = codes.code;
  const uint32_t xy_bits = bits[0] + bits[1];
  if (xy_bits + bits[2] <= kMostPutBits) {  // the common case
    for (uint32_t i = 0; i < count; ++i)
      writer.put(x[i] | uint64_t{y[i]} << bits[0] | uint64_t{z[i]} << xy_bits, xy_bits + bits[2]);
  } else {
    for (uint32_t i = 0; i < count; ++i)
      for (size_t a = 0; a < 3; ++a) writer.put(codes.code[a][i], bits[a]);
  }
  return writer.end_section();
}

uint32_t ClusterPacker::pack(std::span<const uint32_t> triangles, ClusterSet& out) {
  gather(triangles);
  choose_numbering();
  std::fill_n(at_vertex_.begin(), vertex_count_, CornerCounts{});
  const size_t before = out.triangles.size();
  out.triangles.resize(before + triangle_count_);
  for (uint32_t i = 0; i < triangle_count_; ++i) out.triangles[before + i] = triangles[best_.order[i]];
  PackedCluster cluster{};
  std::array<uint32_t, kMostClusterWords + kWriterSlack> words;
  const uint32_t* end = put_data(cluster, out.vertices, words.data());
  cluster.words = static_cast<uint32_t>(end - words.data());
  out.words.insert(out.words.end(), words.begin(), words.begin() + cluster.words);
  out.clusters.push_back(cluster);
  return triangle_count_;
}

}  // namespace scree::format
