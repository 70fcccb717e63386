// Parts of drawing a frame: its size in samples, pictures in linear light, and picks.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/draw/device_scene.h"
#include "runtime/scene/scene.h"

namespace scree::runtime {

/// The view whose pixels are the samples of `view`. Errors kRange: a side of 0 or over kernels::kMaxImageSide.
Result<kernels::View> view_of_samples(kernels::View view, uint32_t samples_per_side);

/// The functions of the CPU, or of the GPU that drew, that linear_picture() calls.
struct PictureLight {
  std::function<Result<void>(std::span<uint8_t> rgba)> coded;   // kernels::resolve_cpu() with 4 channels
  std::function<Result<void>(std::span<float> colors)> colors;  // kernels::shade_part_cpu() with all chunks
  std::function<Result<void>(std::vector<float>& over, kernels::BlendCounts& counts)> over;  // kernels::blend_cpu()
};
PictureLight light_of_cpu(const kernels::SceneView& scene, const kernels::View& view, uint32_t samples_per_side,
                          std::span<const uint64_t> samples, const kernels::ShadeOptions& options, uint32_t threads);

/// `device`: drew `view` last. `options`: as for its resolve().
inline PictureLight light_of(DeviceView& device, const kernels::View& view, uint32_t samples_per_side,
                             const kernels::ShadeOptions& options) {
  return {[=, &device](std::span<uint8_t> rgba) {
            // RGBA8, red in the low byte.
            return device.resolve(view, samples_per_side, options,
                                  {reinterpret_cast<uint32_t*>(rgba.data()), rgba.size() / 4});
          },
          [=, &device](std::span<float> colors) { return device.read_colors(view, options, colors); },
          [=, &device](std::vector<float>& over, kernels::BlendCounts& counts) {
            over.resize(uint64_t{4} * view.width * view.height);
            const Result<void> read = device.read_over(view, options, over);
            counts = device.blended();
            return read;
          }};
}

/// Makes a picture in linear light: RGBA, 4 floats per pixel, premultiplied by alpha. Pictures of ids or depths become
/// their 8-bit colours in linear light. Takes 12 bytes per sample meanwhile, and 16 more if blended surfaces are drawn.
/// Errors of `light` and kernels::occlusion_cpu. Throws std::bad_alloc.
Result<void> linear_picture(const kernels::SceneView& scene, const kernels::View& view, uint32_t samples_per_side,
                            std::span<const uint64_t> samples, const kernels::ShadeOptions& options, uint32_t threads,
                            const PictureLight& light, std::span<float> out, kernels::BlendCounts& blended);

/// The triangle that a pixel shows.
struct Pick {
  kernels::Hit hit;
  uint32_t mesh;
  uint32_t node;
  uint32_t node_instance;
  uint64_t mesh_triangle;                   // in the mesh as stored
  std::optional<uint64_t> source_triangle;  // in the source primitive, if the file has source ids
  uint64_t id;                              // global triangle id
  double depth;                             // from the eye's plane, world units
};

/// The index of the sample that picking a pixel reads: the one at its centre, or below and to the right of the centre
/// if the number of samples per side is even. `view`: in samples.
uint64_t sample_index(const kernels::View& view, uint32_t samples_per_side, uint32_t x, uint32_t y);

/// The triangle that a sample of a frame of `view` shows; nothing on the background. If the scene does not have the
/// triangle's page, it is read from the file: errors as Scene::page.
Result<std::optional<Pick>> pick_sample(const Scene& scene, const kernels::View& view, uint64_t sample);

}  // namespace scree::runtime
