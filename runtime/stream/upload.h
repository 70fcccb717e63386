// Uploads a scene's bytes to a device: pages are read, checked and unpacked on all cores while earlier pages are
// copied. Independent of CUDA; runtime/draw/cuda_upload.h has the device.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/result.h"
#include "runtime/files/mapped_file.h"
#include "runtime/files/reading.h"
#include "runtime/scene/pages.h"
#include "runtime/stream/join_target.h"
#include "runtime/threads/job_progress.h"

namespace scree::runtime {

/// The ring of staging memory: `slots` times `slot_bytes` (a multiple of format::kPageAlignment). An upload also takes
/// host memory for one unpacked page larger than a slot, for zstd's contexts, for a split page per thread
/// (Container::load_page), and for a slot's bytes per thread if compressed pages are read past the page cache.
struct StagingSizes {
  uint64_t slot_bytes = uint64_t{4} << 20;
  uint32_t slots = 32;
  uint64_t join_jobs = 0;  // by staging_for(): how many slots' worth of data have split pages

  uint64_t bytes() const { return slot_bytes * slots; }
  /// Bytes of a JoinTarget's slots. The split pages that make a slot's bytes rarely take more.
  uint64_t join_slot_bytes() const { return slot_bytes + slot_bytes / 4; }
};

/// Staging memory and a device that copies out of it. Called by several threads at once, each with a different slot.
class UploadTarget {
 public:
  /// The memory of a slot, aligned to format::kPageAlignment. Must be written only while no copy from it is running.
  virtual std::byte* slot(uint32_t slot) = 0;
  /// Starts copying the slot's first `bytes` to offset `to` of the device's arena. Errors kDevice.
  virtual Result<void> copy(uint32_t slot, uint64_t to, uint64_t bytes) = 0;
  /// Waits until the last copy out of the slot is done. Errors kDevice.
  virtual Result<void> wait(uint32_t slot) = 0;

  /// Joins split pages to the arena, in slots of its own; null: the device joins none.
  virtual JoinTarget* joins() { return nullptr; }
  /// Waits for all joins, also after an error. Returns whether the device found all of them good. Errors kDevice.
  virtual Result<bool> finish_joins() { return true; }

 protected:
  ~UploadTarget() = default;
};

/// The layout of the arena. Its size is known before the first byte is read.
class UploadPlan {
 public:
  /// Adds host memory, which must stay unchanged until it is uploaded. Returns its offset in the arena, a multiple of
  /// 256.
  uint64_t add(const void* from, uint64_t bytes);
  template <class T>
  uint64_t add_array(const T* from, uint64_t count) {
    return add(from, count * sizeof(T));
  }

  /// Adds pages, at most once; they must outlive the plan. Each lies on a multiple of format::kPageAlignment, as in the
  /// file, so that consecutive raw pages are contiguous in both.
  void add_pages(const DrawnPages& pages);

  uint64_t bytes() const { return bytes_; }
  const DrawnPages* pages() const { return pages_; }
  /// Offset in the arena. `index`: in pages().
  uint64_t page_offset(uint64_t index) const { return page_offsets_[index]; }

  struct Piece {
    const std::byte* from;
    uint64_t bytes;
    uint64_t offset;
  };
  const std::vector<Piece>& pieces() const { return pieces_; }

 private:
  std::vector<Piece> pieces_;
  const DrawnPages* pages_ = nullptr;
  std::vector<uint64_t> page_offsets_;
  uint64_t bytes_ = 0;
};

/// Resolves kAuto for these pages. `least_bytes`: bytes of pages from which on kDirect is chosen.
Reading choose_reading(const UploadPlan& plan, const MappedFile& map, Reading wanted,
                       uint64_t least_bytes = kDirectBytes);

/// Bytes of a slot for pages that are read through the page cache. A page is then still in a core's cache when it is
/// checked, and all slots are in the shared cache when they are copied. If a page is larger (because of a chunk of more
/// than 1 MiB), so are the slots.
inline constexpr uint64_t kCachedSlotBytes = uint64_t{1} << 20;

/// Staging memory that `plan` can use, at most `most`. `reading`: not kAuto. `joins`: split pages lie in other memory.
StagingSizes staging_for(const UploadPlan& plan, Reading reading, uint32_t threads, const StagingSizes& most = {},
                         bool joins = false);

/// The threads of an upload. With kDirect they wait for the disk, so at least kDirectThreads are used.
inline uint32_t threads_for(Reading reading, uint32_t threads) {
  return std::max(threads, reading == Reading::kDirect ? kDirectThreads : 1u);
}

struct UploadCounts {
  uint64_t pages = 0;
  uint64_t stored_bytes = 0;    // of the pages, in the file
  uint64_t unpacked_bytes = 0;  // of the compressed pages
  uint64_t copied_bytes = 0;    // to the device
  uint64_t direct_bytes = 0;    // read past the page cache
  uint64_t joined_pages = 0;    // by the device
};

struct UploadStats {
  UploadCounts counts;
  uint64_t device_bytes = 0;
  double upload_ms = 0;  // from its beginning, with device memory allocated, to the end of the last copy

  /// Bytes to the device, in 1e9 bytes per second.
  double gb_per_s() const { return upload_ms > 0 ? static_cast<double>(counts.copied_bytes) * 1e-6 / upload_ms : 0; }
};

/// Uploads `plan` on up to threads_for() threads and returns when all of it lies on the device. `reading`: not kAuto. A
/// page is checked in its slot before it is copied (checksum, padding, frame, the streams of its drawn chunks). Only a
/// raw page larger than a slot is checked in the map. A split page is joined and its clusters are checked by the
/// device, if it can; if the device refuses any, all split pages are unpacked and checked here after all. Used pages
/// are dropped from the map's resident memory. `map`: the file that the pages' container was opened on. Errors: as
/// load_pages, and kFile; the error of the first bad page, for any number of threads; kDevice. `progress`: receives the
/// bytes of the arena, and may stop the upload (kFile).
Result<UploadCounts> run_upload(const UploadPlan& plan, const MappedFile& map, UploadTarget& target,
                                const StagingSizes& sizes, Reading reading, uint32_t threads,
                                JobProgress* progress = nullptr);

}  // namespace scree::runtime
