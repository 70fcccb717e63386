// Small files with huge sizes in their headers take little memory. The program reads each in 512 MiB of address space,
// and has to print a better error than that memory has run out. This is not built with sanitizers, which take terabytes
// of address space. For them the fuzz targets limit single allocations.
#include <sys/wait.h>

#include <cstdlib>
#include <string>

#include "format/bytes.h"
#include "format/layout.h"
#include "tests/format/container/container_fixture.h"
#include "tests/format/jpeg/jpeg_checks.h"
#include "tests/models.h"
#include "tests/tools/model_maker.h"

namespace scree::tests {
namespace {

using namespace scree::format;

/// Runs the program in `folder` within the limit. An exit code other than 3 fails the test.
void must_refuse(const TempFolder& folder, const std::string& words) {
  const std::string log = folder.file("log");
  const std::string command = "cd '" + folder.path().string() + "' && ulimit -v 524288 && '" + tests::kProgram + "' " +
                              words + " >'" + log + "' 2>&1";
  const int status = std::system(command.c_str());
  const std::string said = read_whole(log);
  INFO(words << ": " << said);
  REQUIRE(WIFEXITED(status));
  CHECK(WEXITSTATUS(status) == 3);
  const size_t error = said.rfind("scree ");
  REQUIRE(error != std::string::npos);
  CHECK(said.find("memory", error) == std::string::npos);
}

/// A JPEG whose header states 16383 x 16383 pixels.
Bytes huge_jpeg(bool is_progressive, bool is_arithmetic) {
  Bytes file = make_jpeg({.width = 8,
                          .height = 8,
                          .factors = {{1, 1}, {1, 1}, {1, 1}},
                          .is_progressive = is_progressive,
                          .is_arithmetic = is_arithmetic});
  const uint32_t frame = is_arithmetic ? (is_progressive ? 0xca : 0xc9) : is_progressive ? 0xc2 : 0xc0;
  const size_t at = jpeg::find_marker(file, frame);
  file[at + 5] = file[at + 7] = std::byte{0x3f};
  file[at + 6] = file[at + 8] = std::byte{0xff};
  return file;
}

Bytes huge_png() {
  Bytes file = tests::read_bytes(data_path("checker.png").string());
  file[18] = file[22] = std::byte{0x3f};
  file[19] = file[23] = std::byte{0xff};
  return file;
}

void make_textured(const TempFolder& folder, ImageCodec codec, const Bytes& image) {
  ModelMaker maker(folder.file("in.glb"));
  maker.node("node", maker.mesh("mesh", {maker.grid({.uv = true}, maker.textured("image", codec, image))}));
  maker.finish();
}

TEST_CASE("pictures of a few bytes whose header states 268 million pixels take little memory", "[hostile]") {
  const TempFolder folder;
  for (const bool is_progressive : {false, true}) {
    for (const bool is_arithmetic : {false, true}) {
      make_textured(folder, ImageCodec::kJpeg, huge_jpeg(is_progressive, is_arithmetic));
      must_refuse(folder, "convert in.glb -o out.scree --threads 1");
      must_refuse(folder, "convert in.glb -o out.scree --threads 1 --textures raw");
    }
  }
  make_textured(folder, ImageCodec::kPng, huge_png());
  must_refuse(folder, "convert in.glb -o out.scree --threads 1");
}

TEST_CASE("documents of a few bytes with huge buffers take little memory", "[hostile]") {
  const TempFolder folder;
  const auto document = [](const std::string& buffer, const std::string& view, const std::string& accessor) {
    return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
"buffers":[{"uri":"data:;base64,AAAA",)" +
           buffer + R"(}],"bufferViews":[{"buffer":0,)" + view + R"(}],"extensionsUsed":["EXT_meshopt_compression"],
"accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","min":[0,0,0],"max":[0,0,0],)" +
           accessor + "}]}";
  };
  const std::string huge = "4503599627370496";
  folder.write("in.gltf", document("\"byteLength\":" + huge, "\"byteLength\":" + huge, "\"count\":375299968947541"));
  must_refuse(folder, "convert in.gltf -o out.scree --threads 1");
  folder.write("in.gltf", document("\"byteLength\":3", "\"byteLength\":3", "\"count\":4294967295"));
  must_refuse(folder, "convert in.gltf -o out.scree --threads 1");
  // Three bytes that unpack to 48 GB.
  folder.write("in.gltf", document("\"byteLength\":3",
                                   R"("byteLength":51539607540,"byteStride":12,"extensions":{"EXT_meshopt_compression":
{"buffer":0,"byteLength":3,"byteStride":12,"count":4294967295,"mode":"ATTRIBUTES"}})",
                                   "\"count\":4294967295"));
  must_refuse(folder, "convert in.gltf -o out.scree --threads 1");
  std::string glb("glTF\2\0\0\0\xff\xff\xff\xff\xf0\xff\xff\xffJSON{}", 22);
  folder.write("in.glb", glb);
  must_refuse(folder, "convert in.glb -o out.scree --threads 1");
}

TEST_CASE("containers of a few bytes with huge tables take little memory", "[hostile]") {
  const TempFolder folder;
  const Bytes good = file_of(full_parts());
  const auto check = [&](const Bytes& file) {
    folder.write("in.scree", {reinterpret_cast<const char*>(file.data()), file.size()});
    for (const char* words :
         {"inspect in.scree --verify --threads 1", "render in.scree -o out.png --backend cpu --threads 1",
          "export in.scree -o out.glb --threads 1"})
      must_refuse(folder, words);
  };
  for (const uint32_t bits : {0u, 7u, 32u}) {
    check(patched<ChunkRecord>(good, TableKind::kChunks, 0, [&](ChunkRecord& chunk) {
      chunk.triangle_count = 0xffffffff;
      chunk.index_bits = static_cast<uint8_t>(bits);
    }));
  }
  check(patched<ChunkRecord>(good, TableKind::kChunks, 1, [](ChunkRecord& c) { c.vertex_count = 0xffffffff; }));
  check(patched<PageRecord>(good, TableKind::kPages, 1, [](PageRecord& page) { page.raw_bytes = uint64_t{1} << 40; }));
  check(patched<PageRecord>(good, TableKind::kPages, 0,
                            [](PageRecord& page) { page.stored_bytes = page.raw_bytes = uint64_t{1} << 40; }));
  check(patched<MeshRecord>(good, TableKind::kMeshes, 0, [](MeshRecord& mesh) { mesh.vertex_count = ~uint64_t{0}; }));
  check(
      patched<SceneRecord>(good, TableKind::kScenes, 1, [](SceneRecord& s) { s.instance_count = uint64_t{1} << 60; }));
  check(patched<NodeRecord>(good, TableKind::kNodes, 2, [](NodeRecord& n) { n.node_instance_count = ~uint64_t{0}; }));
  check(patched<ImageRecord>(good, TableKind::kImages, 0,
                             [](ImageRecord& image) { image.width = image.height = 1 << 24; }));
  for (const uint64_t count : {uint64_t{0xfffffffe}, ~uint64_t{0}}) {
    Bytes file = good;
    const size_t at = toc_entry_offset(file, TableKind::kInstances);
    auto entry = format::load<TocEntry>(file.data() + at);
    entry.record_count = count;
    format::store(file.data() + at, entry);
    reseal(file);
    check(file);
  }
}

}  // namespace
}  // namespace scree::tests
