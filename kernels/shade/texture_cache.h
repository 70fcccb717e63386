// The GPU's cache of decoded groups of indexed JPEGs (format/jpeg/pixels.h), for threads that must not wait for each
// other. The CPU has jpeg_group_cache.h instead. This code runs on a CPU too, for tests.
//
// A picture is shaded in rounds. During shading the cache's keys and colours do not change: a pixel that lacks a group
// requests it and is left for the next round. Between two rounds every requested group replaces one that this round did
// not use, and is decoded. After a few rounds the remaining pixels, for which the cache is too small, decode the groups
// themselves. So the picture does not depend on the cache's size.
#pragma once

#include <cstdint>

#include "kernels/shade/shared_words.h"
#include "kernels/shade/texture.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// A group that pixels lack.
struct GroupRequest {
  uint64_t key;    // JpegLevel::first_group + group
  uint32_t level;  // its number
  uint32_t group;
};

/// The counts of one round.
struct RoundCounters {
  uint32_t requests;  // requested groups; may exceed the capacity
  uint32_t decoded;   // of these, groups that found a slot
  uint32_t tiles;     // tiles with pixels that are left for the next round
  uint32_t zero;
};

/// A view of the cache: slots in sets of kWays; a group may lie in either of two sets. A group's key is its number
/// among all groups of the scene. A byte per key gives the group's slot: 0.03 bits per pixel. Owns nothing.
struct TextureCache {
  static constexpr uint32_t kWays = 8;
  static constexpr uint64_t kNoKey = ~uint64_t{0};
  static constexpr uint32_t kNoSlot = ~uint32_t{0};
  static constexpr uint8_t kAbsent = 0;
  static constexpr uint8_t kRequested = 255;        // absent, and requested in this round
  static constexpr uint32_t kNever = ~uint32_t{0};  // the stamp of a way without a group

  uint8_t* places;          // by key: 1 + way in the first set, 1 + kWays + way in the second, or a constant above
  uint64_t* keys;           // by slot; kWays per set
  uint32_t* stamps;         // the last round that used the slot
  uint32_t* colours;        // slot_pixels per slot, by format::jpeg_pixel()
  GroupRequest* requests;   // one per slot
  const JpegLevel* levels;  // by number
  uint32_t set_count;
  uint32_t slot_count;
  uint32_t slot_pixels;  // JpegGroups::pixels

  /// The first slot of a key's first or second set.
  SCREE_HD uint32_t first_slot(uint64_t key, uint32_t choice) const {
    // Consecutive keys are spread evenly. Keys of one scene seldom differ by 2^32.
    const uint32_t bits = static_cast<uint32_t>(key) * (choice == 0 ? 0x9e3779b1u : 0x85ebca77u);
    return kWays * static_cast<uint32_t>(uint64_t{bits} * set_count >> 32);
  }

  /// The group's slot; kNoSlot if the group is absent. Slots do not change during shading. Has no branch, so that a GPU
  /// waits for several look-ups at once.
  SCREE_HD uint32_t find_slot(uint64_t key) const {
    const uint32_t way = uint32_t{load_cached(places + key)} - 1;
    const uint32_t slot = first_slot(key, way / kWays) + way % kWays;
    return way < 2 * kWays ? slot : kNoSlot;
  }
  /// Marks a slot as used in round `now`.
  SCREE_HD void mark(uint32_t slot, uint32_t now) const {
    if (load_cached(stamps + slot) != now) store_relaxed(stamps + slot, now);
  }
  SCREE_HD uint32_t* colours_of(uint32_t slot) const { return colours + slot * slot_pixels; }  // below 2^32
  SCREE_HD uint32_t colour(uint32_t slot, uint32_t pixel) const { return colours[slot * slot_pixels + pixel]; }

  /// Requests an absent group, once for all pixels that lack it. Drops the request if there is no room.
  SCREE_HD void request_group(const GroupRequest& request, RoundCounters* counters) const {
    if (load_relaxed(&counters->requests) > slot_count)
      return;  // otherwise the misses of a small cache would wrap the counter
    uint8_t* const place = places + request.key;
    if (load_relaxed(place) != kAbsent || fetch_or(place, kRequested) != kAbsent) return;
    const uint32_t index = fetch_increment(&counters->requests);
    if (index < slot_count) {
      requests[index] = request;
    } else {
      store_relaxed(place, kAbsent);
    }
  }

  /// Gives a request of round `now` the least recently used slot that this round did not use; kNoSlot if there is none.
  /// Several threads may allocate at once. A slot lost to another thread keeps the stamp `now`, so a thread tries at
  /// most once per way.
  SCREE_HD uint32_t allocate_slot(const GroupRequest& request, uint32_t now) const {
    store_relaxed(places + request.key, kAbsent);
    for (;;) {
      uint32_t oldest = kNoSlot;
      uint32_t stamp = now;
      uint32_t place = 0;
      for (uint32_t choice = 0; choice < 2; ++choice) {
        const uint32_t first = first_slot(request.key, choice);
        for (uint32_t way = 0; way < kWays; ++way) {
          const uint32_t seen = load_relaxed(stamps + first + way);
          if (seen >= stamp) continue;
          stamp = seen;
          oldest = first + way;
          place = 1 + choice * kWays + way;
        }
      }
      if (oldest == kNoSlot) return kNoSlot;
      if (compare_and_swap(stamps + oldest, stamp, now) != stamp) continue;
      if (keys[oldest] != kNoKey) store_relaxed(places + keys[oldest], kAbsent);
      keys[oldest] = request.key;
      store_relaxed(places + request.key, static_cast<uint8_t>(place));
      return oldest;
    }
  }

  /// Whether the cache has room for the groups of a level with this picture. The groups of a paged level are counted
  /// before it is read, as if it were coded like the last stored level. If it has larger groups or more of them, each
  /// pixel decodes its groups itself.
  SCREE_HD bool holds(const JpegLevel& level, const format::JpegPicture& picture) const {
    return format::jpeg_group_pixels(picture) <= slot_pixels &&
           picture.view.mcu_count <= level.group_count * picture.view.group_mcus;
  }

  /// The slots of a cache of `bytes` of colours: at least one, and whole sets if there are several. At most 16 GiB, so
  /// that colours have numbers of 32 bits.
  static uint32_t slots_for(uint64_t bytes, uint32_t slot_bytes) {
    constexpr uint64_t kMostBytes = uint64_t{1} << 34;
    constexpr uint64_t kMost = uint64_t{1} << 30;
    const uint64_t slots = min_of(min_of(bytes, kMostBytes) / slot_bytes, kMost);
    if (slots < kWays) return slots == 0 ? 1 : static_cast<uint32_t>(slots);
    return static_cast<uint32_t>(slots / kWays * kWays);
  }
  static uint32_t sets_for(uint32_t slots) { return slots < kWays ? 1 : slots / kWays; }
};

/// Texels of JPEG levels from the cache only, and of paged levels from the pages that are there.
struct CachedTexels {
  static constexpr bool kMayMiss = true;
  static constexpr uint32_t kNoGroup = ~uint32_t{0};  // in the first place: the cache cannot hold the level's groups
  // TexelPlaces::same
  static constexpr uint32_t kSecondInFirst = 1;  // texel 1 lies in the group of texel 0, otherwise in that of texel 3
  static constexpr uint32_t kThirdInFirst = 2;   // texel 2 likewise
  static constexpr uint32_t kManyGroups = 4;     // or in a third group
  struct Lane {
    bool missed = false;  // a group or a page was absent, for the current pixel
  };

  TextureCache cache;
  RoundCounters* counters;
  uint32_t now;
  TexelPages pages;

  /// Sets the places of the texels of two columns and two rows. Returns whether their pages are present.
  SCREE_HD bool place(Lane& lane, const TextureView& texture, uint32_t level, const TexelPair& column,
                      const TexelPair& row, TexelPlaces& out) const {
    // Here and in fetch() the branches that few pixels of JPEGs take are marked. nvcc then moves registers to memory in
    // these branches, and not before them.
    if (level >= texture.jpeg_level_count) [[unlikely]]
      return place_stored<true>(pages, texture, level, column, row, out);
    const JpegLevel& jpeg = texture.jpeg[level];
    const format::JpegPicture* const there = want_jpeg(pages, jpeg);
    if (there == nullptr) [[unlikely]]
      return false;
    const format::JpegPicture& picture = *there;
    const format::JpegLine columns[2] = {jpeg_column(picture, column.first), jpeg_column(picture, column.second)};
    const format::JpegLine rows[2] = {jpeg_row(picture, row.first), jpeg_row(picture, row.second)};
    for (uint32_t i = 0; i < 4; ++i) {
      const format::JpegPlace place = jpeg_place(picture, columns[i % 2], rows[i / 2]);
      out.group[i] = place.group;
      out.pixel[i] = jpeg_pixel(picture, place);
    }
    const uint32_t* const group = out.group;
    out.same =
        (group[1] == group[0] ? kSecondInFirst : 0u) | (group[2] == group[0] ? kThirdInFirst : 0u) |
        ((group[1] != group[0] && group[1] != group[3]) || (group[2] != group[0] && group[2] != group[3]) ? kManyGroups
                                                                                                          : 0u);
    if (!cache.holds(jpeg, picture)) [[unlikely]] {
      lane.missed = true;  // its pixels decode it themselves
      out.group[0] = kNoGroup;
    }
    return true;
  }

  SCREE_HD void fetch(Lane& lane, const TextureView& texture, uint32_t level, const TexelPlaces& at,
                      uint32_t texels[4]) const {
    if (level >= texture.jpeg_level_count) [[unlikely]]
      return stored_texels<true>(pages, texture, level, at, texels);
    if (at.group[0] == kNoGroup) [[unlikely]] {
      for (uint32_t i = 0; i < 4; ++i) texels[i] = kAbsentTexel;
      return;
    }
    const uint64_t first_group = texture.level_offset[level];
    // The texels lie in one group, in two at a border, or in up to four at a corner. Two look-ups by all lanes are
    // faster than four. They are also faster than a loop over the groups, in which lanes diverge.
    const auto find = [&](uint32_t i) { return cache.find_slot(first_group + at.group[i]); };
    uint32_t slot[4];
    slot[0] = find(0);
    slot[3] = find(3);
    slot[1] = (at.same & kSecondInFirst) != 0 ? slot[0] : slot[3];
    slot[2] = (at.same & kThirdInFirst) != 0 ? slot[0] : slot[3];
    const bool has_more = (at.same & kManyGroups) != 0;
    if (has_more) [[unlikely]]
      for (uint32_t i = 1; i < 3; ++i)
        if (at.group[i] != at.group[0] && at.group[i] != at.group[3]) slot[i] = find(i);
    static_assert(TextureCache::kNoSlot == ~uint32_t{0});  // the only one with the highest bit
    if (static_cast<int32_t>(slot[0] | slot[1] | slot[2] | slot[3]) >= 0) [[likely]] {
      for (uint32_t i = 0; i < 4; ++i) texels[i] = cache.colour(slot[i], at.pixel[i]);
      // While the colours are being loaded:
      cache.mark(slot[0], now);
      cache.mark(slot[3], now);
      if (!has_more) [[likely]]
        return;
    }
    for (uint32_t i = 0; i < 4; ++i) {
      if (slot[i] != TextureCache::kNoSlot) {
        cache.mark(slot[i], now);
        continue;
      }
      lane.missed = true;
      cache.request_group({first_group + at.group[i], texture.jpeg[level].number, at.group[i]}, counters);
    }
    if (lane.missed)
      for (uint32_t i = 0; i < 4; ++i) texels[i] = kAbsentTexel;  // any colour, because the pixel has to wait
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

  /// Sets the places of the texels of two columns and two rows. Returns whether their pages are present.
  SCREE_HD bool place(Lane&, const TextureView& texture, uint32_t level, const TexelPair& column, const TexelPair& row,
                      TexelPlaces& out) const {
    if (level >= texture.jpeg_level_count) return place_stored<true>(pages, texture, level, column, row, out);
    keep_pairs(column, row, out);
    return want_jpeg(pages, texture.jpeg[level]) != nullptr;
  }

  /// A call, so that the decoder is compiled once and not in every kernel.
  [[gnu::noinline]] SCREE_HD void fetch(Lane&, const TextureView& texture, uint32_t level, const TexelPlaces& at,
                                        uint32_t texels[4]) const {
    if (level >= texture.jpeg_level_count) return stored_texels<true>(pages, texture, level, at, texels);
    const JpegLevel& jpeg = texture.jpeg[level];
    const format::JpegPicture* const picture = present_jpeg(pages, jpeg);
    const bool is_held = cache.holds(jpeg, *picture);
    format::JpegPlace places[4];
    for (uint32_t i = 0; i < 4; ++i) places[i] = format::jpeg_place(*picture, at.group[i % 2], at.group[2 + i / 2]);
    uint32_t left = 15;
    while (left != 0) {
      const uint32_t group = places[lowest_bit(left)].group;
      uint32_t mine = 0;
      for (uint32_t i = 0; i < 4; ++i)
        if (places[i].group == group) mine |= 1u << i;
      const uint32_t slot = is_held ? cache.find_slot(jpeg.first_group + group) : TextureCache::kNoSlot;
      if (slot == TextureCache::kNoSlot) {
        format::decode_jpeg_colours(*picture, places, mine, texels);
      } else {
        cache.mark(slot, now);
        for (uint32_t i = 0; i < 4; ++i)
          if ((mine >> i & 1u) != 0) texels[i] = cache.colour(slot, jpeg_pixel(*picture, places[i]));
      }
      left &= ~mine;
    }
  }
};

/// Decodes the groups that a round requested. A lane decodes a group to samples in the group's slot; then the whole
/// team turns the samples of one group after the other into colours.
struct DecodeGroups {
  static constexpr uint32_t kStagingWords = 16 * format::kJpegMaxGroupBlocks;  // a group's samples

  TextureCache cache;
  RoundCounters* counters;
  uint32_t now;  // the current round
  TexelPages pages{};

  SCREE_HD uint32_t count() const { return min_of(counters->requests, cache.slot_count); }

  /// Decodes the requests from `first` on and before `end`, at most team.size(). `staging`: kStagingWords words, which
  /// all lanes share.
  template <class Team>
  SCREE_HD void operator()(uint32_t first, uint32_t end, Team team, uint32_t* staging) const {
    const uint32_t item = first + team.rank();
    const uint32_t own = item < end ? decode(cache.requests[item]) : TextureCache::kNoSlot;
    team.synchronise();
    for (uint32_t i = first; i < end; ++i) {
      const uint32_t slot = static_cast<uint32_t>(team.share(own, i - first));
      if (slot != TextureCache::kNoSlot) colour(cache.requests[i], cache.colours_of(slot), team, staging);
    }
  }

 private:
  SCREE_HD const format::JpegPicture& picture_of(const GroupRequest& request) const {
    const JpegLevel& level = cache.levels[request.level];
    return *present_jpeg(pages, level);  // the page of a group that was requested is present
  }

  /// Returns the slot that holds the group's samples, or kNoSlot.
  SCREE_HD uint32_t decode(const GroupRequest& request) const {
    const uint32_t slot = cache.allocate_slot(request, now);
    if (slot == TextureCache::kNoSlot) return slot;
    fetch_increment(&counters->decoded);
    static_assert(format::kJpegMaxComponents <= sizeof(uint32_t));  // so a group's samples fit its colours' slot
    format::decode_jpeg_group(picture_of(request), request.group, reinterpret_cast<uint8_t*>(cache.colours_of(slot)));
    return slot;
  }

  /// Turns a group's samples into its colours, in place.
  template <class Team>
  SCREE_HD void colour(const GroupRequest& request, uint32_t* colours, Team team, uint32_t* staging) const {
    const format::JpegPicture& picture = picture_of(request);
    const uint32_t mcus = format::jpeg_group_mcus(picture, request.group);
    const uint32_t words = 16 * picture.mcu_blocks * mcus;
    for (uint32_t i = team.rank(); i < words; i += team.size()) staging[i] = colours[i];
    team.synchronise();
    const uint32_t runs = picture.mcu_width * picture.mcu_height * mcus / 8;
    for (uint32_t run = team.rank(); run < runs; run += team.size())
      format::jpeg_run_colours(picture, run, reinterpret_cast<const uint8_t*>(staging), colours + 8 * run);
    team.synchronise();
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
