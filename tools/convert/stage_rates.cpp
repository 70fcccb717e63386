#include "tools/convert/stage_rates.h"

#include <algorithm>
#include <chrono>

#include "tools/common/options.h"

namespace scree::convert {
namespace {

uint64_t now() {
  const auto since = std::chrono::steady_clock::now().time_since_epoch();
  return static_cast<uint64_t>(std::chrono::duration_cast<std::chrono::nanoseconds>(since).count());
}

double rate(uint64_t amount, double seconds) {
  return static_cast<double>(amount) / std::max(seconds, 1e-9);
}

std::string bytes_a_second(uint64_t bytes, double seconds) {
  return tools::format_bytes(static_cast<uint64_t>(rate(bytes, seconds))) + "/s";
}

}  // namespace

std::string describe(const StageRates& rates) {
  const double read = rates.read_seconds / rates.threads;
  const double encode = rates.encode_seconds / rates.threads;
  const double write = rates.write_seconds;
  std::string text = "read " + bytes_a_second(rates.read_bytes, read) + ", encode " +
                     tools::format_count(rate(rates.triangles, encode)) + " triangles/s, write " +
                     bytes_a_second(rates.written_bytes, write);
  // Reading and encoding wait for each other; writing goes on beside them.
  if (write > read + encode) return text + ": writing limits";
  return text + (read > encode ? ": reading limits" : ": encoding limits");
}

Timed::Timed(std::atomic<uint64_t>& nanoseconds) : nanoseconds_(nanoseconds), start_(now()) {}

Timed::~Timed() {
  nanoseconds_.fetch_add(now() - start_, std::memory_order_relaxed);
}

}  // namespace scree::convert
