// The earlier vertices to which a split page can refer, while it is split or joined. Source: spec/codecs.md, split
// pages.
#pragma once

#include <cstdint>
#include <cstring>

#include "format/geometry/cluster_layout.h"
#include "format/geometry/split_streams.h"
#include "format/geometry/vertex_predictor.h"

namespace scree::format::split_streams {

/// Values in RecentVertices: a power of two, so that a modulo without a branch keeps any index within bounds.
inline constexpr uint32_t kMostValues = 1u << 17;

/// The vertices of a part, numbered from 0 in the part; the oldest, to which no later vertex can refer, are dropped.
/// They lie in one array behind the residuals of a cluster, so that one index selects a vertex or a residual.
class RecentVertices {
 public:
  void clear() {
    used_ = 0;
    forgotten_ = 0;
  }
  /// Number of vertices.
  uint32_t count() const { return forgotten_ + used_; }
  /// Returns where the caller writes the vertices of the next cluster before it calls add().
  Offsets* make_room() {
    if (used_ + kMaxClusterVertices > kRoom) {
      forgotten_ += used_ - kMostBack;
      std::memmove(vertices(), vertices() + used_ - kMostBack, kMostBack * sizeof(Offsets));
      used_ = kMostBack;
    }
    return vertices() + used_;
  }
  void add(uint32_t vertices) { used_ += vertices; }

  /// Room for kMaxClusterVertices residuals, then the vertices.
  Offsets* values() { return values_; }
  /// Vertex n has index (first_index() + n) modulo 2^32 in values().
  uint32_t first_index() const { return kMaxClusterVertices - forgotten_; }
  Offsets at(uint32_t number) const { return values_[first_index() + number]; }

 private:
  static constexpr uint32_t kRoom = kMostValues - kMaxClusterVertices;  // each vertex moves once

  Offsets* vertices() { return values_ + kMaxClusterVertices; }

  uint32_t used_ = 0;
  uint32_t forgotten_ = 0;
  Offsets values_[kMostValues];
};

/// Memory that splitting and joining need beside the page.
struct SplitMemory {
  RecentVertices recent;
  VertexPredictor predictor;
};

}  // namespace scree::format::split_streams
