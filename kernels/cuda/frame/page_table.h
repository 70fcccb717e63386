// The table of a scene's page addresses on a GPU. It has the addresses of the pages of the current part of a frame
// (frame_parts.h).
#pragma once

#include <cstdint>
#include <span>

#include "format/result.h"
#include "kernels/cuda/common/check.h"
#include "kernels/scene_view.h"

namespace scree::kernels {

class CudaPageTable {
 public:
  /// A page and its address.
  struct Entry {
    uint64_t page;
    const std::byte* memory;  // device memory
  };

  /// `device`: a scene on the current device, which outlives this. `page_count`: of its table. Errors kDevice.
  Result<void> open(const SceneView& device, uint64_t page_count);

  /// Fills the table with these pages, each listed once, and no others. Queued on the default stream as a kernel that
  /// reads pinned memory, because a copy might wait behind loads. The previous set() must be done. Errors kDevice.
  Result<void> set(std::span<const Entry> entries);

 private:
  const std::byte** pages_ = nullptr;
  uint64_t page_count_ = 0;
  PinnedBuffer entries_;
};

}  // namespace scree::kernels
