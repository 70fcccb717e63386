// A frame drawn in parts, for scenes whose chunks are not all in memory at once: a part is the chunks whose pages are
// there (SceneView::pages), each in one part (on a GPU in one that draws all that is left of it: FramePart). The
// picture is that of draw_cpu() and resolve_cpu(), byte for byte, however the chunks are shared out and in whatever
// order the parts come.
#pragma once

#include <cstdint>
#include <span>

#include "kernels/frame.h"

namespace scree::kernels {

/// Whether samples are shaded from their chunks, so that shade_part_cpu() is needed; what shows anything else is
/// resolved from the samples alone, by resolve_cpu() after the last part.
constexpr bool shades_from_chunks(Show show) {
  return show != Show::kDepth && show != Show::kTriangle && show != Show::kMesh;
}

/// As draw_cpu(), but into samples that hold the parts before; all kBackground before the first.
Result<FrameStats> draw_part_cpu(const SceneView& scene, const View& view, std::span<uint64_t> samples,
                                 uint32_t threads);

/// Shades those samples whose triangle lies in a chunk that is there: linear light, 3 floats a sample, row by row. What
/// a later part draws over them it shades again. Errors kRange (sizes that do not fit each other, the camera), kMemory.
Result<void> shade_part_cpu(const SceneView& scene, const View& view, std::span<const uint64_t> samples,
                            const ShadeOptions& options, std::span<float> colors, uint32_t threads);

/// As resolve_cpu(), from the colours of all samples that are not background. `over`: of blend_cpu(), or empty.
Result<void> resolve_colors_cpu(const View& view, uint32_t samples_per_side, std::span<const uint64_t> samples,
                                std::span<const float> colors, std::span<const float> over, const ShadeOptions& options,
                                uint32_t channels, std::span<uint8_t> pixels, uint32_t threads);

}  // namespace scree::kernels
