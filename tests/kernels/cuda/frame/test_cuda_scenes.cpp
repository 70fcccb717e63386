// The GPU against the CPU on scenes made for it: encodings side by side, orthographic floats, widths of 0 bits. The
// visibility buffers must be equal bit for bit, with queues that are large enough and queues that have to grow.
#include <algorithm>
#include <map>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "kernels/cuda/frame/draw_tables.h"
#include "tests/gpu.h"
#include "tests/kernels/cuda/device_copy.h"
#include "tests/kernels/cuda/frame/crowd.h"
#include "tests/kernels/omitted_cases.h"
#include "tests/kernels/raster/hard_cases.h"
#include "tests/kernels/raster/mask_cases.h"

using namespace scree;
using namespace scree::tests;
using kernels::View;

namespace {

/// `least`: the least number of pixels that the scene covers in each view; checked without a GPU too. `first_id`: as in
/// SceneBuilder::view.
void compare(SceneBuilder& builder, const std::vector<View>& views, uint64_t least, uint64_t first_id = 0) {
  const kernels::SceneView scene = builder.view(first_id);
  std::vector<std::vector<uint64_t>> expected;
  for (const View& view : views) {
    expected.push_back(draw(scene, view, 2));
    INFO("view " << expected.size() - 1);
    CHECK(covered(expected.back()) >= least);
  }
  if (!has_gpu()) return;
  const DeviceCopy device(scene, builder.pages);
  for (size_t i = 0; i < views.size(); ++i) {
    INFO("view " << i);
    CHECK((device.draw(views[i]) == expected[i]));  // a picture may be too large to be printed
    CHECK((device.draw(views[i], {1, 1, 1, 1, 1, 1}) == expected[i]));
    CHECK((device.draw(views[i], {}, {false}) == expected[i]));
    const kernels::DrawOptions by_kernel{.stage_times = true};
    CHECK((device.draw(views[i], {}, by_kernel) == expected[i]));
  }
  CHECK((device.draw_in_turn(views) == expected));
}

/// Perspective and orthographic views: the whole scene, parts of it, and from inside.
std::vector<View> all_views() {
  const View far = look_at({2.5, 2, 3}, {0, 0, 0}, 321, 203);
  const View near = look_at({0.4, 0.7, 0.5}, {0, 0, 0}, 200, 333, 0.01);
  const View above = look_at({0, 3, 0}, {0, 0, 0}, 256, 256);
  return {far,
          near,
          above,
          orthographic(far, 1.6, 0.1, 20),
          orthographic(near, 0.3, 0.01, 9),
          orthographic(above, 1, 0.1, 20)};
}

/// A mesh in which each corner has one of `values` along each of the first `flat` axes.
Soup flat_soup(int flat) {
  Soup soup;
  for (uint32_t j = 0; j < 5; ++j)
    for (uint32_t i = 0; i < 5; ++i)
      soup.add(flat > 0 ? 0.25 : i * 0.25 - 0.5, flat > 1 ? 0.25 : j * 0.25 - 0.5, flat > 2 ? 0.25 : (i + 3 * j) * 0.1);
  for (uint32_t j = 0; j < 4; ++j)
    for (uint32_t i = 0; i < 4; ++i) {
      soup.triangle(5 * j + i, 5 * j + i + 1, 5 * j + i + 6);
      soup.triangle(5 * j + i, 5 * j + i + 6, 5 * j + i + 5);
    }
  return soup;
}

}  // namespace

TEST_CASE("scenes that mix lattice and float32 meshes are equal on the GPU", "[cuda]") {
  SceneBuilder builder;
  const uint32_t both_sides = builder.material(format::kMaterialDoubleSided);
  const Encoding lattice{.chunk_triangles = 500};
  Encoding floats = float32();
  floats.chunk_triangles = 333;
  Encoding open_lattice = lattice;
  open_lattice.material = both_sides;
  open_lattice.exponent = -20;  // 22 bits per axis: the general reader
  Encoding open_floats = floats;
  open_floats.material = both_sides;
  const uint32_t meshes[] = {builder.mesh(grid(40, 0.2), lattice), builder.mesh(sphere(30, 0.1), floats),
                             builder.mesh(grid(31, 0.3), open_floats), builder.mesh(sphere(12, 0), open_lattice),
                             builder.mesh(grid(3, 0.1), floats)};
  place_all(builder, meshes, {0, 0.2, 0, -0.2, 0.2, 0, 0, 0.5, 0, 0.1, 0.2, 0.3});
  compare(builder, all_views(), 5000);
}

// Rows change from frame to frame, so that the hints of clusters come from frames of other rows.
TEST_CASE("rows drawn alone equal those of the whole picture on the GPU", "[cuda][gpus]") {
  std::mt19937 random(41);
  for (const int kind : {0, 1, 2}) {
    SceneBuilder builder;
    if (kind != 0) add_masked_meshes(builder, kind == 2);
    const Encoding clustered{.clusters = Clusters::kClustered};
    Encoding floats = float32();
    floats.chunk_triangles = 200;
    builder.instance(builder.mesh(sphere(24, 0.2), clustered), builder.matrix({1, 0, 0, 0.3, 0, 1, 0, 0, 0, 0, 1, -1}));
    if (kind != 2) builder.instance(builder.mesh(grid(24, 0.3), floats), builder.identity());
    const kernels::SceneView scene = builder.view();
    std::vector<View> views = masked_views(kEmulatesGpu ? 2 : 1);
    for (const View& view : all_views()) views.push_back(view);
    View clipped = views.back();
    clipped.clips = true;
    for (int i = 0; i < 3; ++i) clipped.clip_min[i] = -0.4, clipped.clip_max[i] = 0.5;
    views.push_back(clipped);
    if (!has_gpu()) return;
    const DeviceCopy device(scene, builder.pages);
    uint64_t drawn = 0, of_all = 0;
    for (const kernels::CudaQueueSizes& sizes : {kernels::CudaQueueSizes(), by_warps(), in_two_passes(), kNoRoom}) {
      kernels::CudaFrames frames = must(kernels::CudaFrames::create(scene, device.view(), sizes));
      for (size_t i = 0; i < views.size(); i += kEmulatesGpu ? 8 : 1) {
        const View& view = views[i];
        const std::vector<uint64_t> expected = draw(scene, view, 2);
        for (int turn = 0; turn < 3; ++turn) {
          kernels::DrawOptions options{.stage_times = turn == 2};
          options.rows.first = static_cast<uint32_t>(random() % view.height);
          options.rows.end =
              options.rows.first + 1 + static_cast<uint32_t>(random() % (view.height - options.rows.first));
          CAPTURE(kind, i, options.rows.first, options.rows.end);
          const auto draw_rows = [&](uint64_t* samples) {
            kernels::FrameTimes times{};
            drawn += must(frames.draw(view, samples, options, &times)).triangles;
            CHECK(times.raster_ms > 0);
            CHECK(times.has_stages == options.stage_times);
            if (!times.has_stages) CHECK(times.cull_ms + times.small_ms + times.second_ms == 0);
          };
          // Samples begin as zeros, which are nearer than everything. Other rows are not cleared, so a read of them
          // would change the picture.
          const std::vector<uint64_t> found = device.picture(view, draw_rows, 0);
          const auto at = [&](uint32_t row) { return static_cast<ptrdiff_t>(uint64_t{row} * view.width); };
          CHECK(std::equal(found.begin() + at(options.rows.first), found.begin() + at(options.rows.end),
                           expected.begin() + at(options.rows.first)));
        }
        of_all += 3 * device.stats(view, sizes, {}).triangles;
      }
    }
    // Most chunks reach into any rows, so few are left out. The emulated GPU draws a fifth of the views, where even
    // fewer are.
    CHECK(drawn < of_all - of_all / (kEmulatesGpu ? 50 : 10));
  }
}

// Frames follow each other, so that hints of clusters outlive frames that omit the clusters.
TEST_CASE("omitted instances are left out on the GPU as on the CPU, and come back", "[cuda][omitted]") {
  const bool is_clustered = GENERATE(false, true);
  SceneBuilder builder;
  add_masked_meshes(builder, is_clustered);
  const kernels::SceneView scene = builder.view();
  const std::vector<uint32_t> some = random_omitted(scene.instance_count, 1);
  const std::vector<uint32_t> others = random_omitted(scene.instance_count, 2);
  std::vector<View> views;
  std::vector<const std::vector<uint32_t>*> omitted;
  std::vector<std::vector<uint64_t>> expected;
  const std::vector<View> cameras = masked_views(kEmulatesGpu ? 2 : 1);
  for (size_t i = 0; i < cameras.size(); i += kEmulatesGpu ? 4 : 1) {
    for (const std::vector<uint32_t>* bits : {static_cast<const std::vector<uint32_t>*>(nullptr), &some, &others,
                                              static_cast<const std::vector<uint32_t>*>(nullptr)}) {
      views.push_back(cameras[i]);
      omitted.push_back(bits);
      expected.push_back(draw(scene, omitting(cameras[i], bits != nullptr ? bits->data() : nullptr), 2));
    }
    const size_t last = expected.size() - 1;
    CHECK(expected[last - 3] == expected[last]);
    CHECK(expected[last - 2] != expected[last]);
    CHECK(expected[last - 1] != expected[last - 2]);
  }
  if (!has_gpu()) return;
  const DeviceCopy device(scene, builder.pages);
  const DeviceBits some_there(some);
  const DeviceBits others_there(others);
  for (size_t i = 0; i < views.size(); ++i)
    if (omitted[i] != nullptr) views[i].omitted = omitted[i] == &some ? some_there.data() : others_there.data();
  for (const kernels::CudaQueueSizes& sizes : {kernels::CudaQueueSizes(), in_two_passes()})
    CHECK((device.draw_in_turn(views, sizes) == expected));
}

TEST_CASE("float32 positions with an orthographic camera are equal on the GPU", "[cuda]") {
  SceneBuilder builder;
  Encoding floats = float32();
  floats.chunk_triangles = 256;
  builder.mesh(sphere(50, 0.2), floats);
  builder.mesh(grid(64, 0.3), floats);
  builder.mesh(grid(1, 0), floats);  // large triangles
  for (uint32_t mesh = 0; mesh < 3; ++mesh) {
    builder.instance(mesh, builder.identity());
    // Far from the origin, where float32 positions leave few bits for the visible part.
    builder.instance(mesh, builder.matrix({1, 0, 0, 1e6, 0, 1, 0, 0, 0, 0, 1, 0}));
  }
  std::vector<View> views;
  for (const View& view : all_views())
    if (view.orthographic) views.push_back(view);
  compare(builder, views, 5000);
  const View distant = look_at({1e6 + 2, 2, 3}, {1e6, 0, 0}, 321, 203);
  compare(builder, {orthographic(distant, 1.6, 0.1, 20), orthographic(distant, 0.01, 2, 5)}, 5000);
}

TEST_CASE("chunks with widths of 0 bits are equal on the GPU", "[cuda]") {
  SceneBuilder builder;
  const Encoding encoding{.material = builder.material(format::kMaterialDoubleSided)};
  for (const int flat : {0, 1, 2, 3}) {
    const uint32_t mesh = builder.mesh(flat_soup(flat), encoding);
    builder.instance(mesh, builder.identity());
    builder.instance(mesh, builder.matrix({0, 0.5, 0.5, 0.1, 0.5, 0, 0.2, 0.2, 0, 0.5, 0, 0.3}));
    const format::ChunkRecord& chunk = builder.chunks.back();
    for (int axis = 0; axis < 3; ++axis) CHECK((chunk.position_bits[axis] == 0) == (axis < flat));
  }
  // All three corners of every triangle are the same vertex.
  Soup points;
  points.add(0.1, 0.2, 0.3);
  for (int i = 0; i < 40; ++i) points.triangle(0, 0, 0);
  for (const bool floats : {false, true}) {
    Encoding of_points = encoding;
    of_points.float32 = floats;
    builder.instance(builder.mesh(points, of_points), builder.identity());
    CHECK(builder.chunks.back().index_bits == 0);
  }
  // Indices of few bits in an otherwise usual mesh, cut into chunks of which some have one triangle.
  Encoding single = encoding;
  single.chunk_triangles = 1;
  builder.instance(builder.mesh(grid(4, 0.2), single), builder.identity());
  compare(builder, all_views(), 2000);
}

namespace {

/// Clustered chunks and, unless `is_clustered`, other chunks, in front of and behind each other. Each view is drawn
/// twice, the second time with all hints; then the views follow in reverse order, with jumps.
struct MixedScene {
  explicit MixedScene(bool is_clustered) {
    const Encoding lattice{.chunk_triangles = 900};
    Encoding clustered = lattice;
    clustered.clusters = Clusters::kClustered;
    Encoding open_clustered = clustered;
    open_clustered.material = builder.material(format::kMaterialDoubleSided);
    open_clustered.chunk_triangles = 65536;
    const uint32_t meshes[] = {builder.mesh(grid(60, 0.2), clustered), builder.mesh(sphere(40, 0.1), open_clustered),
                               builder.mesh(sphere(30, 0.2), is_clustered ? clustered : lattice),
                               builder.mesh(grid(31, 0.3), is_clustered ? clustered : float32()),
                               builder.mesh(grid(1, 0), clustered)};
    place_all(builder, meshes, {1, 0, 0, 0.2, 0, 1, 0, -1.5, 0, 0, 1, 0.3});  // behind others
    scene = builder.view();
    CHECK((scene.chunk_kinds == kernels::ChunkKinds::kMixed) != is_clustered);
    std::vector<View> once = all_views();
    if (scree::tests::kEmulatesGpu) once.erase(once.begin() + 1, once.end() - 1);
    for (const View& view : once) views.insert(views.end(), 2, view);
    views.insert(views.end(), once.rbegin(), once.rend());
    for (const View& view : views) {
      expected.push_back(draw(scene, view, 2));
      CHECK(covered(expected.back()) >= 5000);
    }
  }

  SceneBuilder builder;
  kernels::SceneView scene{};
  std::vector<View> views;
  std::vector<std::vector<uint64_t>> expected;
};

}  // namespace

TEST_CASE("every pair of an instance and a clustered chunk is a candidate once, beside indexed chunks", "[clusters]") {
  SceneBuilder builder;
  const Encoding clustered{.chunk_triangles = 900, .clusters = Clusters::kClustered};
  for (const uint32_t mesh : {builder.mesh(grid(60, 0.2), clustered), builder.mesh(grid(1, 0), clustered)})
    for (int i = 0; i < 21; ++i) builder.instance(mesh, builder.identity());
  builder.chunks[1].encoding = format::ChunkEncoding::kIndexed;
  const kernels::SceneView scene = builder.view();
  const auto tables = kernels::make_draw_tables(scene);
  REQUIRE(tables);
  const kernels::CandidateCounts counts = kernels::count_candidates(scene);
  CHECK(tables->candidates.size() == counts.indexed);
  CHECK(tables->cluster_candidates.size() == counts.clustered);
  CHECK(counts.cluster_draws == 21 * (scene.chunk_count - 1));
  std::map<std::pair<uint64_t, uint64_t>, int> seen;  // chunk, index of the instance
  for (const kernels::CandidateDraw& candidate : tables->cluster_candidates) {
    const format::MeshRecord& mesh = scene.meshes[scene.chunks[candidate.chunk].mesh];
    for (uint64_t i = 0; i < kernels::kDrawInstances; ++i) {
      const uint64_t ahead = candidate.chunk - mesh.first_chunk + i;
      const uint64_t index = candidate.first + ahead / mesh.chunk_count;
      if (index < 21) ++seen[{mesh.first_chunk + ahead % mesh.chunk_count, index}];
    }
  }
  CHECK(seen.size() == 21 * scene.chunk_count);
  for (const auto& [pair, times] : seen) CHECK(times == 1);
}

TEST_CASE("scenes of clustered and other chunks are equal on the GPU, frame after frame", "[cuda][clusters]") {
  const bool is_clustered = GENERATE(false, true);
  const MixedScene mixed(is_clustered);
  if (!has_gpu()) return;
  const DeviceCopy device(mixed.scene, mixed.builder.pages);
  for (const kernels::CudaQueueSizes& sizes : {kernels::CudaQueueSizes{}, by_warps(), in_two_passes(), kNoRoom}) {
    for (const bool occlusion : {true, false}) {
      if (scree::tests::kEmulatesGpu && !occlusion) continue;
      const std::vector<std::vector<uint64_t>> pictures =
          device.draw_in_turn(mixed.views, sizes, {.occlusion = occlusion});
      for (size_t i = 0; i < mixed.views.size(); ++i) {
        INFO("frame " << i << " two passes from " << sizes.two_pass_groups << " groups, occlusion " << occlusion);
        CHECK(pictures[i] == mixed.expected[i]);
      }
    }
  }
}

TEST_CASE("frames in parts are equal on the GPU, previously visible clusters first", "[cuda][clusters]") {
  const bool is_clustered = GENERATE(false, true);
  if (scree::tests::kEmulatesGpu && is_clustered) return;  // the other scene has clusters too
  const MixedScene mixed(is_clustered);
  const auto third = [](size_t which) { return [which](size_t page) { return page % 3 == which; }; };
  const auto but_third = [](size_t which) { return [which](size_t page) { return page % 3 != which; }; };
  using Part = DeviceCopy::Part;
  using kernels::FramePart;
  const std::vector<Part> ways[] = {
      {{FramePart::kPart, third(0)}, {FramePart::kPart, third(1)}, {FramePart::kPart, third(2)}},
      {{FramePart::kPart, third(0)},
       {FramePart::kPreviouslyVisible, but_third(0)},
       {FramePart::kRest, third(1)},
       {FramePart::kRest, third(2)}},
      {{FramePart::kPreviouslyVisible, but_third(2)},
       {FramePart::kRest, third(1)},
       {FramePart::kPart, third(2)},
       {FramePart::kRest, third(0)}}};
  if (!has_gpu()) return;
  const DeviceCopy device(mixed.scene, mixed.builder.pages);
  REQUIRE(mixed.builder.pages.size() >= 9);
  for (const kernels::CudaQueueSizes& sizes : {kernels::CudaQueueSizes{}, in_two_passes(), kNoRoom}) {
    if (scree::tests::kEmulatesGpu && sizes.two_pass_groups != 1) continue;
    for (const std::vector<Part>& parts : ways) {
      const std::vector<std::vector<uint64_t>> pictures = device.draw_in_parts(mixed.views, parts, sizes);
      for (size_t i = 0; i < mixed.views.size(); ++i) {
        INFO("frame " << i << ", way " << &parts - ways << ", two passes from " << sizes.two_pass_groups << " groups");
        CHECK(pictures[i] == mixed.expected[i]);
      }
    }
  }
}

TEST_CASE("the small scene's kernel finds the same clusters as the kernels of larger scenes", "[cuda][clusters]") {
  const MixedScene mixed(true);
  if (!has_gpu()) return;
  const DeviceCopy device(mixed.scene, mixed.builder.pages);
  const kernels::DrawOptions in_one_pass{.occlusion = false};
  for (const View& view : all_views()) {
    const kernels::FrameStats few = device.stats(view, {}, in_one_pass);
    const kernels::FrameStats many = device.stats(view, in_two_passes(), in_one_pass);
    CHECK(few.instances_drawn == many.instances_drawn);
    CHECK(few.draws == many.draws);
    CHECK(few.triangles == many.triangles);
    CHECK(few.groups_tested == many.groups_tested);
    CHECK(few.clusters_tested == many.clusters_tested);
    CHECK(few.clusters_drawn == many.clusters_drawn);
    CHECK(few.clusters_drawn > 0);
  }
}

TEST_CASE("clusters that the near plane cuts everywhere are equal on the GPU", "[cuda][clusters]") {
  const Clusters clusters = GENERATE(Clusters::kClustered, Clusters::kNone);
  SceneBuilder builder;
  builder.instance(
      builder.mesh(rough_field(scree::tests::kEmulatesGpu ? 60 : 400, 0.01), {.exponent = -16, .clusters = clusters}),
      builder.identity());
  // From above, with the field at the near plane; slanting through it; close, so that clipping leaves little; and from
  // within, where some triangles leave the guard band too. Each view comes twice: only the previous frame tells whether
  // much has to be clipped.
  std::vector<View> views;
  for (const View& view :
       {look_at({0, 1.6, 0}, {0, 0, 0}, 320, 180, 1.6), look_at({0.3, 0.5, 0.2}, {0, 0, 0}, 320, 180, 0.55),
        look_at({0, 0.02, 0}, {0.2, 0, 0.1}, 320, 180, 0.019), look_at({0, 0.003, 0}, {0.2, 0, 0.1}, 320, 180, 1e-6)})
    views.insert(views.end(), 2, view);
  compare(builder, views, 5000);
  if (!has_gpu()) return;
  const DeviceCopy device(builder.view(), builder.pages);
  CHECK(device.stats(views[0], {}, {}).triangles_clipped > (scree::tests::kEmulatesGpu ? 1000 : 50000));
}

TEST_CASE("a hundred thousand instances of clusters are equal on the GPU, frame after frame", "[cuda][clusters]") {
  SceneBuilder builder;
  build_crowd(builder);
  const kernels::SceneView scene = builder.view();
  const View above = look_at({0, -2.4, 1.5}, {0, 0, 0}, 320, 180);
  const View within = look_at({0.2, 0.1, 0.3}, {0.1, 0.6, 0}, 320, 180);
  std::vector<View> views = {above, above, within, within, above, look_at({0, -2.3, 1.5}, {0, 0, 0}, 320, 180)};
  if (scree::tests::kEmulatesGpu) views.resize(3);
  std::vector<std::vector<uint64_t>> expected;
  for (const View& view : views) expected.push_back(draw(scene, view, 2));
  if (!has_gpu()) return;
  const DeviceCopy device(scene, builder.pages);
  for (const bool occlusion : {true, false}) {
    if (scree::tests::kEmulatesGpu && !occlusion) continue;
    const std::vector<std::vector<uint64_t>> pictures = device.draw_in_turn(views, {}, {.occlusion = occlusion});
    for (size_t i = 0; i < views.size(); ++i) {
      INFO("frame " << i << ", occlusion " << occlusion);
      CHECK(pictures[i] == expected[i]);
    }
  }
}

TEST_CASE("hard cases are equal on the GPU", "[cuda][hard]") {
  for (const NamedCase& named : hard_cases()) {
    INFO(named.name);
    HardCase hard = named.make();
    compare(hard.builder, hard.views, 0);
    HardCase clustered = in_clusters(hard, Clusters::kClustered);
    compare(clustered.builder, clustered.views, 0);
  }
}

TEST_CASE("hard: triangles side by side cover each pixel once on the GPU", "[cuda][hard]") {
  if (!has_gpu()) return;
  const auto on_gpu = [](const SceneBuilder& builder, const kernels::SceneView& scene, const View& view) {
    return DeviceCopy(scene, builder.pages).draw(view);
  };
  for (const std::string name : {"sliver strip", "vertices at pixel centres", "fans"}) {
    INFO(name);
    HardCase hard = make_hard_case(name);
    for (const View& view : hard.views) {
      const CoverCount count = count_covers(hard.builder, view, on_gpu);
      note(name + ", covers, GPU",
           std::to_string(count.covered) + " pixels, " + std::to_string(count.twice) + " of them twice");
      CHECK(count.covered > 500);
      CHECK(count.twice == 0);
    }
  }
  check_closed("closed mesh, covers, GPU", sphere(150, 0), sphere_view(160), 80 / 1.1, on_gpu);
}

TEST_CASE("hard: ids past 2^32, to the last, on the GPU", "[cuda][hard]") {
  for (const Clusters clusters : {Clusters::kNone, Clusters::kClustered}) {
    SceneBuilder builder;
    const uint32_t mesh = builder.mesh(grid(5, 0.1), {.chunk_triangles = 10, .clusters = clusters});
    builder.instance(mesh, builder.matrix({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}));
    builder.instance(mesh, builder.matrix({1, 0, 0, 0, 0, 1, 0, 0.3, 0, 0, 1, 0}));
    const View view = look_at({0, 1, 2}, {0, 0, 0}, 120, 90);
    for (const uint64_t first : {(uint64_t{1} << 32) - 30, (uint64_t{1} << 35) + 12345, kernels::kIdMask - 100}) {
      CAPTURE(first);
      compare(builder, {view}, 500, first);
    }
  }
}

namespace {

/// Meshes of one chunk each, side by side, with indices that span `spans`.
void compare_spans(const std::vector<uint32_t>& spans) {
  std::mt19937 random(17);
  std::uniform_real_distribution<double> unit(-1, 1);
  SceneBuilder builder;
  constexpr uint32_t kColumns = 8;
  for (uint32_t i = 0; i < spans.size(); ++i) {
    Soup soup;
    double middle[3] = {};
    for (uint32_t v = 0; v <= spans[i]; ++v) {
      if (v % 3 == 0)
        for (double& m : middle) m = 0.3 * unit(random);
      soup.add(middle[0] + 0.1 * unit(random), middle[1] + 0.1 * unit(random), middle[2] + 0.1 * unit(random));
    }
    // Every vertex is used, and the last triangle ends with the last vertex. The first triangle has the whole span.
    soup.triangle(0, spans[i] / 2, spans[i]);
    for (uint32_t v = 0; v <= spans[i]; v += 3) soup.triangle(v, std::min(v + 1, spans[i]), std::min(v + 2, spans[i]));
    const Encoding whole{.chunk_triangles = UINT32_MAX};
    const double x = i % kColumns - 3.5, y = i / kColumns - 3.0;
    builder.instance(builder.mesh(soup, whole), builder.matrix({1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, 0}));
    CHECK(builder.chunks.back().vertex_count == spans[i] + 1);
  }
  compare(builder, {look_at({0, 0, 9}, {0, 0, 0}, 640, 480)}, 10000);
}

std::vector<uint32_t> spans_about(uint32_t first_power, uint32_t last_power) {
  std::vector<uint32_t> spans;
  for (uint32_t k = first_power; k <= last_power; ++k)
    for (const uint32_t span : {(1u << k) - 1, 1u << k, (1u << k) + 1}) spans.push_back(span);
  return spans;
}

}  // namespace

TEST_CASE("hard: index spans of 0, 1, 2^k - 1, 2^k and 2^k + 1 on the GPU", "[cuda][hard]") {
  std::vector<uint32_t> spans = spans_about(1, 16);
  spans.insert(spans.begin(), {0, 1});
  compare_spans(spans);
}

TEST_CASE("hard: index spans around 2^17 to 2^22 on the GPU", "[cuda][.hard-long]") {
  if (!has_gpu()) return;
  compare_spans(spans_about(17, 22));
}

TEST_CASE("hard: pictures of 16384 x 16384 and meshes of 10 M sub-pixel triangles on the GPU", "[cuda][.hard-long]") {
  if (!has_gpu()) return;
  SceneBuilder builder;
  const Soup fine = sphere(1582, 0);
  REQUIRE(fine.indices.size() / 3 > 10000000);
  builder.instance(builder.mesh(fine, Encoding{}), builder.identity());
  const View view = orthographic(look_at({0, 0, 4}, {0, 0, 0}, 16384, 16384), 1.1, 0.1, 8);
  View small = view;
  small.width = small.height = 1024;
  compare(builder, {small, view}, 500000);
}
