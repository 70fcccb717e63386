// Split pages: joined, and the result split again.
#include "format/geometry/cluster_page.h"

#include "tests/fuzz/input.h"

namespace scree::fuzz {

void cluster_page(Bytes bytes) {
  Parameters in(bytes);
  const size_t page_bytes = in.take<uint32_t>() % (1u << 17);
  const ExactCopy split(in.rest());
  std::vector<std::byte> page(page_bytes, std::byte{0xaa});
  if (!format::join_page(split.bytes(), page)) return;
  std::vector<std::byte> again(page_bytes, std::byte{0x55});
  must(bool(format::join_page(split.bytes(), again)) && again == page, "joining writes every byte, the same each time");
}

}  // namespace scree::fuzz
