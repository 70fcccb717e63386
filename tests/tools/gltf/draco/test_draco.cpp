// KHR_draco_mesh_compression: decoded meshes equal their source, and damaged streams are errors of one line.
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "tests/models.h"
#include "tests/results.h"
#include "tests/tools/gltf/draco/draco_streams.h"
#include "tests/tools/gltf/read_all.h"
#include "tests/tools/temp_folder.h"
#include "tools/convert/convert.h"
#include "tools/gltf/draco/source.h"
#include "tools/gltf/source.h"

namespace scree::convert {
namespace {

namespace fs = std::filesystem;
using namespace tests;
using tests::make_draco;

using Corner = std::array<float, 5>;  // position and texture coordinate
using Triangle = std::array<Corner, 3>;

/// The triangles, sorted. Each begins with its smallest corner.
std::vector<Triangle> triangles_of(const std::vector<float>& positions, const std::vector<float>& uvs,
                                   const std::vector<uint32_t>& corners) {
  std::vector<Triangle> all(corners.size() / 3);
  for (size_t i = 0; i < corners.size(); ++i) {
    Corner& corner = all[i / 3][i % 3];
    for (size_t k = 0; k < 3; ++k) corner[k] = positions[3 * corners[i] + k];
    if (!uvs.empty())
      for (size_t k = 0; k < 2; ++k) corner[3 + k] = uvs[2 * corners[i] + k];
  }
  for (Triangle& one : all) std::rotate(one.begin(), std::min_element(one.begin(), one.end()), one.end());
  std::sort(all.begin(), all.end());
  return all;
}

std::vector<Triangle> triangles_of(const Primitive& primitive) {
  const std::vector<float> uvs = primitive.uv ? tests::all_values(*primitive.uv) : std::vector<float>();
  return triangles_of(tests::all_values(primitive.positions), uvs, tests::all_corners(primitive));
}

DracoPrimitive stated_of(const DracoGrid& grid, const DracoRecipe& recipe) {
  DracoPrimitive stated{.triangles = grid.triangles(), .vertices = grid.vertices()};
  stated.arrays.push_back({"POSITION", tests::kDracoPosition, ComponentType::kFloat32, 3});
  if (recipe.has_uv) stated.arrays.push_back({"TEXCOORD_0", tests::kDracoUv, ComponentType::kFloat32, 2});
  return stated;
}

Result<std::vector<std::byte>> decode(const DracoPrimitive& stated, std::span<const std::byte> stream) {
  std::vector<std::byte> out(*stated.offset_of(stated.arrays.size()));
  if (auto done = decode_draco(stated, std::vector<std::byte>(stream.begin(), stream.end()), out); !done)
    return done.error();
  return out;
}

Result<SourceScene> import_document(const TempFolder& folder, const std::string& text,
                                    const ImportOptions& options = {}) {
  folder.write("t.png", tests::read_whole(tests::data_path("checker.png").string()));
  return import_gltf(folder.write("draco.gltf", text), options);
}

TEST_CASE("Draco geometry equals its source", "[draco]") {
  const TempFolder folder;
  const DracoGrid grid(GENERATE(1u, 9u, 60u));
  for (const bool is_sequential : {true, false})
    for (const int speed : {0, 5, 10})
      for (const int bits : {0, 11})
        for (const bool has_uv : {true, false}) {
          const DracoRecipe recipe{is_sequential, speed, bits, has_uv, has_uv};
          const auto stream = make_draco(grid, recipe);
          const auto scene =
              must(import_document(folder, tests::draco_document({stream}, grid.triangles(), grid.vertices(), recipe)));
          REQUIRE(scene.primitives.size() == 1);
          CHECK(scene.primitives[0].uv.has_value() == has_uv);
          const auto found = triangles_of(scene.primitives[0]);
          const auto expected = triangles_of(grid.positions, has_uv ? grid.uvs : std::vector<float>(), grid.corners);
          REQUIRE(found.size() == expected.size());
          if (bits == 0) {
            CHECK((found == expected));
            continue;
          }
          constexpr float kHalfStep = 0.51f / 2047;  // for 11 bits
          // Quantisation may change the order of triangles. So each triangle must be near an expected one, and the
          // numbers must agree. Triangles begin with the corner of the smallest x, so only expected triangles with
          // nearly the same x there can be near.
          float off = 0;
          for (const Triangle& one : found) {
            float least = 9;
            const float x = one[0][0];
            auto other = std::lower_bound(expected.begin(), expected.end(), x - kHalfStep,
                                          [](const Triangle& is, float than) { return is[0][0] < than; });
            for (; other != expected.end() && (*other)[0][0] <= x + kHalfStep; ++other) {
              for (size_t turn = 0; turn < 3; ++turn) {
                float most = 0;
                for (size_t c = 0; c < 3; ++c)
                  for (size_t k = 0; k < 3; ++k)
                    most = std::max(most, std::abs(one[c][k] - (*other)[(c + turn) % 3][k]));
                least = std::min(least, most);
              }
              if (least < kHalfStep) break;
            }
            off = std::max(off, least);
          }
          CHECK(off < kHalfStep);
        }
}

TEST_CASE("threads read primitives of Draco streams at once, in little memory", "[draco]") {
  const TempFolder folder;
  const DracoGrid grid(30);
  const DracoRecipe recipe{.has_uv = false};
  const auto stream = make_draco(grid, recipe);
  const ImportOptions options{.kept_view_bytes = GENERATE(uint64_t{0}, uint64_t{1} << 30)};
  const auto scene = must(import_document(
      folder, tests::draco_document({stream, stream, stream}, grid.triangles(), grid.vertices(), recipe), options));
  CHECK(scene.view_memory.reader_bytes > 12u * grid.triangles());
  const uint64_t unpacked = 3 * 12u * (grid.triangles() + grid.vertices());
  CHECK(scene.view_memory.kept_bytes >= std::min(options.kept_view_bytes, unpacked));
  const auto expected = triangles_of(grid.positions, {}, grid.corners);
  std::vector<std::thread> threads;
  std::array<bool, 6> good{};
  for (size_t i = 0; i < good.size(); ++i)
    threads.emplace_back([&, i] {
      const Primitive& primitive = scene.primitives[i % 3];
      std::vector<float> positions(3 * primitive.vertex_count());
      std::vector<uint32_t> corners(3 * primitive.triangle_count());
      good[i] = read_floats(primitive.positions, 0, primitive.vertex_count(), positions) &&
                read_triangles(primitive, 0, primitive.triangle_count(), corners) &&
                triangles_of(positions, {}, corners) == expected;
    });
  for (std::thread& thread : threads) thread.join();
  for (const bool is_good : good) CHECK(is_good);
}

TEST_CASE("a Draco primitive that does not fit into --memory is refused with the memory that it needs", "[draco]") {
  const TempFolder folder;
  const DracoRecipe recipe{.has_uv = false};
  const std::string text = tests::draco_document({make_draco(DracoGrid(4), recipe)}, 100'000'000, 50'000'000, recipe);
  check_refusal(
      import_document(folder, text, {.memory = uint64_t{1} << 30}), ErrorCode::kUsage,
      "draco.gltf: mesh 0 primitive 0: --memory: 1.00 GiB, but unpacking its 100000000 triangles (Draco) takes ");
  // Without a limit the file is opened, and its header is refused before so much memory is allocated.
  must(import_document(folder, text));
}

TEST_CASE("Draco streams of other sizes than their accessors state are refused", "[draco][bad]") {
  const DracoGrid grid(6);
  for (const bool is_sequential : {true, false}) {
    const DracoRecipe recipe{.is_sequential = is_sequential, .has_tangent = true};
    const auto stream = make_draco(grid, recipe);
    const DracoPrimitive stated = stated_of(grid, recipe);
    REQUIRE(decode(stated, stream));
    const auto refused = [&](const auto& change, ErrorCode code, const std::string& words) {
      DracoPrimitive other = stated;
      change(other);
      check_refusal(decode(other, stream), code, words);
    };
    refused([](DracoPrimitive& p) { ++p.triangles; }, ErrorCode::kRange,
            "72 triangles, but the accessor of its indices has 73");
    refused([](DracoPrimitive& p) { --p.vertices; }, ErrorCode::kRange,
            "49 vertices, but the accessor of POSITION has 48");
    refused([](DracoPrimitive& p) { ++p.vertices; }, ErrorCode::kRange,
            "49 vertices, but the accessor of POSITION has 50");
    refused([](DracoPrimitive& p) { p.arrays[1].id = 9; }, ErrorCode::kFormat, "TEXCOORD_0: no attribute 9");
    refused([](DracoPrimitive& p) { p.arrays[1].components = 3; }, ErrorCode::kFormat,
            "TEXCOORD_0: 2 components in the stream, but its accessor has 3");
    auto cloud = stream;
    cloud[7] = std::byte{0};
    CHECK(refusal(decode(stated, cloud)).code == ErrorCode::kUnsupported);
  }
}

TEST_CASE("damaged Draco streams are errors of one line", "[draco][bad]") {
  const DracoGrid grid(5);
  for (const bool is_sequential : {true, false})
    for (const int bits : {0, 8}) {
      const DracoRecipe recipe{.is_sequential = is_sequential, .position_bits = bits};
      const auto stream = make_draco(grid, recipe);
      const DracoPrimitive stated = stated_of(grid, recipe);
      for (size_t size = 0; size < stream.size(); ++size) {
        const auto cut = decode(stated, std::span(stream).first(size));
        if (!cut) CHECK(cut.error().message.find('\n') == std::string::npos);
        if (size < stream.size() / 2) CHECK_FALSE(cut);
      }
      for (size_t i = 0; i < 8 * std::min<size_t>(stream.size(), 160); ++i) {
        auto bad = stream;
        bad[i / 8] ^= std::byte{1} << i % 8;
        const auto done = decode(stated, bad);
        if (!done) CHECK(done.error().message.find('\n') == std::string::npos);
      }
    }
}

TEST_CASE("real scenes of Draco convert", "[draco][models]") {
  const std::filesystem::path folder = tests::real_models("scenes");
  if (folder.empty()) return;
  const TempFolder out;
  // The number of triangles agrees with the accessors of the indices.
  const std::pair<const char*, uint64_t> scenes[] = {
      {"Box_Draco/Box_Draco.glb", 12},
      {"heart_draco/heart_draco.glb", 0},
      {"DracoSparseMesh/DracoSparseMesh.gltf", 0},
      {"cave/cave.glb", 0},
  };
  for (const auto& [name, triangles] : scenes) {
    INFO(name);
    ConvertOptions options;
    options.input = (folder / name).string();
    options.output = out.file("out.scree");
    options.existing = format::Existing::kReplace;
    options.threads = 2;
    const auto report = must(convert(options));
    CHECK(report.triangles > 0);
    if (triangles != 0) CHECK(report.triangles == triangles);
  }
}

}  // namespace
}  // namespace scree::convert
