#include "tools/synth/panes.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "tools/common/jobs/stop_flag.h"
#include "tools/gltf/write/writer.h"
#include "tools/synth/gltf_parts.h"
#include "tools/synth/scene_functions.h"

namespace scree::synth {
namespace {

using namespace tools;

constexpr uint32_t kMostPanes = 8;
constexpr uint32_t kPaneQuads = 64;  // along a side
constexpr double kPaneAngle = std::numbers::pi / 3;
constexpr double kPaneAspect = 16.0 / 9.0;
constexpr double kNearestPane = 4;   // distance of the nearest pane from the camera
constexpr double kPaneStep = 0.5;    // distance from pane to pane
constexpr double kPaneMargin = 1.1;  // size of a pane relative to the picture
constexpr double kPaneWaves = 0.12;  // height of the waves; neighbouring panes do not touch

/// Adds a grid at `distance`, whose waves have the given phase.
Result<GltfPrimitive> add_pane(GltfWriter& writer, double distance, double phase, bool has_uvs) {
  Mesh mesh;
  const double half_height = kPaneMargin * (distance + kPaneWaves) * std::tan(kPaneAngle / 2);
  for (uint32_t y = 0; y <= kPaneQuads; ++y) {
    for (uint32_t x = 0; x <= kPaneQuads; ++x) {
      const double u = static_cast<double>(x) / kPaneQuads;
      const double v = static_cast<double>(y) / kPaneQuads;
      const double wave = kPaneWaves * std::sin(9 * u + phase) * std::sin(7 * v + 2 * phase);
      mesh.add_vertex({(2 * u - 1) * half_height * kPaneAspect, (1 - 2 * v) * half_height, wave - distance}, 4 * u,
                      4 * v);
    }
  }
  mesh.add_grid(kPaneQuads, kPaneQuads, Mesh::Rows::kDown);
  if (!has_uvs) mesh.uvs.clear();
  return append_primitive(writer, mesh);
}

/// Adds a texture with streaks in its alpha.
Result<uint32_t> add_streaks(GltfWriter& writer, const SynthOptions& options) {
  const uint32_t size = *options.texture_size;
  std::vector<uint8_t> rgba;
  rgba.reserve(uint64_t{4} * size * size);
  for (uint32_t y = 0; y < size; ++y) {
    SCREE_TRY(tools::check_stop(options.stop));
    for (uint32_t x = 0; x < size; ++x) {
      const double u = 2 * std::numbers::pi * x / size;
      const double v = 2 * std::numbers::pi * y / size;
      const double streak = 0.5 + 0.5 * std::sin(3 * u + std::sin(2 * v)) * std::sin(5 * v + std::cos(u));
      const double alpha = 0.1 + 0.3 * streak + 0.1 * unit24(hash2(7, x, y));
      for (const uint8_t code : {uint8_t{255}, uint8_t{255}, uint8_t{255}, static_cast<uint8_t>(255 * alpha + 0.5)})
        rgba.push_back(code);
    }
  }
  const std::vector<std::byte> png = SCREE_TRY(runtime::encode_png({size, size, 4, rgba}, {.is_small = true}));
  const uint32_t image = SCREE_TRY(writer.add_image("streaks", format::ImageCodec::kPng, png));
  return writer.add_texture(trilinear(image, "streaks"));
}

}  // namespace

Result<SynthReport> write_panes(const SynthOptions& options) {
  const bool is_textured = options.scene == "panes-textured";
  GltfWriter writer = SCREE_TRY(GltfWriter::create(options.output, {}, options.existing));
  writer.stop_on(options.stop);
  uint32_t streaks = format::kNone;
  if (is_textured) streaks = SCREE_TRY(add_streaks(writer, options));
  const auto panes = std::max(1u, static_cast<uint32_t>(std::lround(kMostPanes * options.scale)));
  std::vector<uint32_t> children;
  // The last one is the wall.
  for (uint32_t i = 0; i <= panes; ++i) {
    const bool is_wall = i == panes;
    GltfMaterial material{.name = is_wall ? "wall" : "pane " + std::to_string(i)};
    const double tone = static_cast<double>(i) / kMostPanes;
    const double color[3] = {0.9 - 0.8 * tone, 0.3 + 0.6 * std::abs(2 * tone - 1), 0.1 + 0.8 * tone};
    std::copy(color, color + 3, material.base_color);
    material.double_sided = true;
    if (!is_wall) material.alpha = GltfAlpha::kBlend;
    if (!is_wall && !is_textured) material.base_color[3] = 0.2;
    if (!is_wall) material.texture = streaks;
    GltfMesh mesh{.name = material.name};
    GltfPrimitive primitive =
        SCREE_TRY(add_pane(writer, kNearestPane + kPaneStep * (is_wall ? kMostPanes : i), i, is_textured && !is_wall));
    primitive.material = writer.add_material(std::move(material));
    mesh.primitives.push_back(std::move(primitive));
    children.push_back(writer.add_node({.name = mesh.name, .mesh = writer.add_mesh(std::move(mesh))}));
  }
  const GltfCamera lens{.name = "through", .y = kPaneAngle, .x = kPaneAspect};
  children.push_back(writer.add_node({.name = lens.name, .camera = writer.add_camera(lens)}));
  writer.add_scene({"panes", std::move(children)});
  SCREE_TRY(writer.finish());
  SynthReport report;
  report.instances = panes + 1;
  report.unique_triangles = report.drawn_triangles = report.instances * (2 * kPaneQuads * kPaneQuads);
  report.vertices = report.instances * ((kPaneQuads + 1) * (kPaneQuads + 1));
  report.file_bytes = writer.total_bytes();
  return report;
}

}  // namespace scree::synth
