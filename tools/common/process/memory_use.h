// Memory of this process, as the system counts it.
#pragma once

#include <cstdint>

namespace scree::tools {

/// Bytes; all 0 without /proc.
struct MemoryUse {
  uint64_t anonymous = 0;  // resident now, private to the process: RssAnon + RssShmem
  uint64_t file = 0;       // resident now, of mapped files, including the program itself
  uint64_t peak = 0;       // largest resident total so far
};
MemoryUse memory_use();

/// An upper bound of the process's peak of anonymous memory since it began, or since reset_peak(). It is too large by
/// the bytes of the program's own file that became resident since `before` was taken (a few MiB).
uint64_t peak_anonymous(const MemoryUse& before);

/// Resets the peak to the currently resident memory. Has no effect without /proc.
void reset_peak();

/// Memory that programs can allocate now without swapping, as the system estimates it; 0 without /proc.
uint64_t available_memory();

/// Returns free memory of the heap to the system.
void trim_heap();

}  // namespace scree::tools
