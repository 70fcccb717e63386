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
  // The time is proportional to the pixels, whose number a header may state at will. The tested functions limit the
  // memory themselves.
  if (uint64_t{header->width} * header->height > 512 * 512 && bytes.size() > 4096) return;
  const auto indexed = runtime::index_jpeg(copy.bytes());
  if (!indexed) return;
  const ExactCopy file(indexed->bytes);
  const auto index = format::open_jpeg_index(file.bytes());
  must(bool(index), "what index_jpeg makes can be opened");
  must(index->width == header->width && index->height == header->height, "the size is kept");
  must(bool(format::decode_jpeg_rows(*index, [](uint32_t, std::span<const uint8_t>) {})), "what was indexed decodes");
  if (uint64_t{index->width} * index->height > 512 * 512) return;
  const auto levels = runtime::make_jpeg_levels(*index);
  must(bool(levels), "mip levels of what was indexed can be made");
  for (const std::vector<std::byte>& level : *levels)
    must(bool(format::open_jpeg_index(level)), "a level can be opened");
}

}  // namespace scree::fuzz
