#include <random>
#include <set>

#include "tests/kernels/shade_samples.h"
#include "tests/kernels/square.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;

namespace {

double linear(double code) {
  const double value = code / 255;
  return value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4);
}

/// A texture of `side` with all mip levels. Level 0 is `texels` (RGBA8), the others are one grey each: 10 * level.
struct Texture {
  Texture(uint32_t side, std::vector<uint8_t> level0) : texels(std::move(level0)) {
    view.width = view.height = side;
    view.wrap_s = view.wrap_t = format::Wrap::kRepeat;
    view.level_count = 0;
    uint64_t offset = 0;
    for (uint32_t s = side;; s /= 2) {
      view.level_offset[view.level_count] = offset;
      if (view.level_count > 0)
        texels.resize(texels.size() + size_t{4} * s * s, static_cast<uint8_t>(10 * view.level_count));
      offset += uint64_t{s} * s;
      ++view.level_count;
      if (s == 1) break;
    }
    view.texels = texels.data();
  }
  std::vector<uint8_t> texels;
  TextureView view{};
};

std::vector<uint8_t> noise(uint32_t side, uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<uint8_t> out(size_t{4} * side * side);
  for (uint8_t& value : out) value = static_cast<uint8_t>(random());
  return out;
}

View front(uint32_t side) {
  return orthographic(look_at({0, 0, 1}, {0, 0, 0}, side, side), 1, 0, 2);
}

std::vector<float> shaded(const SceneView& scene, const View& view, const ShadeOptions& options) {
  const std::vector<uint64_t> samples = draw(scene, view);
  std::vector<float> rgba(4 * samples.size());
  scree::tests::shade_samples(scene, view, samples, options, rgba);
  return rgba;
}

struct TexturedSquare {
  TexturedSquare(const Soup& soup, const Texture& texture) {
    encoding.material = builder.material(format::kMaterialUnlit);
    builder.materials[0].texture = 0;
    builder.textures.push_back(texture.view);
    builder.instance(builder.mesh(soup, encoding), builder.identity());
  }
  SceneBuilder builder;
  Encoding encoding;
};

void check_close(const std::vector<float>& a, const std::vector<float>& b, double margin) {
  REQUIRE(a.size() == b.size());
  double worst = 0;
  for (size_t i = 0; i < a.size(); ++i)
    worst = std::max(worst, std::fabs(static_cast<double>(a[i]) - static_cast<double>(b[i])));
  CHECK(worst <= margin);
}

}  // namespace

TEST_CASE("shade: a texture with one texel per pixel is shown exactly", "[shade]") {
  const uint32_t side = 16;
  const Texture texture(side, noise(side, 1));
  TexturedSquare square_scene(square(0, 0, 1, 1), texture);
  for (bool nearest : {false, true}) {
    square_scene.builder.textures[0].magnified_nearest = nearest;
    const std::vector<float> rgba = shaded(square_scene.builder.view(), front(side), ShadeOptions{});
    for (size_t i = 0; i < size_t{side} * side; ++i) {
      for (size_t c = 0; c < 3; ++c)
        REQUIRE(static_cast<double>(rgba[4 * i + c]) == Approx(linear(texture.texels[4 * i + c])).margin(1e-5));
      REQUIRE(rgba[4 * i + 3] == 1.0f);
    }
  }
}

TEST_CASE("shade: magnified textures are bilinear in linear light, or nearest", "[shade]") {
  const Texture texture(4, noise(4, 2));
  TexturedSquare square_scene(square(0, 0, 1, 1), texture);
  const uint32_t size = 64;
  const std::vector<float> smooth = shaded(square_scene.builder.view(), front(size), ShadeOptions{});
  square_scene.builder.textures[0].magnified_nearest = true;
  const std::vector<float> hard = shaded(square_scene.builder.view(), front(size), ShadeOptions{});
  const auto texel = [&](int x, int y, size_t c) {
    return linear(texture.texels[4 * static_cast<size_t>((y & 3) * 4 + (x & 3)) + c]);
  };
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      const double u = (x + 0.5) / 16 - 0.5, v = (y + 0.5) / 16 - 0.5;
      const int ix = static_cast<int>(std::floor(u)), iy = static_cast<int>(std::floor(v));
      for (size_t c = 0; c < 3; ++c) {
        const double expected = (texel(ix, iy, c) * (ix + 1 - u) + texel(ix + 1, iy, c) * (u - ix)) * (iy + 1 - v) +
                                (texel(ix, iy + 1, c) * (ix + 1 - u) + texel(ix + 1, iy + 1, c) * (u - ix)) * (v - iy);
        const size_t at = 4 * static_cast<size_t>(64 * y + x) + c;
        REQUIRE(static_cast<double>(smooth[at]) == Approx(expected).margin(1e-5));
        REQUIRE(static_cast<double>(hard[at]) == Approx(texel(x / 16, y / 16, c)).margin(1e-5));
      }
    }
  }
}

TEST_CASE("shade: minified textures use the mip level of their footprint", "[shade]") {
  const Texture texture(64, noise(64, 3));
  TexturedSquare square_scene(square(0, 0, 1, 1), texture);
  for (uint32_t level = 1; level <= 6; ++level) {
    const std::vector<float> rgba = shaded(square_scene.builder.view(), front(64 >> level), ShadeOptions{});
    for (size_t i = 0; i < rgba.size(); i += 4)
      REQUIRE(static_cast<double>(rgba[i]) == Approx(linear(10 * level)).margin(1e-4));
  }
  // Between two levels. A footprint of 2^1.5 texels would need 64 / 2^1.5 pixels, which is not an integer. 24 pixels
  // give log2(64 / 24) = 1.415.
  const std::vector<float> between = shaded(square_scene.builder.view(), front(24), ShadeOptions{});
  const double weight = std::log2(64.0 / 24) - 1;
  for (size_t i = 0; i < between.size(); i += 4)
    REQUIRE(static_cast<double>(between[i]) == Approx(linear(10) * (1 - weight) + linear(20) * weight).margin(1e-4));
  // A footprint past the last level.
  TexturedSquare far_scene(square(0, 0, 1000, 1000), texture);
  const std::vector<float> far = shaded(far_scene.builder.view(), front(5), ShadeOptions{});
  for (size_t i = 0; i < far.size(); i += 4) REQUIRE(static_cast<double>(far[i]) == Approx(linear(60)).margin(1e-4));
}

TEST_CASE("shade: minified textures follow their filter", "[shade]") {
  const Texture texture(64, noise(64, 11));
  TexturedSquare square_scene(square(0, 0, 1, 1), texture);
  TextureView& view = square_scene.builder.textures[0];
  const auto sample = [&](uint32_t size, bool nearest, bool one_level, bool finest_level) {
    view.minified_nearest = nearest;
    view.one_level = one_level;
    view.finest_level = finest_level;
    return shaded(square_scene.builder.view(), front(size), ShadeOptions{});
  };
  // The nearest level alone: log2(64 / 24) = 1.42 and log2(64 / 20) = 1.68.
  for (const auto& [size, level] : {std::pair(24u, 1), std::pair(20u, 2)}) {
    const std::vector<float> rgba = sample(size, false, true, false);
    for (size_t i = 0; i < rgba.size(); i += 4)
      REQUIRE(static_cast<double>(rgba[i]) == Approx(linear(10 * level)).margin(1e-5));
  }
  // Level 0 alone.
  const auto texel = [&](uint32_t x, uint32_t y, size_t c) {
    return linear(texture.texels[4 * (size_t{64} * (y & 63) + (x & 63)) + c]);
  };
  const std::vector<float> hard = sample(24, true, false, true);
  const std::vector<float> smooth = sample(24, false, false, true);
  for (uint32_t y = 0; y < 24; ++y) {
    for (uint32_t x = 0; x < 24; ++x) {
      const double u = (x + 0.5) * 64 / 24, v = (y + 0.5) * 64 / 24;
      const auto left = static_cast<uint32_t>(u - 0.5), top = static_cast<uint32_t>(v - 0.5);
      const double right_share = u - 0.5 - left, low_share = v - 0.5 - top;
      for (size_t c = 0; c < 3; ++c) {
        const size_t at = 4 * (size_t{24} * y + x) + c;
        if (x % 3 != 1 && y % 3 != 1)  // other pixels lie between two texels
          REQUIRE(static_cast<double>(hard[at]) ==
                  Approx(texel(static_cast<uint32_t>(u), static_cast<uint32_t>(v), c)).margin(1e-5));
        const double upper = texel(left, top, c) * (1 - right_share) + texel(left + 1, top, c) * right_share;
        const double lower = texel(left, top + 1, c) * (1 - right_share) + texel(left + 1, top + 1, c) * right_share;
        REQUIRE(static_cast<double>(smooth[at]) == Approx(upper * (1 - low_share) + lower * low_share).margin(1e-4));
      }
    }
  }
  // Two levels of nearest texels: each level but level 0 has one grey.
  const std::vector<float> between = sample(24, true, false, false);
  const double weight = std::log2(64.0 / 24) - 1;
  for (size_t i = 0; i < between.size(); i += 4)
    REQUIRE(static_cast<double>(between[i]) == Approx(linear(10) * (1 - weight) + linear(20) * weight).margin(1e-4));
}

TEST_CASE("shade: wrap modes", "[shade]") {
  const uint32_t side = 8;
  const Texture texture(side, noise(side, 4));
  const int shown = 40;  // in texels, from -16 to 24
  for (format::Wrap wrap : {format::Wrap::kRepeat, format::Wrap::kMirror, format::Wrap::kClamp}) {
    TexturedSquare scene(square(-2, -2, 3, 3), texture);
    scene.builder.textures[0].wrap_s = wrap;
    const std::vector<float> rgba = shaded(scene.builder.view(), front(shown), ShadeOptions{});
    for (int y = 0; y < shown; ++y) {
      for (int x = 0; x < shown; ++x) {
        const int at = x - 16;
        const int repeat = ((at % 8) + 8) % 8, period = ((at % 16) + 16) % 16;
        const int column = wrap == format::Wrap::kRepeat   ? repeat
                           : wrap == format::Wrap::kMirror ? (period < 8 ? period : 15 - period)
                                                           : std::clamp(at, 0, 7);
        const size_t texel = 4 * static_cast<size_t>(y % 8 * 8 + column);
        for (size_t c = 0; c < 3; ++c) {
          REQUIRE(static_cast<double>(rgba[4 * static_cast<size_t>(shown * y + x) + c]) ==
                  Approx(linear(texture.texels[texel + c])).margin(1e-4));
        }
      }
    }
  }
}

TEST_CASE("shade: a texture is as sharp thousands of repeats away", "[shade]") {
  const Texture texture(64, noise(64, 5));
  TexturedSquare near(square(0, 0, 1, 1), texture);
  const std::vector<float> expected = shaded(near.builder.view(), front(100), ShadeOptions{});
  TexturedSquare away(square(4096, -8192, 4097, -8191), texture);
  check_close(shaded(away.builder.view(), front(100), ShadeOptions{}), expected, 1e-5);
  // The lattice of a chunk can reach farther than floats: move it by 2^40 repeats.
  for (format::ChunkRecord& chunk : near.builder.chunks)
    chunk.uv_min[0] += static_cast<int64_t>(std::ldexp(1.0, 20 - chunk.uv_exponent));
  check_close(shaded(near.builder.view(), front(100), ShadeOptions{}), expected, 1e-5);
}

TEST_CASE("shade: KHR_texture_transform scales, rotates counter-clockwise, then moves", "[shade]") {
  const Texture texture(32, noise(32, 6));
  TexturedSquare plain(square(0, 0, 1, 1), texture);
  format::MaterialRecord& material = plain.builder.materials[0];
  material.uv_offset[0] = 0.25f;
  material.uv_offset[1] = 0.5f;
  material.uv_scale[0] = 2;
  TexturedSquare moved(square(0.25, 0.5, 2.25, 1.5), texture);
  check_close(shaded(plain.builder.view(), front(64), ShadeOptions{}),
              shaded(moved.builder.view(), front(64), ShadeOptions{}), 1e-5);
  // A quarter turn: (1, 0), right, becomes (0, -1), which is up in a picture with v pointing down.
  material = moved.builder.materials[0];
  material.uv_rotation = static_cast<float>(3.14159265358979323846 / 2);
  Soup turned = square(0, 0, 1, 1);
  for (size_t i = 0; i < 4; ++i) {
    const float u = turned.uvs[2 * i];
    turned.uvs[2 * i] = turned.uvs[2 * i + 1];
    turned.uvs[2 * i + 1] = -u;
  }
  TexturedSquare expected(turned, texture);
  check_close(shaded(plain.builder.view(), front(32), ShadeOptions{}),
              shaded(expected.builder.view(), front(32), ShadeOptions{}), 1e-4);
}

TEST_CASE("shade: perspective, clipped and edge-on: texture coordinates at the intersection of ray and plane",
          "[shade]") {
  Soup floor = square(0, 0, 1, 1);  // rotated down: y = 0, from z = -20 to 20
  for (size_t v = 0; v < 4; ++v) {
    floor.positions[3 * v + 2] = -20 * floor.positions[3 * v + 1];
    floor.positions[3 * v] *= 20;
    floor.positions[3 * v + 1] = 0;
  }
  SceneBuilder builder;
  builder.instance(builder.mesh(floor, {.material = builder.material(format::kMaterialDoubleSided)}),
                   builder.identity());
  const ShadeOptions options{.show = Show::kUv};
  for (double height : {1.0, 0.01, -0.5}) {
    const View view = look_at({0.3, height, 3}, {0.2, height - 0.1, 0}, 120, 80, 0.01, 1.2);
    const std::vector<float> rgba = shaded(builder.view(), view, options);
    uint32_t seen = 0;
    for (uint32_t y = 0; y < 80; ++y) {
      for (uint32_t x = 0; x < 120; ++x) {
        const size_t at = 4 * (size_t{120} * y + x);
        if (rgba[at + 3] == 0) continue;
        double ray[3];
        for (int i = 0; i < 3; ++i) {
          ray[i] = view.forward[i] + view.right[i] * view.half_width * ((x + 0.5) / 60 - 1) -
                   view.up[i] * view.half_height * ((y + 0.5) / 40 - 1);
        }
        const double t = -view.eye[1] / ray[1];
        const double u = ((view.eye[0] + t * ray[0]) / 20 + 1) / 2;
        const double v = ((view.eye[2] + t * ray[2]) / 20 + 1) / 2;
        if (std::fabs(u - 0.5) > 0.49 || std::fabs(v - 0.5) > 0.49) continue;
        ++seen;
        REQUIRE(static_cast<double>(rgba[at]) == Approx(linear(255 * u)).margin(2e-4));
        REQUIRE(static_cast<double>(rgba[at + 1]) == Approx(linear(255 * v)).margin(2e-4));
      }
    }
    CHECK(seen > 1000);
  }
}

TEST_CASE("shade: factors, vertex colours, light and background", "[shade]") {
  SceneBuilder builder;
  const Encoding encoding{.material = builder.material(0)};
  builder.materials[0].base_color[0] = 0.5f;
  builder.materials[0].base_color[1] = 0.25f;
  Soup soup = square(0, 0, 1, 1);
  soup.uvs.clear();
  for (int v = 0; v < 4; ++v) soup.colors.insert(soup.colors.end(), {0.2f, 0.4f, 0.6f, 1.0f});
  const uint32_t mesh = builder.mesh(soup, encoding);
  const double angle = 1.0;
  builder.instance(
      mesh, builder.matrix({0.5 * std::cos(angle), 0, 0, 0, 0, 0.5, 0, 0, -0.5 * std::sin(angle), 0, 0.5, -0.2}));
  ShadeOptions options;
  options.background[0] = 0.125f;
  options.background[3] = 0.5f;
  const View view = front(40);
  const auto middle = [&](const std::vector<float>& rgba, size_t c) {
    return static_cast<double>(rgba[4 * (40 * 20 + 20) + c]);
  };
  std::vector<float> rgba = shaded(builder.view(), view, options);
  CHECK(rgba[0] == 0.125f);
  CHECK(rgba[3] == 0.5f);
  const double light = 0.2 + 0.8 * std::cos(angle);  // the rotated square's normal against the view
  CHECK(middle(rgba, 0) == Approx(0.5 * 51 / 255 * light).epsilon(1e-4));
  CHECK(middle(rgba, 1) == Approx(0.25 * 102 / 255 * light).epsilon(1e-4));
  CHECK(middle(rgba, 2) == Approx(153.0 / 255 * light).epsilon(1e-4));
  options.light = false;
  CHECK(middle(shaded(builder.view(), view, options), 2) == Approx(153.0 / 255).epsilon(1e-4));
  options.light = true;
  builder.materials[0].flags = format::kMaterialUnlit;
  CHECK(middle(shaded(builder.view(), view, options), 2) == Approx(153.0 / 255).epsilon(1e-4));
  builder.meshes[0].material = format::kNone;  // the default material is lit and white
  CHECK(middle(shaded(builder.view(), view, options), 0) == Approx(51.0 / 255 * light).epsilon(1e-4));
}

TEST_CASE("shade: normals of faces and of vertices, also under mirroring and stretching", "[shade]") {
  const auto code = [](double normal) { return linear(255 * (0.5 + 0.5 * normal)); };
  for (bool stored : {false, true}) {
    for (bool mirrored : {false, true}) {
      SceneBuilder builder;
      const Encoding encoding{.material = builder.material(format::kMaterialDoubleSided)};
      Soup soup;  // the plane x + z = 0, rotated a little: normal (1, 0, 1)
      soup.add(-1, -1, 1);
      soup.add(1, -1, -1);
      soup.add(1, 1, -1);
      soup.triangle(0, 1, 2);
      if (stored)
        for (int v = 0; v < 3; ++v) soup.normals.insert(soup.normals.end(), {1, 0, 1});
      const double x = mirrored ? -2 : 2;  // scaled by (x, 1, 1): the normal becomes (1 / x, 0, 1)
      builder.instance(builder.mesh(soup, encoding), builder.matrix({x, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -2}));
      const ShadeOptions options{.show = Show::kNormal};
      View view = front(41);
      view.z_far = 10;
      view.half_width = view.half_height = 3;
      const std::vector<float> rgba = shaded(builder.view(), view, options);
      const double length = std::sqrt(1 + 1 / (x * x));
      uint32_t seen = 0;
      for (size_t i = 0; i < rgba.size(); i += 4) {
        if (rgba[i + 3] == 0) continue;
        ++seen;
        REQUIRE(static_cast<double>(rgba[i]) == Approx(code(1 / x / length)).margin(1e-3));
        REQUIRE(static_cast<double>(rgba[i + 1]) == Approx(code(0)).margin(1e-3));
        REQUIRE(static_cast<double>(rgba[i + 2]) == Approx(code(1 / length)).margin(1e-3));
      }
      CHECK(seen > 50);
    }
  }
}

TEST_CASE("shade: triangles, meshes and depth", "[shade]") {
  SceneBuilder builder;
  const uint32_t mesh = builder.mesh(grid(6, 0.2), Encoding{});
  const uint32_t other = builder.mesh(grid(6, 0.2), Encoding{});
  builder.instance(mesh, builder.identity());
  builder.instance(mesh, builder.matrix({1, 0, 0, 2, 0, 1, 0, 0, 0, 0, 1, 0}));
  builder.instance(other, builder.matrix({1, 0, 0, -2, 0, 1, 0, 0, 0, 0, 1, 0}));
  const SceneView scene = builder.view();
  const View view = look_at({0, 2.5, 2}, {0, 0, 0}, 160, 90);
  const std::vector<uint64_t> samples = draw(scene, view);
  std::vector<float> rgba(4 * samples.size());
  ShadeOptions options;
  const auto colors = [&](Show show) {
    options.show = show;
    scree::tests::shade_samples(scene, view, samples, options, rgba);
    std::set<std::array<float, 3>> found;
    for (size_t i = 0; i < samples.size(); ++i)
      if (samples[i] != kBackground) found.insert({rgba[4 * i], rgba[4 * i + 1], rgba[4 * i + 2]});
    return found.size();
  };
  std::set<uint64_t> ids;
  for (uint64_t sample : samples) ids.insert(sample_id(sample));
  CHECK(colors(Show::kTriangle) == ids.size() - 1);  // the background is one of these colours
  CHECK(colors(Show::kMesh) == 2);
  CHECK(colors(Show::kCluster) == 2);  // each indexed chunk counts as one cluster
  CHECK(colors(Show::kDepth) > 100);
  uint64_t nearest = kBackground;
  size_t brightest = 0;
  for (size_t i = 0; i < samples.size(); ++i) {
    if (samples[i] < nearest) {
      nearest = samples[i];
      brightest = i;
    }
  }
  CHECK(rgba[4 * brightest] == 1.0f);
}
