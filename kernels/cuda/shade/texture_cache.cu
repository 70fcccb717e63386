// CudaTextureCache: rounds of shading and decoding. They are queued without reading the counters of earlier rounds;
// only rounds that wait for pages read them.
#include <cuda_runtime.h>

#include <algorithm>
#include <new>
#include <span>
#include <string>
#include <utility>

#include "kernels/cuda/common/check.h"
#include "kernels/cuda/shade/pixels.cuh"
#include "kernels/cuda/shade/texture_cache.h"
#include "kernels/shade/resolve_rounds.h"
#include "kernels/shade/stored_colors.h"
#include "kernels/shade/texel_pager.h"

namespace scree::kernels {
namespace {

constexpr uint32_t kRoundThreads = 256;
constexpr uint32_t kResidentBlocks =
    4;                                  // per multiprocessor: 64 registers per thread, which spills more but waits less
constexpr uint32_t kListedColumns = 8;  // of tiles, per block
constexpr uint32_t kListedRows = 4;
constexpr uint32_t kListedTiles = kListedColumns * kListedRows;  // a warp each; the first warp lists them, a lane each
constexpr uint32_t kListThreads = 32 * kListedTiles;
constexpr uint32_t kDecodeThreads = 64;
constexpr uint32_t kDecodeBlocks = 16;           // per multiprocessor
constexpr uint32_t kWarpGroups = 8;              // fewer than lanes, so that few groups fill more of the GPU
constexpr uint32_t kRounds = kDecodeRounds + 1;  // the last one's pixels decode groups by themselves
constexpr uint32_t kCounters = kRounds + 1;      // the last of them count the tiles of list_tiles()

/// Whether the rounds of pictures with one sample per pixel have a build of their own: lit pictures in perspective,
/// because each build takes 10 s to compile.
template <class Shader>
inline constexpr bool kKnowsSide = false;
template <>
inline constexpr bool kKnowsSide<Shader<false, Show::kSurface, ChunkKinds::kMixed, CachedTexels>> = true;

/// `before`: the counters of the round that left the tiles, or null to shade all `tile_count` tiles.
template <class Pixels>
__global__ void __launch_bounds__(kRoundThreads, kResidentBlocks)
    shade_round(const __grid_constant__ ShadeRound<Pixels> pass, uint32_t tile_count, const RoundCounters* before) {
  const uint32_t count = before != nullptr ? before->tiles : tile_count;
  const uint32_t warps = gridDim.x * (kRoundThreads / 32);
  for (uint32_t item = (blockIdx.x * kRoundThreads + threadIdx.x) / 32; item < count; item += warps)
    pass(item, PixelTeam{});
}

/// The place of a tile among the tiles that a block lists. Any four or eight tiles in turn form a compact part of the
/// picture, so that the warps of a block that shades them read the same texels.
__device__ uint2 listed_place(uint32_t i) {
  static_assert(kListedColumns == 8 && kListedRows == 4);
  return {(i & 1u) | (i >> 1 & 2u) | (i >> 2 & 4u), (i >> 1 & 1u) | (i >> 2 & 2u)};
}

/// Finishes the tiles of background, and lists the others. A block has a warp per tile.
__global__ void __launch_bounds__(kListThreads)
    list_tiles(const __grid_constant__ BackgroundTiles pass, UnfinishedTile* list, RoundCounters* listed) {
  __shared__ bool shows[kListedTiles];
  const uint32_t warp = threadIdx.x / 32;
  const uint32_t lane = PixelTeam::rank();
  const uint32_t across = pass.tiles.across();
  const auto tile_at = [](uint32_t i) {
    const uint2 place = listed_place(i);
    return uint2{blockIdx.x * kListedColumns + place.x, blockIdx.y * kListedRows + place.y};
  };
  const uint2 own = tile_at(warp);
  const bool is_covered = own.x < across && own.y < pass.tiles.down() && !pass.finish(own.x, own.y, PixelTeam{});
  if (lane == 0) shows[warp] = is_covered;
  __syncthreads();
  if (warp != 0) return;
  const bool is_listed = shows[lane];
  const uint32_t mask = PixelTeam::ballot(is_listed);
  const uint32_t first = lane == 0 && mask != 0 ? atomicAdd(&listed->tiles, count_bits(mask)) : 0;
  const uint32_t place = static_cast<uint32_t>(PixelTeam::share(first, 0)) + count_bits(mask & ((1u << lane) - 1));
  const uint2 tile = tile_at(lane);
  if (is_listed) list[place] = {tile.y * across + tile.x, ~uint32_t{0}};
}

__global__ void __launch_bounds__(kDecodeThreads) decode_round(const __grid_constant__ DecodeGroups pass) {
  __shared__ uint32_t staging[kDecodeThreads / 32][DecodeGroups::kStagingWords];
  const uint32_t warp = threadIdx.x / 32;
  const uint32_t step = gridDim.x * (kDecodeThreads / 32) * kWarpGroups;
  const uint32_t count = pass.count();
  for (uint32_t first = (blockIdx.x * (kDecodeThreads / 32) + warp) * kWarpGroups; first < count; first += step)
    pass(first, min_of(first + kWarpGroups, count), PixelTeam{}, staging[warp]);
}

__global__ void __launch_bounds__(kDecodeThreads)
    decode_level(const JpegLevel* level, uint32_t group_count, uint8_t* out, uint32_t slot_bytes) {
  const uint32_t group = blockIdx.x * kDecodeThreads + threadIdx.x;
  if (group < group_count) format::decode_jpeg_group(level->picture, group, out + uint64_t{group} * slot_bytes);
}

/// Layout of the cache's memory.
struct CacheLayout {
  uint64_t keys;
  uint64_t stamps;
  uint64_t colours;
  uint64_t requests;
  uint64_t counters;
  uint64_t bytes;
};

/// At most twice the slots that all groups need: a group has two sets of kWays, so hardly any is dropped then.
uint32_t slots_of(uint64_t bytes, const JpegGroups& groups) {
  if (groups.pixels == 0) return 0;
  const auto slot_bytes = static_cast<uint32_t>(sizeof(uint32_t) * groups.pixels);
  return TextureCache::slots_for(min_of(bytes, 2 * uint64_t{groups.count} * slot_bytes), slot_bytes);
}

CacheLayout lay_out(uint32_t slots, const JpegGroups& groups) {
  uint64_t at = 0;
  const auto add = [&at](uint64_t count, uint64_t size) {
    const uint64_t place = at;
    at = (at + count * size + 255) & ~uint64_t{255};
    return place;
  };
  const uint64_t ways = uint64_t{TextureCache::kWays} * TextureCache::sets_for(slots);
  CacheLayout layout{};
  add(groups.count, 1);  // TextureCache::places
  layout.keys = add(ways, sizeof(uint64_t));
  layout.stamps = add(ways, sizeof(uint32_t));
  layout.colours = add(slots, sizeof(uint32_t) * groups.pixels);
  layout.requests = add(slots, sizeof(GroupRequest));
  layout.counters = add(kCounters, sizeof(RoundCounters));
  layout.bytes = at;
  return layout;
}

}  // namespace

struct CudaTextureCache::Impl {
  /// `before`: as for shade_round(). `is_first`: of the first round, which may shade all tiles.
  template <class Pixels>
  Result<void> run(const ShadeRound<Pixels>& round, uint32_t tiles, const RoundCounters* before, bool is_first,
                   cudaStream_t stream) const {
    constexpr uint32_t kTilesPerBlock = kRoundThreads / 32;
    const uint32_t all = (tiles + kTilesPerBlock - 1) / kTilesPerBlock;
    const uint32_t blocks = is_first ? all : std::min(all, multiprocessors * kResidentBlocks);
    shade_round<Pixels><<<blocks, kRoundThreads, 0, stream>>>(round, tiles, before);
    return cuda_check(cudaGetLastError(), "starting a round of shading");
  }

  /// Makes room for two lists of the tiles of a picture.
  Result<void> reserve(uint32_t tiles) {
    list_room = tiles;
    return lists.reserve(uint64_t{2} * tiles * sizeof(UnfinishedTile), "allocating the lists of tiles");
  }

  Result<void> clear(cudaStream_t stream) {
    const auto fill = [stream](void* at, int value, uint64_t bytes) {
      return cuda_check(cudaMemsetAsync(at, value, bytes, stream), "clearing the texture cache");
    };
    const uint64_t ways = uint64_t{TextureCache::kWays} * cache.set_count;
    static_assert(TextureCache::kAbsent == 0 && TextureCache::kNoKey == ~uint64_t{0} &&
                  TextureCache::kNever == ~uint32_t{0});
    now = 1;
    is_clean = false;
    SCREE_TRY(fill(cache.places, 0, group_count));
    SCREE_TRY(fill(cache.keys, 0xff, ways * sizeof(uint64_t)));
    SCREE_TRY(fill(cache.stamps, 0xff, ways * sizeof(uint32_t)));
    SCREE_TRY(fill(cache.stamps, 0, cache.slot_count * sizeof(uint32_t)));
    SCREE_TRY(fill(counters, 0, kCounters * sizeof(RoundCounters)));
    is_clean = true;
    return {};
  }

  /// `pixels_of(shader)`: returns the Resolve or the ShadePart that finishes the pixels of `tiles`. `background`: of
  /// these tiles; null to shade all. `kApart`: as for visit_kinds().
  template <bool kApart, class PixelsOf>
  Result<void> shade(const ShadeInputs& in, const PixelTiles& tiles, const BackgroundTiles* background,
                     const PixelsOf& pixels_of, cudaStream_t stream);

  /// Queues shading of `count` tiles: list(1), or if `all` is set every tile, with `background` as for shade(). Where
  /// pages may be missing, list(0) then has the tiles with pixels that lacked some, and the counters of last_round()
  /// their number.
  template <bool kApart, class PixelsOf>
  Result<void> shade_tiles(const ShadeInputs& in, const BackgroundTiles* background, const PixelsOf& pixels_of,
                           uint32_t count, bool all, cudaStream_t stream);

  UnfinishedTile* list(uint32_t i) { return reinterpret_cast<UnfinishedTile*>(lists.data()) + i * list_room; }
  bool has_jpegs() const { return cache.slot_count != 0; }
  /// The round whose pixels lack only pages.
  uint32_t last_round() const { return has_jpegs() ? kDecodeRounds : 0; }
  TexelPages pages() const { return pager != nullptr ? pager->pages() : TexelPages{}; }

  DeviceBuffer memory;
  DeviceBuffer lists;
  uint64_t list_room = 0;    // tiles in one
  TextureCache cache{};      // without slots where there are no JPEG levels
  uint64_t group_count = 0;  // JpegGroups::count
  TexelPager* pager = nullptr;
  RoundCounters* counters = nullptr;  // one per round
  uint32_t multiprocessors = 0;
  uint32_t now = 1;       // first round of the next picture
  bool is_clean = false;  // false: an error left work half queued
};

template <bool kApart, class PixelsOf>
Result<void> CudaTextureCache::Impl::shade(const ShadeInputs& in, const PixelTiles& tiles,
                                           const BackgroundTiles* background, const PixelsOf& pixels_of,
                                           cudaStream_t stream) {
  const uint32_t tile_count = tiles.count();
  SCREE_TRY(reserve(tile_count));
  if (pager == nullptr) return shade_tiles<kApart>(in, background, pixels_of, tile_count, true, stream);
  const auto shade_some = [&](std::span<const UnfinishedTile> some, UnfinishedTile* left) -> Result<uint32_t> {
    constexpr const char* kWhat = "copying a list of tiles";
    const uint32_t count = some.empty() ? tile_count : static_cast<uint32_t>(some.size());
    RoundCounters last{};
    if (!some.empty())
      SCREE_TRY(
          cuda_check(cudaMemcpyAsync(list(1), some.data(), some.size_bytes(), cudaMemcpyHostToDevice, stream), kWhat));
    SCREE_TRY(shade_tiles<kApart>(in, background, pixels_of, count, some.empty(), stream));
    SCREE_TRY(cuda_check(cudaMemcpyAsync(&last, counters + last_round(), sizeof last, cudaMemcpyDeviceToHost, stream),
                         kWhat));
    SCREE_TRY(cuda_check(cudaStreamSynchronize(stream), "shading"));
    if (last.tiles != 0)
      SCREE_TRY(cuda_check(cudaMemcpy(left, list(0), last.tiles * sizeof *left, cudaMemcpyDeviceToHost), kWhat));
    return last.tiles;
  };
  try {
    return shade_in_rounds(*pager, tile_count, shade_some);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "no memory left for the tiles of a picture"};
  }
}

template <bool kApart, class PixelsOf>
Result<void> CudaTextureCache::Impl::shade_tiles(const ShadeInputs& in, const BackgroundTiles* background,
                                                 const PixelsOf& pixels_of, uint32_t count, bool all,
                                                 cudaStream_t stream) {
  if (!is_clean || now > TextureCache::kNever - kRounds) SCREE_TRY(clear(stream));
  is_clean = false;
  SCREE_TRY(cuda_check(cudaMemsetAsync(counters, 0, kCounters * sizeof(RoundCounters), stream),
                       "clearing the rounds' counters"));
  const UnfinishedTile* from = all ? nullptr : list(1);
  const RoundCounters* before = nullptr;
  Result<void> started;
  if (all && background != nullptr) {
    const PixelTiles& tiles = background->tiles;
    const dim3 blocks((tiles.across() + kListedColumns - 1) / kListedColumns,
                      (tiles.down() + kListedRows - 1) / kListedRows);
    list_tiles<<<blocks, kListThreads, 0, stream>>>(*background, list(1), counters + kRounds);
    SCREE_TRY(cuda_check(cudaGetLastError(), "listing the tiles of a picture"));
    from = list(1);
    before = counters + kRounds;
  }
  for (uint32_t round = 0; round < (has_jpegs() ? kDecodeRounds : 1); ++round, ++now) {
    visit_textured<kApart>(in, CachedTexels{cache, counters + round, now, pages()}, [&](const auto& shader) {
      const ShadeRound<decltype(pixels_of(shader))> pass{pixels_of(shader), from, list(round % 2), counters + round};
      started = run(pass, count, before, round == 0, stream);
    });
    from = list(round % 2);
    before = counters + round;
    if (!started) return started;
    if (!has_jpegs()) continue;
    // The last of these rounds decodes too, for the pixels that are left and for the next picture.
    decode_round<<<multiprocessors * kDecodeBlocks, kDecodeThreads, 0, stream>>>(
        DecodeGroups{cache, counters + round, now, pages()});
    SCREE_TRY(cuda_check(cudaGetLastError(), "starting a round of decoding"));
  }
  if (has_jpegs())
    visit_textured<false>(in, FallbackTexels{cache, now - 1, pages()}, [&](const auto& shader) {
      static_assert(kDecodeRounds % 2 == 0, "the last of them leaves list(1)");
      const ShadeRound<decltype(pixels_of(shader))> pass{pixels_of(shader), from, list(0), counters + kDecodeRounds};
      started = run(pass, count, before, false, stream);
    });
  is_clean = static_cast<bool>(started);
  return started;
}

CudaTextureCache::CudaTextureCache() : impl_(std::make_unique<Impl>()) {}
CudaTextureCache::CudaTextureCache(CudaTextureCache&&) noexcept = default;
CudaTextureCache& CudaTextureCache::operator=(CudaTextureCache&&) noexcept = default;
CudaTextureCache::~CudaTextureCache() = default;

uint64_t CudaTextureCache::device_bytes(uint64_t bytes, const JpegGroups& groups) {
  return lay_out(slots_of(bytes, groups), groups).bytes;
}

Result<CudaTextureCache> CudaTextureCache::create(const JpegLevel* levels, uint64_t bytes, const JpegGroups& groups,
                                                  TexelPager* pager) {
  CudaTextureCache made;
  Impl& impl = *made.impl_;
  impl.pager = pager;
  const uint32_t slots = slots_of(bytes, groups);
  const CacheLayout layout = lay_out(slots, groups);
  impl.memory = SCREE_TRY(DeviceBuffer::allocate(layout.bytes, "allocating the texture cache"));
  std::byte* const base = impl.memory.data();
  impl.group_count = groups.count;
  impl.cache = {reinterpret_cast<uint8_t*>(base),
                reinterpret_cast<uint64_t*>(base + layout.keys),
                reinterpret_cast<uint32_t*>(base + layout.stamps),
                reinterpret_cast<uint32_t*>(base + layout.colours),
                reinterpret_cast<GroupRequest*>(base + layout.requests),
                levels,
                TextureCache::sets_for(slots),
                slots,
                groups.pixels};
  impl.counters = reinterpret_cast<RoundCounters*>(base + layout.counters);
  int device = 0;
  int count = 0;
  SCREE_TRY(cuda_check(cudaGetDevice(&device), "asking for the device"));
  SCREE_TRY(
      cuda_check(cudaDeviceGetAttribute(&count, cudaDevAttrMultiProcessorCount, device), "asking for multiprocessors"));
  impl.multiprocessors = static_cast<uint32_t>(count);
  SCREE_TRY(impl.clear(nullptr));
  SCREE_TRY(cuda_check(cudaStreamSynchronize(nullptr), "clearing the texture cache"));
  return Result<CudaTextureCache>(std::move(made));
}

uint64_t CudaTextureCache::slots() const {
  return impl_->cache.slot_count;
}

uint64_t CudaTextureCache::bytes() const {
  return slots() * sizeof(uint32_t) * impl_->cache.slot_pixels;
}

Result<void> CudaTextureCache::resolve(const ShadeInputs& in, const PixelTiles& tiles, const uint64_t* samples,
                                       uint32_t samples_per_side, const float* visibility, uint32_t* pixels,
                                       cudaStream_t stream) {
  auto* const out = reinterpret_cast<uint8_t*>(pixels);
  ShadeInputs host = in;
  host.srgb = &srgb_tables();
  const BackgroundTiles background{tiles, samples, samples_per_side, background_code(host, samples_per_side), out};
  const auto shade = [&]<uint32_t kSide>() {
    const auto pixels_of = [&]<class Shader>(const Shader& shader) {
      constexpr uint32_t kBuilt = kKnowsSide<Shader> ? kSide : 0;
      return Resolve<Shader, kBuilt>{shader, tiles, samples, samples_per_side, visibility, 4, out};
    };
    return impl_->shade<true>(in, tiles, &background, pixels_of, stream);
  };
  return samples_per_side == 1 ? shade.operator()<1>() : shade.operator()<0>();
}

void CudaTextureCache::load(const ShadeInputs& in, uint32_t samples_per_side) {
  const auto load_round = [&]<class Shader>(const Shader&) {
    constexpr uint32_t kBuilt = kKnowsSide<Shader> ? 1 : 0;
    samples_per_side == 1 ? load_kernel(shade_round<Resolve<Shader, kBuilt>>)
                          : load_kernel(shade_round<Resolve<Shader>>);
  };
  load_kernel(list_tiles);
  visit_textured<true>(in, CachedTexels{}, load_round);
  load_kernel(decode_round);
  visit_textured<false>(in, FallbackTexels{}, load_round);
}

Result<void> CudaTextureCache::shade_part(const ShadeInputs& in, const PixelTiles& tiles, const uint64_t* samples,
                                          float* colors, cudaStream_t stream) {
  const auto pixels_of = [&]<class Shader>(const Shader& shader) {
    return ShadePart<Shader>{shader, tiles, samples, colors};
  };
  // One kernel for all kinds of chunks: one per kind would add 10 s of compile time and 0.7 MB.
  return impl_->shade<false>(in, tiles, nullptr, pixels_of, stream);
}

Result<TextureCacheCounts> CudaTextureCache::counts() const {
  RoundCounters rounds[kDecodeRounds];
  SCREE_TRY(cuda_check(cudaMemcpy(rounds, impl_->counters, sizeof rounds, cudaMemcpyDeviceToHost),
                       "reading the rounds' counters"));
  TextureCacheCounts counts;
  for (const RoundCounters& round : rounds) {
    counts.asked += round.requests;
    counts.decoded += round.decoded;
    counts.rounds += round.tiles != 0 ? 1 : 0;
  }
  counts.tiles = rounds[kDecodeRounds - 1].tiles;
  return counts;
}

Result<void> CudaTextureCache::clear(cudaStream_t stream) {
  return impl_->clear(stream);
}

Result<void> CudaTextureCache::decode(const JpegLevel* level, uint32_t group_count, uint8_t* out, uint32_t slot_bytes,
                                      cudaStream_t stream) {
  if (group_count == 0) return {};
  decode_level<<<(group_count - 1) / kDecodeThreads + 1, kDecodeThreads, 0, stream>>>(level, group_count, out,
                                                                                      slot_bytes);
  return cuda_check(cudaGetLastError(), "starting to decode a level");
}

}  // namespace scree::kernels
