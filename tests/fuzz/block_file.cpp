// A KTX2 or DDS file: its header, every level, every pixel.
#include "runtime/images/block_file.h"

#include <algorithm>

#include "format/blocks/format.h"
#include "tests/fuzz/input.h"

namespace scree::fuzz {

void block_file(Bytes bytes) {
  const ExactCopy copy(bytes);
  runtime::ImageFile file(copy.bytes());
  if (!runtime::is_block_file(file)) return;
  auto head = runtime::open_block_file(file);
  if (!head) return;
  must(format::is_block_format(head->format) && format::is_swizzle(head->swizzle), "a format that there is");
  must(!head->levels.empty() && head->levels.size() <= format::most_block_levels(head->width, head->height) + 1,
       "no more levels than there can be");
  // The time is proportional to the pixels.
  if (uint64_t{head->width} * head->height > 512 * 512) return;
  for (uint32_t l = 0; l < head->levels.size(); ++l) {
    const uint32_t width = std::max(1u, head->width >> l), height = std::max(1u, head->height >> l);
    const auto blocks = runtime::read_block_level(file, *head, l);
    if (!blocks) continue;
    must(blocks->size() == format::block_level_bytes(head->format, width, height), "a level has its blocks");
    const runtime::Image image =
        runtime::decode_block_level(head->format, head->swizzle, width, height, blocks->data());
    must(image.rgba.size() == size_t{4} * width * height, "a pixel is 4 bytes");
  }
}

}  // namespace scree::fuzz
