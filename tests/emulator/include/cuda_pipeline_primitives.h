// Asynchronous copies to shared memory. A copy is made only when a lane waits for it, so that an earlier read gets
// other data.
#pragma once

#include <cstddef>

#include "tests/emulator/machine.h"

inline void __pipeline_memcpy_async(void* to, const void* from, size_t bytes) {
  scree::emulator::copy_later(to, from, bytes);
}
inline void __pipeline_commit() {
  scree::emulator::end_copies();
}
inline void __pipeline_wait_prior(uint32_t groups) {
  scree::emulator::wait_for_copies(groups);
}
