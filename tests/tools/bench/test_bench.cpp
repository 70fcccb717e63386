// scree bench: the cached share of a file, and the report of a file's loads and frames.
#include <filesystem>
#include <string>
#include <vector>

#include "tests/csv.h"
#include "tests/runtime/paged_scene.h"
#include "tests/tools/block_model.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/run_program.h"
#include "tools/bench/bench.h"
#include "tools/bench/file_cache.h"
#include "tools/bench/times.h"

using namespace scree;
using namespace scree::bench;
using tests::TempFolder;

namespace {

/// A file of raw and compressed pages, every third one compressed.
std::string paged_file(const TempFolder& folder) {
  const std::string path = folder.file("paged.scree");
  tests::Encoding floats{.float32 = true};
  tests::PagedScene{}.write(path, {{tests::grid(40, 0.2), {}}, {tests::grid(25, 0.1), floats}});
  return path;
}

BenchOptions small_options() {
  BenchOptions options;
  options.size = {64, 48};
  options.threads = 2;
  options.repeats = 2;
  options.frames = 3;
  options.warmup = 1;
  options.quiet = true;
  return options;
}

}  // namespace

TEST_CASE("bench: the cached share of a file is measured", "[bench_tool]") {
  const TempFolder folder;
  const std::string path = folder.write("bytes", std::string(300'000, 'x'));
  const double brought = must(bring_to_cache(path));
  CHECK(must(cached_share(path)) == brought);
  const double dropped = must(drop_from_cache(path));
  CHECK(dropped >= 0);
  CHECK(dropped <= brought);
  if (brought < 1) WARN("the page cache does not hold files of the folder for temporary files");
  if (dropped > 0) WARN("the page cache keeps files of the folder for temporary files");

  const std::string empty = folder.write("empty", "");
  CHECK(*bring_to_cache(empty) == 0);
  CHECK(*drop_from_cache(empty) == 0);
  for (const auto& missing :
       {cached_share(folder.file("none")), drop_from_cache(folder.file("none")), bring_to_cache(folder.file("none"))}) {
    REQUIRE_FALSE(missing);
    CHECK(missing.error().code == ErrorCode::kFile);
  }
}

TEST_CASE("bench: times are reported by median, minimum, maximum and mean", "[bench_tool]") {
  const std::vector<float> odd{3, 1, 2};
  CHECK(summarize(odd).median == 2);
  CHECK(summarize(odd).minimum == 1);
  CHECK(summarize(odd).spread == 2);
  CHECK(summarize(odd).worst == 3);
  const std::vector<float> even{4, 1, 3, 2};
  CHECK(summarize(even).median == 2.5);
  CHECK(summarize(even).mean == 2.5);
}

TEST_CASE("bench: frames are counted, and an error ends them", "[bench_tool]") {
  uint32_t drawn = 0;
  CHECK(must(timed_frames(5, 3, [&]() -> Result<float> { return static_cast<float>(drawn++); })) ==
        std::vector<float>{3, 4, 5, 6, 7});
  CHECK(refusal(timed_frames(5, 0, [&]() -> Result<float> {
          return Error{ErrorCode::kDevice, "gone"};
        })).message == "gone");
}

TEST_CASE("bench: a file's loads and frames are measured on the CPU", "[bench_tool]") {
  const TempFolder folder;
  const std::string path = paged_file(folder);
  const FileResult file = must(measure_file(path, small_options(), false));
  CHECK(file.file_bytes == std::filesystem::file_size(path));
  CHECK(file.unique_triangles == 2 * (40 * 40 + 25 * 25));
  CHECK(file.drawn_triangles >= file.unique_triangles);
  REQUIRE(file.loads.size() == 2);
  for (const LoadResult& load : file.loads) {
    CHECK(load.load.median > 0);
    CHECK(load.load.minimum <= load.load.median);
    CHECK(load.first_picture.median > load.load.minimum);
    CHECK(load.read_bytes == file.file_bytes);
    CHECK(load.device_bytes > load.read_bytes / 2);
    CHECK(load.gb_per_s() > 0);
  }
  CHECK(file.loads[0].is_cold);
  CHECK_FALSE(file.loads[1].is_cold);
  CHECK(file.loads[0].cached_share <= file.loads[1].cached_share);
  REQUIRE(file.views.size() == 1);
  const ViewResult& view = file.views[0];
  CHECK(view.name == "default");
  CHECK(view.frames == 3);
  CHECK(view.draw.minimum > 0);
  CHECK(view.shade.minimum > 0);
  CHECK(view.first_ms > 0);
  CHECK_FALSE(view.streamed_bytes);
  CHECK(must(measure_file(path, small_options(), false)).views[0].picture == view.picture);
  BenchOptions finer = small_options();
  finer.samples_per_side = 2;
  CHECK(must(measure_file(path, finer, false)).views[0].picture != view.picture);

  BenchOptions options = small_options();
  options.cameras = {"nowhere"};
  CHECK(refusal(measure_file(path, options, false)).message.find("nowhere") != std::string::npos);
}

TEST_CASE("bench: pages of textures that loading leaves in the file are not counted as read", "[bench_tool]") {
  const TempFolder folder;
  tests::make_block_model(folder.file("in.glb"), tests::large_block_files());
  const convert::ConvertOptions options = tests::options_of(folder);
  tests::must_convert(options);
  const runtime::Scene scene = tests::must_load(options.output, {.texture_memory = 1 << 30});
  REQUIRE(scene.block_pager() != nullptr);
  uint64_t left = 0;
  for (const uint32_t page : scene.block_pager()->file_pages()) left += scene.container().pages()[page].stored_bytes;
  CHECK(left > 1'000'000);
  const FileResult file = must(measure_file(options.output, small_options(), false));
  for (const LoadResult& load : file.loads) CHECK(load.read_bytes == file.file_bytes - left);
}

TEST_CASE("bench: the report has the file's loads and frames", "[bench_tool]") {
  BenchReport report{small_options(), {"0123456789ab", "NVIDIA \"X\"", "580"}, {FileResult{}}};
  FileResult& file = report.files[0];
  file.file = "a.scree";
  file.loads.resize(2);
  file.loads[0].is_cold = true;
  file.loads[0].cached_share = 0.37;
  file.loads[0].read_bytes = 3'000'000'000;
  file.loads[0].load = file.loads[0].first_picture = summarize(std::vector<float>{1500});
  file.loads[1].cached_share = 1;
  file.loads[1].load = file.loads[1].first_picture = summarize(std::vector<float>{500});
  ViewResult view{.name = "front"};
  view.draw = view.shade = summarize(std::vector<float>{0.5});
  file.views.push_back(view);
  const std::string text = bench_text(report);
  INFO(text);
  CHECK(text.find("NVIDIA \"X\", driver 580, 2 threads; commit 0123456789ab") != std::string::npos);
  CHECK(text.find("not dropped, 37% cached") != std::string::npos);
  CHECK(text.find("page cache") != std::string::npos);
  CHECK(text.find(" 2.00") != std::string::npos);  // GB/s
  CHECK(text.find("streamed") == std::string::npos);
  file.views[0].streamed_bytes = 4096;
  CHECK(bench_text(report).find("streamed") != std::string::npos);
  const std::string json = bench_json(report);
  INFO(json);
  CHECK(json.find("\"device\":\"NVIDIA \\\"X\\\"\"") != std::string::npos);
  CHECK(json.find("\"streamed_bytes\":4096") != std::string::npos);
}

TEST_CASE("bench: the program prints tables or JSON and appends rows", "[bench_tool]") {
  const TempFolder folder;
  const std::string path = paged_file(folder);
  const std::string csv = folder.file("rows.csv");
  const std::string line =
      "bench " + path + " --backend cpu --repeats 1 --frames 2 --warmup 0 --size 32x32 --csv " + csv;
  const auto run = tests::must_run(tests::words_of(line), folder.file("log"));
  CHECK(run.output.find("first picture s") != std::string::npos);
  const auto json = tests::must_run(tests::words_of(line + " --json -q"), folder.file("log"));
  CHECK(json.output.starts_with("{\"commit\":"));
  CHECK(json.output.ends_with("]}\n"));
  const std::vector<tests::CsvRow> rows = tests::read_csv(csv);
  REQUIRE(rows.size() == 2);
  CHECK(rows[0].at("file") == path);
  CHECK(rows[0].at("picture") == rows[1].at("picture"));
  CHECK(std::stod(rows[0].at("draw_ms")) > 0);
  CHECK(std::stod(rows[0].at("cache_load_ms")) > 0);

  // A damaged file gives render's error, after the results that were measured before.
  const std::string damaged = folder.write("cut.scree", tests::read_whole(path).substr(0, 9000));
  const auto cut = tests::run_program(
      tests::words_of("bench --backend cpu --repeats 1 --frames 1 --size 32x32 " + path + " " + damaged),
      folder.file("log"));
  INFO(cut.output);
  CHECK(cut.exit_code == 3);
  CHECK(cut.output.find("cut.scree: ") != std::string::npos);
  CHECK(cut.output.find("paged.scree: ") != std::string::npos);
}
