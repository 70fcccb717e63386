// Makes the seeds of the corpus, from what the tests have: scree_tests "[make-corpus]". They are committed; a new
// codec or table wants new ones.
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "format/attribute_codec.h"
#include "format/chunk_layout.h"
#include "format/cluster_codec.h"
#include "format/cluster_page.h"
#include "format/index_codec.h"
#include "format/position_codec.h"
#include "runtime/image.h"
#include "tests/catch.h"
#include "tests/format/container_fixture.h"
#include "tests/format/jpeg_checks.h"
#include "tests/format/jpeg_maker.h"
#include "tests/models.h"
#include "tests/paths.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/packed_file.h"
#include "tests/tools/temp_folder.h"
#include "tools/common/cluster_builder.h"

namespace scree::tests {
namespace {

/// The fields of a seed as fuzz::Parameters takes them, then a stream.
class Seed {
 public:
  template <class T>
  Seed& add(T value) {
    const auto* const first = reinterpret_cast<const std::byte*>(&value);
    bytes_.insert(bytes_.end(), first, first + sizeof value);
    return *this;
  }
  Seed& stream(const Bytes& bytes) {
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
    return *this;
  }
  void save(const std::string& target, const std::string& name) const { save(bytes_, target, name); }

  static void save(std::span<const std::byte> bytes, const std::string& target, const std::string& name) {
    const std::filesystem::path folder = std::filesystem::path(tests::kCorpusFolder) / target;
    std::filesystem::create_directories(folder);
    std::ofstream out(folder / name, std::ios::binary);
    out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    REQUIRE(out.good());
  }

 private:
  Bytes bytes_;
};

void make_index_seeds() {
  const std::vector<uint32_t> indices = {5, 9, 7, 5, 6, 9, 20, 5, 9, 8, 8, 8};
  const format::IndexRange range = format::index_range(indices);
  Bytes stream(format::packed_bytes(indices.size(), range.bits));
  format::encode_indices(stream, indices, range);
  Seed()
      .add(uint32_t{21})
      .add(range.min)
      .add(static_cast<uint8_t>(range.bits))
      .add(static_cast<uint16_t>(indices.size()))
      .add(uint64_t{1} << 62)
      .stream(stream)
      .save("index_codec", "indices");
  Seed()
      .add(uint32_t{8})
      .add(uint32_t{7})
      .add(uint8_t{0})
      .add(uint16_t{300})
      .add(uint64_t{0})
      .save("index_codec", "equal");
  Seed()
      .add(~uint32_t{0})
      .add(uint32_t{0})
      .add(uint8_t{32})
      .add(uint16_t{1})
      .add(~uint64_t{0})
      .stream(Bytes(16))
      .save("index_codec", "wide");
}

Seed position_head(const format::MeshLattice& lattice, const format::PositionRange& range, uint16_t count) {
  Seed seed;
  seed.add(static_cast<int16_t>(lattice.exponent));
  for (const int64_t min : lattice.min) seed.add(min);
  for (const uint8_t bits : lattice.bits) seed.add(bits);
  for (const uint32_t min : range.min) seed.add(min);
  for (const uint8_t bits : range.bits) seed.add(bits);
  return seed.add(count).add(uint64_t{1} << 61);
}

void make_position_seeds() {
  const std::vector<float> points = {0, 0.5f, 3, 1, -2.25f, 4, 0.125f, 7, 3.5f, 2, 2, 2};
  const float lo[3] = {0, -2.25f, 2};
  const float hi[3] = {2, 7, 4};
  for (const uint32_t bits : {8u, 16u, 20u}) {
    const auto lattice = format::choose_lattice(lo, hi, bits, 0);
    REQUIRE(lattice);
    std::vector<uint32_t> coordinates(points.size());
    format::quantize_positions(coordinates, points, *lattice);
    const format::PositionRange range = format::position_range(coordinates);
    Bytes stream(format::position_stream_bytes(4, range));
    format::encode_positions(stream, coordinates, range);
    position_head(*lattice, range, 4).stream(stream).save("position_codec", "lattice" + std::to_string(bits));
  }
  const format::PositionRange floats{{0, 0, 0}, {32, 32, 32}};
  Bytes stream(format::position_stream_bytes(4, floats));
  format::encode_positions_float32(stream, points);
  position_head({}, floats, 4).stream(stream).save("position_codec", "float32");
}

void make_attribute_seeds() {
  const std::vector<float> uvs = {0, 1, 0.5f, -3.25f, 7, 0.125f};
  const format::UvRange uv_range = format::choose_uv_range(uvs);
  Bytes stream(format::uv_stream_bytes(3, uv_range));
  format::encode_uvs(stream, uvs, uv_range);
  Seed seed;
  seed.add(uint8_t{0}).add(uint16_t{3}).add(static_cast<int16_t>(uv_range.exponent));
  for (const int64_t min : uv_range.min) seed.add(min);
  for (const uint8_t bits : uv_range.bits) seed.add(bits);
  seed.stream(stream).save("attribute_codec", "uvs");

  stream.assign(format::color_stream_bytes(2), std::byte{0});
  format::encode_colors(stream, std::vector<float>{0, 0.5f, 1, 1, 1, 0, 0.25f, 0});
  Seed().add(uint8_t{1}).add(uint16_t{2}).stream(stream).save("attribute_codec", "colors");

  stream.assign(format::normal_stream_bytes(3, 12), std::byte{0});
  format::encode_normals(stream, std::vector<float>{0, 0, 1, 0.6f, -0.8f, 0, -1, -1, -1}, 12);
  Seed().add(uint8_t{2}).add(uint16_t{3}).add(uint8_t{12}).stream(stream).save("attribute_codec", "normals");

  const std::vector<uint64_t> ids = {7, 1000, uint64_t{1} << 31, 9};
  const format::SourceIdRange id_range = format::source_id_range(ids);
  stream.assign(format::source_id_stream_bytes(4, id_range), std::byte{0});
  format::encode_source_ids(stream, ids, id_range);
  Seed()
      .add(uint8_t{3})
      .add(uint16_t{4})
      .add(id_range.min)
      .add(static_cast<uint8_t>(id_range.bits))
      .stream(stream)
      .save("attribute_codec", "source_ids");
}

void make_cluster_seed(uint32_t side, tools::ClusterEffort effort, const std::string& name) {
  std::vector<uint32_t> offsets, indices;
  for (uint32_t y = 0; y <= side; ++y)
    for (uint32_t x = 0; x <= side; ++x) offsets.insert(offsets.end(), {100 * x, 100 * y, 3 * x + y * y % 7});
  for (uint32_t y = 0; y < side; ++y) {
    for (uint32_t x = 0; x < side; ++x) {
      const uint32_t at = y * (side + 1) + x;
      indices.insert(indices.end(), {at, at + 1, at + side + 1, at + 1, at + side + 2, at + side + 1});
    }
  }
  format::ChunkRecord chunk{};
  const format::ClusterSet set = tools::ClusterBuilder().build(indices, offsets, effort);
  const format::ClusterRun run{0, set.clusters.size(), 0};
  format::describe_clusters(set, run, chunk);
  Bytes stream(format::cluster_stream_bytes(chunk.cluster_count, chunk.cluster_words));
  format::write_clusters(stream, set, run, chunk);
  Seed seed;
  seed.add(static_cast<uint16_t>(chunk.triangle_count)).add(static_cast<uint16_t>(chunk.vertex_count));
  seed.add(static_cast<uint8_t>(chunk.cluster_count)).add(static_cast<uint16_t>(chunk.cluster_words));
  seed.add(int16_t{-7});
  for (const int64_t min : {int64_t{-500}, int64_t{0}, int64_t{1} << 40}) seed.add(min);
  for (int axis = 0; axis < 3; ++axis) seed.add(uint8_t{16});
  for (const uint32_t min : chunk.position_min) seed.add(min);
  for (const uint8_t bits : chunk.position_bits) seed.add(bits);
  seed.stream(stream).save("cluster_codec", name);
  const format::PageClusters clusters{0, chunk.cluster_count};
  Seed()
      .add(static_cast<uint32_t>(stream.size()))
      .stream(format::split_page(stream, {&clusters, 1}).bytes)
      .save("cluster_page", name);
}

void make_jpeg_seeds() {
  std::vector<JpegRecipe> recipes;
  const auto add = [&](const char* name, auto change) {
    JpegRecipe recipe;
    recipe.name = name;
    recipe.width = 21;
    recipe.height = 19;
    recipe.factors = {{2, 2}, {1, 1}, {1, 1}};
    recipe.quality = 60;
    change(recipe);
    recipes.push_back(recipe);
  };
  add("420", [](JpegRecipe&) {});
  add("grey", [](JpegRecipe& r) { r.factors = {{1, 1}}; });
  add("444_restart", [](JpegRecipe& r) { r.factors = {{1, 1}, {1, 1}, {1, 1}}, r.restart = 2; });
  add("rgb", [](JpegRecipe& r) { r.factors = {{1, 1}, {1, 1}, {1, 1}}, r.is_rgb = true; });
  add("optimised", [](JpegRecipe& r) { r.is_optimised = r.has_three_tables = true; });
  add("progressive", [](JpegRecipe& r) { r.is_progressive = true; });
  add("arithmetic", [](JpegRecipe& r) { r.is_arithmetic = true; });
  add("scans", [](JpegRecipe& r) { r.has_scan_each = true; });
  add("cmyk", [](JpegRecipe& r) { r.factors = {{1, 1}, {1, 1}, {1, 1}, {1, 1}}; });
  add("wide", [](JpegRecipe& r) { r.has_wide_quant = true, r.quality = 2; });
  for (const JpegRecipe& recipe : recipes) {
    const Bytes file = make_jpeg(recipe);
    Seed::save(file, "jpeg_file", recipe.name);
    if (recipe.name != "optimised" && recipe.name != "444_restart") Seed::save(file, "image", recipe.name);
    if (const auto indexed = jpeg::encode(file)) Seed::save(*indexed, "jpeg_index", recipe.name);
  }
}

void make_png_seeds(const TempFolder& folder) {
  std::vector<uint8_t> pixels(4 * 13 * 7);
  for (size_t i = 0; i < pixels.size(); ++i) pixels[i] = static_cast<uint8_t>(i * i / 7);
  for (const uint32_t channels : {3u, 4u}) {
    const std::string path = folder.file("seed.png");
    REQUIRE(runtime::write_png(path, 13, 7, channels, std::span(pixels).first(13 * 7 * channels)));
    Seed::save(tests::read_file(path), "image", "png" + std::to_string(channels));
  }
  Seed::save(tests::read_file(data_path("checker.png").string()), "image", "checker");
}

/// A textured grid whose JPEG is kept as one, with two levels.
std::string textured_model(const TempFolder& folder) {
  JpegRecipe recipe;
  recipe.width = recipe.height = 128;
  recipe.factors = {{2, 2}, {1, 1}, {1, 1}};
  recipe.quality = 5;
  const std::string path = folder.file("textured.glb");
  ModelMaker maker(path);
  GridSpec spec;
  spec.uv = spec.normal = true;
  maker.node(
      "node",
      maker.mesh("mesh", {maker.grid(spec, maker.textured("jpeg", format::ImageCodec::kJpeg, make_jpeg(recipe)))}));
  maker.finish();
  return path;
}

void make_scene_seeds(const TempFolder& folder) {
  Seed::save(file_of(tiny_parts()), "container", "tiny");
  Seed::save(file_of(full_parts()), "container", "full");
  const std::string textured = textured_model(folder);
  Seed::save(tests::read_file(textured), "gltf", "textured");
  const auto pack_as = [&](const std::string& input, const std::string& name, auto change) {
    convert::ConvertOptions options;
    change(options);
    const std::string output = folder.file(name + ".scree");
    REQUIRE(pack(input, output, options));
    Seed::save(tests::read_file(output), "container", name);
  };
  const auto plain = [](convert::ConvertOptions&) {};
  const auto clustered = [](convert::ConvertOptions& o) { o.encoding = convert::Encoding::kClustered; };
  pack_as(textured, "textured", plain);
  pack_as(data_path("textured_cube.glb").string(), "cube", clustered);
  pack_as(data_path("gpu_instancing.glb").string(), "instances", plain);
  pack_as(data_path("colors.glb").string(), "colors", [](convert::ConvertOptions& o) { o.source_ids = true; });
  pack_as(data_path("materials.gltf").string(), "materials", plain);
  pack_as(data_path("nodes.gltf").string(), "nodes", [](convert::ConvertOptions& o) { o.float32 = true; });
  const std::string grid = folder.file("grid.glb");
  make_model(grid, {.columns = 12, .rows = 9, .color = true, .normal = true});
  pack_as(grid, "grid_clustered", [](convert::ConvertOptions& o) {
    o.encoding = convert::Encoding::kClustered;
    o.normals = o.source_ids = true;
  });
  pack_as(grid, "grid_split", [](convert::ConvertOptions& o) {
    o.encoding = convert::Encoding::kClustered;
    o.zstd_level = 3;
  });
  pack_as(grid, "grid_zstd", [](convert::ConvertOptions& o) { o.zstd_level = 3, o.chunk_triangles = 50; });

  for (const char* name :
       {"colors.glb", "gpu_instancing.glb", "index_types.glb", "interleaved.glb", "left_out.glb", "modes.glb",
        "multi_primitive.glb", "quantized.glb", "textured_cube.glb", "data_uri.gltf", "nodes.gltf", "materials.gltf"})
    Seed::save(tests::read_file(data_path(name).string()), "gltf", name);
  // What a .gltf and its .bin beside it say, in one file.
  const std::string sparse = replaced(read_whole(data_path("sparse.gltf").string()), "sparse.bin", "data.bin");
  Seed::save(std::as_bytes(std::span<const char>(sparse)), "gltf", "sparse");
}

TEST_CASE("fuzz corpus: the seeds are made anew", "[.][make-corpus]") {
  const TempFolder folder;
  make_index_seeds();
  make_position_seeds();
  make_attribute_seeds();
  make_cluster_seed(4, tools::ClusterEffort::kFast, "small");
  make_cluster_seed(12, tools::ClusterEffort::kBest, "several");
  make_cluster_seed(40, tools::ClusterEffort::kFast, "groups");
  make_jpeg_seeds();
  make_png_seeds(folder);
  make_scene_seeds(folder);
}

}  // namespace
}  // namespace scree::tests
