// The clipping box of a view: which samples lie in it, and conservative tests of boxes of triangles. A sample's place
// is its ray and its depth code, so the test needs no triangle. Source: spec/rasterization.md, clipping box.
#pragma once

#include "kernels/frame.h"
#include "kernels/math.h"
#include "kernels/raster/depth.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// A view's clipping box over samples. (X, Y) is a sample's centre in half samples from the image's centre, Y downward,
/// and m the depth value of its code. Along axis k the sample is inside if
///   x X + y Y + (low_m m + low_one) >= 0   and   x X + y Y + (high_m m + high_one) <= 0.
/// In perspective both sums are world units times m, in orthographic views world units.
struct ClipBox {
  struct Axis {
    double x;
    double y;
    double low_m;
    double low_one;
    double high_m;
    double high_one;

    bool operator==(const Axis&) const = default;
  };
  Axis axis[3];
  bool is_set;  // false: there is no box

  bool operator==(const ClipBox&) const = default;
};

SCREE_HD inline ClipBox make_clip_box(const View& view) {
  ClipBox box{};
  box.is_set = view.clips;
  if (!view.clips) return box;
  const double scale = view.orthographic ? 1.0 : view.z_near;
  const double to_x = view.half_width / static_cast<double>(view.width) * scale;
  const double to_y = view.half_height / static_cast<double>(view.height) * scale;
  for (int k = 0; k < 3; ++k) {
    ClipBox::Axis& axis = box.axis[k];
    axis.x = view.right[k] * to_x;
    axis.y = view.up[k] * -to_y;
    const double low = view.eye[k] - view.clip_min[k];
    const double high = view.eye[k] - view.clip_max[k];
    if (view.orthographic) {
      axis.low_m = axis.high_m = view.forward[k] * (view.z_near - view.z_far);
      axis.low_one = low + view.forward[k] * view.z_far;
      axis.high_one = high + view.forward[k] * view.z_far;
    } else {
      axis.low_m = low;
      axis.high_m = high;
      axis.low_one = axis.high_one = view.forward[k] * view.z_near;
    }
  }
  return box;
}

/// Whether sample (x, y) of an image of `width` x `height`, with a depth code, lies in the box.
SCREE_HD inline bool is_in_clip_box(const ClipBox& box, int32_t width, int32_t height, bool orthographic, int32_t x,
                                    int32_t y, uint32_t code) {
  const auto at_x = static_cast<double>(2 * x + 1 - width);
  const auto at_y = static_cast<double>(2 * y + 1 - height);
  const double m = depth_value_of_code(code, orthographic);
  bool inside = true;
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
  for (int k = 0; k < 3; ++k) {
    const ClipBox::Axis& axis = box.axis[k];
    const double across = axis.x * at_x + axis.y * at_y;
    inside = inside & (across + (axis.low_m * m + axis.low_one) >= 0.0) &
             (across + (axis.high_m * m + axis.high_one) <= 0.0);
  }
  return inside;
}

/// False only if no sample of columns `first_x` to `last_x` and rows `first_y` to `last_y`, with a depth value between
/// `lowest` and `highest`, lies in the box. A sum has at most 8 roundings of 2^-24 of its terms; the slack is 2^-18.
/// Written so that NaN keeps the samples.
SCREE_HD inline bool samples_may_be_in_clip_box(const ClipBox& box, int32_t width, int32_t height, int32_t first_x,
                                                int32_t first_y, int32_t last_x, int32_t last_y, float lowest,
                                                float highest) {
  constexpr float kSlack = 1.0f / (1 << 18);
  const float left = static_cast<float>(2 * first_x + 1 - width);
  const float right = static_cast<float>(2 * last_x + 1 - width);
  const float top = static_cast<float>(2 * first_y + 1 - height);
  const float bottom = static_cast<float>(2 * last_y + 1 - height);
  const float farthest_x = max_of(abs_of(left), abs_of(right));
  const float farthest_y = max_of(abs_of(top), abs_of(bottom));
  for (int k = 0; k < 3; ++k) {
    const ClipBox::Axis& axis = box.axis[k];
    const auto x = static_cast<float>(axis.x);
    const auto y = static_cast<float>(axis.y);
    const float terms = abs_of(x) * farthest_x + abs_of(y) * farthest_y;
    const auto low_m = static_cast<float>(axis.low_m);
    const auto low_one = static_cast<float>(axis.low_one);
    const float largest =
        max_of(x * left, x * right) + max_of(y * top, y * bottom) + (max_of(low_m * lowest, low_m * highest) + low_one);
    if (largest < -kSlack * (terms + abs_of(low_m) * highest + abs_of(low_one))) return false;
    const auto high_m = static_cast<float>(axis.high_m);
    const auto high_one = static_cast<float>(axis.high_one);
    const float smallest = min_of(x * left, x * right) + min_of(y * top, y * bottom) +
                           (min_of(high_m * lowest, high_m * highest) + high_one);
    if (smallest > kSlack * (terms + abs_of(high_m) * highest + abs_of(high_one))) return false;
  }
  return true;
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
