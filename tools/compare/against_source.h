// Compares pictures of a .scree file, drawn by kernels/, with pictures of its source, drawn by the reference
// rasteriser.
#pragma once

#include <cstdint>
#include <span>

#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/scene/scene.h"
#include "tools/compare/images.h"
#include "tools/compare/pixels.h"
#include "tools/compare/source_model.h"

namespace scree::compare {

/// Two triangles coincide at a pixel if their relative depth difference is at most this: double precision cannot decide
/// which one is nearer.
inline constexpr double kCoincidence = 1e-12;

/// The shading that the reference supports too (shade_reference()): base colour factors, vertex colours, light, and a
/// black background; no textures, and no layers of blended surfaces.
kernels::ShadeOptions shading_of_reference();

struct SourceReport {
  PixelReport pixels;
  PictureReport pictures;  // the lit pictures, both without textures
};

/// Draws `scene` on the CPU with one sample per pixel, and `model` by draw_reference(), shades both, and compares pixel
/// by pixel. `model` must have been loaded for the same scene of the same file. `pixels_per_degree`: for FLIP. Errors:
/// those of draw_cpu, resolve_cpu, draw_reference and shade_reference; kRange: a source triangle number past its mesh;
/// kMemory.
Result<SourceReport> compare_with_source(const runtime::Scene& scene, const SourceModel& model,
                                         const kernels::View& view, double pixels_per_degree, uint32_t threads);

/// Compares the samples of a frame of `scene`, one per pixel, with the reference picture of the same view, `expected`.
/// `model` may have been loaded for another file of the same source, with the same meshes and instances. Errors kRange,
/// kMemory, those of runtime::pick_sample.
Result<PixelReport> compare_frame(const runtime::Scene& scene, std::span<const uint64_t> samples,
                                  const SourceModel& model, std::span<const ReferencePixel> expected,
                                  const kernels::View& view, uint32_t threads);

/// Compares a picture of the reference rasteriser in another ReferenceMode with its exact picture. Errors kMemory.
Result<PixelReport> compare_references(std::span<const ReferencePixel> found, const SourceModel& model,
                                       std::span<const ReferencePixel> expected, const kernels::View& view,
                                       uint32_t threads);

}  // namespace scree::compare
