// Pages of block images and JPEGs in a GPU's memory. Only in programs that are built with CUDA.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <memory>
#include <vector>

#include "format/bytes.h"
#include "kernels/cuda/check.h"
#include "runtime/scene/scene.h"
#include "runtime/stream/block_pool.h"
#include "runtime/textures/block_pager.h"

namespace scree::runtime {

/// Belongs to the device that was current when it was made. Pages go through pinned memory: some are read while others
/// are copied.
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

  /// The room for SceneOptions::device_texture_memory and device_texture_limit, in bytes: not more than all pages take.
  static uint64_t usual_room(const Scene& scene);
  static uint64_t most_room(const Scene& scene);
  /// The room that pages get in addition to usual_room(), if a resident scene leaves `rest` bytes: half of them. The
  /// other half is for blended surfaces and for queues that grow.
  static uint64_t more_room(const Scene& scene, uint64_t rest);
  /// The device memory of create() beside the room.
  static uint64_t table_bytes(const Scene& scene);
  /// The pinned memory that create() takes if an upload may take `host_memory` (0: no limit): an eighth of it, at most
  /// 32 MiB, at least two pages of blocks. Larger pages of JPEGs go through memory that is not pinned.
  static uint64_t pinned_bytes(uint64_t host_memory);

 private:
  using BlockPager::BlockPager;

  uint64_t rounded(uint64_t bytes) const override { return format::align_up(bytes, kUnit); }
  Result<std::span<const uint64_t>> wanted() override;
  bool take(uint64_t number) override;
  void give_back(uint64_t number) override { pool_.give_back(taken_[number]); }
  Result<void> load(std::span<const uint32_t> numbers) override;
  Result<void> load_part(std::span<const uint32_t> numbers, uint32_t half);
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
  cudaStream_t stream_ = nullptr;
  cudaEvent_t copied_[2] = {};   // the copies from each half of staging_ are done
  BlockPool pool_;               // of the room, in units of kUnit
  std::vector<uint32_t> taken_;  // by number: the block in pool_
  std::vector<uint64_t> wanted_;
};

}  // namespace scree::runtime
