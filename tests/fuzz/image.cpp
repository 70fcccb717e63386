// A PNG, JPEG, WebP, KTX2 or DDS as a texture.
#include "runtime/images/image.h"

#include "runtime/textures/texture.h"
#include "tests/fuzz/input.h"

namespace scree::fuzz {

void image(Bytes bytes) {
  const ExactCopy copy(bytes);
  const auto info = runtime::probe_image(copy.bytes());
  // The time is proportional to the pixels. The tested functions limit the memory themselves.
  if (info && uint64_t{info->width} * info->height > 1024 * 1024 && bytes.size() > 4096) return;
  const auto checked = runtime::check_image(copy.bytes());
  const auto decoded = runtime::decode_image(copy.bytes());
  must(!checked || decoded, "an image that passes the check decodes");
  // The check unpacks every level of KTX2 and DDS, while decoding reads only the first one.
  const bool has_levels = info && info->codec == format::ImageCodec::kBlocks;
  must(checked || !decoded || has_levels, "an image that decodes passes the check");
  if (!decoded || !checked) return;
  must(bool(info), "what decodes has a head");
  must(decoded->width == info->width && decoded->height == info->height, "the head says the size");
  must(decoded->rgba.size() == size_t{4} * decoded->width * decoded->height, "a pixel is 4 bytes");
  must(decoded->warning.empty() == checked->empty(), "check and decode warn alike");
  if (uint64_t{decoded->width} * decoded->height <= 256 * 256) (void)runtime::make_mips(*decoded);
}

}  // namespace scree::fuzz
