// A thread that prepares items before other threads work on them, for example by asking the system to read their files.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>

namespace scree::convert {

/// Prepares items 0 to `count` - 1 in order, up to `most_bytes` ahead of the newest item that is being worked on. No
/// thread waits for this one, and results must not depend on it: it may have prepared nothing, if no thread or no
/// memory is left.
class PrepareAhead {
 public:
  /// `bytes_of(i)`: size of item i. `prepare(i)` may throw std::bad_alloc, which ends preparing. Both run in the
  /// thread.
  PrepareAhead(uint64_t count, uint64_t most_bytes, std::function<uint64_t(uint64_t)> bytes_of,
               std::function<void(uint64_t)> prepare);
  ~PrepareAhead();
  PrepareAhead(const PrepareAhead&) = delete;
  PrepareAhead& operator=(const PrepareAhead&) = delete;

  /// Reports that work on item `i` begins. Any thread may call it.
  void begun(uint64_t i);

 private:
  void run();

  const uint64_t count_;
  const uint64_t most_bytes_;
  const std::function<uint64_t(uint64_t)> bytes_of_;
  const std::function<void(uint64_t)> prepare_;
  std::mutex lock_;
  std::condition_variable changed_;
  uint64_t begun_ = 0;
  bool closing_ = false;
  std::thread thread_;
};

}  // namespace scree::convert
