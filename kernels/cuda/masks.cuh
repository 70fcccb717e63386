// Alpha masks of the triangles that a warp draws together: their planes in shared memory.
#pragma once

#include "kernels/cuda/backend.cuh"
#include "kernels/raster/mask.h"

namespace scree::kernels {

/// Blocks of a multiprocessor of kernels of stage 1 that draw masked triangles: as many as the planes leave room for.
inline constexpr uint32_t kMaskedBlocks = 5;

/// A warp's shared memory for them, one per triangle of SetUpTriangles.
struct WarpMasks {
  MaskPlane planes[kWarpLanes];
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

/// The triangle of a lane, as its mask needs it; and the planes of the warp.
struct LaneMask {
  static constexpr bool kTests = true;

  const SceneView* scene;
  const FrameView* view;
  const Transform* transform;
  uint32_t chunk;
  uint32_t number;
  const MaskView* mask = nullptr;  // null: the lane's triangle is opaque
  MaskPlane* planes;

  /// Returns 1 where the triangle is masked.
  __device__ uint32_t find(const SceneView& of, const FrameView& seen, const Transform* transforms, uint32_t instance,
                           uint32_t of_chunk, uint32_t of_number) {
    scene = &of;
    view = &seen;
    transform = transforms + instance;
    chunk = of_chunk;
    number = of_number;
    mask = mask_of(of, of.meshes[of.chunks[of_chunk].mesh]);
    return mask != nullptr ? 1 : 0;
  }

  template <bool kOrthographic>
  __device__ void set_up(int slot) const {
    MaskPlane& out = planes[slot];
    out.mask = mask;
    if (mask == nullptr) return;
    make_mask_plane<kOrthographic>(*scene, *view, *transform, chunk, number, out);
  }

  /// `sample`: in the picture.
  __device__ bool passes(uint32_t slot, uint32_t sample, int32_t width) const {
    const MaskPlane& plane = planes[slot];
    if (plane.mask == nullptr) return true;
    const auto row = static_cast<uint32_t>(width);
    return plane_passes(&plane, static_cast<int32_t>(sample % row), static_cast<int32_t>(sample / row));
  }
};

}  // namespace scree::kernels
