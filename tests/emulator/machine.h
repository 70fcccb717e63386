// A GPU emulated on one thread of the CPU: blocks, warps and lanes of a kernel as fibers that the collectives switch
// between. What it is for: tests of the kernels where there is no GPU, with the address and undefined behaviour
// sanitizers watching them. It is there where SCREE_EMULATED_GPU is set, and says nothing about speed.
//
// SCREE_EMULATED_GPU=1 is one GPU of compute capability 9.0 with 16 GiB; a list such as 6.1,7.5,9.0:512 is several, the
// last with 512 MiB. Kernels have code for 8.0 and newer. SCREE_EMULATED_DRIVER=12020 is a driver for CUDA up to 12.2, 0
// none.
//
// What it is stricter in than a GPU: blocks of a kernel, warps and lanes take turns in an order that a seed decides
// (SCREE_EMULATOR_SEED), at every collective and at some atomics; shared memory and device memory begin as garbage; a
// warp's collective ends the program where a lane of its mask has ended (which CUDA allows), waits in another one, or
// is asked for a value that it did not bring. What it does not show: two lanes that write one place without an atomic;
// a kernel that reads host memory, or a host that reads a GPU's; memory given back while work with it is under way;
// more threads than __launch_bounds__; garbage past the first 16 MiB of an allocation. Host functions of .cu files run
// as a GPU's forms of what they call.
#pragma once

#include <cuda_runtime.h>

#include <cstddef>
#include <cstdint>
#include <functional>

namespace scree::emulator {

inline constexpr uint32_t kWarpLanes = 32;
inline constexpr int kGarbage = 0xa5;  // each byte of memory that nothing was written to
inline constexpr int kMultiprocessors = 2;
inline constexpr int kMultiprocessorThreads = 2048;
inline constexpr int kMaxThreads = 1024;            // of a block
inline constexpr size_t kSharedBytes = 227 * 1024;  // of a block, where the kernel's attribute allows it; else 48 KiB

/// Where the running lane stands.
const uint3& thread_index();
const uint3& block_index();
const dim3& block_size();
const dim3& grid_size();

/// `bytes` of the running block's shared memory, for the declaration that has this number in its source file.
void* shared_memory(uint32_t declaration, size_t bytes);
/// What the launch asked for.
void* dynamic_shared_memory();

/// Leaves `value` for the lanes of `mask` and waits for what they leave: 32 values, of which those of the mask are set.
/// They hold until the lane's next call. `what` is the collective's name.
const uint64_t* meet_warp(const char* what, uint32_t mask, uint64_t value);
void meet_block();

/// A copy of 4, 8 or 16 bytes of the running lane's, the end of a group of them, and the wait for all groups but the
/// last `groups`.
void copy_later(void* to, const void* from, size_t bytes);
void end_copies();
void wait_for_copies(uint32_t groups);

/// Perhaps lets other lanes run first.
void pause_at_atomic();

/// What is allocated now and was at most, on a GPU and of pinned memory; the most begins anew with forget_peaks().
struct MemoryInUse {
  uint64_t now = 0;
  uint64_t peak = 0;
};
MemoryInUse memory_of_gpu(int index);
MemoryInUse pinned_memory();
void forget_peaks();

/// A number below `bound`, of the seed's sequence.
uint32_t random_below(uint32_t bound);

/// A kernel with its parameters, as it was launched. One runs at a time: who calls run() holds a lock.
struct Grid {
  const char* name;
  dim3 blocks;
  dim3 threads;
  size_t shared_bytes;
  std::function<void()> lane;  // what each lane runs
};
void run(const Grid& grid);

/// What the kernel behind `function` is: its name, and how the parameters that a launch points to are kept.
using Bind = std::function<void()> (*)(const void* function, void** parameters);
void add_kernel(const void* function, const char* name, Bind bind);

/// Ends the program with one line.
[[noreturn]] void fail(const char* format, ...) __attribute__((format(printf, 1, 2)));

}  // namespace scree::emulator
