// Typed device memory.
#pragma once

#include <cuda_runtime.h>

#include <cstdint>
#include <utility>
#include <vector>

#include "kernels/cuda/check.h"
#include "kernels/math.h"

#pragma nv_diag_suppress 2810  // nvcc 13 takes the assignment of a nodiscard class for an ignored result

namespace scree::kernels {

/// Device memory for `count` values, or none.
template <class T>
class DeviceArray {
 public:
  /// Loses the contents. Errors kDevice.
  Result<void> allocate(uint64_t count, const char* what) {
    count_ = 0;
    if (Result<void> done = buffer_.release("freeing device memory"); !done) return done;
    Result<DeviceBuffer> made = DeviceBuffer::allocate(max_of<uint64_t>(count, 1) * sizeof(T), what);
    if (!made) return made.error();
    buffer_ = std::move(*made);
    count_ = count;
    return {};
  }
  Result<void> fill(const std::vector<T>& values, const char* what) {
    if (Result<void> done = allocate(values.size(), what); !done || values.empty()) return done;
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
