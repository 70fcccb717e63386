// Predicts the position of a cluster's next vertex from its triangles so far. Source: spec/codecs.md, split pages.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "format/geometry/cluster_layout.h"

namespace scree::format {

/// Offsets of a vertex from the chunk's position_min: x, y, z and 0. A vector of four, so that one instruction handles
/// all axes.
using Offsets = int32_t __attribute__((vector_size(16)));

/// Takes the triangles of a cluster in order and places its vertices in order, each right before the first triangle
/// that refers to it. The caller ensures that vertex numbers are below 128, and that distances are below
/// 2^distance_bits and at most their triangle's largest vertex.
class VertexPredictor {
 public:
  /// `before`: expected offsets of the first vertex.
  void begin(uint32_t distance_bits, const Offsets& before) {
    bits_ = distance_bits;
    std::fill_n(opposite_.begin(), size_t{kMaxClusterVertices} << bits_, kNoVertex);
    next_ = 0;
    found_ = 0;
    expected_ = before;
  }

  /// The next triangle. `place(vertex, expected)` returns the offsets of a vertex; it is called for all unplaced
  /// vertices before `largest`.
  template <class Place>
  void triangle(uint32_t largest, const uint32_t back[2], Place&& place) {
    place_to(largest, place);
    if (back[0] == 0 || back[1] == 0 || back[0] == back[1]) return;
    const uint32_t a = largest - back[0];
    const uint32_t b = largest - back[1];
    uint16_t& across = opposite_[edge(a, b)];
    if (across < largest) {
      if (found_ < kFull) add(a, b, across);
    } else if (found_ == 0) {
      expected_ = (at_[a] + at_[b]) >> 1;
    }
    across = static_cast<uint16_t>(largest);
    opposite_[largest << bits_ | back[0]] = static_cast<uint16_t>(b);
    opposite_[largest << bits_ | back[1]] = static_cast<uint16_t>(a);
  }

  /// Places the remaining vertices up to `count`.
  template <class Place>
  void finish(uint32_t count, Place&& place) {
    place_to(count, place);
  }

  /// Offsets of a placed vertex.
  Offsets at(uint32_t vertex) const { return at_[vertex]; }

 private:
  static constexpr uint16_t kNoVertex = 0xffff;
  static constexpr uint32_t kFull = 2;  // number of parallelograms that are averaged; more gain nothing

  /// Index of an edge in the table: the larger number, then the distance back to the other.
  uint32_t edge(uint32_t a, uint32_t b) const { return std::max(a, b) << bits_ | (std::max(a, b) - std::min(a, b)); }

  void add(uint32_t a, uint32_t b, uint32_t across) {
    const Offsets corner = at_[a] + at_[b] - at_[across];
    expected_ = found_ == 0 ? corner : (expected_ + corner) >> 1;
    ++found_;
  }

  template <class Place>
  void place_to(uint32_t end, Place&& place) {
    while (next_ < end) {
      at_[next_] = place(next_, expected_);
      expected_ = at_[next_++];  // for a vertex that completes no triangle
      found_ = 0;
    }
  }

  uint32_t bits_ = 0;
  uint32_t next_ = 0;   // number of placed vertices
  uint32_t found_ = 0;  // number of parallelograms averaged in `expected_`
  Offsets expected_{};  // of vertex next_
  Offsets at_[kMaxClusterVertices];
  // Per edge: the vertex opposite to it in the last triangle that has the edge. Not bytes, since a compiler must assume
  // that bytes alias everything.
  std::array<uint16_t, kMaxClusterVertices * kMaxClusterVertices> opposite_;
};

}  // namespace scree::format
