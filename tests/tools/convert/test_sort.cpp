// Primitives with triangles in random order are sorted. The copy equals the primitive for any amount of memory, the
// output is as small as for an ordered primitive, and the temporary file is removed.
#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <numeric>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "format/container/part_file.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/gltf/read_all.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/run_program.h"
#include "tools/convert/sort/sort_primitive.h"
#include "tools/convert/windows/locality.h"
#include "tools/gltf/byte_source.h"

using namespace scree;
using namespace scree::convert;
using namespace scree::tests;

namespace {

template <class T>
Accessor accessor_of(const std::vector<T>& values, uint32_t components, ComponentType type, uint64_t stride = 0) {
  Accessor out{.count = values.size() / components, .type = type, .components = components};
  const uint64_t bytes = components * sizeof(T);
  out.stride = stride == 0 ? bytes : stride;
  std::vector<std::byte> data(out.count * out.stride);
  for (uint64_t i = 0; i < out.count; ++i) std::memcpy(&data[i * out.stride], &values[i * components], bytes);
  out.source = memory_source(std::move(data));
  return out;
}

/// A wavy grid of side x side vertices in random order, with `first` unused vertices before them and attributes of
/// every kind. Its triangles are in random order, in the form of `mode`.
Primitive shuffled(uint32_t side, uint32_t first, PrimitiveMode mode, uint64_t joined = 0) {
  std::mt19937 random(5);
  std::vector<uint32_t> number(size_t{side} * side);
  std::iota(number.begin(), number.end(), first);
  std::shuffle(number.begin(), number.end(), random);
  const size_t vertices = first + number.size();
  std::vector<float> positions(3 * vertices, -7.0f), normals(3 * vertices);
  std::vector<uint16_t> uvs(2 * vertices);
  std::vector<uint8_t> colors(3 * vertices);
  for (uint32_t y = 0; y < side; ++y) {
    for (uint32_t x = 0; x < side; ++x) {
      const size_t v = number[size_t{y} * side + x];
      const float place[3] = {static_cast<float>(x), std::sin(0.1f * static_cast<float>(x + y)), static_cast<float>(y)};
      std::copy_n(place, 3, &positions[3 * v]);
      for (size_t i = 0; i < 3; ++i) normals[3 * v + i] = static_cast<float>(random() % 100);
      for (size_t i = 0; i < 2; ++i) uvs[2 * v + i] = static_cast<uint16_t>(random());
      for (size_t i = 0; i < 3; ++i) colors[3 * v + i] = static_cast<uint8_t>(random());
    }
  }
  std::vector<std::array<uint32_t, 3>> triangles;
  for (uint32_t y = 0; y + 1 < side; ++y) {
    for (uint32_t x = 0; x + 1 < side; ++x) {
      const auto at = [&](uint32_t dx, uint32_t dy) { return number[size_t{y + dy} * side + x + dx]; };
      triangles.push_back({at(0, 0), at(0, 1), at(1, 0)});
      triangles.push_back({at(1, 0), at(0, 1), at(1, 1)});
    }
  }
  std::shuffle(triangles.begin(), triangles.end(), random);
  std::vector<uint32_t> corners;
  for (const auto& triangle : triangles) corners.insert(corners.end(), triangle.begin(), triangle.end());
  for (uint64_t i = 0; i < joined; ++i) corners.push_back(number[random() % number.size()]);
  Primitive out{.mode = mode,
                .positions = accessor_of(positions, 3, ComponentType::kFloat32, 20),
                .uv = accessor_of(uvs, 2, ComponentType::kUint16)};
  out.uv->normalized = true;
  out.color = accessor_of(colors, 3, ComponentType::kUint8, 4);
  out.normal = accessor_of(normals, 3, ComponentType::kFloat32);
  // The sparse accessor replaces the position of vertex number[3].
  const Accessor::Sparse sparse{
      .count = 1,
      .index_source = accessor_of(std::vector<uint32_t>{number[3]}, 1, ComponentType::kUint32).source,
      .value_source = accessor_of(std::vector<float>{40, 50, 60}, 3, ComponentType::kFloat32).source};
  out.positions.sparse = sparse;
  out.indices = accessor_of(corners, 1, ComponentType::kUint32);
  return out;
}

std::vector<uint32_t> all_numbers(const Accessor& accessor) {
  std::vector<uint32_t> out(accessor.count);
  REQUIRE(read_elements(accessor, 0, accessor.count, std::as_writable_bytes(std::span(out))));
  return out;
}

std::shared_ptr<const format::PartFile> make_file(const TempFolder& folder) {
  format::PartFile file = must(format::PartFile::create(folder.file("sorted")));
  REQUIRE(file.hide());
  return std::make_shared<const format::PartFile>(std::move(file));
}

Primitive must_sort(const TempFolder& folder, const Primitive& primitive, uint32_t first, const SortLimits& limits,
                    uint64_t offset = 0) {
  const std::shared_ptr<const format::PartFile> shared = make_file(folder);
  const uint64_t vertices = primitive.vertex_count() - first;
  uint64_t last = 0;
  Primitive copy = must(sort_primitive(primitive, {0, first, vertices}, true, limits, shared, offset, nullptr,
                                       [&](uint64_t done) { last = done; }));
  CHECK(last == 2 * (vertices + copy.triangle_count()));
  CHECK(shared->size().value() == offset + sort_needs(primitive, vertices, true).kept_file_bytes);
  CHECK(std::filesystem::is_empty(folder.path()));
  return copy;
}

/// Checks that `copy` has all triangles of the source, each once and with its vertices' values. `degenerate`: the
/// degenerate triangles must be in it too.
void check_copy(const Primitive& source, const Primitive& copy, bool degenerate) {
  const std::vector<uint32_t> from = all_corners(source), to = all_corners(copy);
  const std::vector<uint32_t> triangles = all_numbers(copy.numbers->triangles);
  const std::vector<uint32_t> vertices = all_numbers(copy.numbers->vertices);
  REQUIRE(copy.mode == PrimitiveMode::kTriangles);
  REQUIRE(triangles.size() == copy.triangle_count());
  std::vector<bool> seen(source.triangle_count());
  bool same = true;
  for (size_t t = 0; t < triangles.size(); ++t) {
    REQUIRE(triangles[t] < seen.size());
    REQUIRE_FALSE(seen[triangles[t]]);
    seen[triangles[t]] = true;
    for (size_t n = 0; n < 3; ++n)
      same &= copy.numbers->first_vertex + vertices[to[3 * t + n]] == from[3 * size_t{triangles[t]} + n];
  }
  CHECK(same);
  for (size_t t = 0; t < seen.size(); ++t) {
    const uint32_t* c = &from[3 * t];
    const bool joins = c[0] == c[1] || c[1] == c[2] || c[2] == c[0];
    if (seen[t] == (joins && !degenerate)) FAIL("source triangle " << t);
  }
  const auto check_values = [&](const Accessor& a, const Accessor& b) {
    REQUIRE((a.type == b.type && a.normalized == b.normalized && a.components == b.components));
    const std::vector<float> before = all_values(a), after = all_values(b);
    bool equal = true;
    for (size_t v = 0; v < vertices.size(); ++v)
      for (size_t c = 0; c < a.components; ++c)
        equal &= after[a.components * v + c] ==
                 before[a.components * (size_t{copy.numbers->first_vertex} + vertices[v]) + c];
    CHECK(equal);
  };
  check_values(source.positions, copy.positions);
  check_values(*source.uv, *copy.uv);
  check_values(*source.color, *copy.color);
  check_values(*source.normal, *copy.normal);
}

/// The sum of the vertices that runs of 4096 triangles use, divided by the number of all vertices.
double repeats(const Primitive& primitive) {
  const std::vector<uint32_t> corners = all_corners(primitive);
  uint64_t distinct = 0;
  for (size_t first = 0; first < corners.size(); first += 3 * 4096) {
    std::vector<uint32_t> run(
        corners.begin() + static_cast<std::ptrdiff_t>(first),
        corners.begin() + static_cast<std::ptrdiff_t>(std::min(corners.size(), first + 3 * 4096)));
    std::sort(run.begin(), run.end());
    distinct += static_cast<uint64_t>(std::unique(run.begin(), run.end()) - run.begin());
  }
  return static_cast<double>(distinct) / static_cast<double>(primitive.vertex_count());
}

/// Writes meshes of a grid of 532,480 triangles (three windows), in order or not. With `broken`, one vertex is not
/// finite. Returns that vertex's number.
uint32_t make_grid_file(const std::string& path, bool in_order, size_t meshes = 1, bool broken = false) {
  constexpr uint32_t kColumns = 520, kRows = 512, kWidth = kColumns + 1;
  std::mt19937 random(3);
  std::vector<uint32_t> number(kWidth * (kRows + 1));
  std::iota(number.begin(), number.end(), 0u);
  if (!in_order) std::shuffle(number.begin(), number.end(), random);
  std::vector<float> points(3 * number.size());
  for (uint32_t i = 0; i < number.size(); ++i) {
    const float u = static_cast<float>(i % kWidth) / kColumns, v = static_cast<float>(i / kWidth) / kColumns;
    const float place[3] = {u, 0.1f * std::sin(7 * u) * std::cos(5 * v), v};
    std::copy_n(place, 3, &points[3 * size_t{number[i]}]);
  }
  if (broken) points[3 * size_t{number[1000]} + 1] = NAN;
  std::vector<std::array<uint32_t, 3>> triangles;
  for (uint32_t i = 0; i < kWidth * kRows; ++i) {
    if (i % kWidth == kColumns) continue;
    triangles.push_back({number[i], number[i + kWidth], number[i + 1]});
    triangles.push_back({number[i + 1], number[i + kWidth], number[i + kWidth + 1]});
  }
  if (!in_order) std::shuffle(triangles.begin(), triangles.end(), random);
  std::vector<uint32_t> corners;
  for (const auto& triangle : triangles) corners.insert(corners.end(), triangle.begin(), triangle.end());
  ModelMaker maker(path);
  for (size_t i = 0; i < meshes; ++i)
    maker.node("node", maker.mesh("mesh", {maker.primitive(points, corners)}), {static_cast<double>(i), 0, 0});
  maker.finish();
  return number[1000];
}

}  // namespace

TEST_CASE("sort: primitives with and without locality are distinguished", "[sort]") {
  CHECK(vertices_read({}) == 0);
  CHECK(vertices_read(std::vector<uint32_t>{7}) == 1);
  CHECK(vertices_read(std::vector<uint32_t>{7, 8, 10}) == 4);
  CHECK(vertices_read(std::vector<uint32_t>{0, 341, 341 + 342}) == 343);
  const auto used = [](uint64_t triangles, uint64_t far, uint64_t distinct, uint32_t last) {
    return VertexUse{triangles, far, distinct, 0, last};
  };
  CHECK_FALSE(VertexUse{}.has_no_locality());
  CHECK_FALSE(used(1000, 0, 500, 499).has_no_locality());
  CHECK_FALSE(used(1000, 0, 750, 499).has_no_locality());
  CHECK(used(1000, 0, 751, 499).has_no_locality());
  CHECK_FALSE(used(1000, 500, 500, 499).has_no_locality());
  CHECK(used(1000, 501, 500, 499).has_no_locality());
  CHECK(used(1000, 1000, 3000, 3999).has_no_locality());
  CHECK_FALSE(used(1000, 1000, 3000, 4000).has_no_locality());  // most vertices belong to another primitive
}

TEST_CASE("sort: the copy is the primitive in sorted order, for any memory and threads", "[sort]") {
  const TempFolder folder;
  const auto check = [&](const Primitive& primitive, uint32_t first, bool degenerate) {
    const Primitive copy = must_sort(folder, primitive, first, {1, UINT64_MAX});
    check_copy(primitive, copy, degenerate);
    for (const SortLimits limits : {SortLimits{3, UINT64_MAX}, SortLimits{2, primitive.vertex_count() / 3}}) {
      const Primitive other = must_sort(folder, primitive, first, limits, 12345);
      CHECK((all_corners(other) == all_corners(copy)));
      CHECK((all_numbers(other.numbers->triangles) == all_numbers(copy.numbers->triangles)));
      CHECK((all_numbers(other.numbers->vertices) == all_numbers(copy.numbers->vertices)));
      CHECK((all_values(*other.color) == all_values(*copy.color)));
    }
    return copy;
  };
  SECTION("triangles, several buckets") {
    const Primitive grid = shuffled(300, 50, PrimitiveMode::kTriangles);
    CHECK(repeats(grid) > 3);
    CHECK(repeats(check(grid, 50, true)) < 1.2);
  }
  SECTION("a few") {
    check(shuffled(2, 0, PrimitiveMode::kTriangles), 0, true);
  }
  SECTION("strips and fans") {
    check(shuffled(12, 3, PrimitiveMode::kStrip), 3, false);
    check(shuffled(12, 3, PrimitiveMode::kFan), 3, false);
  }
  SECTION("a strip joined through a vertex that no visible triangle uses") {
    Primitive strip = shuffled(12, 3, PrimitiveMode::kStrip);
    std::vector<uint32_t> corners = all_numbers(*strip.indices);
    const std::vector<uint32_t> joint{corners[299], corners[299], 0, 0, 0, corners[300], corners[300]};
    corners.insert(corners.begin() + 300, joint.begin(), joint.end());
    strip.indices = accessor_of(corners, 1, ComponentType::kUint32);
    check(strip, 3, false);
  }
  SECTION("more triangles than a bucket's piece") {
    check(shuffled(20, 0, PrimitiveMode::kTriangles, 3 * 263000), 0, true);
  }
}

TEST_CASE("sort: points that are not finite or all equal are sorted", "[sort]") {
  const TempFolder folder;
  Primitive primitive = shuffled(30, 0, PrimitiveMode::kTriangles);
  std::vector<float> positions = all_values(primitive.positions);
  positions[30] = NAN;
  positions[34] = INFINITY;
  positions[38] = -INFINITY;
  positions[60] = 1e30f;
  primitive.positions = accessor_of(positions, 3, ComponentType::kFloat32);
  CHECK(
      (all_numbers(must_sort(folder, primitive, 0, {2, 100}).numbers->triangles).size() == primitive.triangle_count()));
  // Far vertices must not reduce the resolution of the others.
  Primitive large = shuffled(300, 50, PrimitiveMode::kTriangles);
  std::vector<float> with_far = all_values(large.positions);
  for (const size_t v : {20, 4000, 70000}) std::fill_n(&with_far[3 * v], 3, 1e30f);
  large.positions = accessor_of(with_far, 3, ComponentType::kFloat32);
  CHECK(repeats(must_sort(folder, large, 0, {2, UINT64_MAX})) < 1.2);
  primitive.positions = accessor_of(std::vector<float>(positions.size(), 3.5f), 3, ComponentType::kFloat32);
  check_copy(primitive, must_sort(folder, primitive, 0, {2, UINT64_MAX}), true);
}

TEST_CASE("sort: samples that do not represent the vertices do no harm", "[sort]") {
  const TempFolder folder;
  Primitive primitive = shuffled(400, 0, PrimitiveMode::kTriangles);
  std::vector<float> positions = all_values(primitive.positions);
  for (size_t v = 0; v < positions.size() / 3; ++v)  // all except the sampled vertices lie at one point
    if (v % (160000 / (64 * 5)) != 0) std::fill_n(&positions[3 * v], 3, 5.5f);
  primitive.positions = accessor_of(positions, 3, ComponentType::kFloat32);
  check_copy(primitive, must_sort(folder, primitive, 0, {2, UINT64_MAX}), true);
}

TEST_CASE("sort: a source that has changed is an error", "[sort]") {
  const TempFolder folder;
  const Primitive primitive = shuffled(12, 4, PrimitiveMode::kTriangles);
  const std::shared_ptr<const format::PartFile> file = make_file(folder);
  for (const ScatteredPrimitive& measured : {ScatteredPrimitive{0, 5, 143}, ScatteredPrimitive{0, 4, 143}}) {
    check_refusal(sort_primitive(primitive, measured, true, {1, UINT64_MAX}, file, 0, nullptr, [](uint64_t) {}),
                  {ErrorCode::kFormat, "mesh 0 primitive 0 changed while it was converted"});
  }
}

TEST_CASE("sort: a shuffled mesh becomes as small as an ordered one", "[sort][convert]") {
  const TempFolder folder;
  make_grid_file(folder.file("ordered.glb"), true);
  make_grid_file(folder.file("in.glb"), false);
  ConvertOptions options = options_of(folder, "ordered.glb");
  options.source_ids = false;
  const ConvertReport ordered = must_convert(options);
  CHECK(ordered.sorted_triangles == 0);
  options.input = folder.file("in.glb");
  options.threads = 1;
  const ConvertReport sorted = must_convert(options);
  CHECK(sorted.sorted_triangles == 532480);
  CHECK(sorted.sort_file_bytes > uint64_t{16} * 532480);
  CHECK(sorted.triangles == ordered.triangles);
  CHECK(static_cast<double>(sorted.output_bytes) < 1.1 * static_cast<double>(ordered.output_bytes));
  const std::string reference = tests::read_whole(options.output);
  options.threads = 3;
  must_convert_within(options, 1);
  CHECK((tests::read_whole(options.output) == reference));
  options.memory = ConvertOptions().memory;
  options.order = Order::kNone;  // keeps the source's order
  CHECK(must_convert(options).sorted_triangles == 0);
  CHECK((folder.names() == std::vector<std::string>{"in.glb", "ordered.glb", "out.scree"}));
}

TEST_CASE("sort: triangles keep their numbers, and equal meshes are stored once", "[sort][convert]") {
  const TempFolder folder;
  make_grid_file(folder.file("in.glb"), false, 2);
  ConvertOptions options = options_of(folder);
  options.encoding = convert::Encoding::kClustered;
  CHECK(must_match(options).sorted_triangles == 2 * 532480);
  CHECK(tests::must_open(options.output).file.meshes().size() == 1);
}

TEST_CASE("sort: the error of a position names the source's vertex", "[sort][convert]") {
  const TempFolder folder;
  const uint32_t vertex = make_grid_file(folder.file("in.glb"), false, 1, true);
  ConvertOptions options = options_of(folder);
  must_fail(options, ErrorCode::kRange, "mesh 0 primitive 0: vertex " + std::to_string(vertex) + ": position (");
  CHECK((folder.names() == std::vector<std::string>{"in.glb"}));
  options.drop_nonfinite = true;
  const ConvertReport report = must_match(options);
  CHECK(report.dropped_nonfinite == 6);
  CHECK(report.sorted_triangles == 532480);
}

TEST_CASE("sort: the temporary file disappears, however the program ends", "[sort][convert]") {
  const TempFolder folder;
  make_grid_file(folder.file("in.glb"), false);
  const std::string program = "cd \"" + folder.path().string() + "\" && ";
  // A limit of the file's size acts like a full disk.
  const std::string limited =
      "trap '' XFSZ; ulimit -f 4000; \"" + std::string(tests::kProgram) + "\" convert in.glb -o out.scree >log 2>&1";
  const int status = std::system((program + limited).c_str());
  REQUIRE(WIFEXITED(status));
  CHECK(WEXITSTATUS(status) == 2);
  const std::string said = tests::read_whole(folder.file("log"));
  CHECK(said.find("out.scree.sorted.part: write: File too large\n") != std::string::npos);
  CHECK(std::count(said.begin(), said.end(), '\n') == 1);
  CHECK((folder.names() == std::vector<std::string>{"in.glb", "log"}));

  const std::vector<std::string> words{"convert", folder.file("in.glb"), "-o", folder.file("out.scree"), "--quiet"};
  for (const int end : {SIGINT, SIGKILL}) {
    for (const int milliseconds : {30, 100, 300}) {
      const pid_t child = tests::start_program(words, folder.file("log"));
      std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
      kill(child, end);
      tests::wait_for(child);
      for (const std::string& name : folder.names()) {
        CAPTURE(name);
        // The process may be killed after it has created the temporary file and before it has unlinked it.
        const bool may_be_left = name == "out.scree.part" || name == "out.scree.sorted.part";
        CHECK((name == "in.glb" || name == "log" || name == "out.scree" || (end == SIGKILL && may_be_left)));
      }
      for (const char* name : {"out.scree", "out.scree.part", "out.scree.sorted.part"})
        std::filesystem::remove(folder.file(name));
    }
  }
}

TEST_CASE("sort: a conversion that sorts is resumed", "[sort][convert]") {
  const TempFolder folder;
  make_grid_file(folder.file("in.glb"), false);
  const auto words = [&](const std::string& output) {
    return std::vector<std::string>{
        "convert", folder.file("in.glb"), "-o", folder.file(output), "--resume", "--force", "--zstd", "9"};
  };
  REQUIRE(tests::run_program(words("whole.scree"), folder.file("log")).exit_code == 0);
  const std::string part = folder.file("out.scree.part");
  const pid_t child = tests::start_program(words("out.scree"), folder.file("log"));
  tests::wait_until([&] { return tests::has_ended(child) || tests::disk_bytes(part) > 4000 * 512; });
  kill(child, SIGKILL);
  tests::wait_for(child);
  const bool is_unfinished = std::filesystem::exists(part);
  const tests::ProgramRun resumed = tests::run_program(words("out.scree"), folder.file("log"));
  CHECK(resumed.exit_code == 0);
  if (is_unfinished) CHECK(resumed.output.find("resumed after ") != std::string::npos);
  CHECK((tests::read_whole(folder.file("out.scree")) == tests::read_whole(folder.file("whole.scree"))));
}
