// Scenes of block-compressed textures, for the tests that draw them.
#pragma once

#include <string>
#include <vector>

#include "tests/runtime/frame.h"
#include "tests/runtime/images/block_files.h"
#include "tests/runtime/load_scene.h"
#include "tests/tools/model_maker.h"

namespace scree::tests {

/// Grids side by side, of `side` quads per side, each with one of the files as its texture.
inline void make_block_model(const std::string& path, const std::vector<FileBytes>& files, uint32_t side = 4) {
  ModelMaker maker(path);
  for (size_t i = 0; i < files.size(); ++i) {
    GridSpec spec{.columns = side, .rows = side};
    spec.origin = {1.1f * static_cast<float>(i % 3), 0, 1.1f * static_cast<float>(i / 3)};
    spec.uv = true;
    spec.normal = side > 4;  // more bytes
    const std::string number = std::to_string(i);
    const uint32_t material = maker.textured("i" + number, format::ImageCodec::kBlocks, files[i]);
    maker.draw("n" + number, {maker.grid(spec, material)});
  }
  maker.finish();
}

/// The files of block_files(), without their names.
inline std::vector<FileBytes> all_block_files() {
  std::vector<FileBytes> files;
  for (auto& [name, bytes] : block_files()) files.push_back(std::move(bytes));
  return files;
}

/// Levels in one page and in several, of all block sizes, with and without the levels of the source. `count`: at
/// most 5.
inline std::vector<FileBytes> large_block_files(size_t count = 5) {
  using format::BlockFormat;
  std::vector<FileBytes> files{
      make_ktx2({.width = 1024, .height = 1024, .levels = 11, .scheme = 2}),
      make_dds({.format = BlockFormat::kBc1, .width = 700, .height = 1300, .levels = 3, .seed = 2}, 71),
      make_ktx2({.vk_format = 37, .model = 1, .format = BlockFormat::kRgba8, .width = 300, .height = 301, .seed = 3}),
      make_ktx2({.vk_format = 9, .model = 1, .format = BlockFormat::kR8, .width = 513, .height = 700, .levels = 10}),
      make_ktx2({.width = 64, .height = 64, .levels = 7, .seed = 4})};
  files.resize(count);
  return files;
}

/// The picture of a scene by its default camera.
inline std::vector<uint8_t> draw_scene(const runtime::Scene& scene, uint32_t width,
                                       runtime::DeviceView* device = nullptr) {
  return must_picture(scene, must_view(scene, {.width = width, .height = width * 2 / 3}), 1, device);
}

}  // namespace scree::tests
