// The nodes of a document that are kept, and their order.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "format/result.h"
#include "tools/gltf/buffers.h"
#include "tools/gltf/document/document.h"
#include "tools/gltf/source.h"

namespace scree::convert {

struct NodePlan {
  std::vector<uint32_t>
      order;  // document numbers of the kept nodes: parents before children, otherwise as in the document
  std::vector<uint32_t> place;           // by document number: index in `order`, or format::kNone
  std::vector<uint32_t> parent;          // by document number: the parent's document number, or format::kNone
  std::vector<SourceSceneRoots> scenes;  // roots are indices in `order`
  uint64_t excluded = 0;
  uint64_t outside = 0;        // nodes that are in no scene
  bool implied_scene = false;  // the document has no scene; its root nodes make one
};

/// Checks the node trees and scenes. Picks the nodes that some scene draws and that `options.exclude` (a regular
/// expression, or empty) does not match. Errors kUsage (the expression), kRange: a missing node, mesh, camera or skin, a
/// node with two parents, a cycle, a scene root that has a parent; kFile: stopped.
Result<NodePlan> plan_nodes(const GltfDocument& document, const ImportOptions& options);

/// The kept nodes as SourceNodes. `group`: by document mesh, its index in SourceScene::groups or format::kNone. Reads
/// the instances of EXT_mesh_gpu_instancing. Errors kRange (a transform that is not finite, unequal counts), kFormat,
/// and those of GltfBuffers.
Result<std::vector<SourceNode>> make_nodes(const GltfDocument& document, const NodePlan& plan,
                                           const std::vector<uint32_t>& group, GltfBuffers& buffers);

}  // namespace scree::convert
