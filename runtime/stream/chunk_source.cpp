#include "runtime/stream/chunk_source.h"

#include <algorithm>
#include <atomic>
#include <cstring>
#include <new>

#include "runtime/stream/streamed_copy.h"
#include "runtime/threads/first_error.h"

namespace scree::runtime {

ChunkSource::ChunkSource(const Scene& scene) : scene_(scene) {
  const DrawnPages& drawn = scene.drawn_pages();
  index_.assign(scene.container().pages().size(), 0);
  for (uint64_t i = 0; i < drawn.size(); ++i) index_[drawn.page(i)] = i;
  checked_.assign(index_.size(), 0);
}

std::vector<uint64_t> ChunkSource::chunk_bytes() const {
  const kernels::SceneView& view = scene_.view();
  std::vector<uint64_t> bytes(view.chunk_count, 0);
  std::vector<bool> done(view.mesh_count, false);
  for (uint64_t i = 0; i < view.instance_count; ++i) {
    const uint32_t number = view.instances[i].mesh;
    if (done[number]) continue;
    done[number] = true;
    const format::MeshRecord& mesh = view.meshes[number];
    for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c) bytes[c] = view.chunks[c].bytes;
  }
  return bytes;
}

Result<void> ChunkSource::read(std::span<const Residency::Place> places, std::byte* memory, Reader reader,
                               Workers& workers) try {
  const format::ChunkRecord* const chunks = scene_.view().chunks;
  std::vector<Residency::Place> sorted(places.begin(), places.end());
  std::sort(sorted.begin(), sorted.end(), [&](const Residency::Place& a, const Residency::Place& b) {
    const format::ChunkRecord& first = chunks[a.chunk];
    const format::ChunkRecord& second = chunks[b.chunk];
    return first.page != second.page ? first.page < second.page : first.offset < second.offset;
  });
  std::vector<Job> jobs;
  for (size_t i = 0; i < sorted.size(); ++i) {
    const uint32_t page = chunks[sorted[i].chunk].page;
    if (jobs.empty() || jobs.back().page != page) jobs.push_back({page, i, i});
    jobs.back().last = i + 1;
  }
  const auto ask_for = [&](size_t i) {
    if (i >= jobs.size() || scene_.has_pages()) return;
    const format::PageRecord& record = scene_.container().pages()[jobs[i].page];
    scene_.file().map().will_need(record.offset, record.stored_bytes);
  };
  for (size_t i = 0; i < workers.count(); ++i) ask_for(i);
  FirstError failure;
  workers.for_each(jobs.size(), [&](uint64_t i) {
    if (failure.is_superseded(i)) return;
    ask_for(i + workers.count());
    if (const Result<void> done = read(jobs[i], sorted, memory, reader); !done) failure.report(i, done.error());
  });
  if (failure.any()) return at(scene_.file().path(), failure.error());
  return {};
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, scene_.file().path() + ": no memory left to read its chunks"};
}

Result<void> ChunkSource::read(const Job& job, std::span<const Residency::Place> places, std::byte* memory,
                               Reader reader) {
  const kernels::SceneView& view = scene_.view();
  const std::atomic_ref<uint8_t> checked(checked_[job.page]);
  std::vector<std::byte> scratch;
  std::span<const std::byte> raw;
  if (view.pages[job.page] != nullptr) {
    raw = {view.pages[job.page], scene_.container().pages()[job.page].raw_bytes};
  } else {
    const format::Container& container = scene_.container();
    const format::PageRecord& record = container.pages()[job.page];
    // load_page() computes the checksum, which takes as long as the copy. For a raw page of the map once is enough.
    if (checked != 0 && record.codec == format::PageCodec::kRaw) {
      raw = container.stored_page(job.page);
    } else {
      const Result<std::span<const std::byte>> loaded = container.load_page(job.page, scratch);
      if (!loaded) return loaded.error();
      raw = *loaded;
    }
    if (checked == 0) {
      if (Result<void> good = scene_.drawn_pages().check(index_[job.page], raw); !good) return good;
      checked = 1;
    }
  }
  for (size_t i = job.first; i < job.last; ++i) {
    const format::ChunkRecord& chunk = view.chunks[places[i].chunk];
    if (chunk.bytes == 0) continue;
    std::byte* const to = memory + places[i].offset;
    const std::byte* const from = raw.data() + chunk.offset;
    if (reader == Reader::kDevice) {
      copy_past_cache(to, from, chunk.bytes);
    } else {
      std::memcpy(to, from, chunk.bytes);
    }
  }
  return {};
}

}  // namespace scree::runtime
