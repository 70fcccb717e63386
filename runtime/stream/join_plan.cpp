#include "runtime/stream/join_plan.h"

#include <algorithm>
#include <array>
#include <optional>

#include "format/geometry/cluster_codec.h"
#include "format/geometry/position_codec.h"
#include "format/geometry/split_streams.h"
#include "runtime/scene/pages.h"

namespace scree::runtime {
namespace {

using format::split_streams::SplitPart;
using format::split_streams::SplitParts;
using kernels::JoinTask;

/// A block of the device copies at most this many bytes.
constexpr uint64_t kMostCopy = uint64_t{32} << 10;

/// The task of a part's clusters, which are those of `chunk`. nullopt if they cannot be.
std::optional<JoinTask> task_of(const SplitParts& page, const SplitPart& part, const JoinChunk& chunk) {
  const format::ChunkRecord& record = *chunk.chunk;
  if (record.encoding != format::ChunkEncoding::kClustered || record.cluster_count != part.cluster_count ||
      record.triangle_count != part.triangle_count || record.vertex_count != part.vertex_count ||
      record.cluster_words > format::kMaxClusterWords)
    return std::nullopt;
  const format::MeshLattice lattice = format::lattice_of(*chunk.mesh);
  const format::PositionRange range = format::position_range_of(record);
  if (!check_offsets(lattice, range, {})) return std::nullopt;
  JoinTask task;
  std::array<uint32_t, 3> largest;
  for (size_t axis = 0; axis < 3; ++axis) {
    largest[axis] = std::min((1u << range.bits[axis]) - 1, (1u << lattice.bits[axis]) - 1 - range.min[axis]);
    task.largest[axis] = largest[axis];
  }
  if (!check_offsets(lattice, range, largest)) return std::nullopt;  // a smaller offset could pass
  task.cluster_count = part.cluster_count;
  std::copy(std::begin(part.first), std::end(part.first), task.first);
  task.planes = page.planes;
  task.residual_count = page.residual_count;
  task.residuals = page.residuals;
  task.cluster_words = record.cluster_words;
  return task;
}

}  // namespace

bool JoinPlan::add_split(std::span<const std::byte> split, uint64_t page_bytes, std::span<const JoinChunk> chunks,
                         const JoinPlaces& places) {
  const std::optional<SplitParts> page = format::split_streams::locate_parts(split);
  if (!page) return false;
  JoinPlan added;
  uint64_t done = 0;
  for (const SplitPart& part : page->parts) {
    const uint32_t plain_from = part.first[format::split_streams::kPlain];
    const std::span<const std::byte> plain = split.subspan(plain_from, part.plain_bytes);
    if (part.cluster_count != 0) {
      if (chunks.empty() || chunks[0].chunk->offset != done || done % format::kChunkAlignment != 0) return false;
      const JoinChunk chunk = chunks[0];
      chunks = chunks.subspan(1);
      std::optional<JoinTask> task = task_of(*page, part, chunk);
      if (!task) return false;
      const uint64_t bytes = format::cluster_stream_bytes(part.cluster_count, chunk.chunk->cluster_words);
      if (bytes > page_bytes - done || chunk.chunk->bytes < bytes || chunk.chunk->bytes - bytes > plain.size() ||
          !check_behind_clusters(*chunk.mesh, *chunk.chunk, plain.first(chunk.chunk->bytes - bytes)))
        return false;
      task->to = places.to + done;
      task->from = places.from;
      task->first_vertex = static_cast<uint32_t>(vertices_ + added.vertices_);
      added.vertices_ += part.vertex_count;
      added.tasks_.push_back(*task);
      done += bytes;
    }
    if (plain.size() > page_bytes - done) return false;
    for (; !chunks.empty() && chunks[0].chunk->encoding != format::ChunkEncoding::kClustered;
         chunks = chunks.subspan(1)) {
      const format::ChunkRecord& chunk = *chunks[0].chunk;
      if (chunk.offset < done || chunk.offset - done > plain.size() ||
          chunk.bytes > plain.size() - (chunk.offset - done))
        break;  // in a later part, or in none
      format::ChunkRecord moved = chunk;
      moved.offset = chunk.offset - done;
      if (!check_chunk(*chunks[0].mesh, moved, plain)) return false;
    }
    added.add_copy({places.from + plain_from, places.to + done}, plain.size());
    done += plain.size();
  }
  if (done != page_bytes || !chunks.empty() || vertices_ + added.vertices_ > UINT32_MAX) return false;
  tasks_.insert(tasks_.end(), added.tasks_.begin(), added.tasks_.end());
  vertices_ += added.vertices_;
  return true;
}

void JoinPlan::add_copy(const JoinPlaces& places, uint64_t bytes) {
  for (uint64_t done = 0; done < bytes; done += kMostCopy) {
    JoinTask& task = tasks_.emplace_back();
    task.from = static_cast<uint32_t>(places.from + done);
    task.to = places.to + done;
    task.bytes = static_cast<uint32_t>(std::min(bytes - done, kMostCopy));
  }
}

}  // namespace scree::runtime
