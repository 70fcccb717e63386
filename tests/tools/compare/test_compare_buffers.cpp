// Visibility buffers of differently encoded files of the same source.
#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "kernels/raster/depth.h"
#include "runtime/scene/camera.h"
#include "tests/runtime/frame.h"
#include "tests/runtime/load_scene.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/packed_file.h"
#include "tools/common/chunk_decode.h"
#include "tools/compare/buffers.h"

using namespace scree;
using namespace compare;

namespace {

using Options = convert::ConvertOptions;

constexpr uint32_t kWidth = 160, kHeight = 120;

/// A glTF, and convert's file of it.
struct Source {
  tests::TempFolder folder;
  std::string gltf;

  explicit Source(const std::function<void(tests::ModelMaker&)>& fill) : gltf(folder.file("in.gltf")) {
    tests::ModelMaker maker(gltf);
    fill(maker);
    maker.finish();
  }

  runtime::Scene scene(const std::string& name, const std::function<void(Options&)>& change = {}) const {
    Options options;
    options.encoding = convert::Encoding::kIndexed;
    options.source_ids = true;
    if (change) change(options);
    must(tests::pack(gltf, folder.file(name + ".scree"), options));
    return must(runtime::Scene::open(folder.file(name + ".scree"), {.threads = 2}));
  }
};

/// Two equal meshes, which --no-share keeps apart. Between them lies a mesh whose triangles share vertices only after
/// welding. Each mesh has two primitives.
void fill_with_grids(tests::ModelMaker& maker) {
  const tests::GridSpec grid{.columns = 40, .rows = 30, .normal = true};
  tests::GridSpec loose = grid;
  loose.indexed = false;
  loose.origin = {1, 0.125f, 0};
  const auto mesh = [&](const tests::GridSpec& spec) {
    tests::GridSpec behind = spec;
    behind.origin[2] += 1;
    return maker.mesh("mesh", {maker.grid(spec), maker.grid(behind)});
  };
  const uint32_t first = mesh(grid), second = mesh(loose), third = mesh(grid);
  maker.node("third", third, {0.5, 0.5, 0});
  maker.node("second", second);
  maker.node("first", first);
}

std::vector<uint64_t> draw(const runtime::Scene& scene) {
  const kernels::View view = tests::must_view(scene, {.eye = runtime::Vec3{-1.0, 2.0, 3.5},
                                                      .target = runtime::Vec3{1.0, 0.0, 1.0},
                                                      .width = kWidth,
                                                      .height = kHeight});
  const auto frame = tests::must_draw(scene, view);
  return {frame.samples().begin(), frame.samples().end()};
}

PixelReport compared(const runtime::Scene& a, const runtime::Scene& b) {
  const auto match = must(SceneMatch::match(a, b));
  return must(compare::compare_buffers(draw(a), draw(b), kWidth, kHeight, &match));
}

PixelReport compared_by_id(const runtime::Scene& a, const runtime::Scene& b) {
  return must(compare::compare_buffers(draw(a), draw(b), kWidth, kHeight, nullptr));
}

uint64_t count_of(const PixelReport& report, PixelKind kind) {
  return report.counts()[static_cast<size_t>(kind)];
}

/// The error for two scenes, or these samples of them, that cannot be compared.
Error refused(const runtime::Scene& a, const runtime::Scene& b, const std::vector<uint64_t>& samples_a = {},
              const std::vector<uint64_t>& samples_b = {}) {
  const auto match = SceneMatch::match(a, b);
  if (!match) return match.error();
  return refusal(compare::compare_buffers(samples_a, samples_b, static_cast<uint32_t>(samples_a.size()), 1, &*match));
}

void check_refused(const Error& error, ErrorCode code, const std::string& words) {
  INFO(error.message);
  CHECK(error.code == code);
  CHECK(error.message.find(words) != std::string::npos);
  CHECK(error.message.find('\n') == std::string::npos);
}

/// The id of a source triangle of a node.
uint64_t id_of(const runtime::Scene& scene, uint32_t node, uint64_t source) {
  const kernels::SceneView& view = scene.view();
  tools::ChunkReader reader(scene.container());
  for (uint64_t i = 0; i < view.instance_count; ++i) {
    if (view.instances[i].node != node) continue;
    const format::MeshRecord& mesh = view.meshes[view.instances[i].mesh];
    for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c) {
      const auto chunk = must(reader.read(c, tools::kPartSourceIds));
      for (uint64_t t = 0; t < chunk->source_ids.size(); ++t)
        if (chunk->source_ids[t] == source) return view.instance_base[i] + view.chunks[c].first_triangle + t;
    }
  }
  FAIL("no triangle " << source << " of node " << node);
  return 0;
}

using Points = std::vector<float>;

/// Adds squares of side 1, side by side with gaps, from the lower left on. Each has two triangles.
tests::ModelMaker& add_squares(tests::ModelMaker& maker, uint32_t squares, std::array<double, 3> place = {0, 0, 0},
                               float height = 1) {
  Points points;
  std::vector<uint32_t> corners;
  for (uint32_t i = 0; i < squares; ++i) {
    const float x = 2 * static_cast<float>(i);
    points.insert(points.end(), {x, 0, 0, x + 1, 0, 0, x + 1, height, 0, x, height, 0});
    for (const uint32_t corner : {0u, 1u, 2u, 0u, 2u, 3u}) corners.push_back(4 * i + corner);
  }
  maker.node("node", maker.mesh("mesh", {maker.primitive(points, corners)}), place);
  return maker;
}

void clustered(Options& options) {
  options.encoding = convert::Encoding::kClustered;
}

}  // namespace

TEST_CASE("source numbers match triangles whose ids differ by encoding", "[compare]") {
  const Source source(fill_with_grids);
  const runtime::Scene indexed = source.scene("indexed");
  const struct {
    const char* name;
    bool changes_ids;
    std::function<void(Options&)> change;
  } variants[] = {
      {"clustered", true, clustered},
      {"best", true,
       [](Options& o) {
         clustered(o);
         o.clusters = tools::ClusterEffort::kBest;
       }},
      {"unwelded", true, [](Options& o) { o.weld = false; }},
      {"unordered", true, [](Options& o) { o.order = convert::Order::kNone; }},
      {"unshared", true, [](Options& o) { o.share = false; }},
      {"chunks", false, [](Options& o) { o.chunk_triangles = 100; }},
      {"zstd", false, [](Options& o) { o.zstd_level = 3; }},
      {"clustered_unshared", true,
       [](Options& o) {
         clustered(o);
         o.share = false;
         o.chunk_triangles = 300;
       }},
  };
  for (const auto& variant : variants) {
    INFO(variant.name);
    const runtime::Scene other = source.scene(variant.name, variant.change);
    CHECK((compared_by_id(other, indexed).wrong() > 100) == variant.changes_ids);
    for (const bool turned : {false, true}) {
      const PixelReport report = turned ? compared(indexed, other) : compared(other, indexed);
      CHECK(report.wrong() == 0);
      CHECK(count_of(report, PixelKind::kCoincident) == 0);
      CHECK(count_of(report, PixelKind::kSame) > 3500);
      CHECK(report.same_depth.count() == count_of(report, PixelKind::kSame));
      CHECK(report.same_depth.max() <= 0x1p-21);  // one or two codes, because clusters rotate triangles
    }
  }
}

TEST_CASE("position bits do not change ids, with and without source numbers", "[compare]") {
  const Source source(fill_with_grids);
  const auto bare = [](Options& o) { o.source_ids = false; };
  const runtime::Scene wide = source.scene("wide", bare), numbered = source.scene("numbered");
  for (const uint32_t bits : {8u, 12u, 24u, 0u}) {
    INFO(bits);
    const auto change = [&](Options& o) {
      o.float32 = bits == 0;
      if (bits != 0) o.position_bits = bits;
    };
    const runtime::Scene by_place = source.scene("by_place", [&](Options& o) {
      bare(o);
      change(o);
    });
    const runtime::Scene by_number = source.scene("by_number", change);
    const PixelReport place = compared(by_place, wide), number = compared(by_number, numbered);
    CHECK(place.kinds == number.kinds);
    CHECK(place.same_depth.rms() == number.same_depth.rms());
    CHECK((place.wrong() > 100) == (bits == 8));
    // One of the two has no source numbers, so positions are compared instead.
    CHECK(compared(by_number, wide).kinds == number.kinds);
  }
  // If the numbering may differ, the comparison is refused with advice.
  const std::function<void(Options&)> changes[] = {clustered, [](Options& o) { o.weld = false; },
                                                   [](Options& o) { o.chunk_triangles = 100; }};
  for (const auto& change : changes) {
    const runtime::Scene other = source.scene("other", [&](Options& o) {
      bare(o);
      change(o);
    });
    check_refused(refused(other, wide, draw(other), draw(wide)), ErrorCode::kUnsupported,
                  "store their triangles differently; convert both with --source-ids");
    check_refused(refused(wide, other, draw(wide), draw(other)), ErrorCode::kUnsupported, "--source-ids");
  }
}

TEST_CASE("buffers of two encodings: every kind of pixel is counted", "[compare]") {
  // Node 0: triangles 0 and 1 of one square, 2 and 3 of another. Node 1 has the same positions again, node 2 others.
  const Source source([](tests::ModelMaker& maker) {
    add_squares(maker, 2);
    add_squares(maker, 2);
    add_squares(maker, 1, {0, 3, 0});
  });
  const runtime::Scene first = source.scene("first", clustered), second = source.scene("second", [](Options&o) {
    o.share = false;
    o.position_bits = 12;
  });
  const uint64_t none = kernels::kBackground;
  const auto a = [&](uint32_t node, uint64_t triangle) {
    return kernels::pack_sample(1000, id_of(first, node, triangle));
  };
  const auto b = [&](uint32_t node, uint64_t triangle) {
    return kernels::pack_sample(1000 + (1u << 22), id_of(second, node, triangle));
  };
  const std::vector<uint64_t> found{none, none, a(0, 1), a(0, 1), a(0, 1), a(0, 1), a(0, 1), a(2, 1), a(0, 3), a(1, 2)};
  const std::vector<uint64_t> right{none, b(0, 0), none, b(0, 1), b(0, 0), b(0, 2), b(1, 0), b(2, 1), b(1, 3), b(2, 0)};
  const auto match = must(SceneMatch::match(first, second));
  const auto report = must(compare::compare_buffers(found, right, 5, 2, &match));
  const std::vector<PixelKind> expected{PixelKind::kBothBackground, PixelKind::kBackground, PixelKind::kBackground,
                                        PixelKind::kSame,           PixelKind::kNeighbour,  PixelKind::kApart,
                                        PixelKind::kOtherMesh,      PixelKind::kSame,       PixelKind::kCoincident,
                                        PixelKind::kOtherMesh};
  CHECK(report.kinds == expected);
  CHECK(report.wrong() == 6);
  CHECK(report.same_depth.count() == 2);
  CHECK(report.same_depth.max() == Approx(0.5).epsilon(1e-6));  // an octave of depth codes
  CHECK(report.surface_depth.count() == 7);

  const std::vector<uint64_t> past{kernels::pack_sample(1000, 10)}, one{b(0, 0)};
  check_refused(refused(first, second, past, one), ErrorCode::kRange,
                "pixel 0,0 of the first buffer: triangle 10, but " + first.file().path() + " draws 10");
  check_refused(refused(first, second, {a(0, 0)}, past), ErrorCode::kRange,
                "of the second buffer: triangle 10, but " + second.file().path() + " draws 10");
}

TEST_CASE("files of different sources are not matched", "[compare]") {
  const Source one([](tests::ModelMaker& maker) { add_squares(maker, 2); });
  const runtime::Scene scene = one.scene("scene");
  const std::pair<std::function<void(tests::ModelMaker&)>, const char*> others[] = {
      {[](tests::ModelMaker& maker) { add_squares(maker, 3); }, "node 0 draws 4 triangles, but 6"},
      {[](tests::ModelMaker& maker) { add_squares(add_squares(maker, 2), 2); }, "1 instances, but 2"},
      {[](tests::ModelMaker& maker) {
         add_squares(maker, 2, {0, 0.001, 0});
       },
       "node 0 has another transform"},
      {[](tests::ModelMaker& maker) {
         add_squares(maker, 2, {0, 0, 0}, 1.01f);
       },
       "node 0 draws meshes of other sizes"},
  };
  for (const auto& other : others) {
    INFO(other.second);
    const Source source(other.first);
    const Error error = refused(scene, source.scene("scene", clustered));
    check_refused(error, ErrorCode::kFormat, "are not made from one source: ");
    check_refused(error, ErrorCode::kFormat, other.second);
  }

  // A node with two primitives, and two nodes with one.
  const Source together([](tests::ModelMaker& maker) {
    const tests::GridSpec grid;
    maker.draw("both", {maker.grid(grid), maker.grid(grid)});
  });
  const Source apart([](tests::ModelMaker& maker) {
    const uint32_t mesh = maker.mesh("one", {maker.grid({})});
    maker.node("first", mesh);
    maker.node("second", mesh);
  });
  check_refused(refused(together.scene("scene"), apart.scene("scene")), ErrorCode::kFormat,
                "node 0 draws other meshes");

  // The same number of triangles in the same box, but different ones: one source lacks the first triangle, the other
  // the last.
  const auto with_hole = [](size_t hole) {
    return [hole](tests::ModelMaker& maker) {
      Points points{0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 2, 0, 0, 0, 0};
      points[15] = NAN;
      std::vector<uint32_t> corners{0, 1, 2, 1, 3, 2};
      corners.insert(corners.begin() + static_cast<ptrdiff_t>(3 * hole), {0, 1, 5});
      maker.node("node", maker.mesh("mesh", {maker.primitive(points, corners)}));
    };
  };
  const auto drop = [](Options& o) { o.drop_nonfinite = true; };
  const Source early(with_hole(0)), late(with_hole(2));
  const runtime::Scene a = early.scene("scene", drop), b = late.scene("scene", drop);
  const std::vector<uint64_t> last{kernels::pack_sample(1000, id_of(a, 0, 2))};
  const std::vector<uint64_t> first{kernels::pack_sample(1000, id_of(b, 0, 1))};
  check_refused(refused(a, b, last, first), ErrorCode::kFormat, "mesh 0 has no source triangle 2 in the second");
}

TEST_CASE("depths of an orthographic view are distances between its planes", "[compare]") {
  kernels::View view{};
  view.orthographic = true;
  view.z_near = 1;
  view.z_far = 9;
  const auto at_distance = [&](float distance) {
    return kernels::pack_sample(kernels::orthographic_depth_code((9 - distance) / 8), 5);
  };
  const std::vector<uint64_t> found{at_distance(3), at_distance(6)}, right{at_distance(2), at_distance(5)};
  const auto report = must(compare::compare_buffers(found, right, 2, 1, nullptr, &view));
  CHECK(report.same_depth.max() == Approx(0.5));
  CHECK(report.same_depth.rms() == Approx(std::sqrt((0.25 + 0.04) / 2)));
}
