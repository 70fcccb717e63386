// Stage 1 of a CPU frame: draws the visible part of a draw block from the queue, triangle by triangle. It culls groups
// of 32 clusters, and clusters, that lie outside the picture, between its pixel centres or behind triangles already
// drawn. Source: spec/rasterization.md, culling of clusters.
#pragma once

#include <algorithm>

#include "kernels/cull/chunk_screen.h"
#include "kernels/cull/cluster_bounds.h"
#include "kernels/raster/small.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// The finest level of the depth pyramid. Smaller boxes are tested against the samples.
inline constexpr uint32_t kPyramidFirstLevel = 2;

/// The tests of clusters and of whole blocks. None of them changes the picture.
struct ClusterCulling {
  CenterRange centers;
  bool bounds;           // tests whether it is outside the picture or between pixel centres
  bool occlusion;        // tests whether it is behind triangles already drawn
  DepthPyramid pyramid;  // from kPyramidFirstLevel on, for boxes of more than a few samples; its codes may be null
};

/// Counts of the blocks that were drawn.
struct ClusterCounts {
  uint64_t groups_tested;  // groups of 32 clusters
  uint64_t clusters_tested;
  uint64_t clusters_drawn;
};

template <bool kOrthographic, bool kMasked>
struct RasterBlocks {
  RasterSmall<kOrthographic, kMasked> small;
  ClusterCulling culling;
  ClusterCounts* counts;
  uint64_t first;  // the block of item 0

  using Context = typename RasterSmall<kOrthographic, kMasked>::Context;

  template <class Team>
  void operator()(uint32_t item, Team team) const {
    const SceneView& scene = small.scene;
    const Queues& queues = small.queues;
    const DrawBlock block = queues.blocks[first + item];
    const format::InstanceRecord& instance = scene.instances[block.instance];
    const format::MeshRecord& mesh = scene.meshes[instance.mesh];
    const format::ChunkRecord& chunk = scene.chunks[block.chunk];
    Transform transform = make_transform(small.view, scene.matrices[instance.matrix], mesh.lattice_exponent,
                                         mesh.position_encoding == format::PositionEncoding::kFloat32);
    const RelativeBox box = vertex_box(mesh, chunk, transform);
    set_error(transform, box);
    Context context{
        nullptr, &transform,
        mesh.material != format::kNone && (scene.materials[mesh.material].flags & format::kMaterialDoubleSided) != 0,
        scene.instance_base[block.instance] + chunk.first_triangle};
    if constexpr (kMasked) context.masked = {scene, mesh, chunk};
    // The box of float32 positions is known for whole meshes only.
    if (!culling.bounds || block.triangle_count < kMinTestedTriangles ||
        mesh.position_encoding == format::PositionEncoding::kFloat32) {
      draw_all(team, context, block, mesh, chunk);
    } else if (chunk.encoding == format::ChunkEncoding::kClustered) {
      draw_clusters(team, context, block, mesh, chunk, box);
    } else {
      ScreenBounds bounds;
      if (find_screen_bounds(transform, small.view, box, bounds) && !is_occluded(team, bounds))
        draw_all(team, context, block, mesh, chunk);
    }
    team.add(&queues.counters->triangles_small, context.small);
    if (context.clipped != 0) team.add(&queues.counters->triangles_clipped, context.clipped);
    team.add(&queues.counters->triangles, block.triangle_count);
  }

 private:
  /// Drawing this many triangles takes longer than testing the block.
  static constexpr uint32_t kMinTestedTriangles = 64;

  template <class Team>
  void draw_all(Team team, Context& context, const DrawBlock& block, const format::MeshRecord& mesh,
                const format::ChunkRecord& chunk) const {
    const uint32_t end = block.first_triangle + block.triangle_count;
    uint64_t clusters = 0;
    for (uint32_t at = block.first_triangle; at < end;) {
      // Draws the rest of an indexed chunk, or the next cluster of a clustered one.
      const ChunkReader reader = make_reader(mesh, chunk, small.scene.pages[chunk.page], *context.transform, at);
      context.reader = &reader;
      const uint32_t count = min_of(end, reader.end_triangle) - at;
      small.draw_run(team, context, chunk, at, count);
      at += count;
      clusters += reader.clustered ? 1 : 0;
    }
    if (clusters != 0) team.add(&counts->clusters_drawn, clusters);
  }

  /// Draws the visible part of a clustered chunk, whose box is `box`.
  template <class Team>
  void draw_clusters(Team team, Context& context, const DrawBlock& block, const format::MeshRecord& mesh,
                     const format::ChunkRecord& chunk, const RelativeBox& box) const {
    const Transform& transform = *context.transform;
    const CoverageFilter filter =
        make_coverage_filter(small.view, transform, error_of(transform, box), stored_box(transform, box, mesh, chunk));
    const format::ChunkStreams streams = streams_of(mesh, chunk);
    const std::byte* page = small.scene.pages[chunk.page];
    const std::byte* payload = page + chunk.offset;
    const auto* group_bounds = reinterpret_cast<const format::ClusterBounds*>(payload + streams.group_bounds.offset);
    const auto* cluster_bounds =
        reinterpret_cast<const format::ClusterBounds*>(payload + streams.cluster_bounds.offset);
    const format::ClusterRecord* clusters = clusters_of(payload, streams);
    const uint32_t end = block.first_triangle + block.triangle_count;
    const uint64_t first_cluster = cluster_of_triangle(clusters, chunk.cluster_count, block.first_triangle);
    const uint64_t last_cluster = cluster_of_triangle(clusters, chunk.cluster_count, end - 1);
    ClusterCounts sums{};
    const auto draw_group = [&](uint64_t group) {
      const uint64_t begin = max_of(group * format::kGroupClusters, first_cluster);
      const uint64_t stop = min_of((group + 1) * format::kGroupClusters, last_cluster + 1);
      for (uint64_t cluster = begin; cluster < stop; ++cluster) {
        ++sums.clusters_tested;
        ScreenBounds bounds;
        if (!shows(filter, centered_box(cluster_bounds[cluster]), bounds) || is_occluded(team, bounds)) continue;
        ++sums.clusters_drawn;
        const ChunkReader reader = make_reader_of(mesh, chunk, page, transform, streams, cluster);
        context.reader = &reader;
        const uint32_t at = max_of(block.first_triangle, reader.cluster.first_triangle);
        small.draw_run(team, context, chunk, at, min_of(end, reader.end_triangle) - at);
      }
    };
    // Groups are drawn from near to far, so that near groups hide far ones. The clusters of a group are drawn in memory
    // order.
    VisibleGroup visible[kMaxVisibleGroups];
    const uint64_t end_group = last_cluster / format::kGroupClusters + 1;
    for (uint64_t group = first_cluster / format::kGroupClusters; group < end_group;) {
      uint32_t count = 0;
      for (; group < end_group && count < kMaxVisibleGroups; ++group) {
        ++sums.groups_tested;
        visible[count].group = group;
        if (shows(filter, centered_box(group_bounds[group]), visible[count].bounds)) ++count;
      }
      std::sort(visible, visible + count, [](const VisibleGroup& a, const VisibleGroup& b) {
        return a.bounds.nearest_code < b.bounds.nearest_code;
      });
      for (uint32_t i = 0; i < count; ++i) {
        if (!is_occluded(team, visible[i].bounds)) draw_group(visible[i].group);
      }
    }
    team.add(&counts->groups_tested, sums.groups_tested);
    team.add(&counts->clusters_tested, sums.clusters_tested);
    team.add(&counts->clusters_drawn, sums.clusters_drawn);
  }

  struct VisibleGroup {
    ScreenBounds bounds;
    uint64_t group;
  };
  static constexpr uint32_t kMaxVisibleGroups = 64;  // four times the groups of a block of full clusters

  /// Whether a triangle whose vertices lie in the box may cover a pixel centre. If so, fills `bounds`.
  bool shows(const CoverageFilter& filter, const CenteredBox& box, ScreenBounds& bounds) const {
    if constexpr (kMasked) {
      if (small.view.clip_box.is_set)
        return bound_on_screen<kOrthographic, true>(filter, small.view, culling.centers, box, bounds) ==
               BoxCoverage::kCenters;
    }
    return bound_on_screen<kOrthographic>(filter, small.view, culling.centers, box, bounds) == BoxCoverage::kCenters;
  }

  /// Whether the triangles drawn so far hide all within `bounds`. Small boxes are tested against the samples as they
  /// are now. So the order of drawing decides which clusters are culled, but it does not change the picture.
  template <class Team>
  bool is_occluded(Team team, const ScreenBounds& bounds) const {
    if (!culling.occlusion) return false;
    const PixelBox& box = bounds.pixels;
    constexpr int32_t kFewSamples = 8;
    if (max_of(box.x1 - box.x0, box.y1 - box.y0) >= kFewSamples)
      return culling.pyramid.codes != nullptr && is_occluded_by_pyramid(culling.pyramid, kPyramidFirstLevel, bounds);
    return is_occluded_now(team, small.target, bounds);
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
