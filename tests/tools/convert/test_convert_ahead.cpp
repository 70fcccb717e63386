// Meshes are encoded while later ones are measured. Bytes and errors equal those of measuring all meshes first, as with
// --resume.
#include <cinttypes>
#include <cstdio>
#include <filesystem>
#include <numeric>
#include <string>
#include <vector>

#include "tests/models.h"
#include "tests/sanitized.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/run_program.h"

using namespace scree;
using namespace scree::convert;
using namespace scree::tests;

namespace {

GridSpec grid_of(uint32_t side, float size) {
  return {.columns = side, .rows = side, .size = size, .uv = true, .color = true};
}

enum Kind { kPlain, kShuffled, kApart, kWide, kImages };

/// Indexed triangles that share no vertex.
tools::GltfPrimitive triangles_apart(ModelMaker& maker, uint32_t triangles) {
  std::vector<float> points;
  std::vector<uint32_t> corners(3 * size_t{triangles});
  std::iota(corners.begin(), corners.end(), 0u);
  for (uint32_t i = 0; i < triangles; ++i) {
    const float x = static_cast<float>(i % 500), z = static_cast<float>(i / 500);
    points.insert(points.end(), {x, 0, z, x, 0, z + 0.5f, x + 0.5f, 1, z});
  }
  return maker.primitive(points, corners);
}

/// Enough triangles that one thread starts to encode before all are measured. The meshes: repeated ones, and meshes
/// with several primitives, with more than one window, with white colours and without content.
void make_ahead_scene(const std::string& path, Kind kind) {
  ModelMaker maker(path);
  const uint32_t checker = kind == kImages ? maker.checker("png") : format::kNone;
  for (uint32_t i = 0; i < 6; ++i) {
    const float size = static_cast<float>(1 + i / 2 * 2);  // every second mesh repeats the previous one
    maker.draw("pair", {maker.grid(grid_of(150, size), checker), maker.grid(grid_of(20, size))});
    GridSpec white = grid_of(180, static_cast<float>(i + 1));
    white.white = true;
    maker.draw("white", {maker.grid(white)});
  }
  maker.draw("nothing", {maker.primitive({0, 0, 0, 1, 0, 0}, {})});
  if (kind == kShuffled) maker.draw("shuffled", {shuffled_squares(maker, 400)});
  if (kind == kApart) maker.draw("apart", {triangles_apart(maker, 250000)});
  maker.draw("two windows", {maker.grid(grid_of(400, 2))});
  if (kind == kWide) {  // no lattice of 24 bits per axis keeps an error of 1e-5
    maker.draw("wide", {maker.grid(grid_of(3, 1e6f))});
    maker.draw("last", {maker.grid(grid_of(30, 1))});
  }
  maker.finish();
}

/// As many good triangles, and an invalid position in the last mesh.
void make_bad_scene(const std::string& path) {
  ModelMaker maker(path);
  for (uint32_t i = 0; i < 12; ++i) maker.draw("good", {maker.grid(grid_of(200, static_cast<float>(i + 1)))});
  maker.draw("wide", {maker.grid(grid_of(3, 1e6f))});
  GridSpec bad = grid_of(10, 1);
  bad.origin[1] = kNan;
  maker.draw("bad", {maker.grid(bad)});
  maker.finish();
}

/// Converts with and without measuring all meshes first, and requires the same bytes.
ConvertReport must_be_same(ConvertOptions options) {
  const ConvertReport ahead = must_convert(options);
  const std::string bytes = tests::read_whole(options.output);
  options.resume = true;
  const ConvertReport first = must_convert(options);
  CHECK(first.windows_ahead == 0);
  CHECK((tests::read_whole(options.output) == bytes));
  CHECK(first.triangles == ahead.triangles);
  CHECK(first.chunks == ahead.chunks);
  CHECK(first.position_error == ahead.position_error);
  CHECK((first.warnings == ahead.warnings));
  return ahead;
}

/// The number in the last line of `convert --stats`.
uint64_t windows_ahead(const tests::ProgramRun& run) {
  INFO(run.output);
  REQUIRE(run.exit_code == 0);
  const size_t end = run.output.find(" windows encoded before all were measured");
  if (end == std::string::npos) return 0;
  uint64_t ahead = 0, windows = 0;
  REQUIRE(std::sscanf(run.output.c_str() + run.output.rfind(',', end), ", %" SCNu64 " of %" SCNu64, &ahead, &windows) ==
          2);
  CHECK(ahead < windows);
  return ahead;
}

/// Conversions of a scene by one thread, so that no order is random. Each is a process of its own, so that all start
/// with the same memory.
class TightMemory {
 public:
  explicit TightMemory(Kind kind) { make_ahead_scene(folder_.file("in.glb"), kind); }

  tests::ProgramRun convert_within(uint64_t mib) const {
    return tests::run_program({"convert", folder_.file("in.glb"), "-o", folder_.file("out.scree"), "--force", "--stats",
                               "--threads", "1", "--memory", std::to_string(mib) + "MiB"},
                              folder_.file("log"));
  }

  /// The least memory in MiB, from the error for a smaller value.
  uint64_t least() const {
    const std::string refused = convert_within(1).output;
    INFO(refused);
    const size_t at = refused.find("needs at least ");
    REQUIRE(at != std::string::npos);
    return std::stoull(refused.substr(at + 15));
  }

  std::string bytes() const { return tests::read_whole(folder_.file("out.scree")); }

 private:
  TempFolder folder_;
};

constexpr uint64_t kPlentyMiB = 2048;  // the default

}  // namespace

TEST_CASE("convert: encoding while measuring gives the same bytes", "[convert][ahead]") {
  const TempFolder folder;
  const Kind kind = GENERATE(kPlain, kImages);
  make_ahead_scene(folder.file("in.glb"), kind);
  ConvertOptions options = options_of(folder);
  options.encoding = GENERATE(Encoding::kIndexed, Encoding::kClustered);
  if (tests::kIsSanitized && (kind == kImages) != (options.encoding == Encoding::kClustered)) return;
  for (const uint32_t threads : {1u, 3u}) {
    options.threads = threads;
    const ConvertReport report = must_be_same(options);
    // With one thread at most 400,000 of the 780,000 triangles wait.
    if (threads == 1) CHECK(report.windows_ahead > 4);
    CHECK(report.rates.measured_triangles >= report.triangles);
    CHECK(report.windows_ahead <= report.windows);
  }
  tests::must_match(options);
}

TEST_CASE("convert: measured windows are not read again", "[convert][ahead]") {
  const TempFolder folder;
  make_ahead_scene(folder.file("in.glb"), kPlain);
  ConvertOptions options = options_of(folder);
  options.weld = options.share = false;
  const ConvertReport report = must_convert(options);
  // Positions, indices and texture coordinates are read once. Colours are read twice, because measuring reads them too.
  CHECK(report.rates.read_bytes < 3 * report.input_bytes / 2);
  options.resume = true;
  CHECK(must_convert(options).rates.read_bytes > 3 * report.input_bytes / 2);
}

// From the minimum memory on, in steps, to the first value with which windows are encoded ahead.
TEST_CASE("convert: with little --memory nothing is encoded ahead, and the bytes are the same",
          "[convert][ahead][memory]") {
  const TightMemory tight(kPlain);
  CHECK(windows_ahead(tight.convert_within(kPlentyMiB)) > 4);
  const std::string bytes = tight.bytes();
  const uint64_t least = tight.least();
  uint64_t ahead = 0, enough = least;
  for (; ahead == 0 && enough < kPlentyMiB; enough += 4) {
    ahead = windows_ahead(tight.convert_within(enough));
    CHECK((tight.bytes() == bytes));
    if (enough == least) CHECK(ahead == 0);
  }
  CHECK(ahead > 0);
  CHECK(enough < least + 256);
}

TEST_CASE("convert: with little --memory a window with unusually many vertices ends encoding ahead",
          "[convert][ahead][memory]") {
  const TightMemory tight(kApart);
  const uint64_t plenty = windows_ahead(tight.convert_within(kPlentyMiB));
  const std::string bytes = tight.bytes();
  const uint64_t least = tight.least();
  // Enough to measure any window, and to encode windows with one vertex per triangle while measuring.
  const tests::ProgramRun run = tight.convert_within(least + 8);
  const uint64_t few = windows_ahead(run);
  CHECK(few > 0);
  CHECK(few < plenty);
  CHECK((tight.bytes() == bytes));
  if (!tests::kIsSanitized) CHECK(tests::stated_peak(run.output) <= (least + 8) << 20);
}

TEST_CASE("convert: options that need all meshes measured end encoding ahead", "[convert][ahead][sort]") {
  const TempFolder folder;
  make_ahead_scene(folder.file("in.glb"), kShuffled);
  ConvertOptions options = options_of(folder);
  options.threads = 1;
  const ConvertReport report = must_be_same(options);
  CHECK(report.sorted_triangles == 320000);
  CHECK(report.windows_ahead > 0);
  options.grid = Grid::kScene;
  CHECK(must_be_same(options).windows_ahead == 0);
}

TEST_CASE("convert: a mesh without a lattice ends encoding ahead, a bad last mesh is an error", "[convert][ahead]") {
  const TempFolder folder;
  make_ahead_scene(folder.file("in.glb"), kWide);
  ConvertOptions options = options_of(folder);
  options.threads = 1;
  options.max_error = 1e-5;
  CHECK(must_be_same(options).windows_ahead > 0);
  CHECK((folder.names() == std::vector<std::string>{"in.glb", "out.scree"}));
  std::filesystem::remove(options.output);

  make_bad_scene(folder.file("in.glb"));
  tests::must_fail(options, ErrorCode::kRange, "in.glb: mesh 13 primitive 0: vertex 0: position (");
  CHECK((folder.names() == std::vector<std::string>{"in.glb"}));
}

TEST_CASE("convert: the .part of an earlier run survives a run with a bad source", "[convert][ahead]") {
  const TempFolder folder;
  ConvertOptions options = options_of(folder);
  options.threads = 1;
  make_bad_scene(folder.file("in.glb"));
  const std::string part = folder.write("out.scree.part", "what a run that was killed left");
  REQUIRE_FALSE(convert::convert(options));
  CHECK(tests::read_whole(part) == "what a run that was killed left");

  // If the source is good, memory becomes free once everything is measured.
  make_ahead_scene(folder.file("in.glb"), kWide);
  CHECK(must_convert(options).windows_ahead == 0);
  CHECK((folder.names() == std::vector<std::string>{"in.glb", "out.scree"}));
  CHECK(must_convert(options).windows_ahead > 0);
}
