// The calls of the CUDA runtime that may fail. CMakeLists.txt repeats the list of names, because a test compares it
// with the program's calls.
#include <cuda_runtime_api.h>

#include <atomic>

#include "tests/faults/faults.h"

using scree::faults::fails;
using scree::faults::Foreign;
using scree::faults::Kind;

namespace {

// A failed launch is reported by the next cudaGetLastError() of its run.
std::atomic<uint64_t> launch_failed_in{0};

bool fails_here(const char* what, const void* site) {
  return fails(Kind::kDevice, what, site);
}

}  // namespace

extern "C" {

/// A call that fails with `error`.
#define SCREE_WRAP(name, error, parameters, arguments)                \
  cudaError_t __real_##name parameters;                               \
  cudaError_t __wrap_##name parameters {                              \
    if (fails_here(#name, __builtin_return_address(0))) return error; \
    const Foreign foreign;                                            \
    return __real_##name arguments;                                   \
  }

/// A call that creates an object which must be destroyed.
#define SCREE_WRAP_MAKE(name, error, parameters, arguments, out)              \
  cudaError_t __real_##name parameters;                                       \
  cudaError_t __wrap_##name parameters {                                      \
    if (fails_here(#name, __builtin_return_address(0))) return error;         \
    const Foreign foreign;                                                    \
    const cudaError_t made = __real_##name arguments;                         \
    if (made == cudaSuccess && *(out) != nullptr) scree::faults::add_live(1); \
    return made;                                                              \
  }

SCREE_WRAP_MAKE(cudaMalloc, cudaErrorMemoryAllocation, (void** out, size_t bytes), (out, bytes), out)
SCREE_WRAP_MAKE(cudaMallocHost, cudaErrorMemoryAllocation, (void** out, size_t bytes), (out, bytes), out)
SCREE_WRAP_MAKE(cudaHostRegister, cudaErrorMemoryAllocation, (void* memory, size_t bytes, unsigned flags),
                (memory, bytes, flags), &memory)
SCREE_WRAP_MAKE(cudaEventCreate, cudaErrorUnknown, (cudaEvent_t * event), (event), event)
SCREE_WRAP_MAKE(cudaEventCreateWithFlags, cudaErrorUnknown, (cudaEvent_t * event, unsigned flags), (event, flags),
                event)
SCREE_WRAP_MAKE(cudaStreamCreate, cudaErrorUnknown, (cudaStream_t * stream), (stream), stream)
SCREE_WRAP_MAKE(cudaStreamCreateWithFlags, cudaErrorUnknown, (cudaStream_t * stream, unsigned flags), (stream, flags),
                stream)
SCREE_WRAP_MAKE(cudaStreamCreateWithPriority, cudaErrorUnknown, (cudaStream_t * stream, unsigned flags, int priority),
                (stream, flags, priority), stream)
SCREE_WRAP_MAKE(cudaGraphInstantiate, cudaErrorMemoryAllocation,
                (cudaGraphExec_t * exec, cudaGraph_t graph, unsigned long long flags), (exec, graph, flags), exec)
SCREE_WRAP_MAKE(cudaGraphCreate, cudaErrorMemoryAllocation, (cudaGraph_t * graph, unsigned flags), (graph, flags),
                graph)
#undef SCREE_WRAP_MAKE
SCREE_WRAP(cudaMemcpy, cudaErrorUnknown, (void* to, const void* from, size_t bytes, cudaMemcpyKind kind),
           (to, from, bytes, kind))
SCREE_WRAP(cudaMemcpyAsync, cudaErrorUnknown,
           (void* to, const void* from, size_t bytes, cudaMemcpyKind kind, cudaStream_t stream),
           (to, from, bytes, kind, stream))
#if CUDART_VERSION >= 13000
SCREE_WRAP(cudaMemcpyBatchAsync, cudaErrorUnknown,
           (void* const* to, const void* const* from, const size_t* bytes, size_t count,
            cudaMemcpyAttributes* attributes, size_t* first, size_t attribute_count, cudaStream_t stream),
           (to, from, bytes, count, attributes, first, attribute_count, stream))
#endif
SCREE_WRAP(cudaMemset, cudaErrorUnknown, (void* at, int value, size_t bytes), (at, value, bytes))
SCREE_WRAP(cudaMemsetAsync, cudaErrorUnknown, (void* at, int value, size_t bytes, cudaStream_t stream),
           (at, value, bytes, stream))
SCREE_WRAP(cudaMemGetInfo, cudaErrorUnknown, (size_t * free, size_t* total), (free, total))
SCREE_WRAP(cudaPointerGetAttributes, cudaErrorUnknown, (cudaPointerAttributes * out, const void* at), (out, at))
SCREE_WRAP(cudaGetDevice, cudaErrorUnknown, (int* device), (device))
SCREE_WRAP(cudaSetDevice, cudaErrorUnknown, (int device), (device))
SCREE_WRAP(cudaGetDeviceCount, cudaErrorUnknown, (int* count), (count))
SCREE_WRAP(cudaGetDeviceProperties, cudaErrorUnknown, (cudaDeviceProp * out, int device), (out, device))
SCREE_WRAP(cudaDeviceGetAttribute, cudaErrorUnknown, (int* value, cudaDeviceAttr attribute, int device),
           (value, attribute, device))
SCREE_WRAP(cudaDeviceCanAccessPeer, cudaErrorUnknown, (int* can, int device, int peer), (can, device, peer))
SCREE_WRAP(cudaDeviceEnablePeerAccess, cudaErrorUnknown, (int peer, unsigned flags), (peer, flags))
SCREE_WRAP(cudaDeviceSynchronize, cudaErrorUnknown, (), ())
SCREE_WRAP(cudaDriverGetVersion, cudaErrorUnknown, (int* version), (version))
SCREE_WRAP(cudaEventQuery, cudaErrorUnknown, (cudaEvent_t event), (event))
SCREE_WRAP(cudaEventRecord, cudaErrorUnknown, (cudaEvent_t event, cudaStream_t stream), (event, stream))
SCREE_WRAP(cudaEventSynchronize, cudaErrorUnknown, (cudaEvent_t event), (event))
SCREE_WRAP(cudaEventElapsedTime, cudaErrorUnknown, (float* ms, cudaEvent_t begin, cudaEvent_t end), (ms, begin, end))
SCREE_WRAP(cudaStreamSynchronize, cudaErrorUnknown, (cudaStream_t stream), (stream))
SCREE_WRAP(cudaStreamWaitEvent, cudaErrorUnknown, (cudaStream_t stream, cudaEvent_t event, unsigned flags),
           (stream, event, flags))
SCREE_WRAP(cudaGraphAddKernelNode, cudaErrorUnknown,
           (cudaGraphNode_t * node, cudaGraph_t graph, const cudaGraphNode_t* before, size_t count,
            const cudaKernelNodeParams* kernel),
           (node, graph, before, count, kernel))
SCREE_WRAP(cudaGraphExecKernelNodeSetParams, cudaErrorUnknown,
           (cudaGraphExec_t exec, cudaGraphNode_t node, const cudaKernelNodeParams* kernel), (exec, node, kernel))
SCREE_WRAP(cudaGraphLaunch, cudaErrorUnknown, (cudaGraphExec_t exec, cudaStream_t stream), (exec, stream))
SCREE_WRAP(cudaFuncGetAttributes, cudaErrorUnknown, (cudaFuncAttributes * out, const void* kernel), (out, kernel))
SCREE_WRAP(cudaFuncSetAttribute, cudaErrorUnknown, (const void* kernel, cudaFuncAttribute attribute, int value),
           (kernel, attribute, value))
SCREE_WRAP(cudaOccupancyMaxActiveBlocksPerMultiprocessorWithFlags, cudaErrorUnknown,
           (int* blocks, const void* kernel, int threads, size_t bytes, unsigned flags),
           (blocks, kernel, threads, bytes, flags))
#undef SCREE_WRAP

/// Calls that free resources succeed in any case, because no caller can use their errors.
#define SCREE_WRAP_RELEASE(name, type, object)                             \
  cudaError_t __real_##name(type object);                                  \
  cudaError_t __wrap_##name(type object) {                                 \
    if (object != nullptr) scree::faults::add_live(-1);                    \
    const bool is_failed = fails_here(#name, __builtin_return_address(0)); \
    const Foreign foreign;                                                 \
    const cudaError_t done = __real_##name(object);                        \
    return is_failed ? cudaErrorUnknown : done;                            \
  }

SCREE_WRAP_RELEASE(cudaFree, void*, block)
SCREE_WRAP_RELEASE(cudaFreeHost, void*, block)
SCREE_WRAP_RELEASE(cudaHostUnregister, void*, memory)
SCREE_WRAP_RELEASE(cudaEventDestroy, cudaEvent_t, event)
SCREE_WRAP_RELEASE(cudaStreamDestroy, cudaStream_t, stream)
SCREE_WRAP_RELEASE(cudaGraphDestroy, cudaGraph_t, graph)
SCREE_WRAP_RELEASE(cudaGraphExecDestroy, cudaGraphExec_t, exec)
#undef SCREE_WRAP_RELEASE

/// The call behind <<<>>>: CUDA 12 uses the first, CUDA 13 the second, whose kernel is a handle.
#define SCREE_WRAP_LAUNCH(name)                                                                         \
  cudaError_t __real_##name(const void* kernel, dim3 grid, dim3 block, void** arguments, size_t shared, \
                            cudaStream_t stream);                                                       \
  cudaError_t __wrap_##name(const void* kernel, dim3 grid, dim3 block, void** arguments, size_t shared, \
                            cudaStream_t stream) {                                                      \
    if (fails_here(#name, __builtin_return_address(0))) {                                               \
      launch_failed_in = scree::faults::run_number();                                                   \
      return cudaErrorLaunchFailure;                                                                    \
    }                                                                                                   \
    const Foreign foreign;                                                                              \
    return __real_##name(kernel, grid, block, arguments, shared, stream);                               \
  }

SCREE_WRAP_LAUNCH(cudaLaunchKernel)
#if CUDART_VERSION >= 13000 && !defined(SCREE_EMULATED_CUDA)
SCREE_WRAP_LAUNCH(__cudaLaunchKernel)
#endif
#undef SCREE_WRAP_LAUNCH

#if !defined(SCREE_EMULATED_CUDA)
/// Other calls behind <<<>>>. A kernel's handle is requested once per process, so its failure would be permanent.
#define SCREE_WRAP_FOREIGN(type, name, parameters, arguments) \
  type __real_##name parameters;                              \
  type __wrap_##name parameters {                             \
    const Foreign foreign;                                    \
    return __real_##name arguments;                           \
  }

SCREE_WRAP_FOREIGN(unsigned, __cudaPushCallConfiguration, (dim3 grid, dim3 block, size_t shared, cudaStream_t stream),
                   (grid, block, shared, stream))
SCREE_WRAP_FOREIGN(cudaError_t, __cudaPopCallConfiguration, (dim3 * grid, dim3* block, size_t* shared, void* stream),
                   (grid, block, shared, stream))
#if CUDART_VERSION >= 13000
SCREE_WRAP_FOREIGN(cudaError_t, __cudaGetKernel, (cudaKernel_t * out, const void* kernel), (out, kernel))
#endif
#undef SCREE_WRAP_FOREIGN
#endif

cudaError_t __real_cudaGetLastError();
cudaError_t __wrap_cudaGetLastError() {
  const cudaError_t error = __real_cudaGetLastError();
  const uint64_t run = launch_failed_in.exchange(0);
  return run != 0 && run == scree::faults::run_number() ? cudaErrorLaunchFailure : error;
}

}  // extern "C"
