// Long jobs that write files end cleanly when they are asked to stop.
#pragma once

#include <atomic>
#include <csignal>
#include <cstddef>

namespace scree::tools {

/// While one lives, the first SIGINT, SIGTERM or SIGHUP only raises flag(), and the job ends by itself and removes what
/// it has written; a second one ends the program as if nobody caught it. A signal that was ignored (nohup) stays
/// ignored. One at a time.
class StopOnSignal {
 public:
  StopOnSignal();
  ~StopOnSignal();
  StopOnSignal(const StopOnSignal&) = delete;
  StopOnSignal& operator=(const StopOnSignal&) = delete;

  /// For the job to look at between its steps.
  static const std::atomic<bool>* flag();

  /// Where a signal came: ends the program by it, so that whoever sent it learns that it did. Call when none lives any
  /// more.
  static void end_where_signalled();

 private:
  static constexpr int kSignals[3] = {SIGINT, SIGTERM, SIGHUP};
  struct sigaction before_[3]{};
};

}  // namespace scree::tools
