#include "tools/common/jobs/ordered_pool.h"
#include "tools/common/jobs/stop_flag.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <new>
#include <system_error>
#include <thread>
#include <vector>

namespace scree::convert {

struct WorkerPool::Impl {
  const std::atomic<bool>* stop = nullptr;
  std::mutex lock;
  std::condition_variable work_ready;
  std::condition_variable job_done;
  std::deque<std::function<void(uint32_t)>> urgent;
  std::deque<std::function<void(uint32_t)>> jobs;
  bool closing = false;
  std::vector<std::thread> threads;

  void run(uint32_t worker) {
    std::unique_lock<std::mutex> hold(lock);
    for (;;) {
      work_ready.wait(hold, [&] { return closing || !urgent.empty() || !jobs.empty(); });
      if (closing) return;
      std::deque<std::function<void(uint32_t)>>& queue = urgent.empty() ? jobs : urgent;
      {
        const std::function<void(uint32_t)> job = std::move(queue.front());
        queue.pop_front();
        hold.unlock();
        job(worker);
        // The job's captures are destroyed here, outside the lock, because they may hold much memory.
      }
      hold.lock();
    }
  }
};

WorkerPool::WorkerPool(uint32_t threads, const std::atomic<bool>* stop) : impl_(std::make_unique<Impl>()) {
  impl_->stop = stop;
  impl_->threads.reserve(std::max(threads, 1u));
  for (uint32_t worker = 0; worker < std::max(threads, 1u); ++worker) {
    try {
      impl_->threads.emplace_back([impl = impl_.get(), worker] { impl->run(worker); });
    } catch (const std::system_error& refused) {
      // Fewer threads give the same result, so only a failure of the first one is an error. The message of libstdc++ is
      // misleading (it is about linking) and is replaced.
      if (worker == 0) throw std::system_error(refused.code(), "the system has no thread left");
      break;
    } catch (const std::bad_alloc&) {
      if (worker == 0) throw;
      break;
    }
  }
}

WorkerPool::~WorkerPool() {
  {
    const std::lock_guard<std::mutex> hold(impl_->lock);
    impl_->closing = true;
  }
  impl_->work_ready.notify_all();
  for (std::thread& thread : impl_->threads) thread.join();
}

uint32_t WorkerPool::threads() const {
  return static_cast<uint32_t>(impl_->threads.size());
}

void WorkerPool::submit(std::function<void(uint32_t worker)> job, bool urgent) {
  {
    const std::lock_guard<std::mutex> hold(impl_->lock);
    (urgent ? impl_->urgent : impl_->jobs).push_back(std::move(job));
  }
  impl_->work_ready.notify_one();
}

Result<void> WorkerPool::wait(const std::function<bool()>& done) {
  std::unique_lock<std::mutex> hold(impl_->lock);
  for (;;) {
    SCREE_TRY(tools::check_stop(impl_->stop));
    if (done()) return {};
    // A signal handler can only set the flag, so the flag is tested from time to time.
    impl_->job_done.wait_for(hold, std::chrono::milliseconds(50));
  }
}

void WorkerPool::drain(const std::function<bool()>& done) {
  std::unique_lock<std::mutex> hold(impl_->lock);
  impl_->job_done.wait(hold, done);
}

void WorkerPool::notify(const std::function<void()>& change) {
  {
    const std::lock_guard<std::mutex> hold(impl_->lock);
    change();
  }
  impl_->job_done.notify_all();
}

}  // namespace scree::convert
