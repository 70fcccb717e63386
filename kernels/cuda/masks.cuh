// Alpha masks of the triangles that a warp draws together. Their planes lie in shared memory.
#pragma once

#include <type_traits>

#include "kernels/cuda/backend.cuh"
#include "kernels/raster/mask.h"

namespace scree::kernels {

/// Blocks per multiprocessor of the stage 1 kernels that draw masked triangles. One more block would leave 96 registers
/// and cause spills: a forest takes 3.1 ms with 5 blocks and 2.75 ms with 4 (H200).
inline constexpr uint32_t kMaskedBlocks = 4;

/// A warp's shared memory for masks.
struct WarpMasks {
  /// The most samples that wait for the test: twice as many as draw_pixels() processes at once.
  static constexpr uint32_t kMostSamples = 256;

  MaskPlane planes[kWarpLanes];    // one per triangle of SetUpTriangles
  uint16_t samples[kMostSamples];  // bits 0 to 6: pixel in the triangle's box; from bit 7 on: the triangle
};

/// Calls TestedTriangle::shown(). Out of line, so that loops over samples keep their values in registers. Few samples
/// need it.
static __device__ __noinline__ uint32_t shown_by_plane(const MaskPlane* plane, const FrameView* view, int32_t x,
                                                       int32_t y, uint64_t value) {
  return TestedTriangle{*plane, *view}.shown(x, y, value);
}

/// The tests of the samples of a warp's triangle. `kOfLayers`: the triangle is blended.
template <bool kOfLayers>
struct WarpPlane {
  static constexpr bool kTests = true;
  static constexpr bool kBlends = kOfLayers;
  const MaskPlane* plane;  // in shared memory
  const FrameView* view;

  __device__ uint32_t shown(int32_t x, int32_t y, uint64_t value) const {
    return shown_by_plane(plane, view, x, y, value);
  }
};

/// For kernels that draw only opaque triangles.
struct NoLaneMask {
  static constexpr bool kTests = false;
};

/// Draws the samples that pass their tests. `kOfLayers`: the lanes' triangles are blended.
template <bool kOfLayers>
struct TestedSamples {
  static constexpr bool kTests = true;
  static constexpr bool kBlends = kOfLayers;

  __device__ static void draw(const Target& target, uint64_t* sample, uint64_t value, uint32_t shown) {
    if constexpr (kBlends) {
      WarpTeam::draw_blended(target, sample, value, shown);
    } else {
      WarpTeam::atomic_min(sample, value);
    }
  }
};

/// The mask of a lane's triangle, and the warp's shared memory. All lanes have `shared` and `view`.
template <bool kOfLayers>
struct LaneMask : TestedSamples<kOfLayers> {
  const MaskView* mask = nullptr;  // null: the lane's triangle has none
  WarpMasks* shared;
  const SceneView* scene;
  const FrameView* view;
  const Transform* transform;
  uint32_t chunk;
  uint32_t number;

  /// Returns Triangle::is_masked.
  __device__ uint32_t find(const SceneView& of, const Transform* transforms, uint32_t instance, uint32_t of_chunk,
                           uint32_t of_number) {
    scene = &of;
    transform = transforms + instance;
    chunk = of_chunk;
    number = of_number;
    mask = mask_of(of, of.meshes[of.chunks[of_chunk].mesh]);
    return is_tested(of, *view, mask);
  }

  __device__ const FrameView& frame_view() const { return *view; }
  /// Whether the samples of the lane's triangle wait for a test: if it has a mask, or the view a clipping box. Samples
  /// of other blended surfaces do not wait.
  __device__ bool waits() const { return mask != nullptr || view->clip_box.is_set; }

  template <bool kOrthographic>
  __device__ void make_plane(MaskPlane& out) const {
    make_mask_plane<kOrthographic>(*scene, *view, *transform, chunk, number, out);
  }
};

template <Alpha kAlpha>
using LaneMaskOf = std::conditional_t<kAlpha == Alpha::kOpaque, NoLaneMask, LaneMask<kAlpha == Alpha::kBlended>>;

}  // namespace scree::kernels
