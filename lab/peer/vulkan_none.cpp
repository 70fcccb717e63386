// Replaces the other files of this folder in a build without Vulkan's headers or glslangValidator: there is no peer.
#include "lab/peer/peer.h"

namespace scree::lab {

Result<std::unique_ptr<Peer>> open_vulkan_peer(const std::string&) {
  return Error{ErrorCode::kDevice,
               "built without Vulkan; 'scripts/setup peer' installs what it needs (libvulkan-dev, glslang-tools)"};
}

}  // namespace scree::lab
