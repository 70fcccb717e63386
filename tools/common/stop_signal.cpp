#include "tools/common/stop_signal.h"

namespace scree::tools {
namespace {

static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler may only touch lock-free atomics");
std::atomic<bool> stop_requested{false};
std::atomic<int> stop_signal{0};

extern "C" void request_stop(int signal) {
  stop_requested.store(true, std::memory_order_relaxed);
  stop_signal.store(signal, std::memory_order_relaxed);
}

}  // namespace

StopOnSignal::StopOnSignal() {
  struct sigaction action {};
  action.sa_handler = request_stop;
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  sigemptyset(&action.sa_mask);
  for (size_t i = 0; i < 3; ++i) {
    sigaction(kSignals[i], nullptr, &before_[i]);
    if (before_[i].sa_handler != SIG_IGN) sigaction(kSignals[i], &action, nullptr);  // nohup stays nohup
  }
}

StopOnSignal::~StopOnSignal() {
  for (size_t i = 0; i < 3; ++i) sigaction(kSignals[i], &before_[i], nullptr);
}

const std::atomic<bool>* StopOnSignal::flag() {
  return &stop_requested;
}

void StopOnSignal::end_where_signalled() {
  if (stop_requested.load()) std::raise(stop_signal.load());
}

}  // namespace scree::tools
