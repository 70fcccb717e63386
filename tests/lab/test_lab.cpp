// scree-lab without a GPU: its options, its statistics, its files, and its comparison of pictures.

#include <cmath>
#include <fstream>
#include <limits>
#include <sstream>

#include "lab/frames/picture_error.h"
#include "lab/options.h"
#include "lab/report/case_result.h"
#include "lab/report/case_row.h"
#include "lab/report/tables.h"
#include "lab/scenes/chunk_plan.h"
#include "lab/setup/views.h"
#include "runtime/scene/camera.h"
#include "tests/full_disk.h"
#include "tests/lab/host_chunks.h"
#include "tests/lab/refused.h"
#include "tests/results.h"
#include "tests/tools/temp_folder.h"
#include "tools/bench/csv.h"

using namespace scree;
using namespace scree::lab;
using tests::refused;

namespace {

size_t commas(const std::string& line) {
  return static_cast<size_t>(std::count(line.begin(), line.end(), ','));
}

CaseResult sample_result() {
  CaseResult result{.scene = "A", .order = "row", .positions = "16", .indices = "packed", .view = "overview"};
  result.width = 1920;
  result.height = 1080;
  result.frames = 60;
  result.unique_triangles = 1000;
  result.drawn_triangles = 2000;
  result.geometry_bytes = 8000;
  result.stats.triangles = 1500;
  result.frame = {2, 1, 3, 2, 4};
  return result;
}

}  // namespace

TEST_CASE("lab: its defaults measure A to D, packed and as floats", "[lab]") {
  const LabOptions options = must(parse_options({}));
  CHECK(options.scenes == std::vector<std::string>{"A", "B", "C", "D"});
  REQUIRE(options.encodings.size() == 2);
  CHECK(encoding_name(options.encodings[0]) == "16-bit, packed");
  CHECK(encoding_name(options.encodings[1]) == "float32, 32-bit");
  CHECK(options.samples_per_side == std::vector<uint32_t>{1});
  LabWords words;
  words.effects = "none, ssao+edl";
  const LabOptions effects = must(parse_options(words));
  REQUIRE(effects.effects.size() == 2);
  CHECK_FALSE(effects.effects[0].ssao);
  CHECK((effects.effects[1].ssao && effects.effects[1].edl));
}

TEST_CASE("lab: invalid words are refused with the valid ones", "[lab]") {
  const auto with = [](auto member, auto value) {
    LabWords words;
    words.*member = value;
    return words;
  };
  CHECK(refused(with(&LabWords::scenes, "A,E")).find("\"E\"") != std::string::npos);
  CHECK(refused(with(&LabWords::positions, "7")).find("8 to 24") != std::string::npos);
  CHECK(refused(with(&LabWords::positions, "16,")).find("8 to 24") != std::string::npos);
  CHECK(refused(with(&LabWords::indices, "16")).find("packed") != std::string::npos);
  CHECK(refused(with(&LabWords::order, "column")).find("block") != std::string::npos);
  CHECK(refused(with(&LabWords::samples, "3")).find("1, 2 or 4") != std::string::npos);
  CHECK(refused(with(&LabWords::sampleless, "no")).find("on or off") != std::string::npos);
  CHECK(refused(with(&LabWords::effects, "ssao,fog")).find("edl") != std::string::npos);
  CHECK(refused(with(&LabWords::size, "1920")).find("WxH") != std::string::npos);
  CHECK(refused(with(&LabWords::size, "0x9")).find("WxH") != std::string::npos);
  CHECK(refused(with(&LabWords::scale, 0.0)).find("--scale") != std::string::npos);
  CHECK(refused(with(&LabWords::scale, std::nan(""))).find("--scale") != std::string::npos);
  CHECK(refused(with(&LabWords::near, -1e-6)).find("--near") != std::string::npos);
  CHECK(refused(with(&LabWords::frames, 0u)).find("--frames") != std::string::npos);
  CHECK(refused(with(&LabWords::views, "inside,left")).find("overview") != std::string::npos);
  LabWords words;
  words.scenes = "D";
  words.views = "overview";
  CHECK(refused(words).find("inside, corner") != std::string::npos);
  words = {};
  words.files = {"a.scree"};
  words.scenes = "A";
  CHECK(refused(words).find("exclude") != std::string::npos);
  words.scenes.clear();
  words.order = "block";
  CHECK(refused(words).find("not for a file") != std::string::npos);
  words.order = "row";
  words.sweep = true;
  CHECK(refused(words).find("--sweep") != std::string::npos);
  words.path = true;
  CHECK(refused(words).find("exclude") != std::string::npos);
}

TEST_CASE("lab: a sweep covers the requested encodings", "[lab]") {
  LabWords words;
  words.scenes = "A";
  words.sweep = true;
  LabOptions options = must(parse_options(words));
  CHECK(options.encodings.size() == 8);
  CHECK(options.encodings.front().position_bits == 8);
  CHECK(options.encodings.back().position_bits == 24);
  words.indices = "packed,clustered";
  words.positions = "12,float32";
  options = must(parse_options(words));
  REQUIRE(options.encodings.size() == 3);
  CHECK_FALSE(options.encodings[0].clustered);
  CHECK(options.encodings[1].clustered);
  CHECK(options.encodings[2].float32);
}

TEST_CASE("lab: the textured scene is measured alone", "[lab]") {
  LabWords words;
  words.scenes = "textured";
  LabOptions options = must(parse_options(words));
  CHECK(options.is_textured);
  CHECK(options.textures == 12);
  CHECK(options.texture_size == 16384);
  CHECK(options.texture_cache == runtime::kDeviceTextureCache);
  words.textures = 20;
  words.texture_size = 8192;
  words.texture_cache = "1GiB";
  words.size = "1920x1080";
  options = must(parse_options(words));
  CHECK(options.textures == 20);
  CHECK(options.texture_size == 8192);
  CHECK(options.texture_cache == uint64_t{1} << 30);
  CHECK(options.size->width == 1920);
  for (const uint32_t size : {0u, 1000u, 65536u}) {
    LabWords bad = words;
    bad.texture_size = size;
    CHECK(refused(bad).find("--texture-size") != std::string::npos);
  }
  LabWords bad = words;
  bad.csv = "rows.csv";
  CHECK(refused(bad).find("--scene textured allows only") != std::string::npos);
  bad = words;
  bad.texture_cache = "much";
  CHECK(refused(bad).find("--texture-cache") != std::string::npos);
  bad = words;
  bad.scenes = "A";  // A has no textures
  CHECK(refused(bad).find("--scene textured") != std::string::npos);
  bad.scenes = "A,textured";
  CHECK(refused(bad).find("\"textured\"") != std::string::npos);
}

TEST_CASE("lab: the extra scenes have the paper's sizes", "[lab]") {
  CHECK(make_scene("lantern", synth::MeshOrder::kRow, 1).drawn_triangles() == 995328);
  const uint64_t sixty = make_scene("A60", synth::MeshOrder::kBlock, 1).drawn_triangles();
  CHECK(sixty > 59'000'000);
  CHECK(sixty < 61'000'000);
}

TEST_CASE("lab: a CSV file has one header and a row per case", "[lab]") {
  const tests::TempFolder folder;
  const std::string path = folder.file("rows.csv");
  const Machine machine{{"0123456789ab", "NVIDIA \"X\", large", "1.2"}, 4000};
  CaseResult result = sample_result();
  const bench::CsvCells cells = case_cells(machine, result);
  const std::string row = bench::csv_values(cells);
  REQUIRE(bench::append_csv(path, cells));
  result.raster = Times{1, 1, 0, 1, 1};
  result.error = PictureError{5, 0.25, 0.125, std::numeric_limits<double>::infinity(), 0.5};
  REQUIRE(bench::append_csv(path, case_cells(machine, result)));
  std::istringstream lines(tests::read_whole(path));
  std::string header, first, second, more;
  std::getline(lines, header);
  std::getline(lines, first);
  std::getline(lines, second);
  CHECK_FALSE(std::getline(lines, more));
  CHECK(header == bench::csv_columns(cells));
  CHECK(header.starts_with("commit,gpu,driver,"));
  CHECK(first == row);
  CHECK(first.starts_with("0123456789ab,\"NVIDIA \"\"X\"\", large\",1.2,4000,A,row,1,16,packed,overview,1920,1080,1,"));
  CHECK(commas(first) == commas(header) + 1);  // one comma lies inside the quotes
  CHECK(commas(second) == commas(header) + 1);
  CHECK(second.ends_with(",0.5,5,0.25,0.125,inf,,,,,"));
  CHECK(first.ends_with(",,,,,,,,,,"));
  result.error = {};
  result.peer = PeerComparison{{900, 80, 15, 5, 0.25}, 1.5};
  CHECK(bench::csv_values(case_cells(machine, result)).ends_with(",,900,80,15,5,0.25"));
}

TEST_CASE("lab: rows are not appended to a file with other columns", "[lab]") {
  const tests::TempFolder folder;
  const std::string path = folder.file("other.csv");
  std::ofstream(path) << "a,b\n1,2\n";
  check_refusal(bench::append_csv(path, case_cells({}, sample_result())), ErrorCode::kFormat, "other.csv: line 1");
  CHECK(tests::read_whole(path) == "a,b\n1,2\n");
  // A row that does not fit on the disk leaves nothing.
  const std::string full = folder.file("full.csv");
  REQUIRE(bench::append_csv(full, {{"a", "1"}}));
  CHECK_FALSE(tests::on_full_disk(6, [&] { return bench::append_csv(full, {{"a", "12345"}}); }));
  CHECK(tests::read_whole(full) == "a\n1\n");

  CHECK(refusal(bench::append_csv(folder.file("none/rows.csv"), {{"a", "1"}})).code == ErrorCode::kFile);
}

TEST_CASE("lab: tables leave out cases that were not timed", "[lab]") {
  CaseResult result = sample_result();
  const std::string whole = times_table({&result, 1});
  CHECK(whole.find(" - ") != std::string::npos);
  CHECK(whole.find("2.000") != std::string::npos);
  result.raster = Times{0.5, 0.5, 0, 0.5, 0.5};
  CHECK(result.triangles_per_s() == 2000 / 0.5e-3);
  CHECK(result.culled_triangles() == 500);
  result.touched_bytes = 2'000'000;  // 4 GB/s
  CHECK(counts_table({&result, 1}, Machine{{}, 40}).find("10.0%") != std::string::npos);
}

TEST_CASE("lab: peers have their own table, beside scree's frames", "[lab]") {
  CaseResult results[2] = {sample_result(), sample_result()};
  results[1].indices = "VK-ID";
  results[1].raster = Times{3, 2, 1, 3, 3};
  results[1].peer = PeerComparison{{900, 80, 15, 5, 0.25}, 2};
  const std::string table = peer_table(results);
  CHECK(std::count(table.begin(), table.end(), '\n') == 3);  // header, rule, one row
  for (const char* cell : {"VK-ID", "3.000", "90.0000%", "8.0000%", "1.5000%", " 5 ", "0.25"})
    CHECK(table.find(cell) != std::string::npos);
}

TEST_CASE("lab: pictures are compared by triangle, depth and colour", "[lab]") {
  const kernels::View view = scene_view({"v", {0, 0, 0}, {1, 0, 0}}, 2, 2);
  const uint32_t near_code = 1u << 20;
  const uint32_t far_code = near_code + (1u << 10);
  HostPicture reference;
  reference.samples = {kernels::pack_sample(near_code, 1), kernels::pack_sample(near_code, 2), kernels::kBackground,
                       kernels::pack_sample(near_code, 4)};
  reference.pixels.assign(16, 100);
  CHECK(compare_pictures(view, reference, reference).wrong_pixels == 0);
  CHECK(std::isinf(compare_pictures(view, reference, reference).psnr_db));
  HostPicture other = reference;
  other.samples[0] = kernels::pack_sample(far_code, 1);  // deeper
  other.samples[1] = kernels::pack_sample(near_code, 3);
  other.samples[3] = kernels::kBackground;
  other.pixels[0] = 110;
  other.pixels[3] = 0;  // alpha does not count
  const PictureError error = compare_pictures(view, other, reference);
  CHECK(error.wrong_pixels == 2);
  const double ratio = kernels::depth_of_code(view, far_code) / kernels::depth_of_code(view, near_code) - 1;
  CHECK(error.depth_error_max == Approx(ratio));
  CHECK(error.depth_error_rms == Approx(ratio / std::sqrt(2.0)));
  CHECK(error.psnr_db == Approx(10 * std::log10(255.0 * 255.0 / (100.0 / 12))));
}

TEST_CASE("lab: the near plane may be a share of the scene's size, and the view's name has the share", "[lab]") {
  const synth::Scene scene = make_scene("D", synth::MeshOrder::kRow, 1);
  const std::vector<ChunkPlan> plans = plan_chunks(scene);
  const SceneTables tables =
      must(make_tables(scene, plans, scree::tests::chunk_boxes(scene, plans), {false, 16, true}));
  const kernels::SceneView view = tables.view(nullptr);
  const NamedView named = with_near({"inside", {scene_view(scene.cameras[0], 64, 32)}}, view, 1e-6);
  CHECK(named.name == "inside near 1e-06");
  const runtime::WorldBox box = runtime::scene_box(view);
  CHECK(named.frames[0].z_near ==
        Approx(1e-6 * std::hypot(box.max[0] - box.min[0], box.max[1] - box.min[1], box.max[2] - box.min[2])));
}

TEST_CASE("lab: the path goes from a scene's first view to its second", "[lab]") {
  const synth::Scene scene = make_scene("D", synth::MeshOrder::kRow, 1);
  const std::vector<kernels::View> path = path_views(scene.cameras, 64, 32);
  REQUIRE(path.size() == kPathFrames);
  for (size_t i = 0; i < 3; ++i) {
    CHECK(path.front().eye[i] == scene.cameras[0].eye[i]);
    CHECK(path.back().eye[i] == Approx(scene.cameras[1].eye[i]));
  }
  CHECK(path.front().half_height == Approx(std::tan(0.5235987755982988)));
  CHECK(path.front().half_width == Approx(2 * path.front().half_height));
}
