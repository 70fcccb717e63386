// Materials, textures and images that the kept primitives use.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "format/result.h"
#include "tools/gltf/buffers.h"
#include "tools/gltf/document/document.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// Materials by document number.
struct MaterialPlan {
  std::vector<uint32_t> place;                   // index in SourceScene::materials, or format::kNone
  std::vector<std::array<uint32_t, 2>> uv_sets;  // sets of texture coordinates that its textures use, or format::kNone
};

/// Adds the materials marked in `used` (by document number), in the document's order, with their textures and images,
/// to `scene`. Also adds the warnings, and counts the parts that are left out. Opens only images that materials use.
/// The format of an image is found by its first bytes. Images in formats that scree cannot read are left out with a
/// warning, as are, with `keep_going`, images that cannot be opened. Errors kRange, kFormat and those of GltfBuffers.
Result<MaterialPlan> make_materials(const GltfDocument& document, const std::vector<bool>& used, GltfBuffers& buffers,
                                    bool keep_going, SourceScene& scene);

}  // namespace scree::convert
