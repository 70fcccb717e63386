// Pages of block images that come from the file as pixels sample them (kernels/shade/texel_pager.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "kernels/shade/texel_pager.h"
#include "runtime/files/mapped_file.h"

namespace scree::runtime {

/// Counts since the pager was made; bytes are unpacked.
struct PagerStats {
  uint64_t read_pages = 0;  // a page counts each time that it is read
  uint64_t read_bytes = 0;
  uint64_t stored_bytes = 0;  // of these pages, in the file
};

class BlockPager final : public kernels::TexelPager {
 public:
  /// `map`: of the file that `container` was opened on; must outlive this. `budget_bytes`: the most that pages take.
  /// Reads on `threads` threads.
  BlockPager(const MappedFile& map, format::Container container, uint64_t budget_bytes, uint32_t threads)
      : map_(map), container_(std::move(container)), budget_bytes_(budget_bytes), threads_(threads) {}

  /// Adds a page of the file that holds rows of blocks. It gets the next number. Throws std::bad_alloc.
  void add(uint32_t page);

  void begin_round() override;
  /// Drops the pages that were wanted longest ago, if room is needed. Errors kMemory (they exceed the budget; no memory
  /// left), kFile, those of Container::load_page.
  Result<bool> bring(bool must) override;

  uint64_t size() const { return slots_.size(); }    // in pages
  uint64_t all_bytes() const { return all_bytes_; }  // of all pages
  uint64_t resident_bytes() const { return resident_bytes_; }
  const PagerStats& stats() const { return stats_; }

 private:
  struct Slot {
    uint32_t page;
    uint64_t round = 0;  // the last one that wanted it
    std::unique_ptr<std::byte[]> raw;
  };

  uint64_t raw_bytes(uint64_t number) const { return container_.pages()[slots_[number].page].raw_bytes; }
  void make_room(uint64_t bytes);
  Result<void> read(const std::vector<uint32_t>& missing);
  Result<std::unique_ptr<std::byte[]>> read(uint32_t page) const;

  const MappedFile& map_;
  format::Container container_;
  uint64_t budget_bytes_;
  uint32_t threads_;
  std::vector<Slot> slots_;
  uint64_t round_ = 0;
  uint64_t all_bytes_ = 0;
  uint64_t resident_bytes_ = 0;
  PagerStats stats_;
};

}  // namespace scree::runtime
