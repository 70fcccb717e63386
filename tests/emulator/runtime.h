// The state of the emulated CUDA runtime, which its calls share. Only one call runs at a time.
#pragma once

#include <cuda_runtime.h>

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "tests/emulator/machine.h"

namespace scree::emulator {

using Clock = std::chrono::steady_clock;

/// The work of `stream` before its number `end`.
struct Point {
  CUstream_st* stream;
  uint64_t end;
};

struct Work {
  std::function<void()> run;
  std::vector<Point> after;
};

}  // namespace scree::emulator

struct CUgraphNode_st {
  const struct CUgraph_st* graph;
  size_t number;           // in the graph
  std::set<size_t> after;  // numbers of the nodes before it
  std::function<void()> work;
};
struct CUgraph_st {
  std::deque<CUgraphNode_st> nodes;
};
struct CUgraphExec_st {
  std::vector<CUgraphNode_st> nodes;
};

struct CUstream_st {
  int gpu = 0;
  bool waits_for_null = false;  // ordered with the null stream of its GPU, both ways
  bool is_destroyed = false, is_running = false;
  uint64_t done = 0;
  std::deque<scree::emulator::Work> waiting;

  scree::emulator::Point end() { return {this, done + waiting.size()}; }
};

struct CUevent_st {
  struct Record {
    scree::emulator::Point at;
    bool is_timed;
    scree::emulator::Clock::time_point time;
  };
  bool is_timed = true;
  std::shared_ptr<Record> last;  // null: never recorded
};

namespace scree::emulator {

constexpr size_t kDeviceBytes = size_t{16} << 30;
constexpr size_t kUnaskedSharedBytes = 48 * 1024;
constexpr int kPinned = -1;  // in place of a GPU's number

struct Allocation {
  size_t bytes;
  bool is_device;
  int gpu;
};

struct Gpu {
  int major = 9, minor = 0;
  size_t bytes = kDeviceBytes;
};

/// The GPU with this number in SCREE_EMULATED_GPU.
std::optional<Gpu> listed_gpu(int number);

struct Kernel {
  const char* name = nullptr;
  Bind bind = nullptr;
  size_t shared_bytes = kUnaskedSharedBytes;
};

struct Device {
  std::recursive_mutex mutex;
  std::map<int, CUstream_st> null_streams;  // by GPU
  std::deque<std::unique_ptr<CUstream_st>> streams;
  std::deque<std::unique_ptr<CUstream_st>> destroyed_streams;  // events may still refer to them
  std::map<uintptr_t, Allocation> allocations;
  std::map<const void*, Kernel> kernels;
  std::map<int, MemoryInUse> in_use;                // by GPU; pinned memory is under kPinned
  std::vector<std::unique_ptr<CUgraph_st>> graphs;  // not destroyed yet
  std::set<std::pair<int, int>> peers;              // GPUs that may read the memory of others
};

Device& device();

inline thread_local int current_gpu = 0;

/// Notes the calling thread's last error, and returns it.
cudaError_t failed(cudaError_t error);

/// The stream behind a handle; the null stream of the current GPU for null.
CUstream_st* stream_of(cudaStream_t stream);

/// Appends work to a stream, after the work at the points `after`.
Point submit(CUstream_st* stream, std::function<void()> run, std::vector<Point> after = {});

/// Does all work before `point`.
void reach(Point point);

/// Does all submitted work of a GPU; with kPinned, the work of all GPUs.
void finish(int gpu);

}  // namespace scree::emulator
