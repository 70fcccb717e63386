// scree convert as a program: exit codes, messages, signals.
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <random>

#include "tests/tools/gltf/many_files.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/run_program.h"

using namespace scree;
using namespace scree::tests;

TEST_CASE("the convert command: exit codes, one line for an error, two for the result", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), {});
  std::ofstream(folder.file("bad.glb")) << "no glTF at all";
  const auto run = [&](std::vector<std::string> words, const std::string& expected) {
    words.insert(words.begin(), {"convert", "--force"});
    const int status = wait_for(start_program(words, folder.file("log")));
    const std::string log = tests::read_whole(folder.file("log"));
    INFO(log);
    CHECK(log.find(expected) != std::string::npos);
    if (log.find("as float32") == std::string::npos)  // the table of error bounds
      CHECK(std::count(log.begin(), log.end(), '\n') == (expected.empty() ? 0 : expected == "ratio" ? 2 : 1));
    REQUIRE(WIFEXITED(status));
    return WEXITSTATUS(status);
  };
  const std::string in = folder.file("in.glb");
  CHECK(run({in}, "ratio") == 0);
  CHECK(std::filesystem::exists(folder.file("in.scree")));  // the default name
  CHECK(run({in, "--max-error", "0.5mm", "--grid", "scene", "--order", "none", "--threads", "1"}, "ratio") == 0);
  CHECK(run({in, "-q"}, "") == 0);
  CHECK(run({in, "--positions", "7"}, "--positions") == 1);
  CHECK(run({in, "--positions", "float16"}, "float32") == 1);
  CHECK(run({in, "--max-error", "1 parsec"}, "--max-error") == 1);
  CHECK(run({in, "--max-error", "1mm", "--positions", "16"}, "exclude each other") == 1);
  CHECK(run({in, "--grid", "world"}, "--grid") == 1);
  CHECK(run({in, "--order", "lifo"}, "--order") == 1);
  CHECK(run({in, "--chunk-triangles", "65537"}, "--chunk-triangles") == 1);
  CHECK(run({in, "--zstd", "-1"}, "--zstd") == 1);
  CHECK(run({in, "--threads", "many"}, "--threads") == 1);
  CHECK(run({in, "--memory", "much"}, "--memory") == 1);
  CHECK(run({in, "--memory", "1MiB"}, "needs at least") == 1);
  CHECK(run({in, "--exclude", "("}, "--exclude") == 1);
  CHECK(run({in, "--positons", "16"}, "did you mean --positions?") == 1);
  CHECK(run({folder.file("none.glb")}, "none.glb") == 2);
  CHECK(run({folder.file("bad.glb")}, "bad.glb") == 3);
}

TEST_CASE("a signal ends the command, which removes its files", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), {.columns = 700, .rows = 400});
  // Level 22 takes seconds, so the signal arrives during the work.
  const pid_t child = start_program(
      {"convert", folder.file("in.glb"), "-o", folder.file("out.scree"), "--zstd", "22", "--threads", "1"},
      folder.file("log"));
  CHECK(tests::wait_until([&] { return std::filesystem::exists(folder.file("out.scree.part")); }));
  kill(child, SIGTERM);
  const int status = wait_for(child);
  REQUIRE(WIFSIGNALED(status));
  CHECK(WTERMSIG(status) == SIGTERM);
  CHECK(folder.names() == std::vector<std::string>{"in.glb", "log"});
}

TEST_CASE("convert: an input that is cut is an error, and one that is deleted is read to its end", "[convert]") {
  const TempFolder folder;
  const bool shrinks = GENERATE(true, false);
  tests::make_model(folder.file("in.gltf"), {.columns = 700, .rows = shrinks ? 2000u : 400u});
  folder.write("out.scree", "earlier");
  // Everything is measured, and the first of several windows is being encoded. With this level a window takes half a
  // second.
  const pid_t child = start_program(
      {"convert", folder.file("in.gltf"), "-o", folder.file("out.scree"), "--force", "--zstd", "16", "--threads", "1"},
      folder.file("log"));
  CHECK(tests::wait_until([&] { return std::filesystem::exists(folder.file("out.scree.part")); }));
  if (shrinks) {
    std::filesystem::resize_file(folder.file("in.bin"), 1000);
  } else {
    std::filesystem::remove(folder.file("in.bin"));  // the open file keeps its content
  }
  const int status = wait_for(child);
  const std::string log = tests::read_whole(folder.file("log"));
  INFO(log);
  REQUIRE(WIFEXITED(status));
  if (shrinks) {
    CHECK(WEXITSTATUS(status) == 3);
    CHECK(log.find("in.bin: ends at byte ") != std::string::npos);  // the position of the read, past the new end
    CHECK(log.find(" when it was opened") != std::string::npos);
    CHECK(std::count(log.begin(), log.end(), '\n') == 1);
    CHECK(tests::read_whole(folder.file("out.scree")) == "earlier");
    CHECK(folder.names() == std::vector<std::string>{"in.bin", "in.gltf", "log", "out.scree"});
  } else {
    CHECK(WEXITSTATUS(status) == 0);
    CHECK(folder.names() == std::vector<std::string>{"in.gltf", "log", "out.scree"});
  }
}

TEST_CASE("convert: a buffer file that is deleted or replaced meanwhile is an error when it is reopened", "[convert]") {
  const TempFolder folder;
  const bool is_replaced = GENERATE(true, false);
  // The windows of the first file come before the others and take a second. Meanwhile, once the .part shows that all
  // windows have been measured, a file is changed. It is the last one, which is not among the files that stay open.
  constexpr size_t kFiles = 600;
  std::mt19937 random(7);
  std::uniform_real_distribution<float> unit(0, 1);
  std::vector<std::vector<float>> points = tests::many_triangles(kFiles);
  points[0].clear();
  for (size_t i = 0; i < 9 * 600'000; ++i) points[0].push_back(unit(random));
  const std::string last = folder.file(std::to_string(kFiles - 1) + ".bin");
  const std::string input = tests::write_many_files(folder, points);
  folder.write("out.scree", "earlier");
  const pid_t child = start_program({"convert", input, "-o", folder.file("out.scree"), "--force", "--grid", "scene",
                                     "--positions", "12", "--zstd", "16", "--threads", "1", "--order", "none"},
                                    folder.file("log"));
  tests::wait_until([&] { return std::filesystem::exists(folder.file("out.scree.part")) || tests::has_ended(child); });
  if (is_replaced) {
    std::filesystem::copy_file(last, folder.file("copy"));
    std::filesystem::rename(folder.file("copy"), last);
  } else {
    std::filesystem::remove(last);
  }
  const int status = wait_for(child);
  const std::string log = tests::read_whole(folder.file("log"));
  INFO(log);
  REQUIRE(WIFEXITED(status));
  CHECK(WEXITSTATUS(status) == 2);
  CHECK(log.starts_with("scree convert: "));
  CHECK(log.ends_with("599.bin: " + std::string(is_replaced ? "was replaced by another file while it was being read\n"
                                                            : "No such file or directory\n")));
  CHECK(std::count(log.begin(), log.end(), '\n') == 1);
  CHECK(tests::read_whole(folder.file("out.scree")) == "earlier");
  CHECK_FALSE(std::filesystem::exists(folder.file("out.scree.part")));
}

TEST_CASE("convert: progress on a terminal names the limiting stage", "[convert]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), {.columns = 700, .rows = 400});
  const int terminal = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  REQUIRE(terminal >= 0);
  REQUIRE(grantpt(terminal) == 0);
  REQUIRE(unlockpt(terminal) == 0);
  const pid_t child = start_program(
      {"convert", folder.file("in.glb"), "--zstd", "19", "--threads", "1", "--encoding", "indexed", "--stats"},
      ptsname(terminal));
  std::string shown;
  tests::wait_until([&] {
    const bool ended = tests::has_ended(child);
    char buffer[4096];
    for (ssize_t got; (got = read(terminal, buffer, sizeof buffer)) > 0;)
      shown.append(buffer, static_cast<size_t>(got));
    return ended;
  });
  const int status = wait_for(child);
  close(terminal);
  INFO(shown);
  REQUIRE(WIFEXITED(status));
  CHECK(WEXITSTATUS(status) == 0);
  CHECK(shown.find("\rencode: ") != std::string::npos);
  CHECK(shown.find("/s: encoding limits\x1b[K") != std::string::npos);
  const size_t last = shown.find("in.glb -> ");
  REQUIRE(last != std::string::npos);
  CHECK(shown.find(", write ", last) != std::string::npos);
  CHECK(shown.find(": encoding limits", last) != std::string::npos);
}
