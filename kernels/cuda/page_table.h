// The table of a scene's pages on a GPU, as it names those of a part of a frame (frame_parts.h).
#pragma once

#include <cstdint>
#include <span>

#include "format/result.h"
#include "kernels/cuda/check.h"
#include "kernels/scene_view.h"

namespace scree::kernels {

class CudaPageTable {
 public:
  /// Where a page lies.
  struct Entry {
    uint64_t page;
    const std::byte* memory;  // of the device
  };

  /// `device`: a scene on the current device, which outlives this; `page_count`: of its table. Errors kDevice.
  Result<void> open(const SceneView& device, uint64_t page_count);

  /// The table names these pages, each once, and no other: queued on the default stream, by a kernel that reads pinned
  /// memory. A copy might wait behind what is being loaded. The set before must be done. Errors kDevice.
  Result<void> set(std::span<const Entry> entries);

 private:
  const std::byte** pages_ = nullptr;
  uint64_t page_count_ = 0;
  PinnedBuffer entries_;
};

}  // namespace scree::kernels
