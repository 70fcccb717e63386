#include "runtime/stream/chunk_source.h"

#include <algorithm>
#include <atomic>
#include <cstring>
#include <new>

#include "format/bytes.h"
#include "format/geometry/cluster_page.h"
#include "runtime/stream/streamed_copy.h"
#include "runtime/threads/first_error.h"

namespace scree::runtime {

ChunkSource::ChunkSource(const Scene& scene) : scene_(scene) {
  const DrawnPages& drawn = scene.drawn_pages();
  index_.assign(scene.container().pages().size(), 0);
  for (uint64_t i = 0; i < drawn.size(); ++i) index_[drawn.page(i)] = i;
  checked_.assign(index_.size(), 0);
  refused_.assign(index_.size(), 0);
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

namespace {

/// In the order of the file.
std::vector<Residency::Place> sorted_by_page(std::span<const Residency::Place> places,
                                             const format::ChunkRecord* chunks) {
  std::vector<Residency::Place> sorted(places.begin(), places.end());
  std::sort(sorted.begin(), sorted.end(), [&](const Residency::Place& a, const Residency::Place& b) {
    const format::ChunkRecord& first = chunks[a.chunk];
    const format::ChunkRecord& second = chunks[b.chunk];
    return first.page != second.page ? first.page < second.page : first.offset < second.offset;
  });
  return sorted;
}

Error no_memory() {
  return {ErrorCode::kMemory, "no memory left to read its chunks"};
}

/// The most bytes of a page's frame in a slot.
uint64_t slot_room(const format::PageRecord& record) {
  return format::kMaxSplitRatio * format::align_up(record.raw_bytes, format::kPageAlignment);
}

}  // namespace

std::vector<ChunkSource::Job> ChunkSource::jobs_of(std::span<const Residency::Place> sorted) const {
  const format::ChunkRecord* const chunks = scene_.view().chunks;
  std::vector<Job> jobs;
  for (size_t i = 0; i < sorted.size(); ++i) {
    const uint32_t page = chunks[sorted[i].chunk].page;
    if (jobs.empty() || jobs.back().page != page) jobs.push_back({page, i, i});
    jobs.back().last = i + 1;
  }
  return jobs;
}

/// Starts the system's read-ahead for a job's page.
void ChunkSource::ask_for(std::span<const Job> jobs, size_t i) const {
  if (i >= jobs.size() || scene_.has_pages()) return;
  const format::PageRecord& record = scene_.container().pages()[jobs[i].page];
  scene_.file().map().will_need(record.offset, record.stored_bytes);
}

Result<void> ChunkSource::read(std::span<const Residency::Place> places, std::byte* memory, Reader reader,
                               Workers& workers) try {
  const std::vector<Residency::Place> sorted = sorted_by_page(places, scene_.view().chunks);
  const std::vector<Job> jobs = jobs_of(sorted);
  for (size_t i = 0; i < workers.count(); ++i) ask_for(jobs, i);
  FirstError failure;
  workers.for_each(jobs.size(), [&](uint64_t i) {
    if (failure.is_superseded(i)) return;
    ask_for(jobs, i + workers.count());
    if (const Result<void> done = read(jobs[i], sorted, memory, reader); !done) failure.report(i, done.error());
  });
  return failure.any() ? Result<void>(failure.error()) : Result<void>();
} catch (const std::bad_alloc&) {
  return no_memory();
}

Result<void> ChunkSource::read(const Job& job, std::span<const Residency::Place> places, std::byte* memory,
                               Reader reader) {
  const kernels::SceneView& view = scene_.view();
  std::vector<std::byte> scratch;
  const std::span<const std::byte> raw = SCREE_TRY(load(job.page, scratch));
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

Result<std::span<const std::byte>> ChunkSource::load(uint32_t page, std::vector<std::byte>& scratch) {
  const kernels::SceneView& view = scene_.view();
  const format::Container& container = scene_.container();
  const format::PageRecord& record = container.pages()[page];
  if (view.pages[page] != nullptr) return std::span<const std::byte>(view.pages[page], record.raw_bytes);
  const std::atomic_ref<uint8_t> checked(checked_[page]);
  // load_page() computes the checksum, which takes as long as the copy. For a raw page of the map once is enough.
  if (checked != 0 && record.codec == format::PageCodec::kRaw) return container.stored_page(page);
  const Result<std::span<const std::byte>> raw = container.load_page(page, scratch);
  if (raw && checked == 0) {
    SCREE_TRY(scene_.drawn_pages().check(index_[page], *raw));
    checked = 1;
  }
  return raw;
}

uint64_t ChunkSource::most_slot_bytes() const {
  uint64_t most = 0;
  for (uint64_t i = 0; i < scene_.drawn_pages().size(); ++i)
    if (can_send_page(scene_.drawn_pages().page(i))) most = std::max(most, slot_room(scene_.drawn_pages().record(i)));
  return most;
}

bool ChunkSource::can_send_page(uint32_t page) const {
  const format::PageRecord& record = scene_.container().pages()[page];
  return record.codec == format::PageCodec::kSplit && record.raw_bytes <= format::kPageTargetBytes &&
         scene_.view().pages[page] == nullptr && refused_[page] == 0;
}

bool ChunkSource::can_send(uint32_t chunk) const {
  return can_send_page(scene_.view().chunks[chunk].page);
}

void ChunkSource::refuse(std::span<const Residency::Place> places) {
  for (const Residency::Place& place : places) refused_[scene_.view().chunks[place.chunk].page] = 1;
}

Result<void> ChunkSource::send(std::span<const Residency::Place> places, JoinTarget& target, Workers& workers) try {
  const std::vector<Residency::Place> sorted = sorted_by_page(places, scene_.view().chunks);
  const std::vector<Job> jobs = jobs_of(sorted);
  // Small pages share a slot.
  struct Range {
    size_t first;
    size_t last;
  };
  std::vector<Range> slots;
  uint64_t bytes = 0;
  for (size_t i = 0; i < jobs.size(); ++i) {
    const uint64_t room = slot_room(scene_.container().pages()[jobs[i].page]);
    if (slots.empty() || bytes + room > target.slot_bytes()) {
      slots.push_back({i, i});
      bytes = 0;
    }
    slots.back().last = i + 1;
    bytes += room;
  }
  const uint64_t threads = std::min<uint64_t>(workers.count(), target.slot_count());
  const size_t ahead = 2 * threads;
  for (size_t i = 0; i < ahead; ++i) ask_for(jobs, i);
  FirstError failure;
  std::atomic<size_t> next = 0;
  workers.for_each(std::min<uint64_t>(threads, slots.size()), [&](uint64_t) {
    for (size_t i = next++; i < slots.size() && !failure.any(); i = next++) {
      const auto [first, last] = slots[i];
      for (size_t job = first; job < last; ++job) ask_for(jobs, job + ahead);
      const Result<void> done = send(std::span(jobs).subspan(first, last - first), sorted, target);
      if (!done) failure.report(i, done.error());
    }
  });
  return failure.any() ? Result<void>(failure.error()) : Result<void>();
} catch (const std::bad_alloc&) {
  return no_memory();
}

/// Sends the places of pages that lie together in a slot.
Result<void> ChunkSource::send(std::span<const Job> jobs, std::span<const Residency::Place> places,
                               JoinTarget& target) {
  const JoinTarget::Slot slot = SCREE_TRY(target.take());
  const auto give_back = [&](Error error) {
    target.give_back(slot);
    return error;
  };
  // Without room to join on the device, the pages are joined here.
  for (const bool is_split : {true, false}) {
    Filling filling{slot.memory};
    Result<void> done;
    try {
      for (const Job& job : jobs)
        if (done) done = is_split ? fill_split(job, places, filling) : fill_raw(job, places, filling);
    } catch (const std::bad_alloc&) {
      done = Error{ErrorCode::kMemory, "no memory left to read a page"};
    }
    if (!done) return give_back(done.error());
    const Result<bool> is_taken = target.join(slot, filling.end, filling.plan);
    if (!is_taken) return give_back(is_taken.error());
    if (*is_taken) return {};
  }
  return give_back({ErrorCode::kMemory, "no room to join a page"});
}

/// Unpacks the frame of a page. A page that the device cannot join is joined here.
Result<void> ChunkSource::fill_split(const Job& job, std::span<const Residency::Place> places, Filling& filling) {
  const format::Container& container = scene_.container();
  const DrawnPages& pages = scene_.drawn_pages();
  SCREE_TRY(container.check_page(job.page, container.padded_page(job.page)));
  const auto stored = container.stored_page(job.page);
  const uint64_t content = SCREE_TRY(container.content_bytes(job.page, stored));
  const std::span<std::byte> split = filling.memory.subspan(filling.end, content);
  SCREE_TRY(container.unpack_content(job.page, stored, split));
  const uint64_t index = index_[job.page];
  std::vector<JoinChunk> chunks;
  std::vector<uint64_t> to;
  size_t next = job.first;
  for (uint64_t i = 0; i < pages.chunk_count(index); ++i) {
    const format::ChunkRecord& chunk = container.chunks()[pages.chunk(index, i)];
    chunks.push_back({&container.meshes()[chunk.mesh], &chunk});
    const bool is_wanted = next < job.last && places[next].chunk == pages.chunk(index, i);
    to.push_back(is_wanted ? places[next++].offset : kNotWanted);
  }
  if (next != job.last || !filling.plan.add_chunks(split, container.pages()[job.page].raw_bytes, chunks,
                                                   static_cast<uint32_t>(filling.end), to))
    return fill_raw(job, places, filling);
  filling.end = format::align_up(filling.end + content, Residency::kAlignment);
  return {};
}

/// Joins a page here, and leaves only copies of its chunks to the device.
Result<void> ChunkSource::fill_raw(const Job& job, std::span<const Residency::Place> places, Filling& filling) {
  std::vector<std::byte> scratch;
  const std::span<const std::byte> raw = SCREE_TRY(load(job.page, scratch));
  for (size_t i = job.first; i < job.last; ++i) {
    const format::ChunkRecord& chunk = scene_.view().chunks[places[i].chunk];
    copy_past_cache(filling.memory.data() + filling.end, raw.data() + chunk.offset, chunk.bytes);
    filling.plan.add_copy({static_cast<uint32_t>(filling.end), places[i].offset}, chunk.bytes);
    filling.end = format::align_up(filling.end + chunk.bytes, 16);
  }
  filling.end = format::align_up(filling.end, Residency::kAlignment);
  return {};
}

}  // namespace scree::runtime
