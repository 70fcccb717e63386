#include "runtime/draw/device_block_pager.h"

#include <algorithm>

namespace scree::runtime {

using kernels::cuda_check;

namespace {

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

Result<std::unique_ptr<DeviceBlockPager>> DeviceBlockPager::create(const Scene& scene, uint32_t threads,
                                                                   uint64_t host_memory, Reading reading,
                                                                   uint64_t room) {
  std::unique_ptr<DeviceBlockPager> made(
      new DeviceBlockPager(scene.file().map(), scene.container(), room, threads, reading));
  DeviceBlockPager& pager = *made;
  pager.add_all_of(*scene.block_pager());
  const uint64_t count = pager.size();
  pager.taken_.assign(count, BlockPool::kNone);
  pager.wanted_.assign(count, 0);
  pager.pool_.reset(room / kUnit);
  Result<void> done;
  if (room != 0) done = pager.room_.reserve(room, "allocating room for pages of textures");
  pager.end_ = pager.room_.data() + room;
  const uint64_t table_bytes = count * sizeof(uint8_t*);
  if (done) done = pager.tables_.reserve(table_bytes + count * sizeof(uint64_t), "allocating the table of pages");
  if (done)
    done = cuda_check(cudaMemset(pager.tables_.data(), 0, pager.tables_.bytes()), "clearing the table of pages");
  pager.half_ = pinned_bytes(host_memory) / 2;
  if (done)
    done =
        pager.staging_.allocate_for_copies(pinned_bytes(host_memory), "allocating pinned memory for pages of textures");
  if (done) done = cuda_check(cudaStreamCreateWithFlags(&pager.stream_, cudaStreamNonBlocking), "making a stream");
  for (cudaEvent_t& event : pager.copied_)
    if (done) done = cuda_check(cudaEventCreateWithFlags(&event, cudaEventDisableTiming), "making an event");
  if (!done) return done.error();
  pager.pages_.blocks = reinterpret_cast<const uint8_t* const*>(pager.tables_.data());
  pager.pages_.wanted = reinterpret_cast<uint64_t*>(pager.tables_.data() + table_bytes);
  return made;
}

DeviceBlockPager::~DeviceBlockPager() {
  if (stream_ != nullptr) (void)cudaStreamSynchronize(stream_);
  for (cudaEvent_t event : copied_)
    if (event != nullptr) (void)cudaEventDestroy(event);
  if (stream_ != nullptr) (void)cudaStreamDestroy(stream_);
}

Result<void> DeviceBlockPager::use_room(std::byte* end, uint64_t bytes) {
  end_ = end;
  drop_if(
      [&](uint32_t number) { return (pool_.offset(taken_[number]) + pool_.units(taken_[number])) * kUnit > bytes; });
  pool_.resize(bytes / kUnit);
  set_room_bytes(bytes);
  const Result<void> copied = copy_table();
  const Result<void> ended = cuda_check(cudaStreamSynchronize(stream_), "copying the table of pages");
  return copied ? ended : copied;
}

/// Starts the copy of the pages' addresses to the device.
Result<void> DeviceBlockPager::copy_table() {
  return cuda_check(cudaMemcpyAsync(tables_.data(), blocks_.data(), blocks_.size() * sizeof blocks_[0],
                                    cudaMemcpyHostToDevice, stream_),
                    "copying the table of pages");
}

Result<std::span<const uint64_t>> DeviceBlockPager::wanted() {
  const Result<void> done =
      cuda_check(cudaMemcpy(wanted_.data(), pages_.wanted, wanted_.size() * sizeof wanted_[0], cudaMemcpyDeviceToHost),
                 "reading which pages of textures are shown");
  if (!done) return done.error();
  return std::span<const uint64_t>(wanted_);
}

bool DeviceBlockPager::take(uint64_t number) {
  taken_[number] = pool_.take(rounded(page_bytes(number)) / kUnit, static_cast<uint32_t>(number));
  return taken_[number] != BlockPool::kNone;
}

Result<void> DeviceBlockPager::load(std::span<const uint32_t> numbers) {
  Result<void> done;
  uint32_t half = 0;
  for (size_t first = 0; first < numbers.size() && done && (first == 0 || !is_over()); half ^= 1) {
    size_t count = 0;
    uint64_t bytes = 0;
    while (first + count < numbers.size() && bytes + slot_bytes(numbers[first + count]) <= half_)
      bytes += slot_bytes(numbers[first + count++]);
    count = std::max<size_t>(count, 1);
    done = load_part(numbers.subspan(first, count), half);
    first += count;
  }
  // The copies from blocks_ and to the room end before a page is sampled, or before its memory is given back.
  const Result<void> copied = copy_table();
  const Result<void> ended = cuda_check(cudaStreamSynchronize(stream_), "copying pages of textures");
  return !done ? done : !copied ? copied : ended;
}

Result<void> DeviceBlockPager::load_part(std::span<const uint32_t> numbers, uint32_t half) {
  constexpr const char* kWhat = "copying pages of textures";
  if (Result<void> done = cuda_check(cudaEventSynchronize(copied_[half]), kWhat); !done) return done;
  std::vector<std::byte*> slots;
  DirectMemory large;  // of a page that does not fit half of the pinned memory, the only one then
  std::byte* next = staging_.data() + half * half_;
  for (const uint32_t number : numbers) {
    slots.push_back(next);
    next += slot_bytes(number);
  }
  if (slot_bytes(numbers[0]) > half_) {
    large = direct_memory(slot_bytes(numbers[0]));
    slots[0] = large.get();
  }
  std::vector<uint8_t> is_read(numbers.size());
  const Result<void> read = read_all(
      numbers,
      [&](uint64_t i) {
        return Target{slots[i], place(numbers[i])};
      },
      [&](uint64_t i) { is_read[i] = 1; });
  for (uint64_t i = 0; i < numbers.size(); ++i) {
    if (is_read[i] == 0) continue;
    if (Result<void> done = cuda_check(
            cudaMemcpyAsync(place(numbers[i]), slots[i], page_bytes(numbers[i]), cudaMemcpyHostToDevice, stream_),
            kWhat);
        !done)
      return done;
    blocks_[numbers[i]] = reinterpret_cast<const uint8_t*>(place(numbers[i]));
  }
  if (large != nullptr)
    if (Result<void> done = cuda_check(cudaStreamSynchronize(stream_), kWhat); !done) return done;
  const Result<void> recorded = cuda_check(cudaEventRecord(copied_[half], stream_), kWhat);
  return read ? recorded : read;
}

}  // namespace scree::runtime
