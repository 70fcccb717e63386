// Runs `scree render` within the test.
#pragma once

#include <string>
#include <vector>

#include "format/result.h"
#include "tools/common/options/command.h"

namespace scree::tests {

inline Result<void> run_render(std::vector<std::string> arguments) {
  CLI::App app("test", "scree");
  const tools::Command command = tools::add_render(app);
  arguments.insert(arguments.begin(), {"scree", "render"});
  std::vector<const char*> words;
  for (const std::string& argument : arguments) words.push_back(argument.c_str());
  app.parse(static_cast<int>(words.size()), words.data());
  return command.run();
}

}  // namespace scree::tests
