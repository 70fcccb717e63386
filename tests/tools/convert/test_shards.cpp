// convert --shard and merge: shards that any number of threads made in any order merge to the bytes of one run, and
// shards that do not belong together are refused.
#include <algorithm>
#include <filesystem>
#include <functional>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "format/container/container.h"
#include "format/geometry/chunk_layout.h"
#include "tests/format/jpeg/jpeg_maker.h"
#include "tests/models.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/temp_folder.h"
#include "tools/convert/convert.h"
#include "tools/convert/passes/shard.h"

using namespace scree;
using namespace scree::tests;
using convert::ConvertOptions;
namespace fs = std::filesystem;

namespace {

/// Three images, two of them equal; a mesh of several windows, two equal meshes, many small ones, and one that is not
/// drawn.
void make_sharded_scene(const std::string& path, bool is_large) {
  ModelMaker maker(path);
  tests::JpegRecipe recipe{.width = 100, .height = 100, .factors = {{2, 2}, {1, 1}, {1, 1}}};
  const uint32_t jpeg = maker.textured("jpeg", format::ImageCodec::kJpeg, tests::make_jpeg(recipe));
  const uint32_t checker = maker.checker("png"), again = maker.checker("again");
  recipe.width = 72;
  const uint32_t other = maker.textured("other", format::ImageCodec::kJpeg, tests::make_jpeg(recipe));
  const GridSpec large{.columns = is_large ? 600u : 60u, .rows = 500, .uv = true};
  GridSpec small{.uv = true, .color = true};
  maker.draw("large", {maker.grid(large, jpeg), maker.grid(small, checker)});
  maker.draw("small", {maker.grid(small, again)}, {2, 0, 0});
  maker.draw("equal", {maker.grid(small, checker)}, {3, 0, 0});
  maker.mesh("not drawn", {maker.grid(small)});
  for (int i = 0; i < 20; ++i) {
    small.columns = static_cast<uint32_t>(4 + i);
    maker.draw("grid " + std::to_string(i), {maker.grid(small, i % 2 == 0 ? other : checker)}, {4.0 + i, 0, 0});
  }
  maker.finish();
}

/// Conversions of one model in its own folder.
class Sharded {
 public:
  explicit Sharded(bool is_large = false) {
    fs::create_directory(folder_.file("in"));
    make_sharded_scene(input(), is_large);
  }
  explicit Sharded(const fs::path& model) : input_(model.string()) {}

  const TempFolder& folder() const { return folder_; }
  std::string input() const { return input_.empty() ? folder_.file("in/scene.gltf") : input_; }
  std::string shard(uint32_t number) const { return folder_.file("x." + std::to_string(number) + ".part"); }

  ConvertOptions options() const {
    ConvertOptions options;
    options.input = input();
    options.threads = 2;
    return options;
  }

  std::string one_run(ConvertOptions options) const {
    options.output = folder_.file("one.scree");
    must(convert::convert(options));
    return tests::read_whole(options.output);
  }

  std::vector<std::string> make_shards(ConvertOptions options, uint32_t count) const {
    std::vector<std::string> names;
    options.shards = count;
    for (uint32_t i = count; i-- > 0;) {
      options.shard = i;
      options.threads = 1 + i % 3;
      options.output = shard(i + 1);
      must(convert::convert(options));
      names.push_back(options.output);
    }
    return names;
  }

  Result<convert::ConvertReport> merge(const std::vector<std::string>& shards, uint32_t threads = 2) const {
    convert::MergeOptions options;
    options.shards = shards;
    options.output = folder_.file("merged.scree");
    options.threads = threads;
    return convert::merge(options);
  }

  void check_same(const ConvertOptions& options, uint32_t count) const {
    const std::string expected = one_run(options);
    const auto merged = must(merge(make_shards(options, count), count % 3 + 1));
    CHECK(tests::read_whole(folder_.file("merged.scree")) == expected);
    CHECK(merged.output_bytes == expected.size());
  }

  /// Checks that a merge is refused and leaves nothing behind. `words`: a part of the error's message.
  void must_refuse(const std::vector<std::string>& shards, ErrorCode code, const std::string& words,
                   int line = __builtin_LINE()) const {
    fs::remove(folder_.file("merged.scree"));
    check_refusal(merge(shards), code, words, __builtin_FILE(), line);
    CHECK_FALSE(fs::exists(folder_.file("merged.scree")));
    CHECK_FALSE(fs::exists(folder_.file("merged.scree.part")));
  }

 private:
  TempFolder folder_;
  std::string input_;
};

}  // namespace

TEST_CASE("shards merge to the bytes of one run", "[convert][shards]") {
  const Sharded scene;
  ConvertOptions options = scene.options();
  const std::pair<const char*, std::function<void()>> cases[] = {
      {"as it is", [] {}},
      {"zstd", [&] { options.zstd_level = options.images.block_zstd_level = 5; }},
      {"indexed, normals, source ids",
       [&] {
         options.encoding = convert::Encoding::kIndexed;
         options.normals = convert::Normals::kAlways;
         options.source_ids = true;
       }},
      {"floats", [&] { options.float32 = true; }},
      {"small chunks", [&] { options.chunk_triangles = 300; }},
      {"one grid", [&] { options.grid = convert::Grid::kScene; }},
      {"pixels",
       [&] {
         options.pixel_bound.pixels = 0.5;
         options.pixel_bound.distance = 2;
       }},
      {"nothing shared", [&] { options.share = options.weld = false; }},
      {"JPEGs", [&] { options.images.textures = convert::Textures::kJpeg; }},
      {"excluded", [&] { options.exclude = "grid 1"; }},
  };
  for (const auto& [name, change] : cases) {
    INFO(name);
    options = scene.options();
    change();
    scene.check_same(options, 3);
  }
  for (const uint32_t count : {1u, 2u, 7u, 40u}) {  // 40 are more than there are windows
    INFO(count << " shards");
    scene.check_same(scene.options(), count);
  }
}

TEST_CASE("a mesh of several windows and pages can be cut anywhere", "[convert][shards]") {
  const Sharded scene(true);
  for (const int level : {0, 1}) {
    ConvertOptions options = scene.options();
    options.zstd_level = level;
    options.encoding = level == 0 ? convert::Encoding::kIndexed : convert::Encoding::kClustered;
    scene.check_same(options, 4);
  }
}

TEST_CASE("shards of real models merge to the bytes of one run", "[convert][shards][models]") {
  std::vector<fs::path> models = tests::model_files(tests::real_models("scenes"));
  std::erase_if(models, [](const fs::path& path) { return fs::file_size(path) >= 1000000; });
  for (size_t i = 0; i < models.size(); i += 10) {
    const Sharded scene(models[i]);
    ConvertOptions options = scene.options();
    options.output = scene.folder().file("try.scree");
    if (!convert::convert(options)) continue;
    INFO(models[i]);
    scene.check_same(scene.options(), 3);
  }
}

TEST_CASE("shards that do not belong together are refused with their names", "[convert][shards]") {
  const Sharded scene;
  const std::vector<std::string> shards = scene.make_shards(scene.options(), 3);
  scene.must_refuse({shards[0], shards[2]}, ErrorCode::kUsage, "x.3.part: is one of 3 shards; missing: 2");
  fs::copy_file(shards[0], scene.folder().file("copy.part"));
  scene.must_refuse({shards[0], shards[1], shards[2], scene.folder().file("copy.part")}, ErrorCode::kUsage,
                    "copy.part: is shard 3 of 3, as " + shards[0] + " is");

  ConvertOptions other = scene.options();
  other.shards = 3;
  other.shard = 1;
  other.position_bits = 14;
  other.output = scene.folder().file("other.part");
  REQUIRE(convert::convert(other));
  for (const char* const words : {"other.part: is from another conversion than ", "--positions 14"})
    scene.must_refuse({shards[0], other.output, shards[2]}, ErrorCode::kUsage, words);
  other = scene.options();
  other.shards = 4;
  other.output = scene.folder().file("other.part");
  REQUIRE(convert::convert(other));
  scene.must_refuse({shards[0], shards[1], other.output}, ErrorCode::kUsage, "is one of 4, but the first one of 3");

  (void)scene.one_run(scene.options());
  scene.must_refuse({scene.folder().file("one.scree")}, ErrorCode::kUsage, "one.scree: is a .scree file, but no shard");
  scene.must_refuse({scene.folder().file("nothing.part")}, ErrorCode::kFile, "nothing.part");
  scene.must_refuse({scene.input()}, ErrorCode::kFormat, "scene.gltf");

  // A source that has changed since, and a shard of the changed source.
  const std::string bin = scene.folder().file("in/scene.bin");
  fs::last_write_time(bin, fs::last_write_time(bin) + std::chrono::seconds(5));
  scene.must_refuse(shards, ErrorCode::kFile, "x.1.part: scene.bin has changed since the shards were made");
  other = scene.options();
  other.shards = 3;
  other.shard = 1;
  other.output = scene.shard(2);
  REQUIRE(convert::convert(other));
  scene.must_refuse(shards, ErrorCode::kUsage,
                    "x.2.part: is from another conversion than " + shards[0] + ": it was made from scene.bin of ");
}

TEST_CASE("a damaged shard is refused and nothing is left", "[convert][shards]") {
  const Sharded scene;
  const std::vector<std::string> shards = scene.make_shards(scene.options(), 3);
  const std::string good = tests::read_whole(shards[1]);
  for (size_t i = 1; i < 40; ++i) {
    std::string bad = good;
    const size_t at = good.size() * i / 40;
    bad[at] = static_cast<char>(bad[at] ^ 0x10);
    scene.folder().write("x.2.part", bad);
    fs::remove(scene.folder().file("merged.scree"));
    const auto merged = scene.merge(shards);
    INFO("byte " << at);
    REQUIRE_FALSE(merged);
    CHECK(exit_code(merged.error().code) == 3);
    CHECK(merged.error().message.find("x.2.part") != std::string::npos);
    CHECK_FALSE(fs::exists(scene.folder().file("merged.scree")));
    CHECK_FALSE(fs::exists(scene.folder().file("merged.scree.part")));
  }
  scene.folder().write("x.2.part", good.substr(0, good.size() / 2));
  CHECK_FALSE(scene.merge(shards));
  scene.folder().write("x.2.part", good);
  CHECK(scene.merge(shards));
}

TEST_CASE("all data of a shard are checked against the source", "[convert][shards]") {
  const Sharded scene;
  (void)scene.make_shards(scene.options(), 1);
  const auto opened = must(convert::open_shards({scene.shard(1)}));
  const std::vector<std::byte> plan = convert::pack_plan(opened.plan);
  const std::vector<std::byte> share = convert::pack_share(opened.files[0].share);
  // Unpacking returns the packed plan. Every shorter text is refused.
  CHECK(convert::pack_plan(must(convert::unpack_plan(plan))) == plan);
  CHECK(convert::pack_share(must(convert::unpack_share(share))) == share);
  for (size_t size = 0; size < plan.size(); size += 1 + size / 64)
    CHECK_FALSE(
        convert::unpack_plan(std::vector<std::byte>(plan.begin(), plan.begin() + static_cast<ptrdiff_t>(size))));
  for (size_t size = 0; size < share.size(); size += 1 + size / 64)
    CHECK_FALSE(
        convert::unpack_share(std::vector<std::byte>(share.begin(), share.begin() + static_cast<ptrdiff_t>(size))));
}

TEST_CASE("a crafted shard with right checksums is refused", "[convert][shards]") {
  using convert::ShardPlan;
  using convert::ShardShare;
  const Sharded scene(true);  // its geometry takes several pages, so that the first one is copied
  (void)scene.make_shards(scene.options(), 1);
  const auto opened = must(convert::open_shards({scene.shard(1)}));
  const format::Container& container = opened.files[0].container;
  const std::string bad = scene.folder().file("bad.part");
  const format::ChunkRecord first = opened.files[0].share.windows[0].chunks[0];
  REQUIRE(opened.files[0].share.windows.back().chunks.back().page > first.page);
  REQUIRE(opened.files[0].share.windows[0].chunks.size() > 1);
  REQUIRE(opened.files[0].share.windows[0].chunks[1].page == first.page);
  REQUIRE(first.offset == 0);
  // Writes the shard with another plan and share, and with the first page of geometry changed and packed.
  using ChangePage = std::function<void(std::vector<std::byte>&)>;
  const auto write = [&](const ShardPlan& plan, const ShardShare& share, const ChangePage& change, int zstd_level) {
    auto writer = must(format::ContainerWriter::create(bad));
    for (uint32_t i = 0; i < container.pages().size(); ++i) {
      const format::PageRecord& record = container.pages()[i];
      const std::span<const std::byte> stored = container.stored_page(i);
      std::vector<std::byte> bytes(stored.begin(), stored.end());
      if (record.kind == convert::kShardPlanPage || record.kind == convert::kShardSharePage) continue;
      if (i == first.page) {
        REQUIRE(record.codec == format::PageCodec::kRaw);
        change(bytes);
        must(writer.append(format::seal_page(record.kind, std::move(bytes), zstd_level)));
      } else {
        must(writer.append({record, std::move(bytes)}));
      }
    }
    must(convert::append_shard_pages(convert::pack_plan(plan), share, writer));
    must(writer.finish({}));
  };
  const auto leave = [](std::vector<std::byte>&) {};

  for (const int zstd_level : {0, 1}) {
    write(opened.plan, opened.files[0].share, leave, zstd_level);
    must(scene.merge({bad}));
    const auto damage = [&](std::vector<std::byte>& page) {
      const format::ChunkStream clusters = format::chunk_streams({}, first).clusters;
      std::fill_n(page.begin() + static_cast<std::ptrdiff_t>(clusters.offset), clusters.bytes, std::byte{0xff});
    };
    write(opened.plan, opened.files[0].share, damage, zstd_level);
    scene.must_refuse({bad}, ErrorCode::kRange,
                      "bad.part: chunk 0 in page " + std::to_string(first.page) + ": clusters: cluster 0: first");
    const auto lengthen = [](std::vector<std::byte>& page) { page.resize(page.size() + 16); };
    write(opened.plan, opened.files[0].share, lengthen, zstd_level);
    scene.must_refuse({bad}, ErrorCode::kTrailing, "bad.part: page " + std::to_string(first.page) + ": ");
  }

  struct Case {
    const char* words;  // of the error
    std::function<void(convert::WindowOutcome&)> change;
  };
  const Case cases[] = {
      {"bad.part: chunk 0: page 4294967295, but the file has", [](auto& window) { window.chunks[0].page = ~0u; }},
      {"bad.part: chunk 0: page 0 is of kind", [](auto& window) { window.chunks[0].page = 0; }},  // of an image
      {" clusters of 2147483647 vertices", [](auto& window) { window.chunks[0].vertex_count = 0x7fffffff; }},
      {"bad.part: chunk 0: 16 bytes, but its streams take", [](auto& window) { window.chunks[0].bytes = 16; }},
      {"bad.part: chunk 0: at byte 16 of page", [](auto& window) { window.chunks[0].offset = 16; }},
      {"bad.part: chunk 1: first triangle", [](auto& window) { ++window.chunks[1].first_triangle; }},
      {"bad.part: chunk 0: encoding 77", [](auto& window) { window.chunks[0].encoding = format::ChunkEncoding{77}; }},
      {"merged.scree: its shards give no valid file: mesh 0: uv error",
       [](auto& window) { window.uv_error = std::numeric_limits<float>::infinity(); }},
  };
  for (const Case& wrong : cases) {
    ShardShare share = opened.files[0].share;
    wrong.change(share.windows[0]);
    write(opened.plan, share, leave, 0);
    scene.must_refuse({bad}, ErrorCode::kRange, wrong.words);
  }
  ShardPlan plan = opened.plan;
  plan.measurement.primitives[0].box.lo[1] = std::numeric_limits<float>::quiet_NaN();
  write(plan, opened.files[0].share, leave, 0);
  scene.must_refuse({bad}, ErrorCode::kFormat, "bad.part: the box of primitive 0 does not match the source");
}

TEST_CASE("parts of a list are consecutive and have equal weights", "[convert][shards]") {
  const std::vector<uint64_t> costs{5, 1, 1, 1, 20, 1, 1, 5, 5, 0, 9};
  for (const uint32_t count : {1u, 2u, 3u, 4u, 11u, 50u}) {
    uint64_t end = 0;
    for (uint32_t i = 0; i < count; ++i) {
      const convert::Part part = convert::part_of(costs, i, count);
      CHECK((part.first == end || part.first == part.end));
      end = std::max(end, part.end);
      uint64_t weight = 0;
      for (uint64_t k = part.first; k < part.end; ++k) weight += costs[k];
      CHECK(weight <= 49 / count + 20);
    }
    CHECK(end == costs.size());
  }
  CHECK(convert::part_of({}, 0, 3).end == 0);
  CHECK(convert::part_of(std::vector<uint64_t>{0, 0}, 0, 3).end == 2);
}
