// The coverage filter: whether a triangle can cover a pixel centre at all, decided with a seventh of the floating-point
// instructions that exact projection takes (docs/drawing.md). Most triangles of a dense mesh fall between the centres;
// the others are then projected exactly. Source: spec/rasterization.md, early culling.
//
// The filter is conservative: it rejects only triangles for which the exact projection (vertex.h) gives an empty
// pixel_box(), of the triangle or of each piece that clipping leaves. It uses vertices as they are stored (lattice
// codes or float32 positions), with the chunk's origin folded into the matrix. A bound of both errors covers the
// difference from the exact projection.
#pragma once

#include "kernels/raster/vertex.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// One (instance, chunk): rows over (stored position, 1). With w = row w: u / w and v / w (orthographic: u and v) are
/// pixels from the image's centre, shifted so that pixel centres are the integers.
struct alignas(16) CoverageFilter {
  float u[4];
  float v[4];
  float w[4];
  float slack;     // error bound of a corner in pixels, with snapping: slack + growth * |largest coordinate|;
  float growth;    // slack is infinity if no bound is known, and then every triangle is kept
  float w_lowest;  // the smallest w at which `slack` bounds the error (1 - kBeforeNear, plus the error of w)
  float w_end;     // perspective: a lower bound of the chunk's w, at least 1, for which `slack` was computed;
                   // orthographic: the largest w at which a corner surely needs no clipping
};

/// The part of CoverageFilter::slack for snapping. It does not depend on where a corner lies.
inline constexpr double kSnapSlack = 0.625 / kSubpixels;

/// How far before the near plane (w = 1) corners may lie with a perspective camera. If a triangle is cut there, the
/// rest lies between the positions of its corners. Their error is the usual one divided by w, so at most twice as
/// large.
inline constexpr float kBeforeNear = 0.5f;

/// The pixel centres of the drawn rows in the filter's coordinates: from a quarter of a pixel before the first centre
/// to a quarter before the last.
struct SampleLimits {
  float first_u;
  float last_u;
  float first_v;
  float last_v;
};

SCREE_HD inline SampleLimits make_sample_limits(const FrameView& view) {
  const int32_t middle[2] = {view.width / 2, view.height / 2};
  const auto limit = [&](int axis, int32_t center) { return static_cast<float>(center - middle[axis]) - 0.25f; };
  return {limit(0, 0), limit(0, view.width - 1), limit(1, view.first_row), limit(1, view.end_row - 1)};
}

/// The box of a chunk's stored positions, and the transform's coordinates of a stored 0.
struct StoredBox {
  double origin[3];  // the transform's coordinates of a stored position of 0
  float center[3];
  float extent[3];
  float largest[3];  // magnitude
  bool known;        // false: no error bound holds
};

/// The StoredBox of a chunk on a lattice. Codes are exact as floats. `chunk`: any record with its position_min and
/// position_bits.
template <typename Chunk>
SCREE_HD StoredBox lattice_box(const Transform& transform, const format::MeshRecord& mesh, const Chunk& chunk) {
  constexpr auto kFarthest = static_cast<int64_t>(kReferenceLimit);
  StoredBox out;
  out.known = true;
  for (int i = 0; i < 3; ++i) {
    const int64_t base = wrapping_sub(wrapping_add(mesh.lattice_min[i], static_cast<int64_t>(chunk.position_min[i])),
                                      transform.reference[i]);
    out.origin[i] = static_cast<double>(base);
    out.largest[i] = static_cast<float>((uint64_t{1} << (chunk.position_bits[i] & 31)) - 1);
    out.center[i] = out.extent[i] = 0.5f * out.largest[i];
    out.known = out.known && base < kFarthest && base > -kFarthest && chunk.position_bits[i] <= 24;
  }
  return out;
}

/// The StoredBox of any chunk. `box`: the box of its vertices in the transform's coordinates.
SCREE_HD inline StoredBox stored_box(const Transform& transform, const RelativeBox& box, const format::MeshRecord& mesh,
                                     const format::ChunkRecord& chunk) {
  if (mesh.position_encoding != format::PositionEncoding::kFloat32) return lattice_box(transform, mesh, chunk);
  StoredBox out;
  out.known = true;
  for (int i = 0; i < 3; ++i) {
    out.origin[i] = -static_cast<double>(transform.center[i]);
    out.center[i] = static_cast<float>(box.center[i] - out.origin[i]);
    out.extent[i] = static_cast<float>(box.extent[i]);
    out.largest[i] = abs_of(out.center[i]) + out.extent[i];
  }
  return out;
}

/// The filter of one (instance, chunk). `error`: bound for the chunk's vertices, which lie in `box`. The rows are
/// computed in double precision. Bounds are sums of magnitudes, so single precision with a small margin is enough.
SCREE_HD inline CoverageFilter make_coverage_filter(const FrameView& view, const Transform& transform,
                                                    const TransformError& error, const StoredBox& box) {
  constexpr float kMore = 1.00001f;         // covers the roundings of a sum of magnitudes
  constexpr float kOff = 1.0f / (1 << 21);  // share of all terms: covers the roundings of any sum
  constexpr auto kSnap = static_cast<float>(kSnapSlack);
  // In an image of even width the pixel centres lie half a pixel off the image's centre; likewise its height.
  const double shift[2] = {view.width % 2 == 0 ? -0.5 : 0.0, view.height % 2 == 0 ? -0.5 : 0.0};
  const double* rows[3] = {transform.exact_x, transform.exact_y, transform.exact_w};
  CoverageFilter filter;
  float* out[3] = {filter.u, filter.v, filter.w};
  float terms[3];
  float largest_uv = 0;  // upper bound of |u * w| and |v * w| in the box
  float w_least = 0;     // lower bound of w in the box
  for (int r = 0; r < 3; ++r) {
    double row[4];
    for (int j = 0; j < 4; ++j) {
      row[j] = rows[r][j];
      if (r == 2) continue;
      row[j] *= 1.0 / kSubpixels;
      if (!view.orthographic) row[j] += shift[r] * transform.exact_w[j];
    }
    row[3] += row[0] * box.origin[0] + row[1] * box.origin[1] + row[2] * box.origin[2];
    if (view.orthographic && r < 2) row[3] += shift[r];
    for (int j = 0; j < 4; ++j) out[r][j] = static_cast<float>(row[j]);
    float sum = abs_of(out[r][3]);
    float middle = out[r][3];
    float side = 0;
    for (int j = 0; j < 3; ++j) {
      sum += abs_of(out[r][j]) * box.largest[j];
      middle += out[r][j] * box.center[j];
      side += abs_of(out[r][j]) * box.extent[j];
    }
    terms[r] = kMore * sum;
    if (r < 2) {
      largest_uv = max_of(largest_uv, abs_of(middle) + kMore * side + kOff * terms[r]);
    } else {
      w_least = middle - kMore * side - kOff * terms[r];
    }
  }
  // The error here, of rounding the rows and of three fused steps, is at most 2^-22 of all terms. The error of the
  // exact projection is the transform's own bound.
  constexpr float kHere = 1.0f / (1 << 22);
  const float error_w = terms[2] * kHere + error.w;
  const float error_x = terms[0] * kHere + error.x / kSubpixels + 0.5f * error_w;
  const float error_y = terms[1] * kHere + error.y / kSubpixels + 0.5f * error_w;
  const float error_uv = max_of(error_x, error_y);
  bool known = box.known && terms[0] < 1e30f && terms[1] < 1e30f && terms[2] < 1e30f && error_uv < 1e30f;
  const float nearest = view.orthographic ? 1.0f : max_of(w_least - error_w, 1.0f);
  // Snapping moves a corner by half a sub-pixel. 2^-21 covers the reciprocal's ulp, the products' roundings and those
  // of the exact projection.
  float slack = error_uv / nearest + kSnap;
  float growth = (view.orthographic ? 0.0f : error_w / nearest) + 1.0f / (1 << 21);
  if (!view.orthographic && !(w_least - error_w > 1.0f)) {  // part of it may lie before the near plane
    slack /= 1.0f - kBeforeNear;
    growth /= 1.0f - kBeforeNear;
  }
  known = known && slack < 16.0f;
  // A chunk well in front of the camera and within the guard band has one slack for all its triangles.
  const float farthest = largest_uv / nearest;
  if (known && !view.orthographic && w_least - error_w > 1.0f && farthest < 32000.0f) {
    slack += growth * (farthest + slack);  // applies to the computed coordinate, which has an error itself
    growth = 0;
  }
  filter.slack = known ? slack * 1.001f : bits_float(0x7f800000u);
  filter.growth = known ? growth * 1.001f : 1.0f;
  filter.w_lowest = ((view.orthographic ? 0.0f : 1.0f - kBeforeNear) + error_w) * 1.000001f;
  filter.w_end = (view.orthographic ? 1.0f - error_w : nearest) * 0.999999f;
  return filter;
}

// For numbers only. A GPU takes one instruction; min_of() takes two because it handles NaN.
SCREE_HD inline float fast_min(float a, float b) {
#if defined(__CUDA_ARCH__)
  return fminf(a, b);
#else
  return min_of(a, b);
#endif
}
SCREE_HD inline float fast_max(float a, float b) {
#if defined(__CUDA_ARCH__)
  return fmaxf(a, b);
#else
  return max_of(a, b);
#endif
}

SCREE_HD inline float fast_abs(float a) {
#if defined(__CUDA_ARCH__)
  return fabsf(a);
#else
  return abs_of(a);
#endif
}

/// 1 / w to an ulp, for normal w.
SCREE_HD inline float filter_reciprocal(float w) {
#if defined(__CUDA_ARCH__) && defined(__CUDACC__)
  float out;
  asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(out) : "f"(w));
  return out;
#else
  return 1.0f / w;
#endif
}

/// A corner in the filter's coordinates.
struct FilteredVertex {
  float u;
  float v;
  float w;
};

template <bool kOrthographic>
SCREE_HD inline FilteredVertex filter_vertex(const CoverageFilter& filter, float x, float y, float z) {
  const float u = fused(filter.u[0], x, fused(filter.u[1], y, fused(filter.u[2], z, filter.u[3])));
  const float v = fused(filter.v[0], x, fused(filter.v[1], y, fused(filter.v[2], z, filter.v[3])));
  const float w = fused(filter.w[0], x, fused(filter.w[1], y, fused(filter.w[2], z, filter.w[3])));
  if constexpr (kOrthographic) return {u, v, w};
  const float scale = filter_reciprocal(w);
  return {u * scale, v * scale, w};
}

/// False only if the triangle covers no pixel centre of the image.
template <bool kOrthographic>
SCREE_HD inline bool may_cover_sample(const CoverageFilter& filter, const SampleLimits& limits, const FilteredVertex& a,
                                      const FilteredVertex& b, const FilteredVertex& c) {
  const float low_u = fast_min(fast_min(a.u, b.u), c.u);
  const float high_u = fast_max(fast_max(a.u, b.u), c.u);
  const float low_v = fast_min(fast_min(a.v, b.v), c.v);
  const float high_v = fast_max(fast_max(a.v, b.v), c.v);
  float slack = filter.slack;
  bool held = false;
  if (kOrthographic || filter.growth != 0.0f) {
    // Near the guard band, or if a corner lies far before the near plane, the exact projection decides.
    const float farthest =
        fast_max(fast_max(fast_abs(low_u), fast_abs(high_u)), fast_max(fast_abs(low_v), fast_abs(high_v)));
    slack = fused(farthest, filter.growth, slack);
    held = !(farthest < 32700.0f) | !(fast_min(fast_min(a.w, b.w), c.w) >= filter.w_lowest);
    if constexpr (kOrthographic) held = held | !(fast_max(fast_max(a.w, b.w), c.w) <= filter.w_end);
  }
  // The last pixel centre at or before the end of the range. Adding 1.5 * 2^23 rounds to nearest; subtracting a half
  // first makes it round down.
  constexpr float kMagic = 12582912.0f;
  const float less_half = slack - 0.5f;
  const float last_u = (fast_min(high_u + less_half, limits.last_u) + kMagic) - kMagic;
  const float last_v = (fast_min(high_v + less_half, limits.last_v) + kMagic) - kMagic;
  return held |
         ((last_u >= fast_max(low_u - slack, limits.first_u)) & (last_v >= fast_max(low_v - slack, limits.first_v)));
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
