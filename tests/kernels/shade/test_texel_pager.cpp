// Rounds of shading with pages that are loaded between them, with any amount of memory.
#include "kernels/shade/texel_pager.h"

#include <algorithm>
#include <random>
#include <set>
#include <vector>

#include "kernels/shade/texture.h"
#include "tests/results.h"

using namespace scree;
using kernels::UnfinishedTile;

namespace {

/// Pages of one byte, which is their number.
class TestPager final : public kernels::TexelPager {
 public:
  TestPager(size_t pages, size_t room) : room_(room), content_(pages) {
    for (size_t i = 0; i < pages; ++i) content_[i] = static_cast<uint8_t>(i);
    blocks_.assign(pages, nullptr);
    wanted_.assign(pages, 0);
    pages_ = {blocks_.data(), wanted_.data(), 0, false};
  }

  Result<bool> bring(bool must) override {
    if (fails) return Error{ErrorCode::kChecksum, "damaged"};
    const auto wanted = static_cast<size_t>(std::count(wanted_.begin(), wanted_.end(), pages_.round));
    if (wanted > room_ && must) return Error{ErrorCode::kMemory, "too many"};
    if (wanted > room_) return false;
    for (size_t i = 0; i < blocks_.size(); ++i) {
      const bool is_new = wanted_[i] == pages_.round && blocks_[i] == nullptr;
      if (is_new && has_patience() && brought == most_brought) continue;
      if (is_new) ++brought;
      blocks_[i] = wanted_[i] == pages_.round ? &content_[i] : nullptr;
    }
    return true;
  }
  Result<uint64_t> missing_since(uint64_t first) override {
    uint64_t count = 0;
    for (size_t i = 0; i < blocks_.size(); ++i) count += wanted_[i] >= first && blocks_[i] == nullptr ? 1 : 0;
    return count;
  }

  size_t brought = 0;
  size_t most_brought = 0;  // limit of `brought` while the picture waits for pages
  bool fails = false;

 private:
  size_t room_;
  std::vector<uint8_t> content_;
  std::vector<const uint8_t*> blocks_;
  std::vector<uint64_t> wanted_;
};

/// Pixels that need up to `most` of the pages each; neighbours need similar ones.
class TestPicture {
 public:
  TestPicture(uint32_t tiles, uint32_t pages, uint32_t most) : finished_(32 * size_t{tiles}, 0) {
    std::mt19937 random(tiles + pages + most);
    for (size_t i = 0; i < finished_.size(); ++i) {
      const size_t first = i * pages / finished_.size();
      std::vector<uint32_t>& shown = pages_.emplace_back();
      for (auto n = random() % (most + 1); n > 0; --n)
        shown.push_back(static_cast<uint32_t>((first + random() % most) % pages));
    }
  }

  Result<void> shade(kernels::TexelPager& pager) {
    const auto count = static_cast<uint32_t>(finished_.size() / 32);
    std::vector<UnfinishedTile> all(count);
    for (uint32_t i = 0; i < count; ++i) all[i] = {i, ~uint32_t{0}};
    return kernels::shade_in_rounds(
        pager, count, [&](std::span<const UnfinishedTile> tiles, UnfinishedTile* left) -> Result<uint32_t> {
          ++rounds;
          REQUIRE(tiles.size() <= count);
          uint32_t unfinished = 0;
          for (const UnfinishedTile& tile : tiles.empty() ? std::span<const UnfinishedTile>(all) : tiles) {
            uint32_t missed = 0;
            for (uint32_t bit = 0; bit < 32; ++bit) {
              if ((tile.pixels >> bit & 1) == 0) continue;
              bool is_there = true;
              for (const uint32_t page : pages_[32 * tile.tile + bit]) {
                const uint8_t* const content = kernels::want_page(pager.pages(), page);
                is_there = is_there && content != nullptr;
                if (content != nullptr) wrong += *content != page;
              }
              if (!is_there && pager.pages().takes_coarser) ++coarse;
              if (is_there || pager.pages().takes_coarser)
                ++finished_[32 * tile.tile + bit];
              else
                missed |= 1u << bit;
            }
            if (missed != 0) left[unfinished++] = {tile.tile, missed};
          }
          std::reverse(left, left + unfinished);  // in another order, as threads may list them
          return unfinished;
        });
  }

  bool is_complete(int times) const {
    return std::all_of(finished_.begin(), finished_.end(), [&](int count) { return count == times; });
  }
  size_t shown_pages() const {
    std::set<uint32_t> all;
    for (const auto& pages : pages_) all.insert(pages.begin(), pages.end());
    return all.size();
  }
  size_t most_pages() const {
    size_t most = 0;
    for (const auto& pages : pages_) most = std::max(most, std::set<uint32_t>(pages.begin(), pages.end()).size());
    return most;
  }

  size_t rounds = 0, wrong = 0;
  size_t coarse = 0;  // pixels that were finished without all of their pages

 private:
  std::vector<std::vector<uint32_t>> pages_;
  std::vector<int> finished_;
};

}  // namespace

TEST_CASE("every pixel is finished once, with any memory for pages", "[texel_pager]") {
  for (const uint32_t tiles : {1u, 7u, 200u}) {
    for (const uint32_t pages : {1u, 5u, 250u}) {
      TestPicture picture(tiles, pages, 5);
      const size_t least = picture.most_pages(), all = picture.shown_pages();
      int times = 0;
      for (size_t room = least; room <= all; room += std::max<size_t>(1, room / 2)) {
        CAPTURE(tiles, pages, room);
        TestPager pager(pages, room);
        picture.wrong = 0;
        REQUIRE(picture.shade(pager));
        CHECK(picture.is_complete(++times));
        CHECK(picture.wrong == 0);
      }
      // With room for all pages, every page is loaded once.
      TestPager pager(pages, all);
      for (const size_t rounds : {2, 1}) {
        picture.rounds = 0;
        REQUIRE(picture.shade(pager));
        CHECK(picture.is_complete(++times));
        CHECK(picture.rounds == rounds);
        CHECK(pager.brought == all);
      }
    }
  }
}

TEST_CASE("a pixel with more pages than memory is an error, and so is a bad page", "[texel_pager]") {
  TestPicture picture(20, 50, 6);
  TestPager small(50, picture.most_pages() - 1);
  CHECK(refusal(picture.shade(small)).code == ErrorCode::kMemory);
  TestPager bad(50, 50);
  bad.fails = true;
  CHECK(refusal(picture.shade(bad)).code == ErrorCode::kChecksum);
  CHECK(bad.mutex().try_lock());
  bad.mutex().unlock();
}

TEST_CASE("a picture that does not wait is finished with the present pages", "[texel_pager]") {
  TestPicture picture(40, 90, 5);
  const size_t all = picture.shown_pages();
  for (const size_t room : {picture.most_pages(), all / 2, all}) {
    CAPTURE(room);
    TestPager pager(90, room);
    int times = 0;
    for (int i = 0; i < 30; ++i) {
      pager.most_brought = pager.brought + 20;
      pager.set_patience([] { return true; });
      picture.coarse = 0;
      REQUIRE(picture.shade(pager));
      CHECK((picture.coarse == 0) == (pager.missing_bytes() == 0));
      ++times;
    }
    // With room for all pages, each picture loads some.
    if (room == all) CHECK(pager.missing_bytes() == 0);
    if (room != all) CHECK(pager.missing_bytes() != 0);
    pager.set_patience({});
    picture.coarse = 0;
    REQUIRE(picture.shade(pager));
    CHECK(picture.coarse == 0);
    CHECK(pager.missing_bytes() == 0);
    CHECK(picture.is_complete(++times));
    picture = TestPicture(40, 90, 5);
  }
}

TEST_CASE("a coarser level is sampled if a page is absent", "[texel_pager]") {
  constexpr uint32_t kSide = 64;
  std::vector<std::vector<uint8_t>> levels;
  std::mt19937 random(3);
  for (uint32_t side = kSide; side >= kSide / 4; side /= 2) {
    levels.emplace_back(size_t{side} * side);
    for (uint8_t& texel : levels.back()) texel = static_cast<uint8_t>(random());
  }
  float table[256];
  for (uint32_t i = 0; i < 256; ++i) table[i] = static_cast<float>(i);
  kernels::TextureView texture{.width = kSide,
                               .height = kSide,
                               .level_count = 3,
                               .block_level_count = 3,
                               .paged_level_count = 3,
                               .block_format = format::BlockFormat::kR8,
                               .swizzle = format::kPlainSwizzle};
  for (uint32_t level = 0; level < 3; ++level) texture.level_offset[level] = level;
  const auto sample = [&](uint32_t present, bool takes_coarser, float footprint, float& value) {
    const uint8_t* blocks[3];
    uint64_t wanted[3] = {};
    for (uint32_t level = 0; level < 3; ++level)
      blocks[level] = (present >> level & 1) != 0 ? levels[level].data() : nullptr;
    const kernels::SceneTexels texels{nullptr, {blocks, wanted, 1, takes_coarser}};
    kernels::SceneTexels::Lane lane;
    float channels[3];
    kernels::sample_texture(texels, lane, texture, table, kernels::texture_point(0.37), kernels::texture_point(0.81),
                            footprint, channels);
    value = channels[0];
    return lane.missed;
  };
  float exact[3];
  for (uint32_t level = 0; level < 3; ++level)
    CHECK_FALSE(sample(7, false, static_cast<float>(1u << 2 * level), exact[level]));
  CHECK(exact[0] != exact[1]);
  float found;
  CHECK(sample(6, false, 1, found));
  CHECK_FALSE(sample(6, true, 1, found));
  CHECK(found == exact[1]);
  CHECK_FALSE(sample(4, true, 1, found));
  CHECK(found == exact[2]);
  CHECK_FALSE(sample(5, true, 4, found));
  CHECK(found == exact[2]);
  CHECK_FALSE(sample(0, true, 1, found));
  CHECK(found == 128);  // grey
  // Between two levels, each is replaced by its own coarser level.
  CHECK_FALSE(sample(5, true, 2, found));
  CHECK(found == exact[0] + (exact[2] - exact[0]) * 0.5f);
}
