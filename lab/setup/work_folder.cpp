#include "lab/setup/work_folder.h"

#include <atomic>
#include <climits>
#include <cstdint>

#include <dirent.h>
#include <fcntl.h>
#include <unistd.h>

#include "tools/common/stop_signal.h"

namespace scree::lab {
namespace {

// A signal handler may not allocate, so that names lie in memory that stays.
struct Slot {
  std::atomic<bool> is_used;
  char path[PATH_MAX];
};
Slot slots[8];

constexpr int kDeepest = 16;

/// By system calls alone, since opendir() and remove_all() allocate. Links are removed, not followed.
void empty_folder(int folder, int depth) {
  alignas(dirent64) char entries[4096];
  // A folder that shrinks while it is read may hide entries from one pass: each begins at the start again.
  for (int pass = 0; pass < 100; ++pass) {
    bool removed_any = false;
    ::lseek(folder, 0, SEEK_SET);
    for (ssize_t bytes = 0; (bytes = ::getdents64(folder, entries, sizeof entries)) > 0;) {
      for (ssize_t at = 0; at < bytes;) {
        const auto* const entry = reinterpret_cast<const dirent64*>(entries + at);
        at += entry->d_reclen;
        const char* const name = entry->d_name;
        if (name[0] == '.' && (name[1] == 0 || (name[1] == '.' && name[2] == 0))) continue;
        if (::unlinkat(folder, name, 0) == 0) {
          removed_any = true;
          continue;
        }
        const int inner =
            depth < kDeepest ? ::openat(folder, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC) : -1;
        if (inner < 0) continue;
        empty_folder(inner, depth + 1);
        ::close(inner);
        removed_any = ::unlinkat(folder, name, AT_REMOVEDIR) == 0 || removed_any;
      }
    }
    if (!removed_any) return;
  }
}

/// Other threads go on until the program ends, and may make files in the folder meanwhile.
void remove_folders() {
  for (Slot& slot : slots) {
    if (!slot.is_used) continue;
    const int folder = ::open(slot.path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (folder < 0) continue;
    for (int attempt = 0; attempt < 100; ++attempt) {
      empty_folder(folder, 0);
      if (::rmdir(slot.path) == 0) break;
    }
    ::close(folder);
  }
}

}  // namespace

void remove_on_signal(const std::string& path) {
  tools::clean_up_with(remove_folders);
  for (Slot& slot : slots) {
    if (slot.is_used || path.size() >= sizeof slot.path) continue;
    path.copy(slot.path, path.size());
    slot.path[path.size()] = 0;
    slot.is_used = true;
    return;
  }
}

void forget_folder(const std::string& path) {
  for (Slot& slot : slots)
    if (slot.is_used && path == slot.path) slot.is_used = false;
}

}  // namespace scree::lab
