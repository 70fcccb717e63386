#include "kernels/shade/jpeg_group_cache.h"

#include <algorithm>
#include <cassert>
#include <cstring>
#include <thread>

namespace scree::kernels {
namespace {

/// Spreads keys evenly that differ in a few low bits.
uint64_t spread(uint64_t key, uint64_t count) {
  key = (key ^ (key >> 32)) * 0x9e3779b97f4a7c15u;
  key = (key ^ (key >> 29)) * 0xbf58476d1ce4e5b9u;
  return (key >> 20) % count;
}

}  // namespace

JpegGroupCache::JpegGroupCache(uint64_t bytes, uint32_t slot_bytes) : slot_bytes_(slot_bytes) {
  assert(slot_bytes >= 1 && slot_bytes <= 64 * format::kJpegMaxGroupBlocks);
  const uint64_t slots = std::max<uint64_t>(1, bytes / slot_bytes);
  ways_ = std::min(slots, kWays);
  set_count_ = slots / ways_;
  sets_ = std::make_unique<Set[]>(set_count_);
  keys_.assign(ways_ * set_count_, kEmpty);
  stamps_.assign(keys_.size(), 0);
  samples_ = std::make_unique_for_overwrite<uint8_t[]>(keys_.size() * slot_bytes);
}

void JpegGroupCache::lock(Set& set) {
  while (set.is_held.exchange(true, std::memory_order_acquire))
    while (set.is_held.load(std::memory_order_relaxed)) std::this_thread::yield();
}

/// Requires that the set is locked. Null if the group is absent.
const uint8_t* JpegGroupCache::find(uint64_t set, uint64_t key) {
  for (uint64_t slot = set * ways_; slot < (set + 1) * ways_; ++slot) {
    if (keys_[slot] != key) continue;
    stamps_[slot] = ++sets_[set].clock;
    return samples_.get() + slot * slot_bytes_;
  }
  return nullptr;
}

const uint8_t* JpegGroupCache::hold(const format::JpegPicture& picture, uint32_t level, uint32_t group,
                                    uint64_t& place) {
  assert(format::jpeg_group_bytes(picture) <= slot_bytes_);
  const uint64_t key = uint64_t{level} << 32 | group;
  place = spread(key, set_count_);
  Set& set = sets_[place];
  lock(set);
  if (const uint8_t* found = find(place, key)) return found;
  // Other threads need not wait for the decoding; at worst they decode the same group.
  release(place);
  uint8_t samples[64 * format::kJpegMaxGroupBlocks];
  format::decode_jpeg_group(picture, group, samples);
  decoded_.fetch_add(1, std::memory_order_relaxed);
  lock(set);
  if (const uint8_t* found = find(place, key)) return found;
  uint64_t oldest = place * ways_;
  for (uint64_t slot = oldest; slot < (place + 1) * ways_; ++slot) {
    if (keys_[slot] == kEmpty) {
      oldest = slot;
      break;
    }
    // Compares ages, so that a clock that wraps around does no harm.
    if (set.clock - stamps_[slot] > set.clock - stamps_[oldest]) oldest = slot;
  }
  keys_[oldest] = key;
  stamps_[oldest] = ++set.clock;
  uint8_t* const out = samples_.get() + oldest * slot_bytes_;
  std::memcpy(out, samples, format::jpeg_group_bytes(picture));
  return out;
}

void JpegGroupCache::release(uint64_t place) {
  sets_[place].is_held.store(false, std::memory_order_release);
}

void JpegGroupCache::fetch(const format::JpegPicture& picture, uint32_t level, const uint32_t x[2], const uint32_t y[2],
                           uint32_t colours[4]) {
  format::JpegPlace places[4];
  for (uint32_t i = 0; i < 4; ++i) places[i] = format::jpeg_place(picture, x[i % 2], y[i / 2]);
  const bool fits = format::jpeg_group_bytes(picture) <= slot_bytes_;
  uint32_t missing = 15;
  for (uint32_t i = 0; i < 4; ++i) {
    if ((missing >> i & 1u) == 0) continue;
    uint32_t same = 0;  // pixels in this one's group
    for (uint32_t j = i; j < 4; ++j)
      if (places[j].group == places[i].group) same |= 1u << j;
    missing &= ~same;
    if (!fits) {
      format::decode_jpeg_colours(picture, places, same, colours);
      decoded_.fetch_add(1, std::memory_order_relaxed);
      continue;
    }
    uint64_t place;
    const uint8_t* const samples = hold(picture, level, places[i].group, place);
    for (uint32_t j = i; j < 4; ++j)
      if ((same >> j & 1u) != 0) colours[j] = format::jpeg_colour(picture, places[j], samples);
    release(place);
  }
}

}  // namespace scree::kernels
