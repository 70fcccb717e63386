#include "tools/common/process/sigbus.h"

#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstddef>
#include <string>

#include <unistd.h>

#include "format/result.h"

namespace scree::tools {
namespace {

// A signal handler may not allocate, so the line is prepared in static memory. Paths have at most 4 KiB.
constexpr size_t kLineBytes = 8192;
char line[kLineBytes];
constexpr char kCutShort[] = "cannot read: the file was cut short while it was read, or its disk failed (SIGBUS)";
volatile sig_atomic_t line_size = 0;
int exit_status = 2;

std::atomic_flag is_said = ATOMIC_FLAG_INIT;

extern "C" void on_sigbus(int) {
  // Several threads may read past the end of the file at once. The first one prints the line and ends the process.
  while (is_said.test_and_set()) ::pause();
  size_t written = 0;
  const auto size = static_cast<size_t>(line_size);
  while (written < size) {
    const ssize_t count = ::write(STDERR_FILENO, line + written, size - written);
    if (count <= 0) break;
    written += static_cast<size_t>(count);
  }
  ::_exit(exit_status);
}

}  // namespace

void report_sigbus(std::string_view command, std::string_view file) {
  std::string text("scree ");
  text.append(command).append(": ").append(file).append(": ").append(kCutShort).append("\n");
  line_size = 0;
  const size_t size = std::min(text.size(), kLineBytes);
  std::copy_n(text.begin(), size, line);
  line_size = static_cast<sig_atomic_t>(size);
  exit_status = exit_code(ErrorCode::kFile);
  struct sigaction action {};
  action.sa_handler = on_sigbus;
  sigemptyset(&action.sa_mask);
  sigaction(SIGBUS, &action, nullptr);
}

Result<void> check_not_cut(const runtime::MappedFile& map) {
  if (map.check_size()) return {};
  return Error{ErrorCode::kFile, map.path() + ": " + kCutShort};
}

}  // namespace scree::tools
