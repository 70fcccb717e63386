// Stores repeated parts of a source once: materials and textures become references to the first equal one, glTF meshes
// become instances of it.
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "tools/common/content_hash.h"
#include "tools/convert/images/masks.h"
#include "tools/convert/windows/measure.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// By primitive of SourceScene::primitives: whether it is `wanted` and its glTF mesh has the same numbers of
/// primitives, triangles and attributes as another mesh. Only such primitives must be hashed to find equal meshes.
std::vector<bool> may_repeat(const SourceScene& scene, const std::vector<bool>& wanted);

struct MergedMaterials {
  uint64_t textures = 0;
  uint64_t materials = 0;
};

/// Redirects all references to a material or texture to the first equal one. Equal means: the name, all values, the
/// image's record (`image_places`, as ImagePlan::places), so that equal images count as one, and the planned mask,
/// which also depends on the triangles that use a material. The counts are over `materials_used`.
MergedMaterials merge_materials(SourceScene& scene, const std::vector<bool>& materials_used,
                                const std::vector<uint32_t>& image_places, const MaskPlan& masks);

/// Finds equal groups, one after another.
class EqualGroups {
 public:
  /// The first group, among the groups of earlier calls, whose measured primitives equal those of `group` in triangles,
  /// vertices, attributes and materials (merged before). Returns `group` itself if there is none, or if none of its
  /// triangles are kept. `first_primitive`: of the group. `measured`: as SourceScene::primitives, complete for the
  /// group.
  uint32_t find_first(const SourceScene& scene, const std::vector<Measured>& measured, uint32_t group,
                      size_t first_primitive);

 private:
  std::map<ContentHash, uint32_t> known_;
};

/// The first equal group of each of SourceScene::groups.
std::vector<uint32_t> find_equal_groups(const SourceScene& scene, const Measurement& measurement);

}  // namespace scree::convert
