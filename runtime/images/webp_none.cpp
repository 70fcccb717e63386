#include "runtime/images/codecs.h"
#include "runtime/images/image.h"

namespace scree::runtime {
namespace {

Error not_built() {
  return {ErrorCode::kUnsupported, "WebP: this scree is built without libwebp: convert the image to PNG first"};
}

}  // namespace

std::string webp_version() {
  return {};
}

Result<ImageInfo> probe_webp(ImageFile&) {
  return not_built();
}

Result<Image> decode_webp(ImageFile&, const ImageInfo&) {
  return not_built();
}

}  // namespace scree::runtime
