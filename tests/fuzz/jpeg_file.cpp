// A JPEG file as convert handles it: parsed, indexed (transcoded or encoded again if needed), its mip levels made, and
// everything decoded again.
#include "tools/convert/images/jpeg_file.h"

#include "format/jpeg/index.h"
#include "format/jpeg/parse.h"
#include "format/jpeg/picture.h"
#include "tests/fuzz/input.h"
#include "tools/convert/images/jpeg_levels.h"

namespace scree::fuzz {

void jpeg_file(Bytes bytes) {
  const ExactCopy copy(bytes);
  const auto header = format::parse_jpeg(copy.bytes());
  if (!header) return;
  // The time is proportional to the pixels. A file of 512 bytes that states more than 512 x 512 is refused at once,
  // because each block takes a bit. Arithmetic coding has no such limit.
  constexpr uint64_t kMostPixels = 512 * 512;
  const bool may_take_long = header->is_arithmetic || bytes.size() > kMostPixels / 512;
  if (uint64_t{header->width} * header->height > kMostPixels && may_take_long) return;
  const auto indexed = convert::index_jpeg(copy.bytes());
  if (!indexed) return;
  const ExactCopy file(indexed->bytes);
  const auto index = format::open_jpeg_index(file.bytes());
  must(bool(index), "what index_jpeg makes can be opened");
  must(index->width == header->width && index->height == header->height, "the size is kept");
  must(bool(format::decode_jpeg_rows(*index, [](uint32_t, std::span<const uint8_t>) {})), "what was indexed decodes");
  const auto levels = convert::make_jpeg_levels(*index);
  must(bool(levels), "mip levels of what was indexed can be made");
  for (const std::vector<std::byte>& level : *levels)
    must(bool(format::open_jpeg_index(level)), "a level can be opened");
}

}  // namespace scree::fuzz
