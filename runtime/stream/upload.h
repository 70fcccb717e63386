// Bringing a scene's bytes to a device: pages are read, checked and unpacked on all cores while those before them are
// copied. Knows no CUDA; runtime/draw/cuda_upload.h is the device.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "format/result.h"
#include "runtime/files/mapped_file.h"
#include "runtime/scene/pages.h"
#include "runtime/threads/job_progress.h"

namespace scree::runtime {

/// The ring of staging memory: `slots` times `slot_bytes` (a multiple of format::kPageAlignment). That, one unpacked
/// page larger than a slot, zstd's contexts, for each thread what a split page takes (Container::load_page), and a
/// slot's bytes a thread where compressed pages are read past the page cache are all the host memory that an upload
/// takes.
struct StagingSizes {
  uint64_t slot_bytes = uint64_t{4} << 20;
  uint32_t slots = 32;

  uint64_t bytes() const { return slot_bytes * slots; }
};

/// Staging memory and a device that copies out of it. Called by several threads at once, each with another slot.
class UploadTarget {
 public:
  /// The memory of a slot, aligned to format::kPageAlignment. Written only while no copy out of it is under way.
  virtual std::byte* slot(uint32_t slot) = 0;
  /// Starts copying the slot's first `bytes` to byte `to` of the device's arena. Errors kDevice.
  virtual Result<void> copy(uint32_t slot, uint64_t to, uint64_t bytes) = 0;
  /// Returns when the last copy out of the slot is done. Errors kDevice.
  virtual Result<void> wait(uint32_t slot) = 0;

 protected:
  ~UploadTarget() = default;
};

/// What goes where in the arena: its size is known before the first byte is read.
class UploadPlan {
 public:
  /// Host memory, which stays as it is until it is uploaded. Returns its place in the arena, a multiple of 256.
  uint64_t add(const void* from, uint64_t bytes);
  template <class T>
  uint64_t add_array(const T* from, uint64_t count) {
    return add(from, count * sizeof(T));
  }

  /// Pages, which outlive the plan; once. Each lies on a multiple of format::kPageAlignment, as in the file, so that
  /// raw pages in a row are one run of bytes in both.
  void add_pages(const DrawnPages& pages);

  uint64_t bytes() const { return bytes_; }
  const DrawnPages* pages() const { return pages_; }
  /// By index in pages().
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

/// How pages come from the file.
enum class Reading {
  kAuto,      // kDirect for kDirectBytes of pages or more, most of which are not in the page cache; else kBuffered
  kMapped,    // out of the map, through the page cache
  kBuffered,  // by read() through the page cache, straight into the slots; compressed pages, and one larger than a
              // slot, as kMapped
  kDirect,    // past the page cache, straight into the slots; a page larger than a slot as kMapped, and all of a file
              // system that has no such reads as kBuffered
};
inline constexpr uint64_t kDirectBytes = uint64_t{256} << 20;

/// What kAuto is for these pages; `least_bytes`: of them, for kDirect.
Reading choose_reading(const UploadPlan& plan, const MappedFile& map, Reading wanted,
                       uint64_t least_bytes = kDirectBytes);

/// Of a slot's bytes what pages that go through the page cache take: a page is then still in a core's cache when it is
/// checked, and all slots in that of all cores when they are copied from. More where a page takes more, which is then
/// of a chunk larger than 1 MiB.
inline constexpr uint64_t kCachedSlotBytes = uint64_t{1} << 20;

/// How much staging memory `plan` can use: no more than `most`. `reading`: not kAuto.
StagingSizes staging_for(const UploadPlan& plan, Reading reading, uint32_t threads, const StagingSizes& most = {});

struct UploadCounts {
  uint64_t pages = 0;
  uint64_t stored_bytes = 0;    // of the pages, in the file
  uint64_t unpacked_bytes = 0;  // of those that were compressed
  uint64_t copied_bytes = 0;    // to the device
  uint64_t direct_bytes = 0;    // read past the page cache
};

inline constexpr uint32_t kDirectThreads = 8;

struct UploadStats {
  UploadCounts counts;
  uint64_t device_bytes = 0;
  double upload_ms = 0;  // from its beginning, device memory allocated, to the last copy's end

  /// Bytes to the device, 1e9 a second.
  double gb_per_s() const { return upload_ms > 0 ? static_cast<double>(counts.copied_bytes) * 1e-6 / upload_ms : 0; }
};

/// Uploads `plan` on up to `threads` threads (with kDirect, where threads wait for the disk, on kDirectThreads at
/// least) and returns when all of it lies on the device. `reading`: not kAuto. A page is checked (checksum, padding,
/// frame, the streams of its drawn chunks) before it is copied, where it is copied from: in the slot. Only a raw page
/// larger than a slot is checked in the map. Pages leave the map's resident part as they go. `map`: what the pages'
/// container was opened on. Errors as load_pages and kFile, that of the first bad page whatever the number of threads;
/// kDevice. `progress`: hears of bytes of the arena, and may stop the upload (kFile).
Result<UploadCounts> run_upload(const UploadPlan& plan, const MappedFile& map, UploadTarget& target,
                                const StagingSizes& sizes, Reading reading, uint32_t threads,
                                JobProgress* progress = nullptr);

}  // namespace scree::runtime
