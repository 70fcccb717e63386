// As test_record_rules.cpp: the rules for images, masks, surfaces and lights.
#include "format/blocks/format.h"
#include "format/bytes.h"
#include "format/container/container.h"
#include "tests/catch.h"
#include "tests/format/container/container_breaker.h"

namespace scree::tests {
namespace {

using namespace scree::format;

/// An image of BC1 blocks in page 3, with its levels from mip level 0 on.
ImageRecord bc1_image(ImageRecord image, uint32_t width, uint32_t height, uint32_t level_count) {
  image.codec = ImageCodec::kBlocks;
  image.page = 3;
  image.width = width;
  image.height = height;
  image.channels = 4;
  image.block_format = BlockFormat::kBc1;
  image.swizzle = kOpaqueSwizzle;
  image.first_level = 0;
  image.level_count = level_count;
  return image;
}

TEST_CASE("container rules: indexed JPEGs and their mip levels", "[container]") {
  scree::tests::Parts parts = full_parts();
  // 300 x 130 has levels of 150 x 65 and 75 x 32 pixels; 60 x 60 has none.
  parts.pages.push_back(seal_page(PageKind::kImage, Bytes(96, std::byte{1}), 0));
  ImageRecord small = parts.tables.images[0];
  small.codec = ImageCodec::kIndexedJpeg;
  small.page = 3;
  small.width = small.height = 60;
  ImageRecord large = small;
  large.width = 300;
  large.height = 130;
  large.channels = 1;
  large.first_level = 0;
  large.level_count = 2;
  parts.tables.images.push_back(small);
  parts.tables.images.push_back(large);
  parts.tables.mip_levels = {{0, 64, 3, 2}, {64, 32, 3, 2}};
  const Breaker b(parts);

  using I = ImageRecord;
  constexpr TableKind i = TableKind::kImages;
  b.record<I>(
      i, 2, [](I& r) { r.width = 65536; }, "image 2: 65536 x 130 pixels, expected 1 to 65535");
  b.record<I>(
      i, 1, [](I& r) { r.channels = 2; }, "image 1: 2 channels");
  b.record<I>(
      i, 1, [](I& r) { r.channels = 4; }, "image 1: 4 channels");
  b.record<I>(
      i, 2, [](I& r) { r.level_count = 1; }, "image 2: 1 mip levels, expected 2");
  b.record<I>(
      i, 2, [](I& r) { r.level_count = UINT32_MAX; }, "image 2: 4294967295 mip levels, expected 2");
  b.record<I>(
      i, 2, [](I& r) { r.first_level = 1; }, "image 2: mip levels from 1, expected 0");
  b.record<I>(
      i, 1, [](I& r) { r.first_level = 0; }, "image 1: mip levels from 0, expected 4294967295");
  b.record<I>(
      i, 2, [](I& r) { r.width = 127, r.height = 1, r.level_count = 0, r.first_level = kNone; },
      "mip level 0: belongs to no image");
  b.record<I>(
      i, 2, [](I& r) { r.width = 600, r.level_count = 3; }, "image 2: mip level 2, but the file has 2 mip levels");

  using L = MipLevelRecord;
  constexpr TableKind l = TableKind::kMipLevels;
  b.record<L>(
      l, 1, [](L& r) { r.image = 1; }, "mip level 1: image 1, expected 2");
  b.record<L>(
      l, 0, [](L& r) { r.page = 4; }, "mip level 0: page 4, but the file has 4 pages");
  b.record<L>(
      l, 0, [](L& r) { r.page = 0; }, "mip level 0: page 0 is of kind 1, which holds no image");
  b.record<L>(
      l, 0, [](L& r) { r.offset = 8; }, "mip level 0: 64 bytes at byte 8 of page 3, which has 96");
  b.record<L>(
      l, 1, [](L& r) { r.bytes = 33; }, "mip level 1: 33 bytes at byte 64 of page 3, which has 96");
  b.record<L>(
      l, 1, [](L& r) { r.bytes = UINT64_MAX; },
      "mip level 1: 18446744073709551615 bytes at byte 64 of page 3, which has 96");
}

TEST_CASE("container rules: surfaces and lights", "[container]") {
  scree::tests::Parts parts = full_parts();
  SurfaceRecord surface{};
  surface.ior = 1.5f;
  for (SurfaceTexture& use : surface.textures) use = {kNone, {0, 0}, {1, 1}, 0};
  parts.tables.surfaces = {surface, surface};
  parts.tables.surfaces[1].material = 1;
  parts.tables.surfaces[1].textures[2].texture = 0;
  LightRecord spot{};
  spot.kind = LightKind::kSpot;
  spot.outer_cone = 1;
  parts.tables.lights = {spot};
  const Breaker b(parts);

  using S = SurfaceRecord;
  constexpr TableKind s = TableKind::kSurfaces;
  b.record<S>(
      s, 0, [](S& r) { r.material = 2; }, "surface 0: material 2, but the file has 2 materials");
  b.record<S>(
      s, 1, [](S& r) { r.material = 0; }, "surface 1: material 0, expected 1 or more");
  b.record<S>(
      s, 0, [](S& r) { r.second_uv = 1; }, "surface 0: second uv of textures 1", ErrorCode::kReserved);
  b.record<S>(
      s, 0, [](S& r) { r.specular_color[2] = kInfinity; }, "surface 0: a factor that is not finite");
  b.record<S>(
      s, 0, [](S& r) { r.metallic = 1.5f; }, "surface 0: a factor of 1.5, expected 0 to 1");
  b.record<S>(
      s, 0, [](S& r) { r.occlusion_strength = -1; }, "surface 0: a factor of -1, expected 0 to 1");
  b.record<S>(
      s, 0, [](S& r) { r.emission[1] = -1; }, "surface 0: a colour below 0");
  b.record<S>(
      s, 0, [](S& r) { r.ior = 0.5f; }, "surface 0: index of refraction 0.5, expected 0, or 1 or more");
  b.record<S>(
      s, 1, [](S& r) { r.textures[2].texture = 1; }, "surface 1: texture 1, but the file has 1 textures");
  b.record<S>(
      s, 1, [](S& r) { r.textures[5].uv_rotation = float(kNan); }, "surface 1: a texture transform that is not finite");

  using L = LightRecord;
  constexpr TableKind l = TableKind::kLights;
  b.record<L>(
      l, 0, [](L& r) { r.name = kNone; },
      ("light 0: string at 4294967295, but the strings take " + std::to_string(parts.tables.strings.bytes().size()) +
       " bytes")
          .c_str());
  b.record<L>(
      l, 0, [](L& r) { r.node = 4; }, "light 0: node 4, but the file has 4 nodes");
  b.record<L>(
      l, 0, [](L& r) { r.kind = LightKind{4}; }, "light 0: kind 4");
  b.record<L>(
      l, 0, [](L& r) { r.reserved2 = 1; }, "light 0: a reserved field is set", ErrorCode::kReserved);
  b.record<L>(
      l, 0, [](L& r) { r.range = kInfinity; }, "light 0: a number that is not finite");
  b.record<L>(
      l, 0, [](L& r) { r.intensity = -2; }, "light 0: -2, expected 0 or more");
  b.record<L>(
      l, 0, [](L& r) { r.inner_cone = 1; }, "light 0: a cone from 1 to 1");
  b.record<L>(
      l, 0, [](L& r) { r.kind = LightKind::kPoint; }, "light 0: a cone from 0 to 1");
}

TEST_CASE("container rules: masks", "[container][mask]") {
  scree::tests::Parts parts = full_parts();
  // 5 x 3, 2 x 1 and 1 x 1 texels.
  parts.pages.push_back(seal_page(PageKind::kMask, Bytes(18, std::byte{1}), 0));
  MaskRecord mask{};
  mask.page = 3;
  mask.width = 5;
  mask.height = 3;
  mask.level_count = 3;
  mask.threshold = kMaxMaskThreshold;
  mask.wrap_s = Wrap::kClamp;
  mask.flags = kMaskNearest;
  mask.place[0][0] = mask.place[1][1] = 1;
  parts.tables.masks = {mask, mask};
  parts.tables.masks[1].material = 1;
  const Bytes file = file_of(parts);
  CHECK(load<FileHeader>(file.data()).version_minor == 1);
  CHECK(load<FileHeader>(file_of(full_parts()).data()).version_minor == 0);
  const Breaker b(parts);

  using M = MaskRecord;
  constexpr TableKind m = TableKind::kMasks;
  b.record<M>(
      m, 1, [](M& r) { r.material = 2; }, "mask 1: material 2, but the file has 2 materials");
  b.record<M>(
      m, 1, [](M& r) { r.material = 0; }, "mask 1: material 0 after material 0, expected ascending order");
  b.record<M>(
      m, 0, [](M& r) { r.page = 4; }, "mask 0: page 4, but the file has 4 pages");
  b.record<M>(
      m, 0, [](M& r) { r.page = 2; }, "mask 0: page 2 is of kind 2, which holds no mask");
  b.record<M>(
      m, 0, [](M& r) { r.width = 0; }, "mask 0: 0 x 3 texels, expected 1 to 65536");
  b.record<M>(
      m, 0, [](M& r) { r.height = 65537; }, "mask 0: 5 x 65537 texels, expected 1 to 65536");
  b.record<M>(
      m, 0, [](M& r) { r.level_count = 0; }, "mask 0: 0 levels, expected 1 to 3");
  b.record<M>(
      m, 0, [](M& r) { r.level_count = 4; }, "mask 0: 4 levels, expected 1 to 3");
  b.record<M>(
      m, 0, [](M& r) { r.level_count = UINT32_MAX; }, "mask 0: 4294967295 levels, expected 1 to 3");
  b.record<M>(
      m, 0, [](M& r) { r.level_count = 2; }, "mask 0: page 3 has 18 bytes, expected 17");
  b.record<M>(
      m, 0, [](M& r) { r.width = r.height = 65536; }, "mask 0: page 3 has 18 bytes, expected 5637144576");
  b.record<M>(
      m, 0, [](M& r) { r.threshold = 0; }, "mask 0: threshold 0, expected 1 to 16711680");
  b.record<M>(
      m, 0, [](M& r) { r.threshold = kMaxMaskThreshold + 1; }, "mask 0: threshold 16711681, expected 1 to 16711680");
  b.record<M>(
      m, 0, [](M& r) { r.wrap_t = Wrap{3}; }, "mask 0: wrap 2 and 3");
  b.record<M>(
      m, 0, [](M& r) { r.flags = 4; }, "mask 0: flags 4", ErrorCode::kReserved);
  b.record<M>(
      m, 1, [](M& r) { r.place[1][2] = kInfinity; }, "mask 1: a transform that is not finite");
}

TEST_CASE("container rules: block images and their mip levels", "[container]") {
  scree::tests::Parts parts = full_parts();
  // 9 x 6 pixels of BC1 have 3 x 2 blocks; its levels of 4 x 3 and 2 x 1 have one each.
  parts.pages.push_back(seal_page(PageKind::kImage, Bytes(48, std::byte{1}), 0));
  parts.pages.push_back(seal_page(PageKind::kImage, Bytes(24, std::byte{2}), 0));
  parts.tables.images.push_back(bc1_image(parts.tables.images[0], 9, 6, 2));
  parts.tables.mip_levels = {{0, 8, 4, 1}, {16, 8, 4, 1}};
  const Breaker b(parts);

  using I = ImageRecord;
  constexpr TableKind i = TableKind::kImages;
  b.record<I>(
      i, 1, [](I& r) { r.block_format = BlockFormat::kNoBlocks; }, "image 1: block format 0, swizzle 2696");
  b.record<I>(
      i, 1, [](I& r) { r.block_format = BlockFormat{6}; }, "image 1: block format 6, swizzle 2696");
  b.record<I>(
      i, 1, [](I& r) { r.block_format = BlockFormat{11}; }, "image 1: block format 11, swizzle 2696");
  b.record<I>(
      i, 1, [](I& r) { r.swizzle = 6; }, "image 1: block format 1, swizzle 6");
  b.record<I>(
      i, 1, [](I& r) { r.swizzle |= 0x8000; }, "image 1: block format 1, swizzle 35464");
  b.record<I>(
      i, 1, [](I& r) { r.channels = 3; }, "image 1: 3 channels, but BC1 has 4");
  b.record<I>(
      i, 1, [](I& r) { r.width = 13; }, "image 1: page 3 has 48 bytes, expected 64");
  b.record<I>(
      i, 1, [](I& r) { r.width = 65537; }, "image 1: 65537 x 6 pixels, expected 1 to 65536");
  b.record<I>(
      i, 1, [](I& r) { r.level_count = 4; }, "image 1: 4 mip levels, expected at most 3");
  b.record<I>(
      i, 1, [](I& r) { r.level_count = 3; }, "image 1: mip level 2, but the file has 2 mip levels");

  using L = MipLevelRecord;
  constexpr TableKind l = TableKind::kMipLevels;
  b.record<L>(
      l, 1, [](L& r) { r.bytes = 7; }, "mip level 1: 7 bytes, expected 8");
  b.record<L>(
      l, 0, [](L& r) { r.bytes = 16; }, "mip level 0: 16 bytes, expected 8");
}

TEST_CASE("container rules: levels of blocks in several pages", "[container]") {
  scree::tests::Parts parts = full_parts();
  // 4096 x 1028 pixels of BC1 have 257 rows of 8192 bytes; 32 rows are a page. Level 1 has 129 rows, 64 in a page.
  const auto add_pages = [&](size_t count, size_t last) {
    for (size_t i = 0; i < count; ++i)
      parts.pages.push_back(seal_page(PageKind::kImage, Bytes(i + 1 == count ? last : kBlockPageBytes), 0));
  };
  add_pages(9, 8192);
  add_pages(3, 4096);
  parts.tables.images.push_back(bc1_image(parts.tables.images[0], 4096, 1028, 1));
  parts.tables.mip_levels = {{0, 129 * 4096, 12, 1}};
  const Breaker b(parts);

  using I = ImageRecord;
  constexpr TableKind i = TableKind::kImages;
  b.record<I>(
      i, 1, [](I& r) { r.page = 4; }, "image 1: page 11 has 8192 bytes, expected 262144");
  b.record<I>(
      i, 1, [](I& r) { r.page = 12; }, "image 1: page 14 has 4096 bytes, expected 262144");
  b.record<I>(
      i, 1, [](I& r) { r.height = 1032; }, "image 1: page 11 has 8192 bytes, expected 16384");
  using L = MipLevelRecord;
  constexpr TableKind l = TableKind::kMipLevels;
  b.record<L>(
      l, 0, [](L& r) { r.page = 13; }, "mip level 0: page 14 has 4096 bytes, expected 262144");
  b.record<L>(
      l, 0, [](L& r) { r.offset = 16; }, "mip level 0: at byte 16 of its first page");
  b.record<L>(
      l, 0, [](L& r) { r.bytes = 4096; }, "mip level 0: 4096 bytes, expected 528384");
  using P = PageRecord;
  b.record<P>(
      TableKind::kPages, 8, [](P& r) { r.kind = PageKind{7}; }, "image 1: page 8 is of kind 7, which holds no image");
}

}  // namespace
}  // namespace scree::tests
