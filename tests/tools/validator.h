// Runs the Khronos glTF validator over a folder of exports.
#pragma once

#include <filesystem>
#include <string>

namespace scree::tests {

struct ValidatorRun {
  bool ran = false;  // false: node or the npm package is missing; `output` gives the reason
  int exit_code = 0;
  std::string output;
};

/// Validates every .gltf and .glb below `folder` in one node process (tests/validator/validate.mjs; `npm ci` there
/// installs the package, as in scripts/test). Exit code 1: some file has errors, which the output lists.
ValidatorRun run_validator(const std::filesystem::path& folder);

/// Handles a validation that did not run: fails if SCREE_REQUIRE_VALIDATOR is 1 (as in CI), else warns. Returns true if
/// it did run.
bool validator_result_is_there(const ValidatorRun& run);

}  // namespace scree::tests
