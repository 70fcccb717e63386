#include "tools/common/output/progress.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "tools/common/options/options.h"

namespace scree::tools {

Progress::Progress(bool enabled, Listener listener)
    : enabled_(enabled && isatty(STDERR_FILENO) == 1),
      listener_(std::move(listener)),
      start_(Clock::now()),
      last_(start_) {}

Progress::~Progress() {
  erase();
}

void Progress::stage(std::string name, uint64_t count, std::string things) {
  things_ = std::move(things);
  name_ = std::move(name);
  total_ = count;
  start_ = Clock::now();
  last_ = start_;
  if (listener_) listener_(name_, 0, total_);
}

void Progress::update(uint64_t done, uint64_t bytes, const std::function<std::string()>& detail) {
  if (!enabled_ && !listener_) return;
  const Clock::time_point now = Clock::now();
  if (now - last_ < std::chrono::milliseconds(200)) return;
  last_ = now;
  if (listener_) listener_(name_, done, total_);
  if (!enabled_) return;
  const double seconds = std::chrono::duration<double>(now - start_).count();
  const double rate = seconds > 0 ? static_cast<double>(done) / seconds : 0;
  const double share = total_ > 0 ? static_cast<double>(done) / static_cast<double>(total_) : 0;
  const std::string left =
      rate > 0 && done <= total_ ? format_duration(static_cast<double>(total_ - done) / rate) + " left" : "";
  // The code that clears the rest of the line comes last, so that nothing of a longer line remains.
  const std::string more = detail ? "; " + detail() : "";
  const std::string size = bytes > 0 ? format_bytes(bytes) + ", " : "";
  char percent[16];
  std::snprintf(percent, sizeof percent, ": %3.0f%%, ", std::floor(100 * share));
  const std::string line = name_ + percent + size + format_count(rate) + " " + things_ + "/s, " + left + more;
  // A longer line would wrap, and the next one would begin in its second row.
  winsize window{};
  const size_t columns = ioctl(STDERR_FILENO, TIOCGWINSZ, &window) == 0 && window.ws_col > 1 ? window.ws_col - 1u : 200;
  std::fprintf(stderr, "\r%s\x1b[K", line.substr(0, columns).c_str());
  std::fflush(stderr);
  shown_ = true;
}

void Progress::erase() {
  if (!shown_) return;
  std::fputs("\r\x1b[K", stderr);
  std::fflush(stderr);
  shown_ = false;
}

std::string format_duration(double seconds) {
  const uint64_t whole = static_cast<uint64_t>(std::llround(std::clamp(seconds, 0.0, 1e15)));
  char text[64];
  if (whole < 60) {
    std::snprintf(text, sizeof text, "%llu s", static_cast<unsigned long long>(whole));
  } else if (whole < 3600) {
    std::snprintf(text, sizeof text, "%llu min %02llu s", static_cast<unsigned long long>(whole / 60),
                  static_cast<unsigned long long>(whole % 60));
  } else {
    std::snprintf(text, sizeof text, "%llu h %02llu min", static_cast<unsigned long long>(whole / 3600),
                  static_cast<unsigned long long>(whole / 60 % 60));
  }
  return text;
}

}  // namespace scree::tools
