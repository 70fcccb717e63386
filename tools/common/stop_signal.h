// Commands that write files end cleanly when a signal asks them to stop.
#pragma once

#include <atomic>
#include <csignal>
#include <string>
#include <string_view>

namespace scree::tools {

/// From now on the first SIGINT, SIGTERM or SIGHUP prints "scree COMMAND: stopped; nothing written" (or what
/// note_written() has named) and ends the program by that signal, after the function of clean_up_with(). That is right
/// as long as nothing unfinished is on the disk; a StopOnSignal covers the time in which something is. A signal that
/// was ignored (nohup) stays ignored. Called by main before a command that writes files; a later call replaces it.
void end_on_signal(std::string_view command);

/// While one lives, the first signal only raises flag(), and the job ends by itself and removes the files it has not
/// finished; a second one ends the program at once. One at a time.
class StopOnSignal {
 public:
  /// `advice`: the end of the line instead of "nothing written".
  explicit StopOnSignal(std::string_view advice = {});
  ~StopOnSignal();
  StopOnSignal(const StopOnSignal&) = delete;
  StopOnSignal& operator=(const StopOnSignal&) = delete;

  /// For the job to test between its steps.
  static const std::atomic<bool>* flag();

 private:
  struct sigaction before_[3]{};  // of SIGINT, SIGTERM and SIGHUP
};

/// From now on signals end the program without a line: a launcher, which sends them to each of several ranks, has said
/// why.
void end_silently_on_signal();

/// A file of the command has its name, or has grown: the line of a later signal names it, once.
void note_written(const std::string& path);

/// `clean_up` runs in the signal handler that ends the program: it may only make calls that POSIX allows there. Null:
/// none.
void clean_up_with(void (*clean_up)());

/// Where a signal raised flag(): prints the line and ends the program by that signal, so that its parent learns of it.
/// Called by main when the command has ended without finishing its work.
void end_where_signalled();

}  // namespace scree::tools
