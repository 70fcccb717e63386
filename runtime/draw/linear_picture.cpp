#include "runtime/draw/linear_picture.h"

#include <cstddef>

#include "kernels/blend.h"
#include "kernels/frame_parts.h"
#include "runtime/textures/srgb.h"
#include "runtime/threads/parallel.h"

namespace scree::runtime {

PictureLight light_of_cpu(const kernels::SceneView& scene, const kernels::View& view, uint32_t samples_per_side,
                          std::span<const uint64_t> samples, const kernels::ShadeOptions& options, uint32_t threads) {
  return {[=, &scene](std::span<uint8_t> rgba) {
            return kernels::resolve_cpu(scene, view, samples_per_side, samples, options, 4, rgba, threads);
          },
          [=, &scene](std::span<float> colors) {
            return kernels::shade_part_cpu(scene, view, samples, options, colors, threads);
          },
          [=, &scene](std::vector<float>& over, kernels::BlendCounts& counts) -> Result<void> {
            over = SCREE_TRY(kernels::blend_cpu(scene, view, samples, options, threads, counts));
            return {};
          }};
}

Result<void> linear_picture(const kernels::SceneView& scene, const kernels::View& view, uint32_t samples_per_side,
                            std::span<const uint64_t> samples, const kernels::ShadeOptions& options, uint32_t threads,
                            const PictureLight& light, std::span<float> out, kernels::BlendCounts& blended) {
  if (!kernels::shades_from_chunks(options.show)) {
    std::vector<uint8_t> coded(out.size());
    SCREE_TRY(light.coded(coded));
    for (size_t i = 0; i < out.size(); i += 4) {
      out[i + 3] = static_cast<float>(coded[i + 3]) / 255.0f;
      for (size_t c = 0; c < 3; ++c) out[i + c] = linear_of_srgb(coded[i + c]) * out[i + 3];
    }
    return {};
  }
  std::vector<float> colors(3 * samples.size());
  SCREE_TRY(light.colors(colors));
  // BlendTargets::over of the layers of blended surfaces: their light, and the share that they let through.
  std::vector<float> over;
  if (kernels::shows_layers(scene, options)) SCREE_TRY(light.over(over, blended));
  std::vector<float> visibility(options.ssao || options.edl ? out.size() / 4 : 0);
  if (!visibility.empty())
    SCREE_TRY(kernels::occlusion_cpu(view, samples_per_side, samples, options, visibility, threads));
  const uint64_t side = samples_per_side;
  const uint64_t width = view.width / side;
  parallel_for(view.height / side, threads, [&](uint64_t y) {
    for (uint64_t x = 0; x < width; ++x) {
      const uint64_t pixel = y * width + x;
      float lit[3] = {0, 0, 0};
      float layers[3] = {0, 0, 0};
      float surface = 0;
      for (uint64_t j = 0; j < side; ++j) {
        for (uint64_t i = 0; i < side; ++i) {
          const uint64_t sample = (y * side + j) * view.width + x * side + i;
          const bool covered = samples[sample] != kernels::kBackground;
          const float through = over.empty() ? 1.0f : over[4 * sample + 3];
          for (uint64_t c = 0; c < 3; ++c) {
            if (!over.empty()) layers[c] += over[4 * sample + c];
            if (covered) lit[c] += through * colors[3 * sample + c];
          }
          surface += covered ? 1.0f : 1.0f - through;
        }
      }
      const float factor = visibility.empty() ? 1.0f : visibility[pixel];
      const float share = 1.0f / static_cast<float>(side * side);
      const float behind = (static_cast<float>(side * side) - surface) * options.background[3];
      for (uint64_t c = 0; c < 3; ++c)
        out[4 * pixel + c] = (lit[c] * factor + layers[c] + behind * options.background[c]) * share;
      out[4 * pixel + 3] = (surface + behind) * share;
    }
  });
  return {};
}

}  // namespace scree::runtime
