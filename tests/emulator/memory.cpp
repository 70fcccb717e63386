// Memory of the emulated GPU and pinned memory: allocations, copies, memsets.
#include "tests/emulator/runtime.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>

namespace scree::emulator {
namespace {

constexpr size_t kAlignment = 256;
constexpr size_t kGarbageBytes = size_t{1} << 20;  // filled per allocation; more would take too long

/// The allocation at an address; null if CUDA did not allocate it.
const Allocation* allocation_at(const void* at, size_t bytes) {
  const auto& all = device().allocations;
  const auto address = reinterpret_cast<uintptr_t>(at);
  auto found = all.upper_bound(address);
  if (found == all.begin()) return nullptr;
  --found;
  if (address - found->first >= std::max<size_t>(found->second.bytes, 1)) return nullptr;
  if (bytes > found->second.bytes - (address - found->first)) {
    fail("%zu bytes at %zu of an allocation of %zu", bytes, static_cast<size_t>(address - found->first),
         found->second.bytes);
  }
  return &found->second;
}

void add_allocation(void* memory, size_t bytes, bool is_device) {
  Device& all = device();
  const int gpu = is_device ? current_gpu : kPinned;
  std::memset(memory, kGarbage, std::min(bytes, kGarbageBytes));
  all.allocations[reinterpret_cast<uintptr_t>(memory)] = {bytes, is_device, gpu};
  MemoryInUse& in_use = all.in_use[gpu];
  in_use.now += bytes;
  in_use.peak = std::max(in_use.peak, in_use.now);
}

cudaError_t allocate(void** out, size_t bytes, bool is_device) {
  Device& all = device();
  const std::lock_guard lock(all.mutex);
  *out = nullptr;
  if (is_device && bytes > listed_gpu(current_gpu).value_or(Gpu{}).bytes - all.in_use[current_gpu].now)
    return failed(cudaErrorMemoryAllocation);
  if (bytes == 0) return cudaSuccess;
  void* made = nullptr;
  if (posix_memalign(&made, kAlignment, bytes) != 0) return failed(cudaErrorMemoryAllocation);
  add_allocation(made, bytes, is_device);
  *out = made;
  return cudaSuccess;
}

/// Waits for all submitted work first.
cudaError_t remove_allocation(void* block, bool is_device) {
  Device& all = device();
  const std::lock_guard lock(all.mutex);
  finish(kPinned);
  const auto found = all.allocations.find(reinterpret_cast<uintptr_t>(block));
  if (found == all.allocations.end() || found->second.is_device != is_device) return failed(cudaErrorInvalidValue);
  all.in_use[found->second.gpu].now -= found->second.bytes;
  all.allocations.erase(found);
  return cudaSuccess;
}

cudaError_t give_back(void* block, bool is_device) {
  if (block == nullptr) return cudaSuccess;
  const cudaError_t removed = remove_allocation(block, is_device);
  if (removed == cudaSuccess) std::free(block);
  return removed;
}

struct Copy {
  void* to;
  const void* from;
  size_t bytes;
};

/// Submits the copies. Memory that is not pinned is read or written before the call returns.
cudaError_t submit_copies(std::vector<Copy> copies, cudaMemcpyKind kind, cudaStream_t stream, bool waits) {
  const std::lock_guard lock(device().mutex);
  for (const Copy& copy : copies) {
    if (copy.bytes == 0) continue;
    const Allocation* const to = allocation_at(copy.to, copy.bytes);
    const Allocation* const from = allocation_at(copy.from, copy.bytes);
    const bool to_device = to != nullptr && to->is_device;
    const bool from_device = from != nullptr && from->is_device;
    if (kind == cudaMemcpyHostToDevice && (!to_device || from_device)) return failed(cudaErrorInvalidValue);
    if (kind == cudaMemcpyDeviceToHost && (to_device || !from_device)) return failed(cudaErrorInvalidValue);
    if (kind == cudaMemcpyDeviceToDevice && !(to_device && from_device)) return failed(cudaErrorInvalidValue);
    waits = waits || to == nullptr || from == nullptr;
  }
  const Point end = submit(stream_of(stream), [copies = std::move(copies)] {
    for (const Copy& copy : copies)
      if (copy.bytes != 0) std::memcpy(copy.to, copy.from, copy.bytes);
  });
  if (waits) reach(end);
  return cudaSuccess;
}

cudaError_t submit_set(void* at, int value, size_t bytes, cudaStream_t stream) {
  const std::lock_guard lock(device().mutex);
  if (bytes == 0) return cudaSuccess;
  if (allocation_at(at, bytes) == nullptr) return failed(cudaErrorInvalidValue);
  submit(stream_of(stream), [=] { std::memset(at, value, bytes); });
  return cudaSuccess;
}

}  // namespace

MemoryInUse memory_of_gpu(int index) {
  const std::lock_guard lock(device().mutex);
  return device().in_use[index];
}

MemoryInUse pinned_memory() {
  return memory_of_gpu(kPinned);
}

void reset_peaks() {
  const std::lock_guard lock(device().mutex);
  for (auto& [index, in_use] : device().in_use) in_use.peak = in_use.now;
}

}  // namespace scree::emulator

using namespace scree::emulator;

extern "C" {

cudaError_t cudaMalloc(void** out, size_t bytes) {
  return allocate(out, bytes, true);
}
cudaError_t cudaMallocHost(void** out, size_t bytes) {
  return allocate(out, bytes, false);
}
cudaError_t cudaHostRegister(void* memory, size_t bytes, unsigned) {
  const std::lock_guard lock(device().mutex);
  if (memory == nullptr || bytes == 0 || allocation_at(memory, 1) != nullptr) return failed(cudaErrorInvalidValue);
  add_allocation(memory, bytes, false);
  return cudaSuccess;
}
cudaError_t cudaHostUnregister(void* memory) {
  return remove_allocation(memory, false);
}
cudaError_t cudaFree(void* block) {
  return give_back(block, true);
}
cudaError_t cudaFreeHost(void* block) {
  return give_back(block, false);
}

cudaError_t cudaPointerGetAttributes(cudaPointerAttributes* out, const void* at) {
  const std::lock_guard lock(device().mutex);
  *out = {};
  const Allocation* const found = allocation_at(at, 1);
  out->type = found == nullptr   ? cudaMemoryTypeUnregistered
              : found->is_device ? cudaMemoryTypeDevice
                                 : cudaMemoryTypeHost;
  out->device = found != nullptr && found->is_device ? found->gpu : kPinned;
  return cudaSuccess;
}

cudaError_t cudaMemGetInfo(size_t* free_bytes, size_t* total) {
  const std::lock_guard lock(device().mutex);
  *total = listed_gpu(current_gpu).value_or(Gpu{}).bytes;
  *free_bytes = *total - device().in_use[current_gpu].now;
  return cudaSuccess;
}

cudaError_t cudaMemcpy(void* to, const void* from, size_t bytes, cudaMemcpyKind kind) {
  return submit_copies({{to, from, bytes}}, kind, nullptr, true);
}
cudaError_t cudaMemcpyAsync(void* to, const void* from, size_t bytes, cudaMemcpyKind kind, cudaStream_t stream) {
  return submit_copies({{to, from, bytes}}, kind, stream, false);
}
#if CUDART_VERSION >= 13000
cudaError_t cudaMemcpyBatchAsync(void* const* to, const void* const* from, const size_t* bytes, size_t count,
                                 cudaMemcpyAttributes*, size_t*, size_t, cudaStream_t stream) {
  if (stream == nullptr) return failed(cudaErrorInvalidValue);
  std::vector<Copy> copies;
  for (size_t i = 0; i < count; ++i) copies.push_back({to[i], from[i], bytes[i]});
  std::reverse(copies.begin(), copies.end());  // copies of one batch have no order
  return submit_copies(std::move(copies), cudaMemcpyDefault, stream, false);
}
#endif
cudaError_t cudaMemset(void* at, int value, size_t bytes) {
  return submit_set(at, value, bytes, nullptr);
}
cudaError_t cudaMemsetAsync(void* at, int value, size_t bytes, cudaStream_t stream) {
  return submit_set(at, value, bytes, stream);
}

}  // extern "C"
