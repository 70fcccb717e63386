// A frame: from a scene and a view to a picture, its layers and picks.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <new>
#include <optional>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/draw/device_scene.h"
#include "runtime/scene/scene.h"
#include "runtime/threads/stopwatch.h"

namespace scree::runtime {

/// The view whose pixels are the samples of `view`. Errors kRange: a side of 0 or over kernels::kMaxImageSide.
Result<kernels::View> view_of_samples(kernels::View view, uint32_t samples_per_side);

/// 8-bit sRGB pixels, rows top to bottom.
struct Picture {
  uint32_t width = 0;
  uint32_t height = 0;
  uint32_t channels = 3;  // 3: RGB; 4: RGBA, alpha linear and not premultiplied
  std::vector<uint8_t> pixels;
  kernels::BlendCounts blended;
};

/// The channels of a picture: 4 if the background is not opaque, else 3.
inline uint32_t picture_channels(const kernels::ShadeOptions& options) {
  return options.background[3] >= 1.0f ? 3 : 4;
}

/// Fills picture.pixels from RGBA8 words, red in the low byte.
void pack_pixels(std::span<const uint32_t> rgba, uint32_t threads, Picture& picture);

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

/// The visibility buffer of one view of a scene, which outlives it.
class Frame {
 public:
  /// Draws `view` with `samples_per_side` x `samples_per_side` samples per pixel (1, 2 or 4); view.width and
  /// view.height are in pixels.
  /// - `device`: null, or a copy of `scene` that outlives the frame. The GPU then draws and shades. The samples are the
  ///   same, and stay there until read_samples(). Only the frame that a device drew last can be shaded or read. Without
  ///   a device `scene` must have its pages.
  /// - `shade`: the options of the later shade(), which DeviceView::draw() needs if the device streams.
  /// Errors kRange (a side of more than kernels::kMaxImageSide samples), kMemory, and the errors of kernels::draw_cpu.
  static Result<Frame> draw(const Scene& scene, const kernels::View& view, uint32_t samples_per_side, uint32_t threads,
                            DeviceView* device = nullptr, const kernels::ShadeOptions* shade = nullptr);

  /// Shades every sample and averages a pixel's samples in linear light, weighted by alpha. Returns RGBA if the
  /// background is not opaque. Errors kMemory, and the errors of kernels::resolve_cpu and DeviceView::resolve.
  Result<Picture> shade(const kernels::ShadeOptions& options, uint32_t threads) const;

  /// The same as linear_picture(). On a GPU it requires read_samples() before. `blended`: null, or filled in. Errors
  /// kMemory, and the errors of shade(), kernels::shade_part_cpu and DeviceView::read_colors.
  Result<std::vector<float>> linear(const kernels::ShadeOptions& options, uint32_t threads,
                                    kernels::BlendCounts* blended = nullptr) const;

  /// Copies the samples from a GPU for samples() and pick(). Does nothing if the CPU drew. Errors kMemory, kDevice.
  Result<void> read_samples();

  /// A layer (kernels::LayerTargets lists values and types), rows top to bottom. Errors kMemory, and the errors of
  /// kernels::layers_cpu and DeviceView::read_layer.
  template <class T>
  Result<std::vector<T>> layer(PixelLayer layer, uint32_t threads) const try {
    std::vector<T> values(uint64_t{width()} * height() * layer_bytes(layer) / sizeof(T));
    if (const Result<void> read = read_layer(layer, std::as_writable_bytes(std::span(values)), threads); !read)
      return read.error();
    return values;
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "no memory left for a layer of the picture"};
  }

  /// The bytes of layer().
  Result<void> read_layer(PixelLayer layer, std::span<std::byte> out, uint32_t threads) const;

  /// pick_sample() of sample_index(); x < width, y < height in pixels.
  Result<std::optional<Pick>> pick(uint32_t x, uint32_t y) const;

  /// Row by row, samples per side * width values per row.
  std::span<const uint64_t> samples() const { return samples_; }
  const kernels::View& view() const { return view_; }  // in samples
  uint32_t width() const { return view_.width / samples_per_side_; }
  uint32_t height() const { return view_.height / samples_per_side_; }
  const kernels::FrameStats& stats() const { return stats_; }
  const Duration& draw_time() const { return draw_time_; }

 private:
  Frame() = default;
  Result<void> make_room();  // for samples_

  const Scene* scene_ = nullptr;
  DeviceView* device_ = nullptr;
  kernels::View view_{};  // in samples
  uint32_t samples_per_side_ = 1;
  std::vector<uint64_t> samples_;
  kernels::FrameStats stats_{};
  Duration draw_time_;
};

}  // namespace scree::runtime
