// Compressed buffer views that are read in windows. For any windows, order and threads they equal the library's result
// for the whole stream, and streams that the library refuses are refused.
#include <meshoptimizer.h>

#include <algorithm>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/results.h"
#include "tests/tools/gltf/meshopt/meshopt_streams.h"
#include "tests/tools/packed_file.h"
#include "tools/gltf/byte_source.h"
#include "tools/gltf/meshopt/source.h"
#include "tools/gltf/meshopt/windows.h"
#include "tools/gltf/source.h"

namespace scree::convert {
namespace {

using namespace tests;
using Filter = DocMeshopt::Filter;

/// The library's code for a whole stream, 0 for success, and its unpacked bytes.
int library_unpacks(const Packed& packed, Bytes& out) {
  const DocMeshopt& stated = packed.stated;
  out.assign(stated.count * stated.stride, std::byte{0});
  const auto* const stream = reinterpret_cast<const unsigned char*>(packed.stream.data());
  const size_t bytes = packed.stream.size();
  if (stated.mode == Mode::kAttributes)
    return meshopt_decodeVertexBuffer(out.data(), stated.count, stated.stride, stream, bytes);
  if (stated.mode == Mode::kTriangles)
    return meshopt_decodeIndexBuffer(out.data(), stated.count, stated.stride, stream, bytes);
  return meshopt_decodeIndexSequence(out.data(), stated.count, stated.stride, stream, bytes);
}

void undo_filter(Filter filter, Bytes& bytes, size_t stride) {
  const size_t count = bytes.size() / stride;
  if (filter == Filter::kQuaternion) meshopt_decodeFilterQuat(bytes.data(), count, stride);
  if (filter == Filter::kExponential) meshopt_decodeFilterExp(bytes.data(), count, stride);
}

Result<Bytes> read_all(const ByteSource& source) {
  Bytes bytes(source.size());
  if (auto read = source.read(0, bytes); !read) return read.error();
  return bytes;
}

/// Compares the windows of a stream, read in several ways, with the library's whole result.
void check_windows(const Packed& packed, uint64_t window_bytes, uint64_t kept_bytes, uint32_t seed) {
  INFO("mode " << static_cast<int>(packed.stated.mode) << ", " << packed.stated.count << " elements of "
               << packed.stated.stride << " bytes, windows of " << window_bytes << ", kept " << kept_bytes);
  Bytes expected;
  REQUIRE(library_unpacks(packed, expected) == 0);
  undo_filter(packed.stated.filter, expected, packed.stated.stride);
  const MeshoptCache cache(kept_bytes, window_bytes);
  const auto make = [&] { return cache.view(packed.stated, memory_source(packed.stream)); };
  CHECK((must(read_all(*make())) == expected));

  const auto view = make();
  std::mt19937 random(seed);
  bool all_equal = true;
  for (int round = 0; round < 20; ++round) {
    const size_t first = random() % expected.size();
    Bytes part(1 + random() % std::min<size_t>(expected.size() - first, 3 * window_bytes));
    REQUIRE(view->read(first, part));
    all_equal &= std::equal(part.begin(), part.end(), expected.begin() + static_cast<ptrdiff_t>(first));
  }
  CHECK(all_equal);
}

/// Elements in which some bytes continue from one element to the next, some jump and some stay equal. So groups of all
/// bit widths occur.
Bytes mixed_elements(size_t count, size_t stride, uint32_t seed) {
  std::mt19937 random(seed);
  Bytes bytes(count * stride);
  for (size_t i = 0; i < bytes.size(); ++i) {
    const size_t place = i % stride, element = i / stride;
    const uint32_t before = i < stride ? 0 : std::to_integer<uint32_t>(bytes[i - stride]);
    const uint32_t kind = static_cast<uint32_t>(place + element / 50) % 4;
    const auto step = kind == 0 ? 0 : kind == 1 ? random() % 2 : kind == 2 ? random() % 9 : random() % 256;
    bytes[i] = static_cast<std::byte>((before + step) & 255);
  }
  return bytes;
}

/// Triangles of a grid whose order is partly lost, and triangles with random corners.
std::vector<uint32_t> mixed_triangles(size_t triangles, uint32_t vertices, uint32_t seed) {
  std::mt19937 random(seed);
  const std::vector<uint32_t> grid = grid_indices(60);
  std::vector<uint32_t> out;
  size_t at = 0;
  while (out.size() < 3 * triangles) {
    const auto turn = random() % 40;
    if (turn == 0) at = random() % (grid.size() / 3);
    for (size_t i = 0; i < 3; ++i) {
      const uint32_t corner = turn < 3 ? static_cast<uint32_t>(random()) : grid[(3 * at + i) % grid.size()];
      out.push_back(corner % vertices);
    }
    ++at;
  }
  return out;
}

Packed narrowed(Packed packed) {
  packed.stated.stride = 2;
  packed.raw.resize(packed.raw.size() / 2);
  return packed;
}

/// Streams of all modes, versions and strides, of about `count` elements.
std::vector<Packed> all_streams(size_t count, uint32_t seed) {
  std::vector<Packed> all;
  for (const size_t stride : {4, 8, 12, 16, 20, 36, 64, 252, 256})
    all.push_back(pack_attributes(mixed_elements(count, stride, seed), stride));
  for (const auto& [filter, stride] : {std::pair{Filter::kQuaternion, 8}, std::pair{Filter::kExponential, 12}}) {
    all.push_back(
        pack_attributes(mixed_elements(count, static_cast<size_t>(stride), seed + 1), static_cast<size_t>(stride)));
    all.back().stated.filter = filter;
  }
  for (const int version : {0, 1}) {
    meshopt_encodeIndexVersion(version);
    for (const uint32_t vertices : {3721u, 65536u, 0xffffffffu}) {
      const std::vector<uint32_t> corners = mixed_triangles((count + 2) / 3, vertices, seed);
      all.push_back(pack_triangles(corners, vertices));
      all.push_back(narrowed(all.back()));
      all.push_back(pack_indices({corners.begin(), corners.begin() + static_cast<ptrdiff_t>(count)}, vertices));
      all.push_back(narrowed(all.back()));
    }
  }
  meshopt_encodeIndexVersion(1);
  return all;
}

/// Checks that a view of the stream gives the library's result: the same bytes, or an error of the same kind.
void check_as_library(const Packed& packed, uint64_t window_bytes) {
  Bytes expected;
  const int status = library_unpacks(packed, expected);
  const MeshoptCache cache(0, window_bytes);
  const auto bytes = read_all(*cache.view(packed.stated, memory_source(packed.stream)));
  const bool is_equal =
      status == 0 ? bytes && *bytes == expected
                  : !bytes && bytes.error().code == (status == -2 ? ErrorCode::kTruncated : ErrorCode::kTrailing);
  if (is_equal) return;
  FAIL("the library says " << status << ", but "
                           << (!bytes        ? bytes.error().message
                               : status == 0 ? "it is unpacked to other bytes"
                                             : "it is unpacked"));
}

}  // namespace

TEST_CASE("windows of any stream equal the library's output", "[meshopt]") {
  uint32_t seed = 0;
  // Counts near multiples of groups and blocks, and windows from the smallest allowed size on.
  for (const size_t count : {1, 2, 3, 15, 16, 17, 31, 32, 33, 255, 256, 257, 511, 513, 3000})
    for (const Packed& packed : all_streams(count, ++seed))
      for (const uint64_t window : {1, 4096}) check_windows(packed, window, 0, seed);
  // Streams longer than a piece, with windows that end where blocks end.
  for (const Packed& packed : all_streams(40000, ++seed))
    for (const uint64_t window : {5000, 8192, 100000, 1 << 30})
      for (const uint64_t kept : {0, 200000}) check_windows(packed, window, kept, seed);
}

TEST_CASE("threads read windows of one view at the same time", "[meshopt]") {
  for (const Packed& packed : all_streams(30000, 99)) {
    Bytes expected;
    REQUIRE(library_unpacks(packed, expected) == 0);
    undo_filter(packed.stated.filter, expected, packed.stated.stride);
    const MeshoptCache cache(40000, 10000);
    const auto view = cache.view(packed.stated, memory_source(packed.stream));
    std::vector<int> wrong(4, 0);
    std::vector<std::thread> threads;
    for (uint32_t t = 0; t < wrong.size(); ++t) {
      threads.emplace_back([&, t] {
        std::mt19937 random(t);
        for (int round = 0; round < 40; ++round) {
          const size_t first = random() % expected.size();
          Bytes part(1 + random() % std::min<size_t>(expected.size() - first, 25000));
          wrong[t] += !view->read(first, part) ||
                      !std::equal(part.begin(), part.end(), expected.begin() + static_cast<ptrdiff_t>(first));
        }
      });
    }
    for (std::thread& thread : threads) thread.join();
    CHECK(wrong == std::vector<int>(4, 0));
  }
}

TEST_CASE("damaged streams are refused as by the library, for any window", "[meshopt][bad]") {
  std::mt19937 random(11);
  for (const size_t count : {6, 300}) {
    for (const Packed& whole : all_streams(count, 5)) {
      if (whole.stated.filter != Filter::kNone || whole.stated.stride > 64) continue;
      INFO("mode " << static_cast<int>(whole.stated.mode) << ", stride " << whole.stated.stride << ", " << count);
      const auto check = [&](Packed packed) {
        packed.stream.shrink_to_fit();
        packed.stated.bytes = packed.stream.size();
        check_as_library(packed, 1);
        check_as_library(packed, 1000);
      };
      const size_t step = count < 10 ? 1 : 7;
      for (size_t size = 1; size <= whole.stream.size(); size += step) {
        Packed cut = whole;
        cut.stream.resize(size);
        check(cut);
        Packed shorter = whole;  // the stream's tail is kept
        const auto at = shorter.stream.begin() + static_cast<ptrdiff_t>(size);
        if (size + 1 < whole.stream.size()) shorter.stream.erase(at, at + 1);
        check(shorter);
        Packed longer = whole;
        longer.stream.insert(longer.stream.begin() + static_cast<ptrdiff_t>(size), std::byte{3});
        check(longer);
        if (size == whole.stream.size()) continue;
        for (const uint32_t bits : {0x01u, 0x80u, 0xffu, static_cast<uint32_t>(random() % 256)}) {
          Packed flipped = whole;
          flipped.stream[size] ^= static_cast<std::byte>(bits);
          check(flipped);
        }
      }
    }
  }
}

TEST_CASE("streams of random bytes give the library's result", "[meshopt][bad]") {
  std::mt19937 random(17);
  int taken[2] = {};  // triangles, indices
  for (int round = 0; round < 3000; ++round) {
    Packed packed{.stated = {.mode = round % 2 == 0 ? Mode::kTriangles : Mode::kIndices}};
    const bool is_triangles = packed.stated.mode == Mode::kTriangles;
    packed.stated.stride = round % 4 < 2 ? 4 : 2;
    packed.stated.count = 3 * (1 + random() % 60);
    const size_t codes = is_triangles ? packed.stated.count / 3 : packed.stated.count;
    packed.stream.resize(1 + codes + (is_triangles ? random() % (4 * codes) + 16 : 4));
    for (std::byte& byte : packed.stream) byte = static_cast<std::byte>(random());
    packed.stream[0] = static_cast<std::byte>((is_triangles ? 0xe0u : 0xd0u) | random() % 2);
    // Indices of one byte each, so that none of them is lost.
    for (size_t i = 1; i < packed.stream.size() && !is_triangles; ++i) packed.stream[i] &= std::byte{0x7f};
    // The stream's length, which only decoding shows: tries each length until one is accepted.
    const size_t most = packed.stream.size();
    for (size_t size = 1 + codes + (is_triangles ? 16 : 4); size <= most; ++size) {
      Packed cut = packed;
      cut.stream.resize(size);
      cut.stream.shrink_to_fit();
      cut.stated.bytes = size;
      check_as_library(cut, 100);
      Bytes ignored;
      if (library_unpacks(cut, ignored) != 0) continue;
      ++taken[is_triangles ? 0 : 1];
      break;
    }
  }
  CHECK(taken[0] > 300);
  CHECK(taken[1] == 1500);
}

TEST_CASE("a scene whose views are many windows converts to the same bytes", "[meshopt]") {
  const TempFolder folder;
  const Packed positions = pack_attributes(bytes_of(grid_positions(400)), 12);
  const Packed indices = pack_triangles(grid_indices(400), 401 * 401);
  REQUIRE(indices.raw.size() > 4 * MeshoptCache::kWindowBytes);
  // The plain bytes lie in the same file. The name of the extension alone decides which bytes are read.
  std::string text = meshopt_document(folder, indices, positions);
  Bytes all = indices.stream;
  for (const Bytes* const part : {&positions.stream, &indices.raw, &positions.raw})
    all.insert(all.end(), part->begin(), part->end());
  folder.write("mesh.bin", std::string(reinterpret_cast<const char*>(all.data()), all.size()));
  const uint64_t packed_bytes = indices.stream.size() + positions.stream.size();
  const uint64_t plain_bytes = all.size() - packed_bytes;
  text = replaced(text, R"("extensionsRequired":["EXT_meshopt_compression"],)", "");
  text = replaced(text, R"("byteLength":)" + std::to_string(packed_bytes),
                  R"("byteLength":)" + std::to_string(all.size()));
  for (const uint64_t offset : {packed_bytes, packed_bytes + indices.raw.size()})
    text = replaced(text, R"({"buffer":1,)", R"({"buffer":0,"byteOffset":)" + std::to_string(offset) + ",");
  const std::string path = folder.write("scene.gltf", text);
  REQUIRE(import_gltf(path, {})->view_memory.kept_bytes >= plain_bytes);
  REQUIRE(tests::pack(path, folder.file("packed.scree")));
  for (size_t at = 0; (at = text.find("EXT_meshopt", at)) != std::string::npos; ++at) text.replace(at, 3, "NOT");
  folder.write("scene.gltf", text);
  REQUIRE(import_gltf(path, {})->view_memory.kept_bytes == 0);
  REQUIRE(tests::pack(path, folder.file("plain.scree")));
  CHECK((tests::read_whole(folder.file("packed.scree")) == tests::read_whole(folder.file("plain.scree"))));
}

TEST_CASE("windows are kept up to their limit of bytes", "[meshopt]") {
  KeptWindows kept(1000 + 3 * KeptWindows::kEntryBytes);
  int owner = 0, other = 0;
  const auto take = [&](const void* whose, uint64_t number, size_t size) {
    return kept.take(whose, number, size, std::max<size_t>(size, 400));
  };
  const auto first = take(&owner, 0, 400);
  CHECK(take(&owner, 0, 400) == first);
  CHECK(take(&other, 0, 400) != first);
  CHECK(take(&owner, 0, 400) == first);  // now used more recently than the other window
  const std::byte* const second = take(&owner, 1, 400)->bytes.get();
  CHECK(take(&owner, 0, 400) == first);
  const auto third = take(&owner, 2, 400);  // in the memory of window 1
  CHECK(third->bytes.get() == second);
  CHECK_FALSE(third->is_unpacked);
  CHECK(take(&other, 1, 400)->bytes.get() != first->bytes.get());  // whose memory is still in use
  CHECK(take(&owner, 0, 400) != first);
  kept.forget(&owner, 3);
  CHECK(take(&owner, 2, 400) != third);
  CHECK(take(&owner, 3, 5000)->size == 5000);
  // A smaller window with the same capacity also reuses the memory.
  const std::byte* const memory = take(&owner, 4, 400)->bytes.get();
  take(&owner, 5, 400);
  CHECK(take(&owner, 6, 399)->bytes.get() == memory);
  // Released memory is available again.
  kept.forget(&owner, 7);
  const auto fourth = take(&owner, 0, 400);
  take(&owner, 1, 400);
  CHECK(take(&owner, 0, 400) == fourth);
}

}  // namespace scree::convert
