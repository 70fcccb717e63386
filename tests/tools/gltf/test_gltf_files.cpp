// The files of a document: GLB chunks, relative paths, buffers far larger than memory.
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tests/models.h"
#include "tests/results.h"
#include "tests/sanitized.h"
#include "tests/tools/gltf/many_files.h"
#include "tools/common/process/memory_use.h"
#include "tools/gltf/byte_source.h"
#include "tools/gltf/document/json.h"
#include "tools/gltf/document/uri.h"
#include "tools/gltf/source.h"

namespace scree::convert {
namespace {

namespace fs = std::filesystem;

void append(std::string& bytes, uint32_t value) {
  bytes.append(reinterpret_cast<const char*>(&value), 4);
}

std::string chunk(std::string_view type, std::string_view data) {
  std::string bytes;
  append(bytes, static_cast<uint32_t>(data.size()));
  return bytes.append(type).append(data);
}

std::string glb(const std::string& chunks, uint32_t version = 2) {
  std::string bytes = "glTF";
  append(bytes, version);
  append(bytes, static_cast<uint32_t>(12 + chunks.size()));
  return bytes + chunks;
}

const std::string kBin("BIN\0", 4);
const std::string kDocument = R"({"asset":{"version":"2.0"},"buffers":[{"byteLength":36}],"bufferViews":[{"buffer":0,
"byteLength":36}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],"meshes":[{"primitives":[{
"attributes":{"POSITION":0}}]}],"nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}]})";

std::string padded(std::string text, char with = ' ') {
  return text + std::string((4 - text.size() % 4) % 4, with);
}

std::string floats(const std::vector<float>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float)};
}

const std::string kTriangle = floats({0, 0, 0, 1, 0, 0, 0, 1, 0});

/// A GLB that is refused, and a part of the error's message.
struct Bad {
  std::string bytes;
  ErrorCode code;
  const char* message;
};

/// kDocument with a buffer of `bytes` bytes, the last 36 of which are the positions.
std::string large_document(uint64_t bytes) {
  return tests::replaced(tests::replaced(kDocument, R"("byteLength":36}],"bufferViews")",
                                         R"("byteLength":)" + std::to_string(bytes) + R"(}],"bufferViews")"),
                         R"("buffer":0,)", R"("buffer":0,"byteOffset":)" + std::to_string(bytes - 36) + ",");
}

// The positions of the first primitive, or the error.
Result<std::vector<float>> positions_of(const std::string& path) {
  auto scene = import_gltf(path, {});
  if (!scene) return scene.error();
  if (scene->primitives.empty()) return Error{ErrorCode::kFormat, "no primitives"};
  std::vector<float> out(9);
  if (auto read = read_floats(scene->primitives[0].positions, 0, 3, out); !read) return read.error();
  return out;
}

TEST_CASE("GLB chunks are found, unknown ones are skipped, and padding is accepted", "[import][glb]") {
  const tests::TempFolder folder;
  const std::string json = chunk("JSON", padded(kDocument));
  const std::string bin = chunk(kBin, kTriangle);
  const std::vector<float> expected{0, 0, 0, 1, 0, 0, 0, 1, 0};
  for (const std::string& good : {
           glb(json + bin), glb(json + bin + chunk("XYZ ", "12345678")), glb(json + chunk(kBin, kTriangle + "abc ")),
           glb(json + bin) + std::string(100, '\0'), glb(chunk("JSON", padded(kDocument, '\0')) + bin),
           glb(chunk("JSON", padded("\xef\xbb\xbf" + kDocument)) + bin),
           glb(chunk("JSON", kDocument + (kDocument.size() % 4 == 0 ? " " : "")) + bin),  // length not a multiple of 4
       }) {
    CHECK(must(positions_of(folder.write("good.glb", good))) == expected);
  }

  std::string many;
  for (int i = 0; i < 63; ++i) many += chunk("XYZ ", "");
  std::string long_length = glb(json + bin);
  long_length[8] = static_cast<char>(long_length[8] + 1);
  for (const Bad& bad : std::initializer_list<Bad>{
           {glb(json + bin, 1), ErrorCode::kVersion, "GLB header: version is 1"},
           {glb(json + bin, 4), ErrorCode::kVersion, "GLB header: version is 4, expected 2 or 3"},
           {glb(json + bin, 3), ErrorCode::kTruncated, "GLB header: length is"},
           {long_length, ErrorCode::kTruncated, "GLB header: length is"},
           {glb(bin + json), ErrorCode::kFormat, "GLB chunk 0: expected the JSON chunk first"},
           {glb(json + json), ErrorCode::kFormat, "GLB chunk 1: a second JSON chunk"},
           {glb(json + bin + bin), ErrorCode::kFormat, "GLB chunk 2: the BIN chunk"},
           {glb(json + bin) + std::string(100, 'x'), ErrorCode::kTrailing, "GLB header: length is"},
           {glb(json + bin) + std::string(10000, '\0'), ErrorCode::kTrailing, "GLB header: length is"},
           {glb(json + bin + many), ErrorCode::kFormat, "GLB chunk 64: at most 64 are read"},
           {glb(chunk("JSON", "") + bin), ErrorCode::kFormat, "GLB chunk 0: the JSON chunk is empty"},
           {glb(""), ErrorCode::kFormat, "too short for a chunk"},
           {glb(json + bin.substr(0, 6)), ErrorCode::kTruncated, "GLB chunk 1: 6 bytes left for its header"},
           {glb(json + bin.substr(0, 30)), ErrorCode::kTruncated, "GLB chunk 1: length is 36, but 22 bytes are left"},
           {glb(json + chunk(kBin, kTriangle.substr(4))), ErrorCode::kTruncated, "buffer 0: byteLength is 36"},
           {glb(json), ErrorCode::kFormat, "buffer 0: uri is missing, and the file has no binary chunk"},
           {"glTF", ErrorCode::kTruncated, "GLB header: the file ends after 4 bytes"},
           {"", ErrorCode::kFormat, "empty"},
           {" \n ", ErrorCode::kFormat, "JSON is empty"},
           {"[]", ErrorCode::kFormat, "expected '{'"},
           {kDocument + "x", ErrorCode::kTrailing, "1 bytes after the end of the document"},
       }) {
    INFO(bad.message);
    check_refusal(positions_of(folder.write("bad.glb", bad.bytes)), bad.code, bad.message);
  }
}

// A file of any size that takes no disk space: `parts` at their offsets, and holes between them.
std::string sparse_file(const tests::TempFolder& folder, const std::string& name, uint64_t size,
                        const std::vector<std::pair<uint64_t, std::string>>& parts) {
  const std::string path = folder.write(name, "");
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  for (const auto& [offset, bytes] : parts) {
    file.seekp(static_cast<std::streamoff>(offset));
    file.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  }
  file.close();
  REQUIRE(::truncate(path.c_str(), static_cast<off_t>(size)) == 0);
  return path;
}

TEST_CASE("a GLB above 4 GiB is read, whose lengths are modulo 2^32", "[import][glb]") {
  const tests::TempFolder folder;
  const uint64_t bin_bytes = (uint64_t{5} << 30) + 36;
  const uint64_t last = bin_bytes - 36;
  const std::string json = padded(large_document(bin_bytes));
  const uint64_t bin_at = 12 + 8 + json.size() + 8;
  const uint64_t size = bin_at + bin_bytes;
  std::string head = "glTF";
  append(head, 2);
  append(head, static_cast<uint32_t>(size));
  head += chunk("JSON", json);
  append(head, static_cast<uint32_t>(bin_bytes));
  head += kBin;
  const auto positions =
      must(positions_of(sparse_file(folder, "large.glb", size, {{0, head}, {bin_at + last, kTriangle}})));
  CHECK(positions[3] == 1.0f);
  CHECK(positions[7] == 1.0f);

  // If the header's length differs from the file's, the header's is used, and the file ends early.
  CHECK(refusal(positions_of(sparse_file(folder, "longer.glb", size + 8, {{0, head}}))).code == ErrorCode::kTrailing);
}

// Version 3, from the draft of glTF 2.1: lengths of 64 bits, with a chunk's type before them, and chunks at multiples
// of 8.
std::string wide_chunk(std::string_view type, std::string_view data, uint32_t encoding = 0) {
  std::string bytes(type);
  append(bytes, encoding);
  append(bytes, static_cast<uint32_t>(data.size()));
  append(bytes, 0);
  bytes.append(data);
  return bytes.append((8 - bytes.size() % 8) % 8, '\0');
}

std::string wide_glb(const std::string& chunks) {
  std::string bytes = "glTF";
  append(bytes, 3);
  append(bytes, static_cast<uint32_t>(16 + chunks.size()));
  append(bytes, 0);
  return bytes + chunks;
}

TEST_CASE("a GLB of version 3 has chunks of 64-bit lengths in any order", "[import][glb]") {
  const tests::TempFolder folder;
  const std::string json = wide_chunk("JSON", kDocument), bin = wide_chunk(kBin, kTriangle);
  const std::string named =
      wide_chunk("JSON", tests::replaced(kDocument, R"({"byteLength":36})", R"({"byteLength":36,"chunk":0})"));
  for (const std::string& good :
       {wide_glb(json + bin), wide_glb(json + bin + wide_chunk("XYZ ", "12345", 7)), wide_glb(bin + named),
        wide_glb(bin + wide_chunk("XYZ ", "1") + named + bin + wide_chunk("JSON", "{}")),
        wide_glb(json + bin) + std::string(100, '\0')}) {
    CHECK(must(positions_of(folder.write("good.glb", good)))[3] == 1.0f);
  }
  std::string long_chunk = json;
  long_chunk[15] = 1;
  std::string many = json;
  for (int i = 0; i < 5000; ++i) many += wide_chunk("XYZ ", "");
  for (const Bad& bad : std::initializer_list<Bad>{
           {wide_glb(json + bin).substr(0, 12), ErrorCode::kTruncated, "GLB header: the file ends after 12 bytes"},
           {wide_glb(""), ErrorCode::kFormat, "too short for a chunk"},
           {wide_glb(bin + bin), ErrorCode::kFormat, "GLB: there is no JSON chunk"},
           {wide_glb(wide_chunk("JSON", "")), ErrorCode::kFormat, "GLB chunk 0: the JSON chunk is empty"},
           {wide_glb(wide_chunk("JSON", kDocument, 1) + bin), ErrorCode::kUnsupported,
            "GLB chunk 0: encoded by method 1"},
           {wide_glb(json + bin.substr(0, 8)), ErrorCode::kTruncated, "GLB chunk 1: 8 bytes left for its header"},
           {wide_glb(json + bin.substr(0, 40)), ErrorCode::kTruncated, "GLB chunk 1: length is 36, but 24 bytes"},
           {wide_glb(long_chunk), ErrorCode::kTruncated, "GLB chunk 0: length is 72057594"},
           {wide_glb(json), ErrorCode::kFormat, "buffer 0: uri is missing, and the file has no binary chunk"},
           {wide_glb(json + wide_chunk("XYZ ", kTriangle)), ErrorCode::kFormat, "the file has no binary chunk"},
           {wide_glb(wide_chunk("XYZ ", kTriangle) + named), ErrorCode::kFormat,
            "chunk 0 is no binary chunk of the file"},
           {wide_glb(many), ErrorCode::kFormat, "GLB chunk 4096: at most 4096 are read"},
       }) {
    INFO(bad.message);
    check_refusal(positions_of(folder.write("bad.glb", bad.bytes)), bad.code, bad.message);
  }
}

TEST_CASE("a GLB of version 3 above 4 GiB is read at its true offsets", "[import][glb]") {
  const tests::TempFolder folder;
  const uint64_t bin_bytes = (uint64_t{5} << 30) + 36, last = bin_bytes - 36;
  std::string head = wide_glb(wide_chunk("JSON", large_document(bin_bytes))).append(kBin);
  append(head, 0);
  append(head, static_cast<uint32_t>(bin_bytes));
  append(head, static_cast<uint32_t>(bin_bytes >> 32));
  const uint64_t size = head.size() + bin_bytes;
  for (uint32_t i = 0; i < 8; ++i) head[8 + i] = static_cast<char>(size >> 8 * i);
  const auto positions =
      must(positions_of(sparse_file(folder, "large.glb", size, {{0, head}, {head.size() + last, kTriangle}})));
  CHECK(positions[7] == 1.0f);
}

/// The most resident bytes since tools::reset_peak(), not counting the bytes of `before`; nullopt if the system does
/// not report it.
std::optional<uint64_t> most_resident_since(const tools::MemoryUse& before) {
  const uint64_t peak = tools::memory_use().peak, resident = before.anonymous + before.file;
  if (resident == 0 || peak < resident) return std::nullopt;
  return peak - resident;
}

TEST_CASE("JSON that is cut off while it is read is an error", "[import]") {
  const tests::TempFolder folder;
  const std::string path = folder.write("a.gltf", kDocument);
  const auto source = must(open_file_source(path));
  const uint64_t bytes = source->size();
  const auto whole = must(read_json_text(*source, 0, bytes));
  CHECK(std::string(whole.begin(), whole.end()) == kDocument);
  std::filesystem::resize_file(path, bytes / 2);
  CHECK(refusal(read_json_text(*source, 0, bytes)).code == ErrorCode::kTruncated);
}

TEST_CASE("a 40 GB buffer is opened and read without being kept in memory", "[import]") {
  const tests::TempFolder folder;
  constexpr uint64_t kBytes = 40'000'000'000, kVertices = 3'000'000'000;
  const uint64_t last = (kVertices - 3) * 12;
  sparse_file(folder, "large.bin", kBytes, {{last, kTriangle}});
  std::string json = tests::replaced(kDocument, R"("buffers":[{"byteLength":36}])",
                                     R"("buffers":[{"uri":"large.bin","byteLength":40000000000}])");
  json = tests::replaced(json, R"("byteLength":36}],"accessors")", R"("byteLength":40000000000}],"accessors")");
  json = tests::replaced(json, R"("count":3)", R"("count":3000000000)");
  const std::string path = folder.write("large.gltf", json);

  tools::reset_peak();
  const tools::MemoryUse before = tools::memory_use();
  const auto scene = must(import_gltf(path, {}));
  REQUIRE(scene.primitives.size() == 1);
  const Primitive& primitive = scene.primitives[0];
  CHECK(primitive.triangle_count() == kVertices / 3);
  CHECK(scene.buffer_bytes == kBytes);
  std::vector<float> values(9);
  REQUIRE(read_floats(primitive.positions, kVertices - 3, 3, values));
  CHECK(values[3] == 1.0f);
  CHECK(values[7] == 1.0f);
  const std::array<uint32_t, 4> some{0, 5, 2'147'483'648u, static_cast<uint32_t>(kVertices - 2)};
  std::vector<float> gathered(12);
  REQUIRE(gather_floats(primitive.positions, some, gathered));
  CHECK(gathered[9] == 1.0f);
  std::vector<uint32_t> triangles(3);
  REQUIRE(read_triangles(primitive, kVertices / 3 - 1, 1, triangles));
  CHECK(triangles[2] == kVertices - 1);
  const std::optional<uint64_t> most = most_resident_since(before);
  if (!most) {
    WARN("skipped: this system does not report the used memory");
    return;
  }
  CHECK(*most < uint64_t{50} << 20);
}

TEST_CASE("the memory of a document is bounded by its size", "[import]") {
  // 8 MB of nodes take at most 15 times their size in memory. tinygltf alone would take more.
  std::string json = R"({"asset":{"version":"2.0"},"nodes":[)";
  for (int i = 0; i < 120000; ++i)
    json += R"({"name":"node )" + std::to_string(i) + R"(","translation":[1.5,2.5,-3.25],"scale":[2,2,2]},)";
  json.back() = ']';
  json += "}";
  const tests::TempFolder folder;
  const std::string path = folder.write("nodes.gltf", json);
  tools::reset_peak();
  const tools::MemoryUse before = tools::memory_use();
  const auto scene = must(import_gltf(path, {}));
  const std::optional<uint64_t> most = most_resident_since(before);
  CHECK(scene.nodes.size() == 120000);
  REQUIRE(scene.scenes.size() == 1);
  CHECK(scene.scenes[0].roots.size() == 120000);
  CHECK(scene.warnings.size() == 1);
  // Freed memory that the sanitizers keep.
  constexpr uint64_t kQuarantine = tests::kIsSanitized ? uint64_t{256} << 20 : 0;
  if (most) CHECK(*most < 15 * json.size() + (uint64_t{64} << 20) + kQuarantine);
}

TEST_CASE("paths stay inside the scene's folder", "[import][uri]") {
  const tests::TempFolder folder;
  folder.write("outside.bin", kTriangle);
  folder.write("scene/here.bin", kTriangle);
  folder.write("scene/deep/er/there.bin", kTriangle);
  folder.write("scene/with space #1.bin", kTriangle);
  folder.write("scene/a:b.bin", kTriangle);
  fs::create_directory(folder.path() / "scene" / "folder.bin");
  REQUIRE(::mkfifo((folder.path() / "scene" / "pipe.bin").c_str(), 0600) == 0);
  fs::create_symlink("here.bin", folder.path() / "scene" / "link.bin");
  fs::create_symlink("../outside.bin", folder.path() / "scene" / "escape.bin");
  fs::create_symlink("..", folder.path() / "scene" / "up");
  fs::create_symlink("loop.bin", folder.path() / "scene" / "loop.bin");
  fs::create_directory_symlink("scene", folder.path() / "same");
  const auto import_uri = [&](const std::string& uri, const std::string& name = "scene/scene.gltf") {
    return positions_of(
        folder.write(name, tests::replaced(kDocument, R"("byteLength":36}],"bufferViews")",
                                           R"("uri":")" + uri + R"(","byteLength":36}],"bufferViews")")));
  };
  for (const char* good :
       {"here.bin", "./here.bin", "deep/er/there.bin", "deep/../here.bin", "deep//er/there.bin",
        "with%20space%20%231.bin", "with space #1.bin", "h%65re.bin", "link.bin", "./a:b.bin", "up/scene/here.bin"}) {
    INFO(good);
    CHECK(must(import_uri(good))[3] == 1.0f);
  }
  // The folder itself may be reached by a link.
  CHECK(import_uri("here.bin", "same/again.gltf"));

  for (const auto& [uri, code, message] : std::initializer_list<std::tuple<const char*, ErrorCode, const char*>>{
           {"../outside.bin", ErrorCode::kUnsupported, "leaves the scene's folder"},
           {"%2e%2e/outside.bin", ErrorCode::kUnsupported, "leaves the scene's folder"},
           {"..%2Foutside.bin", ErrorCode::kUnsupported, "leaves the scene's folder"},
           {"deep/../../outside.bin", ErrorCode::kUnsupported, "leaves the scene's folder"},
           {"../scene/here.bin", ErrorCode::kUnsupported, "leaves the scene's folder"},
           {"escape.bin", ErrorCode::kUnsupported, "by way of a symbolic link"},
           {"up/outside.bin", ErrorCode::kUnsupported, "by way of a symbolic link"},
           {"/etc/hostname", ErrorCode::kUnsupported, "an absolute path"},
           {"%2Fetc/hostname", ErrorCode::kUnsupported, "an absolute path"},
           {"file:///etc/hostname", ErrorCode::kUnsupported, "scheme \"file:\""},
           {"FILE:here.bin", ErrorCode::kUnsupported, "scheme \"FILE:\""},
           {"http://example.org/a.bin", ErrorCode::kUnsupported, "scheme \"http:\""},
           {"https://example.org/a.bin", ErrorCode::kUnsupported, "scheme \"https:\""},
           {"C:/a.bin", ErrorCode::kUnsupported, "scheme \"C:\""},
           {"a%00b.bin", ErrorCode::kFormat, "holds a zero byte"},
           {"a%4", ErrorCode::kFormat, "bad percent coding"},
           {"a%zz", ErrorCode::kFormat, "bad percent coding"},
           {"missing.bin", ErrorCode::kFile, "missing.bin: No such file"},
           {"folder.bin", ErrorCode::kFile, "not a regular file"},
           {"pipe.bin", ErrorCode::kFile, "not a regular file"},
           {"loop.bin", ErrorCode::kFile, "loop.bin"},
       }) {
    INFO(uri);
    const Error error = refusal(import_uri(uri));
    check_error(error, code, message);
    CHECK(error.message.find("buffer 0: ") != std::string::npos);
  }
  // Files outside the folder are read on request. The refusal names the option.
  for (const char* outside :
       {"../outside.bin", "..%2Foutside.bin", "../scene/here.bin", "escape.bin", "up/outside.bin"}) {
    INFO(outside);
    CHECK(refusal(import_uri(outside)).message.ends_with("; --allow-outside reads it"));
    CHECK(import_gltf(folder.file("scene/scene.gltf"), {.allow_outside = true}));
  }
  for (const char* never : {"/etc/hostname", "file:///etc/hostname"}) {
    REQUIRE_FALSE(import_uri(never));
    CHECK_FALSE(import_gltf(folder.file("scene/scene.gltf"), {.allow_outside = true}));
  }
  CHECK(refusal(import_gltf(folder.file("none.gltf"), {})).code == ErrorCode::kFile);
  CHECK(refusal(import_gltf(folder.path().string(), {})).message.find("not a regular file") != std::string::npos);
}

TEST_CASE("images stay inside the scene's folder", "[import][uri]") {
  const tests::TempFolder folder;
  const std::string picture = tests::read_whole(tests::data_path("checker.png").string());
  folder.write("outside.png", picture);
  folder.write("scene/here.png", picture);
  folder.write("scene/points.bin", std::string(60, '\0'));
  fs::create_symlink("../outside.png", folder.path() / "scene" / "escape.png");
  const auto import_image = [&](const std::string& uri) {
    return import_gltf(
        folder.write("scene/scene.gltf", R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_0":1},"material":0}]}],
"materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],"textures":[{"source":0}],
"images":[{"uri":")" + uri + R"("}],"buffers":[{"byteLength":60,"uri":"points.bin"}],
"bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":24}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[0,0,0]},
{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}]})"),
        {});
  };
  REQUIRE(must(import_image("here.png")).images.size() == 1);
  for (const std::string& uri :
       {std::string("../outside.png"), std::string("%2e%2e/outside.png"), std::string("escape.png"),
        (folder.path() / "outside.png").string(), "file://" + (folder.path() / "outside.png").string()}) {
    INFO(uri);
    check_refusal(import_image(uri), ErrorCode::kUnsupported, "image 0: ");
  }
}

TEST_CASE("a scene may have more buffer files than a process can open", "[import]") {
  const tests::TempFolder folder;
  constexpr int kFiles = 1500;
  const auto scene = must(import_gltf(tests::write_many_files(folder, tests::many_triangles(kFiles)), {}));
  REQUIRE(scene.primitives.size() == kFiles);
  for (int i = 0; i < kFiles; ++i) {
    std::array<float, 3> first;
    REQUIRE(read_floats(scene.primitives[static_cast<size_t>(i)].positions, 0, 1, first));
    CHECK(first[0] == static_cast<float>(i));
  }
}

TEST_CASE("a reopened buffer file must be the same file", "[import]") {
  const tests::TempFolder folder;
  constexpr size_t kFiles = 600, kKept = 512;
  const auto scene = must(import_gltf(tests::write_many_files(folder, tests::many_triangles(kFiles)), {}));
  const auto read = [&](size_t number) {
    std::array<float, 3> first;
    return read_floats(scene.primitives.at(number).positions, 0, 1, first);
  };
  const auto path = [&](size_t number) { return folder.file(std::to_string(number) + ".bin"); };
  const auto must_fail = [&](size_t number, const std::string& words) {
    check_refusal(read(number), {ErrorCode::kFile, path(number) + ": " + words});
  };
  REQUIRE(read(kFiles - 1));
  fs::remove(path(590));
  must_fail(590, "No such file or directory");
  // Another file of the same bytes, size and time, and a name that is no longer a file.
  fs::copy_file(path(591), folder.file("copy"));
  fs::last_write_time(folder.file("copy"), fs::last_write_time(path(591)));
  fs::rename(folder.file("copy"), path(591));
  must_fail(591, "was replaced by another file while it was being read");
  REQUIRE(::mkfifo(folder.file("pipe").c_str(), 0600) == 0);
  fs::rename(folder.file("pipe"), path(592));
  must_fail(592, "was replaced by another file while it was being read");
  // The same file with another size, or modified since.
  fs::resize_file(path(593), 35);
  must_fail(593, "was changed while it was being read");
  fs::resize_file(path(594), 37);
  fs::last_write_time(path(594), fs::last_write_time(path(595)));
  must_fail(594, "was changed while it was being read");
  fs::last_write_time(path(596), fs::last_write_time(path(596)) + std::chrono::nanoseconds(1));
  must_fail(596, "was changed while it was being read");
  fs::last_write_time(path(597), fs::last_write_time(path(597)) - std::chrono::seconds(1));
  must_fail(597, "was changed while it was being read");
  // Files that stay open keep their content.
  fs::remove(path(0));
  CHECK(read(0));
  fs::rename(path(1), path(2));
  CHECK(read(2));
  CHECK(read(kKept + 1));
}

TEST_CASE("a file that shrinks after it was opened is an error", "[import]") {
  const tests::TempFolder folder;
  const std::string bin = folder.write("shrinks.bin", kTriangle);
  const std::string text = tests::replaced(kDocument, R"("buffers":[{)", R"("buffers":[{"uri":"shrinks.bin",)");
  const SourceScene scene = must(import_gltf(folder.write("shrinks.gltf", text), {}));
  REQUIRE(::truncate(bin.c_str(), 20) == 0);
  std::vector<float> values(9);
  check_refusal(read_floats(scene.primitives.at(0).positions, 0, 3, values), ErrorCode::kTruncated,
                "shrinks.bin: ends at byte 20");
}

TEST_CASE("data: URIs are base64 or percent-coded", "[import][uri]") {
  const auto text_of = [](std::string_view uri) {
    const auto bytes = must(decode_data_uri(uri));
    return std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  };
  CHECK(text_of("data:,a%20b") == "a b");
  CHECK(text_of("DATA:text/plain;charset=x,%41") == "A");
  CHECK(text_of("data:,") == "");
  CHECK(text_of("data:;base64,") == "");
  CHECK(text_of("data:;base64,Zg==") == "f");
  CHECK(text_of("data:;base64,Zg") == "f");
  CHECK(text_of("data:;base64,Zm8=") == "fo");
  CHECK(text_of("data:;base64,Zm9v") == "foo");
  CHECK(text_of("data:;base64,Zm9vYg%3D%3D") == "foob");
  CHECK(text_of("DATA:application/octet-stream;BASE64,Zm9v") == "foo");
  CHECK(text_of("data:;Base64,Zm9v") == "foo");
  CHECK(text_of("data:base64,Zm9v") == "Zm9v");  // a type, not the mark
  CHECK(text_of("data:;base64,-_-_") == text_of("data:;base64,+/+/"));
  for (const char* bad :
       {"data:", "data:x;base64", "data:;base64,Z", "data:;base64,Zg=", "data:;base64,Z===", "data:;base64,Zg==Zg==",
        "data:;base64,Z g=", "data:,%4", "data:,%", "data:,%x0", "date:,a"}) {
    INFO(bad);
    CHECK_FALSE(decode_data_uri(bad));
  }
}

TEST_CASE("the scanner divides a document at members and elements", "[import][json]") {
  std::string text =
      R"( {"a":[1,"]}",{"b":"\\\"]"}] , "n\u006fdes" : [ {"extras":{"x":[1,2]}} ,2,[3]],"extras":[[5]],"c":"\\" } )";
  const auto members = must(split_document(text));
  REQUIRE(members.size() == 4);
  const auto value = [&](size_t i) {
    const JsonRange range = members[i].value;
    return text.substr(range.begin, range.end - range.begin);
  };
  CHECK(members[1].key == "nodes");
  CHECK(value(0) == R"([1,"]}",{"b":"\\\"]"}])");
  CHECK(value(1) == R"([ {"extras":{         }} ,2,[3]])");
  CHECK(value(2) == "[   ]");
  CHECK(value(3) == R"("\\")");

  JsonElements elements(text, members[1].value);
  std::vector<std::string> found;
  for (uint64_t first = 0;; ++first) {
    const auto batch = must(elements.next(1));
    if (batch.count == 0) break;
    CHECK(batch.count == 1);
    CHECK(batch.first == first);
    found.push_back(text.substr(batch.elements.begin, batch.elements.end - batch.elements.begin));
  }
  CHECK(found == std::vector<std::string>{R"({"extras":{         }})", "2", "[3]"});
  JsonElements together(text, members[1].value);
  CHECK(together.next(1 << 20)->count == 3);

  for (const char* bad : {"", "{", "}", "[]", "{]", "{\"a\"}", "{\"a\":}", "{\"a\":1,}", "{,}", "{\"a\" 1}",
                          "{\"a\":1 2}", "{\"a\":[}", "{\"a\":1}}", "{\"a\":\"", "{\"a\":\"\\\"}", "{a:1}",
                          "{\"a\":1,\"a\":2}", "{\"a\":1,\"\\u0061\":2}", "{\"a\\q\":1}"}) {
    std::string copy = bad;
    INFO(bad);
    CHECK_FALSE(split_document(copy));
  }
}

TEST_CASE("a read past the end of a source is refused with both sizes", "[uri]") {
  const tests::TempFolder folder;
  const auto file = must(open_file_source(folder.write("eight", std::string_view("8 bytes."))));
  for (const auto& [source, end] : {std::pair(file, "the file has 8"),
                                    std::pair(memory_source(std::vector<std::byte>(8)), "the data: URI has 8")}) {
    std::array<std::byte, 4> out{};
    CHECK(source->read(4, out));
    check_refusal(source->read(5, out), ErrorCode::kTruncated, std::string("read of 4 bytes at 5, but ") + end);
    check_refusal(source->read(~uint64_t{0}, out), ErrorCode::kTruncated, end);
  }
}

}  // namespace
}  // namespace scree::convert
