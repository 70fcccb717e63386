#include "tools/common/process/stop_signal.h"

#include <algorithm>
#include <cstddef>
#include <vector>

#include <unistd.h>

#include "format/container/part_file.h"

namespace scree::tools {
namespace {

static_assert(std::atomic<bool>::is_always_lock_free && std::atomic<size_t>::is_always_lock_free &&
                  std::atomic<void (*)()>::is_always_lock_free,
              "a signal handler may only touch lock-free atomics");
constexpr int kSignals[3] = {SIGINT, SIGTERM, SIGHUP};

std::atomic<bool> stop_requested{false};
std::atomic<int> stop_signal{0};
std::atomic<void (*)()> clean_up{nullptr};

// A signal handler may not allocate, so the line is prepared in static memory.
constexpr size_t kMessageBytes = 8192;
char message[kMessageBytes];
std::atomic<size_t> message_size{0};
std::string command_name;
std::string written_files;
std::vector<std::string> written_names;

void make_line(std::string_view end) {
  std::string text = "scree " + command_name + ": stopped; " + std::string(end);
  text.resize(std::min(text.size(), kMessageBytes - 1));
  text += '\n';
  message_size = 0;
  std::copy(text.begin(), text.end(), message);
  message_size = text.size();
}

std::string usual_end() {
  return written_files.empty() ? "nothing written" : "written: " + written_files;
}

std::atomic<bool> is_silent{false};

void print_line() {
  if (is_silent) return;
  for (size_t written = 0; written < message_size;) {
    const ssize_t count = ::write(STDERR_FILENO, message + written, message_size - written);
    if (count <= 0) break;
    written += static_cast<size_t>(count);
  }
}

extern "C" void end_at_once(int signal) {
  format::remove_open_parts();  // unfinished files exist only at a second signal
  if (void (*const function)() = clean_up) function();
  print_line();
  ::raise(signal);  // its action is the default again, and takes effect when the handler returns
}

/// Sets the handler of `signal`, unless it is ignored. The default action is restored before the handler runs.
void handle(int signal, void (*handler)(int)) {
  struct sigaction action {};
  action.sa_handler = handler;
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  sigemptyset(&action.sa_mask);
  struct sigaction now {};
  sigaction(signal, nullptr, &now);
  if (now.sa_handler != SIG_IGN) sigaction(signal, &action, nullptr);
}

extern "C" void request_stop(int signal) {
  stop_requested.store(true, std::memory_order_relaxed);
  stop_signal.store(signal, std::memory_order_relaxed);
  handle(signal, end_at_once);
}

void install(void (*handler)(int)) {
  for (const int signal : kSignals) handle(signal, handler);
}

}  // namespace

void end_on_signal(std::string_view command) {
  command_name = command;
  written_files.clear();
  written_names.clear();
  stop_requested = false;
  make_line(usual_end());
  install(end_at_once);
}

StopOnSignal::StopOnSignal(std::string_view advice) {
  if (!advice.empty()) advise(advice);
  for (size_t i = 0; i < 3; ++i) sigaction(kSignals[i], nullptr, &before_[i]);
  install(request_stop);
}

StopOnSignal::~StopOnSignal() {
  for (size_t i = 0; i < 3; ++i) sigaction(kSignals[i], &before_[i], nullptr);
}

const std::atomic<bool>* StopOnSignal::flag() {
  return &stop_requested;
}

void StopOnSignal::advise(std::string_view advice) {
  make_line(advice);
}

void end_silently_on_signal() {
  is_silent = true;
}

void note_written(const std::string& path) {
  if (std::find(written_names.begin(), written_names.end(), path) != written_names.end()) return;
  written_names.push_back(path);
  written_files += (written_files.empty() ? "" : ", ") + path;
  make_line(usual_end());
}

void clean_up_with(void (*function)()) {
  clean_up = function;
}

void end_where_signalled() {
  if (!stop_requested) return;
  print_line();
  for (const int signal : kSignals) {
    struct sigaction now {};
    sigaction(signal, nullptr, &now);
    if (now.sa_handler == end_at_once) std::signal(signal, SIG_DFL);
  }
  std::raise(stop_signal);
}

}  // namespace scree::tools
