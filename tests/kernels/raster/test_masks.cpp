// Alpha masks: the rule's parts with numbers worked out by hand, pictures compared with an independent ray caster, and
// equal pictures for every way of drawing.
#include <cmath>

#include "tests/format/geometry/spec_vectors.h"
#include "tests/kernels/raster/mask_cases.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;
using format::Wrap;

TEST_CASE("texels, levels and alpha of masks equal the test vectors", "[mask]") {
  for (const SpecVector& vector : spec_vectors("masks.txt")) {
    if (vector.has("texels")) {
      const std::vector<std::string> words = vector.words("texels");
      INFO("texels: " << vector.text("texels"));
      REQUIRE(words.size() == 7);
      const Wrap wrap = words[2] == "repeat" ? Wrap::kRepeat : words[2] == "mirror" ? Wrap::kMirror : Wrap::kClamp;
      const MaskTexels texels = mask_texels(wrap_point(texture_point(std::stod(words[0])), wrap),
                                            static_cast<uint32_t>(std::stoul(words[1])), wrap, words[3] == "1");
      CHECK(texels.first == std::stoul(words[4]));
      CHECK(texels.second == std::stoul(words[5]));
      CHECK(texels.weight == std::stoul(words[6]));
    } else if (vector.has("level")) {
      const std::vector<std::string> words = vector.words("level");
      INFO("level: " << vector.text("level"));
      REQUIRE(words.size() == 3);
      CHECK(nearest_level(std::stof(words[0]), static_cast<uint32_t>(std::stoul(words[1]))) == std::stoul(words[2]));
    } else if (vector.has("corners")) {
      const std::vector<std::string> words = vector.words("corners");
      INFO("corners: " << vector.text("corners"));
      REQUIRE(words.size() == 5);
      uint32_t codes = 0;
      for (size_t n = 0; n < 3; ++n) codes |= static_cast<uint32_t>(std::stoul(words[n])) << 8 * n;
      CHECK(corner_alpha(codes, std::stof(words[3])) == std::stoul(words[4]));
    } else {
      const std::vector<std::string> words = vector.words("alpha");
      INFO("alpha: " << vector.text("alpha"));
      REQUIRE(words.size() == 11);
      uint8_t alpha[5];
      for (size_t i = 0; i < 5; ++i) alpha[i] = static_cast<uint8_t>(std::stoul(words[5 + i]));
      MaskView mask = mask_view(2, 2, 2, 1);
      mask.alpha = alpha;
      mask.wrap_s = mask.wrap_t = Wrap::kClamp;
      mask.magnified_nearest = words[3] == "1";
      mask.minified_nearest = words[4] == "1";
      CHECK(mask_alpha(mask, texture_point(std::stod(words[0])), texture_point(std::stod(words[1])),
                       std::stof(words[2])) == std::stoul(words[10]));
    }
  }
  CHECK(nearest_level(-NAN, 6) == 5);
  CHECK(nearest_level(1e30f, 1) == 0);
}

namespace {

/// The alpha of the test's vertex colours: 1 at x = -1, and `slope` less at x = 1.
double color_alpha(double slope, double x) {
  return 1 - slope * (0.5 + 0.5 * x);
}

/// The rule's result for a flat quad at y = 0 under with_uvs(), by an independent ray cast. Returns the distance of the
/// alpha above the threshold in 8-bit codes, or NaN where the ray misses the quad.
double alpha_above(const View& view, const MaskView& mask, double repeats, double slope, uint32_t x, uint32_t y) {
  double place = 0;
  const auto hit = [&](double sample_x, double sample_y, double out[2]) {
    const double across = (2 * (sample_x + 0.5) / view.width - 1) * view.half_width;
    const double up = (1 - 2 * (sample_y + 0.5) / view.height) * view.half_height;
    double ray[3];
    double from[3];
    for (int i = 0; i < 3; ++i) {
      ray[i] = view.orthographic ? view.forward[i] : view.forward[i] + across * view.right[i] + up * view.up[i];
      from[i] = view.eye[i] + (view.orthographic ? across * view.right[i] + up * view.up[i] : 0.0);
    }
    const double t = -from[1] / ray[1], px = from[0] + t * ray[0], pz = from[2] + t * ray[2];
    place = px;
    out[0] = repeats * (0.4 * px + 0.1 * pz) + 0.3;
    out[1] = repeats * (0.5 * pz - 0.07 * px) - 1.7;
  };
  double at[2], right[2], down[2];
  const double e = 1e-4;
  hit(x + e, y, right);
  hit(x, y + e, down);
  hit(x, y, at);
  const double size[2] = {static_cast<double>(mask.width), static_cast<double>(mask.height)};
  double squares[2] = {0, 0};
  for (int c = 0; c < 2; ++c) {
    squares[0] += std::pow((right[c] - at[c]) / e * size[c], 2);
    squares[1] += std::pow((down[c] - at[c]) / e * size[c], 2);
  }
  const double f = std::sqrt(std::max(squares[0], squares[1]));
  uint32_t level = 0;
  while (level + 1 < mask.level_count && f >= std::sqrt(2.0) * (1 << level)) ++level;
  const uint8_t* alpha = mask.alpha + format::mask_bytes(mask.width, mask.height, level);
  const uint32_t width = std::max(mask.width >> level, 1u), height = std::max(mask.height >> level, 1u);
  const double px = (at[0] - std::floor(at[0])) * width - 0.5;
  const double py = (at[1] - std::floor(at[1])) * height - 0.5;
  const auto texel = [&](double tx, double ty) {
    const auto wrapped = [](double value, uint32_t n) { return static_cast<uint32_t>(value + n) % n; };
    return static_cast<double>(alpha[wrapped(ty, height) * width + wrapped(tx, width)]);
  };
  const double x0 = std::floor(px), y0 = std::floor(py);
  const double wx = px - x0, wy = py - y0;
  const double value = (texel(x0, y0) * (1 - wx) + texel(x0 + 1, y0) * wx) * (1 - wy) +
                       (texel(x0, y0 + 1) * (1 - wx) + texel(x0 + 1, y0 + 1) * wx) * wy;
  return value * color_alpha(slope, place) - mask.threshold / 65536.0;
}

}  // namespace

TEST_CASE("a masked quad has the holes that ray casting finds", "[mask]") {
  const double repeats = GENERATE(0.7, 9.0);
  const double slope = GENERATE(0.0, 0.6);  // of vertex colours; 0: none
  SceneBuilder masked;
  MaskView mask = mask_view(64, 32, 6, (slope > 0 ? 65 : 120) * 65536);
  const std::vector<uint8_t> levels = noisy_levels(64, 32, 6, 5);
  const Encoding encoding{.material = masked.masked_material(format::kMaterialDoubleSided, mask, levels)};
  mask.alpha = levels.data();
  for (const uint32_t n : {1u, 60u}) {
    Soup soup = with_uvs(grid(n, 0), repeats);
    for (size_t v = 0; slope > 0 && v < soup.positions.size() / 3; ++v)
      soup.colors.insert(soup.colors.end(), {1, 1, 1, static_cast<float>(color_alpha(slope, soup.positions[3 * v]))});
    masked.mesh(soup, encoding);
  }
  for (const uint32_t mesh : {0u, 1u}) {
    masked.instances.clear();
    masked.instance(mesh, masked.identity());
    const SceneView scene = masked.view();
    SceneView opaque = scene;
    opaque.masks = nullptr;
    for (const View& view : masked_views()) {
      const std::vector<uint64_t> all = draw(opaque, view), seen = draw(scene, view);
      uint64_t kept = 0, dropped = 0, wrong = 0, foreign = 0;
      for (uint32_t i = 0; i < all.size(); ++i) {
        if (seen[i] != kBackground && seen[i] != all[i]) ++foreign;
        if (all[i] == kBackground) continue;
        const bool passes = seen[i] != kBackground;
        (passes ? kept : dropped) += 1;
        const double above = alpha_above(view, mask, repeats, slope, i % view.width, i / view.width);
        // Positions are rounded to 1/256 texel and texture coordinates to few bits, so an alpha may differ by some
        // codes.
        if (std::fabs(above) > 6 && (above > 0) != passes) ++wrong;
      }
      INFO(repeats << ", mesh " << mesh << ", " << view.width << " samples wide: " << kept << " kept, " << dropped
                   << " dropped, " << wrong << " wrong");
      CHECK(foreign == 0);
      CHECK(kept > 300);
      CHECK(dropped > 300);
      CHECK(wrong <= (kept + dropped) / 200);  // only at borders between levels and at edges of quads
    }
  }
}

TEST_CASE("the alpha of vertex colours scales that of a mask", "[mask]") {
  Encoding encoding{.clusters = GENERATE(Clusters::kNone, Clusters::kClustered)};
  /// `alpha`: of all vertices; below 0: they have no colours.
  const auto picture = [&](const View& view, float alpha, uint32_t threshold) {
    SceneBuilder builder;
    encoding.material = builder.masked_material(format::kMaterialDoubleSided, mask_view(64, 32, 6, threshold),
                                                noisy_levels(64, 32, 6, 5));
    Soup soup = with_uvs(grid(4, 0), 3);
    for (size_t v = 0; alpha >= 0 && v < soup.positions.size() / 3; ++v)
      soup.colors.insert(soup.colors.end(), {1.0f, 0.5f, 0.2f, alpha});
    builder.instance(builder.mesh(soup, encoding), builder.identity());
    return draw(builder.view(), view);
  };
  for (const View& view : masked_views()) {
    INFO(view.width << " samples wide");
    CHECK(picture(view, 1, 120 * 65536) == picture(view, -1, 120 * 65536));
    CHECK(picture(view, 0.2f, 30 * 65536) == picture(view, -1, 150 * 65536));  // as a threshold five times as high
    CHECK(picture(view, 0.2f, 30 * 65536) != picture(view, -1, 30 * 65536));
    CHECK(covered(picture(view, 0, 1)) == 0);
  }
}

TEST_CASE("a masked scene has the same picture in every way of drawing", "[mask]") {
  SceneBuilder builder;
  add_masked_meshes(builder, GENERATE(false, true));
  const SceneView scene = builder.view();
  SceneView opaque = scene;
  opaque.masks = nullptr;
  const QueueSizes tiny{
      .blocks = 1, .medium = 1, .large = 1, .tiles = 1, .blocks_at_a_time = 3, .block_triangles = 100};
  const QueueSizes all{.cluster_bounds = false, .occlusion = false};
  const QueueSizes rounds{.round_triangles = 500};
  for (const View& view : masked_views()) {
    INFO(view.width << " samples wide");
    const std::vector<uint64_t> expected = draw(scene, view);
    CHECK(covered(expected) > 4000);
    CHECK(expected != draw(opaque, view));
    for (const InstructionSet set : {InstructionSet::kBaseline, best_instruction_set()}) {
      CHECK((draw_with(scene, view, 1, set, all) == expected));
      CHECK((draw_with(scene, view, 2, set, tiny) == expected));
      CHECK((draw_with(scene, view, 3, set, rounds) == expected));
    }
  }
}
