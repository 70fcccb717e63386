// Work for several streams, started as one. Otherwise a short frame waits for its streams to fork and join.
#pragma once

#include <cuda_runtime.h>

#include "format/result.h"
#include "kernels/cuda/check.h"

namespace scree::kernels {

/// A CUDA graph that is captured again for every frame. If it has the same shape as before, only its arguments are
/// updated, which costs the host less than launching the kernels one by one. One thread at a time.
class CudaGraph {
 public:
  CudaGraph() = default;
  CudaGraph(const CudaGraph&) = delete;
  CudaGraph& operator=(const CudaGraph&) = delete;
  ~CudaGraph() {
    if (exec_ != nullptr) (void)cudaGraphExecDestroy(exec_);
  }

  /// Starts capturing `stream` and every stream that joins it through an event. `stream` must not be ordered with the
  /// default stream. Meanwhile other threads may use the default stream and may allocate, but none may wait for the
  /// whole device.
  static Result<void> begin(cudaStream_t stream) {
    return cuda_check(cudaStreamBeginCapture(stream, cudaStreamCaptureModeThreadLocal), "recording a frame");
  }

  /// Ends the capture after an error and drops it.
  static void abandon(cudaStream_t stream) {
    cudaGraph_t captured = nullptr;
    (void)cudaStreamEndCapture(stream, &captured);
    if (captured != nullptr) (void)cudaGraphDestroy(captured);
    (void)cudaGetLastError();
  }

  /// Ends the capture; launch() starts it.
  Result<void> finish(cudaStream_t stream) {
    cudaGraph_t captured = nullptr;
    if (auto done = cuda_check(cudaStreamEndCapture(stream, &captured), "recording a frame"); !done) return done;
    Result<void> updated = update(captured);
    (void)cudaGraphDestroy(captured);
    return updated;
  }

  Result<void> launch(cudaStream_t stream) { return cuda_check(cudaGraphLaunch(exec_, stream), "starting a frame"); }

 private:
  Result<void> update(cudaGraph_t captured) {
    if (exec_ != nullptr) {
      cudaGraphExecUpdateResultInfo info{};
      if (cudaGraphExecUpdate(exec_, captured, &info) == cudaSuccess) return {};
      // The graph has another shape.
      (void)cudaGetLastError();
      const cudaGraphExec_t old = exec_;
      exec_ = nullptr;
      if (auto done = cuda_check(cudaGraphExecDestroy(old), "recording a frame"); !done) return done;
    }
    return cuda_check(cudaGraphInstantiate(&exec_, captured, 0), "recording a frame");
  }

  cudaGraphExec_t exec_ = nullptr;
};

}  // namespace scree::kernels
