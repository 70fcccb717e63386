#include "lab/setup/machine.h"

#include <cuda_runtime_api.h>

#include <vector>

#include "kernels/cuda/check.h"
#include "lab/setup/gpu_timer.h"

namespace scree::lab {
namespace {

using kernels::cuda_check;
using kernels::DeviceBuffer;

constexpr uint64_t kCopyBytes = uint64_t{1} << 30;

/// Bytes read and written per second by a copy inside the device's memory, in GB: the median of several copies.
Result<double> measure_copy() {
  constexpr int kCopies = 11;
  Result<DeviceBuffer> from = DeviceBuffer::allocate(kCopyBytes, "allocating memory to copy");
  if (!from) return from.error();
  Result<DeviceBuffer> to = DeviceBuffer::allocate(kCopyBytes, "allocating memory to copy to");
  if (!to) return to.error();
  if (auto done = cuda_check(cudaMemset(from->data(), 1, kCopyBytes), "clearing memory"); !done) return done.error();
  Result<GpuTimer> timer = GpuTimer::create();
  if (!timer) return timer.error();
  std::vector<float> times;
  for (int i = 0; i < kCopies; ++i) {
    Result<void> done = timer->start();
    if (done)
      done =
          cuda_check(cudaMemcpyAsync(to->data(), from->data(), kCopyBytes, cudaMemcpyDeviceToDevice), "copying memory");
    if (!done) return done.error();
    const Result<float> ms = timer->stop();
    if (!ms) return ms.error();
    times.push_back(*ms);
  }
  return 2.0 * static_cast<double>(kCopyBytes) / (summarize(times).median * 1e6);
}

}  // namespace

Result<Machine> find_machine(const runtime::Gpu& gpu) {
  const Result<double> copy = measure_copy();
  if (!copy) return copy.error();
  return Machine{bench::gpu_machine(gpu), *copy};
}

}  // namespace scree::lab
