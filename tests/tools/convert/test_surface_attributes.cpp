// Second texture coordinates and tangents: the rule for storing them, their precision, and their export.
#include <cmath>
#include <filesystem>
#include <map>
#include <vector>

#include "format/geometry/tangent_codec.h"
#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tools/common/chunk_decode.h"
#include "tools/export/export.h"
#include "tools/gltf/source.h"

using namespace scree;
using namespace scree::convert;
using namespace scree::tests;
using tools::GltfType;

namespace {

constexpr double kDegree = 3.14159265358979323846 / 180;

format::SurfaceRecord plain_surface() {
  format::SurfaceRecord surface{
      .roughness = 0.5f, .normal_scale = 1, .occlusion_strength = 1, .ior = 1.5f, .specular = 1};
  std::fill_n(surface.specular_color, 3, 1.0f);
  for (format::SurfaceTexture& use : surface.textures) use = {format::kNone, {0, 0}, {1, 1}, 0};
  return surface;
}

uint32_t white_texture(tests::ModelMaker& maker) {
  const std::vector<uint8_t> white(4 * 4 * 4, 255);
  return maker.writer().add_texture(
      maker.texture("white", format::ImageCodec::kPng, must(runtime::encode_png({4, 4, 4, white}))));
}

/// A strip of `n` squares along x that is bent by `bend` radians per square, with normals and tangents at the corners.
struct Strip {
  std::vector<float> points, normals, uvs, seconds, tangents;
  std::vector<uint32_t> corners;
};

/// `turn`: degrees by which the tangents are turned around the normals. `u_sign`: -1 mirrors the texture.
Strip strip(uint32_t n, double bend, double turn, float u_sign, float handedness) {
  Strip out;
  double x = 0, y = 0;
  for (uint32_t i = 0; i <= n; ++i) {
    const double angle = bend * i;
    for (const float z : {0.0f, -1.0f}) {
      out.points.insert(out.points.end(), {static_cast<float>(x), static_cast<float>(y), z});
      // The squares' own normals if the strip is flat, otherwise the mean of two neighbours.
      const double up = angle - bend / 2;
      out.normals.insert(out.normals.end(), {static_cast<float>(-std::sin(up)), static_cast<float>(std::cos(up)), 0});
      const double along[3] = {u_sign * std::cos(up), u_sign * std::sin(up), 0};
      const double c = std::cos(turn * kDegree), s = std::sin(turn * kDegree);
      out.tangents.insert(out.tangents.end(), {static_cast<float>(c * along[0]), static_cast<float>(c * along[1]),
                                               static_cast<float>(-s * u_sign), handedness});
      out.uvs.insert(out.uvs.end(), {u_sign * static_cast<float>(i), 1 + z});  // the texture's top is at z = -1
      out.seconds.insert(out.seconds.end(), {0.25f + 0.01f * static_cast<float>(i), -3 * z});
    }
    if (i < n) {
      const uint32_t a = 2 * i;
      out.corners.insert(out.corners.end(), {a, a + 2, a + 3, a, a + 3, a + 1});
    }
    x += std::cos(angle);
    y += std::sin(angle);
  }
  return out;
}

tools::GltfPrimitive primitive_of(tests::ModelMaker& maker, const Strip& strip, uint32_t material, bool has_second,
                                  bool has_tangents) {
  tools::GltfPrimitive out = maker.primitive(strip.points, strip.corners);
  out.material = material;
  out.attributes.emplace_back("NORMAL", maker.floats(strip.normals, GltfType::kVec3));
  out.attributes.emplace_back("TEXCOORD_0", maker.floats(strip.uvs, GltfType::kVec2));
  if (has_second) out.attributes.emplace_back("TEXCOORD_1", maker.floats(strip.seconds, GltfType::kVec2));
  if (has_tangents) out.attributes.emplace_back("TANGENT", maker.floats(strip.tangents, GltfType::kVec4));
  return out;
}

ConvertOptions auto_options(const TempFolder& folder) {
  ConvertOptions options = options_of(folder);
  options.normals = Normals::kAuto;
  options.source_ids = false;
  options.share = false;
  return options;
}

/// Finds the nearest source vertex by position for each stored vertex of a mesh.
template <class Take>
void for_each_vertex(const tests::PackedFile& file, uint64_t mesh, const Strip& strip, const Take& take) {
  tools::ChunkReader reader(file.file);
  const format::MeshRecord& record = file.file.meshes()[mesh];
  uint64_t count = 0;
  for (uint64_t c = record.first_chunk; c < record.first_chunk + record.chunk_count; ++c) {
    const auto read = must(reader.read(c));
    const tools::DecodedChunk& chunk = *read;
    for (size_t v = 0; v < chunk.positions.size() / 3; ++v) {
      size_t best = 0;
      double least = 1e30;
      for (size_t s = 0; s < strip.points.size() / 3; ++s) {
        double squared = 0;
        for (size_t axis = 0; axis < 3; ++axis)
          squared += std::pow(double{chunk.positions[3 * v + axis]} - double{strip.points[3 * s + axis]}, 2);
        if (squared < least) least = squared, best = s;
      }
      take(chunk, v, best);
      ++count;
    }
  }
  CHECK(count >= strip.points.size() / 3);
}

}  // namespace

TEST_CASE("second texture coordinates are stored if a material uses both sets", "[convert][surfaces]") {
  const TempFolder folder;
  const Strip made = strip(20, 0.1, 0, 1, 1);
  constexpr uint32_t kOcclusion = static_cast<uint32_t>(format::SurfaceUse::kOcclusion);
  tests::make_model(folder.file("in.glb"), [&](tests::ModelMaker& maker) {
    const uint32_t white = white_texture(maker);
    tools::GltfMaterial both, first, second;
    both.texture = white;
    both.surface = plain_surface();
    both.surface->textures[kOcclusion] = {white, {0.5f, 0}, {2, 2}, 0};
    first = both;
    both.surface->second_uv = 1u << kOcclusion;
    second = first;
    second.tex_coord = 1;
    const uint32_t with_both = maker.writer().add_material(both);
    const auto add = [&](const char* name, uint32_t material, bool has_second) {
      maker.draw(name, {primitive_of(maker, made, material, has_second, false)});
    };
    add("both", with_both, true);
    add("first only", maker.writer().add_material(first), true);
    add("second only", maker.writer().add_material(second), true);
    add("without", with_both, false);
  });
  for (const Encoding encoding : {Encoding::kIndexed, Encoding::kClustered}) {
    for (const bool float32 : {false, true}) {
      if (float32 && encoding == Encoding::kClustered) continue;
      ConvertOptions options = auto_options(folder);
      options.encoding = encoding;
      options.float32 = float32;
      std::filesystem::remove(options.output);
      options.zstd_level = encoding == Encoding::kClustered ? 3 : 0;
      must_convert(options);
      const tests::PackedFile file = must_open(options.output);
      CHECK(file.file.header().version_major == 2);
      const std::vector<bool> expected{true, false, false, false};
      for (size_t mesh = 0; mesh < expected.size(); ++mesh) {
        CAPTURE(mesh);
        const format::MeshRecord& record = file.file.meshes()[mesh];
        CHECK((record.attributes & format::kHasUv) != 0);
        CHECK(((record.attributes & format::kHasSecondUv) != 0) == expected[mesh]);
        for_each_vertex(file, mesh, made, [&](const tools::DecodedChunk& chunk, size_t v, size_t source) {
          for (size_t c = 0; c < 2; ++c) {
            const float uv = (mesh == 2 ? made.seconds : made.uvs)[2 * source + c];
            REQUIRE(std::abs(chunk.uvs[2 * v + c] - uv) <= record.max_uv_error);
            if (expected[mesh])
              REQUIRE(std::abs(chunk.second_uvs[2 * v + c] - made.seconds[2 * source + c]) <= record.max_uv_error);
          }
        });
      }
      CHECK(left_out(file.file)["TEXCOORD_0"] == 1);  // of "second only"
      CHECK(left_out(file.file)["TEXCOORD_1"] == 1);  // of "first only"
      REQUIRE(file.file.surfaces().size() == 3);
      CHECK(file.file.surfaces()[0].second_uv == 1u << kOcclusion);
      CHECK(file.file.surfaces()[1].second_uv == 0);

      // Export writes them as TEXCOORD_1. A mesh that has none gets its own material.
      const std::string back = folder.file("back.glb");
      std::filesystem::remove(back);
      must(tools::export_gltf(file.file, back, {}));
      const auto scene = must(import_gltf(back, {}));
      CHECK(scene.warnings.empty());
      REQUIRE(scene.primitives.size() == 4);
      CHECK(scene.primitives[0].second_uv() != nullptr);
      for (const size_t i : {1, 2, 3}) CHECK(scene.primitives[i].second_uv() == nullptr);
      const NamedMaterial& without = scene.materials[scene.primitives[3].material];
      CHECK(without.record.texture != format::kNone);
      CHECK(without.surface->textures[kOcclusion].texture == format::kNone);
      CHECK(scene.materials[scene.primitives[0].material].surface->second_uv == 1u << kOcclusion);
    }
  }
}

TEST_CASE("tangents are stored unless texture coordinates give the same ones", "[convert][surfaces]") {
  const TempFolder folder;
  struct Case {
    const char* name;
    Strip strip;
    bool is_mapped = true, expected = false;
  };
  std::vector<Case> cases{{"flat", strip(8, 0, 0, 1, 1)},
                          {"flat and mirrored", strip(8, 0, 0, -1, -1)},
                          {"nearly", strip(8, 0, 0.15, 1, 1)},
                          {"not quite", strip(8, 0, 0.25, 1, 1), true, true},
                          {"other hand", strip(8, 0, 0, 1, -1), true, true},
                          {"turned", strip(8, 0.2, 120, -1, 1), true, true},
                          {"turned without a normal map", strip(8, 0.2, 120, -1, 1), false}};
  tests::make_model(folder.file("in.glb"), [&](tests::ModelMaker& maker) {
    tools::GltfMaterial plain, mapped;
    plain.texture = white_texture(maker);
    plain.surface = plain_surface();
    mapped = plain;
    mapped.surface->textures[static_cast<size_t>(format::SurfaceUse::kNormalMap)].texture = plain.texture;
    const uint32_t materials[] = {maker.writer().add_material(plain), maker.writer().add_material(mapped)};
    for (const Case& c : cases) maker.draw(c.name, {primitive_of(maker, c.strip, materials[c.is_mapped], false, true)});
  });
  ConvertOptions options = auto_options(folder);
  must_convert(options);
  const tests::PackedFile file = must_open(options.output);
  CHECK(file.file.header().version_major == 2);
  REQUIRE(file.file.meshes().size() == cases.size());
  const double bound = std::exp2(3.0 - kTangentBits);
  for (size_t mesh = 0; mesh < cases.size(); ++mesh) {
    CAPTURE(cases[mesh].name);
    const uint32_t attributes = file.file.meshes()[mesh].attributes;
    CHECK(((attributes & format::kHasTangent) != 0) == cases[mesh].expected);
    if (!cases[mesh].expected) continue;
    CHECK((attributes & format::kHasNormal) != 0);  // even if they equal the faces'
    const Strip& made = cases[mesh].strip;
    for_each_vertex(file, mesh, made, [&](const tools::DecodedChunk& chunk, size_t v, size_t source) {
      REQUIRE(chunk.tangents[4 * v + 3] == made.tangents[4 * source + 3]);
      double product = 0;
      for (size_t c = 0; c < 3; ++c)
        product += double{chunk.tangents[4 * v + c]} * double{made.tangents[4 * source + c]};
      // The error of the normal adds up to 0.05 degrees to the tangent's own error.
      REQUIRE(std::acos(std::min(product, 1.0)) <= std::hypot(bound, 0.05 * kDegree) + 1e-4);
    });
  }
  std::map<std::string, uint64_t> out = left_out(file.file);
  CHECK(out["TANGENT (as texture coordinates give them)"] == 3);
  CHECK(out["TANGENT"] == 1);  // without a normal map

  // Export restores them: converted again, the codes are the same.
  const std::string back = folder.file("back.glb");
  must(tools::export_gltf(file.file, back, {}));
  ConvertOptions again = auto_options(folder);
  again.input = back;
  again.output = folder.file("again.scree");
  must_convert(again);
  const tests::PackedFile twice = must_open(again.output);
  REQUIRE(twice.file.meshes().size() == cases.size());
  for (size_t mesh = 0; mesh < cases.size(); ++mesh)
    CHECK(twice.file.meshes()[mesh].attributes == file.file.meshes()[mesh].attributes);
  for (size_t mesh = 3; mesh < 6; ++mesh)
    for_each_vertex(twice, mesh, cases[mesh].strip, [&](const tools::DecodedChunk& chunk, size_t v, size_t source) {
      REQUIRE(chunk.tangents[4 * v + 3] == cases[mesh].strip.tangents[4 * source + 3]);
    });

  // Without normals there are no tangents, and readers of version 1 can read the file.
  options.normals = Normals::kNever;
  std::filesystem::remove(options.output);
  must_convert(options);
  const tests::PackedFile plain = must_open(options.output);
  CHECK(plain.file.header().version_major == 1);
  for (uint64_t i = 0; i < plain.file.meshes().size(); ++i)
    CHECK((plain.file.meshes()[i].attributes & format::kHasTangent) == 0);
}
