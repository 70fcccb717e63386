// Checks every reference between the records of a document, and every range, before any file is opened.
#pragma once

#include <cstdint>

#include "format/result.h"
#include "tools/gltf/document/document.h"

namespace scree::convert {

/// Bytes of a component of glTF's component type; 0 for an unknown type.
uint32_t component_bytes(int32_t type);

/// The most elements of an accessor without data, whose values are all zero. Such an accessor takes no bytes of the
/// file, so a malicious file can state any count. Real files use them as bases of sparse accessors.
inline constexpr uint64_t kMaxZeroElements = uint64_t{1} << 24;
Result<void> check_zeros(uint64_t count);

/// Checks that buffer views lie in their buffers (as declared), that accessors lie in their views, and that all records
/// named by meshes, nodes, materials, textures and images exist. Checks the whole document, including parts that are
/// not drawn: if a file is broken in one place, its other parts are not trusted either. plan_nodes() checks the nodes'
/// trees; skins and animations are not checked. Errors kRange, kFormat: "accessor 3: 24 elements of 12 bytes at 0,
/// stride 12, pass the end of buffer view 1 (280 bytes)".
Result<void> check_document(const GltfDocument& document);

}  // namespace scree::convert
