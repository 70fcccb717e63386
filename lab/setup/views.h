// The viewpoints of the measured scenes.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "kernels/frame.h"
#include "tools/synth/scenes.h"

namespace scree::lab {

/// A camera with its name, for a picture of one sample per pixel.
struct NamedView {
  std::string name;
  std::vector<kernels::View> frames;  // one frame, or all frames of a path
};

inline constexpr uint32_t kPathFrames = 120;

/// The view of a measured scene's camera. `width`, `height` in samples. The near plane lies at 0.1, as in the files
/// that synth writes.
kernels::View scene_view(const synth::SceneCamera& camera, uint32_t width, uint32_t height);

/// The view with its near plane at `share` of the scene's diagonal, and a name that includes the share.
NamedView with_near(NamedView view, const kernels::SceneView& scene, double share);

/// The camera path of a scene: eye and target move linearly from its first view to its second, including both. In a
/// loop, the first frame shows the jump back.
std::vector<kernels::View> path_views(std::span<const synth::SceneCamera> cameras, uint32_t width, uint32_t height,
                                      uint32_t frames = kPathFrames);

}  // namespace scree::lab
