// CUDA calls as Results, and memory, streams and events of CUDA that free themselves.
#pragma once

#include <cuda_runtime_api.h>
#include <sys/mman.h>

#include <cstdint>
#include <cstdlib>
#include <string>
#include <utility>

#include "format/bytes.h"
#include "format/result.h"

#ifdef __NVCC__
#pragma nv_diag_suppress 2810  // nvcc 13 takes the assignment of a nodiscard class for an ignored result
#endif

namespace scree::kernels {

/// `what`: the purpose of the call.
inline Result<void> cuda_check(cudaError_t status, const char* what) {
  if (status == cudaSuccess) return {};
  (void)cudaGetLastError();  // clears the error, which the next launch would report otherwise
  return Error{ErrorCode::kDevice, std::string("CUDA: ") + what + ": " + cudaGetErrorString(status)};
}

/// Loads a kernel's code, which its first launch would do otherwise. That launch also reports errors.
template <class... Parameters>
void load_kernel(void (*kernel)(Parameters...)) {
  cudaFuncAttributes attributes;
  (void)cuda_check(cudaFuncGetAttributes(&attributes, reinterpret_cast<const void*>(kernel)), "loading a kernel");
}

/// Owns a stream or an event, once it is made.
template <class Handle, cudaError_t (*kDestroy)(Handle)>
class OwnedHandle {
 public:
  OwnedHandle() = default;
  OwnedHandle(OwnedHandle&& other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
  OwnedHandle& operator=(OwnedHandle&&) = delete;
  ~OwnedHandle() {
    if (handle_ != nullptr) (void)kDestroy(handle_);
  }

  operator Handle() const { return handle_; }  // null before make()

 protected:
  Handle handle_ = nullptr;
};

/// On the device that is current when it is made.
class DeviceStream : public OwnedHandle<cudaStream_t, cudaStreamDestroy> {
 public:
  /// Errors kDevice.
  Result<void> make(unsigned flags = cudaStreamDefault, int priority = 0) {
    return cuda_check(cudaStreamCreateWithPriority(&handle_, flags, priority), "making a stream");
  }
};

/// Likewise.
class DeviceEvent : public OwnedHandle<cudaEvent_t, cudaEventDestroy> {
 public:
  /// Errors kDevice.
  Result<void> make(unsigned flags = cudaEventDefault) {
    return cuda_check(cudaEventCreateWithFlags(&handle_, flags), "making an event");
  }
};

/// Owns a cudaMalloc() allocation.
class DeviceBuffer {
 public:
  DeviceBuffer() = default;
  DeviceBuffer(DeviceBuffer&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}
  DeviceBuffer& operator=(DeviceBuffer&& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(bytes_, other.bytes_);
    return *this;
  }
  ~DeviceBuffer() { (void)cudaFree(data_); }

  static Result<DeviceBuffer> allocate(uint64_t bytes, const char* what) {
    DeviceBuffer buffer;
    SCREE_TRY(cuda_check(cudaMalloc(&buffer.data_, bytes), what));
    buffer.bytes_ = bytes;
    return Result<DeviceBuffer>(std::move(buffer));
  }

  /// Makes room for at least `bytes`; loses the contents if it has to grow. Errors kDevice.
  Result<void> reserve(uint64_t bytes, const char* what) {
    if (bytes_ >= bytes) return {};
    SCREE_TRY(release(what));  // before the larger allocation
    *this = SCREE_TRY(allocate(bytes, what));
    return {};
  }

  /// Frees the memory before the object's destruction. Errors kDevice.
  Result<void> release(const char* what) {
    bytes_ = 0;
    return cuda_check(cudaFree(std::exchange(data_, nullptr)), what);
  }

  std::byte* data() const { return static_cast<std::byte*>(data_); }
  uint64_t bytes() const { return bytes_; }

 private:
  void* data_ = nullptr;
  uint64_t bytes_ = 0;
};

/// Pinned host memory, which the GPU copies from and to without the CPU.
class PinnedBuffer {
 public:
  PinnedBuffer() = default;
  PinnedBuffer(const PinnedBuffer&) = delete;
  PinnedBuffer& operator=(const PinnedBuffer&) = delete;
  ~PinnedBuffer() {
    if (!is_registered_) {
      (void)cudaFreeHost(data_);
      return;
    }
    (void)cudaHostUnregister(data_);
    std::free(data_);
  }

  /// May be called once, or allocate_for_copies(). Errors kDevice.
  Result<void> allocate(uint64_t bytes, const char* what) {
    return cuda_check(cudaMallocHost(&data_, bytes == 0 ? 1 : bytes), what);
  }

  /// The same for memory that kernels do not read or write. It has huge pages if the system gives them, and then takes
  /// half the time: 5 instead of 11 ms for 33 MiB on the host of an H200.
  Result<void> allocate_for_copies(uint64_t bytes, const char* what) {
    constexpr uint64_t kHugePage = uint64_t{2} << 20;
    if (bytes < kHugePage) return allocate(bytes, what);
    const uint64_t size = format::align_up(bytes, kHugePage);
    void* const memory = size < bytes ? nullptr : std::aligned_alloc(kHugePage, size);
    if (memory == nullptr) return cuda_check(cudaErrorMemoryAllocation, what);
    (void)madvise(memory, size, MADV_HUGEPAGE);  // only advice
    const Result<void> done = cuda_check(cudaHostRegister(memory, bytes, cudaHostRegisterPortable), what);
    if (!done) {
      std::free(memory);
      return done;
    }
    data_ = memory;
    is_registered_ = true;
    return {};
  }

  std::byte* data() const { return static_cast<std::byte*>(data_); }

 private:
  void* data_ = nullptr;
  bool is_registered_ = false;  // false: cudaMallocHost() made it
};

}  // namespace scree::kernels
