// The streams of a split page, and the earlier vertices to which it can refer. Source: spec/codecs.md, split pages.
#pragma once

#include <cstdint>
#include <cstring>

#include "format/geometry/cluster_layout.h"
#include "format/geometry/vertex_predictor.h"

namespace scree::format::split_streams {

enum Stream : uint32_t {
  kParts,      // number of clusters, number of plain bytes, and so on alternating, u32 each
  kTriangles,  // a byte per cluster: triangles less one
  kVertices,   // a byte per cluster: vertices less one
  kForms,      // a byte per cluster: distance bits 0 to 2, wide steps 3, predicted axis 4 and 5
  kSlopes,     // of clusters with a prediction: i16 each
  kSteps,      // low bits of a cluster's steps, then high bits if wide: whole bytes
  kDistances,  // both distances of each triangle: one byte, the first in its low half; a byte each if over 4 bits
  kPlaces,     // per vertex: 0 it has a residual, 1 to 254 the step to an equal earlier vertex, 255 it is in kFar
  kFar,        // u16: how many vertices back the equal vertex is
  kResiduals,  // of vertices with place 0: low bytes of x, of y, of z, then the next byte of each, and so on
  kPlain,      // bytes outside clusters
  kStreams,
};
inline constexpr const char* kNames[kStreams] = {"parts",     "triangles", "vertices", "forms",     "slopes", "steps",
                                                 "distances", "places",    "far",      "residuals", "plain"};

// A split page begins with the number of bytes per residual and the sizes of the streams.
inline constexpr uint64_t kHeaderBytes = 4 * (1 + uint64_t{kStreams});
inline constexpr uint32_t kMaxPlanes = 3;      // residuals are modulo 2^24
inline constexpr uint32_t kShortDistance = 4;  // distances of at most this many bits take half a byte
inline constexpr uint32_t kFarPlace = 255;
inline constexpr uint32_t kMostBack = 65535;  // vertices

/// Values in RecentVertices: a power of two, so that a modulo without a branch keeps any index within bounds.
inline constexpr uint32_t kMostValues = 1u << 17;

/// The vertices of a part, numbered from 0 in the part; the oldest that nothing can refer to any more are forgotten.
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
