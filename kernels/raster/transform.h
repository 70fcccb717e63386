// From lattice coordinates to sub-pixels: the frame's constants, and one matrix per world matrix and lattice exponent.
// Source: spec/rasterization.md, vertices.
#pragma once

#include <cmath>

#include "format/geometry/quantize.h"
#include "format/layout.h"
#include "kernels/frame.h"
#include "kernels/math.h"
#include "kernels/raster/clip_box.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

inline constexpr int32_t kSubpixels = 256;                     // per pixel
inline constexpr float kGuardBand = 32768.0f * kSubpixels;     // sub-pixels from the image's centre, 2^23
inline constexpr double kReferenceLimit = 4503599627370496.0;  // 2^52: a reference is exact in a double

/// A frame's constants of the camera. Let p be the vertex in world space minus the eye. x = row_x . p and y = row_y . p
/// are sub-pixels from the image's centre (y downward), in perspective times w. depth = row_w . p + offset_w is w, 1 on
/// the near plane; an orthographic camera has t instead, 1 on the near plane and 0 on the far one.
struct FrameView {
  double eye[3];
  double row_x[3];
  double row_y[3];
  double row_w[3];
  double offset_w;
  const uint32_t* omitted;  // View::omitted
  float half_width;         // the image's, sub-pixels
  float half_height;
  int32_t width;  // samples
  int32_t height;
  // The rows from first_row to end_row - 1 are drawn; samples of other rows are undefined. All rows, unless GPUs divide
  // a picture.
  int32_t first_row;
  int32_t end_row;
  bool orthographic;
  ClipBox clip_box;

  bool operator==(const FrameView&) const = default;
};

SCREE_HD inline FrameView make_frame_view(const View& view) {
  FrameView frame{};
  frame.width = static_cast<int32_t>(view.width);
  frame.height = static_cast<int32_t>(view.height);
  frame.end_row = frame.height;
  frame.half_width = static_cast<float>(view.width) * (kSubpixels / 2);
  frame.half_height = static_cast<float>(view.height) * (kSubpixels / 2);
  frame.orthographic = view.orthographic;
  frame.omitted = view.omitted;
  const double scale = view.orthographic ? 1.0 : 1.0 / view.z_near;
  const double scale_x = static_cast<double>(frame.half_width) / view.half_width * scale;
  const double scale_y = static_cast<double>(frame.half_height) / view.half_height * scale;
  const double depth_scale = view.orthographic ? -1.0 / (view.z_far - view.z_near) : scale;
  for (int i = 0; i < 3; ++i) {
    frame.eye[i] = view.eye[i];
    frame.row_x[i] = view.right[i] * scale_x;
    frame.row_y[i] = view.up[i] * -scale_y;
    frame.row_w[i] = view.forward[i] * depth_scale;
  }
  frame.offset_w = view.orthographic ? view.z_far / (view.z_far - view.z_near) : 0.0;
  frame.clip_box = make_clip_box(view);
  return frame;
}

/// Whether the view's clipping box cuts away a fragment at sample (x, y). `value`: its word for the visibility buffer.
SCREE_HD inline bool is_cut_away(const FrameView& view, int32_t x, int32_t y, uint64_t value) {
  return view.clip_box.is_set &&
         !is_in_clip_box(view.clip_box, view.width, view.height, view.orthographic, x, y, sample_depth_code(value));
}

/// Whether the view leaves out an instance.
SCREE_HD inline bool is_omitted(const FrameView& view, uint64_t instance) {
  return view.omitted != nullptr && (view.omitted[instance / 32] >> (instance % 32) & 1) != 0;
}

/// One matrix per world matrix and lattice exponent: rows x, y and depth over (d, 1). d is a lattice coordinate minus
/// `reference`, or a float32 position minus `center`.
struct Transform {
  float x[4];
  float y[4];
  float w[4];
  double exact_x[4];  // the same before rounding, for clipping and culling
  double exact_y[4];
  double exact_w[4];
  int64_t reference[3];
  float center[3];
  bool mirrored;  // the world matrix has a negative determinant
  // Error bounds of x, y and w for the vertices that use this transform: set_error(). A vertex counts as outside a
  // plane of the view only if it is outside by more.
  float error_x;
  float error_y;
  float error_w;
};

/// The eye in object space; 0 on all axes if the matrix has no finite inverse. Returns whether the matrix mirrors.
SCREE_HD inline bool object_space_eye(const FrameView& view, const format::MatrixRecord& matrix, double out[3]) {
  // Scaled to a largest entry of 1, so that the determinant of a matrix of tiny or huge entries stays a normal number.
  double largest = 0;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) largest = max_of(largest, abs_of(matrix.rows[i][j]));
  }
  out[0] = out[1] = out[2] = 0;
  if (!(largest > 0)) return false;
  const double scale = 1.0 / largest;
  double m[3][3];
  double t[3];
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) m[i][j] = matrix.rows[i][j] * scale;
    t[i] = (view.eye[i] - matrix.rows[i][3]) * scale;
  }
  const double c0 = m[1][1] * m[2][2] - m[1][2] * m[2][1];
  const double c1 = m[1][2] * m[2][0] - m[1][0] * m[2][2];
  const double c2 = m[1][0] * m[2][1] - m[1][1] * m[2][0];
  const double determinant = m[0][0] * c0 + m[0][1] * c1 + m[0][2] * c2;
  if (!(abs_of(determinant) > 0)) return false;
  const double inverse = 1.0 / determinant;
  const double eye[3] = {
      (c0 * t[0] + (m[0][2] * m[2][1] - m[0][1] * m[2][2]) * t[1] + (m[0][1] * m[1][2] - m[0][2] * m[1][1]) * t[2]) *
          inverse,
      (c1 * t[0] + (m[0][0] * m[2][2] - m[0][2] * m[2][0]) * t[1] + (m[0][2] * m[1][0] - m[0][0] * m[1][2]) * t[2]) *
          inverse,
      (c2 * t[0] + (m[0][1] * m[2][0] - m[0][0] * m[2][1]) * t[1] + (m[0][0] * m[1][1] - m[0][1] * m[1][0]) * t[2]) *
          inverse};
  constexpr double kHuge = 1e300;
  if (abs_of(eye[0]) < kHuge && abs_of(eye[1]) < kHuge && abs_of(eye[2]) < kHuge) {
    for (int i = 0; i < 3; ++i) out[i] = eye[i];
  }
  return determinant < 0;
}

/// The rows of a Transform, exact or rounded.
template <class Real>
struct TransformRows {
  const Real* x;
  const Real* y;
  const Real* w;
};
SCREE_HD inline TransformRows<float> rows_of(const Transform& transform, float) {
  return {transform.x, transform.y, transform.w};
}
SCREE_HD inline TransformRows<double> rows_of(const Transform& transform, double) {
  return {transform.exact_x, transform.exact_y, transform.exact_w};
}

/// A box in the coordinates of a Transform: d of lattice coordinates or float32 positions.
template <class Real>
struct TransformBox {
  Real center[3];
  Real extent[3];  // half sides, >= 0
};
using RelativeBox = TransformBox<double>;
/// In single precision the error of a number is at most 3 * 2^-24 of center + extent, which are magnitudes here.
/// GeForce cards compute doubles at 1/64 of the rate, and a frame tests hundreds of thousands of boxes.
using RoundedBox = TransformBox<float>;

/// The transform of positions on the lattice of `exponent`, or of float32 positions.
SCREE_HD inline Transform make_transform(const FrameView& view, const format::MatrixRecord& matrix, int32_t exponent,
                                         bool float32) {
  Transform out;
  out.error_x = out.error_y = out.error_w = 0;
  double eye[3];
  out.mirrored = object_space_eye(view, matrix, eye);
  const double step = float32 ? 1.0 : format::exp2i(exponent);
  double origin[3];  // the point that d is relative to, object space
  for (int i = 0; i < 3; ++i) {
    out.reference[i] = 0;
    out.center[i] = 0;
    if (float32) {
      out.center[i] = abs_of(eye[i]) < 3e38 ? static_cast<float>(eye[i]) : 0.0f;
      origin[i] = static_cast<double>(out.center[i]);
    } else {
      const double nearest = std::floor(eye[i] / step + 0.5);
      const double clamped = min_of(max_of(nearest, -kReferenceLimit), kReferenceLimit);
      out.reference[i] = static_cast<int64_t>(clamped);
      origin[i] = clamped * step;
    }
  }
  // World-space offset of `origin` from the eye. The eye is subtracted from the translation first. For a scene far from
  // the world's origin that difference is exact, so the picture is that of the same scene at the origin.
  double offset[3];
  for (int i = 0; i < 3; ++i) {
    offset[i] = (matrix.rows[i][0] * origin[0] + matrix.rows[i][1] * origin[1] + matrix.rows[i][2] * origin[2]) +
                (matrix.rows[i][3] - view.eye[i]);
  }
  const double* rows[3] = {view.row_x, view.row_y, view.row_w};
  double* exact[3] = {out.exact_x, out.exact_y, out.exact_w};
  float* rounded[3] = {out.x, out.y, out.w};
  for (int r = 0; r < 3; ++r) {
    for (int j = 0; j < 3; ++j) {
      exact[r][j] =
          (rows[r][0] * matrix.rows[0][j] + rows[r][1] * matrix.rows[1][j] + rows[r][2] * matrix.rows[2][j]) * step;
    }
    exact[r][3] = rows[r][0] * offset[0] + rows[r][1] * offset[1] + rows[r][2] * offset[2];
    if (r == 2) exact[r][3] = exact[r][3] + view.offset_w;
    for (int j = 0; j < 4; ++j) rounded[r][j] = static_cast<float>(exact[r][j]);
  }
  return out;
}

/// Bounds of the single-precision errors of x, y and w.
struct TransformError {
  float x;
  float y;
  float w;
};

/// For the vertices of a box: 2^-21 of the largest sum of terms, which has five roundings of 2^-24. These leave three
/// of eight units of 2^-24, far more than the error of the sum of terms from a RoundedBox.
template <class Real>
SCREE_HD inline TransformError error_of(const Transform& transform, const TransformBox<Real>& box) {
  const TransformRows<Real> of = rows_of(transform, Real{});
  const Real* const rows[3] = {of.x, of.y, of.w};
  float errors[3];
  for (int r = 0; r < 3; ++r) {
    Real terms = abs_of(rows[r][3]);
    for (int i = 0; i < 3; ++i) terms += abs_of(rows[r][i]) * (abs_of(box.center[i]) + box.extent[i]);
    errors[r] = static_cast<float>(terms * (Real{1} / (1 << 21)));
  }
  return {errors[0], errors[1], errors[2]};
}

SCREE_HD inline void set_error(Transform& transform, const RelativeBox& box) {
  const TransformError error = error_of(transform, box);
  transform.error_x = error.x;
  transform.error_y = error.y;
  transform.error_w = error.w;
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
