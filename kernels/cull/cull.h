// Culls chunks of instances: tests bounds against the planes of the view, conservatively. Source:
// spec/rasterization.md, culling.
#pragma once

#include "kernels/raster/queues.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// The planes above and below rows of the picture: their distances from its middle in sub-pixels.
struct RowPlanes {
  float above;
  float below;
};

SCREE_HD inline RowPlanes all_rows(const FrameView& view) {
  return {view.half_height, view.half_height};
}

/// The rows that are drawn (FrameView::first_row, end_row). Exact: the distances are whole numbers below 2^24.
SCREE_HD inline RowPlanes drawn_rows(const FrameView& view) {
  return {view.half_height - static_cast<float>(view.first_row * kSubpixels),
          static_cast<float>(view.end_row * kSubpixels) - view.half_height};
}

/// Whether rows of the picture are left out.
SCREE_HD inline bool leaves_out_rows(const FrameView& view) {
  return view.first_row != 0 || view.end_row != view.height;
}

/// may_be_seen() of `rows` x, y and w. `slack`: as a share of the sum of all terms.
template <class Real, class Box>
SCREE_HD inline bool box_may_be_seen(const Real* const rows[3], const FrameView& view, const Box& box,
                                     const RowPlanes& planes, Real slack) {
  Real at_center[3];
  Real half_extent[3][3];  // row, axis: how much the row's value changes from the box's centre to its side
  Real terms[3];
  for (int r = 0; r < 3; ++r) {
    at_center[r] = rows[r][3];
    terms[r] = abs_of(rows[r][3]);
    for (int i = 0; i < 3; ++i) {
      at_center[r] += rows[r][i] * box.center[i];
      half_extent[r][i] = rows[r][i] * box.extent[i];
      terms[r] += abs_of(rows[r][i]) * (abs_of(box.center[i]) + box.extent[i]);
    }
  }
  for (int axis = 0; axis < 2; ++axis) {
    for (int side = -1; side <= 1; side += 2) {
      // Largest plane * w + side * x over the box; orthographic: plane + side * x.
      const auto plane = static_cast<Real>(axis == 0 ? view.half_width : side < 0 ? planes.below : planes.above);
      const Real weight = view.orthographic ? Real{0} : plane;
      const auto sign = static_cast<Real>(side);
      Real largest = weight * at_center[2] + sign * at_center[axis];
      if (view.orthographic) largest += plane;
      for (int i = 0; i < 3; ++i) largest += abs_of(weight * half_extent[2][i] + sign * half_extent[axis][i]);
      if (largest < -slack * (abs_of(weight) * terms[2] + terms[axis])) return false;
    }
  }
  const Real depth_half_extent = abs_of(half_extent[2][0]) + abs_of(half_extent[2][1]) + abs_of(half_extent[2][2]);
  if (view.orthographic) {
    if (at_center[2] - depth_half_extent > Real{1} + slack * terms[2] ||
        at_center[2] + depth_half_extent < -slack * terms[2])
      return false;
  } else if (at_center[2] + depth_half_extent < Real{1} - slack * terms[2]) {
    return false;
  }
  return true;
}

/// The slack of the tests of boxes. The error of single-precision projection is a few 2^-24. The error of a value from
/// a RoundedBox is at most 3 * 2^-24 of the terms for the box, 2^-24 for the rows and 9 * 2^-24 for the roundings here:
/// together less than 2^-20.
template <class Real>
inline constexpr Real kBoxSlack = Real{1} / (1 << (sizeof(Real) == sizeof(double) ? 20 : 18));

/// False only if no vertex in the box, and no triangle of such vertices, can touch a pixel centre of the rows. The
/// planes lie half a pixel outside the outermost centres, farther than snapping moves a vertex. Boxes with NaN or
/// infinity are kept.
template <class Real>
SCREE_HD inline bool may_be_seen(const Transform& transform, const FrameView& view, const TransformBox<Real>& box,
                                 const RowPlanes& planes) {
  const TransformRows<Real> of = rows_of(transform, Real{});
  const Real* const rows[3] = {of.x, of.y, of.w};
  return box_may_be_seen(rows, view, box, planes, kBoxSlack<Real>);
}

/// The same for all rows of the picture.
template <class Box>
SCREE_HD inline bool may_be_seen(const Transform& transform, const FrameView& view, const Box& box) {
  return may_be_seen(transform, view, box, all_rows(view));
}

/// may_be_in_clip_box() of `rows` x, y and w. `slack`: as a share of the sum of all terms.
template <class Real, class Box>
SCREE_HD inline bool box_may_be_in_clip_box(const Real* const rows[3], const FrameView& view, const Box& box,
                                            Real slack) {
  constexpr Real kMore = static_cast<Real>(1.00001);
  constexpr Real kDepthError = Real{1} / (1 << 19);
  constexpr Real kToHalfSamples = Real{2} / kSubpixels;
  Real at_w = rows[2][3];
  Real extent_w = abs_of(rows[2][3]) * slack;
  for (int i = 0; i < 3; ++i) {
    at_w += rows[2][i] * box.center[i];
    extent_w += abs_of(rows[2][i]) * (box.extent[i] + slack * (abs_of(box.center[i]) + box.extent[i]));
  }
  const Real farthest = max_of(at_w + extent_w, Real{1}) * kMore;
  const Real nearest = max_of(at_w - extent_w, Real{1});
  for (int k = 0; k < 3; ++k) {
    const ClipBox::Axis& axis = view.clip_box.axis[k];
    const auto x = static_cast<Real>(axis.x);
    const auto y = static_cast<Real>(axis.y);
    // The change of the sums per unit of w; orthographic: per unit of t.
    const auto of_depth = static_cast<Real>(view.orthographic ? axis.low_m : axis.low_one);
    Real value[4];
    Real terms = 0;
    for (int j = 0; j < 4; ++j) {
      const Real by_x = x * kToHalfSamples * rows[0][j];
      const Real by_y = y * kToHalfSamples * rows[1][j];
      const Real by_depth = of_depth * rows[2][j];
      value[j] = by_x + by_y + by_depth;
      terms +=
          (abs_of(by_x) + abs_of(by_y) + abs_of(by_depth)) * (j < 3 ? abs_of(box.center[j]) + box.extent[j] : Real{1});
    }
    Real at_center = value[3];
    Real half_extent = 0;
    for (int i = 0; i < 3; ++i) {
      at_center += value[i] * box.center[i];
      half_extent += abs_of(value[i]) * box.extent[i];
    }
    // Snapping moves a corner by 1/256 of half a sample. A sample's depth is that of a point of the moved triangle but
    // for 2^-20 of the nearest depth value; in perspective this moves the sample by (w w 2^-20 / w_nearest) along its
    // ray.
    Real off = (abs_of(x) + abs_of(y)) / 64;
    if (view.orthographic) {
      off += abs_of(of_depth) * kDepthError;
    } else {
      const Real ray =
          abs_of(x) * static_cast<Real>(view.width) + abs_of(y) * static_cast<Real>(view.height) + abs_of(of_depth);
      off = off * farthest + ray * farthest * (farthest / nearest) * kDepthError;
    }
    const auto low = static_cast<Real>(view.orthographic ? axis.low_one : axis.low_m);
    const auto high = static_cast<Real>(view.orthographic ? axis.high_one : axis.high_m);
    if (at_center + low + half_extent < -(slack * (terms + abs_of(low)) + off)) return false;
    if (at_center + high - half_extent > slack * (terms + abs_of(high)) + off) return false;
  }
  return true;
}

/// False only if no sample of a triangle of vertices in the box can lie in the view's clipping box, which is set. Boxes
/// with NaN or infinity are kept.
template <class Real>
SCREE_HD inline bool may_be_in_clip_box(const Transform& transform, const FrameView& view,
                                        const TransformBox<Real>& box) {
  const TransformRows<Real> of = rows_of(transform, Real{});
  const Real* const rows[3] = {of.x, of.y, of.w};
  return box_may_be_in_clip_box(rows, view, box, kBoxSlack<Real>);
}

/// Whether the box may be seen in the rows. `kClips`: the view has a clipping box, and the box is tested against it
/// too.
template <bool kClips, class Box>
SCREE_HD inline bool may_be_drawn(const Transform& transform, const FrameView& view, const Box& box,
                                  const RowPlanes& planes) {
  return may_be_seen(transform, view, box, planes) && (!kClips || may_be_in_clip_box(transform, view, box));
}

/// The same for all rows, with a test at run time whether the view has a clipping box.
template <class Box>
SCREE_HD inline bool may_be_drawn(const Transform& transform, const FrameView& view, const Box& box) {
  return may_be_seen(transform, view, box) && (!view.clip_box.is_set || may_be_in_clip_box(transform, view, box));
}

/// The distance of the box's nearest point in w, which is 1 on the near plane. An orthographic camera's value is 0 on
/// its near plane and 1 on its far one. Only for sorting. `row_w`: of a Transform, in the box's precision.
template <class Real, class Box>
SCREE_HD inline Real nearness(const Real row_w[4], const FrameView& view, const Box& box) {
  Real at = row_w[3];
  Real half_extent = 0;
  for (int i = 0; i < 3; ++i) {
    at += row_w[i] * box.center[i];
    half_extent += abs_of(row_w[i]) * box.extent[i];
  }
  return view.orthographic ? Real{1} - (at + half_extent) : at - half_extent;
}

/// One team per instance: culls the instance, then its chunks with the lanes, and appends the draw blocks of visible
/// chunks.
struct Cull {
  SceneView scene;
  FrameView view;
  Queues queues;
  uint64_t first;            // the instance of item 0
  uint32_t block_triangles;  // the most per draw block

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    const uint64_t number = first + item;
    if (is_omitted(view, number)) return;
    const format::InstanceRecord& instance = scene.instances[number];
    const format::MeshRecord& mesh = scene.meshes[instance.mesh];
    if (mesh.triangle_count == 0 || !draws_mesh(scene, mesh)) return;
    const bool float32 = mesh.position_encoding == format::PositionEncoding::kFloat32;
    const Transform transform = make_transform(view, scene.matrices[instance.matrix], mesh.lattice_exponent, float32);
    if (!may_be_drawn(transform, view, mesh_box(mesh, transform))) return;
    uint64_t draws = 0;
    for (uint64_t i = team.rank(); i < mesh.chunk_count; i += team.size()) {
      const format::ChunkRecord& chunk = scene.chunks[mesh.first_chunk + i];
      if (chunk.triangle_count == 0 || scene.pages[chunk.page] == nullptr) continue;
      const RelativeBox box = vertex_box(mesh, chunk, transform);
      // A mesh of one chunk has been tested already.
      if (!float32 && mesh.chunk_count > 1 && !may_be_drawn(transform, view, box)) continue;
      const double near = nearness(transform.exact_w, view, box);
      const float nearest = near > 0 ? static_cast<float>(min_of(near, 1e38)) : 0.0f;  // NaN cannot be sorted
      ++draws;
      for (uint64_t start = 0; start < chunk.triangle_count; start += block_triangles) {
        const uint64_t left = chunk.triangle_count - start;
        push(team, &queues.counters->blocks, queues.blocks, queues.block_capacity,
             DrawBlock{number, mesh.first_chunk + i, static_cast<uint32_t>(start),
                       static_cast<uint32_t>(min_of<uint64_t>(left, block_triangles)), nearest});
      }
    }
    if (draws != 0) team.add(&queues.counters->draws, draws);
    if (team.rank() == 0) team.add(&queues.counters->instances_drawn, 1);
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
