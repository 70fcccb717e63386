// Joins split pages (format/geometry/cluster_page.h) on a GPU: the same bytes as join_page(), checked as
// check_clusters() checks them. Parts are joined side by side, a block of four warps each; the clusters of a part
// follow one another, because their vertices refer to earlier ones.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>
#include <span>

#include "format/result.h"
#include "kernels/join_task.h"

namespace scree::kernels {

/// Tasks with memory of their own. Device memory, except `failed`.
struct JoinSlot {
  const JoinTask* tasks;
  uint32_t task_count;
  const std::byte* bytes;  // sources, a multiple of 4; up to 3 bytes before and after them are read
  uint32_t* history;       // JoinPlan::history_words() of all tasks
  uint32_t* failed;        // pinned; set to 1 if a part is bad, whose bytes are then unspecified
};

/// The most slots of a launch.
inline constexpr uint32_t kMostJoinSlots = 32;

/// Queues the tasks of up to kMostJoinSlots slots on `stream`; their results are written to `arena`. Errors kDevice.
Result<void> join_parts(std::span<const JoinSlot> slots, std::byte* arena, cudaStream_t stream);

}  // namespace scree::kernels
