// `scree inspect` shows the content of a file, the size of each part and of the error, and checks every byte.
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
  uint32_t threads = 0;        // for --verify; 0: one per core
  bool progress = false;       // for --verify, on stderr if that is a terminal
  std::string source{};        // a .gltf or .glb from which the true position error is measured
  std::string exclude{};       // ImportOptions::exclude of that import
  bool allow_outside = false;  // ImportOptions::allow_outside of that import
};

/// Prints the report to `out`. Errors: kFile; those of Container::open; the first failure of verify(), after all of
/// them are printed. With a source: errors of import_gltf and compare_geometry, and kRange, after everything is
/// printed, if the error of a mesh exceeds its stated bound, or triangles are missing.
Result<void> inspect_file(const std::string& path, const InspectOptions& options, std::FILE* out);

}  // namespace scree::inspect
