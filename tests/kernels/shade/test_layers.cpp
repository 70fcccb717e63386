// Layers of floats, compared with rays and planes in world space.
#include <array>
#include <cmath>
#include <random>

#include "format/vec3.h"
#include "tests/kernels/scene_builder.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;

namespace {

using Vector = Vec3;

Vector unit(const Vector& a) {
  const double length = std::sqrt(dot(a, a));
  return {a[0] / length, a[1] / length, a[2] / length};
}

struct Layers {
  std::vector<float> depth;
  std::vector<int64_t> triangle;
  std::vector<int32_t> instance;
  std::vector<float> normal, uv;
};

Layers layers_of(const SceneView& scene, const View& view, uint32_t side, const std::vector<uint64_t>& samples,
                 uint32_t threads = 2) {
  const size_t count = samples.size() / side / side;
  Layers out{std::vector<float>(count), std::vector<int64_t>(count), std::vector<int32_t>(count),
             std::vector<float>(3 * count), std::vector<float>(2 * count)};
  REQUIRE(layers_cpu(scene, view, side, samples,
                     {out.depth.data(), out.triangle.data(), out.instance.data(), out.normal.data(), out.uv.data()},
                     threads));
  return out;
}

/// A bumpy sphere whose vertices have texture coordinates and, on request, normals that differ from the faces'.
Soup ball(bool with_normals) {
  Soup soup = sphere(12, 0.1);
  for (size_t i = 0; i < soup.positions.size(); i += 3) {
    soup.uvs.push_back(3 * soup.positions[i] + 1);
    soup.uvs.push_back(soup.positions[i + 1] - 2 * soup.positions[i + 2]);
    if (!with_normals) continue;
    const Vector normal =
        unit({static_cast<double>(soup.positions[i]) + 0.3, static_cast<double>(soup.positions[i + 1]),
              static_cast<double>(soup.positions[i + 2])});
    for (const double c : normal) soup.normals.push_back(static_cast<float>(c));
  }
  return soup;
}

/// The intersection of a sample's ray with the triangle's plane, as weights of its corners.
Vector weights_of(const View& view, uint32_t x, uint32_t y, const std::array<Vector, 3>& corner) {
  const double across = (2 * (x + 0.5) / view.width - 1) * view.half_width;
  const double up = (1 - 2 * (y + 0.5) / view.height) * view.half_height;
  Vector origin{}, ray{};
  for (size_t i = 0; i < 3; ++i) {
    const double aside = view.right[i] * across + view.up[i] * up;
    origin[i] = view.eye[i] + (view.orthographic ? aside : 0);
    ray[i] = view.forward[i] + (view.orthographic ? 0 : aside);
  }
  const Vector normal = cross(corner[1] - corner[0], corner[2] - corner[0]);
  const double distance = dot(normal, corner[0] - origin) / dot(normal, ray);
  const Vector hit{origin[0] + distance * ray[0], origin[1] + distance * ray[1], origin[2] + distance * ray[2]};
  Vector weights{};
  for (size_t i = 0; i < 3; ++i)
    weights[i] =
        dot(normal, cross(corner[(i + 2) % 3] - corner[(i + 1) % 3], hit - corner[(i + 1) % 3])) / dot(normal, normal);
  return weights;
}

/// Compares every pixel of a scene of one mesh and several instances with the reference.
void check(SceneBuilder& builder, const Soup& soup, const View& view) {
  const SceneView scene = builder.view();
  const std::vector<uint64_t> samples = draw(scene, view);
  const Layers layers = layers_of(scene, view, 1, samples);
  const uint64_t triangles = soup.indices.size() / 3;
  size_t compared = 0;
  for (uint32_t y = 0; y < view.height; ++y) {
    for (uint32_t x = 0; x < view.width; ++x) {
      const size_t pixel = size_t{y} * view.width + x;
      const float* const normal = layers.normal.data() + 3 * pixel;
      const float* const uv = layers.uv.data() + 2 * pixel;
      if (samples[pixel] == kBackground) {
        CHECK((layers.triangle[pixel] == -1 && layers.instance[pixel] == -1 && std::isinf(layers.depth[pixel])));
        CHECK((normal[0] == 0 && normal[1] == 0 && normal[2] == 0 && uv[0] == 0 && uv[1] == 0));
        continue;
      }
      const auto id = static_cast<uint64_t>(layers.triangle[pixel]);
      CHECK(id == sample_id(samples[pixel]));
      CHECK(static_cast<uint64_t>(layers.instance[pixel]) == id / triangles);
      const format::MatrixRecord& matrix = scene.matrices[scene.instances[id / triangles].matrix];
      std::array<Vector, 3> corner{};
      const uint32_t* const vertex = soup.indices.data() + 3 * (id % triangles);
      for (size_t i = 0; i < 3; ++i)
        for (size_t r = 0; r < 3; ++r) {
          corner[i][r] = matrix.rows[r][3];
          for (size_t c = 0; c < 3; ++c)
            corner[i][r] += matrix.rows[r][c] * static_cast<double>(soup.positions[3 * vertex[i] + c]);
        }
      const Vector weights = weights_of(view, x, y, corner);
      if (*std::min_element(weights.begin(), weights.end()) < 0) continue;  // snapping draws a little past an edge
      Vector expected = unit(cross(corner[1] - corner[0], corner[2] - corner[0]));
      const double turned = dot(cross({matrix.rows[0][0], matrix.rows[0][1], matrix.rows[0][2]},
                                      {matrix.rows[1][0], matrix.rows[1][1], matrix.rows[1][2]}),
                                {matrix.rows[2][0], matrix.rows[2][1], matrix.rows[2][2]}) < 0
                                ? -1.0
                                : 1.0;
      for (double& c : expected) c *= turned;
      double tolerance = 1e-6;
      if (!soup.normals.empty()) {
        Vector object{};
        for (size_t i = 0; i < 3; ++i)
          for (size_t c = 0; c < 3; ++c) object[c] += weights[i] * static_cast<double>(soup.normals[3 * vertex[i] + c]);
        for (size_t r = 0; r < 3; ++r) {
          const Vector a{matrix.rows[(r + 1) % 3][0], matrix.rows[(r + 1) % 3][1], matrix.rows[(r + 1) % 3][2]};
          const Vector b{matrix.rows[(r + 2) % 3][0], matrix.rows[(r + 2) % 3][1], matrix.rows[(r + 2) % 3][2]};
          expected[r] = turned * dot(cross(a, b), object);
        }
        expected = unit(expected);
        tolerance = 3e-3;  // for codes of 12 bits, under matrices that stretch
      }
      for (size_t i = 0; i < 3; ++i) CHECK(static_cast<double>(normal[i]) == Approx(expected[i]).margin(tolerance));
      if (!soup.uvs.empty()) {
        for (size_t c = 0; c < 2; ++c) {
          double value = 0;
          for (size_t i = 0; i < 3; ++i) value += weights[i] * static_cast<double>(soup.uvs[2 * vertex[i] + c]);
          CHECK(static_cast<double>(uv[c]) == Approx(value).margin(2e-5));
        }
      } else {
        CHECK((uv[0] == 0 && uv[1] == 0));
      }
      ++compared;
    }
  }
  CHECK(compared > samples.size() / 20);
}

}  // namespace

TEST_CASE("normals and texture coordinates are interpolated where a pixel's ray hits the triangle", "[shade][layers]") {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> any(-1, 1);
  for (const bool with_normals : {false, true}) {
    const Soup soup = ball(with_normals);
    SceneBuilder builder;
    Encoding encoding = float32();
    encoding.chunk_triangles = 100;
    const uint32_t mesh = builder.mesh(soup, encoding);
    builder.instance(mesh, builder.identity());
    for (int round = 1; round <= 7; ++round)
      add_turned_instance(builder, mesh, round, 1.2 * any(random), [&] { return any(random); });
    const View view = look_at({2, 1.5, 4}, {0, 0, 0}, 71, 53);
    check(builder, soup, view);
    check(builder, soup, orthographic(view, 1.5, 0.1, 20));
    check(builder, soup, look_at({0.2, 0.1, 0.3}, {1, 0, 0}, 60, 40, 0.01));  // from inside: back faces
  }
}

TEST_CASE("a mesh without texture coordinates has zeros, and normals of its faces", "[shade][layers]") {
  SceneBuilder builder;
  const Soup soup = sphere(10, 0.05);
  builder.instance(builder.mesh(soup, float32()), builder.identity());
  check(builder, soup, look_at({0, 1, 3}, {0, 0, 0}, 40, 40));
}

TEST_CASE("layers of packed chunks equal those of floats within the lattice's error", "[shade][layers]") {
  const Soup soup = ball(true);
  const View view = look_at({2, 1.5, 4}, {0, 0, 0}, 60, 60);
  SceneBuilder exact(soup, float32());
  const std::vector<uint64_t> samples = draw(exact.view(), view);
  const Layers expected = layers_of(exact.view(), view, 1, samples);
  for (const Clusters clusters : {Clusters::kNone, Clusters::kClustered}) {
    const Encoding encoding{.exponent = -18, .clusters = clusters};
    SceneBuilder builder(soup, encoding);
    const Layers layers = layers_of(builder.view(), view, 1, draw(builder.view(), view));
    size_t differing = 0;
    for (size_t i = 0; i < samples.size(); ++i) {
      for (size_t c = 0; c < 3; ++c)
        differing += std::fabs(layers.normal[3 * i + c] - expected.normal[3 * i + c]) > 1e-3f ? 1 : 0;
      for (size_t c = 0; c < 2; ++c)
        differing += std::fabs(layers.uv[2 * i + c] - expected.uv[2 * i + c]) > 1e-3f ? 1 : 0;
    }
    CHECK(differing <= samples.size() / 100);
  }
}

TEST_CASE("a pixel of every layer shows its nearest sample", "[shade][layers]") {
  const Soup soup = ball(true);
  SceneBuilder builder(soup, float32());
  const SceneView scene = builder.view();
  for (const uint32_t side : {2u, 4u}) {
    View view = look_at({2, 1.5, 4}, {0, 0, 0}, 20 * side, 16 * side);
    const std::vector<uint64_t> samples = draw(scene, view);
    const Layers all = layers_of(scene, view, 1, samples);
    const Layers pixels = layers_of(scene, view, side, samples);
    for (uint32_t y = 0; y < 16; ++y) {
      for (uint32_t x = 0; x < 20; ++x) {
        size_t nearest = size_t{y} * side * view.width + x * side;
        for (uint32_t j = 0; j < side; ++j)
          for (uint32_t i = 0; i < side; ++i) {
            const size_t place = (size_t{y} * side + j) * view.width + x * side + i;
            if (samples[place] < samples[nearest]) nearest = place;
          }
        const size_t pixel = y * 20 + x;
        CHECK(pixels.depth[pixel] == all.depth[nearest]);
        CHECK(pixels.triangle[pixel] == all.triangle[nearest]);
        CHECK(pixels.instance[pixel] == all.instance[nearest]);
        for (size_t c = 0; c < 3; ++c) CHECK(pixels.normal[3 * pixel + c] == all.normal[3 * nearest + c]);
        for (size_t c = 0; c < 2; ++c) CHECK(pixels.uv[2 * pixel + c] == all.uv[2 * nearest + c]);
      }
    }
    const Layers alone = layers_of(scene, view, side, samples, 1);
    CHECK((alone.normal == pixels.normal && alone.uv == pixels.uv && alone.depth == pixels.depth));
  }
}
