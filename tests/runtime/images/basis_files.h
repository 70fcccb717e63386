// Makes KTX2 files of BasisLZ for the tests: random codebooks, and blocks that refer to colours and selectors in every
// way that the format allows.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <random>
#include <utility>
#include <vector>

#include "tests/runtime/images/block_files.h"

namespace scree::tests {

struct BasisRecipe {
  uint32_t width = 37, height = 22, levels = 2;
  bool has_alpha = true, is_grey = false, has_plain_selectors = false;
  std::string swizzle{};
  uint32_t seed = 1;
};

struct BasisFile {
  FileBytes bytes;
  std::vector<FileBytes> levels;  // their RGBA pixels
};

/// Writes bits, lowest first, and codes of nearly equal lengths for a given number of symbols.
class BasisWriter {
 public:
  void put(uint32_t value, uint32_t count) {
    for (uint32_t i = 0; i < count; ++i, ++bits_) {
      if (bits_ % 8 == 0) bytes_.push_back(std::byte{0});
      bytes_.back() |= static_cast<std::byte>((value >> i & 1) << bits_ % 8);
    }
  }
  /// `symbols`: of the code, at least 2. The first ones have codes of n bits, the others codes of n + 1 bits.
  void code(uint32_t symbol, uint32_t symbols) {
    const auto [length, shorter] = lengths(symbols);
    if (symbol < shorter) return reversed(symbol, length);
    reversed(shorter + symbol, length + 1);
  }
  void table(uint32_t symbols) {
    constexpr uint32_t kOrder[] = {17, 18, 19, 20, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15, 16};
    const auto [length, shorter] = lengths(symbols);
    put(symbols, 14);
    put(21, 5);
    for (const uint32_t l : kOrder) put(l == length || (l == length + 1 && shorter < symbols) ? 1 : 0, 3);
    for (uint32_t i = 0; i < symbols; ++i) put(i < shorter ? 0 : 1, 1);
  }
  void groups(uint32_t value, uint32_t bits) {
    for (; value >> bits != 0; value >>= bits) put((value & ((1u << bits) - 1)) | 1u << bits, bits + 1);
    put(value, bits + 1);
  }
  const FileBytes& bytes() const { return bytes_; }

 private:
  static std::pair<uint32_t, uint32_t> lengths(uint32_t symbols) {
    const auto length = static_cast<uint32_t>(std::bit_width(symbols)) - 1;
    return {length, (2u << length) - symbols};
  }
  void reversed(uint32_t value, uint32_t count) {
    while (count-- > 0) put(value >> count & 1, 1);
  }

  FileBytes bytes_;
  uint64_t bits_ = 0;
};

inline constexpr uint32_t kBasisColors = 5, kBasisSelectors = 6, kBasisHistory = 8;

struct BasisCodebooks {
  std::array<std::array<std::array<uint8_t, 3>, 4>, kBasisColors> colors;
  std::array<uint32_t, kBasisSelectors> selectors;
  FileBytes color_part, selector_part, table_part;
};

inline BasisCodebooks make_codebooks(const BasisRecipe& recipe, std::mt19937& random) {
  constexpr int32_t kModifiers[8][2] = {{2, 8}, {5, 17}, {9, 29}, {13, 42}, {18, 60}, {24, 80}, {33, 106}, {47, 183}};
  BasisCodebooks books;
  BasisWriter colors, selectors, tables;
  for (int i = 0; i < 3; ++i) colors.table(32);
  colors.table(8);
  colors.put(recipe.is_grey ? 1 : 0, 1);
  std::array<uint32_t, 3> before{16, 16, 16};
  uint32_t table = 0;
  for (auto& four : books.colors) {
    const uint32_t next = random() % 8;
    colors.code((next - table) & 7, 8);
    table = next;
    for (size_t c = 0; c < 3; ++c) {
      const uint32_t value = recipe.is_grey && c > 0 ? before[0] : random() % 32;
      if (!recipe.is_grey || c == 0) colors.code((value - before[c]) & 31, 32);
      before[c] = value;
      const auto wide = static_cast<int32_t>(value * 8 + value / 4);
      const int32_t modifiers[] = {-kModifiers[table][1], -kModifiers[table][0], kModifiers[table][0],
                                   kModifiers[table][1]};
      for (size_t i = 0; i < 4; ++i) four[i][c] = static_cast<uint8_t>(std::clamp(wide + modifiers[i], 0, 255));
    }
  }
  selectors.put(recipe.has_plain_selectors ? 4 : 0, 3);
  if (!recipe.has_plain_selectors) selectors.table(256);
  for (size_t i = 0; i < kBasisSelectors; ++i) {
    const uint32_t value = books.selectors[i] = static_cast<uint32_t>(random());
    if (i == 0 || recipe.has_plain_selectors) {
      selectors.put(value & 0xffff, 16);
      selectors.put(value >> 16, 16);
      continue;
    }
    for (uint32_t row = 0; row < 32; row += 8) selectors.code((value ^ books.selectors[i - 1]) >> row & 255, 256);
  }
  tables.table(257);
  tables.table(kBasisColors);
  tables.table(kBasisSelectors + kBasisHistory + 1);
  tables.table(64);
  tables.put(kBasisHistory, 13);
  books.color_part = colors.bytes();
  books.selector_part = selectors.bytes();
  books.table_part = tables.bytes();
  return books;
}

/// Writes a slice of random blocks. Returns its bytes and sets its pixels.
inline FileBytes make_slice(const BasisCodebooks& books, bool is_alpha, uint32_t width, uint32_t height,
                            std::mt19937& random, FileBytes& pixels) {
  const uint32_t columns = (width + 3) / 4, rows = (height + 3) / 4;
  // One symbol per 2 x 2 blocks gives the source of each block's colours: 0 left, 1 above, 2 above left, 3 a
  // difference.
  std::vector<uint32_t> groups;
  for (uint32_t y = 0; y < rows; y += 2)
    for (uint32_t x = 0; x < columns; x += 2) {
      uint32_t symbol = 0;
      for (uint32_t k = 0; k < 4; ++k) {
        const bool has_left = x + k % 2 > 0, has_above = y + k / 2 > 0;
        uint32_t source = static_cast<uint32_t>(random() % 4);
        if ((source != 1 && source != 3 && !has_left) || (source != 0 && source != 3 && !has_above)) source = 3;
        symbol |= source << 2 * k;
      }
      // Makes many predictions equal, so that they share a symbol.
      if (x > 0 && y > 0 && x > 2 && random() % 4 != 0) symbol = groups.back();
      groups.push_back(symbol);
    }
  const auto run_of = [&](size_t at, uint32_t value) {
    size_t end = at;
    while (end < groups.size() && groups[end] == value) ++end;
    return static_cast<uint32_t>(end - at);
  };
  BasisWriter out;
  std::vector<uint32_t> color(size_t{columns} * rows), history(kBasisHistory);
  uint32_t repeats = 0, run = 0, next = kBasisHistory / 2, previous = 0, last_group = 0;
  for (uint32_t y = 0; y < rows; ++y)
    for (uint32_t x = 0; x < columns; ++x) {
      const size_t group = size_t{y / 2} * ((columns + 1) / 2) + x / 2;
      if (x % 2 == 0 && y % 2 == 0) {
        if (repeats > 0) {
          --repeats;
        } else if (const uint32_t count = run_of(group, last_group); count >= 3) {
          out.code(256, 257);
          out.groups(count - 3, 4);
          repeats = count - 1;
        } else {
          out.code(last_group = groups[group], 257);
        }
      }
      const size_t at = size_t{y} * columns + x;
      switch (groups[group] >> (x % 2 * 2 + y % 2 * 4) & 3) {
        case 0:
          color[at] = color[at - 1];
          break;
        case 1:
          color[at] = color[at - columns];
          break;
        case 2:
          color[at] = color[at - columns - 1];
          break;
        default: {
          color[at] = static_cast<uint32_t>(random() % kBasisColors);
          out.code((color[at] + kBasisColors - previous) % kBasisColors, kBasisColors);
        }
      }
      previous = color[at];

      uint32_t selector;
      if (run == 0 && random() % 8 == 0 && columns * rows - at >= 3) {  // a run of the first entry of the history
        run = std::min(static_cast<uint32_t>(random() % 200) + 3, columns * rows - static_cast<uint32_t>(at));
        out.code(kBasisSelectors + kBasisHistory, kBasisSelectors + kBasisHistory + 1);
        out.code(std::min(run - 3, 63u), 64);
        if (run - 3 >= 63) out.groups(run - 3, 7);
      }
      if (run > 0) {
        --run;
        selector = history[0];
      } else if (random() % 2 == 0) {
        const auto index = static_cast<uint32_t>(random() % kBasisHistory);
        out.code(kBasisSelectors + index, kBasisSelectors + kBasisHistory + 1);
        selector = history[index];
        std::swap(history[index], history[index / 2]);
      } else {
        selector = static_cast<uint32_t>(random() % kBasisSelectors);
        out.code(selector, kBasisSelectors + kBasisHistory + 1);
        history[next] = selector;
        next = next + 1 == kBasisHistory ? kBasisHistory / 2 : next + 1;
      }
      for (uint32_t i = 0; i < 16; ++i) {
        const uint32_t px = 4 * x + i % 4, py = 4 * y + i / 4;
        if (px >= width || py >= height) continue;
        const auto& rgb = books.colors[color[at]][books.selectors[selector] >> 2 * i & 3];
        std::byte* pixel = pixels.data() + 4 * (size_t{py} * width + px);
        for (size_t c = 0; c < 3 && !is_alpha; ++c) pixel[c] = std::byte{rgb[c]};
        pixel[3] = is_alpha ? std::byte{rgb[1]} : std::byte{255};
      }
    }
  return out.bytes();
}

inline BasisFile make_basis_lz(const BasisRecipe& recipe) {
  std::mt19937 random(recipe.seed);
  const BasisCodebooks books = make_codebooks(recipe, random);
  BasisFile made;
  std::vector<std::array<FileBytes, 2>> slices(recipe.levels);
  for (uint32_t l = 0; l < recipe.levels; ++l) {
    const uint32_t width = std::max(1u, recipe.width >> l), height = std::max(1u, recipe.height >> l);
    FileBytes& pixels = made.levels.emplace_back(size_t{4} * width * height);
    for (const bool is_alpha : {false, true})
      if (!is_alpha || recipe.has_alpha)
        slices[l][is_alpha ? 1 : 0] = make_slice(books, is_alpha, width, height, random, pixels);
  }
  FileBytes global;
  put(global, uint32_t{kBasisColors | kBasisSelectors << 16});
  for (const FileBytes* part : {&books.color_part, &books.selector_part, &books.table_part})
    put(global, static_cast<uint32_t>(part->size()));
  put(global, 0u);
  FileBytes data;
  std::vector<std::pair<uint64_t, uint64_t>> places(recipe.levels);
  for (uint32_t l = recipe.levels; l-- > 0;) {
    places[l].first = data.size();
    for (const FileBytes& slice : slices[l]) data.insert(data.end(), slice.begin(), slice.end());
    places[l].second = data.size() - places[l].first;
  }
  for (const auto& [color, alpha] : slices)
    for (const size_t word : {size_t{0}, size_t{0}, color.size(), alpha.empty() ? 0 : color.size(), alpha.size()})
      put(global, static_cast<uint32_t>(word));
  for (const FileBytes* part : {&books.color_part, &books.selector_part, &books.table_part})
    global.insert(global.end(), part->begin(), part->end());

  // The header, index, descriptor and keys of a UASTC file, followed by the two slices.
  made.bytes = make_ktx2({.vk_format = 0,
                          .model = 163,
                          .width = recipe.width,
                          .height = recipe.height,
                          .levels = recipe.levels,
                          .swizzle = recipe.swizzle,
                          .second_channel = recipe.has_alpha ? 15u : 0u});
  const auto set = [&](size_t at, auto value) { made.bytes = with(std::move(made.bytes), at, value); };
  uint64_t begin;
  std::memcpy(&begin, made.bytes.data() + 80 + 24 * (recipe.levels - 1), sizeof(begin));
  made.bytes.resize(begin);
  set(44, 1u);
  set(64, begin);
  set(72, uint64_t{global.size()});
  for (uint32_t l = 0; l < recipe.levels; ++l) {
    set(80 + 24 * l, begin + global.size() + places[l].first);
    set(88 + 24 * l, places[l].second);
    set(96 + 24 * l, uint64_t{0});
  }
  made.bytes.insert(made.bytes.end(), global.begin(), global.end());
  made.bytes.insert(made.bytes.end(), data.begin(), data.end());
  return made;
}

}  // namespace scree::tests
