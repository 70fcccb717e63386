// Calls that fail on purpose, or transfer less than requested. The program under test is linked with --wrap for every
// call below, so that calls from its own objects and from static libraries reach the wrappers first. One counter covers
// files, memory and the GPU. LD_PRELOAD was rejected: it does not cover the CUDA runtime, which is linked statically,
// and ASan's runtime has to be the first library and provide malloc.
#pragma once

#include <cstdint>
#include <vector>

namespace scree::faults {

inline constexpr uint64_t kMaxSites = 1 << 16;

enum class Kind : uint32_t {
  kFile,    // open, read, write, map, rename, ...
  kMemory,  // malloc and operator new, and threads
  kDevice,  // CUDA
  kShort,   // read and write, which succeed with half of the bytes
};

/// Called by each wrapped call: returns whether the call has to fail. `what`: its name. `site`: the address from which
/// it was called. `size`: the requested bytes, for memory. Thread-safe.
bool fails(Kind kind, const char* what, const void* site, uint64_t size = 0);

/// The calls that a run counts, and the call that fails. Lies in memory that forked children share with their parent.
struct Plan {
  Kind kind = Kind::kFile;
  uint64_t site = 0;    // the first call of this entry of `sites` fails; 0: none
  uint64_t number = 0;  // the call with this number fails, from 1; 0: none
  bool every = false;   // all calls fail
  char from[32] = {};   // counting begins with the first call of this name, of any kind; empty: at the start
};

/// While one exists, calls of its thread come from a library that is not under test. They are not counted.
class Foreign {
 public:
  Foreign();
  Foreign(const Foreign&) = delete;
  Foreign& operator=(const Foreign&) = delete;
  ~Foreign();
};

/// Makes memory that this process shares with the processes that it forks from now on. Must be called first.
void prepare();
/// From now on calls are counted, and the plan's call fails.
void arm(const Plan& plan);
void disarm();

/// Results of the last armed run. The name is empty if no call failed.
uint64_t call_count();
const char* failed_call();
uint64_t run_number();          // number of the last run, from 1
void add_live(int by);          // counts resources that calls allocate and free, where nothing else checks them
int64_t live_count();           // resources that the run has not freed; 0 if it never reached disarm()
std::vector<uint64_t> sites();  // every site of a call (for memory: and size), in the order of first calls

}  // namespace scree::faults
