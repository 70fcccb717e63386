#include "tools/gltf/draco/source.h"

namespace scree::convert {

std::string draco_version() {
  return {};
}

Result<void> decode_draco(const DracoPrimitive&, std::span<const std::byte>, std::span<std::byte>) {
  return Error{ErrorCode::kUnsupported, "this scree is built without libdraco"};
}

}  // namespace scree::convert
