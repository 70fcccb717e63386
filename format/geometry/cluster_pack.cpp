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
constexpr uint32_t kAhead = 8;

uint32_t words_for(uint32_t bits) {
  return (bits + 31) / 32;
}

/// The codes of a cluster's vertices, and the bits that they need.
struct Codes {
  uint32_t count;
  std::array<std::array<uint32_t, 3>, kMaxClusterVertices> code;

  uint32_t bits(uint32_t axis) const {
    uint32_t largest = 0;
    for (uint32_t i = 0; i < count; ++i) largest |= code[i][axis];
    return static_cast<uint32_t>(std::bit_width(largest));
  }
};

/// A predictor for one axis, and the bits of its residuals.
struct Prediction {
  ClusterPredictor predictor{kNotPredicted, 0, 0, 0};
  uint32_t bits = 0;
};

int32_t predicted(const std::array<uint32_t, 3>& code, uint32_t u, uint32_t v, int32_t slope_u, int32_t slope_v) {
  return (slope_u * static_cast<int32_t>(code[u]) + slope_v * static_cast<int32_t>(code[v])) >> kPredictorShift;
}

/// The plane nearest to the vertices by least squares, solved for the axis in which its slopes are smallest.
Prediction fit_plane(const Codes& codes) {
  double mean[3] = {};
  for (uint32_t i = 0; i < codes.count; ++i)
    for (size_t axis = 0; axis < 3; ++axis) mean[axis] += codes.code[i][axis];
  for (double& sum : mean) sum /= codes.count;
  double covariance[3][3] = {};
  for (uint32_t i = 0; i < codes.count; ++i) {
    double d[3];
    for (size_t axis = 0; axis < 3; ++axis) d[axis] = codes.code[i][axis] - mean[axis];
    for (size_t a = 0; a < 3; ++a)
      for (size_t b = a; b < 3; ++b) covariance[a][b] += d[a] * d[b];
  }
  for (size_t a = 0; a < 3; ++a)
    for (size_t b = 0; b < a; ++b) covariance[a][b] = covariance[b][a];

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
    if (!(steepest < 2) || codes.bits(u) > kMaxPredictorBits || codes.bits(v) > kMaxPredictorBits) continue;
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
    const int32_t left =
        static_cast<int32_t>(codes.code[i][p]) -
        predicted(codes.code[i], (p + 1) % 3, (p + 2) % 3, best.predictor.slope_u, best.predictor.slope_v);
    smallest = std::min(smallest, left);
    largest = std::max(largest, left);
  }
  best.predictor.bias = static_cast<uint32_t>(smallest);
  best.bits = static_cast<uint32_t>(std::bit_width(static_cast<uint32_t>(largest) - static_cast<uint32_t>(smallest)));
  return best;
}

}  // namespace

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
  const auto most = static_cast<uint32_t>(std::min<size_t>(triangles.size(), kMaxClusterTriangles));
  uint32_t limit = kMaxClusterVertices;
  triangle_count_ = 0;
  vertex_count_ = 0;
  for (; triangle_count_ < most; ++triangle_count_) {
    if (triangle_count_ + kAhead < triangles.size())
      __builtin_prefetch(&indices_[3 * size_t{triangles[triangle_count_ + kAhead]}]);
    const uint32_t* vertex = &indices_[3 * size_t{triangles[triangle_count_]}];
    if (vertex[0] == vertex[1] || vertex[1] == vertex[2] || vertex[2] == vertex[0]) limit = kMaxDegenerateVertices;
    auto& corner = corners_[triangle_count_];
    uint32_t count = vertex_count_;
    for (size_t i = 0; i < 3; ++i) {
      // The next vertex overwrites a vertex that the cluster already has. A branch here would often be mispredicted.
      const uint8_t slot = slots_[vertex[i]];
      vertices_[count] = vertex[i];
      __builtin_prefetch(&offsets_[3 * size_t{vertex[i]}]);
      corner[i] = slot == kFree ? static_cast<uint8_t>(count) : slot;
      count += slot == kFree ? 1 : 0;
      slots_[vertex[i]] = corner[i];
    }
    if (count > limit) {
      for (; count > vertex_count_; --count) slots_[vertices_[count - 1]] = kFree;
      break;
    }
    vertex_count_ = count;
    for (size_t i = 0; i < 3; ++i)
      at_vertex_[corner[i]][i][triangle_count_ / 64] |= uint64_t{1} << (triangle_count_ % 64);
  }
  for (uint32_t v = 0; v < vertex_count_; ++v) slots_[vertices_[v]] = kFree;
}

/// Numbers the vertices outwards from `start`, in the manner of Cuthill and McKee. Where triangles share edges, the
/// next vertex is one that completes a triangle: the triangle's other two vertices already have numbers. It is then the
/// largest of the triangle, so steps are 0 or 1. Returns the last vertex, or kGaveUp as soon as a distance takes more
/// than `most_bits`.
uint32_t ClusterPacker::number_from(uint32_t start, uint32_t most_bits, Numbering& out) {
  std::array<uint8_t, kMaxClusterVertices> queue;  // vertices by number
  CornerSets numbered{};                           // triangles whose corner has a number
  CornerSets known{};                              // triangles whose corner has been taken from the queue
  uint32_t filled = 0;
  std::fill_n(out.number.begin(), vertex_count_, kFree);
  const auto push = [&](uint8_t vertex) {
    out.number[vertex] = static_cast<uint8_t>(filled);
    queue[filled++] = vertex;
    add(at_vertex_[vertex], numbered);
  };
  const auto push_corners = [&](uint32_t triangle) {
    for (const uint8_t corner : corners_[triangle])
      if (out.number[corner] == kFree) push(corner);
  };
  const auto first_of = [](const TriangleSet& set) {
    return static_cast<uint32_t>(set[0] != 0 ? std::countr_zero(set[0]) : 64 + std::countr_zero(set[1]));
  };
  const auto all_corners = [](const CornerSets& sets, size_t word) {
    return sets[0][word] & sets[1][word] & sets[2][word];
  };
  const auto around = [this](uint32_t vertex, size_t word) {
    return at_vertex_[vertex][0][word] | at_vertex_[vertex][1][word] | at_vertex_[vertex][2][word];
  };
  push(static_cast<uint8_t>(start));
  push_corners(first_of({around(start, 0), around(start, 1)}));
  uint32_t placed = 0;
  uint32_t furthest = 0;
  uint32_t widest = 0;
  for (uint32_t at = 0; at < vertex_count_; ++at) {
    if (at == filled)  // the other triangles share no edge with these
      push_corners(first_of({~all_corners(numbered, 0), ~all_corners(numbered, 1)}));
    const uint32_t vertex = queue[at];
    const TriangleSet here{around(vertex, 0), around(vertex, 1)};
    // Numbers all neighbours of the vertex, triangle by triangle around it.
    for (bool again = true; again;) {
      again = false;
      for (size_t word = 0; word < 2; ++word) {
        for (uint64_t left = here[word];;) {
          const uint64_t a = numbered[0][word], b = numbered[1][word], c = numbered[2][word];
          left &= ((a & b) | (b & c) | (c & a)) & ~(a & b & c);  // triangles in which exactly one corner has no number
          if (left == 0) break;
          const int bit = std::countr_zero(left);
          const size_t missing = (a >> bit & 1) + ((a & b) >> bit & 1);
          push(corners_[64 * word + static_cast<size_t>(bit)][missing]);
          left = here[word] & (~uint64_t{1} << bit);
          again = true;
        }
      }
    }
    add(at_vertex_[vertex], known);
    for (size_t word = 0; word < 2; ++word) {
      for (uint64_t left = here[word] & all_corners(known, word); left != 0; left &= left - 1) {
        const auto t = static_cast<uint8_t>(64 * word + static_cast<size_t>(std::countr_zero(left)));
        const auto& corner = corners_[t];
        const uint32_t smallest = std::min({out.number[corner[0]], out.number[corner[1]], out.number[corner[2]]});
        furthest = std::max(furthest, at - smallest);
        if (placed != 0) widest = std::max<uint32_t>(widest, at - out.largest[placed - 1]);
        out.order[placed] = t;
        out.largest[placed++] = static_cast<uint8_t>(at);
      }
    }
    if (furthest >> most_bits != 0) return kGaveUp;
  }
  assert(placed == triangle_count_);
  out.padding = out.largest[0] < 2 ? 2u - out.largest[0] : 0;
  widest = std::max(widest, out.largest[0] + out.padding - 2);
  assert(vertex_count_ + out.padding <= kMaxClusterVertices && widest <= 3);
  out.distance_bits = static_cast<uint32_t>(std::bit_width(furthest));
  out.wide_steps = widest > 1;
  out.words =
      words_for(triangle_count_) * (out.wide_steps ? 2 : 1) + words_for(triangle_count_ * 2 * out.distance_bits);
  return queue[vertex_count_ - 1];
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
    uint32_t before = 2;
    for (uint32_t i = 0; i < triangle_count_; ++i) {
      const uint32_t largest = best_.largest[i] + best_.padding;
      writer.put((largest - before) >> bit & 1u, 1);
      before = largest;
    }
    writer.end_section();
  }
  for (uint32_t i = 0; i < triangle_count_; ++i) {
    const auto& corner = corners_[best_.order[i]];
    const uint32_t largest = best_.largest[i];
    const uint32_t number[3] = {best_.number[corner[0]], best_.number[corner[1]], best_.number[corner[2]]};
    // The largest corner comes first. A rotation of the corners keeps the triangle's orientation.
    const size_t first = number[0] == largest ? 0 : number[1] == largest ? 1 : 2;
    const uint32_t second = largest - number[(first + 1) % 3];
    const uint32_t third = largest - number[(first + 2) % 3];
    writer.put(second | third << best_.distance_bits, 2 * best_.distance_bits);
  }
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
  std::fill_n(cluster.min, 3, ~0u);
  for (uint32_t i = 0; i < count; ++i) {
    const uint32_t* offset = &offsets_[3 * size_t{vertices[first + i]}];
    for (size_t axis = 0; axis < 3; ++axis) {
      codes.code[i][axis] = offset[axis];
      cluster.min[axis] = std::min(cluster.min[axis], offset[axis]);
      cluster.max[axis] = std::max(cluster.max[axis], offset[axis]);
    }
  }
  for (uint32_t i = 0; i < count; ++i)
    for (size_t axis = 0; axis < 3; ++axis) codes.code[i][axis] -= cluster.min[axis];
  uint32_t bits[3];
  for (uint32_t axis = 0; axis < 3; ++axis) {
    bits[axis] = static_cast<uint32_t>(std::bit_width(cluster.max[axis] - cluster.min[axis]));
  }
  const uint32_t stride = bits[0] + bits[1] + bits[2];

  const Prediction plane = fit_plane(codes);
  const uint32_t axis = plane.predictor.axis;
  if (axis != kNotPredicted && words_for(count * (stride - bits[axis] + plane.bits)) + 2 < words_for(count * stride)) {
    for (uint32_t i = 0; i < count; ++i) {
      auto& code = codes.code[i];
      code[axis] -=
          plane.predictor.bias + static_cast<uint32_t>(predicted(code, (axis + 1) % 3, (axis + 2) % 3,
                                                                 plane.predictor.slope_u, plane.predictor.slope_v));
    }
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
  const uint32_t xy_bits = bits[0] + bits[1];
  if (xy_bits + bits[2] <= 32) {  // the common case
    for (uint32_t i = 0; i < count; ++i) {
      const auto& code = codes.code[i];
      writer.put(code[0] | code[1] << bits[0] | static_cast<uint32_t>(uint64_t{code[2]} << xy_bits), xy_bits + bits[2]);
    }
  } else {
    for (uint32_t i = 0; i < count; ++i)
      for (size_t a = 0; a < 3; ++a) writer.put(codes.code[i][a], bits[a]);
  }
  return writer.end_section();
}

uint32_t ClusterPacker::pack(std::span<const uint32_t> triangles, ClusterSet& out) {
  gather(triangles);
  choose_numbering();
  std::fill_n(at_vertex_.begin(), vertex_count_, CornerSets{});
  for (uint32_t i = 0; i < triangle_count_; ++i) out.triangles.push_back(triangles[best_.order[i]]);
  PackedCluster cluster{};
  std::array<uint32_t, kMostClusterWords + kWriterSlack> words;
  const uint32_t* end = put_data(cluster, out.vertices, words.data());
  cluster.words = static_cast<uint32_t>(end - words.data());
  out.words.insert(out.words.end(), words.begin(), words.begin() + cluster.words);
  out.clusters.push_back(cluster);
  return triangle_count_;
}

}  // namespace scree::format
