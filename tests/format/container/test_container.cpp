// The container as a whole: written data is read back; cut, lengthened and flipped files are refused; versions.
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <limits>
#include <random>

#include "format/bytes.h"
#include "format/container/checksum.h"
#include "format/container/container.h"
#include "format/geometry/chunk_layout.h"
#include "tests/format/container/container_fixture.h"
#include "tests/format/geometry/spec_vectors.h"
#include "tests/results.h"
#include "tests/speed.h"

namespace scree::tests {
namespace {

using namespace scree::format;

/// Whether a table of an opened file has exactly these records.
template <class Record>
bool same(const Table<Record>& table, const std::vector<Record>& records) {
  if (table.size() != records.size()) return false;
  for (size_t i = 0; i < records.size(); ++i)
    if (std::memcmp(&table[i], &records[i], sizeof(Record)) != 0) return false;
  return true;
}

TEST_CASE("checksums of the spec", "[container][spec]") {
  for (const auto& vector : spec_vectors("checksum.txt")) {
    INFO(vector.text("name"));
    const std::vector<std::byte> bytes = vector.bytes("bytes");
    const uint64_t expected = std::stoull(vector.text("checksum"), nullptr, 16);
    CHECK(checksum(bytes) == expected);
    Checksum parts;  // of the same bytes in two pieces
    parts.add(std::span(bytes).first(bytes.size() / 3));
    parts.add(std::span(bytes).subspan(bytes.size() / 3));
    CHECK(parts.value() == expected);
  }
}

TEST_CASE("container: every table and page is read as it was written", "[container]") {
  const Parts parts = full_parts();
  const Bytes bytes = file_of(parts);
  const ExactCopy file(bytes);
  const auto opened = must(Container::open(file.bytes()));
  const Container& container = opened;
  const TableSet& tables = parts.tables;
  CHECK(same(container.meshes(), tables.meshes));
  CHECK(same(container.chunks(), tables.chunks));
  CHECK(same(container.groups(), tables.groups));
  CHECK(same(container.nodes(), tables.nodes));
  CHECK(same(container.instances(), tables.instances));
  CHECK(same(container.matrices(), tables.matrices));
  CHECK(same(container.node_instances(), tables.node_instances));
  CHECK(same(container.materials(), tables.materials));
  CHECK(same(container.textures(), tables.textures));
  CHECK(same(container.images(), tables.images));
  CHECK(same(container.cameras(), tables.cameras));
  CHECK(same(container.scenes(), tables.scenes));
  CHECK(same(container.scene_roots(), tables.scene_roots));
  CHECK(same(container.left_out(), tables.left_out));
  CHECK(same(container.left_out_costs(), tables.left_out_costs));
  CHECK(std::memcmp(&container.source(), &tables.source, sizeof tables.source) == 0);
  CHECK(container.string(tables.groups[0].name) == "boulder");
  CHECK(container.string(container.images()[0].name) == "moss.png");
  CHECK(container.string(0).empty());
  CHECK(container.string_is(tables.groups[0].name, "boulder"));
  for (const char* other : {"", "boulde", "boulders", "boulder moss.png and a text that passes the end of the table"})
    CHECK_FALSE(container.string_is(tables.groups[0].name, other));
  CHECK_FALSE(container.string_is(tables.groups[0].name, std::string_view("boulder\0", 8)));
  CHECK(container.string_is(0, ""));
  CHECK(container.header().file_bytes == bytes.size());

  REQUIRE(container.pages().size() == parts.pages.size());
  Bytes scratch;
  for (uint32_t i = 0; i < parts.pages.size(); ++i) {
    CHECK(container.pages()[i].offset % kPageAlignment == 0);
    const auto stored = container.stored_page(i);
    CHECK(std::ranges::equal(stored, parts.pages[i].stored));
    const auto raw = must(container.load_page(i, scratch));
    CHECK(raw.size() == parts.pages[i].record.raw_bytes);
    CHECK(reinterpret_cast<uintptr_t>(raw.data()) % kChunkAlignment == 0);
  }
  CHECK(parts.pages[0].record.codec == PageCodec::kRaw);
  REQUIRE(parts.pages[1].record.codec == PageCodec::kZstd);
  const auto raw = container.load_page(1, scratch);
  for (size_t i = 0; i < raw->size(); ++i) REQUIRE((*raw)[i] == static_cast<std::byte>(i / 16));
  CHECK(refusal(container.load_page(3, scratch)).message == "page 3, but the file has 3 pages");
}

TEST_CASE("container: the same pages and tables give the same bytes", "[container]") {
  CHECK(file_of(full_parts()) == file_of(full_parts()));
}

TEST_CASE("container: a file with empty tables is valid", "[container]") {
  const Bytes file = file_of({});
  const ExactCopy copy(file);
  const auto container = must(Container::open(copy.bytes()));
  CHECK(container.pages().empty());
  CHECK(container.scenes().empty());
  CHECK(container.meshes().empty());
  CHECK(container.string(container.source().name).empty());
}

TEST_CASE("container: every prefix and one byte too many are refused", "[container]") {
  const Bytes file = file_of(tiny_parts());
  REQUIRE(!verify_copy(file));
  for (size_t size = 0; size < file.size(); ++size)
    CHECK(must(verify_copy(std::span(file).first(size))).code == ErrorCode::kTruncated);
  Bytes longer = file;
  longer.push_back(std::byte{0});
  CHECK(must(verify_copy(longer)).code == ErrorCode::kTrailing);
}

TEST_CASE("container: a flipped bit anywhere is found", "[container]") {
  // Every bit of the small file, one bit of every byte of the larger one.
  for (const bool small : {true, false}) {
    ExactCopy file(file_of(small ? tiny_parts() : full_parts()));
    REQUIRE(!verify(file.bytes()));
    for (size_t i = 0; i < file.bytes().size(); ++i) {
      for (size_t bit = 0; bit < 8; ++bit) {
        if (!small && bit != i % 8) continue;
        const std::byte flip = std::byte{1} << bit;
        file[i] ^= flip;
        if (!verify(file.bytes())) FAIL("byte " << i << " bit " << bit);
        file[i] ^= flip;
      }
    }
  }
}

TEST_CASE("container: no byte behind the end is read", "[container]") {
  Bytes file = file_of(tiny_parts());
  REQUIRE(file.size() % kTableAlignment == 0);  // otherwise it could not both be aligned and end at the guard page
  const size_t page = static_cast<size_t>(::sysconf(_SC_PAGESIZE));
  const size_t mapped = align_up(file.size(), page);
  void* const map = ::mmap(nullptr, mapped + page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  REQUIRE(map != MAP_FAILED);
  std::byte* const end = static_cast<std::byte*>(map) + mapped;
  REQUIRE(::mprotect(end, page, PROT_NONE) == 0);
  std::byte* const first = end - file.size();
  std::memcpy(first, file.data(), file.size());
  CHECK(!verify({first, file.size()}));
  ::munmap(map, mapped + page);
}

TEST_CASE("container: newer versions are refused or read by the rules", "[container]") {
  const Bytes file = file_of(full_parts());
  SECTION("the fixture lays a file out as the writer does") {
    CHECK(RawFile(file).build() == file);
  }
  SECTION("a newer major is refused before anything else is read") {
    RawFile raw(file);
    raw.version_major = kSecondMajor + 1;
    Bytes newer = raw.build();
    newer[60] ^= std::byte{1};
    const auto error = must(verify_copy(newer));
    CHECK(error.code == ErrorCode::kVersion);
    CHECK(error.message == "the file has version 3.0, but this program reads versions 1 and 2");
  }
  SECTION("second texture coordinates and tangents need the second major") {
    const auto errors = [&](uint16_t major) {
      std::vector<std::string> found;
      Parts parts = full_parts();
      SurfaceRecord surface{.roughness = 1, .ior = 1.5f, .specular = 1, .second_uv = 1};
      for (SurfaceTexture& use : surface.textures) use = {kNone, {0, 0}, {1, 1}, 0};
      const auto add = [&](const Bytes& bytes) {
        RawFile raw(bytes);
        raw.version_major = major;
        raw.version_minor = 0;
        const auto error = verify_copy(raw.build());
        found.push_back(error ? error->message : "");
      };
      for (const uint32_t attributes : {16u, 32u}) {
        Bytes changed =
            patched<MeshRecord>(file, TableKind::kMeshes, 0, [&](MeshRecord& mesh) { mesh.attributes |= attributes; });
        add(changed);
      }
      parts.tables.surfaces = {surface};
      add(file_of(parts));
      return found;
    };
    const std::vector<std::string> first = errors(kVersionMajor), second = errors(kSecondMajor);
    CHECK(first == std::vector<std::string>{"mesh 0: attributes 31", "mesh 0: attributes 47",
                                            "surface 0: second uv of textures 1"});
    REQUIRE(second.size() == 3);
    CHECK(second[0].starts_with("chunk 0: "));  // the chunk's bytes lack the stream
    CHECK(second[1].starts_with("chunk 0: 0 tangent bits, expected 3 to 16"));
    CHECK(second[2].empty());
  }
  SECTION("a newer minor may have longer records, unknown tables and unknown pages") {
    RawFile raw(file);
    raw.version_minor = kVersionMinor + 1;
    for (RawTable& table : raw.tables) {
      if (table.kind == TableKind::kStrings) continue;
      const uint32_t longer = table.record_bytes + 8;
      Bytes bytes;
      for (size_t at = 0; at < table.bytes.size(); at += table.record_bytes) {
        bytes.insert(bytes.end(), table.bytes.begin() + static_cast<ptrdiff_t>(at),
                     table.bytes.begin() + static_cast<ptrdiff_t>(at + table.record_bytes));
        bytes.resize(bytes.size() + 8, std::byte{0xa5});
      }
      table.record_bytes = longer;
      table.bytes = bytes;
    }
    for (const uint32_t kind : {99u, 1000u, 1000u})
      raw.tables.insert(raw.tables.begin() + 3, {static_cast<TableKind>(kind), 3, Bytes(9, std::byte{7})});
    Bytes newer = patched<PageRecord>(raw.build(), TableKind::kPages, 2, [](PageRecord&) {});
    const ExactCopy copy(newer);
    const auto container = must(Container::open(copy.bytes()));
    CHECK(same(container.chunks(), full_parts().tables.chunks));
    CHECK(same(container.scene_roots(), full_parts().tables.scene_roots));
    CHECK(!verify(copy.bytes()));

    const size_t unknown = toc_entry_offset(newer, static_cast<TableKind>(99));
    newer[load<TocEntry>(newer.data() + unknown).offset] ^= std::byte{1};
    CHECK(must(verify_copy(newer)).message == "table 5 of kind 99: the checksum differs");
  }
  SECTION("longer records of our own minor are refused") {
    RawFile raw(file);
    RawTable& table = raw.table(TableKind::kScenes);
    table.record_bytes += 48;
    CHECK(must(verify_copy(raw.build())).message == "scene table: records of 96 bytes, expected 48");
  }
  SECTION("longer records keep 64-bit fields aligned") {
    RawFile raw(file);
    raw.version_minor = kVersionMinor + 1;
    RawTable& table = raw.table(TableKind::kSource);
    table.record_bytes += 4;
    table.bytes.resize(table.record_bytes);
    CHECK(must(verify_copy(raw.build())).message == "source table: records of 68 bytes, expected a multiple of 8");
  }
  SECTION("a page of an unknown kind is kept and checked, and nothing may use it") {
    Parts parts = full_parts();
    parts.pages.push_back(seal_page(static_cast<PageKind>(77), Bytes(5000), 3));
    Bytes newer = file_of(parts);
    CHECK(!verify_copy(newer));
    CHECK(must(verify_copy(patched<ChunkRecord>(newer, TableKind::kChunks, 0, [](ChunkRecord& chunk) {
            chunk.page = 3;
          }))).message == "chunk 0: page 3 is of kind 77, which holds no chunks");
  }
}

TEST_CASE("container: offsets of the streams of a chunk", "[container]") {
  const Parts parts = full_parts();
  const ChunkStreams all = chunk_streams(parts.tables.meshes[0], parts.tables.chunks[0]);
  CHECK(all.indices.offset == 0);
  CHECK(all.indices.bytes == 272);  // 300 x 7 bits = 263 bytes, 8 of slack
  CHECK(all.positions.offset == 272);
  CHECK(all.positions.bytes == 448);  // 90 x 39 bits = 439 bytes
  CHECK(all.uvs.offset == 720);
  CHECK(all.uvs.bytes == 464);  // 90 x 40 bits = 450 bytes
  CHECK(all.colors.offset == 1184);
  CHECK(all.colors.bytes == 368);  // 360
  CHECK(all.normals.offset == 1552);
  CHECK(all.normals.bytes == 192);  // 90 x 16 bits = 180 bytes
  CHECK(all.source_ids.offset == 1744);
  CHECK(all.source_ids.bytes == 128);  // 100 x 9 bits = 113 bytes
  CHECK(all.bytes == 1872);
  CHECK(chunk_streams(parts.tables.meshes[1], parts.tables.chunks[2]).positions.bytes == 1200);

  const MeshRecord mesh{.attributes = ~0u};
  ChunkRecord chunk;
  std::memset(&chunk, 0xff, sizeof chunk);
  CHECK(chunk_streams(mesh, chunk).bytes < uint64_t{1} << 41);  // the widest fields do not overflow
}

/// A file with `count` records in each of the large tables. They refer to each other in order, as convert writes them,
/// or shuffled.
Bytes large_file(uint32_t count, bool is_shuffled) {
  Parts parts = tiny_parts();
  TableSet& tables = parts.tables;
  const auto repeat = [&](auto& records) { records.resize(count, records[0]); };
  repeat(tables.meshes);
  repeat(tables.chunks);
  repeat(tables.groups);
  repeat(tables.nodes);
  repeat(tables.instances);
  repeat(tables.matrices);
  std::vector<uint32_t> order(count);
  for (uint32_t i = 0; i < count; ++i) order[i] = i;
  if (is_shuffled) std::shuffle(order.begin(), order.end(), std::mt19937(1));
  for (uint32_t i = 0; i < count; ++i) {
    tables.meshes[i].first_chunk = i;
    tables.meshes[i].group = i;
    tables.chunks[i].mesh = i;
    tables.groups[i].first_mesh = i;
    tables.nodes[order[i]].group = i;
    tables.instances[i] = {i, order[i], is_shuffled ? order[count - 1 - i] : i, 0};
  }
  tables.scenes[0].instance_count = count;
  tables.scenes[0].triangle_count = count;
  return file_of(parts);
}

TEST_CASE("container: large tables, checked in parts, give the same errors as small ones", "[container]") {
  constexpr uint32_t kCount = 3000;  // 1.5 MB of records, several parts
  const Bytes good = large_file(kCount, true);
  CHECK(!verify_copy(good));
  const auto message = [](const Bytes& file) {
    const auto error = verify_copy(file);
    return error ? error->message : "none";
  };
  const uint32_t place = GENERATE(0u, 1u, 511u, 1700u, kCount - 1);
  const std::string number = std::to_string(place);

  const Bytes bad_node = patched<NodeRecord>(good, TableKind::kNodes, place, [](NodeRecord& node) { node.camera = 7; });
  CHECK(message(bad_node) == "node " + number + ": camera 7, but the file has 0 cameras");
  // Tables are checked in order. The first bad record is reported even if it comes late in an early table.
  const Bytes bad_mesh =
      patched<MeshRecord>(bad_node, TableKind::kMeshes, kCount - 1, [](MeshRecord& mesh) { mesh.attributes = 64; });
  CHECK(message(bad_mesh) == "mesh 2999: attributes 64");
  CHECK(message(patched<MatrixRecord>(good, TableKind::kMatrices, place, [](MatrixRecord& matrix) {
          matrix.rows[2][3] = -std::numeric_limits<double>::infinity();
        })) == "matrix " + number + ": not finite");
  CHECK(message(patched<MeshRecord>(good, TableKind::kMeshes, place,
                                    [&](MeshRecord& mesh) { mesh.group = place == 0 ? 1 : place - 1; })) ==
        "mesh " + number + ": group " + (place == 0 ? "1" : std::to_string(place - 1)) +
            ", but it is a mesh of group " + number);
  CHECK(message(patched<InstanceRecord>(good, TableKind::kInstances, place, [](InstanceRecord& instance) {
          instance.node_instance = 1;
        })).find("instance " + number + ": node instance 1, but node ") == 0);

  // A flipped bit is reported as a wrong checksum, even if it breaks a rule and later tables have other errors.
  Bytes flipped = bad_mesh;
  flipped[record_offset(flipped, TableKind::kNodes, place) + 8] ^= std::byte{1};
  CHECK(message(flipped) == "node table: the checksum differs");
  flipped[record_offset(flipped, TableKind::kMeshes, place)] ^= std::byte{0x80};
  CHECK(message(flipped) == "mesh table: the checksum differs");
}

/// Processor time of opening a file, in ns per record of the six tables.
double opening_nanoseconds(const ExactCopy& file, uint32_t count) {
  const double start = cpu_seconds();
  must(Container::open(file.bytes()));
  return 1e9 * (cpu_seconds() - start) / (6.0 * count);
}

/// Run it by name: scree_tests "[container-speed]", in a release build.
TEST_CASE("container: speed of opening large tables", "[.][container-speed]") {
  constexpr uint32_t kCount = 1000000;
  for (const bool is_shuffled : {false, true}) {
    const ExactCopy file(large_file(kCount, is_shuffled));
    double best = 1e300;
    for (int round = 0; round < 20; ++round) best = std::min(best, opening_nanoseconds(file, kCount));
    WARN("open: " << best << " ns a record, 6 tables of " << kCount << (is_shuffled ? ", shuffled" : ""));
  }
}

#ifdef NDEBUG
TEST_CASE("speed: a file opens in 20 ns per record", "[speed]") {
  // With more records each attempt would get fresh memory from the kernel. On some virtual machines the kernel then
  // takes 165 ns per record, and opening 10.
  constexpr uint32_t kCount = 30000;
  const ExactCopy file(large_file(kCount, false));
  check_speed(30, 20, [&] { return opening_nanoseconds(file, kCount); });
}
#endif

}  // namespace
}  // namespace scree::tests
