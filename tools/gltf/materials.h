// Materials, textures and images that the kept primitives use.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "format/result.h"
#include "tools/gltf/buffers.h"
#include "tools/gltf/document.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// By document number of a material.
struct MaterialPlan {
  std::vector<uint32_t> place;   // in SourceScene::materials, or format::kNone
  std::vector<uint32_t> uv_set;  // that its textures use, or format::kNone
};

/// Adds the materials marked in `used` (by document number), in the document's order, with their textures and images,
/// to `scene`, which also gets the warnings and what was left out. Only images that materials use are opened; formats
/// other than PNG and JPEG are told by their first bytes and left out with a warning. With
/// `keep_going` an image that cannot be opened is left out likewise. Errors kRange, kFormat and those of GltfBuffers.
Result<MaterialPlan> make_materials(const GltfDocument& document, const std::vector<bool>& used, GltfBuffers& buffers,
                                    bool keep_going, SourceScene& scene);

}  // namespace scree::convert
