// Locations of the tests' inputs.
#pragma once

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/catch.h"
#include "tests/paths.h"

namespace scree::tests {

/// A file of tests/data (in the repository).
inline std::filesystem::path data_path(const char* name) {
  return std::filesystem::path(kDataFolder) / name;
}

/// The folder of real models beside the checkout (scenes/, jpeg/, bad/), or empty if it does not exist.
inline std::filesystem::path models_path() {
  const std::filesystem::path path = std::filesystem::path(kModelsFolder) / "models";
  return std::filesystem::exists(path) ? path : std::filesystem::path{};
}

/// The folder or file `name` of the real models. If it does not exist: empty, with a WARN, and the test should return.
inline std::filesystem::path real_models(const char* name) {
  const std::filesystem::path path = std::filesystem::path(kModelsFolder) / "models" / name;
  if (std::filesystem::exists(path)) return path;
  WARN("skipped: no real models of " << name);
  return {};
}

/// All files in and below `root`, sorted; empty if it does not exist.
inline std::vector<std::filesystem::path> files_below(const std::filesystem::path& root) {
  std::vector<std::filesystem::path> files;
  if (!std::filesystem::exists(root)) return files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(root))
    if (entry.is_regular_file()) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

/// The .gltf and .glb files below `root`.
inline std::vector<std::filesystem::path> model_files(const std::filesystem::path& root) {
  std::vector<std::filesystem::path> files = files_below(root);
  std::erase_if(files, [](const std::filesystem::path& file) {
    const std::string extension = file.extension().string();
    return extension != ".gltf" && extension != ".glb";
  });
  return files;
}

}  // namespace scree::tests
