// Equal vertices are stored once: the classes compared with brute force, and convert's output.
#include <bit>
#include <random>
#include <vector>

#include "tests/sanitized.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tools/convert/encode/weld.h"

using namespace scree;
using namespace scree::convert;
using namespace scree::tests;

namespace {

uint64_t stored_vertices(const format::Container& file) {
  uint64_t sum = 0;
  for (uint64_t i = 0; i < file.meshes().size(); ++i) sum += file.meshes()[i].vertex_count;
  return sum;
}

/// A triangle list without indices: two triangles with a common edge from corner 1 to 2.
std::vector<float> quad() {
  return {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
}

}  // namespace

TEST_CASE("weld: classes equal brute force, for every set of attributes", "[weld]") {
  std::mt19937 random(11);
  const float choices[] = {0.0f, -0.0f, 1.0f, 1e-30f, std::numeric_limits<float>::quiet_NaN()};
  for (const size_t count : {size_t{0}, size_t{1}, size_t{2}, size_t{63}, size_t{64}, size_t{65}, size_t{700}}) {
    for (const Welder::Zeros zeros : {Welder::Zeros::kUnsigned, Welder::Zeros::kSigned}) {
      CAPTURE(count, zeros == Welder::Zeros::kSigned);
      std::vector<float> positions(3 * count), uvs(2 * count), colors(4 * count);
      for (float& value : positions) value = choices[random() % 4];
      for (float& value : uvs) value = choices[random() % 5];
      for (float& value : colors) value = choices[random() % 2];
      const auto same = [&](const std::vector<float>& values, size_t n, size_t a, size_t b, bool keeps_sign) {
        for (size_t c = 0; c < n; ++c) {
          uint32_t x = std::bit_cast<uint32_t>(values[n * a + c]), y = std::bit_cast<uint32_t>(values[n * b + c]);
          if (!keeps_sign && x == 0x80000000u) x = 0;
          if (!keeps_sign && y == 0x80000000u) y = 0;
          if (x != y) return false;
        }
        return true;
      };
      const auto check = [&](Welder& welder, int attributes) {
        uint64_t duplicates = 0;
        std::vector<uint32_t> with_equal;
        REQUIRE(welder.firsts().size() == count);
        for (uint32_t i = 0; i < count; ++i) {
          uint32_t first = i;
          bool has_equal = false;
          for (uint32_t j = 0; j < count; ++j) {
            const bool equal = same(positions, 3, i, j, zeros == Welder::Zeros::kSigned) &&
                               (attributes < 1 || same(uvs, 2, i, j, false)) &&
                               (attributes < 2 || same(colors, 4, i, j, false));
            if (equal && j < first) first = j;
            has_equal = has_equal || (equal && j != i);
          }
          if (welder.firsts()[i] != first) FAIL("vertex " << i << ": " << welder.firsts()[i] << ", not " << first);
          duplicates += first != i ? 1 : 0;
          if (has_equal) with_equal.push_back(i);
        }
        CHECK(welder.duplicates() == duplicates);
        const std::span<const uint32_t> found = welder.find_candidates();
        CHECK(std::vector<uint32_t>(found.begin(), found.end()) == with_equal);
      };
      const auto pick = [](const std::vector<float>& values, size_t n, Welder& welder) {
        std::vector<float> out;
        for (const uint32_t place : welder.find_candidates())
          out.insert(out.end(), &values[n * place], &values[n * place] + n);
        return out;
      };
      Welder welder;
      welder.start(positions, zeros);
      check(welder, 0);
      welder.part(pick(uvs, 2, welder), 2);
      check(welder, 1);
      welder.part(pick(colors, 4, welder), 4);
      check(welder, 2);
    }
  }
}

TEST_CASE("weld: a mesh without indices takes as many bytes as with indices", "[weld]") {
  const TempFolder folder;
  tests::GridSpec spec{.columns = 512, .rows = 300};  // 307,200 triangles: two windows
  const auto encoding = GENERATE(Encoding::kIndexed, Encoding::kClustered);
  const auto order = GENERATE(Order::kNone, Order::kFifo);
  if (tests::kIsSanitized && (encoding == Encoding::kClustered) != (order == Order::kFifo)) return;
  CAPTURE(encoding == Encoding::kClustered, order == Order::kFifo);
  uint64_t bytes[2], vertices[2];
  for (const bool indexed : {true, false}) {
    spec.indexed = indexed;
    tests::make_model(folder.file("in.glb"), spec);
    ConvertOptions options = options_of(folder);
    options.encoding = encoding;
    options.order = order;
    REQUIRE(must_match(options).triangles == 307200);
    const tests::PackedFile packed = must_open(options.output);
    bytes[indexed] = tests::chunk_bytes(packed.file);
    vertices[indexed] = stored_vertices(packed.file);
    // Every square has six corners, and all but one belong to vertices of other squares too. The row that two windows
    // share counts twice.
    CHECK(left_out(packed.file)["duplicate vertices"] == (indexed ? 0u : 3u * 307200 - (513u * 301 + 513)));
  }
  INFO(bytes[1] << " bytes with indices, " << bytes[0] << " without");
  // In the source's order the number of bytes is the same. meshoptimizer's order depends on the vertex numbers.
  if (order == Order::kNone && encoding == Encoding::kIndexed) {
    CHECK(bytes[0] == bytes[1]);
    CHECK(vertices[0] == vertices[1]);
  }
  CHECK(static_cast<double>(bytes[0]) < 1.05 * static_cast<double>(bytes[1]));
}

TEST_CASE("weld: --no-weld keeps every vertex of the source, and any number of threads gives the same bytes",
          "[weld]") {
  const TempFolder folder;
  tests::make_model(folder.file("in.glb"), {.columns = 400, .rows = 400, .indexed = false});
  ConvertOptions options = options_of(folder);
  std::string first;
  for (const uint32_t threads : {1u, 2u, 5u}) {
    options.threads = threads;
    const std::string bytes = tests::converted_bytes(options);
    if (first.empty()) first = bytes;
    CHECK(bytes == first);
  }
  options.weld = false;
  must_match(options);
  const tests::PackedFile packed = must_open(options.output);
  CHECK(stored_vertices(packed.file) == 3 * 320000u);
  CHECK(left_out(packed.file)["duplicate vertices"] == 0);
  CHECK(packed.file.string(packed.file.source().options).find("--no-weld") != std::string_view::npos);
}

TEST_CASE("weld: vertices with different stored attributes stay apart", "[weld]") {
  const TempFolder folder;
  tests::ModelMaker maker(folder.file("in.glb"));
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const auto loose = [&](const std::vector<float>& colors, bool with_normals) {
    tests::ModelMaker& m = maker;
    tools::GltfPrimitive out = m.primitive(quad(), {});
    if (!colors.empty()) out.attributes.emplace_back("COLOR_0", m.floats(colors, tools::GltfType::kVec3));
    if (with_normals)
      out.attributes.emplace_back(
          "NORMAL", m.floats({0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 1, 0, 0, 1, 0, 0, 1, 0}, tools::GltfType::kVec3));
    return out;
  };
  const std::vector<float> equal{1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 0, 1, 1, 1, 0, -0.0f, 1};
  const std::vector<float> one_differs{1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 0, 1, 1, 1, 0, 0.25f, 1};
  const std::vector<float> not_numbers{1, 0, 0, nan, 1, 0, 0, 0, 1, nan, 1, 0, 1, 1, 1, 0, 0, 1};
  maker.draw("plain", {loose({}, false)});
  maker.draw("equal", {loose(equal, false)});
  maker.draw("differs", {loose(one_differs, false)});
  maker.draw("nan", {loose(not_numbers, false)});
  maker.draw("normals", {loose({}, true)}, {0, 0, 1});
  maker.finish();
  ConvertOptions options = options_of(folder);
  must_match(options);
  const auto counts = [&] {
    const tests::PackedFile packed = must_open(options.output);
    std::vector<uint64_t> out;
    for (uint64_t i = 0; i < packed.file.meshes().size(); ++i) out.push_back(packed.file.meshes()[i].vertex_count);
    return out;
  };
  const std::vector<uint64_t> without_normals = counts();
  REQUIRE(without_normals.size() >= 4);
  CHECK(std::vector<uint64_t>(without_normals.begin(), without_normals.begin() + 4) ==
        std::vector<uint64_t>{4, 4, 5, 4});
  options.normals = convert::Normals::kAlways;
  must_match(options);
  CHECK(counts().back() == 6);
}

TEST_CASE("weld: minus zero equals zero on a lattice, but not as a float", "[weld]") {
  const TempFolder folder;
  std::vector<float> points = quad();
  points[11] = -0.0f;  // z of the second triangle's first corner, which is also the first triangle's second corner
  tests::make_model(folder.file("in.glb"), points, {});
  ConvertOptions options = options_of(folder);
  must_match(options);
  CHECK(stored_vertices(must_open(options.output).file) == 4);
  options.float32 = true;
  must_match(options);
  CHECK(stored_vertices(must_open(options.output).file) == 5);
}
