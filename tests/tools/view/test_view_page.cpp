// The page in a browser: tests/view/page.mjs, if Node.js, playwright-core and a Chromium are available.
#include <cstdlib>
#include <string>
#include <string_view>

#include <sys/wait.h>

#include "tests/models.h"
#include "tests/runtime/small_scene.h"
#include "tests/tools/convert/convert_fixture.h"

using namespace scree::tests;

TEST_CASE("the page of scree view works in a browser", "[view][view-page][release]") {
  const TempFolder folder;
  const std::string scene = folder.file("a scene's file.scree");
  SmallScene{}.write(scene);
  scree::convert::ConvertOptions sunny = options_of(folder, data_path("sun.glb"));
  must_convert(sunny);
  const std::string quoted = "'" + replaced(scene, "'", "'\\''") + "'";
  const std::string log = folder.file("log");
  const int status = std::system(("node '" + std::string(kViewPageFolder) + "/page.mjs' '" + kProgram + "' " + quoted +
                                  " '" + folder.path().string() + "' '" + sunny.output + "' >'" + log + "' 2>&1")
                                     .c_str());
  const std::string text = read_whole(log);
  const int code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  INFO(text);
  if (code == 77 || code == 127) {
    const char* const required = std::getenv("SCREE_REQUIRE_BROWSER");
    if (required != nullptr && std::string_view(required) == "1") FAIL("SCREE_REQUIRE_BROWSER is 1");
    WARN("the page is not tested: " << (code == 127 ? "node is not installed" : text));
    return;
  }
  CHECK(code == 0);
}
