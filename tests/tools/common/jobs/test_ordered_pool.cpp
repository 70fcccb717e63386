// Results come in order, the first error in that order is reported, and nothing hangs.
#include "tools/common/jobs/ordered_pool.h"

#include <atomic>
#include <chrono>
#include <mutex>
#include <thread>
#include <vector>

#include "tests/results.h"
#include "tools/common/jobs/prepare_ahead.h"

using namespace scree;
using namespace scree::convert;

namespace {

const auto kNoCost = [](uint64_t) { return uint64_t{0}; };

void pause(uint64_t i) {
  std::this_thread::sleep_for(std::chrono::microseconds(i * 7919 % 300));
}

}  // namespace

TEST_CASE("results are taken in the order of submission", "[ordered_pool]") {
  const uint32_t threads = GENERATE(1u, 2u, 5u);
  WorkerPool pool(threads, nullptr);
  std::vector<uint64_t> taken;
  const auto work = [&](uint64_t i, uint32_t worker) -> Result<uint64_t> {
    if (worker >= threads) return Error{ErrorCode::kRange, "worker"};
    pause(i);
    return i * i;
  };
  const auto take = [&](uint64_t i, uint64_t result) -> Result<void> {
    if (result != i * i) return Error{ErrorCode::kRange, "order"};
    taken.push_back(i);
    return {};
  };
  CHECK(run_ordered<uint64_t>(pool, 200, {3 * threads, UINT64_MAX}, work, kNoCost, take));
  REQUIRE(taken.size() == 200);
  for (uint64_t i = 0; i < 200; ++i) CHECK(taken[i] == i);
  CHECK(run_ordered<uint64_t>(pool, 0, {1, 0}, work, kNoCost, take));
}

TEST_CASE("the first error in order is returned, whichever thread was faster", "[ordered_pool]") {
  for (const uint32_t threads : {1u, 2u, 8u}) {
    for (int round = 0; round < 10; ++round) {
      WorkerPool pool(threads, nullptr);
      std::vector<char> local(100);  // a job that outlived run_ordered would write here
      const auto work = [&](uint64_t i, uint32_t) -> Result<int> {
        if (i == 20) std::this_thread::sleep_for(std::chrono::milliseconds(2));
        local[i] = 1;
        if (i >= 20) return Error{ErrorCode::kRange, "job " + std::to_string(i)};
        return 0;
      };
      uint64_t taken = 0;
      const auto take = [&](uint64_t, int) -> Result<void> {
        ++taken;
        return {};
      };
      CHECK(refusal(run_ordered<int>(pool, 100, {3 * threads, UINT64_MAX}, work, kNoCost, take)).message == "job 20");
      CHECK(taken == 20);
    }
  }
}

TEST_CASE("an error of the consumer ends the run", "[ordered_pool]") {
  WorkerPool pool(3, nullptr);
  const auto work = [](uint64_t i, uint32_t) -> Result<uint64_t> { return i; };
  const auto take = [](uint64_t i, uint64_t) -> Result<void> {
    if (i == 5) return Error{ErrorCode::kFile, "disk full"};
    return {};
  };
  CHECK(refusal(run_ordered<uint64_t>(pool, 1000, {9, UINT64_MAX}, work, kNoCost, take)).message == "disk full");
}

TEST_CASE("jobs in flight stay within the limit, which is at least one", "[ordered_pool]") {
  WorkerPool pool(4, nullptr);
  std::atomic<int> started{0};
  uint64_t taken = 0;
  int most = 0;
  const auto work = [&](uint64_t, uint32_t) -> Result<int> { return ++started; };
  const auto take = [&](uint64_t, int) -> Result<void> {
    most = std::max(most, started.load() - static_cast<int>(taken));
    ++taken;
    return {};
  };
  SECTION("by number") {
    CHECK(run_ordered<int>(pool, 100, {3, UINT64_MAX}, work, kNoCost, take));
    CHECK(most <= 3);
  }
  SECTION("by cost") {
    const auto cost = [](uint64_t i) { return i % 10 == 9 ? uint64_t{1000} : uint64_t{50}; };  // 1000 exceeds the limit
    CHECK(run_ordered<int>(pool, 100, {50, 100}, work, cost, take));
    CHECK(most <= 2);
  }
  CHECK(taken == 100);
}

TEST_CASE("an exception of a job is an error", "[ordered_pool]") {
  WorkerPool pool(2, nullptr);
  const auto work = [](uint64_t i, uint32_t) -> Result<int> {
    if (i == 3) throw std::bad_alloc();
    return 0;
  };
  const auto take = [](uint64_t, int) -> Result<void> { return {}; };
  CHECK(refusal(run_ordered<int>(pool, 10, {4, UINT64_MAX}, work, kNoCost, take)).code == ErrorCode::kMemory);
}

TEST_CASE("a raised stop flag ends the wait", "[ordered_pool]") {
  std::atomic<bool> stop{false};
  WorkerPool pool(2, &stop);
  const auto work = [&](uint64_t i, uint32_t) -> Result<int> {
    if (i == 4) stop = true;
    return 0;
  };
  const auto take = [](uint64_t, int) -> Result<void> {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return {};
  };
  CHECK(refusal(run_ordered<int>(pool, 100000, {6, UINT64_MAX}, work, kNoCost, take)).message == "interrupted");
}

TEST_CASE("a result that takes less memory than its job makes room before it is taken", "[ordered_pool]") {
  struct Small {
    uint64_t held_bytes() const { return 5; }
  };
  WorkerPool pool(2, nullptr);
  std::atomic<int> later{0};
  const auto work = [&](uint64_t i, uint32_t) -> Result<Small> {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    if (i > 0) ++later;
    while (i == 0 && later < 3 && std::chrono::steady_clock::now() < end) pause(1);
    if (later < 3 && i == 0) return Error{ErrorCode::kRange, "no room"};
    return Small{};
  };
  const auto cost = [](uint64_t i) { return i == 0 ? uint64_t{30} : uint64_t{60}; };  // 0 and one other fit 100 bytes
  CHECK(run_ordered<Small>(pool, 4, {8, 100}, work, cost, [](uint64_t, Small) -> Result<void> { return {}; }));
}

TEST_CASE("items are prepared in order, a number of bytes ahead of the work", "[ordered_pool]") {
  std::mutex lock;
  std::vector<uint64_t> prepared;
  const auto wait_for = [&](const std::vector<uint64_t>& expected) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    for (;;) {
      {
        const std::lock_guard<std::mutex> hold(lock);
        if (prepared == expected || std::chrono::steady_clock::now() > end) return prepared == expected;
      }
      pause(1);
    }
  };
  const auto ten = [](uint64_t) { return uint64_t{10}; };
  const auto note = [&](uint64_t i) {
    const std::lock_guard<std::mutex> hold(lock);
    prepared.push_back(i);
  };
  PrepareAhead ahead(10, 25, ten, note);
  CHECK(wait_for({0, 1, 2}));
  ahead.begun(1);
  CHECK(wait_for({0, 1, 2, 3}));
  ahead.begun(6);  // items that another caller has begun need no preparation
  CHECK(wait_for({0, 1, 2, 3, 6, 7, 8}));
  ahead.begun(9);
  CHECK(wait_for({0, 1, 2, 3, 6, 7, 8, 9}));
}
