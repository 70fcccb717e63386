// Everything of the output but the geometry: nodes, world matrices, instances, scenes, cameras, materials, textures.
#pragma once

#include <cstdint>
#include <vector>

#include "format/container.h"
#include "format/result.h"
#include "tools/convert/gltf_source.h"

namespace scree::convert {

/// Instances of one file, all scenes together: a document of a few bytes can multiply its way to more than any memory.
inline constexpr uint64_t kMaxInstances = uint64_t{1} << 28;

/// Fills nodes, node instances, world matrices (equal ones once), instances, scenes, roots and cameras of `tables`,
/// whose meshes and groups are there already. A document without scenes gets one of all root nodes. Errors kRange: a
/// world matrix that is not finite; kUnsupported: more than kMaxInstances.
Result<void> add_nodes_and_scenes(const SourceScene& scene, format::TableSet& tables);

/// Which materials, textures and images the kept meshes need: new places, or kNone for those that are left out.
struct MaterialUse {
  std::vector<uint32_t> materials;
  std::vector<uint32_t> textures;
  std::vector<uint32_t> images;
};

/// `materials_used`: a flag for each of SourceScene::materials.
MaterialUse find_material_use(const SourceScene& scene, const std::vector<bool>& materials_used);

/// Fills materials and textures; `image_places`: the record of each of SourceScene::images.
void add_materials(const SourceScene& scene, const MaterialUse& use, const std::vector<uint32_t>& image_places,
                   format::TableSet& tables);

/// For each mesh of `tables`, the smallest mesh number with which it must share one lattice step so that all meshes
/// under one world matrix have the same.
std::vector<uint32_t> meshes_sharing_matrices(const format::TableSet& tables);

}  // namespace scree::convert
