// The triangles of clusters that passed the filter: their corners, their masks and their exact projection.
#pragma once

#include "kernels/cuda/raster/cluster_run.cuh"
#include "kernels/cuda/raster/small.cuh"

namespace scree::kernels {

/// A survivor that is about to be drawn: its cluster, and the data by which its corners are read.
struct SurvivorReader {
  const ClusterDraw& draw;
  uint32_t number;        // of the triangle in its chunk
  uint32_t first_vertex;  // of the cluster in its chunk
  uint32_t corners;
  format::ClusterLayout at;
  format::ClusterBounds bounds;
  const uint32_t* data;
  ClusterPrediction prediction;

  __device__ SurvivorReader(const ClusterFrame& frame, const SurvivorTriangle& survivor)
      : SurvivorReader(frame, survivor, frame.list.items[survivor.item]) {}

  /// The vertex number, in the cluster, of corner 0 to 2.
  __device__ uint32_t corner(uint32_t number_of_corner) const { return corners >> (7 * (number_of_corner + 1)) & 127; }

  /// Lattice coordinates of corner 0 to 2 minus the transform's reference. Requires a draw without
  /// ClusterDraw::kFarAway.
  __device__ void relative(uint32_t number_of_corner, int32_t out[3]) const {
    const uint32_t stride = at.position_bits[0] + at.position_bits[1] + at.position_bits[2];
    uint64_t bit = uint64_t{corner(number_of_corner)} * stride;
    uint32_t code[3];
    for (int k = 0; k < 3; ++k) {
      code[k] = unpack_bits(data + at.positions, bit, at.position_bits[k]);
      bit += at.position_bits[k];
    }
    prediction.apply(code);
    for (int k = 0; k < 3; ++k) out[k] = draw.base[k] + static_cast<int32_t>(format::bounds_min(bounds, k) + code[k]);
  }

  template <bool kOrthographic>
  __device__ ProjectedPoint project(const int32_t position[3]) const {
    return project_point<kOrthographic>(draw.x, draw.y, draw.w, static_cast<float>(position[0]),
                                        static_cast<float>(position[1]), static_cast<float>(position[2]));
  }

  /// kernels::set_up() of the triangle with these corners.
  __device__ bool set_up(const FrameView& view, const ScreenVertex& a, const ScreenVertex& b, const ScreenVertex& c,
                         Triangle& triangle, PixelBox& box, int64_t& area) const {
    return kernels::set_up(view, a, b, c, draw.first_id + number, (draw.flags & ClusterDraw::kMirrored) != 0,
                           (draw.flags & ClusterDraw::kDoubleSided) != 0, triangle, box, area);
  }

 private:
  __device__ SurvivorReader(const ClusterFrame& frame, const SurvivorTriangle& survivor, const ClusterItem& item)
      : SurvivorReader(frame.list.draws[item.draw], survivor, item.cluster,
                       __ldg(reinterpret_cast<const uint4*>(frame.list.draws[item.draw].clusters() + item.cluster))) {}
  __device__ SurvivorReader(const ClusterDraw& of, const SurvivorTriangle& survivor, uint32_t cluster,
                            const uint4& record)
      : draw(of),
        number(record.y + (survivor.corners & 127)),
        first_vertex(record.z),
        corners(survivor.corners),
        at(format::cluster_layout({record.x, record.y, record.z, record.w})),
        bounds(load_bounds(of.cluster_bounds() + cluster)),
        data(of.data()),
        prediction(at.predicted_axis, data + at.prediction) {}
};

/// Makes the planes of survivors.
struct ClusterPlanes {
  using Key = SurvivorTriangle;
  const ClusterFrame* frame;

  __device__ const FrameView& frame_view() const { return frame->small.view; }

  template <bool kOrthographic>
  __device__ void make(const SurvivorTriangle& survivor, MaskPlane& out) const {
    const SceneView& scene = frame->small.scene;
    const SurvivorReader reader(*frame, survivor);
    const format::ChunkRecord& chunk = scene.chunks[reader.draw.chunk];
    const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
    const MaskView* const mask = mask_of(scene, mesh);
    if (mask == nullptr) return;
    // The streams follow each other as in format::chunk_streams().
    const std::byte* const uvs =
        reinterpret_cast<const std::byte*>(reader.data) + format::packed_bytes(chunk.cluster_words, 32);
    const std::byte* colors = nullptr;
    if (masks_by_colors(scene, mesh))
      colors = uvs + format::packed_bytes(chunk.vertex_count, uint32_t{chunk.uv_bits[0]} + chunk.uv_bits[1]);
    MaskCorner<int32_t> corners[3];
    for (uint32_t n = 0; n < 3; ++n) {
      corners[n].vertex = reader.first_vertex + reader.corner(n);
      reader.relative(n, corners[n].relative);
    }
    make_mask_plane<kOrthographic>(mask, frame->small.view, frame->small.list.transforms[reader.draw.instance],
                                   MaskVertices(chunk, uvs, colors), corners, out);
  }
};

using ClusterWaiting = WaitingSamples<SurvivorTriangle>;

/// This warp's memory for masks, in kernels that draw masked triangles. It lies behind the ClusterShared of all warps.
__device__ inline ClusterWaiting& cluster_masks() {
  extern __shared__ uint4 shared_memory[];
  return reinterpret_cast<ClusterWaiting*>(reinterpret_cast<ClusterShared*>(shared_memory) +
                                           kClusterWarps)[threadIdx.x / kWarpLanes];
}

/// This warp's memory for masks in kernels whose shared memory is static; null if they draw only opaque triangles.
template <Alpha kAlpha>
__device__ inline ClusterWaiting* block_masks() {
  if constexpr (kAlpha != Alpha::kOpaque) {
    __shared__ ClusterWaiting masks[kClusterWarps];
    return masks + threadIdx.x / kWarpLanes;
  } else {
    return nullptr;
  }
}

/// LaneMask::find() of a survivor.
template <class Mask>
__device__ inline uint32_t find_mask(Mask& mask, const ClusterFrame& frame, const SurvivorTriangle& survivor) {
  return mask.find(frame.small.scene, frame.list.draws[frame.list.items[survivor.item].draw].chunk, survivor);
}

/// Projects a survivor. Returns false if there is nothing to draw, or if it was queued to be clipped.
template <bool kOrthographic>
__device__ inline bool project_cluster_survivor(const ClusterFrame& frame, const SurvivorTriangle& survivor,
                                                Triangle& triangle, PixelBox& box, int64_t& area) {
  const FrameView& view = frame.small.view;
  const SurvivorReader reader(frame, survivor);
  const ClusterDraw& draw = reader.draw;
  ProjectedPoint points[3];
  for (uint32_t i = 0; i < 3; ++i) {  // reading all corners first would take more registers
    int32_t position[3];
    reader.relative(i, position);
    points[i] = reader.project<kOrthographic>(position);
  }
  const bool in_range = points[0].in_range & points[1].in_range & points[2].in_range;
  const bool far_away = (draw.flags & ClusterDraw::kFarAway) != 0;
  if (!in_range || far_away) {
    uint32_t outside = far_away ? 0u : uint32_t{kOutsideMask};
    for (int i = 0; i < 3; ++i) {
      outside &= plane_flags<kOrthographic>(points[i], view, draw.error[0], draw.error[1], draw.error[2]);
    }
    if (outside == 0)
      push(WarpTeam{}, &frame.small.list.counters->to_clip, frame.list.to_clip, frame.list.clip_capacity,
           ClipItem{survivor, draw.instance, draw.chunk, reader.number});
    return false;
  }
  return reader.set_up(view, snap_point(points[0], view, 0), snap_point(points[1], view, 0),
                       snap_point(points[2], view, 0), triangle, box, area);
}

}  // namespace scree::kernels
