// Sessions: hidden nodes, including blended ones, are left out on the CPU and on a GPU, and come back.
#include "tools/view/session.h"

#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

#include "tests/catch.h"
#include "tests/gpu.h"
#include "tests/models.h"
#include "tests/tools/convert/convert_fixture.h"

using namespace scree;
using namespace scree::tools::view;
using scree::tests::TempFolder;

namespace {

ViewSession open(const std::string& path, tools::BackendChoice choice) {
  SessionOptions options;
  options.file = path;
  options.threads = 2;
  options.backend.choice = choice;
  options.quiet = true;
  Result<ViewSession> session = ViewSession::open(options);
  if (!session) FAIL(session.error().message);
  return std::move(*session);
}

using Rgb = std::vector<uint8_t>;

/// Eight quads in two rows; node 5 is blended.
Rgb draw(ViewSession& session, const Visibility& visibility, uint32_t viewer = 0) {
  PictureRequest request;
  request.camera.eye = {3.75, 1.25, 9};
  request.camera.target = {3.75, 1.25, 0};
  request.shade.background[3] = 1;
  const Result<Drawn> drawn = session.draw(viewer, request, 120, 60, 1, visibility);
  if (!drawn) FAIL(drawn.error().message);
  const PixelView& pixels = drawn->pixels;
  Rgb out;
  for (size_t i = 0; i < pixels.bytes.size(); ++i)
    if (i % pixels.channels < 3) out.push_back(pixels.bytes[i]);
  return out;
}

/// The number of channels that differ by more than one level, the tolerance of shading with floats.
size_t differing(const Rgb& a, const Rgb& b) {
  REQUIRE(a.size() == b.size());
  size_t count = 0;
  for (size_t i = 0; i < a.size(); ++i) count += std::abs(a[i] - b[i]) > 1 ? 1 : 0;
  return count;
}

}  // namespace

TEST_CASE("hidden nodes, opaque and blended, are left out on the CPU and on a GPU", "[view][cuda][omitted]") {
  const TempFolder folder;
  convert::ConvertOptions options = tests::options_of(folder);
  options.input = tests::data_path("materials.gltf").string();
  options.encoding = GENERATE(convert::Encoding::kIndexed, convert::Encoding::kClustered);
  tests::must_convert(options);
  ViewSession cpu = open(options.output, tools::BackendChoice::kCpu);
  const std::vector<Visibility> all_kinds{{}, {{5}, {}}, {{1, 6}, {}}, {{}, {5}}, {{5}, {5}}, {}};
  std::vector<Rgb> expected;
  for (const Visibility& visibility : all_kinds) expected.push_back(draw(cpu, visibility));
  CHECK(expected.back() == expected.front());
  for (size_t i = 1; i + 1 < expected.size(); ++i) CHECK(differing(expected[i], expected[i - 1]) > 100);
  // The node's name and its instance's number are those of the whole scene.
  draw(cpu, {{0, 1}, {}});
  const auto picked = cpu.pick({75, 20});
  REQUIRE(picked);
  REQUIRE(picked->has_value());
  CHECK((*picked)->node == 6);
  CHECK((*picked)->instance == 6);
  if (!tests::has_gpu()) return;
  ViewSession gpu = open(options.output, tools::BackendChoice::kCuda);
  std::vector<Rgb> found;
  for (size_t i = 0; i < all_kinds.size(); ++i) {
    INFO("visibility " << i);
    if (i == 3) {  // from now on the scene is resident
      const Result<uint64_t> left = gpu.load_rest({});
      REQUIRE(left);
      CHECK(*left == 0);
    }
    found.push_back(draw(gpu, all_kinds[i]));
    CHECK(differing(found[i], expected[i]) == 0);
  }
  CHECK(found.back() == found.front());
  // Viewers take turns. Each has its own picture again, even without drawing, and picks in it.
  for (const uint32_t round : {0, 1, 2}) {
    INFO("round " << round);
    if (round == 2) gpu.forget(1);
    CHECK(draw(gpu, all_kinds[1], 1) == found[1]);
    CHECK(draw(gpu, all_kinds[2], 2) == found[2]);
    CHECK(draw(gpu, {}, 0) == found[0]);
    CHECK(draw(gpu, all_kinds[2], 2) == found[2]);
    const auto at_hidden = gpu.pick({75, 20});
    draw(gpu, {{0, 1}, {}}, 1);
    const auto at_shown = gpu.pick({75, 20});
    REQUIRE(at_hidden);
    REQUIRE(at_shown);
    CHECK(!at_hidden->has_value());
    REQUIRE(at_shown->has_value());
    CHECK((*at_shown)->node == 6);
  }
}
