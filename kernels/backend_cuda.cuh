// The CUDA backend: a warp an item, passes as kernels on the default stream. This file and backend_cpu.h are the only
// two that know how work starts.
#pragma once

#include <cuda_runtime.h>

#include <cstdint>
#include <string>

#include "format/result.h"
#include "kernels/queues.h"

namespace scree::kernels {

/// One warp as a team of 32 lanes.
struct WarpTeam {
  static constexpr bool kCachesVertices = false;
  static constexpr bool kDrawsRuns = false;

  __device__ uint32_t rank() const { return threadIdx.x & 31u; }
  __device__ static constexpr uint32_t size() { return 32; }

  __device__ static uint64_t add(uint64_t* counter, uint64_t value) {
    return atomicAdd(reinterpret_cast<unsigned long long*>(counter), value);
  }

  /// The smaller of the sample and `value` stays. Reads first: most pixels that are drawn again lose, and a read is an
  /// eighth of the price of an atomic.
  __device__ static void keep_min(uint64_t* sample, uint64_t value) {
    if (value < *static_cast<volatile uint64_t*>(sample)) {
      atomicMin(reinterpret_cast<unsigned long long*>(sample), value);
    }
  }
};

template <class Pass>
__global__ void __launch_bounds__(256) run_pass(const Pass pass, uint32_t count) {
  const uint32_t item = (blockIdx.x * blockDim.x + threadIdx.x) / 32;
  if (item < count) pass(item, WarpTeam{});
}

/// The first failure stays: after it every call does nothing, so that a pass driver needs to look only at its end.
class CudaBackend {
 public:
  CudaBackend() { check(cudaMalloc(&counters_, sizeof(Counters)), "allocating counters"); }
  ~CudaBackend() { cudaFree(counters_); }
  CudaBackend(const CudaBackend&) = delete;
  CudaBackend& operator=(const CudaBackend&) = delete;

  template <class Pass>
  void for_each(uint64_t count, const Pass& pass) {
    constexpr uint32_t kThreads = 256;
    constexpr uint32_t kItemsPerBlock = kThreads / 32;
    if (count == 0 || failed()) return;
    const auto blocks = static_cast<uint32_t>((count + kItemsPerBlock - 1) / kItemsPerBlock);
    run_pass<Pass><<<blocks, kThreads>>>(pass, static_cast<uint32_t>(count));
    check(cudaGetLastError(), "starting a pass");
  }

  /// Null when the device has no memory left, which is not a failure of the backend.
  template <class T>
  T* allocate(uint64_t count) {
    void* memory = nullptr;
    if (failed() || count > UINT64_MAX / sizeof(T)) return nullptr;
    const cudaError_t status = cudaMalloc(&memory, count * sizeof(T));
    if (status == cudaErrorMemoryAllocation) {
      (void)cudaGetLastError();  // it is reported through the null
      return nullptr;
    }
    check(status, "allocating a queue");
    return static_cast<T*>(memory);
  }
  void release(void* memory) { check(cudaFree(memory), "freeing a queue"); }

  Counters* counters() { return counters_; }

  /// After a failure: zeros.
  Counters read_counters() {
    Counters counters{};
    if (!failed()) {
      check(cudaMemcpy(&counters, counters_, sizeof counters, cudaMemcpyDeviceToHost), "reading the queues' counters");
    }
    return failed() ? Counters{} : counters;
  }
  void write_counters(const Counters& counters) {
    if (!failed()) {
      check(cudaMemcpy(counters_, &counters, sizeof counters, cudaMemcpyHostToDevice), "setting the queues' counters");
    }
  }

  void synchronize(const char* what) {
    if (!failed()) check(cudaDeviceSynchronize(), what);
  }
  bool failed() const { return status_ != cudaSuccess; }
  Error error() const {
    return {ErrorCode::kDevice, std::string("CUDA: ") + what_ + ": " + cudaGetErrorString(status_)};
  }

 private:
  void check(cudaError_t status, const char* what) {
    if (status == cudaSuccess || failed()) return;
    status_ = status;
    what_ = what;
  }

  Counters* counters_ = nullptr;
  cudaError_t status_ = cudaSuccess;
  const char* what_ = "";
};

}  // namespace scree::kernels
