// What programs read of a picture beside its colours: depth, triangle and instance of every pixel.
#pragma once

#include "kernels/frame.h"
#include "kernels/raster/depth.h"
#include "kernels/shade/locate.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// Distance from the eye's plane (perspective) or eye plane (orthographic) in world units at a depth code's centre;
/// infinity for the background.
SCREE_HD inline double distance_of_code(uint32_t code, bool orthographic, double z_near, double z_far) {
  if (code >= kFarthestDepthCode) return static_cast<double>(bits_float(0x7f800000u));
  const double value = depth_value_of_code(code, orthographic);
  return orthographic ? z_far - value * (z_far - z_near) : z_near / value;
}

/// Layers of pixels, row by row from the top. A pixel shows its nearest sample. One pointer at least is not null.
struct LayerTargets {
  float* depth;       // distance_of_code(), infinity on the background
  int64_t* triangle;  // global id, -1 on the background
  int32_t* instance;  // index in SceneView::instances (2^31 at most), -1 on the background
};

/// An item is kPixels pixels of a row of all pixels.
struct MakeLayers {
  static constexpr uint32_t kPixels = 128;

  const uint64_t* instance_base;  // of SceneView
  uint64_t instance_count;
  const uint64_t* samples;
  uint32_t width;  // pixels
  uint32_t height;
  uint32_t samples_per_side;
  bool orthographic;
  double z_near;
  double z_far;
  LayerTargets out;

  uint32_t items() const { return static_cast<uint32_t>((uint64_t{width} * height + kPixels - 1) / kPixels); }

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    const uint64_t first = uint64_t{item} * kPixels;
    const uint64_t end = min_of(first + kPixels, uint64_t{width} * height);
    for (uint64_t i = first + team.rank(); i < end; i += team.size()) set(i);
  }

 private:
  SCREE_HD void set(uint64_t pixel) const {
    const uint64_t x = pixel % width * samples_per_side;
    const uint64_t y = pixel / width * samples_per_side;
    const uint64_t row = uint64_t{width} * samples_per_side;
    uint64_t nearest = kBackground;  // the smallest code is the nearest
    for (uint64_t j = 0; j < samples_per_side; ++j) {
      for (uint64_t i = 0; i < samples_per_side; ++i) nearest = min_of(nearest, samples[(y + j) * row + x + i]);
    }
    const bool is_background = nearest == kBackground;
    const uint64_t id = sample_id(nearest);
    if (out.depth != nullptr)
      out.depth[pixel] = static_cast<float>(distance_of_code(
          is_background ? kFarthestDepthCode : sample_depth_code(nearest), orthographic, z_near, z_far));
    if (out.triangle != nullptr) out.triangle[pixel] = is_background ? -1 : static_cast<int64_t>(id);
    if (out.instance != nullptr)
      out.instance[pixel] =
          is_background ? -1 : static_cast<int32_t>(last_not_above(instance_count, id, InstanceBases{instance_base}));
  }
};

/// `view` and `samples` as of the whole picture, in samples.
inline MakeLayers make_layers(const SceneView& scene, const View& view, uint32_t samples_per_side,
                              const uint64_t* samples, const LayerTargets& out) {
  return {scene.instance_base,
          scene.instance_count,
          samples,
          view.width / samples_per_side,
          view.height / samples_per_side,
          samples_per_side,
          view.orthographic,
          view.z_near,
          view.z_far,
          out};
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
