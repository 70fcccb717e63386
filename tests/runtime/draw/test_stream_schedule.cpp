// The calls that a streamer makes to its target, for any timing of loads. The target draws nothing and records the
// calls.
#include <algorithm>
#include <deque>
#include <future>
#include <new>
#include <optional>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "runtime/scene/camera.h"
#include "runtime/stream/streamer.h"
#include "runtime/threads/job_thread.h"
#include "tests/runtime/load_scene.h"
#include "tests/runtime/paged_scene.h"

using namespace scree;
using namespace scree::runtime;
using namespace scree::tests;
using scree::kernels::ShadeOptions;
using scree::kernels::View;

namespace {

constexpr uint64_t kUnit = Residency::kAlignment;

/// A target. Each unit of its pool stores a chunk number plus one.
class Account final : public StreamTarget {
 public:
  Account(uint64_t pool_bytes, uint32_t seed) : random_(seed), pool_(pool_bytes / kUnit) {}

  /// Depth codes of the next frames, by chunk; chunks with kNotInView are not listed. `in_the_end`: the codes after the
  /// first drawn part, which decide the visible chunks.
  void set_view(std::vector<uint32_t> codes, std::vector<uint32_t> in_the_end) {
    codes_ = std::move(codes);
    in_the_end_ = std::move(in_the_end);
  }
  void fail_at(uint32_t call) { fails_at_ = call; }

  const std::set<uint32_t>& loaded() const { return loaded_; }
  /// Number of chunks that were drawn before the first and before the fourth load was started.
  size_t drawn_before_first() const { return drawn_before_.at(0); }
  size_t drawn_before_fourth() const { return drawn_before_.at(3); }

  /// Checks that all chunks of a frame are drawn; called after the frame.
  void check_all_drawn() const {
    REQUIRE(started_.empty());
    for (const uint32_t chunk : likely_seen_) REQUIRE(drawn_.contains(chunk));
    for (const uint32_t chunk : listed_)
      if (!drawn_.contains(chunk)) REQUIRE(shown_[chunk] == kNotInView);
  }

  Result<void> begin(const View&, const ShadeOptions*) override {
    loaded_.clear();
    drawn_.clear();
    likely_seen_.clear();
    drawn_before_.clear();
    return {};
  }
  Result<std::span<const uint32_t>> list() override {
    shown_ = codes_;
    listed_ = runtime::order_by_depth(codes_);
    return std::span<const uint32_t>(listed_);
  }
  Result<void> start_loading(const Residency::Batch& batch) override {
    REQUIRE(started_.size() < runtime::kMostLoads);
    for (const Residency::Place& place : batch.loads) REQUIRE(loaded_.insert(place.chunk).second);
    drawn_before_.push_back(drawn_.size());
    started_.push_back(batch);
    return call();
  }
  Result<bool> is_loaded() override {
    REQUIRE_FALSE(started_.empty());
    if (random_() % 2 == 0) carry_out();
    return carried_out_ > 0;
  }
  Result<double> finish_loading() override {
    REQUIRE_FALSE(started_.empty());
    if (carried_out_ == 0) carry_out();
    started_.pop_front();
    --carried_out_;
    if (auto done = call(); !done) return done.error();
    return 1.0;
  }
  Result<void> start_drawing(std::span<const Residency::Place> places, PartOptions options) override {
    REQUIRE(part_.empty());
    REQUIRE_FALSE(places.empty());
    part_.assign(places.begin(), places.end());
    options_ = options;
    for (const Residency::Place& place : places)
      REQUIRE(likely_seen_.contains(place.chunk) == (options.share == Share::kRest));
    check_part();
    return call();
  }
  Result<Drawn> finish_drawing() override {
    REQUIRE_FALSE(part_.empty());
    // Carries out some of the moves and loads meanwhile.
    while (carried_out_ < started_.size() && random_() % 3 != 0) carry_out();
    check_part();
    std::set<uint32_t>& drawn = options_.share == Share::kLikelySeen ? likely_seen_ : drawn_;
    for (const Residency::Place& place : part_) REQUIRE(drawn.insert(place.chunk).second);
    part_.clear();
    if (options_.finds_depths) shown_ = in_the_end_;
    if (auto done = call(); !done) return done.error();
    return Drawn{{}, 1.0};
  }
  uint32_t nearest_shown(uint32_t chunk) const override { return shown_[chunk]; }
  void stop() override {
    started_.clear();
    carried_out_ = 0;
    part_.clear();
  }

 private:
  /// Executes the oldest started batch.
  void carry_out() {
    if (carried_out_ == started_.size()) return;
    const Residency::Batch& batch = started_[carried_out_++];
    for (const Residency::Move& move : batch.moves) {
      const auto from = pool_.begin() + static_cast<ptrdiff_t>(move.from / kUnit);
      std::copy(from, from + static_cast<ptrdiff_t>((move.bytes + kUnit - 1) / kUnit),
                pool_.begin() + static_cast<ptrdiff_t>(move.to / kUnit));
    }
    for (const Residency::Place& place : batch.loads)
      for (uint64_t u = 0; u * kUnit < place.bytes; ++u) pool_[place.offset / kUnit + u] = place.chunk + 1;
  }
  void check_part() const {
    for (const Residency::Place& place : part_)
      for (uint64_t u = 0; u * kUnit < place.bytes; ++u) REQUIRE(pool_[place.offset / kUnit + u] == place.chunk + 1);
  }
  Result<void> call() {
    if (fails_at_ != 0 && --fails_at_ == 0) return Error{ErrorCode::kDevice, "told to fail"};
    return {};
  }

  std::mt19937 random_;
  std::vector<uint32_t> pool_, codes_;
  std::vector<uint32_t> in_the_end_, shown_;
  std::vector<uint32_t> listed_;
  std::deque<Residency::Batch> started_;
  size_t carried_out_ = 0;  // number of executed batches
  std::vector<Residency::Place> part_;
  PartOptions options_{};
  std::set<uint32_t> loaded_, drawn_;
  std::set<uint32_t> likely_seen_;
  std::vector<size_t> drawn_before_;  // by load: number of chunks drawn before it
  uint32_t fails_at_ = 0;
};

/// A scene of some hundred chunks, whose sizes may be set to any value.
struct Chunks {
  Chunks() {
    std::mt19937 random(3);
    std::uniform_real_distribution<double> unit(-1, 1);
    Soup soup;
    for (int i = 0; i < 2000; ++i) {
      uint32_t corner[3];
      for (uint32_t& c : corner) c = soup.add(unit(random), unit(random), unit(random));
      soup.triangle(corner[0], corner[1], corner[2]);
    }
    const PagedScene paged{.chunk_triangles = 8};
    paged.write(folder.file("chunks.scree"), {{soup, Encoding{}}});
    scene.emplace(must(Scene::open(folder.file("chunks.scree"), {.threads = 1, .pages = false})));
    view =
        must_view(*scene, {.eye = runtime::Vec3{0, 0, 5}, .target = runtime::Vec3{0, 0, 0}, .width = 16, .height = 16});
    for (uint64_t c = 0; c < scene->view().chunk_count; ++c) {
      bytes.push_back(300 + random() % 3000);
      all += bytes.back();
    }
  }

  TempFolder folder;
  std::optional<Scene> scene;
  View view{};
  std::vector<uint64_t> bytes;
  uint64_t all = 0;
};

}  // namespace

TEST_CASE("a streamer draws each visible chunk once, from its place, whenever loads finish", "[streamer]") {
  Chunks chunks;
  const auto count = static_cast<uint32_t>(chunks.bytes.size());
  REQUIRE(count > 200);
  std::mt19937 random(4);
  const auto below = [&](uint32_t most) { return static_cast<uint32_t>(random() % most); };
  uint64_t moved = 0, merged = 0;
  for (const uint64_t pool : {uint64_t{3500}, chunks.all / 10, chunks.all / 3, chunks.all / 2, 2 * chunks.all}) {
    Account account(pool, static_cast<uint32_t>(pool));
    Streamer streamer = must(Streamer::create(*chunks.scene, pool, chunks.bytes));
    std::vector<uint32_t> codes(count), in_the_end(count);
    for (int frame = 0; frame < 24; ++frame) {
      if (frame % 3 == 0) {
        for (uint32_t c = 0; c < count; ++c) {
          codes[c] = below(4) == 0 ? kNotInView : below(1000);
          in_the_end[c] = below(3) == 0 ? kNotInView : codes[c] == kNotInView ? kNotInView : codes[c] + below(9);
        }
        account.set_view(codes, in_the_end);
      }
      if (frame % 7 == 5) account.fail_at(1 + below(20));
      const Result<StreamStats> stats = streamer.draw(chunks.view, nullptr, account);
      account.fail_at(0);
      if (!stats) {
        CHECK(stats.error().code == ErrorCode::kDevice);
        continue;
      }
      account.check_all_drawn();
      REQUIRE(stats->streamed_bytes + stats->hidden_bytes == stats->missing_bytes);
      uint64_t loaded = 0, needed = 0;
      for (const uint32_t chunk : account.loaded()) {
        loaded += chunks.bytes[chunk];
        if (in_the_end[chunk] != kNotInView) needed += chunks.bytes[chunk];
      }
      REQUIRE(loaded == stats->streamed_bytes);
      REQUIRE(needed == stats->needed_bytes);
      moved += stats->moved_bytes;
      merged += stats->parts < stats->batches ? 1 : 0;
    }
  }
  CHECK(moved > 0);
  CHECK(merged > 0);
}

TEST_CASE("an ended frame draws the loads it has started, and the other chunks are loaded between frames",
          "[streamer]") {
  Chunks chunks;
  const auto count = static_cast<uint32_t>(chunks.bytes.size());
  std::mt19937 random(9);
  const auto below = [&](uint32_t most) { return static_cast<uint32_t>(random() % most); };
  uint64_t ended = 0;
  for (const uint64_t pool : {uint64_t{3500}, chunks.all / 3, 2 * chunks.all}) {
    Account account(pool, static_cast<uint32_t>(pool));
    Streamer streamer = must(Streamer::create(*chunks.scene, pool, chunks.bytes));
    std::vector<uint32_t> codes(count);
    for (int frame = 0; frame < 40; ++frame) {
      if (frame % 8 == 0) {
        for (uint32_t& code : codes) code = below(4) == 0 ? kNotInView : below(1000);
        std::vector<uint32_t> in_the_end = codes;
        for (uint32_t& code : in_the_end) code = below(3) == 0 ? kNotInView : code;
        account.set_view(codes, in_the_end);
      }
      // Every eighth frame runs to its end. Some of the others are ended before they load anything.
      uint32_t loads = frame % 8 == 7 ? UINT32_MAX : below(6);
      if (frame % 9 == 5) account.fail_at(1 + below(20));
      const Result<StreamStats> stats = streamer.draw(chunks.view, nullptr, account, [&] {
        if (loads != 0) --loads;
        return loads == 0;
      });
      account.fail_at(0);
      if (!stats) continue;
      REQUIRE(stats->streamed_bytes + stats->hidden_bytes + stats->left_bytes == stats->missing_bytes);
      ended += stats->left_bytes != 0 ? 1 : 0;
      if (stats->left_bytes == 0) account.check_all_drawn();
      if (frame % 8 == 7) REQUIRE(stats->left_bytes == 0);
      if (frame % 4 != 3) continue;
      REQUIRE(account.begin(chunks.view, nullptr));
      if (frame % 16 == 3) account.fail_at(1 + below(5));
      int calls = 0;
      const Result<Streamer::Rest> rest = streamer.load_rest(account, [&] { return ++calls == 2; });
      account.fail_at(0);
      if (!rest) continue;
      uint64_t there = rest->left_bytes;
      for (const Residency::Place& place : rest->present) there += place.bytes;
      REQUIRE(there == chunks.all);
    }
    REQUIRE(account.begin(chunks.view, nullptr));
    CHECK((must(streamer.load_rest(account)).left_bytes == 0) == (pool >= chunks.all));
  }
  CHECK(ended > 20);
}

TEST_CASE("chunks that were visible last are loaded while resident chunks are drawn, hidden ones are not",
          "[streamer]") {
  Chunks chunks;
  const auto count = static_cast<uint32_t>(chunks.bytes.size());
  std::vector<uint32_t> codes(count), in_the_end(count);
  uint64_t needed = 0;
  for (uint32_t c = 0; c < count; ++c) {
    codes[c] = c;
    in_the_end[c] = c % 3 == 2 ? kNotInView : c;
    if (c % 3 != 2) needed += chunks.bytes[c];
  }
  const uint64_t pool = needed * 2 / 3;
  Account account(pool, 1);
  account.set_view(codes, in_the_end);
  Streamer streamer = must(Streamer::create(*chunks.scene, pool, chunks.bytes));
  CHECK(must(streamer.draw(chunks.view, nullptr, account)).streamed_bytes >= needed);
  // Without an earlier frame, one batch is loaded before any depths are computed, and two while they are computed.
  CHECK(account.drawn_before_first() == 0);
  CHECK(account.drawn_before_fourth() > 0);
  for (int i = 0; i < 4; ++i) {
    const StreamStats again = must(streamer.draw(chunks.view, nullptr, account));
    account.check_all_drawn();
    for (const uint32_t chunk : account.loaded()) REQUIRE(chunk % 3 != 2);
    CHECK(again.streamed_bytes == again.needed_bytes);
    CHECK(again.streamed_bytes < needed / 2);
    // Each part makes room for one batch.
    CHECK(again.batches < 2 * runtime::kBatchShare);
    CHECK(account.drawn_before_first() < count / 10);
    CHECK(account.drawn_before_fourth() < count / 3);
  }
}

TEST_CASE("a job thread runs jobs in order and passes on their exceptions", "[streamer]") {
  std::vector<int> done;
  runtime::JobThread<int> thread;
  std::vector<std::future<int>> results;
  for (int i = 0; i < 100; ++i)
    results.push_back(thread.add([&done, i] {
      if (i == 50) throw std::bad_alloc();
      done.push_back(i);
      return 2 * i;
    }));
  thread.wait();
  CHECK(done.size() == 99);
  CHECK(std::is_sorted(done.begin(), done.end()));
  for (int i = 0; i < 100; ++i) {
    if (i == 50) {
      CHECK_THROWS_AS(results[50].get(), std::bad_alloc);
    } else {
      CHECK(results[static_cast<size_t>(i)].get() == 2 * i);
    }
  }
}
