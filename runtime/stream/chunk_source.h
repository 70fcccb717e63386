// The payloads of a scene's chunks, from host memory or the file's map, checked before their first use.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/result.h"
#include "runtime/scene/scene.h"
#include "runtime/stream/join_target.h"
#include "runtime/stream/residency.h"
#include "runtime/threads/workers.h"

namespace scree::runtime {

class ChunkSource {
 public:
  /// `scene` must outlive this. If it has its pages (Scene::load_pages), payloads are copied from them. If not, pages
  /// are read through the map and the page cache, and no copy of them is kept. Throws std::bad_alloc.
  explicit ChunkSource(const Scene& scene);

  /// Payload bytes of every chunk that the scene draws, by chunk; 0 for the others.
  std::vector<uint64_t> chunk_bytes() const;

  /// The processor that reads the copies next.
  enum class Reader : uint8_t { kProcessor, kDevice };

  /// Copies the payload of each place's chunk to place.offset of `memory`, on `workers`. Before the first copy out of a
  /// page, the whole page and the streams of its drawn chunks are checked. A compressed page is unpacked once for all
  /// its chunks in `places`. Errors, without the file: those of load_pages(), for the bad page with the lowest number;
  /// kMemory. Thread-safe for different places and workers.
  Result<void> read(std::span<const Residency::Place> places, std::byte* memory, Reader reader, Workers& workers);

  /// The most bytes that the page of a chunk for send() takes in a slot; 0 if there is no such chunk.
  uint64_t most_slot_bytes() const;
  /// Whether send() may be used for a chunk: its page is split, not larger than kPageTargetBytes, and was never
  /// refused.
  bool can_send(uint32_t chunk) const;
  /// As read(), but unpacks only the frames of split pages, and leaves it to `target` to join each place's chunk at
  /// place.offset of its arena and to check its clusters. Everything else in the pages is checked here. `places`: of
  /// chunks for which can_send() returns true. Errors as read(), of any bad page, after which read() finds the first;
  /// kDevice. `target` may still be at work when this returns.
  Result<void> send(std::span<const Residency::Place> places, JoinTarget& target, Workers& workers);
  /// After `target` found one of these chunks bad, makes can_send() return false for the chunks of their pages.
  void refuse(std::span<const Residency::Place> places);

 private:
  /// Consecutive places of one page.
  struct Job {
    uint32_t page;
    size_t first;
    size_t last;
  };
  std::vector<Job> jobs_of(std::span<const Residency::Place> sorted) const;
  void ask_for(std::span<const Job> jobs, size_t i) const;
  bool can_send_page(uint32_t page) const;
  Result<void> read(const Job& job, std::span<const Residency::Place> places, std::byte* memory, Reader reader);
  /// The raw bytes of a page, checked if they are used for the first time. They may lie in `scratch`.
  Result<std::span<const std::byte>> load(uint32_t page, std::vector<std::byte>& scratch);

  /// Places of pages that lie together in a slot.
  struct Filling {
    std::span<std::byte> memory;
    uint64_t end = 0;
    JoinPlan plan{};
  };
  Result<void> send(std::span<const Job> jobs, std::span<const Residency::Place> places, JoinTarget& target);
  Result<void> fill_split(const Job& job, std::span<const Residency::Place> places, Filling& filling);
  Result<void> fill_raw(const Job& job, std::span<const Residency::Place> places, Filling& filling);

  const Scene& scene_;
  std::vector<uint64_t> index_;   // by page number: index in Scene::drawn_pages()
  std::vector<uint8_t> checked_;  // by page number
  std::vector<uint8_t> refused_;  // by page number
};

}  // namespace scree::runtime
