// A Radiance picture, row by row.
#include "runtime/images/hdr.h"

#include <cmath>

#include "tests/fuzz/input.h"

namespace scree::fuzz {

void hdr(Bytes bytes) {
  const ExactCopy file(bytes);
  const auto size = runtime::read_hdr_size(file.bytes());
  // Run-length coded rows take few bytes, but the time is proportional to the pixels.
  if (size && uint64_t{size->width} * size->height > 1u << 20) return;
  uint32_t rows = 0;
  const auto read = runtime::read_hdr(file.bytes(), [&](uint32_t y, std::span<const float> row) {
    must(y == rows++ && row.size() == uint64_t{3} * size->width, "rows come in order and whole");
    for (const float value : row) must(std::isfinite(value) && value >= 0, "light is finite");
  });
  must(!read || rows == size->height, "all rows come");
  must(!read || bool(size), "what is read has a size");
}

}  // namespace scree::fuzz
