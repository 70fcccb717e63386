// The payloads of a scene's chunks, from host memory or the file's map, checked before they are first handed out.
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
  /// `scene` outlives this. Where it has its pages (Scene::load_pages) they are copied from; where not, pages come from
  /// the map, through the page cache, and stay with the system. Throws std::bad_alloc.
  explicit ChunkSource(const Scene& scene);

  /// Bytes of every chunk that the scene draws, by chunk; 0 for the others.
  std::vector<uint64_t> chunk_bytes() const;

  /// Who reads the copies next.
  enum class Reader : uint8_t { kProcessor, kDevice };

  /// Copies the payload of each place's chunk to place.offset of `memory`, on `workers`. The first time that a page is
  /// asked for it is checked whole, with its drawn chunks' streams, before anything of it is copied. A compressed page
  /// is unpacked once for all its chunks in `places`. Errors, with the file and the place named: those of load_pages(),
  /// the one of the first bad page by number; kMemory. Thread-safe where the places and the workers differ.
  Result<void> read(std::span<const Residency::Place> places, std::byte* memory, Reader reader, Workers& workers);

 private:
  /// A run of places of one page.
  struct Job {
    uint32_t page;
    size_t first;
    size_t last;
  };
  Result<void> read(const Job& job, std::span<const Residency::Place> places, std::byte* memory, Reader reader);

  const Scene& scene_;
  std::vector<uint64_t> index_;   // of a page in Scene::drawn_pages(), by number
  std::vector<uint8_t> checked_;  // by page number
};

}  // namespace scree::runtime
