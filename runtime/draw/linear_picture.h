// Pictures in linear light, made from the samples of a frame.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/draw/device_view.h"

namespace scree::runtime {

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

}  // namespace scree::runtime
