// A thread pool. Results are taken in the order in which jobs were submitted, so output never depends on the number or
// the speed of threads.
#pragma once

#include <algorithm>
#include <atomic>
#include <concepts>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <utility>

#include "format/result.h"

namespace scree::convert {

/// A fixed number of worker threads. Jobs start in the order of submission, urgent ones first. The destructor drops
/// jobs that have not started and waits for the running ones, so declare the pool after everything that its jobs use.
class WorkerPool {
 public:
  /// `threads`: at least 1. `stop`: a flag that wait() polls; may be null, must outlive the pool.
  WorkerPool(uint32_t threads, const std::atomic<bool>* stop);
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  uint32_t threads() const;

  /// Runs `job(worker)` on one of the threads; `worker` < threads() identifies the thread's scratch memory. The job
  /// must not throw, submit or wait.
  void submit(std::function<void(uint32_t worker)> job, bool urgent);

  /// Waits until `done` returns true. It is called with the pool's lock held whenever a job has ended. Errors kFile:
  /// "interrupted", if the stop flag is set.
  Result<void> wait(const std::function<bool()>& done);

  /// The same without testing the stop flag.
  void drain(const std::function<bool()>& done);

  /// Runs `change` under the pool's lock and wakes all waiting threads.
  void notify(const std::function<void()>& change);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// A result that reports the memory it takes, in bytes. That can be less than the job needed.
template <class T>
concept HasHeldBytes = requires(const T& result) {
  { result.held_bytes() } -> std::convertible_to<uint64_t>;
};

/// Results of one kind of job in the order of submission. Used by one thread. The destructor skips jobs that have not
/// started and waits for the others. So jobs may refer to objects that outlive these results.
template <class T>
class OrderedResults {
 public:
  using Work = std::function<Result<T>(uint32_t worker)>;

  OrderedResults(WorkerPool& pool, bool urgent) : pool_(pool), urgent_(urgent) {}
  ~OrderedResults() {
    cancelled_->store(true, std::memory_order_relaxed);
    for (const std::shared_ptr<Slot>& slot : slots_) pool_.drain([&] { return slot->done; });
  }
  OrderedResults(const OrderedResults&) = delete;
  OrderedResults& operator=(const OrderedResults&) = delete;

  /// `cost`: memory of the job and its result, bytes; see cost(). Once the job is done, a result that reports less
  /// memory costs only that.
  void submit(Work work, uint64_t cost) {
    auto slot = std::make_shared<Slot>();
    slot->cost = cost;
    slots_.push_back(slot);
    cost_ += cost;
    try {
      submit(slot, std::move(work));
    } catch (...) {  // take() would wait forever for a job that never runs
      slots_.pop_back();
      cost_ -= cost;
      throw;
    }
  }

  uint64_t size() const { return slots_.size(); }

  /// Sum of the costs of the jobs whose results have not been taken.
  uint64_t cost() const { return cost_.load(std::memory_order_relaxed); }

  /// Whether take() would return at once.
  bool ready() {
    if (slots_.empty()) return false;
    bool done = false;
    pool_.notify([&] { done = slots_.front()->done; });
    return done;
  }

  /// The same while the pool's lock is held, as in WorkerPool::wait.
  bool ready_locked() const { return !slots_.empty() && slots_.front()->done; }

  /// Waits for the oldest job and returns its result. size() must not be 0.
  Result<T> take() {
    const std::shared_ptr<Slot> slot = slots_.front();
    if (const Result<void> waited = pool_.wait([&] { return slot->done; }); !waited) return waited.error();
    slots_
        .pop_front();  // only after the wait, because after an interruption the destructor must still wait for this job
    cost_ -= slot->cost;
    return std::move(*slot->result);
  }

 private:
  struct Slot {
    bool done = false;  // under the pool's lock
    uint64_t cost = 0;
    std::optional<Result<T>> result;
  };

  void submit(const std::shared_ptr<Slot>& slot, Work work) {
    pool_.submit(
        [slot = std::shared_ptr<Slot>(slot), work = std::move(work), cancelled = cancelled_, &pool = pool_,
         &cost = cost_](uint32_t worker) mutable {
          std::optional<Result<T>> result;
          try {
            if (cancelled->load(std::memory_order_relaxed)) {
              result.emplace(Error{ErrorCode::kFile, "interrupted"});
            } else {
              result.emplace(work(worker));
            }
          } catch (const std::bad_alloc&) {
            result.emplace(Error{ErrorCode::kMemory, "out of memory"});
          } catch (const std::exception& error) {
            result.emplace(Error{ErrorCode::kMemory, std::string("unexpected: ") + error.what()});
          }
          // The job and its result may refer to objects that live only as long as these results, so both are destroyed
          // before the result counts as done.
          work = nullptr;
          const auto publish = [&] {
            if constexpr (HasHeldBytes<T>)
              if (*result) {
                const uint64_t held = std::min<uint64_t>((**result).held_bytes(), slot->cost);
                cost -= slot->cost - held;
                slot->cost = held;
              }
            slot->result = std::move(result);
            result.reset();
            slot->done = true;
            slot.reset();
          };
          pool.notify(std::ref(publish));  // a copy would take memory, and nothing here may fail
        },
        urgent_);
  }

  WorkerPool& pool_;
  bool urgent_;
  std::shared_ptr<std::atomic<bool>> cancelled_ = std::make_shared<std::atomic<bool>>(false);
  std::deque<std::shared_ptr<Slot>> slots_;
  std::atomic<uint64_t> cost_ = 0;
};

/// Limits of the work in flight. One job is always allowed.
struct InFlight {
  uint64_t jobs = 1;
  uint64_t cost = UINT64_MAX;
};

/// Other results of the same pool, which run_ordered() takes while it waits for its own.
class OtherResults {
 public:
  virtual ~OtherResults() = default;
  /// Whether take_one() would return without waiting. Called with the pool's lock held.
  virtual bool is_ready() const = 0;
  virtual Result<void> take_one() = 0;
};

/// Runs work(i, worker) for i in [0, count) on the pool and take(i, result) on the calling thread, in order. Stops at
/// the first error in that order, which is the same for any number of threads, or at an error of `others`, which may
/// be null. `cost(i)`: see OrderedResults::submit.
template <class T, class Work, class Cost, class Take>
Result<void> run_ordered(WorkerPool& pool, uint64_t count, InFlight limit, Work work, Cost cost, Take take,
                         OtherResults* others = nullptr) {
  OrderedResults<T> results(pool, false);
  uint64_t next = 0;
  uint64_t next_cost = count > 0 ? cost(0) : 0;
  const auto has_room = [&] {
    return next < count && results.size() < limit.jobs &&
           (results.size() == 0 || results.cost() + next_cost <= limit.cost);
  };
  for (uint64_t taken = 0; taken < count; ++taken) {
    for (;;) {
      while (has_room()) {
        results.submit([work, next](uint32_t worker) { return work(next, worker); }, next_cost);
        if (++next < count) next_cost = cost(next);
      }
      // A done job may leave room for another one before its own result is taken.
      bool is_other = false;
      const auto done = [&] {
        is_other = others != nullptr && others->is_ready();
        return is_other || results.ready_locked() || has_room();
      };
      SCREE_TRY(pool.wait(done));
      if (is_other) {
        SCREE_TRY(others->take_one());
      } else if (results.ready()) {
        break;
      }
    }
    T result = SCREE_TRY(results.take());
    SCREE_TRY(take(taken, std::move(result)));
  }
  return {};
}

}  // namespace scree::convert
