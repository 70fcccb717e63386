// Calls that fail on purpose. The program under test is linked with --wrap for every call below, so that its own
// objects and the static libraries come here first; one counter serves files, memory and the GPU.
// Lost: LD_PRELOAD. It would not see the CUDA runtime, which is linked statically, and ASan's runtime wants to be the
// first library and to own malloc.
#pragma once

#include <cstdint>
#include <vector>

namespace scree::faults {

enum class Kind : uint32_t {
  kFile,    // open, read, write, map, rename, ...
  kMemory,  // malloc and operator new, and threads
  kDevice,  // CUDA
};

/// Asked by each wrapped call: whether this one fails. `what`: the call's name. `site`: where it was called from;
/// `size`: bytes asked for, of memory. Thread-safe.
bool fails(Kind kind, const char* what, const void* site, uint64_t size = 0);

/// What a run counts and which call fails in it; lies in memory that forked children share with their parent.
struct Plan {
  Kind kind = Kind::kFile;
  uint64_t site = 0;    // fails at its first call, as `sites` has it; 0: none
  uint64_t number = 0;  // the call of that number fails, from 1; 0: none
  char from[32] = {};   // calls count from the first of this name on, of whatever kind it is; empty: from the start
};

/// Makes the shared memory; once, before anything else here.
void prepare();
/// From now on calls are counted, and the plan's fails.
void arm(const Plan& plan);
void disarm();

/// Of the run that was armed last. The name is empty where no call failed.
uint64_t call_count();
const char* failed_call();
std::vector<uint64_t> sites();  // each place that calls came from (memory: and each size), by its first call

}  // namespace scree::faults
