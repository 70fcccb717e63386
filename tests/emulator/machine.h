// A GPU emulated on one CPU thread: the lanes of a kernel are fibers, and the collectives switch between them. Its
// purpose is to test kernels without a GPU, under the address and undefined behaviour sanitizers. It exists only if
// SCREE_EMULATED_GPU is set, and its speed is not that of any GPU.
//
// SCREE_EMULATED_GPU=1 is one GPU of compute capability 9.0 with 16 GiB. A list such as 6.1,7.5,9.0:512 is several
// GPUs, of which the last has 512 MiB. Kernels have code for 8.0 and newer. SCREE_EMULATED_DRIVER=12020 is a driver for
// CUDA up to 12.2; 0 is no driver.
//
// It is stricter than a GPU:
// - Blocks of a kernel, warps and lanes take turns in an order that depends on a seed (SCREE_EMULATOR_SEED), at every
//   collective and at some atomics.
// - Shared memory and device memory begin as garbage.
// - A warp's collective ends the program if a lane of its mask has ended (which CUDA allows), waits in another
//   collective, or passed no value that another lane reads.
//
// It does not detect: two lanes that write one address without an atomic; a kernel that reads host memory, or a host
// that reads a GPU's; memory freed while work with it is under way; more threads than __launch_bounds__; garbage past
// the first 1 MiB of an allocation. Host functions of .cu files call the GPU forms of shared functions.
#pragma once

#include <cuda_runtime.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>

namespace scree::emulator {

inline constexpr uint32_t kWarpLanes = 32;
inline constexpr int kGarbage = 0xa5;  // each byte of unwritten memory
inline constexpr int kMultiprocessors = 2;
inline constexpr int kMultiprocessorThreads = 2048;
inline constexpr int kMaxThreads = 1024;            // per block
inline constexpr size_t kSharedBytes = 227 * 1024;  // per block, if the kernel's attribute allows it; else 48 KiB

/// The position of the running lane.
const uint3& thread_index();
const uint3& block_index();
const dim3& block_size();
const dim3& grid_size();

/// `bytes` of the running block's shared memory, for the declaration that has this number in its source file.
void* shared_memory(uint32_t declaration, size_t bytes);
/// The dynamic shared memory of the launch.
void* dynamic_shared_memory();

/// The values that the lanes of a mask passed; the other lanes' are not set.
struct Passed {
  std::array<uint64_t, kWarpLanes> values{};
  uint32_t odd = 0;  // the lanes whose value is odd, a bit each
};
/// Passes `value` to the lanes of `mask` and waits for theirs. The result is valid until the lane's next call. `what`:
/// the collective's name.
const Passed& exchange_in_warp(const char* what, uint32_t mask, uint64_t value);
void sync_block();

/// Requests a copy of 4, 8 or 16 bytes for the running lane, ends a group of copies, and waits for all groups except
/// the last `groups`.
void copy_later(void* to, const void* from, size_t bytes);
void end_copies();
void wait_for_copies(uint32_t groups);

/// May let other lanes run first.
void pause_at_atomic();

/// Bytes that are allocated now, and their peak, on a GPU or of pinned memory. reset_peaks() resets the peak.
struct MemoryInUse {
  uint64_t now = 0, peak = 0;
};
MemoryInUse memory_of_gpu(int index);
MemoryInUse pinned_memory();
void reset_peaks();

/// A number below `bound` from the seed's sequence.
uint32_t random_below(uint32_t bound);

/// A launched kernel with its parameters. Only one runs at a time: the caller of run() holds a lock.
struct Grid {
  const char* name;
  dim3 blocks, threads;
  size_t shared_bytes;
  std::function<void()> lane;  // code of each lane
};
void run(const Grid& grid);

/// Registers the kernel behind `function`: its name, and a function that copies the parameters of a launch.
using Bind = std::function<void()> (*)(const void* function, void** parameters);
void add_kernel(const void* function, const char* name, Bind bind);

/// Ends the program with one line.
[[noreturn]] void fail(const char* format, ...) __attribute__((format(printf, 1, 2)));

}  // namespace scree::emulator
