#include "runtime/draw/device_block_pager.h"

#include <algorithm>
#include <cstring>
#include <mutex>
#include <utility>

namespace scree::runtime {

using kernels::cuda_check;

namespace {

/// Pages that come from pinned host memory to the room at a time, bytes: a millisecond of a fast link, beside other
/// work.
constexpr uint64_t kMostCopiedBytes = uint64_t{64} << 20;

/// Pinned memory for pages is allocated in at most about 64 pieces, so that the memory in use grows with its use.
constexpr uint64_t kLeastSlabBytes = uint64_t{64} << 20;
constexpr uint64_t kMostSlabs = 64;

/// The memory that the scene's pages take together, but at most `limit`.
uint64_t room_within(const Scene& scene, uint64_t limit) {
  const HostBlockPager* const host = scene.block_pager();
  uint64_t all = 0;
  for (uint64_t number = 0; host != nullptr && number < host->size(); ++number)
    all += format::align_up(host->page_bytes(number), DeviceBlockPager::kUnit);
  return std::min(all, limit / DeviceBlockPager::kUnit * DeviceBlockPager::kUnit);
}

}  // namespace

uint64_t DeviceBlockPager::usual_room(const Scene& scene) {
  return room_within(scene, scene.device_texture_memory());
}

uint64_t DeviceBlockPager::most_room(const Scene& scene) {
  return room_within(scene, scene.device_texture_limit());
}

uint64_t DeviceBlockPager::more_room(const Scene& scene, uint64_t rest) {
  return std::min(most_room(scene) - usual_room(scene), rest / 2 / kUnit * kUnit);
}

uint64_t DeviceBlockPager::table_bytes(const Scene& scene) {
  return scene.block_pager()->size() * (sizeof(uint8_t*) + sizeof(uint64_t));
}

uint64_t DeviceBlockPager::pinned_bytes(uint64_t host_memory) {
  constexpr uint64_t kMost = 128 * format::kBlockPageBytes;
  constexpr uint64_t kLeast = 2 * format::kBlockPageBytes;
  return host_memory == 0 ? kMost : std::clamp(host_memory / 8 / kLeast * kLeast, kLeast, kMost);
}

uint64_t DeviceBlockPager::most_kept_bytes(const Scene& scene, uint64_t host_memory) {
  if (scene.block_pager() == nullptr) return 0;
  const uint64_t other = pinned_bytes(host_memory) + table_bytes(scene);
  return host_memory - std::min(host_memory, other);
}

Result<std::unique_ptr<DeviceBlockPager>> DeviceBlockPager::create(const Scene& scene, uint32_t threads,
                                                                   uint64_t host_memory, Reading reading,
                                                                   uint64_t room) {
  std::unique_ptr<DeviceBlockPager> made(
      new DeviceBlockPager(scene.file().map(), scene.container(), room, threads, reading));
  DeviceBlockPager& pager = *made;
  pager.add_all_of(*scene.block_pager());
  const uint64_t count = pager.size();
  pager.taken_.assign(count, BlockPool::kNone);
  pager.kept_.resize(count);
  pager.was_loaded_.resize(count);
  pager.pool_.reset(room / kUnit);
  if (room != 0) SCREE_TRY(pager.room_.reserve(room, "allocating room for pages of textures"));
  pager.end_ = pager.room_.data() + room;
  SCREE_TRY(pager.tables_.reserve(table_bytes(scene), "allocating the table of pages"));
  SCREE_TRY(cuda_check(cudaMemset(pager.tables_.data(), 0, pager.tables_.bytes()), "clearing the table of pages"));
  SCREE_TRY(pager.lists_.allocate(table_bytes(scene), "allocating pinned memory for the table of pages"));
  pager.half_ = pinned_bytes(host_memory) / 2;
  SCREE_TRY(
      pager.staging_.allocate_for_copies(pinned_bytes(host_memory), "allocating pinned memory for pages of textures"));
  SCREE_TRY(pager.stream_.make(cudaStreamNonBlocking));
  for (kernels::DeviceEvent* const event : {&pager.copied_[0], &pager.copied_[1], &pager.arrived_})
    SCREE_TRY(event->make(cudaEventDisableTiming));
  pager.pages_.blocks = reinterpret_cast<const uint8_t* const*>(pager.tables_.data());
  pager.pages_.wanted = reinterpret_cast<uint64_t*>(pager.tables_.data() + count * sizeof(uint8_t*));
  return made;
}

DeviceBlockPager::~DeviceBlockPager() {
  if (stream_ != nullptr) (void)cudaStreamSynchronize(stream_);
}

Result<void> DeviceBlockPager::use_room(std::byte* end, uint64_t bytes) {
  SCREE_TRY(finish_copies());
  end_ = end;
  drop_if(
      [&](uint32_t number) { return (pool_.offset(taken_[number]) + pool_.units(taken_[number])) * kUnit > bytes; });
  pool_.resize(bytes / kUnit);
  set_room_bytes(bytes);
  return copy_table();
}

/// Copies the pages' addresses to the device, and waits for all copies of pages.
Result<void> DeviceBlockPager::copy_table() {
  constexpr const char* kWhat = "copying pages of textures and their table";
  const uint64_t bytes = blocks_.size() * sizeof blocks_[0];
  std::memcpy(lists_.data(), blocks_.data(), bytes);
  const Result<void> copied =
      cuda_check(cudaMemcpyAsync(tables_.data(), lists_.data(), bytes, cudaMemcpyHostToDevice, stream_), kWhat);
  const Result<void> ended = cuda_check(cudaStreamSynchronize(stream_), kWhat);
  return copied ? ended : copied;
}

Result<std::span<const uint64_t>> DeviceBlockPager::wanted() {
  SCREE_TRY(finish_copies());
  auto* const wanted = reinterpret_cast<uint64_t*>(lists_.data() + size() * sizeof blocks_[0]);
  SCREE_TRY(cuda_check(cudaMemcpy(wanted, pages_.wanted, size() * sizeof *wanted, cudaMemcpyDeviceToHost),
                       "reading which pages of textures are shown"));
  return std::span<const uint64_t>(wanted, size());
}

bool DeviceBlockPager::take(uint64_t number) {
  taken_[number] = pool_.take(rounded(page_bytes(number)) / kUnit, static_cast<uint32_t>(number));
  return taken_[number] != BlockPool::kNone;
}

Result<void> DeviceBlockPager::load(std::span<const uint32_t> numbers) {
  if (numbers.empty()) return {};
  Result<void> done;
  uint32_t half = 0;
  try {
    for (size_t first = 0; first < numbers.size() && done && (first == 0 || !is_over()); half ^= 1) {
      size_t count = 0;
      uint64_t bytes = 0;
      while (first + count < numbers.size() && bytes + slot_bytes(numbers[first + count]) <= half_)
        bytes += slot_bytes(numbers[first + count++]);
      count = std::max<size_t>(count, 1);
      done = load_part(numbers.subspan(first, count), half);
      first += count;
    }
  } catch (const std::bad_alloc&) {
    done = no_memory();
  }
  // Also after an error: the copies from blocks_ and to the room end before a page is sampled, or before its memory is
  // given back, and the table has the pages that came.
  const Result<void> copied = copy_table();
  return done ? copied : done;
}

Result<void> DeviceBlockPager::load_part(std::span<const uint32_t> numbers, uint32_t half) {
  constexpr const char* kWhat = "copying pages of textures";
  SCREE_TRY(cuda_check(cudaEventSynchronize(copied_[half]), kWhat));
  std::vector<std::byte*> slots;
  slots.reserve(numbers.size());
  std::vector<uint8_t> is_read(numbers.size());
  DirectMemory large;  // of a page that does not fit half of the pinned memory, the only one then
  std::byte* next = staging_.data() + half * half_;
  for (const uint32_t number : numbers) {
    // A page that was dropped may be dropped again. So it is kept if there is memory, and copied from there.
    const bool is_kept = kept_limit_ != 0 && !has_jpeg(number) && was_loaded_[number] != 0 && keep_next(number);
    slots.push_back(is_kept ? kept_memory(number) : next);
    if (!is_kept) next += slot_bytes(number);
  }
  if (slot_bytes(numbers[0]) > half_) {
    large = direct_memory(slot_bytes(numbers[0]));
    slots[0] = large.get();
  }
  const Result<void> read = read_all(
      numbers,
      [&](uint64_t i) {
        return Target{slots[i], place(numbers[i])};
      },
      [&](uint64_t i) { is_read[i] = 1; });
  for (uint64_t i = 0; i < numbers.size(); ++i) {
    const bool is_kept = kept_[numbers[i]].slab != BlockPool::kNone;
    if (is_kept) kept_[numbers[i]].is_filled = is_read[i] != 0;
    if (is_kept && is_read[i] == 0) drop_kept(numbers[i]);
    if (is_read[i] == 0) continue;
    was_loaded_[numbers[i]] = 1;
    SCREE_TRY(cuda_check(
        cudaMemcpyAsync(place(numbers[i]), slots[i], page_bytes(numbers[i]), cudaMemcpyHostToDevice, stream_), kWhat));
    blocks_[numbers[i]] = reinterpret_cast<const uint8_t*>(place(numbers[i]));
  }
  if (large != nullptr) SCREE_TRY(cuda_check(cudaStreamSynchronize(stream_), kWhat));
  const Result<void> recorded = cuda_check(cudaEventRecord(copied_[half], stream_), kWhat);
  return read ? recorded : read;
}

Result<void> DeviceBlockPager::keep_in_host_memory(uint64_t bytes) try {
  uint64_t all = 0;
  std::vector<uint32_t> numbers;
  for (uint32_t number = 0; number < size(); ++number) {
    if (has_jpeg(number)) continue;
    numbers.push_back(number);
    all += slot_bytes(number);
  }
  kept_limit_ = std::min(bytes / kUnit * kUnit, all);
  if (kept_limit_ == 0) return {};
  if (all > kept_limit_) {
    slab_bytes_ = std::max(format::align_up(kept_limit_ / kMostSlabs, kUnit), kLeastSlabBytes);
    return {};
  }
  slab_bytes_ = all;
  for (size_t i = 0; i < numbers.size(); ++i) {
    if (keep_next(numbers[i])) continue;
    numbers.resize(i);  // the system pins no more
    break;
  }
  return numbers.empty() ? Result<void>() : load_kept(numbers);
} catch (const std::bad_alloc&) {
  return no_memory();
}

/// Returns whether there is another slab. If the system pins no more, there will be none.
bool DeviceBlockPager::add_slab() {
  while (allocated_bytes_ < kept_limit_) {
    const uint64_t bytes = std::min(slab_bytes_, kept_limit_ - allocated_bytes_);
    auto slab = std::make_unique<Slab>();
    slab->pool.reset(bytes / kUnit);
    slabs_.reserve(slabs_.size() + 1);
    if (slab->memory.allocate(bytes, "allocating pinned memory for pages of textures")) {
      slabs_.push_back(std::move(slab));
      allocated_bytes_ += bytes;
      return true;
    }
    if (bytes > kLeastSlabBytes) {
      slab_bytes_ = std::max(format::align_up(bytes / kMostSlabs, kUnit), kLeastSlabBytes);
    } else {
      kept_limit_ = allocated_bytes_;
    }
  }
  return false;
}

/// Takes free memory to keep a page, unless it has some. Returns false if none is free.
bool DeviceBlockPager::keep_next(uint32_t number) {
  Kept& kept = kept_[number];
  if (kept.slab != BlockPool::kNone) return true;
  const uint64_t units = slot_bytes(number) / kUnit;
  const auto take_from = [&](size_t slab) {
    kept.block = slabs_[slab]->pool.take(units, number);
    if (kept.block == BlockPool::kNone) return false;
    kept.slab = static_cast<uint32_t>(slab);
    kept_bytes_ += units * kUnit;
    return true;
  };
  for (size_t slab = slabs_.size(); slab-- > 0;)
    if (slabs_[slab]->pool.free_units() >= units && take_from(slab)) return true;
  return add_slab() && take_from(slabs_.size() - 1);
}

void DeviceBlockPager::drop_kept(uint32_t number) {
  if (!is_in_room(number)) blocks_[number] = nullptr;
  const Kept kept = std::exchange(kept_[number], {});
  kept_bytes_ -= slot_bytes(number);
  slabs_[kept.slab]->pool.give_back(kept.block);
}

bool DeviceBlockPager::keep(std::span<const uint32_t> numbers, std::span<const uint64_t> wanted) {
  if (kept_limit_ == 0) return false;
  uint64_t bytes = 0;
  for (const uint32_t number : numbers) bytes += slot_bytes(number);
  if (bytes > kept_limit_) return false;
  std::vector<uint32_t> old;  // pages that may be dropped, the one shown longest ago first; made once it is needed
  bool is_sorted = false;
  size_t gone = 0;
  for (size_t i = 0; i < numbers.size();) {
    if (keep_next(numbers[i])) {
      ++i;
      continue;
    }
    if (!is_sorted) {
      for (uint32_t number = 0; number < size(); ++number)
        if (kept_[number].is_filled && (is_in_room(number) || wanted[number] != pages().round)) old.push_back(number);
      std::sort(old.begin(), old.end(),
                [&](uint32_t a, uint32_t b) { return wanted[a] != wanted[b] ? wanted[a] < wanted[b] : a < b; });
      is_sorted = true;
    }
    if (gone == old.size()) {
      while (i > 0) drop_kept(numbers[--i]);
      return false;
    }
    drop_kept(old[gone++]);
  }
  return true;
}

Result<void> DeviceBlockPager::load_kept(std::span<const uint32_t> numbers) {
  const size_t most = has_patience() ? 8 * size_t{threads()} : numbers.size();
  Result<void> done;
  for (auto rest = numbers; done && !rest.empty(); rest = rest.subspan(std::min(rest.size(), most))) {
    const auto some = rest.first(std::min(rest.size(), most));
    done = read_all(
        some,
        [&](uint64_t i) {
          return Target{kept_memory(some[i]), kept_memory(some[i])};
        },
        [&](uint64_t i) {
          kept_[some[i]].is_filled = true;
          blocks_[some[i]] = reinterpret_cast<const uint8_t*>(kept_memory(some[i]));
        });
    if (is_over()) break;
  }
  for (const uint32_t number : numbers)
    if (!kept_[number].is_filled) drop_kept(number);
  const Result<void> copied = copy_table();
  return done ? copied : done;
}

const uint8_t* DeviceBlockPager::kept_address(uint64_t number) const {
  return kept_[number].is_filled ? reinterpret_cast<const uint8_t*>(kept_memory(number)) : nullptr;
}

Result<void> DeviceBlockPager::settle() {
  if (kept_bytes_ == 0) return {};
  const std::lock_guard<std::mutex> lock(mutex());
  if (!copying_.empty()) {
    const cudaError_t status = cudaEventQuery(arrived_);
    const Result<void> arrived = cuda_check(status, "copying pages of textures");  // which clears the status
    if (status == cudaErrorNotReady) return {};
    SCREE_TRY(arrived);
    SCREE_TRY(finish_copies());
  }
  return pages().round == settled_round_ ? Result<void>() : begin_copies();
}

/// Waits for the pages that are being copied to the room. They are sampled there from now on.
Result<void> DeviceBlockPager::finish_copies() {
  if (copying_.empty()) return {};
  SCREE_TRY(cuda_check(cudaStreamSynchronize(stream_), "copying pages of textures"));
  for (const uint32_t number : copying_) blocks_[number] = reinterpret_cast<const uint8_t*>(place(number));
  copying_.clear();
  return copy_table();
}

Result<void> DeviceBlockPager::begin_copies() {
  const std::span<const uint64_t> last = SCREE_TRY(wanted());
  const Result<void> done = copy_sampled(last);
  if (done) return done;
  for (const uint32_t number : copying_) drop(number);  // they stay in host memory
  copying_.clear();
  return done;
}

Result<void> DeviceBlockPager::copy_sampled(std::span<const uint64_t> last) try {
  const uint64_t first_round = settled_round_ + 1;
  settled_round_ = pages().round;
  const uint64_t oldest = std::exchange(ended_[next_ended_++ % ended_.size()], settled_round_);
  std::vector<uint32_t> old;
  bool is_sorted = false;
  size_t gone = 0;
  uint64_t bytes = 0;
  copying_.reserve(size());
  for (uint32_t number = 0; number < size() && bytes < kMostCopiedBytes; ++number) {
    if (last[number] < first_round || is_in_room(number) || !kept_[number].is_filled) continue;
    bool is_taken = take_next(number);
    if (!is_taken && !is_sorted) {
      old = unwanted_since(oldest, last);
      is_sorted = true;
    }
    while (!is_taken && gone < old.size()) {
      drop(old[gone++]);
      is_taken = take_next(number);
    }
    if (!is_taken) break;
    copying_.push_back(number);
    bytes += slot_bytes(number);
  }
  if (copying_.empty() && gone == 0) return {};
  constexpr const char* kWhat = "copying pages of textures";
  // From now on nothing is sampled where the copies go. Earlier calls may have dropped pages too.
  Result<void> done = copy_table();
  for (const uint32_t number : copying_)
    if (done)
      done = cuda_check(
          cudaMemcpyAsync(place(number), kept_memory(number), page_bytes(number), cudaMemcpyHostToDevice, stream_),
          kWhat);
  if (done) done = cuda_check(cudaEventRecord(arrived_, stream_), kWhat);
  if (done) copied_bytes_ += bytes;
  return done;
} catch (const std::bad_alloc&) {
  return no_memory();
}

}  // namespace scree::runtime
