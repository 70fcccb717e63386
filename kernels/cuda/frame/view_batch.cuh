// Many small pictures of one scene in one kernel. Even for the smallest picture a frame's kernels take 0.1 ms, since
// each begins when the last warp of the previous one has ended. Here a warp takes one group of 32 clusters for one
// view, and does all the work from the instance's matrix to the samples. It culls the group and its clusters, projects
// each vertex once and sets up the triangles. It draws small triangles 32 at a time, and larger ones one after the
// other. No warp waits for another, no work is queued for a later kernel, and no queue can be too small.
//
// Frames and batches share the source that decides a pixel (kernels/raster, kernels/cull), and a sample is the minimum
// of all that is drawn there. So the pictures are those of single frames, bit for bit.
#pragma once

#include "kernels/cuda/frame/cluster_list.h"
#include "kernels/cuda/raster/small.cuh"
#include "kernels/cull/cluster_bounds.h"
#include "kernels/raster/large.h"
#include "kernels/shade/layers.h"

namespace scree::kernels {

/// A view of a batch, in device memory.
struct BatchView {
  FrameView frame;
  double z_near;
  double z_far;
};

/// Zero when a batch begins.
struct BatchCounters {
  FrameStats stats;  // sums over all views
  uint64_t next;     // work handed out; zero before each launch
};

struct BatchFrame {
  SceneView scene;
  FrameView size;  // of every picture; it has no camera
  const BatchView* views;
  const ClusterGroup* groups;
  uint32_t group_count;
  uint64_t work;      // views times groups, view by view
  uint64_t* samples;  // picture after picture
  uint64_t picture_samples;
  Triangle* queued;  // 2 * kWarpQueue of each warp: medium triangles, then large ones
  BatchCounters* counters;
};

inline constexpr uint32_t kBatchThreads = 128;
inline constexpr uint32_t kBatchWarps = kBatchThreads / kWarpLanes;
inline constexpr uint32_t kBatchLayerThreads = 256;

/// Triangles of one kind that a warp draws after the small ones: one per lane, or the pieces of a few clipped ones.
inline constexpr uint32_t kWarpQueue = kWarpLanes;
inline constexpr uint32_t kClippedAtOnce = kWarpQueue / (kMaxPolygon - 2);

/// The work of a warp: a group of clusters of an instance in one view.
struct BatchGroup {
  Transform transform;  // of the instance
  uint64_t first_id;    // of the chunk's triangle 0
  int64_t origin[3];    // lattice coordinates of the chunk's position_min minus the transform's reference
  const format::ClusterBounds* bounds;  // of the chunk's clusters, whose records and data follow
  uint32_t cluster_count;               // of the chunk
  bool is_double_sided;

  __device__ const format::ClusterRecord* records() const {
    return reinterpret_cast<const format::ClusterRecord*>(bounds + cluster_count);
  }
  __device__ const uint32_t* data() const { return reinterpret_cast<const uint32_t*>(records() + cluster_count); }
};

/// A warp's shared memory.
struct BatchShared {
  BatchGroup group;
  Counters queued;  // `medium` and `large` of this warp's queues
  union {
    CoverageFilter filter;  // of the group's chunk, while its clusters are tested
    ScreenVertex vertices[format::kMaxClusterVertices];
  };
  Triangle survivors[2 * kWarpLanes - 1];  // wait until there are 32
  SetUpTriangles set_up;
};

/// The same for masks.
struct BatchMasks {
  WarpMasks waiting;
  MaskPlane plane;  // of a queued triangle, and its samples
  WarpSamples samples;
};

inline constexpr uint32_t kBatchBlocks = blocks_in_shared(kBatchWarps * sizeof(BatchShared), 7);
inline constexpr uint32_t kMaskedBatchBlocks =
    blocks_in_shared(kBatchWarps * (sizeof(BatchShared) + sizeof(BatchMasks)), 4);

/// This warp's shared memory.
__device__ inline BatchShared& batch_shared() {
  __shared__ BatchShared all[kBatchWarps];
  return all[threadIdx.x / kWarpLanes];
}
__device__ inline BatchMasks& batch_masks() {
  extern __shared__ uint4 shared_memory[];
  return reinterpret_cast<BatchMasks*>(shared_memory)[threadIdx.x / kWarpLanes];
}

/// Dynamic shared memory of a block that draws masked surfaces. Together with the static shared memory it would exceed
/// the 48 KiB that a block may have statically.
inline constexpr size_t kBatchMaskBytes = kBatchWarps * sizeof(BatchMasks);

/// This warp's queues.
__device__ inline Queues batch_queues(const BatchFrame& in) {
  const uint64_t warp = uint64_t{blockIdx.x} * kBatchWarps + threadIdx.x / kWarpLanes;
  Triangle* const medium = in.queued + 2 * kWarpQueue * warp;
  return {nullptr, medium, medium + kWarpQueue, nullptr, 0, kWarpQueue, kWarpQueue, 0, &batch_shared().queued};
}

template <bool kOrthographic>
__device__ inline bool may_show(const FrameView& size, const CoverageFilter& filter,
                                const format::ClusterBounds* bounds) {
  ScreenBounds on_screen;
  return bound_on_screen<kOrthographic>(filter, size, center_range(size), centered_box(load_bounds(bounds)),
                                        on_screen) == BoxCoverage::kCenters;
}

/// A cluster of the warp's group: the same in all lanes.
struct BatchCluster {
  const uint32_t* data;  // of the chunk's clusters
  format::ClusterLayout at;
  format::ClusterPredictor predictor;
  uint32_t first_triangle;  // in the chunk
  int32_t base[3];          // lattice coordinates of code 0 minus the transform's reference, modulo 2^32
  bool is_narrow;           // these and the vertices' relative coordinates fit int32

  __device__ BatchCluster(const BatchGroup& group, uint32_t number) : data(group.data()) {
    const uint4 record = __ldg(reinterpret_cast<const uint4*>(group.records() + number));
    const format::ClusterBounds bounds = load_bounds(group.bounds + number);
    at = format::cluster_layout({record.x, record.y, record.z, record.w});
    first_triangle = record.y;
    predictor = {at.predicted_axis, 0, 0, 0};
    if (at.predicted_axis != format::kNotPredicted) {
      const uint32_t slopes = data[at.prediction];
      predictor.slope_u = static_cast<int16_t>(slopes & 0xffffu);
      predictor.slope_v = static_cast<int16_t>(slopes >> 16);
      predictor.bias = data[at.prediction + 1];
    }
    constexpr int64_t kNarrow = int64_t{1} << 30;  // as in make_reader_of()
    is_narrow = true;
    for (int i = 0; i < 3; ++i) {
      const int64_t from = wrapping_add(group.origin[i], int64_t{format::bounds_min(bounds, i)});
      base[i] = static_cast<int32_t>(from);
      is_narrow = is_narrow && from < kNarrow && from > -kNarrow;
    }
  }

  /// ChunkReader::relative() of a vertex of the cluster.
  __device__ void relative(const BatchGroup& group, uint32_t vertex, float out[3]) const {
    const uint32_t* const positions = data + at.positions;
    uint32_t bit = vertex * (at.position_bits[0] + at.position_bits[1] + at.position_bits[2]);
    uint32_t code[3];
    for (int i = 0; i < 3; ++i) {
      const uint32_t* const from = positions + (bit >> 5);
      code[i] = __funnelshift_r(from[0], from[1], bit) & ((1u << at.position_bits[i]) - 1);
      bit += at.position_bits[i];
    }
    predict_code(predictor, code);
    for (int i = 0; i < 3; ++i) {
      if (is_narrow) {
        out[i] = static_cast<float>(base[i] + static_cast<int32_t>(code[i]));
      } else {
        constexpr int64_t kEnd = INT64_MAX - (int64_t{1} << 32);
        const int64_t offset = int64_t{static_cast<uint32_t>(base[i]) - static_cast<uint32_t>(group.origin[i])};
        const int64_t from = wrapping_add(group.origin[i], offset);
        out[i] = static_cast<float>(min_of(from, kEnd) + static_cast<int64_t>(code[i]));
      }
    }
  }
};

/// The corners of a cluster's triangles. A lane has every 32nd triangle.
class BatchCorners {
 public:
  __device__ explicit BatchCorners(const BatchCluster& cluster)
      : steps_(cluster.data + cluster.at.steps),
        distances_(cluster.data + cluster.at.distances),
        bits_(cluster.at.distance_bits),
        wide_(cluster.at.wide_steps ? (cluster.at.triangle_count + 31) / 32 : 0),
        up_to_lane_((2u << threadIdx.x % kWarpLanes) - 1) {}

  /// The corners of the next 32 triangles, by all lanes; `is_there`: whether the lane has one, `number` in the cluster.
  __device__ void next(uint32_t number, bool is_there, uint32_t out[3]) {
    const uint32_t low = steps_[0];
    out[0] = largest_ + static_cast<uint32_t>(__popc(low & up_to_lane_));
    largest_ += static_cast<uint32_t>(__popc(low));
    if (wide_ != 0) {
      const uint32_t high = steps_[wide_];
      out[0] += 2 * static_cast<uint32_t>(__popc(high & up_to_lane_));
      largest_ += 2 * static_cast<uint32_t>(__popc(high));
    }
    ++steps_;
    if (!is_there) return;
    const uint32_t bit = number * 2 * bits_;
    const uint32_t* const from = distances_ + (bit >> 5);
    const uint32_t both = __funnelshift_r(from[0], from[1], bit);
    const uint32_t mask = (1u << bits_) - 1;
    out[1] = out[0] - (both & mask);
    out[2] = out[0] - (both >> bits_ & mask);
  }

 private:
  const uint32_t* steps_;
  const uint32_t* distances_;
  uint32_t bits_;  // of a distance
  uint32_t wide_;  // words from a step's low bits to its high ones; 0: there are none
  uint32_t up_to_lane_;
  uint32_t largest_ = 2;  // vertex of the triangles before
};

/// Tests a group of clusters for a view: the box of its instance, the box of its chunk and its own box. If it may be
/// visible, stores its transform and filter in shared memory and returns true. Out of line, so that the loops over
/// clusters do not keep its registers.
template <bool kOrthographic>
__device__ __noinline__ bool prepare_group(const BatchFrame& in, const FrameView& view, const ClusterGroup& at) {
  if (is_omitted(view, at.instance)) return false;
  const SceneView& scene = in.scene;
  const format::InstanceRecord& instance = scene.instances[at.instance];
  const format::ChunkRecord& chunk = scene.chunks[at.chunk];
  const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
  const uint32_t lane = threadIdx.x % kWarpLanes;
  FrameStats& stats = in.counters->stats;
  constexpr bool kFloat32 = false;  // clusters lie on a lattice
  Transform transform = make_transform(view, scene.matrices[instance.matrix], mesh.lattice_exponent, kFloat32);
  if (!may_be_seen(transform, in.size, mesh_box(mesh, transform))) return false;
  if (lane == 0 && at.group == 0 && at.chunk == mesh.first_chunk) WarpTeam::add(&stats.instances_drawn, 1);
  if (scene.pages[chunk.page] == nullptr) return false;
  const RoundedBox box = rounded_chunk_box(mesh, chunk, transform);
  if (mesh.chunk_count != 1 && !may_be_seen(transform, in.size, box)) return false;
  if (lane == 0 && at.group == 0) {
    WarpTeam::add(&stats.draws, 1);
    WarpTeam::add(&stats.triangles, uint64_t{chunk.triangle_count});
  }
  if (lane == 0) WarpTeam::add(&stats.groups_tested, 1);
  const TransformError error = error_of(transform, box);
  const CoverageFilter filter = make_coverage_filter(in.size, transform, error, lattice_box(transform, mesh, chunk));
  const std::byte* const payload = scene.pages[chunk.page] + chunk.offset;
  const format::ChunkStreams streams = streams_of(mesh, chunk);
  const auto* const bounds = reinterpret_cast<const format::ClusterBounds*>(payload + streams.group_bounds.offset);
  if (!may_show<kOrthographic>(in.size, filter, bounds + at.group)) return false;
  if (lane == 0) {
    transform.error_x = error.x;
    transform.error_y = error.y;
    transform.error_w = error.w;
    BatchGroup& group = batch_shared().group;
    group.transform = transform;
    group.first_id = scene.instance_base[at.instance] + chunk.first_triangle;
    for (int i = 0; i < 3; ++i)
      group.origin[i] =
          wrapping_sub(wrapping_add(mesh.lattice_min[i], int64_t{chunk.position_min[i]}), transform.reference[i]);
    group.bounds = reinterpret_cast<const format::ClusterBounds*>(payload + streams.cluster_bounds.offset);
    group.cluster_count = chunk.cluster_count;
    group.is_double_sided = is_double_sided(scene, mesh);
    batch_shared().filter = filter;
  }
  __syncwarp();
  return true;
}

/// The number in its chunk of a triangle of the warp's group.
__device__ inline uint32_t number_in_chunk(uint64_t id) {
  return static_cast<uint32_t>(id - batch_shared().group.first_id);
}

/// Draws a triangle with a whole warp: its box at once if its edge values fit 32 bits, otherwise the tiles that it may
/// cover.
template <bool kOrthographic, class Mask>
__device__ inline void draw_boxes(const FrameView& size, const Target& target, const Triangle& triangle,
                                  const Mask& mask) {
  const int64_t area = doubled_area(triangle.x, triangle.y);
  if (fits_narrow_edges(triangle.x, triangle.y)) {
    draw_box_with_team<kOrthographic, int32_t>(WarpTeam{}, target, triangle, pixel_box(triangle.x, triangle.y, size),
                                               area, mask);
    return;
  }
  const LargeTiles tiles(triangle, size);
  const TileTest test(triangle);
#pragma unroll 1
  for (uint32_t i = 0; i < tiles.count(); ++i) {
    uint32_t x;
    uint32_t y;
    tiles.tile(i, x, y);
    if (!test.may_cover(x, y)) continue;
    const PixelBox box = tile_box(triangle, size, static_cast<int32_t>(x), static_cast<int32_t>(y));
    if (!box.empty()) draw_box_with_team<kOrthographic, int64_t>(WarpTeam{}, target, triangle, box, area, mask);
  }
}

/// Draws the queued medium and large triangles, each with the whole warp. Out of line, like the next two functions:
/// they are called once for many triangles, and would take registers from the loops over clusters.
template <bool kOrthographic, bool kMasked>
__device__ __noinline__ void draw_queued(const BatchFrame& in, uint64_t* samples, uint32_t chunk) {
  BatchShared& shared = batch_shared();
  const uint32_t lane = threadIdx.x % kWarpLanes;
  __syncwarp();
  const auto medium = static_cast<uint32_t>(shared.queued.medium);
  const auto large = static_cast<uint32_t>(shared.queued.large);
  __syncwarp();  // otherwise a lane could queue more before all lanes have read the counts
  if ((medium | large) == 0) return;
  const Target target{samples, in.size.width};
  const Queues queues = batch_queues(in);
#pragma unroll 1
  for (uint32_t i = 0; i < medium + large; ++i) {
    const Triangle triangle = i < medium ? queues.medium[i] : queues.large[i - medium];
    if constexpr (kMasked) {
      if (triangle.is_masked != 0) {
        BatchMasks& masks = batch_masks();
        if (lane == 0)
          make_mask_plane<kOrthographic>(in.scene, in.size, shared.group.transform, chunk, number_in_chunk(triangle.id),
                                         masks.plane);
        __syncwarp();
        uint32_t waiting = 0;
        const WarpPlane<false> tests{&masks.plane, 0, &in.size, &masks.samples, &waiting};
        draw_boxes<kOrthographic>(in.size, target, triangle, tests);
        tests.finish(target);
        __syncwarp();
        continue;
      }
    }
    draw_boxes<kOrthographic>(in.size, target, triangle, NoMask{});
  }
  __syncwarp();
  if (lane == 0) {
    shared.queued.medium = shared.queued.large = 0;
    WarpTeam::add(&in.counters->stats.triangles_medium, uint64_t{medium});
    WarpTeam::add(&in.counters->stats.triangles_large, uint64_t{large});
  }
  __syncwarp();
}

/// Draws `count` survivors from `first` on, at most 32. Returns whether stage 1 drew the lane's triangle.
template <bool kOrthographic, bool kMasked>
__device__ __noinline__ bool draw_survivors(const BatchFrame& in, uint64_t* samples, uint32_t chunk, uint32_t first,
                                            uint32_t count) {
  BatchShared& shared = batch_shared();
  const uint32_t lane = threadIdx.x % kWarpLanes;
  __syncwarp();
  Triangle triangle{};
  PixelBox box{};
  int64_t area = 0;
  int64_t pixels = 0;
  if constexpr (kMasked) batch_masks().waiting.begin();
  auto mask = lane_mask < kMasked ? Alpha::kMasked
                                  : Alpha::kOpaque > (ChunkPlanes{&in.scene, &in.size},
                                                      []() -> WarpMasks& { return batch_masks().waiting; });
  if (lane < count) {
    triangle = shared.survivors[first + lane];
    box = pixel_box(triangle.x, triangle.y, in.size);
    area = doubled_area(triangle.x, triangle.y);
    pixels = box.pixels();
    if constexpr (kMasked) {
      triangle.is_masked = mask.find(in.scene, chunk, {&shared.group.transform, chunk, number_in_chunk(triangle.id)});
    }
  }
  const bool drawn = draw_set_up<kOrthographic>({samples, in.size.width}, batch_queues(in), shared.set_up, triangle,
                                                box, area, pixels, mask);
  if constexpr (kMasked) mask.template finish<kOrthographic>({samples, in.size.width});
  draw_queued<kOrthographic, kMasked>(in, samples, chunk);
  return drawn;
}

/// Clips and draws a triangle with one lane; larger pieces are queued. Returns the number of pieces that it drew. Out
/// of line, because it is rare and long.
template <bool kOrthographic, bool kMasked>
__device__ __noinline__ uint32_t clip_for_view(const BatchFrame& in, uint64_t* samples, const ClusterGroup& at,
                                               uint32_t number) {
  const BatchGroup& group = batch_shared().group;
  const Transform& transform = group.transform;
  const format::ChunkRecord& chunk = in.scene.chunks[at.chunk];
  const format::MeshRecord& mesh = in.scene.meshes[chunk.mesh];
  const ChunkReader reader = make_reader(mesh, chunk, in.scene.pages[chunk.page], transform, number);
  const RasterSmall<kOrthographic, kMasked> pass{in.scene, in.size, {samples, in.size.width}, batch_queues(in)};
  typename RasterSmall<kOrthographic, kMasked>::Context context{&reader, &transform, group.is_double_sided,
                                                                group.first_id, kLaneBox};
  if constexpr (kMasked) context.masked = {in.scene, mesh, chunk};
  uint32_t v[3];
  reader.triangle(number, v);
  const DirectVertices<kOrthographic> vertices{&reader, &transform, &in.size};
  pass.draw(WarpTeam{}, context, number, v, vertices(v[0]), vertices(v[1]), vertices(v[2]));
  return static_cast<uint32_t>(context.small);
}

/// One warp's work on a batch.
template <bool kOrthographic, bool kMasked>
class BatchWarp {
 public:
  __device__ explicit BatchWarp(const BatchFrame& in) : in_(in), lane_(threadIdx.x % kWarpLanes) {}

  __device__ void run() {
    BatchShared& shared = batch_shared();
    if (lane_ == 0) shared.queued.medium = shared.queued.large = 0;
    __syncwarp();
    const uint64_t warps = uint64_t{gridDim.x} * kBatchWarps;
    for (uint64_t start = 0;;) {
      // Takes a quarter of this warp's share of the remaining work. A run has neighbouring groups of one view, and runs
      // shrink towards the end.
      uint64_t share = 0;
      if (lane_ == 0) {
        share = max_of<uint64_t>((in_.work - min_of(start, in_.work)) / (4 * warps), 1);
        start = WarpTeam::add(&in_.counters->next, share);
      }
      start = __shfl_sync(~0u, start, 0);
      share = __shfl_sync(~0u, share, 0);
      if (start >= in_.work) break;
      const uint64_t end = min_of(start + share, in_.work);
      for (uint64_t work = start; work < end; ++work) draw_group(work / in_.group_count, work % in_.group_count);
    }
    report();
  }

 private:
  __device__ void draw_group(uint64_t view, uint64_t number) {
    const ClusterGroup at = in_.groups[number];
    __syncwarp();  // the previous group is drawn
    if (!prepare_group<kOrthographic>(in_, in_.views[view].frame, at)) return;
    samples_ = in_.samples + view * in_.picture_samples;
    BatchShared& shared = batch_shared();
    const uint32_t first = at.group * format::kGroupClusters;
    const bool is_there = first + lane_ < shared.group.cluster_count;
    const uint32_t kept = __ballot_sync(
        ~0u, is_there && may_show<kOrthographic>(in_.size, shared.filter, shared.group.bounds + first + lane_));
    __syncwarp();  // vertices overwrite the filter
    tested_ += static_cast<uint32_t>(__popc(__ballot_sync(~0u, is_there)));
    drawn_ += static_cast<uint32_t>(__popc(kept));
    for (uint32_t left = kept; left != 0; left &= left - 1) {
      const BatchCluster cluster(shared.group, first + static_cast<uint32_t>(__ffs(static_cast<int>(left))) - 1);
      project(cluster);
      draw_triangles(at, cluster);
    }
    while (survivor_count_ != 0) flush(at.chunk);
  }

  /// Projects each vertex of a cluster exactly.
  __device__ void project(const BatchCluster& cluster) {
    BatchShared& shared = batch_shared();
#pragma unroll 1
    for (uint32_t vertex = lane_; vertex < cluster.at.vertex_count; vertex += kWarpLanes) {
      float d[3];
      cluster.relative(shared.group, vertex, d);
      shared.vertices[vertex] = kernels::project<kOrthographic>(shared.group.transform, in_.size, d[0], d[1], d[2]);
    }
    __syncwarp();
  }

  /// Sets up the triangles of a cluster. Triangles with pixels wait until there are 32.
  __device__ void draw_triangles(const ClusterGroup& at, const BatchCluster& cluster) {
    BatchShared& shared = batch_shared();
    const uint64_t first_id = shared.group.first_id + cluster.first_triangle;
    const uint32_t count = cluster.at.triangle_count;
    BatchCorners corners(cluster);
#pragma unroll 1
    for (uint32_t base = 0; base < count; base += kWarpLanes) {
      const uint32_t number = base + lane_;  // in the cluster
      uint32_t v[3];
      corners.next(number, number < count, v);
      Triangle triangle;
      bool survives = false;
      bool clips = false;
      if (number < count) {
        const ScreenVertex a = shared.vertices[v[0]];
        const ScreenVertex b = shared.vertices[v[1]];
        const ScreenVertex c = shared.vertices[v[2]];
        if (((a.flags | b.flags | c.flags) & kNeedsClip) != 0) {
          clips = (a.flags & b.flags & c.flags & kOutsideMask) == 0;
        } else {
          PixelBox box;
          int64_t area;
          survives = set_up(in_.size, a, b, c, first_id + number, shared.group.transform.mirrored,
                            shared.group.is_double_sided, triangle, box, area);
        }
      }
      const uint32_t lanes = __ballot_sync(~0u, survives);
      if (survives) shared.survivors[survivor_count_ + rank_among(lanes)] = triangle;
      survivor_count_ += static_cast<uint32_t>(__popc(lanes));
      const uint32_t to_clip = __ballot_sync(~0u, clips);
      if (to_clip != 0) clip(at, to_clip, cluster.first_triangle + number);
      if (survivor_count_ >= kWarpLanes) flush(at.chunk);
    }
    __syncwarp();  // the next cluster's vertices overwrite these
  }

  /// Draws the last survivors, up to 32.
  __device__ void flush(uint32_t chunk) {
    const uint32_t count = min_of(survivor_count_, kWarpLanes);
    survivor_count_ -= count;
    if (draw_survivors<kOrthographic, kMasked>(in_, samples_, chunk, survivor_count_, count)) ++small_;
  }

  /// Clips and draws the triangle `number` of the chunk of each lane of `lanes`, a few at a time.
  __device__ void clip(const ClusterGroup& at, uint32_t lanes, uint32_t number) {
    clipped_ += lanes >> lane_ & 1;
    while (lanes != 0) {
      uint32_t few = 0;
      for (uint32_t i = 0; i < kClippedAtOnce && lanes != 0; ++i) {
        few |= lanes & (0 - lanes);
        lanes &= lanes - 1;
      }
      if ((few >> lane_ & 1) != 0) small_ += clip_for_view<kOrthographic, kMasked>(in_, samples_, at, number);
      draw_queued<kOrthographic, kMasked>(in_, samples_, at.chunk);
    }
  }

  __device__ void report() const {
    FrameStats& stats = in_.counters->stats;
    const uint32_t small = sum_of_lanes(small_);
    const uint32_t clipped = sum_of_lanes(clipped_);
    if (lane_ != 0) return;
    WarpTeam::add(&stats.triangles_small, uint64_t{small});
    WarpTeam::add(&stats.triangles_clipped, uint64_t{clipped});
    WarpTeam::add(&stats.clusters_tested, uint64_t{tested_});
    WarpTeam::add(&stats.clusters_drawn, uint64_t{drawn_});
  }

  const BatchFrame& in_;
  uint32_t lane_;
  uint64_t* samples_ = nullptr;  // of the view
  uint32_t survivor_count_ = 0;
  uint32_t small_ = 0;    // triangles, of this lane; the others are the warp's
  uint32_t clipped_ = 0;  // likewise
  uint32_t tested_ = 0;   // clusters
  uint32_t drawn_ = 0;
};

template <bool kOrthographic, bool kMasked>
__global__ void __launch_bounds__(kBatchThreads, kMasked ? kMaskedBatchBlocks : kBatchBlocks)
    draw_views(const __grid_constant__ BatchFrame in) {
  BatchWarp<kOrthographic, kMasked>(in).run();
}

/// Makes depths and ids of `count` pixels from the first pixel of a picture on, one per thread. `layers`: of all
/// pictures, as one.
__global__ void __launch_bounds__(kBatchLayerThreads)
    make_batch_layers(const __grid_constant__ MakeLayers layers, const BatchView* views, uint32_t view_pixels,
                      uint32_t count) {
  const uint32_t pixel = blockIdx.x * kBatchLayerThreads + threadIdx.x;
  if (pixel >= count) return;
  MakeLayers of_view = layers;
  const BatchView& view = views[pixel / view_pixels];
  of_view.orthographic = view.frame.orthographic;
  of_view.z_near = view.z_near;
  of_view.z_far = view.z_far;
  of_view.set(pixel);
}

}  // namespace scree::kernels
