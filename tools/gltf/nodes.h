// Which nodes of a document are kept, and in what order.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "format/result.h"
#include "tools/gltf/buffers.h"
#include "tools/gltf/document.h"
#include "tools/gltf/source.h"

namespace scree::convert {

struct NodePlan {
  std::vector<uint32_t> order;   // document numbers of the kept nodes, parents before children, else as in the document
  std::vector<uint32_t> place;   // by document number: where in `order`, or format::kNone
  std::vector<uint32_t> parent;  // by document number: document number of the parent, or format::kNone
  std::vector<SourceSceneRoots> scenes;  // roots are places in `order`
  uint64_t excluded = 0;
  uint64_t outside = 0;        // of every scene
  bool implied_scene = false;  // the document has none: its root nodes make one
};

/// Checks the node trees and scenes and picks the nodes that some scene draws and `exclude` (a regular expression, or
/// empty) does not match. Errors kUsage (the expression), kRange: a node, mesh, camera or skin that is not there, two
/// parents, a cycle, a scene root that is no root.
Result<NodePlan> plan_nodes(const GltfDocument& document, const std::string& exclude);

/// The kept nodes as SourceNodes; `group`: by document mesh, place in SourceScene::groups or format::kNone. Reads the
/// instances of EXT_mesh_gpu_instancing. Errors kRange (a transform that is not finite, unequal counts), kFormat, and
/// those of GltfBuffers.
Result<std::vector<SourceNode>> make_nodes(const GltfDocument& document, const NodePlan& plan,
                                           const std::vector<uint32_t>& group, GltfBuffers& buffers);

}  // namespace scree::convert
