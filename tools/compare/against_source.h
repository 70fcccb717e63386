// What kernels/ draws of a .scree file against what the reference rasteriser draws of its source.
#pragma once

#include <cstdint>
#include <span>

#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/draw/renderer.h"
#include "runtime/scene/scene.h"
#include "tools/compare/images.h"
#include "tools/compare/pixels.h"
#include "tools/compare/source_model.h"

namespace scree::compare {

/// Coincident triangles are those whose depths at a pixel differ by no more than this share of it: double precision
/// cannot say which is nearer.
inline constexpr double kCoincidence = 1e-12;

/// What of a scene's colours the reference has too (shade_reference()): base colour factors, vertex colours and light,
/// black behind; no textures, and no layers of blended surfaces.
kernels::ShadeOptions shading_of_reference();

struct SourceReport {
  PixelReport pixels;
  PictureReport pictures;  // the lit pictures, textures left out of both
};

/// Draws `scene` by the CPU, one sample a pixel, and `model` by draw_reference(), shades both,
/// and compares pixel by pixel. `model` was loaded for the same scene of the same file; `pixels_per_degree` is FLIP's.
/// Errors: those of draw_cpu, resolve_cpu, draw_reference and shade_reference; kRange: a source triangle number past
/// its mesh; kMemory.
Result<SourceReport> compare_with_source(const runtime::Scene& scene, const SourceModel& model,
                                         const kernels::View& view, double pixels_per_degree, uint32_t threads);

/// The same of a frame that was drawn of one sample a pixel and has its samples on the host, and of the reference of
/// the same view: `expected` are its width * height pixels. `model` may have been loaded for another file of the same
/// source, with the same meshes and instances. Errors kRange, kMemory, those of Frame::pick.
Result<PixelReport> compare_frame(const runtime::Frame& frame, const SourceModel& model,
                                  std::span<const ReferencePixel> expected, const kernels::View& view,
                                  uint32_t threads);

/// One picture of the reference rasteriser (in another ReferenceMode) against another. Errors kMemory.
Result<PixelReport> compare_references(std::span<const ReferencePixel> found, const SourceModel& model,
                                       std::span<const ReferencePixel> expected, const kernels::View& view,
                                       uint32_t threads);

}  // namespace scree::compare
