// scree render --path: each frame is the picture of its camera, and existing frames are not drawn again.
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "tests/gpu.h"
#include "tests/runtime/small_scene.h"
#include "tests/tools/render/run_render.h"

using namespace scree::tests;
using scree::ErrorCode;
using scree::Result;
namespace fs = std::filesystem;

namespace {

class PathRun {
 public:
  PathRun() {
    SmallScene().write(name("quad.scree"));
    write_path("0, 0, 3");
  }
  std::string name(const std::string& file) const { return folder_.file(file); }

  void write_path(const std::string& first_eye) const {
    folder_.write("path.json",
                  R"({"format": "scree camera path", "version": 1, "fps": 4, "keys": [{"t": 0, "eye": [)" + first_eye +
                      R"(], "target": [0, 0, 0]}, {"t": 1, "eye": [2, 1, 3], "target": [0.2, 0, 0], "fov": 60}]})");
  }

  Result<void> draw(const std::vector<std::string>& more, const std::string& pattern = "f_%02d",
                    const std::string& size = "40x30", const std::string& backend = "cpu") const {
    std::vector<std::string> all{"--path", name("path.json"), "--size", size, "--backend", backend};
    all.insert(all.end(), more.begin(), more.end());
    return run(pattern, all);
  }

  /// Draws the scene to the files `pattern` of all outputs.
  Result<void> run(const std::string& pattern, const std::vector<std::string>& more) const {
    std::vector<std::string> all{
        name("quad.scree"),    "-q", "-o", name(pattern + ".png"), "--depth", name(pattern + ".pfm"), "--visbuffer",
        name(pattern + ".bin")};
    all.insert(all.end(), more.begin(), more.end());
    return run_render(all);
  }

  /// Whether the outputs of two frames are the same bytes.
  void compare(const std::string& a, const std::string& b) const {
    for (const std::string extension : {".png", ".pfm", ".bin"}) {
      INFO(a << extension);
      CHECK(read_bytes(name(a + extension)) == read_bytes(name(b + extension)));
    }
  }

  size_t files() const { return folder_.names().size(); }

 private:
  TempFolder folder_;
};

void check_usage(const Result<void>& done, const char* words) {
  check_refusal(done, ErrorCode::kUsage, words);
}

}  // namespace

TEST_CASE("each frame of a path equals a picture by the same camera", "[render][path]") {
  const PathRun path;
  for (const std::string samples : {"1", "2"}) {
    REQUIRE(path.draw({"--samples", samples, "--background", samples == "1" ? "black" : "transparent", "--force"}));
    const std::vector<std::vector<std::string>> cameras{{"--eye", "0,0,3", "--target", "0,0,0"},
                                                        {"--eye", "2,1,3", "--target", "0.2,0,0", "--fov", "60"}};
    for (size_t i = 0; i < 2; ++i) {
      std::vector<std::string> words{"--size",    "40x30",        "-f",
                                     "--backend", "cpu",          "--samples",
                                     samples,     "--background", samples == "1" ? "black" : "transparent"};
      words.insert(words.end(), cameras[i].begin(), cameras[i].end());
      REQUIRE(path.run("one", words));
      path.compare(i == 0 ? "f_00" : "f_04", "one");
    }
  }
}

TEST_CASE("shares of a path draw the same frames as one run", "[render][path]") {
  const PathRun path;
  REQUIRE(path.draw({}));
  for (const char* share : {"1/3", "2/3", "3/3"}) REQUIRE(path.draw({"--frames", std::string("0:5,") + share}, "g_%d"));
  CHECK(path.files() == 2 + 2 * 15);
  for (int frame = 0; frame < 5; ++frame) path.compare("f_0" + std::to_string(frame), "g_" + std::to_string(frame));
  REQUIRE(path.draw({"--frames", "7/9"}, "h_%d"));  // a share without frames
  CHECK(path.files() == 2 + 2 * 15);
}

TEST_CASE("GPUs draw the frames of a path that the CPU draws", "[cuda][gpus][render][path]") {
  if (!scree::tests::has_gpu()) return;
  const scree::tests::EmulatedGpus emulated("9.0,9.0");
  const PathRun path;
  for (const std::string samples : {"1", "2"}) {
    const std::vector<std::string> drawing{"--samples", samples, "--show", "normal", "--force"};
    REQUIRE(path.draw(drawing));
    // A frame's outputs are copied while the next frame is drawn, unless memory holds only one frame.
    const std::vector<std::vector<std::string>> ways{
        {"--threads", "4"},
        {"--threads", "1"},
        {"--threads", "4", "--host-memory", samples == "1" ? "70000" : "150000"},
        {"--threads", "4", "--gpus", "2"}};
    for (std::vector<std::string> way : ways) {
      if (way.back() == "2" && !scree::tests::has_gpus(2)) continue;
      CAPTURE(samples, way);
      way.insert(way.end(), drawing.begin(), drawing.end());
      REQUIRE(path.draw(way, "g_%02d", "40x30", "cuda"));
      for (int frame = 0; frame < 5; ++frame)
        path.compare("f_0" + std::to_string(frame), "g_0" + std::to_string(frame));
    }
  }
}

TEST_CASE("a resumed path draws missing and incomplete frames", "[render][path]") {
  const PathRun path;
  REQUIRE(path.draw({}));
  const auto before = read_bytes(path.name("f_03.png"));
  check_refusal(path.draw({}), ErrorCode::kFile, "f_00.png: exists already; --force replaces it; --resume");
  fs::remove(path.name("f_01.bin"));
  fs::resize_file(path.name("f_02.pfm"), 100);
  fs::resize_file(path.name("f_03.png"), fs::file_size(path.name("f_03.png")) - 1);
  std::ofstream(path.name("f_05.png.part")) << "half";
  const auto old = fs::last_write_time(path.name("f_00.png"));
  const auto drawn_again = fs::last_write_time(path.name("f_01.png"));
  REQUIRE(path.draw({"--resume"}));
  CHECK(fs::last_write_time(path.name("f_00.png")) == old);
  CHECK(fs::last_write_time(path.name("f_01.png")) != drawn_again);
  CHECK(read_bytes(path.name("f_03.png")) == before);
  CHECK(fs::file_size(path.name("f_02.pfm")) == 40 * 30 * 4 + std::string("Pf\n40 30\n-1.0\n").size());
  CHECK(fs::exists(path.name("f_01.bin")));
  // Neither a frame of another size nor another file is replaced.
  check_refusal(path.draw({"--resume"}, "f_%02d", "20x10"), ErrorCode::kFile, "f_00.png: is a frame of another size");
  CHECK(read_bytes(path.name("f_03.png")) == before);
  std::ofstream(path.name("f_04.pfm")) << "a text";
  check_refusal(path.draw({"--resume"}), ErrorCode::kFile, "f_04.pfm: is no frame; --resume does not replace it");
  REQUIRE(path.draw({"--force"}, "f_%02d", "20x10"));
  CHECK(read_bytes(path.name("f_00.bin")).size() == 20 * 10 * 8);
}

TEST_CASE("errors of a path are reported before anything is drawn", "[render][path]") {
  const PathRun path;
  check_usage(path.draw({"--frames", "0:6"}), "path.json has 5 frames, from 0 on, at 4 per");
  CHECK(refusal(path.draw({"--frames", "5/5", "--fps", "0.5", "--fov", "5"})).message ==
        "--path and --fov exclude each other");
  check_usage(path.draw({"--resume", "--force"}), "exclude each other");
  const std::string scene = path.name("quad.scree"), keys = path.name("path.json");
  CHECK(refusal(run_render({scene, "--resume"})).message == "--resume needs --path");
  check_usage(run_render({scene, "--frames", "0:5"}), "--path");
  CHECK(refusal(run_render({scene, "--path", keys})).message ==
        "--path needs file names for the frames, such as -o frame_%05d.png");
  // Frame 0 has its target at the eye.
  path.write_path("0, 0, 0");
  check_refusal(path.draw({}), ErrorCode::kRange, "path.json: frame 0, at 0 s: the eye and the target are the");
  path.write_path("0, 3, 0");  // the view direction is parallel to up
  check_refusal(path.draw({}), ErrorCode::kRange, "frame 0, at 0 s: up lies along");
  fs::remove(keys);
  check_refusal(path.draw({}), ErrorCode::kFile, "path.json: cannot be opened");
  CHECK(path.files() == 1);
  // A pattern that gives the scene's own name.
  fs::rename(path.name("quad.scree"), path.name("f_02.scree"));
  path.write_path("0, 0, 3");
  check_usage(
      run_render({path.name("f_02.scree"), "--path", keys, "--visbuffer", path.name("f_%02d.scree"), "-q", "--force"}),
      "frame 2 would replace");
}
