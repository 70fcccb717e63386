// Everything of the output but the geometry: nodes, world matrices, instances, scenes, cameras, materials, textures.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// Instances of one file, all scenes together: a document of a few bytes can multiply its way to more than any memory.
inline constexpr uint64_t kMaxInstances = uint64_t{1} << 28;

/// World matrices of more node instances than these are neither held nor compared with others.
inline constexpr uint64_t kMaxHeldInstances = uint64_t{1} << 18;

/// What write_nodes writes beside the nodes: the world matrices and the instances of a file, of which only those of
/// ordinary nodes and of the first kMaxHeldInstances node instances are held.
struct InstancePlan {
  struct Node {
    uint64_t first =
        UINT64_MAX;  // of its matrices: in matrix_of or, of a streamed node, in the table; unset: not drawn
    bool is_streamed = false;
  };
  struct Stream {
    uint32_t node = 0;  // the first that has these matrices
    format::MatrixRecord world{};
  };
  std::vector<format::MatrixRecord> matrices;  // each once
  std::vector<uint32_t> matrix_of;             // places in `matrices`
  std::vector<Node> nodes;                     // as SourceScene::nodes
  std::vector<Stream> streams;                 // behind `matrices` in the table, in this order
  std::vector<uint32_t> by_group;              // nodes with a group, sorted by group, then number
  std::vector<uint64_t> first_of_group;        // in by_group; one more than there are groups
  std::vector<SourceSceneRoots> scenes;
};

/// Fills scenes, roots and cameras of `tables`, whose meshes and groups are there already, and plans the rest. A
/// document without scenes gets one of all root nodes. Errors kRange: a world matrix that is not finite; kUnsupported:
/// more than kMaxInstances; those of read_instances.
Result<InstancePlan> plan_scenes(const SourceScene& scene, format::TableSet& tables);

/// Writes nodes, node instances, matrices and instances, after the last page, and adds the nodes' names to `tables`.
/// Errors kFile, and those of read_instances.
Result<void> write_nodes(const SourceScene& scene, const InstancePlan& plan, format::TableSet& tables,
                         format::ContainerWriter& writer);

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

/// Calls `take` for the world matrices of all instances of a group's nodes that some scene draws. Errors: those of
/// read_instances.
Result<void> visit_world_matrices(const SourceScene& scene, const InstancePlan& plan, uint32_t group,
                                  const std::function<void(const format::MatrixRecord&)>& take);

/// For each mesh of `tables`, the smallest mesh number with which it must share one lattice step so that all meshes
/// under one world matrix have the same. All of them, where some matrices are not held and so cannot be compared.
std::vector<uint32_t> meshes_sharing_matrices(const InstancePlan& plan, const SourceScene& scene,
                                              const format::TableSet& tables);

}  // namespace scree::convert
