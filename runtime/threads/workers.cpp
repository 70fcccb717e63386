#include "runtime/threads/workers.h"

#include <algorithm>
#include <exception>

namespace scree::runtime {

Workers::~Workers() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  begun_.notify_all();
  for (std::thread& helper : helpers_) helper.join();
}

void Workers::start() {
  if (!helpers_.empty()) return;
  try {
    for (uint32_t i = 1; i < threads_; ++i) helpers_.emplace_back([this] { help(); });
  } catch (const std::exception&) {
    // If the system starts fewer threads, these do the same work.
  }
}

void Workers::help() {
  std::unique_lock lock(mutex_);
  for (uint64_t seen = 0;;) {
    begun_.wait(lock, [&] { return ends_ || loops_ != seen; });
    if (ends_) return;
    seen = loops_;
    if (wanted_ == 0) continue;
    --wanted_;
    ++helping_;
    const std::function<void()>& work = *work_;
    lock.unlock();
    work();
    lock.lock();
    if (--helping_ == 0) left_.notify_one();
  }
}

void Workers::share(uint64_t helpers, const std::function<void()>& work) {
  {
    const std::lock_guard lock(mutex_);
    work_ = &work;
    ++loops_;
    wanted_ = std::min<uint64_t>(helpers, helpers_.size());
  }
  begun_.notify_all();
  work();
  std::unique_lock lock(mutex_);
  wanted_ = 0;
  left_.wait(lock, [&] { return helping_ == 0; });
}

}  // namespace scree::runtime
