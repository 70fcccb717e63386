// scree bench --load: what is cached, what the raw disk gives, and that every way of loading brings the same scene.
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "tests/catch.h"
#include "tests/runtime/paged_scene.h"
#include "tests/tools/bench/refused_bench.h"
#include "tests/tools/run_program.h"
#include "tests/tools/temp_folder.h"
#include "tools/bench/disk/file_cache.h"
#include "tools/bench/disk/load_report.h"
#include "tools/bench/disk/raw_disk.h"
#include "tools/bench/disk/timed_load.h"
#include "tools/bench/report/plot.h"

using namespace scree;
using namespace scree::bench;
using tests::TempFolder;

namespace {

constexpr LoadWay kCpuWays[] = {LoadWay::kMap, LoadWay::kArenaMapped, LoadWay::kArenaBuffered, LoadWay::kArenaDirect};

/// A file of raw and compressed pages, every third one compressed.
std::string paged_file(const TempFolder& folder) {
  const std::string path = folder.file("paged.scree");
  tests::Encoding floats;
  floats.float32 = true;
  tests::PagedScene{}.write(path, {{tests::grid(40, 0.2), {}}, {tests::grid(25, 0.1), floats}});
  return path;
}

LoadSettings small_settings() {
  LoadSettings settings;
  settings.threads = 2;
  settings.size = {64, 48};
  return settings;
}

LoadRow row_of(const std::string& file, bool is_cold, uint64_t bytes, double resident_ms) {
  LoadRow row;
  row.file = file;
  row.is_cold = is_cold;
  row.last.read_bytes = bytes;
  row.last.file_bytes = bytes;
  row.resident.median = resident_ms;
  return row;
}

std::string refused_loads(const BenchWords& words) {
  return tests::refusal(parse_loads(words));
}

}  // namespace

TEST_CASE("bench --load: what the page cache has of a file", "[bench_load]") {
  const TempFolder folder;
  const std::string path = folder.write("bytes", std::string(300'000, 'x'));
  const Result<double> brought = bring_to_cache(path);
  REQUIRE(brought);
  const Result<double> looked = cached_share(path);
  REQUIRE(looked);
  CHECK(*looked == *brought);
  const Result<double> dropped = drop_from_cache(path);
  REQUIRE(dropped);
  CHECK(*dropped >= 0);
  CHECK(*dropped <= *brought);
  if (*brought < 1) WARN("the folder for temporary files does not go through the page cache");
  if (*dropped > 0) WARN("files in the folder for temporary files do not leave the page cache");

  const std::string empty = folder.write("empty", "");
  CHECK(*bring_to_cache(empty) == 0);
  CHECK(*drop_from_cache(empty) == 0);
  CHECK(read_raw(empty, 1)->bytes == 0);
  for (const auto& missing :
       {cached_share(folder.file("none")), drop_from_cache(folder.file("none")), bring_to_cache(folder.file("none"))}) {
    REQUIRE_FALSE(missing);
    CHECK(missing.error().code == ErrorCode::kFile);
  }
}

TEST_CASE("bench --load: a raw read takes all of a file, of any size", "[bench_load]") {
  const TempFolder folder;
  for (const auto& [bytes, in_flight] : {std::pair{uint64_t{1}, 16u}, std::pair{uint64_t{4096}, 1u},
                                         std::pair{kRawBlockBytes + 1, 4u}, std::pair{3 * kRawBlockBytes, 2u}}) {
    const Result<RawRate> raw = read_raw(folder.write("bytes", std::string(bytes, 'x')), in_flight);
    if (!raw) {
      CHECK(raw.error().code == ErrorCode::kUnsupported);
      WARN("the folder for temporary files has no direct reads");
      return;
    }
    CHECK(raw->bytes == bytes);
    CHECK(raw->gb_per_s() > 0);
  }
}

TEST_CASE("bench: a raw write takes what it was asked for and leaves nothing", "[bench_load]") {
  const TempFolder folder;
  for (const uint64_t bytes : {uint64_t{1}, uint64_t{4096}, kRawBlockBytes + 1, 3 * kRawBlockBytes}) {
    CAPTURE(bytes);
    const Result<RawRate> raw = write_raw(folder.file("raw"), bytes);
    CHECK(folder.names().empty());
    if (!raw) {
      CHECK(raw.error().code == ErrorCode::kUnsupported);
      WARN("the folder for temporary files has no direct writes");
      return;
    }
    CHECK(raw->bytes == (bytes + 4095) / 4096 * 4096);
    CHECK(raw->gb_per_s() > 0);
  }
  folder.write("there", "already");
  const Result<RawRate> twice = write_raw(folder.file("there"), 4096);
  REQUIRE_FALSE(twice);
  CHECK(twice.error().code == ErrorCode::kFile);
  CHECK(tests::read_whole(folder.file("there")) == "already");
  const Result<RawRate> nowhere = write_raw(folder.file("none/raw"), 4096);
  REQUIRE_FALSE(nowhere);
  CHECK(nowhere.error().code == ErrorCode::kFile);
}

TEST_CASE("bench: a rate is steady once two rounds hardly change it", "[bench_load]") {
  using Rates = std::vector<double>;
  CHECK_FALSE(is_steady(Rates{}));
  CHECK_FALSE(is_steady(Rates{2, 2}));
  CHECK(is_steady(Rates{2, 2, 2}));
  CHECK(is_steady(Rates{4, 3, 2, 2.03, 2}));
  CHECK_FALSE(is_steady(Rates{2, 2, 2.05}));
  CHECK_FALSE(is_steady(Rates{2.05, 2, 2}));
  CHECK_FALSE(is_steady(Rates{2, 2, 2, 1.9}));
}

TEST_CASE("bench --load: every way brings the same scene", "[bench_load]") {
  const TempFolder folder;
  const std::string path = paged_file(folder);
  const Result<uint64_t> bytes = arena_bytes(path);
  REQUIRE(bytes);
  const Result<HostArena> arena = HostArena::allocate(*bytes);
  REQUIRE(arena);
  const bool has_direct = static_cast<bool>(read_raw(path, 2));
  std::vector<TimedLoad> loads;
  for (const LoadWay way : kCpuWays) {
    INFO(load_way_name(way));
    const Result<TimedLoad> load = timed_load(path, way, *arena, small_settings());
    REQUIRE(load);
    CHECK(load->resident_s > 0);
    CHECK(load->first_frame_s > load->resident_s);
    CHECK(load->file_bytes == std::filesystem::file_size(path));
    CHECK(load->read_bytes == load->file_bytes);
    CHECK((load->direct_bytes > 0) == (way == LoadWay::kArenaDirect && has_direct));
    loads.push_back(*load);
  }
  for (const TimedLoad& load : loads) {
    CHECK(load.picture == loads[0].picture);
    CHECK(load.device_bytes == loads[0].device_bytes);
  }
  CHECK(loads[0].device_bytes > loads[0].read_bytes / 2);

  const HostArena none;
  REQUIRE_FALSE(timed_load(path, LoadWay::kArenaMapped, none, small_settings()));
  LoadSettings settings = small_settings();
  settings.view = "nowhere";
  const Result<TimedLoad> no_view = timed_load(path, LoadWay::kMap, none, settings);
  REQUIRE_FALSE(no_view);
  CHECK(no_view.error().message.find("nowhere") != std::string::npos);
}

TEST_CASE("bench --load: an arena larger than memory is refused", "[bench_load]") {
  const Result<HostArena> arena = HostArena::allocate(uint64_t{1} << 50);
  REQUIRE_FALSE(arena);
  CHECK(arena.error().code == ErrorCode::kMemory);
  CHECK(arena.error().message.find("available") != std::string::npos);
}

TEST_CASE("bench --load: rows of every way, from the disk and from the page cache", "[bench_load]") {
  const TempFolder folder;
  const std::string path = paged_file(folder);
  std::vector<std::string> notes;
  const auto rows = measure_loads(path, {std::begin(kCpuWays), std::end(kCpuWays)}, true, 3, small_settings(), notes);
  REQUIRE(rows);
  REQUIRE(rows->size() == 7);  // direct reads never come from the page cache
  const bool has_raw = static_cast<bool>(read_raw(path, 2));
  CHECK(notes.empty() == has_raw);
  for (const LoadRow& row : *rows) {
    CHECK(row.file == "paged.scree");
    CHECK(row.resident.median > 0);
    CHECK(row.resident.minimum <= row.resident.median);
    CHECK(row.first_frame.median > row.resident.minimum);
    CHECK(row.gb_per_s() > 0);
    CHECK((row.raw_gb_per_s > 0) == has_raw);
  }
  CHECK(rows->front().is_cold);
  CHECK_FALSE(rows->back().is_cold);
  CHECK(rows->front().cached_share <= rows->back().cached_share);
  const auto cold_only = measure_loads(path, {LoadWay::kMap}, false, 1, small_settings(), notes);
  REQUIRE(cold_only);
  CHECK(cold_only->size() == 1);
  CHECK(disk_table(*cold_only).empty());
}

TEST_CASE("bench --load: a disk's rate or the processors', whichever is slower", "[bench_load]") {
  const std::vector<LoadRow> rows{row_of("raw", true, 3'000'000'000, 9000), row_of("raw", false, 3'000'000'000, 800),
                                  row_of("raw", false, 3'000'000'000, 500), row_of("packed", true, 9, 9),
                                  row_of("packed", false, 1'500'000'000, 700)};
  const std::string table = disk_table(rows);
  INFO(table);
  const auto line_of = [&](const std::string& name) {
    const size_t from = table.find(name + " ");
    REQUIRE(from != std::string::npos);
    return table.substr(from, table.find('\n', from) - from);
  };
  const std::string raw = line_of("raw");
  CHECK(raw.find("0.500") != std::string::npos);                        // the faster of two
  CHECK(raw.find("3.00   ") != std::string::npos);                      // 1 GB/s
  CHECK(raw.find("1.00") != std::string::npos);                         // 3 GB/s
  CHECK(raw.ends_with("0.500"));                                        // 7 GB/s: the processors
  CHECK(line_of("packed").find("1.50") != std::string::npos);           // 1 GB/s
  CHECK(line_of("packed").find("0.700   0.700") != std::string::npos);  // 3 and 7 GB/s

  LoadRow kept = row_of("raw", true, 1, 1);
  kept.cached_share = 0.37;
  CHECK(load_table({kept}).find("not dropped, 37% cached") != std::string::npos);
  kept.is_cold = false;
  CHECK(load_table({kept}).find(" 37% cached") != std::string::npos);
}

TEST_CASE("bench --load: words that cannot be are refused with what can", "[bench_load]") {
  BenchWords words;
  CHECK(refused_loads(words) == "--load takes .scree files");
  words.files = {"a.scree", "b.scree"};
  REQUIRE(parse_loads(words));
  CHECK(parse_loads(words)->files.size() == 2);
  CHECK(parse_loads(words)->settings.threads > 0);
  const auto with = [&](auto member, auto value) {
    BenchWords changed = words;
    changed.*member = value;
    return refused_loads(changed);
  };
  CHECK(with(&BenchWords::repeats, 0u) == "--repeats is at least 1");
  CHECK(with(&BenchWords::backend, "gpu").find("auto, cpu or cuda") != std::string::npos);
  CHECK(with(&BenchWords::threads, "many").find("--threads") != std::string::npos);
  CHECK(with(&BenchWords::size, "8").find("WxH") != std::string::npos);
  CHECK(with(&BenchWords::views, "a,b") == "--load draws one --view");
}

TEST_CASE("bench --load: the program prints tables and appends rows", "[bench_load]") {
  const TempFolder folder;
  const std::string path = paged_file(folder);
  const std::string csv = folder.file("load.csv");
  const std::vector<std::string> words{"bench",  "--load", path,    "--backend", "cpu",       "--repeats", "1",
                                       "--size", "32x32",  "--csv", csv,         "--threads", "2"};
  const auto run = tests::run_program(words, folder.file("log"));
  INFO(run.output);
  REQUIRE(run.exit_code == 0);
  CHECK(run.output.find("from other disks") != std::string::npos);
  const Result<CsvTable> table = read_csv(csv);
  REQUIRE(table);
  CHECK(table->rows.size() == 7);

  // What is no .scree file, or a damaged one, is told as by render; what was measured before it is printed.
  std::vector<std::string> two = words;
  two.push_back(folder.write("cut.scree", tests::read_whole(path).substr(0, 9000)));
  const auto cut = tests::run_program(two, folder.file("log"));
  INFO(cut.output);
  CHECK(cut.exit_code == 3);
  CHECK(cut.output.find("cut.scree: ") != std::string::npos);
  CHECK(cut.output.find("ring, direct") != std::string::npos);
}
