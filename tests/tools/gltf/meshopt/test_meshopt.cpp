// Buffer views compressed by EXT_meshopt_compression: all modes and filters compared with the source values, real files
// compared with their uncompressed versions, and every possible error.
#include <meshoptimizer.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <random>
#include <span>
#include <string>
#include <utility>
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

std::vector<Packed> one_of_each() {
  std::vector<Packed> all;
  all.push_back(pack_attributes(bytes_of(grid_positions(40)), 12));
  all.push_back(pack_triangles(grid_indices(40), 41 * 41));
  all.push_back(pack_indices(grid_indices(40), 41 * 41));
  return all;
}

Result<Bytes> unpacked(const Packed& packed, MeshoptCache& cache) {
  DocMeshopt stated = packed.stated;
  if (auto checked = check_meshopt(stated, packed.raw.size(), 0); !checked) return checked.error();
  const auto source = cache.view(stated, memory_source(packed.stream));
  CHECK(source->size() == packed.raw.size());
  Bytes bytes(source->size());
  if (auto read = source->read(0, bytes); !read) return read.error();
  return bytes;
}

Result<Bytes> unpacked(const Packed& packed) {
  MeshoptCache cache;
  return unpacked(packed, cache);
}

/// All triangles of a scene with their corners' positions and texture coordinates, in the order of the primitives.
/// Normals are left out, because decoders of the octahedral filter round differently. Each triangle begins with its
/// smallest corner, because compression may rotate it.
std::vector<std::vector<float>> all_triangles(const SourceScene& scene) {
  std::vector<std::vector<float>> out;
  for (const Primitive& primitive : scene.primitives) {
    std::vector<uint32_t> corners = all_corners(primitive);
    std::vector<std::vector<float>> vertices(primitive.vertex_count());
    for (const Accessor* accessor : {&primitive.positions, primitive.uv ? &*primitive.uv : nullptr}) {
      if (accessor == nullptr) continue;
      const std::vector<float> values = all_values(*accessor);
      for (size_t i = 0; i < values.size(); ++i) vertices[i / accessor->components].push_back(values[i]);
    }
    const size_t first = out.size();
    for (size_t t = 0; t < corners.size(); t += 3) {
      const auto less = [&](uint32_t a, uint32_t b) { return vertices[a] < vertices[b]; };
      std::rotate(corners.begin() + t, std::min_element(corners.begin() + t, corners.begin() + t + 3, less),
                  corners.begin() + t + 3);
      std::vector<float>& triangle = out.emplace_back();
      for (size_t i = 0; i < 3; ++i)
        triangle.insert(triangle.end(), vertices[corners[t + i]].begin(), vertices[corners[t + i]].end());
    }
    std::sort(out.begin() + static_cast<ptrdiff_t>(first), out.end());
  }
  return out;
}

Error error_of(const std::string& path) {
  const auto scene = import_gltf(path, {});
  if (!scene) return scene.error();
  for (const Primitive& primitive : scene->primitives) {
    std::vector<uint32_t> corners(3 * primitive.triangle_count());
    if (auto read = read_triangles(primitive, 0, primitive.triangle_count(), corners); !read) return read.error();
    std::vector<float> values(3 * primitive.positions.count);
    if (auto read = read_floats(primitive.positions, 0, primitive.positions.count, values); !read) return read.error();
  }
  FAIL("no error");
  return {ErrorCode::kFormat, {}};
}

}  // namespace

TEST_CASE("every mode unpacks to the packed data", "[meshopt]") {
  for (const Packed& packed : one_of_each()) CHECK(must(unpacked(packed)) == packed.raw);
  // 16-bit indices, which the codecs write as well.
  Packed small = pack_triangles(grid_indices(20), 441);
  std::vector<uint16_t> narrow(small.stated.count);
  for (size_t i = 0; i < narrow.size(); ++i) {
    uint32_t index;
    std::memcpy(&index, small.raw.data() + 4 * i, 4);
    narrow[i] = static_cast<uint16_t>(index);
  }
  small.stated.stride = 2;
  small.raw = bytes_of(narrow);
  CHECK(must(unpacked(small)) == small.raw);
}

TEST_CASE("filters are undone after unpacking", "[meshopt]") {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> number(-1, 1);
  const size_t count = 300;
  std::vector<float> units, wide;
  for (size_t i = 0; i < count; ++i) {
    float v[4] = {number(random), number(random), number(random), number(random)};
    const float length = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2] + v[3] * v[3]);
    for (float c : v) units.push_back(c / length);
    for (float c : v) wide.push_back(c * 1000);
  }
  // The quaternions have one sign, because the filter keeps only rotations.
  SECTION("quaternions") {
    Bytes filtered(8 * count);
    meshopt_encodeFilterQuat(filtered.data(), count, 8, 16, units.data());
    Packed packed = pack_attributes(filtered, 8);
    packed.stated.filter = Filter::kQuaternion;
    const auto bytes = must(unpacked(packed));
    for (size_t i = 0; i < count; ++i) {
      std::array<int16_t, 4> q;
      std::memcpy(q.data(), bytes.data() + 8 * i, 8);
      double dot = 0;
      for (size_t c = 0; c < 4; ++c) dot += q[c] / 32767.0 * static_cast<double>(units[4 * i + c]);
      CHECK(std::abs(dot) > 0.9999);
    }
  }
  SECTION("octahedral normals, 8 and 16 bits a component") {
    std::vector<float> normals;
    for (size_t i = 0; i < count; ++i) {
      const float* v = units.data() + 4 * i;
      const float length = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
      normals.insert(normals.end(), {v[0] / length, v[1] / length, v[2] / length, 0});
    }
    for (const size_t stride : {size_t{4}, size_t{8}}) {
      Bytes filtered(stride * count);
      meshopt_encodeFilterOct(filtered.data(), count, stride, stride == 4 ? 8 : 16, normals.data());
      Packed packed = pack_attributes(filtered, stride);
      packed.stated.filter = Filter::kOctahedral;
      const auto bytes = must(unpacked(packed));
      for (size_t i = 0; i < count; ++i) {
        double dot = 0, length = 0;
        for (size_t c = 0; c < 3; ++c) {
          const std::byte* const at = bytes.data() + stride * i + stride / 4 * c;
          int16_t value = static_cast<int8_t>(*at);
          if (stride == 8) std::memcpy(&value, at, 2);
          dot += value * static_cast<double>(normals[4 * i + c]);
          length += static_cast<double>(value) * value;
        }
        length = std::sqrt(length);
        CHECK(length > (stride == 4 ? 126.0 : 32766.0));
        CHECK(dot / length > (stride == 4 ? 0.9998 : 0.99999));
      }
    }
  }
  SECTION("exponents") {
    Bytes filtered(16 * count);
#if MESHOPTIMIZER_VERSION < 190
    meshopt_encodeFilterExp(filtered.data(), count, 16, 24, wide.data());
#else
    meshopt_encodeFilterExp(filtered.data(), count, 16, 24, wide.data(), meshopt_EncodeExpSharedVector);
#endif
    Packed packed = pack_attributes(filtered, 16);
    packed.stated.filter = Filter::kExponential;
    const auto bytes = must(unpacked(packed));
    for (size_t i = 0; i < wide.size(); ++i) {
      float value;
      std::memcpy(&value, bytes.data() + 4 * i, 4);
      CHECK(std::abs(value - wide[i]) < 1e-3f);
    }
  }
}

TEST_CASE("streams that are cut, too long, of another kind or version are errors", "[meshopt]") {
  const char* const names[] = {"ATTRIBUTES", "TRIANGLES", "INDICES"};
  for (const Packed& whole : one_of_each()) {
    INFO(names[static_cast<size_t>(whole.stated.mode)]);
    for (size_t size = 0; size < whole.stream.size(); size += size < 40 || size + 40 > whole.stream.size() ? 1 : 37) {
      Packed cut = whole;
      cut.stream.resize(size);
      cut.stream.shrink_to_fit();
      cut.stated.bytes = size;
      const auto bytes = unpacked(cut);
      if (bytes) FAIL("a prefix of " << size << " of " << whole.stream.size() << " bytes is taken");
    }
    Packed longer = whole;
    longer.stream.push_back(std::byte{0});
    ++longer.stated.bytes;
    CHECK_FALSE(unpacked(longer));

    Packed other = whole;
    other.stream[0] = std::byte{0x50};
    check_refusal(unpacked(other), ErrorCode::kFormat,
                  std::string("not a stream of ") + names[static_cast<size_t>(whole.stated.mode)]);
    Packed newer = whole;
    newer.stream[0] = (whole.stream[0] & std::byte{0xf0}) | std::byte{7};
    check_refusal(unpacked(newer), ErrorCode::kUnsupported, "of version 7, but at most");

    // Random bytes are unpacked or refused; nothing else happens.
    std::mt19937 random(5);
    for (int round = 0; round < 300; ++round) {
      Packed damaged = whole;
      for (uint32_t i = 0; i <= random() % 4; ++i)
        damaged.stream[1 + random() % (whole.stream.size() - 1)] = static_cast<std::byte>(random());
      const auto bytes = unpacked(damaged);
      if (!bytes) CHECK(bytes.error().message.find("buffer view 0: EXT_meshopt_compression: ") == 0);
    }
  }
}

TEST_CASE("views that the cache has evicted are unpacked again", "[meshopt]") {
  const std::vector<Packed> all = one_of_each();
  for (const uint64_t kept : {uint64_t{0}, uint64_t{30000}, MeshoptCache::kKeptBytes}) {
    MeshoptCache cache(kept);
    std::vector<std::shared_ptr<const ByteSource>> sources;
    for (const Packed& packed : all) sources.push_back(cache.view(packed.stated, memory_source(packed.stream)));
    for (int round = 0; round < 3; ++round) {
      for (size_t i = 0; i < all.size(); ++i) {
        Bytes part(777);
        REQUIRE(sources[i]->read(1001, part));
        CHECK(std::equal(part.begin(), part.end(), all[i].raw.begin() + 1001));
        CHECK_FALSE(sources[i]->read(all[i].raw.size() - 776, part));
      }
    }
  }
}

TEST_CASE("views that are unpacked ahead have the same bytes and errors", "[meshopt]") {
  for (const Packed& packed : one_of_each()) {
    const uint64_t size = packed.raw.size();
    for (const uint64_t kept : {uint64_t{0}, MeshoptCache::kKeptBytes}) {
      const auto source = MeshoptCache(kept, 3000).view(packed.stated, memory_source(packed.stream));
      source->unpack_ahead(0, 1);
      source->unpack_ahead(size / 2, 5000);
      Bytes whole(size);
      REQUIRE(source->read(0, whole));
      CHECK(whole == packed.raw);
      source->unpack_ahead(size - 1, 100'000);  // no block is left to unpack
      REQUIRE(source->read(0, whole));
      CHECK(whole == packed.raw);
    }
    Packed cut = packed;
    cut.stream.resize(cut.stream.size() - 1);
    const auto shorter = MeshoptCache(MeshoptCache::kKeptBytes, 3000).view(cut.stated, memory_source(cut.stream));
    Bytes whole(size);
    const Error error = refusal(shorter->read(0, whole));
    const auto again = MeshoptCache(MeshoptCache::kKeptBytes, 3000).view(cut.stated, memory_source(cut.stream));
    again->unpack_ahead(0, size);
    CHECK(refusal(again->read(0, whole)).message == error.message);
  }
}

TEST_CASE("hints for a compressed view lie in its stream and cover it", "[meshopt]") {
  /// Records the bytes that hints give.
  class Hinted final : public ByteSource {
   public:
    explicit Hinted(uint64_t bytes) : named(bytes) {}
    uint64_t size() const override { return named.size(); }
    Result<void> read(uint64_t, std::span<std::byte>) const override { return {}; }
    void will_need(uint64_t offset, uint64_t bytes) const override {
      REQUIRE(offset <= named.size());
      std::fill_n(named.begin() + static_cast<ptrdiff_t>(offset), std::min(bytes, named.size() - offset), true);
    }
    mutable std::vector<bool> named;
  };
  for (const Packed& packed : one_of_each()) {
    const uint64_t size = packed.raw.size();
    const auto hinted = [&](std::initializer_list<std::pair<uint64_t, uint64_t>> ranges) {
      const auto stream = std::make_shared<Hinted>(packed.stream.size());
      const auto view = MeshoptCache(0, 3000).view(packed.stated, stream);
      for (const auto& [offset, bytes] : ranges) view->will_need(offset, bytes);
      return std::count(stream->named.begin(), stream->named.end(), true);
    };
    // The first byte of some streams is a header.
    CHECK(hinted({{0, size}}) >= static_cast<ptrdiff_t>(packed.stream.size()) - 1);
    CHECK(hinted({{0, size / 2}, {size / 2, size}}) >= static_cast<ptrdiff_t>(packed.stream.size()) - 1);
    CHECK(hinted({{size / 4, size / 4}}) < static_cast<ptrdiff_t>(packed.stream.size()) / 2);
    CHECK(hinted({{size, 1}, {size + 100, ~uint64_t{0}}}) <= 1);
  }
}

TEST_CASE("a compressed document equals the plain one", "[meshopt]") {
  const tests::TempFolder folder;
  const Packed positions = pack_attributes(bytes_of(grid_positions(40)), 12);
  for (const Packed& indices : {pack_triangles(grid_indices(40), 1681), pack_indices(grid_indices(40), 1681)}) {
    for (const char* extension : {"EXT_meshopt_compression", "KHR_meshopt_compression"}) {
      const std::string path = folder.write("packed.gltf", meshopt_document(folder, indices, positions, extension));
      const auto scene = must(import_gltf(path, {}));
      REQUIRE(scene.primitives.size() == 1);
      CHECK(scene.primitives[0].triangle_count() == 3200);
      CHECK(all_values(scene.primitives[0].positions) == grid_positions(40));
      CHECK(bytes_of(all_corners(scene.primitives[0])) == indices.raw);
      CHECK(tests::pack(path, folder.file("packed.scree")));
    }
  }
}

TEST_CASE("invalid properties of a compressed view are refused", "[meshopt][bad]") {
  const tests::TempFolder folder;
  const Packed indices = pack_triangles(grid_indices(40), 1681);
  const std::string good = meshopt_document(folder, indices, pack_attributes(bytes_of(grid_positions(40)), 12));
  struct Change {
    const char* from;
    const char* to;
    ErrorCode code;
    const char* message;
  };
  const Change changes[] = {
      {R"("buffer":0,"byteOffset":0)", R"("buffer":2,"byteOffset":0)", ErrorCode::kRange,
       "buffer view 0: EXT_meshopt_compression: buffer 2 does not exist"},
      {R"("buffer":0,"byteOffset":0)", R"("byteOffset":0)", ErrorCode::kFormat, "buffer is missing"},
      {R"("byteOffset":0)", R"("byteOffset":9007199254740992)", ErrorCode::kRange,
       "bytes at 9007199254740992, but buffer 0 has"},
      {R"("mode":"TRIANGLES")", R"("mode":"STRIPS")", ErrorCode::kFormat, R"(mode is "STRIPS", expected ATTRIBUTES)"},
      {R"("mode":"TRIANGLES")", R"("mode":3)", ErrorCode::kRange, "mode is 3, expected a string"},
      {R"("mode":"TRIANGLES")", R"("mode":"INDICES")", ErrorCode::kTruncated, "9600 elements do not fit into"},
      {R"("mode":"TRIANGLES")", R"("mode":"ATTRIBUTES")", ErrorCode::kFormat, "not a stream of ATTRIBUTES"},
      {R"("mode":"TRIANGLES")", R"("mode":"TRIANGLES","filter":"OCTAHEDRAL")", ErrorCode::kFormat,
       "a filter, but the mode is TRIANGLES"},
      {R"("mode":"ATTRIBUTES")", R"("mode":"ATTRIBUTES","filter":"SEPIA")", ErrorCode::kUnsupported,
       R"(buffer view 1: EXT_meshopt_compression: filter is "SEPIA", expected NONE)"},
      {R"("mode":"ATTRIBUTES")", R"("mode":"ATTRIBUTES","filter":"COLOR")", ErrorCode::kFormat,
       "byteStride is 12, expected 4 or 8 for COLOR"},
      {R"("mode":"ATTRIBUTES")", R"("mode":"ATTRIBUTES","filter":"OCTAHEDRAL")", ErrorCode::kFormat,
       "byteStride is 12, expected 4 or 8 for OCTAHEDRAL"},
      {R"("mode":"ATTRIBUTES")", R"("mode":"ATTRIBUTES","filter":"QUATERNION")", ErrorCode::kFormat,
       "byteStride is 12, expected 8 for QUATERNION"},
      {R"("byteStride":4)", R"("byteStride":3)", ErrorCode::kFormat, "byteStride is 3, expected 2 or 4 for indices"},
      {R"("byteStride":12)", R"("byteStride":6)", ErrorCode::kFormat,
       "byteStride is 6, expected a multiple of 4 up to 256"},
      {R"("byteStride":12)", R"("byteStride":260)", ErrorCode::kFormat, "byteStride is 260, expected a multiple"},
      {R"("byteStride":12)", R"("byteStride":0)", ErrorCode::kFormat, "byteStride is 0, expected a multiple"},
      {R"("count":1681,"mode")", R"("count":1682,"mode")", ErrorCode::kRange,
       "1682 elements of 12 bytes, but the buffer view has 20172 bytes"},
      {R"("count":1681,"mode")", R"("count":9007199254740992,"mode")", ErrorCode::kRange,
       "9007199254740992 elements of 12 bytes"},
      {R"("count":9600,"mode")", R"("count":9601,"mode")", ErrorCode::kFormat,
       "count is 9601, expected a multiple of 3 for TRIANGLES"},
      {R"("count":1681,"mode")", R"("count":-1,"mode")", ErrorCode::kRange, "count is -1"},
      {R"("byteLength":20172)", R"("byteLength":20172,"byteStride":16)", ErrorCode::kFormat,
       "byteStride is 12, but the buffer view's is 16"},
  };
  for (const Change& change : changes) {
    INFO(change.from << " -> " << change.to);
    check_error(error_of(folder.write("bad.gltf", tests::replaced(good, change.from, change.to))), change.code,
                change.message);
  }
  // A small stream with a huge stated size.
  std::string bomb = tests::replaced(good, R"("count":1681,"mode")", R"("count":300000000,"mode")");
  bomb = tests::replaced(bomb, R"("byteLength":20172,)", R"("byteLength":3600000000,)");
  bomb = tests::replaced(bomb, R"({"byteLength":)", R"({"byteLength":3600000000,"x":)");
  check_error(error_of(folder.write("bomb.gltf", bomb)), ErrorCode::kTruncated, "300000000 elements do not fit into");
  // A view of the fallback buffer that is not compressed.
  const std::string plain = tests::replaced(good, R"("EXT_meshopt_compression":{"buffer":0,"byteOffset":0)",
                                            R"("OTHER":{"buffer":0,"byteOffset":0)");
  CHECK(error_of(folder.write("plain.gltf", plain))
            .message.find("buffer 1: a fallback buffer without data, but a buffer view of it is not compressed") !=
        std::string::npos);
}

TEST_CASE("real compressed scenes have the triangles of their uncompressed versions", "[meshopt][models]") {
  const std::filesystem::path folder = tests::real_models("scenes");
  if (folder.empty()) return;
  const std::pair<const char*, const char*> twins[] = {
      {"pirate/pirate.glb", "pirate/pirate-decoded.glb"},
      {"dream-apartment/dream-apartment.glb", "dream-apartment/dream-apartment-decoded.glb"},
      {"meshopt-no-fallback/meshopt-no-fallback.gltf", "meshopt-fallback/meshopt-fallback.gltf"},
      {"KHR_meshopt-no-fallback/meshopt-no-fallback.gltf", "meshopt-fallback/meshopt-fallback.gltf"},
  };
  for (const auto& [packed, plain] : twins) {
    if (!std::filesystem::exists(folder / packed) || !std::filesystem::exists(folder / plain)) {
      WARN("not there: " << packed << " or " << plain);
      continue;
    }
    INFO(packed);
    const auto triangles = all_triangles(must(import_gltf((folder / packed).string(), {})));
    CHECK(triangles.size() > 10);
    CHECK((triangles == all_triangles(must(import_gltf((folder / plain).string(), {})))));
  }
}

TEST_CASE("a fallback buffer has the bytes of its unpacked views", "[meshopt][models]") {
  const std::filesystem::path folder = tests::real_models("scenes/meshopt-fallback");
  if (folder.empty()) return;
  const tests::TempFolder copy;
  std::string text = tests::read_whole((folder / "meshopt-fallback.gltf").string());
  for (const char* name : {"meshopt-fallback.bin", "meshopt-fallback.fallback.bin"})
    copy.write(name, tests::read_whole((folder / name).string()));
  const auto packed = import_gltf(copy.write("packed.gltf", text), {});
  // Without the extension only the fallback remains.
  for (size_t at = 0; (at = text.find("EXT_meshopt", at)) != std::string::npos; ++at) text.replace(at, 3, "NOT");
  const auto plain = must(import_gltf(copy.write("plain.gltf", text), {}));
  REQUIRE(packed);
  CHECK((all_triangles(*packed) == all_triangles(plain)));
}

}  // namespace scree::convert
