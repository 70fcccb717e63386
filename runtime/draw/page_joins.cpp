#include "runtime/draw/page_joins.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "format/bytes.h"
#include "format/layout.h"

namespace scree::runtime {

using kernels::cuda_check;

namespace {

constexpr uint64_t kCopying = 8;                       // slots that are copied while each thread fills another
constexpr uint64_t kUsualRegion = uint64_t{80} << 20;  // most bytes of a region, unless a page needs more
constexpr uint64_t kUnit = 256;                        // slots, and everything in a region, begin at a multiple of it

/// Device memory for a page: its streams take up to 1.2 times its bytes, and its vertices as much again, fewer if only
/// a part of it is wanted.
uint64_t usual_room(uint64_t page_bytes) {
  return page_bytes * 5 / 2;
}

/// The least bytes of a region, so that nearly any page fits it. Other pages are joined on the CPU.
uint64_t least_region(uint64_t page_bytes) {
  return page_bytes * 5;
}

}  // namespace

/// An ordinary page has a task for every 200 KB and more.
uint64_t PageJoins::Sizes::whole_slot() const {
  return format::align_up(slot_bytes + std::max<uint64_t>(slot_bytes / 16, 4096), format::kPageAlignment);
}

uint64_t PageJoins::Sizes::pinned_bytes() const {
  return any() ? slots * whole_slot() + kMostLoads * sizeof(uint32_t) : 0;
}

PageJoins::Sizes PageJoins::sizes_for(const Work& work, uint64_t most_device, uint64_t most_pinned) {
  if (work.slot_bytes == 0) return {};
  Sizes sizes{.slot_bytes = work.slot_bytes};
  // Each thread fills a slot, while a few others are copied.
  const uint64_t slots = std::min({uint64_t{std::max(work.threads, 1u)} + kCopying, work.slots,
                                   (most_pinned - std::min(most_pinned, kUnit)) / sizes.whole_slot()});
  const uint64_t room = usual_room(work.page_bytes), least = least_region(work.page_bytes);
  const uint64_t region = std::max(std::min(kernels::kMostJoinSlots * room, kUsualRegion), least);
  const uint64_t needed =
      std::max(std::min(work.slots, kMostRegions * uint64_t{kernels::kMostJoinSlots}) * room, least);
  const uint64_t device = std::min({most_device, kMostRegions * region, needed});
  sizes.regions = static_cast<uint32_t>(std::min<uint64_t>(device / least, kMostRegions));
  if (sizes.regions == 0 || slots == 0) return {};
  sizes.region_bytes = device / sizes.regions / kUnit * kUnit;
  sizes.slots = static_cast<uint32_t>(slots);
  return sizes;
}

PageJoins::~PageJoins() {
  for (const Region& region : regions_)
    if (region.stream != nullptr) (void)cudaStreamSynchronize(region.stream);
}

Result<void> PageJoins::open(const Sizes& sizes, int device, std::byte* arena, std::byte* regions) {
  sizes_ = sizes;
  device_ = device;
  arena_ = arena;
  SCREE_TRY(pinned_.allocate_for_copies(sizes.slots * sizes.whole_slot(), "allocating pinned memory"));
  SCREE_TRY(flags_.allocate(kMostLoads * sizeof(uint32_t), "allocating pinned memory"));
  if (regions == nullptr) {
    SCREE_TRY(memory_.reserve(sizes.device_bytes(), "allocating memory to join pages"));
    regions = memory_.data();
  }
  slots_.open(sizes.slots);
  copied_.resize(sizes.slots);
  for (kernels::DeviceEvent& event : copied_) SCREE_TRY(event.make(cudaEventDisableTiming | cudaEventBlockingSync));
  regions_.resize(sizes.regions);
  for (Region& region : regions_) {
    SCREE_TRY(region.stream.make(cudaStreamNonBlocking));
    SCREE_TRY(region.done.make(cudaEventDisableTiming | cudaEventBlockingSync));
    region.memory = regions + static_cast<uint64_t>(&region - regions_.data()) * sizes.region_bytes;
    region.joins.reserve(kernels::kMostJoinSlots);
  }
  return {};
}

Result<void> PageJoins::begin(uint32_t load, cudaEvent_t moved, cudaEvent_t begun) {
  const std::lock_guard<std::mutex> lock(mutex_);
  load_ = load;
  begun_ = begun;
  *flag_of(load) = 0;
  for (const Region& region : regions_)
    if (moved != nullptr) SCREE_TRY(cuda_check(cudaStreamWaitEvent(region.stream, moved), "recording a load"));
  return {};
}

Result<void> PageJoins::end(cudaStream_t stream) {
  const std::lock_guard<std::mutex> lock(mutex_);
  // If the last copy filled its region, the open one may still be at work, with pages of earlier loads. The places of
  // their chunks may hold other chunks by now, so it must not be launched again.
  const cudaEvent_t begun = std::exchange(begun_, nullptr);
  if (!open_region().is_launched && !open_region().joins.empty()) SCREE_TRY(launch(open_region()));
  if (begun != nullptr) SCREE_TRY(cuda_check(cudaEventRecord(begun, stream), "recording a load"));
  for (const Region& region : regions_)
    if (region.is_launched) SCREE_TRY(cuda_check(cudaStreamWaitEvent(stream, region.done), "recording a load"));
  return {};
}

/// Joins the pages of the open region, and opens the next one, which may still be at work.
Result<void> PageJoins::launch(Region& region) {
  SCREE_TRY(cuda_check(cudaSetDevice(device_), "choosing the GPU"));  // each thread has a current device of its own
  region.is_launched = true;
  ++region.launches;
  open_ = (open_ + 1) % sizes_.regions;
  SCREE_TRY(kernels::join_parts(region.joins, arena_, region.stream));
  return cuda_check(cudaEventRecord(region.done, region.stream), "recording a load");
}

/// Waits for a region's joins, with the lock released.
Result<void> PageJoins::wait_for(std::unique_lock<std::mutex>& lock, Region& region) {
  const uint64_t launches = region.launches;
  lock.unlock();
  Result<void> done = cuda_check(cudaEventSynchronize(region.done), "joining pages");
  lock.lock();
  if (!done || !region.is_launched || region.launches != launches) return done;  // another thread has emptied it
  region.joins.clear();
  region.end = 0;
  region.is_launched = false;
  return done;
}

Result<JoinTarget::Slot> PageJoins::take() {
  const SlotQueue::Taken taken = slots_.take();
  const Result<void> copied = taken.is_copying
                                  ? cuda_check(cudaEventSynchronize(copied_[taken.slot]), "copying pages to the device")
                                  : Result<void>();
  if (!copied) {
    slots_.give_back(taken.slot);
    return copied.error();
  }
  const uint64_t bytes = sizes_.whole_slot();
  return Slot{taken.slot, {pinned_.data() + taken.slot * bytes, bytes}};
}

void PageJoins::give_back(const Slot& slot) {
  slots_.give_back(slot.number);
}

Result<bool> PageJoins::join(const Slot& slot, uint64_t bytes, const JoinPlan& plan) {
  const auto tasks = std::as_bytes(std::span(plan.tasks()));
  const uint64_t tasks_at = format::align_up(bytes, kUnit);
  const uint64_t history_at = format::align_up(tasks_at + tasks.size(), kUnit);
  const uint64_t needed = format::align_up(history_at + plan.history_words() * sizeof(uint32_t), kUnit);
  if (tasks_at + tasks.size() > slot.memory.size() || needed > sizes_.region_bytes) return false;
  if (!tasks.empty()) std::memcpy(slot.memory.data() + tasks_at, tasks.data(), tasks.size());

  std::unique_lock<std::mutex> lock(mutex_);
  SCREE_TRY(cuda_check(cudaSetDevice(device_), "choosing the GPU"));
  for (;;) {
    Region& open = open_region();
    if (!open.is_launched && open.end + needed <= sizes_.region_bytes) break;
    SCREE_TRY(open.is_launched ? wait_for(lock, open) : launch(open));
  }
  Region& region = open_region();
  if (begun_ != nullptr)
    SCREE_TRY(cuda_check(cudaEventRecord(std::exchange(begun_, nullptr), region.stream), "recording a load"));
  std::byte* const memory = region.memory + region.end;
  SCREE_TRY(cuda_check(
      cudaMemcpyAsync(memory, slot.memory.data(), tasks_at + tasks.size(), cudaMemcpyHostToDevice, region.stream),
      "copying pages to the device"));
  SCREE_TRY(cuda_check(cudaEventRecord(copied_[slot.number], region.stream), "recording a load"));
  region.end += needed;
  region.joins.push_back({reinterpret_cast<const kernels::JoinTask*>(memory + tasks_at),
                          static_cast<uint32_t>(plan.tasks().size()), memory,
                          reinterpret_cast<uint32_t*>(memory + history_at), flag_of(load_)});
  if (region.joins.size() == kernels::kMostJoinSlots) SCREE_TRY(launch(region));  // after an error it is the caller's
  slots_.add_copying(slot.number);
  return true;
}

}  // namespace scree::runtime
