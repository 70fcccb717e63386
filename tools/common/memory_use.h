// What this process takes of the machine's memory, as the system counts it.
#pragma once

#include <cstdint>

namespace scree::tools {

/// Bytes; all 0 where /proc does not say.
struct MemoryUse {
  uint64_t anonymous = 0;  // resident now, of the process alone: RssAnon + RssShmem
  uint64_t file = 0;       // resident now, of mapped files: the program itself
  uint64_t peak = 0;       // the most that was resident at once, of both
};
MemoryUse memory_use();

/// The most anonymous memory that the process ever had, at least; too much by what of the program's own file became
/// resident since `before` was taken (a few MiB).
uint64_t peak_anonymous(const MemoryUse& before);

/// The peak is from now on what is resident now; where the system does not let (no /proc), it stays.
void forget_peak();

/// What the system says that programs may take now without swapping; 0 where /proc does not say.
uint64_t available_memory();

/// Gives what the allocator keeps for later back to the system.
void give_back_free_memory();

}  // namespace scree::tools
