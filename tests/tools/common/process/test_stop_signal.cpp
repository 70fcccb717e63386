// Commands that a signal stops: their files, their output, and the time until they end.
#include <sys/wait.h>

#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <unistd.h>

#include "format/container/part_file.h"
#include "tests/models.h"
#include "tests/tools/run_program.h"
#include "tools/common/process/stop_signal.h"

namespace scree::tests {
namespace {

using Clock = std::chrono::steady_clock;

bool has_entry(const TempFolder& folder, const std::string& begin) {
  const std::vector<std::string> names = folder.names();
  return std::any_of(names.begin(), names.end(), [&](const std::string& name) { return name.starts_with(begin); });
}

/// Whether a process runs the program and catches the signal. Until its command begins, a signal ends it silently.
bool catches(pid_t process, const char* program, int signal) {
  const std::string place = "/proc/" + std::to_string(process);
  std::error_code error;
  if (!std::filesystem::equivalent(place + "/exe", program, error)) return false;
  const std::string status = read_whole(place + "/status");
  const size_t caught = status.find("SigCgt:");
  return caught != std::string::npos &&
         (std::strtoull(status.c_str() + caught + 7, nullptr, 16) >> (signal - 1) & 1) != 0;
}

/// Stops the program once its command has begun and `is_ready` returns true, and checks that the signal ends it soon.
/// Returns its output.
template <class IsReady>
std::string stop(const std::vector<std::string>& words, const std::string& log, int signal, IsReady is_ready,
                 const char* program = kProgram) {
  const pid_t child = start_program(words, log, program);
  REQUIRE(wait_until([&] { return catches(child, program, signal) && is_ready(); }));
  kill(child, signal);
  const auto stopped = Clock::now();
  const int status = wait_for(child);
  CAPTURE(words, read_whole(log));
  CHECK(Clock::now() - stopped < std::chrono::seconds(10));  // about one second on an idle machine
  REQUIRE(WIFSIGNALED(status));
  CHECK(WTERMSIG(status) == signal);
  return read_whole(log);
}

/// For stop(): true once the command has run for a while.
auto has_run(std::chrono::milliseconds time) {
  return [time, begin = std::optional<Clock::time_point>()]() mutable {
    if (!begin) begin = Clock::now();
    return Clock::now() - *begin > time;
  };
}

TEST_CASE("a signal stops synth, which removes its files", "[stop]") {
  for (const std::string name : {"city.gltf", "city.glb"}) {
    const TempFolder folder, outside;
    // Unstopped, this would write 7 GB or 2 GB.
    const std::string scale = name == "city.glb" ? "0.1" : "1";
    const auto has_part = [&] { return has_entry(folder, "city."); };
    const std::string printed = stop({"synth", "A", "--scale", scale, "--threads", "2", "-o", folder.file(name)},
                                     outside.file("log"), SIGINT, has_part);
    CHECK(printed == "scree synth: stopped; nothing written\n");
    CHECK(folder.names().empty());
  }
}

TEST_CASE("a signal stops synth while it makes textures", "[stop]") {
  for (const char* const scene : {"slope", "forest", "panes-textured"}) {
    const TempFolder folder, outside;
    const auto has_part = [&] { return has_entry(folder, "stones."); };
    CHECK(stop({"synth", scene, "--texture-size", "8192", "--threads", "1", "-o", folder.file("stones.glb")},
               outside.file("log"), SIGINT, has_part) == "scree synth: stopped; nothing written\n");
    CHECK(folder.names().empty());
  }
}

TEST_CASE("a signal stops render and compare while they draw", "[stop]") {
  const TempFolder folder, outside;
  const std::string log = outside.file("log");
  const std::string model = data_path("textured_cube.glb").string();
  const std::string packed = outside.file("cube.scree");
  REQUIRE(run_program({"convert", model, "-o", packed, "--source-ids"}, log).exit_code == 0);
  CHECK(stop({"render", packed, "-o", folder.file("cube.png"), "--backend", "cpu", "--frames", "1000000"}, log, SIGTERM,
             has_run(std::chrono::milliseconds(300))) == "scree render: stopped; nothing written\n");
  CHECK(folder.names().empty());
  CHECK(stop({"compare", packed, model, "-o", folder.file("cube.png"), "--size", "8192x8192"}, log, SIGINT,
             has_run(std::chrono::milliseconds(300))) == "scree compare: stopped; nothing written\n");
  CHECK(folder.names().empty());
}

TEST_CASE("a signal to scree-lab removes its folder", "[stop]") {
  const TempFolder folder, outside;
  REQUIRE(setenv("TMPDIR", folder.path().c_str(), 1) == 0);
  const auto has_files = [&] { return !files_below(folder.path()).empty(); };
  const std::string printed =
      stop({"--reference", "--scene", "A", "--scale", "0.2"}, outside.file("log"), SIGINT, has_files, kLabProgram);
  unsetenv("TMPDIR");
  CHECK(printed.ends_with("scree lab: stopped; nothing written\n"));
  CHECK(folder.names().empty());
}

TEST_CASE("a signal stops convert while it reads the document", "[stop]") {
  const TempFolder folder, outside;
  std::string buffers = R"({"byteLength":1})";
  for (uint32_t i = 0; i < 1'500'000; ++i) buffers += R"(,{"byteLength":1})";  // half a minute with sanitizers
  const std::string model = outside.write("buffers.gltf", R"({"asset":{"version":"2.0"},"buffers":[)" + buffers + "]}");
  CHECK(stop({"convert", model, "-o", folder.file("buffers.scree"), "--quiet"}, outside.file("log"), SIGINT,
             has_run(std::chrono::milliseconds(500))) == "scree convert: stopped; nothing written\n");
  CHECK(folder.names().empty());
}

TEST_CASE("a signal before convert is done prints how to resume", "[stop]") {
  const TempFolder folder, outside;
  const std::string log = outside.file("log"), model = outside.file("city.gltf");
  REQUIRE(run_program({"synth", "A", "--scale", "0.05", "-o", model}, log).exit_code == 0);
  const std::string packed = folder.file("city.scree");
  const auto has_part = [&] { return has_entry(folder, "city.scree.part"); };
  CHECK(stop({"convert", model, "-o", packed, "--quiet", "--threads", "1"}, log, SIGINT, has_part) ==
        "scree convert: stopped; nothing written\n");
  CHECK(folder.names().empty());
  CHECK(stop({"convert", model, "-o", packed, "--quiet", "--threads", "1", "--resume"}, log, SIGHUP, has_part) ==
        "scree convert: stopped; continue with --resume\n");
  CHECK(folder.names() == std::vector<std::string>{"city.scree.part"});
}

TEST_CASE("advice that becomes right later replaces the line of a signal", "[stop]") {
  const TempFolder folder;
  const std::string log = folder.file("log");
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    if (std::freopen(log.c_str(), "w", stderr) == nullptr) _exit(1);
    tools::end_on_signal("test");
    {
      const tools::StopOnSignal handlers;
      std::raise(SIGTERM);
      tools::StopOnSignal::advise("continue");
    }
    tools::end_where_signalled();
    _exit(2);
  }
  const int status = wait_for(child);
  REQUIRE(WIFSIGNALED(status));
  CHECK(WTERMSIG(status) == SIGTERM);
  CHECK(read_whole(log) == "scree test: stopped; continue\n");
}

TEST_CASE("a second signal ends a command at once, removes its unfinished file and names the written ones", "[stop]") {
  const TempFolder folder, outside;
  const std::string log = outside.file("log");
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    if (std::freopen(log.c_str(), "w", stderr) == nullptr) _exit(1);
    tools::end_on_signal("test");
    for (const char* const written : {"first.png", "second.png", "first.png"}) tools::note_written(written);
    const tools::StopOnSignal handlers;
    Result<format::PartFile> part = format::PartFile::create(folder.file("out.bin"));
    if (!part || !part->write_at(0, std::as_bytes(std::span("new")))) _exit(2);
    std::raise(SIGINT);  // ignored
    if (!tools::StopOnSignal::flag()->load()) _exit(3);
    std::raise(SIGINT);
    _exit(4);
  }
  const int status = wait_for(child);
  REQUIRE(WIFSIGNALED(status));
  CHECK(WTERMSIG(status) == SIGINT);
  CHECK(read_whole(log) == "scree test: stopped; written: first.png, second.png\n");
  CHECK(folder.names().empty());
}

}  // namespace
}  // namespace scree::tests
