// Joins split pages on a GPU, straight into the memory from which they are drawn. Only in programs that are built with
// CUDA.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <vector>

#include "format/geometry/cluster_page.h"
#include "format/result.h"
#include "kernels/cuda/common/check.h"
#include "kernels/cuda/join/join.h"
#include "runtime/stream/chunk_source.h"
#include "runtime/stream/join_target.h"
#include "runtime/stream/slot_queue.h"
#include "runtime/stream/streamer.h"

namespace scree::runtime {

/// Slots of pinned memory, which are copied to a few regions of device memory. A slot is free when it is copied. A
/// region takes copies until it is full. Then one launch joins all of them, while other regions are filled and joined.
class PageJoins final : public JoinTarget {
 public:
  struct Sizes {
    uint64_t slot_bytes = 0;  // for pages
    uint32_t slots = 0;       // 0: nothing is joined
    uint64_t region_bytes = 0;
    uint32_t regions = 0;

    bool any() const { return slots != 0; }
    /// Bytes of a slot with the tasks of its pages.
    uint64_t whole_slot() const;
    uint64_t device_bytes() const { return regions * region_bytes; }
    uint64_t pinned_bytes() const;
  };
  struct Work {
    uint64_t page_bytes;  // of the pages that share a slot, when they are joined
    uint64_t slot_bytes;  // 0: nothing is joined
    uint64_t slots;       // that are filled in all
    uint32_t threads;     // that fill slots
  };
  /// The result takes at most `most_device` and `most_pinned` bytes.
  static Sizes sizes_for(const Work& work, uint64_t most_device, uint64_t most_pinned);
  /// For the pages that `source` can send.
  static Sizes sizes_for(const ChunkSource& source, uint32_t threads, uint64_t most_device, uint64_t most_pinned) {
    const uint64_t slot_bytes = source.most_slot_bytes();
    return sizes_for({slot_bytes / format::kMaxSplitRatio, slot_bytes, UINT64_MAX, threads}, most_device, most_pinned);
  }

  PageJoins() = default;
  PageJoins(const PageJoins&) = delete;
  PageJoins& operator=(const PageJoins&) = delete;
  ~PageJoins();

  /// The most pinned memory that sizes_for() should get.
  static constexpr uint64_t kMostPinned = uint64_t{256} << 20;

  /// On the current device, whose number is `device`. `arena`: the memory that chunks are joined into. `regions`:
  /// Sizes::device_bytes() of device memory, aligned to 256 bytes; null: allocates them. Errors kDevice.
  Result<void> open(const Sizes& sizes, int device, std::byte* arena, std::byte* regions = nullptr);

  /// Begins a load (its number is below kMostLoads), on one thread. Its joins start after `moved`, if that is not null.
  /// `begun` is recorded before the first copy. Errors kDevice.
  Result<void> begin(uint32_t load, cudaEvent_t moved, cudaEvent_t begun);
  /// Ends it: everything is started, and `stream` waits until it is done. Also to be called after an error.
  Result<void> end(cudaStream_t stream);
  /// After that: whether the GPU found all clusters of the load good.
  bool has_joined(uint32_t load) const { return *flag_of(load) == 0; }

  uint32_t slot_count() const override { return sizes_.slots; }
  uint64_t slot_bytes() const override { return sizes_.slot_bytes; }
  Result<Slot> take() override;
  void give_back(const Slot& slot) override;
  Result<bool> join(const Slot& slot, uint64_t bytes, const JoinPlan& plan) override;

 private:
  static constexpr uint32_t kMostRegions = 4;

  struct Region {
    std::byte* memory = nullptr;
    kernels::DeviceStream stream;
    kernels::DeviceEvent done;
    uint64_t end = 0;  // of the used bytes
    std::vector<kernels::JoinSlot> joins{};
    bool is_launched = false;  // and perhaps not done
    uint64_t launches = 0;
  };

  Result<void> launch(Region& region);
  Result<void> wait_for(std::unique_lock<std::mutex>& lock, Region& region);
  Region& open_region() { return regions_[open_]; }
  uint32_t* flag_of(uint32_t load) const { return reinterpret_cast<uint32_t*>(flags_.data()) + load; }

  Sizes sizes_;
  int device_ = 0;
  std::byte* arena_ = nullptr;
  kernels::PinnedBuffer pinned_;  // slots
  kernels::PinnedBuffer flags_;   // for each load, set by kernels
  kernels::DeviceBuffer memory_;  // of the regions, if it is allocated here
  SlotQueue slots_;
  std::mutex mutex_;                          // guards the rest, except copied_
  std::vector<kernels::DeviceEvent> copied_;  // by slot
  std::vector<Region> regions_;
  uint32_t open_ = 0;  // the region that takes copies
  uint32_t load_ = 0;
  cudaEvent_t begun_ = nullptr;  // to be recorded
};

}  // namespace scree::runtime
