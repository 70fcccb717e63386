// Plans how a device joins split pages (kernels/cuda/join/join.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/layout.h"
#include "kernels/join_task.h"

namespace scree::runtime {

/// A drawn chunk of a page.
struct JoinChunk {
  const format::MeshRecord* mesh;
  const format::ChunkRecord* chunk;
};

/// Where bytes lie: in a slot, and in the arena.
struct JoinPlaces {
  uint32_t from = 0;
  uint64_t to = 0;
};

/// The place of a chunk that is not wanted.
inline constexpr uint64_t kNotWanted = ~uint64_t{0};

class JoinPlan {
 public:
  /// Adds the tasks that join a split page of `page_bytes` raw bytes with these drawn chunks. Checks everything that
  /// the device does not check (kernels/cuda/join/join.h). So the device reads no bytes outside the split page, and
  /// writes none outside the page. Returns false if the page has to be joined and checked here instead: it is damaged,
  /// some of its clusters are not drawn, or its chunks are not in the order of their offsets. Throws std::bad_alloc.
  bool add_split(std::span<const std::byte> split, uint64_t page_bytes, std::span<const JoinChunk> chunks,
                 const JoinPlaces& places);
  /// The same for some chunks of the page, each with its own destination in the arena. `from`: where the page lies in
  /// its slot. `to`: by chunk of `chunks`, a multiple of 4 or kNotWanted. Checks the other chunks except their
  /// clusters.
  bool add_chunks(std::span<const std::byte> split, uint64_t page_bytes, std::span<const JoinChunk> chunks,
                  uint32_t from, std::span<const uint64_t> to);
  /// Adds tasks that copy bytes, such as a raw page.
  void add_copy(const JoinPlaces& places, uint64_t bytes);

  const std::vector<kernels::JoinTask>& tasks() const { return tasks_; }
  /// Words of device memory for the kept vertices of all parts.
  uint64_t history_words() const { return history_words_; }

 private:
  struct Split;
  bool add(const Split& split);

  std::vector<kernels::JoinTask> tasks_;
  uint64_t history_words_ = 0;
};

}  // namespace scree::runtime
