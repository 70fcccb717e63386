// What a source has more than once is stored once: materials and textures become references to the first equal one,
// glTF meshes instances of it.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "tools/common/content_hash.h"
#include "tools/convert/windows/measure.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// Flags for SourceScene::primitives: those of `wanted` whose glTF mesh has as many primitives, triangles and
/// attributes as another one. Only their content need be hashed to find equal meshes.
std::vector<bool> may_repeat(const SourceScene& scene, const std::vector<bool>& wanted);

struct MergedMaterials {
  uint64_t textures = 0;
  uint64_t materials = 0;
};

/// Makes whatever refers to a material or texture refer to the first one that is equal: in name, all values, and the
/// image's record (`image_places`, as ImagePlan::places), so that equal images count as one. Counted are those of
/// `materials_used`.
MergedMaterials merge_materials(SourceScene& scene, const std::vector<bool>& materials_used,
                                const std::vector<uint32_t>& image_places);

/// Finds equal groups one after the other.
class EqualGroups {
 public:
  /// The first of `group` and the groups asked for before whose measured primitives are the same, one by one:
  /// triangles, vertices, attributes, materials (merged before). Itself where there is none, or where nothing of it is
  /// kept. `first_primitive`: of the group; `measured`: as SourceScene::primitives, those of the group known.
  uint32_t find_first(const SourceScene& scene, const std::vector<Measured>& measured, uint32_t group,
                      size_t first_primitive);

 private:
  std::map<ContentHash, uint32_t> known_;
};

/// EqualGroups for each of SourceScene::groups.
std::vector<uint32_t> find_equal_groups(const SourceScene& scene, const Measurement& measurement);

}  // namespace scree::convert
