// Alpha masks of the triangles that a warp draws together: their planes in shared memory.
#pragma once

#include "kernels/cuda/backend.cuh"
#include "kernels/raster/mask.h"

namespace scree::kernels {

/// Blocks of a multiprocessor of kernels of stage 1 that draw masked triangles. One more would leave 96 registers and
/// spills: a forest takes 3.1 ms with 5 blocks and 2.75 with 4 (H200).
inline constexpr uint32_t kMaskedBlocks = 4;

/// A warp's shared memory for them.
struct WarpMasks {
  /// Samples that wait for the test, at most: what draw_pixels() looks at in one go, twice.
  static constexpr uint32_t kMostSamples = 256;

  MaskPlane planes[kWarpLanes];    // one per triangle of SetUpTriangles
  uint16_t samples[kMostSamples];  // bits 0 to 6: the pixel of the triangle's box; from bit 7 on: the triangle
};

/// A call, so that the loops over samples keep what they have in registers: few samples come here.
static __device__ __noinline__ bool plane_passes(const MaskPlane* plane, int32_t x, int32_t y) {
  return plane->passes(x, y);
}

/// What the samples of a warp's triangle are tested by.
struct WarpPlane {
  static constexpr bool kTests = true;
  const MaskPlane* plane;  // in shared memory

  __device__ bool passes(int32_t x, int32_t y) const { return plane_passes(plane, x, y); }
};

/// Of kernels that draw opaque triangles alone.
struct NoLaneMask {
  static constexpr bool kTests = false;
};

/// The triangle of a lane, as its mask needs it; and the shared memory of the warp.
struct LaneMask {
  static constexpr bool kTests = true;

  const MaskView* mask = nullptr;  // null: the lane's triangle is opaque
  WarpMasks* shared;
  const SceneView* scene;
  const FrameView* view;
  const Transform* transform;
  uint32_t chunk;
  uint32_t number;

  /// Returns Triangle::is_masked.
  __device__ uint32_t find(const SceneView& of, const FrameView& seen, const Transform* transforms, uint32_t instance,
                           uint32_t of_chunk, uint32_t of_number) {
    scene = &of;
    view = &seen;
    transform = transforms + instance;
    chunk = of_chunk;
    number = of_number;
    mask = mask_of(of, of.meshes[of.chunks[of_chunk].mesh]);
    return is_tested(of, mask);
  }

  template <bool kOrthographic>
  __device__ void make_plane(MaskPlane& out) const {
    make_mask_plane<kOrthographic>(*scene, *view, *transform, chunk, number, out);
  }
};

}  // namespace scree::kernels
