// The stage of a conversion that is reported as the limit.
#include "tools/common/jobs/stage_rates.h"

#include <atomic>
#include <string>

#include "tests/catch.h"

namespace scree::convert {
namespace {

/// Invented rates of two threads: all stages work for the same time, and a thread does two units of work per second.
StageRates even_rates() {
  return {.measured_triangles = 300'000'000,
          .encoded_triangles = 20'000'000,
          .read_bytes = uint64_t{4} << 30,
          .written_bytes = uint64_t{3} << 20,
          .read_seconds = 4,
          .measure_seconds = 4,
          .encode_seconds = 4,
          .write_seconds = 2,
          .threads = 2};
}

std::string limit(const StageRates& rates) {
  const std::string text = describe(rates);
  return text.substr(text.rfind(": ") + 2);
}

}  // namespace

TEST_CASE("rates count the time in which a stage works, on all threads", "[stage_rates]") {
  StageRates rates = even_rates();
  CHECK(describe(rates) ==
        "read 2.00 GiB/s, measure 150 M triangles/s, encode 10.0 M triangles/s, write 1.50 MiB/s: encoding limits");
  rates.threads = 1;
  CHECK(describe(rates) ==
        "read 1.00 GiB/s, measure 75.0 M triangles/s, encode 5.00 M triangles/s, write 1.50 MiB/s: encoding limits");
  CHECK(describe({}) ==
        "read 0 bytes/s, measure 0 triangles/s, encode 0 triangles/s, write 0 bytes/s: encoding limits");
}

TEST_CASE("the slowest stage limits, by its share of the threads' time", "[stage_rates]") {
  StageRates rates = even_rates();
  rates.read_seconds = 4.5;
  CHECK(limit(rates) == "reading limits");
  rates.measure_seconds = 5;
  CHECK(limit(rates) == "measuring limits");
  rates.encode_seconds = 5.5;
  CHECK(limit(rates) == "encoding limits");
  // One thread writes in parallel to everything else, which the two threads do one after another in 15 s each.
  rates.write_seconds = 7.4;
  CHECK(limit(rates) == "encoding limits");
  rates.write_seconds = 7.6;
  CHECK(limit(rates) == "writing limits");
  // With more threads, each of the other stages takes less time.
  rates.threads = 4;
  rates.write_seconds = 3.8;
  CHECK(limit(rates) == "writing limits");
  rates.threads = 1;
  CHECK(limit(rates) == "encoding limits");
}

TEST_CASE("a thread's reading time is not working time", "[stage_rates]") {
  std::atomic<uint64_t> working{0}, reading{0}, all{0};
  const auto spin = [](double seconds) {
    std::atomic<uint64_t> taken{0};
    while (static_cast<double>(taken) < 1e9 * seconds) const Timed timed(taken);
  };
  {
    const Timed timed(all);
    const Timed work(working, Spent::kNotReading);
    spin(0.002);
    const Timed read(reading, Spent::kReading);
    spin(0.003);
  }
  CHECK(reading >= 3'000'000);
  CHECK(working >= 2'000'000);
  CHECK(working + reading <= all);
}

}  // namespace scree::convert
