#include "tools/convert/encode/weld.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>

namespace scree::convert {
namespace {

constexpr uint32_t kEmpty = UINT32_MAX;
constexpr size_t kBlock = 64;  // items whose slots are prefetched together, because the table exceeds the cache

/// The compared values of an item: up to four attribute values, and its class so far.
using Key = std::array<uint32_t, 5>;

uint64_t hash_of(const Key& key) {
  // Two independent multiplications. Coordinates of a grid differ in few bits, so the high half of the product is
  // folded down.
  const uint64_t a = (uint64_t{key[0]} << 32 | key[1]) * 0x9e3779b97f4a7c15ull;
  const uint64_t b = (uint64_t{key[2]} << 32 | key[3]) * 0xbf58476d1ce4e5b9ull;
  const uint64_t sum = (a ^ std::rotr(a, 32)) + (b ^ std::rotr(b, 29)) + key[4];
  const uint64_t mixed = sum * 0x94d049bb133111ebull;
  return mixed ^ mixed >> 32;
}

uint32_t bits_of(float value, Welder::Zeros zeros) {
  return std::bit_cast<uint32_t>(zeros == Welder::Zeros::kUnsigned ? value + 0.0f : value);
}

}  // namespace

/// Sets first_items_ to the first item with an equal key for each of `count` items.
template <class Item>
void Welder::find_equals(uint64_t count, const Item& item) {
  const uint64_t mask = std::bit_ceil(count + count / 4 + 2) - 1;  // at most 0.8 full
  const uint64_t items = std::bit_ceil(count + 1) - 1;             // the bits of an entry that hold an item's number
  table_.assign(mask + 1, kEmpty);
  first_items_.resize(count);
  std::array<uint64_t, kBlock> hashes;
  for (uint64_t begin = 0; begin < count; begin += kBlock) {
    const uint64_t end = std::min<uint64_t>(begin + kBlock, count);
    for (uint64_t i = begin; i < end; ++i) {
      hashes[i - begin] = hash_of(item(i));
      __builtin_prefetch(&table_[hashes[i - begin] & mask], 1);
    }
    for (uint64_t i = begin; i < end; ++i) {
      const uint64_t hash = hashes[i - begin];
      const auto tag = static_cast<uint32_t>(hash >> 32 & ~items);
      uint64_t slot = hash & mask;
      uint32_t entry = table_[slot];
      while (entry != kEmpty && ((entry & ~items) != tag || item(entry & items) != item(i)))
        entry = table_[slot = (slot + 1) & mask];
      if (entry == kEmpty) entry = table_[slot] = tag | static_cast<uint32_t>(i);
      first_items_[i] = static_cast<uint32_t>(entry & items);
    }
  }
}

void Welder::start(std::span<const float> positions, Zeros zeros) {
  const uint64_t count = positions.size() / 3;
  find_equals(count, [&](uint64_t i) {
    const float* p = &positions[3 * i];
    return Key{bits_of(p[0], zeros), bits_of(p[1], zeros), bits_of(p[2], zeros), 0, 0};
  });
  firsts_.swap(first_items_);
  count_duplicates();
}

void Welder::part(std::span<const float> values, uint32_t components) {
  find_equals(candidates_.size(), [&](uint64_t i) {
    Key key{};
    for (uint32_t c = 0; c < components; ++c) key[c] = bits_of(values[components * i + c], Zeros::kUnsigned);
    key[4] = firsts_[candidates_[i]];
    return key;
  });
  // firsts_ changes only after the loop above, which reads its old values.
  for (size_t i = 0; i < candidates_.size(); ++i) firsts_[candidates_[i]] = candidates_[first_items_[i]];
  count_duplicates();
}

void Welder::count_duplicates() {
  duplicates_ = 0;
  for (uint64_t i = 0; i < firsts_.size(); ++i) duplicates_ += firsts_[i] != i ? 1 : 0;
}

std::span<const uint32_t> Welder::find_candidates() {
  candidates_.clear();
  if (duplicates_ == 0) return candidates_;
  has_equal_.assign(firsts_.size(), false);
  for (uint64_t i = 0; i < firsts_.size(); ++i)
    if (firsts_[i] != i) has_equal_[i] = has_equal_[firsts_[i]] = true;
  for (uint64_t i = 0; i < firsts_.size(); ++i)
    if (has_equal_[i]) candidates_.push_back(static_cast<uint32_t>(i));
  return candidates_;
}

}  // namespace scree::convert
