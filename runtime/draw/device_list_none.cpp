// The list of GPUs where the program is built without CUDA.
#include "runtime/draw/device_list.h"

namespace scree::runtime {
namespace {

constexpr const char* kWithoutCuda = "this program was built without CUDA";

}  // namespace

GpuList program_without_gpus() {
  return {};
}

GpuList list_gpus() {
  GpuList list;
  list.why_none = kWithoutCuda;
  return list;
}

Result<Gpu> use_gpu(std::string_view) {
  return Error{ErrorCode::kDevice, kWithoutCuda};
}

Result<Gpu> use_gpu_in_turn(uint32_t) {
  return Error{ErrorCode::kDevice, kWithoutCuda};
}

Result<std::vector<int>> gpus_from(int, uint32_t) {
  return Error{ErrorCode::kDevice, kWithoutCuda};
}

Result<Gpu> current_gpu() {
  return Error{ErrorCode::kDevice, kWithoutCuda};
}

Result<void> set_current_gpu(int) {
  return Error{ErrorCode::kDevice, kWithoutCuda};
}

KeptGpu::KeptGpu() = default;
KeptGpu::~KeptGpu() = default;

}  // namespace scree::runtime
