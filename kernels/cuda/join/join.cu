// Joins split pages: reads their clusters, places the vertices, and writes the clusters.
#include "kernels/cuda/join/join.h"

#include "kernels/cuda/common/check.h"
#include "kernels/cuda/join/join_writer.cuh"

namespace scree::kernels {
namespace {

using namespace joining;

// The warps of a block form a pipeline over the clusters of a part. In each step the first warp reads the triangles of
// a cluster, the second the vertices of the cluster before, the third places the vertices of the one before that, and
// the fourth writes the cluster that was placed in the step before.
constexpr uint32_t kWarps = 4;
constexpr uint32_t kThreads = kWarps * kWarpLanes;

struct BlockMemory {
  ReadTriangles triangles[kWarps];
  ReadVertices vertices[2];
  PlacedCluster placed[2];
  TriangleMemory reader;
  uint32_t words[kMostWords];
  uint32_t is_bad[2];  // by the parity of the step
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

/// Places the `vertices` vertices of a cluster. `history`: of the part. `first_vertex`: number of the cluster's first
/// one in the part. `before`: the cluster before, or null.
__device__ void place(ReadVertices& in, uint32_t vertices, const PlacedCluster* before, History history,
                      uint32_t first_vertex, PlacedCluster& out, uint32_t lane) {
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
    const auto sum_of = [at](const Corners& corners) {
      const auto sum_of_one = [at](uint32_t corner) {
        return at[corner & 0xff] + at[corner >> 8 & 0xff] - at[corner >> 16 & 0xff];
      };
      return sum_of_one(corners.first) + sum_of_one(corners.second);
    };
    // The vertex just before counts as 0 in `sum`, so that the sum can be loaded before that vertex is placed. The
    // corners are loaded one vertex earlier still.
    Corners corners = in.corners[0];
    Corners next = in.corners[1];
    uint32_t sum = sum_of(corners);
    uint32_t last = 0;
    uint32_t smallest = kMostOffset;
    uint32_t largest = 0;
    for (uint32_t v = 0; v < vertices; ++v) {
      const Corners after = in.corners[v + 2];
      const uint32_t value = in.values[lane][v];
      const uint32_t next_sum = sum_of(next);
      const uint32_t twice = sum + ((corners.first >> 24) - 2) * last;
      last = (static_cast<uint32_t>(static_cast<int32_t>(twice) >> 1) + value) & kMostOffset;
      at[v] = last;
      smallest = min_of(smallest, last);
      largest = max_of(largest, last);
      corners = next;
      next = after;
      sum = next_sum;
    }
    out.box.min[lane] = smallest;
    out.box.max[lane] = largest;
  }
  __syncwarp();
  for (uint32_t v = lane; v < vertices; v += kWarpLanes)
    for (uint32_t axis = 0; axis < 3; ++axis) history.set(first_vertex + v, axis, out.at[axis][v]);
}

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
  TriangleReader triangles(task, slot.bytes, block.reader, lane);
  VertexReader vertices(task, slot.bytes, lane);
  Writer writer(task, arena, block.words);
  const History history(slot.history + task.history, task.keeps_wide());
  uint32_t first_vertex = 0;
  if (threadIdx.x < 2) block.is_bad[threadIdx.x] = 0;
  __syncthreads();
  for (uint32_t step = 0; step < task.cluster_count + kWarps - 1; ++step) {
    const uint32_t cluster = step - warp;
    bool is_good = true;
    if (cluster >= task.cluster_count) {
      // The pipeline fills or drains.
    } else if (warp == 0) {
      is_good = triangles.read(block.triangles[cluster % kWarps]);
    } else if (warp == 1) {
      is_good = vertices.read(block.triangles[cluster % kWarps], block.vertices[cluster % 2]);
    } else if (warp == 2) {
      const uint32_t count = block.triangles[cluster % kWarps].vertex_count;
      const PlacedCluster* const before = cluster != 0 ? &block.placed[(cluster - 1) % 2] : nullptr;
      place(block.vertices[cluster % 2], count, before, history, first_vertex, block.placed[cluster % 2], lane);
      first_vertex += count;
    } else {
      is_good = writer.write(block.triangles[cluster % kWarps], block.placed[cluster % 2], cluster, lane);
    }
    if (!is_good && lane == 0) block.is_bad[step % 2] = 1;
    __syncthreads();
    if (block.is_bad[step % 2] != 0) {
      if (threadIdx.x == 0) *slot.failed = 1;
      return;
    }
  }
  if (warp == kWarps - 1 && !writer.finish(lane) && lane == 0) *slot.failed = 1;
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
