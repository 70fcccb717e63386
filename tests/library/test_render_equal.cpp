// A frame of the library equals the output of `scree render` bit for bit.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "runtime/images/image.h"
#include "tests/library/handles.h"
#include "tests/results.h"
#include "tests/sanitized.h"
#include "tests/tools/run_program.h"

using namespace scree::tests;
namespace fs = std::filesystem;

namespace {

/// The values of a PFM, rows from the top. `channels`: 1 or 3 per pixel.
std::string pfm_values(const std::string& bytes, uint32_t width, uint32_t height, uint32_t channels = 1) {
  const std::string head_text =
      (channels == 1 ? "Pf\n" : "PF\n") + std::to_string(width) + " " + std::to_string(height) + "\n-1.0\n";
  REQUIRE(bytes.starts_with(head_text));
  const size_t head = head_text.size();
  const size_t row = 4 * size_t{width} * channels;
  REQUIRE(bytes.size() == head + row * height);
  std::string values;
  for (size_t y = height; y-- > 0;) values += bytes.substr(head + y * row, row);
  return values;
}

/// One way to draw, for the command and for the library.
struct Way {
  std::vector<std::string> words;
  scree_load_options load = sized<scree_load_options>();
  scree_camera camera = sized<scree_camera>();
  scree_draw_options draw = sized<scree_draw_options>();
};

/// A Radiance picture: four columns and two rows of different lights.
std::string surroundings(const TempFolder& folder) {
  std::string text = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n";
  for (char i = 0; i < 8; ++i)
    text += {static_cast<char>(100 + 10 * i), static_cast<char>(120 - 9 * i), 90, static_cast<char>(127 + i % 3)};
  return folder.write("surroundings.hdr", text);
}

/// Whether the file has a directional light.
bool has_sun(const std::string& file) {
  const Opened opened(file);
  scree_draw_options options = draw_options(1, 1);
  options.light = SCREE_LIGHT_SCENE;
  options.flags = SCREE_SHADOWS;
  return scree_draw(opened.view, nullptr, &options) == SCREE_OK;
}

constexpr size_t kWays = 6;

/// One of the ways to draw. Together they have every option of `scree render` that changes a picture. `file`: the
/// scene; `--light scene` requires that it has lights.
Way way_of(const TempFolder& folder, const std::string& file, size_t number, std::string& environment) {
  Way way;
  switch (number % kWays) {
    case 1:
      environment = surroundings(folder);
      way.words = words_of("--environment " + environment + " --exposure 1.25 --ssao --blend-layers 1");
      way.load.environment = environment.c_str();
      way.draw.exposure = 1.25;
      way.draw.flags = SCREE_SSAO;
      way.draw.blend_layers = 1;
      break;
    case 2:
      way.words = words_of("--light camera --view top --up 0,0,-1 --edl --edl-strength 2.5 --edl-radius 3");
      way.draw.light = SCREE_LIGHT_CAMERA;
      way.camera.kind = SCREE_CAMERA_AROUND;
      way.camera.rise_degrees = 90;
      way.camera.up[2] = -1;
      way.draw.flags = SCREE_EDL;
      way.draw.edl_strength = 2.5f;
      way.draw.edl_radius = 3;
      break;
    case 3: {
      const scree_scene_stats stats = stats_of(Opened(file).scene);
      way.words = words_of("--exposure -2 --view left --fov 70 --texture-memory 1MiB --texture-cache 1 --light " +
                           std::string(stats.lights != 0 ? "scene" : "environment"));
      if (has_sun(file)) {
        way.words.insert(way.words.end(), {"--shadows", "--shadow-size", "333"});
        way.draw.flags = SCREE_SHADOWS;
        way.draw.shadow_size = 333;
      }
      way.load.light = SCREE_LIGHT_ENVIRONMENT;
      way.load.texture_memory = 1 << 20;
      way.load.texture_cache = 1;
      way.draw.light = stats.lights != 0 ? SCREE_LIGHT_SCENE : SCREE_LIGHT_AUTO;
      way.draw.exposure = -2;
      way.camera.kind = SCREE_CAMERA_AROUND;
      way.camera.turn_degrees = -90;
      way.camera.fov_degrees = 70;
      break;
    }
    case 4:
      way.words = words_of("--no-light --blend-layers 0 --show color --view iso");
      way.load.texture_cache = uint64_t{1} << 40;  // more than there is; the scene needs less
      way.draw.show = SCREE_SHOW_COLOR;
      way.draw.flags = SCREE_NO_LIGHT | SCREE_NO_BLEND;
      way.camera.kind = SCREE_CAMERA_AROUND;
      way.camera.turn_degrees = 45;
      way.camera.rise_degrees = 35.26438968275465;
      break;
    case 5: {  // the lower left part of the scene, from the right, so that its inside is visible
      const scree_scene_stats stats = stats_of(Opened(file).scene);
      std::string box;
      way.camera.kind = SCREE_CAMERA_AROUND;
      way.camera.turn_degrees = 90;
      way.camera.clips = 1;
      for (size_t i = 0; i < 6; ++i) {
        const size_t axis = i % 3;
        const bool is_empty = !(stats.box_min[axis] <= stats.box_max[axis]);
        const double low = is_empty ? 0 : stats.box_min[axis], side = is_empty ? 1 : stats.box_max[axis] - low;
        const double place = low + (i < 3 ? -0.25 : 0.625) * (side > 0 ? side : 1);
        double* const corner = i < 3 ? way.camera.clip_min : way.camera.clip_max;
        corner[axis] = place;
        char text[32];
        std::snprintf(text, sizeof text, "%.17g", place);
        box += (i == 0 ? "" : ",") + std::string(text);
      }
      way.words = {"--clip-box=" + box, "--view", "right", "--ssao"};
      way.draw.flags = SCREE_SSAO;
      break;
    }
    default:
      break;
  }
  way.load.backend = SCREE_BACKEND_CPU;
  way.load.threads = 2;
  return way;
}

/// Compares the output of `render` for `file` with the library's frame, drawn in one of kWays ways.
void compare(const TempFolder& folder, const std::string& file, uint32_t samples, size_t number) {
  const uint32_t width = 97, height = 61;
  const std::string picture = folder.file("a.png"), depth = folder.file("a.pfm"), visibility = folder.file("a.vis");
  const std::string normals = folder.file("n.pfm"), uvs = folder.file("uv.pfm");
  std::string environment;
  Way way = way_of(folder, file, number, environment);
  std::vector<std::string> words =
      words_of("render " + file + " -o " + picture + " --depth " + depth + " --visbuffer " + visibility +
               " --normals " + normals + " --uvs " + uvs + " --size 97x61 --samples " + std::to_string(samples) +
               " --background none --backend cpu --threads 2 --force --quiet");
  words.insert(words.end(), way.words.begin(), way.words.end());
  const ProgramRun run = run_program(words, folder.file("log"));
  INFO("way " << number % kWays << ": " << run.output);
  REQUIRE(run.exit_code == 0);

  const Opened opened(file, way.load);
  way.draw.width = width;
  way.draw.height = height;
  way.draw.samples = samples;
  must(scree_draw(opened.view, &way.camera, &way.draw));
  CHECK(layer_of(opened.view, SCREE_SAMPLES) == read_whole(visibility));
  CHECK(layer_of(opened.view, SCREE_DEPTH) == pfm_values(read_whole(depth), width, height));
  CHECK(layer_of(opened.view, SCREE_NORMAL) == pfm_values(read_whole(normals), width, height, 3));
  const std::string wide = pfm_values(read_whole(uvs), width, height, 3);
  std::string uv;
  for (size_t i = 0; i < wide.size(); i += 12) uv += wide.substr(i, 8);
  CHECK(layer_of(opened.view, SCREE_UV) == uv);
  const std::string png = read_whole(picture);
  const scree::runtime::Image image = must(scree::runtime::decode_image(std::as_bytes(std::span(png))));
  const std::string color = layer_of(opened.view, SCREE_COLOR);
  CHECK(std::equal(color.begin(), color.end(), image.rgba.begin(), image.rgba.end(),
                   [](char a, uint8_t b) { return static_cast<uint8_t>(a) == b; }));
}

/// Checks the layers of ids and depths, which show a pixel's nearest sample.
void check_layers(const std::string& file) {
  const Opened opened(file);
  draw(opened.view, draw_options(50, 40, 2));
  const auto samples = values_of<uint64_t>(layer_of(opened.view, SCREE_SAMPLES));
  const auto triangles = values_of<int64_t>(layer_of(opened.view, SCREE_TRIANGLE));
  const auto instances = values_of<int32_t>(layer_of(opened.view, SCREE_INSTANCE));
  const auto depths = values_of<float>(layer_of(opened.view, SCREE_DEPTH));
  const scree_scene_stats stats = stats_of(opened.scene);
  size_t covered = 0;
  for (size_t y = 0; y < 40; ++y) {
    for (size_t x = 0; x < 50; ++x) {
      const size_t pixel = y * 50 + x;
      const uint64_t nearest = std::min({samples[2 * y * 100 + 2 * x], samples[2 * y * 100 + 2 * x + 1],
                                         samples[(2 * y + 1) * 100 + 2 * x], samples[(2 * y + 1) * 100 + 2 * x + 1]});
      if (nearest == ~uint64_t{0}) {
        CHECK((triangles[pixel] == -1 && instances[pixel] == -1 && std::isinf(depths[pixel])));
        continue;
      }
      ++covered;
      CHECK(triangles[pixel] == static_cast<int64_t>(nearest & ((uint64_t{1} << 36) - 1)));
      REQUIRE((instances[pixel] >= 0 && static_cast<uint64_t>(instances[pixel]) < stats.instances));
      auto info = sized<scree_instance_info>(), next = info;
      must(scree_get_instance_info(opened.scene, static_cast<uint64_t>(instances[pixel]), &info));
      CHECK(info.first_triangle <= static_cast<uint64_t>(triangles[pixel]));
      if (static_cast<uint64_t>(instances[pixel]) + 1 < stats.instances) {
        must(scree_get_instance_info(opened.scene, static_cast<uint64_t>(instances[pixel]) + 1, &next));
        CHECK(next.first_triangle > static_cast<uint64_t>(triangles[pixel]));
      }
      const scree_pick_info pick = pick_at(opened.view, static_cast<uint32_t>(x), static_cast<uint32_t>(y));
      if (pick.hit != 0) CHECK(pick.depth >= static_cast<double>(depths[pixel]) * (1 - 1e-6));
    }
  }
  CHECK(covered > 0);
}

uint64_t folder_bytes(const fs::path& folder) {
  uint64_t bytes = 0;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder))
    if (entry.is_regular_file()) bytes += entry.file_size();
  return bytes;
}

/// Compares every model below `root` whose folder has at most `most_bytes`. Returns the number of models.
size_t compare_all(const fs::path& root, uint64_t most_bytes) {
  const TempFolder folder;
  size_t compared = 0;
  for (const fs::path& model : model_files(root)) {
    if (folder_bytes(model.parent_path()) > most_bytes) continue;
    INFO(model.string());
    const std::string file = folder.file("model.scree");
    auto options = sized<scree_convert_options>();
    options.flags = SCREE_CONVERT_REPLACE | (compared % 2 == 0 ? SCREE_CONVERT_NORMALS : 0) |
                    (compared % 3 == 0 ? SCREE_CONVERT_INDEXED : 0);
    options.threads = 2;
    // Draco and other input may not be supported.
    if (scree_convert(model.c_str(), file.c_str(), &options, nullptr) != SCREE_OK) continue;
    compare(folder, file, compared % 4 == 0 ? 2 : 1, compared);
    ++compared;
  }
  return compared;
}

}  // namespace

TEST_CASE("a frame of the library equals the output of scree render", "[library]") {
  CHECK(compare_all(kDataFolder, ~uint64_t{0}) >= 12);
}

TEST_CASE("a frame of every small real model equals the output of scree render", "[library][models]") {
  const fs::path models = real_models("");
  if (models.empty()) return;
  CHECK(compare_all(models / "scenes", kIsSanitized ? 5000 : 50000) >= 10);
  CHECK(compare_all(models / "scenes-material", kIsSanitized ? 5000 : 50000) >= 3);
}

TEST_CASE("a frame of one model equals the output of scree render, with all options", "[library]") {
  const TempFolder folder;
  const std::string glass = packed(folder, "glass.glb"), materials = packed(folder, "materials.gltf");
  const std::string sun = packed(folder, "sun.glb");
  REQUIRE(has_sun(sun));
  for (size_t way = 0; way < kWays; ++way) {
    compare(folder, glass, 2, way);
    compare(folder, materials, 1, way);
    compare(folder, sun, 2, way);
  }
}

// Takes minutes; run it by name.
TEST_CASE("a frame of every real model equals the output of scree render", "[.][library-models]") {
  const fs::path models = models_path();
  REQUIRE(!models.empty());
  const size_t compared =
      compare_all(models / "scenes", ~uint64_t{0}) + compare_all(models / "scenes-material", ~uint64_t{0});
  WARN(compared << " models");
  CHECK(compared >= 100);
}

TEST_CASE("layers show the nearest sample of a pixel", "[library]") {
  const TempFolder folder;
  check_layers(packed(folder, "two_instances.gltf"));
  check_layers(packed(folder, "gpu_instancing.glb", SCREE_CONVERT_INDEXED));
}
