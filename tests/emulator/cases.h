// Kernels for tests of the emulated GPU itself.
#pragma once

#include <string>

namespace scree::emulator {

/// Errors in the results of collectives, atomics and intrinsics; empty if there are none.
std::string check_intrinsics();

/// Errors of shared memory and of copies to it; empty if there are none.
std::string check_shared_memory();

/// Errors in the order of work on streams; empty if there are none.
std::string check_streams();

/// Runs an invalid kernel, or makes an invalid call: the program ends.
enum class Mistake {
  kEndedLane,
  kOtherCollective,
  kForeignLane,
  kNotOfMask,
  kStuck,
  kCopyTooLong,
  kSharedTooLong,
  kOverrun
};
void make(Mistake mistake);

}  // namespace scree::emulator
