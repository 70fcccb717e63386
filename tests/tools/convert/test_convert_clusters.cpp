// convert() with clustered chunks.
#include <algorithm>

#include "format/geometry/chunk_layout.h"
#include "tests/models.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tools/convert/convert.h"
#include "tools/inspect/stats.h"

using namespace scree;
using namespace scree::tests;

namespace {

convert::ConvertOptions clustered(const TempFolder& folder) {
  convert::ConvertOptions options = options_of(folder);
  options.encoding = convert::Encoding::kClustered;
  return options;
}

/// The stored corners of all triangles, sorted. Each triangle is rotated to begin with its smallest corner.
std::vector<std::array<std::array<float, 3>, 3>> corners_of(const tests::PackedFile& opened) {
  std::vector<std::array<std::array<float, 3>, 3>> out;
  tools::ChunkReader reader(opened.file);
  for (uint64_t i = 0; i < opened.file.chunks().size(); ++i) {
    const auto chunk = must(reader.read(i));
    for (size_t t = 0; t < chunk->indices.size(); t += 3) {
      std::array<std::array<float, 3>, 3> corners{};
      for (size_t n = 0; n < 3; ++n)
        for (size_t axis = 0; axis < 3; ++axis)
          corners[n][axis] = chunk->positions[3 * size_t{chunk->indices[t + n]} + axis];
      std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
      out.push_back(corners);
    }
  }
  std::sort(out.begin(), out.end());
  return out;
}

/// Converts to clusters, and compares them with the source and with indexed chunks.
convert::ConvertReport must_cluster(const convert::ConvertOptions& options, const TempFolder& folder) {
  const convert::ConvertReport report = must_match(options);
  const tests::PackedFile opened = must_open(options.output);
  must_verify(opened);
  for (uint64_t i = 0; i < opened.file.chunks().size(); ++i) {
    const format::ChunkRecord& chunk = opened.file.chunks()[i];
    CHECK(chunk.encoding == format::ChunkEncoding::kClustered);
    CHECK(chunk.bytes == format::chunk_streams(opened.file.meshes()[chunk.mesh], chunk).bytes);
    CHECK(chunk.cluster_count >= (chunk.triangle_count + 127) / 128);
  }

  // The stored content equals the content of indexed chunks.
  convert::ConvertOptions indexed = options;
  indexed.encoding = convert::Encoding::kIndexed;
  indexed.output = folder.file("indexed.scree");
  must_convert(indexed);
  CHECK((corners_of(opened) == corners_of(must_open(indexed.output))));
  return report;
}

}  // namespace

TEST_CASE("clusters keep the triangles and the stated error under every option", "[convert][clusters]") {
  const TempFolder folder;
  make_grids(folder.file("in.glb"));
  using Options = convert::ConvertOptions;
  const auto effort = GENERATE(tools::ClusterEffort::kFast, tools::ClusterEffort::kBest);
  const auto cluster = [&](const char* name, void (*change)(Options&)) {
    INFO(name);
    Options options = clustered(folder);
    options.clusters = effort;
    change(options);
    return must_cluster(options, folder);
  };
  cluster("defaults", [](Options&) {});
  cluster("8 bits", [](Options& o) { o.position_bits = 8; });
  cluster("24 bits, order none", [](Options& o) { o.position_bits = 24, o.order = convert::Order::kNone; });
  const auto singles = cluster("chunks of one triangle", [](Options& o) { o.chunk_triangles = 1; });
  CHECK(singles.chunks == 2 * (60 * 40 + 31 * 40 + 16));
  cluster("chunks of 300 triangles", [](Options& o) { o.chunk_triangles = 300; });
  const tests::PackedFile opened = must_open(clustered(folder).output);
  for (uint64_t i = 0; i < opened.file.chunks().size(); ++i) CHECK(opened.file.chunks()[i].triangle_count <= 300);
  const auto whole = cluster("whole meshes, everything", [](Options& o) {
    o.chunk_triangles = 0;
    o.normals = convert::Normals::kAlways;
    o.zstd_level = 3;
  });
  CHECK(whole.chunks == 3);
}

TEST_CASE("float32 positions have no clusters", "[convert][clusters]") {
  const TempFolder folder;
  make_grids(folder.file("in.glb"));
  convert::ConvertOptions options = clustered(folder);
  options.float32 = true;
  CHECK(must_match(options).position_error == 0);
  const tests::PackedFile opened = must_open(options.output);
  for (uint64_t i = 0; i < opened.file.chunks().size(); ++i)
    CHECK(opened.file.chunks()[i].encoding == format::ChunkEncoding::kIndexed);
}

TEST_CASE("clustered pages stay within their limit, for any number of threads", "[convert][clusters]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"),
                    {.columns = 400, .rows = 400, .color = true, .normal = true, .indexed = GENERATE(true, false)});
  convert::ConvertOptions options = clustered(folder);
  options.normals = convert::Normals::kAlways;
  options.threads = 1;
  must_match(options);
  {
    const tests::PackedFile opened = must_open(options.output);
    must_verify(opened);
    CHECK(opened.file.pages().size() > 2);
    for (uint64_t i = 0; i < opened.file.pages().size(); ++i)
      CHECK(opened.file.pages()[i].raw_bytes <= format::kPageTargetBytes);
  }
  const std::string one = tests::read_whole(options.output);
  options.threads = 3;
  CHECK((tests::converted_bytes(options) == one));
}

TEST_CASE("split pages unpack to the bytes of raw pages, for any number of threads", "[convert][clusters]") {
  const TempFolder folder;
  make_grids(folder.file("in.glb"));
  convert::ConvertOptions options = clustered(folder);
  options.normals = convert::Normals::kAlways;
  options.chunk_triangles = 3000;
  must_convert(options);
  const tests::PackedFile raw = must_open(options.output);
  options.output = folder.file("split.scree");
  options.zstd_level = GENERATE(1, 3, 19);
  options.threads = 1;
  must_match(options);
  const tests::PackedFile split = must_open(options.output);
  must_verify(split);
  REQUIRE(split.file.pages().size() == raw.file.pages().size());
  CHECK(split.map.bytes().size() < raw.map.bytes().size());
  std::vector<std::byte> expected, found;
  for (uint32_t i = 0; i < raw.file.pages().size(); ++i) {
    CHECK(split.file.pages()[i].codec == format::PageCodec::kSplit);
    const auto a = raw.file.load_page(i, expected);
    const auto b = split.file.load_page(i, found);
    REQUIRE((a && b && a->size() == b->size()));
    CHECK(std::equal(a->begin(), a->end(), b->begin()));
  }
  const std::string one = tests::read_whole(options.output);
  options.threads = 3;
  CHECK((tests::converted_bytes(options) == one));
}

TEST_CASE("inspect itemises the bytes of clusters", "[convert][inspect][clusters]") {
  const TempFolder folder;
  make_grids(folder.file("in.glb"));
  convert::ConvertOptions options = clustered(folder);
  options.zstd_level = GENERATE(0, 3);
  must_convert(options);
  const tests::PackedFile opened = must_open(options.output);
  const inspect::Stats stats = inspect::gather(opened.file, opened.map.bytes(), 10, true);
  uint64_t clusters = 0, raw = 0;
  for (uint64_t i = 0; i < opened.file.chunks().size(); ++i) clusters += opened.file.chunks()[i].cluster_count;
  for (const uint64_t bytes : stats.clusters.bytes) raw += bytes;
  CHECK(raw == tests::chunk_bytes(opened.file));
  CHECK(stats.clusters.clusters == clusters);
  CHECK(stats.clusters.triangles == stats.triangles);
  CHECK(stats.clusters.vertices == stats.vertices);
  CHECK(stats.clusters.bytes[inspect::kClusterRecords] == 16 * clusters);
  CHECK(stats.clusters.bytes[inspect::kClusterBounds] >= 16 * clusters);
  // Steps have one or two bits and distances up to seven bits, and each cluster rounds up by at most four words.
  CHECK(8 * stats.clusters.bytes[inspect::kIndices] >= stats.triangles);
  CHECK(8 * stats.clusters.bytes[inspect::kIndices] <= 16 * stats.triangles + 4 * 32 * clusters);
  uint64_t file = stats.images.stored + stats.container_bytes();
  for (const inspect::Cost& cost : stats.streams) file += cost.stored;
  CHECK(file == stats.file_bytes);
}

TEST_CASE("scans take half the bytes of indexed chunks", "[convert][clusters][models]") {
  const std::filesystem::path scans = tests::real_models("scenes/scans");
  if (scans.empty()) return;
  const TempFolder folder;
  double sum = 0;
  int count = 0;
  for (const char* name : {"beast", "bun_zipper", "nefertiti", "igea_strip"}) {
    INFO(name);
    convert::ConvertOptions options = clustered(folder);
    options.input = (scans / (std::string(name) + ".glb")).string();
    options.source_ids = false;
    must_convert(options);
    const tests::PackedFile opened = must_open(options.output);
    const inspect::Stats stats = inspect::gather(opened.file, opened.map.bytes(), 1, true);
    const auto& bytes = stats.clusters.bytes;
    const double triangles = static_cast<double>(stats.triangles);
    const double each = static_cast<double>(bytes[inspect::kClusterBounds] + bytes[inspect::kClusterRecords] +
                                            bytes[inspect::kIndices] + bytes[inspect::kPositions]) /
                        triangles;
    CHECK(each <= 4.8);
    CHECK(8 * static_cast<double>(bytes[inspect::kIndices]) / triangles <= 12);
    sum += each;
    ++count;
    options.zstd_level = 3;
    CHECK(static_cast<double>(must_convert(options).output_bytes) <= 3.5 * triangles);
  }
  CHECK(sum / count <= 4.5);
}
