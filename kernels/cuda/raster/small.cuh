// Stage 1 of indexed chunks on a GPU. Warps take runs of rows of the draw list. A row is 32 triangles, one per lane,
// fetched once for all instances of the draw. The coverage filter (coverage_filter.h) rejects most triangles. Survivors
// collect in shared memory until there are 32, and are then drawn exactly (raster/small.h), so that no lane idles while
// its neighbours draw.
#pragma once

#include <type_traits>

#include "kernels/cuda/common/backend.cuh"
#include "kernels/cuda/frame/draw_list.cuh"
#include "kernels/cuda/raster/chunk.cuh"
#include "kernels/cuda/raster/masks.cuh"
#include "kernels/cull/coverage_filter.h"
#include "kernels/raster/small.h"

namespace scree::kernels {

struct SmallFrame {
  SceneView scene;
  FrameView view;
  Target target;
  Queues queues;
  DrawList list;
  SampleLimits limits;
  bool filters;  // false: every triangle is drawn exactly
};

inline constexpr uint32_t kSmallThreads = 128;
inline constexpr uint32_t kSmallWarps = kSmallThreads / kWarpLanes;

/// Blocks per multiprocessor. Without instances more warps hide the latency of memory; with instances more registers
/// are faster.
constexpr uint32_t small_blocks(bool instanced) {
  return instanced ? 6 : 8;
}

/// Above this sum of pixels in the small boxes of its triangles, a warp would take too long. Boxes of more than
/// kCrowdedBox pixels then go to stage 2.
inline constexpr uint32_t kCrowdedPixels = 1024;
inline constexpr int64_t kCrowdedBox = 48;

/// The largest piece of a clipped triangle that stage 1 draws, in pixels. One lane draws it and waits for each pixel.
inline constexpr int64_t kLaneBox = 4;

/// For this many rows, computing the filter's constants takes about the time that the filter saves.
inline constexpr uint32_t kFilteredRows = 4;

/// Calls `call` with the ways to read the chunk's indices and positions, as types. Only ways that may occur in the
/// scene are built. If one of the two streams has a rare width, both are read by the generic code.
template <bool kLattice, bool kFloat32, class Call>
__device__ inline auto choose_fetch(const PackedChunkView& stored, const Call& call) {
  constexpr std::integral_constant<Fetch, Fetch::kWindow> kWindow;
  constexpr std::integral_constant<Fetch, Fetch::kWords> kWords;
  constexpr std::integral_constant<Fetch, Fetch::kGeneric> kGeneric;
  if constexpr (kLattice) {
    if (stored.index_fetch == Fetch::kWindow && stored.position_fetch == Fetch::kWindow) return call(kWindow, kWindow);
  }
  if constexpr (kFloat32) {
    if (stored.position_fetch == Fetch::kWords) {
      if (stored.index_fetch == Fetch::kWindow) return call(kWindow, kWords);
      return stored.index_fetch == Fetch::kWords ? call(kWords, kWords) : call(kGeneric, kWords);
    }
  }
  if constexpr (kLattice) {
    return call(kGeneric, kGeneric);
  } else {
    return call(kGeneric, kWords);  // there is no other case
  }
}

/// Draws a triangle that needs clipping, or whose reference is too far away for int32. Returns the number of its pieces
/// that stage 1 drew, and from bit 16 on whether it was clipped. Out of line, because it is rare and takes many
/// registers.
template <bool kOrthographic, Alpha kAlpha>
__device__ __noinline__ uint32_t clip_and_draw(const SmallFrame& frame, uint32_t instance, uint32_t chunk_number,
                                               uint32_t number) {
  const format::ChunkRecord& chunk = frame.scene.chunks[chunk_number];
  const format::MeshRecord& mesh = frame.scene.meshes[chunk.mesh];
  Transform transform = frame.list.transforms[instance];
  set_error(transform, vertex_box(mesh, chunk, transform));
  const ChunkReader reader = make_reader(mesh, chunk, frame.scene.pages[chunk.page], transform, number);
  const RasterSmall<kOrthographic, kAlpha != Alpha::kOpaque> pass{frame.scene, frame.view, frame.target, frame.queues};
  typename RasterSmall<kOrthographic, kAlpha != Alpha::kOpaque>::Context context{
      &reader, &transform, is_double_sided(frame.scene, mesh),
      frame.scene.instance_base[instance] + chunk.first_triangle, kLaneBox};
  if constexpr (kAlpha != Alpha::kOpaque) context.masked = {frame.scene, mesh, chunk};
  uint32_t v[3];
  reader.triangle(number, v);
  ScreenVertex corners[3];
  for (int i = 0; i < 3; ++i) {
    float d[3];
    reader.relative(v[i], d);
    corners[i] = project<kOrthographic>(transform, frame.view, d[0], d[1], d[2]);
  }
  pass.draw(WarpTeam{}, context, number, v, corners[0], corners[1], corners[2]);
  return static_cast<uint32_t>(context.small) | static_cast<uint32_t>(context.clipped) << 16;
}

/// A small triangle while its pixels are drawn. It takes five 16-byte words, so that lanes that read eight consecutive
/// triangles use different banks.
struct alignas(16) SetUpTriangle {
  uint32_t value[3];   // Edges::value at the box's first pixel; all three are modulo 2^32
  uint32_t shape;      // packed bits, see below
  uint32_t step_x[3];  // Edges::step_x
  uint32_t start;      // number of pixels in the boxes before
  uint32_t to_row[3];  // step from the end of a row of the box to the start of the next: step_y - width * step_x
  uint32_t first;      // index in the picture of the box's first pixel
  DepthPlane plane;
  uint64_t id;

  // `shape`: the low bits are 2^16 / width plus at most 1; then Edges::exclusive of edges 1 and 2, one bit each; then
  // the width.
  static constexpr uint32_t kInverseWidthMask = 0x1ffff;
  static constexpr uint32_t kExclusive1Bit = 17;
  static constexpr uint32_t kExclusive2Bit = 18;
  static constexpr uint32_t kWidthBit = 19;
};
static_assert(sizeof(SetUpTriangle) == 80);

/// The lanes' triangles that have pixels, at most 32.
struct SetUpTriangles {
  SetUpTriangle items[kWarpLanes];
};

/// A warp's shared memory.
template <bool kInstanced>
struct SmallShared {
  CoverageFilter filters[kInstanced ? kDrawInstances : 1];
  InstanceTransform exact[kInstanced ? kDrawInstances : 1];
  SetUpTriangles set_up;
  PackedChunkView stored;
  uint32_t survivors[2 * kWarpLanes];                          // triangle numbers
  uint8_t survivor_instance[kInstanced ? 2 * kWarpLanes : 1];  // instance numbers in the draw
  bool double_sided;
};

/// This warp's shared memory. Accessed by name, because a pointer would hide its address space from the
/// compiler.
template <bool kInstanced>
__device__ inline SmallShared<kInstanced>& small_shared() {
  extern __shared__ uint4 shared_memory[];
  return reinterpret_cast<SmallShared<kInstanced>*>(shared_memory)[threadIdx.x / kWarpLanes];
}

/// Lies behind the shared memory of all warps, in kernels that draw masked triangles.
template <bool kInstanced>
__device__ inline WarpMasks& small_masks() {
  extern __shared__ uint4 shared_memory[];
  return reinterpret_cast<WarpMasks*>(reinterpret_cast<SmallShared<kInstanced>*>(shared_memory) +
                                      kSmallWarps)[threadIdx.x / kWarpLanes];
}

template <bool kInstanced, Alpha kAlpha>
__device__ inline auto small_mask(const SmallFrame& frame) {
  return lane_mask<kAlpha>(ChunkPlanes{&frame.scene, &frame.view}, small_masks<kInstanced>);
}

/// Pixel `inside` of the box of a triangle. False where the triangle does not cover it; else `drawn` is the sample,
/// and `sample` its index in the picture.
template <bool kOrthographic>
__device__ inline bool sample_at(const SetUpTriangle& its, uint32_t inside, int32_t picture_width, uint64_t& drawn,
                                 uint32_t& sample) {
  const uint32_t shape = its.shape;
  // Exact: inside < 128 and width <= 128, so the error of the quotient is below 2^-9, while a remainder is at least
  // 2^-7.
  const uint32_t y = inside * (shape & SetUpTriangle::kInverseWidthMask) >> 16;
  int32_t value[3];
  for (int i = 0; i < 3; ++i) {
    value[i] = static_cast<int32_t>(its.value[i] + inside * its.step_x[i] + y * its.to_row[i]);
  }
  if ((value[0] | value[1] | value[2]) < 0) return false;
  const float depth =
      depth_at<int32_t>(its.plane, value[1] + static_cast<int32_t>(shape >> SetUpTriangle::kExclusive1Bit & 1),
                        value[2] + static_cast<int32_t>(shape >> SetUpTriangle::kExclusive2Bit & 1));
  drawn = pack_sample(depth_code<kOrthographic>(depth), its.id);
  sample = its.first + inside + y * (static_cast<uint32_t>(picture_width) - (shape >> SetUpTriangle::kWidthBit));
  return true;
}

/// Draws the boxes of the lanes' triangles, of `pixels` <= kSmallBox each (0: the lane has none), with narrow edges.
/// Every lane draws every 32nd pixel of all boxes together, so boxes of 1 and of 128 pixels leave no lane waiting.
/// `masks`: NoLaneMask, or the tests of the lane's triangle. A masked triangle's samples in front of the stored samples
/// wait for LaneMask::test_waiting(). Many triangles have no such sample, and get no plane.
template <bool kOrthographic, class Masks>
__device__ inline void draw_pixels(const Target& target, SetUpTriangles& shared, const Triangle& triangle,
                                   const PixelBox& box, int64_t area, uint32_t pixels, const Masks& masks) {
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const uint32_t before_lane = (1u << lane) - 1;
  const uint32_t up_to_lane = 2 * before_lane + 1;
  uint32_t end = pixels;
  for (uint32_t distance = 1; distance < kWarpLanes; distance *= 2) {
    const uint32_t other = __shfl_up_sync(~0u, end, distance);
    if (lane >= distance) end += other;
  }
  const uint32_t total = __shfl_sync(~0u, end, kWarpLanes - 1);
  if (total == 0) return;
  const uint32_t lanes = __ballot_sync(~0u, pixels != 0);
  const uint32_t start = pixels != 0 ? end - pixels : ~0u;
  const auto slot = static_cast<uint32_t>(__popc(lanes & before_lane));
  [[maybe_unused]] uint32_t masked = 0;  // one bit per triangle
  if constexpr (Masks::kTests) masked = bits_of_lanes(pixels != 0 && masks.waits ? 1u << slot : 0u);
  if (pixels != 0) {
    const Edges<int32_t> edges = make_edges<int32_t>(triangle, box.x0, box.y0);
    const auto width = static_cast<uint32_t>(box.x1 - box.x0 + 1);
    SetUpTriangle& out = shared.items[slot];
    for (int i = 0; i < 3; ++i) {
      out.value[i] = static_cast<uint32_t>(edges.value[i]);
      out.step_x[i] = static_cast<uint32_t>(edges.step_x[i]);
      out.to_row[i] = static_cast<uint32_t>(edges.step_y[i]) - width * out.step_x[i];
    }
    out.shape = (static_cast<uint32_t>(__fdividef(65536.0f, static_cast<float>(width))) + 1) |
                static_cast<uint32_t>(edges.exclusive[1] << SetUpTriangle::kExclusive1Bit |
                                      edges.exclusive[2] << SetUpTriangle::kExclusive2Bit) |
                width << SetUpTriangle::kWidthBit;
    out.start = start;
    out.first = static_cast<uint32_t>(box.y0 * target.width + box.x0);
    out.plane = make_depth_plane(triangle, area);
    out.id = triangle.id;
  }
  __syncwarp();
  // Number of samples that a lane starts to load before it uses the first. With masks a warp waits for instructions
  // rather than for memory, so fewer copies of the code are faster.
  constexpr uint32_t kBatch = Masks::kTests ? 2 : 4;
  uint32_t begun = ~0u;  // number of boxes that begin before this row of 32 pixels, minus one
  for (uint32_t base = 0; base < total; base += kBatch * kWarpLanes) {
    uint32_t sample[kBatch];
    uint64_t drawn[kBatch];
    uint64_t seen[kBatch];
    [[maybe_unused]] uint32_t owners[kBatch];
    for (uint32_t k = 0; k < kBatch; ++k) {
      const uint32_t row = base + k * kWarpLanes;
      const uint32_t pixel = row + lane;
      const uint32_t begins = bits_of_lanes(start - row < kWarpLanes ? 1u << (start - row) : 0u);
      const uint32_t owner = begun + static_cast<uint32_t>(__popc(begins & up_to_lane));
      begun += static_cast<uint32_t>(__popc(begins));
      drawn[k] = kBackground;
      if constexpr (Masks::kTests) owners[k] = owner;
      if (pixel >= total) continue;
      const SetUpTriangle& its = shared.items[owner];
      sample_at<kOrthographic>(its, pixel - its.start, target.width, drawn[k], sample[k]);
    }
    for (uint32_t k = 0; k < kBatch; ++k) {
      seen[k] = drawn[k] != kBackground ? WarpTeam::load_relaxed(target.samples + sample[k]) : 0;
    }
    if constexpr (Masks::kTests) {
      uint32_t needed = 0;  // one bit per triangle with a sample that waits
      bool waits[kBatch];
      for (uint32_t k = 0; k < kBatch; ++k) {
        const bool shows =
            drawn[k] < seen[k] && (!Masks::kBlends || target.is_behind_peeled(target.samples + sample[k], drawn[k]));
        waits[k] = shows && (masked >> owners[k] & 1) != 0;
        if (waits[k]) needed |= 1u << owners[k];
        if (shows && !waits[k]) masks.draw(target, target.samples + sample[k], drawn[k], kShownOpaque);
      }
      needed = bits_of_lanes(needed);
      if (needed == 0) continue;
      auto& waiting = *masks.shared;
      const uint32_t first = waiting.triangle_count;
      uint32_t count = waiting.sample_count;
      if (pixels != 0 && (needed >> slot & 1) != 0)
        waiting.triangles[first + static_cast<uint32_t>(__popc(needed & ((1u << slot) - 1)))] = masks.key;
      for (uint32_t k = 0; k < kBatch; ++k) {
        const uint32_t those = __ballot_sync(~0u, waits[k]);
        if (waits[k]) {
          const uint32_t at = count + static_cast<uint32_t>(__popc(those & before_lane));
          waiting.drawn[at] = drawn[k];
          waiting.sample[at] = sample[k];
          waiting.owner[at] =
              static_cast<uint8_t>(first + static_cast<uint32_t>(__popc(needed & ((1u << owners[k]) - 1))));
        }
        count += static_cast<uint32_t>(__popc(those));
      }
      const uint32_t triangles = first + static_cast<uint32_t>(__popc(needed));
      __syncwarp();  // all lanes have read the counts
      if (lane == 0) {
        waiting.triangle_count = triangles;
        waiting.sample_count = count;
      }
      __syncwarp();
      if (triangles >= kWarpLanes || count > waiting.kMostSamples - kBatch * kWarpLanes)
        masks.template test_waiting<kOrthographic>(masks.planes, target, waiting);
    } else {
      for (uint32_t k = 0; k < kBatch; ++k) {
        if (drawn[k] < seen[k]) WarpTeam::atomic_min(target.samples + sample[k], drawn[k]);
      }
    }
  }
  __syncwarp();
}

/// Draws the lanes' triangles, whose boxes have `pixels` each (0: the lane has none), or queues them for the other
/// stages. Returns whether stage 1 drew the lane's triangle.
template <bool kOrthographic, class Masks = NoLaneMask>
__device__ inline bool draw_set_up(const Target& target, const Queues& queues, SetUpTriangles& shared,
                                   const Triangle& triangle, const PixelBox& box, int64_t area, int64_t pixels,
                                   const Masks& masks = {}) {
  if (__ballot_sync(~0u, pixels != 0) == 0) return false;
  bool small = pixels != 0 && pixels <= kSmallBox && fits_narrow_edges(triangle.x, triangle.y);
  // 32 boxes of a hundred pixels would keep this warp busy long after all others are done. The larger ones are queued
  // for stage 2.
  if (sum_of_lanes(small ? static_cast<uint32_t>(pixels) : 0) > kCrowdedPixels) {
    small = small && pixels <= kCrowdedBox;
  }
  if (pixels >= kMediumBox) {
    push(WarpTeam{}, &queues.counters->large, queues.large, queues.large_capacity, triangle);
  } else if (pixels != 0 && !small) {
    push(WarpTeam{}, &queues.counters->medium, queues.medium, queues.medium_capacity, triangle);
  }
  __syncwarp();
  draw_pixels<kOrthographic>(target, shared, triangle, box, area, small ? static_cast<uint32_t>(pixels) : 0, masks);
  return small;
}

/// Projects a survivor. False if there is nothing to draw, or if clip_and_draw() drew it (`drawn`).
template <bool kOrthographic, Fetch kIndices, Fetch kPositions, Alpha kAlpha>
__device__ inline bool project_survivor(const SmallFrame& frame, const PackedChunkView& stored,
                                        const InstanceTransform& exact, bool double_sided, uint32_t number,
                                        uint32_t chunk, Triangle& triangle, PixelBox& box, int64_t& area,
                                        uint32_t& drawn) {
  uint32_t v[3];
  stored.decode_indices<kIndices>(stored.load_indices<kIndices>(number), v);
  ProjectedPoint points[3];
  for (int i = 0; i < 3; ++i) {
    float d[3];
    stored.relative<kPositions>(v[i], exact, d);
    points[i] = project_point<kOrthographic>(exact.x, exact.y, exact.w, d[0], d[1], d[2]);
  }
  const bool in_range = points[0].in_range & points[1].in_range & points[2].in_range;
  if (!in_range || (exact.flags & InstanceTransform::kFarAway) != 0) {
    uint32_t outside = in_range || (exact.flags & InstanceTransform::kFarAway) != 0 ? 0u : uint32_t{kOutsideMask};
    for (int i = 0; i < 3; ++i) {
      outside &= plane_flags<kOrthographic>(points[i], frame.view, exact.error[0], exact.error[1], exact.error[2]);
    }
    if (outside == 0) drawn = clip_and_draw<kOrthographic, kAlpha>(frame, exact.instance, chunk, number);
    return false;
  }
  return set_up(frame.view, snap_point(points[0], frame.view, 0), snap_point(points[1], frame.view, 0),
                snap_point(points[2], frame.view, 0), exact.first_id + number,
                (exact.flags & InstanceTransform::kMirrored) != 0, double_sided, triangle, box, area);
}

/// Draws the triangles survivors[first] to [first + count - 1] with a whole warp, one per lane. Returns counts in the
/// form of clip_and_draw().
template <bool kOrthographic, bool kLattice, bool kFloat32, bool kInstanced, Alpha kAlpha>
__device__ inline uint32_t draw_survivors(const SmallFrame& frame, uint32_t first, uint32_t count, uint32_t chunk) {
  SmallShared<kInstanced>& shared = small_shared<kInstanced>();
  const uint32_t lane = threadIdx.x % kWarpLanes;
  Triangle triangle{};
  PixelBox box{};
  int64_t area = 0;
  int64_t pixels = 0;  // 0: there is nothing to draw
  uint32_t drawn = 0;
  auto mask = small_mask<kInstanced, kAlpha>(frame);
  if (lane < count) {
    const uint32_t number = shared.survivors[first + lane];
    const InstanceTransform& exact = shared.exact[kInstanced ? shared.survivor_instance[first + lane] : 0];
    const auto project = [&](auto indices, auto positions) {
      return project_survivor<kOrthographic, decltype(indices)::value, decltype(positions)::value, kAlpha>(
          frame, shared.stored, exact, shared.double_sided, number, chunk, triangle, box, area, drawn);
    };
    if (choose_fetch<kLattice, kFloat32>(shared.stored, project)) pixels = box.pixels();
    if constexpr (kAlpha != Alpha::kOpaque) {
      if (pixels != 0)
        triangle.is_masked = mask.find(frame.scene, chunk, {frame.list.transforms + exact.instance, chunk, number});
    }
  }
  return drawn +
         (draw_set_up<kOrthographic>(frame.target, frame.queues, shared.set_up, triangle, box, area, pixels, mask) ? 1
                                                                                                                   : 0);
}

/// Fills shared memory with the data that a draw needs of its chunk and instances, with a whole warp. Out of line, like
/// clip_and_draw().
template <bool kInstanced>
__device__ __noinline__ void prepare_draw(const SmallFrame& frame, const InstancedDraw& draw, bool filters) {
  SmallShared<kInstanced>& shared = small_shared<kInstanced>();
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const format::ChunkRecord& chunk = frame.scene.chunks[draw.chunk];
  const format::MeshRecord& mesh = frame.scene.meshes[chunk.mesh];
  if (lane == 0) {
    shared.stored = PackedChunkView(frame.scene, mesh, chunk);
    shared.double_sided = is_double_sided(frame.scene, mesh);
  }
  if (lane < static_cast<uint32_t>(__popc(draw.instances))) {
    const uint32_t bit = __fns(draw.instances, 0, static_cast<int>(lane) + 1);
    const uint32_t instance = frame.list.visible[draw.first_visible + bit];
    const Transform& transform = frame.list.transforms[instance];
    const RelativeBox box = drawn_box(frame.list, mesh, chunk, draw.chunk, transform);
    const TransformError error = error_of(transform, box);
    if (filters)
      shared.filters[lane] =
          make_coverage_filter(frame.view, transform, error, stored_box(transform, box, mesh, chunk));
    shared.exact[lane] = InstanceTransform(frame.scene, transform, error, mesh, chunk, instance);
  }
  __syncwarp();
}

/// A warp's position in the rows of a draw.
struct RowCursor {
  uint32_t row;
  uint32_t instance;
  uint32_t survivor_count;  // in shared memory
};

/// Filters until the rows end or there are 32 survivors. It calls no function: a call would force the loop's values
/// into memory.
template <bool kOrthographic, Fetch kIndices, Fetch kPositions, bool kInstanced>
__device__ __noinline__ RowCursor filter_rows(const SmallFrame& frame, RowCursor at, uint32_t last_row,
                                              uint32_t last_triangle, uint32_t count) {
  SmallShared<kInstanced>& shared = small_shared<kInstanced>();
  const uint32_t lane = threadIdx.x % kWarpLanes;
  const PackedChunkView stored = shared.stored;
  const SampleLimits limits = frame.limits;
  // Each row's positions are loaded while the previous row is filtered, and its indices one row earlier still.
  uint32_t triangle = at.row * kWarpLanes + lane;
  PackedChunkView::IndexWords words = stored.load_indices<kIndices>(min_of(triangle, last_triangle));
  PackedChunkView::PositionWords next[3];
  uint32_t v[3];
  stored.decode_indices<kIndices>(words, v);
  for (int i = 0; i < 3; ++i) next[i] = stored.load_position<kPositions>(v[i]);
  words = stored.load_indices<kIndices>(min_of(triangle + kWarpLanes, last_triangle));
  do {
    float p[3][3];
    for (int i = 0; i < 3; ++i) stored.position<kPositions>(next[i], p[i]);
    stored.decode_indices<kIndices>(words, v);
    for (int i = 0; i < 3; ++i) next[i] = stored.load_position<kPositions>(v[i]);
    words = stored.load_indices<kIndices>(min_of(triangle + 2 * kWarpLanes, last_triangle));
    for (;;) {
      const CoverageFilter& filter = shared.filters[kInstanced ? at.instance : 0];
      const FilteredVertex a = filter_vertex<kOrthographic>(filter, p[0][0], p[0][1], p[0][2]);
      const FilteredVertex b = filter_vertex<kOrthographic>(filter, p[1][0], p[1][1], p[1][2]);
      const FilteredVertex c = filter_vertex<kOrthographic>(filter, p[2][0], p[2][1], p[2][2]);
      const bool survives = (triangle <= last_triangle) & may_cover_sample<kOrthographic>(filter, limits, a, b, c);
      const uint32_t lanes = __ballot_sync(~0u, survives);
      if (lanes != 0) {
        if (survives) {
          const uint32_t slot = at.survivor_count + rank_among(lanes);
          shared.survivors[slot] = triangle;
          if (kInstanced) shared.survivor_instance[slot] = static_cast<uint8_t>(at.instance);
        }
        at.survivor_count += static_cast<uint32_t>(__popc(lanes));
      }
      if constexpr (!kInstanced) break;
      if (++at.instance == count) break;
      if (at.survivor_count >= kWarpLanes) return at;
    }
    at.instance = 0;
    ++at.row;
    triangle += kWarpLanes;
  } while (at.row < last_row && at.survivor_count < kWarpLanes);
  return at;
}

/// One warp's work on the draw list.
template <bool kOrthographic, bool kLattice, bool kFloat32, bool kInstanced, Alpha kAlpha>
class SmallWarp {
 public:
  __device__ explicit SmallWarp(const SmallFrame& frame) : frame_(frame), lane_(threadIdx.x % kWarpLanes) {}

  __device__ void run() {
    if constexpr (kAlpha != Alpha::kOpaque) small_masks<kInstanced>().begin();
    const uint64_t packed = frame_.list.counters->instanced_draws;
    const auto draw_count = static_cast<uint32_t>(packed >> kWorkBits);
    const uint64_t total = packed & kWorkMask;
    const uint64_t warps = uint64_t{gridDim.x} * kSmallWarps;
    const InstancedDraw* const draws = frame_.list.instanced_draws;
    for (;;) {
      // Takes 1 / kPart of this warp's share of the remaining work. A run begins with a search and the preparation of a
      // draw, but the last runs must be short: with near and far instances, the times of rows differ by a factor of a
      // hundred.
      constexpr uint32_t kPart = kInstanced ? 16 : 4;
      uint64_t start = 0;
      uint64_t share = 0;
      if (lane_ == 0) {
        const uint64_t taken = *static_cast<const volatile uint64_t*>(&frame_.list.counters->next_work);
        share = max_of<uint64_t>((total - min_of(taken, total)) / (kPart * warps), total < 256 * warps ? 1 : 64);
        start = WarpTeam::add(&frame_.list.counters->next_work, share);
      }
      start = __shfl_sync(~0u, start, 0);
      share = __shfl_sync(~0u, share, 0);
      if (start >= total) break;
      const uint64_t end = min_of(start + share, total);
      uint32_t index = find_draw(draw_count, start, lane_, [&](uint32_t i) { return draws[i].work_before; });
      for (; index < draw_count && draws[index].work_before < end; ++index) draw_instanced(draws[index], start, end);
    }
    if constexpr (kAlpha != Alpha::kOpaque)
      small_mask<kInstanced, kAlpha>(frame_).template finish<kOrthographic>(frame_.target);
    report();
  }

 private:
  __device__ void draw_instanced(const InstancedDraw& draw, uint64_t start, uint64_t end) {
    const auto count = static_cast<uint32_t>(__popc(draw.instances));
    const uint32_t last_triangle = frame_.scene.chunks[draw.chunk].triangle_count - 1;
    const uint32_t rows = last_triangle / kWarpLanes + 1;
    // A row belongs to the run that holds its first unit of work.
    const uint64_t skipped = start > draw.work_before ? start - draw.work_before : 0;
    const auto first = static_cast<uint32_t>((skipped + count - 1) / count);
    const auto last = static_cast<uint32_t>(min_of<uint64_t>((end - draw.work_before + count - 1) / count, rows));
    if (first >= last) return;
    // For a few rows the filter would take longer than the time it saves.
    const bool filters = frame_.filters && last - first >= kFilteredRows;
    prepare_draw<kInstanced>(frame_, draw, filters);
    RowCursor at{first, 0, 0};
    while (at.row < last || at.survivor_count != 0) {
      if (at.row < last) at = filters ? filter(at, last, last_triangle, count) : keep_row(at, last_triangle, count);
      __syncwarp();
      if (at.survivor_count >= kWarpLanes || at.row == last) flush_survivors(at, draw.chunk);
    }
  }

  __device__ RowCursor filter(RowCursor at, uint32_t last, uint32_t last_triangle, uint32_t count) {
    return choose_fetch<kLattice, kFloat32>(small_shared<kInstanced>().stored, [&](auto indices, auto positions) {
      return filter_rows<kOrthographic, decltype(indices)::value, decltype(positions)::value, kInstanced>(
          frame_, at, last, last_triangle, count);
    });
  }

  /// Keeps all triangles of a row as survivors.
  __device__ RowCursor keep_row(RowCursor at, uint32_t last_triangle, uint32_t count) {
    SmallShared<kInstanced>& shared = small_shared<kInstanced>();
    const uint32_t triangle = at.row * kWarpLanes + lane_;
    if (triangle <= last_triangle) {
      shared.survivors[at.survivor_count + lane_] = triangle;
      if (kInstanced) shared.survivor_instance[at.survivor_count + lane_] = static_cast<uint8_t>(at.instance);
    }
    at.survivor_count += min_of(last_triangle - at.row * kWarpLanes + 1, kWarpLanes);
    if (++at.instance == count) at = {at.row + 1, 0, at.survivor_count};
    return at;
  }

  /// Draws the last survivors, at most 32.
  __device__ void flush_survivors(RowCursor& at, uint32_t chunk) {
    const uint32_t count = min_of(at.survivor_count, kWarpLanes);
    if (count == 0) return;
    at.survivor_count -= count;
    const uint32_t drawn =
        draw_survivors<kOrthographic, kLattice, kFloat32, kInstanced, kAlpha>(frame_, at.survivor_count, count, chunk);
    small_ += drawn & 0xffffu;
    clipped_ += drawn >> 16;
    __syncwarp();
  }

  __device__ void report() {
    const uint64_t small = sum_of_lanes(small_);
    const uint64_t clipped = sum_of_lanes(clipped_);
    if (lane_ != 0) return;
    if (small != 0) WarpTeam::add(&frame_.list.counters->queues.triangles_small, small);
    if (clipped != 0) WarpTeam::add(&frame_.list.counters->queues.triangles_clipped, clipped);
  }

  const SmallFrame& frame_;
  uint32_t lane_;
  uint32_t small_ = 0;
  uint32_t clipped_ = 0;
};

template <bool kOrthographic, bool kLattice, bool kFloat32, bool kInstanced, Alpha kAlpha>
__global__ void __launch_bounds__(kSmallThreads, kAlpha != Alpha::kOpaque ? kMaskedBlocks : small_blocks(kInstanced))
    raster_small(const __grid_constant__ SmallFrame frame) {
  SmallWarp<kOrthographic, kLattice, kFloat32, kInstanced, kAlpha>(frame).run();
}

}  // namespace scree::kernels
