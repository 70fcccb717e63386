#include "runtime/stream/join_plan.h"

#include <algorithm>
#include <array>
#include <cassert>
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
  task.cluster_words = record.cluster_words;
  return task;
}

}  // namespace

/// A split page, and the destination of its bytes.
struct JoinPlan::Split {
  std::span<const std::byte> bytes;
  uint64_t page_bytes;
  std::span<const JoinChunk> chunks;
  JoinPlaces places;             // of the page; without `to` if chunks have places of their own
  std::span<const uint64_t> to;  // by chunk; empty if the page is copied to one place

  bool goes_whole() const { return to.empty(); }
  /// The destination of a chunk. `offset`: in the page.
  uint64_t place_of(size_t chunk, uint64_t offset) const { return goes_whole() ? places.to + offset : to[chunk]; }
};

bool JoinPlan::add_split(std::span<const std::byte> split, uint64_t page_bytes, std::span<const JoinChunk> chunks,
                         const JoinPlaces& places) {
  return add({split, page_bytes, chunks, places, {}});
}

bool JoinPlan::add_chunks(std::span<const std::byte> split, uint64_t page_bytes, std::span<const JoinChunk> chunks,
                          uint32_t from, std::span<const uint64_t> to) {
  assert(chunks.size() == to.size());
  return !chunks.empty() && add({split, page_bytes, chunks, {from, 0}, to});
}

bool JoinPlan::add(const Split& split) {
  const std::optional<SplitParts> page = format::split_streams::locate_parts(split.bytes);
  if (!page) return false;
  PageRoom room(split.page_bytes);
  for (const JoinChunk& chunk : split.chunks)
    if (!room.take(*chunk.chunk)) return false;
  JoinPlan added;
  uint64_t done = 0;
  size_t next = 0;  // of the chunks
  for (const SplitPart& part : page->parts) {
    const uint32_t plain_from = part.first[format::split_streams::kPlain];
    const std::span<const std::byte> plain = split.bytes.subspan(plain_from, part.plain_bytes);
    const uint32_t plain_in_slot = split.places.from + plain_from;
    if (part.cluster_count != 0) {
      if (next == split.chunks.size() || split.chunks[next].chunk->offset != done ||
          done % format::kChunkAlignment != 0)
        return false;
      const JoinChunk& chunk = split.chunks[next];
      std::optional<JoinTask> task = task_of(*page, part, chunk);
      if (!task) return false;
      const uint64_t bytes = format::cluster_stream_bytes(part.cluster_count, chunk.chunk->cluster_words);
      if (bytes > split.page_bytes - done || chunk.chunk->bytes < bytes || chunk.chunk->bytes - bytes > plain.size() ||
          !check_behind_clusters(*chunk.mesh, *chunk.chunk, plain.first(chunk.chunk->bytes - bytes)))
        return false;
      if (const uint64_t to = split.place_of(next, done); to != kNotWanted) {
        task->to = to;
        task->from = split.places.from;
        task->history = static_cast<uint32_t>(history_words_ + added.history_words_);
        added.history_words_ += JoinTask::history_words(task->keeps_wide(), part.vertex_count);
        added.tasks_.push_back(*task);
        if (!split.goes_whole()) added.add_copy({plain_in_slot, to + bytes}, chunk.chunk->bytes - bytes);
      }
      ++next;
      done += bytes;
    }
    if (plain.size() > split.page_bytes - done) return false;
    for (; next < split.chunks.size() && split.chunks[next].chunk->encoding != format::ChunkEncoding::kClustered;
         ++next) {
      const format::ChunkRecord& chunk = *split.chunks[next].chunk;
      if (chunk.offset < done || chunk.offset - done > plain.size() ||
          chunk.bytes > plain.size() - (chunk.offset - done))
        break;  // in a later part, or in none
      format::ChunkRecord moved = chunk;
      moved.offset = chunk.offset - done;
      if (!check_chunk(*split.chunks[next].mesh, moved, plain)) return false;
      if (!split.goes_whole() && split.to[next] != kNotWanted)
        added.add_copy({static_cast<uint32_t>(plain_in_slot + moved.offset), split.to[next]}, chunk.bytes);
    }
    if (split.goes_whole()) added.add_copy({plain_in_slot, split.places.to + done}, plain.size());
    done += plain.size();
  }
  if (done != split.page_bytes || next != split.chunks.size() || history_words_ + added.history_words_ > UINT32_MAX)
    return false;
  tasks_.insert(tasks_.end(), added.tasks_.begin(), added.tasks_.end());
  history_words_ += added.history_words_;
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
