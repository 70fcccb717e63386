// Streamed frames compared with frames of the whole scene in memory: every sample and every byte of the picture.
#include "runtime/stream/streamer.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "runtime/scene/camera.h"
#include "tests/kernels/omitted_cases.h"
#include "tests/models.h"
#include "tests/runtime/frame.h"
#include "tests/runtime/paged_scene.h"
#include "tests/runtime/soup.h"
#include "tests/runtime/stream/cpu_stream.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/jpeg_model.h"

using namespace scree;
using namespace scree::runtime;
using namespace scree::tests;
using namespace scree::kernels;

namespace {

Scene open_scene(const std::string& path, bool pages) {
  return must_load(path, {.threads = 2, .texture_cache = uint64_t{1} << 20, .pages = pages});
}

struct Pool {
  uint64_t least = 0;  // room for the largest chunk
  uint64_t all = 0;    // room for all chunks
};

Pool pool_of(const Scene& scene) {
  Pool pool;
  for (const uint64_t bytes : runtime::ChunkSource(scene).chunk_bytes()) {
    if (bytes == 0) continue;
    const uint64_t room = (bytes + Residency::kAlignment - 1) / Residency::kAlignment * Residency::kAlignment;
    pool.least = std::max(pool.least, room);
    pool.all += room;
  }
  return pool;
}

/// A camera at a random point around or inside the scene that looks at a random point in it. Every fourth one is
/// orthographic.
View random_view(const Scene& scene, std::mt19937& random, uint32_t width, uint32_t height) {
  const runtime::WorldBox box = runtime::scene_box(scene.view());
  std::uniform_real_distribution<double> unit(0, 1);
  const double reach = random() % 2 == 0 ? 1.2 : 0.2;  // outside, or close
  runtime::CameraOptions options;
  runtime::Vec3 eye, target;
  for (size_t i = 0; i < 3; ++i) {
    const double side = std::max(box.max[i] - box.min[i], 0.5);
    eye[i] = box.min[i] + side * (unit(random) * (1 + 2 * reach) - reach);
    target[i] = box.min[i] + side * unit(random);
  }
  options.eye = eye;
  options.target = target;
  options.fov_degrees = 25 + 90 * unit(random);
  options.width = width;
  options.height = height;
  View view = must(runtime::make_view(scene, options));
  if (random() % 4 == 0) {
    double size = 0;
    for (size_t i = 0; i < 3; ++i) size = std::max(size, box.max[i] - box.min[i]);
    view.orthographic = true;
    view.half_width = size * (0.1 + unit(random) / 2);
    view.half_height = view.half_width * height / width;
    view.z_near = -size;
    view.z_far = 3 * size;
  }
  return view;
}

/// Shading options, with every kind of picture in turn.
ShadeOptions shade_options(uint32_t number) {
  constexpr Show kShows[] = {Show::kTexture, Show::kTexture,  Show::kColor, Show::kUv,   Show::kNormal,  Show::kTexture,
                             Show::kCluster, Show::kTriangle, Show::kStage, Show::kMesh, Show::kTexture, Show::kDepth};
  ShadeOptions options{.show = kShows[number % std::size(kShows)], .ssao = number % 3 == 1, .edl = number % 5 == 1};
  options.light = number % 7 != 3;
  options.background[3] = number % 2 == 0 ? 1.0f : 0.25f;
  options.background[1] = 0.5f;
  return options;
}

/// Two scenes of one file. One has all of its pages in memory.
class Compared {
 public:
  explicit Compared(const std::string& path) : whole_(open_scene(path, true)), paged_(open_scene(path, false)) {}

  const Scene& whole() const { return whole_; }
  const Scene& paged() const { return paged_; }
  Pool pool() const { return pool_of(paged_); }

  std::unique_ptr<CpuStream> stream(uint64_t pool_bytes, uint32_t threads = 2) const {
    return must(CpuStream::create(paged_, pool_bytes, threads));
  }

  /// Draws both and compares them. `view`: in pixels.
  StreamStats draw(CpuStream& stream, const View& view, uint32_t samples_per_side, const ShadeOptions& shade) const {
    const Frame expected = must_draw(whole_, view, samples_per_side);
    View fine = view;
    fine.width *= samples_per_side;
    fine.height *= samples_per_side;
    const StreamStats stats = must(stream.draw_frame(fine, &shade));
    REQUIRE(std::ranges::equal(stream.samples(), expected.samples()));
    REQUIRE(must(stream.picture(samples_per_side)) == must(expected.shade(shade, 2)));
    REQUIRE(stats.streamed_bytes + stats.hidden_bytes == stats.missing_bytes);
    // Layers of blended surfaces add chunks that are missing for them.
    if (whole_.view().blend_masks == nullptr) REQUIRE(stats.missing_bytes <= stats.seen_bytes);
    return stats;
  }

 private:
  Scene whole_, paged_;
};

struct Totals {
  uint64_t frames = 0, streamed = 0, hidden = 0, moved = 0;
};

/// Compares paths of random cameras, with pools from the least size to one that holds everything. Each view comes
/// twice.
Totals compare_paths(const Compared& scene, uint32_t seed, uint32_t views = 4) {
  std::mt19937 random(seed);
  const Pool pool = scene.pool();
  Totals totals;
  uint32_t number = seed;
  for (const uint64_t bytes : {pool.least, 2 * pool.least + 300, pool.all / 4, pool.all / 2 + pool.least, pool.all}) {
    const std::unique_ptr<CpuStream> stream = scene.stream(std::max(bytes, pool.least), 1 + seed % 3);
    for (uint32_t i = 0; i < views; ++i) {
      const uint32_t side = i == 1 ? 2 : i == 3 ? 4 : 1;
      const View view = random_view(scene.whole(), random, 97, 61);
      ++number;
      const StreamStats first = scene.draw(*stream, view, side, shade_options(number));
      const StreamStats again = scene.draw(*stream, view, side, shade_options(number + 6));
      REQUIRE(again.seen_bytes == first.seen_bytes);
      // Once everything fits, drawn chunks stay, and hidden chunks are not loaded again. Layers of blended surfaces may
      // first show in the second frame.
      if (bytes == pool.all && scene.whole().view().blend_masks == nullptr) {
        REQUIRE(first.hidden_bytes == again.hidden_bytes);
        REQUIRE(again.streamed_bytes == 0);
      }
      totals.frames += 2;
      for (const StreamStats& stats : {first, again}) {
        totals.streamed += stats.streamed_bytes;
        totals.hidden += stats.hidden_bytes;
        totals.moved += stats.moved_bytes;
      }
    }
  }
  return totals;
}

/// Textured, coloured and plain grids, near and far, above and behind each other, some of them drawn many times.
void make_layers(const std::string& path) {
  ModelMaker maker(path);
  const GridSpec spec{.columns = 30, .rows = 30, .uv = true, .color = true, .normal = true};
  const uint32_t pictured = maker.textured("t", format::ImageCodec::kPng, scree::tests::four_colors_png());
  const uint32_t hills = maker.mesh("hills", {maker.grid(spec, pictured)});
  for (int i = 0; i < 9; ++i) maker.node("h" + std::to_string(i), hills, {1.0 * (i % 3), -0.02 * i, 1.0 * (i / 3)});
  const GridSpec ground{.columns = 12, .rows = 12, .size = 6, .origin = {-1.5f, -1, -1.5f}, .flat = true};
  maker.draw("ground", {maker.grid(ground)});
  GridSpec deep = ground;
  deep.columns = deep.rows = 40;
  deep.size = 4;
  deep.origin = {-0.5f, -3, -0.5f};
  deep.color = true;
  maker.draw("deep", {maker.grid(deep)});
  maker.finish();
}

Compared convert_layers(const TempFolder& folder, convert::ConvertOptions options) {
  make_layers(folder.file("in.glb"));
  options.input = folder.file("in.glb");
  options.output = folder.file("out.scree");
  options.threads = 2;
  scree::tests::must_convert(options);
  return Compared(options.output);
}

Soup random_soup(uint32_t triangles, std::mt19937& random) {
  std::uniform_real_distribution<double> unit(-1, 1);
  Soup soup;
  for (uint32_t i = 0; i < triangles; ++i) {
    const double x = unit(random), y = unit(random), z = 3 * unit(random);
    const auto corner = [&] {
      return soup.add(x + 0.15 * unit(random), y + 0.15 * unit(random), z + 0.15 * unit(random));
    };
    const uint32_t a = corner(), b = corner(), c = corner();
    soup.triangle(a, b, c);
  }
  return soup;
}

}  // namespace

TEST_CASE("streamed pictures equal the whole scene's: one encoding each", "[streamer]") {
  convert::ConvertOptions options;
  options.chunk_triangles = 150;
  options.normals = convert::Normals::kAlways;
  uint32_t seed = 1;
  SECTION("indexed") {
    options.encoding = convert::Encoding::kIndexed;
  }
  SECTION("clustered") {
    options.encoding = convert::Encoding::kClustered;
    options.chunk_triangles = 400;
    seed = 2;
  }
  SECTION("float32") {
    options.float32 = true;
    seed = 3;
  }
  SECTION("compressed") {
    options.zstd_level = 3;
    seed = 4;
  }
  const TempFolder folder;
  const Totals totals = compare_paths(convert_layers(folder, options), seed);
  CHECK(totals.frames == 40);
  CHECK(totals.streamed > 0);
}

TEST_CASE("streamed pictures equal the whole scene's: mixed encodings in pages of several chunks", "[streamer]") {
  std::mt19937 random(5);
  std::vector<std::pair<Soup, Encoding>> meshes;
  for (int i = 0; i < 6; ++i) meshes.emplace_back(random_soup(500, random), encoding_of(i));
  const TempFolder folder;
  const PagedScene paged{.chunk_triangles = 120, .drawn_twice = true};
  paged.write(folder.file("mixed.scree"), meshes);
  CHECK(compare_paths(Compared(folder.file("mixed.scree")), 5).streamed > 0);
}

TEST_CASE("streamed pictures equal the whole scene's: JPEG textures decoded on demand", "[streamer]") {
  const TempFolder folder;
  scree::tests::make_jpeg_model(folder.file("in.glb"));
  convert::ConvertOptions options = scree::tests::options_of(folder);
  options.encoding = GENERATE(convert::Encoding::kIndexed, convert::Encoding::kClustered);
  options.chunk_triangles = 4;
  scree::tests::must_convert(options);
  CHECK(compare_paths(Compared(folder.file("out.scree")), 6, 3).streamed > 0);
}

/// out.scree: a file of tests/data with a chunk per triangle.
static void convert_by_triangles(const char* name, const TempFolder& folder) {
  convert::ConvertOptions options = scree::tests::options_of(folder, scree::tests::data_path(name));
  options.chunk_triangles = 1;
  scree::tests::must_convert(options);
}

TEST_CASE("streamed pictures equal the whole scene's: files of tests/data", "[streamer]") {
  for (const char* name : {"gpu_instancing.glb", "two_instances.gltf", "textured_cube.glb", "materials.gltf"}) {
    INFO(name);
    const TempFolder folder;
    convert_by_triangles(name, folder);
    compare_paths(Compared(folder.file("out.scree")), 7, 2);
  }
}

TEST_CASE("pictures that do not wait for all chunks end with the whole picture", "[streamer]") {
  const TempFolder folder;
  convert::ConvertOptions options;
  options.chunk_triangles = 60;
  options.encoding = GENERATE(convert::Encoding::kIndexed, convert::Encoding::kClustered);
  const Compared scene = convert_layers(folder, options);
  const View view = must_view(scene.whole(), {.width = 97, .height = 61});
  const Frame whole = must_draw(scene.whole(), view);
  const std::unique_ptr<CpuStream> stream = scene.stream(scene.pool().all);
  const ShadeOptions shade;
  uint64_t left = UINT64_MAX;
  int frames = 0;
  while (left != 0) {
    bool has_asked = false;
    const StreamStats stats = must(stream->draw_frame(view, &shade, [&] { return std::exchange(has_asked, true); }));
    REQUIRE(stats.left_bytes < left);
    left = stats.left_bytes;
    // Every sample equals the whole picture's or lies behind it.
    REQUIRE(stream->samples().size() == whole.samples().size());
    bool is_behind = false;
    for (size_t i = 0; i < whole.samples().size(); ++i) {
      REQUIRE(stream->samples()[i] >= whole.samples()[i]);
      is_behind = is_behind || stream->samples()[i] != whole.samples()[i];
    }
    CHECK((left != 0 || !is_behind));
    if (frames++ == 0) CHECK(is_behind);
  }
  CHECK(frames > 2);
  scene.draw(*stream, view, 2, shade);

  uint64_t rest = UINT64_MAX;
  int calls = 0;
  while (rest != 0) {
    const uint64_t less = must(stream->load_rest([] { return true; }));
    REQUIRE(less < rest);
    rest = less;
    ++calls;
  }
  CHECK(calls > 0);
  CHECK(scene.draw(*stream, view, 1, shade).missing_bytes == 0);
  // A pool that is too small for all chunks keeps some of them permanently.
  const std::unique_ptr<CpuStream> small = scene.stream(scene.pool().all / 2);
  const uint64_t kept_out = must(small->load_rest());
  CHECK(kept_out > 0);
  CHECK(*small->load_rest() == kept_out);
  scene.draw(*small, view, 1, shade);
}

TEST_CASE("streamed pictures leave out omitted instances, whose chunks are not loaded", "[streamer][omitted]") {
  for (const char* name : {"gpu_instancing.glb", "materials.gltf"}) {
    INFO(name);
    const TempFolder folder;
    convert_by_triangles(name, folder);
    const Compared scene(folder.file("out.scree"));
    const View view = must_view(scene.whole(), {.width = 97, .height = 61});
    const std::unique_ptr<CpuStream> stream = scene.stream(scene.pool().least);
    const StreamStats all = scene.draw(*stream, view, 1, {});
    const uint64_t instances = scene.whole().view().instance_count;
    for (const uint32_t seed : {1u, 2u}) {
      const std::vector<uint32_t> bits = scree::tests::random_omitted(instances, seed);
      const StreamStats some = scene.draw(*stream, scree::tests::omitting(view, bits.data()), 1, {});
      CHECK(some.drawn.triangles < all.drawn.triangles);
    }
    const std::vector<uint32_t> none((instances + 31) / 32, ~0u);
    CHECK(scene.draw(*stream, scree::tests::omitting(view, none.data()), 1, {}).seen_chunks == 0);
    CHECK(scene.draw(*stream, view, 1, {}).seen_bytes == all.seen_bytes);
  }
}

TEST_CASE("streamed pictures equal the whole scene's: real models", "[streamer][models]") {
  const std::filesystem::path root = scree::tests::real_models("scenes");
  if (root.empty()) return;
  for (const char* name : {"DamagedHelmet", "InstanceTest", "Fox"}) {
    INFO(name);
    const std::vector<std::filesystem::path> files = scree::tests::model_files(root / name);
    REQUIRE_FALSE(files.empty());
    const std::filesystem::path& input = files.back();
    const TempFolder folder;
    convert::ConvertOptions options = scree::tests::options_of(folder);
    options.input = input.string();
    options.chunk_triangles = 300;
    scree::tests::must_convert(options);
    compare_paths(Compared(folder.file("out.scree")), 8, 2);
  }
}

TEST_CASE("chunks that are already loaded are not streamed again along a path", "[streamer]") {
  const TempFolder folder;
  const Compared scene = convert_layers(folder, {.chunk_triangles = 60});
  const Pool pool = scene.pool();
  const std::unique_ptr<CpuStream> stream = scene.stream(pool.all / 2 + pool.least);
  // On one turn around the scene, about half of it is visible at a time.
  uint64_t streamed = 0, seen = 0;
  runtime::CameraOptions camera{.fov_degrees = 50, .width = 120, .height = 80};
  constexpr int kSteps = 24;
  for (int i = 0; i < kSteps; ++i) {
    const double angle = 2 * std::numbers::pi * i / kSteps;
    camera.eye = runtime::Vec3{1.5, 0.4, 1.5};
    camera.target = runtime::Vec3{1.5 + std::cos(angle), 0, 1.5 + std::sin(angle)};
    const View view = must_view(scene.whole(), camera);
    const StreamStats stats = scene.draw(*stream, view, 1, shade_options(0));
    REQUIRE(stats.streamed_bytes <= stats.missing_bytes);
    streamed += stats.streamed_bytes;
    seen += stats.seen_bytes;
  }
  CAPTURE(streamed, seen, pool.all);
  CHECK(streamed > 0);
  // If no chunk stayed from frame to frame, everything visible would be loaded.
  CHECK(streamed < seen / 3);
}

TEST_CASE("hidden chunks are not loaded, in later frames either", "[streamer]") {
  const TempFolder folder;
  const Compared scene = convert_layers(folder, {.chunk_triangles = 60});
  runtime::CameraOptions camera{
      .eye = runtime::Vec3{1.5, 9, 1.5}, .target = runtime::Vec3{1.5, 0, 1.49}, .width = 120, .height = 80};
  const View view = must_view(scene.whole(), camera);
  const std::unique_ptr<CpuStream> stream = scene.stream(scene.pool().all);
  const StreamStats first = scene.draw(*stream, view, 2, shade_options(0));
  CHECK(first.missing_bytes == first.seen_bytes);
  // From above, the ground hides the whole mesh below it, which has the most triangles.
  uint64_t below = 0;
  const scree::kernels::SceneView& records = scene.paged().view();
  for (uint64_t c = 0; c < records.chunk_count; ++c)
    if (records.meshes[records.chunks[c].mesh].triangle_count == 3200) below += records.chunks[c].bytes;
  // The first three of eight batches are chosen before the ground is drawn.
  CHECK(first.hidden_bytes > below / 4);
  const StreamStats again = scene.draw(*stream, view, 2, shade_options(0));
  CHECK(again.hidden_bytes == first.hidden_bytes);
  CHECK(again.streamed_bytes == 0);
  // From below, the one-sided ground hides nothing.
  camera.eye = runtime::Vec3{1.5, -2, 1.5};
  camera.target = runtime::Vec3{1.5, -3, 1.49};
  CHECK(scene.draw(*stream, must_view(scene.whole(), camera), 1, shade_options(0)).streamed_bytes > 0);
}

TEST_CASE("a still camera with a small pool streams the missing chunks, and near chunks stay", "[streamer]") {
  const TempFolder folder;
  const Compared scene = convert_layers(folder, {.chunk_triangles = 60});
  const Pool pool = scene.pool();
  const std::unique_ptr<CpuStream> stream = scene.stream(pool.all / 3);
  const View view = must_view(scene.whole(), {.width = 120, .height = 80});
  const StreamStats first = scene.draw(*stream, view, 1, shade_options(0));
  CHECK(first.missing_bytes == first.seen_bytes);
  for (int i = 0; i < 3; ++i) {
    const StreamStats again = scene.draw(*stream, view, 1, shade_options(0));
    CHECK(again.missing_bytes + pool.all / 4 <= again.seen_bytes);  // most of the pool was used
    CHECK(again.streamed_bytes <= first.streamed_bytes - pool.all / 4);
  }
}

TEST_CASE("bad pages end a streamed frame with the same error as loading", "[streamer]") {
  std::mt19937 random(9);
  const TempFolder folder;
  const PagedScene paged{
      .page_bytes = 2500, .chunk_triangles = 60, .change = [](uint32_t number, format::SealedPage& page) {
        if (number == 2) page.stored[17] ^= std::byte{1};
      }};
  paged.write(folder.file("bad.scree"), {{random_soup(900, random), Encoding{}}});
  Scene scene = open_scene(folder.file("bad.scree"), false);
  const View view =
      must_view(scene, {.eye = runtime::Vec3{0, 0, 9}, .target = runtime::Vec3{0, 0, 0}, .width = 64, .height = 64});
  std::unique_ptr<CpuStream> stream = must(CpuStream::create(scene, pool_of(scene).least * 3, 2));
  for (int i = 0; i < 2; ++i) {
    const auto drawn = refusal(stream->draw_frame(view, nullptr));
    const auto loaded = refusal(scene.load_pages(2));
    CHECK(drawn.code == loaded.code);
    CHECK(folder.file("bad.scree") + ": " + drawn.message == loaded.message);
  }
}

TEST_CASE("a pool smaller than a chunk is refused with the least size", "[streamer]") {
  std::mt19937 random(10);
  const TempFolder folder;
  PagedScene().write(folder.file("a.scree"), {{random_soup(200, random), Encoding{}}});
  const Scene scene = open_scene(folder.file("a.scree"), false);
  const uint64_t least = pool_of(scene).least;
  check_refusal(CpuStream::create(scene, least - 1, 1), ErrorCode::kRange, "at least " + std::to_string(least));
  CHECK(CpuStream::create(scene, least, 1));
}
