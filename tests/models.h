// Locations of the tests' inputs.
#pragma once

#include <filesystem>

#include "tests/paths.h"

namespace scree::tests {

/// A file of tests/data (in the repository).
inline std::filesystem::path data_path(const char* name) {
  return std::filesystem::path(kDataFolder) / name;
}

/// The folder of real models beside the checkout (scenes/, jpeg/, bad/), or empty if it does not exist. Tests that need
/// it print a WARN and return.
inline std::filesystem::path models_path() {
  const std::filesystem::path path = std::filesystem::path(kModelsFolder) / "models";
  return std::filesystem::exists(path) ? path : std::filesystem::path{};
}

}  // namespace scree::tests
