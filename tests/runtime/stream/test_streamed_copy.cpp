// Copies past the cache write the right bytes, and no others.
#include "runtime/stream/streamed_copy.h"

#include <algorithm>
#include <vector>

#include "tests/catch.h"

TEST_CASE("copies past the cache of any size and alignment") {
  constexpr size_t kRoom = 512;
  std::vector<std::byte> source(kRoom);
  for (size_t i = 0; i < kRoom; ++i) source[i] = static_cast<std::byte>(i * 37 + i / 256 + 1);
  for (size_t from = 0; from < 17; from += 3) {
    for (size_t to = 0; to < 65; ++to) {
      for (size_t bytes = 0; bytes < 270; bytes += bytes < 140 ? 1 : 13) {
        std::vector<std::byte> copy(kRoom, std::byte{0xa5});
        std::vector<std::byte> expected = copy;
        scree::runtime::copy_past_cache(copy.data() + to, source.data() + from, bytes);
        std::copy_n(source.begin() + static_cast<ptrdiff_t>(from), bytes,
                    expected.begin() + static_cast<ptrdiff_t>(to));
        REQUIRE(copy == expected);
      }
    }
  }
}
