// Hostile and broken documents. Each gives a clear error or a clean import, and never crashes under ASan and UBSan.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "tests/models.h"
#include "tests/results.h"
#include "tests/tools/gltf/read_all.h"
#include "tests/tools/temp_folder.h"
#include "tools/gltf/buffers.h"
#include "tools/gltf/document/document.h"
#include "tools/gltf/draco/source.h"
#include "tools/gltf/nodes.h"
#include "tools/gltf/source.h"

namespace scree::convert {
namespace {

namespace fs = std::filesystem;

// Reads every triangle and every attribute of an import.
Result<void> read_everything(const SourceScene& scene) {
  constexpr uint64_t kBlock = 20000;
  for (const Primitive& primitive : scene.primitives) {
    std::vector<uint32_t> triangles;
    for (uint64_t at = 0; at < primitive.triangle_count(); at += kBlock) {
      const uint64_t n = std::min(kBlock, primitive.triangle_count() - at);
      triangles.resize(n * 3);
      if (auto read = read_triangles(primitive, at, n, triangles); !read) return read;
    }
    std::vector<float> values;
    for (const Accessor* const accessor : tests::accessors_of(primitive)) {
      for (uint64_t at = 0; at < accessor->count; at += kBlock) {
        const uint64_t n = std::min(kBlock, accessor->count - at);
        values.resize(n * accessor->components);
        if (auto read = read_floats(*accessor, at, n, values); !read) return read;
      }
    }
  }
  return {};
}

// Checks the properties of every import: indices are in range, and errors have one line that begins with the file's
// name.
void check_outcome(const std::string& path, const Result<SourceScene>& scene) {
  INFO(path);
  if (!scene) {
    const std::string& message = scene.error().message;
    INFO(message);
    CHECK(message.compare(0, path.size() + 2, path + ": ") == 0);
    CHECK(message.size() > path.size() + 8);
    CHECK(message.find('\n') == std::string::npos);
    CHECK(message.back() != '.');
    return;
  }
  const auto in = [](uint32_t index, size_t count) { return index == format::kNone || index < count; };
  bool right = true;
  for (const Primitive& primitive : scene->primitives) {
    right = right && primitive.group < scene->groups.size() && in(primitive.material, scene->materials.size()) &&
            primitive.triangle_count() > 0;
  }
  for (size_t i = 0; i < scene->nodes.size(); ++i) {
    const SourceNode& node = scene->nodes[i];
    right =
        right && in(node.parent, i) && in(node.group, scene->groups.size()) && in(node.camera, scene->cameras.size());
  }
  for (const NamedMaterial& material : scene->materials)
    right = right && in(material.record.texture, scene->textures.size());
  for (const NamedTexture& texture : scene->textures) right = right && texture.record.image < scene->images.size();
  for (const SourceSceneRoots& roots : scene->scenes)
    for (const uint32_t root : roots.roots) right = right && root < scene->nodes.size();
  CHECK(right);
}

const std::string& base_document() {
  static const std::string text = tests::read_whole(tests::data_path("data_uri.gltf").string());
  return text;
}

Error import_error(const std::string& path) {
  const auto scene = import_gltf(path, {});
  check_outcome(path, scene);
  if (!scene) return scene.error();
  if (auto read = read_everything(*scene); !read) return read.error();
  FAIL("no error");
  return {ErrorCode::kFormat, {}};
}

std::string quoted(std::string text) {
  std::replace(text.begin(), text.end(), '\'', '"');
  return text;
}

struct Change {
  const char* from;
  const char* to;
  ErrorCode code;
  const char* message;
};

TEST_CASE("a document with one error is refused with the place of the error", "[import][bad]") {
  using enum ErrorCode;
  // The document of tests/data/data_uri.gltf with one error. Here ' stands for ".
  const Change changes[] = {
      {"'mesh':0}", "'mesh':4294967296}", kRange, "node 0: mesh is 4294967296, expected an index"},
      {"'mesh':0}", "'mesh':2147483648}", kRange, "node 0: mesh is 2147483648, expected an index"},
      {"'mesh':0}", "'mesh':1}", kRange, "node 0: mesh 1 does not exist, the document has 1"},
      {"'mesh':0}", "'mesh':-1}", kRange, "node 0: mesh is -1, expected an index"},
      {"'mesh':0}", "'mesh':0.0}", kRange, "node 0: mesh is 0.0, expected an index"},
      {"'mesh':0}", "'mesh':'0'}", kFormat, "node 0: mesh is a string, expected an index"},
      {"'mesh':0}", "'mesh':0,'mesh':0}", kFormat, "node 0: mesh appears twice"},
      {"'mesh':0}", "'mesh':0,'children':[0]}", kRange, "node 0: is its own ancestor"},
      {"'mesh':0}", "'mesh':0,'children':[1]}", kRange, "node 0: child 1 does not exist"},
      {"'mesh':0}", "'mesh':0,'children':[1]},{'children':[2]},{'children':[1]}", kRange, "two parents"},
      {"'mesh':0}", "'mesh':0},{'children':[2]},{'children':[1]}", kRange, "is its own ancestor"},
      {"'mesh':0}", "'mesh':0,'matrix':[1,2,3]}", kRange, "node 0: matrix has 3 numbers, expected 16"},
      {"'mesh':0}", "'mesh':0,'scale':[1,null,3]}", kFormat, "node 0: scale[1] is null"},
      {"'mesh':0}", "'mesh':0,'scale':[1,1e999,3]}", kFormat, "number overflow"},
      {"'mesh':0}", "'mesh':0,'rotation':[0,0,0,0]}", kRange, "node 0: rotation has no length"},
      {"'mesh':0}", "'mesh':0,'camera':0}", kRange, "node 0: camera 0 does not exist"},
      {"'mesh':0}", "'mesh':0,'skin':7}", kRange, "node 0: skin 7 does not exist"},
      {"'mesh':0}", "'mesh':0,'extensions':{'EXT_mesh_gpu_instancing':{'attributes':{'TRANSLATION':9}}}}", kRange,
       "node 0: EXT_mesh_gpu_instancing: TRANSLATION: accessor 9 does not exist"},
      {"'mesh':0}", "'mesh':0,'extensions':{'EXT_mesh_gpu_instancing':{'attributes':{'TRANSLATION':4294967296}}}}",
       kRange, "TRANSLATION is 4294967296, expected an index"},
      {"'mesh':0}", "'mesh':0,'extensions':{'EXT_mesh_gpu_instancing':{'attributes':{'TRANSLATION':1}}}}", kFormat,
       "TRANSLATION: accessor 1 is no VEC3 of float"},
      {"'mesh':0}", "'mesh':0,'extensions':{'EXT_mesh_gpu_instancing':{'attributes':{}}}}", kFormat,
       "EXT_mesh_gpu_instancing: no instances"},
      {"[{'nodes':[0]}]", "[{'nodes':[1]}]", kRange, "scene 0: node 1 does not exist"},
      {"[{'nodes':[0]}]", "[{'nodes':[0,0]}]", kRange, "scene 0: node 0 appears twice"},
      {"'scene':0", "'scene':1", kRange, "scene 1 does not exist"},
      {"'scene':0", "'scene':4294967296", kRange, "scene is 4294967296"},
      {"'scene':0", "'scene':0,'scene':0", kFormat, "member \"scene\" appears twice"},
      {"'POSITION':0", "'POSITION':2", kRange, "mesh 0 primitive 0: POSITION: accessor 2 does not exist"},
      {"'POSITION':0", "'POSITION':-1", kRange, "mesh 0: primitives[0].attributes.POSITION is -1, expected an index"},
      {"'POSITION':0", "'POSITION':4294967296", kRange, "POSITION is 4294967296, expected an index"},
      {"'POSITION':0", "'POSITION':1", kFormat, "POSITION: accessor 1 has componentType 5121"},
      {"'POSITION':0", "'POSITION':0,'NORMAL':1", kFormat, "NORMAL: accessor 1"},
      {"'POSITION':0", "'POSITION':0,'POSITION':0", kFormat, "mesh 0: primitives[0].attributes.POSITION appears twice"},
      {"'POSITION':0", "'POSITION':0,'_A\\nB\\u001b[31m':9", kRange, "_A?B?[31m: accessor 9 does not exist"},
      {"'mesh':0}", "'mesh':0,'extras':{'a':[1,2}}", kFormat, "JSON byte"},
      {"'mesh':0}", "'mesh':0,'extras':{'a':[1,b]}}", kFormat, "extras are malformed"},
      {"'indices':1", "'indices':7", kRange, "mesh 0 primitive 0: indices: accessor 7 does not exist"},
      {"'indices':1", "'indices':4294967297", kRange, "indices is 4294967297, expected an index"},
      {"'indices':1", "'indices':0", kFormat, "indices: accessor 0 has componentType 5126"},
      {"'indices':1", "'indices':1,'mode':7", kRange, "mode is 7, expected 0 to 6"},
      {"'indices':1", "'indices':1,'material':0", kRange, "material 0 does not exist"},
      {"'primitives':", "'things':", kFormat, "mesh 0: primitives is missing"},
      {"{'attributes':{'POSITION':0},'indices':1}", "{'indices':1}", kFormat,
       "mesh 0: primitives[0].attributes is missing"},
      {"{'attributes':{'POSITION':0},'indices':1}", "5", kRange, "mesh 0: primitives[0] is 5"},
      {"'count':4,", "'count':5,", kRange,
       "accessor 0: 5 elements of 12 bytes at 0, stride 12, pass the end of buffer view 0 (48 bytes)"},
      {"'count':4,", "'count':9007199254740992,", kRange, "accessor 0: 9007199254740992 elements"},
      {"'count':4,", "'count':18446744073709551615,", kRange, "count is 18446744073709551615"},
      {"'count':4,", "'count':4.5,", kRange, "accessor 0: count is 4.5, expected a size"},
      {"'count':4,", "'count':-4,", kRange, "accessor 0: count is -4, expected a size"},
      {"'count':4,", "'count':3,", kRange, "mesh 0 primitive 0: index 3 at element 5, but the mesh has 3 vertices"},
      {"'count':4,", "'byteOffset':1,'count':4,", kRange, "accessor 0: 4 elements of 12 bytes at 1"},
      {"'count':4,", "'byteOffset':9007199254740992,'count':4,", kRange, "at 9007199254740992"},
      {"{'bufferView':0,'componentType':5126", "{'bufferView':2,'componentType':5126", kRange,
       "accessor 0: buffer view 2 does not exist"},
      {"{'bufferView':0,'componentType':5126,'count':4", "{'componentType':5126,'count':99999999", kRange,
       "accessor 0: 99999999 elements without a buffer view"},
      {"'componentType':5126", "'componentType':5124", kFormat, "accessor 0: componentType is 5124"},
      {"'componentType':5126", "'componentType':5130", kFormat, "accessor 0: componentType is 5130"},
      {"'componentType':5126", "'componentType':1", kFormat, "accessor 0"},
      {"'type':'VEC3'", "'type':'VEC2'", kFormat, "POSITION: accessor 0 has componentType 5126 and 2"},
      {"'type':'VEC3'", "'type':'MAT2'", kFormat, "accessor 0: a matrix"},
      {"'type':'VEC3'", "'type':'VEC5'", kFormat, "accessor 0"},
      {"'type':'VEC3'",
       "'sparse':{'count':5,'indices':{'bufferView':1,'componentType':5121},'values':{'bufferView':0}},'type':'VEC3'",
       kRange, "accessor 0: sparse: 5 values, but the accessor has 4 elements"},
      {"'type':'VEC3'",
       "'sparse':{'count':2,'indices':{'bufferView':1,'componentType':5121},'values':{'bufferView':1}},'type':'VEC3'",
       kRange, "accessor 0: sparse: 2 values pass the end of buffer view 1"},
      {"'type':'VEC3'",
       "'sparse':{'count':3,'indices':{'bufferView':1,'componentType':5121},'values':{'bufferView':0}},'type':'VEC3'",
       kRange, "accessor 0 sparse: index 1 at element 2, expected ascending indices"},
      {"'type':'VEC3'",
       "'sparse':{'count':1,'indices':{'bufferView':1,'componentType':5121,'byteOffset':12},'values':{'bufferView':0}},"
       "'type':'VEC3'",
       kRange, "1 indices pass the end"},
      {"'type':'VEC3'",
       "'sparse':{'count':1,'indices':{'bufferView':1,'componentType':5126},'values':{'bufferView':0}},'type':'VEC3'",
       kFormat, "sparse: indices componentType is 5126"},
      {"'type':'VEC3'", "'sparse':{'count':1},'type':'VEC3'", kFormat, "sparse.indices is missing"},
      {"{'buffer':0,'byteOffset':0,'byteLength':48}", "{'buffer':1,'byteOffset':0,'byteLength':48}", kRange,
       "buffer view 0: buffer 1 does not exist"},
      {"{'buffer':0,'byteOffset':0,'byteLength':48}", "{'buffer':0,'byteOffset':13,'byteLength':48}", kRange,
       "buffer view 0: 48 bytes at 13, but buffer 0 has 60"},
      {"{'buffer':0,'byteOffset':0,'byteLength':48}", "{'buffer':0,'byteOffset':9007199254740992,'byteLength':48}",
       kRange, "buffer view 0: 48 bytes at 9007199254740992"},
      {"{'buffer':0,'byteOffset':0,'byteLength':48}", "{'buffer':0,'byteOffset':0,'byteLength':48,'byteStride':8}",
       kRange, "accessor 0: elements of 12 bytes overlap, byteStride is 8"},
      {"{'buffer':0,'byteOffset':0,'byteLength':48}", "{'buffer':0,'byteOffset':0,'byteLength':48,'byteStride':253}",
       kFormat, "buffer view 0"},
      {"'byteLength':60", "'byteLength':61", kTruncated, "buffer 0: byteLength is 61, but there are 60"},
      {"'byteLength':60", "'byteLength':59", kRange, "buffer view 1: 12 bytes at 48, but buffer 0 has 59"},
      {"'byteLength':60", "'byteLength':'60'", kFormat, "buffer 0: byteLength is a string"},
      {"'byteLength':60,", "", kFormat, "buffer 0: byteLength is missing"},
      {";base64,AAAA", ";base64,A*AA", kFormat, "buffer 0: data: URI: not a base64 digit at character 1"},
      {";base64,AAAA", ";base64,AAA", kTruncated, "buffer 0: byteLength is 60, but there are 59 bytes"},
      {";base64,AAAA", ";base64,AA", kTruncated, "buffer 0"},
      {";base64,AAAA", ";base64,A", kFormat, "buffer 0: data: URI: base64 of 77 digits"},
      {";base64,AAAA", ",%zz", kFormat, "buffer 0"},
      {";base64,AAAA", ";base64", kFormat, "buffer 0: data: URI without a comma"},
      {"{'asset':{'version':'2.0',", "{'asset':{'version':'1.0',", kVersion, "asset: version is \"1.0\""},
      {"{'asset':{'version':'2.0',", "{'asset':{'version':'3.0',", kVersion, "asset: version is \"3.0\""},
      {"{'asset':{'version':'2.0',", "{'asset':{'version':2,", kRange, "asset: version is 2"},
      {"{'asset':{'version':'2.0',", "{'asset':{'minVersion':'2.1','version':'2.1',", kVersion,
       "asset: minVersion is \"2.1\""},
      {"{'asset':", "{'aset':", kFormat, "asset is missing"},
      {"{'asset':", "{'extensionsRequired':['VENDOR_all_new'],'asset':", kUnsupported,
       "required extension VENDOR_all_new is not read"},
      {"{'asset':", "{'extensionsRequired':[5],'asset':", kRange, "extensionsRequired 0 is 5"},
      {"{'asset':", "{'extensionsRequired':'X','asset':", kFormat, "extensionsRequired is not an array"},
      {"'nodes':[{", "'nodes':{'a':{", kFormat, "JSON byte"},
      {"'nodes':[{", "'nodes':[,{", kFormat, "JSON byte"},
      {"'nodes':[{", "'nodes':[{}{", kFormat, "JSON byte"},
      {"'nodes':[{", "'nodes':[{},,{", kFormat, "JSON byte"},
      {"'name':'tetrahedron'", "'name':'tetra\\qhedron'", kFormat, "JSON byte"},
      {"'name':'tetrahedron'", "'name':'tetra\xff\xfehedron'", kFormat, "JSON byte"},
      {"'name':'tetrahedron'", "'name':'tetra\nhedron'", kFormat, "JSON byte"},
      {"'name':'tetrahedron'", "'name':tetrahedron", kFormat, "JSON byte"},
      {"'name':'tetrahedron'", "'name':NaN", kFormat, "JSON byte"},
      {"'name':'tetrahedron'", "'name':7", kRange, "node 0: name is 7, expected a string"},
      {",'scene':0", ",'scene':0,", kFormat, "JSON byte"},
      {",'scene':0", ",'scene':0,'animations':[{bad}]", kFormat, "JSON byte"},
      {",'scene':0", ",'scene':0,'unknown':{bad}", kFormat, "JSON byte"},
      {",'scene':0", ",'scene':0,'cameras':[{'type':'fisheye'}]", kFormat, "camera 0"},
      {",'scene':0", ",'scene':0,'cameras':[{'type':'perspective','perspective':{'yfov':0,'znear':1}}]", kRange,
       "camera 0: yfov is not between 0 and pi"},
      {",'scene':0",
       ",'scene':0,'cameras':[{'type':'orthographic','orthographic':{'xmag':1,'ymag':1,'znear':2,'zfar':1}}]", kRange,
       "camera 0: zfar is not past znear"},
      {",'scene':0", ",'scene':0,'cameras':[{'type':'perspective','perspective':{'yfov':1,'znear':0}}]", kRange,
       "camera 0: znear is not positive"},
      {",'scene':0", ",'scene':0,'textures':[{'source':3}]", kRange, "texture 0: image 3 does not exist"},
      {",'scene':0", ",'scene':0,'textures':[{'sampler':3}]", kRange, "texture 0: sampler 3 does not exist"},
      {",'scene':0", ",'scene':0,'images':[{'bufferView':8}]", kRange, "image 0: buffer view 8"},
      {",'scene':0", ",'scene':0,'materials':[{'pbrMetallicRoughness':{'baseColorTexture':{'index':0}}}]", kRange,
       "material 0: texture 0 does not exist"},
      {",'scene':0", ",'scene':0,'materials':[{'pbrMetallicRoughness':{'baseColorFactor':[1,1,1]}}]", kRange,
       "material 0: pbrMetallicRoughness.baseColorFactor has 3 numbers, expected 4"},
      {",'scene':0", ",'scene':0,'materials':[{'emissiveFactor':[1,1,1,1]}]", kRange,
       "material 0: emissiveFactor has 4 numbers, expected 3"},
  };
  const tests::TempFolder folder;
  for (const Change& change : changes) {
    INFO(change.from << " -> " << change.to);
    const std::string text = tests::replaced(base_document(), quoted(change.from), quoted(change.to));
    check_error(import_error(folder.write("changed.gltf", text)), change.code, change.message);
  }
}

TEST_CASE("textures with broken images are refused or left out", "[import][bad]") {
  const tests::TempFolder folder;
  const auto with_image = [&](const std::string& image, const std::string& texture) {
    std::string text = tests::replaced(base_document(), R"("indices":1)", R"("indices":1,"material":0)");
    text = tests::replaced(text, R"(,"scene":0)",
                           R"(,"scene":0,"materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],
                           "textures":[{)" +
                               texture + R"(}],"images":[)" + image + "]");
    return folder.write("image.gltf", text);
  };
  const std::string source = R"("source":0)";
  const auto expect = [&](const char* image, ErrorCode code, const char* message) {
    check_error(import_error(with_image(image, source)), code, message);
  };
  expect(R"({"uri":"data:image/png;base64,AAAA"})", ErrorCode::kFormat, "image 0: is no image file of a known kind");
  expect(R"({"uri":"data:image/png;base64,"})", ErrorCode::kFormat, "image 0: is empty");
  expect(R"({"uri":"missing.png"})", ErrorCode::kFile, "missing.png");
  expect(R"({"uri":"https://example.org/a.png"})", ErrorCode::kUnsupported, "scheme \"https:\"");
  expect(R"({})", ErrorCode::kFormat, "image 0: has neither uri nor bufferView");
  expect(R"({"uri":"a.png","bufferView":0})", ErrorCode::kFormat, "image 0: has both");
  expect("", ErrorCode::kRange, "texture 0: image 0 does not exist");

  // Known formats that are not supported lose the texture, not the scene.
  folder.write("a.webp", std::string("RIFF\0\0\0\0WEBPVP8 ", 16));
  folder.write("a.ktx", "\xabKTX 11\xbb\r\n\x1a\n");
  folder.write("b.png", tests::read_whole(tests::data_path("checker.png").string()));
  const SourceScene dropped = must(import_gltf(with_image(R"({"uri":"a.ktx"})", source), {}));
  CHECK(dropped.textures.empty());
  CHECK(dropped.images.empty());
  CHECK(dropped.materials.at(0).record.texture == format::kNone);
  CHECK(dropped.warnings.size() == 1);
  // A readable fallback is drawn instead of an unreadable image.
  const std::string both = R"({"uri":"a.webp"},{"uri":"b.png","mimeType":"image/jpeg"})";
  const SourceScene fallback =
      must(import_gltf(with_image(both, R"("source":1,"extensions":{"EXT_texture_webp":{"source":0}})"), {}));
  REQUIRE(fallback.images.size() == 1);
  CHECK(fallback.images[0].codec == format::ImageCodec::kPng);
  for (const std::string& line : fallback.warnings) CHECK(line.find("WebP") == std::string::npos);
  const SourceScene alone =
      must(import_gltf(with_image(both, R"("extensions":{"EXT_texture_webp":{"source":0}})"), {}));
  CHECK(alone.images.at(0).is_webp);  // convert reports the image's defect
}

TEST_CASE("Draco geometry with a plain copy is read, and refused without", "[import][bad]") {
  const tests::TempFolder folder;
  const auto with_draco = [&](const std::string& text) {
    return folder.write("draco.gltf",
                        tests::replaced(text, R"("indices":1)",
                                        R"("indices":1,"extensions":{"KHR_draco_mesh_compression":{"bufferView":0}})"));
  };
  CHECK(import_gltf(with_draco(base_document()), {}));
  const Error error = import_error(with_draco(tests::replaced(base_document(), R"({"bufferView":0,)", "{")));
  if (draco_version().empty()) {
    CHECK(error.code == ErrorCode::kUnsupported);
    CHECK(
        error.message.ends_with("has only Draco-compressed data, and this scree is built without libdraco: decode it "
                                "first, for example with gltf-transform"));
  } else {
    CHECK(error.message.ends_with("KHR_draco_mesh_compression: expected a primitive of indexed triangles"));
  }
}

TEST_CASE("deep nesting is refused before it is parsed", "[import][bad]") {
  const tests::TempFolder folder;
  for (const auto& [open, close] : {std::pair{"[", "]"}, std::pair{"{\"a\":", "}"}}) {
    std::string deep;
    for (int i = 0; i < 200000; ++i) deep += open;
    const std::string start = R"({"asset":{"version":"2.0"},"extras":)";
    CHECK(import_error(folder.write("deep.gltf", start + deep)).message.find("nested deeper than 128") !=
          std::string::npos);
    std::string closed = deep + "1";
    for (int i = 0; i < 200000; ++i) closed += close;
    CHECK(import_error(folder.write("deep.gltf", start + closed + "}")).code == ErrorCode::kFormat);
    CHECK(import_error(folder.write("deep.gltf", deep)).code == ErrorCode::kFormat);
  }
  // 120 levels of nesting are allowed. If they are not read, they cost nothing.
  std::string nested = "1";
  for (int i = 0; i < 120; ++i) nested = "[" + nested + "]";
  CHECK(import_gltf(folder.write("nested.gltf", R"({"asset":{"version":"2.0","extras":)" + nested + "}}"), {}));
}

TEST_CASE("long documents keep their indices over batches", "[import]") {
  // Batches are cut at 256 KiB: about 20,000 nodes and meshes fill a dozen.
  constexpr uint32_t kCount = 20000;
  std::string meshes, nodes;
  std::string roots;
  for (uint32_t i = 0; i < kCount; ++i) {
    const std::string comma = i == 0 ? "" : ",";
    // Every third mesh has no indices, so that a lost one would shift all later ones.
    meshes += comma + R"({"name":"m)" + std::to_string(i) + R"(","primitives":[{"attributes":{"POSITION":0})" +
              (i % 3 == 0 ? "" : R"(,"indices":1)") + R"(,"extras":{"indices":[1,2,{"indices":"x"}]}}]})";
    nodes += comma + R"({"mesh":)" + std::to_string(i) + R"(,"name":"indices"})";
    roots += comma + std::to_string(i);
  }
  std::string text = tests::replaced(base_document(), R"([{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}])",
                                     "[" + meshes + "]");
  text = tests::replaced(text, R"([{"name":"tetrahedron","mesh":0}])", "[" + nodes + "]");
  text = tests::replaced(text, R"({"nodes":[0]})", R"({"nodes":[)" + roots + "]}");
  const tests::TempFolder folder;
  const std::string path = folder.write("long.gltf", text);
  const auto with_threads = [](uint32_t threads) {
    ImportOptions options{.threads = threads};
    return options;
  };
  for (const uint32_t threads : {1u, 3u, 8u}) {
    const auto scene = must(import_gltf(path, with_threads(threads)));
    REQUIRE(scene.primitives.size() == kCount);
    REQUIRE(scene.nodes.size() == kCount);
    bool right = true;
    for (uint32_t i = 0; i < kCount; ++i) {
      const Primitive& primitive = scene.primitives[i];
      right = right && primitive.indices.has_value() == (i % 3 != 0) && primitive.mesh == i &&
              scene.groups[i].name == "m" + std::to_string(i) && scene.nodes[i].group == i &&
              scene.nodes[i].name == "indices";
    }
    CHECK(right);
  }

  // The first error of the document is reported, whichever thread finds an error first.
  const std::string last = std::to_string(kCount - 1), middle = std::to_string(kCount / 2);
  const auto broken = [&](const std::string& before, const std::string& node, const char* member) {
    return tests::replaced(before, R"({"mesh":)" + node + ",", R"({"mesh":)" + node + member);
  };
  const std::string late = broken(text, last, R"(,"skin":-2,)");
  const auto message = [&](const std::string& changed, uint32_t threads) {
    const auto scene = import_gltf(folder.write("long.gltf", changed), with_threads(threads));
    return scene ? std::string() : scene.error().message;
  };
  CHECK(message(late, 8).find("node " + last + ": skin is -2") != std::string::npos);
  for (const char* member : {R"(,"skin":-3,)", ",,"}) {
    const std::string both = broken(late, middle, member);
    CHECK(message(both, 1).find("node " + last) == std::string::npos);
    CHECK(message(both, 8) == message(both, 1));
  }
}

TEST_CASE("the flag to stop ends each step of an import", "[import]") {
  const std::atomic<bool> stop{true};
  ImportOptions stopped;
  stopped.stop = &stop;
  const auto read = [](const std::string& members, const ImportOptions& options) {
    const std::string text = R"({"asset":{"version":"2.0"},)" + members + "}";
    return read_document({text.begin(), text.end()}, options);
  };
  for (const char* const members : {R"("buffers":[{"byteLength":1}])", R"("images":[{}])", R"("nodes":[{}])",
                                    R"("extensions":{"KHR_lights_punctual":{"lights":[{"type":"point"}]}})"}) {
    INFO(members);
    CHECK(read(members, {}));
    check_refusal(read(members, stopped), ErrorCode::kFile, "interrupted");
  }
  const GltfDocument document =
      must(read(R"("nodes":[{}],"accessors":[{"componentType":5126,"count":1,"type":"VEC3"}],"images":[{}])", {}));
  check_refusal(plan_nodes(document, stopped), ErrorCode::kFile, "interrupted");
  GltfBuffers buffers(document, ".", {}, stopped);
  check_refusal(buffers.accessor(0), ErrorCode::kFile, "interrupted");
  check_refusal(buffers.image(document.images[0]), ErrorCode::kFile, "interrupted");
  check_refusal(make_nodes(document, must(plan_nodes(document, {})), {}, buffers), ErrorCode::kFile, "interrupted");
  const std::string path = tests::data_path("data_uri.gltf").string();
  CHECK(refusal(import_gltf(path, stopped)).message == path + ": interrupted");
}

TEST_CASE("long chains of nodes and many scenes take time in proportion to their size", "[import][bad]") {
  constexpr uint32_t kCount = 100000;
  std::string nodes;
  for (uint32_t i = 0; i + 1 < kCount; ++i) nodes += R"({"children":[)" + std::to_string(i + 1) + "]},";
  std::string scenes;
  for (uint32_t i = 0; i < 2000; ++i)
    scenes += std::string(i == 0 ? "" : ",") + R"({"nodes":[)" + std::to_string(kCount - 1) + "]}";
  const tests::TempFolder folder;
  const auto start = std::chrono::steady_clock::now();
  const auto scene = must(import_gltf(folder.write("chain.gltf", R"({"asset":{"version":"2.0"},"nodes":[)" + nodes +
                                                                     R"({"name":"last"}],"scenes":[)" + scenes + "]}"),
                                      {}));
  CHECK(scene.nodes.size() == kCount);
  CHECK(scene.nodes.back().name == "last");
  CHECK(scene.scenes.size() == 2000);
  CHECK(std::chrono::steady_clock::now() - start < std::chrono::seconds(60));
}

TEST_CASE("every prefix of a file is refused", "[import][bad]") {
  const tests::TempFolder folder;
  for (const char* name : {"data_uri.gltf", "interleaved.glb"}) {
    std::string bytes = tests::read_whole(tests::data_path(name).string());
    while (bytes.back() == '\n') bytes.pop_back();
    for (size_t length = 0; length < bytes.size(); ++length) {
      const std::string path = folder.write(std::string("prefix-") + name, std::string_view(bytes).substr(0, length));
      const auto scene = import_gltf(path, {});
      INFO(name << " cut to " << length);
      REQUIRE_FALSE(scene);
    }
  }
}

TEST_CASE("a changed byte never crashes an import", "[import][bad]") {
  std::mt19937 random(2);
  const auto below = [&](size_t n) { return static_cast<size_t>(random() % n); };
  const tests::TempFolder folder;
  for (const char* name : {"data_uri.gltf", "interleaved.glb", "gpu_instancing.glb", "sparse.gltf", "materials.gltf"}) {
    const std::string bytes = tests::read_whole(tests::data_path(name).string());
    if (std::string(name) == "sparse.gltf")
      folder.write("sparse.bin", tests::read_whole(tests::data_path("sparse.bin").string()));
    for (int i = 0; i < 700; ++i) {
      std::string changed = bytes;
      constexpr std::string_view kLikely = "0123456789-.eE,:[]{}\"\\ \xff";
      for (size_t n = 1 + below(3); n > 0; --n) {
        const size_t at = below(changed.size());
        changed[at] = below(2) == 0 ? static_cast<char>(below(256)) : kLikely[below(kLikely.size())];
      }
      const std::string path = folder.write(std::string("changed-") + name, changed);
      const auto scene = import_gltf(path, {});
      check_outcome(path, scene);
      if (scene) (void)read_everything(*scene);
    }
  }
}

TEST_CASE("the malformed real files end in an error or a clean import", "[import][bad][models]") {
  const std::filesystem::path folder = tests::real_models("bad/gltf");
  if (folder.empty()) return;
  size_t files = 0, refused = 0;
  for (const fs::path& file : tests::model_files(folder)) {
    ++files;
    const std::string path = file.string();
    const auto scene = import_gltf(path, {});
    check_outcome(path, scene);
    bool failed = !scene;
    if (scene) failed = !read_everything(*scene);
    refused += failed ? 1 : 0;
  }
  CHECK(files > 300);
  CHECK(refused > 100);
}

// The reasons for refusing scenes of the folder of real models. All others must be imported.
const std::map<std::string, std::string> kRefusedScenes = {
    {"CubeScaledInstances/cube_att.gltf", "node 5: has two parents"},
    {"batched-CESIUM_RTC/batched.glb", "CESIUM_RTC"},
    {"frankfurt-474_5548/474_5548_-1_lv5_group_0.osgb_3.glb",
     "accessor 2 has 49427 elements, expected a multiple of 3"},
    {"habitat-batch-multiple-meshes/batch-multiple-meshes.gltf", "KHR_texture_ktx"},
};

TEST_CASE("real scenes are imported, except for unsupported features", "[import][models]") {
  const std::filesystem::path folder = tests::real_models("scenes");
  if (folder.empty()) return;
  size_t files = 0;
  for (const fs::path& file : tests::model_files(folder)) {
    ++files;
    const std::string name = file.lexically_relative(folder).generic_string();
    INFO(name);
    const auto scene = import_gltf(file.string(), {});
    check_outcome(file.string(), scene);
    const auto reason = kRefusedScenes.find(name);
    if (!scene && draco_version().empty() && scene.error().message.find("built without libdraco") != std::string::npos)
      continue;
    if (reason == kRefusedScenes.end()) {
      if (!scene) FAIL(scene.error().message);
      must(read_everything(*scene));
    } else {
      CHECK(refusal(scene).message.find(reason->second) != std::string::npos);
    }
  }
  CHECK(files >= kRefusedScenes.size());
}

}  // namespace
}  // namespace scree::convert
