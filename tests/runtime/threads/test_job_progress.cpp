// Progress of a job that holds a lock while its listener waits for the same lock.
#include <future>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "runtime/threads/job_progress.h"
#include "runtime/threads/parallel.h"
#include "tests/results.h"

namespace scree::tests {

using runtime::JobProgress;

TEST_CASE("a relayed job never waits for its listener", "[threads]") {
  std::mutex lock;
  const std::thread::id caller = std::this_thread::get_id();
  bool is_on_caller = true;
  std::vector<std::pair<std::string, uint64_t>> heard;
  JobProgress progress([&](const char* stage, uint64_t done, uint64_t) {
    const std::lock_guard<std::mutex> held(lock);
    is_on_caller = is_on_caller && std::this_thread::get_id() == caller;
    heard.emplace_back(stage, done);
    return true;
  });
  REQUIRE(progress.relay([&]() -> Result<void> {
    const std::lock_guard<std::mutex> held(lock);
    for (const char* const stage : {"first", "second"}) {
      progress.begin(stage, 1000);
      runtime::parallel_for(1000, 3, [&](uint64_t) { (void)JobProgress::advance(&progress, 1); });
    }
    return {};
  }));
  CHECK(is_on_caller);
  // The listener got the lock when the job had ended. Then it received each stage's beginning and end.
  CHECK(heard ==
        std::vector<std::pair<std::string, uint64_t>>{{"first", 0}, {"first", 1000}, {"second", 0}, {"second", 1000}});
  progress.begin("third", 1);  // called directly again instead of relayed
  CHECK(heard.back() == std::pair<std::string, uint64_t>("third", 0));
}

TEST_CASE("a relayed job is stopped by its listener, and throws to its caller", "[threads]") {
  JobProgress progress([](const char*, uint64_t, uint64_t) { return false; });
  CHECK(refusal(progress.relay([&]() -> Result<void> {
          progress.begin("stage", 0);
          for (;;)
            if (Result<void> going = JobProgress::advance(&progress, 1); !going) return going;
        })).message == "interrupted");
  CHECK(progress.is_stopped());
  CHECK_THROWS_AS(progress.relay([]() -> Result<void> { throw std::runtime_error("job"); }), std::runtime_error);
}

TEST_CASE("a listener stops a relayed job that is already done", "[threads]") {
  std::promise<void> is_done;
  JobProgress progress([&](const char*, uint64_t, uint64_t) {
    is_done.get_future().wait();
    return false;
  });
  CHECK(refusal(progress.relay([&]() -> Result<void> {
          progress.begin("stage", 1);
          is_done.set_value();
          return {};
        })).message == "interrupted");
  CHECK(progress.is_stopped());
}

}  // namespace scree::tests
