// The GPU's cache of decoded groups of indexed JPEGs (format/jpeg/pixels.h), for threads that must not wait for each
// other. The CPU has block_cache.h instead. This code runs on a CPU too, for tests.
//
// A picture is shaded in rounds. During shading the cache's keys and samples do not change: a pixel that lacks a group
// requests it and is left for the next round. Between two rounds every requested group replaces one that this round did
// not use, and is decoded. After a few rounds the remaining pixels, for which the cache is too small, decode the groups
// themselves. So the picture does not depend on the cache's size.
#pragma once

#include <cstdint>

#include "kernels/shade/shared_words.h"
#include "kernels/shade/texture.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// A group that pixels lack: its key, and its index in TextureCache::wanted.
struct GroupRequest {
  uint64_t key;
  uint32_t wanted_index;
  uint32_t zero;
};

/// The counts of one round.
struct RoundCounters {
  uint32_t requests;  // requested groups; may exceed the capacity
  uint32_t decoded;   // of these, groups that found a slot
  uint32_t tiles;     // tiles with pixels that are left for the next round
  uint32_t zero;
};

/// A view of the cache: keys in sets of kWays; each key may lie in either of two sets. Owns nothing.
struct TextureCache {
  static constexpr uint32_t kWays = 8;
  static constexpr uint32_t kProbes = 16;  // of the table `wanted`
  static constexpr uint64_t kNoKey = ~uint64_t{0};
  static constexpr uint32_t kNoSlot = ~uint32_t{0};
  static constexpr uint32_t kNever = ~uint32_t{0};  // the stamp of an absent way

  uint64_t* keys;           // level number << 32 | group; kWays per set
  uint32_t* stamps;         // the last round that used the slot
  uint8_t* samples;         // slot_bytes per slot
  uint64_t* wanted;         // hash table of the keys requested in this round; all kNoKey between rounds
  GroupRequest* requests;   // one per slot
  const JpegLevel* levels;  // by number
  uint32_t set_count;
  uint32_t slot_count;
  uint32_t slot_bytes;  // bytes of the largest group, a multiple of 64
  uint32_t wanted_count;

  SCREE_HD static uint64_t key_of(uint32_t level, uint32_t group) { return uint64_t{level} << 32 | group; }

  SCREE_HD static uint64_t spread(uint64_t key) {
    key = (key ^ (key >> 32)) * 0x9e3779b97f4a7c15u;
    return (key ^ (key >> 29)) * 0xbf58476d1ce4e5b9u;
  }
  /// Scales 32 evenly spread bits to a number below `count`.
  SCREE_HD static uint32_t scale_to(uint32_t bits, uint32_t count) {
    return static_cast<uint32_t>(uint64_t{bits} * count >> 32);
  }
  SCREE_HD uint32_t first_slot(uint64_t spread_key, uint32_t choice) const {
    return kWays * scale_to(static_cast<uint32_t>(spread_key >> (choice == 0 ? 32 : 12)), set_count);
  }

  /// The slot of a key, or kNoSlot. Keys do not change during shading.
  SCREE_HD uint32_t find(uint64_t key) const {
    const uint64_t spread_key = spread(key);
    for (uint32_t choice = 0; choice < 2; ++choice) {
      const uint32_t first = first_slot(spread_key, choice);
      uint32_t found = kNoSlot;
      for (uint32_t way = 0; way < kWays; ++way) found = keys[first + way] == key ? first + way : found;
      if (found != kNoSlot) return found;
    }
    return kNoSlot;
  }

  /// The group's samples, marked as used in round `now`; null if the group is absent.
  SCREE_HD const uint8_t* lookup(uint64_t key, uint32_t now) const {
    const uint32_t slot = find(key);
    if (slot == kNoSlot) return nullptr;
    if (load_cached(stamps + slot) != now) store_relaxed(stamps + slot, now);
    return samples + uint64_t{slot} * slot_bytes;
  }

  /// Requests an absent group, once for all pixels that lack it. Drops the request if there is no room.
  SCREE_HD void request_group(uint64_t key, RoundCounters* counters) const {
    if (load_relaxed(&counters->requests) > slot_count)
      return;  // otherwise the misses of a small cache would wrap the counter
    uint32_t place = scale_to(static_cast<uint32_t>(spread(key) >> 20), wanted_count);
    for (uint32_t probe = 0; probe < kProbes; ++probe) {
      uint64_t there = load_cached(wanted + place);
      if (there == kNoKey) there = compare_and_swap(wanted + place, kNoKey, key);
      if (there == key) return;
      if (there == kNoKey) {
        const uint32_t index = fetch_increment(&counters->requests);
        if (index < slot_count) {
          requests[index] = {key, place, 0};
        } else {
          store_relaxed(wanted + place, kNoKey);
        }
        return;
      }
      place = place + 1 == wanted_count ? 0 : place + 1;
    }
  }

  /// Gives a request of round `now` the least recently used slot that this round did not use; kNoSlot if there is none.
  /// Several threads may allocate at once. A slot lost to another thread keeps the stamp `now`, so a thread tries at
  /// most once per way.
  SCREE_HD uint32_t allocate_slot(const GroupRequest& request, uint32_t now) const {
    store_relaxed(wanted + request.wanted_index, kNoKey);
    const uint64_t spread_key = spread(request.key);
    for (;;) {
      uint32_t oldest = kNoSlot;
      uint32_t stamp = now;
      for (uint32_t choice = 0; choice < 2; ++choice) {
        const uint32_t first = first_slot(spread_key, choice);
        for (uint32_t way = 0; way < kWays; ++way) {
          const uint32_t seen = load_relaxed(stamps + first + way);
          if (seen >= stamp) continue;
          stamp = seen;
          oldest = first + way;
        }
      }
      if (oldest == kNoSlot) return kNoSlot;
      if (compare_and_swap(stamps + oldest, stamp, now) != stamp) continue;
      keys[oldest] = request.key;
      return oldest;
    }
  }

  /// Whether a slot has room for the picture's groups. Groups of a paged level may be larger than the levels from which
  /// the slot's size was found; they are decoded where they are sampled.
  SCREE_HD bool holds(const format::JpegPicture& picture) const {
    return format::jpeg_group_bytes(picture) <= slot_bytes;
  }

  /// The slots of a cache of `bytes` of samples: at least one, and whole sets if there are several.
  static uint32_t slots_for(uint64_t bytes, uint32_t slot_bytes) {
    const uint64_t slots = bytes / slot_bytes;
    constexpr uint64_t kMost = uint64_t{1} << 30;
    if (slots < kWays) return slots == 0 ? 1 : static_cast<uint32_t>(slots);
    return static_cast<uint32_t>((slots < kMost ? slots : kMost) / kWays * kWays);
  }
  static uint32_t sets_for(uint32_t slots) { return slots < kWays ? 1 : slots / kWays; }
  /// Entries of the table `wanted`: twice the largest number of requests.
  static uint32_t wanted_for(uint32_t slots) { return 2 * slots < 4 * kProbes ? 4 * kProbes : 2 * slots; }
};

/// Texels of JPEG levels from the cache only, and of paged levels from the pages that are there.
struct CachedTexels {
  static constexpr bool kMayMiss = true;
  struct Lane {
    bool missed = false;  // a group or a page was absent, for the current pixel
  };

  TextureCache cache;
  RoundCounters* counters;
  uint32_t now;
  TexelPages pages;

  /// Returns whether the texels' pages are present.
  SCREE_HD bool fetch(Lane& lane, const TextureView& texture, uint32_t level, const TexelPair& column,
                      const TexelPair& row, uint32_t texels[4]) const {
    if (level >= texture.jpeg_level_count) return stored_texels<true>(pages, texture, level, column, row, texels);
    const JpegLevel& jpeg = texture.jpeg[level];
    const format::JpegPicture* const picture = want_jpeg(pages, jpeg);
    if (picture == nullptr) return absent_texels(texels);
    const uint8_t* samples = nullptr;
    uint32_t group = 0;
    for (uint32_t i = 0; i < 4; ++i) {
      const format::JpegPlace place =
          format::jpeg_place(*picture, i % 2 == 0 ? column.first : column.second, i < 2 ? row.first : row.second);
      if (i == 0 || place.group != group) {
        group = place.group;
        const uint64_t key = TextureCache::key_of(jpeg.number, group);
        samples = cache.lookup(key, now);
        if (samples == nullptr) {
          lane.missed = true;
          if (cache.holds(*picture)) cache.request_group(key, counters);
        }
      }
      texels[i] = samples != nullptr ? format::jpeg_colour(*picture, place, samples) : 0;
    }
    return true;
  }
};

/// Texels of JPEG levels from the cache, where an absent group is decoded immediately: slow, but always correct. Only
/// texels of pages may be missing.
struct FallbackTexels {
  static constexpr bool kMayMiss = true;
  struct Lane {
    bool missed = false;  // a page was absent, for the current pixel
  };

  TextureCache cache;
  uint32_t now;
  TexelPages pages;

  /// A call, so that the decoder is compiled once and not in every kernel.
  /// Returns whether the texels' pages are present.
  [[gnu::noinline]] SCREE_HD bool fetch(Lane&, const TextureView& texture, uint32_t level, const TexelPair& column,
                                        const TexelPair& row, uint32_t texels[4]) const {
    if (level >= texture.jpeg_level_count) return stored_texels<true>(pages, texture, level, column, row, texels);
    const JpegLevel& jpeg = texture.jpeg[level];
    const format::JpegPicture* const picture = want_jpeg(pages, jpeg);
    if (picture == nullptr) return absent_texels(texels);
    format::JpegPlace places[4];
    for (uint32_t i = 0; i < 4; ++i)
      places[i] =
          format::jpeg_place(*picture, i % 2 == 0 ? column.first : column.second, i < 2 ? row.first : row.second);
    uint32_t left = 15;
    while (left != 0) {
      const uint32_t group = places[lowest_bit(left)].group;
      uint32_t mine = 0;
      for (uint32_t i = 0; i < 4; ++i)
        if (places[i].group == group) mine |= 1u << i;
      const uint8_t* samples = cache.lookup(TextureCache::key_of(jpeg.number, group), now);
      if (samples == nullptr) {
        format::decode_jpeg_colours(*picture, places, mine, texels);
      } else {
        for (uint32_t i = 0; i < 4; ++i)
          if ((mine >> i & 1u) != 0) texels[i] = format::jpeg_colour(*picture, places[i], samples);
      }
      left &= ~mine;
    }
    return true;
  }
};

/// Decodes the groups that a round requested, one request per item.
struct DecodeGroups {
  TextureCache cache;
  RoundCounters* counters;
  uint32_t now;  // the current round
  TexelPages pages{};

  SCREE_HD uint32_t count() const { return min_of(counters->requests, cache.slot_count); }

  SCREE_HD void operator()(uint32_t item) const {
    const GroupRequest& request = cache.requests[item];
    const uint32_t slot = cache.allocate_slot(request, now);
    if (slot == TextureCache::kNoSlot) return;
    fetch_increment(&counters->decoded);
    const JpegLevel& level = cache.levels[request.key >> 32];
    // The page of a group that was requested is present.
    format::decode_jpeg_group(*want_jpeg(pages, level), static_cast<uint32_t>(request.key),
                              cache.samples + uint64_t{slot} * cache.slot_bytes);
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
