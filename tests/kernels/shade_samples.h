// Shades samples one by one, for tests of colours.
#pragma once

#include <cstdint>
#include <span>

#include "kernels/cpu/team.h"
#include "kernels/frame.h"
#include "kernels/shade/pixels.h"
#include "kernels/shade/srgb.h"

namespace scree::tests {

/// Linear light of the samples: 4 floats per sample, not premultiplied; the background where there is no triangle.
/// `scene` must have no paged levels.
inline void shade_samples(const kernels::SceneView& scene, const kernels::View& view, std::span<const uint64_t> samples,
                          const kernels::ShadeOptions& options, std::span<float> rgba) {
  using namespace kernels;
  const CpuTeam lane(nullptr, true);
  DepthRange range;
  for (uint32_t y = 0; y < view.height; ++y) FindDepthRange{samples.data(), view.width, &range}(y, lane);
  const ShadeInputs inputs = make_shade_inputs(scene, view, options, nullptr, &srgb_tables(), &range);
  visit_shader<false>(inputs, [&]<class Shader>(const Shader& shader) {
    for (uint32_t y = 0; y < view.height; ++y) {
      ShadeState<CpuTeam, Shader> state;
      for (uint32_t x = 0; x < view.width; ++x) {
        const uint64_t at = uint64_t{y} * view.width + x;
        float color[4];
        const bool covered = samples[at] != kBackground;
        shader(lane, covered, samples[at], static_cast<int32_t>(x), static_cast<int32_t>(y), state, color);
        color[3] = 1.0f;
        for (uint32_t c = 0; c < 4; ++c) rgba[4 * at + c] = covered ? color[c] : options.background[c];
      }
    }
  });
}

}  // namespace scree::tests
