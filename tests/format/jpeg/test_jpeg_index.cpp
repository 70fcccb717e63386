#include "format/jpeg/index.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <random>

#include <jpeglib.h>

#include "tests/format/geometry/spec_vectors.h"
#include "tests/format/jpeg/jpeg_checks.h"
#include "tests/models.h"
#include "tests/results.h"

using namespace scree::tests;
using namespace scree::tests::jpeg;

namespace {

/// Compares every MCU, decoded separately and in random order, with libjpeg's coefficients of `file`.
void check_coefficients(const JpegIndex& index, std::span<const std::byte> file) {
  const std::vector<JpegPlane> planes = scree::tests::read_coefficients(file);
  REQUIRE(planes.size() == index.component_count);
  const JpegView view = index.view();
  std::vector<uint32_t> order(view.mcu_count);
  std::iota(order.begin(), order.end(), 0u);
  std::shuffle(order.begin(), order.end(), std::mt19937(1));
  uint64_t compared = 0, wrong = 0;
  for (const uint32_t mcu : order) {
    Blocks blocks;
    if (!decode_mcu(view, mcu, blocks)) FAIL("MCU " << mcu << " does not decode");
    uint32_t block = 0;
    for (uint32_t c = 0; c < view.component_count; ++c) {
      const JpegViewComponent& component = view.components[c];
      for (uint32_t i = 0; i < uint32_t{component.h} * component.v; ++i, ++block) {
        const uint32_t x = mcu % view.mcus_across * component.h + i % component.h;
        const uint32_t y = mcu / view.mcus_across * component.v + i / component.h;
        if (x >= planes[c].blocks_across || y >= planes[c].blocks_down) continue;  // padding of the MCU
        const int16_t* const expected = planes[c].values.data() + 64 * (size_t{y} * planes[c].blocks_across + x);
        wrong += !std::equal(blocks[block].begin(), blocks[block].end(), expected);
        ++compared;
      }
    }
  }
  CHECK(wrong == 0);
  uint64_t blocks_in_all = 0;
  for (const JpegPlane& plane : planes) blocks_in_all += uint64_t{plane.blocks_across} * plane.blocks_down;
  CHECK(compared == blocks_in_all);
}

/// Compares index, coefficients, tables, colour, and the rebuilt file with libjpeg.
void check_round_trip(std::span<const std::byte> file) {
  const auto bytes = must(encode(file));
  const auto index = must(open_jpeg_index(bytes));
  check_coefficients(index, file);
  const auto tables = scree::tests::read_quant_tables(file);
  for (uint32_t c = 0; c < index.component_count; ++c) {
    const auto& table = index.quant[index.components[c].quant];
    for (uint32_t k = 0; k < 64; ++k) REQUIRE(table[k] == tables[c][kJpegNaturalOrder[k]]);
  }
  const int colour = scree::tests::read_colour_space(file);
  CHECK(colour == (index.colour == JpegColour::kGrey  ? JCS_GRAYSCALE
                   : index.colour == JpegColour::kRgb ? JCS_RGB
                                                      : JCS_YCbCr));
  const auto back = must(rebuild(index));
  const auto same = [](const std::vector<JpegPlane>& a, const std::vector<JpegPlane>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const JpegPlane& p, const JpegPlane& q) {
      return p.blocks_across == q.blocks_across && p.blocks_down == q.blocks_down && p.values == q.values;
    });
  };
  CHECK(same(scree::tests::read_coefficients(back), scree::tests::read_coefficients(file)));
  CHECK(scree::tests::read_quant_tables(back) == tables);
  CHECK(scree::tests::read_colour_space(back) == colour);
  // The rebuilt file is indexed to the same bytes again.
  CHECK(must(encode(back)) == bytes);
}

}  // namespace

TEST_CASE("indexed JPEGs of the spec", "[jpeg_index][spec]") {
  for (const auto& vector : scree::tests::spec_vectors("jpeg.txt")) {
    INFO(vector.text("name"));
    const Bytes bytes = vector.bytes("bytes");
    const auto index = open_jpeg_index(bytes);
    CHECK(outcome(index) == (vector.has("error") ? vector.text("error") : "ok"));
    if (!vector.has("jpeg")) continue;
    const Bytes file = vector.bytes("jpeg");
    CHECK(must(encode(file)) == bytes);
    REQUIRE(index);
    const auto listed = vector.integers<int>("nonzero");
    std::map<std::array<int, 3>, int> expected;
    for (size_t i = 0; i + 3 < listed.size(); i += 4)
      expected[{listed[i], listed[i + 1], listed[i + 2]}] = listed[i + 3];
    std::map<std::array<int, 3>, int> found;
    for (uint32_t mcu = 0; mcu < index->layout.mcu_count(); ++mcu) {
      CHECK(decode_jpeg_mcu(index->view(), mcu, [&](uint32_t block, uint32_t k, int32_t value) {
        if (value != 0) found[{static_cast<int>(mcu), static_cast<int>(block), static_cast<int>(k)}] = value;
      }));
    }
    CHECK(found == expected);
    check_round_trip(file);
  }
}

TEST_CASE("every kind of sequential JPEG is indexed without loss", "[jpeg_index]") {
  for (const JpegRecipe& recipe : indexable_recipes()) {
    INFO(recipe.name);
    check_round_trip(make_jpeg(recipe));
  }
}

TEST_CASE("groups and anchor blocks of every fill are indexed without loss", "[jpeg_index]") {
  // Grey: 4 MCUs per group, 32 groups per block.
  for (const int mcus : {1, 3, 4, 5, 124, 127, 128, 129, 132, 256, 257}) {
    INFO(mcus << " MCUs");
    const Bytes file = make_jpeg(recipe_of(8 * mcus, 8, {{1, 1}}, mcus == 257 ? 3 : 0));
    check_round_trip(file);
    const auto bytes = must(encode(file));
    const auto index = must(open_jpeg_index(bytes));
    CHECK(index.layout.group_mcus == 4);
    CHECK(index.layout.group_count == static_cast<uint32_t>((mcus + 3) / 4));
    CHECK(index.layout.anchor_block_count == static_cast<uint32_t>((mcus + 127) / 128));
  }
}

TEST_CASE("the index takes at most a quarter of a bit per pixel", "[jpeg_index]") {
  for (const auto& factors : std::vector<std::vector<std::pair<int, int>>>{{{1, 1}},
                                                                           {{1, 1}, {1, 1}, {1, 1}},
                                                                           {{2, 1}, {1, 1}, {1, 1}},
                                                                           {{2, 2}, {1, 1}, {1, 1}},
                                                                           {{4, 2}, {1, 1}, {1, 1}}}) {
    for (const int quality : {1, 85, 100}) {
      JpegRecipe recipe = recipe_of(512, 512, factors);
      recipe.quality = quality;
      const auto bytes = must(encode(make_jpeg(recipe)));
      CHECK(static_cast<double>(8 * must(open_jpeg_index(bytes)).index_bytes()) / (512.0 * 512.0) <= 0.25);
    }
  }
}

TEST_CASE("real JPEG files are indexed without loss", "[jpeg_index]") {
  const std::filesystem::path folder = scree::tests::real_models("jpeg");
  if (folder.empty()) return;
  uint32_t indexed = 0;
  for (const auto& path : scree::tests::files_below(folder)) {
    INFO(path.filename().string());
    const Bytes file = read_bytes(path);
    const auto header = must(parse_jpeg(file));
    if (judge_jpeg(header).treatment != JpegTreatment::kAsItIs) continue;
    const auto bytes = must(encode(file));
    const auto index = must(open_jpeg_index(bytes));
    check_coefficients(index, file);
    const auto back = must(rebuild(index));
    check_coefficients(index, back);
    CHECK(scree::tests::read_colour_space(back) == scree::tests::read_colour_space(file));
    // Counts whole groups, including the padding of MCUs at the picture's edge.
    const uint64_t covered = uint64_t{256} * index.layout.group_count;
    if (index.layout.group_count >= 32) CHECK(8 * index.index_bytes() <= covered / 4);
    ++indexed;
  }
  CHECK(indexed >= 60);
}

TEST_CASE("JPEGs that cannot be indexed give the reason", "[jpeg_index]") {
  const auto reason = [](JpegRecipe recipe) {
    const Bytes file = make_jpeg(recipe);
    const auto header = must(parse_jpeg(file));
    const auto encoded = encode(file);
    CHECK(outcome(encoded) == "unsupported");
    CHECK(encoded.error().message == "JPEG: " + judge_jpeg(header).reason);
    return std::pair(judge_jpeg(header).treatment, judge_jpeg(header).reason);
  };
  JpegRecipe recipe = recipe_of(40, 30, {{2, 2}, {1, 1}, {1, 1}});
  recipe.is_progressive = true;
  CHECK(reason(recipe) == std::pair(JpegTreatment::kTranscode, std::string("progressive")));
  recipe.is_progressive = false;
  recipe.is_arithmetic = true;
  CHECK(reason(recipe) == std::pair(JpegTreatment::kTranscode, std::string("arithmetic coding")));
  recipe.is_arithmetic = false;
  recipe.has_scan_each = true;
  CHECK(reason(recipe) == std::pair(JpegTreatment::kTranscode, std::string("several scans")));
  CHECK(reason(recipe_of(40, 30, {{1, 1}, {1, 1}, {1, 1}, {1, 1}})) ==
        std::pair(JpegTreatment::kReencode, std::string("4 components (CMYK)")));

  const auto changed = [](uint32_t sof, int precision) {
    Bytes file = make_jpeg(recipe_of(40, 30, {{1, 1}}));
    const size_t at = find_marker(file, 0xc0);
    file[at + 1] = std::byte(sof);
    file[at + 4] = std::byte(precision);
    const auto header = must(parse_jpeg(file));
    return std::pair(judge_jpeg(header).treatment, judge_jpeg(header).reason);
  };
  CHECK(changed(0xc1, 12) == std::pair(JpegTreatment::kRefuse, std::string("12 bits per sample")));
  CHECK(changed(0xc3, 8) == std::pair(JpegTreatment::kRefuse, std::string("lossless")));
  CHECK(changed(0xcb, 8) == std::pair(JpegTreatment::kRefuse, std::string("lossless")));
  CHECK(changed(0xc6, 8) == std::pair(JpegTreatment::kRefuse, std::string("hierarchical")));
  CHECK(changed(0xc1, 8) == std::pair(JpegTreatment::kAsItIs, std::string()));

  // A second scan after the first is found.
  const Bytes file = make_jpeg(recipe_of(40, 30, {{1, 1}}));
  Bytes twice(file.begin(), file.end() - 2);
  twice.insert(twice.end(), file.begin() + static_cast<ptrdiff_t>(find_marker(file, 0xda)), file.end());
  CHECK(outcome(encode(twice)) == "unsupported");
  // Eleven blocks per MCU.
  Bytes wide = make_jpeg(recipe_of(40, 30, {{2, 2}, {1, 1}, {1, 1}}));
  wide[find_marker(wide, 0xc0) + 11] = std::byte{0x33};
  CHECK(outcome(encode(wide)) == "unsupported");
}

TEST_CASE("a file without Huffman tables gets the standard ones", "[jpeg_index]") {
  const Bytes file = make_jpeg(recipe_of(100, 70, {{2, 2}, {1, 1}, {1, 1}}));
  Bytes bare = file;
  for (int i = 0; i < 4; ++i) {
    const size_t at = find_marker(bare, 0xc4);
    const size_t length = static_cast<size_t>(bare[at + 2]) << 8 | static_cast<size_t>(bare[at + 3]);
    bare.erase(bare.begin() + static_cast<ptrdiff_t>(at), bare.begin() + static_cast<ptrdiff_t>(at + 2 + length));
  }
  REQUIRE(bare.size() == file.size() - 4 * 4 - 2 * (17 + 12) - 2 * (17 + 162));
  CHECK(must(encode(bare)) == *encode(file));
}

TEST_CASE("impossible Huffman tables are refused", "[jpeg_index]") {
  JpegHuffmanSpec spec;
  CHECK(make_jpeg_table(spec, true));  // a table without codes decodes nothing
  CHECK(make_jpeg_table(spec, true)->find(0).length == 0);
  spec.counts[0] = 2;  // 0 and 1: the second is a code of all ones
  CHECK(outcome(make_jpeg_table(spec, false)) == "format");
  spec.counts[0] = 1;
  CHECK(make_jpeg_table(spec, false));
  spec.counts[1] = 2;
  CHECK(outcome(make_jpeg_table(spec, false)) == "format");
  spec.counts[1] = 1;
  spec.symbols[1] = 16;
  CHECK(make_jpeg_table(spec, false));
  CHECK(outcome(make_jpeg_table(spec, true)) == "format");
}

TEST_CASE("Huffman tables decode every code in every window", "[jpeg_index]") {
  std::mt19937 random(3);
  std::vector<JpegHuffmanSpec> specs = {standard_jpeg_table(false, 0), standard_jpeg_table(false, 1),
                                        standard_jpeg_table(true, 0), standard_jpeg_table(true, 1)};
  for (int i = 0; i < 60; ++i) {
    JpegHuffmanSpec spec;
    uint32_t left = 1;  // free codes of this length
    uint32_t total = 0;
    for (uint32_t length = 1; length <= 16; ++length) {
      left = std::min(left * 2, 100000u);
      const uint32_t most = std::min({left - 1, 256 - total, 255u});
      const uint32_t count = length == 16 ? most : std::min(most, static_cast<uint32_t>(random() % (length + 1)));
      spec.counts[length - 1] = static_cast<uint8_t>(count);
      left -= count;
      total += count;
    }
    for (uint8_t& symbol : spec.symbols) symbol = static_cast<uint8_t>(random());
    specs.push_back(spec);
  }
  for (const JpegHuffmanSpec& spec : specs) {
    const auto table = must(make_jpeg_table(spec, false));
    // Decodes bit by bit as in T.81, F.2.2.3.
    uint64_t wrong = 0;
    for (uint32_t window = 0; window < 65536; ++window) {
      uint32_t code = 0, next = 0, index = 0;
      JpegCode expected{0, 0};
      for (uint32_t length = 1; length <= 16 && expected.length == 0; ++length) {
        code = window >> (16 - length);
        const uint32_t count = spec.counts[length - 1];
        if (code >= next && code < next + count) expected = {length, spec.symbols[index + code - next]};
        index += count;
        next = (next + count) * 2;
      }
      const JpegCode found = table.find(window);
      wrong += found.length != expected.length || found.symbol != expected.symbol;
    }
    CHECK(wrong == 0);
  }
}
