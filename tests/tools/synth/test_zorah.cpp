// Scenes like Zorah have the counts of NVIDIA's files, are converted and are drawn.
#include "tools/synth/zorah.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "format/blocks/format.h"
#include "runtime/images/block_file.h"
#include "runtime/images/image.h"
#include "runtime/scene/camera.h"
#include "tests/runtime/frame.h"
#include "tests/runtime/load_scene.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tools/gltf/document/document.h"
#include "tools/inspect/verify.h"
#include "tools/synth/block_encoder.h"
#include "tools/synth/sheet.h"

using namespace scree;
using namespace scree::synth;
using nlohmann::json;
using tests::read_whole;
using tests::TempFolder;

namespace {

constexpr double kGib = 1073741824;

double gib_of_levels(const ZorahPlan& plan, uint32_t longest) {
  uint64_t bytes = 0;
  for (const BlockTexture& texture : plan.textures) bytes += block_bytes_of(texture, longest);
  return static_cast<double>(bytes) / kGib;
}

/// Writes a scene and returns its document.
json written(const TempFolder& folder, const ZorahPlan& plan, uint32_t threads = 2) {
  const SynthOptions options{.output = folder.file(plan.name + ".gltf"), .threads = threads};
  const SynthReport report = must(write_zorah(plan, options));
  const json document = json::parse(read_whole(options.output));
  uint64_t bytes = std::filesystem::file_size(options.output);
  for (const char* kind : {"buffers", "images"}) {
    if (!document.contains(kind)) continue;
    for (const json& file : document[kind])
      if (file.contains("uri")) bytes += std::filesystem::file_size(folder.file(file["uri"].get<std::string>()));
  }
  CHECK(report.file_bytes == bytes);
  return document;
}

/// The same plan with a fortieth of the files, because each file is synced to the disk.
ZorahPlan with_fewer_files(ZorahPlan plan) {
  constexpr uint32_t kFewer = 40;
  for (ZorahGroup& group : plan.groups) group.buffer /= kFewer;
  plan.buffers = plan.groups.back().buffer + 1;
  std::vector<BlockTexture> textures;
  for (size_t i = 0; i < plan.textures.size(); i += kFewer) textures.push_back(plan.textures[i]);
  plan.textures = textures;
  for (ZorahMaterial& material : plan.materials)
    for (uint32_t* texture :
         {&material.color, &material.surface, &material.normals, &material.specular_texture, &material.emission})
      if (*texture != format::kNone) *texture /= kFewer;
  plan.png_images /= kFewer;
  plan.tile_images /= kFewer;
  return plan;
}

uint64_t triangles_of(const json& document, const json& primitive) {
  return document["accessors"][primitive["indices"].get<size_t>()]["count"].get<uint64_t>() / 3;
}

/// By mesh: how many times it is drawn.
std::vector<uint64_t> draws_of(const json& document) {
  std::vector<uint64_t> draws(document["meshes"].size());
  for (const json& node : document["nodes"]) {
    if (!node.contains("mesh")) continue;
    uint64_t count = 1;
    if (node.contains("extensions")) {
      const json& attributes = node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"];
      count = document["accessors"][attributes["TRANSLATION"].get<size_t>()]["count"].get<uint64_t>();
    }
    draws[node["mesh"].get<size_t>()] += count;
  }
  return draws;
}

/// Converts, checks and draws a document's scene. Checks that the file has the document's counts.
void check_packed(const TempFolder& folder, const std::string& scene, const json& document) {
  convert::ConvertOptions options = tests::options_of(folder, scene + ".gltf");
  options.normals = convert::Normals::kAuto;
  options.source_ids = false;
  const convert::ConvertReport report = tests::must_convert(options);
  const std::vector<uint64_t> draws = draws_of(document);
  uint64_t instances = 0, drawn = 0;
  for (size_t m = 0; m < draws.size(); ++m) {
    instances += draws[m] * document["meshes"][m]["primitives"].size();  // a packed mesh is one primitive
    for (const json& primitive : document["meshes"][m]["primitives"])
      drawn += draws[m] * triangles_of(document, primitive);
  }
  const auto packed = must(tests::open_packed(options.output));
  const auto map = must(runtime::MappedFile::open(options.output));
  CHECK(inspect::verify(packed.file, map.bytes(), 2).failure_count == 0);
  if (document.contains("images")) CHECK(packed.file.images().size() <= document["images"].size());

  const runtime::Scene loaded = tests::must_load(options.output);
  const auto view = must(runtime::make_view(loaded, {.camera = "view", .width = 160, .height = 90}));
  const auto picture = tests::must_picture(loaded, view);
  std::set<std::array<uint8_t, 3>> colors;
  for (size_t i = 0; i + 3 < picture.size(); i += 4) colors.insert({picture[i], picture[i + 1], picture[i + 2]});
  CHECK(colors.size() > 100);
  CHECK(report.triangles_drawn == drawn);
  CHECK(packed.file.instances().size() == instances);
}

uint64_t drawn_primitives(const ZorahPlan& plan) {
  uint64_t sum = 0;
  for (const ZorahMesh& mesh : plan.meshes) sum += mesh.materials.size() * (mesh.nodes + mesh.instances);
  return sum;
}

/// The sum over all meshes. A shared accessor counts once per mesh.
uint64_t named_triangles(const ZorahPlan& plan) {
  uint64_t sum = 0;
  for (const ZorahMesh& mesh : plan.meshes)
    for (size_t i = 0; i < mesh.materials.size(); ++i) sum += plan.groups[mesh.first_group + i].triangles;
  return sum;
}

}  // namespace

TEST_CASE("zorah's plan has the counts of NVIDIA's file", "[synth][zorah]") {
  const ZorahPlan plan = zorah_plan(1);
  CHECK(plan.meshes.size() == 2068);
  CHECK(plan.primitives() == 3163);
  CHECK(plan.groups.size() == 3163);
  CHECK(plan.unique_triangles() == 1627207159);
  CHECK(plan.drawn_triangles() == 18937042387);
  CHECK(plan.drawn_meshes() == 16988);
  CHECK(drawn_primitives(plan) == 19144);
  CHECK(plan.materials.size() == 3283);
  // The decoded bytes of float attributes and 32-bit indices.
  CHECK(12 * (plan.unique_triangles() + plan.vertices()) == 31690629036);
  uint64_t largest = 0, most = 0, mountains = 0;
  std::set<uint32_t> used;
  for (const ZorahGroup& group : plan.groups) largest = std::max(largest, group.triangles);
  for (const ZorahMesh& mesh : plan.meshes) {
    REQUIRE(mesh.nodes >= 1);
    most = std::max<uint64_t>(most, mesh.nodes);
    used.insert(mesh.materials.begin(), mesh.materials.end());
    if (mesh.kind == ZorahKind::kMountain) mountains += mesh.nodes;
    if (mesh.nodes == 365) CHECK(plan.groups[mesh.first_group].triangles == 19461216);
  }
  CHECK(largest == 32054609);
  CHECK(plan.groups[0].triangles == largest);
  CHECK(plan.groups[0].vertices == 16005261);
  CHECK(most == 365);
  CHECK(mountains == 50);
  CHECK(used.size() == 2882);
}

TEST_CASE("zorah-textured's plan has the counts of NVIDIA's file", "[synth][zorah]") {
  const ZorahPlan plan = zorah_textured_plan(1);
  CHECK(plan.meshes.size() == 2812);
  CHECK(plan.primitives() == 7277);
  CHECK(plan.groups.size() == 5408);
  CHECK(named_triangles(plan) == 3310614344);
  CHECK(plan.unique_triangles() == 1630979739);
  CHECK(plan.drawn_triangles() == 18930392835);
  CHECK(plan.drawn_meshes() == 16118);
  CHECK(drawn_primitives(plan) == 43068);
  CHECK(plan.buffers == 2034);
  uint64_t with_normals = 0, with_uvs = 0, with_tangents = 0, instancing = 0, kites = 0;
  std::set<uint32_t> buffers;
  for (const ZorahMesh& mesh : plan.meshes) {
    instancing += mesh.instances != 0;
    REQUIRE(mesh.nodes + mesh.instances >= 1);
    REQUIRE(mesh.nodes < 100);
    if (mesh.kind == ZorahKind::kKite) kites += mesh.nodes + mesh.instances;
    for (size_t i = 0; i < mesh.materials.size(); ++i) {
      const ZorahGroup& group = plan.groups[mesh.first_group + i];
      with_normals += group.normals;
      with_uvs += group.uvs;
      with_tangents += group.tangents;
      buffers.insert(group.buffer);
    }
  }
  CHECK(with_normals == 7276);
  CHECK(with_uvs == 7237);
  CHECK(with_tangents == 1713);
  CHECK(instancing == 1092);
  CHECK(kites == 52);
  CHECK(buffers.size() == 2034);

  CHECK(plan.textures.size() == 4418);
  std::map<format::BlockFormat, int> formats;
  for (const BlockTexture& texture : plan.textures) ++formats[block_format_of(texture.picture)];
  CHECK(formats[format::BlockFormat::kBc7] == 1583);
  CHECK(formats[format::BlockFormat::kBc5] == 2774);
  CHECK(formats[format::BlockFormat::kBc4] == 61);
  CHECK(std::abs(gib_of_levels(plan, 512) - 1.36) < 0.005);
  CHECK(std::abs(gib_of_levels(plan, 1024) - 5.41) < 0.005);
  CHECK(std::abs(gib_of_levels(plan, 2048) - 21.5) < 0.05);
  CHECK(std::abs(gib_of_levels(plan, UINT32_MAX) - 85.024) < 0.05);

  CHECK(plan.materials.size() == 1514);
  uint64_t masks = 0, blends = 0, sides = 0, transmissive = 0, unlit = 0, specular = 0, transforms = 0;
  std::set<uint32_t> textures;
  for (const ZorahMaterial& material : plan.materials) {
    masks += material.alpha == ZorahMaterial::Alpha::kMask;
    blends += material.alpha == ZorahMaterial::Alpha::kBlend;
    sides += material.double_sided;
    transmissive += material.transmission;
    unlit += material.unlit;
    specular += material.specular;
    for (const uint32_t texture :
         {material.color, material.surface, material.normals, material.specular_texture, material.emission})
      if (texture != format::kNone) {
        textures.insert(texture);
        transforms += material.transform;
      }
  }
  CHECK(masks == 110);
  CHECK(blends == 1);
  CHECK(sides == 157);
  CHECK(transmissive == 1);
  CHECK(unlit == 1);
  CHECK(specular == 1388);
  CHECK(transforms == 501);
  CHECK(textures.size() == 4418);
}

TEST_CASE("smaller versions of zorah keep the counts", "[synth][zorah]") {
  for (const double scale : {0.25, 0.001, 1e-9}) {
    const ZorahPlan plan = zorah_textured_plan(scale);
    CHECK(plan.primitives() == 7277);
    CHECK(drawn_primitives(plan) == 43068);
    CHECK(plan.textures.size() == 4418);
    const double share = static_cast<double>(plan.unique_triangles()) / 1630979739;
    if (scale > 1e-6) CHECK(share == Approx(scale).epsilon(0.01));
    const double texels = gib_of_levels(plan, UINT32_MAX) / 85.024;
    if (scale > 0.1) CHECK(texels == Approx(scale).epsilon(0.01));
    for (const ZorahGroup& group : plan.groups) REQUIRE((group.triangles >= 2 && group.vertices >= 4));
  }
}

TEST_CASE("a sheet has exactly the stated triangles and vertices", "[synth][zorah]") {
  bool counts_right = true, indices_right = true, all_used = true;
  for (uint64_t triangles = 2; triangles < 160; triangles += triangles < 40 ? 1 : 7)
    for (uint64_t vertices = 4; vertices < 120; ++vertices) {
      const SheetGrid grid(triangles, vertices);
      const std::vector<uint32_t> indices = make_indices(grid);
      const std::vector<float> points = make_stream(grid, {}, SheetStream::kPositions);
      counts_right = counts_right && indices.size() == 3 * triangles && points.size() == 3 * vertices;
      std::set<uint32_t> used(indices.begin(), indices.end());
      indices_right = indices_right && *used.rbegin() < vertices;
      for (size_t i = 0; i < indices.size(); i += 3)
        indices_right = indices_right && indices[i] != indices[i + 1] && indices[i + 1] != indices[i + 2] &&
                        indices[i] != indices[i + 2];
      // An odd last triangle may leave a corner of its quad unused.
      if (vertices <= triangles / 2) all_used = all_used && used.size() + grid.spare_vertices() + 1 >= vertices;
    }
  CHECK(counts_right);
  CHECK(indices_right);
  CHECK(all_used);
  const SheetGrid largest(32054609, 16005261);
  CHECK(largest.spare_vertices() == 0);
}

TEST_CASE("a sheet is a closed surface with matching normals and tangents", "[synth][zorah]") {
  const SheetGrid grid(2 * 24 * 24, 25 * 25 + 60);
  const SheetShape shape{.seed = 5, .round8 = 8};
  const std::vector<float> points = make_stream(grid, shape, SheetStream::kPositions);
  const std::vector<float> normals = make_stream(grid, shape, SheetStream::kNormals);
  const std::vector<float> tangents = make_stream(grid, shape, SheetStream::kTangents);
  REQUIRE(make_stream(grid, shape, SheetStream::kUvs).size() == 2 * grid.vertices());
  const std::vector<uint32_t> indices = make_indices(grid);
  const auto vector_at = [](const std::vector<float>& values, size_t at) {
    return Vec3{values[at], values[at + 1], values[at + 2]};
  };
  double volume = 0;
  int against = 0;
  for (size_t i = 0; i < indices.size(); i += 3) {
    const Vec3 a = vector_at(points, 3 * indices[i]), b = vector_at(points, 3 * indices[i + 1]),
               c = vector_at(points, 3 * indices[i + 2]);
    volume += dot(a, cross(b, c)) / 6;
    for (size_t k = 0; k < 3; ++k) against += dot(cross(b - a, c - a), vector_at(normals, 3 * indices[i + k])) < 0;
  }
  CHECK(volume > 3.0);  // a sphere of radius 1 has 4.19
  CHECK(volume < 5.5);
  CHECK(against < 30);  // triangles at the folds of the border
  for (size_t v = 0; v < grid.vertices(); ++v) {
    const Vec3 n = vector_at(normals, 3 * v), t = vector_at(tangents, 4 * v);
    REQUIRE(dot(n, n) == Approx(1).margin(1e-5));
    REQUIRE(dot(t, t) == Approx(1).margin(1e-5));
    REQUIRE(dot(n, t) == Approx(0).margin(1e-5));
  }
}

TEST_CASE("encoded blocks decode to nearly the same texels", "[synth][zorah]") {
  BlockTexels ramp{};
  for (uint32_t i = 0; i < 16; ++i)
    ramp[i] = {static_cast<uint8_t>(40 + 9 * i), static_cast<uint8_t>(200 - 7 * i), static_cast<uint8_t>(10 + 3 * i),
               255};
  const auto most_off = [&](const BlockTexels& texels, format::BlockFormat format, uint32_t channels,
                            const std::byte* block) {
    const runtime::Image image = runtime::decode_block_level(format, format::kPlainSwizzle, 4, 4, block);
    int most = 0;
    for (uint32_t i = 0; i < 16; ++i)
      for (uint32_t c = 0; c < 4; ++c)
        if ((channels >> c & 1) != 0) most = std::max(most, std::abs(image.rgba[4 * i + c] - texels[i][c]));
    return most;
  };
  for (const bool is_reversed : {false, true}) {
    if (is_reversed) std::reverse(ramp.begin(), ramp.end());
    alignas(16) std::byte block[16]{};
    encode_bc7(ramp, block);
    CHECK(most_off(ramp, format::BlockFormat::kBc7, 15, block) <= 4);
    encode_bc5(ramp, block);
    CHECK(most_off(ramp, format::BlockFormat::kBc5, 3, block) <= 10);  // half of a seventh of 135
    encode_bc4(ramp, 1, block);
    BlockTexels green = ramp;
    for (auto& texel : green) texel[0] = texel[1];
    CHECK(most_off(green, format::BlockFormat::kBc4, 1, block) <= 8);
  }
  BlockTexels flat{};
  flat.fill({17, 90, 3, 255});
  alignas(16) std::byte block[16]{};
  encode_bc7(flat, block);
  CHECK(most_off(flat, format::BlockFormat::kBc7, 15, block) <= 1);
  CHECK(most_off(flat, format::BlockFormat::kBc7, 8, block) == 0);  // opaque texels stay opaque
  encode_bc5(flat, block);
  CHECK(most_off(flat, format::BlockFormat::kBc5, 3, block) == 0);
}

TEST_CASE("generated textures are KTX2 files with all levels", "[synth][zorah]") {
  using enum format::ChannelSource;
  const struct {
    BlockPicture picture;
    uint16_t swizzle;
  } kinds[] = {{BlockPicture::kColor, format::kPlainSwizzle},
               {BlockPicture::kCutout, format::kPlainSwizzle},
               {BlockPicture::kSurface, format::make_swizzle(kOne, kRed, kGreen, kOne)},
               {BlockPicture::kNormals, format::kPlainSwizzle},
               {BlockPicture::kSpecular, format::make_swizzle(kOne, kOne, kOne, kRed)}};
  for (const auto& [picture, swizzle] : kinds) {
    const BlockTexture texture{picture, 128, 132, 7};
    const auto bytes = must(make_block_file(texture));
    runtime::ImageFile file(bytes);
    auto head = must(runtime::open_block_file(file));
    CHECK(head.width == 128);
    CHECK(head.height == 132);
    CHECK(head.format == block_format_of(picture));
    CHECK(head.swizzle == swizzle);
    CHECK(head.packing == runtime::BlockFile::Packing::kZstd);
    REQUIRE(head.levels.size() == 8);
    std::vector<double> mean;
    bool is_opaque = true;
    for (uint32_t l = 0; l < 8; ++l) {
      const auto blocks = must(runtime::read_block_level(file, head, l));
      const runtime::Image image = runtime::decode_block_level(head.format, head.swizzle, std::max(1u, 128u >> l),
                                                               std::max(1u, 132u >> l), blocks.data());
      double sum = 0;
      for (size_t i = 0; i < image.rgba.size(); i += 4) {
        sum += image.rgba[i + 1];
        is_opaque = is_opaque && image.rgba[i + 3] == 255;
      }
      mean.push_back(sum / static_cast<double>(image.rgba.size() / 4));
    }
    CHECK(is_opaque == (picture != BlockPicture::kCutout && picture != BlockPicture::kSpecular));
    if (picture == BlockPicture::kColor) CHECK(std::abs(mean[5] - mean[0]) < 25);  // all levels show the same picture
  }
}

TEST_CASE("zorah is written, converted and drawn", "[synth][zorah]") {
  const TempFolder folder;
  const json document = written(folder, zorah_plan(3e-5));
  CHECK(document["extensionsRequired"] == json{"EXT_meshopt_compression"});
  REQUIRE(document["buffers"].size() == 2);
  CHECK(document["buffers"][0]["uri"] == "zorah.bin");
  CHECK_FALSE(document["buffers"][1].contains("uri"));
  CHECK(document["buffers"][1]["extensions"]["EXT_meshopt_compression"]["fallback"] == true);
  uint64_t decoded = 0;
  for (const json& view : document["bufferViews"]) {
    REQUIRE(view["buffer"] == 1);
    REQUIRE(view["extensions"]["EXT_meshopt_compression"]["buffer"] == 0);
    decoded += view["byteLength"].get<uint64_t>();
  }
  CHECK(document["buffers"][1]["byteLength"] == decoded);
  CHECK(document["meshes"].size() == 2068);
  CHECK(document["materials"].size() == 3283);
  uint64_t mesh_nodes = 0, mountains = 0;
  for (const json& node : document["nodes"]) {
    mesh_nodes += node.contains("mesh");
    CHECK_FALSE(node.contains("children"));
    mountains += node["name"].get<std::string>().starts_with("mountain_");
  }
  CHECK(mesh_nodes == 16988);
  CHECK(mountains == 50);
  CHECK(document["scenes"][0]["nodes"].size() == 16988 + 1);  // and the camera's node
  for (const json& mesh : document["meshes"])
    for (const json& primitive : mesh["primitives"]) REQUIRE(primitive["attributes"].size() == 1);
  check_packed(folder, "zorah", document);

  // The same bytes for any number of threads.
  const std::string bin = read_whole(folder.file("zorah.bin")), text = read_whole(folder.file("zorah.gltf"));
  written(folder, zorah_plan(3e-5), 1);
  CHECK(read_whole(folder.file("zorah.bin")) == bin);
  CHECK(read_whole(folder.file("zorah.gltf")) == text);
}

TEST_CASE("zorah-textured is written, converted and drawn", "[synth][zorah]") {
  const TempFolder folder;
  const ZorahPlan plan = with_fewer_files(zorah_textured_plan(2e-5));
  const json document = written(folder, plan);
  REQUIRE(document["buffers"].size() == 1 + plan.buffers + 1);
  CHECK(document["meshes"].size() == 2812);
  CHECK(document["nodes"].size() == 13079 + 1);  // and the camera's node
  uint64_t parents = 0, instancing = 0, primitives = 0, drawn = 0;
  std::set<uint64_t> positions;
  for (const json& node : document["nodes"]) {
    parents += node.contains("children");
    instancing += node.contains("extensions");
  }
  CHECK(parents == 3736);
  CHECK(instancing == 1092);
  const std::vector<uint64_t> draws = draws_of(document);
  for (size_t m = 0; m < draws.size(); ++m) {
    const json& mesh = document["meshes"][m];
    primitives += mesh["primitives"].size();
    drawn += draws[m] * mesh["primitives"].size();
    for (const json& primitive : mesh["primitives"])
      positions.insert(primitive["attributes"]["POSITION"].get<uint64_t>());
  }
  CHECK(primitives == 7277);
  CHECK(drawn == 43068);
  CHECK(positions.size() == 5408);
  REQUIRE(document["images"].size() == plan.textures.size());
  REQUIRE(document["textures"].size() == plan.textures.size());
  uint64_t pngs = 0, tiles = 0;
  for (const json& image : document["images"]) {
    pngs += image["mimeType"] == "image/png";
    const std::string uri = image["uri"];
    tiles += uri.ends_with(".1001.ktx2");
    CHECK(read_whole(folder.file(uri)).substr(1, 6) == "KTX 20");
  }
  CHECK(pngs == plan.png_images);
  CHECK(tiles == plan.tile_images);
  std::map<std::string, int> modes, extensions;
  for (const json& material : document["materials"]) {
    ++modes[material.value("alphaMode", "OPAQUE")];
    const json used = material.value("extensions", json::object());
    for (const auto& [name, content] : used.items()) ++extensions[name];
  }
  CHECK(modes["OPAQUE"] == 1403);
  CHECK(modes["MASK"] == 110);
  CHECK(modes["BLEND"] == 1);
  CHECK(extensions["KHR_materials_specular"] == 1388);
  CHECK(extensions["KHR_materials_transmission"] == 1);
  CHECK(extensions["KHR_materials_unlit"] == 1);
  check_packed(folder, "zorah-textured", document);
}

TEST_CASE("zorah-textured has as many files as NVIDIA's", "[zorah][.slow]") {
  const TempFolder folder;
  const SynthOptions options{.scene = "zorah-textured", .output = folder.file("t.gltf"), .scale = 2e-5};
  must(synthesize(options));
  const json document = json::parse(read_whole(options.output));
  CHECK(document["buffers"].size() == 1 + 2034 + 1);
  CHECK(document["images"].size() == 4418);
  check_packed(folder, "t", document);
}

TEST_CASE("zorah refuses options of other scenes", "[synth][zorah]") {
  const TempFolder folder;
  const auto refused = [&](const SynthOptions& options) {
    return refusal(synthesize(options)).code == ErrorCode::kUsage;
  };
  SynthOptions options{.scene = "zorah", .output = folder.file("z.glb")};
  CHECK(refused(options));
  options.output = folder.file("z.gltf");
  for (const int which : {0, 1, 2, 3, 4}) {
    SynthOptions bad = options;
    if (which == 0) bad.normals = true;
    if (which == 1) bad.gpu_instancing = true;
    if (which == 2) bad.texture_size = 64;
    if (which == 3) bad.seed = 2;
    if (which == 4) bad.checks = true;
    CHECK(refused(bad));
  }
  CHECK(std::filesystem::is_empty(folder.path()));
}
