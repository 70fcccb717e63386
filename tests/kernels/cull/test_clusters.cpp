#include <array>
#include <map>
#include <random>
#include <set>

#include "kernels/cpu/backend.h"
#include "tests/kernels/scene_builder.h"
#include "tests/kernels/shade_samples.h"

using namespace scree;
using namespace scree::kernels;
using namespace scree::tests;

namespace {

/// Adds colours, texture coordinates and normals to every vertex.
void add_attributes(Soup& soup) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> unit(0, 1);
  for (size_t v = 0; v < soup.positions.size() / 3; ++v) {
    soup.uvs.insert(soup.uvs.end(), {4 * soup.positions[3 * v], 4 * soup.positions[3 * v + 2]});
    for (int c = 0; c < 4; ++c) soup.colors.push_back(unit(random));
    soup.normals.insert(soup.normals.end(), {unit(random), 1.0f, unit(random)});
  }
}

/// Thousands of triangles of all sizes, some without area, some without shared vertices.
Soup mixed() {
  Soup soup = sphere(40, 0.3);
  std::mt19937 random(9);
  std::uniform_real_distribution<double> place(-2, 2);
  for (int i = 0; i < 400; ++i) {
    const double size = std::exp2(-8 * std::abs(place(random)) / 2);
    const uint32_t first = soup.add(place(random), place(random), place(random));
    const float* p = &soup.positions[3 * size_t{first}];
    const double x = p[0], y = p[1], z = p[2];
    soup.add(x + size * place(random), y + size * place(random), z + size * place(random));
    soup.add(x + size * place(random), y + size * place(random), z + size * place(random));
    soup.triangle(first, first + 1, i % 9 == 0 ? first : first + 2);
  }
  add_attributes(soup);
  return soup;
}

/// The soup at two positions, one of them mirrored.
void build(SceneBuilder& builder, const Soup& soup, Encoding encoding) {
  encoding.material = builder.material(format::kMaterialDoubleSided);
  const uint32_t mesh = builder.mesh(soup, encoding);
  builder.instance(mesh, builder.identity());
  builder.instance(mesh, builder.matrix({-0.7, 0.2, 0, 2.5, 0, 0.9, 0.1, 0.3, 0, 0, 1.1, -0.5}));
}

std::vector<View> cameras() {
  return {look_at({0.5, 0.8, 4}, {0, 0, 0}, 160, 120), look_at({0.9, 0.2, 0.6}, {0, 0, 0}, 97, 61, 0.3),
          look_at({0, 0.1, 0.2}, {1, 0, 0}, 64, 64, 0.01), look_at({30, 9, 40}, {0, 0, 0}, 200, 100),
          orthographic(look_at({2, 2, 4}, {0, 0, 0}, 120, 90), 2.5, 0.5, 9)};
}

}  // namespace

TEST_CASE("clusters: the picture equals that of indexed chunks in the same order, bit for bit", "[raster][clusters]") {
  const Soup soup = mixed();
  for (const int32_t exponent : {-6, -12, -18}) {
    for (const uint32_t chunk_triangles : {65536u, 1000u, 77u}) {
      Encoding encoding{.exponent = exponent, .chunk_triangles = chunk_triangles, .clusters = Clusters::kClustered};
      SceneBuilder clustered;
      build(clustered, soup, encoding);
      encoding.clusters = Clusters::kUndone;
      SceneBuilder undone;
      build(undone, soup, encoding);
      REQUIRE(clustered.chunks[0].encoding == format::ChunkEncoding::kClustered);
      const SceneView scene = clustered.view();
      const SceneView other = undone.view();
      for (const View& view : cameras()) {
        const std::vector<uint64_t> expected = draw(other, view);
        REQUIRE(covered(expected) > 0);
        CHECK(draw(scene, view) == expected);
        CHECK(draw(scene, view, 3) == expected);
        // Blocks that end within clusters (some have few triangles), and kernels without AVX2.
        QueueSizes sizes;
        for (const uint32_t triangles : {1u, 50u, 200u}) {
          sizes.block_triangles = triangles;
          sizes.round_triangles = triangles;
          CHECK(draw_with(scene, view, 2, InstructionSet::kBaseline, sizes) == expected);
        }
      }
    }
  }
}

TEST_CASE("clusters: shading and picking find the triangle and its vertices", "[shade][clusters]") {
  const Soup soup = mixed();
  Encoding encoding{.chunk_triangles = 2000, .clusters = Clusters::kClustered};
  SceneBuilder clustered;
  build(clustered, soup, encoding);
  encoding.clusters = Clusters::kUndone;
  SceneBuilder undone;
  build(undone, soup, encoding);
  const SceneView scene = clustered.view();
  const SceneView other = undone.view();
  for (const View& view : cameras()) {
    const std::vector<uint64_t> samples = draw(scene, view);
    for (const Show show : {Show::kColor, Show::kTexture, Show::kUv, Show::kNormal, Show::kStage, Show::kMesh}) {
      const ShadeOptions options{.show = show};
      std::vector<float> found(4 * samples.size());
      std::vector<float> expected(found.size());
      scree::tests::shade_samples(scene, view, samples, options, found);
      scree::tests::shade_samples(other, view, samples, options, expected);
      CHECK(found == expected);
    }
    // Each visible cluster has its own colour.
    const ShadeOptions options{.show = Show::kCluster};
    std::vector<float> rgba(4 * samples.size());
    scree::tests::shade_samples(scene, view, samples, options, rgba);
    std::map<std::pair<uint64_t, uint32_t>, std::set<std::array<float, 3>>> colors;  // by chunk and cluster
    std::set<std::array<float, 3>> all;
    for (size_t i = 0; i < samples.size(); ++i) {
      if (samples[i] == kBackground) continue;
      const Hit hit = find_triangle(scene, sample_id(samples[i]));
      const ChunkReader reader = make_reader(scene.meshes[scene.chunks[hit.chunk].mesh], scene.chunks[hit.chunk],
                                             scene.pages[scene.chunks[hit.chunk].page], Transform{}, hit.triangle);
      const std::array<float, 3> color{rgba[4 * i], rgba[4 * i + 1], rgba[4 * i + 2]};
      colors[{hit.chunk, reader.cluster.first_triangle}].insert(color);
      all.insert(color);
    }
    for (const auto& [cluster, of_one] : colors) CHECK(of_one.size() == 1);
    CHECK(all.size() == colors.size());
    for (const uint64_t sample : samples) {
      if (sample == kBackground) continue;
      const Hit hit = find_triangle(scene, sample_id(sample));
      const Hit same = find_triangle(other, sample_id(sample));
      if (hit.instance != same.instance || hit.chunk != same.chunk || hit.triangle != same.triangle)
        FAIL("triangle " << sample_id(sample));
    }
  }
}
