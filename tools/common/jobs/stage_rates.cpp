#include "tools/common/jobs/stage_rates.h"

#include <algorithm>
#include <chrono>

#include "tools/common/options/options.h"

namespace scree::convert {
namespace {

uint64_t now() {
  const auto since = std::chrono::steady_clock::now().time_since_epoch();
  return static_cast<uint64_t>(std::chrono::duration_cast<std::chrono::nanoseconds>(since).count());
}

// Nanoseconds that this thread spent in Spent::kReading.
thread_local uint64_t thread_read = 0;

double rate(uint64_t amount, double seconds) {
  return static_cast<double>(amount) / std::max(seconds, 1e-9);
}

std::string bytes_a_second(uint64_t bytes, double seconds) {
  return tools::format_bytes(static_cast<uint64_t>(rate(bytes, seconds))) + "/s";
}

}  // namespace

StageRates StageTimes::rates(ReadTotals read, uint64_t written, uint32_t threads) const {
  const auto seconds = [](const std::atomic<uint64_t>& nanoseconds) {
    return 1e-9 * static_cast<double>(nanoseconds.load());
  };
  StageRates now;
  now.measured_triangles = measured_triangles;
  now.encoded_triangles = encoded_triangles;
  now.read_bytes = read.bytes;
  now.written_bytes = written + discarded_bytes;
  now.read_seconds = read.seconds;
  now.measure_seconds = seconds(measuring);
  now.encode_seconds = seconds(encoding);
  now.write_seconds = seconds(writing);
  now.threads = threads;
  return now;
}

std::string describe(const StageRates& rates) {
  const double read = rates.read_seconds / rates.threads;
  const double measure = rates.measure_seconds / rates.threads;
  const double encode = rates.encode_seconds / rates.threads;
  const double write = rates.write_seconds;
  const std::string text = "read " + bytes_a_second(rates.read_bytes, read) + ", measure " +
                           tools::format_count(rate(rates.measured_triangles, measure)) + " triangles/s, encode " +
                           tools::format_count(rate(rates.encoded_triangles, encode)) + " triangles/s, write " +
                           bytes_a_second(rates.written_bytes, write);
  // Reading, measuring and encoding share the threads, so their times add up. Writing runs beside them.
  if (write > read + measure + encode) return text + ": writing limits";
  if (read > std::max(measure, encode)) return text + ": reading limits";
  return text + (measure > encode ? ": measuring limits" : ": encoding limits");
}

Timed::Timed(std::atomic<uint64_t>& nanoseconds, Spent on)
    : nanoseconds_(nanoseconds), on_(on), start_(now()), read_before_(thread_read) {}

Timed::~Timed() {
  const uint64_t taken = now() - start_;
  const uint64_t left_out = on_ == Spent::kNotReading ? thread_read - read_before_ : 0;
  nanoseconds_.fetch_add(taken - left_out, std::memory_order_relaxed);
  if (on_ == Spent::kReading) thread_read += taken;
}

}  // namespace scree::convert
