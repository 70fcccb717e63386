// A block pool compared with an array of each unit's owner.
#include "runtime/stream/block_pool.h"

#include <algorithm>
#include <map>
#include <random>
#include <vector>

#include "tests/catch.h"

using scree::runtime::BlockPool;

namespace {

constexpr uint32_t kFree = 0;

/// Checks the blocks: they cover the pool, no two neighbours are free, and each unit has the right owner.
void check_blocks(const BlockPool& pool, const std::vector<uint32_t>& owners) {
  uint64_t at = 0, free_units = 0;
  bool was_free = false;
  for (uint32_t block = pool.first(); block != BlockPool::kNone; block = pool.next(block)) {
    REQUIRE(pool.offset(block) == at);
    REQUIRE(pool.units(block) != 0);
    REQUIRE_FALSE((was_free && pool.is_free(block)));
    was_free = pool.is_free(block);
    free_units += was_free ? pool.units(block) : 0;
    const uint32_t owner = was_free ? kFree : pool.owner(block);
    REQUIRE(at + pool.units(block) <= owners.size());
    REQUIRE(std::all_of(owners.begin() + static_cast<ptrdiff_t>(at),
                        owners.begin() + static_cast<ptrdiff_t>(at + pool.units(block)),
                        [&](uint32_t unit) { return unit == owner; }));
    at += pool.units(block);
  }
  REQUIRE(at == owners.size());
  REQUIRE(free_units == pool.free_units());
}

uint64_t largest_gap(const std::vector<uint32_t>& owners) {
  uint64_t largest = 0, run = 0;
  for (const uint32_t owner : owners) {
    run = owner == kFree ? run + 1 : 0;
    largest = std::max(largest, run);
  }
  return largest;
}

}  // namespace

TEST_CASE("blocks are allocated, freed and moved together", "[residency]") {
  std::mt19937 random(11);
  uint32_t refused = 0, moves = 0;
  for (int round = 0; round < 60; ++round) {
    const uint64_t units = 1 + random() % 3000;
    const uint32_t most = 1 + static_cast<uint32_t>(random() % (random() % 2 == 0 ? 20 : 500));
    BlockPool pool;
    pool.reset(units);
    std::vector<uint32_t> owners(units, kFree);
    std::map<uint32_t, uint32_t> block_of;  // by owner
    for (uint32_t step = 1; step < 400; ++step) {
      const uint32_t action = static_cast<uint32_t>(random() % 100);
      if (action < 55) {
        const uint64_t wanted = 1 + random() % most;
        const uint64_t gap = largest_gap(owners);
        const uint32_t block = pool.take(wanted, step);
        REQUIRE((block != BlockPool::kNone) == (wanted <= gap));
        if (block == BlockPool::kNone) {
          ++refused;
          continue;
        }
        REQUIRE(pool.units(block) == wanted);
        std::fill_n(owners.begin() + static_cast<ptrdiff_t>(pool.offset(block)), wanted, step);
        block_of[step] = block;
      } else if (action < 60) {  // to any size that holds the blocks
        const auto last = std::find_if(owners.rbegin(), owners.rend(), [](uint32_t owner) { return owner != kFree; });
        const uint64_t end = static_cast<uint64_t>(owners.rend() - last);
        owners.resize(end + random() % (owners.size() - end + 100), kFree);
        pool.resize(owners.size());
        check_blocks(pool, owners);
      } else if (action < 97) {
        if (block_of.empty()) continue;
        const auto gone = std::next(block_of.begin(), static_cast<ptrdiff_t>(random() % block_of.size()));
        std::replace(owners.begin(), owners.end(), gone->first, kFree);
        pool.give_back(gone->second);
        block_of.erase(gone);
      } else {
        const uint32_t pinned = static_cast<uint32_t>(random() % 4);  // one of 4, or none
        std::vector<uint32_t> after(owners.size(), kFree);
        uint64_t end = 0;
        const auto stays = [&](uint32_t owner) { return pinned != 0 && owner % 4 == pinned; };
        pool.move_together(stays, [&](uint32_t block, uint64_t from) {
          REQUIRE(pool.offset(block) < from);
          REQUIRE_FALSE(stays(pool.owner(block)));
          ++moves;
        });
        for (uint64_t at = 0; at < owners.size();) {  // each as far to the front as the blocks before it allow
          const uint32_t owner = owners[at];
          uint64_t count = 0;
          while (at + count < owners.size() && owners[at + count] == owner) ++count;
          if (owner != kFree) {
            if (stays(owner)) end = at;
            std::fill_n(after.begin() + static_cast<ptrdiff_t>(end), count, owner);
            end += count;
          }
          at += count;
        }
        owners = after;
      }
      if (step % 10 == 0) check_blocks(pool, owners);
    }
    check_blocks(pool, owners);
    for (const auto& [owner, block] : block_of) pool.give_back(block);
    if (owners.empty()) continue;
    REQUIRE(pool.take(owners.size(), 1) == pool.first());  // one piece again
  }
  CHECK(refused > 100);
  CHECK(moves > 100);
}

TEST_CASE("blocks of any size up to 64 bits", "[residency]") {
  BlockPool pool;
  pool.reset(0);
  CHECK(pool.take(1, 0) == BlockPool::kNone);
  pool.reset(~uint64_t{0});
  const uint32_t half = pool.take(uint64_t{1} << 63, 1);
  REQUIRE(half != BlockPool::kNone);
  CHECK(pool.take(uint64_t{1} << 63, 2) == BlockPool::kNone);
  const uint32_t rest = pool.take((uint64_t{1} << 63) - 1, 3);
  REQUIRE(rest != BlockPool::kNone);
  CHECK(pool.offset(rest) == uint64_t{1} << 63);
  CHECK(pool.free_units() == 0);
}
