// How a frame's kernels are started: on streams with events between them, or as one graph.
#pragma once

#include <type_traits>

#include "kernels/cuda/common/check.h"
#include "kernels/cuda/common/graph.h"
#include "kernels/cuda/frame/frame.h"

namespace scree::kernels {

enum FrameEvent {
  kStart,
  kCleared,
  kCulled,
  kClustersDone,
  kClippedDone,
  kSmallDone,
  kMediumDone,
  kLargeBegun,
  kLargeDone,
  kFirstDone,
  kPyramidDone,
  kSecondSmallDone,
  kSecondMediumDone,
  kSecondLargeBegun,
  kSecondLargeDone,
  kAllDone,
  kCountersRead,
  kEventCount
};

/// The events of one pass. Stages 2 and 3 begin after `small_done`.
struct StageEvents {
  FrameEvent small_done;
  FrameEvent medium_done;
  FrameEvent large_begun;
  FrameEvent large_done;
};
inline constexpr StageEvents kFirstStages{kSmallDone, kMediumDone, kLargeBegun, kLargeDone};
inline constexpr StageEvents kSecondStages{kSecondSmallDone, kSecondMediumDone, kSecondLargeBegun, kSecondLargeDone};

/// A frame's streams, or the branches of its graph.
enum Branch : uint32_t {
  kMain,
  kSide,  // stage 3
  kClip,  // triangles of clusters that are clipped, in all stages
  kBranchCount
};
static_assert(kBranchCount <= CudaGraph::kBranches);

class FrameRecorder {
 public:
  ~FrameRecorder() {
    if (main_stream() != nullptr) (void)cudaStreamSynchronize(main_stream());
  }

  /// Errors kDevice.
  Result<void> open() {
    for (DeviceStream& stream : streams_) SCREE_TRY(stream.make());
    for (DeviceEvent& event : events_) SCREE_TRY(event.make());
    return {};
  }

  /// Begins a frame. `is_graph`: update_graph() and start_graph() follow once its kernels are recorded. Otherwise each
  /// kernel starts at once.
  void begin(bool is_graph, bool times_stages) {
    is_graph_ = is_graph;
    times_stages_ = times_stages;
    if (is_graph) graph_.begin();
  }
  Result<void> update_graph() { return graph_.update(); }
  Result<void> start_graph() { return graph_.launch(main_stream()); }

  /// The stream of everything but the branches.
  cudaStream_t main_stream() const { return streams_[kMain]; }

  /// Adds a kernel to a branch.
  template <class... P>
  void launch(Branch branch, void (*kernel)(P...), uint32_t blocks, uint32_t threads, size_t shared_bytes,
              const std::type_identity_t<P>&... arguments) {
    if (is_graph_) {
      graph_.add(branch, kernel, blocks, threads, shared_bytes, arguments...);
    } else {
      kernel<<<blocks, threads, shared_bytes, streams_[branch]>>>(arguments...);
    }
  }

  /// Makes a branch continue where the main one is now, which `event` marks.
  Result<void> fork(FrameEvent event, Branch to) {
    if (is_graph_) {
      graph_.fork(kMain, to);
      return {};
    }
    SCREE_TRY(record(event));
    return cuda_check(cudaStreamWaitEvent(streams_[to], events_[event]), "forking");
  }
  /// Makes the main branch wait for the end of another one, which `event` marks.
  Result<void> join(FrameEvent event, Branch from) {
    if (is_graph_) {
      graph_.join(from, kMain);
      return {};
    }
    SCREE_TRY(record(event, from));
    return cuda_check(cudaStreamWaitEvent(main_stream(), events_[event]), "joining");
  }

  Result<void> record(FrameEvent event, Branch branch = kMain) {
    return cuda_check(cudaEventRecord(events_[event], streams_[branch]), "recording an event");
  }
  /// Records an event between two stages, to measure their times.
  Result<void> mark(FrameEvent event, Branch branch = kMain) {
    return times_stages_ ? record(event, branch) : Result<void>();
  }
  /// Marks the events of stages that run only after the last pass, so that their times are 0 here.
  Result<void> mark_all(const StageEvents& at) {
    for (const FrameEvent event : {at.small_done, at.large_begun, at.large_done, at.medium_done})
      SCREE_TRY(mark(event));
    return {};
  }

  /// Whether an event has been reached.
  cudaError_t query(FrameEvent event) const { return cudaEventQuery(events_[event]); }

  /// The times of a frame that is done. `has_second`: it had a second pass. Errors kDevice.
  Result<void> read_times(bool has_second, FrameTimes& times) const {
    times = {};
    times.has_stages = times_stages_;
    const auto read = [&](float& out, FrameEvent from, FrameEvent to) {
      return cuda_check(cudaEventElapsedTime(&out, events_[from], events_[to]), "reading times");
    };
    SCREE_TRY(read(times.raster_ms, kStart, kAllDone));
    if (!times_stages_) return {};
    SCREE_TRY(read(times.clear_ms, kStart, kCleared));
    SCREE_TRY(read(times.cull_ms, kCleared, kCulled));
    SCREE_TRY(read(times.small_ms, kCulled, kSmallDone));
    SCREE_TRY(read(times.medium_ms, kSmallDone, kMediumDone));
    SCREE_TRY(read(times.large_ms, kLargeBegun, kLargeDone));
    if (!has_second) return {};
    SCREE_TRY(read(times.pyramid_ms, kFirstDone, kPyramidDone));
    return read(times.second_ms, kPyramidDone, kAllDone);
  }

 private:
  // Blocking streams, so that work on the default stream (the resolver's) is ordered with the frame.
  DeviceStream streams_[kBranchCount];
  DeviceEvent events_[kEventCount];
  CudaGraph graph_;
  bool is_graph_ = false;
  bool times_stages_ = false;
};

}  // namespace scree::kernels
