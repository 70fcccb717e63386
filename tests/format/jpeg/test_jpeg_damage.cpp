// Damaged, cut and mutated JPEG files and indexed JPEGs.
#include <algorithm>
#include <random>

#include "format/jpeg/index.h"
#include "format/jpeg/picture.h"
#include "tests/format/jpeg/jpeg_checks.h"
#include "tests/models.h"
#include "tests/results.h"
#include "tests/sanitized.h"

using namespace scree;
using namespace scree::tests;
using namespace scree::tests::jpeg;

namespace {

/// Decodes groups into a buffer of their size that ends at a guard page, and some of their pixels without a buffer.
/// Both must give the same colours, whatever the data.
void decode_groups(const JpegIndex& index, uint32_t step) {
  const std::vector<uint32_t> factors = jpeg_factors(index);
  const JpegPicture picture = jpeg_picture(index, factors.data());
  const uint32_t group_mcus = picture.view.group_mcus;
  GuardedBytes buffer(size_t{64} * picture.mcu_blocks * group_mcus);
  auto* const samples = reinterpret_cast<uint8_t*>(buffer.bytes().data());
  for (uint32_t group = 0; group < index.layout.group_count; group += step) {
    decode_jpeg_group(picture, group, samples);
    JpegPlace places[4];
    uint32_t expected[4];
    for (uint32_t i = 0; i < 4; ++i) {
      const uint32_t mcus = std::min(group_mcus, picture.view.mcu_count - group * group_mcus);
      places[i] = {group, (group + i) % mcus, (5 * i + group) % picture.mcu_width,
                   (3 * i + group) % picture.mcu_height};
      expected[i] = jpeg_colour(picture, places[i], samples);
    }
    for (const uint32_t wanted : {15u, 6u, 8u}) {
      uint32_t colours[4] = {1, 2, 3, 4};
      decode_jpeg_colours(picture, places, wanted, colours);
      for (uint32_t i = 0; i < 4; ++i)
        if (colours[i] != ((wanted >> i & 1u) != 0 ? expected[i] : i + 1)) FAIL("group " << group << ", pixel " << i);
    }
  }
}

/// Opens the index and, if that succeeds, decodes every MCU both ways. Nothing may be read or written out of bounds.
void decode_all(std::span<const std::byte> bytes) {
  const auto index = open_jpeg_index(bytes);
  if (!index) return;
  const JpegView view = index->view();
  Blocks blocks;
  const uint32_t step = std::max(1u, view.mcu_count / 64);
  for (uint32_t mcu = 0; mcu < view.mcu_count; mcu += step) decode_mcu(view, mcu, blocks);
  CHECK_FALSE(decode_mcu(view, view.mcu_count, blocks));
  decode_groups(*index, std::max(1u, index->layout.group_count / 8));
  (void)rebuild(*index);
}

}  // namespace
TEST_CASE("a JPEG that is cut anywhere is refused with the number of the byte", "[jpeg_index]") {
  for (const int restart : {0, 2}) {
    const Bytes file = make_jpeg(recipe_of(50, 40, {{2, 2}, {1, 1}, {1, 1}}, restart));
    for (size_t size = 0; size < file.size(); ++size) {
      GuardedBytes guarded(std::span<const std::byte>(file).first(size));
      const auto encoded = encode(guarded.bytes());
      if (size >= file.size() - 2) {
        if (!encoded) FAIL("without the end marker: " << encoded.error().message);  // the picture is complete
        continue;
      }
      const std::string found = outcome(encoded);
      if (found != "truncated" && !(size < 2 && found == "format")) FAIL(size << " bytes: " << found);
      if (encoded.error().message.find(": byte ") == std::string::npos) FAIL(encoded.error().message);
    }
  }
}

TEST_CASE("errors of damaged data name the defect", "[jpeg_index]") {
  const Bytes file = make_jpeg(recipe_of(64, 64, {{2, 2}, {1, 1}, {1, 1}}, 4));
  const size_t first = find_marker(file, 0xd0);
  Bytes swapped = file;
  swapped[first + 1] = std::byte{0xd3};
  CHECK(refusal(encode(swapped)).message ==
        "JPEG: byte " + std::to_string(first) + ": MCU 4 of 16: marker 211, expected restart marker 208");
  // Two extra bytes before a marker are dropped, and so are fill bytes.
  Bytes longer = file;
  longer.insert(longer.begin() + static_cast<ptrdiff_t>(first), {std::byte{0x12}, std::byte{0x34}, std::byte{0xff}});
  uint64_t dropped = 0;
  const auto kept = must(encode(longer, &dropped));
  CHECK(dropped == 2);
  CHECK(kept == *encode(file));
  // A code of all ones is invalid.
  const Bytes plain = make_jpeg(recipe_of(64, 64, {{1, 1}}));
  const auto header = parse_jpeg(plain);
  Bytes ones = plain;
  for (size_t i = 0; i < 8; i += 2) {
    ones[header->data_offset + 20 + i] = std::byte{0xff};
    ones[header->data_offset + 21 + i] = std::byte{0};
  }
  check_refusal(encode(ones), ErrorCode::kFormat, "no Huffman code");
  // A header whose size exceeds the file takes no memory.
  Bytes huge = plain;
  for (size_t i = 5; i < 9; ++i) huge[find_marker(huge, 0xc0) + i] = std::byte{0xff};
  CHECK(outcome(encode(huge)) == "truncated");
}

TEST_CASE("damaged JPEG files are refused or indexed, and every MCU ends", "[jpeg_index]") {
  const std::filesystem::path folder = scree::tests::real_models("bad/jpeg");
  if (folder.empty()) return;
  uint32_t refused = 0;
  for (const auto& path : scree::tests::files_below(folder)) {
    INFO(path.filename().string());
    const Bytes file = read_bytes(path);
    GuardedBytes guarded(file);
    const auto bytes = encode(guarded.bytes());
    if (!bytes) {
      ++refused;
      CHECK(bytes.error().message.find('\n') == std::string::npos);
      continue;
    }
    CHECK(rebuild(must(open_jpeg_index(*bytes))));
  }
  CHECK(refused > 50);
}

TEST_CASE("an indexed JPEG stays inside its bytes", "[jpeg_index]") {
  const auto bytes = must(encode(make_jpeg(recipe_of(150, 70, {{2, 1}, {1, 1}, {1, 1}}, 7))));
  {
    GuardedBytes guarded(bytes);
    CHECK(rebuild(must(open_jpeg_index(guarded.bytes()))));
    decode_all(guarded.bytes());
  }
  for (size_t size = 0; size < bytes.size(); ++size) {
    GuardedBytes guarded(std::span<const std::byte>(bytes).first(size));
    const std::string found = outcome(open_jpeg_index(guarded.bytes()));
    if (found != "truncated") FAIL(size << " of " << bytes.size() << " bytes: " << found);
  }
  Bytes longer = bytes;
  longer.push_back(std::byte{0});
  CHECK(outcome(open_jpeg_index(longer)) == "trailing");
  for (size_t shift = 1; shift < 4; ++shift) {
    Bytes moved(bytes.size() + shift);
    std::copy(bytes.begin(), bytes.end(), moved.begin() + static_cast<ptrdiff_t>(shift));
    CHECK(rebuild(must(open_jpeg_index(std::span(moved).subspan(shift)))));
  }
}

TEST_CASE("a flipped bit of an indexed JPEG is refused or harmless", "[jpeg_index]") {
  const auto bytes = must(encode(make_jpeg(recipe_of(50, 24, {{2, 2}, {1, 1}, {1, 1}}, 3))));
  const auto original = must(open_jpeg_index(bytes));
  const auto data_at = static_cast<size_t>(original.data.data() - bytes.data());
  const auto blocks_at = static_cast<size_t>(original.blocks.data() - bytes.data());
  uint32_t accepted_header = 0;
  GuardedBytes guarded(bytes);
  for (size_t bit = 0; bit < 8 * bytes.size(); bit += tests::kIsSanitized ? 3 : 1) {
    const size_t at = bit / 8;
    const std::byte mask = std::byte{1} << (bit % 8);
    guarded.bytes()[at] ^= mask;
    decode_all(guarded.bytes());
    const auto index = open_jpeg_index(guarded.bytes());
    const bool is_whole = index && rebuild(*index);
    guarded.bytes()[at] ^= mask;
    // A flipped bit is undetectable in these places: any quantisation table is valid, a component may use another
    // table, and a Huffman table or the data may belong to another picture. Apart from them, the data determine the
    // index and all of the header, except the colour space and sizes with equally many MCUs.
    const bool is_quant_number = at >= 24 && at < 48 && at % 8 == 2;
    const bool is_told = at < 6 || (at >= 12 && at < 64 && !is_quant_number) || at >= blocks_at;
    const bool is_slack = at >= data_at + original.data.size() && at < blocks_at;
    if (is_slack && index) FAIL("bit " << bit << " of the slack");
    if (is_told && is_whole) FAIL("bit " << bit % 8 << " of byte " << at << ", the blocks at " << blocks_at);
    accepted_header += at < 64 && is_whole;
  }
  CHECK(accepted_header > 0);  // another width within the last MCU, RGB for YCbCr
}

TEST_CASE("mutated JPEG files and indexed JPEGs never take a decoder past its limits", "[jpeg_index][fuzz]") {
  std::mt19937 random(11);
  std::vector<Bytes> files;
  for (const JpegRecipe& recipe : indexable_recipes())
    if (recipe.width <= 160) files.push_back(make_jpeg(recipe));
  const auto mutate = [&](Bytes& bytes, size_t first) {
    for (auto i = 1 + random() % 4; i > 0; --i) {
      const size_t at = random() % 4 == 0 ? first + random() % (bytes.size() - first) : random() % bytes.size();
      switch (random() % 5) {
        case 0:
          bytes[at] = static_cast<std::byte>(random());
          break;
        case 1:
          bytes[at] ^= std::byte{1} << random() % 8;
          break;
        case 2:
          bytes[at] = std::byte{0xff};
          break;
        case 3:
          bytes.erase(bytes.begin() + static_cast<ptrdiff_t>(at));
          break;
        default:
          bytes.insert(bytes.begin() + static_cast<ptrdiff_t>(at), static_cast<std::byte>(random()));
          break;
      }
      if (bytes.size() < 16) return;
    }
  };
  uint32_t encoded_count = 0;
  for (int round = 0; round < 3000; ++round) {
    Bytes file = files[random() % files.size()];
    mutate(file, file.size() / 2);
    GuardedBytes guarded(file);
    const auto encoded = encode(guarded.bytes());
    if (!encoded) continue;
    ++encoded_count;
    must(rebuild(must(open_jpeg_index(*encoded))));
  }
  CHECK(encoded_count > 300);
  std::vector<Bytes> indexed;
  for (const Bytes& file : files) indexed.push_back(*encode(file));
  uint32_t opened = 0;
  for (int round = 0; round < 3000; ++round) {
    Bytes bytes = indexed[random() % indexed.size()];
    // The size is kept in most cases, so that other parts are wrong than the size.
    const size_t size = bytes.size();
    mutate(bytes, 64);
    if (round % 8 != 0) bytes.resize(size);
    GuardedBytes guarded(bytes);
    opened += static_cast<bool>(open_jpeg_index(guarded.bytes()));
    decode_all(guarded.bytes());
  }
  CHECK(opened > 300);
}

TEST_CASE("a group decoder stays inside its buffers and ends, on any bytes", "[jpeg_index]") {
  std::mt19937 random(20261122);
  for (const auto& factors :
       {std::vector<std::pair<int, int>>{{2, 2}, {1, 1}, {1, 1}}, {{1, 1}}, {{4, 1}, {1, 1}, {2, 1}}}) {
    for (const int restart : {0, 3}) {
      const auto bytes = must(encode(make_jpeg(recipe_of(120, 90, factors, restart))));
      const auto index = must(open_jpeg_index(bytes));
      decode_groups(index, 1);
      // The parts that open_jpeg_index() checks stay; data and anchors are random.
      const auto data_at = static_cast<size_t>(index.data.data() - bytes.data());
      const auto anchors_at = static_cast<size_t>(index.anchors.data() - bytes.data());
      GuardedBytes guarded(bytes);
      const auto fill = [&](size_t at, size_t size, uint32_t kind) {
        for (size_t i = at; i < at + size; ++i)
          guarded.bytes()[i] = static_cast<std::byte>(kind == 0 ? random() : kind == 1 ? 0xff : 0);
      };
      for (uint32_t kind = 0; kind < 3; ++kind) {
        fill(data_at, index.data.size(), kind);
        const auto damaged = must(open_jpeg_index(guarded.bytes()));
        decode_groups(damaged, 1);
        // Random anchors, which bypass the checks of a file.
        fill(anchors_at, index.anchors.size(), kind);
        decode_groups(damaged, 1);
        std::copy_n(bytes.begin() + static_cast<ptrdiff_t>(anchors_at), index.anchors.size(),
                    guarded.bytes().begin() + static_cast<ptrdiff_t>(anchors_at));
      }
    }
  }
}
