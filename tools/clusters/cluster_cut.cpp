#include "tools/clusters/cluster_cut.h"

#include <algorithm>

#include "format/geometry/cluster_pack.h"

namespace scree::tools {
namespace {

using format::kMaxClusterTriangles;
using format::kMaxClusterVertices;

constexpr uint32_t kNone = ~0u;

/// The cluster that is being filled: its vertices, and whether it has room for more.
class OpenCluster {
 public:
  OpenCluster(uint32_t vertex_count, uint32_t most_triangles)
      : most_triangles_(std::min(most_triangles, kMaxClusterTriangles)), cluster_of_(vertex_count, kNone) {}

  uint32_t triangles() const { return triangles_; }
  bool has(uint32_t vertex) const { return cluster_of_[vertex] == number_; }

  /// Whether a triangle still fits.
  bool fits(const uint32_t corner[3]) const {
    uint32_t fresh = 0;
    for (size_t i = 0; i < 3; ++i) {
      bool known = has(corner[i]);
      for (size_t k = 0; k < i; ++k) known |= corner[k] == corner[i];
      fresh += known ? 0 : 1;
    }
    return triangles_ < most_triangles_ && vertices_ + fresh <= limit(corner);
  }

  /// Adds a triangle. `joined(vertex)` is called for each new vertex.
  template <class Joined>
  void add(const uint32_t corner[3], const Joined& joined) {
    limit_ = limit(corner);
    ++triangles_;
    for (size_t i = 0; i < 3; ++i) {
      if (has(corner[i])) continue;
      cluster_of_[corner[i]] = number_;
      ++vertices_;
      joined(corner[i]);
    }
  }

  void next() {
    ++number_;
    triangles_ = 0;
    vertices_ = 0;
    limit_ = kMaxClusterVertices;
  }

 private:
  uint32_t limit(const uint32_t corner[3]) const {
    const bool degenerate = corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0];
    return degenerate ? std::min(limit_, format::kMaxDegenerateVertices) : limit_;
  }

  uint32_t most_triangles_;
  std::vector<uint32_t> cluster_of_;  // by vertex: the last cluster that used it
  uint32_t number_ = 0;
  uint32_t triangles_ = 0;
  uint32_t vertices_ = 0;
  uint32_t limit_ = kMaxClusterVertices;
};

/// Grows one cluster after another.
class Growth {
 public:
  Growth(std::span<const uint32_t> indices, uint32_t vertex_count, uint32_t most_triangles)
      : indices_(indices), cluster_(vertex_count, most_triangles), known_(indices.size() / 3) {
    list_triangles(vertex_count);
  }

  ClusterCut run() {
    const size_t count = known_.size();
    out_.triangles.reserve(count);
    while (out_.triangles.size() < count) {
      uint32_t next = next_neighbour();
      // A cluster without free neighbours takes triangles from elsewhere only if it is less than half full.
      if (next == kNone && cluster_.triangles() >= kMaxClusterTriangles / 2) {
        finish();
        continue;
      }
      if (next == kNone) next = next_seed();
      if (!cluster_.fits(corners(next))) {
        finish();
        continue;
      }
      take(next);
    }
    if (cluster_.triangles() != 0) finish();
    return std::move(out_);
  }

 private:
  static constexpr uint8_t kTaken = 0xff;

  const uint32_t* corners(uint32_t triangle) const { return &indices_[3 * size_t{triangle}]; }

  void list_triangles(uint32_t vertex_count) {
    first_at_.assign(size_t{vertex_count} + 1, 0);
    for (const uint32_t vertex : indices_) ++first_at_[vertex];
    uint32_t sum = 0;
    for (uint32_t& first : first_at_) {
      const uint32_t count = first;
      first = sum;
      sum += count;
    }
    left_at_.assign(vertex_count, 0);
    at_vertex_.resize(indices_.size());
    for (size_t i = 0; i < indices_.size(); ++i) {
      const uint32_t vertex = indices_[i];
      at_vertex_[first_at_[vertex] + left_at_[vertex]++] = static_cast<uint32_t>(i / 3);
    }
  }

  /// A neighbour that needs no new vertex, else the one that has shared an edge with the cluster for longest, else
  /// kNone.
  uint32_t next_neighbour() {
    while (!ready_.empty()) {
      const uint32_t triangle = ready_.back();
      ready_.pop_back();
      if (known_[triangle] != kTaken) return triangle;
    }
    while (front_at_ < front_.size()) {
      const uint32_t triangle = front_[front_at_++];
      if (known_[triangle] != kTaken) return triangle;
    }
    return kNone;
  }

  /// The triangle beside the previous cluster with the fewest free triangles around it, so that no small remainders
  /// arise. If there is none: the first free triangle.
  uint32_t next_seed() {
    uint32_t best = kNone;
    uint32_t fewest = kNone;
    for (const uint32_t triangle : seeds_) {
      if (known_[triangle] == kTaken) continue;
      uint32_t left = 0;
      for (size_t i = 0; i < 3; ++i) left += left_at_[corners(triangle)[i]];
      if (left >= fewest) continue;
      fewest = left;
      best = triangle;
    }
    if (best != kNone) return best;
    while (known_[first_left_] == kTaken) ++first_left_;
    return first_left_;
  }

  void take(uint32_t triangle) {
    known_[triangle] = kTaken;
    out_.triangles.push_back(triangle);
    for (size_t i = 0; i < 3; ++i) --left_at_[corners(triangle)[i]];
    cluster_.add(corners(triangle), [this](uint32_t vertex) {
      for (uint32_t i = first_at_[vertex]; i < first_at_[vertex + 1]; ++i) {
        const uint32_t around = at_vertex_[i];
        const uint8_t known = known_[around];
        if (known == kTaken) continue;
        known_[around] = static_cast<uint8_t>(known + 1);
        if (known == 0) touched_.push_back(around);
        if (known == 1) front_.push_back(around);
        if (known == 2) ready_.push_back(around);
      }
    });
  }

  void finish() {
    out_.ends.push_back(static_cast<uint32_t>(out_.triangles.size()));
    cluster_.next();
    seeds_.clear();
    for (const uint32_t triangle : touched_) {
      if (known_[triangle] == kTaken) continue;
      seeds_.push_back(triangle);
      known_[triangle] = 0;
    }
    touched_.clear();
    front_.clear();
    front_at_ = 0;
    ready_.clear();
  }

  std::span<const uint32_t> indices_;
  OpenCluster cluster_;
  ClusterCut out_;
  // The triangles at each vertex, once per corner there: at_vertex_[first_at_[v]] to at_vertex_[first_at_[v + 1]].
  std::vector<uint32_t> first_at_;
  std::vector<uint32_t> at_vertex_;
  std::vector<uint32_t> left_at_;  // by vertex: corners that are in no cluster yet
  std::vector<uint8_t> known_;     // by triangle: its number of corners in the open cluster, or kTaken
  std::vector<uint32_t> touched_;  // triangles with a corner in the open cluster
  std::vector<uint32_t> front_;    // triangles with two such corners, in the order in which they got the second
  std::vector<uint32_t> ready_;    // triangles with three such corners
  std::vector<uint32_t> seeds_;    // triangles beside the previous cluster
  size_t front_at_ = 0;
  uint32_t first_left_ = 0;  // all triangles before it are taken
};

}  // namespace

ClusterCut cut_by_neighbourhood(std::span<const uint32_t> indices, uint32_t vertex_count, uint32_t most_triangles) {
  return Growth(indices, vertex_count, most_triangles).run();
}

}  // namespace scree::tools
