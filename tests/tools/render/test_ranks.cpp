// Ranks under mpirun share the frames of a path or the pages of a scene, and all of them end when one fails or dies.
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "runtime/draw/nccl_group.h"
#include "runtime/scene/scene.h"
#include "tests/gpu.h"
#include "tests/models.h"
#include "tests/runtime/small_scene.h"
#include "tests/sanitized.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/run_program.h"
#include "tools/convert/convert.h"

namespace fs = std::filesystem;
using scree::tests::SmallScene;
using scree::tests::TempFolder;
using scree::tests::wait_until;

namespace {

/// A launched command. The destructor ends it with its ranks.
class Launch {
 public:
  Launch(const std::string& command, const TempFolder& folder) : out_(folder.file("out")), err_(folder.file("err")) {
    pid_ = ::fork();
    if (pid_ != 0) return;
    ::setenv("OMPI_ALLOW_RUN_AS_ROOT", "1", 1);
    ::setenv("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1", 1);
    ::setenv("OMPI_MCA_rmaps_base_oversubscribe", "1", 1);
    ::setenv("ASAN_OPTIONS", "detect_leaks=0", 1);  // the leaks are MPI's own
    ::setenv("OMPI_MCA_hwloc_base_binding_policy", "none", 1);
    const std::string line = "cd '" + folder.path().string() + "' && exec " + command + " >out 2>err";
    ::execl("/bin/sh", "sh", "-c", line.c_str(), nullptr);
    ::_exit(127);
  }
  Launch(const Launch&) = delete;
  Launch& operator=(const Launch&) = delete;
  ~Launch() {
    if (pid_ > 0) ::kill(pid_, SIGTERM);
    if (pid_ > 0) ::waitpid(pid_, &status_, 0);
  }

  /// The exit code, or 128 and the signal; -1 if it has not ended within `seconds`.
  int wait(double seconds) {
    if (!wait_until([&] { return has_ended(); }, std::chrono::milliseconds(std::lround(1000 * seconds)))) return -1;
    return WIFEXITED(status_) ? WEXITSTATUS(status_) : 128 + WTERMSIG(status_);
  }

  std::vector<pid_t> ranks() const {
    std::vector<pid_t> found;
    const std::string self = std::to_string(pid_);
    std::istringstream list(scree::tests::read_whole("/proc/" + self + "/task/" + self + "/children"));
    for (pid_t child; list >> child;) found.push_back(child);
    return found;
  }

  std::string out() const { return scree::tests::read_whole(out_); }
  std::string all_errors() const { return scree::tests::read_whole(err_); }
  /// The lines that scree wrote, without the launcher's lines.
  std::vector<std::string> errors() const {
    std::vector<std::string> lines;
    std::istringstream text(all_errors());
    for (std::string line; std::getline(text, line);)
      if (line.find("scree render:") != std::string::npos) lines.push_back(line);
    return lines;
  }

 private:
  bool has_ended() {
    if (pid_ > 0 && ::waitpid(pid_, &status_, WNOHANG) == pid_) pid_ = 0;
    return pid_ == 0;
  }

  pid_t pid_ = 0;
  int status_ = 0;
  std::string out_, err_;
};

/// Runs a command that must succeed within `seconds` and write `lines` lines of errors. Returns its output.
std::string succeed(const std::string& command, const TempFolder& folder, double seconds = 60, size_t lines = 0) {
  INFO(command);
  Launch launch(command, folder);
  const int code = launch.wait(seconds);
  INFO(launch.all_errors());
  REQUIRE(code == 0);
  CHECK(launch.errors().size() == lines);
  return launch.out();
}

/// Runs a command that must end with `code` and one line of errors, which contains each of `words`.
void fail(const std::string& command, const TempFolder& folder, int code, const std::vector<std::string>& words,
          double seconds = 60) {
  INFO(command);
  Launch launch(command, folder);
  CHECK(launch.wait(seconds) == code);
  REQUIRE(launch.errors().size() == 1);
  INFO(launch.errors()[0]);
  for (const std::string& word : words) CHECK(launch.errors()[0].find(word) != std::string::npos);
}

/// Whether a process is still running. An ended process exists until its parent reads its exit status.
bool runs(pid_t process) {
  std::ifstream stat("/proc/" + std::to_string(process) + "/stat");
  std::string text;
  std::getline(stat, text);
  const size_t name_end = text.rfind(')');
  return name_end != std::string::npos && text.substr(name_end, 3) != ") Z";
}

void make_path(const TempFolder& folder, const char* end) {
  folder.write("path.json", std::string(R"({"format": "scree camera path", "version": 1, "keys": [
    {"t": 0, "eye": [0, 0, 3], "target": [0, 0, 0]}, {"t": )") +
                                end + R"(, "eye": [2, 1, 3], "target": [0, 0, 0]}]})");
}

void make_inputs(const TempFolder& folder, const char* end) {
  SmallScene().write(folder.file("quad.scree"));
  make_path(folder, end);
}

std::string render(int ranks, const std::string& more, const std::string& backend = "cpu") {
  return std::string(SCREE_MPIEXEC) + " -n " + std::to_string(ranks) + " '" + scree::tests::kProgram +
         "' render quad.scree --backend " + backend + " --threads 1 " + more;
}

}  // namespace

TEST_CASE("ranks share the frames of a path", "[render][path][ranks]") {
  const TempFolder folder;
  make_inputs(folder, "0.3");  // 10 frames
  std::string expected;
  for (const int ranks : {1, 2, 3, 5}) {
    INFO(ranks << " ranks");
    const std::string pattern = "n" + std::to_string(ranks) + "_%d";
    const std::string out = succeed(render(ranks, "--path path.json --size 40x30 -o " + pattern + ".png --visbuffer " +
                                                      pattern + ".bin --depth " + pattern + ".pfm"),
                                    folder);
    CHECK(out.find("10 frames of 40 x 30") != std::string::npos);
    CHECK(out.find('\n') == out.size() - 1);  // only one rank reports
    std::string bytes;
    for (int frame = 0; frame < 10; ++frame)
      for (const char* extension : {".png", ".bin", ".pfm"})
        bytes += scree::tests::read_whole(
            folder.file("n" + std::to_string(ranks) + "_" + std::to_string(frame) + extension));
    if (ranks == 1) expected = bytes;
    CHECK(bytes == expected);
  }
}

TEST_CASE("an error of one rank ends all ranks with one line", "[render][path][ranks]") {
  const TempFolder folder;
  make_inputs(folder, "0.3");
  folder.write("f_4.png", "is there");  // exists already; a frame of rank 1
  fail(render(3, "--path path.json --size 40x30 -o f_%d.png"), folder, 2,
       {"rank 1 of 3 on ", "f_4.png: exists already"});
  CHECK_FALSE(fs::exists(folder.file("f_0.png")));
  // A rank fails in the middle of its work.
  for (const int frame : {0, 1, 2, 3, 4, 5, 6, 7, 9}) fs::create_directory(folder.file("d" + std::to_string(frame)));
  fail(render(3, "--path path.json --size 40x30 -o d%d/f.png"), folder, 2, {" of 3 on ", "d8/f.png"});
  // All ranks have an error.
  scree::tests::damage(folder.file("quad.scree"), 4096);
  fail(render(3, "--path path.json --size 40x30 -o g_%d.png"), folder, 3, {"rank 0 of 3 on ", "quad.scree: page 0"});
}

TEST_CASE("a rank that is killed ends all ranks", "[render][path][ranks]") {
  for (const auto& [victim, more] :
       {std::pair<size_t, std::string>(0, ""), {1, ""}, {2, ""}, {0, "--share geometry "}, {1, "--share geometry "}}) {
    INFO("rank " << victim << ", " << more);
    const TempFolder folder;
    make_inputs(folder, "300");  // 9,001 frames
    Launch launch(render(3, more + "--path path.json --size 200x150 -q -o f_%d.png"), folder);
    REQUIRE(wait_until([&] { return fs::exists(folder.file("f_5.png")); }));
    const std::vector<pid_t> ranks = launch.ranks();
    REQUIRE(ranks.size() == 3);
    ::kill(ranks[victim], SIGKILL);
    CHECK(launch.wait(10) > 0);
    for (const pid_t rank : ranks) CHECK(wait_until([&] { return !runs(rank); }, std::chrono::seconds(10)));
    // A file with its final name is complete, so the film can be resumed.
    CHECK(fs::file_size(folder.file("f_5.png")) > 45);
  }
}

namespace {

/// Several pages of geometry, some of them textured, under a sun. `blends`: four of the six grids are blended.
void make_large_scene(const TempFolder& folder, bool blends = false) {
  namespace format = scree::format;
  scree::tests::ModelMaker maker(folder.file("grids.gltf"));
  const uint32_t checker = maker.checker("png");
  scree::tools::GltfMaterial glass{.alpha = scree::tools::GltfAlpha::kBlend};
  glass.base_color[3] = 0.5;
  const uint32_t clear = maker.writer().add_material(glass);
  glass.texture = maker.writer().add_texture(maker.texture(
      "film", format::ImageCodec::kPng, scree::tests::read_bytes(scree::tests::data_path("checker.png"))));
  const uint32_t film = maker.writer().add_material(glass);
  scree::tests::GridSpec grid{.uv = true, .color = true};
  for (int i = 0; i < 6; ++i) {
    grid.columns = static_cast<uint32_t>(150 + 40 * i);
    grid.rows = 120;
    grid.origin = {0, 0, 0.1f * static_cast<float>(i)};  // the grids lie one in front of the other
    const std::string name = "grid " + std::to_string(i);
    const uint32_t opaque = i % 2 == 0 ? checker : format::kNone;
    const uint32_t material = !blends || i < 2 ? opaque : i % 2 == 0 ? film : clear;
    maker.draw(name, {maker.grid(grid, material)}, {0.2 * i, 0.1 * i, 0});
  }
  maker.finish();
  nlohmann::json model = nlohmann::json::parse(scree::tests::read_whole(folder.file("grids.gltf")));
  model["extensionsUsed"].push_back("KHR_lights_punctual");
  model["extensions"]["KHR_lights_punctual"]["lights"] = {{{"type", "directional"}, {"intensity", 3}}};
  model["scenes"][0]["nodes"].push_back(model["nodes"].size());
  model["nodes"].push_back(
      {{"rotation", {-0.3, 0.1, 0, std::sqrt(0.9)}}, {"extensions", {{"KHR_lights_punctual", {{"light", 0}}}}}});
  folder.write("grids.gltf", model.dump());
  scree::convert::ConvertOptions options;
  options.input = folder.file("grids.gltf");
  options.output = folder.file("quad.scree");
  options.float32 = true;  // larger, so that there are several pages to share
  CHECK(must(scree::convert::convert(options)).geometry_bytes > 5 << 20);
}

/// Numbers of ranks whose picture must equal that of one rank. Under sanitizers a rank takes seconds to start.
const std::vector<int> kRanks = scree::tests::kIsSanitized ? std::vector<int>{3} : std::vector<int>{2, 3, 5};
/// One rank, and the numbers that are compared with it, in tests that take longer.
const std::vector<int> kFewRanks = scree::tests::kIsSanitized ? std::vector<int>{1, 3} : std::vector<int>{1, 2, 3};

/// Offsets of the pages of geometry, which go to the ranks in this order.
std::vector<uint64_t> places_of_pages(const TempFolder& folder) {
  const auto file = must(scree::runtime::SceneFile::open(folder.file("quad.scree")));
  std::vector<uint64_t> places;
  for (uint64_t i = 0; i < file.container().pages().size(); ++i)
    if (file.container().pages()[i].kind == scree::format::PageKind::kGeometry)
      places.push_back(file.container().pages()[i].offset);
  return places;
}

/// The options that write the outputs to files with this name.
std::string to_files(const std::string& name) {
  return " --size 160x120 --force -o " + name + ".png --depth " + name + ".pfm --visbuffer " + name + ".bin ";
}

std::string files_of(const TempFolder& folder, const std::string& name) {
  std::string bytes;
  for (const char* extension : {".png", ".pfm", ".bin"})
    bytes += scree::tests::read_whole(folder.file(name + extension));
  return bytes;
}

}  // namespace

TEST_CASE("ranks that share a scene's pages draw the same picture as one rank", "[render][ranks]") {
  const TempFolder folder;
  make_large_scene(folder);
  const std::string cases[] = {"",
                               "--samples 2 --ssao --edl --eye 1,1,3 --background transparent",
                               "--show triangle",
                               "--show depth --view iso",
                               "--light scene --shadows --shadow-size 500",
                               "--show normal --eye 0.5,0.5,0.9 --target 0.5,0.5,0 --no-light"};
  for (const std::string& more : cases) {
    succeed(render(1, more + to_files("one")), folder);
    for (const int ranks : kRanks) {
      INFO(ranks << " ranks, " << more);
      succeed(render(ranks, more + to_files("all")), folder);
      CHECK(files_of(folder, "all") == files_of(folder, "one"));
    }
  }
}

TEST_CASE("ranks that share a scene's pages make the same layers and picks as one rank", "[render][ranks]") {
  const TempFolder folder;
  make_large_scene(folder, true);
#if defined(SCREE_HAS_EXR)
  const std::string picture = "two.exr";
#else
  const std::string picture = "two.png";
#endif
  for (const std::string more : {"", "--samples 4 --ssao", "--show mesh"}) {
    std::vector<std::string> expected;
    for (const int ranks : kFewRanks) {
      INFO(ranks << " ranks, " << more);
      const std::string where = "--eye 0.5,2,1.5 --target 0.5,0,0.5 --size 80x60 --pick 40,30 --pick 0,0 ";
      const std::string to = "--quiet --force --normals n.pfm --uvs uv.pfm -o " + picture + " ";
      std::vector<std::string> made{succeed(render(ranks, where + to + more), folder)};
      for (const std::string& name : {picture, std::string("n.pfm"), std::string("uv.pfm")})
        made.push_back(scree::tests::read_whole(folder.file(name)));
      if (ranks == 1) expected = made;
      CHECK(made == expected);
      CHECK(made[0].find(", mesh ") != std::string::npos);
    }
  }
  CHECK(succeed(render(2, "--list-cameras"), folder) == "scene 0 has no cameras\n");
}

TEST_CASE("GPUs of ranks that share a scene's pages draw the same as the CPU", "[cuda][render][ranks]") {
  if (!scree::tests::has_gpu()) return;
  for (const bool blends : {false, true}) {
    const TempFolder folder;
    make_large_scene(folder, blends);
    uint32_t number = 0;
    for (const std::string more : {"", "--samples 2 --ssao --background transparent --normals n.pfm",
                                   "--light scene --shadows --shadow-size 300", "--show triangle"}) {
      if (scree::tests::kEmulatesGpu && (number++ % 2 == 0) == blends) continue;
      succeed(render(1, more + to_files("cpu")), folder);
      for (const int ranks : {2, 3}) {
        if (scree::tests::kEmulatesGpu && (ranks == 2) != blends) continue;
        INFO(ranks << " ranks, " << more);
        const std::string out = succeed(render(ranks, more + to_files("gpu") + "--json", "cuda"), folder, 120);
        CHECK(nlohmann::json::parse(out)["gpus"] == ranks);
        CHECK(files_of(folder, "gpu") == files_of(folder, "cpu"));
      }
    }
    // With too little memory the CPU draws instead, if --backend allows it.
    fail(render(2, "--device-memory 20000 -q -o refused.png", "cuda"), folder, 4,
         {"bytes of device memory, but 20000 are allowed"});
    CHECK_FALSE(fs::exists(folder.file("refused.png")));
    const std::string few = render(2, "--device-memory 20000 --json" + to_files("small"), "auto");
    CHECK(nlohmann::json::parse(succeed(few, folder, 60, 2))["gpus"] == 0);  // each rank warns
    succeed(render(1, to_files("small_one")), folder);
    CHECK(files_of(folder, "small") == files_of(folder, "small_one"));
    // A damaged page ends all ranks with one line.
    scree::tests::damage(folder.file("quad.scree"), places_of_pages(folder)[0] + 100);
    fail(render(2, "--eye 1,1,3 --target 0,0,0 -o bad.png", "cuda"), folder, 3,
         {"rank 0 of 2 on ", "quad.scree: page "});
  }
}

TEST_CASE("ranks that share the geometry of a film draw the same frames as one rank", "[render][path][ranks]") {
  const auto film = [](int ranks, const std::string& name, const std::string& more) {
    return render(ranks, "--path path.json --size 40x30 -o " + name + "_%d.png --visbuffer " + name +
                             "_%d.bin --depth " + name + "_%d.pfm " + more);
  };
  const auto files = [](const TempFolder& folder, const std::string& name) {
    std::string bytes;
    for (int frame = 0; frame < 4; ++frame) bytes += files_of(folder, name + "_" + std::to_string(frame));
    return bytes;
  };
  for (const bool blends : {false, true}) {
    const TempFolder folder;
    make_path(folder, "0.1");  // 4 frames
    make_large_scene(folder, blends);
    for (const std::string more : {"", "--samples 2 --ssao --background transparent"}) {
      succeed(film(1, "one", "--force --share geometry " + more), folder);
      for (const int ranks : kRanks) {
        INFO(ranks << " ranks, " << more);
        const std::string out = succeed(film(ranks, "all", "--force --share geometry --json " + more), folder);
        const nlohmann::json report = nlohmann::json::parse(out);
        CHECK(report["frames"] == 4);
        CHECK(report["exchange"] == "mpi");
        CHECK(files(folder, "all") == files(folder, "one"));
      }
    }
    // A frame that one rank lacks is drawn by all.
    fs::remove(folder.file("all_1.png"));
    fs::remove(folder.file("all_3.bin"));
    const std::string resume = "--resume --share geometry --samples 2 --ssao --background transparent ";
    CHECK(nlohmann::json::parse(succeed(film(3, "all", resume + "--json"), folder))["frames_there"] == 2);
    CHECK(files(folder, "all") == files(folder, "one"));
    CHECK(succeed(film(3, "all", resume), folder).find("4 of 4 frames exist") != std::string::npos);
  }
}

TEST_CASE("a film whose geometry is shared is refused like other films", "[render][path][ranks]") {
  const TempFolder folder;
  make_inputs(folder, "0.1");
  folder.write("f_1.png", "is there");
  const std::tuple<std::string, int, std::string> refused[] = {
      {"--share geometry -o no.png", 1, "--share needs --path"},
      {"--path path.json --share fairly -o no_%d.png", 1, "--share: 'fairly' is not one of frames, geometry"},
      {"--path path.json --share geometry -o f_%d.png", 2, "rank 1 of 2 on "},
      {"--path path.json --share geometry -o no/f_%d.png", 2, "no/f_0.png"}};
  for (const auto& [words, code, line] : refused) {
    INFO(words);
    Launch launch(render(2, words), folder);
    CHECK(launch.wait(20) == code);
    REQUIRE(!launch.errors().empty());
    CHECK(launch.errors()[0].find(line) != std::string::npos);
  }
}

namespace {

enum class RankPlaces { kOwnGpus, kOneGpu, kOwnHosts };

/// The command of ranks that each have their own GPU, or that all use the first GPU. kOwnHosts: each also appears to
/// have its own host, so that NCCL connects them by TCP.
std::string render_on_gpus(int ranks, const std::string& more, RankPlaces places = RankPlaces::kOwnGpus) {
  std::string line = SCREE_MPIEXEC;
  for (int rank = 0; rank < ranks; ++rank) {
    const std::string number = std::to_string(rank);
    line += std::string(rank == 0 ? "" : " :") + " -n 1 ";
    if (places == RankPlaces::kOwnHosts) line += "env NCCL_HOSTID=" + number + " NCCL_SOCKET_IFNAME=lo ";
    line += std::string("'") + scree::tests::kProgram + "' render quad.scree --threads 1 --device " +
            (places == RankPlaces::kOneGpu ? "0" : number) + " " + more;
  }
  return line;
}

/// Whether each of two ranks can have a GPU, with NCCL. Each emulated rank has its own GPU.
bool can_use_nccl() {
  if (!scree::tests::has_gpus(2)) return false;
  const auto opened = scree::runtime::NcclGroup::open();
  if (!opened && !scree::tests::kEmulatesGpu) WARN("skipped: " << opened.error().message);
  return opened || scree::tests::kEmulatesGpu;
}

/// Lets ranks of emulated GPUs fail as described in tests/emulator/nccl.cpp.
class NcclFails {
 public:
  explicit NcclFails(const char* where) { ::setenv("SCREE_EMULATED_NCCL", where, 1); }
  NcclFails(const NcclFails&) = delete;
  NcclFails& operator=(const NcclFails&) = delete;
  ~NcclFails() { ::unsetenv("SCREE_EMULATED_NCCL"); }
};

}  // namespace

TEST_CASE("ranks with a GPU each exchange by NCCL and draw the same as the CPU", "[cuda][render][ranks][nccl]") {
  const scree::tests::EmulatedGpus gpus("9.0,9.0,9.0");
  if (!can_use_nccl()) return;
  const TempFolder folder;
  make_large_scene(folder);
  const std::string most_files = " --normals n.pfm --size 80x60 --force -o a.png --depth a.pfm --visbuffer a.bin ";
  const auto made = [&] {
    std::string bytes;
    for (const char* name : {"n.pfm", "a.png", "a.pfm", "a.bin"}) bytes += scree::tests::read_whole(folder.file(name));
    return bytes;
  };
  int number = 0;
  for (const std::string more :
       {"", "--samples 2 --ssao --background transparent", "--ssao --edl --background '#ff000080'",
        "--light scene --shadows --shadow-size 300", "--show triangle", "--frames 3 --show normal --pick 40,30"}) {
    succeed(render(1, more + most_files), folder);
    const std::string expected = made();
    const int ranks = scree::tests::kEmulatesGpu ? 2 + number++ % 2 : 2;
    INFO(ranks << " ranks, " << more);
    const std::string out = succeed(render_on_gpus(ranks, more + most_files + "--exchange nccl --json"), folder, 240);
    const nlohmann::json report = nlohmann::json::parse(out);
    CHECK(report["exchange"] == "nccl");
    CHECK(report["gpus"] == ranks);
    CHECK(made() == expected);
  }
  make_path(folder, "0.1");  // 4 frames; each GPU begins the next one before a frame is exchanged
  for (const std::string more : {"--samples 2", "--light scene --shadows --shadow-size 300"}) {
    const std::string film = "--path path.json --size 60x40 -q -f " + more;
    succeed(render(1, film + " -o f_%d.png --depth f_%d.pfm --visbuffer f_%d.bin"), folder);
    for (const auto& [exchange, places] :
         {std::pair{"nccl", RankPlaces::kOwnGpus}, {"nccl", RankPlaces::kOwnHosts}, {"mpi", RankPlaces::kOwnGpus}}) {
      if (places == RankPlaces::kOwnHosts && scree::tests::kEmulatesGpu) continue;  // the emulator's NCCL has no hosts
      if (scree::tests::kEmulatesGpu && (exchange == std::string("mpi")) != (more == "--samples 2")) continue;
      INFO(more << ", " << exchange << ", " << static_cast<int>(places));
      const std::string files = " --share geometry -o g_%d.png --depth g_%d.pfm --visbuffer g_%d.bin --exchange ";
      succeed(render_on_gpus(2, film + files + exchange, places), folder, 240);
      for (const std::string frame : {"_0", "_1", "_2", "_3"})
        CHECK(files_of(folder, "g" + frame) == files_of(folder, "f" + frame));
    }
  }
#if defined(SCREE_HAS_EXR)
  succeed(render_on_gpus(1, "--size 80x60 -q -o one.exr"), folder, 120);  // colours that are not rounded to 8 bits
  succeed(render_on_gpus(2, "--exchange nccl --size 80x60 -q -o two.exr"), folder, 240);
  CHECK((scree::tests::read_whole(folder.file("two.exr")) == scree::tests::read_whole(folder.file("one.exr"))));
#endif
}

TEST_CASE("ranks exchange by MPI where NCCL cannot connect them", "[cuda][render][ranks][nccl]") {
  const scree::tests::EmulatedGpus gpus("9.0,9.0");
  if (!can_use_nccl()) return;
  const TempFolder folder;
  make_large_scene(folder);
  const auto films = [](const std::string& name) {  // enough frames that NCCL is used
    return "--frames 16 --size 32x24 --force -o " + name + ".png --depth " + name + ".pfm --visbuffer " + name +
           ".bin ";
  };
  succeed(render(1, films("one")), folder);
  const auto is_by = [&](const std::string& way, const std::string& command, size_t warnings) {
    INFO(command);
    CHECK(nlohmann::json::parse(succeed(command, folder, 240, warnings))["exchange"] == way);
    CHECK(files_of(folder, "some") == files_of(folder, "one"));
  };
  const auto fails = [&](const std::string& command, int code, const std::string& line) {
    fail(command, folder, code, {line}, 60);
  };
  const std::string some = films("some") + "--json ";
  is_by("nccl", render_on_gpus(2, some), 0);
  is_by("mpi", render_on_gpus(2, some + "--exchange mpi"), 0);
  is_by("mpi", render_on_gpus(2, some, RankPlaces::kOneGpu), 0);
  is_by("mpi", render(2, some), 0);  // no GPU draws
  std::string short_film = some;
  short_film.replace(0, std::string("--frames 16").size(), "--frames 15");
  is_by("mpi", render_on_gpus(2, short_film), 0);
  fails(render_on_gpus(2, "-q -o no.png --exchange nccl", RankPlaces::kOneGpu), 4,
        "--exchange nccl: ranks 0 and 1 share a GPU");
  fails(render(2, "-q -o no.png --exchange nccl"), 4, "--exchange nccl: no GPU draws here");
  fails(render(1, "-q -o no.png --exchange by_post"), 1, "--exchange: 'by_post' is not one of auto, mpi, nccl");
  if (!scree::tests::kEmulatesGpu) return;
  {  // rank 1 fails to connect, and rank 0 waits for it forever
    const NcclFails rank("connect:1");
    is_by("mpi", render_on_gpus(2, some), 1);
    fails(render_on_gpus(2, "-q -o no.png --exchange nccl"), 4, "--exchange nccl: ");
  }
  {
    const NcclFails rank("exchange:1");  // fails in the first exchange, as a part of connecting
    is_by("mpi", render_on_gpus(2, some), 1);
  }
  {
    const NcclFails rank("late:1");
    fails(render_on_gpus(2, "--exchange nccl -q -o no.png"), 4, "rank 1 of 2 on ");
    CHECK_FALSE(fs::exists(folder.file("no.png")));
  }
  {  // fails while the second frame of a film begins
    make_path(folder, "0.1");
    const NcclFails rank("later:1");
    fails(render_on_gpus(2, "--path path.json --share geometry --size 32x24 --exchange nccl -q -o no_%d.png"), 4,
          "rank 1 of 2 on ");
    CHECK_FALSE(fs::exists(folder.file("no_0.png")));
  }
  // The CPU draws the layers of blended surfaces.
  const TempFolder with_layers;
  make_large_scene(with_layers, true);
  CHECK(nlohmann::json::parse(succeed(render_on_gpus(2, some), with_layers, 120))["exchange"] == "mpi");
  fail(render_on_gpus(2, "-q -o no.png --exchange nccl"), with_layers, 1, {"has blended surfaces"});
}

TEST_CASE("ranks that share a scene's pages draw the same layers as one rank", "[render][ranks][blend]") {
  const TempFolder folder;
  make_large_scene(folder, true);
  for (const std::string more : {"", "--samples 2 --background transparent --show color", "--blend-layers 1",
                                 "--light scene --shadows --shadow-size 300"}) {
    std::string expected, warned;
    uint64_t layers = 0;
    for (const int ranks : kFewRanks) {
      INFO(ranks << " ranks, " << more);
      const std::string name = "n" + std::to_string(ranks);
      Launch launch(render(ranks, more + to_files(name) + "--json"), folder);
      REQUIRE(launch.wait(60) == 0);
      const nlohmann::json report = nlohmann::json::parse(launch.out());
      const std::string warning = launch.errors().empty() ? "" : launch.errors()[0];
      CHECK(launch.errors().size() == (more == "--blend-layers 1" ? 1 : 0));
      if (ranks == 1) {
        expected = files_of(folder, name);
        warned = warning;
        layers = report["blended_layers"].get<uint64_t>();
        CHECK((more == "--blend-layers 1" ? layers == 1 : layers > 3));
      }
      CHECK(report["blended_layers"] == layers);
      CHECK(files_of(folder, name) == expected);
      CHECK(warning == warned);
    }
  }
  // The opaque picture alone differs, and so does a picture without shadows.
  succeed(render(2, "--light scene --size 160x120 -q -o lit.png"), folder);
  CHECK(scree::tests::read_whole(folder.file("lit.png")) != scree::tests::read_whole(folder.file("n1.png")));
  succeed(render(2, "--blend-layers 0 --size 160x120 -q -o none.png"), folder);
  CHECK(scree::tests::read_whole(folder.file("none.png")) != scree::tests::read_whole(folder.file("n1.png")));
}

TEST_CASE("a damaged page ends all ranks, and only its owner has read it", "[render][ranks]") {
  const TempFolder folder;
  make_large_scene(folder);
  const std::vector<uint64_t> places = places_of_pages(folder);
  REQUIRE(places.size() >= 5);
  const std::string good = scree::tests::read_whole(folder.file("quad.scree"));
  for (size_t page = 0; page < 3; ++page) {  // the first three pages belong to ranks 0, 1 and 2
    folder.write("quad.scree", good);
    scree::tests::damage(folder.file("quad.scree"), places[page] + 100);
    fail(render(3, "--eye 1,1,3 --target 0,0,0 --size 64x48 -o bad.png"), folder, 3,
         {"rank " + std::to_string(page) + " of 3 on ", "quad.scree: page "}, 10);
    CHECK_FALSE(fs::exists(folder.file("bad.png")));
  }
  folder.write("quad.scree", good);
  fail(render(2, "--stats -o one.png"), folder, 1, {"--stats"});
}
