// Compiled once per instruction set (CMakeLists.txt). SCREE_ISA is the namespace that holds all of it.
#include "kernels/cpu/passes.h"
#include "kernels/cpu/team.h"
#include "kernels/shade/ambient_occlusion.h"
#include "kernels/shade/blend.h"
#include "kernels/shade/layers.h"
#include "kernels/shade/pixels.h"
#include "kernels/shade/resolve_rounds.h"
#include "kernels/shade/stored_colors.h"

namespace scree::kernels {
inline namespace SCREE_ISA {
namespace {

bool draw(ThreadPool& pool, const SceneView& scene, const View& view, uint64_t* samples, const uint64_t* peeled,
          bool clear, const QueueSizes& sizes, FrameStats& stats) {
  CpuBackend backend(pool);
  const FrameView frame = make_frame_view(view);
  if (clear) clear_frame(backend, frame, samples);
  return draw_frame(backend, scene, frame, {samples, frame.width, peeled}, sizes, stats);
}

/// Calls visit(shader) with the shader of the picture's samples.
template <class Visit>
void with_shader(CpuBackend& backend, const SceneView& scene, const View& view, const uint64_t* samples,
                 const ShadeOptions& options, const SrgbTables& srgb, const Visit& visit) {
  DepthRange range;
  if (options.show == Show::kDepth) backend.for_each(view.height, FindDepthRange{samples, view.width, &range});
  visit_shader<false>(make_shade_inputs(scene, view, options, nullptr, &srgb, &range), visit);
}

template <class Pixels>
void run_round(CpuBackend& backend, const Pixels& pixels, const TileRound& round, RoundCounters& counters) {
  backend.for_each(round.count, ShadeRound<Pixels>{pixels, round.tiles, round.left, &counters});
}

uint32_t resolve(ThreadPool& pool, const SceneView& scene, const View& view, uint32_t side, const uint64_t* samples,
                 const ShadeOptions& options, const SrgbTables& srgb, const float* visibility, uint32_t channels,
                 uint8_t* pixels, const TileRound& round) {
  CpuBackend backend(pool);
  RoundCounters counters{};
  const PixelTiles tiles{view.width / side, 0, view.height / side};
  with_shader(backend, scene, view, samples, options, srgb, [&]<class Shader>(const Shader& shader) {
    run_round(backend, Resolve<Shader>{shader, tiles, samples, side, visibility, channels, pixels}, round, counters);
  });
  return counters.tiles;
}

uint32_t shade_part(ThreadPool& pool, const SceneView& scene, const View& view, const uint64_t* samples,
                    const ShadeOptions& options, const SrgbTables& srgb, float* colors, const TileRound& round) {
  CpuBackend backend(pool);
  RoundCounters counters{};
  const PixelTiles tiles{view.width, 0, view.height};
  with_shader(backend, scene, view, samples, options, srgb, [&]<class Shader>(const Shader& shader) {
    run_round(backend, ShadePart<Shader>{shader, tiles, samples, colors}, round, counters);
  });
  return counters.tiles;
}

void resolve_colors(ThreadPool& pool, const View& view, uint32_t side, const uint64_t* samples, const float* colors,
                    const float* over, const ShadeOptions& options, const SrgbTables& srgb, const float* visibility,
                    uint32_t channels, uint8_t* pixels) {
  CpuBackend backend(pool);
  const PixelTiles tiles{view.width / side, 0, view.height / side};
  const ShadeInputs in = make_shade_inputs(SceneView{}, view, options, nullptr, &srgb, nullptr);
  const auto run = [&]<class Shader>(const Shader& shader) {
    backend.for_each(tiles.count(), Resolve<Shader>{shader, tiles, samples, side, visibility, channels, pixels});
  };
  over != nullptr ? run(BlendedColors{{in, colors}, over}) : run(StoredColors{in, colors});
}

void begin_layer(ThreadPool& pool, const BlendTargets& at, bool is_first) {
  CpuBackend(pool).for_each(blend_items(at.sample_count), BeginLayer{at, is_first});
}

uint64_t end_layer(ThreadPool& pool, const BlendTargets& at) {
  uint64_t count = 0;
  CpuBackend(pool).for_each(blend_items(at.sample_count), EndLayer{at, &count});
  return count;
}

void lay_under(ThreadPool& pool, const BlendTargets& at) {
  CpuBackend(pool).for_each(blend_items(at.sample_count), LayUnder{at});
}

void find_alphas(ThreadPool& pool, const SceneView& scene, const View& view, const uint64_t* layer, float* alphas) {
  CpuBackend backend(pool);
  const PixelTiles tiles{view.width, 0, view.height};
  const ShadeInputs in = make_shade_inputs(scene, view, ShadeOptions{}, nullptr, nullptr, nullptr);
  if (view.orthographic) {
    backend.for_each(tiles.count(), FindAlphas<true>{in, tiles, layer, alphas});
  } else {
    backend.for_each(tiles.count(), FindAlphas<false>{in, tiles, layer, alphas});
  }
}

void occlude(ThreadPool& pool, const View& view, uint32_t side, const uint64_t* samples, const ShadeOptions& options,
             float* depth, float* open, float* visibility) {
  CpuBackend backend(pool);
  run_occlusion(view, side, samples, options, depth, open, visibility,
                [&](const auto& pass, uint32_t count) { backend.for_each(count, pass); });
}

void layers(ThreadPool& pool, const SceneView& scene, const View& view, uint32_t side, const uint64_t* samples,
            const LayerTargets& out) {
  CpuBackend backend(pool);
  run_layers(scene, view, side, samples, nullptr, out,
             [&](const auto& pass, uint32_t count) { backend.for_each(count, pass); });
}

}  // namespace

extern const CpuPasses kPasses;
const CpuPasses kPasses = {draw,   resolve,     shade_part, resolve_colors, occlude,
                           layers, begin_layer, end_layer,  lay_under,      find_alphas};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
