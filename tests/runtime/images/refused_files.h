// Image files that must be refused.
#pragma once

#include <span>

#include "runtime/images/image.h"
#include "tests/results.h"
#include "tests/runtime/images/block_files.h"

namespace scree::tests {

struct RefusedFile {
  FileBytes bytes;
  ErrorCode code;
  const char* message;  // the beginning of the error's message
};

inline void check_refused(std::span<const RefusedFile> files) {
  for (const RefusedFile& one : files) {
    INFO(one.message);
    const auto checked = refusal(runtime::check_image(one.bytes));
    INFO(checked.message);
    CHECK(checked.code == one.code);
    CHECK(checked.message.starts_with(one.message));
  }
}

/// Checks that every prefix is refused, and that nothing past its end is read.
inline void check_prefixes_refused(const FileBytes& whole) {
  for (size_t size = 0; size < whole.size(); ++size) {
    FileBytes prefix(whole.begin(), whole.begin() + static_cast<ptrdiff_t>(size));
    prefix.shrink_to_fit();
    CHECK_FALSE(runtime::check_image(prefix));
  }
}

}  // namespace scree::tests
