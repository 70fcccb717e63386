// Compiled once for each instruction set (CMakeLists.txt): SCREE_ISA names the namespace that all of it lies in.
#include "kernels/passes.h"
#include "kernels/shade.h"
#include "kernels/team_cpu.h"

namespace scree::kernels {
inline namespace SCREE_ISA {
namespace {

bool draw(ThreadPool& pool, const SceneView& scene, const View& view, uint64_t* samples, const QueueSizes& sizes,
          FrameStats& stats) {
  CpuBackend backend(pool);
  return draw_frame(backend, scene, make_frame_view(view), samples, sizes, stats);
}

template <bool kOrthographic>
void shade_with(ThreadPool& pool, const SceneView& scene, const View& view, const uint64_t* samples,
                const ShadeOptions& options, const float* srgb_table, uint32_t first_row, uint32_t row_count,
                float* rgba) {
  Shade<kOrthographic> pass{scene,      make_frame_view(view), view, options,   samples,
                            srgb_table, kFarthestDepthCode,    0,    first_row, rgba};
  if (options.show == Show::kDepth) {
    for (uint64_t i = 0; i < uint64_t{view.width} * view.height; ++i) {
      if (samples[i] == kBackground) continue;
      pass.nearest_code = min_of(pass.nearest_code, sample_depth_code(samples[i]));
      pass.farthest_code = max_of(pass.farthest_code, sample_depth_code(samples[i]));
    }
  }
  CpuBackend backend(pool);
  backend.for_each(row_count, pass);
}

void shade(ThreadPool& pool, const SceneView& scene, const View& view, const uint64_t* samples,
           const ShadeOptions& options, const float* srgb_table, uint32_t first_row, uint32_t row_count, float* rgba) {
  if (view.orthographic) {
    shade_with<true>(pool, scene, view, samples, options, srgb_table, first_row, row_count, rgba);
  } else {
    shade_with<false>(pool, scene, view, samples, options, srgb_table, first_row, row_count, rgba);
  }
}

}  // namespace

extern const CpuPasses kPasses;
const CpuPasses kPasses = {draw, shade};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
