#include "runtime/stream/upload.h"

#include <algorithm>
#include <atomic>
#include <cassert>
#include <cstring>
#include <deque>
#include <mutex>
#include <new>
#include <optional>
#include <span>
#include <utility>

#include "format/bytes.h"
#include "runtime/files/direct_file.h"
#include "runtime/stream/join_plan.h"
#include "runtime/threads/first_error.h"
#include "runtime/threads/parallel.h"

namespace scree::runtime {
namespace {

constexpr uint64_t kPieceAlignment = 256;

/// A unit of work for a thread.
struct Job {
  enum class Kind {
    kMemory,     // [from, from + bytes), at most a slot
    kPages,      // pages [first, last), together at most a slot
    kCheck,      // page `first`, raw and larger than a slot: check it in the map; kMemory jobs copy it
    kLargeZstd,  // page `first`, larger than a slot
  };
  Kind kind;
  const std::byte* from;
  uint64_t bytes;  // in the arena
  uint64_t offset;
  uint64_t first;
  uint64_t last;
};

void add_memory(std::vector<Job>& jobs, const std::byte* from, uint64_t bytes, uint64_t offset, uint64_t slot_bytes) {
  for (uint64_t done = 0; done < bytes; done += slot_bytes)
    jobs.push_back({Job::Kind::kMemory, from + done, std::min(slot_bytes, bytes - done), offset + done, 0, 0});
}

/// Bytes of a page in the arena.
uint64_t page_room(const DrawnPages& pages, uint64_t index) {
  return format::align_up(pages.record(index).raw_bytes, format::kPageAlignment);
}

/// The tables first, then the pages in order.
std::vector<Job> jobs_of(const UploadPlan& plan, uint64_t slot_bytes) {
  std::vector<Job> jobs;
  for (const UploadPlan::Piece& piece : plan.pieces())
    add_memory(jobs, piece.from, piece.bytes, piece.offset, slot_bytes);
  if (plan.pages() == nullptr) return jobs;
  const DrawnPages& pages = *plan.pages();
  for (uint64_t i = 0; i < pages.size();) {
    const uint64_t offset = plan.page_offset(i);
    if (page_room(pages, i) > slot_bytes) {
      const format::PageRecord& record = pages.record(i);
      const bool is_raw = record.codec == format::PageCodec::kRaw;
      jobs.push_back({is_raw ? Job::Kind::kCheck : Job::Kind::kLargeZstd, nullptr, record.raw_bytes, offset, i, i + 1});
      if (is_raw)
        add_memory(jobs, pages.container().stored_page(pages.page(i)).data(), record.raw_bytes, offset, slot_bytes);
      ++i;
      continue;
    }
    uint64_t last = i;
    while (last < pages.size() && plan.page_offset(last) + page_room(pages, last) <= offset + slot_bytes) ++last;
    const uint64_t end = plan.page_offset(last - 1) + page_room(pages, last - 1);
    jobs.push_back({Job::Kind::kPages, nullptr, end - offset, offset, i, last});
    i = last;
  }
  return jobs;
}

/// Free slots, then slots whose copies are running, in the order of their start. A thread holds at most one slot, so as
/// many slots as threads are always enough.
class SlotRing {
 public:
  SlotRing(UploadTarget& target, uint32_t slots) : target_(target), joined_(slots, kNoJob) {
    for (uint32_t i = 0; i < slots; ++i) free_.push_back(i);
  }

  Result<uint32_t> take() {
    uint32_t slot = 0;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (!free_.empty()) {
        slot = free_.front();
        free_.pop_front();
        return slot;
      }
      assert(!copying_.empty());
      slot = copying_.front();
      copying_.pop_front();
    }
    if (Result<void> done = finish(slot); !done) {
      give_back(slot);
      return done.error();
    }
    return slot;
  }

  /// Gives back a slot of which no copy is running.
  void give_back(uint32_t slot) {
    const std::lock_guard<std::mutex> lock(mutex_);
    free_.push_back(slot);
  }

  /// Starts a copy out of a taken slot.
  Result<void> copy(uint32_t slot, uint64_t to, uint64_t bytes) { return started(slot, target_.copy(slot, to, bytes)); }

  /// Starts a join out of a taken slot. `job`: its number.
  Result<void> join(uint32_t slot, uint64_t bytes, std::span<const kernels::JoinTask> tasks, uint64_t job) {
    joined_[slot] = job;
    return started(slot, target_.join(slot, bytes, tasks));
  }

  /// Waits for all copies, also after an error, because the slots' memory is about to be freed.
  Result<void> drain() {
    Result<void> result;
    for (const uint32_t slot : copying_) {
      if (Result<void> done = finish(slot); !done && result) result = done;
      free_.push_back(slot);
    }
    copying_.clear();
    return result;
  }

  /// The jobs whose pages the device refused, among the joins that are done. Called by one thread alone.
  std::vector<uint64_t> take_refused() { return std::exchange(refused_, {}); }

 private:
  static constexpr uint64_t kNoJob = UINT64_MAX;

  Result<void> started(uint32_t slot, Result<void> result) {
    if (!result) {
      joined_[slot] = kNoJob;
      give_back(slot);
      return result;
    }
    const std::lock_guard<std::mutex> lock(mutex_);
    copying_.push_back(slot);
    return {};
  }

  /// Waits for a slot's copy or join.
  Result<void> finish(uint32_t slot) {
    const uint64_t job = std::exchange(joined_[slot], kNoJob);
    SCREE_TRY(target_.wait(slot));
    if (job == kNoJob || target_.has_joined(slot)) return {};
    const std::lock_guard<std::mutex> lock(mutex_);
    refused_.push_back(job);
    return {};
  }

  UploadTarget& target_;
  std::mutex mutex_;
  std::deque<uint32_t> free_;
  std::deque<uint32_t> copying_;
  std::vector<uint64_t> joined_;  // by slot: the job whose pages are joined, or kNoJob
  std::vector<uint64_t> refused_;
};

class Uploader {
 public:
  Uploader(const UploadPlan& plan, const MappedFile& map, UploadTarget& target, const StagingSizes& sizes,
           bool is_mapped, JobProgress* progress)
      : plan_(plan),
        map_(map),
        target_(target),
        sizes_(sizes),
        is_mapped_(is_mapped),
        progress_(progress),
        jobs_(jobs_of(plan, sizes.job_bytes())),
        ring_(target, sizes.slots),
        joins_(sizes.joins) {
    bounce_.reserve(sizes.slots);  // room for all buffers, so that giving one back allocates nothing
  }

  /// Opens the file for reads past the page cache, if that is supported.
  Result<void> open_direct() {
    Result<DirectFile> file = DirectFile::open(map_);
    if (!file && file.error().code != ErrorCode::kUnsupported) return file.error();
    if (!file) return {};
    direct_.emplace(std::move(*file));
    is_direct_ = true;
    return {};
  }

  Result<UploadCounts> run(uint32_t threads) {
    FirstError failure;
    if (is_direct_) threads = std::max(threads, kDirectThreads);
    threads = std::clamp(threads, 1u, sizes_.slots);
    for (uint64_t i = 0; i < std::min<uint64_t>(threads, jobs_.size()); ++i) ask_for(i);
    if (progress_ != nullptr) progress_->begin("upload", job_bytes());
    try {
      parallel_for(jobs_.size(), threads, [&](uint64_t i) {
        if (failure.is_superseded(i)) return;
        ask_for(i + threads);
        Result<void> done = run(jobs_[i]);
        if (done) done = JobProgress::advance(progress_, jobs_[i].bytes);
        if (!done) failure.report(i, done.error());
      });
    } catch (...) {
      (void)ring_.drain();
      throw;
    }
    Result<void> drained = ring_.drain();
    if (drained) drained = redo(ring_.take_refused(), failure);
    if (failure.any()) return failure.error();
    if (!drained) return drained.error();
    return counts();
  }

 private:
  /// A buffer of a slot's size for compressed pages that are read past the page cache; kept for the next job. Empty if
  /// the uploader is null.
  class BounceBuffer {
   public:
    explicit BounceBuffer(Uploader* uploader) : uploader_(uploader) {
      if (uploader_ == nullptr) return;
      {
        const std::lock_guard<std::mutex> lock(uploader_->bounce_mutex_);
        if (!uploader_->bounce_.empty()) {
          memory_ = std::move(uploader_->bounce_.back());
          uploader_->bounce_.pop_back();
          return;
        }
      }
      memory_ = direct_memory(uploader_->sizes_.slot_bytes);
    }
    BounceBuffer(const BounceBuffer&) = delete;
    BounceBuffer& operator=(const BounceBuffer&) = delete;
    ~BounceBuffer() {
      if (memory_ == nullptr) return;
      const std::lock_guard<std::mutex> lock(uploader_->bounce_mutex_);
      uploader_->bounce_.push_back(std::move(memory_));
    }
    std::byte* data() const { return memory_.get(); }

   private:
    Uploader* uploader_;
    DirectMemory memory_;
  };

  /// Starts the system's read-ahead for job `i`.
  void ask_for(uint64_t i) const {
    if (i >= jobs_.size() || jobs_[i].first == jobs_[i].last) return;
    if (is_direct_ && jobs_[i].kind == Job::Kind::kPages) return;
    const DrawnPages& pages = *plan_.pages();
    const format::PageRecord& first = pages.record(jobs_[i].first);
    const format::PageRecord& last = pages.record(jobs_[i].last - 1);
    map_.will_need(first.offset, last.offset + last.stored_bytes - first.offset);
  }

  /// Does jobs again, without the device's help, which gives the errors of their pages.
  Result<void> redo(const std::vector<uint64_t>& jobs, FirstError& failure) {
    joins_ = false;
    for (const uint64_t job : jobs) {
      if (failure.is_superseded(job)) continue;
      if (Result<void> done = run(jobs_[job]); !done) failure.report(job, done.error());
    }
    return ring_.drain();
  }

  Result<void> run(const Job& job) {
    if (job.kind == Job::Kind::kMemory) return copy_memory(job.from, job.bytes, job.offset);
    if (job.kind == Job::Kind::kPages) return copy_pages(job);
    return job.kind == Job::Kind::kCheck ? check_large(job) : copy_large_zstd(job);
  }

  /// `bytes`: at most a slot.
  Result<void> copy_memory(const std::byte* from, uint64_t bytes, uint64_t offset) {
    const uint32_t slot = SCREE_TRY(ring_.take());
    std::memcpy(target_.slot(slot), from, bytes);
    return ring_.copy(slot, offset, bytes);
  }

  /// A slot that the pages of a job are read into.
  struct SlotPages {
    const Job* job;
    std::byte* memory;
    bool joins;           // pages lie one after the other, and `plan` makes the job's bytes of them on the device
    JoinPlan plan{};      // if `joins`
    uint64_t end = 0;     // of the pages in the slot so far
    uint64_t joined = 0;  // pages
  };

  Result<void> copy_pages(const Job& job) {
    const uint32_t slot = SCREE_TRY(ring_.take());
    SlotPages pages{&job, target_.slot(slot), joins_ && has_split(job)};
    Result<void> done = fill(pages);
    if (pages.joins) {
      const std::vector<kernels::JoinTask>& tasks = pages.plan.tasks();
      const JoinRoom room = target_.join_room();
      if (done && tasks.size() <= room.tasks && pages.plan.history_words() <= room.history_words) {
        joined_pages_ += pages.joined;
        return ring_.join(slot, pages.end, tasks, static_cast<uint64_t>(&job - jobs_.data()));
      }
      // A page before one with an error may be bad too, which only the device would find.
      pages.joins = false;
      done = fill(pages);
    }
    if (!done) {
      ring_.give_back(slot);
      return done;
    }
    return ring_.copy(slot, job.offset, job.bytes);
  }

  bool has_split(const Job& job) const {
    for (uint64_t i = job.first; i < job.last; ++i)
      if (plan_.pages()->record(i).codec == format::PageCodec::kSplit) return true;
    return false;
  }

  Result<void> fill(SlotPages& slot) {
    if (is_direct_) {
      const Result<void> done = read_pages(slot);
      if (done || done.error().code != ErrorCode::kUnsupported) return done;
      // If the memory or the file system does not support direct reads, no thread tries them again.
      is_direct_ = false;
      slot = {slot.job, slot.memory, slot.joins};
    }
    return take_pages(slot);
  }

  /// The offset of the next page: a multiple of format::kPageAlignment.
  std::byte* place_of(const SlotPages& slot, uint64_t index) const {
    return slot.memory + (slot.joins ? slot.end : plan_.page_offset(index) - slot.job->offset);
  }

  /// Reads the pages of a job into a slot, through the page cache.
  Result<void> take_pages(SlotPages& slot) {
    const DrawnPages& pages = *plan_.pages();
    for (uint64_t i = slot.job->first; i < slot.job->last; ++i) {
      std::span<const std::byte> padded = pages.container().padded_page(pages.page(i));
      std::byte* const to = place_of(slot, i);
      const bool is_raw = pages.record(i).codec == format::PageCodec::kRaw;
      if (is_raw && !padded.empty()) {
        if (is_mapped_)
          std::memcpy(to, padded.data(), padded.size());
        else if (Result<void> read = map_.read(pages.record(i).offset, {to, padded.size()}); !read)
          return read;
        padded = {to, padded.size()};
      }
      SCREE_TRY(finish_page(i, padded, to, slot));
      if (is_mapped_ || !is_raw) map_.release(pages.record(i).offset, pages.record(i).stored_bytes);
    }
    return {};
  }

  /// Reads the pages of a job into a slot, past the page cache. Raw pages that are adjacent in the file are adjacent in
  /// the slot.
  Result<void> read_pages(SlotPages& slot) {
    const DrawnPages& pages = *plan_.pages();
    for (uint64_t i = slot.job->first; i < slot.job->last;) {
      const bool is_raw = pages.record(i).codec == format::PageCodec::kRaw;
      uint64_t last = i + 1;
      while (last < slot.job->last && pages.page(last) == pages.page(last - 1) + 1 &&
             (pages.record(last).codec == format::PageCodec::kRaw) == is_raw)
        ++last;
      const uint64_t begin = pages.record(i).offset;
      const uint64_t end = pages.record(last - 1).offset + pages.record(last - 1).stored_bytes;
      const uint64_t bytes = format::align_up(end - begin, DirectFile::kAlignment);
      // Compressed pages are smaller than unpacked ones, so all pages of a job fit a buffer of a slot's size.
      BounceBuffer bounce(is_raw ? nullptr : this);
      std::byte* const from = is_raw ? place_of(slot, i) : bounce.data();
      SCREE_TRY(direct_->read(begin, {from, bytes}));
      direct_bytes_ += bytes;
      for (; i < last; ++i) {
        std::byte* const page = from + (pages.record(i).offset - begin);
        const std::span<const std::byte> padded(page, pages.container().padded_page(pages.page(i)).size());
        SCREE_TRY(finish_page(i, padded, is_raw ? page : place_of(slot, i), slot));
      }
    }
    return {};
  }

  /// Checks a page, and unpacks it to `to` if it is compressed. A raw page already lies there.
  Result<void> finish_page(uint64_t index, std::span<const std::byte> padded, std::byte* to, SlotPages& slot) {
    const DrawnPages& pages = *plan_.pages();
    const format::Container& container = pages.container();
    const format::PageRecord& record = pages.record(index);
    const uint32_t page = pages.page(index);
    SCREE_TRY(container.check_page(page, padded));
    const auto stored = padded.first(record.stored_bytes);
    if (slot.joins && record.codec == format::PageCodec::kSplit) {
      const bool is_left = SCREE_TRY(leave_split(index, stored, to, slot));
      if (is_left) return {};
    }
    const std::span<std::byte> room(to, record.raw_bytes);
    if (record.codec != format::PageCodec::kRaw) SCREE_TRY(container.unpack_page(page, stored, room));
    if (slot.joins) {
      slot.plan.add_copy({offset_in(slot, to), plan_.page_offset(index)}, record.raw_bytes);
      slot.end = format::align_up(offset_in(slot, to) + record.raw_bytes, format::kPageAlignment);
    }
    return pages.check(index, room);
  }

  static uint32_t offset_in(const SlotPages& slot, const std::byte* place) {
    return static_cast<uint32_t>(place - slot.memory);
  }

  /// Unpacks the frame of a split page to `to`. Returns whether the device can join it.
  Result<bool> leave_split(uint64_t index, std::span<const std::byte> stored, std::byte* to, SlotPages& slot) {
    const DrawnPages& pages = *plan_.pages();
    const format::Container& container = pages.container();
    const uint32_t page = pages.page(index);
    const Result<uint64_t> content = container.content_bytes(page, stored);  // at most twice the page's room
    if (!content) return content.error();
    const std::span<std::byte> split(to, *content);
    SCREE_TRY(container.unpack_content(page, stored, split));
    std::vector<JoinChunk> chunks;
    for (uint64_t i = 0; i < pages.chunk_count(index); ++i) {
      const format::ChunkRecord& chunk = container.chunks()[pages.chunk(index, i)];
      chunks.push_back({&container.meshes()[chunk.mesh], &chunk});
    }
    if (!slot.plan.add_split(split, pages.record(index).raw_bytes, chunks,
                             {offset_in(slot, to), plan_.page_offset(index)}))
      return false;
    slot.end = format::align_up(offset_in(slot, to) + *content, format::kPageAlignment);
    ++slot.joined;
    return true;
  }

  Result<void> check_large(const Job& job) {
    const DrawnPages& pages = *plan_.pages();
    const format::Container& container = pages.container();
    const uint32_t page = pages.page(job.first);
    SCREE_TRY(container.check_page(page, container.padded_page(page)));
    return pages.check(job.first, container.stored_page(page));
  }

  /// Unpacks a large page to separate memory, one page at a time, and copies it from there.
  Result<void> copy_large_zstd(const Job& job) {
    const std::lock_guard<std::mutex> lock(large_mutex_);
    std::vector<std::byte> scratch;
    const uint32_t page = plan_.pages()->page(job.first);
    const std::span<const std::byte> raw = SCREE_TRY(plan_.pages()->container().load_page(page, scratch));
    SCREE_TRY(plan_.pages()->check(job.first, raw));
    for (uint64_t done = 0; done < raw.size(); done += sizes_.slot_bytes) {
      const uint64_t bytes = std::min(sizes_.slot_bytes, raw.size() - done);
      SCREE_TRY(copy_memory(raw.data() + done, bytes, job.offset + done));
    }
    return {};
  }

  uint64_t job_bytes() const {
    uint64_t bytes = 0;
    for (const Job& job : jobs_) bytes += job.bytes;
    return bytes;
  }

  UploadCounts counts() const {
    UploadCounts counts;
    counts.direct_bytes = direct_bytes_;
    counts.joined_pages = joined_pages_;
    for (const Job& job : jobs_)
      if (job.kind != Job::Kind::kCheck) counts.copied_bytes += job.bytes;
    if (plan_.pages() == nullptr) return counts;
    counts.pages = plan_.pages()->size();
    for (uint64_t i = 0; i < counts.pages; ++i) {
      const format::PageRecord& record = plan_.pages()->record(i);
      counts.stored_bytes += record.stored_bytes;
      if (record.codec != format::PageCodec::kRaw) counts.unpacked_bytes += record.raw_bytes;
    }
    return counts;
  }

  const UploadPlan& plan_;
  const MappedFile& map_;
  UploadTarget& target_;
  StagingSizes sizes_;
  bool is_mapped_;  // raw pages are copied directly from the map
  JobProgress* progress_;
  std::vector<Job> jobs_;
  SlotRing ring_;
  bool joins_;  // the device joins split pages
  std::atomic<uint64_t> joined_pages_{0};
  std::mutex large_mutex_;
  std::optional<DirectFile> direct_;
  std::atomic<bool> is_direct_{false};
  std::atomic<uint64_t> direct_bytes_{0};
  std::mutex bounce_mutex_;
  std::vector<DirectMemory> bounce_;
};

}  // namespace

Result<void> UploadTarget::join(uint32_t, uint64_t, std::span<const kernels::JoinTask>) {
  return Error{ErrorCode::kUnsupported, "the device does not join split pages"};
}

bool UploadTarget::has_joined(uint32_t) {
  return false;
}

uint64_t UploadPlan::add(const void* from, uint64_t bytes) {
  const uint64_t offset = bytes_;
  if (bytes != 0) pieces_.push_back({static_cast<const std::byte*>(from), bytes, offset});
  bytes_ = format::align_up(bytes_ + bytes, kPieceAlignment);
  return offset;
}

void UploadPlan::add_pages(const DrawnPages& pages) {
  assert(pages_ == nullptr);
  pages_ = &pages;
  bytes_ = format::align_up(bytes_, format::kPageAlignment);
  for (uint64_t i = 0; i < pages.size(); ++i) {
    page_offsets_.push_back(bytes_);
    bytes_ += page_room(pages, i);
  }
}

Reading choose_reading(const UploadPlan& plan, const MappedFile& map, Reading wanted, uint64_t least_bytes) {
  if (wanted != Reading::kAuto) return wanted;
  uint64_t bytes = 0;
  for (uint64_t i = 0; plan.pages() != nullptr && i < plan.pages()->size(); ++i)
    bytes += plan.pages()->record(i).stored_bytes;
  return bytes >= least_bytes && map.cached_share() < 0.5 ? Reading::kDirect : Reading::kBuffered;
}

bool has_split_pages(const UploadPlan& plan) {
  for (uint64_t i = 0; plan.pages() != nullptr && i < plan.pages()->size(); ++i)
    if (plan.pages()->record(i).codec == format::PageCodec::kSplit) return true;
  return false;
}

StagingSizes staging_for(const UploadPlan& plan, Reading reading, uint32_t threads, const StagingSizes& most,
                         bool joins) {
  const bool is_direct = reading == Reading::kDirect;
  StagingSizes sizes = most;
  if (!is_direct) {
    sizes.slot_bytes = std::min(most.slot_bytes, kCachedSlotBytes);
    // A page larger than a slot is read twice.
    for (uint64_t i = 0; plan.pages() != nullptr && i < plan.pages()->size(); ++i)
      if (const uint64_t room = page_room(*plan.pages(), i); room <= most.slot_bytes)
        sizes.slot_bytes = std::max(sizes.slot_bytes, room);
  }
  sizes.joins = joins;
  if (joins && !is_direct) sizes.slot_bytes = std::min(format::kMaxSplitRatio * sizes.slot_bytes, most.slot_bytes);
  const uint64_t jobs = jobs_of(plan, sizes.job_bytes()).size();
  const uint32_t workers = std::max(threads, is_direct ? kDirectThreads : 1u);
  // Two slots per thread: one is filled while the other is copied. A join takes milliseconds, so joins get more slots.
  const uint64_t slots = (joins ? 8 : 2) * uint64_t{workers};
  const uint64_t limit = joins ? std::max<uint64_t>(most.bytes() / sizes.slot_bytes, 1) : most.slots;
  sizes.slots = static_cast<uint32_t>(std::clamp<uint64_t>(std::min(jobs, slots), 1, limit));
  return sizes;
}

Result<UploadCounts> run_upload(const UploadPlan& plan, const MappedFile& map, UploadTarget& target,
                                const StagingSizes& sizes, Reading reading, uint32_t threads,
                                JobProgress* progress) try {
  Uploader uploader(plan, map, target, sizes, reading == Reading::kMapped, progress);
  if (reading == Reading::kDirect) SCREE_TRY(uploader.open_direct());
  return uploader.run(threads);
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left for its pages"};
}

}  // namespace scree::runtime
