// The list of emulated GPUs, their properties, and errors.
#include "tests/emulator/runtime.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <sstream>
#include <string>

namespace scree::emulator {
namespace {

thread_local cudaError_t last_error = cudaSuccess;
constexpr int kLeastMajor = 8;  // kernels have no code for older GPUs

/// The GPUs listed in SCREE_EMULATED_GPU.
std::vector<Gpu> listed_gpus() {
  const char* const text = std::getenv("SCREE_EMULATED_GPU");
  if (text == nullptr) return {};
  std::vector<Gpu> gpus;
  std::istringstream items(text);
  for (std::string item; std::getline(items, item, ',');) {
    Gpu gpu;
    unsigned long long mebibytes = 0;
    const int read = std::sscanf(item.c_str(), "%d.%d:%llu", &gpu.major, &gpu.minor, &mebibytes);
    if (read < 2) gpu = {};
    if (read == 3) gpu.bytes = static_cast<size_t>(mebibytes) << 20;
    gpus.push_back(gpu);
  }
  return gpus;
}

int driver_version() {
  const char* const text = std::getenv("SCREE_EMULATED_DRIVER");
  return text != nullptr ? std::atoi(text) : CUDART_VERSION;
}

}  // namespace

std::optional<Gpu> listed_gpu(int number) {
  const std::vector<Gpu> gpus = listed_gpus();
  return number >= 0 && static_cast<size_t>(number) < gpus.size() ? std::optional(gpus[number]) : std::nullopt;
}

Device& device() {
  static Device* const made = new Device;  // never freed, for code that runs at exit
  return *made;
}

cudaError_t failed(cudaError_t error) {
  last_error = error;
  return error;
}

}  // namespace scree::emulator

using namespace scree::emulator;

extern "C" {

/// A function that kernels call, and that glibc's math.h declares but does not export.
float __log2f(float value) noexcept {
  return std::log2(value);
}

cudaError_t cudaGetDeviceCount(int* count) {
  if (driver_version() / 1000 < CUDART_VERSION / 1000) return failed(cudaErrorInsufficientDriver);
  *count = static_cast<int>(listed_gpus().size());
  return *count != 0 ? cudaSuccess : failed(cudaErrorNoDevice);
}
cudaError_t cudaGetDevice(int* number) {
  *number = current_gpu;
  return cudaSuccess;
}
cudaError_t cudaSetDevice(int number) {
  if (number < 0 || static_cast<size_t>(number) >= std::max<size_t>(listed_gpus().size(), 1))
    return failed(cudaErrorInvalidDevice);
  current_gpu = number;
  return cudaSuccess;
}
cudaError_t cudaGetDeviceProperties(cudaDeviceProp* out, int number) {
  const std::optional<Gpu> gpu = listed_gpu(number);
  if (!gpu) return failed(cudaErrorInvalidDevice);
  *out = cudaDeviceProp{};
  std::snprintf(out->name, sizeof out->name, "emulated GPU");
  out->major = gpu->major;
  out->minor = gpu->minor;
  out->totalGlobalMem = gpu->bytes;
  for (size_t i = 0; i < sizeof out->uuid.bytes; ++i) out->uuid.bytes[i] = static_cast<char>(0xe0 + number);
  out->multiProcessorCount = kMultiprocessors;
  out->warpSize = static_cast<int>(kWarpLanes);
  out->sharedMemPerBlock = kUnaskedSharedBytes;
  out->sharedMemPerBlockOptin = kSharedBytes;
  return cudaSuccess;
}
cudaError_t cudaDeviceGetAttribute(int* value, cudaDeviceAttr attribute, int) {
  switch (attribute) {
    case cudaDevAttrMultiProcessorCount:
      *value = kMultiprocessors;
      return cudaSuccess;
    case cudaDevAttrMaxThreadsPerMultiProcessor:
      *value = kMultiprocessorThreads;
      return cudaSuccess;
    default:
      return failed(cudaErrorInvalidValue);
  }
}
cudaError_t cudaDriverGetVersion(int* version) {
  *version = driver_version();
  return cudaSuccess;
}

cudaError_t cudaDeviceSynchronize() {
  const std::lock_guard lock(device().mutex);
  finish(current_gpu);
  return cudaSuccess;
}

/// GPUs of one kind read each other's memory.
cudaError_t cudaDeviceCanAccessPeer(int* can, int number, int peer) {
  const std::optional<Gpu> gpu = listed_gpu(number), other = listed_gpu(peer);
  if (!gpu || !other) return failed(cudaErrorInvalidDevice);
  *can = number != peer && gpu->major == other->major && gpu->minor == other->minor ? 1 : 0;
  return cudaSuccess;
}
cudaError_t cudaDeviceEnablePeerAccess(int peer, unsigned) {
  const std::lock_guard lock(device().mutex);
  int can = 0;
  if (const cudaError_t status = cudaDeviceCanAccessPeer(&can, current_gpu, peer); status != cudaSuccess) return status;
  if (can == 0) return failed(cudaErrorPeerAccessUnsupported);
  return device().peers.emplace(current_gpu, peer).second ? cudaSuccess : failed(cudaErrorPeerAccessAlreadyEnabled);
}

cudaError_t cudaFuncGetAttributes(cudaFuncAttributes* out, const void*) {
  *out = {};
  return listed_gpu(current_gpu).value_or(Gpu{}).major < kLeastMajor ? failed(cudaErrorNoKernelImageForDevice)
                                                                     : cudaSuccess;
}
cudaError_t cudaGetLastError() {
  return std::exchange(last_error, cudaSuccess);
}
const char* cudaGetErrorName(cudaError_t error) {
  return cudaGetErrorString(error);
}
const char* cudaGetErrorString(cudaError_t error) {
  switch (error) {
    case cudaSuccess:
      return "no error";
    case cudaErrorMemoryAllocation:
      return "out of memory";
    case cudaErrorInvalidConfiguration:
      return "invalid configuration argument";
    case cudaErrorInvalidValue:
      return "invalid argument";
    default:
      return "an error of the emulated GPU";
  }
}

}  // extern "C"
