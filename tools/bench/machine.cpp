#include "tools/bench/machine.h"

#include <cuda_runtime_api.h>

#include <fstream>
#include <string>
#include <vector>

#include "commit.h"
#include "kernels/cuda_check.h"
#include "runtime/device_scene.h"
#include "tools/bench/gpu_timer.h"

namespace scree::bench {
namespace {

using kernels::cuda_check;
using kernels::DeviceBuffer;

/// "580.159.03", or the newest CUDA the driver knows where the kernel does not tell.
std::string driver_version() {
  std::ifstream in("/sys/module/nvidia/version");
  std::string version;
  if (in >> version) return version;
  int cuda = 0;
  if (cudaDriverGetVersion(&cuda) != cudaSuccess) return "unknown";
  return "CUDA " + std::to_string(cuda / 1000) + "." + std::to_string(cuda % 1000 / 10);
}

/// Bytes read and written a second by a copy inside the device's memory, in GB: the median of several.
Result<double> measure_copy() {
  constexpr uint64_t kBytes = uint64_t{1} << 30;
  constexpr int kCopies = 11;
  Result<DeviceBuffer> from = DeviceBuffer::allocate(kBytes, "allocating memory to copy");
  if (!from) return from.error();
  Result<DeviceBuffer> to = DeviceBuffer::allocate(kBytes, "allocating memory to copy to");
  if (!to) return to.error();
  if (auto done = cuda_check(cudaMemset(from->data(), 1, kBytes), "clearing memory"); !done) return done.error();
  Result<GpuTimer> timer = GpuTimer::create();
  if (!timer) return timer.error();
  std::vector<float> times;
  for (int i = 0; i < kCopies; ++i) {
    Result<void> done = timer->start();
    if (done)
      done = cuda_check(cudaMemcpyAsync(to->data(), from->data(), kBytes, cudaMemcpyDeviceToDevice), "copying memory");
    if (!done) return done.error();
    const Result<float> ms = timer->stop();
    if (!ms) return ms.error();
    times.push_back(*ms);
  }
  return 2.0 * static_cast<double>(kBytes) / (summarize(times).median * 1e6);
}

/// A benchmark has no other backend to offer.
std::string without_advice(std::string message) {
  const size_t advice = message.find("--backend");
  if (advice == std::string::npos) return message;
  const size_t end = message.find_last_of(";,", advice);
  const size_t or_end = message.rfind(" or use ", advice);
  message.resize(or_end != std::string::npos && (end == std::string::npos || or_end > end) ? or_end
                 : end != std::string::npos                                                ? end
                                                                                           : advice);
  return message;
}

}  // namespace

Result<Machine> find_machine() {
  if (const Result<void> found = runtime::find_device(); !found)
    return Error{found.error().code, without_advice(found.error().message) + "; bench measures a GPU"};
  Machine machine;
  machine.commit = SCREE_COMMIT;
  int device = 0;
  cudaDeviceProp properties;
  Result<void> done = cuda_check(cudaGetDevice(&device), "asking for the device");
  if (done) done = cuda_check(cudaGetDeviceProperties(&properties, device), "asking the GPU what it is");
  if (!done) return done.error();
  machine.gpu = properties.name;
  machine.driver = driver_version();
  const Result<double> copy = measure_copy();
  if (!copy) return copy.error();
  machine.copy_gb_per_s = *copy;
  return machine;
}

}  // namespace scree::bench
