// Calls that fail on purpose, or move less than they were asked to. The program under test is linked with --wrap for
// every call below, so that its own objects and the static libraries come here first; one counter serves files, memory
// and the GPU. Lost: LD_PRELOAD. It would not see the CUDA runtime, which is linked statically, and ASan's runtime
// wants to be the first library and to own malloc.
#pragma once

#include <cstdint>
#include <vector>

namespace scree::faults {

enum class Kind : uint32_t {
  kFile,    // open, read, write, map, rename, ...
  kMemory,  // malloc and operator new, and threads
  kDevice,  // CUDA
  kShort,   // read and write, which succeed with half of the bytes
};

/// Asked by each wrapped call: whether this one fails. `what`: the call's name. `site`: where it was called from;
/// `size`: bytes asked for, of memory. Thread-safe.
bool fails(Kind kind, const char* what, const void* site, uint64_t size = 0);

/// What a run counts and which call fails in it; lies in memory that forked children share with their parent.
struct Plan {
  Kind kind = Kind::kFile;
  uint64_t site = 0;    // fails at its first call, as `sites` has it; 0: none
  uint64_t number = 0;  // the call of that number fails, from 1; 0: none
  bool every = false;   // all calls do
  char from[32] = {};   // calls count from the first of this name on, of whatever kind it is; empty: from the start
};

/// While one lives, calls of its thread are somebody else's: a library's that is not ours to test. They are not
/// counted.
class Foreign {
 public:
  Foreign();
  Foreign(const Foreign&) = delete;
  Foreign& operator=(const Foreign&) = delete;
  ~Foreign();
};

/// Makes memory that this process shares with those that it forks from now on; before anything else here.
void prepare();
/// From now on calls are counted, and the plan's fails.
void arm(const Plan& plan);
void disarm();

/// Of the run that was armed last. The name is empty where no call failed.
uint64_t call_count();
const char* failed_call();
uint64_t run_number();          // which that is, from 1
void add_live(int by);          // what is taken and given back by calls, where nothing else sees to it
int64_t live_count();           // what was taken in that run and not given back; 0 where it never came to disarm()
std::vector<uint64_t> sites();  // each place that calls came from (memory: and each size), by its first call

}  // namespace scree::faults
