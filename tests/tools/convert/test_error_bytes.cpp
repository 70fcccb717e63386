// convert with an error bound: nothing takes more bytes than with float32 positions, and the table shows the savings.
#include <algorithm>
#include <filesystem>
#include <iterator>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "format/bytes.h"
#include "tests/models.h"
#include "tests/sanitized.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tools/convert/plan/convert_options.h"

using namespace scree;
using convert::ConvertOptions;
using convert::Encoding;
using tests::must_convert;
using tests::must_open;
namespace fs = std::filesystem;

namespace {

/// A way of bounding the error.
struct Bound {
  double units, pixels;
  double distance;
};

// For models of about one unit: bounds with 1 to 24 bits per axis, and one bound that 24 bits cannot keep.
constexpr Bound kBounds[] = {{0.1, 0, 0},   {1e-3, 0, 0}, {1e-5, 0, 0}, {1e-7, 0, 0},
                             {1e-12, 0, 0}, {0, 4, 10},   {0, 0.5, 2},  {0, 0.01, 0.1}};

ConvertOptions bounded(ConvertOptions options, const Bound& bound) {
  options.max_error = bound.units;
  options.pixel_bound.pixels = bound.pixels;
  options.pixel_bound.distance = bound.distance;
  return options;
}

uint64_t end_of_pages(const format::Container& file) {
  const uint64_t count = file.pages().size();
  return count == 0 ? 0 : file.pages()[count - 1].offset + file.pages()[count - 1].stored_bytes;
}

struct Counts {
  uint64_t chunks = 0, clustered = 0;
  uint64_t indexed = 0;  // chunks on a lattice that stay indexed
  uint64_t saved = 0;
};

/// Compares a conversion for each bound with `floats`, the same conversion to float32 positions, chunk by chunk.
void must_not_take_more(ConvertOptions options, std::span<const Bound> bounds, Counts& counts) {
  ConvertOptions floats = options;
  floats.float32 = true;
  floats.output += ".floats";
  const convert::ConvertReport float_report = must_convert(floats);
  const tests::PackedFile as_floats = must_open(floats.output);
  for (const Bound& bound : bounds) {
    options = bounded(options, bound);
    INFO(convert::describe_options(options));
    const convert::ConvertReport report = must_convert(options);
    const tests::PackedFile opened = must_open(options.output);
    const auto chunks = opened.file.chunks(), float_chunks = as_floats.file.chunks();
    REQUIRE(chunks.size() == float_chunks.size());
    uint64_t bytes = 0, float_bytes = 0;
    for (size_t i = 0; i < chunks.size(); ++i) {
      const format::ChunkRecord& chunk = chunks[i];
      INFO("chunk " << i);
      REQUIRE(chunk.mesh == float_chunks[i].mesh);
      REQUIRE(chunk.triangle_count == float_chunks[i].triangle_count);
      CHECK(chunk.bytes <= float_chunks[i].bytes);
      bytes += chunk.bytes;
      float_bytes += float_chunks[i].bytes;
      const bool is_clustered = chunk.encoding == format::ChunkEncoding::kClustered;
      const bool is_lattice = opened.file.meshes()[chunk.mesh].position_encoding == format::PositionEncoding::kLattice;
      counts.clustered += is_clustered ? 1 : 0;
      counts.indexed += is_lattice && !is_clustered ? 1 : 0;
    }
    counts.chunks += chunks.size();
    counts.saved += float_bytes - bytes;

    // The table gives the same numbers.
    uint64_t table_bytes = 0, meshes = 0, triangles = 0;
    int64_t saved = 0;
    for (const auto& [bits, row] : report.positions.rows()) {
      table_bytes += row.bytes;
      saved += row.saved;
      meshes += row.meshes;
      triangles += row.triangles;
      CHECK(row.saved >= 0);
      if (bits == 32) CHECK(row.saved == 0);
    }
    CHECK(table_bytes == bytes);
    CHECK(saved == static_cast<int64_t>(float_bytes - bytes));
    CHECK(meshes == opened.file.meshes().size());
    CHECK(triangles == report.triangles);

    // Only the text of the options may make the file larger, and this text lies in a padded table.
    CHECK(end_of_pages(opened.file) <= end_of_pages(as_floats.file));
    const uint64_t text = convert::describe_options(options).size(),
                   float_text = convert::describe_options(floats).size();
    const uint64_t longer = text - std::min(text, float_text);
    CHECK(report.output_bytes <= float_report.output_bytes + format::align_up(longer, format::kTableAlignment));
  }
  fs::remove(floats.output);
}

/// Grids; a mesh in which every cluster uses nearly all of its vertices (with and without texture coordinates); a mesh
/// without shared vertices that exceeds a page as floats; points with both zeros; and the smallest possible meshes.
void make_error_scene(const std::string& path) {
  tests::ModelMaker maker(path);
  const auto add = [&](const std::string& name, tools::GltfPrimitive primitive) {
    maker.draw(name, {std::move(primitive)});
  };
  tests::GridSpec grid{.columns = 30, .rows = 30, .uv = true, .color = true, .normal = true};
  add("grid", maker.grid(grid));
  grid = {};
  grid.columns = 180;
  grid.rows = 130;
  grid.indexed = false;
  add("apart", maker.grid(grid));
  std::mt19937 random(3);
  for (const uint32_t vertices : {1u, 2u, 3u, 4u, 5u, 8u, 60u, 110u, 400u}) {
    std::vector<float> points, uvs;
    for (uint32_t i = 0; i < vertices; ++i) {
      for (int axis = 0; axis < 3; ++axis) points.push_back(static_cast<float>(random() % 100000) * 1e-5f);
      uvs.insert(uvs.end(), {static_cast<float>(random() % 1000) * 0.01f, 0.5f});
    }
    std::vector<uint32_t> corners(3 * (vertices < 60 ? vertices : 5000));
    for (uint32_t& corner : corners) corner = static_cast<uint32_t>(random() % vertices);
    add("knot", maker.primitive(points, corners));
    tools::GltfPrimitive with_uvs = maker.primitive(points, corners);
    with_uvs.attributes.emplace_back("TEXCOORD_0", maker.floats(uvs, tools::GltfType::kVec2));
    add("knot with uvs", std::move(with_uvs));
  }
  std::vector<float> zeros;
  for (uint32_t i = 0; i < 300; ++i)
    zeros.insert(zeros.end(), {i % 2 ? 0.0f : -0.0f, static_cast<float>(i / 6), i % 3 ? 0.0f : -0.0f});
  add("zeros", maker.primitive(zeros, {}));
  maker.finish();
}

}  // namespace

TEST_CASE("with an error bound no chunk is larger than as floats, with any options", "[convert][error_bytes]") {
  const tests::TempFolder folder;
  make_error_scene(folder.file("in.glb"));
  const auto encoding = GENERATE(Encoding::kIndexed, Encoding::kClustered);
  const auto variant = GENERATE(0, 1, 2, 3, 4, 5);
  CAPTURE(encoding == Encoding::kClustered, variant);
  ConvertOptions options = tests::options_of(folder);
  options.encoding = encoding;
  options.source_ids = variant != 1;
  options.normals = variant == 1 ? convert::Normals::kAlways : convert::Normals::kNever;
  options.weld = variant != 1;
  if (variant == 2) options.order = convert::Order::kNone;
  if (variant == 3) options.clusters = tools::ClusterEffort::kBest;
  if (variant == 4) options.chunk_triangles = 0;
  if (variant == 5) options.chunk_triangles = 2;
  Counts counts;
  // In this variant there are many chunks of two triangles.
  must_not_take_more(options, variant == 5 ? std::span(kBounds).subspan(2, 2) : std::span(kBounds), counts);
  CHECK(counts.saved > 0);
  CHECK(counts.indexed > 0);  // some chunks take more bytes as clusters
  CHECK((counts.clustered > 0) == (encoding == Encoding::kClustered));
}

TEST_CASE("chunks that stay indexed to save bytes are correct, for any threads and memory", "[convert][error_bytes]") {
  const tests::TempFolder folder;
  make_error_scene(folder.file("in.glb"));
  for (const Bound& bound : {kBounds[1], kBounds[3], kBounds[6]}) {
    for (const auto clusters : {tools::ClusterEffort::kFast, tools::ClusterEffort::kBest}) {
      ConvertOptions options = bounded(tests::options_of(folder), bound);
      options.encoding = Encoding::kClustered;
      options.clusters = clusters;
      options.zstd_level = clusters == tools::ClusterEffort::kBest ? 3 : 0;  // split pages of both kinds of chunks
      options.threads = 1;
      tests::must_match(options);
      const std::string bytes = tests::read_whole(options.output);
      tests::must_verify(options.output);
      options.threads = 4;
      CHECK((tests::converted_bytes(options) == bytes));
      tests::must_convert_within(options, uint64_t{100} << 20);
      CHECK((tests::read_whole(options.output) == bytes));
    }
  }
}

TEST_CASE("with an error bound the small models are no larger than as floats", "[models][error_bytes]") {
  const tests::TempFolder folder;
  Counts counts;
  for (const fs::path& path : tests::model_files(tests::kDataFolder)) {
    INFO(path.string());
    for (int variant = 0; variant < 4; ++variant) {
      ConvertOptions options = tests::options_of(folder);
      options.input = path.string();
      options.drop_nonfinite = true;
      options.encoding = variant % 2 ? Encoding::kClustered : Encoding::kIndexed;
      options.source_ids = variant / 2 == 1;
      options.normals = options.source_ids ? convert::Normals::kAlways : convert::Normals::kNever;
      must_not_take_more(options, kBounds, counts);
    }
  }
  CHECK(counts.chunks > 100);
  CHECK(counts.clustered > 0);
  CHECK(counts.saved > 0);
}

/// `every`: tests every n-th combination of models, bounds and encodings.
static void check_models(size_t every) {
  const std::vector<fs::path> files = tests::model_files(tests::real_models("scenes"));
  if (files.empty()) return;
  const tests::TempFolder folder;
  Counts counts;
  size_t number = 0, measured = 0;
  for (const fs::path& path : files) {
    INFO(path.string());
    ConvertOptions options;
    options.input = path.string();
    options.output = folder.file("out.scree");
    options.threads = 2;
    options.images.textures = convert::Textures::kRaw;  // indices of JPEGs would take most of the time
    std::optional<bool> is_refused;                     // test_models.cpp lists the models that may be refused
    for (const Encoding encoding : {Encoding::kIndexed, Encoding::kClustered}) {
      for (const Bound& bound : kBounds) {
        if (number++ % every != 0) continue;
        if (!is_refused) is_refused = !convert::convert(options);
        if (*is_refused) continue;
        options.encoding = encoding;
        must_not_take_more(options, std::span(&bound, 1), counts);
        ++measured;
      }
    }
  }
  CHECK(measured * every >= 150 * 2 * std::size(kBounds));
  CHECK(counts.clustered > 0);
  CHECK(counts.indexed > 0);
  CHECK(counts.saved > 0);
}

TEST_CASE("with an error bound every model is no larger than as floats", "[models][error_bytes]") {
  check_models(tests::kIsSanitized ? 101 : 11);
}

TEST_CASE("with every error bound every model is no larger than as floats", "[.][models-all]") {
  check_models(1);
}
