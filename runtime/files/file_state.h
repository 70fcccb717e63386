// Compares two states of a file, to find out whether it has changed since it was opened. Signal handlers may call this.
#pragma once

#include <sys/stat.h>

namespace scree::runtime {

/// Whether both are states of one file, which may have got another name.
inline bool is_one_file(const struct stat& a, const struct stat& b) {
  return a.st_dev == b.st_dev && a.st_ino == b.st_ino;
}

/// Whether a file has the same size and the same time of change of its contents in both states.
inline bool has_same_contents(const struct stat& a, const struct stat& b) {
  return a.st_size == b.st_size && a.st_mtim.tv_sec == b.st_mtim.tv_sec && a.st_mtim.tv_nsec == b.st_mtim.tv_nsec;
}

}  // namespace scree::runtime
