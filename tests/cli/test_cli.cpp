// The command line: every *.cli file beside this one is a list of commands with their expected output and exit code.
//
//   $ scree convert missing.gltf     run by sh in an empty folder; `scree`: the program built here, $DATA: tests/data
//   exit 2                           its exit code (0 if no line gives one)
//   err missing.gltf                 stderr contains the text
//   out 12 triangles                 stdout contains the text
//   errlines 1                       number of lines on stderr
//   absent out.scree                 no such file afterwards
//   exists out.scree                 such a file afterwards
#include <sys/wait.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "tests/models.h"
#include "tests/tools/temp_folder.h"

namespace {

namespace fs = std::filesystem;

struct Expectation {
  std::string verb, text;
};

struct Step {
  size_t line = 0;
  std::string command;
  std::vector<Expectation> expected;
};

std::vector<Step> parse_steps(const fs::path& path) {
  std::vector<Step> steps;
  std::ifstream in(path);
  std::string line;
  for (size_t number = 1; std::getline(in, line); ++number) {
    if (line.empty() || line[0] == '#') continue;
    if (line.starts_with("$ ")) {
      steps.push_back({number, line.substr(2), {}});
      continue;
    }
    const size_t space = line.find(' ');
    REQUIRE(!steps.empty());
    REQUIRE(space != std::string::npos);
    steps.back().expected.push_back({line.substr(0, space), line.substr(space + 1)});
  }
  return steps;
}

void run_step(const Step& step, const fs::path& folder) {
  const fs::path out = folder / ".stdout", err = folder / ".stderr";
  // Looking for leaks takes a third of a short command's time. Other tests do it.
  const std::string script = "export ASAN_OPTIONS=detect_leaks=0 && cd '" + folder.string() + "' && PATH='" +
                             fs::path(scree::tests::kProgram).parent_path().string() + "':'" +
                             fs::path(scree::tests::kLabProgram).parent_path().string() + "':\"$PATH\" DATA='" +
                             scree::tests::kDataFolder + "' && export PATH DATA && { " + step.command + "\n} >'" +
                             out.string() + "' 2>'" + err.string() + "' </dev/null";
  const int status = std::system(script.c_str());
  const std::string out_text = scree::tests::read_whole(out.string());
  const std::string err_text = scree::tests::read_whole(err.string());
  INFO("line " << step.line << ": " << step.command << "\nstdout: " << out_text << "\nstderr: " << err_text);
  REQUIRE(WIFEXITED(status));
  int expected_exit = 0;
  for (const Expectation& expected : step.expected) {
    INFO("expected: " << expected.verb << " " << expected.text);
    if (expected.verb == "exit") {
      expected_exit = std::stoi(expected.text);
    } else if (expected.verb == "out") {
      CHECK(out_text.find(expected.text) != std::string::npos);
    } else if (expected.verb == "err") {
      CHECK(err_text.find(expected.text) != std::string::npos);
    } else if (expected.verb == "errlines") {
      CHECK(std::count(err_text.begin(), err_text.end(), '\n') == std::stoi(expected.text));
    } else if (expected.verb == "exists") {
      CHECK(fs::exists(folder / expected.text));
    } else if (expected.verb == "absent") {
      CHECK_FALSE(fs::exists(folder / expected.text));
    } else {
      FAIL("unknown expectation " << expected.verb);
    }
  }
  CHECK(WEXITSTATUS(status) == expected_exit);
}

}  // namespace

TEST_CASE("the command line passes the scripts of tests/cli", "[cli]") {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(scree::tests::kCliFolder))
    if (entry.path().extension() == ".cli") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  REQUIRE(!files.empty());
  for (const fs::path& file : files) {
    DYNAMIC_SECTION(file.stem().string()) {
      const scree::tests::TempFolder folder;
      for (const Step& step : parse_steps(file)) run_step(step, folder.path());
    }
  }
}
