// Streams of ATTRIBUTES of both versions and with all filters, written and decoded by the current meshoptimizer
// (tests/data/meshopt/make_streams.mjs), and real files compared with its decoded bytes.
#include <zlib.h>

#include <cstring>
#include <filesystem>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "tests/models.h"
#include "tests/results.h"
#include "tests/tools/gltf/meshopt/meshopt_streams.h"
#include "tests/tools/gltf/read_all.h"
#include "tests/tools/packed_file.h"
#include "tools/gltf/byte_source.h"
#include "tools/gltf/meshopt/source.h"
#include "tools/gltf/source.h"

namespace scree::convert {
namespace {

using namespace tests;
using Filter = DocMeshopt::Filter;

struct StoredStream {
  DocMeshopt stated;
  Bytes stream;
  uint32_t crc;  // of the decoded bytes
};

std::vector<StoredStream> stored_streams() {
  const std::string file = read_whole(data_path("meshopt/streams.bin").string());
  std::vector<StoredStream> streams;
  for (size_t at = 0; at < file.size();) {
    struct Head {
      uint32_t count, stride, filter, crc, bytes;
    } head;
    std::memcpy(&head, file.data() + at, sizeof(head));
    at += sizeof(head);
    StoredStream stored{.stated = {.filter = static_cast<Filter>(head.filter),
                                   .bytes = head.bytes,
                                   .stride = head.stride,
                                   .count = head.count},
                        .crc = head.crc};
    stored.stream.resize(head.bytes);
    std::memcpy(stored.stream.data(), file.data() + at, head.bytes);
    at += head.bytes;
    streams.push_back(std::move(stored));
  }
  return streams;
}

Result<Bytes> unpacked(const StoredStream& stored, uint64_t window_bytes) {
  const uint64_t bytes = stored.stated.count * stored.stated.stride;
  if (auto checked = check_meshopt(stored.stated, bytes, 0); !checked) return checked.error();
  const MeshoptCache cache(0, window_bytes);
  const auto view = cache.view(stored.stated, memory_source(stored.stream));
  Bytes out(bytes);
  if (auto read = view->read(0, out); !read) return read.error();
  return out;
}

uint32_t crc_of(const Bytes& bytes) {
  return static_cast<uint32_t>(
      crc32(0, reinterpret_cast<const unsigned char*>(bytes.data()), static_cast<unsigned>(bytes.size())));
}

/// The bytes of every accessor of a scene's primitives, by kind, in the order of the primitives.
std::vector<std::vector<float>> values_of(const SourceScene& scene) {
  std::vector<std::vector<float>> out;
  for (const Primitive& primitive : scene.primitives) {
    const std::vector<uint32_t> corners = all_corners(primitive);
    out.emplace_back(corners.begin(), corners.end());
    for (const Accessor* const accessor : accessors_of(primitive)) out.push_back(all_values(*accessor));
  }
  return out;
}

}  // namespace

TEST_CASE("meshopt streams of both versions decode to the current library's bytes", "[meshopt]") {
  const std::vector<StoredStream> streams = stored_streams();
  std::map<uint32_t, uint32_t> versions, filters;
  for (const StoredStream& stored : streams) {
    const uint32_t version = std::to_integer<uint32_t>(stored.stream[0]) & 15;
    ++versions[version];
    ++filters[static_cast<uint32_t>(stored.stated.filter)];
    INFO(stored.stated.count << " x " << stored.stated.stride << " bytes, filter "
                             << static_cast<int>(stored.stated.filter) << ", version " << version);
    for (const uint64_t window : {MeshoptCache::kWindowBytes, uint64_t{1}}) {  // all at once, block by block
      CHECK(crc_of(must(unpacked(stored, window))) == stored.crc);
    }
  }
  CHECK(versions[0] >= 10);
  CHECK(versions[1] >= 90);
  CHECK(filters.size() == 5);
}

TEST_CASE("meshopt streams of version 1 that are cut, too long or damaged are refused or decoded", "[meshopt]") {
  std::mt19937 random(8);
  for (const StoredStream& stored : stored_streams()) {
    if ((stored.stream[0] & std::byte{15}) == std::byte{0}) continue;
    const auto with = [&](Bytes stream) {
      StoredStream other = stored;
      other.stream = std::move(stream);
      other.stream.shrink_to_fit();
      other.stated.bytes = other.stream.size();
      return other;
    };
    const size_t size = stored.stream.size();
    for (size_t cut = 0; cut < size; cut += cut < 16 || cut + 16 > size ? 1 : 1 + size / 23)
      CHECK_FALSE(unpacked(with(Bytes(stored.stream.begin(), stored.stream.begin() + static_cast<ptrdiff_t>(cut))), 1));
    Bytes longer = stored.stream;
    longer.insert(longer.begin() + 1, std::byte{0});
    const auto refused = unpacked(with(longer), 1);
    if (refused) CHECK(crc_of(*refused) != stored.crc);
    for (int round = 0; round < 40; ++round) {
      Bytes damaged = stored.stream;
      for (uint32_t i = 0; i <= random() % 4; ++i)
        damaged[1 + random() % (size - 1)] = static_cast<std::byte>(random());
      const auto bytes = unpacked(with(damaged), 1);
      if (!bytes) CHECK(bytes.error().message.starts_with("buffer view 0: EXT_meshopt_compression: "));
    }
  }
}

TEST_CASE("meshopt modes for missing channels are refused", "[meshopt]") {
  for (const auto& [mode, good] : {std::pair{0x00, true},
                                   {0x01, true},
                                   {0xf2, true},
                                   {0x03, false},
                                   {0x10, false},
                                   {0x11, false},
                                   {0x0f, false}}) {
    INFO("mode " << mode);
    StoredStream stored = stored_streams().front();  // one vertex of 4 bytes
    REQUIRE(stored.stated.stride == 4);
    stored.stream.back() = static_cast<std::byte>(mode);
    const auto bytes = unpacked(stored, 1);
    CHECK(static_cast<bool>(bytes) == good);
    if (!bytes) CHECK(bytes.error().message.find("channel 0 has mode " + std::to_string(mode)) != std::string::npos);
  }
}

TEST_CASE("real files of both extensions and versions have the values of their decoded versions", "[meshopt][models]") {
  const std::filesystem::path folder = tests::real_models("scenes-meshopt");
  if (folder.empty()) return;
  size_t files = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    const std::string path = entry.path().string();
    if (!path.ends_with(".glb") || path.ends_with("-decoded.glb")) continue;
    INFO(path);
    const std::vector<std::vector<float>> values = values_of(must(import_gltf(path, {})));
    ++files;
    std::string twin = path.substr(0, path.size() - 4) + "-decoded.glb";
    const std::string stem = entry.path().parent_path().filename().string();
    if (!stem.starts_with("matrix-")) continue;  // gltfpack's variants are quantised, so they have none
    if (!std::filesystem::exists(twin)) {        // it decodes to the same file as another one
      const bool is_lossy = path.find("-indices-oct8-exp") != std::string::npos;
      twin = stem.substr(7) + (is_lossy ? "-ext-v0-indices-oct8-exp-decoded.glb" : "-ext-v0-tri-decoded.glb");
      twin = (entry.path().parent_path() / twin).string();
    }
    INFO(twin);
    CHECK((values_of(must(import_gltf(twin, {}))) == values));
  }
  CHECK(files >= 25);
}

}  // namespace scree::convert
