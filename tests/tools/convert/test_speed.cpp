// The speed of convert, and its memory in the same run.
#include <filesystem>
#include <string>

#include "tests/speed.h"
#include "tests/tools/run_program.h"

#ifdef NDEBUG

using namespace scree;

TEST_CASE("speed: convert packs 8 M triangles per second and core, in bounded memory", "[speed]") {
  // Runs the program as users do, including its start and end, on the measured terrain with a hundredth of its
  // triangles. The input was just written, so it is read from the page cache.
  const tests::TempFolder folder;
  const std::string input = folder.file("scene.gltf");
  tests::must_run({"synth", "A", "--scale", "0.01", "-o", input}, folder.file("log"));
  const double triangles = static_cast<double>(std::filesystem::file_size(folder.file("scene.bin"))) / 18;
  REQUIRE(triangles > 3.9e6);
  const std::string encoding = GENERATE("indexed", "clustered");
  INFO(encoding);
  tests::check_speed(8, triangles / 8e6, [&] {
    const tests::ProgramRun run =
        tests::run_program({"convert", input, "--threads", "1", "--encoding", encoding}, folder.file("log"));
    UNSCOPED_INFO(run.output);
    REQUIRE(run.exit_code == 0);
    CHECK(tests::stated_peak(run.output) <=
          tests::convert_memory_bound(1, std::filesystem::file_size(folder.file("scene.gltf"))));
    return run.seconds;
  });
}

#endif
