// Makes the corpus' seeds from the tests' inputs: scree_tests "[make-corpus]". The seeds are committed; a new codec or
// table needs new ones.
#include <meshoptimizer.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "format/geometry/attribute_codec.h"
#include "format/geometry/chunk_layout.h"
#include "format/geometry/cluster_codec.h"
#include "format/geometry/cluster_page.h"
#include "format/geometry/index_codec.h"
#include "format/geometry/position_codec.h"
#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "tests/format/container/container_fixture.h"
#include "tests/format/geometry/index_range.h"
#include "tests/format/jpeg/jpeg_checks.h"
#include "tests/models.h"
#include "tests/runtime/images/basis_files.h"
#include "tests/tools/model_maker.h"
#ifdef SCREE_TESTS_DRACO
#include "tests/tools/gltf/draco/draco_streams.h"
#endif
#ifdef SCREE_TESTS_WEBP
#include "tests/runtime/images/webp_files.h"
#endif
#include "tests/tools/packed_file.h"
#include "tools/clusters/cluster_builder.h"
#include "tools/convert/convert.h"
#include "tools/convert/passes/shard.h"

namespace scree::tests {
namespace {

/// The fields of a seed in the order of fuzz::Parameters, then a stream.
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
  const format::IndexRange range = scree::tests::index_range(indices);
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
    const auto lattice = must(format::choose_lattice(lo, hi, bits, 0));
    std::vector<uint32_t> coordinates(points.size());
    format::quantize_positions(coordinates, points, lattice);
    const format::PositionRange range = format::position_range(coordinates);
    Bytes stream(format::position_stream_bytes(4, range));
    format::encode_positions(stream, coordinates, range);
    position_head(lattice, range, 4).stream(stream).save("position_codec", "lattice" + std::to_string(bits));
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
  stream.assign(format::packed_bytes(4, id_range.bits), std::byte{0});
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
    JpegRecipe recipe{.name = name, .width = 21, .height = 19, .factors = {{2, 2}, {1, 1}, {1, 1}}, .quality = 60};
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
    REQUIRE(runtime::write_png(path, {13, 7, channels, std::span(pixels).first(13 * 7 * channels)}));
    Seed::save(tests::read_bytes(path), "image", "png" + std::to_string(channels));
  }
  Seed::save(tests::read_bytes(data_path("checker.png").string()), "image", "checker");
}

void make_webp_seeds() {
#ifdef SCREE_TESTS_WEBP
  for (const bool has_alpha : {false, true})
    for (const float quality : {0.0f, 60.0f})
      Seed::save(make_webp(smooth_pixels(21, 13, has_alpha), 21, 13, quality), "image",
                 std::string("webp_") + (quality == 0 ? "lossless" : "lossy") + (has_alpha ? "_alpha" : ""));
#endif
}

void make_draco_seeds() {
#ifdef SCREE_TESTS_DRACO
  const DracoGrid grid(4);
  for (const bool is_sequential : {false, true})
    for (const int bits : {0, 8}) {
      const DracoRecipe recipe{.is_sequential = is_sequential, .position_bits = bits};
      const Bytes stream = make_draco(grid, recipe);
      std::string json = draco_document({stream}, grid.triangles(), grid.vertices(), recipe);
      // The stream is moved into the file itself, where it can be changed byte by byte.
      const size_t uri = json.find(R"(,"uri":"data:)");
      json.erase(uri, json.find('"', uri + 8) + 1 - uri);
      json = replaced(json, R"("textures":[{"source":0}],"images":[{"uri":"t.png"}],)", R"("textures":[{}],)");
      json.append((4 - json.size() % 4) % 4, ' ');
      Seed glb;
      const auto padded = static_cast<uint32_t>((stream.size() + 3) / 4 * 4);
      Bytes binary = stream;
      binary.resize(padded);
      glb.add(uint32_t{0x46546c67}).add(uint32_t{2}).add(static_cast<uint32_t>(28 + json.size() + padded));
      glb.add(static_cast<uint32_t>(json.size())).add(uint32_t{0x4e4f534a});
      for (const char c : json) glb.add(c);
      glb.add(padded).add(uint32_t{0x004e4942}).stream(binary);
      glb.save("gltf", std::string("draco_") + (is_sequential ? "sequential" : "edgebreaker") +
                           (bits == 0 ? ".glb" : "_8bits.glb"));
    }
#endif
}

void make_block_seeds() {
  for (const bool has_alpha : {false, true}) {
    const BasisFile basis = make_basis_lz({.width = 13, .height = 10, .has_alpha = has_alpha, .is_grey = !has_alpha});
    for (const char* target : {"block_file", "image"})
      Seed::save(basis.bytes, target, has_alpha ? "basis_lz_alpha.ktx2" : "basis_lz.ktx2");
  }
  for (const auto& [name, bytes] : block_files()) {
    Seed::save(bytes, "block_file", name);
    Seed::save(bytes, "image", name);
  }
}

/// A textured grid whose JPEG is kept, with two levels. `is_magnified`: shows a part of the picture, so that level 0 is
/// used.
std::string textured_model(const TempFolder& folder, bool is_magnified) {
  JpegRecipe recipe;
  recipe.width = recipe.height = 128;
  recipe.factors = {{2, 2}, {1, 1}, {1, 1}};
  recipe.quality = 5;
  const std::string path = folder.file("textured.glb");
  ModelMaker maker(path);
  tools::GltfMaterial material;
  material.texture = maker.writer().add_texture(maker.texture("jpeg", format::ImageCodec::kJpeg, make_jpeg(recipe)));
  if (is_magnified) material.transform.scale[0] = material.transform.scale[1] = 0.2;
  GridSpec spec;
  spec.uv = spec.normal = true;
  maker.node("node", maker.mesh("mesh", {maker.grid(spec, maker.writer().add_material(material))}));
  maker.finish();
  return path;
}

/// Flips bits throughout the entropy-coded data of an indexed JPEG, so that decoders lose synchronisation, read invalid
/// codes and run past the end. `jpeg` lies in `file`.
void damage(std::span<std::byte> file, std::span<const std::byte> jpeg) {
  const auto index = must(format::open_jpeg_index(jpeg));
  REQUIRE(jpeg::rebuild(index));
  const std::span<std::byte> data =
      file.subspan(static_cast<size_t>(index.data.data() - file.data()), index.data.size());
  for (size_t i = 5; i < data.size(); i += 23) data[i] ^= std::byte{1} << (i % 8);
  REQUIRE(!jpeg::rebuild(must(format::open_jpeg_index(jpeg))));
}

/// The container with its texture's data damaged, resealed. It opens and can be drawn: only the verification decodes
/// level 0, while loading computes the missing levels from the last stored one, which is intact.
void make_damaged_seed(const std::string& path) {
  const auto packed = must(open_packed(path));
  const format::ImageRecord image = packed.file.images()[0];
  REQUIRE(image.codec == format::ImageCodec::kIndexedJpeg);
  REQUIRE(image.level_count > 0);
  const format::PageRecord page = packed.file.pages()[image.page];
  REQUIRE(page.codec == format::PageCodec::kRaw);
  const std::span<const std::byte> bytes = packed.map.bytes();
  Bytes file(bytes.begin(), bytes.end());
  damage(file, std::span(file).subspan(page.offset, page.raw_bytes));
  reseal_pages(file);
  reseal(file);
  Seed::save(file, "container", "magnified_damaged");
}

/// A .glb whose positions, normals (by the octahedral filter) and triangles are compressed by meshopt, one stream per
/// mode.
void make_meshopt_seed(const TempFolder& folder) {
  constexpr uint32_t kSide = 5;
  constexpr uint32_t kVertices = (kSide + 1) * (kSide + 1);
  std::vector<float> positions, directions;
  std::vector<uint32_t> corners;
  for (uint32_t v = 0; v < kVertices; ++v) {
    const float x = static_cast<float>(v % (kSide + 1)), y = static_cast<float>(v / (kSide + 1));
    positions.insert(positions.end(), {x, y, 0.1f * x * y});
    directions.insert(directions.end(), {0.6f, 0, 0.8f, 0});
    if (v % (kSide + 1) == kSide || v + kSide + 1 >= kVertices) continue;
    corners.insert(corners.end(), {v, v + 1, v + kSide + 2, v, v + kSide + 2, v + kSide + 1});
  }
  std::vector<uint32_t> normals(kVertices);
  meshopt_encodeFilterOct(normals.data(), kVertices, 4, 8, directions.data());

  std::string bin, views;
  size_t fallback = 0;
  const auto add = [&](const char* mode, const char* filter, std::vector<unsigned char> stream, size_t count,
                       size_t stride) {
    const std::string raw = std::to_string(count * stride);
    views += std::string(views.empty() ? "" : ",") + R"({"buffer":1,"byteOffset":)" + std::to_string(fallback) +
             R"(,"byteLength":)" + raw + R"(,"extensions":{"EXT_meshopt_compression":{"buffer":0,"byteOffset":)" +
             std::to_string(bin.size()) + R"(,"byteLength":)" + std::to_string(stream.size()) + R"(,"byteStride":)" +
             std::to_string(stride) + R"(,"count":)" + std::to_string(count) + R"(,"mode":")" + mode +
             R"(","filter":")" + filter + R"("}}})";
    bin.append(stream.begin(), stream.end());
    bin.resize((bin.size() + 3) / 4 * 4);
    fallback += count * stride;
  };
  const auto vertices = [&](const void* values, size_t stride) {
    std::vector<unsigned char> out(meshopt_encodeVertexBufferBound(kVertices, stride));
    out.resize(meshopt_encodeVertexBuffer(out.data(), out.size(), values, kVertices, stride));
    return out;
  };
  std::vector<unsigned char> triangles(meshopt_encodeIndexBufferBound(corners.size(), kVertices));
  triangles.resize(meshopt_encodeIndexBuffer(triangles.data(), triangles.size(), corners.data(), corners.size()));
  std::vector<unsigned char> sequence(meshopt_encodeIndexSequenceBound(corners.size(), kVertices));
  sequence.resize(meshopt_encodeIndexSequence(sequence.data(), sequence.size(), corners.data(), corners.size()));
  add("ATTRIBUTES", "NONE", vertices(positions.data(), 12), kVertices, 12);
  add("ATTRIBUTES", "OCTAHEDRAL", vertices(normals.data(), 4), kVertices, 4);
  add("TRIANGLES", "NONE", triangles, corners.size(), 4);
  add("INDICES", "NONE", sequence, corners.size(), 4);

  const std::string of_vertices = R"(,"count":)" + std::to_string(kVertices) + R"(,"type":"VEC3")";
  const std::string of_corners =
      R"(,"componentType":5125,"count":)" + std::to_string(corners.size()) + R"(,"type":"SCALAR"})";
  std::string json =
      R"({"asset":{"version":"2.0"},"extensionsUsed":["EXT_meshopt_compression","KHR_mesh_quantization"],)"
      R"("extensionsRequired":["EXT_meshopt_compression","KHR_mesh_quantization"],"buffers":[{"byteLength":)" +
      std::to_string(bin.size()) + R"(},{"byteLength":)" + std::to_string(fallback) +
      R"(,"extensions":{"EXT_meshopt_compression":{"fallback":true}}}],"bufferViews":[)" + views +
      R"(],"accessors":[{"bufferView":0,"componentType":5126,"min":[0,0,0],"max":[5,5,2.5])" + of_vertices +
      R"(},{"bufferView":1,"componentType":5120,"normalized":true)" + of_vertices + R"(},{"bufferView":2)" +
      of_corners + R"(,{"bufferView":3)" + of_corners +
      R"(],"meshes":[{"primitives":[{"indices":2,"attributes":{"POSITION":0,"NORMAL":1}},)"
      R"({"indices":3,"attributes":{"POSITION":0}}]}],"nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}],"scene":0})";
  json.resize((json.size() + 3) / 4 * 4, ' ');
  Seed glb;
  const auto size = [](const std::string& text) { return static_cast<uint32_t>(text.size()); };
  const auto add_chunk = [&](uint32_t type, const std::string& text) {
    glb.add(size(text)).add(type);
    for (const char byte : text) glb.add(byte);
  };
  glb.add(uint32_t{0x46546c67}).add(uint32_t{2}).add(28 + size(json) + size(bin));
  add_chunk(0x4e4f534a, json);
  add_chunk(0x004e4942, bin);
  glb.save("gltf", "meshopt.glb");
  const auto seed = std::filesystem::path(tests::kCorpusFolder) / "gltf/meshopt.glb";
  REQUIRE(must(pack(seed.string(), folder.file("meshopt.scree"))).file.meshes().size() == 2);
}

/// A grid with KTX2 and DDS textures, some of them with levels.
std::string block_model(const TempFolder& folder) {
  const std::string path = folder.file("blocks.glb");
  ModelMaker maker(path);
  GridSpec spec;
  spec.columns = spec.rows = 2;
  spec.uv = true;
  for (const auto& [name, bytes] : block_files()) {
    maker.draw(name, {maker.grid(spec, maker.textured(name, format::ImageCodec::kBlocks, bytes))});
    spec.origin[0] += 1.1f;
  }
  maker.finish();
  return path;
}

void make_scene_seeds(const TempFolder& folder) {
  Seed::save(file_of(tiny_parts()), "container", "tiny");
  Seed::save(file_of(full_parts()), "container", "full");
  const std::string textured = textured_model(folder, false);
  Seed::save(tests::read_bytes(textured), "gltf", "textured");
  const auto pack_as = [&](const std::string& input, const std::string& name, auto change) {
    convert::ConvertOptions options;
    change(options);
    const std::string output = folder.file(name + ".scree");
    REQUIRE(pack(input, output, options));
    Seed::save(tests::read_bytes(output), "container", name);
  };
  const auto indexed = [](convert::ConvertOptions& o) { o.encoding = convert::Encoding::kIndexed; };
  const auto clustered = [](convert::ConvertOptions& o) { o.encoding = convert::Encoding::kClustered; };
  pack_as(textured, "textured", indexed);
  pack_as(textured_model(folder, true), "magnified", clustered);
  make_damaged_seed(folder.file("magnified.scree"));
  make_meshopt_seed(folder);
  const std::string blocks = block_model(folder);
  pack_as(blocks, "blocks", indexed);
  Seed::save(tests::read_bytes(blocks), "gltf", "blocks.glb");
  pack_as(data_path("textured_cube.glb").string(), "cube", clustered);
  pack_as(data_path("gpu_instancing.glb").string(), "instances", indexed);
  pack_as(data_path("colors.glb").string(), "colors", [](convert::ConvertOptions& o) {
    o.encoding = convert::Encoding::kIndexed;
    o.source_ids = true;
  });
  pack_as(data_path("materials.gltf").string(), "materials", indexed);
  pack_as(data_path("masked.glb").string(), "masked", clustered);
  pack_as(data_path("nodes.gltf").string(), "nodes",
          [](convert::ConvertOptions& o) { o.encoding = convert::Encoding::kIndexed, o.float32 = true; });
  const std::string grid = folder.file("grid.glb");
  make_model(grid, {.columns = 12, .rows = 9, .color = true, .normal = true});
  pack_as(grid, "grid_clustered", [](convert::ConvertOptions& o) {
    o.encoding = convert::Encoding::kClustered;
    o.normals = convert::Normals::kAlways;
    o.source_ids = true;
  });
  pack_as(grid, "grid_split", [](convert::ConvertOptions& o) {
    o.encoding = convert::Encoding::kClustered;
    o.zstd_level = 3;
  });
  pack_as(grid, "grid_zstd", [](convert::ConvertOptions& o) {
    o.encoding = convert::Encoding::kIndexed, o.zstd_level = 3, o.chunk_triangles = 50;
  });

  for (const char* name :
       {"colors.glb", "gpu_instancing.glb", "index_types.glb", "interleaved.glb", "left_out.glb", "modes.glb",
        "multi_primitive.glb", "quantized.glb", "textured_cube.glb", "data_uri.gltf", "nodes.gltf", "materials.gltf"})
    Seed::save(tests::read_bytes(data_path(name).string()), "gltf", name);
  // The content of a .gltf and its .bin in one file.
  const std::string sparse = replaced(read_whole(data_path("sparse.gltf").string()), "sparse.bin", "data.bin");
  Seed::save(std::as_bytes(std::span<const char>(sparse)), "gltf", "sparse");
}

/// Names of this machine and times are replaced.
void make_shard_seeds(const TempFolder& folder) {
  convert::ConvertOptions options;
  options.input = data_path("textured_cube.glb").string();
  options.output = folder.file("shard.scree");
  options.shards = 1;
  must(convert::convert(options));
  const Bytes bytes = tests::read_bytes(options.output);
  const auto container = must(format::Container::open(bytes));
  for (uint32_t page = 0; page < container.pages().size(); ++page) {
    const format::PageRecord& record = container.pages()[page];
    const auto stored = std::span<const std::byte>(bytes).subspan(record.offset, record.stored_bytes);
    if (record.kind == convert::kShardPlanPage) {
      convert::ShardPlan plan = must(convert::unpack_plan(stored));
      for (convert::FileStamp& file : plan.files) file.changed_s = file.changed_ns = 1;
      Seed::save(convert::pack_plan(plan), "shard", "plan");
    } else if (record.kind == convert::kShardSharePage) {
      convert::ShardShare share = must(convert::unpack_share(stored));
      share.input = "/scene.gltf";
      Seed::save(convert::pack_share(share), "shard", "share");
    }
  }
}

TEST_CASE("fuzz corpus: the seeds are written again", "[.][make-corpus]") {
  const TempFolder folder;
  make_index_seeds();
  make_position_seeds();
  make_attribute_seeds();
  make_cluster_seed(4, tools::ClusterEffort::kFast, "small");
  make_cluster_seed(12, tools::ClusterEffort::kBest, "several");
  make_cluster_seed(40, tools::ClusterEffort::kFast, "groups");
  make_jpeg_seeds();
  make_png_seeds(folder);
  make_webp_seeds();
  make_draco_seeds();
  make_block_seeds();
  make_scene_seeds(folder);
  make_shard_seeds(folder);
}

}  // namespace
}  // namespace scree::tests
