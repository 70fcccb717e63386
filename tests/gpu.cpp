#include "tests/gpu.h"

#include "runtime/device_scene.h"
#include "tests/catch.h"

namespace scree::tests {

bool has_gpu() {
  const Result<void> found = runtime::find_device();
  if (found) return true;
  CHECK(found.error().code == ErrorCode::kDevice);
  WARN("skipped: " << found.error().message);
  return false;
}

}  // namespace scree::tests
