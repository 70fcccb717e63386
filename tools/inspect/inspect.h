// `scree inspect`: what is in a file, what each part costs, how big the error is, and whether every byte is as written.
#pragma once

#include <cstdint>
#include <cstdio>
#include <string>

#include "format/result.h"

namespace scree::inspect {

struct InspectOptions {
  bool json = false;
  bool verify = false;
  bool chunks = false;
  uint32_t top = 10;           // meshes and images listed by name
  uint32_t threads = 0;        // of --verify; 0: one a core
  bool progress = false;       // of --verify, on stderr where that is a terminal
  std::string source{};        // a .gltf or .glb: measure the true position error against it
  std::string exclude{};       // ImportOptions::exclude of that import
  bool allow_outside = false;  // ImportOptions::allow_outside of that import
};

/// Prints the report to `out`. Errors kFile, and what Container::open and verify() find: the first failure, named with
/// the file, after all of them are printed. With a source: those of import_gltf and compare_geometry; kRange, after all
/// is printed, where a mesh is farther from its source than it states, or triangles are missing.
Result<void> inspect_file(const std::string& path, const InspectOptions& options, std::FILE* out);

}  // namespace scree::inspect
