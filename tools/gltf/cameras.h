// The cameras and lights of a document.
#pragma once

#include "format/result.h"
#include "tools/gltf/document/document.h"
#include "tools/gltf/nodes.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// Adds all cameras. Error kRange: a camera whose view is empty.
Result<void> make_cameras(const GltfDocument& document, SourceScene& scene);

/// Adds a light for every kept node that has one. Error kRange: an unknown type, a negative or infinite value, a cone
/// that is none.
Result<void> make_lights(const GltfDocument& document, const NodePlan& plan, SourceScene& scene);

}  // namespace scree::convert
