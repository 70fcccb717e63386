#include "tests/tools/validator.h"
#include "tests/paths.h"

#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "tests/catch.h"

namespace scree::tests {
namespace {

std::string quoted(const std::string& word) {
  std::string text = "'";
  for (const char c : word) text += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return text + "'";
}

int run(const std::string& command, std::string& output) {
  std::FILE* pipe = popen((command + " 2>&1").c_str(), "r");
  if (pipe == nullptr) return 127;
  std::array<char, 4096> block;
  for (size_t got = 0; (got = std::fread(block.data(), 1, block.size(), pipe)) > 0;) output.append(block.data(), got);
  const int status = pclose(pipe);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128;
}

}  // namespace

ValidatorRun run_validator(const std::filesystem::path& folder) {
  ValidatorRun result;
  const std::filesystem::path place = tests::kValidatorFolder;
  if (!std::filesystem::exists(place / "node_modules" / "gltf-validator")) {
    result.output = "the npm package gltf-validator is not installed (npm ci --prefix tests/validator)";
    return result;
  }
  std::string version;
  if (run("node --version", version) != 0) {
    result.output = "node is not installed";
    return result;
  }
  result.ran = true;
  result.exit_code =
      run("node " + quoted((place / "validate.mjs").string()) + " " + quoted(folder.string()), result.output);
  return result;
}

bool validator_result_is_there(const ValidatorRun& run) {
  if (run.ran) return true;
  const char* required = std::getenv("SCREE_REQUIRE_VALIDATOR");
  if (required != nullptr && std::string_view(required) == "1")
    FAIL("SCREE_REQUIRE_VALIDATOR is 1, but " << run.output);
  WARN("exports are not validated: " << run.output);
  return false;
}

}  // namespace scree::tests
