// Alpha masks on a GPU: samples wait for their tests until all lanes of a warp have work.
#pragma once

#include <type_traits>

#include "kernels/cuda/common/backend.cuh"
#include "kernels/raster/mask.h"

namespace scree::kernels {

/// Blocks per multiprocessor of the stage 1 kernels that draw masked triangles. With 5 blocks the warps compete for the
/// instruction cache, and a forest takes longer (docs/history.md).
inline constexpr uint32_t kMaskedBlocks = 4;

/// Samples of a warp that wait for their test, and their triangles, both in drawing order. They lie in shared memory
/// and wait until there are as many triangles as lanes, even if more triangles are drawn meanwhile. `Key`: the data by
/// which a plane is made.
template <class Key>
struct WaitingSamples {
  static constexpr uint32_t kMostSamples = 256;
  static constexpr uint32_t kMostTriangles = 2 * kWarpLanes;

  uint64_t drawn[kMostSamples];
  uint32_t sample[kMostSamples];  // index in the picture
  Key triangles[kMostTriangles];
  uint32_t triangle_count;
  uint32_t sample_count;
  uint8_t owner[kMostSamples];  // index in `triangles`

  /// Empties it, once before the warp draws.
  __device__ void begin() {
    if (threadIdx.x % kWarpLanes == 0) triangle_count = sample_count = 0;
    __syncwarp();
  }
};

/// The value of lane `lane`, for every lane of a full warp.
template <class T>
__device__ inline T of_lane(const T& value, uint32_t lane) {
  static_assert(sizeof(T) % 4 == 0);
  uint32_t words[sizeof(T) / 4];
  memcpy(words, &value, sizeof(T));
  for (uint32_t& word : words) word = __shfl_sync(~0u, word, lane);
  T out;
  memcpy(&out, words, sizeof(T));
  return out;
}

/// Draws a sample that passed its test. `kOfLayers`: its triangle is blended.
template <bool kOfLayers>
__device__ inline void draw_shown(const Target& target, uint64_t* sample, uint64_t value, uint32_t shown) {
  if constexpr (kOfLayers) {
    WarpTeam::draw_blended(target, sample, value, shown);
  } else {
    WarpTeam::atomic_min(sample, value);
  }
}

/// Samples of a warp's medium or large triangles that wait until every lane has one. In shared memory.
struct WarpSamples {
  uint64_t drawn[2 * kWarpLanes];
  uint32_t place[2 * kWarpLanes];  // y << 16 | x
  uint8_t plane[2 * kWarpLanes];   // index
};

/// Tests `count` samples from `first` on, at most 32, and draws the ones that pass. Out of line, so that loops over
/// samples keep their values in registers.
template <bool kOfLayers>
__device__ __noinline__ void test_samples(const MaskPlane* planes, const WarpSamples* waiting, const FrameView* view,
                                          const Target* target, uint32_t first, uint32_t count) {
  __syncwarp();
  const uint32_t i = first + threadIdx.x % kWarpLanes;
  if (i < first + count) {
    const uint64_t drawn = waiting->drawn[i];
    const auto x = static_cast<int32_t>(waiting->place[i] & 0xffffu);
    const auto y = static_cast<int32_t>(waiting->place[i] >> 16);
    const uint32_t shown = TestedTriangle{planes[waiting->plane[i]], *view}.shown(x, y, drawn);
    if (shown != 0) draw_shown<kOfLayers>(*target, target->row(y) + x, drawn, shown);
  }
  __syncwarp();
}

/// The tests of the samples of a warp's triangle. `kOfLayers`: the triangle is blended.
template <bool kOfLayers>
struct WarpPlane {
  static constexpr bool kTests = true;
  const MaskPlane* planes;  // in shared memory
  uint32_t plane;           // index: of the triangle
  const FrameView* view;
  WarpSamples* waiting;
  uint32_t* count;  // of samples that wait, at most 31; the same in all lanes

  /// Lanes draw together.
  __device__ static bool any(bool of_lane) { return __ballot_sync(~0u, of_lane) != 0; }

  /// As TestedTriangle::draw(), but the test may wait for other samples. All lanes call it.
  __device__ void draw(WarpTeam, const Target& target, bool is_nearer, const uint64_t* sample, uint64_t value,
                       int32_t x, int32_t y) const {
    if (kOfLayers) is_nearer = is_nearer && target.is_behind_peeled(sample, value);
    const uint32_t lanes = __ballot_sync(~0u, is_nearer);
    if (lanes == 0) return;
    if (is_nearer) {
      const uint32_t at = *count + rank_among(lanes);
      waiting->drawn[at] = value;
      waiting->place[at] = static_cast<uint32_t>(y) << 16 | static_cast<uint32_t>(x);
      waiting->plane[at] = static_cast<uint8_t>(plane);
    }
    *count += static_cast<uint32_t>(__popc(lanes));
    if (*count < kWarpLanes) return;
    *count -= kWarpLanes;
    test_samples<kOfLayers>(planes, waiting, view, &target, *count, kWarpLanes);
  }

  /// Tests the samples that still wait.
  __device__ void finish(const Target& target) const {
    if (*count != 0) test_samples<kOfLayers>(planes, waiting, view, &target, 0, *count);
    *count = 0;
  }
};

/// For kernels that draw only opaque triangles.
struct NoLaneMask {
  static constexpr bool kTests = false;
};

/// The tests of a warp's samples, and the lane's triangle. `Planes`: makes planes from keys. `kOfLayers`: the triangles
/// are blended.
template <class Planes, bool kOfLayers>
struct LaneMask {
  using Key = typename Planes::Key;
  static constexpr bool kTests = true;
  static constexpr bool kBlends = kOfLayers;

  Planes planes;
  WaitingSamples<Key>* shared;
  Key key;             // of the lane's triangle
  bool waits = false;  // whether its samples are tested: it has a mask, or the view a clipping box

  /// `warp`: after its begin(). `maker`: the same in all lanes.
  __device__ LaneMask(WaitingSamples<Key>& warp, const Planes& maker) : planes(maker), shared(&warp) {}

  /// Sets the lane's triangle. Returns Triangle::is_masked.
  __device__ uint32_t find(const SceneView& scene, uint32_t chunk, const Key& of) {
    key = of;
    const MaskView* const mask = mask_of(scene, scene.meshes[scene.chunks[chunk].mesh]);
    waits = mask != nullptr || planes.frame_view().clip_box.is_set;
    return is_tested(scene, planes.frame_view(), mask);
  }

  /// Draws a sample that is not tested.
  __device__ static void draw(const Target& target, uint64_t* sample, uint64_t value, uint32_t shown) {
    draw_shown<kOfLayers>(target, sample, value, shown);
  }

  /// Tests all samples that wait. Called once after the warp's last triangle.
  template <bool kOrthographic>
  __device__ void finish(const Target& target) const {
    while (shared->triangle_count != 0) test_waiting<kOrthographic>(planes, target, *shared);
  }

  /// Tests the samples of the first triangles that wait, up to 32, and draws the ones that pass. Each lane makes a
  /// plane, then tests a sample of any lane's triangle. Out of line, because it takes many registers.
  template <bool kOrthographic>
  __device__ static __noinline__ void test_waiting(const Planes planes, const Target& target,
                                                   WaitingSamples<Key>& waiting) {
    const uint32_t lane = threadIdx.x % kWarpLanes;
    const uint32_t triangles = waiting.triangle_count;
    const uint32_t samples = waiting.sample_count;
    MaskPlane own;
    own.mask = nullptr;
    if (lane < triangles) planes.template make<kOrthographic>(waiting.triangles[lane], own);
    __syncwarp();
    const auto row = static_cast<uint32_t>(target.width);
    uint32_t done = 0;
    for (uint32_t tested = kWarpLanes; tested == kWarpLanes; done += tested) {
      const uint32_t i = done + lane;
      const uint32_t owner = i < samples ? waiting.owner[i] : kWarpLanes;
      tested = static_cast<uint32_t>(__popc(__ballot_sync(~0u, owner < kWarpLanes)));
      const MaskPlane plane = of_lane(own, owner % kWarpLanes);
      if (lane >= tested) continue;
      const uint64_t drawn = waiting.drawn[i];
      const uint32_t sample = waiting.sample[i];
      const uint32_t shown = TestedTriangle{plane, planes.frame_view()}.shown(
          static_cast<int32_t>(sample % row), static_cast<int32_t>(sample / row), drawn);
      if (shown != 0) draw(target, target.samples + sample, drawn, shown);
    }
    __syncwarp();
    // The others move to the front.
    const uint32_t rest = triangles - min_of(triangles, kWarpLanes);
    if (lane < rest) waiting.triangles[lane] = waiting.triangles[kWarpLanes + lane];
    for (uint32_t i = lane; i - lane < samples - done; i += kWarpLanes) {
      const bool moves = i < samples - done;
      const uint64_t drawn = moves ? waiting.drawn[done + i] : 0;
      const uint32_t sample = moves ? waiting.sample[done + i] : 0;
      const uint8_t owner = moves ? waiting.owner[done + i] : 0;
      __syncwarp();
      if (!moves) continue;
      waiting.drawn[i] = drawn;
      waiting.sample[i] = sample;
      waiting.owner[i] = static_cast<uint8_t>(owner - kWarpLanes);
    }
    if (lane == 0) {
      waiting.triangle_count = rest;
      waiting.sample_count = samples - done;
    }
    __syncwarp();
  }
};

/// A triangle of a chunk of the scene, as the key of its plane.
struct ChunkTriangle {
  const Transform* transform;
  uint32_t chunk;
  uint32_t number;
};

struct ChunkPlanes {
  using Key = ChunkTriangle;
  const SceneView* scene;
  const FrameView* view;

  __device__ const FrameView& frame_view() const { return *view; }

  template <bool kOrthographic>
  __device__ void make(const ChunkTriangle& of, MaskPlane& out) const {
    make_mask_plane<kOrthographic>(*scene, *view, *of.transform, of.chunk, of.number, out);
  }
};

/// A warp's shared memory for masks in kernels that do not draw clusters directly.
using WarpMasks = WaitingSamples<ChunkTriangle>;

/// The tests of the lane's triangle. `waiting()`: returns the warp's shared memory; called only in builds that test
/// masks.
template <Alpha kAlpha, class Planes, class Waiting>
__device__ inline auto lane_mask(const Planes& planes, const Waiting& waiting) {
  if constexpr (kAlpha != Alpha::kOpaque) {
    return LaneMask<Planes, kAlpha == Alpha::kBlended>(waiting(), planes);
  } else {
    return NoLaneMask{};
  }
}

}  // namespace scree::kernels
