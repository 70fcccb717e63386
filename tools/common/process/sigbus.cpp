#include "tools/common/process/sigbus.h"

#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstddef>
#include <string>
#include <string_view>

#include <sys/stat.h>
#include <unistd.h>

#include "format/result.h"
#include "runtime/files/file_state.h"

namespace scree::tools {
namespace {

constexpr char kCutShort[] = "cannot read: the file was cut short while it was read, or its disk failed (SIGBUS)";
constexpr char kChanged[] = "cannot read: the file was changed while it was read";

// A signal handler may not allocate, so all that it needs is prepared in static memory. Paths have at most 4 KiB.
constexpr size_t kLineBytes = 8192;
struct Line {
  char text[kLineBytes];
  size_t size;

  void set(std::string_view command, std::string_view file, std::string_view reason) {
    std::string whole("scree ");
    whole.append(command).append(": ").append(file).append(": ").append(reason).append("\n");
    size = std::min(whole.size(), kLineBytes);
    std::copy_n(whole.begin(), size, text);
  }
};
Line cut_short, changed;
char watched[4096 + 1];    // the file; empty if there is none of this name
struct stat opened;        // its state at the start
struct sigaction earlier;  // of SIGSEGV
int exit_status = 2;

std::atomic_flag is_said = ATOMIC_FLAG_INIT;

[[noreturn]] void end_with(const Line& line) {
  // Several threads may fail at once. The first one prints the line and ends the process.
  while (is_said.test_and_set()) ::pause();
  size_t written = 0;
  while (written < line.size) {
    const ssize_t count = ::write(STDERR_FILENO, line.text + written, line.size - written);
    if (count <= 0) break;
    written += static_cast<size_t>(count);
  }
  ::_exit(exit_status);
}

bool is_overwritten() {
  struct stat now;
  return watched[0] != 0 && ::stat(watched, &now) == 0 && runtime::is_one_file(now, opened) &&
         !runtime::has_same_contents(now, opened);
}

extern "C" void on_sigbus(int) {
  end_with(cut_short);
}

/// For another reason the signal is raised again, for the handler before.
extern "C" void on_sigsegv(int) {
  if (is_overwritten()) end_with(changed);
  sigaction(SIGSEGV, &earlier, nullptr);
}

void handle(int signal, void (*handler)(int), struct sigaction* before) {
  struct sigaction action {};
  action.sa_handler = handler;
  sigemptyset(&action.sa_mask);
  struct sigaction old;
  sigaction(signal, &action, &old);
  if (before != nullptr && old.sa_handler != handler) *before = old;
}

}  // namespace

void report_sigbus(std::string_view command, std::string_view file) {
  cut_short.set(command, file, kCutShort);
  changed.set(command, file, kChanged);
  const size_t size = file.size() < sizeof watched ? file.size() : 0;
  *std::copy_n(file.begin(), size, watched) = 0;
  if (::stat(watched, &opened) != 0) watched[0] = 0;
  exit_status = exit_code(ErrorCode::kFile);
  handle(SIGBUS, on_sigbus, nullptr);
  handle(SIGSEGV, on_sigsegv, &earlier);
}

Result<void> check_unchanged(const runtime::MappedFile& map) {
  if (map.check_unchanged()) return {};
  return Error{ErrorCode::kFile, map.path() + ": " + (map.is_shorter() ? kCutShort : kChanged)};
}

}  // namespace scree::tools
