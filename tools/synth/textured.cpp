#include "tools/synth/textured.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <new>
#include <span>
#include <utility>
#include <vector>

#include "runtime/images/jpeg_writer.h"
#include "runtime/threads/parallel.h"
#include "tools/gltf/write/writer.h"
#include "tools/synth/gltf_parts.h"
#include "tools/synth/textures.h"

namespace scree::synth {
namespace {

using namespace tools;

constexpr uint32_t kAcross = 5;   // tiles
constexpr uint32_t kQuads = 256;  // per side of a tile
constexpr double kTileSide = 100;
constexpr int kDetail = 1;  // of 255: amplitude of the noise in each texel, like the grain of a photograph

/// Height at grid steps (gi, gj) from the terrain's corner.
double height(int gi, int gj) {
  return 18.0 * noise2(1, 8, gi, gj) + 7.0 * noise2(2, 6, gi, gj) + 1.5 * noise2(3, 4, gi, gj) +
         0.3 * noise2(4, 2, gi, gj);
}

Result<void> add_tile(GltfWriter& writer, uint32_t number, uint32_t material) {
  const int first_i = static_cast<int>(number % kAcross * kQuads);
  const int first_j = static_cast<int>(number / kAcross * kQuads);
  constexpr double kStep = kTileSide / kQuads;
  Mesh mesh{.name = "tile " + std::to_string(number), .material = material};
  for (int j = 0; j <= static_cast<int>(kQuads); ++j) {
    for (int i = 0; i <= static_cast<int>(kQuads); ++i)
      mesh.add_vertex({(first_i + i) * kStep, (first_j + j) * kStep, height(first_i + i, first_j + j)},
                      static_cast<double>(i) / kQuads, static_cast<double>(j) / kQuads);
  }
  mesh.add_grid(kQuads, kQuads, Mesh::Rows::kUp);
  GltfPrimitive primitive = SCREE_TRY(append_primitive(writer, mesh));
  writer.add_mesh({mesh.name, {std::move(primitive)}});
  return {};
}

/// A texture of stones side by side, each rotated differently, under slowly varying light, with grain.
Result<std::vector<std::byte>> make_jpeg(uint32_t number, const TexturedOptions& options,
                                         std::span<const std::vector<uint8_t>> stones) {
  const uint32_t size = options.size;
  const uint32_t side = options.stone;
  runtime::JpegCoding coding;
  coding.width = coding.height = size;
  coding.components[0].h = coding.components[0].v = 2;
  for (size_t c = 1; c < 3; ++c) {
    coding.components[c].h = coding.components[c].v = 1;
    coding.components[c].quant = 1;
  }
  runtime::JpegWriter writer = SCREE_TRY(runtime::JpegWriter::create(coding));
  std::vector<uint8_t> row(size_t{3} * size);
  for (uint32_t y = 0; y < size; ++y) {
    for (uint32_t tile = 0; tile < size / side; ++tile) {
      const uint32_t way = hash2(number, tile, y / side);
      const std::vector<uint8_t>& stone = stones[way % stones.size()];
      const uint32_t from_y = (way & 256u) != 0 ? side - 1 - y % side : y % side;
      for (uint32_t x = 0; x < side; ++x) {
        const uint32_t from_x = (way & 512u) != 0 ? side - 1 - x : x;
        const uint8_t* const texel = stone.data() + 3 * (size_t{from_y} * side + from_x);
        const int grain = static_cast<int>(hash32(way + from_y * side + from_x) % (2 * kDetail + 1)) - kDetail;
        uint8_t* const out = row.data() + 3 * (size_t{tile} * side + x);
        for (size_t c = 0; c < 3; ++c) out[c] = static_cast<uint8_t>(std::clamp(texel[c] + grain, 0, 255));
      }
    }
    SCREE_TRY(writer.row(row));
  }
  return writer.finish();
}

}  // namespace

std::array<SceneCamera, 2> textured_cameras() {
  return {SceneCamera{"overview", {250, -220, 190}, {250, 210, 0}},
          SceneCamera{"closeup", {210, 160, 34}, {280, 230, 8}}};
}

Result<TexturedReport> write_textured(const TexturedOptions& options) try {
  if (options.meshes == 0 || options.size == 0 || options.size > 32768 || options.stone < 32 ||
      !std::has_single_bit(options.stone) || options.size % options.stone != 0)
    return Error{ErrorCode::kUsage, std::to_string(options.meshes) + " textures of " + std::to_string(options.size) +
                                        " texels per side, expected 1 or more of a multiple of " +
                                        std::to_string(options.stone) + ", at most 32768"};
  const uint32_t threads = thread_count(options.threads, options.meshes);
  std::vector<std::vector<uint8_t>> stones;
  for (const TextureKind kind :
       {TextureKind::kGranite, TextureKind::kSandstone, TextureKind::kSlate, TextureKind::kGround})
    stones.push_back(SCREE_TRY(make_texture(kind, options.stone, options.threads)));
  std::vector<Result<std::vector<std::byte>>> files(options.meshes, std::vector<std::byte>());
  runtime::parallel_for(files.size(), threads,
                        [&](uint64_t i) { files[i] = make_jpeg(static_cast<uint32_t>(i), options, stones); });
  GltfWriter writer = SCREE_TRY(GltfWriter::create(options.output));
  TexturedReport report;
  GltfScene scene{.name = "textured"};
  for (uint32_t i = 0; i < options.meshes; ++i) {
    if (!files[i]) return files[i].error();
    report.texture_bytes += files[i]->size();
    const std::string name = "texture" + std::to_string(i);
    const uint32_t image = SCREE_TRY(writer.add_image(name, format::ImageCodec::kJpeg, *files[i]));
    files[i] = std::vector<std::byte>{};
    GltfMaterial material{.texture = writer.add_texture(trilinear(image, {}, format::Wrap::kClamp))};
    SCREE_TRY(add_tile(writer, i, writer.add_material(std::move(material))));
    scene.nodes.push_back(writer.add_node({.name = "tile " + std::to_string(i), .mesh = i}));
    report.triangles += uint64_t{2} * kQuads * kQuads;
  }
  writer.add_scene(std::move(scene));
  SCREE_TRY(writer.finish());
  return report;
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left for " + std::to_string(options.meshes) + " textures"};
}

}  // namespace scree::synth
