// The pool of chunks compared with a simulated memory, and with a direct implementation of the eviction order.
#include "runtime/stream/residency.h"

#include <algorithm>
#include <cstring>
#include <deque>
#include <numeric>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "runtime/stream/shared_room.h"
#include "tests/results.h"
#include "tests/speed.h"

using scree::ErrorCode;
using scree::Result;
using scree::runtime::Residency;
using scree::runtime::SharedRoom;

namespace {

uint64_t room_of(uint64_t bytes) {
  return std::max<uint64_t>((bytes + Residency::kAlignment - 1) / Residency::kAlignment, 1) * Residency::kAlignment;
}

/// Carries out a residency's moves and loads in a memory of 32-bit numbers, one per kAlignment bytes, and checks
/// everything that Residency promises.
class Checked {
 public:
  Checked(uint64_t pool_bytes, std::vector<uint64_t> chunk_bytes)
      : chunk_bytes_(std::move(chunk_bytes)),
        last_sights_(chunk_bytes_.size()),
        units_(pool_bytes / Residency::kAlignment) {
    residency_.emplace(must(Residency::create(pool_bytes, chunk_bytes_)));
  }

  struct Frame {
    uint64_t loaded_bytes = 0;
    uint64_t missing_bytes = 0;  // when the frame began
    uint64_t moved = 0;
    uint32_t batches = 0;
  };

  /// `ahead`: a batch is loaded before the previous one is drawn. `hide_one_of`: the inverse of the share of the
  /// missing chunks that is dropped after each batch, and again when a batch is chosen.
  Frame frame(const std::vector<uint32_t>& visible, uint64_t batch_bytes, bool ahead, std::mt19937& random,
              uint32_t hide_one_of = 0) {
    ++number_;
    for (uint32_t rank = 0; rank < visible.size(); ++rank) last_sights_[visible[rank]] = {number_, rank};
    Frame out;
    std::set<uint32_t> to_draw(visible.begin(), visible.end());
    std::set<uint32_t> loaded;
    std::vector<std::vector<Residency::Place>> undrawn{residency_->begin_frame(visible)};
    for (const Residency::Place& place : undrawn[0]) REQUIRE(resident_.contains(place.chunk));
    for (const uint32_t chunk : residency_->missing()) out.missing_bytes += chunk_bytes_[chunk];
    REQUIRE(undrawn[0].size() + residency_->missing().size() == visible.size());
    const auto draw_oldest = [&] {
      for (const Residency::Place& place : undrawn.front()) {
        REQUIRE(holds(place));
        REQUIRE(to_draw.erase(place.chunk) == 1);
      }
      residency_->batch_drawn(undrawn.front());
      undrawn.erase(undrawn.begin());
    };
    if (!ahead) draw_oldest();
    while (!undrawn.empty() || !residency_->missing().empty()) {
      const Residency::Batch batch = load(batch_bytes, undrawn, out, [&](uint32_t chunk) {
        if (hide_one_of == 0 || random() % hide_one_of != 0) return false;
        REQUIRE(to_draw.erase(chunk) == 1);
        out.missing_bytes -= chunk_bytes_[chunk];
        return true;
      });
      for (const Residency::Place& place : batch.loads) {
        REQUIRE(loaded.insert(place.chunk).second);
        REQUIRE(to_draw.contains(place.chunk));
      }
      REQUIRE((!batch.loads.empty() || !undrawn.empty() || residency_->missing().empty()));
      if (!undrawn.empty()) draw_oldest();
      if (!batch.loads.empty()) {
        undrawn.push_back(batch.loads);
        if (!ahead) draw_oldest();
      }
      if (hide_one_of != 0) {
        std::vector<uint32_t> late;  // dropped, but needed again
        residency_->drop_missing([&](uint32_t chunk) {
          if (random() % hide_one_of != 0) return false;
          if (random() % 2 == 0) {
            late.push_back(chunk);
            return true;
          }
          to_draw.erase(chunk);
          out.missing_bytes -= chunk_bytes_[chunk];
          return true;
        });
        residency_->add_missing(late);
      }
    }
    REQUIRE(to_draw.empty());
    REQUIRE(out.loaded_bytes == out.missing_bytes);
    return out;
  }

  /// Chunks that end before the new end stay.
  void resize(uint64_t pool_bytes) {
    const auto end = static_cast<ptrdiff_t>(pool_bytes / Residency::kAlignment);
    std::set<uint32_t> beyond;  // chunks past the new end, and chunks that left traces there
    if (end < static_cast<ptrdiff_t>(units_.size()))
      for (auto unit = units_.begin() + end; unit != units_.end(); ++unit) beyond.insert(*unit - 1);
    residency_->resize(pool_bytes);
    units_.resize(static_cast<size_t>(end));
    for (auto chunk = resident_.begin(); chunk != resident_.end();) {
      const bool stays = residency_->is_resident(*chunk);
      if (!stays) REQUIRE(beyond.contains(*chunk));
      chunk = stays ? std::next(chunk) : resident_.erase(chunk);
    }
    REQUIRE(residency_->pool_bytes() == units_.size() * Residency::kAlignment);
    REQUIRE(used() + residency_->free_bytes() == units_.size() * Residency::kAlignment);
  }

  const Residency& residency() const { return *residency_; }

 private:
  struct LastSight {
    uint64_t frame = 0;
    uint32_t rank = 0;
  };

  bool holds(const Residency::Place& place) const {
    if (place.offset % Residency::kAlignment != 0 || place.bytes != chunk_bytes_[place.chunk]) return false;
    const uint64_t first = place.offset / Residency::kAlignment;
    const uint64_t count = room_of(place.bytes) / Residency::kAlignment;
    if (first + count > units_.size()) return false;
    return std::all_of(units_.begin() + static_cast<ptrdiff_t>(first),
                       units_.begin() + static_cast<ptrdiff_t>(first + count),
                       [&](uint32_t unit) { return unit == place.chunk + 1; });
  }

  uint64_t used() const {
    uint64_t bytes = 0;
    for (const uint32_t chunk : resident_) bytes += room_of(chunk_bytes_[chunk]);
    return bytes;
  }

  template <class IsDropped>
  Residency::Batch load(uint64_t batch_bytes, const std::vector<std::vector<Residency::Place>>& undrawn, Frame& frame,
                        const IsDropped& is_dropped) {
    std::set<uint32_t> pinned;
    uint64_t pinned_bytes = 0;
    for (const auto& batch : undrawn) {
      for (const Residency::Place& place : batch) {
        pinned.insert(place.chunk);
        pinned_bytes += room_of(place.bytes);
      }
    }
    std::vector<uint32_t> missing(residency_->missing().begin(), residency_->missing().end());
    const uint64_t free_before = units_.size() * Residency::kAlignment - used();
    const Residency::Batch batch = residency_->next_batch(batch_bytes, [&](uint32_t chunk) {
      REQUIRE(std::find(missing.begin(), missing.end(), chunk) != missing.end());
      if (!is_dropped(chunk)) return false;
      std::erase(missing, chunk);
      return true;
    });
    REQUIRE(residency_->missing().size() + batch.loads.size() == missing.size());
    REQUIRE(std::equal(residency_->missing().begin(), residency_->missing().end(),
                       missing.begin() + static_cast<ptrdiff_t>(batch.loads.size())));

    // The order of the evicted chunks is the promised one.
    std::vector<uint32_t> gone, kept;
    for (const uint32_t chunk : resident_) (residency_->is_resident(chunk) ? kept : gone).push_back(chunk);
    const auto before = [&](uint32_t a, uint32_t b) {
      if (last_sights_[a].frame != last_sights_[b].frame) return last_sights_[a].frame < last_sights_[b].frame;
      return last_sights_[a].rank > last_sights_[b].rank;
    };
    uint64_t gone_bytes = 0;
    for (const uint32_t chunk : gone) {
      REQUIRE_FALSE(pinned.contains(chunk));
      gone_bytes += room_of(chunk_bytes_[chunk]);
      for (const uint32_t other : kept)
        if (!pinned.contains(other)) REQUIRE(before(chunk, other));
    }
    uint64_t wanted = 0;
    size_t count = 0;
    while (count < missing.size()) {
      const uint64_t bytes = room_of(chunk_bytes_[missing[count]]);
      if (wanted + bytes > units_.size() * Residency::kAlignment - pinned_bytes) break;
      if (count != 0 && wanted + bytes > batch_bytes) break;
      wanted += bytes;
      ++count;
    }
    REQUIRE(batch.loads.size() <= count);
    if (undrawn.empty()) REQUIRE(batch.loads.size() == count);
    if (!gone.empty()) {
      const uint32_t youngest = *std::max_element(gone.begin(), gone.end(), before);
      REQUIRE(free_before + gone_bytes - room_of(chunk_bytes_[youngest]) < wanted);
    }

    for (const uint32_t chunk : gone) resident_.erase(chunk);
    for (const Residency::Move& move : batch.moves) {
      REQUIRE(move.to < move.from);
      const uint64_t units = room_of(move.bytes) / Residency::kAlignment;
      std::memmove(&units_[move.to / Residency::kAlignment], &units_[move.from / Residency::kAlignment],
                   units * sizeof(uint32_t));
      ++frame.moved;
    }
    for (size_t i = 0; i < batch.loads.size(); ++i) {
      const Residency::Place& place = batch.loads[i];
      REQUIRE(place.chunk == missing[i]);  // near chunks first
      REQUIRE(resident_.insert(place.chunk).second);
      REQUIRE(place.offset + room_of(place.bytes) <= units_.size() * Residency::kAlignment);
      const uint64_t first = place.offset / Residency::kAlignment;
      for (uint64_t u = 0; u < room_of(place.bytes) / Residency::kAlignment; ++u) units_[first + u] = place.chunk + 1;
      frame.loaded_bytes += place.bytes;
    }
    frame.batches += !batch.loads.empty();
    REQUIRE(used() + residency_->free_bytes() == units_.size() * Residency::kAlignment);
    // No undrawn resident chunk was overwritten.
    for (const auto& batch_before : undrawn)
      for (const Residency::Place& place : batch_before) REQUIRE(holds(place));
    return batch;
  }

  std::vector<uint64_t> chunk_bytes_;
  std::vector<LastSight> last_sights_;
  std::vector<uint32_t> units_;  // chunk + 1
  std::optional<Residency> residency_;
  std::set<uint32_t> resident_;
  uint64_t number_ = 0;
};

std::vector<uint32_t> some_of(uint32_t count, uint32_t most, std::mt19937& random) {
  std::vector<uint32_t> all(count);
  std::iota(all.begin(), all.end(), 0u);
  std::shuffle(all.begin(), all.end(), random);
  all.resize(std::min(count, most));
  return all;
}

}  // namespace

TEST_CASE("random frames in random pools keep the promises of Residency", "[residency]") {
  std::mt19937 random(7);
  uint64_t moved = 0;
  uint32_t reused = 0;
  for (int round = 0; round < 120; ++round) {
    const uint32_t count = 1 + static_cast<uint32_t>(random() % 60);
    std::vector<uint64_t> bytes(count);
    const bool uneven = random() % 2 == 0;
    for (uint64_t& chunk : bytes) chunk = uneven && random() % 3 == 0 ? random() % 40 : random() % 9000;
    uint64_t largest = 0, all = 0;
    for (const uint64_t chunk : bytes) {
      largest = std::max(largest, room_of(chunk));
      all += room_of(chunk);
    }
    // Pools from the smallest one to one with room for everything.
    uint64_t pool = largest + random() % (all - largest + 700) * (random() % 3) / 2;
    Checked checked(pool, bytes);
    std::vector<uint32_t> visible;
    for (int frame = 0; frame < 12; ++frame) {
      const bool still = frame % 3 == 2;  // the same chunks as before
      if (frame % 3 == 0 && random() % 2 == 0) {
        pool = largest + random() % (all - largest + 700);
        checked.resize(pool);
      }
      if (!still) visible = some_of(count, static_cast<uint32_t>(random() % (count + 1)), random);
      uint64_t needed = 0;
      for (const uint32_t chunk : visible) needed += room_of(bytes[chunk]);
      const uint64_t batch = random() % 2 == 0 ? pool / 4 : 1 + random() % pool;
      const uint32_t hide = random() % 3 == 0 && !still && frame % 3 != 1 ? 4 : 0;
      const Checked::Frame got = checked.frame(visible, batch, random() % 2 == 0, random, hide);
      moved += got.moved;
      if (still && needed <= pool / Residency::kAlignment * Residency::kAlignment) {
        REQUIRE(got.loaded_bytes == 0);
        ++reused;
      }
    }
  }
  CHECK(moved > 0);
  CHECK(reused > 20);
}

TEST_CASE("near chunks stay in a pool that is too small, far chunks are streamed", "[residency]") {
  std::mt19937 random(1);
  const uint32_t count = 40;
  Checked checked(10 * 1024, std::vector<uint64_t>(count, 1024));
  std::vector<uint32_t> visible(count);
  std::iota(visible.begin(), visible.end(), 0u);
  CHECK(checked.frame(visible, 2048, true, random).loaded_bytes == 40 * 1024);
  // Two batches of two chunks take turns. The other eight places have the nearest chunks.
  for (uint32_t chunk = 0; chunk < 6; ++chunk) CHECK(checked.residency().is_resident(chunk));
  CHECK(checked.frame(visible, 2048, true, random).loaded_bytes == 30 * 1024);
  // The chunks seen longest ago are evicted first.
  const std::vector<uint32_t> others{20, 21, 22};
  checked.frame(others, 2048, true, random);
  CHECK(checked.frame(others, 2048, true, random).loaded_bytes == 0);
}

TEST_CASE("a Residency is empty after forget()", "[residency]") {
  Residency made = must(Residency::create(4096, {1000, 1000, 3000}));
  const std::vector<uint32_t> visible{0, 1, 2};
  CHECK(made.begin_frame(visible).empty());
  CHECK(made.next_batch(4096).loads.size() == 2);
  made.forget();
  CHECK_FALSE(made.is_resident(0));
  CHECK(made.free_bytes() == 4096);
  CHECK(made.begin_frame(visible).empty());
  CHECK(made.missing().size() == 3);
}

TEST_CASE("a chunk larger than the pool is refused with the least pool size", "[residency]") {
  check_refusal(
      Residency::create(1023, {10, 1025, 7}),
      {ErrorCode::kRange, "chunk 1 takes 1025 bytes, but the pool of chunks has 768; it needs at least 1280"});
  CHECK(Residency::create(1280, {10, 1025, 7}));
  CHECK(refusal(Residency::create(~uint64_t{0}, {~uint64_t{0}})).code == ErrorCode::kRange);
  // Without chunks no memory is needed. A chunk without bytes still has its own place.
  CHECK(Residency::create(0, {}));
  CHECK_FALSE(Residency::create(0, {0}));
}

TEST_CASE("sizes above 32 bits are kept", "[residency]") {
  const uint64_t gib = uint64_t{1} << 30;
  Residency made = must(Residency::create(100 * gib, {60 * gib, 50 * gib, 30 * gib}));
  const std::vector<uint32_t> visible{0, 1, 2};
  made.begin_frame(visible);
  const Residency::Batch first = made.next_batch(~uint64_t{0});
  REQUIRE(first.loads.size() == 1);
  CHECK(first.loads[0].bytes == 60 * gib);
  CHECK(made.next_batch(~uint64_t{0}).loads.empty());
  made.batch_drawn(first.loads);
  const Residency::Batch second = made.next_batch(~uint64_t{0});
  REQUIRE(second.loads.size() == 2);
  CHECK(second.loads[1].offset + second.loads[1].bytes <= 100 * gib);
}

TEST_CASE("give_way_next() sets the order of eviction, and evicted chunks leave contiguous room", "[residency]") {
  constexpr uint64_t kUnit = Residency::kAlignment;
  constexpr uint32_t kChunks = 12;
  Residency residency = must(Residency::create(kChunks * kUnit, std::vector<uint64_t>(2 * kChunks, kUnit)));
  std::vector<uint32_t> first(kChunks);
  std::iota(first.begin(), first.end(), 0u);
  residency.begin_frame(first);
  residency.batch_drawn(residency.next_batch(kChunks * kUnit).loads);

  // The same chunks and as many new ones. Batches of four and then of two of these are loaded.
  std::vector<uint32_t> second(2 * kChunks);
  std::iota(second.begin(), second.end(), 0u);
  const std::vector<Residency::Place> there = residency.begin_frame(second);
  REQUIRE(there.size() == kChunks);
  for (size_t i = 1; i < there.size(); ++i) REQUIRE(there[i - 1].offset < there[i].offset);
  const std::span<const Residency::Place> all(there);
  residency.give_way_next(all.subspan(4, 4));
  residency.give_way_next(all.subspan(0, 4));
  residency.batch_drawn(all);
  std::set<uint64_t> taken;
  for (const uint64_t most : {4 * kUnit, 2 * kUnit, 2 * kUnit}) {
    const Residency::Batch batch = residency.next_batch(most);
    REQUIRE(batch.moves.empty());
    REQUIRE(batch.loads.size() == most / kUnit);
    for (const Residency::Place& place : batch.loads) REQUIRE(taken.insert(place.offset).second);
    if (taken.size() == 4) REQUIRE(*taken.begin() == all[4].offset);
    REQUIRE(*taken.rbegin() == all[7].offset);
    residency.batch_drawn(batch.loads);
  }
  for (uint32_t i = 8; i < kChunks; ++i) CHECK(residency.is_resident(all[i].chunk));
}

TEST_CASE("memory is divided in proportion to the bytes that a picture showed, within limits", "[residency]") {
  constexpr uint64_t kUnit = 4096;
  SharedRoom room{.bytes = 1000 * kUnit,
                  .room = 250 * kUnit,
                  .least_room = 10 * kUnit,
                  .most_room = 900 * kUnit,
                  .least_pool = 50 * kUnit};
  const auto balanced = [&](uint64_t chunks, uint64_t pages) {
    return room.balanced(chunks * kUnit, pages * kUnit, kUnit) / kUnit;
  };
  CHECK(balanced(750, 250) == 250);  // both have room
  CHECK(balanced(0, 0) == 250);
  CHECK(balanced(300, 500) == 600);  // they share the remaining memory
  CHECK(balanced(800, 100) == 150);
  CHECK(balanced(760, 245) == 250);  // the change is too small
  CHECK(balanced(1000, 3000) == 750);
  CHECK(balanced(6000, 2000) == 250);
  CHECK(balanced(20000, 100) == 10);
  CHECK(balanced(100, 20000) == 900);
  CHECK(balanced(uint64_t{1} << 50, uint64_t{1} << 50) == 500);
  room.most_room = 300 * kUnit;        // --texture-memory
  CHECK(balanced(100, 20000) == 250);  // a change to 300 is too small
  room.most_room = 2000 * kUnit;
  CHECK(balanced(0, 20000) == 950);  // a chunk needs room
  CHECK(room.within(0, kUnit) == room.least_room);
  CHECK(room.within(kUnit * 20 + 5, kUnit) == 20 * kUnit);
}

TEST_CASE("cost of choosing chunks", "[.bench][residency]") {
  // As many chunks as a quarter of scene C has, with a pool for a quarter of them.
  constexpr uint32_t kCount = 36000;
  std::mt19937 random(3);
  std::vector<uint64_t> bytes(kCount);
  for (uint64_t& chunk : bytes) chunk = 250000 + random() % 150000;
  const uint64_t pool = std::accumulate(bytes.begin(), bytes.end(), uint64_t{0}) / 4;
  Residency residency = must(Residency::create(pool, bytes));
  const auto frame = [&](const std::string& name, const std::vector<uint32_t>& visible) {
    const double start = scree::tests::cpu_seconds();
    uint64_t loaded = 0, moved = 0;
    uint32_t batches = 0;
    std::deque<std::vector<Residency::Place>> undrawn{residency.begin_frame(visible)};
    while (!undrawn.empty() || !residency.missing().empty()) {
      Residency::Batch batch = residency.next_batch(std::min(pool / 16, uint64_t{128} << 20));
      for (const Residency::Place& place : batch.loads) loaded += place.bytes;
      for (const Residency::Move& move : batch.moves) moved += move.bytes;
      batches += batch.loads.empty() ? 0 : 1;
      if (!batch.loads.empty()) undrawn.push_back(std::move(batch.loads));
      residency.batch_drawn(undrawn.front());
      undrawn.pop_front();
    }
    char line[160];
    std::snprintf(line, sizeof line, "%-24s %6.1f ms, %3u batches, %.1f GB loaded, %.1f GB moved", name.c_str(),
                  1e3 * (scree::tests::cpu_seconds() - start), batches, 1e-9 * static_cast<double>(loaded),
                  1e-9 * static_cast<double>(moved));
    WARN(line);
  };
  std::vector<uint32_t> all(kCount);
  std::iota(all.begin(), all.end(), 0u);
  frame("first", all);
  for (int i = 0; i < 3; ++i) frame("still", all);
  for (int i = 0; i < 4; ++i) frame("another random 60%", some_of(kCount, kCount * 6 / 10, random));
}
