#include "tools/bench/setup/machine.h"

#include <cuda_runtime_api.h>

#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include "commit.h"
#include "kernels/cuda/check.h"
#include "tools/bench/setup/gpu_timer.h"

namespace scree::bench {
namespace {

using kernels::cuda_check;
using kernels::DeviceBuffer;
using kernels::PinnedBuffer;

/// "580.159.03", or the newest CUDA the driver knows where the kernel does not tell.
std::string driver_version() {
  std::ifstream in("/sys/module/nvidia/version");
  std::string version;
  if (in >> version) return version;
  int cuda = 0;
  if (cudaDriverGetVersion(&cuda) != cudaSuccess) return "unknown";
  return "CUDA " + std::to_string(cuda / 1000) + "." + std::to_string(cuda % 1000 / 10);
}

constexpr uint64_t kCopyBytes = uint64_t{1} << 30;

/// Copies of kCopyBytes a second, in GB: the median of several.
Result<double> measure_copies(void* to, const void* from, cudaMemcpyKind kind) {
  constexpr int kCopies = 11;
  Result<GpuTimer> timer = GpuTimer::create();
  if (!timer) return timer.error();
  std::vector<float> times;
  for (int i = 0; i < kCopies; ++i) {
    Result<void> done = timer->start();
    if (done) done = cuda_check(cudaMemcpyAsync(to, from, kCopyBytes, kind), "copying memory");
    if (!done) return done.error();
    const Result<float> ms = timer->stop();
    if (!ms) return ms.error();
    times.push_back(*ms);
  }
  return static_cast<double>(kCopyBytes) / (summarize(times).median * 1e6);
}

/// Bytes read and written a second by a copy inside the device's memory, in GB.
Result<double> measure_copy() {
  Result<DeviceBuffer> from = DeviceBuffer::allocate(kCopyBytes, "allocating memory to copy");
  if (!from) return from.error();
  Result<DeviceBuffer> to = DeviceBuffer::allocate(kCopyBytes, "allocating memory to copy to");
  if (!to) return to.error();
  if (auto done = cuda_check(cudaMemset(from->data(), 1, kCopyBytes), "clearing memory"); !done) return done.error();
  const Result<double> rate = measure_copies(to->data(), from->data(), cudaMemcpyDeviceToDevice);
  return rate ? Result<double>(2.0 * *rate) : rate.error();
}

}  // namespace

Result<Machine> find_machine(const runtime::Gpu& gpu) {
  Machine machine;
  machine.commit = SCREE_COMMIT;
  machine.gpu = gpu.name;
  machine.driver = driver_version();
  const Result<double> copy = measure_copy();
  if (!copy) return copy.error();
  machine.copy_gb_per_s = *copy;
  return machine;
}

Result<double> measure_link() {
  PinnedBuffer from;
  if (auto done = from.allocate(kCopyBytes, "pinning memory to copy"); !done) return done.error();
  std::memset(from.data(), 1, kCopyBytes);
  Result<DeviceBuffer> to = DeviceBuffer::allocate(kCopyBytes, "allocating memory to copy to");
  if (!to) return to.error();
  return measure_copies(to->data(), from.data(), cudaMemcpyHostToDevice);
}

}  // namespace scree::bench
