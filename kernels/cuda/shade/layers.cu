#include "kernels/cuda/shade/layers.h"

#include <cuda_runtime.h>

#include "kernels/cuda/shade/pixels.cuh"
#include "kernels/shade/layers.h"

namespace scree::kernels {
namespace {

template <class Pass>
__global__ void run_layer(const __grid_constant__ Pass pass, uint32_t count) {
  const uint32_t item = (blockIdx.x * kPixelThreads + threadIdx.x) / 32;
  if (item < count) pass(item, PixelTeam{});
}

}  // namespace

Result<void> start_layers(const SceneView& scene, const View& view, uint32_t samples_per_side, const uint64_t* samples,
                          const Transform* transforms, const LayerTargets& out, cudaStream_t stream) {
  SCREE_TRY(check_resolve(view, samples_per_side));
  Result<void> done;
  run_layers(scene, view, samples_per_side, samples, transforms, out,
             [&]<class Pass>(const Pass& pass, uint32_t count) {
               if (done) done = start_items(run_layer<Pass>, pass, count, stream, "starting to make a layer");
             });
  return done;
}

}  // namespace scree::kernels
