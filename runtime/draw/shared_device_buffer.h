// The same as runtime/draw/shared_buffer.h, in a GPU's memory.
#pragma once

#include <memory>
#include <new>

#include "kernels/cuda/common/check.h"

namespace scree::runtime {

/// A DeviceBuffer that takes new memory if it has to grow while the old memory is held.
class SharedDeviceBuffer {
 public:
  /// As kernels::DeviceBuffer; errors kMemory too.
  Result<void> reserve(uint64_t bytes, const char* what) {
    if (this->bytes() >= bytes) return {};
    try {
      if (!buffer_ || buffer_.use_count() > 1) buffer_ = std::make_shared<kernels::DeviceBuffer>();
    } catch (const std::bad_alloc&) {
      return Error{ErrorCode::kMemory, "no memory left for a buffer's record"};
    }
    return buffer_->reserve(bytes, what);
  }

  std::byte* data() const { return buffer_ ? buffer_->data() : nullptr; }
  uint64_t bytes() const { return buffer_ ? buffer_->bytes() : 0; }
  std::shared_ptr<const void> hold() const { return buffer_; }

 private:
  std::shared_ptr<kernels::DeviceBuffer> buffer_;
};

}  // namespace scree::runtime
