// Pages of block images and JPEGs that are read when pixels sample them (kernels/shade/texel_pager.h).
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "kernels/shade/texel_pager.h"
#include "runtime/files/direct_file.h"
#include "runtime/files/mapped_file.h"
#include "runtime/files/reading.h"
#include "runtime/textures/jpeg_image.h"
#include "runtime/threads/workers.h"

namespace scree::runtime {

/// Counts since the pager was made; bytes are unpacked.
struct PagerStats {
  uint64_t read_pages = 0;  // a page counts each time that it is read
  uint64_t read_bytes = 0;
  uint64_t stored_bytes = 0;  // of these pages, in the file
  uint64_t direct_pages = 0;  // of these pages, past the page cache

  PagerStats& operator+=(const PagerStats& other) {
    read_pages += other.read_pages;
    read_bytes += other.read_bytes;
    stored_bytes += other.stored_bytes;
    direct_pages += other.direct_pages;
    return *this;
  }
};

/// Decides which pages are in memory. A derived class owns that memory: the room, and perhaps other memory that keeps
/// pages outside it. A page outside the room is present if it can be sampled there.
class BlockPager : public kernels::TexelPager {
 public:
  /// As TexelPager::bring(). If room is needed, drops the pages that were wanted longest ago. Errors kMemory (the
  /// wanted pages exceed the room; no memory left), kFile, kDevice, and the errors of Container::load_page.
  Result<bool> bring(bool must) final;

  uint64_t size() const { return file_pages_.size(); }                  // in pages
  std::span<const uint32_t> file_pages() const { return file_pages_; }  // by number: which page of the file
  uint64_t all_bytes() const { return all_bytes_; }                     // of all pages
  /// Memory that a page takes: its raw bytes, and the heads of its JPEG levels.
  uint64_t page_bytes(uint64_t number) const;
  uint64_t resident_bytes() const { return resident_bytes_; }  // in the room, rounded up
  uint64_t room_bytes() const { return room_bytes_; }
  uint64_t kept_bytes() const { return kept_bytes_; }      // of pages in memory outside the room, rounded up
  uint64_t copied_bytes() const { return copied_bytes_; }  // so far from there to the room, between pictures
  /// Bytes of the pages, rounded up, that were wanted in round `first` or later. Error kDevice.
  Result<uint64_t> wanted_bytes(uint64_t first);
  /// Bytes of the pages of a single pixel that the last bring() refused; 0 if it refused none.
  uint64_t refused_bytes() const { return refused_bytes_; }
  const PagerStats& stats() const { return stats_; }

 protected:
  /// `map`: of the file that `container` was opened on; must outlive this. `room_bytes`: the most that pages take.
  /// Reads on `threads` threads, but on at least kDirectThreads while pages are read past the page cache.
  BlockPager(const MappedFile& map, format::Container container, uint64_t room_bytes, uint32_t threads, Reading reading)
      : map_(map), container_(std::move(container)), room_bytes_(room_bytes), threads_(threads), reading_(reading) {}

  /// `jpeg`: the levels in the page; their count is 0 if it has rows of blocks.
  void add(uint32_t file_page, const JpegLevels& jpeg);
  /// Adds all pages of another pager.
  void add_all_of(const BlockPager& other);

  const format::PageRecord& record(uint64_t number) const { return container_.pages()[file_pages_[number]]; }
  /// Memory that reading a page fills: at least page_bytes(); a raw page has its padding.
  uint64_t read_bytes(uint64_t number) const;
  /// Reads pages on all threads, many at a time, so that the disk is busy. A page that is read for the first time is
  /// read past the page cache, if `reading` allows it. A page that is read again is read through the page cache,
  /// because it was dropped for lack of room and may be dropped again. The i-th page is read to `to(i)`, which may
  /// throw std::bad_alloc. `was_read(i)` is called afterwards on the same thread. Returns the error of the first page
  /// that failed.
  struct Target {
    std::byte* memory;         // aligned to DirectFile::kAlignment
    const std::byte* address;  // where the page will lie when it is sampled
  };
  Result<void> read_all(std::span<const uint32_t> numbers, const std::function<Target(uint64_t i)>& to,
                        const std::function<void(uint64_t i)>& was_read);

  static Error no_memory();  // kMemory
  void set_room_bytes(uint64_t bytes) { room_bytes_ = bytes; }
  /// Drops the pages of the room for which `is_dropped(number)` returns true.
  void drop_if(const std::function<bool(uint32_t number)>& is_dropped);
  bool is_in_room(uint64_t number) const { return in_room_[number] != 0; }
  bool has_jpeg(uint64_t number) const { return jpegs_[number].count != 0; }
  /// The pages of the room that no round from `first` on wanted, the one wanted longest ago first.
  std::vector<uint32_t> unwanted_since(uint64_t first, std::span<const uint64_t> wanted) const;
  /// Takes memory in the room. Returns false if it has none.
  bool take_next(uint64_t number);
  /// Removes a page from the room.
  void drop(uint64_t number);

  /// The bytes of the room that a page of `bytes` takes.
  virtual uint64_t rounded(uint64_t bytes) const { return bytes; }
  /// By number: TexelPages::wanted, in host memory.
  virtual Result<std::span<const uint64_t>> wanted() = 0;
  /// Takes memory for a page. Returns false if the free room lies in pieces that are too small; never if the room is
  /// empty.
  virtual bool take(uint64_t number) = 0;
  virtual void give_back(uint64_t number) = 0;
  /// Reads pages for which memory is taken: some in any case, the rest unless is_over(). Sets blocks_ for the pages
  /// that were read. Then copies blocks_ to the memory from which shading reads it.
  virtual Result<void> load(std::span<const uint32_t> numbers) = 0;
  /// Takes memory outside the room for pages without JPEG levels, from which they will be sampled, all or none. Pages
  /// of the current round stay where they are. Returns false if there is too little.
  virtual bool keep(std::span<const uint32_t> numbers, std::span<const uint64_t> wanted) {
    (void)numbers, (void)wanted;
    return false;
  }
  /// As load(), for pages for which keep() took memory. Gives back the memory of those that were not read.
  virtual Result<void> load_kept(std::span<const uint32_t> numbers) {
    (void)numbers;
    return {};
  }
  /// The address of a page outside the room; null if it is not kept there.
  virtual const uint8_t* kept_address(uint64_t number) const {
    (void)number;
    return nullptr;
  }

  uint32_t threads() const { return threads_; }

  uint64_t kept_bytes_ = 0;
  uint64_t copied_bytes_ = 0;
  std::vector<const uint8_t*> blocks_;  // by number, a page's address for shading; null if the page is absent

 private:
  Result<uint64_t> missing_since(uint64_t first) final;
  uint64_t bytes_of(uint64_t number) const { return rounded(page_bytes(number)); }
  bool take_all(std::span<const uint32_t> numbers, std::span<const uint64_t> wanted);
  std::vector<uint32_t> split_missing(std::vector<uint32_t>& missing, uint64_t left) const;
  void count_read(uint64_t number);
  Result<void> open_direct();
  Result<void> read(uint64_t number, const Target& to);
  Result<void> read_stored(uint64_t number, std::span<std::byte> padded);

  const MappedFile& map_;
  format::Container container_;
  uint64_t room_bytes_;
  uint32_t threads_;
  std::optional<Workers> workers_;    // once a page was read
  Reading reading_;                   // not kAuto once a page was read
  std::optional<DirectFile> direct_;  // once a page was read, if it is used
  std::atomic<bool> is_direct_{false};
  std::atomic<uint64_t> direct_pages_{0};
  std::vector<uint8_t> was_read_;  // by number
  std::vector<uint32_t> file_pages_;
  std::vector<JpegLevels> jpegs_;  // by number
  std::vector<uint8_t> in_room_;   // by number
  uint64_t all_bytes_ = 0;
  uint64_t resident_bytes_ = 0;
  uint64_t refused_bytes_ = 0;
  PagerStats stats_;
};

/// The pager for pictures that the CPU shades.
class HostBlockPager final : public BlockPager {
 public:
  /// As BlockPager.
  HostBlockPager(const MappedFile& map, format::Container container, uint64_t room_bytes, uint32_t threads,
                 Reading reading)
      : BlockPager(map, std::move(container), room_bytes, threads, reading) {}

  /// Adds a page of the file that holds rows of blocks, or JPEG levels. It gets the next number. Throws std::bad_alloc.
  void add(uint32_t file_page, const JpegLevels& jpeg = {});

 private:
  Result<std::span<const uint64_t>> wanted() override { return std::span<const uint64_t>(wanted_); }
  bool take(uint64_t) override { return true; }
  void give_back(uint64_t number) override { raw_[number].reset(); }
  Result<void> load(std::span<const uint32_t> numbers) override;
  Result<void> load_part(std::span<const uint32_t> numbers);

  std::vector<uint64_t> wanted_;
  std::vector<DirectMemory> raw_;
};

}  // namespace scree::runtime
