// Reads materials beyond base colours, and KHR_lights_punctual, from a document into a file.
#include <filesystem>

#include "runtime/scene/scene.h"
#include "tests/models.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tools/gltf/source.h"

using namespace scree;
using namespace scree::convert;
using namespace scree::tests;

namespace {

/// A triangle for each material, a node for each light, and a texture of checker.png.
std::string document(const std::string& materials, const std::string& lights = "",
                     const std::string& light_nodes = "") {
  size_t count = 0;
  for (size_t at = materials.find("\"name\""); at != std::string::npos; at = materials.find("\"name\"", at + 1))
    ++count;
  std::string primitives, roots = "0";
  for (size_t i = 0; i < count; ++i)
    primitives += std::string(i == 0 ? "" : ",") +
                  R"({"attributes":{"POSITION":0,"TEXCOORD_0":1,"TEXCOORD_1":1},"material":)" + std::to_string(i) + "}";
  const size_t nodes = static_cast<size_t>(std::count(light_nodes.begin(), light_nodes.end(), '~'));
  for (size_t i = 0; i < nodes; ++i) roots += "," + std::to_string(i + 1);
  std::string placed = light_nodes;
  std::replace(placed.begin(), placed.end(), '~', ' ');
  return R"({"asset":{"version":"2.0"},"extensionsUsed":["KHR_lights_punctual","KHR_materials_specular"],)" +
         (lights.empty() ? "" : R"("extensions":{"KHR_lights_punctual":{"lights":[)" + lights + "]}},") +
         R"("buffers":[{"uri":"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA","byteLength":36}],)"
         R"("bufferViews":[{"buffer":0,"byteLength":36}],"images":[{"uri":"checker.png"}],"textures":[{"source":0},)"
         R"({"source":0,"name":"other"}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3",)"
         R"("min":[0,0,0],"max":[1,1,0]},{"bufferView":0,"componentType":5126,"count":3,"type":"VEC2"}],)"
         R"("materials":[)" +
         materials + R"(],"meshes":[{"primitives":[)" + primitives + R"(]}],"nodes":[{"mesh":0})" + placed +
         R"(],"scenes":[{"nodes":[)" + roots + R"(]}],"scene":0})";
}

std::string write(const TempFolder& folder, const std::string& text) {
  std::filesystem::copy_file(tests::data_path("checker.png"), folder.file("checker.png"),
                             std::filesystem::copy_options::overwrite_existing);
  return folder.write("in.gltf", text);
}

}  // namespace

TEST_CASE("surfaces: specular and glossiness are read, also where the document requires them", "[gltf][surfaces]") {
  const TempFolder folder;
  std::string text =
      document(R"({"name":"glossy","pbrMetallicRoughness":{"metallicRoughnessTexture":{"index":1}},"extensions":{)"
               R"("KHR_materials_pbrSpecularGlossiness":{"diffuseFactor":[1,0.5,0,1],"diffuseTexture":{"index":0},)"
               R"("specularFactor":[0.08,0.04,0.02],"glossinessFactor":0.75}}})");
  text.insert(1, R"("extensionsRequired":["KHR_materials_pbrSpecularGlossiness"],)");
  const auto scene = must(import_gltf(write(folder, text), {}));
  CHECK(scene.warnings.empty());
  REQUIRE(scene.materials.size() == 1);
  CHECK(scene.materials[0].record.base_color[1] == 0.5f);
  CHECK(scene.materials[0].record.texture == 0);
  REQUIRE(scene.materials[0].surface);
  CHECK(scene.materials[0].surface->metallic == 0);
  CHECK(scene.materials[0].surface->roughness == 0.25f);
  CHECK(scene.materials[0].surface->specular_color[0] == 2);
  // The fallback's texture would change this roughness.
  CHECK(scene.materials[0].surface->textures[static_cast<size_t>(format::SurfaceUse::kMetallicRoughness)].texture ==
        format::kNone);
}

TEST_CASE("surfaces: a material with more than a base colour has a surface", "[gltf][surfaces]") {
  const TempFolder folder;
  const std::string path = write(
      folder,
      document(
          R"({"name":"plain","pbrMetallicRoughness":{"baseColorFactor":[1,0.5,0,1],"baseColorTexture":{"index":0}}},)"
          R"({"name":"matt","pbrMetallicRoughness":{"metallicFactor":0,"roughnessFactor":0.5}},)"
          R"({"name":"unlit","pbrMetallicRoughness":{"metallicFactor":0},"extensions":{"KHR_materials_unlit":{}}},)"
          R"({"name":"all","pbrMetallicRoughness":{"metallicFactor":2,"metallicRoughnessTexture":{"index":1,"texCoord":1,)"
          R"("extensions":{"KHR_texture_transform":{"offset":[1,2],"scale":[3,4],"rotation":5}}}},)"
          R"("normalTexture":{"index":0,"texCoord":1,"scale":0.25},"occlusionTexture":{"index":0,"strength":0.75},)"
          R"("emissiveFactor":[0.5,1,0],"extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":4},)"
          R"("KHR_materials_ior":{"ior":1.25},"KHR_materials_specular":{"specularFactor":0.5,)"
          R"("specularColorFactor":[1,2,3],"specularColorTexture":{"index":1,"texCoord":1}}}})"));
  const auto scene = must(import_gltf(path, {}));
  REQUIRE(scene.materials.size() == 4);
  REQUIRE(scene.materials[0].surface);  // glTF's defaults, because another material has a surface
  CHECK(scene.materials[0].surface->metallic == 1);
  CHECK(scene.materials[0].surface->roughness == 1);
  CHECK(!scene.materials[2].surface);
  REQUIRE(scene.materials[1].surface);
  CHECK(scene.materials[1].surface->metallic == 0);
  CHECK(scene.materials[1].surface->roughness == 0.5f);
  CHECK(scene.materials[1].surface->ior == 1.5f);
  REQUIRE(scene.materials[3].surface);
  const format::SurfaceRecord& all = *scene.materials[3].surface;
  CHECK(all.metallic == 1);
  CHECK(all.normal_scale == 0.25f);
  CHECK(all.occlusion_strength == 0.75f);
  CHECK(all.emission[0] == 2);
  CHECK(all.emission[1] == 4);
  CHECK(all.ior == 1.25f);
  CHECK(all.specular == 0.5f);
  CHECK(all.specular_color[2] == 3);
  CHECK(all.textures[0].texture != format::kNone);
  CHECK(all.textures[0].uv_offset[1] == 2);
  CHECK(all.textures[0].uv_scale[0] == 3);
  CHECK(all.textures[0].uv_rotation == 5);
  CHECK(all.textures[1].texture != format::kNone);
  CHECK(all.textures[2].texture != format::kNone);
  CHECK(all.second_uv == 1u << 2);  // occlusion alone uses the second coordinates
  CHECK(all.textures[3].texture == format::kNone);
  CHECK(all.textures[5].texture == all.textures[0].texture);
  CHECK(scene.warnings.empty());

  ConvertOptions options;
  options.input = path;
  options.output = folder.file("out.scree");
  must_convert(options);
  const tests::PackedFile packed = must_open(options.output);
  REQUIRE(packed.file.surfaces().size() == 3);
  CHECK(packed.file.surfaces()[1].material == 1);
  CHECK(packed.file.surfaces()[2].material == 3);
  CHECK(tests::read_whole(options.output)[8] == 2);  // the major version, for the second coordinates
  const auto loaded = must(runtime::Scene::open(options.output, {}));
  CHECK(loaded.view().surface_count == 3);
  CHECK(loaded.view().material_views[3].surface == 2);
  CHECK(loaded.view().material_views[2].surface == format::kNone);
  CHECK(loaded.view().environment != nullptr);

  // A file with base colours alone has version 1.0, and loading it makes no environment.
  options.input = write(folder, document(R"({"name":"plain","pbrMetallicRoughness":{"baseColorTexture":{"index":0}}},)"
                                         R"({"name":"matt","pbrMetallicRoughness":{"metallicFactor":0}})"));
  must_convert(options);
  CHECK(tests::read_whole(options.output)[8] == 1);
  CHECK(tests::read_whole(options.output)[10] == 0);
  const auto plain = must(runtime::Scene::open(options.output, {}));
  CHECK(plain.view().surface_count == 0);
  CHECK(plain.view().environment == nullptr);
}

TEST_CASE("surfaces: lights lie at their nodes", "[gltf][surfaces]") {
  const TempFolder folder;
  ConvertOptions options;
  options.output = folder.file("out.scree");
  options.input = write(
      folder,
      document(
          R"({"name":"plain"})",
          R"({"type":"directional","color":[1,0.5,0],"intensity":3},{"type":"spot","range":7,"spot":{"outerConeAngle":0.5}})",
          R"(,{~"translation":[1,2,3],"scale":[2,2,2],"extensions":{"KHR_lights_punctual":{"light":1}}})"
          R"(,{~"rotation":[0.70710678,0,0,0.70710678],"extensions":{"KHR_lights_punctual":{"light":0}}})"));
  must_convert(options);
  const tests::PackedFile packed = must_open(options.output);
  REQUIRE(packed.file.lights().size() == 2);
  CHECK(packed.file.lights()[0].kind == format::LightKind::kSpot);
  CHECK(packed.file.lights()[0].node == 1);
  CHECK(packed.file.lights()[0].outer_cone == 0.5f);
  const auto scene = must(runtime::Scene::open(options.output, {}));
  REQUIRE(scene.view().light_count == 2);
  const kernels::PlacedLight* const lights = scene.view().lights;
  CHECK(lights[0].position[1] == 2);
  CHECK(lights[0].direction[2] == -1);
  CHECK(lights[0].range == 7);
  CHECK(lights[0].cone_scale * std::cos(0.5f) + lights[0].cone_offset == Approx(0).margin(1e-5));
  CHECK(lights[0].cone_scale + lights[0].cone_offset == Approx(1));
  // A quarter turn about x: -z becomes y.
  CHECK(lights[1].direction[1] == Approx(1));
  CHECK(lights[1].color[1] == 1.5f);
}

TEST_CASE("surfaces: values that glTF forbids are refused with their place", "[gltf][surfaces]") {
  const TempFolder folder;
  const auto refused = [&](const std::string& text, const std::string& message) {
    CHECK(refusal(import_gltf(write(folder, text), {})).message == folder.file("in.gltf") + ": " + message);
  };
  const std::string node = R"(,{~"extensions":{"KHR_lights_punctual":{"light":0}}})", plain = R"({"name":"a"})";
  refused(document(plain, R"({"type":"sun"})", node), "light 0: type is \"sun\", expected directional, point or spot");
  refused(document(plain, R"({"type":"point","intensity":-1})", node),
          "light 0: a colour, intensity or range that is not 0 or more");
  refused(document(plain, R"({"type":"spot","spot":{"innerConeAngle":-1}})", node),
          "light 0: innerConeAngle is not between 0 and outerConeAngle");
  refused(document(plain, "", node), "node 1: light 0 does not exist, the document has 0");
  refused(document(R"({"name":"a","normalTexture":{"index":9}})"),
          "material 0: texture 9 does not exist, the document has 2");
  refused(document(R"({"name":"a","emissiveFactor":[1e30,0,0],"extensions":)"
                   R"({"KHR_materials_emissive_strength":{"emissiveStrength":1e30}}})"),
          "material 0: a factor outside the range of floats");
}
