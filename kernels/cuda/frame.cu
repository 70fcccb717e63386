// Frames on a GPU: the draw list's tables, the queues, and the order of the passes (docs/frame.md shows it on a page).
#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <new>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "kernels/cuda/check.h"
#include "kernels/cuda/cluster.cuh"
#include "kernels/cuda/cluster_clip.cuh"
#include "kernels/cuda/draw_tables.h"
#include "kernels/cuda/few_clusters.cuh"
#include "kernels/cuda/frame.h"
#include "kernels/cuda/graph.h"
#include "kernels/cuda/large.cuh"
#include "kernels/cuda/occupancy.h"
#include "kernels/cuda/pyramid.cuh"
#include "kernels/cuda/queues.h"
#include "kernels/cuda/small.cuh"
#include "kernels/cuda/small_scene_cull.cuh"

#pragma nv_diag_suppress 2810  // nvcc 13 treats the assignment of a nodiscard class as an ignored result

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

/// The first capacity of the queue of clusters.
uint64_t first_items(uint64_t cluster_groups, const CudaQueueSizes& sizes) {
  const uint64_t all = cluster_groups * format::kGroupClusters;
  return min_of(all, sizes.holds_first_frame ? max_of(sizes.clusters, all / 4) : sizes.clusters);
}

/// Whether the scene has no indexed chunks and is drawn in one pass.
bool is_small_scene(uint64_t indexed_candidates, uint64_t cluster_groups, const CudaQueueSizes& sizes) {
  return indexed_candidates == 0 && cluster_groups < sizes.two_pass_groups;
}

/// A stage 1 kernel, built for the scene's kind of positions and instances.
struct SmallVariant {
  void (*kernel)(const SmallFrame);
  size_t shared_bytes;
};

template <bool kOrthographic, bool kLattice, bool kFloat32, bool kInstanced, Alpha kAlpha = Alpha::kOpaque>
SmallVariant small_variant() {
  return {raster_small<kOrthographic, kLattice, kFloat32, kInstanced, kAlpha>,
          kSmallWarps * (sizeof(SmallShared<kInstanced>) + (kAlpha != Alpha::kOpaque ? sizeof(WarpMasks) : 0))};
}

SmallVariant choose_small(const DrawTables& tables, bool orthographic, Alpha alpha) {
  if (alpha == Alpha::kMasked)
    return orthographic ? small_variant<true, true, true, true, Alpha::kMasked>()
                        : small_variant<false, true, true, true, Alpha::kMasked>();
  if (alpha == Alpha::kBlended)
    return orthographic ? small_variant<true, true, true, true, Alpha::kBlended>()
                        : small_variant<false, true, true, true, Alpha::kBlended>();
  if (orthographic) return small_variant<true, true, true, true>();
  if (tables.has_lattice && tables.has_float32) return small_variant<false, true, true, true>();
  if (tables.has_float32) {
    return tables.has_instances ? small_variant<false, false, true, true>()
                                : small_variant<false, false, true, false>();
  }
  return tables.has_instances ? small_variant<false, true, false, true>() : small_variant<false, true, false, false>();
}

/// Shared memory of a block of raster_clusters.
template <Alpha kAlpha>
constexpr size_t kClusterSharedBytes = kClusterWarps*(sizeof(ClusterShared) +
                                                      (kAlpha != Alpha::kOpaque ? sizeof(ClusterWaiting) : 0));

template <Alpha kAlpha>
Result<void> prepare_clusters() {
  for (const auto kernel :
       {raster_clusters<false, 1, false, kAlpha>, raster_clusters<false, 1, true, kAlpha>,
        raster_clusters<false, kClusterParts, false, kAlpha>, raster_clusters<true, 1, false, kAlpha>,
        raster_clusters<true, 1, true, kAlpha>, raster_clusters<true, kClusterParts, false, kAlpha>}) {
    Result<void> done = cuda_check(
        cudaFuncSetAttribute(reinterpret_cast<const void*>(kernel), cudaFuncAttributeMaxDynamicSharedMemorySize,
                             static_cast<int>(kClusterSharedBytes<kAlpha>)),
        "asking for shared memory");
    if (!done) return done;
  }
  return {};
}

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

/// A frame's streams, or the branches of its graph.
enum Branch : uint32_t {
  kMain,
  kSide,  // stage 3
  kClip,  // triangles of clusters that are clipped, in all stages
  kBranchCount
};
static_assert(kBranchCount <= CudaGraph::kBranches);

/// From this many drawn triangles on, a frame is not run as a graph.
constexpr uint64_t kMostGraphTriangles = uint64_t{1} << 23;

/// The events of one pass. Stages 2 and 3 begin after `small_done`.
struct StageEvents {
  FrameEvent small_done;
  FrameEvent medium_done;
  FrameEvent large_begun;
  FrameEvent large_done;
};
constexpr StageEvents kFirstStages{kSmallDone, kMediumDone, kLargeBegun, kLargeDone};
constexpr StageEvents kSecondStages{kSecondSmallDone, kSecondMediumDone, kSecondLargeBegun, kSecondLargeDone};

bool same_clip_box(const ClipBox& a, const ClipBox& b) {
  if (a.is_set != b.is_set) return false;
  for (int k = 0; k < 3; ++k) {
    const ClipBox::Axis& x = a.axis[k];
    const ClipBox::Axis& y = b.axis[k];
    if (x.low_m != y.low_m || x.low_one != y.low_one || x.high_m != y.high_m || x.high_one != y.high_one) return false;
  }
  return true;
}

/// Whether few rows are new. Many new rows have the same effect as a camera that moved.
bool similar_rows(const FrameView& a, const FrameView& b) {
  return std::abs(a.first_row - b.first_row) + std::abs(a.end_row - b.end_row) <= a.height / 32;
}

bool same_view(const FrameView& a, const FrameView& b) {
  const auto same = [](const double(&x)[3], const double(&y)[3]) { return std::equal(x, x + 3, y); };
  return same(a.eye, b.eye) && same(a.row_x, b.row_x) && same(a.row_y, b.row_y) && same(a.row_w, b.row_w) &&
         a.offset_w == b.offset_w && a.width == b.width && a.height == b.height && a.orthographic == b.orthographic &&
         same_clip_box(a.clip_box, b.clip_box) && similar_rows(a, b);
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
  Impl() = default;
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    if (streams[kMain] != nullptr) (void)cudaStreamSynchronize(streams[kMain]);
    for (cudaEvent_t event : events) {
      if (event != nullptr) (void)cudaEventDestroy(event);
    }
    (void)cudaFreeHost(handed_over);
    for (cudaStream_t stream : streams) {
      if (stream != nullptr) (void)cudaStreamDestroy(stream);
    }
  }

  Result<void> open(const SceneView& host, const CudaQueueSizes& sizes);
  Result<void> open_clusters(const SceneView& host, const CudaQueueSizes& sizes);
  template <bool kClips>
  void submit_culling(const DrawList& list, const SamplesToClear& clear, bool draws_indexed, bool draws_clusters);
  template <bool kOrthographic, bool kClips>
  void submit_small_scene_culling(const DrawList& list, const SamplesToClear& clear);
  Result<void> find_all_bounds();
  Result<void> forget();
  Result<void> fit_pyramid(const FrameView& frame);
  Result<void> submit();
  /// Queues a kernel on a stream. In a frame that is a graph, adds it to a branch of the graph.
  template <class... P>
  void launch(Branch branch, void (*kernel)(P...), uint32_t blocks, uint32_t threads, size_t shared_bytes,
              const std::type_identity_t<P>&... arguments) {
    if (is_graph) {
      graph.add(branch, kernel, blocks, threads, shared_bytes, arguments...);
    } else {
      kernel<<<blocks, threads, shared_bytes, streams[branch]>>>(arguments...);
    }
  }
  /// Makes a branch continue where the main one is now, which `event` marks.
  Result<void> fork(FrameEvent event, Branch to) {
    if (is_graph) {
      graph.fork(kMain, to);
      return {};
    }
    const Result<void> done = record_event(event, kMain);
    return done ? cuda_check(cudaStreamWaitEvent(streams[to], events[event]), "forking") : done;
  }
  /// Makes the main branch wait for the end of another one, which `event` marks.
  Result<void> join(FrameEvent event, Branch from) {
    if (is_graph) {
      graph.join(from, kMain);
      return {};
    }
    const Result<void> done = record_event(event, from);
    return done ? cuda_check(cudaStreamWaitEvent(streams[kMain], events[event]), "joining") : done;
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
  Result<void> record_stages(const StageEvents& events_of_pass);
  template <Alpha kAlpha>
  LargeFrame<kAlpha> large_frame(const SmallFrame& small, const Queues& queued, const DrawnTriangles* drawn) const {
    LargeFrame<kAlpha> out{small.view, small.target, queued, drawn, {}};
    if constexpr (kAlpha != Alpha::kOpaque)
      out.masks = {scene, transforms.data()};
    else
      out.view = without_camera(small.view);
    return out;
  }
  ClusterList cluster_list() const;
  ClusterCull cluster_cull(const DrawList& list, const ClusterTests& tests, uint32_t pass, uint32_t round,
                           uint32_t rounds) const;
  Result<void> prepare(SmallVariant& variant) const;
  bool has_clusters() const { return cluster_candidates.count() != 0; }
  /// Each doubling of the groups adds a round: a round is worth its pyramid if it saves enough clusters.
  uint32_t rounds_when_moving() const {
    return min_of(max_of(static_cast<uint32_t>(std::bit_width(tables.cluster_groups / round_groups)), 1u), kMostRounds);
  }
  bool in_two_passes() const { return tables.cluster_groups >= two_pass_groups; }
  /// Whether clusters are so few that a block draws each (raster_few_clusters).
  bool has_few_clusters() const { return tables.cluster_groups < min_of(few_groups, two_pass_groups); }
  /// Whether one kernel does all culling, because there are few groups and no other chunks.
  bool culls_as_small_scene() const { return small_scene_groups.count() != 0; }
  /// A guess from the previous frame. raster_near_clipped is faster for many triangles. Its code is longer, and
  /// fetching it would delay a few triangles.
  bool clips_many() const { return clipped_before > uint64_t{resident.multiprocessors()} * kClusterWarps; }
  bool clips_on_own_stream() const { return has_clusters() && !in_two_passes(); }
  /// Whether clipping and stages 2 and 3 run only after the last pass. A guess from the previous frame, like
  /// clips_many(): that frame queued so little for them that it would have hidden hardly anything.
  bool defers_stages() const { return two_passes && options.part == FramePart::kWhole && queued_little; }
  /// Joins the samples with those of other GPUs, if these draw the frame too.
  Result<void> join_samples() const {
    return options.join != nullptr ? (*options.join)(streams[kMain]) : Result<void>();
  }
  /// Clears the counters for the next frame, while the host does not wait.
  Result<void> clear_counters() {
    Result<void> done =
        cuda_check(cudaMemsetAsync(zeroed.data(), 0, zeroed.count(), streams[kMain]), "clearing the counters");
    counters_cleared = static_cast<bool>(done);
    return done;
  }
  /// Graphs are worth it if a frame takes a fraction of a millisecond. Frames of two passes are no graphs, because
  /// their number of rounds changes.
  bool goes_as_graph() const {
    return options.part == FramePart::kWhole && !two_passes && !options.stage_times && order.count() != 0 &&
           triangle_count < kMostGraphTriangles;
  }
  Result<void> record_event(FrameEvent event, Branch branch) {
    return cuda_check(cudaEventRecord(events[event], streams[branch]), "recording an event");
  }
  /// Records an event between two stages, to measure their times.
  Result<void> mark(FrameEvent event, Branch branch = kMain) {
    return options.stage_times ? record_event(event, branch) : Result<void>();
  }
  Result<void> wait() const;
  Result<void> grow_queues();
  void adapt_next_frame();
  Result<void> read_times(FrameTimes& times) const;

  SceneView scene{};
  uint64_t triangle_count = 0;
  DrawTables tables;  // only the flags; the vectors are freed once they are on the device
  ResidentBlocks resident;
  SmallVariant variants[2] = {};  // perspective, orthographic
  std::optional<Alpha> prepared;  // of the variants
  // Blocking streams, so that work on the default stream (the resolver's) is ordered with the frame.
  cudaStream_t streams[kBranchCount] = {};
  CudaGraph graph;
  bool is_graph = false;  // of the last frame
  cudaEvent_t events[kEventCount] = {};
  HandedOver* handed_over = nullptr;  // pinned

  DeviceArray<uint32_t> order;
  DeviceArray<uint32_t> mesh_first;
  DeviceArray<CandidateDraw> candidates;
  DeviceArray<ChunkBounds> bounds;
  DeviceArray<std::byte> zeroed;  // the counters, then the visible instances of each mesh
  DeviceArray<uint32_t> visible;
  DeviceArray<Transform> transforms;
  DeviceArray<InstancedDraw> instanced_draws;
  FrameQueues queues;
  // Clustered chunks:
  DeviceArray<CandidateDraw> cluster_candidates;
  DeviceArray<ClusterChunk> cluster_chunks;
  DeviceArray<uint64_t> hint_offset;
  DeviceArray<uint32_t> hints;
  DeviceArray<ClusterDraw> draws;
  DeviceArray<DrawPlace> draw_places;
  DeviceArray<OrderedDraw> draw_order;
  DeviceArray<ClusterGroup> small_scene_groups;  // for scenes that are drawn in one pass and have no other chunks
  DeviceArray<uint32_t> pyramid_codes;
  DepthPyramid pyramid{};
  // The current frame:
  FrameView frame{};
  uint64_t* samples = nullptr;
  DrawOptions options;
  FrameView last_view{};
  bool two_passes = false;  // of the last frame
  uint64_t two_pass_groups = 0;
  uint64_t round_groups = 0;
  uint64_t few_groups = 0;
  uint32_t frame_number = 0;
  uint64_t clipped_before = 0;  // triangles of clusters, in the last frame
  bool queued_little = false;   // the last frame: nothing large or to be clipped, and hardly anything medium
  bool counters_cleared = false;
  uint32_t hint_period = kHintPeriod;  // of the next frame
};

Result<void> CudaFrames::Impl::open(const SceneView& host, const CudaQueueSizes& sizes) {
  triangle_count = host.instance_base[host.instance_count];
  two_pass_groups = sizes.two_pass_groups;
  round_groups = max_of<uint64_t>(sizes.round_groups, 1);
  few_groups = sizes.few_groups;
  Result<DrawTables> made = make_draw_tables(host);
  if (!made) return made.error();
  tables = std::move(*made);
  Result<void> done = resident.open();
  for (cudaStream_t& stream : streams) {
    if (done) done = cuda_check(cudaStreamCreate(&stream), "making a stream");
  }
  for (cudaEvent_t& event : events) {
    if (done) done = cuda_check(cudaEventCreate(&event), "making an event");
  }
  if (done) {
    done = cuda_check(cudaMallocHost(reinterpret_cast<void**>(&handed_over), sizeof(HandedOver)),
                      "allocating pinned memory");
    if (done) handed_over->frame = 0;
  }
  if (done) done = order.fill(tables.order, "allocating the draw list");
  if (done) done = mesh_first.fill(tables.mesh_first, "allocating the draw list");
  if (done) done = candidates.fill(tables.candidates, "allocating the draw list");
  if (done && tables.has_float32) done = bounds.allocate(host.chunk_count, "allocating the chunks' bounds");
  if (done && tables.has_float32) done = find_all_bounds();
  if (done) {
    done = zeroed.allocate(sizeof(FrameCounters) + host.mesh_count * sizeof(uint32_t), "allocating the draw list");
  }
  if (done) done = visible.allocate(tables.order.size(), "allocating the draw list");
  if (done) done = transforms.allocate(host.instance_count, "allocating the frame's transforms");
  if (done) done = instanced_draws.allocate(tables.candidates.size(), "allocating the draw list");
  if (done) done = queues.triangles.tiles.allocate(sizes.tiles, "allocating the queues");
  if (done) done = queues.grow({sizes.medium, sizes.large, 0, 0, 0, 0, 0, 0});
  if (done && !tables.cluster_candidates.empty()) done = open_clusters(host, sizes);
  if (done) done = prepare_alpha();
  if (done) done = cuda_check(cudaStreamSynchronize(streams[kMain]), "preparing to draw");
  tables.order = {};
  tables.mesh_first = {};
  tables.candidates = {};
  tables.cluster_candidates = {};
  tables.cluster_chunks = {};
  tables.hint_offset = {};
  return done;
}

/// Finds the boxes of the float32 chunks whose pages are resident.
Result<void> CudaFrames::Impl::find_all_bounds() {
  find_bounds<<<resident.of(find_bounds, 128), 128, 0, streams[kMain]>>>(scene, bounds.data());
  return cuda_check(cudaGetLastError(), "finding the chunks' bounds");
}

Result<void> CudaFrames::Impl::open_clusters(const SceneView& host, const CudaQueueSizes& sizes) {
  Result<void> done = cluster_candidates.fill(tables.cluster_candidates, "allocating the draw list");
  if (done) done = cluster_chunks.fill(tables.cluster_chunks, "allocating the draw list");
  if (done) done = hint_offset.fill(tables.hint_offset, "allocating the draw list");
  if (done && is_small_scene(tables.candidates.size(), tables.cluster_groups, sizes)) {
    done = small_scene_groups.fill(list_cluster_groups(host), "allocating the draw list");
  } else {
    if (done) done = draw_places.allocate(tables.cluster_draws, "allocating the draw list");
    if (done) done = draw_order.allocate(tables.cluster_draws, "allocating the draw list");
  }
  if (done) done = draws.allocate(max_of(tables.cluster_draws, small_scene_groups.count()), "allocating the draw list");
  if (done && in_two_passes()) {
    done = hints.allocate(tables.cluster_groups, "allocating a bit for each cluster");
    if (done) done = forget();
  }
  if (done) done = queues.clipped.tiles.allocate(sizes.tiles, "allocating the queues");
  if (done)
    done = queues.grow({0, 0, 0, first_items(tables.cluster_groups, sizes), sizes.to_clip, sizes.clipped, 0, 0});
  return done;
}

/// Clears all hints, as if nothing had been drawn before.
Result<void> CudaFrames::Impl::forget() {
  if (!in_two_passes()) return {};
  last_view = {};
  return cuda_check(cudaMemsetAsync(hints.data(), 0, tables.cluster_groups * sizeof(uint32_t), streams[kMain]),
                    "clearing a bit for each cluster");
}

/// Fits the pyramid to the image, if the image's size has changed.
Result<void> CudaFrames::Impl::fit_pyramid(const FrameView& frame) {
  if (!in_two_passes() || (pyramid.width == frame.width && pyramid.height == frame.height)) return {};
  const uint64_t count = lay_out(pyramid, frame.width, frame.height);
  if (count > pyramid_codes.count()) {
    if (Result<void> done = pyramid_codes.allocate(count, "allocating the depth pyramid"); !done) {
      pyramid.width = 0;
      return done;
    }
  }
  pyramid.codes = pyramid_codes.data();
  return {};
}

Result<void> CudaFrames::Impl::prepare(SmallVariant& variant) const {
  return cuda_check(cudaFuncSetAttribute(variant.kernel, cudaFuncAttributeMaxDynamicSharedMemorySize,
                                         static_cast<int>(variant.shared_bytes)),
                    "asking for shared memory");
}

Result<void> CudaFrames::Impl::prepare_alpha() {
  if (prepared == alpha()) return {};
  Result<void> done;
  for (const bool orthographic : {false, true}) {
    variants[orthographic] = choose_small(tables, orthographic, alpha());
    if (done) done = prepare(variants[orthographic]);
  }
  if (done && has_clusters()) done = with_alpha([&]<Alpha kAlpha>() { return prepare_clusters<kAlpha>(); });
  if (done) prepared = alpha();
  return done;
}

ClusterList CudaFrames::Impl::cluster_list() const {
  return {cluster_candidates.data(),
          cluster_chunks.data(),
          hint_offset.data(),
          static_cast<uint32_t>(cluster_candidates.count()),
          hints.data(),
          draws.data(),
          draw_places.data(),
          draw_order.data(),
          queues.items.data(),
          queues.items.count(),
          queues.to_clip.data(),
          queues.to_clip.count(),
          pyramid,
          static_cast<float>(std::clamp(tables.box.farthest(frame), 1.0, 1e38))};
}

ClusterCull CudaFrames::Impl::cluster_cull(const DrawList& list, const ClusterTests& tests, uint32_t pass,
                                           uint32_t round, uint32_t rounds) const {
  return {frame,  center_range(frame), cluster_list(), list.counters, samples, tests, pass, round,
          rounds, frame_number,        hint_period};
}

/// Finds the chunks that are drawn, and clears the picture.
template <bool kClips>
void CudaFrames::Impl::submit_culling(const DrawList& list, const SamplesToClear& clear, bool draws_indexed,
                                      bool draws_clusters) {
  launch(kMain, cull_instances<kClips>, (list.instance_count - 1) / kCullThreads + 1 + clear.blocks, kCullThreads, 0,
         scene, frame, list, clear);
  if (draws_indexed) {
    launch(kMain, cull_chunks<kClips>, (list.candidate_count - 1) / kCullThreads + 1, kCullThreads, 0, scene, frame,
           list);
  }
  if (draws_clusters) {
    const uint64_t threads = cluster_candidates.count() * kDrawInstances;
    const auto blocks = static_cast<uint32_t>((threads - 1) / kCullThreads + 1);
    const ClusterList clusters = cluster_list();
    launch(kMain, cull_clustered_chunks<kClips>, blocks, kCullThreads, 0, scene, frame, list, clusters,
           in_two_passes());
    launch(kMain, place_cluster_draws, static_cast<uint32_t>((tables.cluster_draws - 1) / kPlaceThreads + 1),
           kPlaceThreads, 0, list.counters, draw_places.data(), draw_order.data());
  }
}

/// Finds the clusters that are drawn, and clears the picture.
template <bool kOrthographic, bool kClips>
void CudaFrames::Impl::submit_small_scene_culling(const DrawList& list, const SamplesToClear& clear) {
  const auto group_count = static_cast<uint32_t>(small_scene_groups.count());
  const uint32_t blocks = (group_count - 1) / kCullWarps + 1 + clear.blocks;
  launch(kMain, cull_small_scene<kOrthographic, kClips>, blocks, kCullThreads, 0,
         {scene, list.transforms, cluster_cull(list, {options.cluster_bounds, false}, 0, 0, 1),
          small_scene_groups.data(), group_count, clear});
}

/// Culls the clusters of a pass, unless cull_small_scene() has done that, and draws them. `clips`: also draws their
/// triangles that need clipping, unless these have a stream of their own.
template <bool kOrthographic, ClusterPass kPass, Alpha kAlpha>
void CudaFrames::Impl::submit_clusters(const SmallFrame& small, uint32_t round, uint32_t rounds, bool clips) {
  const uint32_t pass = kPass == ClusterPass::kNewlyVisible ? 1 + round : 0;
  if (!culls_as_small_scene()) {
    // More blocks than the registers allow at once: culling waits for memory, and late blocks balance the load.
    const auto cull =
        frame.clip_box.is_set ? cull_clusters<kOrthographic, kPass, true> : cull_clusters<kOrthographic, kPass, false>;
    launch(kMain, cull, resident.fill(kCullThreads), kCullThreads, 0,
           cluster_cull(small.list, {options.cluster_bounds, options.occlusion}, pass, round, rounds));
  }
  const ClusterFrame clusters{small, cluster_list(), pass};
  // Not in parts of a frame: their last pass has no first pass to compare with.
  const bool culls_late = kPass == ClusterPass::kNewlyVisible && options.part == FramePart::kWhole;
  const auto kernel = has_few_clusters() ? raster_few_clusters<kOrthographic, kAlpha>
                      : !in_two_passes() ? raster_clusters<kOrthographic, kClusterParts, false, kAlpha>
                      : culls_late       ? raster_clusters<kOrthographic, 1, true, kAlpha>
                                         : raster_clusters<kOrthographic, 1, false, kAlpha>;
  const size_t shared_bytes = has_few_clusters() ? 0 : kClusterSharedBytes<kAlpha>;
  launch(kMain, kernel, resident.of(kernel, kClusterThreads, shared_bytes), kClusterThreads, shared_bytes, clusters);
  if (clips && !clips_on_own_stream()) submit_clipped<kOrthographic, kAlpha>(clusters, kMain);
}

/// Clips the triangles of clusters that need it.
template <bool kOrthographic, Alpha kAlpha>
void CudaFrames::Impl::submit_clipped(const ClusterFrame& clusters, Branch branch) {
  if constexpr (!kOrthographic) {  // clip_near() is for perspective only
    if (clips_many()) {
      const auto near_clipped = raster_near_clipped<kAlpha>;
      launch(branch, near_clipped, resident.of(near_clipped, kClusterThreads), kClusterThreads, 0, clusters);
      return;
    }
  }
  launch(branch, raster_clipped<kOrthographic, kAlpha>, resident.multiprocessors(), kClusterThreads, 0, clusters);
}

/// Clips the triangles of clusters that need it and draws the remaining pieces, while all other triangles go through
/// stages 2 and 3. They are few, but each takes 20 us. The additional kernels are worth it only in short frames: in
/// scenes that are drawn in one pass.
template <bool kOrthographic, Alpha kAlpha>
Result<void> CudaFrames::Impl::submit_clipping_on_own_stream(const SmallFrame& small) {
  SmallFrame clipped = small;
  clipped.queues = queues.clipped.view(&small.list.counters->clipped);
  const LargeFrame<kAlpha> queued = large_frame<kAlpha>(small, clipped.queues, &small.list.counters->clipped_drawn);
  Result<void> done = fork(kClustersDone, kClip);
  if (!done) return done;
  submit_clipped<kOrthographic, kAlpha>({clipped, cluster_list(), 0}, kClip);
  const auto large = raster_large<kOrthographic, kAlpha>;
  launch(kClip, split_large<kOrthographic, kAlpha>, resident.multiprocessors(), kLargeThreads, 0, queued);
  launch(kClip, large, resident.of(large, kLargeThreads), kLargeThreads, 0, queued);
  launch(kClip, raster_medium<kOrthographic, kAlpha>, resident.multiprocessors(), kLargeThreads, 0, queued);
  return cuda_check(cudaGetLastError(), "starting to clip");
}

/// Runs stages 2 and 3 side by side, because each alone is too little work for the GPU.
template <bool kOrthographic, Alpha kAlpha>
Result<void> CudaFrames::Impl::submit_stages(const SmallFrame& small, const StageEvents& at) {
  const LargeFrame<kAlpha> queued = large_frame<kAlpha>(small, small.queues, &small.list.counters->drawn);
  Result<void> done;
  if (clips_on_own_stream()) done = submit_clipping_on_own_stream<kOrthographic, kAlpha>(small);
  if (done) done = fork(at.small_done, kSide);
  if (done) done = mark(at.large_begun, kSide);
  if (done) {
    const auto split = split_large<kOrthographic, kAlpha>;
    const auto large = raster_large<kOrthographic, kAlpha>;
    launch(kSide, split, resident.of(split, kLargeThreads), kLargeThreads, 0, queued);
    launch(kSide, large, resident.of(large, kLargeThreads), kLargeThreads, 0, queued);
    done = cuda_check(cudaGetLastError(), "starting stage 3");
  }
  if (done) {
    const auto medium = raster_medium<kOrthographic, kAlpha>;
    launch(kMain, medium, resident.of(medium, kLargeThreads), kLargeThreads, 0, queued);
    done = cuda_check(cudaGetLastError(), "starting stage 2");
  }
  if (done) done = mark(at.medium_done);
  if (done) done = join(at.large_done, kSide);
  if (done && clips_on_own_stream()) done = join(kClippedDone, kClip);
  return done;
}

/// Records the events of stages that run only after the last pass, so that their times are 0 here.
Result<void> CudaFrames::Impl::record_stages(const StageEvents& at) {
  Result<void> done;
  for (const FrameEvent event : {at.small_done, at.large_begun, at.large_done, at.medium_done})
    if (done) done = mark(event);
  return done;
}

/// Draws the frame.
template <bool kOrthographic, Alpha kAlpha>
Result<void> CudaFrames::Impl::submit_passes() {
  auto* const counters = reinterpret_cast<FrameCounters*>(zeroed.data());
  const DrawList list{order.data(),
                      mesh_first.data(),
                      candidates.data(),
                      bounds.data(),
                      static_cast<uint32_t>(order.count()),
                      static_cast<uint32_t>(candidates.count()),
                      reinterpret_cast<uint32_t*>(zeroed.data() + sizeof(FrameCounters)),
                      visible.data(),
                      transforms.data(),
                      instanced_draws.data(),
                      counters};
  const Target target{samples, frame.width, options.peeled, options.fragments};
  const uint64_t row_samples = static_cast<uint64_t>(frame.width);
  uint64_t* const first_sample = samples + static_cast<uint64_t>(frame.first_row) * row_samples;
  const uint64_t sample_count = static_cast<uint64_t>(frame.end_row - frame.first_row) * row_samples;

  Result<void> done;
  static_assert(kBackground == ~uint64_t{0});
  // A one-pass frame has no hints.
  const bool draws_only_previously_visible = options.part == FramePart::kPreviouslyVisible;
  const bool draws_clusters = has_clusters() && (two_passes || !draws_only_previously_visible);
  const bool draws_indexed = list.candidate_count != 0 && !draws_only_previously_visible;
  if (done && options.part != FramePart::kWhole && draws_indexed && tables.has_float32) done = find_all_bounds();
  const bool clears = options.part == FramePart::kWhole;
  const bool culls = list.instance_count != 0 && (draws_indexed || draws_clusters);
  if (done && clears && !culls) {
    done = cuda_check(cudaMemsetAsync(first_sample, 0xff, sample_count * sizeof(uint64_t), streams[kMain]), "clearing");
  }
  if (done) done = mark(kCleared);
  if (done && culls) {
    const SamplesToClear clear{first_sample, sample_count, clears ? resident.fill(kCullThreads) : 0};
    const auto submit = [&]<bool kClips>() {
      if (culls_as_small_scene()) {
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
    done = cuda_check(cudaGetLastError(), "starting culling");
  }
  if (done) done = mark(kCulled);
  const SmallFrame small{scene,
                         frame,
                         target,
                         queues.triangles.view(&counters->queues),
                         list,
                         make_sample_limits(frame),
                         options.sampleless_test};
  if (done && draws_indexed) {
    const SmallVariant& variant = variants[kOrthographic ? 1 : 0];
    const uint32_t blocks = resident.of(variant.kernel, kSmallThreads, variant.shared_bytes);
    launch(kMain, variant.kernel, blocks, kSmallThreads, variant.shared_bytes, small);
  }
  const bool defers = defers_stages();
  if (done && draws_clusters) {
    if (two_passes && options.part != FramePart::kRest) {
      submit_clusters<kOrthographic, ClusterPass::kPreviouslyVisible, kAlpha>(small, 0, 1, !defers);
    } else if (!two_passes) {
      submit_clusters<kOrthographic, ClusterPass::kOnly, kAlpha>(small, 0, 1, true);
    }
  }
  if (done) done = cuda_check(cudaGetLastError(), "starting stage 1");
  if (done) {
    done = defers ? record_stages(kFirstStages) : submit_stages<kOrthographic, kAlpha>(small, kFirstStages);
  }
  if (done) done = mark(kFirstDone);
  if (done && two_passes) done = join_samples();
  if (done && two_passes && !draws_only_previously_visible) {
    const auto tiles_along = [](int32_t side) { return (static_cast<uint32_t>(side) - 1) / kPyramidTile + 1; };
    const dim3 tiles_of_image(tiles_along(frame.width), tiles_along(frame.height));
    // If the camera stood still, few clusters are newly visible, and one round is the least work.
    const uint32_t rounds = same_view(frame, last_view) ? 1 : rounds_when_moving();
    for (uint32_t round = 0; round < rounds && done; ++round) {
      build_pyramid_tiles<<<tiles_of_image, kPyramidThreads, 0, streams[kMain]>>>(pyramid, samples, frame.first_row,
                                                                                  frame.end_row);
      build_pyramid_top_and_begin_pass<<<1, 1024, 0, streams[kMain]>>>(pyramid, counters, !defers);
      if (round == 0) done = mark(kPyramidDone);
      const bool ends = !defers || round + 1 == rounds;
      submit_clusters<kOrthographic, ClusterPass::kNewlyVisible, kAlpha>(small, round, rounds, ends);
      if (done) done = cuda_check(cudaGetLastError(), "starting the second pass");
      if (done && ends) done = submit_stages<kOrthographic, kAlpha>(small, kSecondStages);
    }
  }
  return done;
}

/// Starts the frame, or starts it again.
Result<void> CudaFrames::Impl::submit() {
  ++frame_number;
  two_passes = has_clusters() && in_two_passes() && options.cluster_bounds && options.occlusion;
  is_graph = goes_as_graph();
  Result<void> done;
  if (is_graph) {
    graph.begin();
    done = submit_passes();
    if (done) done = graph.update();
  }
  if (done) done = record_event(kStart, kMain);
  if (done && !counters_cleared) done = clear_counters();
  counters_cleared = false;
  if (done) done = is_graph ? graph.launch(streams[kMain]) : submit_passes();
  if (done) done = join_samples();
  const auto* const counters = reinterpret_cast<const FrameCounters*>(zeroed.data());
  if (done) done = record_event(kAllDone, kMain);
  if (done) {
    hand_over<<<1, kWarpLanes, 0, streams[kMain]>>>(counters, handed_over, frame_number);
    done = cuda_check(cudaGetLastError(), "reading the counters");
  }
  if (done) done = record_event(kCountersRead, kMain);
  if (done) done = clear_counters();
  return done;
}

/// Waits for the counters of the frame. It polls their last word, which arrives before the event that is recorded
/// behind it. The event only reports errors.
Result<void> CudaFrames::Impl::wait() const {
  constexpr uint32_t kLooks = 1000;  // polls between two queries of the event, each of which takes a lock
  std::atomic_ref<uint32_t> frame_there(handed_over->frame);
  for (;;) {
    for (uint32_t i = 0; i < kLooks; ++i) {
      if (frame_there.load(std::memory_order_acquire) == frame_number) return {};
#if defined(__x86_64__)
      __builtin_ia32_pause();
#endif
    }
    const cudaError_t status = cudaEventQuery(events[kCountersRead]);
    const Result<void> done = cuda_check(status, "drawing");
    if (done || status != cudaErrorNotReady) return done;
  }
}

Result<void> CudaFrames::Impl::read_times(FrameTimes& times) const {
  struct Span {
    float* out;
    FrameEvent from;
    FrameEvent to;
    bool is_there;
  };
  times.has_stages = options.stage_times;
  const bool has_second = two_passes && options.part != FramePart::kPreviouslyVisible;
  const Span spans[] = {{&times.clear_ms, kStart, kCleared, true},
                        {&times.cull_ms, kCleared, kCulled, true},
                        {&times.small_ms, kCulled, kSmallDone, true},
                        {&times.medium_ms, kSmallDone, kMediumDone, true},
                        {&times.large_ms, kLargeBegun, kLargeDone, true},
                        {&times.pyramid_ms, kFirstDone, kPyramidDone, has_second},
                        {&times.second_ms, kPyramidDone, kAllDone, has_second},
                        {&times.raster_ms, kStart, kAllDone, true}};
  for (const Span& span : spans) {
    *span.out = 0;
    if (!span.is_there || (!times.has_stages && span.out != &times.raster_ms)) continue;
    Result<void> done = cuda_check(cudaEventElapsedTime(span.out, events[span.from], events[span.to]), "reading times");
    if (!done) return done;
  }
  return {};
}

CudaFrames::CudaFrames(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
CudaFrames::CudaFrames(CudaFrames&&) noexcept = default;
CudaFrames& CudaFrames::operator=(CudaFrames&&) noexcept = default;
CudaFrames::~CudaFrames() = default;

uint64_t CudaFrames::device_bytes(const SceneView& host, const CudaQueueSizes& sizes) {
  const CandidateCounts candidates = count_candidates(host);
  uint64_t bytes = sizeof(FrameCounters) + 2 * host.mesh_count * sizeof(uint32_t) +
                   host.instance_count * (2 * sizeof(uint32_t) + sizeof(Transform)) +
                   host.chunk_count * sizeof(ChunkBounds) +
                   candidates.indexed * (sizeof(CandidateDraw) + sizeof(InstancedDraw)) +
                   (sizes.medium + sizes.large) * sizeof(Triangle) + sizes.tiles * sizeof(TileItem);
  const bool is_small = is_small_scene(candidates.indexed, candidates.cluster_groups, sizes);
  const uint64_t small_scene_groups = is_small ? candidates.cluster_groups : 0;
  if (candidates.clustered != 0) {
    bytes += candidates.clustered * sizeof(CandidateDraw) +
             (is_small ? 0 : candidates.cluster_draws * (sizeof(DrawPlace) + sizeof(OrderedDraw))) +
             max_of(candidates.cluster_draws, small_scene_groups) * sizeof(ClusterDraw) +
             small_scene_groups * sizeof(ClusterGroup) + host.chunk_count * sizeof(ClusterChunk) +
             host.instance_count * sizeof(uint64_t) + candidates.cluster_groups * sizeof(uint32_t) +
             first_items(candidates.cluster_groups, sizes) * sizeof(ClusterItem) + sizes.to_clip * sizeof(ClipItem) +
             2 * sizes.clipped * sizeof(Triangle) + sizes.tiles * sizeof(TileItem);
  }
  return bytes;
}

Result<CudaFrames> CudaFrames::create(const SceneView& host, const SceneView& device, const CudaQueueSizes& sizes) {
  try {
    auto impl = std::make_unique<Impl>();
    impl->scene = device;
    if (Result<void> opened = impl->open(host, sizes); !opened) return opened.error();
    return CudaFrames(std::move(impl));
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "out of memory for the draw list"};
  }
}

Result<FrameStats> CudaFrames::draw(const View& view, uint64_t* samples, const DrawOptions& options,
                                    FrameTimes* times) {
  if (Result<void> started = start(view, samples, options); !started) return started.error();
  const Result<Finished> finished = finish(times);
  if (!finished) return finished.error();
  return finished->stats;
}

Result<void> CudaFrames::start(const View& view, uint64_t* samples, const DrawOptions& options) {
  if (Result<void> checked = check_frame(view, impl_->triangle_count); !checked) return checked;
  impl_->frame = make_frame_view(view);
  if (!options.rows.is_empty()) {
    impl_->frame.first_row = static_cast<int32_t>(options.rows.first);
    impl_->frame.end_row = static_cast<int32_t>(options.rows.end);
  }
  impl_->samples = samples;
  impl_->options = options;
  if (Result<void> done = impl_->prepare_alpha(); !done) return done;
  if (Result<void> done = impl_->fit_pyramid(impl_->frame); !done) return done;
  return impl_->submit();
}

/// Makes room in the queues that overflowed, before the frame is drawn again. Errors kDevice; kRange: a queue would
/// need 2^32 entries.
Result<void> CudaFrames::Impl::grow_queues() {
  const bool lost_clusters = queues.lost_clusters(handed_over->counters);
  // A little more than the frame needed, because the camera moves; the exact size if there is no memory for more.
  Result<void> grown = queues.grow(queues.needed(handed_over->counters, 4));
  if (!grown) grown = queues.grow(queues.needed(handed_over->counters, 0));
  if (!grown) return grown;
  if (!queues.had_room(handed_over->counters))
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
  clipped_before = handed_over->counters.to_clip;
  queued_little = handed_over->counters.to_clip == 0 && handed_over->counters.queues.large == 0 &&
                  handed_over->counters.queues.medium <= kMostDeferred;
  // After a jump of the camera most clusters that the second pass found turn out to be hidden, so all hints are tested
  // anew. The same holds for each part of a frame, because few of the chunks that may hide its first clusters were
  // resident. In rows that are new to a GPU everything was drawn, because nothing had hidden it.
  const uint64_t previously_visible = handed_over->counters.clusters[0];
  const uint64_t newly_visible = clusters_before(handed_over->counters, kClusterPasses) - previously_visible;
  const bool tests_all = options.part != FramePart::kWhole || has_new_rows || newly_visible > previously_visible;
  hint_period = tests_all ? 1 : kHintPeriod;
}

Result<CudaFrames::Finished> CudaFrames::finish(FrameTimes* times) {
  bool is_drawn_again = false;
  for (;;) {
    if (Result<void> done = impl_->wait(); !done) return done.error();
    if (impl_->queues.had_room(impl_->handed_over->counters)) break;
    if (Result<void> grown = impl_->grow_queues(); !grown) return grown.error();
    is_drawn_again = true;
    impl_->clipped_before = impl_->handed_over->counters.to_clip;  // the guess is right, because the frame is the same
    if (impl_->options.join != nullptr) return Finished{{}, is_drawn_again};
    if (Result<void> done = impl_->submit(); !done) return done.error();
  }
  impl_->adapt_next_frame();
  if (times != nullptr) {
    if (Result<void> done = impl_->read_times(*times); !done) return done.error();
  }
  const Counters& counters = impl_->handed_over->counters.queues;
  FrameStats stats{};
  if (impl_->options.part != FramePart::kPreviouslyVisible) {  // otherwise kRest counts them
    stats.instances_drawn = counters.instances_drawn;
    stats.draws = counters.draws + (impl_->handed_over->counters.draws >> kWorkBits);
    stats.triangles = counters.triangles;
  }
  stats.triangles_small = counters.triangles_small;
  stats.triangles_medium = counters.medium + impl_->handed_over->counters.clipped.medium;
  stats.triangles_large = counters.large + impl_->handed_over->counters.clipped.large;
  stats.triangles_clipped = counters.triangles_clipped;
  stats.groups_tested = impl_->handed_over->counters.groups_tested;
  stats.clusters_tested = impl_->handed_over->counters.clusters_tested;
  stats.clusters_drawn =
      clusters_before(impl_->handed_over->counters, kClusterPasses) - impl_->handed_over->counters.clusters_culled_late;
  return Finished{stats, is_drawn_again};
}

Result<void> CudaFrames::pages_came() {
  return impl_->tables.has_float32 ? impl_->find_all_bounds() : Result<void>();
}

const Transform* CudaFrames::transforms() const {
  return impl_->transforms.data();
}

}  // namespace scree::kernels
