// The coverage filter (coverage_filter.h) of one cluster that perspective hardly distorts. A vertex's screen
// coordinate is then a fixed-point sum over its packed codes: no division, and no unpacking. Conservative as the filter
// is: its error is added to the slack. Source: spec/rasterization.md, early culling.
#pragma once

#include "kernels/cull/cluster_bounds.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// How a cluster's positions are packed (spec/codecs.md, clusters).
struct ClusterCodes {
  uint32_t bits[3];
  uint32_t predicted_axis;  // format::kNotPredicted if there is none
  int32_t slope[3];         // of the predicted axis: 0 for itself, and of the others; all 0 if there is none
  int32_t bias;             // 0 if there is none
};

/// Let w0 be the lowest 32 bits of a vertex's codes, w1 those from bits[0] on and w2 those from bits[0] + bits[1] on
/// (w2 holds no bits of the next vertex). The high half of
///   u[0] w0 + u[1] w1 + u[2] w2 + u[3]   (modulo 2^32)
/// is the vertex's screen coordinate: in steps of 2^-n pixels, rounded down, counted from a pixel centre before the
/// cluster, with its slack added. v likewise. A triangle covers pixel centres of a column only if the coordinates of
/// its corners fulfil largest - smallest + twice_slack >= largest mod 2^n.
struct AffineProjection {
  uint32_t u[4];
  uint32_t v[4];
  uint32_t twice_slack;  // of u, and of v in the high half; 0: there is no projection, use the filter
  uint32_t fraction;     // 2^n - 1, in both halves

  /// Whether a triangle may cover a pixel centre. `largest`, `smallest`: the coordinates of its corners, v in the high
  /// half.
  SCREE_HD static bool may_cover(uint32_t largest, uint32_t smallest, uint32_t twice_slack, uint32_t fraction) {
    // Neither difference is negative, and all coordinates are well below 2^16.
    const uint32_t size = largest - smallest + twice_slack;
    const uint32_t past = largest & fraction;
#if defined(__CUDA_ARCH__)
    return __vmaxu2(size, past) == size;
#else
    return (size & 0xffff) >= (past & 0xffff) && size >> 16 >= past >> 16;
#endif
  }
};

/// Common to both axes of an AffineProjection.
struct AffineCenter {
  float center[3];         // a lattice point near the middle of the cluster's box
  float before_center[3];  // from the box's lower side to it
  float half_extent[3];    // upper bound from it to either side
  float scale;             // 1 / w there
  float change;  // error bound from the change of w within the box, as a share of the distance from the middle
  float slack;   // the filter's, for this cluster
  bool known;    // false: no bound holds
};

/// `filter`: of the cluster's chunk, perspective. `bounds`: of the cluster.
SCREE_HD inline AffineCenter make_affine_center(const CoverageFilter& filter, const format::ClusterBounds& bounds) {
  AffineCenter out;
  float w = filter.w[3];
  float w_half_extent = 0;
  for (int i = 2; i >= 0; --i) {
    const uint32_t extent = format::bounds_extent(bounds, i);
    out.before_center[i] = static_cast<float>(extent / 2);
    out.half_extent[i] = static_cast<float>(extent - extent / 2);
    out.center[i] = static_cast<float>(format::bounds_min(bounds, i) + extent / 2);
    w = fused(filter.w[i], out.center[i], w);
    w_half_extent = fused(fast_abs(filter.w[i]), out.half_extent[i], w_half_extent);
  }
  out.scale = filter_reciprocal(w);
  // The change of w within the box, and the error of w, as shares of w.
  const float change = w_half_extent * out.scale;
  const float off = fused(filter.w_lowest - (1.0f - kBeforeNear), out.scale, 1e-6f);
  // A point at distance d from the middle lies at step . d * w(middle) / w(point).
  out.change = fused(1.34f, change, 2.0f * off);
  // The chunk's slack without snapping is proportional to 1 / w.
  constexpr auto kSnap = static_cast<float>(kSnapSlack);
  const float nearer = fast_min(filter.w_end * out.scale * (1.00001f + out.change), 1.0f);
  out.slack = fused(filter.slack - kSnap, nearer, kSnap * 1.001f);
  // Requires that one slack holds for the whole chunk: it lies in front of the camera and within the guard band.
  // Comparisons are written so that NaN is false.
  constexpr float kExact = 16777216.0f;
  out.known = (filter.growth == 0.0f) & (w - 1.01f * w_half_extent > 1.0f) & (change < 0.2f) & (off < 0.01f) &
              (out.slack < 0.25f) & (fast_max(fast_max(out.center[0], out.center[1]), out.center[2]) <= kExact);
  return out;
}

/// One axis of an AffineProjection before its fixed-point factors are computed.
struct AffineAxis {
  float center;   // coordinate of the middle, pixels
  float step[3];  // pixels per lattice step
  float half;     // half of the cluster's size, pixels
};

/// `row`: u or v of the filter.
SCREE_HD inline AffineAxis make_affine_axis(const AffineCenter& middle, const float w[4], const float row[4]) {
  AffineAxis out;
  out.center =
      fused(row[0], middle.center[0], fused(row[1], middle.center[1], fused(row[2], middle.center[2], row[3]))) *
      middle.scale;
  out.half = 0;
  for (int i = 0; i < 3; ++i) {
    out.step[i] = fused(-out.center, w[i], row[i]) * middle.scale;
    out.half = fused(fast_abs(out.step[i]), middle.half_extent[i], out.half);
  }
  return out;
}

/// The n of AffineProjection for a cluster whose longer axis has this half size in pixels: the largest n that leaves
/// room for all of it. 0 if there is none.
SCREE_HD inline uint32_t affine_fraction_bits(float half) {
  constexpr uint32_t kMostBits = 13;
  const float span = fused(2.25f, half, 2.25f);
  if (!(span < 256.0f)) return 0;
  const uint32_t before_point = (float_bits(span) >> 23) - 126;  // span < 2^before_point
  return min_of(16 - before_point, kMostBits);
}

/// Computes the factors of one axis and its twice_slack. Returns false if the filter itself is better. `fraction_bits`:
/// of the longer axis, not 0. `codes`: of the cluster, at most 64 bits.
SCREE_HD inline bool finish_affine_axis(const AffineCenter& middle, const AffineAxis& axis, const float w[4],
                                        const float row[4], const ClusterCodes& codes, uint32_t fraction_bits,
                                        uint32_t factors[4], uint32_t& twice_slack) {
  const float one = static_cast<float>(1u << fraction_bits);
  const float fine = one * 65536.0f;  // scale of the sum
  float predicted_step = 0;
  for (uint32_t i = 0; i < 3; ++i) predicted_step = codes.predicted_axis == i ? axis.step[i] : predicted_step;
  const float slope_step = predicted_step * (1.0f / (1 << format::kPredictorShift));
  const float bias = static_cast<float>(codes.bias) - 0.5f;  // rounding down subtracts half a step on average
  float error_bound = fused(axis.half, middle.change, 0.5f * fast_abs(predicted_step));
  // The roundings of single precision: of a few operations here, and of the rows.
  float terms = fast_abs(axis.center) + axis.half + fast_abs(predicted_step * bias);
  float constant = predicted_step * bias;
  float largest = 0;  // largest factor
  uint32_t factor[3];
  for (int i = 0; i < 3; ++i) {
    const float largest_code = static_cast<float>((1u << codes.bits[i]) - 1);
    const float sloped = slope_step * static_cast<float>(codes.slope[i]);
    // An axis of 0 bits has no code of its own; its word holds the next field, so its factor must be 0.
    const float own = (codes.bits[i] == 0 ? 0.0f : axis.step[i] + sloped) * fine;
    constant = fused(-axis.step[i], middle.before_center[i], constant);
    terms += (fast_abs(row[i]) + fast_abs(axis.center * w[i])) * middle.scale * middle.half_extent[i];
    terms += (fast_abs(axis.step[i]) + fast_abs(sloped)) * largest_code;
    error_bound = fused(largest_code, 0.5f / fine, error_bound);
    largest = fast_max(largest, fast_abs(own));
    factor[i] = static_cast<uint32_t>(static_cast<int32_t>(fast_min(fast_max(floor_of(own + 0.5f), -1e9f), 1e9f)));
  }
  error_bound = fused(terms, 1.0f / (1 << 20), error_bound);
  const float slack = middle.slack + error_bound + 2.0f / fine;
  const float low = axis.center - axis.half - error_bound - slack;
  // The constant term, modulo 2^32 like the factors.
  const float place = ((axis.center - floor_of(low)) + slack + constant) * fine;
  factors[0] = factor[0];
  factors[1] = factor[1] - (factor[0] << codes.bits[0]);
  factors[2] = factor[2] - (factor[1] << codes.bits[1]);
  factors[3] = static_cast<uint32_t>(static_cast<int64_t>(fast_min(fast_max(place, -9e18f), 9e18f)));
  twice_slack = static_cast<uint32_t>(2.0f * slack * one) + 1;
  // If the error is a large part of a triangle's size, the filter itself rejects more.
  return (largest < 9e8f) & (fast_abs(place) < 8e18f) & (error_bound < fused(axis.half, 0.02f, 0.03f));
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
