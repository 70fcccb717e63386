// Workers that share one loop after another run each item of each loop once, and survive exceptions of a loop.
#include "runtime/threads/workers.h"

#include <atomic>
#include <chrono>
#include <set>
#include <stdexcept>
#include <thread>
#include <vector>

#include "tests/catch.h"

using scree::runtime::Workers;

TEST_CASE("workers run each item of each loop once") {
  const uint32_t threads = GENERATE(1u, 2u, 5u);
  const int spin = GENERATE(0, 20, 100000);  // microseconds: none, too short, and long
  Workers workers(threads, std::chrono::microseconds(spin));
  CHECK(workers.count() == threads);
  for (uint64_t loop = 0; loop < 500; ++loop) {
    const uint64_t count = loop % 7 == 0 ? 0 : loop % 5 == 0 ? 1 : loop;
    std::vector<std::atomic<uint32_t>> done(count);
    workers.for_each(count, [&](uint64_t i) { ++done[i]; });
    // When it returns, all threads have finished all items.
    uint64_t once = 0;
    for (const std::atomic<uint32_t>& times : done) once += times == 1;
    REQUIRE(once == count);
  }
}

TEST_CASE("workers share a loop, even after a loop of one item") {
  Workers workers(3, std::chrono::microseconds(GENERATE(0, 1000)));
  std::mutex mutex;
  std::set<std::thread::id> ids;
  const std::thread::id caller = std::this_thread::get_id();
  workers.for_each(1, [&](uint64_t) { CHECK(std::this_thread::get_id() == caller); });
  // Each item waits until all have begun, so no thread can do the work of another.
  std::atomic<uint32_t> begun{0};
  workers.for_each(3, [&](uint64_t) {
    ++begun;
    while (begun < 3) std::this_thread::yield();
    const std::lock_guard lock(mutex);
    ids.insert(std::this_thread::get_id());
  });
  CHECK(ids.size() == 3);
}

TEST_CASE("loops of several threads run one after the other") {
  Workers workers(3);
  std::atomic<uint32_t> running{0}, mixed{0}, done{0};  // running loops; items with two; all items
  std::vector<std::thread> callers;
  for (uint32_t caller = 0; caller < 4; ++caller)
    callers.emplace_back([&, caller] {
      for (int loop = 0; loop < 100; ++loop)
        workers.for_each(20, [&](uint64_t) {
          const uint32_t before = running.fetch_or(1u << caller);
          if ((before & ~(1u << caller)) != 0) ++mixed;
          if (++done % 20 == 0) running = 0;
        });
    });
  for (std::thread& caller : callers) caller.join();
  CHECK(done == 4 * 100 * 20);
  CHECK(mixed == 0);
}

TEST_CASE("an exception ends a loop early, and the workers stay usable") {
  Workers workers(4);
  for (int round = 0; round < 50; ++round) {
    std::atomic<uint64_t> done{0};
    const auto body = [&](uint64_t i) {
      ++done;
      if (i == 10) throw std::runtime_error("ten");
    };
    CHECK_THROWS_AS(workers.for_each(1u << 30, body), std::runtime_error);
    CHECK(done < 1u << 30);
    std::atomic<uint64_t> then{0};
    workers.for_each(100, [&](uint64_t) { ++then; });
    CHECK(then == 100);
  }
}

TEST_CASE("workers without a loop start no thread") {
  for (int i = 0; i < 1000; ++i) const Workers workers(1000);
}
