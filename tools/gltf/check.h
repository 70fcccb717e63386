// Every reference between the records of a document, and every range, on paper: before any file is opened.
#pragma once

#include <cstdint>

#include "format/result.h"
#include "tools/gltf/document.h"

namespace scree::convert {

/// Bytes of a component of glTF's component type, 0 for a type glTF does not have.
uint32_t component_bytes(int32_t type);

/// Elements that an accessor without data, all zeros, has at most: it costs a file nothing, so its count could say
/// anything. Real ones are bases of sparse accessors.
inline constexpr uint64_t kMaxZeroElements = uint64_t{1} << 24;
Result<void> check_zeros(uint64_t count);

/// Checks that buffer views lie in their buffers (as declared), accessors in their views, and that whatever a mesh,
/// node, material, texture or image names is there. Holds for all of the document, drawn or not: a file that is broken
/// in one place is not trusted in another. Nodes' trees are plan_nodes()' business; skins and animations are not looked
/// into. Errors kRange, kFormat: "accessor 3: 24 elements of 12 bytes at 0, stride 12, pass the end of buffer view 1
/// (280 bytes)".
Result<void> check_document(const GltfDocument& document);

}  // namespace scree::convert
