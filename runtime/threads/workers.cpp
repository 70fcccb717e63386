#include "runtime/threads/workers.h"

#include <algorithm>
#include <exception>

namespace scree::runtime {

Workers::~Workers() {
  {
    const std::lock_guard lock(mutex_);
    is_stopping_ = true;
  }
  loop_begun_.notify_all();
  for (std::thread& helper : helpers_) helper.join();
}

uint32_t Workers::start() {
  try {
    for (uint32_t i = helpers_.empty() ? 1 : threads_; i < threads_; ++i) helpers_.emplace_back([this] { help(); });
  } catch (const std::exception&) {
    // The system starts no more threads; the others do all the work.
  }
  return static_cast<uint32_t>(helpers_.size()) + 1;
}

/// Waits up to `spin_` for a condition that is then tested again under the mutex.
template <class Condition>
void Workers::spin_until(const Condition& condition) const {
  if (spin_.count() == 0 || condition()) return;
  const auto end = std::chrono::steady_clock::now() + spin_;
  while (!condition() && std::chrono::steady_clock::now() < end) {
#if defined(__x86_64__)
    __builtin_ia32_pause();
#endif
  }
}

void Workers::help() {
  for (uint64_t seen = 0;;) {
    spin_until([&] { return is_stopping_ || loops_ != seen; });
    std::unique_lock lock(mutex_);
    loop_begun_.wait(lock, [&] { return is_stopping_ || loops_ != seen; });
    if (is_stopping_) return;
    seen = loops_;
    if (wanted_ == 0) continue;
    --wanted_;
    ++helping_;
    const std::function<void()>& work = *work_;
    lock.unlock();
    work();
    lock.lock();
    if (--helping_ == 0) all_left_.notify_one();
  }
}

void Workers::share(uint64_t helpers, const std::function<void()>& work) {
  {
    const std::lock_guard lock(mutex_);
    work_ = &work;
    ++loops_;
    wanted_ = std::min<uint64_t>(helpers, helpers_.size());
  }
  loop_begun_.notify_all();
  work();
  spin_until([&] { return helping_ == 0; });
  std::unique_lock lock(mutex_);
  wanted_ = 0;
  all_left_.wait(lock, [&] { return helping_ == 0; });
}

}  // namespace scree::runtime
