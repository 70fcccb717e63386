// KTX2 and DDS textures from glTF to picture and back: the file has their blocks and levels unchanged, and they are
// drawn like their decoded pixels, on the CPU and the GPU.
#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "format/blocks/pixels.h"
#include "format/container/mip_levels.h"
#include "kernels/shade/texture.h"
#include "runtime/draw/device_scene.h"
#include "runtime/scene/camera.h"
#include "runtime/textures/block_image.h"
#include "runtime/textures/jpeg_image.h"
#include "tests/gpu.h"
#include "tests/runtime/images/basis_files.h"
#include "tests/tools/block_model.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/run_program.h"
#include "tools/export/export.h"

using namespace scree;
using namespace scree::tests;
using format::BlockFormat;
using format::ImageCodec;

namespace {

std::vector<std::byte> stored_blocks(const format::Container& file, uint32_t image, uint32_t level) {
  std::vector<std::byte> blocks(format::block_rows(file.images()[image], level).bytes());
  must(runtime::BlockLevels(file).read(image, level, blocks));
  return blocks;
}

}  // namespace

TEST_CASE("blocks and levels are stored unchanged", "[block_textures]") {
  const TempFolder folder;
  const BlockRecipe recipes[] = {
      {.width = 45, .height = 30, .levels = 6, .scheme = 2, .swizzle = "1rg1"},
      {.width = 64, .height = 64, .levels = 1, .seed = 2},
      {.width = 1, .height = 1, .seed = 3},
  };
  const BlockRecipe of_dds{.format = BlockFormat::kBc1, .width = 33, .height = 7, .levels = 3, .seed = 4};
  make_block_model(folder.file("in.glb"), {make_ktx2(recipes[0]), make_ktx2(recipes[1]), make_ktx2(recipes[2]),
                                           make_dds(of_dds, 71), make_ktx2(recipes[1])});
  convert::ConvertOptions options = tests::options_of(folder);
  options.images.textures = GENERATE(convert::Textures::kKeep, convert::Textures::kRaw);
  options.images.block_zstd_level = GENERATE(0, 3);
  tests::must_convert(options);
  tests::must_verify(options.output);
  const auto packed = must(tests::open_packed(options.output));
  const auto images = packed.file.images();
  REQUIRE(images.size() == 4);  // equal images once
  for (uint32_t i = 0; i < 4; ++i) {
    const BlockRecipe& recipe = i == 3 ? of_dds : recipes[i];
    CHECK(images[i].codec == ImageCodec::kBlocks);
    CHECK(images[i].block_format == recipe.format);
    CHECK(images[i].width == recipe.width);
    CHECK(images[i].height == recipe.height);
    CHECK(images[i].channels == 4);
    REQUIRE(images[i].level_count == recipe.levels - 1);
    for (uint32_t l = 0; l < recipe.levels; ++l)
      CHECK(stored_blocks(packed.file, i, l) == tests::level_blocks(recipe, l));
  }
  using enum format::ChannelSource;
  CHECK(images[0].swizzle == format::make_swizzle(kOne, kRed, kGreen, kOne));
  CHECK(images[1].swizzle == format::kPlainSwizzle);
}

TEST_CASE("a large level lies in several pages, small ones share one", "[block_textures]") {
  const TempFolder folder;
  // Rows of 75 blocks of 16 bytes: 218 of them in a page. Level 1 has 145 rows of 38, 2 and 3 are 73 x 19 and 37 x 10.
  const BlockRecipe tall{.width = 300, .height = 1160, .levels = 8, .scheme = 2};
  const BlockRecipe plain{.vk_format = 37, .model = 1, .format = BlockFormat::kRgba8, .width = 1001, .height = 300};
  const BlockRecipe exact{.width = 1024, .height = 256, .levels = 11, .seed = 2};
  make_block_model(folder.file("in.glb"), {make_ktx2(tall), make_ktx2(plain), make_ktx2(exact)});
  convert::ConvertOptions options = tests::options_of(folder);
  options.images.block_zstd_level = GENERATE(0, 3);
  tests::must_convert(options);
  tests::must_verify(options.output);
  const auto packed = must(tests::open_packed(options.output));
  const auto images = packed.file.images();
  REQUIRE(images.size() == 3);
  CHECK(packed.file.pages()[images[0].page].raw_bytes == 218 * 75 * 16);
  const auto pages_of = [&](uint32_t image, uint32_t level) {
    const runtime::LevelPlace place = runtime::block_level_place(packed.file, image, level);
    return std::array{place.page - images[0].page, place.rows.pages()};
  };
  using Pages = std::array<uint32_t, 2>;
  CHECK(pages_of(0, 0) == Pages{0, 2});
  CHECK(pages_of(0, 1) == Pages{2, 1});
  CHECK(pages_of(0, 2) == Pages{3, 1});
  for (uint32_t l = 3; l < 8; ++l) CHECK(pages_of(0, l) == Pages{4, 1});
  CHECK(pages_of(1, 0) == Pages{5, 5});  // 65 rows of 4004 bytes in a page
  CHECK(pages_of(2, 0) == Pages{10, 1});
  CHECK(pages_of(2, 1) == Pages{11, 1});
  for (uint32_t l = 2; l < 11; ++l) CHECK(pages_of(2, l) == Pages{12, 1});
  runtime::BlockLevels in_turn(packed.file);  // keeps the last shared page
  for (const bool backwards : {false, true})
    for (uint32_t i = 0; i < 3; ++i) {
      const BlockRecipe& recipe = i == 0 ? tall : i == 1 ? plain : exact;
      for (uint32_t l = 0; l <= images[i].level_count; ++l) {
        const uint32_t level = backwards ? images[i].level_count - l : l;
        const std::vector<std::byte> expected = stored_blocks(packed.file, i, level);
        CHECK(expected == tests::level_blocks(recipe, level));
        std::vector<std::byte> blocks(expected.size());
        must(in_turn.read(i, level, blocks));
        CHECK(blocks == expected);
      }
    }
}

TEST_CASE("pages of blocks are compressed if that saves bytes, unless --zstd decides", "[block_textures]") {
  const TempFolder folder;
  const BlockRecipe recipe{.width = 256, .height = 256};
  FileBytes noise = make_ktx2(recipe);
  std::mt19937 random(1);
  for (size_t i = noise.size() - tests::level_blocks(recipe, 0).size(); i < noise.size(); ++i)
    noise[i] = static_cast<std::byte>(random());
  make_block_model(folder.file("in.glb"), {noise, make_ktx2(recipe)});
  const auto convert = [&](const std::vector<std::string>& more) {
    std::vector<std::string> words{"convert", folder.file("in.glb"), "-o", folder.file("out.scree"), "--force", "-q"};
    words.insert(words.end(), more.begin(), more.end());
    CHECK(tests::run_program(words, folder.file("log")).exit_code == 0);
    const auto packed = must(tests::open_packed(folder.file("out.scree")));
    const auto pages = packed.file.pages();
    const auto images = packed.file.images();
    REQUIRE(images.size() == 2);
    CHECK(pages[images[0].page].codec == format::PageCodec::kRaw);
    const bool has_all = !more.empty() && more.back() != "0";
    for (uint64_t p = 0; p < pages.size(); ++p)
      if (pages[p].kind == format::PageKind::kGeometry) CHECK((pages[p].codec != format::PageCodec::kRaw) == has_all);
    const std::string text(packed.file.string(packed.file.source().options));
    CHECK((text.find("--zstd") == std::string::npos) == more.empty());
    return pages[images[1].page].codec;
  };
  CHECK(convert({}) == format::PageCodec::kZstd);
  CHECK(convert({"--zstd", "1"}) == format::PageCodec::kZstd);
  CHECK(convert({"--zstd", "0"}) == format::PageCodec::kRaw);
}

TEST_CASE("stored levels are sampled as blocks, the others are made from the last stored level", "[block_textures]") {
  const TempFolder folder;
  make_block_model(folder.file("in.glb"), all_block_files());
  const convert::ConvertOptions options = tests::options_of(folder);
  tests::must_convert(options);
  const runtime::Scene scene = tests::must_load(options.output);
  const auto images = scene.container().images();
  REQUIRE(scene.view().texture_count == all_block_files().size());
  for (uint64_t t = 0; t < scene.view().texture_count; ++t) {
    const kernels::TextureView& texture = scene.view().textures[t];
    const uint32_t image = scene.container().textures()[t].image;
    INFO("image " << image << ", " << format::block_format_name(images[image].block_format));
    CHECK(texture.block_level_count == images[image].level_count + 1);
    CHECK(texture.level_count == format::most_block_levels(texture.width, texture.height) + 1);
    const std::vector<std::byte> last = stored_blocks(scene.container(), image, images[image].level_count);
    const runtime::MipChain made = runtime::make_mips(runtime::decode_block_level(
        texture.block_format, texture.swizzle, std::max(1u, texture.width >> images[image].level_count),
        std::max(1u, texture.height >> images[image].level_count), last.data()));
    for (uint32_t l = 0; l < texture.level_count; ++l) {
      std::vector<std::byte> blocks;
      if (l < texture.block_level_count) blocks = stored_blocks(scene.container(), image, l);
      const uint32_t width = std::max(1u, texture.width >> l), height = std::max(1u, texture.height >> l);
      for (uint32_t y = 0; y < height; ++y)
        for (uint32_t x = 0; x < width; ++x) {
          uint32_t expected;
          if (l < texture.block_level_count) {
            expected = format::block_image_pixel(texture.block_format, texture.swizzle,
                                                 reinterpret_cast<const uint8_t*>(blocks.data()), width, x, y);
          } else {
            std::memcpy(
                &expected,
                made.texels.data() + 4 * (made.level_offset[l - images[image].level_count] + uint64_t{y} * width + x),
                4);
          }
          uint32_t texels[4];
          kernels::TexelPlaces places;
          REQUIRE(kernels::place_stored<false>({}, texture, l, {x, x, 0}, {y, y, 0}, places));
          kernels::stored_texels<false>({}, texture, l, places, texels);
          REQUIRE((texels[0] & 0xffffff) == (expected & 0xffffff));
        }
    }
  }
}

TEST_CASE("a block-compressed texture is drawn and exported as its pixels", "[block_textures]") {
  const TempFolder folder;
  // Without their own levels, so that they have the same levels as the PNGs.
  const std::vector<FileBytes> files = {
      make_ktx2({.width = 100, .height = 60, .swizzle = "gbr1"}),
      make_dds({.format = BlockFormat::kBc5, .width = 31, .height = 31}, 83),
      make_ktx2({.vk_format = 15, .model = 1, .format = BlockFormat::kR8, .width = 50, .height = 20, .levels = 0}),
      make_ktx2({.vk_format = 0, .model = 166, .width = 41, .height = 19, .scheme = 2}),
      tests::make_basis_lz({.width = 53, .height = 30, .levels = 1}).bytes};
  make_block_model(folder.file("in.glb"), files);
  convert::ConvertOptions options = tests::options_of(folder);
  tests::must_convert(options);
  must(tools::export_gltf(must(tests::open_packed(options.output)).file, folder.file("back.glb"), {}));
  convert::ConvertOptions again = options;
  again.input = folder.file("back.glb");
  again.output = folder.file("again.scree");
  tests::must_convert(again);
  const runtime::Scene blocks = tests::must_load(options.output), pngs = tests::must_load(again.output);
  CHECK(blocks.container().images()[0].codec == ImageCodec::kBlocks);
  REQUIRE(pngs.container().images()[0].codec == ImageCodec::kPng);
  for (const uint32_t width : {40u, 300u}) CHECK(draw_scene(blocks, width) == draw_scene(pngs, width));

  // As JPEGs they are similar.
  options.images.textures = convert::Textures::kJpeg;
  options.output = folder.file("jpeg.scree");
  tests::must_convert(options);
  const runtime::Scene jpegs = tests::must_load(options.output);
  for (uint64_t i = 0; i < files.size(); ++i) CHECK(jpegs.container().images()[i].codec == ImageCodec::kIndexedJpeg);
  tests::must_verify(options.output);
}

TEST_CASE("an unsupported KTX2 is an error of one line, or grey with --keep-going", "[block_textures][bad]") {
  const TempFolder folder;
  FileBytes lost = tests::make_basis_lz({.levels = 1}).bytes;
  std::fill(lost.end() - 16, lost.end(), std::byte{0xff});
  FileBytes cut = make_ktx2({.width = 16, .height = 16, .scheme = 2});
  cut.back() ^= std::byte{0xff};
  for (const auto& [file, words] :
       {std::pair{make_ktx2({.vk_format = 143}), "of Vulkan format 143, which scree does not read: make it again"},
        std::pair{cut, "level 0: "}, std::pair{lost, "level 0: BasisLZ: "}}) {
    make_block_model(folder.file("in.glb"), {file});
    convert::ConvertOptions options = tests::options_of(folder);
    CHECK(refusal(convert::convert(options)).message.find("in.glb: image 0 (i0): KTX2: " + std::string(words)) !=
          std::string::npos);
    options.images.keep_going = true;
    tests::must_convert(options);
    const runtime::Scene scene = tests::must_load(options.output);
    CHECK(scene.container().images()[0].codec == ImageCodec::kIndexedJpeg);
    CHECK(scene.container().images()[0].width == 1);
  }
}

namespace {

/// The picture in linear light, with the default shading.
std::vector<float> linear(const runtime::Scene& scene, const tests::Frame& frame, uint32_t samples) {
  std::vector<float> out(uint64_t{4} * frame.width() * frame.height());
  kernels::BlendCounts blended;
  const runtime::PictureLight light =
      runtime::light_of_cpu(scene.view(), frame.view(), samples, frame.samples(), {}, 2);
  REQUIRE(runtime::linear_picture(scene.view(), frame.view(), samples, frame.samples(), {}, 2, light, out, blended));
  return out;
}

}  // namespace

TEST_CASE("a picture does not depend on the memory for pages of textures", "[block_textures][texel_pager]") {
  const TempFolder folder;
  make_block_model(folder.file("in.glb"), large_block_files());
  convert::ConvertOptions options = tests::options_of(folder);
  options.images.block_zstd_level = GENERATE(0, 3);
  const runtime::Reading reading = GENERATE(runtime::Reading::kAuto, runtime::Reading::kDirect);
  tests::must_convert(options);
  const runtime::Scene whole = tests::must_load(options.output, {.threads = 2});
  REQUIRE(whole.block_pager() == nullptr);
  for (const auto& [width, samples] : {std::pair{60u, 1u}, {60u, 4u}, {700u, 1u}, {500u, 2u}}) {
    const kernels::View view = tests::must_view(whole, {.width = width, .height = width * 2 / 3});
    const auto frame = tests::must_draw(whole, view, samples);
    const auto expected = must(frame.shade({}, 2));
    const std::vector<float> light = linear(whole, frame, samples);
    uint64_t needed = 0;  // pages read with room for all
    for (const uint64_t memory : {uint64_t{1} << 40, uint64_t{4} << 20, uint64_t{3} << 19}) {
      CAPTURE(width, samples, memory);
      const runtime::Scene paged =
          tests::must_load(options.output, {.threads = 2, .texture_memory = memory, .reading = reading});
      const runtime::BlockPager* const pager = paged.block_pager();
      REQUIRE(pager != nullptr);
      CHECK(pager->resident_bytes() == 0);
      const uint64_t bytes = pager->all_bytes() + paged.stats().texture_bytes;
      CHECK(bytes <= whole.stats().texture_bytes);
      CHECK(bytes + 16 * 40 > whole.stats().texture_bytes);  // levels in memory begin at multiples of 16
      const auto again = tests::must_draw(paged, view, samples);
      CHECK(must(again.shade({}, 2)) == expected);
      const uint64_t read = pager->stats().read_pages;
      CHECK(pager->resident_bytes() <= memory);
      if (needed == 0) {
        // A still camera's second frame reads nothing.
        REQUIRE(again.shade({}, 2));
        CHECK(pager->stats().read_pages == read);
        CHECK(pager->resident_bytes() == pager->stats().read_bytes);
        const bool is_smaller = pager->stats().stored_bytes < pager->stats().read_bytes;
        CHECK(is_smaller == (read != 0 && options.images.block_zstd_level != 0));
        CHECK((read != 0) == (width > 100));
        needed = read;
      }
      CHECK(read >= needed);
      CHECK(linear(paged, again, samples) == light);
    }
  }
  // Less than a single pixel needs.
  const runtime::Scene small = tests::must_load(options.output, {.texture_memory = 1});
  const kernels::View view = tests::must_view(small, {.width = 1500, .height = 1000});
  const auto frame = tests::must_draw(small, view);
  const auto refused = refusal(frame.shade({}, 2));
  CHECK(refused.code == ErrorCode::kMemory);
  CHECK(refused.message.starts_with("a pixel shows pages of textures of "));
  CHECK(refused.message.find(" bytes together, but 1 are allowed for them") != std::string::npos);
}

TEST_CASE("a picture that does not wait for pages of textures uses pages that fit",
          "[block_textures][texel_pager][cuda]") {
  const TempFolder folder;
  // Side by side, with pages of 256 and 64 KiB each.
  make_block_model(folder.file("in.glb"), {make_ktx2({.width = 1024, .height = 1024, .levels = 11}),
                                           make_ktx2({.width = 1024, .height = 1024, .levels = 11, .seed = 5})});
  const convert::ConvertOptions options = tests::options_of(folder);
  tests::must_convert(options);
  const runtime::Scene whole = tests::must_load(options.output, {.threads = 2});
  for (const bool on_gpu : {false, true}) {
    if (on_gpu && !tests::has_gpu()) break;
    uint64_t memory = uint64_t{1} << 40;
    for (const bool fits : {true, false}) {
      CAPTURE(on_gpu, memory);
      const runtime::Scene scene =
          tests::must_load(options.output, {.threads = 2, .texture_memory = memory, .device_texture_memory = memory});
      std::optional<runtime::DeviceScene> device;
      if (on_gpu) device = must(runtime::DeviceScene::upload(scene, 0, 2));
      runtime::DeviceScene* const gpu = on_gpu ? &*device : nullptr;
      runtime::BlockPager* const pager = on_gpu ? gpu->block_pager() : scene.block_pager();
      REQUIRE(pager != nullptr);
      const std::vector<uint8_t> exact = draw_scene(scene, 700, gpu);
      pager->set_patience([] { return true; });
      CHECK((draw_scene(scene, 700, gpu) == exact) == fits);
      CHECK((pager->missing_bytes() == 0) == fits);
      CHECK(pager->missing_bytes() <= pager->all_bytes());
      CHECK(pager->resident_bytes() <= memory);
      pager->set_patience({});
      CHECK(draw_scene(scene, 700, gpu) == exact);
      CHECK(pager->missing_bytes() == 0);
      if (!on_gpu) CHECK(exact == draw_scene(whole, 700));
      memory = pager->resident_bytes() - 1;  // a page too few
    }
  }
}

TEST_CASE("pages that were needed longest ago are evicted first", "[block_textures][texel_pager]") {
  const TempFolder folder;
  make_block_model(folder.file("in.glb"), {make_ktx2({.width = 1024, .height = 1024})});
  const convert::ConvertOptions options = tests::options_of(folder);
  tests::must_convert(options);
  const auto file = must(runtime::SceneFile::open(options.output));
  const bool is_direct = GENERATE(false, true) && runtime::DirectFile::open(file.map());
  runtime::HostBlockPager pager(file.map(), file.container(), 2 * format::kBlockPageBytes, 2,
                                is_direct ? runtime::Reading::kDirect : runtime::Reading::kBuffered);
  for (uint32_t page = 0; page < 4; ++page) pager.add(file.container().images()[0].page + page);
  const auto round = [&](const std::vector<uint64_t>& wanted) {
    pager.begin_round();
    bool are_there = true;
    for (const uint64_t page : wanted) are_there = kernels::want_page(pager.pages(), page) != nullptr && are_there;
    return are_there;
  };
  const auto bring = [&](const std::vector<uint64_t>& wanted) {
    CHECK_FALSE(round(wanted));
    const auto brought = pager.bring(false);
    REQUIRE(brought);
    return *brought;
  };
  CHECK(bring({0, 1}));
  CHECK(round({0}));
  CHECK(bring({2}));
  CHECK(round({0, 2}));  // 1 was needed before 0
  CHECK(bring({3, 2}));
  CHECK(round({2, 3}));
  CHECK_FALSE(bring({1, 2, 3}));  // one too many
  CHECK(round({2, 3}));
  CHECK(pager.resident_bytes() == 2 * format::kBlockPageBytes);
  CHECK(pager.stats().read_pages == 4);
  CHECK(bring({1}));
  CHECK(pager.stats().read_pages == 5);
  // A page that comes again is left in the page cache.
  CHECK(pager.stats().direct_pages == (is_direct ? 4 : 0));
}

TEST_CASE("a page of a texture is checked when it is read", "[block_textures][texel_pager][bad]") {
  const TempFolder folder;
  make_block_model(folder.file("in.glb"), {large_block_files()[0]});
  convert::ConvertOptions options = tests::options_of(folder);
  options.images.block_zstd_level = GENERATE(0, 3);
  tests::must_convert(options);
  uint64_t offset = 0;
  {
    const auto packed = must(tests::open_packed(options.output));
    offset = packed.file.pages()[packed.file.images()[0].page + 1].offset;
  }
  tests::damage(options.output, offset + 100);
  CHECK_FALSE(runtime::Scene::open(options.output, {}));
  const runtime::Scene scene = tests::must_load(options.output, {.texture_memory = uint64_t{1} << 30});
  const kernels::View view = tests::must_view(scene, {.width = 1500, .height = 1000});
  const auto frame = tests::must_draw(scene, view);
  for (int time = 0; time < 2; ++time) {
    const auto refused = refusal(frame.shade({}, 2));
    CHECK(refused.code == ErrorCode::kChecksum);
    CHECK(refused.message.starts_with("page "));
  }
}

TEST_CASE("block-compressed textures are equal on the GPU", "[cuda]") {
  if (!tests::has_gpu()) return;
  const TempFolder folder;
  make_block_model(folder.file("in.glb"), all_block_files());
  convert::ConvertOptions options = tests::options_of(folder);
  options.encoding = GENERATE(convert::Encoding::kIndexed, convert::Encoding::kClustered);
  tests::must_convert(options);
  const runtime::Scene scene = tests::must_load(options.output);
  auto device = must(runtime::DeviceScene::upload(scene, 0, 2));
  for (const uint32_t width : {60u, tests::kEmulatesGpu ? 150u : 900u}) {
    const std::vector<uint8_t> on_cpu = draw_scene(scene, width);
    CHECK(tests::differing(on_cpu, draw_scene(scene, width, &device)) <= on_cpu.size() / 10000);
  }
}

TEST_CASE("a GPU's picture does not depend on the memory for pages of textures", "[cuda][texel_pager]") {
  if (!tests::has_gpu()) return;
  const TempFolder folder;
  make_block_model(folder.file("in.glb"), large_block_files());
  convert::ConvertOptions options = tests::options_of(folder);
  options.images.block_zstd_level = GENERATE(0, 3);
  options.encoding = GENERATE(convert::Encoding::kIndexed, convert::Encoding::kClustered);
  tests::must_convert(options);
  const runtime::Scene whole = tests::must_load(options.output);
  auto all_there = must(runtime::DeviceScene::upload(whole, 0, 2));
  CHECK(all_there.block_pager() == nullptr);
  for (const uint32_t width : {60u, 700u}) {
    const std::vector<uint8_t> expected = draw_scene(whole, width, &all_there);
    for (const uint64_t memory : {uint64_t{1} << 40, uint64_t{4} << 20, uint64_t{5} << 18}) {
      CAPTURE(width, memory);
      const runtime::Scene paged =
          tests::must_load(options.output, {.threads = 2, .texture_memory = memory, .device_texture_memory = memory});
      auto device = must(runtime::DeviceScene::upload(paged, 0, 2));
      const runtime::BlockPager* const pager = device.block_pager();
      REQUIRE(pager != nullptr);
      CHECK(pager->resident_bytes() == 0);
      const uint64_t spared = pager->all_bytes() - std::min(pager->all_bytes(), memory);
      CHECK(device.stats().device_bytes + spared < all_there.stats().device_bytes + (uint64_t{1} << 20));
      CHECK(draw_scene(paged, width, &device) == expected);
      const uint64_t read = pager->stats().read_pages;
      CHECK((read != 0) == (width > 100));
      CHECK(pager->resident_bytes() <= memory);
      CHECK(paged.block_pager()->stats().read_pages == 0);
      if (memory < uint64_t{1} << 40) continue;
      CHECK(draw_scene(paged, width, &device) == expected);  // a still camera's second picture reads nothing
      CHECK(pager->stats().read_pages == read);
    }
  }
}

TEST_CASE("a GPU samples pages of textures in host memory that its room does not hold", "[cuda][texel_pager]") {
  if (!tests::has_gpu()) return;
  const TempFolder folder;
  make_block_model(folder.file("in.glb"), large_block_files());
  const convert::ConvertOptions options = tests::options_of(folder);
  tests::must_convert(options);
  const runtime::Scene whole = tests::must_load(options.output);
  auto all_there = must(runtime::DeviceScene::upload(whole, 0, 2));
  // Near the middle of one of the first three grids.
  const auto draw_near = [&](const runtime::Scene& scene, double grid, runtime::DeviceScene& device) {
    const double x = 0.5 + 1.1 * grid;
    const kernels::View view = tests::must_view(
        whole, {.eye = Vec3{x, 0.12, 0.5}, .target = Vec3{x + 0.02, 0, 0.42}, .width = 240, .height = 160});
    return tests::must_picture(scene, view, 1, &device);
  };
  std::vector<std::vector<uint8_t>> expected;
  for (uint32_t i = 0; i < 3; ++i) expected.push_back(draw_near(whole, i, all_there));
  uint64_t shown = 0;  // bytes of all pages that the pictures show
  for (const bool is_small : {false, true}) {
    const uint64_t room = is_small ? shown / 2 : uint64_t{1} << 40;
    for (const uint64_t host : {uint64_t{1} << 30, uint64_t{3} << 19}) {  // of all pages, and of some of them
      CAPTURE(room, host);
      const runtime::Scene paged =
          tests::must_load(options.output, {.threads = 2, .texture_memory = 1, .device_texture_memory = room});
      auto device =
          must(runtime::DeviceScene::upload(paged, 0, 2, runtime::Reading::kAuto, runtime::kDeviceTextureCache, host));
      const runtime::BlockPager& pager = *device.block_pager();
      const bool keeps_all = pager.kept_bytes() != 0;
      CHECK(keeps_all == (host == uint64_t{1} << 30));
      CHECK(pager.stats().read_pages == 0);
      for (uint32_t i = 0; i < 6; ++i) {
        CHECK(draw_near(paged, i % 3, device) == expected[i % 3]);
        CHECK(pager.resident_bytes() <= room);
        CHECK(pager.kept_bytes() <= host);
      }
      CHECK((pager.stats().read_pages == 0) == keeps_all);
      CHECK((pager.kept_bytes() != 0) == (keeps_all || is_small));
      CHECK(pager.resident_bytes() != 0);
      if (!is_small) shown = pager.resident_bytes();
      if (keeps_all) CHECK(pager.copied_bytes() != 0);
    }
  }
}

TEST_CASE("pages of textures that are kept in host memory are checked", "[cuda][texel_pager][bad]") {
  if (!tests::has_gpu()) return;
  const TempFolder folder;
  make_block_model(folder.file("in.glb"), {large_block_files()[0]});
  const convert::ConvertOptions options = tests::options_of(folder);
  tests::must_convert(options);
  const runtime::Scene scene = tests::must_load(options.output, {.texture_memory = 1, .device_texture_memory = 1});
  tests::damage(options.output, scene.container().pages()[scene.block_pager()->file_pages()[1]].offset + 100);
  check_refusal(runtime::DeviceScene::upload(scene, 0, 2, runtime::Reading::kAuto, runtime::kDeviceTextureCache,
                                             uint64_t{1} << 30),
                ErrorCode::kChecksum, options.output + ": page ");
}

TEST_CASE("chunks and pages of textures share a GPU's memory", "[cuda][texel_pager]") {
  if (!tests::has_gpu()) return;
  const TempFolder folder;
  make_block_model(folder.file("in.glb"), large_block_files(), 200);
  convert::ConvertOptions options = tests::options_of(folder);
  options.encoding = convert::Encoding::kIndexed;
  tests::must_convert(options);
  const runtime::Scene whole = tests::must_load(options.output);
  auto all_there = must(runtime::DeviceScene::upload(whole, 0, 2));
  constexpr uint64_t kUsual = uint64_t{1} << 16;  // less than some pixels show
  for (const uint64_t limit : {~uint64_t{0}, uint64_t{5} << 18}) {
    const runtime::Scene scene = tests::must_load(options.output, {.threads = 2,
                                                                   .texture_memory = 1,
                                                                   .device_texture_memory = kUsual,
                                                                   .device_texture_limit = limit,
                                                                   .pages = false});
    const uint64_t least = tests::least_device_memory(refusal(runtime::DeviceScene::upload(scene, 1, 2)).message);
    for (const uint64_t more : {uint64_t{3} << 18, uint64_t{3} << 19}) {
      if (tests::kEmulatesGpu && (more == uint64_t{3} << 18) != (limit == ~uint64_t{0})) continue;
      auto device = must(runtime::DeviceScene::upload(scene, least + more, 2));
      REQUIRE(device.is_streamed());
      const runtime::BlockPager& pager = *device.block_pager();
      const uint64_t first_room = pager.room_bytes();
      std::set<uint64_t> rooms = {first_room};
      for (const bool is_close : {false, true, true, false, false, true}) {
        CAPTURE(limit, more, is_close, pager.room_bytes());
        runtime::CameraOptions camera{.width = 240, .height = 160};
        if (is_close) {
          camera.eye = {0.5, 0.12, 0.5};
          camera.target = {0.52, 0, 0.42};
        }
        const kernels::View view = tests::must_view(whole, camera);
        CHECK(tests::must_picture(scene, view, 1, &device) == tests::must_picture(whole, view, 1, &all_there));
        CHECK(pager.resident_bytes() <= pager.room_bytes());
        CHECK(pager.room_bytes() <= std::max(limit, first_room));
        rooms.insert(pager.room_bytes());
      }
      CHECK(rooms.size() > 1);
      CHECK(pager.stats().read_pages != 0);
    }
  }
}

TEST_CASE("pages of textures that do not fit a GPU or are damaged are errors of one line", "[cuda][texel_pager][bad]") {
  if (!tests::has_gpu()) return;
  const TempFolder folder;
  make_block_model(folder.file("in.glb"), {large_block_files()[0]});
  const convert::ConvertOptions options = tests::options_of(folder);
  tests::must_convert(options);
  const auto refused = [&](uint64_t memory) {
    const runtime::Scene scene =
        tests::must_load(options.output, {.texture_memory = 1, .device_texture_memory = memory});
    auto device = must(runtime::DeviceScene::upload(scene, 0, 2));
    const kernels::View view = tests::must_view(scene, {.width = 1500, .height = 1000});
    const auto frame = tests::must_draw(scene, view, 1, &device);
    const auto shaded = refusal(frame.shade({}, 2));
    CHECK_FALSE(frame.shade({}, 2));
    return shaded;
  };
  const Error small = refused(1);
  CHECK(small.code == ErrorCode::kMemory);
  CHECK(small.message.starts_with("a pixel shows pages of textures of "));
  {
    const runtime::Scene scene = tests::must_load(options.output, {.texture_memory = 1});
    for (const uint32_t page : scene.block_pager()->file_pages())
      tests::damage(options.output, scene.container().pages()[page].offset + 100);
  }
  const Error damaged = refused(uint64_t{1} << 30);
  CHECK(damaged.code == ErrorCode::kChecksum);
  CHECK(damaged.message.starts_with("page "));
}
