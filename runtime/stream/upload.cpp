#include "runtime/stream/upload.h"

#include <algorithm>
#include <atomic>
#include <cassert>
#include <cstring>
#include <mutex>
#include <new>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "format/bytes.h"
#include "runtime/files/direct_file.h"
#include "runtime/stream/join_plan.h"
#include "runtime/stream/slot_queue.h"
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

/// Whether a job has split pages that lie in a slot.
bool is_join(const UploadPlan& plan, const Job& job) {
  if (job.kind != Job::Kind::kPages) return false;
  for (uint64_t i = job.first; i < job.last; ++i)
    if (plan.pages()->record(i).codec == format::PageCodec::kSplit) return true;
  return false;
}

/// The slots of a target.
class SlotRing {
 public:
  SlotRing(UploadTarget& target, uint32_t slots) : target_(target) { queue_.open(slots); }

  /// A slot of which no copy is running. Gives it back, unless a copy was started.
  class Taken {
   public:
    Taken(SlotRing& ring, uint32_t slot) : ring_(&ring), slot_(slot) {}
    Taken(Taken&& other) noexcept : ring_(std::exchange(other.ring_, nullptr)), slot_(other.slot_) {}
    Taken& operator=(Taken&&) = delete;
    ~Taken() {
      if (ring_ != nullptr) ring_->queue_.give_back(slot_);
    }

    std::span<std::byte> memory(uint64_t bytes) const { return {ring_->target_.slot(slot_), bytes}; }
    /// Starts a copy.
    Result<void> copy(uint64_t to, uint64_t bytes) {
      SCREE_TRY(ring_->target_.copy(slot_, to, bytes));
      ring_->queue_.add_copying(slot_);
      ring_ = nullptr;
      return {};
    }

   private:
    SlotRing* ring_;
    uint32_t slot_;
  };

  /// Waits until there is a slot.
  Result<Taken> take() {
    const SlotQueue::Taken next = queue_.take();
    Taken taken(*this, next.slot);
    if (next.is_copying) SCREE_TRY(target_.wait(next.slot));
    return Result<Taken>(std::move(taken));
  }

  /// Waits for all copies, also after an error, because the slots' memory is about to be freed.
  Result<void> drain() {
    Result<void> result;
    while (const std::optional<uint32_t> slot = queue_.take_copying()) {
      if (Result<void> done = target_.wait(*slot); !done && result) result = done;
      queue_.give_back(*slot);
    }
    return result;
  }

 private:
  UploadTarget& target_;
  SlotQueue queue_;
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
        ring_(target, sizes.slots),
        joins_(target.joins()) {}

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
    threads = threads_for(is_direct_ ? Reading::kDirect : Reading::kMapped, threads);
    for (uint64_t i = 0; i < std::min<uint64_t>(threads, jobs_.size()); ++i) ask_for(i);
    bounce_.reserve(threads);  // room for all buffers, so that giving one back allocates nothing
    if (progress_ != nullptr) progress_->begin("upload", job_bytes());
    FirstError failure;
    Result<void> done;
    try {
      done = run_all(threads, failure);
    } catch (...) {
      (void)drain();
      throw;
    }
    if (failure.any()) return failure.error();
    if (!done) return done.error();
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

  /// Does all jobs. If the device refuses a split page, the jobs with such pages are done again without its help, which
  /// gives the page's error.
  Result<void> run_all(uint32_t threads, FirstError& failure) {
    parallel_for(jobs_.size(), threads, [&](uint64_t i) {
      if (failure.is_superseded(i)) return;
      ask_for(i + threads);
      Result<void> done = run(jobs_[i]);
      if (done) done = JobProgress::advance(progress_, jobs_[i].bytes);
      if (!done) failure.report(i, done.error());
    });
    const bool is_good = SCREE_TRY(drain());
    if (is_good) return {};
    joins_ = nullptr;
    parallel_for(jobs_.size(), threads, [&](uint64_t i) {
      if (failure.is_superseded(i) || !is_join(plan_, jobs_[i])) return;
      Result<void> done = run(jobs_[i]);
      if (done) done = JobProgress::advance(progress_, 0);  // which may stop it
      if (!done) failure.report(i, done.error());
    });
    return ring_.drain();
  }

  /// Waits for all copies and joins. Returns whether the device has found all split pages good.
  Result<bool> drain() {
    const Result<void> copied = ring_.drain();
    Result<bool> joined = joins_ != nullptr ? target_.finish_joins() : true;
    if (!copied) return copied.error();
    return joined;
  }

  Result<void> run(const Job& job) {
    if (job.kind == Job::Kind::kMemory) return copy_memory(job.from, job.bytes, job.offset);
    if (job.kind == Job::Kind::kPages) return copy_pages(job);
    return job.kind == Job::Kind::kCheck ? check_large(job) : copy_large_zstd(job);
  }

  /// `bytes`: at most a slot.
  Result<void> copy_memory(const std::byte* from, uint64_t bytes, uint64_t offset) {
    SlotRing::Taken slot = SCREE_TRY(ring_.take());
    std::memcpy(slot.memory(bytes).data(), from, bytes);
    return slot.copy(offset, bytes);
  }

  /// The slot that the pages of a job are read into.
  struct SlotPages {
    const Job* job;
    std::span<std::byte> memory;  // at least the job's bytes
    bool joins = false;   // pages lie one after the other, and `plan` makes the job's bytes of them on the device
    JoinPlan plan{};      // if `joins`
    uint64_t end = 0;     // of the pages in the slot so far
    uint64_t joined = 0;  // pages
  };

  Result<void> copy_pages(const Job& job) {
    if (joins_ != nullptr && is_join(plan_, job)) {
      const bool is_joined = SCREE_TRY(join_pages(job));
      if (is_joined) return {};
    }
    SlotRing::Taken slot = SCREE_TRY(ring_.take());
    SlotPages pages{&job, slot.memory(sizes_.slot_bytes)};
    SCREE_TRY(fill(pages));
    return slot.copy(job.offset, job.bytes);
  }

  /// Leaves the job's split pages to the device. Returns false if they have to be joined here: the device lacks room,
  /// or there is an error. Then a page before the bad one may be bad too, which only the device would find.
  Result<bool> join_pages(const Job& job) {
    const JoinTarget::Slot slot = SCREE_TRY(joins_->take());
    Result<bool> taken = false;
    try {
      SlotPages pages{&job, slot.memory.first(sizes_.join_slot_bytes()), true};
      if (fill(pages)) taken = joins_->join(slot, pages.end, pages.plan);
      if (taken && *taken) joined_pages_ += pages.joined;
    } catch (...) {
      joins_->give_back(slot);
      throw;
    }
    if (!taken || !*taken) joins_->give_back(slot);
    return taken;
  }

  Result<void> fill(SlotPages& slot) {
    if (is_direct_) {
      const Result<void> done = read_pages(slot);
      if (done || done.error().code != ErrorCode::kUnsupported) return done;
      // If the memory or the file system does not support direct reads, no thread tries them again.
      is_direct_ = false;
      slot = {slot.job, slot.memory, slot.joins, {}};
    }
    return take_pages(slot);
  }

  /// The offset of the next page: a multiple of format::kPageAlignment.
  std::byte* place_of(const SlotPages& slot, uint64_t index) const {
    return slot.memory.data() + (slot.joins ? slot.end : plan_.page_offset(index) - slot.job->offset);
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
    return static_cast<uint32_t>(place - slot.memory.data());
  }

  /// Unpacks the frame of a split page to `to`. Returns whether the device can join it.
  Result<bool> leave_split(uint64_t index, std::span<const std::byte> stored, std::byte* to, SlotPages& slot) {
    const DrawnPages& pages = *plan_.pages();
    const format::Container& container = pages.container();
    const uint32_t page = pages.page(index);
    const uint64_t content = SCREE_TRY(container.content_bytes(page, stored));
    const uint64_t end = format::align_up(offset_in(slot, to) + content, format::kPageAlignment);
    const uint64_t behind = slot.job->offset + slot.job->bytes - plan_.page_offset(index) - page_room(pages, index);
    if (end + behind > slot.memory.size()) return false;  // the pages behind it need their room
    const std::span<std::byte> split(to, content);
    SCREE_TRY(container.unpack_content(page, stored, split));
    std::vector<JoinChunk> chunks;
    for (uint64_t i = 0; i < pages.chunk_count(index); ++i) {
      const format::ChunkRecord& chunk = container.chunks()[pages.chunk(index, i)];
      chunks.push_back({&container.meshes()[chunk.mesh], &chunk});
    }
    if (!slot.plan.add_split(split, pages.record(index).raw_bytes, chunks,
                             {offset_in(slot, to), plan_.page_offset(index)}))
      return false;
    slot.end = end;
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
  JoinTarget* joins_;  // null: no page is left split
  std::atomic<uint64_t> joined_pages_{0};
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
  if (joins && is_direct)
    sizes.slot_bytes = std::max(sizes.slot_bytes / 2 / format::kPageAlignment, uint64_t{1}) * format::kPageAlignment;
  const std::vector<Job> all = jobs_of(plan, sizes.slot_bytes);
  const auto is_join_job = [&](const Job& job) { return is_join(plan, job); };
  sizes.join_jobs = static_cast<uint64_t>(std::ranges::count_if(all, is_join_job));
  const uint64_t jobs = all.size() - (joins ? sizes.join_jobs : 0);
  // Two slots per thread: one is filled while the other is copied.
  const uint64_t slots = std::min<uint64_t>(jobs, 2 * uint64_t{threads_for(reading, threads)});
  sizes.slots = static_cast<uint32_t>(std::clamp<uint64_t>(slots, 1, most.slots));
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
