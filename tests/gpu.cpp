#include "tests/gpu.h"

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

uint64_t least_device_memory(const std::string& refusal) {
  const std::string before = "takes at least ";
  INFO(refusal);
  const size_t at = refusal.find(before);
  REQUIRE(at != std::string::npos);
  return std::stoull(refusal.substr(at + before.size()));
}

}  // namespace scree::tests
