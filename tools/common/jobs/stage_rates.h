// The speed of each stage of a conversion, which shows the stage that limits the whole.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

namespace scree::convert {

/// Work done so far with the source's geometry, summed over all threads. Reading, measuring and encoding share the
/// threads; one thread writes.
struct StageRates {
  uint64_t measured_triangles = 0;
  uint64_t encoded_triangles = 0;
  uint64_t read_bytes = 0;
  uint64_t written_bytes = 0;
  double read_seconds = 0;     // of all threads, in read calls
  double measure_seconds = 0;  // of all threads, without reading
  double encode_seconds = 0;   // likewise
  double write_seconds = 0;
  uint32_t threads = 1;  // number of encoding threads
};

/// Bytes read, and the time that all threads spent in read calls.
struct ReadTotals {
  uint64_t bytes = 0;
  double seconds = 0;
};

/// Counters that the stages add to: nanoseconds of all threads, and triangles counted by the thread that takes results.
struct StageTimes {
  std::atomic<uint64_t> measuring{0};
  std::atomic<uint64_t> encoding{0};  // including compression
  std::atomic<uint64_t> writing{0};
  uint64_t measured_triangles = 0;
  uint64_t encoded_triangles = 0;
  uint64_t discarded_bytes = 0;  // written but not used

  /// `written`: bytes in the file now. `threads`: of encoding.
  StageRates rates(ReadTotals read, uint64_t written, uint32_t threads) const;
};

/// "read 2.31 GiB/s, measure 310 M triangles/s, encode 14.2 M triangles/s, write 1.2 GiB/s: encoding limits". A stage's
/// rate counts only the time in which it works, as if all threads worked on that stage.
std::string describe(const StageRates& rates);

/// The time that is measured.
enum class Spent : uint8_t {
  kAny,
  kReading,     // read calls
  kNotReading,  // without this thread's time in kReading
};

/// Adds the time from construction to destruction to `nanoseconds`, in any thread.
class Timed {
 public:
  explicit Timed(std::atomic<uint64_t>& nanoseconds, Spent on = Spent::kAny);
  ~Timed();
  Timed(const Timed&) = delete;
  Timed& operator=(const Timed&) = delete;

 private:
  std::atomic<uint64_t>& nanoseconds_;
  const Spent on_;
  const uint64_t start_, read_before_;
};

}  // namespace scree::convert
