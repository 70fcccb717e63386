#include "runtime/draw/renderer.h"

#include <cstddef>
#include <string>

#include "format/bitpack.h"
#include "format/geometry/chunk_layout.h"
#include "kernels/blend.h"
#include "kernels/frame_parts.h"
#include "runtime/textures/srgb.h"
#include "runtime/threads/parallel.h"

namespace scree::runtime {
namespace {

/// The triangle's number in the source primitive, if the file has it.
Result<std::optional<uint64_t>> source_triangle(const Scene& scene, const kernels::Hit& hit) {
  const format::ChunkRecord& chunk = scene.view().chunks[hit.chunk];
  const format::MeshRecord& mesh = scene.view().meshes[chunk.mesh];
  if (!(mesh.attributes & format::kHasSourceIds)) return std::optional<uint64_t>();
  if (chunk.source_bits == 0) return std::optional<uint64_t>(chunk.source_min);
  std::vector<std::byte> scratch;
  const Result<std::span<const std::byte>> page = scene.page(chunk.page, scratch);
  if (!page) return page.error();
  const std::byte* const stream = page->data() + chunk.offset + format::chunk_streams(mesh, chunk).source_ids.offset;
  return std::optional<uint64_t>(chunk.source_min +
                                 format::unpack(stream, uint64_t{hit.triangle} * chunk.source_bits, chunk.source_bits));
}

}  // namespace

Result<kernels::View> view_of_samples(kernels::View view, uint32_t samples_per_side) {
  const uint64_t width = uint64_t{view.width} * samples_per_side;
  const uint64_t height = uint64_t{view.height} * samples_per_side;
  if (width == 0 || height == 0 || width > kernels::kMaxImageSide || height > kernels::kMaxImageSide)
    return Error{ErrorCode::kRange, "a picture of " + std::to_string(width) + " x " + std::to_string(height) +
                                        " samples, expected 1 to " + std::to_string(kernels::kMaxImageSide) +
                                        " a side"};
  view.width = static_cast<uint32_t>(width);
  view.height = static_cast<uint32_t>(height);
  return view;
}

PictureLight light_of_cpu(const kernels::SceneView& scene, const kernels::View& view, uint32_t samples_per_side,
                          std::span<const uint64_t> samples, const kernels::ShadeOptions& options, uint32_t threads) {
  return {[=, &scene](std::span<uint8_t> rgba) {
            return kernels::resolve_cpu(scene, view, samples_per_side, samples, options, 4, rgba, threads);
          },
          [=, &scene](std::span<float> colors) {
            return kernels::shade_part_cpu(scene, view, samples, options, colors, threads);
          },
          [=, &scene](std::vector<float>& over, kernels::BlendCounts& counts) -> Result<void> {
            Result<std::vector<float>> made = kernels::blend_cpu(scene, view, samples, options, threads, counts);
            if (!made) return made.error();
            over = std::move(*made);
            return {};
          }};
}

Result<void> linear_picture(const kernels::SceneView& scene, const kernels::View& view, uint32_t samples_per_side,
                            std::span<const uint64_t> samples, const kernels::ShadeOptions& options, uint32_t threads,
                            const PictureLight& light, std::span<float> out, kernels::BlendCounts& blended) {
  if (!kernels::shades_from_chunks(options.show)) {
    std::vector<uint8_t> coded(out.size());
    if (Result<void> done = light.coded(coded); !done) return done;
    for (size_t i = 0; i < out.size(); i += 4) {
      out[i + 3] = static_cast<float>(coded[i + 3]) / 255.0f;
      for (size_t c = 0; c < 3; ++c) out[i + c] = linear_of_srgb(coded[i + c]) * out[i + 3];
    }
    return {};
  }
  std::vector<float> colors(3 * samples.size());
  if (Result<void> done = light.colors(colors); !done) return done;
  // BlendTargets::over of the layers of blended surfaces: their light, and the share that they let through.
  std::vector<float> over;
  if (kernels::shows_layers(scene, options))
    if (Result<void> done = light.over(over, blended); !done) return done;
  std::vector<float> visibility(options.ssao || options.edl ? out.size() / 4 : 0);
  if (!visibility.empty())
    if (Result<void> done = kernels::occlusion_cpu(view, samples_per_side, samples, options, visibility, threads);
        !done)
      return done;
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

uint64_t sample_index(const kernels::View& view, uint32_t samples_per_side, uint32_t x, uint32_t y) {
  const uint64_t column = uint64_t{x} * samples_per_side + samples_per_side / 2;
  const uint64_t row = uint64_t{y} * samples_per_side + samples_per_side / 2;
  return row * view.width + column;
}

Result<std::optional<Pick>> pick_sample(const Scene& scene, const kernels::View& view, uint64_t sample) {
  if (sample == kernels::kBackground) return std::optional<Pick>();
  Pick pick{};
  pick.id = kernels::sample_id(sample);
  pick.hit = kernels::find_triangle(scene.view(), pick.id);
  const format::InstanceRecord& instance = scene.view().instances[pick.hit.instance];
  pick.mesh = instance.mesh;
  pick.node = instance.node;
  pick.node_instance = instance.node_instance;
  pick.mesh_triangle = scene.view().chunks[pick.hit.chunk].first_triangle + pick.hit.triangle;
  const Result<std::optional<uint64_t>> source = source_triangle(scene, pick.hit);
  if (!source) return source.error();
  pick.source_triangle = *source;
  pick.depth = kernels::depth_of_code(view, kernels::sample_depth_code(sample));
  return std::optional<Pick>(pick);
}

}  // namespace scree::runtime
