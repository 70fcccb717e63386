// A full disk for tests.
#pragma once

#include <sys/resource.h>

#include <csignal>

#include "tests/catch.h"

namespace scree::tests {

/// While it exists, files cannot grow past `bytes`: write() fails as on a full disk, because SIGXFSZ is ignored.
class FullDisk {
 public:
  explicit FullDisk(rlim_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    REQUIRE(::getrlimit(RLIMIT_FSIZE, &before_) == 0);
    rlimit limit = before_;
    limit.rlim_cur = bytes;
    REQUIRE(::setrlimit(RLIMIT_FSIZE, &limit) == 0);
  }
  ~FullDisk() {
    ::setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  rlimit before_{};
  void (*handler_)(int);
};

/// The result of `work` on a full disk. Checks come after it, because their output may go to a file.
template <class Work>
auto on_full_disk(rlim_t bytes, const Work& work) {
  const FullDisk full(bytes);
  return work();
}

}  // namespace scree::tests
