// UASTC and BasisLZ: blocks of every mode, generated files with every kind of block, real files with the pixels of the
// official transcoder, and malformed data.
#include <array>
#include <cstring>
#include <filesystem>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "format/container/checksum.h"
#include "runtime/images/basis/basis_lz.h"
#include "runtime/images/basis/uastc.h"
#include "runtime/images/block_file.h"
#include "tests/models.h"
#include "tests/runtime/images/basis_files.h"
#include "tests/runtime/images/refused_files.h"
#include "tests/tools/temp_folder.h"

namespace scree::runtime {
namespace {

using namespace tests;

using Texels = std::array<uint32_t, 16>;

/// The texels of a block that was written bit by bit.
Texels decoded(const BasisWriter& written) {
  FileBytes block = written.bytes();
  block.resize(kUastcBlockBytes);
  Texels texels;
  decode_uastc_block(block.data(), texels);
  return texels;
}

constexpr uint32_t rgba(uint32_t red, uint32_t green, uint32_t blue, uint32_t alpha = 255) {
  return red | green << 8 | blue << 16 | alpha << 24;
}

constexpr uint32_t kMagenta = rgba(255, 0, 255);

Result<std::vector<FileBytes>> levels_of(const FileBytes& bytes) {
  ImageFile file(bytes);
  auto head = open_block_file(file);
  if (!head) return head.error();
  std::vector<FileBytes> levels;
  for (uint32_t l = 0; l < head->levels.size(); ++l) {
    auto level = read_block_level(file, *head, l);
    if (!level) return level.error();
    levels.push_back(std::move(*level));
  }
  return levels;
}

}  // namespace

TEST_CASE("a solid UASTC block has one colour", "[basis]") {
  BasisWriter block;
  block.put(0x17, 5);
  for (const uint32_t value : {11u, 22u, 33u, 44u}) block.put(value, 8);
  for (const uint32_t texel : decoded(block)) CHECK(texel == rgba(11, 22, 33, 44));
}

TEST_CASE("UASTC weights of 5 bits are interpolated between endpoints of 5 bits", "[basis]") {
  BasisWriter block;  // mode 18
  block.put(0x9, 4);
  block.put(0, 15);
  for (const uint32_t value : {0u, 31u, 31u, 0u, 16u, 16u}) block.put(value, 5);  // red, green and blue, low and high
  for (uint32_t i = 0; i < 16; ++i) block.put(i * 2, i == 0 ? 4 : 5);
  const Texels texels = decoded(block);
  CHECK(texels[0] == rgba(0, 255, 132));
  CHECK(texels[1] == rgba(16, 239, 132));   // weight 4 of 64
  CHECK(texels[8] == rgba(135, 120, 132));  // 34
  CHECK(texels[15] == rgba(247, 8, 132));   // 62
}

TEST_CASE("UASTC subsets have their own endpoints, coded as trits", "[basis]") {
  BasisWriter block;  // mode 3, pattern 10: columns 0 and 1 are subset 0; the other rows are subsets 2, 1, 1 and 2
  block.put(0x3, 5);
  block.put(0, 15);
  block.put(10, 4);
  // Six values per subset. The trits are 0, 1 and 2 for the subsets; with bits of 0 they give 0, 23 and 46.
  const auto trit = [](uint32_t value) { return value / 6; };
  for (uint32_t i = 0; i < 18; i += 5) {
    uint32_t packed = 0;
    for (uint32_t k = std::min(i + 5, 18u); k-- > i;) packed = 3 * packed + trit(k);
    block.put(packed, i == 15 ? 5 : 8);
  }
  block.put(0, 32);
  block.put(0, 4);
  const Texels texels = decoded(block);
  constexpr uint32_t kGrey[] = {rgba(0, 0, 0), rgba(23, 23, 23), rgba(46, 46, 46)};
  constexpr uint32_t kSubsets[] = {0, 0, 2, 2, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 2, 2};
  for (uint32_t i = 0; i < 16; ++i) CHECK(texels[i] == kGrey[kSubsets[i]]);
}

TEST_CASE("a UASTC channel may have its own weights", "[basis]") {
  for (uint32_t channel = 0; channel < 4; ++channel) {
    BasisWriter block;  // mode 13
    block.put(0x1f, 5);
    block.put(0, 23);
    block.put(channel, 2);
    for (uint32_t i = 0; i < 4; ++i) block.put(0xff00, 16);  // low 0, high 255
    block.put(0x2aaaaaaa, 30);  // texels 1 to 15: 0, and 1 in the second plane; texel 0 has no bits, so both are 0
    const Texels texels = decoded(block);
    CHECK(texels[0] == 0);
    for (uint32_t i = 1; i < 16; ++i) CHECK(texels[i] == 0xffu << 8 * channel);
  }
}

TEST_CASE("invalid UASTC blocks are magenta", "[basis]") {
  const auto texel = [](uint32_t code, uint32_t code_bits, uint32_t hint_bits, uint32_t pattern,
                        uint32_t pattern_bits) {
    BasisWriter block;
    block.put(code, code_bits);
    block.put(0, hint_bits);
    block.put(pattern, pattern_bits);
    return decoded(block)[0];
  };
  CHECK(texel(0x45, 7, 0, 0, 0) == kMagenta);  // reserved
  for (const auto& [code, bits, hints, patterns, pattern_bits] :
       {std::array{0x1du, 5u, 15u, 30u, 5u}, {0x3u, 5u, 15u, 11u, 4u}, {0x7u, 5u, 15u, 19u, 5u}}) {
    CHECK(texel(code, bits, hints, patterns - 1, pattern_bits) != kMagenta);
    for (uint32_t pattern = patterns; pattern < 1u << pattern_bits; ++pattern)
      CHECK(texel(code, bits, hints, pattern, pattern_bits) == kMagenta);
  }
}

TEST_CASE("random UASTC blocks of every mode have the pixels of the official transcoder", "[basis]") {
  struct Mode {
    uint32_t code, code_bits, hint_bits, patterns, pattern_bits;  // `pattern_bits`: of a pattern, if there is one
    uint64_t hash;  // of 256 blocks' texels, equal to those of basis_universal as in three.js 0.187
  };
  constexpr Mode kModes[] = {{0x01, 4, 15, 0, 0, 0xcd78fb6d1fd70bae},  {0x35, 6, 15, 0, 0, 0x103ac576ef1b5397},
                             {0x1d, 5, 15, 30, 5, 0xde10bcf66c7f9e94}, {0x03, 5, 15, 11, 4, 0x5185e45a2e5f40b1},
                             {0x13, 5, 15, 30, 5, 0x89c5cad7d2d64887}, {0x0b, 5, 15, 0, 0, 0x35f0df6016a07893},
                             {0x1b, 5, 15, 0, 0, 0x681fb4450a8c2f67},  {0x07, 5, 15, 19, 5, 0xf75c8dac9ba0052c},
                             {0x17, 5, 0, 0, 0, 0xe1980bbb02261a88},   {0x0f, 5, 23, 30, 5, 0xa33e311a495da72a},
                             {0x02, 3, 17, 0, 0, 0xe2f4f251fcd1540e},  {0x00, 2, 17, 0, 0, 0x75c43b50cc7cef7e},
                             {0x06, 3, 17, 0, 0, 0x132b349820173911},  {0x1f, 5, 23, 0, 0, 0x487b1bb9cabb1563},
                             {0x0d, 5, 23, 0, 0, 0x7de59145a43cb41c},  {0x05, 7, 23, 0, 0, 0x7f0601a951428908},
                             {0x15, 6, 23, 30, 5, 0xb06cc64e62c24083}, {0x25, 6, 23, 0, 0, 0x0c1b03eeb09728be},
                             {0x09, 4, 15, 0, 0, 0x0bde28de937b80bf}};
  for (const Mode& mode : kModes) {
    std::mt19937_64 random(mode.code);
    FileBytes pixels;
    for (uint32_t i = 0; i < 256; ++i) {
      std::array<uint64_t, 2> words;
      for (uint64_t& word : words) word = random();
      const auto set = [&](uint32_t at, uint32_t bits, uint64_t value) {
        words[0] = (words[0] & ~(((uint64_t{1} << bits) - 1) << at)) | value << at;
      };
      set(0, mode.code_bits, mode.code);
      if (mode.patterns != 0) set(mode.code_bits + mode.hint_bits, mode.pattern_bits, i % mode.patterns);
      Texels texels;
      decode_uastc_block(reinterpret_cast<const std::byte*>(words.data()), texels);
      for (const uint32_t texel : texels) put(pixels, texel);
    }
    INFO(mode.code);
    CHECK(format::checksum(pixels) == mode.hash);
  }
}

TEST_CASE("a UASTC file is decoded to RGBA8 and cropped to the picture", "[basis]") {
  const BlockRecipe recipe{
      .vk_format = 0, .model = 166, .width = 7, .height = 6, .levels = 3, .scheme = 2, .channel = 3};
  const auto levels = must(levels_of(make_ktx2(recipe)));
  REQUIRE(levels.size() == 3);
  for (uint32_t l = 0; l < 3; ++l) {
    const uint32_t width = 7u >> l, height = 6u >> l, columns = (width + 3) / 4;
    const FileBytes blocks = level_blocks(recipe, l);
    REQUIRE(levels[l].size() == 4 * width * height);
    for (uint32_t y = 0; y < height; ++y)
      for (uint32_t x = 0; x < width; ++x) {
        Texels texels;
        decode_uastc_block(blocks.data() + kUastcBlockBytes * (y / 4 * columns + x / 4), texels);
        uint32_t found;
        std::memcpy(&found, levels[l].data() + 4 * (y * width + x), 4);
        CHECK(found == texels[y % 4 * 4 + x % 4]);
      }
  }
}

TEST_CASE("the sample descriptions of UASTC and ETC1S files determine the channels", "[basis]") {
  using enum format::ChannelSource;
  const auto swizzle_of = [](uint32_t model, uint32_t first, uint32_t second, const std::string& swizzle = "") {
    FileBytes bytes = model == 166 ? make_ktx2({.vk_format = 0, .model = 166, .swizzle = swizzle, .channel = first})
                                   : make_basis_lz({.levels = 1, .has_alpha = second != 0, .swizzle = swizzle}).bytes;
    if (model != 166) bytes[104 + 31] = static_cast<std::byte>(first);
    if (second != 0) bytes[104 + 47] = static_cast<std::byte>(second);
    ImageFile file(bytes);
    const auto head = must(open_block_file(file));
    CHECK(head.format == format::BlockFormat::kRgba8);
    return head.swizzle;
  };
  const uint16_t red = format::make_swizzle(kRed, kZero, kZero, kOne);
  const uint16_t red_alpha = format::make_swizzle(kRed, kAlpha, kZero, kOne);
  CHECK(swizzle_of(166, 0, 0) == format::kOpaqueSwizzle);
  CHECK(swizzle_of(166, 3, 0) == format::kPlainSwizzle);
  CHECK(swizzle_of(166, 4, 0) == red);
  CHECK(swizzle_of(166, 5, 0) == red_alpha);
  CHECK(swizzle_of(166, 6, 0) == format::make_swizzle(kRed, kGreen, kZero, kOne));
  CHECK(swizzle_of(163, 0, 0) == format::kOpaqueSwizzle);
  CHECK(swizzle_of(163, 0, 15) == format::kPlainSwizzle);
  CHECK(swizzle_of(163, 3, 0) == red);
  CHECK(swizzle_of(163, 3, 4) == red_alpha);
  CHECK(swizzle_of(163, 3, 4, "1rg1") == format::make_swizzle(kOne, kRed, kAlpha, kOne));
}

TEST_CASE("BasisLZ files of all kinds of blocks have their pixels", "[basis]") {
  for (const auto& [width, height] : {std::pair{1u, 1u}, {4u, 4u}, {5u, 3u}, {37u, 22u}, {130u, 7u}, {64u, 64u}})
    for (uint32_t seed = 0; seed < 12; ++seed) {
      INFO(width << " x " << height << ", seed " << seed);
      const BasisFile made = make_basis_lz({.width = width,
                                            .height = height,
                                            .levels = std::min(3u, std::max(width, height) / 2 + 1),
                                            .has_alpha = seed % 2 != 0,
                                            .is_grey = seed % 3 == 0,
                                            .has_plain_selectors = seed % 5 == 0,
                                            .seed = seed});
      const auto levels = must(levels_of(made.bytes));
      CHECK((levels == made.levels));
      const auto picture = must(decode_image(made.bytes));
      CHECK(std::memcmp(picture.rgba.data(), made.levels[0].data(), picture.rgba.size()) == 0);
    }
}

TEST_CASE("malformed files of UASTC and BasisLZ are refused with the defect", "[basis][bad]") {
  const BasisFile made = make_basis_lz({.width = 16, .height = 16, .levels = 2});
  const FileBytes& lz = made.bytes;
  const FileBytes uastc = make_ktx2({.vk_format = 0, .model = 166, .width = 16, .height = 16});
  uint64_t global, data;
  std::memcpy(&global, lz.data() + 64, 8);
  std::memcpy(&data, lz.data() + 80, 8);
  uint32_t parts[3];
  std::memcpy(parts, lz.data() + global + 4, 12);
  const size_t images = global + 20, colors = global + 60, selectors = colors + parts[0], tables = selectors + parts[1];
  const auto longer_by = [&](size_t at) {  // makes a part's length longer
    uint32_t length;
    std::memcpy(&length, lz.data() + at, 4);
    return with(lz, at, length + 1);
  };
  const RefusedFile bad[] = {
      {with(lz, 12, 37u), ErrorCode::kFormat, "KTX2: colour model 1 and supercompression scheme 1, but BasisLZ"},
      {make_ktx2({.vk_format = 0, .model = 163}), ErrorCode::kFormat,
       "KTX2: colour model 163 and supercompression scheme 0, but BasisLZ"},
      {with(lz, 44, 0u), ErrorCode::kFormat, "KTX2: 279 bytes of global data"},
      {with(uastc, 44, 1u), ErrorCode::kFormat, "KTX2: colour model 166 and supercompression scheme 1, but BasisLZ"},
      {with(uastc, 40, 0u), ErrorCode::kFormat, "KTX2: 0 levels"},
      {with(lz, 32, 3u), ErrorCode::kUnsupported, "KTX2: an array of 3 pictures"},
      {with(lz, 36, 6u), ErrorCode::kUnsupported, "KTX2: a cube map"},
      {with(uastc, 104 + 31, uint8_t{7}), ErrorCode::kFormat,
       "KTX2: data format descriptor has other samples than UASTC"},
      {with(lz, 128 + 47, uint8_t{4}), ErrorCode::kFormat, "KTX2: data format descriptor has other samples than ETC1S"},
      {with(lz, 96, uint64_t{64}), ErrorCode::kFormat, "KTX2: level 0: 64 bytes unpacked, but BasisLZ states 0"},
      {with(lz, 64, ~uint64_t{7}), ErrorCode::kTruncated, "KTX2: "},
      {with(lz, 72, uint64_t{59}), ErrorCode::kTruncated, "KTX2: 59 bytes of global data"},
      {with(lz, 72, ~uint64_t{0}), ErrorCode::kTruncated, "KTX2: 18446744073709551615 bytes of global data"},
      {longer_by(global + 4), ErrorCode::kFormat, "KTX2: "},
      {with(lz, global + 4, 0xffffffffu), ErrorCode::kFormat, "KTX2: "},
      {with(lz, global + 16, 8u), ErrorCode::kFormat, "KTX2: "},
      {with(lz, images, 2u), ErrorCode::kFormat, "KTX2: level 0: its slices are malformed"},
      {with(lz, images + 4, 1u << 20), ErrorCode::kFormat, "KTX2: level 0: its slices are malformed"},
      {with(lz, images + 8, 0u), ErrorCode::kFormat, "KTX2: level 0: its slices are malformed"},
      {with(lz, images + 8, 0xffffffffu), ErrorCode::kFormat, "KTX2: level 0: its slices are malformed"},
      {with(lz, images + 16, 0u), ErrorCode::kFormat, "KTX2: level 0: its slices are malformed"},
      {with(lz, images + 20 + 12, 0xfffffff0u), ErrorCode::kFormat, "KTX2: level 1: its slices are malformed"},
      {with(lz, global, uint16_t{0}), ErrorCode::kFormat, "KTX2: level 0: BasisLZ: block 0, 0 of a slice is malformed"},
      {with(lz, global, uint16_t{0xffff}), ErrorCode::kFormat, "KTX2: level 0: BasisLZ: its codebook of colours"},
      {with(lz, global + 2, uint16_t{0xffff}), ErrorCode::kFormat, "KTX2: level 0: BasisLZ: its codebook of selectors"},
      {with(lz, colors, 0xffffffffu), ErrorCode::kFormat, "KTX2: level 0: BasisLZ: its codebook of colours"},
      {with(lz, selectors, 0xffffffffu), ErrorCode::kFormat, "KTX2: level 0: BasisLZ: its codebook of selectors"},
      {with(lz, tables, 0xffffffffu), ErrorCode::kFormat, "KTX2: level 0: BasisLZ: its Huffman tables"},
      {with(lz, tables, uint16_t{0}), ErrorCode::kFormat, "KTX2: level 0: BasisLZ: "},
      {with(lz, data, ~uint64_t{0}), ErrorCode::kFormat, "KTX2: level 0: BasisLZ: block 0, 0 of a slice is malformed"},
      {with(with(lz, 20, 16384u), 24, 16384u), ErrorCode::kTruncated, "KTX2: 16384 x 16384 pixels in "},
  };
  check_refused(bad);
  for (const FileBytes& whole : {lz, uastc}) check_prefixes_refused(whole);
  // Any flipped bit gives a picture or one line of error.
  for (size_t bit = 0; bit < 8 * lz.size(); ++bit) {
    FileBytes flipped = lz;
    flipped[bit / 8] ^= static_cast<std::byte>(1u << bit % 8);
    const auto checked = check_image(flipped);
    if (!checked) CHECK(checked.error().message.find('\n') == std::string::npos);
  }
}

TEST_CASE("BasisLZ streams that end early or refer to missing entries are refused", "[basis][bad]") {
  // Two colours, two selectors, and a history of one. The codes have 257, 2, 4 and 64 symbols.
  BasisWriter colors, selectors, tables;
  for (int i = 0; i < 3; ++i) colors.table(32);
  colors.table(8);
  colors.put(0, 1);
  for (int i = 0; i < 2; ++i) {
    colors.code(0, 8);
    for (int c = 0; c < 3; ++c) colors.code(0, 32);
  }
  selectors.put(4, 3);
  for (int i = 0; i < 4; ++i) selectors.put(0, 16);
  for (const uint32_t symbols : {257u, 4u, 8u, 64u}) tables.table(symbols);
  tables.put(1, 13);
  FileBytes parts = colors.bytes();
  parts.insert(parts.end(), selectors.bytes().begin(), selectors.bytes().end());
  parts.insert(parts.end(), tables.bytes().begin(), tables.bytes().end());
  const auto size = [](const BasisWriter& part) { return static_cast<uint32_t>(part.bytes().size()); };
  const auto opened = must(BasisLz::open({2, 2, size(colors), size(selectors), size(tables)}, parts));
  const auto decodes = [&](uint32_t prediction, uint32_t delta, uint32_t selector, uint32_t run) {
    BasisWriter slice;
    slice.code(prediction, 257);
    if (prediction == 256) slice.groups(run, 4);
    if ((prediction & 3) == 3) slice.code(delta, 4);
    slice.code(selector, 8);
    if (selector == 3) slice.code(run, 64);
    FileBytes pixels(64);
    return bool(opened.decode(slice.bytes(), false, 4, 4, pixels));
  };
  CHECK(decodes(3, 1, 1, 0));
  CHECK(decodes(3, 1, 2, 0));        // from the history
  CHECK_FALSE(decodes(0, 0, 1, 0));  // nothing is left of the first block
  CHECK_FALSE(decodes(1, 0, 1, 0));  // nothing is above it
  CHECK_FALSE(decodes(2, 0, 1, 0));
  CHECK(decodes(3, 3, 1, 0));        // 3 of 2 colours wraps around once to 1
  CHECK_FALSE(decodes(3, 1, 4, 0));  // symbols are 2 selectors, a history of 1, and the run
  CHECK_FALSE(decodes(3, 1, 3, 0));  // a run of 3 blocks, where one is left
  CHECK_FALSE(decodes(256, 0, 1, 0));
  FileBytes pixels(64);
  CHECK_FALSE(opened.decode({}, false, 4, 4, pixels));
  // More colours than the part has bytes for.
  CHECK_FALSE(BasisLz::open({200, 2, size(colors), size(selectors), size(tables)}, parts));
}

TEST_CASE("real files of UASTC and BasisLZ have the pixels of the official transcoder", "[basis][models]") {
  const std::filesystem::path folder = tests::real_models("ktx2");
  if (folder.empty()) return;
  // Hashes of all levels, one after another. They equal those of basis_universal as in three.js 0.187, which does not
  // read zlib.
  const std::pair<const char*, uint64_t> files[] = {
      {"KTX-Parse/test_etc1s.ktx2", 0x7b26fa738a0a8225},
      {"KTX-Parse/test_padding.ktx2", 0x566acd70ba89a095},
      {"KTX-Software-CTS/CesiumLogoFlat.ktx2", 0xbd253ffabe6b5c9f},
      {"KTX-Software-CTS/alpha_simple_basis.ktx2", 0xd5fa20ba690e49e9},
      {"KTX-Software-CTS/cyan_rgb_reference_uastc.ktx2", 0x6be208827277b658},
      {"KTX-Software-CTS/kodim17_basis.ktx2", 0x398dda889cc0b2dd},
      {"KTX-Software-CTS/ktx_document_basis.ktx2", 0xf0ac5e57b0f51e66},
      {"KTX-Software-CTS/luminance_alpha_reference_uastc.ktx2", 0xb00c4bea2faac360},
      {"KTX-Software-CTS/r_reference_basis.ktx2", 0x6432f90ebd688f03},
      {"KTX-Software-CTS/valid_R8G8B8A8_SRGB_2D_UASTC_ZLIB_1.ktx2", 0xae76549290b7f018},
      {"KTX-Software-CTS/valid_R8G8B8A8_UNORM_2D_UASTC_ZLIB_1.ktx2", 0xae76549290b7f018},
      {"engine/playcanvas.ktx2", 0x18b1a62eac19255c},
      {"glTF-Transform/2d_etc1s.ktx2", 0xd18d184d207a24b9},
      {"magnum-plugins/BasisImporter_rgb-linear-pow2.ktx2", 0xb1581a16432acb20},
      {"magnum-plugins/BasisImporter_rgb-noflip-pow2.ktx2", 0x79d6002663b2bc8e},
      {"magnum-plugins/BasisImporter_rgb-pow2.ktx2", 0x5855cb9a381d7370},
      {"magnum-plugins/BasisImporter_rgba-uastc.ktx2", 0x0fcebd2f295c7b69},
      {"web-texture-tool/dice.ktx2", 0xc09058211234ad32}};
  for (const auto& [name, hash] : files) {
    INFO(name);
    const auto levels = must(levels_of(read_bytes(folder / name)));
    format::Checksum sum;
    for (const FileBytes& level : levels) sum.add(level);
    CHECK(sum.value() == hash);
  }
}

}  // namespace scree::runtime
