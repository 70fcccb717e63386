// How fast each stage of a conversion is by itself, so that a user sees which one all others wait for.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

namespace scree::convert {

/// What one pass over the source did, summed over its threads. Reading and encoding share the threads; one thread
/// writes.
struct StageRates {
  uint64_t triangles = 0;
  uint64_t read_bytes = 0;
  uint64_t written_bytes = 0;
  double read_seconds = 0;    // of all threads, in calls that read
  double encode_seconds = 0;  // of all threads, at work otherwise
  double write_seconds = 0;
  uint32_t threads = 1;
};

/// "read 2.31 GiB/s, encode 14.2 M triangles/s, write 1.2 GiB/s: encoding limits". A stage's rate is what it makes
/// while it works: reading and encoding on all their threads at once.
std::string describe(const StageRates& rates);

/// Adds the time from its making to its end to `nanoseconds`, in whichever thread.
class Timed {
 public:
  explicit Timed(std::atomic<uint64_t>& nanoseconds);
  ~Timed();
  Timed(const Timed&) = delete;
  Timed& operator=(const Timed&) = delete;

 private:
  std::atomic<uint64_t>& nanoseconds_;
  uint64_t start_;
};

}  // namespace scree::convert
