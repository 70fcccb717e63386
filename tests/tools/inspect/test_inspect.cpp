#include <cstdio>
#include <cstring>
#include <filesystem>
#include <functional>
#include <new>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/format/jpeg/jpeg_maker.h"
#include "tests/models.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/packed_file.h"
#include "tools/common/output/text_table.h"
#include "tools/convert/encode/encode.h"
#include "tools/inspect/inspect.h"
#include "tools/inspect/verify.h"

namespace scree {
namespace {

using nlohmann::json;

std::filesystem::path small_model() {
  return tests::data_path("textured_cube.glb");
}

/// Bytes with the alignment that Container::open needs.
class AlignedBytes {
 public:
  explicit AlignedBytes(const std::string& bytes)
      : size_(bytes.size()),
        data_(static_cast<std::byte*>(::operator new (bytes.size(), std::align_val_t{format::kPageAlignment}))) {
    std::memcpy(data_, bytes.data(), size_);
  }
  AlignedBytes(const AlignedBytes&) = delete;
  AlignedBytes& operator=(const AlignedBytes&) = delete;
  ~AlignedBytes() { ::operator delete (data_, std::align_val_t{format::kPageAlignment}); }
  std::span<std::byte> bytes() const { return {data_, size_}; }

 private:
  size_t size_;
  std::byte* data_;
};

/// The output of inspect_file, and its result.
std::pair<std::string, Result<void>> inspect_text(const std::string& path, const inspect::InspectOptions& options) {
  std::FILE* out = std::tmpfile();
  REQUIRE(out != nullptr);
  Result<void> result = inspect::inspect_file(path, options, out);
  std::string text;
  std::rewind(out);
  char block[4096];
  for (size_t got = 0; (got = std::fread(block, 1, sizeof block, out)) > 0;) text.append(block, got);
  std::fclose(out);
  return {text, result};
}

/// All tables of a file, as a set that can be changed and written again.
format::TableSet tables_of(const format::Container& file) {
  format::TableSet tables;
  const auto copy = [](const auto& from, auto& to) {
    for (uint64_t i = 0; i < from.size(); ++i) to.push_back(from[i]);
  };
  const auto name = [&](uint32_t& offset) { offset = tables.strings.add(file.string(offset)); };
  copy(file.meshes(), tables.meshes);
  copy(file.chunks(), tables.chunks);
  copy(file.groups(), tables.groups);
  copy(file.nodes(), tables.nodes);
  copy(file.instances(), tables.instances);
  copy(file.matrices(), tables.matrices);
  copy(file.node_instances(), tables.node_instances);
  copy(file.materials(), tables.materials);
  copy(file.textures(), tables.textures);
  copy(file.images(), tables.images);
  copy(file.mip_levels(), tables.mip_levels);
  copy(file.cameras(), tables.cameras);
  copy(file.scenes(), tables.scenes);
  copy(file.scene_roots(), tables.scene_roots);
  copy(file.left_out(), tables.left_out);
  copy(file.left_out_costs(), tables.left_out_costs);
  tables.source = file.source();
  for (auto& record : tables.groups) name(record.name);
  for (auto& record : tables.nodes) name(record.name);
  for (auto& record : tables.materials) name(record.name);
  for (auto& record : tables.textures) name(record.name);
  for (auto& record : tables.images) name(record.name);
  for (auto& record : tables.cameras) name(record.name);
  for (auto& record : tables.scenes) name(record.name);
  for (auto& record : tables.left_out) name(record.what);
  for (uint32_t* offset :
       {&tables.source.name, &tables.source.options, &tables.source.generator, &tables.source.copyright})
    name(*offset);
  return tables;
}

using Change = std::function<void(format::TableSet&, std::vector<std::vector<std::byte>>& pages)>;

/// Writes `file` to `path` again with correct checksums, after `change` has modified the tables and raw pages.
void rewrite(const format::Container& file, const std::string& path, const Change& change) {
  format::TableSet tables = tables_of(file);
  std::vector<std::vector<std::byte>> pages;
  std::vector<std::byte> scratch;
  for (uint32_t i = 0; i < file.pages().size(); ++i) {
    const auto raw = must(file.load_page(i, scratch));
    pages.emplace_back(raw.begin(), raw.end());
  }
  change(tables, pages);
  auto writer = must(format::ContainerWriter::create(path));
  for (uint32_t i = 0; i < pages.size(); ++i)
    REQUIRE(writer.append(format::seal_page(file.pages()[i].kind, pages[i], 0)));
  REQUIRE(writer.finish(tables));
}

/// The failures of a file with valid tables.
std::vector<std::string> failures_of(const std::string& path) {
  const auto packed = must(tests::open_packed(path));
  const inspect::VerifyReport report = inspect::verify(packed.file, packed.map.bytes(), 2);
  std::vector<std::string> lines;
  for (const auto& failure : report.failures) lines.push_back(failure.error.message);
  return lines;
}

bool mentions(const std::vector<std::string>& lines, const std::string& words) {
  for (const std::string& line : lines)
    if (line.find(words) != std::string::npos) return true;
  return false;
}

uint64_t sum_of(const json& list, const char* member) {
  uint64_t sum = 0;
  for (const json& entry : list) sum += entry.at(member).get<uint64_t>();
  return sum;
}

/// Checks that every byte of the file is counted in exactly one row, and that the parts of every table add up to its
/// total.
void check_totals(const std::string& path, const json& report) {
  const uint64_t file_bytes = std::filesystem::file_size(path);
  CHECK(report.at("file").at("bytes") == file_bytes);
  uint64_t sum = 0, streams = 0;
  double share = 0;
  for (const auto& [kind, row] : report.at("size").items()) {
    if (kind == "total") continue;
    sum += row.at("bytes").get<uint64_t>();
    share += row.at("share").get<double>();
    if (kind != "textures" && kind != "container") streams += row.at("bytes").get<uint64_t>();
  }
  CHECK(sum == file_bytes);
  CHECK(share == Approx(1.0));
  CHECK(report.at("size").at("total").at("bytes") == file_bytes);

  const json& container = report.at("container");
  CHECK(container.at("header_bytes").get<uint64_t>() + container.at("toc_bytes").get<uint64_t>() +
            sum_of(container.at("tables"), "bytes") + container.at("page_gap_bytes").get<uint64_t>() +
            container.at("other_page_bytes").get<uint64_t>() + container.at("padding_bytes").get<uint64_t>() ==
        container.at("bytes").get<uint64_t>());
  CHECK(container.at("bytes") == report.at("size").at("container").at("bytes"));

  const json& meshes = report.at("meshes");
  CHECK(meshes.at("bytes") == streams);
  CHECK(sum_of(meshes.at("top"), "bytes") == streams);  // all meshes are listed
  CHECK(sum_of(meshes.at("top"), "triangles") == meshes.at("triangles").get<uint64_t>());
  const json& clusters = report.at("clusters");
  CHECK(sum_of(report.at("index_bits"), "triangles") + clusters.at("triangles").get<uint64_t>() ==
        meshes.at("triangles").get<uint64_t>());
  CHECK(sum_of(report.at("index_bits"), "chunks") + clusters.at("chunks").get<uint64_t>() ==
        report.at("chunks").at("count").get<uint64_t>());
  CHECK(sum_of(report.at("position_steps"), "bytes") == report.at("size").at("positions").at("bytes").get<uint64_t>());
  CHECK(sum_of(report.at("chunk_rows"), "triangles") == meshes.at("triangles").get<uint64_t>());
  CHECK(report.at("textures").at("jpeg").at("bytes").get<uint64_t>() +
            report.at("textures").at("indexed_jpeg").at("bytes").get<uint64_t>() +
            report.at("textures").at("png").at("bytes").get<uint64_t>() +
            report.at("textures").at("mask_bytes").get<uint64_t>() ==
        report.at("size").at("textures").at("bytes").get<uint64_t>());
}

}  // namespace

TEST_CASE("inspect: the rows account for every byte of the file", "[inspect]") {
  std::vector<std::filesystem::path> models = tests::model_files(tests::kDataFolder);
  REQUIRE(!models.empty());
  if (const auto real = tests::models_path(); !real.empty()) {
    for (const char* name : {"scenes/building/building.glb", "scenes/InstanceTest/InstanceTest.glb",
                             "scenes/BoxVertexColors/BoxVertexColors.glb"})
      models.push_back(real / name);
  } else {
    WARN("skipped: the real models are missing");
  }
  size_t packed_count = 0;
  for (const auto& model : models) {
    for (const int zstd : {0, 3}) {
      INFO(model.string() << ", zstd " << zstd);
      const tests::TempFolder folder;
      convert::ConvertOptions options;
      options.zstd_level = zstd;
      options.encoding = zstd == 0 ? convert::Encoding::kIndexed : convert::Encoding::kClustered;
      options.normals = convert::Normals::kAlways;
      options.source_ids = zstd != 0;
      options.chunk_triangles = 1000;
      const std::string path = folder.file("a.scree");
      if (const auto packed = tests::pack(model.string(), path, options); !packed) continue;
      ++packed_count;
      const auto [text, result] = inspect_text(path, {true, true, true, 0xffffffffu, 2, false});
      CHECK(result);
      json report;
      REQUIRE_NOTHROW(report = json::parse(text));
      CHECK(report.at("verify").at("ok") == true);
      check_totals(path, report);
    }
  }
  CHECK(packed_count >= 2);
}

TEST_CASE("inspect: the bytes of duplicate vertices in clusters are unknown", "[inspect][lean]") {
  const tests::TempFolder folder;
  tests::make_model(folder.file("in.glb"), {.indexed = false});
  for (const convert::Encoding encoding : {convert::Encoding::kIndexed, convert::Encoding::kClustered}) {
    convert::ConvertOptions options;
    options.encoding = encoding;
    REQUIRE(tests::pack(folder.file("in.glb"), folder.file("a.scree"), options));
    const auto [text, result] = inspect_text(folder.file("a.scree"), {true, false, false, 10, 2, false});
    REQUIRE(result);
    bool is_listed = false;
    const json report = json::parse(text);
    for (const json& entry : report.at("left_out")) {
      if (entry.at("what") != "duplicate vertices") continue;
      is_listed = true;
      CHECK(entry.at("count") == 96 - 25);
      CHECK(entry.contains("stored_bytes") == (encoding == convert::Encoding::kIndexed));
    }
    CHECK(is_listed);
  }
  // A sum is known only if all of its terms are.
  convert::Welded sum{1, 12, 48};
  sum.add({1, 12, 40});
  CHECK(sum.cost_bits == 88);
  sum.add({1, 12, convert::Welded::kUnknownCost});
  sum.add({1, 12, 40});
  CHECK(sum.cost_bits == convert::Welded::kUnknownCost);
}

TEST_CASE("inspect: --verify finds a flipped bit in every byte", "[inspect][verify]") {
  const tests::TempFolder folder;
  for (const int zstd : {0, 3}) {
    convert::ConvertOptions options;
    options.zstd_level = zstd;
    options.normals = convert::Normals::kAlways;
    options.source_ids = true;
    const std::string path = folder.file("a.scree");
    REQUIRE(tests::pack(small_model().string(), path, options));
    const AlignedBytes copy(tests::read_whole(path));
    const std::span<std::byte> bytes = copy.bytes();
    REQUIRE(inspect::verify(must(format::Container::open(bytes)), bytes, 1).failure_count == 0);
    std::vector<size_t> missed;
    for (size_t i = 0; i < bytes.size(); ++i) {
      const std::byte bit{static_cast<uint8_t>(1u << (i * 5 % 8))};
      bytes[i] ^= bit;
      const auto opened = format::Container::open(bytes);
      if (opened && inspect::verify(*opened, bytes, 1).failure_count == 0) missed.push_back(i);
      bytes[i] ^= bit;
    }
    INFO("zstd " << zstd << ", " << bytes.size() << " bytes, first missed " << (missed.empty() ? 0 : missed.front()));
    CHECK(missed.empty());
  }
}

TEST_CASE("inspect: --verify finds damage that checksums cannot", "[inspect][verify]") {
  const tests::TempFolder folder;
  convert::ConvertOptions options;
  options.encoding = convert::Encoding::kIndexed;
  const auto packed = must(tests::pack(small_model().string(), folder.file("a.scree"), options));
  const format::Container& file = packed.file;
  const std::string path = folder.file("b.scree");

  rewrite(file, path, [](auto&, auto&) {});
  CHECK(failures_of(path).empty());

  rewrite(file, path, [](format::TableSet& tables, auto&) { tables.meshes[0].bounds_max[1] += 1; });
  CHECK(mentions(failures_of(path), "mesh 0: bounds"));

  const uint32_t page = file.chunks()[0].page;
  rewrite(file, path, [&](format::TableSet&, auto& pages) {
    pages[page].resize(pages[page].size() + 64);
    pages[page][pages[page].size() - 3] = std::byte{7};
  });
  CHECK(mentions(failures_of(path), "in no chunk: found 7"));

  // Errors in an index stream: an index past the vertices, and slack that is not zero.
  rewrite(file, path, [&](format::TableSet& tables, auto& pages) {
    for (size_t i = 0; i < 16; ++i) pages[page][tables.chunks[0].offset + i] = std::byte{0xff};
  });
  CHECK(mentions(failures_of(path), "chunk 0 (page " + std::to_string(page) + ", byte 0): indices"));

  REQUIRE(!file.images().empty());
  rewrite(file, path, [](format::TableSet& tables, auto&) { tables.images[0].width += 1; });
  CHECK(mentions(failures_of(path), "image 0: is "));

  rewrite(file, path, [&](format::TableSet&, auto& pages) {
    auto& image = pages[file.images()[0].page];
    image.resize(image.size() / 2);
  });
  CHECK(mentions(failures_of(path), "image 0"));
}

TEST_CASE("inspect: --verify decodes every level of an indexed JPEG", "[inspect][verify][jpeg]") {
  const tests::TempFolder folder;
  tests::make_model(folder.file("a.glb"), [&](tests::ModelMaker& maker) {
    const uint32_t material =
        maker.textured("bark", format::ImageCodec::kJpeg,
                       tests::make_jpeg({.width = 300, .height = 150, .factors = {{2, 2}, {1, 1}, {1, 1}}}));
    maker.draw("a", {maker.grid({.uv = true}, material)});
  });
  const auto packed = must(tests::pack(folder.file("a.glb"), folder.file("a.scree")));
  const format::Container& file = packed.file;
  REQUIRE(file.mip_levels().size() == 2);
  const uint32_t base = file.images()[0].page, levels = file.mip_levels()[0].page;
  const std::string path = folder.file("b.scree");
  rewrite(file, path, [](auto&, auto&) {});
  CHECK(failures_of(path).empty());

  // The last byte of the anchors: a group then begins at another bit.
  const auto spoil = [](std::vector<std::byte>& bytes, size_t end) {
    for (size_t i = end; i-- > 0;) {
      if (bytes[i] == std::byte{0}) continue;
      bytes[i] ^= std::byte{1};
      return;
    }
  };
  rewrite(file, path, [&](format::TableSet&, auto& pages) { spoil(pages[base], pages[base].size()); });
  CHECK(mentions(failures_of(path), "image 0: indexed JPEG: "));
  rewrite(file, path,
          [&](format::TableSet& tables, auto& pages) { spoil(pages[levels], tables.mip_levels[1].offset); });
  CHECK(mentions(failures_of(path), "image 0, level 1: indexed JPEG: "));
  rewrite(file, path, [&](format::TableSet&, auto& pages) { pages[levels].resize(pages[levels].size() + 16); });
  CHECK(mentions(failures_of(path), "but its mip levels end at byte "));
  rewrite(file, path, [&](format::TableSet& tables, auto&) { tables.images[0].channels = 1; });
  CHECK(mentions(failures_of(path), "image 0: indexed JPEG: is 300 x 150 x 3, expected 300 x 150 x 1"));
  rewrite(file, path, [&](format::TableSet& tables, auto&) { tables.mip_levels[1] = tables.mip_levels[0]; });
  CHECK(mentions(failures_of(path), "image 0, level 2: begins at byte 0"));
}

TEST_CASE("inspect: a failure is printed and ends in an error", "[inspect][verify]") {
  const tests::TempFolder folder;
  const std::string path = folder.file("a.scree");
  REQUIRE(tests::pack(small_model().string(), path));
  const uint64_t offset = must(tests::open_packed(path)).file.pages()[0].offset;
  const std::string bad = folder.write("bad.scree", tests::read_whole(path));
  tests::damage(bad, offset + 5);

  const auto [text, result] = inspect_text(bad, {false, true, false, 10, 2, false});
  REQUIRE(!result);
  CHECK(exit_code(result.error().code) == 3);
  CHECK(result.error().message.find(bad + ": page 0 at byte " + std::to_string(offset)) != std::string::npos);
  CHECK(text.find("FAILED page 0") != std::string::npos);

  const auto [json_text, json_result] = inspect_text(bad, {true, true, false, 10, 2, false});
  CHECK(!json_result);
  const json report = json::parse(json_text);
  CHECK(report.at("verify").at("ok") == false);
  CHECK(report.at("verify").at("failures").at(0).at("offset") == offset);

  const auto [no_text, missing] = inspect_text(folder.file("missing.scree"), {});
  REQUIRE(!missing);
  CHECK(missing.error().code == ErrorCode::kFile);
  const auto [none, foreign] = inspect_text(folder.write("c.scree", "not a scree file"), {});
  REQUIRE(!foreign);
  CHECK(exit_code(foreign.error().code) == 3);
}

TEST_CASE("inspect: names cannot damage the JSON or the terminal", "[inspect]") {
  const tests::TempFolder folder;
  const auto packed = must(tests::pack(small_model().string(), folder.file("a.scree")));
  const std::string name = "a \"b\" \\ \n\t\x1b[31m red \x7f \xc3\xbc \xe5\xb1\xb1 \xf0\x9f\xaa\xa8";
  const std::string path = folder.file("b.scree");
  rewrite(packed.file, path, [&](format::TableSet& tables, auto&) {
    tables.groups[0].name = tables.strings.add(name);
    tables.scenes[0].name = tables.strings.add("\xff\xfe bad");
  });
  const auto [text, result] = inspect_text(path, {true, false, true, 10, 1, false});
  CHECK(result);
  CHECK(json::parse(text).at("meshes").at("top").at(0).at("name") == name);
  const auto [plain, plain_result] = inspect_text(path, {});
  CHECK(plain_result);
  CHECK(plain.find('\x1b') == std::string::npos);
  CHECK(plain.find("a \"b\" \\ ??") != std::string::npos);
}

TEST_CASE("inspect: columns are aligned", "[inspect]") {
  inspect::TextTable table;
  table.row({"name", "bytes"});
  table.row({"\xc3\xa4\xc3\xb6", "7"});
  table.rule();
  table.row({"long name", "1,234"});
  CHECK(table.text() ==
        "  name       bytes\n"
        "  \xc3\xa4\xc3\xb6             7\n"
        "  ----------------\n"
        "  long name  1,234\n");
  CHECK(inspect::printable("abcdefgh", 6) == "abc...");
  CHECK(inspect::printable("\xc3\xa4\xc3\xb6\xc3\xbc\xc3\x9f", 4) == "\xc3\xa4\xc3\xb6\xc3\xbc\xc3\x9f");
  CHECK(inspect::printable("a\x01\xc2\x9b\xff", 10) == "a???");
}

}  // namespace scree
