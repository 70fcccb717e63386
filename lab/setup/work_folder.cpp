#include "lab/setup/work_folder.h"

#include <atomic>
#include <climits>

#include <sys/wait.h>
#include <unistd.h>

#include "tools/common/process/stop_signal.h"

namespace scree::lab {
namespace {

// A signal handler may not allocate, so the name is in static memory.
std::atomic<bool> is_used;
char folder[PATH_MAX];

/// Runs in the signal handler, which may call fork and exec.
void remove_folder() {
  if (!is_used) return;
  const pid_t child = ::fork();
  if (child == 0) {
    ::execl("/bin/rm", "rm", "-rf", folder, static_cast<char*>(nullptr));
    ::_exit(1);
  }
  if (child > 0) ::waitpid(child, nullptr, 0);
}

}  // namespace

void remove_on_signal(const std::string& path) {
  if (is_used || path.size() >= sizeof folder) return;
  path.copy(folder, path.size());
  folder[path.size()] = 0;
  is_used = true;
  tools::clean_up_with(remove_folder);
}

void forget_folder() {
  is_used = false;
}

}  // namespace scree::lab
