#include "tools/common/jobs/prepare_ahead.h"

#include <algorithm>
#include <deque>
#include <exception>
#include <new>
#include <utility>

namespace scree::convert {

PrepareAhead::PrepareAhead(uint64_t count, uint64_t most_bytes, std::function<uint64_t(uint64_t)> bytes_of,
                           std::function<void(uint64_t)> prepare)
    : count_(count), most_bytes_(most_bytes), bytes_of_(std::move(bytes_of)), prepare_(std::move(prepare)) {
  if (count_ == 0) return;
  try {
    thread_ = std::thread([this] {
      try {
        run();
      } catch (const std::bad_alloc&) {  // handled like a thread that cannot start
      }
    });
  } catch (const std::exception&) {  // without this thread, the work is only slower
  }
}

PrepareAhead::~PrepareAhead() {
  {
    const std::lock_guard<std::mutex> hold(lock_);
    closing_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void PrepareAhead::begun(uint64_t i) {
  {
    const std::lock_guard<std::mutex> hold(lock_);
    begun_ = std::max(begun_, i);
  }
  changed_.notify_all();
}

void PrepareAhead::run() {
  std::deque<uint64_t> prepared;  // bytes of the items from number `first` on
  uint64_t first = 0, bytes = 0;
  std::unique_lock<std::mutex> hold(lock_);
  while (!closing_ && first + prepared.size() < count_) {
    for (; first < begun_; ++first) {
      if (prepared.empty()) continue;
      bytes -= prepared.front();
      prepared.pop_front();
    }
    const uint64_t next = first + prepared.size();
    if (bytes >= most_bytes_ || next >= count_) {
      if (next < count_) changed_.wait(hold, [&] { return closing_ || begun_ > first; });
      continue;
    }
    hold.unlock();
    prepare_(next);
    prepared.push_back(bytes_of_(next));
    bytes += prepared.back();
    hold.lock();
  }
}

}  // namespace scree::convert
