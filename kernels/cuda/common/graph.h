// Work for several streams, started as one. Otherwise a short frame waits for its streams to fork and join.
#pragma once

#include <cuda_runtime.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "format/result.h"
#include "kernels/cuda/common/check.h"

namespace scree::kernels {

/// A CUDA graph of kernels that is made once. As long as frames have as many kernels in the same order, only kernels
/// that differ, or whose arguments differ, are set. One thread at a time.
class CudaGraph {
 public:
  static constexpr uint32_t kMostNodes = 16;
  static constexpr uint32_t kBranches = 3;

  CudaGraph() = default;
  CudaGraph(const CudaGraph&) = delete;
  CudaGraph& operator=(const CudaGraph&) = delete;
  ~CudaGraph() { close(); }

  /// Begins a frame without kernels.
  void begin() {
    count_ = 0;
    std::fill(ends_.begin(), ends_.end(), 0u);
  }

  /// Adds a kernel behind the ones that `branch` ends with. At most kMostNodes per frame.
  template <class... P>
  void add(uint32_t branch, void (*kernel)(P...), uint32_t blocks, uint32_t threads, size_t shared_bytes,
           const P&... arguments) {
    static_assert((std::is_trivially_copyable_v<P> && ...) && ((alignof(P) <= alignof(uint64_t)) && ...));
    static_assert((words_of<P>() + ... + 0) <= kMostWords && sizeof...(P) <= kMostArguments);
    assert(count_ < kMostNodes);
#if defined(SCREE_EMULATED_CUDA)
    emulator::add_kernel(reinterpret_cast<const void*>(kernel), "of a graph", emulator::bind_kernel<P...>);
#endif
    Node& node = nodes_[count_];
    const Launch launch{reinterpret_cast<const void*>(kernel), blocks, threads, shared_bytes};
    node.is_changed = node.is_changed || node.launch != launch;
    node.launch = launch;
    is_reshaped_ = is_reshaped_ || count_ >= made_ || node.after != ends_[branch];
    node.after = ends_[branch];
    size_t word = 0;
    size_t number = 0;
    const auto keep = [&](const auto& argument) {
      uint64_t* const kept = node.words.data() + word;
      if (std::memcmp(kept, &argument, sizeof argument) != 0) {
        node.is_changed = true;
        std::memcpy(kept, &argument, sizeof argument);
      }
      node.arguments[number++] = kept;
      word += words_of<std::remove_cvref_t<decltype(argument)>>();
    };
    (keep(arguments), ...);
    ends_[branch] = 1u << count_++;
  }

  /// Makes the branch `to` continue where `from` is now.
  void fork(uint32_t from, uint32_t to) {
    ends_[to] = ends_[from];
  }
  /// Makes the branch `to` wait for the end of `from` too.
  void join(uint32_t from, uint32_t to) {
    ends_[to] |= ends_[from];
  }

  /// Brings the graph up to date with the frame's kernels. Errors kDevice.
  Result<void> update() {
    if (exec_ == nullptr || is_reshaped_ || count_ != made_) return make();
    for (uint32_t i = 0; i < count_; ++i) {
      if (!nodes_[i].is_changed) continue;
      const cudaKernelNodeParams parameters = nodes_[i].parameters();
      if (cudaGraphExecKernelNodeSetParams(exec_, nodes_[i].node, &parameters) != cudaSuccess) {
        (void)cudaGetLastError();  // the graph has to be another one
        return make();
      }
      nodes_[i].is_changed = false;
    }
    return {};
  }

  /// After update().
  Result<void> launch(cudaStream_t stream) {
    return cuda_check(cudaGraphLaunch(exec_, stream), "starting a frame");
  }

 private:
  static constexpr size_t kMostWords = 512;  // of a kernel's arguments: 4 KiB
  static constexpr size_t kMostArguments = 8;

  template <class T>
  static constexpr size_t words_of() {
    return (sizeof(T) + sizeof(uint64_t) - 1) / sizeof(uint64_t);
  }

  struct Launch {
    const void* kernel;
    uint32_t blocks;
    uint32_t threads;
    size_t shared_bytes;
    bool operator==(const Launch&) const = default;
  };
  struct Node {
    Launch launch{};
    uint32_t after = 0;  // bit i: node i runs before
    bool is_changed = false;
    cudaGraphNode_t node = nullptr;
    std::array<void*, kMostArguments> arguments{};  // in `words`
    std::array<uint64_t, kMostWords> words{};

    cudaKernelNodeParams parameters() {
      return {const_cast<void*>(launch.kernel),           dim3(launch.blocks), dim3(launch.threads),
              static_cast<unsigned>(launch.shared_bytes), arguments.data(),    nullptr};
    }
  };

  /// Makes a new graph.
  Result<void> make() {
    close();
    constexpr const char* kWhat = "recording a frame";
    is_reshaped_ = true;  // until it is made
    SCREE_TRY(cuda_check(cudaGraphCreate(&graph_, 0), kWhat));
    for (uint32_t i = 0; i < count_; ++i) {
      cudaGraphNode_t before[kMostNodes];
      size_t before_count = 0;
      for (uint32_t k = 0; k < i; ++k)
        if ((nodes_[i].after >> k & 1) != 0) before[before_count++] = nodes_[k].node;
      const cudaKernelNodeParams parameters = nodes_[i].parameters();
      SCREE_TRY(cuda_check(cudaGraphAddKernelNode(&nodes_[i].node, graph_, before, before_count, &parameters), kWhat));
      nodes_[i].is_changed = false;
    }
    SCREE_TRY(cuda_check(cudaGraphInstantiate(&exec_, graph_, 0), kWhat));
    made_ = count_;
    is_reshaped_ = false;
    return {};
  }

  void close() {
    if (exec_ != nullptr) (void)cudaGraphExecDestroy(exec_);
    if (graph_ != nullptr) (void)cudaGraphDestroy(graph_);
    exec_ = nullptr;
    graph_ = nullptr;
  }

  cudaGraph_t graph_ = nullptr;  // its nodes name the kernels of `exec_`
  cudaGraphExec_t exec_ = nullptr;
  std::array<Node, kMostNodes> nodes_;
  std::array<uint32_t, kBranches> ends_{};  // of each branch: the nodes after which the next one runs
  uint32_t count_ = 0;                      // of this frame
  uint32_t made_ = 0;                       // of the graph
  bool is_reshaped_ = false;                // this frame's nodes are not connected like the graph's
};

}  // namespace scree::kernels
