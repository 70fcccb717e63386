// Frames on a GPU: their kind, their passes, and their end (docs/frame.md shows them on a page). frame_buffers.h has
// their memory, frame_recorder.cuh starts their kernels.
#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstddef>
#include <new>
#include <optional>
#include <utility>

#include "kernels/cuda/cull/pyramid.cuh"
#include "kernels/cuda/cull/small_scene_cull.cuh"
#include "kernels/cuda/frame/frame_buffers.h"
#include "kernels/cuda/frame/frame_builds.cuh"
#include "kernels/cuda/frame/frame_recorder.cuh"
#include "kernels/cuda/raster/cluster_clip.cuh"
#include "kernels/cuda/raster/few_clusters.cuh"
#include "kernels/cuda/raster/large.cuh"

namespace scree::kernels {
namespace {

/// The counters that the host reads, in pinned memory.
struct HandedOver {
  FrameCounters counters;  // without in_bucket and what follows
  uint32_t frame;          // of the counters; written last
};

/// Writes the counters to the host's memory, with a warp. A copy command would deliver them a few microseconds later.
__global__ void hand_over(const FrameCounters* from, HandedOver* to, uint32_t frame) {
  constexpr uint32_t kWords = offsetof(FrameCounters, in_bucket) / sizeof(uint64_t);
  for (uint32_t i = threadIdx.x; i < kWords; i += kWarpLanes)
    reinterpret_cast<uint64_t*>(&to->counters)[i] = reinterpret_cast<const uint64_t*>(from)[i];
  __threadfence_system();
  __syncwarp();
  if (threadIdx.x == 0) *reinterpret_cast<volatile uint32_t*>(&to->frame) = frame;
}

/// From this many drawn triangles on, a frame is not run as a graph.
constexpr uint64_t kMostGraphTriangles = uint64_t{1} << 23;

/// Whether the camera and the clipping box are the same, and few rows are new. Many new rows have the same effect as a
/// camera that moved.
bool same_view(const FrameView& a, FrameView b) {
  if (std::abs(a.first_row - b.first_row) + std::abs(a.end_row - b.end_row) > a.height / 32) return false;
  b.first_row = a.first_row;
  b.end_row = a.end_row;
  b.omitted = a.omitted;
  return a == b;
}

/// The view without its camera, which stages 2 and 3 need only for masks. Without it their kernel arguments do not
/// change when the camera moves.
FrameView without_camera(const FrameView& view) {
  FrameView out{};
  out.half_width = view.half_width;
  out.half_height = view.half_height;
  out.width = view.width;
  out.height = view.height;
  out.first_row = view.first_row;
  out.end_row = view.end_row;
  out.orthographic = view.orthographic;
  return out;
}

/// Most medium triangles with which stages 2 and 3 may wait for the last pass (defers_stages).
constexpr uint64_t kMostDeferred = 4096;

/// Every hint is tested anew once in this many frames.
constexpr uint32_t kHintPeriod = 4;

}  // namespace

struct CudaFrames::Impl {
  Result<void> open(const SceneView& host, const CudaQueueSizes& sizes);
  template <bool kClips>
  void submit_culling(const DrawList& list, const SamplesToClear& clear, bool draws_indexed, bool draws_clusters);
  template <bool kOrthographic, bool kClips>
  void submit_small_scene_culling(const DrawList& list, const SamplesToClear& clear);
  Result<void> find_all_bounds();
  Result<void> forget();
  Result<void> submit();
  /// Queues a kernel with as many blocks as the GPU holds.
  template <class... P>
  void launch_full(Branch branch, void (*kernel)(P...), uint32_t threads, size_t shared_bytes,
                   const std::type_identity_t<P>&... arguments) {
    recorder.launch(branch, kernel, resident.of(kernel, threads, shared_bytes), threads, shared_bytes, arguments...);
  }
  /// Selects the builds of the kernels for this frame. With a clipping box all samples are tested, as with masks.
  Alpha alpha() const {
    return scene.draws_blended                               ? Alpha::kBlended
           : scene.masks != nullptr || frame.clip_box.is_set ? Alpha::kMasked
                                                             : Alpha::kOpaque;
  }
  /// Prepares the kernel builds of this frame, unless the last frame used the same ones.
  Result<void> prepare_alpha();
  /// Calls run<kAlpha>() with the kernel builds of this frame.
  template <class Run>
  Result<void> with_alpha(const Run& run) const {
    switch (alpha()) {
      case Alpha::kBlended:
        return run.template operator()<Alpha::kBlended>();
      case Alpha::kMasked:
        return run.template operator()<Alpha::kMasked>();
      case Alpha::kOpaque:
        break;
    }
    return run.template operator()<Alpha::kOpaque>();
  }
  Result<void> submit_passes() {
    return with_alpha([&]<Alpha kAlpha>() {
      return frame.orthographic ? submit_passes<true, kAlpha>() : submit_passes<false, kAlpha>();
    });
  }
  template <bool kOrthographic, Alpha kAlpha>
  Result<void> submit_passes();
  template <bool kOrthographic, ClusterPass kPass, Alpha kAlpha>
  void submit_clusters(const SmallFrame& small, uint32_t round, uint32_t rounds, bool clips);
  template <bool kOrthographic, Alpha kAlpha>
  void submit_clipped(const ClusterFrame& clusters, Branch branch);
  template <bool kOrthographic, Alpha kAlpha>
  Result<void> submit_clipping_on_own_stream(const SmallFrame& small);
  template <bool kOrthographic, Alpha kAlpha>
  Result<void> submit_stages(const SmallFrame& small, const StageEvents& events_of_pass);
  template <Alpha kAlpha>
  LargeFrame<kAlpha> large_frame(const SmallFrame& small, const Queues& queued, const DrawnTriangles* drawn) const {
    LargeFrame<kAlpha> out{small.view, small.target, queued, drawn, {}};
    if constexpr (kAlpha != Alpha::kOpaque)
      out.masks = {scene, buffers.transforms.data()};
    else
      out.view = without_camera(small.view);
    return out;
  }
  ClusterCull cluster_cull(const DrawList& list, const ClusterTests& tests, uint32_t pass, uint32_t round,
                           uint32_t rounds) const;
  /// Each doubling of the groups adds a round: a round is worth its pyramid if it saves enough clusters.
  uint32_t rounds_when_moving() const {
    const uint64_t groups = buffers.traits.cluster_groups / max_of<uint64_t>(buffers.sizes.round_groups, 1);
    return min_of(max_of(static_cast<uint32_t>(std::bit_width(groups)), 1u), kMostRounds);
  }
  /// Whether clusters are so few that a block draws each (raster_few_clusters).
  bool has_few_clusters() const {
    return buffers.traits.cluster_groups < min_of(buffers.sizes.few_groups, buffers.sizes.two_pass_groups);
  }
  /// A guess from the previous frame. raster_near_clipped is faster for many triangles. Its code is longer, and
  /// fetching it would delay a few triangles.
  bool clips_many() const { return clipped_before > uint64_t{resident.multiprocessors()} * kClusterWarps; }
  bool clips_on_own_stream() const { return buffers.has_clusters() && !buffers.in_two_passes(); }
  /// Whether clipping and stages 2 and 3 run only after the last pass. A guess from the previous frame, like
  /// clips_many(): that frame queued so little for them that it would have hidden hardly anything.
  bool defers_stages() const { return two_passes && options.part == FramePart::kWhole && queued_little; }
  /// Joins the samples with those of other GPUs, if these draw the frame too.
  Result<void> join_samples() const {
    return options.join != nullptr ? (*options.join)(recorder.main_stream()) : Result<void>();
  }
  /// Clears the counters for the next frame, while the host does not wait.
  Result<void> clear_counters() {
    const DeviceArray<std::byte>& zeroed = buffers.zeroed;
    SCREE_TRY(
        cuda_check(cudaMemsetAsync(zeroed.data(), 0, zeroed.count(), recorder.main_stream()), "clearing the counters"));
    counters_cleared = true;
    return {};
  }
  /// Graphs are worth it if a frame takes a fraction of a millisecond. Frames of two passes are no graphs, because
  /// their number of rounds changes.
  bool goes_as_graph() const {
    return options.part == FramePart::kWhole && !two_passes && !options.stage_times && buffers.order.count() != 0 &&
           triangle_count < kMostGraphTriangles;
  }
  Result<void> wait() const;
  Result<void> grow_queues();
  void adapt_next_frame();
  const HandedOver& handed_over() const { return *reinterpret_cast<const HandedOver*>(pinned.data()); }

  SceneView scene{};
  uint64_t triangle_count = 0;
  ResidentBlocks resident;
  SmallVariant variants[2] = {};  // perspective, orthographic
  std::optional<Alpha> prepared;  // of the variants
  FrameBuffers buffers;
  PinnedBuffer pinned;  // HandedOver
  // The current frame:
  FrameView frame{};
  uint64_t* samples = nullptr;
  DrawOptions options;
  FrameView last_view{};
  bool two_passes = false;  // of the last frame
  uint32_t frame_number = 0;
  uint64_t clipped_before = 0;  // triangles of clusters, in the last frame
  bool queued_little = false;   // the last frame: nothing large or to be clipped, and hardly anything medium
  bool counters_cleared = false;
  uint32_t hint_period = kHintPeriod;  // of the next frame
  FrameRecorder recorder;              // the last member: waits for the work with the others
};

Result<void> CudaFrames::Impl::open(const SceneView& host, const CudaQueueSizes& sizes) {
  triangle_count = host.instance_base[host.instance_count];
  SCREE_TRY(buffers.open(host, sizes));
  SCREE_TRY(resident.open());
  SCREE_TRY(recorder.open());
  SCREE_TRY(pinned.allocate(sizeof(HandedOver), "allocating pinned memory"));
  reinterpret_cast<HandedOver*>(pinned.data())->frame = 0;
  if (buffers.traits.has_float32) SCREE_TRY(find_all_bounds());
  if (buffers.has_clusters()) SCREE_TRY(forget());
  SCREE_TRY(prepare_alpha());
  return cuda_check(cudaStreamSynchronize(recorder.main_stream()), "preparing to draw");
}

/// Finds the boxes of the float32 chunks whose pages are resident.
Result<void> CudaFrames::Impl::find_all_bounds() {
  find_bounds<<<resident.of(find_bounds, 128), 128, 0, recorder.main_stream()>>>(scene, buffers.bounds.data());
  return cuda_check(cudaGetLastError(), "finding the chunks' bounds");
}

/// Clears all hints, as if nothing had been drawn before.
Result<void> CudaFrames::Impl::forget() {
  if (!buffers.in_two_passes()) return {};
  last_view = {};
  const uint64_t bytes = buffers.traits.cluster_groups * sizeof(uint32_t);
  return cuda_check(cudaMemsetAsync(buffers.hints.data(), 0, bytes, recorder.main_stream()),
                    "clearing a bit for each cluster");
}

Result<void> CudaFrames::Impl::prepare_alpha() {
  if (prepared == alpha()) return {};
  const auto prepare = [&]<Alpha kAlpha>() -> Result<void> {
    variants[0] = choose_small<false, kAlpha>(buffers.traits);
    variants[1] = choose_small<true, kAlpha>(buffers.traits);
    for (const SmallVariant& variant : variants) SCREE_TRY(allow_shared(variant.kernel, variant.shared_bytes));
    return buffers.has_clusters() ? prepare_clusters<kAlpha>() : Result<void>();
  };
  SCREE_TRY(with_alpha(prepare));
  prepared = alpha();
  return {};
}

ClusterCull CudaFrames::Impl::cluster_cull(const DrawList& list, const ClusterTests& tests, uint32_t pass,
                                           uint32_t round, uint32_t rounds) const {
  return {frame,
          center_range(frame),
          buffers.cluster_list(frame),
          list.counters,
          samples,
          tests,
          pass,
          round,
          rounds,
          frame_number,
          hint_period};
}

/// Finds the chunks that are drawn, and clears the picture.
template <bool kClips>
void CudaFrames::Impl::submit_culling(const DrawList& list, const SamplesToClear& clear, bool draws_indexed,
                                      bool draws_clusters) {
  recorder.launch(kMain, cull_instances<kClips>, (list.instance_count - 1) / kCullThreads + 1 + clear.blocks,
                  kCullThreads, 0, scene, frame, list, clear);
  if (draws_indexed) {
    recorder.launch(kMain, cull_chunks<kClips>, (list.candidate_count - 1) / kCullThreads + 1, kCullThreads, 0, scene,
                    frame, list);
  }
  if (draws_clusters) {
    const uint64_t threads = buffers.cluster_candidates.count() * kDrawInstances;
    const auto blocks = static_cast<uint32_t>((threads - 1) / kCullThreads + 1);
    const ClusterList clusters = buffers.cluster_list(frame);
    recorder.launch(kMain, cull_clustered_chunks<kClips>, blocks, kCullThreads, 0, scene, frame, list, clusters,
                    buffers.in_two_passes());
    recorder.launch(kMain, place_cluster_draws,
                    static_cast<uint32_t>((buffers.traits.cluster_draws - 1) / kPlaceThreads + 1), kPlaceThreads, 0,
                    list.counters, buffers.draw_places.data(), buffers.draw_order.data(), buffers.first_of_run.data(),
                    buffers.kept_of_run.data());
  }
}

/// Finds the clusters that are drawn, and clears the picture.
template <bool kOrthographic, bool kClips>
void CudaFrames::Impl::submit_small_scene_culling(const DrawList& list, const SamplesToClear& clear) {
  const auto group_count = static_cast<uint32_t>(buffers.small_scene_groups.count());
  const uint32_t blocks = (group_count - 1) / kCullWarps + 1 + clear.blocks;
  recorder.launch(kMain, cull_small_scene<kOrthographic, kClips>, blocks, kCullThreads, 0,
                  {scene, list.transforms, cluster_cull(list, {options.cluster_bounds, false}, 0, 0, 1),
                   buffers.small_scene_groups.data(), group_count, clear});
}

/// Culls the clusters of a pass, unless cull_small_scene() has done that, and draws them. `clips`: also draws their
/// triangles that need clipping, unless these have a stream of their own.
template <bool kOrthographic, ClusterPass kPass, Alpha kAlpha>
void CudaFrames::Impl::submit_clusters(const SmallFrame& small, uint32_t round, uint32_t rounds, bool clips) {
  const uint32_t pass = kPass == ClusterPass::kNewlyVisible ? 1 + round : 0;
  if (!buffers.is_small_scene()) {
    // More blocks than the registers allow at once: culling waits for memory, and late blocks balance the load.
    const auto cull =
        frame.clip_box.is_set ? cull_clusters<kOrthographic, kPass, true> : cull_clusters<kOrthographic, kPass, false>;
    recorder.launch(kMain, cull, resident.fill(kCullThreads), kCullThreads, 0,
                    cluster_cull(small.list, {options.cluster_bounds, options.occlusion}, pass, round, rounds));
    if (kPass == ClusterPass::kPreviouslyVisible && buffers.kept.count() != 0) {
      const auto runs = static_cast<uint32_t>(buffers.kept_of_run.count());
      recorder.launch(kMain, list_in_order, (runs - 1) / kCullWarps + 1, kCullThreads, 0, buffers.cluster_list(frame),
                      small.list.counters);
    }
  }
  const ClusterFrame clusters{small, buffers.cluster_list(frame), pass};
  // Not in parts of a frame: their last pass has no first pass to compare with.
  const bool culls_late = kPass == ClusterPass::kNewlyVisible && options.part == FramePart::kWhole;
  const auto kernel = has_few_clusters()         ? raster_few_clusters<kOrthographic, kAlpha>
                      : !buffers.in_two_passes() ? raster_clusters<kOrthographic, kClusterParts, false, kAlpha>
                      : culls_late               ? raster_clusters<kOrthographic, 1, true, kAlpha>
                                                 : raster_clusters<kOrthographic, 1, false, kAlpha>;
  const size_t shared_bytes = has_few_clusters() ? 0 : kClusterSharedBytes<kAlpha>;
  launch_full(kMain, kernel, kClusterThreads, shared_bytes, clusters);
  if (clips && !clips_on_own_stream()) submit_clipped<kOrthographic, kAlpha>(clusters, kMain);
}

/// Clips the triangles of clusters that need it.
template <bool kOrthographic, Alpha kAlpha>
void CudaFrames::Impl::submit_clipped(const ClusterFrame& clusters, Branch branch) {
  if constexpr (!kOrthographic) {  // clip_near() is for perspective only
    if (clips_many()) return launch_full(branch, raster_near_clipped<kAlpha>, kClusterThreads, 0, clusters);
  }
  recorder.launch(branch, raster_clipped<kOrthographic, kAlpha>, resident.multiprocessors(), kClusterThreads, 0,
                  clusters);
}

/// Clips the triangles of clusters that need it and draws the remaining pieces, while all other triangles go through
/// stages 2 and 3. They are few, but each takes 20 us. The additional kernels are worth it only in short frames: in
/// scenes that are drawn in one pass.
template <bool kOrthographic, Alpha kAlpha>
Result<void> CudaFrames::Impl::submit_clipping_on_own_stream(const SmallFrame& small) {
  SmallFrame clipped = small;
  clipped.queues = buffers.queues.clipped.view(&small.list.counters->clipped);
  const LargeFrame<kAlpha> queued = large_frame<kAlpha>(small, clipped.queues, &small.list.counters->clipped_drawn);
  SCREE_TRY(recorder.fork(kClustersDone, kClip));
  submit_clipped<kOrthographic, kAlpha>({clipped, buffers.cluster_list(frame), 0}, kClip);
  recorder.launch(kClip, split_large<kOrthographic, kAlpha>, resident.multiprocessors(), kLargeThreads, 0, queued);
  launch_full(kClip, raster_large<kOrthographic, kAlpha>, kLargeThreads, 0, queued);
  recorder.launch(kClip, raster_medium<kOrthographic, kAlpha>, resident.multiprocessors(), kLargeThreads, 0, queued);
  return cuda_check(cudaGetLastError(), "starting to clip");
}

/// Runs stages 2 and 3 side by side, because each alone is too little work for the GPU.
template <bool kOrthographic, Alpha kAlpha>
Result<void> CudaFrames::Impl::submit_stages(const SmallFrame& small, const StageEvents& at) {
  const LargeFrame<kAlpha> queued = large_frame<kAlpha>(small, small.queues, &small.list.counters->drawn);
  if (clips_on_own_stream()) SCREE_TRY(submit_clipping_on_own_stream<kOrthographic, kAlpha>(small));
  SCREE_TRY(recorder.fork(at.small_done, kSide));
  SCREE_TRY(recorder.mark(at.large_begun, kSide));
  launch_full(kSide, split_large<kOrthographic, kAlpha>, kLargeThreads, 0, queued);
  launch_full(kSide, raster_large<kOrthographic, kAlpha>, kLargeThreads, 0, queued);
  SCREE_TRY(cuda_check(cudaGetLastError(), "starting stage 3"));
  launch_full(kMain, raster_medium<kOrthographic, kAlpha>, kLargeThreads, 0, queued);
  SCREE_TRY(cuda_check(cudaGetLastError(), "starting stage 2"));
  SCREE_TRY(recorder.mark(at.medium_done));
  SCREE_TRY(recorder.join(at.large_done, kSide));
  return clips_on_own_stream() ? recorder.join(kClippedDone, kClip) : Result<void>();
}

/// Draws the frame.
template <bool kOrthographic, Alpha kAlpha>
Result<void> CudaFrames::Impl::submit_passes() {
  const DrawList list = buffers.draw_list();
  const Target target{samples, frame.width, options.peeled, options.fragments};
  const uint64_t row_samples = static_cast<uint64_t>(frame.width);
  uint64_t* const first_sample = samples + static_cast<uint64_t>(frame.first_row) * row_samples;
  const uint64_t sample_count = static_cast<uint64_t>(frame.end_row - frame.first_row) * row_samples;

  // A one-pass frame has no hints.
  const bool draws_only_previously_visible = options.part == FramePart::kPreviouslyVisible;
  const bool draws_clusters = buffers.has_clusters() && (two_passes || !draws_only_previously_visible);
  const bool draws_indexed = list.candidate_count != 0 && !draws_only_previously_visible;
  if (options.part != FramePart::kWhole && draws_indexed && buffers.traits.has_float32) SCREE_TRY(find_all_bounds());
  const bool clears = options.part == FramePart::kWhole;
  const bool culls = list.instance_count != 0 && (draws_indexed || draws_clusters);
  static_assert(kBackground == ~uint64_t{0});
  if (clears && !culls)
    SCREE_TRY(cuda_check(cudaMemsetAsync(first_sample, 0xff, sample_count * sizeof(uint64_t), recorder.main_stream()),
                         "clearing"));
  SCREE_TRY(recorder.mark(kCleared));
  if (culls) {
    const SamplesToClear clear{first_sample, sample_count, clears ? resident.fill(kCullThreads) : 0};
    const auto submit = [&]<bool kClips>() {
      if (buffers.is_small_scene()) {
        submit_small_scene_culling<kOrthographic, kClips>(list, clear);
      } else {
        submit_culling<kClips>(list, clear, draws_indexed, draws_clusters);
      }
    };
    if (frame.clip_box.is_set) {
      submit.template operator()<true>();
    } else {
      submit.template operator()<false>();
    }
    SCREE_TRY(cuda_check(cudaGetLastError(), "starting culling"));
  }
  SCREE_TRY(recorder.mark(kCulled));
  const SmallFrame small{scene,
                         frame,
                         target,
                         buffers.queues.triangles.view(&list.counters->queues),
                         list,
                         make_sample_limits(frame),
                         options.sampleless_test};
  if (draws_indexed) {
    const SmallVariant& variant = variants[kOrthographic ? 1 : 0];
    launch_full(kMain, variant.kernel, kSmallThreads, variant.shared_bytes, small);
  }
  const bool defers = defers_stages();
  if (draws_clusters) {
    if (two_passes && options.part != FramePart::kRest) {
      submit_clusters<kOrthographic, ClusterPass::kPreviouslyVisible, kAlpha>(small, 0, 1, !defers);
    } else if (!two_passes) {
      submit_clusters<kOrthographic, ClusterPass::kOnly, kAlpha>(small, 0, 1, true);
    }
  }
  SCREE_TRY(cuda_check(cudaGetLastError(), "starting stage 1"));
  SCREE_TRY(defers ? recorder.mark_all(kFirstStages) : submit_stages<kOrthographic, kAlpha>(small, kFirstStages));
  SCREE_TRY(recorder.mark(kFirstDone));
  if (two_passes) SCREE_TRY(join_samples());
  if (two_passes && !draws_only_previously_visible) {
    const auto tiles_along = [](int32_t side) { return (static_cast<uint32_t>(side) - 1) / kPyramidTile + 1; };
    const dim3 tiles_of_image(tiles_along(frame.width), tiles_along(frame.height));
    // If the camera stood still, few clusters are newly visible, and one round is the least work.
    const uint32_t rounds = same_view(frame, last_view) ? 1 : rounds_when_moving();
    for (uint32_t round = 0; round < rounds; ++round) {
      const cudaStream_t stream = recorder.main_stream();
      build_pyramid_tiles<<<tiles_of_image, kPyramidThreads, 0, stream>>>(buffers.pyramid, samples, frame.first_row,
                                                                          frame.end_row);
      build_pyramid_top_and_begin_pass<<<1, 1024, 0, stream>>>(buffers.pyramid, list.counters, !defers);
      if (round == 0) SCREE_TRY(recorder.mark(kPyramidDone));
      const bool ends = !defers || round + 1 == rounds;
      submit_clusters<kOrthographic, ClusterPass::kNewlyVisible, kAlpha>(small, round, rounds, ends);
      SCREE_TRY(cuda_check(cudaGetLastError(), "starting the second pass"));
      if (ends) SCREE_TRY(submit_stages<kOrthographic, kAlpha>(small, kSecondStages));
    }
  }
  return {};
}

/// Starts the frame, or starts it again.
Result<void> CudaFrames::Impl::submit() {
  ++frame_number;
  two_passes = buffers.has_clusters() && buffers.in_two_passes() && options.cluster_bounds && options.occlusion;
  const bool is_graph = goes_as_graph();
  recorder.begin(is_graph, options.stage_times);
  if (is_graph) {
    SCREE_TRY(submit_passes());
    SCREE_TRY(recorder.update_graph());
  }
  SCREE_TRY(recorder.record(kStart));
  if (!counters_cleared) SCREE_TRY(clear_counters());
  counters_cleared = false;
  SCREE_TRY(is_graph ? recorder.start_graph() : submit_passes());
  SCREE_TRY(join_samples());
  SCREE_TRY(recorder.record(kAllDone));
  hand_over<<<1, kWarpLanes, 0, recorder.main_stream()>>>(buffers.counters(),
                                                          reinterpret_cast<HandedOver*>(pinned.data()), frame_number);
  SCREE_TRY(cuda_check(cudaGetLastError(), "reading the counters"));
  SCREE_TRY(recorder.record(kCountersRead));
  return clear_counters();
}

/// Waits for the counters of the frame. It polls their last word, which arrives before the event that is recorded
/// behind it. The event only reports errors.
Result<void> CudaFrames::Impl::wait() const {
  constexpr uint32_t kLooks = 1000;  // polls between two queries of the event, each of which takes a lock
  std::atomic_ref<uint32_t> frame_there(reinterpret_cast<HandedOver*>(pinned.data())->frame);
  for (;;) {
    for (uint32_t i = 0; i < kLooks; ++i) {
      if (frame_there.load(std::memory_order_acquire) == frame_number) return {};
#if defined(__x86_64__)
      __builtin_ia32_pause();
#endif
    }
    const cudaError_t status = recorder.query(kCountersRead);
    const Result<void> done = cuda_check(status, "drawing");
    if (done || status != cudaErrorNotReady) return done;
  }
}

CudaFrames::CudaFrames(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
CudaFrames::CudaFrames(CudaFrames&&) noexcept = default;
CudaFrames& CudaFrames::operator=(CudaFrames&&) noexcept = default;
CudaFrames::~CudaFrames() = default;

uint64_t CudaFrames::device_bytes(const SceneView& host, const CudaQueueSizes& sizes) {
  return FrameBuffers::device_bytes(host, sizes);
}

Result<CudaFrames> CudaFrames::create(const SceneView& host, const SceneView& device, const CudaQueueSizes& sizes) try {
  auto impl = std::make_unique<Impl>();
  impl->scene = device;
  if (Result<void> opened = impl->open(host, sizes); !opened) return opened.error();
  return CudaFrames(std::move(impl));
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "out of memory for the draw list"};
}

Result<FrameStats> CudaFrames::draw(const View& view, uint64_t* samples, const DrawOptions& options,
                                    FrameTimes* times) {
  SCREE_TRY(start(view, samples, options));
  const Finished finished = SCREE_TRY(finish(times));
  return finished.stats;
}

Result<void> CudaFrames::start(const View& view, uint64_t* samples, const DrawOptions& options) {
  SCREE_TRY(check_frame(view, impl_->triangle_count));
  impl_->frame = make_frame_view(view);
  if (!options.rows.is_empty()) {
    impl_->frame.first_row = static_cast<int32_t>(options.rows.first);
    impl_->frame.end_row = static_cast<int32_t>(options.rows.end);
  }
  impl_->samples = samples;
  impl_->options = options;
  SCREE_TRY(impl_->prepare_alpha());
  SCREE_TRY(impl_->buffers.fit_pyramid(impl_->frame));
  return impl_->submit();
}

/// Makes room in the queues that overflowed, before the frame is drawn again. Errors kDevice; kRange: a queue would
/// need 2^32 entries.
Result<void> CudaFrames::Impl::grow_queues() {
  const FrameCounters& counters = handed_over().counters;
  FrameQueues& queues = buffers.queues;
  const bool lost_clusters = queues.lost_clusters(counters);
  // A little more than the frame needed, because the camera moves; the exact size if there is no memory for more.
  if (!queues.grow(queues.needed(counters, 4))) SCREE_TRY(queues.grow(queues.needed(counters, 0)));
  if (!queues.had_room(counters))
    return Error{ErrorCode::kRange, "a queue of the frame would need 2^32 entries; use --backend cpu"};
  // Clusters for which the queue had no room occluded nothing, so the frame set far too many hints. In a part of a
  // frame, a cluster with a new hint would also count as drawn before the part.
  return lost_clusters || options.part != FramePart::kWhole ? forget() : Result<void>();
}

/// Chooses how the next frame is drawn, from this one's view and counters: in how many rounds, by which kernel its
/// triangles are clipped (clips_many), whether clipping and stages 2 and 3 wait for the last pass (defers_stages), and
/// how often the hints are tested anew.
void CudaFrames::Impl::adapt_next_frame() {
  const bool has_new_rows = frame.first_row != last_view.first_row || frame.end_row != last_view.end_row;
  // kRest ends the frame that kPreviouslyVisible begins: it has as many rounds as a whole frame.
  if (options.part != FramePart::kPreviouslyVisible) last_view = frame;
  const FrameCounters& counters = handed_over().counters;
  clipped_before = counters.to_clip;
  queued_little = counters.to_clip == 0 && counters.queues.large == 0 && counters.queues.medium <= kMostDeferred;
  // After a jump of the camera most clusters that the second pass found turn out to be hidden, so all hints are tested
  // anew. The same holds for each part of a frame, because few of the chunks that may hide its first clusters were
  // resident. In rows that are new to a GPU everything was drawn, because nothing had hidden it.
  const uint64_t previously_visible = counters.clusters[0];
  const uint64_t newly_visible = clusters_before(counters, kClusterPasses) - previously_visible;
  const bool tests_all = options.part != FramePart::kWhole || has_new_rows || newly_visible > previously_visible;
  hint_period = tests_all ? 1 : kHintPeriod;
}

Result<CudaFrames::Finished> CudaFrames::finish(FrameTimes* times) {
  Impl& impl = *impl_;
  const FrameCounters& counters = impl.handed_over().counters;
  bool is_drawn_again = false;
  for (;;) {
    SCREE_TRY(impl.wait());
    if (impl.buffers.queues.had_room(counters)) break;
    SCREE_TRY(impl.grow_queues());
    is_drawn_again = true;
    impl.clipped_before = counters.to_clip;  // the guess is right, because the frame is the same
    if (impl.options.join != nullptr) return Finished{{}, is_drawn_again};
    SCREE_TRY(impl.submit());
  }
  impl.adapt_next_frame();
  const bool only_begins = impl.options.part == FramePart::kPreviouslyVisible;  // kRest is the second pass
  if (times != nullptr) SCREE_TRY(impl.recorder.read_times(impl.two_passes && !only_begins, *times));
  FrameStats stats{};
  if (!only_begins) {  // otherwise kRest counts them
    stats.instances_drawn = counters.queues.instances_drawn;
    stats.draws = counters.queues.draws + (counters.draws >> kWorkBits);
    stats.triangles = counters.queues.triangles;
  }
  stats.triangles_small = counters.queues.triangles_small;
  stats.triangles_medium = counters.queues.medium + counters.clipped.medium;
  stats.triangles_large = counters.queues.large + counters.clipped.large;
  stats.triangles_clipped = counters.queues.triangles_clipped;
  stats.groups_tested = counters.groups_tested;
  stats.clusters_tested = counters.clusters_tested;
  stats.clusters_drawn = clusters_before(counters, kClusterPasses) - counters.clusters_culled_late;
  return Finished{stats, is_drawn_again};
}

Result<void> CudaFrames::pages_came() {
  return impl_->buffers.traits.has_float32 ? impl_->find_all_bounds() : Result<void>();
}

const Transform* CudaFrames::transforms() const {
  return impl_->buffers.transforms.data();
}

}  // namespace scree::kernels
