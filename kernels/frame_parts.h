// A frame drawn in parts, for scenes whose chunks do not all fit into memory. A part is the chunks whose pages are
// present (SceneView::pages). Each chunk is in one part; on a GPU a kPreviouslyVisible part may draw some of its
// clusters before (FramePart). The picture equals that of draw_cpu() and resolve_cpu() byte for byte, whatever the
// division and the order of chunks.
#pragma once

#include <cstdint>
#include <span>

#include "kernels/frame.h"

namespace scree::kernels {

/// Whether samples are shaded from their chunks. If so, each part needs shade_part_cpu(). All other pictures are
/// resolved from the samples alone, by resolve_cpu() after the last part.
constexpr bool shades_from_chunks(Show show) {
  return show != Show::kDepth && show != Show::kTriangle && show != Show::kMesh;
}

/// As draw_cpu(), but adds to samples that hold the parts before. All samples are kBackground before the first part.
Result<FrameStats> draw_part_cpu(const SceneView& scene, const View& view, std::span<uint64_t> samples,
                                 uint32_t threads);

/// Shades the samples whose triangle lies in a chunk that is present: linear light, 3 floats per sample, row by row.
/// Samples that a later part draws over are shaded again by that part. Errors kRange (sizes that do not fit each other,
/// the camera), kMemory.
Result<void> shade_part_cpu(const SceneView& scene, const View& view, std::span<const uint64_t> samples,
                            const ShadeOptions& options, std::span<float> colors, uint32_t threads);

/// As resolve_cpu(), from the colours of all samples that are not background. `over`: of blend_cpu(), or empty.
Result<void> resolve_colors_cpu(const View& view, uint32_t samples_per_side, std::span<const uint64_t> samples,
                                std::span<const float> colors, std::span<const float> over, const ShadeOptions& options,
                                uint32_t channels, std::span<uint8_t> pixels, uint32_t threads);

}  // namespace scree::kernels
