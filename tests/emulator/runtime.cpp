// The calls of the CUDA runtime that scree makes, for the emulated GPU. Work submitted to a stream is queued. It is
// done when the program waits for it, or earlier at random. So a result that is used without a wait is missing, and the
// pinned memory of a copy must stay valid until the program has waited for the copy.
#include <cuda_runtime.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "tests/emulator/machine.h"

using scree::emulator::fail;
using scree::emulator::random_below;

/// A function that kernels call, and that glibc's math.h declares but does not export.
extern "C" float __log2f(float value) noexcept {
  return std::log2(value);
}

namespace {

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

}  // namespace

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
  std::deque<Work> waiting;

  Point end() { return {this, done + waiting.size()}; }
};

struct CUevent_st {
  struct Record {
    Point at;
    bool is_timed;
    Clock::time_point time;
  };
  bool is_timed = true;
  std::shared_ptr<Record> last;  // null: never recorded
};

namespace {

constexpr size_t kDeviceBytes = size_t{16} << 30;
constexpr int kLeastMajor = 8;  // kernels have no code for older GPUs
constexpr size_t kAlignment = 256;
constexpr size_t kGarbageBytes = size_t{16} << 20;  // filled per allocation; more would take too long
constexpr size_t kUnaskedSharedBytes = 48 * 1024;

struct Allocation {
  size_t bytes;
  bool is_device;
  int gpu;
};

struct Gpu {
  int major = 9, minor = 0;
  size_t bytes = kDeviceBytes;
};

/// The GPUs listed in SCREE_EMULATED_GPU.
std::vector<Gpu> listed_gpus() {
  const char* const text = std::getenv("SCREE_EMULATED_GPU");
  if (text == nullptr) return {};
  std::vector<Gpu> gpus;
  std::istringstream items(text);
  for (std::string item; std::getline(items, item, ',');) {
    Gpu gpu;
    unsigned long long mebibytes = 0;
    const int read = std::sscanf(item.c_str(), "%d.%d:%llu", &gpu.major, &gpu.minor, &mebibytes);
    if (read < 2) gpu = {};
    if (read == 3) gpu.bytes = static_cast<size_t>(mebibytes) << 20;
    gpus.push_back(gpu);
  }
  return gpus;
}

std::optional<Gpu> listed_gpu(int number) {
  const std::vector<Gpu> gpus = listed_gpus();
  return number >= 0 && static_cast<size_t>(number) < gpus.size() ? std::optional(gpus[number]) : std::nullopt;
}

int driver_version() {
  const char* const text = std::getenv("SCREE_EMULATED_DRIVER");
  return text != nullptr ? std::atoi(text) : CUDART_VERSION;
}

struct Kernel {
  const char* name = nullptr;
  scree::emulator::Bind bind = nullptr;
  size_t shared_bytes = kUnaskedSharedBytes;
};

/// State that the calls share. Only one call runs at a time.
struct Device {
  std::recursive_mutex mutex;
  std::map<int, CUstream_st> null_streams;  // by GPU
  std::deque<std::unique_ptr<CUstream_st>> streams;
  std::deque<std::unique_ptr<CUstream_st>> destroyed_streams;  // events may still refer to them
  std::map<uintptr_t, Allocation> allocations;
  std::map<const void*, Kernel> kernels;
  std::map<int, scree::emulator::MemoryInUse> in_use;  // by GPU; pinned memory is under kPinned
  std::vector<std::unique_ptr<CUgraph_st>> graphs;     // not destroyed yet
  std::set<std::pair<int, int>> peers;                 // GPUs that may read the memory of others
};

Device& device() {
  static Device* const made = new Device;  // never freed, for code that runs at exit
  return *made;
}

constexpr int kPinned = -1;
thread_local int current_gpu = 0;
thread_local cudaError_t last_error = cudaSuccess;

cudaError_t failed(cudaError_t error) {
  last_error = error;
  return error;
}

CUstream_st* null_stream_of(int gpu) {
  CUstream_st& stream = device().null_streams[gpu];
  stream.gpu = gpu;
  return &stream;
}

CUstream_st* stream_of(cudaStream_t stream) {
  if (stream == nullptr) return null_stream_of(current_gpu);
  if (stream->is_destroyed) fail("a stream is used after it was destroyed");
  return stream;
}

/// Does all work before `point`.
void reach(Point point) {
  CUstream_st& stream = *point.stream;
  while (stream.done < point.end) {
    if (stream.is_running) fail("work of a stream waits for itself");
    stream.is_running = true;
    const Work work = std::move(stream.waiting.front());
    for (const Point& before : work.after) reach(before);
    work.run();
    stream.waiting.pop_front();
    ++stream.done;
    stream.is_running = false;
  }
}

Point submit(CUstream_st* stream, std::function<void()> run, std::vector<Point> after = {}) {
  Device& all = device();
  CUstream_st* const null_stream = null_stream_of(stream->gpu);
  if (stream == null_stream) {
    for (const auto& other : all.streams)
      if (other->gpu == stream->gpu && other->waits_for_null && !other->waiting.empty()) after.push_back(other->end());
  } else if (stream->waits_for_null && !null_stream->waiting.empty()) {
    after.push_back(null_stream->end());
  }
  stream->waiting.push_back({std::move(run), std::move(after)});
  const Point end = stream->end();
  // A GPU may be arbitrarily fast, so the work may be done at once.
  if (random_below(4) == 0) {
    const uint32_t number = random_below(static_cast<uint32_t>(all.streams.size()) + 1);
    CUstream_st* const any = number == all.streams.size() ? null_stream : all.streams[number].get();
    if (!any->waiting.empty()) reach({any, any->done + 1 + random_below(static_cast<uint32_t>(any->waiting.size()))});
  }
  return end;
}

/// The allocation at an address; null if CUDA did not allocate it.
const Allocation* allocation_at(const void* at, size_t bytes) {
  const auto& all = device().allocations;
  const auto address = reinterpret_cast<uintptr_t>(at);
  auto found = all.upper_bound(address);
  if (found == all.begin()) return nullptr;
  --found;
  if (address - found->first >= std::max<size_t>(found->second.bytes, 1)) return nullptr;
  if (bytes > found->second.bytes - (address - found->first)) {
    fail("%zu bytes at %zu of an allocation of %zu", bytes, static_cast<size_t>(address - found->first),
         found->second.bytes);
  }
  return &found->second;
}

void add_allocation(void* memory, size_t bytes, bool is_device) {
  Device& all = device();
  const int gpu = is_device ? current_gpu : kPinned;
  std::memset(memory, scree::emulator::kGarbage, std::min(bytes, kGarbageBytes));
  all.allocations[reinterpret_cast<uintptr_t>(memory)] = {bytes, is_device, gpu};
  scree::emulator::MemoryInUse& in_use = all.in_use[gpu];
  in_use.now += bytes;
  in_use.peak = std::max(in_use.peak, in_use.now);
}

cudaError_t allocate(void** out, size_t bytes, bool is_device) {
  Device& all = device();
  const std::lock_guard lock(all.mutex);
  *out = nullptr;
  if (is_device && bytes > listed_gpu(current_gpu).value_or(Gpu{}).bytes - all.in_use[current_gpu].now)
    return failed(cudaErrorMemoryAllocation);
  if (bytes == 0) return cudaSuccess;
  void* made = nullptr;
  if (posix_memalign(&made, kAlignment, bytes) != 0) return failed(cudaErrorMemoryAllocation);
  add_allocation(made, bytes, is_device);
  *out = made;
  return cudaSuccess;
}

/// Does all submitted work of a GPU; with kPinned, the work of all GPUs.
void finish(int gpu) {
  Device& all = device();
  for (auto& [of, stream] : all.null_streams)
    if (gpu == kPinned || of == gpu) reach(stream.end());
  for (const auto& stream : all.streams)
    if (gpu == kPinned || stream->gpu == gpu) reach(stream->end());
}

/// Waits for all submitted work first.
cudaError_t remove_allocation(void* block, bool is_device) {
  Device& all = device();
  const std::lock_guard lock(all.mutex);
  finish(kPinned);
  const auto found = all.allocations.find(reinterpret_cast<uintptr_t>(block));
  if (found == all.allocations.end() || found->second.is_device != is_device) return failed(cudaErrorInvalidValue);
  all.in_use[found->second.gpu].now -= found->second.bytes;
  all.allocations.erase(found);
  return cudaSuccess;
}

cudaError_t give_back(void* block, bool is_device) {
  if (block == nullptr) return cudaSuccess;
  const cudaError_t removed = remove_allocation(block, is_device);
  if (removed == cudaSuccess) std::free(block);
  return removed;
}

struct Copy {
  void* to;
  const void* from;
  size_t bytes;
};

/// Submits the copies. Memory that is not pinned is read or written before the call returns.
cudaError_t submit_copies(std::vector<Copy> copies, cudaMemcpyKind kind, cudaStream_t stream, bool waits) {
  const std::lock_guard lock(device().mutex);
  for (const Copy& copy : copies) {
    if (copy.bytes == 0) continue;
    const Allocation* const to = allocation_at(copy.to, copy.bytes);
    const Allocation* const from = allocation_at(copy.from, copy.bytes);
    const bool to_device = to != nullptr && to->is_device;
    const bool from_device = from != nullptr && from->is_device;
    if (kind == cudaMemcpyHostToDevice && (!to_device || from_device)) return failed(cudaErrorInvalidValue);
    if (kind == cudaMemcpyDeviceToHost && (to_device || !from_device)) return failed(cudaErrorInvalidValue);
    if (kind == cudaMemcpyDeviceToDevice && !(to_device && from_device)) return failed(cudaErrorInvalidValue);
    waits = waits || to == nullptr || from == nullptr;
  }
  const Point end = submit(stream_of(stream), [copies = std::move(copies)] {
    for (const Copy& copy : copies)
      if (copy.bytes != 0) std::memcpy(copy.to, copy.from, copy.bytes);
  });
  if (waits) reach(end);
  return cudaSuccess;
}

cudaError_t submit_set(void* at, int value, size_t bytes, cudaStream_t stream) {
  const std::lock_guard lock(device().mutex);
  if (bytes == 0) return cudaSuccess;
  if (allocation_at(at, bytes) == nullptr) return failed(cudaErrorInvalidValue);
  submit(stream_of(stream), [=] { std::memset(at, value, bytes); });
  return cudaSuccess;
}

cudaError_t make_stream(cudaStream_t* out, bool waits_for_null) {
  const std::lock_guard lock(device().mutex);
  *out = device().streams.emplace_back(std::make_unique<CUstream_st>()).get();
  (*out)->waits_for_null = waits_for_null;
  (*out)->gpu = current_gpu;
  return cudaSuccess;
}

cudaError_t make_event(cudaEvent_t* out, bool is_timed) {
  *out = new CUevent_st;
  (*out)->is_timed = is_timed;
  return cudaSuccess;
}

/// Sets `out` to the work of a launched kernel.
cudaError_t bind_launch(const void* function, dim3 blocks, dim3 threads, void** parameters, size_t shared_bytes,
                        std::function<void()>& out) {
  const Kernel& kernel = device().kernels.at(function);
  const uint64_t in_block = uint64_t{threads.x} * threads.y * threads.z;
  const uint64_t in_grid = uint64_t{blocks.x} * blocks.y * blocks.z;
  const bool fits = in_grid != 0 && blocks.x <= 0x7fffffffu && blocks.y <= 0xffffu && blocks.z <= 0xffffu &&
                    in_block != 0 && in_block <= scree::emulator::kMaxThreads && shared_bytes <= kernel.shared_bytes;
  if (!fits) return failed(cudaErrorInvalidConfiguration);
  scree::emulator::Grid grid{kernel.name, blocks, threads, shared_bytes, kernel.bind(function, parameters)};
  out = [grid = std::move(grid)] { scree::emulator::run(grid); };
  return cudaSuccess;
}

cudaError_t submit_kernel(const void* function, dim3 blocks, dim3 threads, void** parameters, size_t shared_bytes,
                          cudaStream_t stream) {
  const std::lock_guard lock(device().mutex);
  std::function<void()> work;
  if (const cudaError_t bound = bind_launch(function, blocks, threads, parameters, shared_bytes, work);
      bound != cudaSuccess)
    return bound;
  if (stream != nullptr && stream->gpu != current_gpu) return failed(cudaErrorInvalidResourceHandle);
  submit(stream_of(stream), std::move(work));
  return cudaSuccess;
}

/// Sets `out` to the work of a graph's kernel.
cudaError_t bind_node(const cudaKernelNodeParams& kernel, std::function<void()>& out) {
  return bind_launch(kernel.func, kernel.gridDim, kernel.blockDim, kernel.kernelParams, kernel.sharedMemBytes, out);
}

}  // namespace

scree::emulator::MemoryInUse scree::emulator::memory_of_gpu(int index) {
  const std::lock_guard lock(device().mutex);
  return device().in_use[index];
}

scree::emulator::MemoryInUse scree::emulator::pinned_memory() {
  return memory_of_gpu(kPinned);
}

void scree::emulator::reset_peaks() {
  const std::lock_guard lock(device().mutex);
  for (auto& [index, in_use] : device().in_use) in_use.peak = in_use.now;
}

void scree::emulator::add_kernel(const void* function, const char* name, Bind bind) {
  const std::lock_guard lock(device().mutex);
  Kernel& kernel = device().kernels[function];  // may be a kernel whose attribute was set before
  kernel.name = name;
  kernel.bind = bind;
}

extern "C" {

cudaError_t cudaMalloc(void** out, size_t bytes) {
  return allocate(out, bytes, true);
}
cudaError_t cudaMallocHost(void** out, size_t bytes) {
  return allocate(out, bytes, false);
}
cudaError_t cudaHostRegister(void* memory, size_t bytes, unsigned) {
  const std::lock_guard lock(device().mutex);
  if (memory == nullptr || bytes == 0 || allocation_at(memory, 1) != nullptr) return failed(cudaErrorInvalidValue);
  add_allocation(memory, bytes, false);
  return cudaSuccess;
}
cudaError_t cudaHostUnregister(void* memory) {
  return remove_allocation(memory, false);
}
cudaError_t cudaFree(void* block) {
  return give_back(block, true);
}
cudaError_t cudaFreeHost(void* block) {
  return give_back(block, false);
}

cudaError_t cudaPointerGetAttributes(cudaPointerAttributes* out, const void* at) {
  const std::lock_guard lock(device().mutex);
  *out = {};
  const Allocation* const found = allocation_at(at, 1);
  out->type = found == nullptr   ? cudaMemoryTypeUnregistered
              : found->is_device ? cudaMemoryTypeDevice
                                 : cudaMemoryTypeHost;
  out->device = found != nullptr && found->is_device ? found->gpu : kPinned;
  return cudaSuccess;
}

cudaError_t cudaMemGetInfo(size_t* free_bytes, size_t* total) {
  const std::lock_guard lock(device().mutex);
  *total = listed_gpu(current_gpu).value_or(Gpu{}).bytes;
  *free_bytes = *total - device().in_use[current_gpu].now;
  return cudaSuccess;
}

cudaError_t cudaMemcpy(void* to, const void* from, size_t bytes, cudaMemcpyKind kind) {
  return submit_copies({{to, from, bytes}}, kind, nullptr, true);
}
cudaError_t cudaMemcpyAsync(void* to, const void* from, size_t bytes, cudaMemcpyKind kind, cudaStream_t stream) {
  return submit_copies({{to, from, bytes}}, kind, stream, false);
}
#if CUDART_VERSION >= 13000
cudaError_t cudaMemcpyBatchAsync(void* const* to, const void* const* from, const size_t* bytes, size_t count,
                                 cudaMemcpyAttributes*, size_t*, size_t, cudaStream_t stream) {
  if (stream == nullptr) return failed(cudaErrorInvalidValue);
  std::vector<Copy> copies;
  for (size_t i = 0; i < count; ++i) copies.push_back({to[i], from[i], bytes[i]});
  std::reverse(copies.begin(), copies.end());  // copies of one batch have no order
  return submit_copies(std::move(copies), cudaMemcpyDefault, stream, false);
}
#endif
cudaError_t cudaMemset(void* at, int value, size_t bytes) {
  return submit_set(at, value, bytes, nullptr);
}
cudaError_t cudaMemsetAsync(void* at, int value, size_t bytes, cudaStream_t stream) {
  return submit_set(at, value, bytes, stream);
}

cudaError_t cudaGetDeviceCount(int* count) {
  if (driver_version() / 1000 < CUDART_VERSION / 1000) return failed(cudaErrorInsufficientDriver);
  *count = static_cast<int>(listed_gpus().size());
  return *count != 0 ? cudaSuccess : failed(cudaErrorNoDevice);
}
cudaError_t cudaGetDevice(int* number) {
  *number = current_gpu;
  return cudaSuccess;
}
cudaError_t cudaSetDevice(int number) {
  if (number < 0 || static_cast<size_t>(number) >= std::max<size_t>(listed_gpus().size(), 1))
    return failed(cudaErrorInvalidDevice);
  current_gpu = number;
  return cudaSuccess;
}
cudaError_t cudaGetDeviceProperties(cudaDeviceProp* out, int number) {
  const std::optional<Gpu> gpu = listed_gpu(number);
  if (!gpu) return failed(cudaErrorInvalidDevice);
  *out = cudaDeviceProp{};
  std::snprintf(out->name, sizeof out->name, "emulated GPU");
  out->major = gpu->major;
  out->minor = gpu->minor;
  out->totalGlobalMem = gpu->bytes;
  for (size_t i = 0; i < sizeof out->uuid.bytes; ++i) out->uuid.bytes[i] = static_cast<char>(0xe0 + number);
  out->multiProcessorCount = scree::emulator::kMultiprocessors;
  out->warpSize = static_cast<int>(scree::emulator::kWarpLanes);
  out->sharedMemPerBlock = kUnaskedSharedBytes;
  out->sharedMemPerBlockOptin = scree::emulator::kSharedBytes;
  return cudaSuccess;
}
cudaError_t cudaDeviceGetAttribute(int* value, cudaDeviceAttr attribute, int) {
  switch (attribute) {
    case cudaDevAttrMultiProcessorCount:
      *value = scree::emulator::kMultiprocessors;
      return cudaSuccess;
    case cudaDevAttrMaxThreadsPerMultiProcessor:
      *value = scree::emulator::kMultiprocessorThreads;
      return cudaSuccess;
    default:
      return failed(cudaErrorInvalidValue);
  }
}
cudaError_t cudaDriverGetVersion(int* version) {
  *version = driver_version();
  return cudaSuccess;
}

cudaError_t cudaDeviceSynchronize() {
  const std::lock_guard lock(device().mutex);
  finish(current_gpu);
  return cudaSuccess;
}

/// GPUs of one kind read each other's memory.
cudaError_t cudaDeviceCanAccessPeer(int* can, int number, int peer) {
  const std::optional<Gpu> gpu = listed_gpu(number), other = listed_gpu(peer);
  if (!gpu || !other) return failed(cudaErrorInvalidDevice);
  *can = number != peer && gpu->major == other->major && gpu->minor == other->minor ? 1 : 0;
  return cudaSuccess;
}
cudaError_t cudaDeviceEnablePeerAccess(int peer, unsigned) {
  const std::lock_guard lock(device().mutex);
  int can = 0;
  if (const cudaError_t status = cudaDeviceCanAccessPeer(&can, current_gpu, peer); status != cudaSuccess) return status;
  if (can == 0) return failed(cudaErrorPeerAccessUnsupported);
  return device().peers.emplace(current_gpu, peer).second ? cudaSuccess : failed(cudaErrorPeerAccessAlreadyEnabled);
}

cudaError_t cudaStreamCreate(cudaStream_t* stream) {
  return make_stream(stream, true);
}
cudaError_t cudaStreamCreateWithFlags(cudaStream_t* stream, unsigned flags) {
  return make_stream(stream, (flags & cudaStreamNonBlocking) == 0);
}
cudaError_t cudaStreamCreateWithPriority(cudaStream_t* stream, unsigned flags, int) {
  return cudaStreamCreateWithFlags(stream, flags);
}
cudaError_t cudaStreamDestroy(cudaStream_t stream) {
  const std::lock_guard lock(device().mutex);
  reach(stream_of(stream)->end());
  stream->is_destroyed = true;
  std::deque<std::unique_ptr<CUstream_st>>& all = device().streams;
  const auto place = std::find_if(all.begin(), all.end(), [&](const auto& one) { return one.get() == stream; });
  device().destroyed_streams.push_back(std::move(*place));
  all.erase(place);
  return cudaSuccess;
}
/// Visible to nccl.cpp.
__attribute__((visibility("default"))) cudaError_t cudaStreamSynchronize(cudaStream_t stream) {
  const std::lock_guard lock(device().mutex);
  reach(stream_of(stream)->end());
  return cudaSuccess;
}
cudaError_t cudaStreamWaitEvent(cudaStream_t stream, cudaEvent_t event, unsigned) {
  const std::lock_guard lock(device().mutex);
  if (event->last == nullptr) return cudaSuccess;
  CUstream_st* const waiting = stream_of(stream);
  submit(waiting, [] {}, {event->last->at});
  return cudaSuccess;
}

cudaError_t cudaGraphCreate(cudaGraph_t* graph, unsigned) {
  const std::lock_guard lock(device().mutex);
  *graph = device().graphs.emplace_back(std::make_unique<CUgraph_st>()).get();
  return cudaSuccess;
}
cudaError_t cudaGraphAddKernelNode(cudaGraphNode_t* node, cudaGraph_t graph, const cudaGraphNode_t* before,
                                   size_t count, const cudaKernelNodeParams* kernel) {
  const std::lock_guard lock(device().mutex);
  for (size_t i = 0; i < count; ++i)
    if (before[i]->graph != graph) return failed(cudaErrorInvalidValue);
  std::function<void()> work;
  if (const cudaError_t bound = bind_node(*kernel, work); bound != cudaSuccess) return bound;
  std::set<size_t> after;  // all nodes before it
  for (size_t i = 0; i < count; ++i) {
    after.insert(before[i]->number);
    after.insert(before[i]->after.begin(), before[i]->after.end());
  }
  *node = &graph->nodes.emplace_back(CUgraphNode_st{graph, graph->nodes.size(), std::move(after), std::move(work)});
  return cudaSuccess;
}
cudaError_t cudaGraphInstantiate(cudaGraphExec_t* exec, cudaGraph_t graph, unsigned long long) {
  const std::lock_guard lock(device().mutex);
  *exec = new CUgraphExec_st{{graph->nodes.begin(), graph->nodes.end()}};
  return cudaSuccess;
}
cudaError_t cudaGraphExecKernelNodeSetParams(cudaGraphExec_t exec, cudaGraphNode_t node,
                                             const cudaKernelNodeParams* kernel) {
  const std::lock_guard lock(device().mutex);
  if (node->number >= exec->nodes.size() || exec->nodes[node->number].graph != node->graph)
    return failed(cudaErrorInvalidValue);
  return bind_node(*kernel, exec->nodes[node->number].work);
}
/// Runs the kernels in any order that their nodes allow.
cudaError_t cudaGraphLaunch(cudaGraphExec_t exec, cudaStream_t stream) {
  const std::lock_guard lock(device().mutex);
  std::vector<const CUgraphNode_st*> left;
  for (const CUgraphNode_st& node : exec->nodes) left.push_back(&node);
  std::set<size_t> done;
  while (!left.empty()) {
    const auto is_free = [&](const CUgraphNode_st* node) {
      return std::includes(done.begin(), done.end(), node->after.begin(), node->after.end());
    };
    const auto free_end = std::stable_partition(left.begin(), left.end(), is_free);
    const auto next = left.begin() + random_below(static_cast<uint32_t>(free_end - left.begin()));
    submit(stream_of(stream), (*next)->work);
    done.insert((*next)->number);
    left.erase(next);
  }
  return cudaSuccess;
}
cudaError_t cudaGraphDestroy(cudaGraph_t graph) {
  const std::lock_guard lock(device().mutex);
  std::erase_if(device().graphs, [&](const auto& one) { return one.get() == graph; });
  return cudaSuccess;
}
cudaError_t cudaGraphExecDestroy(cudaGraphExec_t exec) {
  delete exec;
  return cudaSuccess;
}

cudaError_t cudaEventCreate(cudaEvent_t* event) {
  return make_event(event, true);
}
cudaError_t cudaEventCreateWithFlags(cudaEvent_t* event, unsigned flags) {
  return make_event(event, (flags & cudaEventDisableTiming) == 0);
}
cudaError_t cudaEventDestroy(cudaEvent_t event) {
  const std::lock_guard lock(device().mutex);
  delete event;
  return cudaSuccess;
}
cudaError_t cudaEventRecord(cudaEvent_t event, cudaStream_t stream) {
  const std::lock_guard lock(device().mutex);
  const auto record = std::make_shared<CUevent_st::Record>();
  record->is_timed = event->is_timed;
  CUstream_st* const recorded = stream_of(stream);
  record->at = submit(recorded, [record] { record->time = Clock::now(); });
  event->last = record;
  return cudaSuccess;
}
cudaError_t cudaEventSynchronize(cudaEvent_t event) {
  const std::lock_guard lock(device().mutex);
  if (event->last == nullptr) return cudaSuccess;
  reach(event->last->at);
  return cudaSuccess;
}
cudaError_t cudaEventQuery(cudaEvent_t event) {
  const std::lock_guard lock(device().mutex);
  if (event->last == nullptr) return cudaSuccess;
  const Point at = event->last->at;
  if (at.stream->done >= at.end) return cudaSuccess;
  reach({at.stream, at.stream->done + 1});
  return failed(cudaErrorNotReady);
}
cudaError_t cudaEventElapsedTime(float* ms, cudaEvent_t begin, cudaEvent_t end) {
  const std::lock_guard lock(device().mutex);
  for (const CUevent_st* event : {begin, end}) {
    if (event->last == nullptr || !event->last->is_timed) return failed(cudaErrorInvalidResourceHandle);
    if (event->last->at.stream->done < event->last->at.end) return failed(cudaErrorNotReady);
  }
  *ms = std::chrono::duration<float, std::milli>(end->last->time - begin->last->time).count();
  return cudaSuccess;
}

cudaError_t cudaFuncGetAttributes(cudaFuncAttributes* out, const void*) {
  *out = {};
  return listed_gpu(current_gpu).value_or(Gpu{}).major < kLeastMajor ? failed(cudaErrorNoKernelImageForDevice)
                                                                     : cudaSuccess;
}
cudaError_t cudaFuncSetAttribute(const void* function, cudaFuncAttribute attribute, int value) {
  const std::lock_guard lock(device().mutex);
  if (attribute != cudaFuncAttributeMaxDynamicSharedMemorySize || value < 0 ||
      static_cast<size_t>(value) > scree::emulator::kSharedBytes)
    return failed(cudaErrorInvalidValue);
  device().kernels[function].shared_bytes = static_cast<size_t>(value);
  return cudaSuccess;
}
cudaError_t cudaOccupancyMaxActiveBlocksPerMultiprocessorWithFlags(int* blocks, const void*, int threads,
                                                                   size_t shared_bytes, unsigned) {
  const size_t by_memory = scree::emulator::kSharedBytes / std::max<size_t>(shared_bytes, 1);
  *blocks = static_cast<int>(std::min<size_t>(
      {static_cast<size_t>(scree::emulator::kMultiprocessorThreads / std::max(threads, 1)), by_memory, 2}));
  return cudaSuccess;
}

cudaError_t cudaLaunchKernel(const void* function, dim3 blocks, dim3 threads, void** parameters, size_t shared_bytes,
                             cudaStream_t stream) {
  return submit_kernel(function, blocks, threads, parameters, shared_bytes, stream);
}

cudaError_t cudaGetLastError() {
  return std::exchange(last_error, cudaSuccess);
}
const char* cudaGetErrorName(cudaError_t error) {
  return cudaGetErrorString(error);
}
const char* cudaGetErrorString(cudaError_t error) {
  switch (error) {
    case cudaSuccess:
      return "no error";
    case cudaErrorMemoryAllocation:
      return "out of memory";
    case cudaErrorInvalidConfiguration:
      return "invalid configuration argument";
    case cudaErrorInvalidValue:
      return "invalid argument";
    default:
      return "an error of the emulated GPU";
  }
}

}  // extern "C"
