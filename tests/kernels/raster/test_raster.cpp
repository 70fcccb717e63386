#include <random>
#include <set>

#include "kernels/cpu/backend.h"
#include "kernels/shade/locate.h"
#include "tests/kernels/scene_builder.h"
#include "tests/kernels/shade_samples.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;

namespace {

/// The drawing rules implemented naively: every triangle against every pixel. It uses the kernels' snapped corners,
/// since rounding and clipping have tests of their own. Coverage is barycentric in 128 bits, with the top-left rule by
/// its definition: the pixel's centre, moved slightly right and even less down, is inside.
std::vector<uint64_t> brute_force(const SceneView& scene, const View& camera) {
  const FrameView view = make_frame_view(camera);
  std::vector<uint64_t> samples(size_t{camera.width} * camera.height, kBackground);
  for (uint64_t number = 0; number < scene.instance_count; ++number) {
    const format::InstanceRecord& instance = scene.instances[number];
    const format::MeshRecord& mesh = scene.meshes[instance.mesh];
    const bool double_sided =
        mesh.material != format::kNone && (scene.materials[mesh.material].flags & format::kMaterialDoubleSided);
    const Transform transform = make_transform(view, scene.matrices[instance.matrix], mesh.lattice_exponent,
                                               mesh.position_encoding == format::PositionEncoding::kFloat32);
    for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c) {
      const format::ChunkRecord& chunk = scene.chunks[c];
      ChunkReader reader = make_reader(mesh, chunk, scene.pages[chunk.page], transform, 0);
      for (uint32_t t = 0; t < chunk.triangle_count; ++t) {
        if (t == reader.end_triangle) reader = make_reader(mesh, chunk, scene.pages[chunk.page], transform, t);
        const uint64_t id = scene.instance_base[number] + chunk.first_triangle + t;
        uint32_t v[3];
        reader.triangle(t, v);
        ClipVertex polygon[kMaxPolygon];
        uint32_t flags = 0;
        for (int i = 0; i < 3; ++i) {
          float d[3];
          double exact[3];
          reader.relative(v[i], d);
          reader.exact_relative(v[i], exact);
          const ScreenVertex projected = camera.orthographic ? project<true>(transform, view, d[0], d[1], d[2])
                                                             : project<false>(transform, view, d[0], d[1], d[2]);
          polygon[i] = clip_vertex(transform, exact, projected);
          flags |= projected.flags;
        }
        int count = 3;
        if (flags & kNeedsClip)
          count = camera.orthographic ? clip_polygon<true>(polygon) : clip_polygon<false>(polygon);
        ScreenVertex corner[kMaxPolygon];
        for (int i = 0; i < count; ++i) {
          corner[i] =
              camera.orthographic ? snap_clipped<true>(polygon[i], view) : snap_clipped<false>(polygon[i], view);
        }
        for (int i = 2; i < count; ++i) {
          __extension__ typedef __int128 Wide;
          const ScreenVertex* p[3] = {&corner[0], &corner[i - 1], &corner[i]};
          const auto cross = [](Wide ax, Wide ay, Wide bx, Wide by) { return ax * by - ay * bx; };
          Wide area = cross(p[1]->x - p[0]->x, p[1]->y - p[0]->y, p[2]->x - p[0]->x, p[2]->y - p[0]->y);
          if (area == 0) continue;
          const bool front = (area < 0) != transform.mirrored;
          if (!front && !double_sided) continue;
          if (area < 0) {
            std::swap(p[1], p[2]);
            area = -area;
          }
          const float inverse_area = 1.0f / static_cast<float>(static_cast<int64_t>(area));
          for (int32_t y = 0; y < view.height; ++y) {
            for (int32_t x = 0; x < view.width; ++x) {
              const Wide px = 256 * x + 128, py = 256 * y + 128;
              bool inside = true;
              Wide edge[3];
              for (int k = 0; k < 3; ++k) {
                const ScreenVertex& a = *p[(k + 1) % 3];
                const ScreenVertex& b = *p[(k + 2) % 3];
                edge[k] = cross(b.x - a.x, b.y - a.y, px - a.x, py - a.y);
                // The gradient of the edge value is (-dy, dx), so moving by (2 eps, eps^2) changes it with this sign.
                const Wide nudge = b.y != a.y ? Wide{a.y - b.y} : Wide{b.x - a.x};
                inside = inside && (edge[k] > 0 || (edge[k] == 0 && nudge > 0));
              }
              if (!inside) continue;
              const float e1 = static_cast<float>(static_cast<int64_t>(edge[1])) * inverse_area;
              const float e2 = static_cast<float>(static_cast<int64_t>(edge[2])) * inverse_area;
              float depth =
                  std::fma(e1, p[1]->depth - p[0]->depth, std::fma(e2, p[2]->depth - p[0]->depth, p[0]->depth));
              depth = std::min(std::max(depth, std::min({p[0]->depth, p[1]->depth, p[2]->depth})),
                               std::max({p[0]->depth, p[1]->depth, p[2]->depth}));
              const uint32_t code =
                  camera.orthographic ? orthographic_depth_code(depth) : perspective_depth_code(depth);
              uint64_t& sample = samples[static_cast<size_t>(y) * camera.width + static_cast<size_t>(x)];
              sample = std::min(sample, pack_sample(code, id));
            }
          }
        }
      }
    }
  }
  return samples;
}

/// Random triangles around the origin, some tiny, some huge.
Soup random_soup(std::mt19937& random, uint32_t count) {
  std::uniform_real_distribution<double> place(-2, 2), size(-6, 2);
  Soup soup;
  for (uint32_t i = 0; i < count; ++i) {
    const double x = place(random), y = place(random), z = place(random);
    const double s = std::exp2(size(random));
    const uint32_t first = soup.add(x + s * place(random), y + s * place(random), z + s * place(random));
    soup.add(x + s * place(random), y + s * place(random), z + s * place(random));
    soup.add(x + s * place(random), y + s * place(random), z + s * place(random));
    soup.triangle(first, first + 1, first + 2);
  }
  return soup;
}

}  // namespace

TEST_CASE("raster: every pixel equals a loop over all triangles and pixels", "[raster]") {
  std::mt19937 random(7);
  for (int round = 0; round < 24; ++round) {
    SceneBuilder builder;
    const Encoding encoding{.float32 = round % 3 == 0,
                            .exponent = round % 3 == 1 ? -6 : -14,
                            .chunk_triangles = 17,
                            .material = builder.material(round % 2 ? uint32_t{format::kMaterialDoubleSided} : 0u)};
    const uint32_t mesh = builder.mesh(random_soup(random, 60), encoding);
    builder.instance(mesh, builder.identity());
    builder.instance(mesh, builder.matrix({-0.5, 0.1, 0, 0.3, 0, 0.7, 0.2, -0.2, 0.1, 0, 0.6, 1}));
    const SceneView scene = builder.view();
    const uint32_t sizes[][2] = {{1, 1}, {97, 61}, {200, 130}, {33, 1}, {1, 57}, {128, 128}};
    const auto [width, height] = sizes[round % 6];
    View view =
        look_at({1.5 * std::sin(round), 0.4, 1.5 * std::cos(round)}, {0, 0.1 * round, 0}, width, height, 0.05, 1.2);
    if (round % 4 == 3) view = orthographic(view, 1.5, -1, 3);
    const std::vector<uint64_t> expected = brute_force(scene, view);
    if (width > 90) REQUIRE(covered(expected) > 500);
    for (InstructionSet set : {InstructionSet::kBaseline, best_instruction_set()}) {
      for (uint32_t threads : {1u, 3u}) {
        CHECK(draw_with(scene, view, threads, set, QueueSizes{}) == expected);
        CHECK(draw_with(scene, view, threads, set, QueueSizes{1, 1, 1, 1, 1, 1}) == expected);
        CHECK(draw_with(scene, view, threads, set, QueueSizes{2, 3, 1, 5, 2, 64}) == expected);
      }
    }
  }
}

TEST_CASE("raster: a picture does not depend on threads, instruction set or sizes of queues", "[raster]") {
  SceneBuilder builder;
  Encoding encoding{.chunk_triangles = 500};
  const uint32_t ground = builder.mesh(grid(60, 0.3), encoding);
  encoding.float32 = true;
  encoding.material = builder.material(format::kMaterialDoubleSided);
  const uint32_t ball = builder.mesh(sphere(20, 0.2), encoding);
  for (int i = 0; i < 40; ++i) {
    const double scale = 0.05 + 0.01 * i;
    builder.instance(i % 2 ? ground : ball, builder.matrix({scale, 0, 0, 0.3 * (i % 7) - 1, 0, scale, 0, 0.1 * (i % 5),
                                                            0, 0, scale, 0.2 * (i % 9) - 1}));
  }
  const SceneView scene = builder.view();
  const View view = look_at({0.5, 0.8, 2}, {0, 0, 0}, 641, 359, 0.01, 1.2);
  const std::vector<uint64_t> expected = draw_with(scene, view, 1, InstructionSet::kBaseline, QueueSizes{});
  CHECK(covered(expected) > 50000);
  for (InstructionSet set : {InstructionSet::kBaseline, best_instruction_set()}) {
    for (uint32_t threads : {1u, 2u, 7u}) {
      CHECK(draw_with(scene, view, threads, set, QueueSizes{}) == expected);
      CHECK(draw_with(scene, view, threads, set, QueueSizes{3, 2, 1, 1, 5, 2}) == expected);
    }
  }
}

TEST_CASE("raster: triangles of all three sizes are counted in their stages", "[raster]") {
  SceneBuilder builder;
  Soup soup;
  const auto add = [&](double x, double y, double size) {
    const uint32_t a = soup.add(x, y, 0);
    soup.add(x + size, y, 0);
    soup.add(x, y + size, 0);
    soup.triangle(a, a + 1, a + 2);
  };
  add(-0.9, -0.9, 0.05);  // 2 units are 200 pixels: 5 x 5, 30 x 30 and 120 x 120 pixels
  add(0.2, -0.8, 0.3);
  add(-0.7, -0.7, 1.2);
  builder.instance(builder.mesh(soup, Encoding{}), builder.identity());
  View view = orthographic(look_at({0, 0, 1}, {0, 0, 0}, 200, 200), 1, 0, 2);
  std::vector<uint64_t> samples(200 * 200);
  const auto drawn = must(draw_cpu(builder.view(), view, samples, 2));
  CHECK(drawn.instances_drawn == 1);
  CHECK(drawn.draws == 1);
  CHECK(drawn.triangles == 3);
  CHECK(drawn.triangles_small == 1);
  CHECK(drawn.triangles_medium == 1);
  CHECK(drawn.triangles_large == 1);
  CHECK(drawn.triangles_clipped == 0);
  std::vector<float> rgba(4 * samples.size());
  scree::tests::shade_samples(builder.view(), view, samples, {.show = Show::kStage}, rgba);
  for (size_t i = 0; i < samples.size(); ++i) {
    if (samples[i] == kBackground) continue;
    for (size_t c = 0; c < 3; ++c) REQUIRE((rgba[4 * i + c] == 1.0f) == (sample_id(samples[i]) == c));
  }
}

TEST_CASE("raster: centres on an edge belong to the triangle below or to the right", "[raster]") {
  // 64 samples per unit, with the image's centre on a corner of samples: centres lie at odd multiples of 1 / 128.
  const View view = orthographic(look_at({0, 0, 1}, {0, 0, 0}, 64, 64), 0.5, 0, 2);
  const Encoding encoding{.exponent = -7};
  const auto rows_and_columns = [&](std::initializer_list<std::array<int, 2>> corners) {
    SceneBuilder builder;
    Soup soup;
    for (const auto& [x, y] : corners) soup.add(x / 128.0, -y / 128.0, 0);  // y points down, as for samples
    soup.triangle(0, 1, 2);
    if (corners.size() == 4) soup.triangle(0, 2, 3);
    Encoding sides = encoding;
    sides.material = builder.material(format::kMaterialDoubleSided);
    builder.instance(builder.mesh(soup, sides), builder.identity());
    const std::vector<uint64_t> samples = draw(builder.view(), view);
    std::set<std::array<int, 2>> covered_centres;  // in 1 / 128 units from the image's centre
    for (int y = 0; y < 64; ++y) {
      for (int x = 0; x < 64; ++x)
        if (samples[static_cast<size_t>(64 * y + x)] != kBackground) covered_centres.insert({2 * x - 63, 2 * y - 63});
    }
    return covered_centres;
  };
  // A square whose corners lie between centres: its left and top edges are inside, and its right and bottom edges are
  // outside, in any orientation.
  for (const auto& square : {std::initializer_list<std::array<int, 2>>{{-11, -7}, {9, -7}, {9, 13}, {-11, 13}},
                             std::initializer_list<std::array<int, 2>>{{9, 13}, {9, -7}, {-11, -7}, {-11, 13}}}) {
    const auto found = rows_and_columns(square);
    CHECK(found.size() == 100);
    for (const auto& [x, y] : found) CHECK((x >= -11 && x < 9 && y >= -7 && y < 13));
  }
  // Diagonals run through centres, which belong to the half of the square right of the edge.
  const auto left_below = rows_and_columns({{-11, -11}, {9, 9}, {-11, 9}});
  const auto right_above = rows_and_columns({{-11, -11}, {9, 9}, {9, -11}});
  CHECK(left_below.count({-11, -11}) == 0);
  CHECK(left_below.count({-1, -1}) == 0);
  CHECK(left_below.count({-11, -9}) == 1);
  CHECK(right_above.count({-11, -11}) == 1);
  CHECK(right_above.count({-1, -1}) == 1);
  CHECK(right_above.count({9, 9}) == 0);
  CHECK(left_below.size() + right_above.size() == 100);
}

TEST_CASE("raster: the depth of a pixel is within the corners' range, in both arithmetics", "[raster]") {
  std::mt19937 random(37);
  std::uniform_int_distribution<int32_t> place(0, 3000);
  std::uniform_real_distribution<float> depth(0.0f, 1.0f);
  for (int round = 0; round < 3000; ++round) {
    Triangle triangle{};
    for (int i = 0; i < 3; ++i) {
      triangle.x[i] = place(random);
      triangle.y[i] = place(random);
      triangle.depth[i] = round % 3 == 0 && i > 0 ? triangle.depth[0] : depth(random);
    }
    int64_t area;
    if (orient(triangle, area, false, true) == Facing::kCulled) continue;
    const DepthPlane plane = make_depth_plane(triangle, area);
    const int32_t whole = static_cast<int32_t>(area);
    for (const auto& [e1, e2] :
         {std::array<int32_t, 2>{0, 0}, {whole, 0}, {0, whole}, {whole / 3, whole - whole / 3}}) {
      const float z = depth_at<int32_t>(plane, e1, e2);
      REQUIRE(z == depth_at<int64_t>(plane, e1, e2));
      REQUIRE(z >= std::min({triangle.depth[0], triangle.depth[1], triangle.depth[2]}));
      REQUIRE(z <= std::max({triangle.depth[0], triangle.depth[1], triangle.depth[2]}));
    }
  }
}

TEST_CASE("raster: every pixel of a fan of random triangles belongs to exactly one", "[raster]") {
  // A flat patch of jittered quads. Any pixel inside lies in one triangle, so every pixel must be counted once if each
  // triangle is drawn alone. Corners often lie on pixel centres: the lattice is a multiple of half a pixel.
  std::mt19937 random(3);
  for (int round = 0; round < 6; ++round) {
    const uint32_t n = 9;
    std::uniform_int_distribution<int> jitter(-3, 3);
    Soup patch;
    for (uint32_t j = 0; j <= n; ++j) {
      for (uint32_t i = 0; i <= n; ++i) {
        const bool border = i == 0 || j == 0 || i == n || j == n;
        patch.add((12 * static_cast<int>(i) + (border ? 0 : jitter(random)) - 54) / 128.0,
                  (12 * static_cast<int>(j) + (border ? 0 : jitter(random)) - 54) / 128.0, 0);
      }
    }
    View view = orthographic(look_at({0, 0, 1}, {0, 0, 0}, 64, 64), 0.5, 0, 2);  // 64 pixels per unit
    if (round >= 3) {
      view = look_at({0, 0, 1}, {0, 0, 0}, 64, 64, 0.1, 0.9);
      for (int i = 0; i < 3; ++i) view.right[i] = -view.right[i], view.up[i] = -view.up[i];  // upside down
    }
    std::vector<uint32_t> count(64 * 64);
    std::vector<uint32_t> quads;
    for (uint32_t j = 0; j < n; ++j) {
      for (uint32_t i = 0; i < n; ++i) {
        const uint32_t a = j * (n + 1) + i;
        quads.insert(quads.end(), {a, a + 1, a + n + 2, a, a + n + 2, a + n + 1});
      }
    }
    Soup all = patch;
    all.indices = quads;
    const Encoding encoding{.exponent = -7};
    SceneBuilder together(all, encoding);
    const std::vector<uint64_t> whole = draw(together.view(), view);
    for (size_t t = 0; t < quads.size(); t += 3) {
      Soup one = patch;
      one.indices.assign(quads.begin() + static_cast<ptrdiff_t>(t), quads.begin() + static_cast<ptrdiff_t>(t + 3));
      SceneBuilder builder(one, encoding);
      const std::vector<uint64_t> samples = draw(builder.view(), view);
      for (size_t i = 0; i < samples.size(); ++i) count[i] += samples[i] != kBackground;
    }
    uint32_t once = 0;
    for (size_t i = 0; i < count.size(); ++i) {
      INFO("round " << round << " pixel " << i % 64 << ", " << i / 64);
      REQUIRE(count[i] <= 1);
      REQUIRE(count[i] == (whole[i] != kBackground));
      once += count[i];
    }
    CHECK(once > 1500);
    if (round < 3) CHECK(once == 54 * 54);  // 108 / 128 of a unit, exactly
  }
}

TEST_CASE("raster: equal lattice points in different meshes and chunks leave no crack", "[raster]") {
  const Soup whole = grid(24, 0.0);
  Soup left = whole, right = whole;
  left.indices.clear();
  right.indices.clear();
  for (size_t t = 0; t < whole.indices.size(); t += 3) {
    // Split along a staircase, so that borders run in all directions.
    Soup& side = (t / 6 + t / 96) % 5 < 2 ? left : right;
    side.indices.insert(side.indices.end(), whole.indices.begin() + static_cast<ptrdiff_t>(t),
                        whole.indices.begin() + static_cast<ptrdiff_t>(t + 3));
  }
  const auto used_only = [](const Soup& soup) {
    Soup out;
    for (uint32_t i : soup.indices) {
      const float* p = soup.positions.data() + 3 * i;
      out.indices.push_back(out.add(p[0], p[1], p[2]));
    }
    return out;
  };
  for (uint32_t cut : {7u, 65536u}) {
    const Encoding encoding{.exponent = -11, .chunk_triangles = cut};
    SceneBuilder one(whole, encoding);
    SceneBuilder two;
    const uint32_t identity = two.identity();
    two.instance(two.mesh(used_only(left), encoding), identity);
    two.instance(two.mesh(used_only(right), encoding), identity);
    for (int round = 0; round < 12; ++round) {
      const View view = look_at({0.7 * std::sin(round), 0.02 + 0.1 * round, 0.9 * std::cos(round)},
                                {0.1, 0, 0.1 * round - 0.5}, 150, 90, 0.05);
      const std::vector<uint64_t> a = draw(one.view(), view), b = draw(two.view(), view);
      for (size_t i = 0; i < a.size(); ++i) REQUIRE(a[i] >> kIdBits == b[i] >> kIdBits);
      CHECK(covered(a) > 1000);
    }
  }
}
