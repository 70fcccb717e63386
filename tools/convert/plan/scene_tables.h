// The tables of the output that hold no geometry: nodes, world matrices, instances, scenes, cameras, materials,
// textures.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/convert/windows/measure.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// The most instances of a file, over all scenes. Without a limit, a document of a few bytes could demand more than any
/// memory.
inline constexpr uint64_t kMaxInstances = uint64_t{1} << 28;

/// The most node instances whose world matrices are held and compared. Further ones are neither.
inline constexpr uint64_t kMaxHeldInstances = uint64_t{1} << 18;

/// Data that write_nodes needs beside the nodes: the world matrices and the instances of a file. Only the matrices of
/// ordinary nodes and of the first kMaxHeldInstances node instances are held.
struct InstancePlan {
  struct Node {
    uint64_t first =
        UINT64_MAX;  // first of its matrices: in matrix_of or, for a streamed node, in the table; unset: not drawn
    bool is_streamed = false;
  };
  struct Stream {
    uint32_t node = 0;  // the first node that has these matrices
    format::MatrixRecord world{};
  };
  std::vector<format::MatrixRecord> matrices;  // each once
  std::vector<uint32_t> matrix_of;             // indices in `matrices`
  std::vector<Node> nodes;                     // in the order of SourceScene::nodes
  std::vector<Stream> streams;                 // after `matrices` in the table, in this order
  std::vector<uint32_t> by_group;              // nodes with a group, sorted by group, then number
  std::vector<uint64_t> first_of_group;        // by group: its first index in by_group; then the end of the last group
  std::vector<SourceSceneRoots> scenes;
};

/// Fills scenes, roots and cameras of `tables`, which already has meshes and groups, and plans the rest. A document
/// without scenes gets one scene with all root nodes. Errors kRange: a world matrix that is not finite; kUnsupported:
/// more than kMaxInstances; errors of read_instances.
Result<InstancePlan> plan_scenes(const SourceScene& scene, format::TableSet& tables);

/// Writes nodes, node instances, matrices and instances, after the last page, and adds the nodes' names to `tables`.
/// Errors kFile, and errors of read_instances.
Result<void> write_nodes(const SourceScene& scene, const InstancePlan& plan, format::TableSet& tables,
                         format::ContainerWriter& writer);

/// The new indices of materials, textures and images that the kept meshes need; kNone for the others.
struct MaterialUse {
  std::vector<uint32_t> materials;
  std::vector<uint32_t> textures;
  std::vector<uint32_t> images;
};

/// Flags for the materials of primitives that keep a triangle. `measured`: by primitive.
std::vector<bool> materials_used(const SourceScene& scene, std::span<const Measured> measured);

/// The same before measuring, if the document alone determines it: every triangle of a list is kept, unless
/// `drop_nonfinite` may drop it. `wanted`: by primitive.
std::optional<std::vector<bool>> materials_known(const SourceScene& scene, const std::vector<bool>& wanted,
                                                 bool drop_nonfinite);

/// `materials_used`: a flag per entry of SourceScene::materials.
MaterialUse find_material_use(const SourceScene& scene, const std::vector<bool>& materials_used);

/// Fills materials and textures. `image_places`: by image of SourceScene::images, its record.
void add_materials(const SourceScene& scene, const MaterialUse& use, const std::vector<uint32_t>& image_places,
                   format::TableSet& tables);

/// Calls `take` with the world matrices of all instances of a group's nodes that are drawn by some scene. Errors of
/// read_instances.
Result<void> visit_world_matrices(const SourceScene& scene, const InstancePlan& plan, uint32_t group,
                                  const std::function<void(const format::MatrixRecord&)>& take);

/// For each mesh of `tables`: the smallest mesh number with which it must share one lattice step so that all meshes
/// under one world matrix have the same step. All meshes share one step if some matrices are not held, since these
/// cannot be compared.
std::vector<uint32_t> meshes_sharing_matrices(const InstancePlan& plan, const SourceScene& scene,
                                              const format::TableSet& tables);

}  // namespace scree::convert
