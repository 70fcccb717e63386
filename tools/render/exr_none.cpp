// OpenEXR pictures in a program that is built without OpenEXR.
#include "tools/render/exr.h"

namespace scree::tools {

Result<void> check_exr_support() {
  return Error{ErrorCode::kUnsupported,
               "this program was built without OpenEXR, which .exr files need (libopenexr-dev; scripts/setup installs "
               "it, then build again)"};
}

Result<void> write_exr(const std::string&, uint32_t, uint32_t, std::span<const ExrChannel>, format::Existing) {
  return check_exr_support();
}

}  // namespace scree::tools
