// Typed device memory.
#pragma once

#include <cuda_runtime.h>

#include <cstdint>
#include <utility>
#include <vector>

#include "kernels/cuda/common/check.h"
#include "kernels/math.h"

namespace scree::kernels {

/// Device memory for `count` values, or none.
template <class T>
class DeviceArray {
 public:
  /// Loses the contents. Errors kDevice.
  Result<void> allocate(uint64_t count, const char* what) {
    count_ = 0;
    SCREE_TRY(buffer_.release("freeing device memory"));
    buffer_ = SCREE_TRY(DeviceBuffer::allocate(max_of<uint64_t>(count, 1) * sizeof(T), what));
    count_ = count;
    return {};
  }
  Result<void> fill(const std::vector<T>& values, const char* what) {
    SCREE_TRY(allocate(values.size(), what));
    if (values.empty()) return {};
    return cuda_check(cudaMemcpy(data(), values.data(), values.size() * sizeof(T), cudaMemcpyHostToDevice), what);
  }
  /// Makes room for at least `count` values; loses the contents if it grows.
  Result<void> grow(uint64_t count, const char* what) {
    return count > count_ ? allocate(count, what) : Result<void>();
  }
  T* data() const { return reinterpret_cast<T*>(buffer_.data()); }
  uint64_t count() const { return count_; }

 private:
  DeviceBuffer buffer_;
  uint64_t count_ = 0;
};

}  // namespace scree::kernels
