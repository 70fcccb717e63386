// The work of joining split pages on a GPU (kernels/cuda/join/join.h): which clusters and bytes go where.
#pragma once

#include <cstdint>

#include "format/geometry/split_streams.h"
#include "format/hd.h"

namespace scree::kernels {

/// The most vertices of a part that are kept for later ones to refer to, a power of two.
inline constexpr uint32_t kJoinHistory = 1 << 16;
static_assert(format::split_streams::kMostBack < kJoinHistory);

/// Joins the clusters of a part, or copies bytes. Sources lie in a slot, results in an arena. The code that makes a
/// task checks that both are in range (runtime/stream/join_plan.h).
struct JoinTask {
  uint64_t to = 0;                                       // offset in the arena; for clusters a multiple of 4
  uint32_t from = 0;                                     // offset in the slot: of the split page, or of the bytes
  uint32_t bytes = 0;                                    // to copy; 0: joins clusters
  uint32_t cluster_count = 0;                            // of the part
  uint32_t first[format::split_streams::kStreams] = {};  // as SplitPart::first
  format::split_streams::StreamPlanes planes;            // of the page
  uint32_t cluster_words = 0;                            // that the clusters' data must take
  uint32_t largest[3] = {};                              // largest offset of a vertex, from the chunk's position_min
  uint32_t history = 0;                                  // place of the part's kept vertices in the slot's history

  /// Whether each axis of a kept vertex takes four bytes instead of two.
  SCREE_HD bool keeps_wide() const { return (largest[0] | largest[1] | largest[2]) >> 16 != 0; }
  /// Words of the history that the part needs.
  static uint64_t history_words(bool is_wide, uint64_t vertices) {
    const uint64_t kept = vertices < kJoinHistory ? vertices : kJoinHistory;
    return is_wide ? 3 * kept : (3 * kept + 1) / 2;
  }
};

}  // namespace scree::kernels
