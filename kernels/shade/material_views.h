// Which textures of a material have their texels at the same places.
#pragma once

#include <span>

#include "kernels/scene_view.h"

namespace scree::kernels {

/// Sets the bundles of `materials`, SceneView::material_views with complete surfaces, from the scene's textures.
/// Textures without a picture are left out.
void bundle_textures(const SceneView& scene, std::span<MaterialView> materials);

}  // namespace scree::kernels
