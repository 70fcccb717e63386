// Elements of a glTF document, parsed by tinygltf.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "format/result.h"
#include "tools/gltf/document.h"
#include "tools/gltf/json.h"

namespace scree::convert {

/// Joins tinygltf's messages, which are lists of lines, into one line.
std::string one_line(std::string text);

/// Adds the elements of `batch`, a document of one section, to `document`. `primitive_indices`: the accessors of
/// "indices" by primitive, which are hidden from tinygltf. Errors kFormat.
Result<void> add_elements(const std::string& batch, std::span<const int32_t> primitive_indices, GltfDocument& document);

/// Reads the version and the copyright. Errors kFormat, kVersion.
Result<void> read_asset(GltfDocument& document, JsonRange range);

}  // namespace scree::convert
