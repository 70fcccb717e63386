// Lets commands that write files end cleanly on a signal.
#pragma once

#include <atomic>
#include <csignal>
#include <string>
#include <string_view>

namespace scree::tools {

/// From now on the first SIGINT, SIGTERM or SIGHUP prints "scree COMMAND: stopped; nothing written" (or the files of
/// note_written()) and ends the program by that signal, after the function of clean_up_with(). That is right as long as
/// no unfinished file is on the disk; a StopOnSignal covers the time in which there may be one. A signal that was
/// ignored (nohup) stays ignored. Called by main before a command that writes files. A later call replaces an earlier
/// one.
void end_on_signal(std::string_view command);

/// While one exists, the first signal only raises flag(): the job then ends itself and removes its unfinished files. A
/// second signal ends the program at once; it also removes unfinished files, except files that --resume can continue.
/// Only one may exist at a time.
class StopOnSignal {
 public:
  /// `advice`: replaces "nothing written" at the end of the line.
  explicit StopOnSignal(std::string_view advice = {});
  ~StopOnSignal();
  StopOnSignal(const StopOnSignal&) = delete;
  StopOnSignal& operator=(const StopOnSignal&) = delete;

  /// The flag that the job tests between its steps.
  static const std::atomic<bool>* flag();

  /// Sets the advice later, once it is right.
  static void advise(std::string_view advice);

 private:
  struct sigaction before_[3]{};  // of SIGINT, SIGTERM and SIGHUP
};

/// From now on signals end the program without a line. With several ranks the launcher sends them and reports the
/// reason.
void end_silently_on_signal();

/// Records that a file of the command was written. The line of a later signal lists it once.
void note_written(const std::string& path);

/// Sets the function that the signal handler calls before it ends the program. It may only make calls that POSIX allows
/// in signal handlers. Null: none.
void clean_up_with(void (*clean_up)());

/// If a signal raised flag(), prints the line and ends the program by that signal, so that the parent process is
/// informed. Called by main when the command has ended without finishing its work.
void end_where_signalled();

}  // namespace scree::tools
