// The passes of a CPU frame in their order. A CPU backend reads the queues' counters between passes. A GPU frame is one
// submission instead; cuda/frame/frame.cu has its order.
//
// A backend has
//   for_each(uint64_t count, const Pass&)     runs pass(item, team) for items 0 to count - 1, count <= 2^32
//   T* allocate<T>(uint64_t count)            memory for the passes; null if none is left
//   void release(T*)
//   Counters read_counters()                  returns queues.counters, between passes
//   void write_counters(const Counters&)
//   Counters* counters()                      returns their address, for the passes
#pragma once

#include <algorithm>

#include "kernels/cpu/raster_blocks.h"
#include "kernels/cull/cull.h"
#include "kernels/raster/large.h"
#include "kernels/raster/medium.h"

namespace scree::kernels {

/// First capacities of the queues, and the amounts that are drawn before their counters are read again.
struct QueueSizes {
  uint64_t blocks = 1u << 14;
  uint64_t medium = 1u << 15;
  uint64_t large = 1u << 13;
  uint64_t tiles = 1u << 17;
  uint64_t instances_at_a_time = 1u << 20;
  uint64_t blocks_at_a_time = 1u << 12;
  uint32_t block_triangles = 65536;  // per draw block
  // Culling of clustered chunks, and of whole indexed chunks on a lattice. It never changes the picture.
  bool cluster_bounds = true;           // removes chunks outside the picture or between pixel centres
  bool occlusion = true;                // removes chunks behind triangles already drawn; requires cluster_bounds
  uint64_t round_triangles = 1u << 20;  // in the first round; the pyramid is built after it
};

inline namespace SCREE_ISA {

/// Sets every sample of one row to the background.
struct Clear {
  Target target;

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    uint64_t* row = target.row(static_cast<int32_t>(item));
    for (uint32_t x = team.rank(); x < static_cast<uint32_t>(target.width); x += team.size()) row[x] = kBackground;
  }
};

/// Levels kPyramidFirstLevel to kBandLevels of the depth pyramid, of 2^kBandLevels rows of samples.
struct PyramidBand {
  static constexpr uint32_t kBandLevels = 6;

  DepthPyramid pyramid;
  const uint64_t* samples;

  template <class Team>
  void operator()(uint32_t item, Team) const {
    constexpr int32_t kSide = 1 << kPyramidFirstLevel;
    for (int32_t y = first_row(item, kPyramidFirstLevel); y < end_row(item, kPyramidFirstLevel); ++y) {
      const uint64_t* rows[kSide];  // the image's last row repeats where there are fewer
      for (int32_t i = 0; i < kSide; ++i) {
        const auto row = static_cast<uint64_t>(min_of(kSide * y + i, pyramid.height - 1));
        rows[i] = samples + row * static_cast<uint64_t>(pyramid.width);
      }
      fill_row(rows, pyramid.row(kPyramidFirstLevel, y));
    }
    for (uint32_t level = kPyramidFirstLevel + 1; level <= kBandLevels; ++level) {
      for (int32_t y = first_row(item, level); y < end_row(item, level); ++y) {
        for (int32_t x = 0; x < pyramid.across(level); ++x)
          pyramid.row(level, y)[x] = code_from_below(pyramid, level, x, y);
      }
    }
  }

 private:
  /// Works on runs of samples, so that the compiler vectorises the loop.
  void fill_row(const uint64_t* const rows[4], uint32_t* out) const {
    static_assert(kPyramidFirstLevel == 2);
    constexpr int32_t kRun = 256;
    uint32_t codes[kRun];
    for (int32_t start = 0; start < pyramid.width; start += kRun) {
      const int32_t count = min_of(kRun, pyramid.width - start);
      for (int32_t i = 0; i < count; ++i) {
        const uint32_t upper = max_of(sample_depth_code(rows[0][start + i]), sample_depth_code(rows[1][start + i]));
        const uint32_t lower = max_of(sample_depth_code(rows[2][start + i]), sample_depth_code(rows[3][start + i]));
        codes[i] = max_of(upper, lower);
      }
      for (int32_t i = count; i < kRun; ++i) codes[i] = 0;
      const int32_t squares = (count - 1) / 4 + 1;
      for (int32_t i = 0; i < squares; ++i) {
        const uint32_t* const four = codes + 4 * i;
        out[start / 4 + i] = max_of(max_of(four[0], four[1]), max_of(four[2], four[3]));
      }
    }
  }

  static int32_t first_row(uint32_t item, uint32_t level) {
    return static_cast<int32_t>(item << (kBandLevels - level));
  }
  int32_t end_row(uint32_t item, uint32_t level) const {
    return min_of(first_row(item + 1, level), pyramid.down(level));
  }
};

/// Draws into a picture that was cleared, or that already holds the triangles of other chunks (frame_parts.h). `draw()`
/// returns false if memory runs out.
template <class Backend, bool kOrthographic, bool kMasked>
class FrameDrawer {
 public:
  FrameDrawer(Backend& backend, const SceneView& scene, const FrameView& view, const Target& target,
              const QueueSizes& sizes)
      : backend_(backend), scene_(scene), view_(view), target_(target), sizes_(sizes) {
    queues_ = Queues{};
    queues_.counters = backend.counters();
    culling_.centers = center_range(view);
    culling_.bounds = sizes.cluster_bounds;
    culling_.occlusion = sizes.cluster_bounds && sizes.occlusion;
  }
  FrameDrawer(const FrameDrawer&) = delete;
  FrameDrawer& operator=(const FrameDrawer&) = delete;
  ~FrameDrawer() {
    backend_.release(queues_.blocks);
    backend_.release(queues_.medium);
    backend_.release(queues_.large);
    backend_.release(queues_.tiles);
    backend_.release(culling_.pyramid.codes);
  }

  bool draw(FrameStats& stats) {
    stats = FrameStats{};
    if (!grow(queues_.blocks, queues_.block_capacity, sizes_.blocks) ||
        !grow(queues_.medium, queues_.medium_capacity, sizes_.medium) ||
        !grow(queues_.large, queues_.large_capacity, sizes_.large)) {
      return false;
    }
    uint64_t share = max_of<uint64_t>(sizes_.instances_at_a_time, 1);
    for (uint64_t first = 0; first < scene_.instance_count;) {
      const uint64_t count = min_of(share, scene_.instance_count - first);
      backend_.write_counters(Counters{});
      backend_.for_each(count, Cull{scene_, view_, queues_, first, max_of(sizes_.block_triangles, 1u)});
      const Counters culled = backend_.read_counters();
      if (culled.blocks > queues_.block_capacity) {
        if (count > 1 && culled.blocks > kMostBlocks) {
          share = count / 2;
        } else if (!grow(queues_.blocks, queues_.block_capacity, culled.blocks)) {
          return false;
        }
        continue;
      }
      stats.instances_drawn += culled.instances_drawn;
      stats.draws += culled.draws;
      if (!draw_blocks(culled.blocks, stats)) return false;
      first += count;
    }
    return true;
  }

 private:
  static constexpr uint64_t kMostBlocks = 1u << 22;     // 128 MiB; above it, fewer instances at a time
  static constexpr uint64_t kMostTriangles = 1u << 21;  // 96 MiB per queue; above it, fewer blocks at a time

  static uint64_t tiles_of(int32_t side) { return (static_cast<uint64_t>(side) + kTileSide - 1) / kTileSide; }

  /// Does not keep the queues' contents.
  template <class T>
  bool grow(T*& items, uint64_t& capacity, uint64_t needed) {
    needed = max_of<uint64_t>(needed, 1);
    if (needed <= capacity) return true;
    backend_.release(items);
    capacity = 0;
    items = backend_.template allocate<T>(needed);
    if (items == nullptr) return false;
    capacity = needed;
    return true;
  }

  MaskSource<kMasked> masks() const {
    if constexpr (kMasked)
      return {scene_, nullptr};
    else
      return {};
  }

  /// Draws the blocks from near to far, in rounds. Each round has up to as many triangles as all rounds before it, so
  /// that it is culled against the triangles of all of them.
  bool draw_blocks(uint64_t total, FrameStats& stats) {
    if (culling_.occlusion) {
      std::sort(queues_.blocks, queues_.blocks + total,
                [](const DrawBlock& a, const DrawBlock& b) { return a.nearest < b.nearest; });
    }
    uint64_t share = max_of<uint64_t>(sizes_.blocks_at_a_time, 1);
    uint64_t end_of_round = culling_.occlusion ? 0 : total;
    for (uint64_t first = 0; first < total;) {
      if (first >= end_of_round) end_of_round = begin_round(first, total);
      const uint64_t count = min_of(share, end_of_round - first);
      backend_.write_counters(Counters{});
      ClusterCounts clusters{};
      backend_.for_each(
          count, RasterBlocks<kOrthographic, kMasked>{{scene_, view_, target_, queues_}, culling_, &clusters, first});
      const Counters drawn = backend_.read_counters();
      if (drawn.medium > queues_.medium_capacity || drawn.large > queues_.large_capacity) {
        if (count > 1 && max_of(drawn.medium, drawn.large) > kMostTriangles) {
          share = count / 2;
        } else if (!grow(queues_.medium, queues_.medium_capacity, drawn.medium) ||
                   !grow(queues_.large, queues_.large_capacity, drawn.large)) {
          return false;
        }
        continue;
      }
      if (drawn.medium != 0) {
        backend_.for_each(drawn.medium, RasterMedium<kOrthographic, kMasked>{view_, target_, queues_, 0, masks()});
      }
      if (!draw_large(drawn.large)) return false;
      stats.triangles += drawn.triangles;
      stats.triangles_small += drawn.triangles_small;
      stats.triangles_medium += drawn.medium;
      stats.triangles_large += drawn.large;
      stats.triangles_clipped += drawn.triangles_clipped;
      stats.groups_tested += clusters.groups_tested;
      stats.clusters_tested += clusters.clusters_tested;
      stats.clusters_drawn += clusters.clusters_drawn;
      first += count;
    }
    return true;
  }

  /// Returns the end of the round that begins with block `first`. Builds the pyramid of all earlier rounds first if the
  /// round is large enough that this saves time.
  uint64_t begin_round(uint64_t first, uint64_t total) {
    const uint64_t most = max_of(triangles_so_far_, max_of<uint64_t>(sizes_.round_triangles, 1));
    uint64_t triangles = 0;
    uint64_t end = first;
    while (end < total && (end == first || triangles + queues_.blocks[end].triangle_count <= most))
      triangles += queues_.blocks[end++].triangle_count;
    const auto samples = static_cast<uint64_t>(view_.width) * static_cast<uint64_t>(view_.height);
    if (triangles_so_far_ != 0 && triangles >= samples / 2) build_pyramid();
    triangles_so_far_ += triangles;
    return end;
  }

  /// Builds the pyramid of the current samples. Without memory for it, no box is tested against it.
  void build_pyramid() {
    DepthPyramid& pyramid = culling_.pyramid;
    if (pyramid.codes == nullptr) {
      const uint64_t count = lay_out(pyramid, view_.width, view_.height, kPyramidFirstLevel);
      pyramid.codes = backend_.template allocate<uint32_t>(count);
      if (pyramid.codes == nullptr) return;
    }
    backend_.for_each(static_cast<uint64_t>(pyramid.down(PyramidBand::kBandLevels)),
                      PyramidBand{pyramid, target_.samples});
    for (uint32_t level = PyramidBand::kBandLevels + 1; level <= kPyramidLevels; ++level)
      fill_level(pyramid, level, 0, 1);
  }

  /// Draws the large queue. The queue of tiles has room for all tiles of one triangle, which can be 65,536. It does not
  /// grow; fewer triangles are split at a time instead. Returns false if memory runs out.
  bool draw_large(uint64_t total) {
    if (total == 0) return true;
    const uint64_t image_tiles = tiles_of(view_.width) * tiles_of(view_.height);
    if (!grow(queues_.tiles, queues_.tile_capacity, max_of(sizes_.tiles, image_tiles))) return false;
    uint64_t share = total;
    for (uint64_t first = 0; first < total;) {
      const uint64_t count = min_of(share, total - first);
      backend_.write_counters(Counters{});
      backend_.for_each(count, SplitLarge{view_, queues_, first});
      const uint64_t tiles = backend_.read_counters().tiles;
      if (tiles > queues_.tile_capacity) {
        share = max_of<uint64_t>(count / 2, 1);
        continue;
      }
      backend_.for_each(tiles, RasterTiles<kOrthographic, kMasked>{view_, target_, queues_, 0, masks()});
      first += count;
    }
    return true;
  }

  Backend& backend_;
  SceneView scene_;
  FrameView view_;
  Target target_;
  QueueSizes sizes_;
  Queues queues_;
  ClusterCulling culling_{};
  uint64_t triangles_so_far_ = 0;  // in the rounds so far
};

template <class Backend>
void clear_frame(Backend& backend, const FrameView& view, uint64_t* samples) {
  backend.for_each(static_cast<uint64_t>(view.height), Clear{{samples, view.width}});
}

template <class Backend>
bool draw_frame(Backend& backend, const SceneView& scene, const FrameView& view, const Target& target,
                const QueueSizes& sizes, FrameStats& stats) {
  const auto draw = [&]<bool kOrthographic, bool kMasked>() {
    return FrameDrawer<Backend, kOrthographic, kMasked>(backend, scene, view, target, sizes).draw(stats);
  };
  const auto draw_with = [&]<bool kMasked>() {
    return view.orthographic ? draw.template operator()<true, kMasked>() : draw.template operator()<false, kMasked>();
  };
  return scene.masks != nullptr || view.clip_box.is_set ? draw_with.template operator()<true>()
                                                        : draw_with.template operator()<false>();
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
