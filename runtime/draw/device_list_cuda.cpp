// The list of GPUs where the program is built with CUDA; device_list_none.cpp stands in elsewhere.
#include <cuda_runtime_api.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <span>
#include <utility>

#include "kernels/cuda/common/check.h"
#include "runtime/draw/device_list.h"
#include "runtime/draw/device_probe.h"

namespace scree::runtime {
namespace {

using kernels::cuda_check;

// The kernels' least compute capability (cmake/cuda.cmake has the architectures that they are built for).
constexpr int kLeastMajor = 7;
constexpr int kLeastMinor = 5;

std::string driver_release() {
  std::ifstream in("/sys/module/nvidia/version");
  std::string version;
  in >> version;
  return version;
}

/// The newest CUDA that the driver runs, such as 13000; 0 if there is no driver.
int driver_cuda_version() {
  int version = 0;
  if (cudaDriverGetVersion(&version) != cudaSuccess) return 0;
  return version;
}

std::string capability_name(const Gpu& gpu) {
  return std::to_string(gpu.major) + "." + std::to_string(gpu.minor);
}

/// The number of GPUs. Errors kDevice: CUDA does not start or has no device.
Result<int> count_gpus() {
  int count = 0;
  const cudaError_t status = cudaGetDeviceCount(&count);
  if (status == cudaErrorInsufficientDriver) {
    (void)cudaGetLastError();
    const int found = driver_cuda_version();
    if (found == 0) return Error{ErrorCode::kDevice, "no NVIDIA driver found"};
    const std::string release = driver_release();
    return Error{ErrorCode::kDevice, "the NVIDIA driver" + (release.empty() ? "" : " " + release) +
                                         " is too old: it runs CUDA up to " + cuda_version_name(found) +
                                         ", this program needs " + cuda_version_name(CUDART_VERSION / 1000 * 1000)};
  }
  if (status == cudaErrorNoDevice || (status == cudaSuccess && count == 0)) {
    (void)cudaGetLastError();
    const char* const visible = std::getenv("CUDA_VISIBLE_DEVICES");
    return Error{ErrorCode::kDevice,
                 std::string("no NVIDIA GPU found") +
                     (visible != nullptr ? " (CUDA_VISIBLE_DEVICES is '" + std::string(visible) + "')" : "")};
  }
  SCREE_TRY(cuda_check(status, "looking for a GPU"));
  return count;
}

/// Describes a GPU without making a context. A GPU that CUDA cannot describe is not usable.
Gpu describe_gpu(int index) {
  Gpu gpu;
  gpu.index = index;
  cudaDeviceProp properties;
  if (const auto read = cuda_check(cudaGetDeviceProperties(&properties, index), "reading the GPU's properties");
      !read) {
    gpu.why_unusable = read.error().message;
    return gpu;
  }
  gpu.name = properties.name;
  gpu.uuid = uuid_name(std::as_bytes(std::span(properties.uuid.bytes)));
  gpu.major = properties.major;
  gpu.minor = properties.minor;
  gpu.total_bytes = properties.totalGlobalMem;
  return gpu;
}

/// Makes `gpu` the current device. Fills in why_unusable if the GPU cannot draw.
void make_current(Gpu& gpu) {
  if (!gpu.is_usable()) return;
  const std::string which = gpu.name + " (GPU " + std::to_string(gpu.index) + ")";
  if (std::pair(gpu.major, gpu.minor) < std::pair(kLeastMajor, kLeastMinor)) {
    gpu.why_unusable = which + " has compute capability " + capability_name(gpu) + ", this program needs " +
                       std::to_string(kLeastMajor) + "." + std::to_string(kLeastMinor);
    return;
  }
  if (Result<void> done = cuda_check(cudaSetDevice(gpu.index), "choosing the GPU"); !done) {
    gpu.why_unusable = which + ": " + done.error().message;
    return;
  }
  const cudaError_t status = probe_kernel();
  if (status == cudaErrorNoKernelImageForDevice || status == cudaErrorInvalidDeviceFunction ||
      status == cudaErrorUnsupportedPtxVersion) {
    (void)cudaGetLastError();
    gpu.why_unusable = "this program has no code for " + which + ": built for " + program_without_gpus().code_for +
                       "; this GPU is " + capability_name(gpu);
    return;
  }
  if (Result<void> done = cuda_check(status, "looking for a kernel"); !done)
    gpu.why_unusable = which + ": " + done.error().message;
}

Result<Gpu> usable(Gpu gpu) {
  if (!gpu.is_usable()) return Error{ErrorCode::kDevice, gpu.why_unusable};
  return gpu;
}

}  // namespace

GpuList program_without_gpus() {
  GpuList list;
  list.program_cuda = CUDART_VERSION;
  list.code_for = architecture_names(SCREE_CUDA_ARCHITECTURES);
  return list;
}

GpuList list_gpus() {
  GpuList list = program_without_gpus();
  list.driver = driver_release();
  list.driver_cuda = driver_cuda_version();
  const Result<int> count = count_gpus();
  if (!count) {
    list.why_none = count.error().message;
    return list;
  }
  const KeptGpu kept;
  for (int i = 0; i < *count; ++i) {
    Gpu gpu = describe_gpu(i);
    make_current(gpu);
    size_t free_bytes = 0;
    size_t total_bytes = 0;
    if (gpu.is_usable()) {
      if (Result<void> done = cuda_check(cudaMemGetInfo(&free_bytes, &total_bytes), "reading free device memory");
          !done)
        gpu.why_unusable = done.error().message;
      gpu.free_bytes = free_bytes;
    }
    list.gpus.push_back(std::move(gpu));
  }
  return list;
}

Result<Gpu> use_gpu(std::string_view which) {
  const int count = SCREE_TRY(count_gpus());
  std::vector<Gpu> gpus;
  for (int i = 0; i < count; ++i) {
    gpus.push_back(describe_gpu(i));
    if (!which.empty()) continue;
    make_current(gpus.back());
    if (gpus.back().is_usable()) return gpus.back();
  }
  if (which.empty()) return usable(gpus.front());
  Gpu found = SCREE_TRY(find_gpu(gpus, which));
  make_current(found);
  return usable(std::move(found));
}

Result<Gpu> use_gpu_in_turn(uint32_t number) {
  const int count = SCREE_TRY(count_gpus());
  Gpu gpu;
  for (int step = 0; step < count; ++step) {
    gpu = describe_gpu((static_cast<int>(number % static_cast<uint32_t>(count)) + step) % count);
    make_current(gpu);
    if (gpu.is_usable()) break;
  }
  return usable(std::move(gpu));
}

Result<std::vector<int>> gpus_from(int first, uint32_t count) {
  const int all = SCREE_TRY(count_gpus());
  std::vector<int> found{first};
  const uint32_t most = std::min(count, kMostGpus);
  for (int step = 1; step < all && found.size() < most; ++step) {
    Gpu gpu = describe_gpu((first + step) % all);
    make_current(gpu);
    if (gpu.is_usable()) found.push_back(gpu.index);
  }
  SCREE_TRY(set_current_gpu(first));
  if (count != kAllGpus && found.size() < count)
    return Error{ErrorCode::kDevice, std::to_string(count) + " GPUs were requested, but only " +
                                         std::to_string(found.size()) + " can be used"};
  return found;
}

Result<Gpu> current_gpu() {
  SCREE_TRY(count_gpus());
  int index = 0;
  SCREE_TRY(cuda_check(cudaGetDevice(&index), "reading the current GPU"));
  Gpu gpu = describe_gpu(index);
  make_current(gpu);
  return usable(std::move(gpu));
}

Result<void> set_current_gpu(int index) {
  return cuda_check(cudaSetDevice(index), "choosing the GPU");
}

KeptGpu::KeptGpu() {
  if (cudaGetDevice(&index_) == cudaSuccess) return;
  (void)cudaGetLastError();  // no driver
  index_ = -1;
}

KeptGpu::~KeptGpu() {
  // cudaSetDevice() makes a context, so it is called only if there is a device to restore.
  int index = -1;
  if (index_ >= 0 && (cudaGetDevice(&index) != cudaSuccess || index != index_)) (void)cudaSetDevice(index_);
}

}  // namespace scree::runtime
