#include "format/geometry/word_writer.h"

#include <random>
#include <vector>

#include "tests/catch.h"

using namespace scree::format;

TEST_CASE("a word writer puts every bit in its place", "[word_writer]") {
  std::mt19937_64 random(5);
  for (int round = 0; round < 2000; ++round) {
    std::vector<uint32_t> words(400, 0xaaaaaaaau);
    uint32_t* at = words.data();
    std::vector<bool> bits;
    while (bits.size() < 6000) {
      WordWriter writer(at);
      const auto any_width = [&random] { return static_cast<uint32_t>(random() % (kMostPutBits + 1)); };
      const bool is_same = round % 2 == 0;
      const uint32_t same = any_width();
      for (uint64_t i = random() % 20; i > 0; --i) {
        const uint32_t width = is_same ? same : any_width();
        const uint64_t value = width == 0 ? 0 : random() >> (64 - width);
        writer.put(value, width);
        for (uint32_t bit = 0; bit < width; ++bit) bits.push_back((value >> bit & 1) != 0);
      }
      at = writer.end_section();
      while (bits.size() % 32 != 0) bits.push_back(false);
      REQUIRE(bits.size() / 32 == static_cast<size_t>(at - words.data()));
    }
    for (size_t i = 0; i < bits.size(); ++i)
      if ((words[i / 32] >> i % 32 & 1) != bits[i]) FAIL("bit " << i << " of round " << round);
    for (size_t i = bits.size() / 32 + kWriterSlack; i < words.size(); ++i) CHECK(words[i] == 0xaaaaaaaau);
  }
}
