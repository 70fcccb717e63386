// The builds of stage 1 that a scene's frames run, and the shared memory of their blocks.
#pragma once

#include "kernels/cuda/common/occupancy.h"
#include "kernels/cuda/frame/draw_tables.h"
#include "kernels/cuda/raster/cluster.cuh"
#include "kernels/cuda/raster/small.cuh"

namespace scree::kernels {

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

template <bool kOrthographic, Alpha kAlpha>
SmallVariant choose_small(const DrawTraits& of) {
  if constexpr (!kOrthographic && kAlpha == Alpha::kOpaque) {
    if (!of.has_float32)
      return of.has_instances ? small_variant<false, true, false, true>() : small_variant<false, true, false, false>();
    if (!of.has_lattice)
      return of.has_instances ? small_variant<false, false, true, true>() : small_variant<false, false, true, false>();
  }
  return small_variant<kOrthographic, true, true, true, kAlpha>();
}

/// Shared memory of a block of raster_clusters.
template <Alpha kAlpha>
inline constexpr size_t kClusterSharedBytes = kClusterWarps*(sizeof(ClusterShared) +
                                                             (kAlpha != Alpha::kOpaque ? sizeof(ClusterWaiting) : 0));

template <Alpha kAlpha>
Result<void> prepare_clusters() {
  for (const auto kernel :
       {raster_clusters<false, 1, false, kAlpha>, raster_clusters<false, 1, true, kAlpha>,
        raster_clusters<false, kClusterParts, false, kAlpha>, raster_clusters<true, 1, false, kAlpha>,
        raster_clusters<true, 1, true, kAlpha>, raster_clusters<true, kClusterParts, false, kAlpha>}) {
    SCREE_TRY(allow_shared(kernel, kClusterSharedBytes<kAlpha>));
  }
  return {};
}

}  // namespace scree::kernels
