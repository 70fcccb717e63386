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

/// Free slots, then slots with copies under way in the order of their start. A thread holds at most one slot, so as
/// many slots as threads are always enough.
class SlotRing {
 public:
  SlotRing(UploadTarget& target, uint32_t slots) : target_(target) {
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
    if (Result<void> done = target_.wait(slot); !done) {
      give_back(slot);
      return done.error();
    }
    return slot;
  }

  /// Gives back a slot with no copy under way.
  void give_back(uint32_t slot) {
    const std::lock_guard<std::mutex> lock(mutex_);
    free_.push_back(slot);
  }

  /// Starts a copy out of a taken slot.
  Result<void> copy(uint32_t slot, uint64_t to, uint64_t bytes) {
    Result<void> started = target_.copy(slot, to, bytes);
    if (!started) {
      give_back(slot);
      return started;
    }
    const std::lock_guard<std::mutex> lock(mutex_);
    copying_.push_back(slot);
    return {};
  }

  /// Waits for all copies, also after an error, because the slots' memory is about to be freed.
  Result<void> drain() {
    Result<void> result;
    for (const uint32_t slot : copying_)
      if (Result<void> done = target_.wait(slot); !done && result) result = done;
    copying_.clear();
    return result;
  }

 private:
  UploadTarget& target_;
  std::mutex mutex_;
  std::deque<uint32_t> free_;
  std::deque<uint32_t> copying_;
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
        jobs_(jobs_of(plan, sizes.slot_bytes)),
        ring_(target, sizes.slots) {
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
    const Result<void> drained = ring_.drain();
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

  Result<void> run(const Job& job) {
    switch (job.kind) {
      case Job::Kind::kMemory:
        return copy_memory(job.from, job.bytes, job.offset);
      case Job::Kind::kPages:
        return copy_pages(job);
      case Job::Kind::kCheck:
        return check_large(job);
      case Job::Kind::kLargeZstd:
        break;
    }
    return copy_large_zstd(job);
  }

  /// `bytes`: at most a slot.
  Result<void> copy_memory(const std::byte* from, uint64_t bytes, uint64_t offset) {
    const Result<uint32_t> slot = ring_.take();
    if (!slot) return slot.error();
    std::memcpy(target_.slot(*slot), from, bytes);
    return ring_.copy(*slot, offset, bytes);
  }

  Result<void> copy_pages(const Job& job) {
    const Result<uint32_t> slot = ring_.take();
    if (!slot) return slot.error();
    std::byte* const memory = target_.slot(*slot);
    Result<void> done;
    if (is_direct_) done = read_pages(job, memory);
    // If the memory or the file system does not support direct reads, they are not tried again.
    if (!done && done.error().code == ErrorCode::kUnsupported) is_direct_ = false;
    if (!is_direct_) done = take_pages(job, memory);
    if (!done) {
      ring_.give_back(*slot);
      return done;
    }
    return ring_.copy(*slot, job.offset, job.bytes);
  }

  /// Reads the pages of a job into a slot, through the page cache.
  Result<void> take_pages(const Job& job, std::byte* slot) {
    const DrawnPages& pages = *plan_.pages();
    for (uint64_t i = job.first; i < job.last; ++i) {
      std::span<const std::byte> padded = pages.container().padded_page(pages.page(i));
      std::byte* const to = slot + plan_.page_offset(i) - job.offset;
      const bool is_raw = pages.record(i).codec == format::PageCodec::kRaw;
      if (is_raw && !padded.empty()) {
        if (is_mapped_)
          std::memcpy(to, padded.data(), padded.size());
        else if (Result<void> read = map_.read(pages.record(i).offset, {to, padded.size()}); !read)
          return read;
        padded = {to, padded.size()};
      }
      if (Result<void> done = finish_page(i, padded, to); !done) return done;
      if (is_mapped_ || !is_raw) map_.release(pages.record(i).offset, pages.record(i).stored_bytes);
    }
    return {};
  }

  /// Reads the pages of a job into a slot, past the page cache. Raw pages that are adjacent in the file are adjacent in
  /// the slot.
  Result<void> read_pages(const Job& job, std::byte* slot) {
    const DrawnPages& pages = *plan_.pages();
    for (uint64_t i = job.first; i < job.last;) {
      const bool is_raw = pages.record(i).codec == format::PageCodec::kRaw;
      uint64_t last = i + 1;
      while (last < job.last && pages.page(last) == pages.page(last - 1) + 1 &&
             (pages.record(last).codec == format::PageCodec::kRaw) == is_raw)
        ++last;
      const uint64_t begin = pages.record(i).offset;
      const uint64_t end = pages.record(last - 1).offset + pages.record(last - 1).stored_bytes;
      const uint64_t bytes = format::align_up(end - begin, DirectFile::kAlignment);
      // Compressed pages are smaller than unpacked ones, so all pages of a job fit a buffer of a slot's size.
      BounceBuffer bounce(is_raw ? nullptr : this);
      std::byte* const to = is_raw ? slot + plan_.page_offset(i) - job.offset : bounce.data();
      if (Result<void> done = direct_->read(begin, {to, bytes}); !done) return done;
      direct_bytes_ += bytes;
      for (; i < last; ++i) {
        const std::span<const std::byte> padded(to + (pages.record(i).offset - begin),
                                                pages.container().padded_page(pages.page(i)).size());
        if (Result<void> done = finish_page(i, padded, slot + plan_.page_offset(i) - job.offset); !done) return done;
      }
    }
    return {};
  }

  /// Checks a page, and unpacks it to `raw` if it is compressed. A raw page already lies in `raw`.
  Result<void> finish_page(uint64_t index, std::span<const std::byte> padded, std::byte* raw) {
    const DrawnPages& pages = *plan_.pages();
    const format::PageRecord& record = pages.record(index);
    const uint32_t page = pages.page(index);
    if (Result<void> checked = pages.container().check_page(page, padded); !checked) return checked;
    const std::span<std::byte> room(raw, record.raw_bytes);
    if (record.codec != format::PageCodec::kRaw) {
      const auto stored = padded.first(record.stored_bytes);
      if (Result<void> done = pages.container().unpack_page(page, stored, room); !done) return done;
    }
    return pages.check(index, room);
  }

  Result<void> check_large(const Job& job) {
    const DrawnPages& pages = *plan_.pages();
    const format::Container& container = pages.container();
    const uint32_t page = pages.page(job.first);
    if (Result<void> checked = container.check_page(page, container.padded_page(page)); !checked) return checked;
    return pages.check(job.first, container.stored_page(page));
  }

  /// Unpacks a large page to separate memory, one page at a time, and copies it from there.
  Result<void> copy_large_zstd(const Job& job) {
    const std::lock_guard<std::mutex> lock(large_mutex_);
    std::vector<std::byte> scratch;
    const uint32_t page = plan_.pages()->page(job.first);
    const Result<std::span<const std::byte>> raw = plan_.pages()->container().load_page(page, scratch);
    if (!raw) return raw.error();
    if (Result<void> checked = plan_.pages()->check(job.first, *raw); !checked) return checked;
    for (uint64_t done = 0; done < raw->size(); done += sizes_.slot_bytes) {
      const uint64_t bytes = std::min(sizes_.slot_bytes, raw->size() - done);
      if (Result<void> copied = copy_memory(raw->data() + done, bytes, job.offset + done); !copied) return copied;
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
  std::mutex large_mutex_;
  std::optional<DirectFile> direct_;
  std::atomic<bool> is_direct_{false};
  std::atomic<uint64_t> direct_bytes_{0};
  std::mutex bounce_mutex_;
  std::vector<DirectMemory> bounce_;
};

}  // namespace

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

StagingSizes staging_for(const UploadPlan& plan, Reading reading, uint32_t threads, const StagingSizes& most) {
  const bool is_direct = reading == Reading::kDirect;
  StagingSizes sizes = most;
  if (!is_direct) {
    sizes.slot_bytes = std::min(most.slot_bytes, kCachedSlotBytes);
    // A page larger than a slot is read twice.
    for (uint64_t i = 0; plan.pages() != nullptr && i < plan.pages()->size(); ++i)
      if (const uint64_t room = page_room(*plan.pages(), i); room <= most.slot_bytes)
        sizes.slot_bytes = std::max(sizes.slot_bytes, room);
  }
  const uint64_t jobs = jobs_of(plan, sizes.slot_bytes).size();
  const uint32_t workers = std::max(threads, is_direct ? kDirectThreads : 1u);
  // Two slots per thread: one is filled while the other is copied.
  sizes.slots = static_cast<uint32_t>(std::clamp<uint64_t>(std::min(jobs, 2 * uint64_t{workers}), 1, most.slots));
  return sizes;
}

Result<UploadCounts> run_upload(const UploadPlan& plan, const MappedFile& map, UploadTarget& target,
                                const StagingSizes& sizes, Reading reading, uint32_t threads, JobProgress* progress) {
  try {
    Uploader uploader(plan, map, target, sizes, reading == Reading::kMapped, progress);
    if (reading == Reading::kDirect)
      if (Result<void> opened = uploader.open_direct(); !opened) return opened.error();
    return uploader.run(threads);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "no memory left for its pages"};
  }
}

}  // namespace scree::runtime
