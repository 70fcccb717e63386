#include "runtime/renderer.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <new>
#include <string>

#include "format/bitpack.h"
#include "format/chunk_layout.h"
#include "runtime/parallel.h"
#include "runtime/srgb.h"

namespace scree::runtime {
namespace {

/// One pixel of `side` x `side` samples whose first is at `rgba`, rows `row_floats` apart. The light of a pixel is that
/// of its samples weighted by their alpha, so that a transparent background does not bleed into an edge.
void resolve_pixel(const Srgb& srgb, const float* rgba, uint64_t row_floats, uint32_t side, uint32_t channels,
                   uint8_t* out) {
  float light[3] = {0, 0, 0};
  float alpha = 0;
  for (uint32_t j = 0; j < side; ++j) {
    for (uint32_t i = 0; i < side; ++i) {
      const float* const sample = rgba + j * row_floats + 4 * i;
      alpha += sample[3];
      for (size_t c = 0; c < 3; ++c) light[c] += sample[3] * sample[c];
    }
  }
  const float scale = alpha > 0 ? 1.0f / alpha : 0.0f;
  for (size_t c = 0; c < 3; ++c) out[c] = srgb.code(light[c] * scale);
  if (channels == 4) {
    const float share = alpha / static_cast<float>(side * side);
    out[3] = static_cast<uint8_t>(std::lrint(std::clamp(share, 0.0f, 1.0f) * 255.0f));
  }
}

std::optional<uint64_t> source_triangle(const kernels::SceneView& scene, const kernels::Hit& hit) {
  const format::ChunkRecord& chunk = scene.chunks[hit.chunk];
  const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
  if (!(mesh.attributes & format::kHasSourceIds)) return std::nullopt;
  if (chunk.source_bits == 0) return chunk.source_min;
  const std::byte* const stream =
      scene.pages[chunk.page] + chunk.offset + format::chunk_streams(mesh, chunk).source_ids.offset;
  return chunk.source_min + format::unpack(stream, uint64_t{hit.triangle} * chunk.source_bits, chunk.source_bits);
}

}  // namespace

Result<Frame> Frame::draw(const Scene& scene, const kernels::View& view, uint32_t samples_per_side, uint32_t threads,
                          DeviceScene* device) {
  assert(samples_per_side == 1 || samples_per_side == 2 || samples_per_side == 4);
  const uint64_t width = uint64_t{view.width} * samples_per_side;
  const uint64_t height = uint64_t{view.height} * samples_per_side;
  if (width == 0 || height == 0 || width > kernels::kMaxImageSide || height > kernels::kMaxImageSide)
    return Error{ErrorCode::kRange, "a picture of " + std::to_string(width) + " x " + std::to_string(height) +
                                        " samples, expected 1 to " + std::to_string(kernels::kMaxImageSide) +
                                        " a side"};
  Frame frame;
  frame.scene_ = &scene;
  frame.device_ = device;
  frame.view_ = view;
  frame.view_.width = static_cast<uint32_t>(width);
  frame.view_.height = static_cast<uint32_t>(height);
  frame.samples_per_side_ = samples_per_side;
  try {
    frame.samples_.resize(width * height);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "no memory left for " + std::to_string(width * height) + " samples"};
  }
  const Stopwatch watch;
  Result<kernels::FrameStats> stats =
      device != nullptr ? device->draw(frame.view_, frame.samples_)
                        : kernels::draw_cpu(scene.view(), frame.view_, frame.samples_, threads);
  if (!stats) return stats.error();
  frame.stats_ = *stats;
  frame.draw_time_ = watch.elapsed();
  return frame;
}

Result<Picture> Frame::shade(const kernels::ShadeOptions& options, uint32_t threads) const {
  try {
    Picture picture;
    picture.width = width();
    picture.height = height();
    picture.channels = options.background[3] >= 1.0f ? 3 : 4;
    picture.pixels.resize(uint64_t{picture.width} * picture.height * picture.channels);
    const uint32_t side = samples_per_side_;
    const uint64_t row_floats = uint64_t{4} * view_.width;
    const uint64_t pixel_row_bytes = row_floats * sizeof(float) * side;
    const auto band = static_cast<uint32_t>(std::clamp<uint64_t>(kBandBytes / pixel_row_bytes, 1, picture.height));
    std::vector<float> rgba(row_floats * side * band);
    for (uint32_t first = 0; first < picture.height; first += band) {
      const uint32_t rows = std::min(band, picture.height - first);
      const std::span<float> floats(rgba.data(), row_floats * side * rows);
      const Result<void> shaded =
          device_ != nullptr
              ? device_->shade(view_, samples_, options, floats, first * side)
              : kernels::shade_cpu(scene_->view(), view_, samples_, options, floats, threads, first * side);
      if (!shaded) return shaded.error();
      parallel_for(rows, threads, [&](uint64_t row) {
        uint8_t* out = picture.pixels.data() + (first + row) * picture.width * picture.channels;
        const float* in = rgba.data() + row * side * row_floats;
        const Srgb& srgb = Srgb::tables();
        for (uint32_t x = 0; x < picture.width; ++x, out += picture.channels, in += 4 * side)
          resolve_pixel(srgb, in, row_floats, side, picture.channels, out);
      });
    }
    return picture;
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "no memory left for the picture"};
  }
}

std::vector<float> Frame::depth() const {
  std::vector<float> out(uint64_t{width()} * height());
  for (uint64_t y = 0; y < height(); ++y) {
    for (uint64_t x = 0; x < width(); ++x) {
      uint64_t nearest = kernels::kBackground;  // the smallest code is the nearest
      for (uint64_t j = 0; j < samples_per_side_; ++j)
        for (uint64_t i = 0; i < samples_per_side_; ++i)
          nearest = std::min(nearest, samples_[(y * samples_per_side_ + j) * view_.width + x * samples_per_side_ + i]);
      out[y * width() + x] =
          nearest == kernels::kBackground
              ? INFINITY
              : static_cast<float>(kernels::depth_of_code(view_, kernels::sample_depth_code(nearest)));
    }
  }
  return out;
}

std::optional<Pick> Frame::pick(uint32_t x, uint32_t y) const {
  assert(x < width() && y < height());
  const uint64_t column = uint64_t{x} * samples_per_side_ + samples_per_side_ / 2;
  const uint64_t row = uint64_t{y} * samples_per_side_ + samples_per_side_ / 2;
  const uint64_t sample = samples_[row * view_.width + column];
  if (sample == kernels::kBackground) return std::nullopt;
  const kernels::SceneView& scene = scene_->view();
  Pick pick{};
  pick.id = kernels::sample_id(sample);
  pick.hit = kernels::find_triangle(scene, pick.id);
  const format::InstanceRecord& instance = scene.instances[pick.hit.instance];
  pick.mesh = instance.mesh;
  pick.node = instance.node;
  pick.node_instance = instance.node_instance;
  pick.mesh_triangle = scene.chunks[pick.hit.chunk].first_triangle + pick.hit.triangle;
  pick.source_triangle = source_triangle(scene, pick.hit);
  pick.depth = kernels::depth_of_code(view_, kernels::sample_depth_code(sample));
  return pick;
}

}  // namespace scree::runtime
