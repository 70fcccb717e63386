#include "tests/gpu.h"

#include <cstdlib>
#include <vector>

#include "runtime/draw/device_list.h"
#include "tests/catch.h"

namespace scree::tests {

bool has_gpu() {
  const Result<runtime::Gpu> found = runtime::use_gpu();
  if (found) return true;
  CHECK(found.error().code == ErrorCode::kDevice);
  WARN("skipped: " << found.error().message);
  return false;
}

EmulatedGpus::EmulatedGpus([[maybe_unused]] const char* list) {
#if defined(SCREE_EMULATED_CUDA)
  setenv("SCREE_EMULATED_GPU", list, 1);
#endif
}

EmulatedGpus::~EmulatedGpus() {
#if defined(SCREE_EMULATED_CUDA)
  setenv("SCREE_EMULATED_GPU", "1", 1);
#endif
}

bool has_gpus(uint32_t count) {
  const Result<runtime::Gpu> first = runtime::use_gpu();
  const Result<std::vector<int>> gpus =
      first ? runtime::gpus_from(first->index, count) : Result<std::vector<int>>(first.error());
  if (!gpus) WARN("skipped: " << gpus.error().message);
  return static_cast<bool>(gpus);
}

uint64_t least_device_memory(const std::string& refusal) {
  const std::string before = "takes at least ";
  INFO(refusal);
  const size_t at = refusal.find(before);
  REQUIRE(at != std::string::npos);
  return std::stoull(refusal.substr(at + before.size()));
}

}  // namespace scree::tests
