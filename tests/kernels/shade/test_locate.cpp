// Finished pixels on the CPU: the mean of their samples, and single precision compared with double precision.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <random>
#include <vector>

#include "runtime/scene/camera.h"
#include "runtime/scene/scene.h"
#include "runtime/textures/srgb.h"
#include "tests/kernels/scene_builder.h"
#include "tests/kernels/shade/reference_shade.h"
#include "tests/kernels/shade_samples.h"
#include "tests/models.h"
#include "tests/tools/temp_folder.h"
#include "tools/convert/convert.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;

namespace {

/// Noise of `side` x `side` texels with its mip levels, each the plain mean of the next finer one.
struct NoiseTexture {
  explicit NoiseTexture(uint32_t side) {
    std::mt19937 random(7);
    view.width = view.height = side;
    std::vector<uint8_t> level(size_t{4} * side * side);
    for (uint8_t& value : level) value = static_cast<uint8_t>(random());
    for (;; side /= 2) {
      view.level_offset[view.level_count++] = texels.size() / 4;
      texels.insert(texels.end(), level.begin(), level.end());
      if (side == 1) break;
      std::vector<uint8_t> half(level.size() / 4);
      for (size_t y = 0; y < side / 2; ++y)
        for (size_t x = 0; x < side / 2; ++x)
          for (size_t c = 0; c < 4; ++c) {
            const auto at = [&](size_t i, size_t j) {
              return uint32_t{level[4 * ((2 * y + j) * side + 2 * x + i) + c]};
            };
            half[4 * (y * (side / 2) + x) + c] = static_cast<uint8_t>((at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1)) / 4);
          }
      level = half;
    }
    view.texels = texels.data();
  }
  std::vector<uint8_t> texels;
  TextureView view{};
};

struct Difference {
  uint64_t covered = 0;
  uint64_t over = 0;  // samples with a channel that is off by more than one level
};

/// Compares the picture's shaded samples with the double-precision reference, both as 8-bit codes.
Difference against_double(const SceneView& scene, const View& view) {
  const std::vector<uint64_t> samples = draw(scene, view);
  std::vector<float> rgba(4 * samples.size());
  scree::tests::shade_samples(scene, view, samples, ShadeOptions{}, rgba);
  const SrgbTables tables = make_srgb_tables();
  Difference out;
  for (uint32_t y = 0; y < view.height; ++y)
    for (uint32_t x = 0; x < view.width; ++x) {
      const size_t i = size_t{y} * view.width + x;
      if (samples[i] == kBackground) continue;
      const Light light = reference_light(scene, view, samples[i], x, y, tables.linear);
      bool over = false;
      for (size_t c = 0; c < 3; ++c)
        over = over || std::abs(runtime::srgb_of_linear(rgba[4 * i + c]) -
                                runtime::srgb_of_linear(static_cast<float>(light[c]))) > 1;
      ++out.covered;
      out.over += over ? 1 : 0;
    }
  return out;
}

/// Allows 0.01% of the samples, and for a small picture a few samples.
void check_against_double(const SceneView& scene, const View& view, Difference& total) {
  const Difference found = against_double(scene, view);
  CHECK(found.covered > 100);
  CHECK(found.over <= std::max<uint64_t>(found.covered / 10000, 3));
  total.covered += found.covered;
  total.over += found.over;
}
void check_total(const Difference& total) {
  INFO(total.over << " of " << total.covered);
  CHECK(total.over <= total.covered / 10000);
}

/// Gives a soup texture coordinates: x and z, with `repeats` per unit.
void add_uvs(Soup& soup, float repeats) {
  for (size_t v = 0; v < soup.positions.size(); v += 3) {
    soup.uvs.push_back(soup.positions[v] * repeats);
    soup.uvs.push_back(soup.positions[v + 2] * repeats);
  }
}

}  // namespace

TEST_CASE("resolve: a pixel is the mean of its samples' light, for every kind of picture", "[resolve]") {
  SceneBuilder builder;
  const NoiseTexture texture(64);
  Soup soup = sphere(20, 0.2);
  add_uvs(soup, 1.5f);
  const Encoding encoding{.material = builder.material(0)};
  builder.materials[0].texture = 0;
  builder.textures.push_back(texture.view);
  const uint32_t mesh = builder.mesh(soup, encoding);
  builder.instance(mesh, builder.identity());
  builder.instance(mesh, builder.matrix({0.5, 0, 0, 1, 0, 0.5, 0, 0.3, 0, 0, 0.5, 0.4}));
  const SceneView scene = builder.view();
  for (const bool flat : {false, true}) {
    for (const uint32_t side : {1u, 2u, 4u}) {
      View view = look_at({0.3, 1, 3}, {0, 0, 0}, 61 * side, 43 * side);
      if (flat) view = orthographic(view, 1.5, 0.1, 10);
      const std::vector<uint64_t> samples = draw(scene, view);
      std::vector<float> rgba(4 * samples.size());
      for (const Show show : {Show::kTexture, Show::kColor, Show::kUv, Show::kNormal, Show::kTriangle, Show::kCluster,
                              Show::kMesh, Show::kStage, Show::kDepth}) {
        ShadeOptions options{.show = show};
        options.background[0] = 0.25f;
        options.background[3] = 0.5f;
        scree::tests::shade_samples(scene, view, samples, options, rgba);
        std::vector<uint8_t> pixels(size_t{4} * 61 * 43);
        REQUIRE(resolve_cpu(scene, view, side, samples, options, 4, pixels, 3));
        std::vector<uint8_t> opaque(size_t{3} * 61 * 43);
        REQUIRE(resolve_cpu(scene, view, side, samples, options, 3, opaque, 1));
        for (uint32_t y = 0; y < 43; ++y)
          for (uint32_t x = 0; x < 61; ++x) {
            double sum[4] = {0, 0, 0, 0};
            for (uint32_t j = 0; j < side; ++j)
              for (uint32_t i = 0; i < side; ++i) {
                const float* sample = &rgba[4 * (size_t{y * side + j} * view.width + x * side + i)];
                for (int c = 0; c < 3; ++c) sum[c] += static_cast<double>(sample[3]) * static_cast<double>(sample[c]);
                sum[3] += static_cast<double>(sample[3]);
              }
            const size_t at = size_t{y} * 61 + x;
            for (size_t c = 0; c < 3; ++c) {
              const int expected = runtime::srgb_of_linear(static_cast<float>(sum[c] / sum[3]));
              REQUIRE(std::abs(pixels[4 * at + c] - expected) <= (side == 1 ? 0 : 1));
              REQUIRE(opaque[3 * at + c] == pixels[4 * at + c]);
            }
            REQUIRE(pixels[4 * at + 3] == std::lrint(sum[3] / (side * side) * 255));
          }
      }
    }
  }
}

TEST_CASE("resolve: occlusion darkens surfaces, not the background", "[resolve]") {
  SceneBuilder builder(grid(12, 0.4));
  const SceneView scene = builder.view();
  const View view = look_at({0.3, 1, 2}, {0, 0, 0}, 240, 160);
  const std::vector<uint64_t> samples = draw(scene, view);
  ShadeOptions options;
  options.background[2] = 0.5f;
  options.background[3] = 1;
  options.ssao = options.edl = true;
  std::vector<float> factors(120 * 80);
  REQUIRE(occlusion_cpu(view, 2, samples, options, factors, 1));
  std::vector<float> rgba(4 * samples.size());
  scree::tests::shade_samples(scene, view, samples, options, rgba);
  std::vector<uint8_t> pixels(3 * factors.size());
  REQUIRE(resolve_cpu(scene, view, 2, samples, options, 3, pixels, 1));
  uint32_t darkened = 0;
  for (uint32_t y = 0; y < 80; ++y)
    for (uint32_t x = 0; x < 120; ++x) {
      const size_t at = size_t{y} * 120 + x;
      double sum[3] = {0, 0, 0};
      for (uint32_t s = 0; s < 4; ++s) {
        const size_t sample = size_t{2 * y + s / 2} * 240 + 2 * x + s % 2;
        const double factor = samples[sample] == kBackground ? 1 : static_cast<double>(factors[at]);
        for (size_t c = 0; c < 3; ++c) sum[c] += factor * static_cast<double>(rgba[4 * sample + c]) / 4;
      }
      darkened += factors[at] < 0.8f ? 1 : 0;
      for (size_t c = 0; c < 3; ++c)
        REQUIRE(std::abs(pixels[3 * at + c] - runtime::srgb_of_linear(static_cast<float>(sum[c]))) <= 1);
    }
  CHECK(darkened > 100);
}

TEST_CASE("resolve: buffers of different sizes are refused", "[resolve]") {
  SceneBuilder builder(grid(2, 0));
  const View view = look_at({0, 1, 2}, {0, 0, 0}, 12, 8);
  const std::vector<uint64_t> samples = draw(builder.view(), view);
  std::vector<uint8_t> pixels(3 * 12 * 8);
  const auto resolved = [&](uint32_t side, uint32_t channels, size_t bytes) {
    pixels.resize(bytes);
    return static_cast<bool>(resolve_cpu(builder.view(), view, side, samples, ShadeOptions{}, channels, pixels, 1));
  };
  CHECK(resolved(1, 3, 3 * 12 * 8));
  CHECK(resolved(4, 4, 4 * 3 * 2));
  CHECK_FALSE(resolved(3, 4, 4 * 4 * 2));
  CHECK_FALSE(resolved(0, 4, 4 * 12 * 8));
  CHECK_FALSE(resolved(1, 2, 2 * 12 * 8));
  CHECK_FALSE(resolved(1, 3, 3 * 12 * 8 - 1));
  pixels.resize(3 * 12 * 8);
  CHECK_FALSE(resolve_cpu(builder.view(), view, 1, std::span(samples).first(95), ShadeOptions{}, 3, pixels, 1));
}

TEST_CASE("resolve: sRGB codes equal the formula's, at every border", "[resolve]") {
  const SrgbTables tables = make_srgb_tables();
  for (uint32_t code = 0; code < 256; ++code) {
    CHECK(srgb_code(tables, tables.linear[code]) == code);
    if (code == 0) continue;
    CHECK(srgb_code(tables, tables.first_light[code]) == code);
    CHECK(srgb_code(tables, std::nextafter(tables.first_light[code], 0.0f)) == code - 1);
  }
  CHECK(srgb_code(tables, -1) == 0);
  CHECK(srgb_code(tables, NAN) == 0);
  CHECK(srgb_code(tables, 7) == 255);
}

TEST_CASE("resolve: single precision is within a level of double", "[resolve]") {
  const NoiseTexture texture(256);
  Difference total;
  for (const bool normals : {false, true}) {
    for (const bool float32 : {false, true}) {
      // Small triangles near and far, large ones, and ones far from the origin or the camera. Edges keep their shape
      // even if the lattice is far away from the camera.
      for (const double distance : {2.5, 40.0, 4000.0}) {
        for (const double origin : {0.0, 1e7}) {
          SceneBuilder builder;
          Soup soup = sphere(24, 0.1);
          add_uvs(soup, 3);
          if (normals)
            for (float c : soup.positions) soup.normals.push_back(c);
          for (size_t v = 0; v < soup.positions.size() / 3; ++v)
            soup.colors.insert(soup.colors.end(), {0.3f, 0.1f * static_cast<float>(v % 10), 1, 1});
          const Encoding encoding{.float32 = float32, .material = builder.material(0)};
          builder.materials[0].texture = 0;
          builder.materials[0].uv_rotation = 0.3f;
          builder.materials[0].uv_offset[0] = 11;
          builder.textures.push_back(texture.view);
          builder.instance(builder.mesh(soup, encoding),
                           builder.matrix({1, 0.2, 0, origin, 0, 0.8, 0, 0, 0, 0, -1, 0}));
          View view = look_at({origin, 0.3 * distance, distance}, {origin, 0, 0}, 150, 150, 0.01 * distance,
                              2 * std::atan(1.3 / distance));
          INFO("normals " << normals << " float32 " << float32 << " distance " << distance << " origin " << origin);
          check_against_double(builder.view(), view, total);
          check_against_double(builder.view(), orthographic(view, 1.3, 0.1, 2 * distance), total);
        }
      }
    }
  }
  check_total(total);
}

TEST_CASE("resolve: a wide ground of two triangles is as sharp as in double precision", "[resolve]") {
  const NoiseTexture texture(1024);
  Difference total;
  for (const double reach : {1.0, 100.0, 10000.0}) {
    Soup soup;
    for (const double x : {-reach, reach})
      for (const double z : {-reach, reach}) soup.add(x, 0, z);
    soup.triangle(0, 1, 3);
    soup.triangle(0, 3, 2);
    add_uvs(soup, 1);
    for (const bool float32 : {false, true}) {
      SceneBuilder builder;
      const Encoding encoding{.float32 = float32,
                              .exponent = -9,
                              .material = builder.material(format::kMaterialDoubleSided | format::kMaterialUnlit)};
      builder.materials[0].texture = 0;
      builder.textures.push_back(texture.view);
      builder.instance(builder.mesh(soup, encoding), builder.identity());
      for (const double height : {2.0, 0.05}) {
        INFO("reach " << reach << " float32 " << float32 << " height " << height);
        check_against_double(builder.view(), look_at({0.3, height, 0.1}, {0.4, 0, 0.7}, 300, 200, 0.001), total);
      }
    }
  }
  check_total(total);
}

TEST_CASE("resolve: real models are within a level of double", "[resolve][models]") {
  std::vector<std::filesystem::path> sources;
  for (const auto& entry : std::filesystem::directory_iterator(tests::kDataFolder)) sources.push_back(entry.path());
  if (models_path().empty()) {
    WARN("skipped: no real models beside the checkout; those of tests/data alone");
  } else {
    for (const char* name : {"DamagedHelmet", "Duck", "Fox", "MultiUVTest", "BoxVertexColors", "sponza"}) {
      const std::filesystem::path folder = models_path() / "scenes" / name;
      if (!std::filesystem::exists(folder)) continue;
      for (const auto& entry : std::filesystem::directory_iterator(folder)) sources.push_back(entry.path());
    }
  }
  uint32_t compared = 0;
  Difference total;
  for (const std::filesystem::path& source : sources) {
    if (source.extension() != ".glb" && source.extension() != ".gltf") continue;
    INFO(source.string());
    const TempFolder folder;
    convert::ConvertOptions options;
    options.input = source.string();
    options.output = folder.file("scene.scree");
    if (!convert::convert(options)) continue;
    runtime::SceneFile file = must(runtime::SceneFile::open(options.output));
    const Result<runtime::Scene> scene = runtime::Scene::load(std::move(file), 0, {true, 2});
    if (!scene || scene->view().blend_masks != nullptr) continue;  // layers are tested in test_blend.cpp
    const Result<View> view = runtime::make_view(*scene, {.width = 320, .height = 200});
    if (!view) continue;
    SceneView plain = scene->view();  // base colours under the camera's light, the only light of the reference
    plain.surface_count = 0;
    plain.environment = nullptr;
    check_against_double(plain, *view, total);
    ++compared;
  }
  CHECK(compared >= 5);
  check_total(total);
}
