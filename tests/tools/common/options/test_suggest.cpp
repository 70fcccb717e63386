#include "tools/common/options/suggest.h"

#include "tests/catch.h"

namespace {

/// The error for one wrong argument of `scree draw`.
std::string message_for(const char* word) {
  CLI::App app("test", "scree");
  CLI::App* draw = app.add_subcommand("draw", "");
  std::string size, camera;
  draw->add_option("--size", size, "");
  draw->add_option("--camera", camera, "");
  const char* arguments[] = {"scree", "draw", word};
  try {
    app.parse(3, arguments);
  } catch (const CLI::ParseError& error) {
    return scree::tools::describe_parse_error(*draw, error);
  }
  return "";
}

}  // namespace

TEST_CASE("an error for a mistyped option suggests the nearest option", "[suggest]") {
  CHECK(message_for("--sise") == "unknown option --sise; did you mean --size?");
  CHECK(message_for("--camra=3") == "unknown option --camra; did you mean --camera?");
  CHECK(message_for("--background") == "unknown option --background");
  CHECK(message_for("picture") == "unknown argument picture");
}
