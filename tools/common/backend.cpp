#include "tools/common/backend.h"

#include "runtime/draw/device_scene.h"

namespace scree::tools {

Result<BackendChoice> parse_backend(const std::string& word) {
  if (word == "auto") return BackendChoice::kAuto;
  if (word == "cpu") return BackendChoice::kCpu;
  if (word == "cuda") return BackendChoice::kCuda;
  return Error{ErrorCode::kUsage, "--backend: '" + word + "' is not auto, cpu or cuda"};
}

Result<bool> wants_gpu(BackendChoice backend) {
  if (backend == BackendChoice::kCpu) return false;
  const Result<void> found = runtime::find_device();
  if (!found && backend == BackendChoice::kCuda) return found.error();
  return static_cast<bool>(found);
}

}  // namespace scree::tools
