#include <algorithm>

#include "kernels/cuda/frame/page_table.h"

namespace scree::kernels {
namespace {

constexpr uint32_t kThreads = 128;

__global__ void __launch_bounds__(kThreads)
    set_pages(const CudaPageTable::Entry* entries, uint64_t count, const std::byte** pages) {
  const uint64_t i = uint64_t{blockIdx.x} * kThreads + threadIdx.x;
  if (i < count) pages[entries[i].page] = entries[i].memory;
}

}  // namespace

Result<void> CudaPageTable::open(const SceneView& device, uint64_t page_count) {
  pages_ = const_cast<const std::byte**>(device.pages);
  page_count_ = page_count;
  return entries_.allocate(page_count * sizeof(Entry), "allocating pinned memory");
}

Result<void> CudaPageTable::set(std::span<const Entry> entries) {
  const char* const what = "listing the chunks of a batch";
  SCREE_TRY(cuda_check(cudaMemsetAsync(pages_, 0, page_count_ * sizeof *pages_, nullptr), what));
  if (entries.empty()) return {};
  auto* const pinned = reinterpret_cast<Entry*>(entries_.data());
  std::copy(entries.begin(), entries.end(), pinned);
  const uint64_t blocks = (entries.size() - 1) / kThreads + 1;
  set_pages<<<static_cast<uint32_t>(blocks), kThreads>>>(pinned, entries.size(), pages_);
  return cuda_check(cudaGetLastError(), what);
}

}  // namespace scree::kernels
