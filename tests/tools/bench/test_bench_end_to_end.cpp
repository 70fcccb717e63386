// scree bench --end-to-end: one scene from glTF to picture, and nothing left behind.
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "tests/catch.h"
#include "tests/paths.h"
#include "tests/tools/bench/refused_bench.h"
#include "tests/tools/run_program.h"
#include "tests/tools/temp_folder.h"
#include "tools/bench/disk/end_to_end.h"
#include "tools/bench/report/plot.h"
#include "tools/bench/setup/timed_frames.h"
#include "tools/convert/convert.h"
#include "tools/synth/synth.h"

using namespace scree;
using namespace scree::bench;
using tests::TempFolder;

namespace {

using Row = std::map<std::string, std::string>;

struct Story {
  int exit_code = 0;
  std::string output;
  Row row;  // of the CSV file; empty where there is none
};

/// Runs a small scene on the CPU, its files in a folder of their own, of which nothing may be left.
Story run_story(const std::vector<std::string>& words) {
  const TempFolder folder;
  const std::string csv = folder.file("rows.csv");
  std::filesystem::create_directory(folder.file("work"));
  std::vector<std::string> all{"bench",     "--end-to-end",
                               "--backend", "cpu",
                               "--repeats", "1",
                               "--frames",  "2",
                               "--warmup",  "0",
                               "--size",    "64x48",
                               "--threads", "2",
                               "--csv",     csv,
                               "--work",    folder.file("work")};
  all.insert(all.end(), words.begin(), words.end());
  const auto run = tests::run_program(all, folder.file("log"));
  CHECK(std::filesystem::is_empty(folder.file("work")));
  Story story{run.exit_code, run.output, {}};
  if (!std::filesystem::exists(csv)) return story;
  const Result<CsvTable> table = read_csv(csv);
  REQUIRE(table);
  REQUIRE(table->rows.size() == 1);
  for (size_t i = 0; i < table->columns.size(); ++i) story.row[table->columns[i]] = table->rows[0][i];
  return story;
}

double number(const Row& row, const std::string& column) {
  INFO(column);
  REQUIRE(row.contains(column));
  REQUIRE_FALSE(row.at(column).empty());
  return std::stod(row.at(column));
}

std::string refused_story(const BenchWords& words) {
  return tests::refusal(parse_end_to_end(words));
}

}  // namespace

TEST_CASE("bench --end-to-end: a generated scene, packed, loaded and drawn", "[bench_end]") {
  for (const char* indices : {"packed", "clustered"}) {
    const Story story = run_story({"--scene", "A", "--scale", "0.0005", "--indices", indices, "--view", "overview"});
    INFO(story.output);
    REQUIRE(story.exit_code == 0);
    for (const char* line :
         {"disk alone", "peak memory", "load, cold", "frame at 25%", "the same picture", "position error"})
      CHECK(story.output.find(line) != std::string::npos);
    const Row& row = story.row;
    CHECK(row.at("view") == "overview");
    CHECK(row.at("encoding") == std::string("16-bit, ") + indices);
    const double triangles = number(row, "unique_triangles");
    CHECK(triangles > 150'000);
    CHECK(number(row, "drawn_triangles") == triangles);
    CHECK(number(row, "gltf_bytes") > 12 * triangles);
    CHECK(number(row, "bits_per_triangle") == Approx(8 * number(row, "scree_bytes") / triangles).epsilon(1e-4));
    CHECK(number(row, "scree_bytes") < number(row, "gltf_bytes"));
    CHECK(number(row, "peak_bytes") > 0);
    CHECK(number(row, "peak_bytes") < number(row, "memory"));
    CHECK(number(row, "position_error") > 0);
    CHECK(number(row, "position_error") <= number(row, "position_bound"));
    CHECK(number(row, "first_frame_s") > number(row, "load_s"));
    CHECK(number(row, "frames") >= 1);
    CHECK(number(row, "frame_ms") > 0);
    // The disk by itself, in the same run. A processor streams over no link.
    if (!row.at("raw_gb_per_s").empty()) {
      CHECK(number(row, "raw_write_bytes") >= number(row, "scree_bytes"));
      CHECK(number(row, "raw_write_bytes") < number(row, "scree_bytes") + 4096);
      CHECK(number(row, "disk_s") == Approx(number(row, "gltf_bytes") * 1e-9 / number(row, "gltf_raw_gb_per_s") +
                                            number(row, "scree_bytes") * 1e-9 / number(row, "raw_write_gb_per_s"))
                                         .epsilon(1e-4));
      CHECK(number(row, "convert_s_over_disk_s") ==
            Approx(number(row, "convert_s") / number(row, "disk_s")).epsilon(1e-4));
    }
    for (const char* column :
         {"link_gb_per_s", "streamed_first_gb_per_s", "streamed_first_link_share", "streamed_first_disk_share",
          "streamed_gb_per_s", "streamed_link_share", "streamed_disk_share"})
      CHECK(row.at(column).empty());
    // A quarter of the chunks: all of them are seen, so that some are loaded in every frame.
    CHECK(number(row, "wrong_samples") == 0);
    CHECK(number(row, "budget_bytes") < 0.5 * number(row, "device_bytes"));
    CHECK(number(row, "streamed_first_bytes") > number(row, "budget_bytes"));
    CHECK(number(row, "streamed_bytes") <= number(row, "streamed_first_bytes"));
    CHECK(number(row, "streamed_bytes") > 0);
  }
}

TEST_CASE("bench --end-to-end: a model's own file stays", "[bench_end]") {
  const TempFolder folder;
  const std::string model = folder.file("cube.glb");
  std::filesystem::copy_file(std::filesystem::path(tests::kDataFolder) / "textured_cube.glb", model);
  const std::string before = tests::read_whole(model);
  const Story story = run_story({model, "--positions", "12"});
  INFO(story.output);
  REQUIRE(story.exit_code == 0);
  CHECK(story.row.at("scene") == "cube.glb");
  CHECK(story.row.at("encoding") == "12-bit, packed");
  CHECK(number(story.row, "gltf_bytes") == static_cast<double>(before.size()));
  CHECK(number(story.row, "wrong_samples") == 0);
  CHECK(tests::read_whole(model) == before);

  const Story cut = run_story({folder.write("cut.glb", before.substr(0, 700))});
  CHECK(cut.exit_code == 3);
  CHECK(cut.output.find("cut.glb") != std::string::npos);
  const Story little = run_story({model, "--memory", "1MiB"});
  INFO(little.output);
  CHECK(little.exit_code == 1);
}

TEST_CASE("bench --end-to-end: the room asked for holds what is written", "[bench_end]") {
  const TempFolder folder;
  for (const auto& [name, scale] : {std::pair{"A", 0.0005}, std::pair{"C", 1e-6}, std::pair{"D", 1.0}}) {
    INFO(name);
    const synth::Scene scene = make_scene(name, synth::MeshOrder::kRow, scale);
    synth::SynthOptions options;
    options.output = folder.file("scene.gltf");
    options.threads = 2;
    const auto written = synth::write_scene(scene, options);
    REQUIRE(written);
    convert::ConvertOptions convert;
    convert.input = options.output;
    convert.float32 = true;  // what takes the most
    convert.threads = 2;
    const auto packed = convert::convert(convert);
    REQUIRE(packed);
    CHECK(room_for(scene) / 2 >= written->file_bytes);
    CHECK(room_for(scene) / 2 >= packed->output_bytes);
  }
}

TEST_CASE("bench --end-to-end: words that cannot be are refused with what can", "[bench_end]") {
  BenchWords words;
  CHECK(refused_story(words).find("one --scene") != std::string::npos);
  words.scenes = "C";
  const Result<EndToEndOptions> options = parse_end_to_end(words);
  REQUIRE(options);
  REQUIRE(options->bench.encodings.size() == 1);
  CHECK(encoding_name(options->bench.encodings[0]) == "16-bit, packed");
  CHECK(options->memory == uint64_t{2} << 30);
  const auto with = [&](auto member, auto value) {
    BenchWords changed = words;
    changed.*member = value;
    return refused_story(changed);
  };
  CHECK(with(&BenchWords::scenes, "A,C").find("one --scene") != std::string::npos);
  CHECK(with(&BenchWords::scenes, "textured").find("one --scene") != std::string::npos);
  CHECK(with(&BenchWords::scenes, "E").find("\"E\"") != std::string::npos);
  CHECK(with(&BenchWords::files, std::vector<std::string>{"a.gltf"}).find("one glTF") != std::string::npos);
  CHECK(with(&BenchWords::positions, "12,16").find("one of --positions") != std::string::npos);
  CHECK(with(&BenchWords::indices, "32").find("packed or clustered") != std::string::npos);
  CHECK(with(&BenchWords::views, "overview,closeup").find("one --view") != std::string::npos);
  CHECK(with(&BenchWords::views, "inside").find("overview") != std::string::npos);
  CHECK(with(&BenchWords::scale, 1.5).find("--scale") != std::string::npos);
  CHECK(with(&BenchWords::memory, "much").find("--memory") != std::string::npos);
  CHECK(with(&BenchWords::backend, "gpu").find("auto, cpu or cuda") != std::string::npos);
  CHECK(with(&BenchWords::repeats, 0u).find("--repeats") != std::string::npos);
}

TEST_CASE("bench: frames are counted, and an error ends them", "[bench_end]") {
  uint32_t drawn = 0;
  const auto times = timed_frames(3, 2, [&]() -> Result<float> { return static_cast<float>(++drawn); });
  REQUIRE(times);
  CHECK(*times == std::vector<float>{3, 4, 5});
  const auto failed = timed_frames(3, 0, [&]() -> Result<float> { return Error{ErrorCode::kDevice, "gone"}; });
  REQUIRE_FALSE(failed);
  CHECK(failed.error().message == "gone");
}

TEST_CASE("bench --end-to-end: what a backend cannot do has its reason", "[bench_end]") {
  EndToEndRow row;
  row.scene = "C";
  row.unique_triangles = 1;
  row.not_streamed = "too little";
  CHECK(end_to_end_table(row).find("- (too little)") != std::string::npos);
  const std::string values = csv_values(end_to_end_cells({}, row));
  CHECK(values.ends_with(",,,,,,,,,,,,,,,"));
  CHECK(end_to_end_table(row).find("- (no raw reads or writes)") != std::string::npos);
  row.streamed = EndToEndRow::Streamed{};
  row.streamed->wrong_samples = 7;
  CHECK(end_to_end_table(row).find("7 samples differ") != std::string::npos);
}

TEST_CASE("bench --end-to-end: shares of the disk's rate and of the link's", "[bench_end]") {
  EndToEndRow row;
  row.unique_triangles = 1;
  row.gltf_bytes = 26'000'000'000;
  row.scree_bytes = 5'000'000'000;
  row.convert_s = 18;
  row.gltf_raw_gb_per_s = 2.6;
  row.raw_write = {4'000'000'000, 1.6};
  row.load.raw_gb_per_s = 2;
  row.streamed = EndToEndRow::Streamed{};
  row.streamed->first_ms = 1000;
  row.streamed->first_bytes = 3'000'000'000;
  row.streamed->then.median = 50;
  row.streamed->then_bytes = 2'000'000'000;
  row.streamed->link_gb_per_s = 50;
  Row cells;
  for (const auto& [column, value] : end_to_end_cells({}, row)) cells[column] = value;
  CHECK(number(cells, "raw_write_gb_per_s") == 2.5);
  CHECK(number(cells, "disk_s") == 12);
  CHECK(number(cells, "convert_s_over_disk_s") == 1.5);
  CHECK(number(cells, "streamed_first_gb_per_s") == 3);
  CHECK(number(cells, "streamed_first_link_share") == 0.06);
  CHECK(number(cells, "streamed_first_disk_share") == 1.5);
  CHECK(number(cells, "streamed_gb_per_s") == 40);
  CHECK(number(cells, "streamed_link_share") == 0.8);
  CHECK(number(cells, "streamed_disk_share") == 20);
  CHECK(number(cells, "link_gb_per_s") == 50);
  const std::string table = end_to_end_table(row);
  CHECK(
      table.find("12.0 s to read the glTF once at 2.60 GB/s and write the .scree once at 2.50; convert took 1.50 times "
                 "that") != std::string::npos);
  CHECK(table.find("at 3.00 GB/s, 0.06 of the link, 1.50 of the raw disk") != std::string::npos);
  CHECK(table.find("at 40.00 GB/s, 0.80 of the link, 20.00 of the raw disk; the link gives 50.00 GB/s") !=
        std::string::npos);

  // Without raw reads, and of a backend that does not say what it loaded.
  row.load.raw_gb_per_s = row.gltf_raw_gb_per_s = 0;
  row.streamed->then_bytes.reset();
  cells.clear();
  for (const auto& [column, value] : end_to_end_cells({}, row)) cells[column] = value;
  for (const char* column : {"disk_s", "convert_s_over_disk_s", "streamed_first_disk_share", "streamed_disk_share",
                             "streamed_gb_per_s", "streamed_link_share"})
    CHECK(cells[column].empty());
  CHECK(number(cells, "streamed_first_link_share") == 0.06);
}
