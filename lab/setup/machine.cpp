#include "lab/setup/machine.h"

#include <cuda_runtime_api.h>

#include <vector>

#include "kernels/cuda/common/check.h"
#include "lab/setup/gpu_timer.h"

namespace scree::lab {
namespace {

using kernels::cuda_check;
using kernels::DeviceBuffer;

constexpr uint64_t kCopyBytes = uint64_t{1} << 30;

/// Bytes read and written per second by a copy inside the device's memory, in GB: the median of several copies.
Result<double> measure_copy() {
  constexpr int kCopies = 11;
  DeviceBuffer from = SCREE_TRY(DeviceBuffer::allocate(kCopyBytes, "allocating memory to copy"));
  DeviceBuffer to = SCREE_TRY(DeviceBuffer::allocate(kCopyBytes, "allocating memory to copy to"));
  SCREE_TRY(cuda_check(cudaMemset(from.data(), 1, kCopyBytes), "clearing memory"));
  GpuTimer timer = SCREE_TRY(GpuTimer::create());
  std::vector<float> times;
  for (int i = 0; i < kCopies; ++i) {
    Result<void> done = timer.start();
    if (done)
      done =
          cuda_check(cudaMemcpyAsync(to.data(), from.data(), kCopyBytes, cudaMemcpyDeviceToDevice), "copying memory");
    if (!done) return done.error();
    times.push_back(SCREE_TRY(timer.stop()));
  }
  return 2.0 * static_cast<double>(kCopyBytes) / (summarize(times).median * 1e6);
}

}  // namespace

Result<Machine> find_machine(const runtime::Gpu& gpu) {
  const double copy = SCREE_TRY(measure_copy());
  return Machine{bench::gpu_machine(gpu), copy};
}

}  // namespace scree::lab
