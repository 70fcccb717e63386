// Kernels for tests of the emulated GPU itself.
#pragma once

#include <string>

namespace scree::emulator {

/// What is wrong with what the collectives, atomics and intrinsics give; empty where all is right.
std::string check_intrinsics();

/// What is wrong with shared memory and the copies into it; empty where all is right.
std::string check_shared_memory();

/// What is wrong with when work of streams is done; empty where all is right.
std::string check_streams();

/// Runs a kernel, or makes a call, that is wrong: the program ends.
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
