// Loads scenes for a test.
#pragma once

#include <string>

#include "runtime/scene/camera.h"
#include "runtime/scene/scene.h"
#include "tests/paths.h"
#include "tests/runtime/small_scene.h"

namespace scree::tests {

/// Scene 0 of a .scree file. The test fails if it cannot be loaded.
inline runtime::Scene must_load(const std::string& path, const runtime::SceneOptions& options = {.threads = 2}) {
  return must(runtime::Scene::open(path, options));
}

/// The same for a temporary file.
inline runtime::Scene must_load(const SmallScene& small) {
  const ScratchPath path("small.scree");
  small.write(path.string());
  return must_load(path.string());
}

/// The view of a scene by `camera`. The test fails if there is none.
inline kernels::View must_view(const runtime::Scene& scene, const runtime::CameraOptions& camera) {
  return must(runtime::make_view(scene, camera));
}

}  // namespace scree::tests
