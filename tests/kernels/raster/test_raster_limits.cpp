#include <random>

#include "kernels/cpu/backend.h"
#include "kernels/shade/locate.h"
#include "tests/kernels/shade_samples.h"
#include "tests/kernels/square.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;

TEST_CASE("raster: a scene far from the world's origin gives the same picture as at the origin", "[raster]") {
  for (bool float32 : {false, true}) {
    Encoding encoding{.float32 = float32};
    SceneBuilder builder;
    const uint32_t mesh = builder.mesh(sphere(14, 0.2), encoding);
    builder.instance(mesh, builder.matrix({0.8, 0, 0.6, 0.25, 0, 1, 0, -0.5, -0.6, 0, 0.8, 0.125}));
    const View view = look_at({0.5, 0.75, 2.5}, {0, 0, 0}, 200, 160);
    const std::vector<uint64_t> expected = draw(builder.view(), view);
    CHECK(covered(expected) > 3000);
    const format::MatrixRecord at_origin = builder.matrices[0];
    // The second place is so far away that coordinates there are rounded to 1/4096. The result is still exact, because
    // eye and matrix are exact there.
    for (const std::array<double, 3>& away : {std::array<double, 3>{1e7, -3e7, 2.5e6}, {0x1p40, -0x1.8p40, 0x1p39}}) {
      View moved = view;
      builder.matrices[0] = at_origin;
      for (size_t i = 0; i < 3; ++i) {
        builder.matrices[0].rows[i][3] += away[i];
        moved.eye[i] += away[i];
      }
      CHECK(draw(builder.view(), moved) == expected);
    }
  }
  // As above with the lattice itself far away: coordinates around 2^40 steps.
  SceneBuilder builder(sphere(14, 0.2));
  View view = look_at({0.5, 0.75, 2.5}, {0, 0, 0}, 200, 160);
  const std::vector<uint64_t> expected = draw(builder.view(), view);
  builder.meshes[0].lattice_min[0] += int64_t{1} << 40;
  const double distance = std::ldexp(1.0, 40 + builder.meshes[0].lattice_exponent);
  builder.meshes[0].bounds_min[0] = static_cast<float>(builder.meshes[0].bounds_min[0] + distance);
  builder.meshes[0].bounds_max[0] = static_cast<float>(builder.meshes[0].bounds_max[0] + distance);
  view.eye[0] += distance;
  CHECK(draw(builder.view(), view) == expected);
}

TEST_CASE("raster: coordinates far beyond 2^30 steps from the eye take the wide path with the same result",
          "[raster]") {
  const FrameView view = make_frame_view(look_at({0, 0, 5}, {0, 0, 0}, 100, 100));
  SceneBuilder builder;
  builder.mesh(grid(4, 0.1), {.exponent = -12});
  builder.identity();
  const SceneView scene = builder.view();
  const Transform transform = make_transform(view, scene.matrices[0], -12, false);
  ChunkReader narrow = make_reader(scene.meshes[0], scene.chunks[0], scene.pages[0], transform, 0);
  REQUIRE(narrow.narrow);
  ChunkReader wide = narrow;
  wide.narrow = false;
  for (int64_t shift : {int64_t{0}, (int64_t{1} << 24) - 7, (int64_t{1} << 29) + 12345}) {
    for (int i = 0; i < 3; ++i) narrow.base[i] = wide.base[i] = shift * (i == 1 ? -1 : 1);
    for (uint32_t v = 0; v < scene.chunks[0].vertex_count; ++v) {
      float a[3];
      float b[3];
      double c[3];
      narrow.relative(v, a);
      wide.relative(v, b);
      wide.exact_relative(v, c);
      for (int i = 0; i < 3; ++i) {
        REQUIRE(a[i] == b[i]);
        REQUIRE(a[i] == static_cast<float>(c[i]));
      }
    }
  }
}

TEST_CASE("raster: projection is within a few ulps of double precision, snapped to the nearest 1/256", "[raster]") {
  std::mt19937 random(23);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int round = 0; round < 50; ++round) {
    const View camera = look_at({3 * unit(random), 3 * unit(random), 4}, {unit(random), unit(random), unit(random)},
                                1920, 1080, 0.01, 1.0);
    const FrameView view = make_frame_view(camera);
    format::MatrixRecord matrix;
    for (auto& row : matrix.rows)
      for (double& value : row) value = unit(random);
    const Transform transform = make_transform(view, matrix, -16, false);
    for (int i = 0; i < 200; ++i) {
      int64_t lattice[3];
      float d[3];
      for (int k = 0; k < 3; ++k) {
        lattice[k] = static_cast<int64_t>(unit(random) * 65536);
        d[k] = static_cast<float>(lattice[k] - transform.reference[k]);
      }
      double p[3];
      for (int k = 0; k < 3; ++k) {
        p[k] = matrix.rows[k][3] - camera.eye[k];
        for (int j = 0; j < 3; ++j) p[k] += matrix.rows[k][j] * static_cast<double>(lattice[j]) / 65536;
      }
      const auto along = [&](const double axis[3]) { return axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2]; };
      const double z = along(camera.forward);
      const ScreenVertex projected = project<false>(transform, view, d[0], d[1], d[2]);
      if (z < 0.02) continue;
      const double x = (along(camera.right) / z / camera.half_width + 1) * 960;
      const double y = (1 - along(camera.up) / z / camera.half_height) * 540;
      if (std::fabs(x) > 3000 || std::fabs(y) > 3000) continue;
      REQUIRE((projected.flags & kNeedsClip) == 0);
      // Half a sub-pixel for snapping, and a few roundings of the terms, whose size may far exceed their sum.
      double terms_x = std::fabs(static_cast<double>(transform.x[3]));
      double terms_y = std::fabs(static_cast<double>(transform.y[3]));
      double terms_w = std::fabs(static_cast<double>(transform.w[3]));
      for (int k = 0; k < 3; ++k) {
        terms_x += std::fabs(static_cast<double>(transform.x[k] * d[k]));
        terms_y += std::fabs(static_cast<double>(transform.y[k] * d[k]));
        terms_w += std::fabs(static_cast<double>(transform.w[k] * d[k]));
      }
      const double w = z / camera.z_near;
      const double rounding = 3 * std::ldexp(1.0, -24);
      const double slack_w = rounding * terms_w / w;
      CHECK(std::fabs(projected.x / 256.0 - x) <
            (0.5 + rounding * terms_x / w) / 256 + std::fabs(x - 960) * (slack_w + rounding));
      CHECK(std::fabs(projected.y / 256.0 - y) <
            (0.5 + rounding * terms_y / w) / 256 + std::fabs(y - 540) * (slack_w + rounding));
      CHECK(std::fabs(static_cast<double>(projected.depth) * w - 1) < slack_w + rounding);
    }
  }
}

TEST_CASE("raster: a vertex counts as outside a plane of the view only if double precision agrees", "[raster]") {
  std::mt19937 random(41);
  std::uniform_real_distribution<double> unit(-1, 1);
  uint64_t unsure = 0;
  for (int round = 0; round < 4000; ++round) {
    View camera = look_at({unit(random), unit(random), unit(random)},
                          {3 * unit(random), 3 * unit(random), 5 * unit(random)}, 64, 48, 0.01, 1.0);
    if (round % 4 == 0) camera = orthographic(camera, 2e4, -1e5, 1e5);
    const FrameView view = make_frame_view(camera);
    format::MatrixRecord matrix{};
    for (size_t i = 0; i < 3; ++i) matrix.rows[i][i] = 1 + 0.5 * unit(random);
    Transform transform = make_transform(view, matrix, 0, true);
    RelativeBox box{{0, 0, 0}, {3e5, 3e5, 3e5}};
    Transform rounded = transform;
    set_error(transform, box);
    // A vertex that is a few ulps from a plane, on either side.
    const double depth = 1e5 * unit(random);
    const double reach = camera.orthographic ? 1.0 : depth;
    double local[3] = {camera.half_width * reach * unit(random), camera.half_height * reach * unit(random), depth};
    const int plane = round % 3;
    const double nudge = 1 + 3e-7 * unit(random);
    if (plane == 0) local[0] = camera.half_width * reach * (unit(random) < 0 ? -1 : 1) * nudge;
    if (plane == 1) local[1] = camera.half_height * reach * (unit(random) < 0 ? -1 : 1) * nudge;
    if (plane == 2) local[2] = camera.z_near * nudge;
    float d[3];
    for (int i = 0; i < 3; ++i) {
      d[i] = static_cast<float>((camera.right[i] * local[0] + camera.up[i] * local[1] + camera.forward[i] * local[2]) /
                                matrix.rows[i][i]);
    }
    const double exact[3] = {static_cast<double>(d[0]), static_cast<double>(d[1]), static_cast<double>(d[2])};
    const ClipVertex v = clip_vertex(transform, exact, ScreenVertex{});
    const double w = camera.orthographic ? 1.0 : v.w;
    uint32_t outside = 0;
    if (v.x < -static_cast<double>(view.half_width) * w) outside |= kOutsideLeft;
    if (v.x > static_cast<double>(view.half_width) * w) outside |= kOutsideRight;
    if (v.y < -static_cast<double>(view.half_height) * w) outside |= kOutsideTop;
    if (v.y > static_cast<double>(view.half_height) * w) outside |= kOutsideBottom;
    if (camera.orthographic ? v.w > 1 : v.w < 1) outside |= kOutsideNear;
    if (camera.orthographic && v.w < 0) outside |= kOutsideFar;
    const auto flags = [&](const Transform& t) {
      return (camera.orthographic ? project<true>(t, view, d[0], d[1], d[2])
                                  : project<false>(t, view, d[0], d[1], d[2]))
                 .flags &
             kOutsideMask;
    };
    CHECK((flags(transform) & ~outside) == 0);
    unsure += (flags(rounded) & ~outside) != 0;
  }
  CHECK(unsure > 20);  // without the error bound some of them would be wrong
}

TEST_CASE("raster: facing, mirroring and double-sided materials", "[raster]") {
  Soup soup;
  soup.add(-0.5, -0.5, 0);
  soup.add(0.5, -0.5, 0);
  soup.add(0, 0.5, 0);
  soup.triangle(0, 1, 2);  // counter-clockwise towards +z
  for (bool double_sided : {false, true}) {
    for (bool mirrored : {false, true}) {
      for (bool behind : {false, true}) {
        SceneBuilder builder;
        const Encoding encoding{.material =
                                    builder.material(double_sided ? uint32_t{format::kMaterialDoubleSided} : 0u)};
        const double s = mirrored ? -1 : 1;
        builder.instance(builder.mesh(soup, encoding), builder.matrix({s, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}));
        const View view = look_at({0, 0, behind ? -2.0 : 2.0}, {0, 0, 0}, 64, 64);
        const bool expected = double_sided || !behind;  // mirroring exchanges front and back
        CHECK((covered(draw(builder.view(), view)) > 100) == expected);
      }
    }
  }
}

TEST_CASE("raster: matrices without an inverse, huge, tiny and infinite numbers", "[raster]") {
  std::mt19937 random(29);
  const double huge[] = {0, 1e-300, 1e-30, 1e-6, 1, 1e6, 1e7, 1e20, 1e38, 1e150, 1.7e308, -1e7, -1e300};
  std::uniform_int_distribution<size_t> pick(0, std::size(huge) - 1);
  for (int round = 0; round < 200; ++round) {
    SceneBuilder builder;
    const Encoding encoding{.float32 = round % 2 == 1, .material = builder.material(format::kMaterialDoubleSided)};
    Soup soup = sphere(4, 0.1);
    if (round % 4 == 1)
      for (float& p : soup.positions) p *= 3e38f;
    const uint32_t mesh = builder.mesh(soup, encoding);
    if (round % 4 == 2) builder.meshes[0].lattice_exponent = round % 8 == 2 ? 127 : -149;
    std::array<double, 12> rows;
    for (double& value : rows) value = huge[pick(random)];
    builder.instance(mesh, builder.matrix(rows));
    View view = look_at({0, 0, 3}, {0, 0, 0}, 50, 40);
    if (round % 5 == 0) view.eye[0] = huge[pick(random)] * 0.5;
    if (round % 3 == 0) view = orthographic(view, 1, 0, 10);
    const SceneView scene = builder.view();
    const std::vector<uint64_t> samples = draw_with(scene, view, 1, InstructionSet::kBaseline, QueueSizes{});
    REQUIRE(draw_with(scene, view, 2, best_instruction_set(), QueueSizes{}) == samples);
    std::vector<float> rgba(4 * samples.size());
    for (Show show : {Show::kTexture, Show::kNormal, Show::kStage, Show::kDepth}) {
      scree::tests::shade_samples(scene, view, samples, {.show = show}, rgba);
      for (float value : rgba) REQUIRE((value >= 0 && value <= 1));
    }
  }
  // A flattened mesh (a shadow): its matrix is singular, and it is drawn in its plane.
  SceneBuilder builder;
  builder.instance(builder.mesh(sphere(10, 0), {.material = builder.material(format::kMaterialDoubleSided)}),
                   builder.matrix({1, 0, 0, 0, 0, 0, 0, 0.5, 0, 0, 1, 0}));
  const View view = look_at({0, 3, 0.001}, {0, 0, 0}, 200, 200, 0.1, 1.0);
  const double radius = 100 / 2.5 / std::tan(0.5);
  CHECK(static_cast<double>(covered(draw(builder.view(), view))) == Approx(3.14159 * radius * radius).epsilon(0.05));
}

TEST_CASE("raster: slivers and points", "[raster]") {
  // Long triangles thinner than a sub-pixel, alone and side by side: no pixel is drawn twice, and a triangle without
  // area draws nothing.
  Soup fan;
  const uint32_t hub = fan.add(-1, -0.8, 0);
  const uint32_t count = 4000;
  for (uint32_t i = 0; i <= count; ++i) fan.add(1, -0.8 + 1.6 * i / count, 0);
  for (uint32_t i = 0; i < count; ++i) fan.triangle(hub, hub + 1 + i, hub + 2 + i);
  Soup whole;
  whole.add(-1, -0.8, 0);
  whole.add(1, -0.8, 0);
  whole.add(1, 0.8, 0);
  whole.triangle(0, 1, 2);
  Encoding encoding{.exponent = -20};
  for (int round = 0; round < 4; ++round) {
    const View view = look_at({0.3 * round, 0.2 * round, 2}, {0, 0, 0}, 190, 140);
    SceneBuilder slivers(fan, encoding);
    SceneBuilder one(whole, encoding);
    const std::vector<uint64_t> thin = draw(slivers.view(), view), solid = draw(one.view(), view);
    // In one of the pictures the far edge is a chain of snapped points. So a few pixels of the outline may differ, but
    // none inside.
    uint32_t differ = 0;
    for (size_t y = 1; y + 1 < 140; ++y) {
      for (size_t x = 1; x + 1 < 190; ++x) {
        const size_t i = 190 * y + x;
        if ((thin[i] == kBackground) == (solid[i] == kBackground)) continue;
        ++differ;
        CHECK((solid[i - 1] == kBackground || solid[i + 1] == kBackground || solid[i - 190] == kBackground ||
               solid[i + 190] == kBackground));
      }
    }
    CHECK(differ <= 5);
    CHECK(covered(solid) > 4000);
  }
  SceneBuilder points;
  Soup flat;
  flat.add(0, 0, 0);
  flat.add(0.5, 0, 0);
  flat.triangle(0, 0, 0);
  flat.triangle(0, 1, 0);
  flat.triangle(1, 1, 0);
  encoding.material = points.material(format::kMaterialDoubleSided);
  points.instance(points.mesh(flat, encoding), points.identity());
  CHECK(covered(draw(points.view(), look_at({0, 0, 1}, {0, 0, 0}, 64, 64))) == 0);
}

TEST_CASE("raster: images of 16384 samples per side", "[raster]") {
  SceneBuilder builder{square()};
  for (const auto& [width, height] : {std::array<uint32_t, 2>{16384, 3}, std::array<uint32_t, 2>{2, 16384}}) {
    const View view = orthographic(look_at({0, 0, 1}, {0, 0, 0}, width, height), 0.9, 0, 2);
    View exact = view;
    exact.half_width = 0.9;  // stretched, so that both sides use all pixels
    const std::vector<uint64_t> samples = draw(builder.view(), exact);
    CHECK(covered(samples) == samples.size());  // including the last row and column
    exact.half_width = exact.half_height = 2;
    const uint64_t inside = covered(draw(builder.view(), exact));
    // Covered is half of the long side, by one row or column of the short side: the middle one of three rows, or the
    // left one of two columns, whose centres lie on the square's left and right edges.
    CHECK(inside == 8192);
  }
}

TEST_CASE("raster: ids past 2^32", "[raster]") {
  SceneBuilder builder;
  const uint32_t mesh = builder.mesh(grid(5, 0.1), {.chunk_triangles = 10});
  builder.instance(mesh, builder.matrix({1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}));
  builder.instance(mesh, builder.matrix({1, 0, 0, 0, 0, 1, 0, 0.3, 0, 0, 1, 0}));
  const View view = look_at({0, 1, 2}, {0, 0, 0}, 120, 90);
  const std::vector<uint64_t> expected = draw(builder.view(), view);
  for (uint64_t first : {uint64_t{0}, (uint64_t{1} << 32) - 30, (uint64_t{1} << 35) + 12345, kIdMask - 100}) {
    const std::vector<uint64_t> samples = draw(builder.view(first), view);
    for (size_t i = 0; i < samples.size(); ++i)
      REQUIRE(samples[i] == (expected[i] == kBackground ? kBackground : expected[i] + first));
  }
  std::vector<uint64_t> samples(120 * 90);
  CHECK(refusal(draw_cpu(builder.view(kIdMask - 99), view, samples, 1)).code == ErrorCode::kRange);
}

TEST_CASE("raster: the triangle of an id, with empty meshes and chunks in between", "[raster]") {
  SceneBuilder builder;
  const Encoding encoding{.chunk_triangles = 7};
  const uint32_t some = builder.mesh(grid(4, 0.1), encoding);  // 32 triangles, 5 chunks
  const uint32_t none = builder.mesh(Soup{{0, 0, 0}, {}, {}, {}, {}, {}, {}}, encoding);
  const uint32_t one = builder.mesh(Soup{{0, 0, 0, 1, 0, 0, 0, 1, 0}, {0, 1, 2}, {}, {}, {}, {}, {}}, encoding);
  const uint32_t identity = builder.identity();
  for (uint32_t mesh : {none, some, none, none, one, some, none}) builder.instance(mesh, identity);
  const SceneView scene = builder.view();
  uint64_t id = 0;
  for (uint64_t i = 0; i < builder.instances.size(); ++i) {
    const format::MeshRecord& mesh = builder.meshes[builder.instances[i].mesh];
    for (uint64_t c = 0; c < mesh.chunk_count; ++c) {
      for (uint32_t t = 0; t < builder.chunks[mesh.first_chunk + c].triangle_count; ++t, ++id) {
        const Hit hit = find_triangle(scene, id);
        REQUIRE(hit.instance == i);
        REQUIRE(hit.chunk == mesh.first_chunk + c);
        REQUIRE(hit.triangle == t);
      }
    }
  }
  CHECK(id == 65);
  CHECK(covered(draw(scene, look_at({0.4, 2, 0.1}, {0, 0, 0}, 80, 60))) > 500);
}

TEST_CASE("raster: depth codes", "[raster]") {
  View view = look_at({0, 0, 1}, {0, 0, 0}, 8, 8, 0.25);
  uint32_t last = 0;
  for (double distance = 0.25; distance < 0.25 * std::ldexp(1.0, 63); distance *= 1.37) {
    const uint32_t code = perspective_depth_code(static_cast<float>(view.z_near / distance));
    CHECK(code >= last);
    last = code;
    CHECK(depth_of_code(view, code) == Approx(distance).epsilon(2.5e-7));
  }
  CHECK(perspective_depth_code(1.0f) == 0);
  CHECK(perspective_depth_code(0.0f) == kFarthestDepthCode);
  CHECK(perspective_depth_code(std::nanf("")) == kFarthestDepthCode);
  CHECK(std::isinf(depth_of_code(view, kFarthestDepthCode)));
  CHECK(std::isinf(depth_of_code(view, sample_depth_code(kBackground))));
  view = orthographic(view, 1, -2, 6);
  for (double t = 0; t <= 1; t += 1.0 / 64)
    CHECK(depth_of_code(view, orthographic_depth_code(static_cast<float>(t))) == Approx(6 - 8 * t).margin(1e-7));
  CHECK(orthographic_depth_code(1.0f) == 0);
  CHECK(orthographic_depth_code(0.0f) < kFarthestDepthCode);
  // All codes are in order, at the ends and across an octave.
  for (uint32_t code : {0u, 1u, (1u << 22) - 2, 1u << 22, 5u << 22, kFarthestDepthCode - 3}) {
    for (uint32_t c = code; c < code + 2; ++c) {
      const double value = depth_value_of_code(c, false);
      CHECK(perspective_depth_code(static_cast<float>(value * (1 + 1e-8))) <= c);
      CHECK(perspective_depth_code(static_cast<float>(value * (1 - 1e-8))) >= c);
      CHECK(depth_value_of_code(c + 1, false) < value);
    }
  }
}

TEST_CASE("raster: absent pages are left out, wrong sizes are refused", "[raster]") {
  SceneBuilder builder(grid(8, 0), {.chunk_triangles = 16});
  SceneView scene = builder.view();
  const View view = look_at({0, 2, 0.1}, {0, 0, 0}, 80, 60);
  const uint64_t all = covered(draw(scene, view));
  builder.page_pointers[3] = nullptr;
  const std::vector<uint64_t> samples = draw(scene, view);
  CHECK(covered(samples) < all);
  for (uint64_t sample : samples) CHECK((sample == kBackground || sample_id(sample) / 16 != 3));

  std::vector<uint64_t> few(79 * 60);
  CHECK(draw_cpu(scene, view, few, 1).error().code == ErrorCode::kRange);
  View wide = view;
  wide.width = kMaxImageSide + 1;
  CHECK(draw_cpu(scene, wide, few, 1).error().code == ErrorCode::kRange);
  View blind = view;
  blind.z_near = 0;
  std::vector<uint64_t> enough(80 * 60);
  CHECK(draw_cpu(scene, blind, enough, 1).error().code == ErrorCode::kRange);
  scene.instance_count = 0;
  CHECK(covered(draw(scene, view)) == 0);
}

TEST_CASE("raster: one chunk of more triangles than a block, and vertices far apart", "[raster]") {
  // --chunk-triangles 0: several blocks share a chunk. A block is drawn from a buffer of the chunk's vertices, or
  // vertex by vertex.
  const Soup field = grid(200, 0.05);
  Soup shuffled = field;
  std::mt19937 random(31);
  for (size_t i = shuffled.indices.size() / 3 - 1; i > 0; --i) {
    const size_t j = std::uniform_int_distribution<size_t>(0, i)(random);
    for (size_t k = 0; k < 3; ++k) std::swap(shuffled.indices[3 * i + k], shuffled.indices[3 * j + k]);
  }
  const View view = look_at({0, 1.2, 0.8}, {0, 0, 0}, 400, 300);
  for (const Soup& soup : {field, shuffled}) {
    const Encoding small{.chunk_triangles = 1000};
    Encoding large = small;
    large.chunk_triangles = UINT32_MAX;
    SceneBuilder cut(soup, small);
    SceneBuilder whole(soup, large);
    REQUIRE(whole.chunks[0].triangle_count > kernels::QueueSizes{}.block_triangles);
    CHECK(draw(cut.view(), view) == draw(whole.view(), view));
  }
}
