// Alpha masks in convert: thresholds, levels that keep the share of passing texels, masks that hide nothing or
// everything, and the way to a picture and back to glTF.
#include <algorithm>
#include <cmath>

#include "format/container/mip_levels.h"
#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "runtime/scene/camera.h"
#include "runtime/scene/scene.h"
#include "tests/kernels/scene_builder.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tools/convert/convert.h"
#include "tools/convert/images/masks.h"
#include "tools/export/export.h"

using namespace scree;
using namespace scree::tests;

namespace {

/// A picture of 64 x 48 pixels whose alpha is `high` within a disc and `low` outside of it.
std::vector<std::byte> disc_png(uint8_t low, uint8_t high) {
  std::vector<uint8_t> pixels;
  for (int y = 0; y < 48; ++y)
    for (int x = 0; x < 64; ++x) {
      const bool inside = std::hypot(x - 31.5, y - 23.5) < 15;
      pixels.insert(pixels.end(), {uint8_t{200}, static_cast<uint8_t>(3 * x), uint8_t{90}, inside ? high : low});
    }
  return must(runtime::encode_png({64, 48, 4, pixels}));
}

/// Adds a grid whose masked material has `png` as its texture.
void add_masked(ModelMaker& maker, const std::string& name, const std::vector<std::byte>& png, double cutoff,
                double factor, bool uv = true, tools::GltfAlpha kind = tools::GltfAlpha::kMask) {
  tools::GltfMaterial material{.name = name};
  material.texture = maker.writer().add_texture(maker.texture(name, format::ImageCodec::kPng, png));
  material.alpha = kind;
  material.alpha_cutoff = cutoff;
  material.base_color[3] = factor;
  material.double_sided = true;
  maker.draw(name, {maker.grid({.flat = true, .uv = uv}, maker.writer().add_material(material))});
}

std::vector<uint64_t> picture_of(const std::string& path, double rise_degrees = 20) {
  const runtime::Scene scene = must(runtime::Scene::open(path, {}));
  const kernels::View view =
      must(runtime::make_view(scene, {.rise_degrees = rise_degrees, .width = 200, .height = 150}));
  std::vector<uint64_t> samples(size_t{view.width} * view.height);
  REQUIRE(kernels::draw_cpu(scene.view(), view, samples, 2));
  return samples;
}

}  // namespace

TEST_CASE("a mask's threshold is the least alpha that passes", "[convert][mask]") {
  CHECK(convert::mask_threshold(1, 0.5f) == 255 * 32768);
  CHECK(convert::mask_threshold(0.5f, 0.5f) == format::kMaxMaskThreshold);
  CHECK(convert::mask_threshold(0.49f, 0.5f) > format::kMaxMaskThreshold);
  CHECK(convert::mask_threshold(0, 0.5f) > format::kMaxMaskThreshold);
  CHECK(convert::mask_threshold(0, 1e-30f) > format::kMaxMaskThreshold);
  CHECK(convert::mask_threshold(1, 0) == 0);
  CHECK(convert::mask_threshold(0, 0) == 0);
  CHECK(convert::mask_threshold(1, 1e-30f) == 1);
  CHECK(convert::mask_threshold(1, 1) == format::kMaxMaskThreshold);
  CHECK(convert::mask_threshold(1, 2) > format::kMaxMaskThreshold);
}

TEST_CASE("levels of a mask keep the share that passes", "[convert][mask]") {
  // Thin lines on a sixth of the texels. A box filter alone would lose them.
  const uint32_t width = 192, height = 131;
  std::vector<uint8_t> alpha(size_t{width} * height);
  for (uint32_t y = 0; y < height; ++y)
    for (uint32_t x = 0; x < width; ++x)
      alpha[y * width + x] = static_cast<uint8_t>((x + y / 3) % 6 == 0 ? 255 : x * y % 40);
  for (const uint32_t threshold : {128u * 65536, 128u * 65536 - 1000, 60u * 65536, 250u * 65536}) {
    const std::vector<std::byte> levels = convert::make_mask_levels(alpha, width, height, threshold);
    const uint32_t count = convert::mask_level_count(width, height);
    CHECK(count == 4);  // 192, 96, 48 and 24 wide
    REQUIRE(levels.size() == format::mask_bytes(width, height, count));
    CHECK(std::equal(alpha.begin(), alpha.end(), reinterpret_cast<const uint8_t*>(levels.data())));
    const std::byte* at = levels.data();
    double first = 0;
    for (uint32_t l = 0; l < count; ++l) {
      const size_t texels = size_t{width >> l} * (height >> l);
      const auto passing = std::count_if(
          at, at + texels, [&](std::byte code) { return static_cast<uint32_t>(code) * 65536 >= threshold; });
      const double share = static_cast<double>(passing) / static_cast<double>(texels);
      if (l == 0) first = share;
      INFO("level " << l << ", threshold " << threshold);
      // Texels of equal value pass together, so the share cannot be kept exactly.
      CHECK(std::fabs(share - first) < 0.05);
      at += texels;
    }
  }
  const std::vector<uint8_t> clear(size_t{40} * 40, uint8_t{3});
  for (const std::byte code : convert::make_mask_levels(clear, 40, 40, 65536 * 4)) REQUIRE(code == std::byte{3});
  CHECK(convert::mask_level_count(1, 1) == 1);
  CHECK(convert::mask_level_count(1, 16) == 1);
  CHECK(convert::mask_level_count(32, 16) == 2);
}

TEST_CASE("blended materials keep their alpha, and are drawn unless it is 0", "[convert][mask][blend]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    using tools::GltfAlpha;
    add_masked(maker, "leaf", disc_png(20, 240), 0.9, 1, true, GltfAlpha::kBlend);
    add_masked(maker, "film", disc_png(20, 240), 0.9, 0.25, true, GltfAlpha::kBlend);
    add_masked(maker, "leaf again, masked", disc_png(20, 240), 0.5, 1);
    add_masked(maker, "wood", disc_png(255, 255), 0.9, 1, true, GltfAlpha::kBlend);
    add_masked(maker, "glass", disc_png(20, 240), 0.9, 0.2, false, GltfAlpha::kBlend);
    add_masked(maker, "air", disc_png(20, 240), 0.9, 0, false, GltfAlpha::kBlend);
    add_masked(maker, "clear", disc_png(0, 0), 0.9, 1, true, GltfAlpha::kBlend);
  });
  const convert::ConvertReport report = must_convert(options_of(folder));
  CHECK(report.masks == 1);
  CHECK(report.opaque_masks == 0);
  CHECK(report.blended == 4);
  CHECK(report.warnings ==
        std::vector<std::string>{"2 primitives have a textured material but not its texture coordinates",
                                 "in.glb: 2 primitives that their alpha masks hide everywhere are left out"});
  const tests::PackedFile opened = must_open(options_of(folder).output);
  REQUIRE(opened.file.masks().size() == 3);
  CHECK(opened.file.masks()[0].threshold == convert::mask_threshold(1, 0.5f));
  CHECK(opened.file.masks()[1].threshold ==
        format::kMaxMaskThreshold);  // above the largest alpha with a factor of 0.25
  CHECK(opened.file.masks()[0].page == opened.file.masks()[1].page);
  CHECK(opened.file.masks()[2].page != opened.file.masks()[1].page);
  CHECK(opened.file.materials()[opened.file.masks()[0].material].flags ==
        (format::kMaterialAlphaBlend | format::kMaterialDoubleSided));
  // Glass has no mask, but it blends. Wood and images without an alpha below 1 do not blend.
  const auto scene = must(runtime::Scene::open(options_of(folder).output, {}));
  uint64_t blended = 0;
  for (uint64_t m = 0; m < scene.view().mesh_count; ++m)
    blended += kernels::may_blend(scene.view(), scene.view().meshes[m]) ? 1 : 0;
  CHECK(blended == 3);
}

TEST_CASE("masks are stored if they hide something, and drawn", "[convert][mask]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    add_masked(maker, "disc", disc_png(20, 240), 0.5, 1);
    add_masked(maker, "disc again", disc_png(20, 240), 0.5, 1);
    add_masked(maker, "less of it", disc_png(20, 240), 0.5, 0.8);
    add_masked(maker, "opaque", disc_png(140, 240), 0.5, 1);
    add_masked(maker, "clear", disc_png(20, 100), 0.5, 1);
    add_masked(maker, "clear by its factor", disc_png(20, 240), 0.5, 0.3);
    add_masked(maker, "no coordinates", disc_png(20, 240), 0.5, 1, false);
  });
  for (const convert::Textures textures : {convert::Textures::kKeep, convert::Textures::kJpeg}) {
    convert::ConvertOptions options = options_of(folder);
    options.images.textures = textures;
    options.zstd_level = textures == convert::Textures::kJpeg ? 3 : 0;
    const convert::ConvertReport report = tests::must_match(options);
    CHECK(report.masks == 3);
    CHECK(report.opaque_masks == 2);
    CHECK(std::any_of(report.warnings.begin(), report.warnings.end(), [](const std::string& warning) {
      return warning == "in.glb: 2 primitives that their alpha masks hide everywhere are left out";
    }));
    const tests::PackedFile opened = must_open(options.output);
    const format::Container& file = opened.file;
    const bool is_split = options.zstd_level > 0;
    CHECK(file.header().version_major == (is_split ? 2 : 1));
    CHECK(file.header().version_minor == (is_split ? 0 : 1));
    CHECK(file.meshes().size() == 5);
    REQUIRE(file.masks().size() == 3);
    CHECK(file.masks()[0].page == file.masks()[1].page);
    CHECK(file.masks()[0].page != file.masks()[2].page);
    for (uint64_t i = 0; i < 3; ++i) {
      CHECK(file.masks()[i].width == 64);
      CHECK(file.masks()[i].height == 48);
      CHECK(file.masks()[i].level_count == 3);
      CHECK((file.materials()[file.masks()[i].material].flags & format::kMaterialAlphaMask) != 0);
    }
    tests::must_verify(opened);
  }
}

TEST_CASE("equal materials keep their masks, also if the first has no texture coordinates", "[convert][mask]") {
  const TempFolder folder;
  const bool plain_first = GENERATE(false, true), share = GENERATE(false, true);
  tests::make_model(folder.file("in.glb"), [&](ModelMaker& maker) {
    for (const bool uv : {!plain_first, plain_first}) add_masked(maker, "disc", disc_png(20, 255), 0.5, 1, uv);
  });
  convert::ConvertOptions options = options_of(folder);
  options.share = share;
  CHECK(must_convert(options).masks == 1);
  CHECK(must_open(options.output).file.masks().size() == 1);
}

TEST_CASE("a masked picture covers the mask's share, for every coding of its colours", "[convert][mask]") {
  const TempFolder folder;
  const auto picture = [&](double cutoff, convert::Textures textures, const char* name) {
    ModelMaker maker(folder.file("in.glb"));
    add_masked(maker, "disc", disc_png(20, 240), cutoff, 1);
    maker.finish();
    convert::ConvertOptions options = options_of(folder);
    options.output = folder.file(name);
    options.images.textures = textures;
    must_convert(options);
    return picture_of(options.output);
  };
  const std::vector<uint64_t> whole = picture(0.01, convert::Textures::kKeep, "whole.scree");
  const std::vector<uint64_t> masked = picture(0.5, convert::Textures::kKeep, "masked.scree");
  CHECK((masked == picture(0.5, convert::Textures::kJpeg, "jpeg.scree")));
  // An export restores the alpha, which the JPEG does not have.
  {
    REQUIRE(tools::export_gltf(must_open(folder.file("jpeg.scree")).file, folder.file("back.glb"), {}));
    convert::ConvertOptions options = options_of(folder, "back.glb");
    options.output = folder.file("back.scree");
    CHECK(must_convert(options).masks == 1);
    const std::vector<uint64_t> back = picture_of(options.output);  // triangles in another order
    uint64_t other = 0;
    for (size_t i = 0; i < back.size(); ++i)
      other += (back[i] == kernels::kBackground) != (masked[i] == kernels::kBackground);
    CHECK(other < 10);
  }
  const double share = static_cast<double>(covered(masked)) / static_cast<double>(covered(whole));
  CHECK(covered(whole) > 2000);
  CHECK(share == Approx(3.14159 * 15 * 15 / (64 * 48)).margin(0.05));
  uint64_t foreign = 0;
  for (size_t i = 0; i < masked.size(); ++i) foreign += masked[i] != whole[i] && masked[i] != kernels::kBackground;
  CHECK(foreign == 0);
}

TEST_CASE("the alpha of vertex colours cuts if the mask's texture cuts nothing", "[convert][mask]") {
  const TempFolder folder;
  const auto encoding = GENERATE(convert::Encoding::kIndexed, convert::Encoding::kClustered);
  const bool has_texture = GENERATE(false, true);
  const auto picture = [&](double cutoff, bool has_alpha) {
    ModelMaker maker(folder.file("in.glb"));
    tools::GltfMaterial material{.name = "fading"};
    if (has_texture)
      material.texture =
          maker.writer().add_texture(maker.texture("opaque", format::ImageCodec::kPng, disc_png(255, 255)));
    material.alpha = tools::GltfAlpha::kMask;
    material.alpha_cutoff = cutoff;
    material.double_sided = true;
    maker.draw("grid", {maker.grid({.flat = true, .uv = has_texture, .color = true, .fading = has_alpha},
                                   maker.writer().add_material(material))});
    maker.finish();
    convert::ConvertOptions options = options_of(folder);
    options.encoding = encoding;
    CHECK(tests::must_match(options).masks == (cutoff > 0 ? 1 : 0));
    const tests::PackedFile opened = must_open(options.output);
    for (uint64_t i = 0; i < opened.file.masks().size(); ++i) {
      const format::MaskRecord& mask = opened.file.masks()[i];
      CHECK(mask.flags == (format::kMaskNearest | format::kMaskOfColors));
      CHECK(mask.width * mask.height == 1);
    }
    return picture_of(options.output, 90);  // from above, so that shares of pixels equal shares of areas
  };
  const std::vector<uint64_t> whole = picture(0, true);
  CHECK(covered(whole) > 2000);
  CHECK((picture(0.5, false) == whole));  // colours of four components, all of them opaque
  const std::vector<uint64_t> cut = picture(0.75, true);
  size_t foreign = 0;
  for (size_t i = 0; i < cut.size(); ++i) foreign += cut[i] != whole[i] && cut[i] != kernels::kBackground;
  CHECK(foreign == 0);
  CHECK(static_cast<double>(covered(cut)) / static_cast<double>(covered(whole)) == Approx(0.25).margin(0.01));
}
