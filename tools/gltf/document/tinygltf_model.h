// Elements of a glTF document, parsed by tinygltf.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "format/result.h"
#include "tools/gltf/document/document.h"
#include "tools/gltf/document/json.h"

namespace scree::convert {

/// Joins tinygltf's messages, which are lists of lines, into one line.
std::string one_line(std::string text);

/// Elements that are parsed, but not part of a document yet.
class ParsedElements {
 public:
  /// Parses `batch`, a document of one section. `primitive_indices`: the accessors of "indices" by primitive, which are
  /// hidden from tinygltf. Several threads may parse at the same time. Errors kFormat.
  static Result<ParsedElements> parse(const std::string& batch, std::vector<int32_t> primitive_indices);

  void add_to(GltfDocument& document) const;

 private:
  struct Impl;
  std::shared_ptr<const Impl> impl_;
};

/// Reads the version and the copyright. Errors kFormat, kVersion.
Result<void> read_asset(GltfDocument& document, JsonRange range);

}  // namespace scree::convert
