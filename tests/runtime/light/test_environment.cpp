// Environments: uniform light stays uniform, directions are right, and the number of threads changes nothing.
#include "runtime/light/environment.h"

#include <fstream>
#include <functional>

#include "kernels/shade/environment.h"
#include "tests/results.h"
#include "tests/tools/temp_folder.h"

using namespace scree;
using namespace scree::runtime;
using tests::TempFolder;

namespace {

/// A picture of 64 x 32 pixels. Pixels for which `bright(x, y)` is true have light 2, the others nearly 0.
std::string write_panorama(const TempFolder& folder, const std::function<bool(int, int)>& bright) {
  std::string text = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 32 +X 64\n";
  for (int y = 0; y < 32; ++y) {
    text += std::string("\2\2\0\x40", 4);
    for (int channel = 0; channel < 4; ++channel) {
      text += '\x40';
      for (int x = 0; x < 64; ++x) text += channel < 3 ? '\x7f' : bright(x, y) ? '\x82' : '\1';
    }
  }
  return folder.write("around.hdr", text);
}

constexpr float kBright = 127.5f / 64;

}  // namespace

TEST_CASE("environment: uniform light stays uniform at every roughness", "[environment]") {
  const TempFolder folder;
  const auto made = must(load_environment(write_panorama(folder, [](int, int) { return true; }), 2));
  REQUIRE(made.size() == kernels::kEnvironmentFloats);
  for (uint32_t level = 0; level < kernels::kEnvironmentLevels; ++level) {
    const uint32_t side = kernels::environment_side(level);
    for (uint32_t i = 0; i < side * side; ++i)
      for (uint32_t c = 0; c < 3; ++c)
        REQUIRE(made[kernels::environment_offset(level) + 4 * i + c] == Approx(kBright).epsilon(1e-4));
  }
  for (const std::array<float, 3>& n : {std::array<float, 3>{0, 1, 0}, {0, -1, 0}, {0.6f, 0, -0.8f}}) {
    float rgb[3];
    kernels::diffuse_environment(made.data(), n.data(), rgb);
    CHECK(rgb[1] == Approx(kBright).epsilon(2e-3));
  }
}

TEST_CASE("environment: -z is in the middle of the picture, +x on the right, y up", "[environment]") {
  const TempFolder folder;
  const auto light = [&](const std::vector<float>& made, float x, float y, float z, float roughness) {
    const float direction[3] = {x, y, z};
    float rgb[3];
    kernels::reflected_light(made.data(), direction, roughness, rgb);
    return rgb[0];
  };
  const auto front = must(load_environment(write_panorama(folder, [](int x, int) { return x >= 24 && x < 40; }), 1));
  const auto right = must(load_environment(write_panorama(folder, [](int x, int) { return x >= 40 && x < 56; }), 1));
  const auto above = must(load_environment(write_panorama(folder, [](int, int y) { return y < 16; }), 1));
  for (const float roughness : {0.0f, 0.2f, 0.5f}) {
    CHECK(light(front, 0, 0, -1, roughness) > 10 * light(front, 0, 0, 1, roughness));
    CHECK(light(right, 1, 0, 0, roughness) > 10 * light(right, -1, 0, 0, roughness));
    CHECK(light(above, 0, 1, 0, roughness) > 10 * light(above, 0, -1, 0, roughness));
  }
  CHECK(light(front, 0, 0, -1, 0) == Approx(kBright).epsilon(1e-3));
  // Higher roughness blurs the light but loses none: half of the directions are lit.
  CHECK(light(above, 1, 0, 0, 1) == Approx(kBright / 2).epsilon(0.1));
  float rgb[3];
  const float up[3] = {0, 1, 0};
  kernels::diffuse_environment(above.data(), up, rgb);
  CHECK(rgb[0] == Approx(kBright).epsilon(0.05));
}

TEST_CASE("environment: octahedral coordinates and directions are inverse maps", "[environment]") {
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      const float u = (static_cast<float>(x) + 0.5f) / 64, v = (static_cast<float>(y) + 0.5f) / 64;
      float direction[3], place[2];
      kernels::octahedral_direction(u, v, direction);
      kernels::octahedral_place(direction, place);
      CHECK(place[0] == Approx(u).margin(1e-6));
      CHECK(place[1] == Approx(v).margin(1e-6));
    }
  }
}

TEST_CASE("environment: the sky is the same for any number of threads, and bright from above", "[environment]") {
  const std::vector<float> sky = make_sky(1);
  CHECK(sky == make_sky(3));
  float above[3], below[3];
  const float up[3] = {0, 1, 0}, down[3] = {0, -1, 0};
  kernels::diffuse_environment(sky.data(), up, above);
  kernels::diffuse_environment(sky.data(), down, below);
  CHECK(above[0] > 0.7f);
  CHECK(above[0] < 1.3f);
  CHECK(below[0] < 0.6f * above[0]);
}

TEST_CASE("environment: a bad file is named", "[environment]") {
  const TempFolder folder;
  const std::string path = folder.file("bad.hdr");
  std::ofstream(path) << "no picture";
  CHECK(refusal(load_environment(path, 1)).message.starts_with(path + ": HDR: "));
  CHECK(!load_environment(folder.file("none.hdr"), 1));
}
