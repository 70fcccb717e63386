// The flag that stops a job between two of its steps. Null: nothing stops it.
#pragma once

#include <atomic>

#include "format/result.h"

namespace scree::tools {

inline bool is_stopped(const std::atomic<bool>* stop) {
  return stop != nullptr && stop->load(std::memory_order_relaxed);
}

/// Error kFile "interrupted" once the flag is raised.
inline Result<void> check_stop(const std::atomic<bool>* stop) {
  if (is_stopped(stop)) return Error{ErrorCode::kFile, "interrupted"};
  return {};
}

}  // namespace scree::tools
