// Shows the progress of a long job in one line on stderr, if that is a terminal.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <string>

namespace scree::tools {

/// Rewrites one line at most five times per second and erases it at the end. Silent if stderr is no terminal or
/// `enabled` is false. A listener receives the same steps in any case. Not thread-safe: one thread owns it.
class Progress {
 public:
  using Listener = std::function<void(const std::string& stage, uint64_t done, uint64_t total)>;

  explicit Progress(bool enabled, Listener listener = nullptr);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// Starts a stage of `count` items. `things`: the name of the items. `name`: the beginning of the line.
  void stage(std::string name, uint64_t count, std::string things = "triangles");

  /// `done` items of the stage are done; `bytes` were read or written so far (0: not shown). `detail`: returns further
  /// text; called only when the line is shown.
  void update(uint64_t done, uint64_t bytes, const std::function<std::string()>& detail = nullptr);

  /// Erases the line, so that other text can be printed.
  void erase();

 private:
  using Clock = std::chrono::steady_clock;
  bool enabled_;
  Listener listener_;
  bool shown_ = false;
  std::string name_;
  std::string things_;
  uint64_t total_ = 0;
  Clock::time_point start_;
  Clock::time_point last_;
};

/// "5 s", "3 min 20 s", "2 h 05 min".
std::string format_duration(double seconds);

}  // namespace scree::tools
