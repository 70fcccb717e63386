// Streams, events, kernels and graphs of the emulated GPU. Work submitted to a stream is queued. It is done when the
// program waits for it, or earlier at random. So a result that is used without a wait is missing, and the pinned memory
// of a copy must stay valid until the program has waited for the copy.
#include "tests/emulator/runtime.h"

#include <algorithm>

namespace scree::emulator {
namespace {

CUstream_st* null_stream_of(int gpu) {
  CUstream_st& stream = device().null_streams[gpu];
  stream.gpu = gpu;
  return &stream;
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
                    in_block != 0 && in_block <= kMaxThreads && shared_bytes <= kernel.shared_bytes;
  if (!fits) return failed(cudaErrorInvalidConfiguration);
  Grid grid{kernel.name, blocks, threads, shared_bytes, kernel.bind(function, parameters)};
  out = [grid = std::move(grid)] { run(grid); };
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

CUstream_st* stream_of(cudaStream_t stream) {
  if (stream == nullptr) return null_stream_of(current_gpu);
  if (stream->is_destroyed) fail("a stream is used after it was destroyed");
  return stream;
}

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

Point submit(CUstream_st* stream, std::function<void()> run, std::vector<Point> after) {
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

void finish(int gpu) {
  Device& all = device();
  for (auto& [of, stream] : all.null_streams)
    if (gpu == kPinned || of == gpu) reach(stream.end());
  for (const auto& stream : all.streams)
    if (gpu == kPinned || stream->gpu == gpu) reach(stream->end());
}

void add_kernel(const void* function, const char* name, Bind bind) {
  const std::lock_guard lock(device().mutex);
  Kernel& kernel = device().kernels[function];  // may be a kernel whose attribute was set before
  kernel.name = name;
  kernel.bind = bind;
}

}  // namespace scree::emulator

using namespace scree::emulator;

extern "C" {

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

cudaError_t cudaFuncSetAttribute(const void* function, cudaFuncAttribute attribute, int value) {
  const std::lock_guard lock(device().mutex);
  if (attribute != cudaFuncAttributeMaxDynamicSharedMemorySize || value < 0 ||
      static_cast<size_t>(value) > kSharedBytes)
    return failed(cudaErrorInvalidValue);
  device().kernels[function].shared_bytes = static_cast<size_t>(value);
  return cudaSuccess;
}
cudaError_t cudaOccupancyMaxActiveBlocksPerMultiprocessorWithFlags(int* blocks, const void*, int threads,
                                                                   size_t shared_bytes, unsigned) {
  const size_t by_memory = kSharedBytes / std::max<size_t>(shared_bytes, 1);
  *blocks = static_cast<int>(
      std::min<size_t>({static_cast<size_t>(kMultiprocessorThreads / std::max(threads, 1)), by_memory, 2}));
  return cudaSuccess;
}

cudaError_t cudaLaunchKernel(const void* function, dim3 blocks, dim3 threads, void** parameters, size_t shared_bytes,
                             cudaStream_t stream) {
  return submit_kernel(function, blocks, threads, parameters, shared_bytes, stream);
}

}  // extern "C"
