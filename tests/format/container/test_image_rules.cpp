// As test_record_rules.cpp, for images, masks, surfaces and lights.
#include "format/blocks/format.h"
#include "format/bytes.h"
#include "format/container/container.h"
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
  // 300 x 130 pixels have levels of 150 x 65 and 75 x 32; 60 x 60 pixels have none.
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
  const auto images = b.records<I>(TableKind::kImages);
  images(2, "image 2: 65536 x 130 pixels, expected 1 to 65535", [](I& r) { r.width = 65536; });
  images(1, "image 1: 2 channels", [](I& r) { r.channels = 2; });
  images(1, "image 1: 4 channels", [](I& r) { r.channels = 4; });
  images(2, "image 2: 1 mip levels, expected 2", [](I& r) { r.level_count = 1; });
  images(2, "image 2: 4294967295 mip levels, expected 2", [](I& r) { r.level_count = UINT32_MAX; });
  images(2, "image 2: mip levels from 1, expected 0", [](I& r) { r.first_level = 1; });
  images(1, "image 1: mip levels from 0, expected 4294967295", [](I& r) { r.first_level = 0; });
  images(2, "mip level 0: belongs to no image",
         [](I& r) { r.width = 127, r.height = 1, r.level_count = 0, r.first_level = kNone; });
  images(2, "image 2: mip level 2, but the file has 2 mip levels", [](I& r) { r.width = 600, r.level_count = 3; });

  using L = MipLevelRecord;
  const auto levels = b.records<L>(TableKind::kMipLevels);
  levels(1, "mip level 1: image 1, expected 2", [](L& r) { r.image = 1; });
  levels(0, "mip level 0: page 4, but the file has 4 pages", [](L& r) { r.page = 4; });
  levels(0, "mip level 0: page 0 is of kind 1, which holds no image", [](L& r) { r.page = 0; });
  levels(0, "mip level 0: 64 bytes at byte 8 of page 3, which has 96", [](L& r) { r.offset = 8; });
  levels(1, "mip level 1: 33 bytes at byte 64 of page 3, which has 96", [](L& r) { r.bytes = 33; });
  levels(1, "mip level 1: 18446744073709551615 bytes at byte 64 of page 3, which has 96",
         [](L& r) { r.bytes = UINT64_MAX; });
}

TEST_CASE("container rules: surfaces and lights", "[container]") {
  scree::tests::Parts parts = full_parts();
  SurfaceRecord surface{.ior = 1.5f};
  for (SurfaceTexture& use : surface.textures) use = {kNone, {0, 0}, {1, 1}, 0};
  parts.tables.surfaces = {surface, surface};
  parts.tables.surfaces[1].material = 1;
  parts.tables.surfaces[1].textures[2].texture = 0;
  const LightRecord spot{.kind = LightKind::kSpot, .outer_cone = 1};
  parts.tables.lights = {spot};
  const Breaker b(parts);

  using S = SurfaceRecord;
  const auto surfaces = b.records<S>(TableKind::kSurfaces);
  surfaces(0, "surface 0: material 2, but the file has 2 materials", [](S& r) { r.material = 2; });
  surfaces(1, "surface 1: material 0, expected 1 or more", [](S& r) { r.material = 0; });
  surfaces(0, ErrorCode::kReserved, "surface 0: second uv of textures 1", [](S& r) { r.second_uv = 1; });
  surfaces(0, "surface 0: a factor that is not finite", [](S& r) { r.specular_color[2] = kInfinity; });
  surfaces(0, "surface 0: a factor of 1.5, expected 0 to 1", [](S& r) { r.metallic = 1.5f; });
  surfaces(0, "surface 0: a factor of -1, expected 0 to 1", [](S& r) { r.occlusion_strength = -1; });
  surfaces(0, "surface 0: a colour below 0", [](S& r) { r.emission[1] = -1; });
  surfaces(0, "surface 0: index of refraction 0.5, expected 0, or 1 or more", [](S& r) { r.ior = 0.5f; });
  surfaces(1, "surface 1: texture 1, but the file has 1 textures", [](S& r) { r.textures[2].texture = 1; });
  surfaces(1, "surface 1: a texture transform that is not finite",
           [](S& r) { r.textures[5].uv_rotation = float(kNan); });

  using L = LightRecord;
  const auto lights = b.records<L>(TableKind::kLights);
  lights(0, b.bad_string("light 0", kNone), [](L& r) { r.name = kNone; });
  lights(0, "light 0: node 4, but the file has 4 nodes", [](L& r) { r.node = 4; });
  lights(0, "light 0: kind 4", [](L& r) { r.kind = LightKind{4}; });
  lights(0, ErrorCode::kReserved, "light 0: a reserved field is set", [](L& r) { r.reserved2 = 1; });
  lights(0, "light 0: a number that is not finite", [](L& r) { r.range = kInfinity; });
  lights(0, "light 0: -2, expected 0 or more", [](L& r) { r.intensity = -2; });
  lights(0, "light 0: a cone from 1 to 1", [](L& r) { r.inner_cone = 1; });
  lights(0, "light 0: a cone from 0 to 1", [](L& r) { r.kind = LightKind::kPoint; });
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
  const auto masks = b.records<M>(TableKind::kMasks);
  masks(1, "mask 1: material 2, but the file has 2 materials", [](M& r) { r.material = 2; });
  masks(1, "mask 1: material 0 after material 0, expected ascending order", [](M& r) { r.material = 0; });
  masks(0, "mask 0: page 4, but the file has 4 pages", [](M& r) { r.page = 4; });
  masks(0, "mask 0: page 2 is of kind 2, which holds no mask", [](M& r) { r.page = 2; });
  masks(0, "mask 0: 0 x 3 texels, expected 1 to 65536", [](M& r) { r.width = 0; });
  masks(0, "mask 0: 5 x 65537 texels, expected 1 to 65536", [](M& r) { r.height = 65537; });
  masks(0, "mask 0: 0 levels, expected 1 to 3", [](M& r) { r.level_count = 0; });
  masks(0, "mask 0: 4 levels, expected 1 to 3", [](M& r) { r.level_count = 4; });
  masks(0, "mask 0: 4294967295 levels, expected 1 to 3", [](M& r) { r.level_count = UINT32_MAX; });
  masks(0, "mask 0: page 3 has 18 bytes, expected 17", [](M& r) { r.level_count = 2; });
  masks(0, "mask 0: page 3 has 18 bytes, expected 5637144576", [](M& r) { r.width = r.height = 65536; });
  masks(0, "mask 0: threshold 0, expected 1 to 16711680", [](M& r) { r.threshold = 0; });
  masks(0, "mask 0: threshold 16711681, expected 1 to 16711680", [](M& r) { r.threshold = kMaxMaskThreshold + 1; });
  masks(0, "mask 0: wrap 2 and 3", [](M& r) { r.wrap_t = Wrap{3}; });
  masks(0, ErrorCode::kReserved, "mask 0: flags 4", [](M& r) { r.flags = 4; });
  masks(1, "mask 1: a transform that is not finite", [](M& r) { r.place[1][2] = kInfinity; });
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
  const auto images = b.records<I>(TableKind::kImages);
  images(1, "image 1: block format 0, swizzle 2696", [](I& r) { r.block_format = BlockFormat::kNoBlocks; });
  images(1, "image 1: block format 6, swizzle 2696", [](I& r) { r.block_format = BlockFormat{6}; });
  images(1, "image 1: block format 11, swizzle 2696", [](I& r) { r.block_format = BlockFormat{11}; });
  images(1, "image 1: block format 1, swizzle 6", [](I& r) { r.swizzle = 6; });
  images(1, "image 1: block format 1, swizzle 35464", [](I& r) { r.swizzle |= 0x8000; });
  images(1, "image 1: 3 channels, but BC1 has 4", [](I& r) { r.channels = 3; });
  images(1, "image 1: page 3 has 48 bytes, expected 64", [](I& r) { r.width = 13; });
  images(1, "image 1: 65537 x 6 pixels, expected 1 to 65536", [](I& r) { r.width = 65537; });
  images(1, "image 1: 4 mip levels, expected at most 3", [](I& r) { r.level_count = 4; });
  images(1, "image 1: mip level 2, but the file has 2 mip levels", [](I& r) { r.level_count = 3; });

  using L = MipLevelRecord;
  const auto levels = b.records<L>(TableKind::kMipLevels);
  levels(1, "mip level 1: 7 bytes, expected 8", [](L& r) { r.bytes = 7; });
  levels(0, "mip level 0: 16 bytes, expected 8", [](L& r) { r.bytes = 16; });
}

TEST_CASE("container rules: levels of blocks in several pages", "[container]") {
  scree::tests::Parts parts = full_parts();
  // 4096 x 1028 pixels of BC1 have 257 rows of 8192 bytes, 32 rows per page. Level 1 has 129 rows, 64 per page.
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
  const auto images = b.records<I>(TableKind::kImages);
  images(1, "image 1: page 11 has 8192 bytes, expected 262144", [](I& r) { r.page = 4; });
  images(1, "image 1: page 14 has 4096 bytes, expected 262144", [](I& r) { r.page = 12; });
  images(1, "image 1: page 11 has 8192 bytes, expected 16384", [](I& r) { r.height = 1032; });
  using L = MipLevelRecord;
  const auto levels = b.records<L>(TableKind::kMipLevels);
  levels(0, "mip level 0: page 14 has 4096 bytes, expected 262144", [](L& r) { r.page = 13; });
  levels(0, "mip level 0: at byte 16 of its first page", [](L& r) { r.offset = 16; });
  levels(0, "mip level 0: 4096 bytes, expected 528384", [](L& r) { r.bytes = 4096; });
  using P = PageRecord;
  const auto pages = b.records<P>(TableKind::kPages);
  pages(8, "image 1: page 8 is of kind 7, which holds no image", [](P& r) { r.kind = PageKind{7}; });
}

}  // namespace
}  // namespace scree::tests
