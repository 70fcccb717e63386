// The Khronos glTF validator over a folder of exports.
#pragma once

#include <filesystem>
#include <string>

namespace scree::tests {

struct ValidatorRun {
  bool ran = false;  // false: node or the npm package is missing; `output` says what
  int exit_code = 0;
  std::string output;
};

/// Validates every .gltf and .glb below `folder` in one node process (tests/validator/validate.mjs; `npm ci` there
/// installs the package, as scripts/test does). Exit code 1: some file has errors, which the output names.
ValidatorRun run_validator(const std::filesystem::path& folder);

/// What a test does with a run that did not happen: fails where SCREE_REQUIRE_VALIDATOR is 1 (as in CI), else warns.
/// True where there is a result to look at.
bool validator_result_is_there(const ValidatorRun& run);

}  // namespace scree::tests
