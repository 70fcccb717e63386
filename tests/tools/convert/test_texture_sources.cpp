// Textures with alternative images, and WebP: the chosen image, and its stored form.
#include <string>
#include <vector>

#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "tests/models.h"
#include "tests/runtime/images/basis_files.h"
#include "tests/runtime/load_scene.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#ifdef SCREE_TESTS_WEBP
#include "tests/runtime/images/webp_files.h"
#endif

using namespace scree;
using format::ImageCodec;
using tests::FileBytes;
using tests::TempFolder;

namespace {

FileBytes png_of(uint32_t side) {
  const std::vector<uint8_t> pixels(size_t{3} * side * side, 90);
  return must(runtime::encode_png({side, side, 3, pixels}));
}

FileBytes unreadable() {
  return tests::make_ktx2({.vk_format = 143});  // BC6H
}

/// Writes a triangle with one texture. `sources`: the texture's members.
std::string textured_triangle(const TempFolder& folder, const std::string& images, const std::string& sources) {
  return folder.write(
      "in.gltf", R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],)"
                 R"("meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1},"material":0}]}],)"
                 R"("materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],)"
                 R"("textures":[{)" +
                     sources + R"(}],"images":[)" + images +
                     R"(],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3",)"
                     R"("min":[0,0,0],"max":[1,1,0]},{"bufferView":0,"componentType":5126,"count":3,"type":"VEC2"}],)"
                     R"("bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,"uri":)"
                     R"("data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]})");
}

/// The one image that is stored.
format::ImageRecord stored_image(const TempFolder& folder) {
  convert::ConvertOptions options = tests::options_of(folder, "in.gltf");
  options.existing = format::Existing::kReplace;
  tests::must_convert(options);
  const auto packed = must(tests::open_packed(options.output));
  REQUIRE(packed.file.images().size() == 1);
  return packed.file.images()[0];
}

}  // namespace

TEST_CASE("the best readable image is used", "[texture_sources]") {
  const TempFolder folder;
  folder.write("8.ktx2", tests::make_ktx2({}));
  folder.write("bc6.ktx2", unreadable());
  folder.write("etc1s.ktx2", tests::make_basis_lz({}).bytes);
  folder.write("8.dds", tests::make_dds({.format = format::BlockFormat::kBc1}, 71));
  folder.write("4.png", png_of(4));
  const std::string images =
      R"({"uri":"8.ktx2"},{"uri":"bc6.ktx2"},{"uri":"8.dds"},{"uri":"4.png"},{"uri":"no.png"},{"uri":"etc1s.ktx2"})";
  const auto taken = [&](const std::string& sources) {
    textured_triangle(folder, images, sources);
    return stored_image(folder);
  };
  const auto basisu = [](int image) { return R"("KHR_texture_basisu":{"source":)" + std::to_string(image) + "}"; };
  const std::string dds = R"("MSFT_texture_dds":{"source":2})";
  const auto all = [](const std::string& source, const std::string& extensions) {
    return R"("source":)" + source + R"(,"extensions":{)" + extensions + "}";
  };
  CHECK(taken(all("3", basisu(0))).block_format == format::BlockFormat::kBc7);
  CHECK(taken(all("3", basisu(1))).codec == ImageCodec::kPng);
  CHECK(taken(all("3", basisu(5))).codec == ImageCodec::kPng);  // an unchanged PNG has priority over decoded pixels
  CHECK(taken(all("4", basisu(5))).block_format == format::BlockFormat::kRgba8);
  CHECK(taken(all("3", dds)).block_format == format::BlockFormat::kBc1);
  CHECK(taken(all("3", basisu(0) + "," + dds)).block_format == format::BlockFormat::kBc7);
  CHECK(taken(all("3", basisu(1) + "," + dds)).block_format == format::BlockFormat::kBc1);
  // The bytes determine the format, not the extension. A missing image is not preferred.
  CHECK(taken(all("0", basisu(3))).block_format == format::BlockFormat::kBc7);
  CHECK(taken(all("3", basisu(4))).codec == ImageCodec::kPng);
  CHECK(taken(all("4", basisu(0))).block_format == format::BlockFormat::kBc7);
  // If no image can be read, the error is that of the first image.
  textured_triangle(folder, images, all("4", basisu(1)));
  tests::must_fail(
      [&] {
        convert::ConvertOptions options = tests::options_of(folder, "in.gltf");
        options.output = folder.file("none.scree");
        return options;
      }(),
      ErrorCode::kUnsupported, "image 0 (bc6.ktx2): KTX2: of Vulkan format 143");
}

TEST_CASE("a WebP becomes a PNG of the same pixels, or a JPEG", "[texture_sources][webp]") {
  const TempFolder folder;
  if (runtime::webp_version().empty()) {
    folder.write("a.webp", FileBytes(64));
    folder.write("a.webp", std::string("RIFF\x08\0\0\0WEBPVP8 ", 16));
    textured_triangle(folder, R"({"uri":"a.webp"})", R"("extensions":{"EXT_texture_webp":{"source":0}})");
    tests::must_fail(tests::options_of(folder, "in.gltf"), ErrorCode::kUnsupported,
                     "in.gltf: image 0 (a.webp): WebP: this scree is built without libwebp");
    return;
  }
#ifdef SCREE_TESTS_WEBP
  const bool has_alpha = GENERATE(false, true);
  const std::vector<uint8_t> pixels = tests::smooth_pixels(60, 40, has_alpha);
  folder.write("a.webp", tests::make_webp(pixels, 60, 40));
  folder.write("4.png", png_of(4));
  const std::string images = R"({"uri":"a.webp","mimeType":"image/jpeg"},{"uri":"4.png"})";
  textured_triangle(folder, images, R"("source":1,"extensions":{"EXT_texture_webp":{"source":0}})");
  CHECK(stored_image(folder).width == 4);  // an unchanged PNG has priority over a PNG that would be made
  textured_triangle(folder, images, GENERATE(R"("extensions":{"EXT_texture_webp":{"source":0}})", R"("source":0)"));
  for (const auto textures : {convert::Textures::kKeep, convert::Textures::kRaw, convert::Textures::kJpeg}) {
    convert::ConvertOptions options = tests::options_of(folder, "in.gltf");
    options.existing = format::Existing::kReplace;
    options.images.textures = textures;
    tests::must_convert(options);
    const auto packed = must(tests::open_packed(options.output));
    const format::ImageRecord image = packed.file.images()[0];
    CHECK(image.width == 60);
    CHECK(image.height == 40);
    (void)tests::must_load(options.output);
    if (textures == convert::Textures::kJpeg) {
      CHECK(image.codec == ImageCodec::kIndexedJpeg);
      continue;
    }
    REQUIRE(image.codec == ImageCodec::kPng);
    CHECK(image.channels == (has_alpha ? 4 : 3));
    std::vector<std::byte> scratch;
    const auto page = must(packed.file.load_page(image.page, scratch));
    CHECK((must(runtime::decode_image(page)).rgba == pixels));
    CHECK_FALSE(runtime::probe_image(page)->is_webp);
  }
#endif
}

TEST_CASE("a real WebP texture is drawn", "[texture_sources][webp][models]") {
  const std::filesystem::path model = tests::real_models("scenes-material/grass/grass.glb");
  if (model.empty() || runtime::webp_version().empty()) return;
  const TempFolder folder;
  convert::ConvertOptions options = tests::options_of(folder);
  options.input = model.string();
  tests::must_convert(options);
  const auto packed = must(tests::open_packed(options.output));
  REQUIRE(packed.file.images().size() == 1);
  CHECK(packed.file.images()[0].codec == ImageCodec::kPng);
}
