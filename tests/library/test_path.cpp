// The cameras of a path: a film made by the library equals the files of `scree render --path`.
#include <algorithm>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/library/handles.h"
#include "tests/tools/run_program.h"

using namespace scree::tests;

namespace {

const char* const kFilm = R"({"format": "scree camera path", "version": 1, "fps": 4, "name": "around", "keys": [
  {"t": 0, "eye": [4, 2, 6], "target": [0, 0, 0]},
  {"t": 1.1, "eye": [6, 3, 0], "target": [0, 0.5, 0], "fov": 70, "up": [0.1, 1, 0]},
  {"t": 2, "matrix": [0, 0, -1, 0,  0, 1, 0, 0,  1, 0, 0, 0,  5, 0.25, 0.5, 1]}]})";

std::vector<scree_camera> cameras_of(const std::string& path, double fps, uint64_t first, uint64_t count) {
  std::vector<scree_camera> cameras(count);
  cameras.front() = sized<scree_camera>();
  must(scree_cameras_of_path(path.c_str(), fps, first, count, cameras.data(), nullptr));
  return cameras;
}

scree_path_info info_of(const std::string& path, double fps = 0) {
  auto info = sized<scree_path_info>();
  must(scree_cameras_of_path(path.c_str(), fps, 0, 0, nullptr, &info));
  return info;
}

}  // namespace

TEST_CASE("a film of the library equals the output of scree render --path", "[library][path]") {
  const TempFolder folder;
  const std::string file = packed(folder, "two_instances.gltf"), film = folder.write("film.json", kFilm);
  const Opened opened(file);
  const scree_draw_options options = draw_options(45, 31, 2);
  struct Way {
    double fps;
    bool clips;
  };
  for (const Way& way : {Way{0, false}, Way{7.5, true}}) {
    must_run(words_of("render " + file + " --path " + film + " -o " + folder.file("color_%d.png") + " --visbuffer " +
                      folder.file("samples_%d.bin") + " --depth " + folder.file("depth_%d.pfm") +
                      " --size 45x31 --samples 2 --backend cpu --threads 2 --force --quiet" +
                      (way.fps > 0 ? " --fps 7.5" : "") + (way.clips ? " --clip-box -1,-1,-1,1,0.25,3" : "")),
             folder.file("log"));
    const scree_path_info info = info_of(film, way.fps);
    CHECK(info.frames == (way.fps > 0 ? 16 : 9));
    CHECK(info.frames_per_second == (way.fps > 0 ? 7.5 : 4));
    std::vector<scree_camera> cameras = cameras_of(film, way.fps, 0, info.frames);
    std::string last;
    for (uint64_t frame = 0; frame < info.frames; ++frame) {
      INFO("frame " << frame << ", clips " << way.clips);
      if (way.clips) {
        cameras[frame].clips = 1;
        const double box[6] = {-1, -1, -1, 1, 0.25, 3};
        std::copy_n(box, 3, cameras[frame].clip_min);
        std::copy_n(box + 3, 3, cameras[frame].clip_max);
      }
      must(scree_draw(opened.view, &cameras[frame], &options));
      const std::string samples = layer_of(opened.view, SCREE_SAMPLES), depth = layer_of(opened.view, SCREE_DEPTH);
      CHECK((samples == read_whole(folder.file("samples_" + std::to_string(frame) + ".bin"))));
      // The rows of a .pfm go from the bottom to the top.
      const std::string pfm = read_whole(folder.file("depth_" + std::to_string(frame) + ".pfm"));
      constexpr size_t kRow = 45 * 4;
      REQUIRE(pfm.size() > depth.size());
      for (size_t row = 0; row < 31; ++row)
        CHECK((depth.substr(row * kRow, kRow) == pfm.substr(pfm.size() - (row + 1) * kRow, kRow)));
      if (!way.clips) CHECK((samples != last));  // in some frames nothing in the box is visible
      last = samples;
    }
    CHECK_FALSE(std::filesystem::exists(folder.file("samples_" + std::to_string(info.frames) + ".bin")));
    // A part of the path.
    draw(opened.view, options, &cameras_of(film, way.fps, 3, 2)[1]);
    if (!way.clips) CHECK((layer_of(opened.view, SCREE_SAMPLES) == read_whole(folder.file("samples_4.bin"))));
  }
}

TEST_CASE("cameras of a path have the size of the first one", "[library][path]") {
  const TempFolder folder;
  const std::string film = folder.write("film.json", kFilm);
  const std::vector<scree_camera> expected = cameras_of(film, 0, 0, 3);
  for (const size_t size : {sizeof(scree_camera) + 8, sizeof(scree_camera), offsetof(scree_camera, clips)}) {
    std::vector<uint64_t> words(3 * size / 8 + 1, 0x5555555555555555u);
    words[0] = size;
    must(scree_cameras_of_path(film.c_str(), 0, 0, 3, reinterpret_cast<scree_camera*>(words.data()), nullptr));
    for (size_t i = 0; i < 3; ++i) {
      std::string wanted(size, 0);
      std::memcpy(wanted.data(), &expected[i], std::min(size, sizeof(scree_camera)));
      std::memcpy(wanted.data(), &size, sizeof size);
      CHECK(std::string(reinterpret_cast<const char*>(words.data()) + i * size, size) == wanted);
    }
    CHECK(words.back() == 0x5555555555555555u);
  }
  CHECK(expected[1].kind == SCREE_CAMERA_LOOK_AT);
  CHECK(expected[1].fov_degrees > 45);
}

TEST_CASE("a path may end at its last frame", "[library][path]") {
  const TempFolder folder;
  const std::string film = folder.write("film.json", kFilm);
  CHECK(info_of(film).frames == 9);
  must(scree_cameras_of_path(film.c_str(), 0, 9, 0, nullptr, nullptr));
  CHECK(cameras_of(film, 0, 8, 1)[0].eye[0] == 5);
}
