// The payloads of a scene's chunks, from host memory or the file's map, checked before their first use.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/result.h"
#include "runtime/scene/scene.h"
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
  /// its chunks in `places`. Errors, with file and place: errors of load_pages(), for the bad page with the lowest
  /// number; kMemory. Thread-safe for different places and workers.
  Result<void> read(std::span<const Residency::Place> places, std::byte* memory, Reader reader, Workers& workers);

 private:
  /// Consecutive places of one page.
  struct Job {
    uint32_t page;
    size_t first;
    size_t last;
  };
  Result<void> read(const Job& job, std::span<const Residency::Place> places, std::byte* memory, Reader reader);

  const Scene& scene_;
  std::vector<uint64_t> index_;   // by page number: index in Scene::drawn_pages()
  std::vector<uint8_t> checked_;  // by page number
};

}  // namespace scree::runtime
