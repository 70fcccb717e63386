// Pages of block images and JPEGs in a GPU's memory, and in pinned host memory, where the GPU can sample them too. Only
// in programs that are built with CUDA.
#pragma once

#include <cuda_runtime_api.h>

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "format/bytes.h"
#include "kernels/cuda/common/check.h"
#include "runtime/scene/scene.h"
#include "runtime/stream/block_pool.h"
#include "runtime/textures/block_pager.h"

namespace scree::runtime {

/// Belongs to the device that was current when it was made. Pages are copied through pinned memory: some are read while
/// others are copied.
class DeviceBlockPager final : public BlockPager {
 public:
  static constexpr uint64_t kUnit = 4096;  // of the room

  /// Makes a pager for the pages of scene.block_pager(), which is not null. `threads`, `reading`: how it reads. `room`:
  /// its own device memory for pages; 0: use_room() gives it memory later. `host_memory`: as for pinned_bytes().
  /// `scene` outlives this. Errors kDevice. Throws std::bad_alloc.
  static Result<std::unique_ptr<DeviceBlockPager>> create(const Scene& scene, uint32_t threads, uint64_t host_memory,
                                                          Reading reading, uint64_t room);
  ~DeviceBlockPager();

  /// Makes the `bytes` of device memory before `end` the room for pages, between two pictures. `bytes`: a multiple of
  /// kUnit. `end`: a multiple of 16, the same in every call. Pages that lie in the room stay, others are dropped. Error
  /// kDevice. Throws std::bad_alloc.
  Result<void> use_room(std::byte* end, uint64_t bytes);

  /// Keeps pages of blocks in up to `bytes` of pinned host memory from now on. If all fit, they are read now. If not,
  /// pages come to it when the room is too small for the pages that a picture shows; pages that were shown longest ago
  /// are dropped for them. Pages are sampled there until they are copied to the room, between pictures. The memory is
  /// allocated as it is needed, and less is used if the system pins no more. To be called at most once. Errors of
  /// reading and checking pages; kMemory; kDevice.
  Result<void> keep_in_host_memory(uint64_t bytes);

  /// To be called before a picture: begins to copy pages that the last picture sampled in host memory to the room.
  /// Pages that the last pictures did not show make room for them. The pages that an earlier call began to copy are
  /// sampled in the room from now on, if they have arrived. Errors kDevice, kMemory.
  Result<void> settle();

  /// The room for SceneOptions::device_texture_memory and device_texture_limit, in bytes: not more than all pages take.
  static uint64_t usual_room(const Scene& scene);
  static uint64_t most_room(const Scene& scene);
  /// The room that pages get in addition to usual_room(), if a resident scene leaves `rest` bytes: half of them. The
  /// other half is for blended surfaces and for queues that grow.
  static uint64_t more_room(const Scene& scene, uint64_t rest);
  /// The device memory of create() beside the room, and its pinned memory beside pinned_bytes().
  static uint64_t table_bytes(const Scene& scene);
  /// The pinned memory that create() takes if an upload may take `host_memory` (0: no limit): an eighth of it, at most
  /// 32 MiB, at least two pages of blocks. Larger pages of JPEGs are copied through memory that is not pinned.
  static uint64_t pinned_bytes(uint64_t host_memory);
  /// The rest of `host_memory`, for keep_in_host_memory(); 0 if there is no limit.
  static uint64_t most_kept_bytes(const Scene& scene, uint64_t host_memory);

 private:
  using BlockPager::BlockPager;

  uint64_t rounded(uint64_t bytes) const override { return format::align_up(bytes, kUnit); }
  Result<std::span<const uint64_t>> wanted() override;
  bool take(uint64_t number) override;
  void give_back(uint64_t number) override { pool_.give_back(taken_[number]); }
  Result<void> load(std::span<const uint32_t> numbers) override;
  Result<void> load_part(std::span<const uint32_t> numbers, uint32_t half);
  Result<void> finish_copies();
  Result<void> begin_copies();
  Result<void> copy_sampled(std::span<const uint64_t> last);
  bool keep(std::span<const uint32_t> numbers, std::span<const uint64_t> wanted) override;
  Result<void> load_kept(std::span<const uint32_t> numbers) override;
  const uint8_t* kept_address(uint64_t number) const override;
  bool keep_next(uint32_t number);
  bool add_slab();
  void drop_kept(uint32_t number);
  std::byte* kept_memory(uint64_t number) const {
    const Slab& slab = *slabs_[kept_[number].slab];
    return slab.memory.data() + slab.pool.offset(kept_[number].block) * kUnit;
  }
  /// The part of the pinned memory that a page goes through.
  uint64_t slot_bytes(uint64_t number) const { return format::align_up(read_bytes(number), DirectFile::kAlignment); }

  /// The place of a page. The pool's offsets count from the end of the room, which stays where it is.
  std::byte* place(uint32_t number) const {
    return end_ - (pool_.offset(taken_[number]) + pool_.units(taken_[number])) * kUnit;
  }
  Result<void> copy_table();

  kernels::DeviceBuffer room_;  // its own, if any
  std::byte* end_ = nullptr;
  kernels::DeviceBuffer tables_;  // TexelPages::blocks, then wanted
  kernels::PinnedBuffer staging_;
  uint64_t half_ = 0;  // bytes of half of staging_
  kernels::DeviceStream stream_;
  kernels::DeviceEvent copied_[2];   // the copies from each half of staging_ are done
  BlockPool pool_;                   // of the room, in units of kUnit
  std::vector<uint32_t> taken_;      // by number: the block in pool_
  std::vector<uint8_t> was_loaded_;  // by number: the page has been in the room
  kernels::PinnedBuffer lists_;      // copies of TexelPages::blocks and wanted

  /// A piece of the pinned memory that keeps pages.
  struct Slab {
    kernels::PinnedBuffer memory;
    BlockPool pool;  // in units of kUnit
  };
  struct Kept {
    uint32_t slab = BlockPool::kNone;
    uint32_t block = BlockPool::kNone;
    bool is_filled = false;  // the page was read
  };
  uint64_t kept_limit_ = 0;
  uint64_t slab_bytes_ = 0;  // of all slabs but the last
  uint64_t allocated_bytes_ = 0;
  std::vector<std::unique_ptr<Slab>> slabs_;
  std::vector<Kept> kept_;            // by number
  std::vector<uint32_t> copying_;     // pages of the room whose copies may not be finished; sampled in host memory
  kernels::DeviceEvent arrived_;      // they are
  std::array<uint64_t, 32> ended_{};  // the last rounds of the last pictures
  size_t next_ended_ = 0;
  uint64_t settled_round_ = 0;  // the last of these
};

}  // namespace scree::runtime
