// The time between two points of the default stream, measured with CUDA events. It includes work that the host
// submitted in between to other blocking streams.
#pragma once

#include <cuda_runtime_api.h>

#include <utility>

#include "kernels/cuda/common/check.h"

namespace scree::lab {

class GpuTimer {
 public:
  static Result<GpuTimer> create() {
    GpuTimer timer;
    for (cudaEvent_t& event : timer.events_) SCREE_TRY(kernels::cuda_check(cudaEventCreate(&event), "making an event"));
    return timer;
  }
  GpuTimer(GpuTimer&& other) noexcept {
    for (int i = 0; i < 2; ++i) events_[i] = std::exchange(other.events_[i], nullptr);
  }
  GpuTimer& operator=(GpuTimer&& other) noexcept {
    for (int i = 0; i < 2; ++i) std::swap(events_[i], other.events_[i]);
    return *this;
  }
  ~GpuTimer() {
    for (cudaEvent_t event : events_) {
      if (event != nullptr) (void)cudaEventDestroy(event);
    }
  }

  Result<void> start() { return kernels::cuda_check(cudaEventRecord(events_[0]), "recording an event"); }
  /// Waits for the work submitted since start(). Returns its ms.
  Result<float> stop() {
    float ms = 0;
    SCREE_TRY(kernels::cuda_check(cudaEventRecord(events_[1]), "recording an event"));
    SCREE_TRY(kernels::cuda_check(cudaEventSynchronize(events_[1]), "waiting for the GPU"));
    SCREE_TRY(kernels::cuda_check(cudaEventElapsedTime(&ms, events_[0], events_[1]), "reading a time"));
    return ms;
  }

 private:
  GpuTimer() = default;
  cudaEvent_t events_[2] = {};
};

}  // namespace scree::lab
