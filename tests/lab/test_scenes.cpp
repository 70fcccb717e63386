// Generated chunks equal their definition by the scene functions, and are drawn like the converted scene.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <vector>

#include "format/geometry/chunk_layout.h"
#include "format/geometry/index_codec.h"
#include "format/geometry/position_codec.h"
#include "kernels/frame.h"
#include "lab/scenes/scene_tables.h"
#include "lab/scenes/visible_cost.h"
#include "runtime/scene/camera.h"
#include "runtime/scene/scene.h"
#include "tests/lab/host_chunks.h"
#include "tests/runtime/load_scene.h"
#include "tools/convert/convert.h"
#include "tools/synth/synth.h"

using namespace scree;
using namespace scree::lab;

namespace {

struct Generated {
  Generated(const synth::Scene& scene, const Encoding& encoding) : plans(plan_chunks(scene)) {
    tables = must(make_tables(scene, plans, scree::tests::chunk_boxes(scene, plans), encoding));
    arena.resize((tables.arena_bytes + 15) / 16);
    scree::tests::fill_chunks(scene, plans, tables, {bytes(), arena.size() * 16});
    pages = tables.page_pointers(bytes());
  }
  struct alignas(16) Block {
    std::byte bytes[16];
  };
  std::byte* bytes() { return arena.data()->bytes; }
  kernels::SceneView view() const { return tables.view(pages.data()); }

  std::vector<ChunkPlan> plans;
  SceneTables tables;
  std::vector<Block> arena;
  std::vector<const std::byte*> pages;
};

/// The chunk's payload.
std::span<const std::byte> stream(const Generated& made, const format::ChunkRecord& chunk,
                                  const format::ChunkStream& part) {
  return {made.pages[chunk.page] + chunk.offset + part.offset, part.bytes};
}

/// Decodes every chunk with the format's codecs and compares each triangle's corners with the definition.
void check_geometry(const synth::Scene& scene, const Encoding& encoding) {
  INFO(scene.name << " " << encoding_name(encoding));
  const Generated made(scene, encoding);
  uint64_t wrong_positions = 0, expected_first = 0, next_chunk = 0;
  for (size_t m = 0; m < scene.meshes.size(); ++m) {
    const synth::MeshRecipe& recipe = scene.meshes[m];
    const format::MeshRecord& mesh = made.tables.meshes[m];
    CHECK(mesh.triangle_count == synth::triangle_count(recipe));
    CHECK(mesh.first_chunk == next_chunk);
    next_chunk += mesh.chunk_count;
    expected_first = 0;
    uint64_t vertices = 0;
    std::vector<synth::Float3> defined;
    for (uint32_t v = 0; v < synth::vertex_count(recipe); ++v) defined.push_back(synth::vertex_position(recipe, v));
    const format::MeshLattice lattice = format::lattice_of(mesh);
    for (uint64_t c = mesh.first_chunk; c < next_chunk; ++c) {
      const format::ChunkRecord& chunk = made.tables.chunks[c];
      REQUIRE(chunk.first_triangle == expected_first);
      REQUIRE(chunk.triangle_count <= format::kMaxChunkTriangles);
      REQUIRE(chunk.offset % format::kChunkAlignment == 0);
      expected_first += chunk.triangle_count;
      vertices += chunk.vertex_count;
      const format::ChunkStreams streams = format::chunk_streams(mesh, chunk);
      REQUIRE(chunk.bytes == streams.bytes);
      std::vector<uint32_t> indices(3 * size_t{chunk.triangle_count});
      must(format::decode_indices(indices, chunk.vertex_count, {chunk.index_min, chunk.index_bits},
                                  stream(made, chunk, streams.indices)));
      std::vector<float> positions(3 * size_t{chunk.vertex_count});
      must(format::decode_positions(positions, lattice, format::position_range_of(chunk),
                                    stream(made, chunk, streams.positions)));
      std::vector<bool> used(chunk.vertex_count);
      for (uint32_t t = 0; t < chunk.triangle_count; t += 2) {
        uint32_t quad[6];
        synth::quad_indices(recipe, static_cast<uint32_t>((chunk.first_triangle + t) / 2), quad);
        for (uint32_t corner = 0; corner < 6; ++corner) {
          const uint32_t local = indices[3 * size_t{t} + corner];
          used[local] = true;
          const synth::Float3 expected = defined[quad[corner]];
          const float parts[3] = {expected.x, expected.y, expected.z};
          for (size_t axis = 0; axis < 3; ++axis) {
            const float found = positions[3 * size_t{local} + axis];
            const double error = std::fabs(static_cast<double>(found) - static_cast<double>(parts[axis]));
            const bool same = encoding.float32 ? std::bit_cast<uint32_t>(found) == std::bit_cast<uint32_t>(parts[axis])
                                               : error <= mesh.max_position_error;
            if (!same || found < mesh.bounds_min[axis] || found > mesh.bounds_max[axis]) ++wrong_positions;
          }
        }
      }
      CHECK(std::find(used.begin(), used.end(), false) == used.end());
    }
    CHECK(expected_first == mesh.triangle_count);
    CHECK(vertices == mesh.vertex_count);
  }
  CHECK(wrong_positions == 0);
  CHECK(next_chunk == made.tables.chunks.size());
  CHECK(made.tables.instance_base.back() == scene.drawn_triangles());
}

/// Compares the sums over the vertices and indices of float32 chunks with the definition.
void check_sums(const char* name, const synth::Scene& scene, double scale) {
  INFO(name);
  const Generated made(scene, Encoding{true, 16, false});
  uint64_t positions = 0, indices = 0;
  for (size_t c = 0; c < made.plans.size(); ++c) {
    const ChunkPlan& plan = made.plans[c];
    const format::ChunkRecord& chunk = made.tables.chunks[c];
    const synth::MeshRecipe& recipe = scene.meshes[plan.mesh];
    const std::byte* const payload = made.pages[chunk.page] + chunk.offset;
    const format::ChunkStreams streams = format::chunk_streams(made.tables.meshes[plan.mesh], chunk);
    std::vector<uint64_t> number(chunk.vertex_count);  // by vertex of the chunk: its number in the mesh
    for (uint32_t v = 0; v < chunk.vertex_count; ++v) {
      const GridPoint at = chunk_vertex(recipe, plan, v);
      number[v] =
          uint64_t{at.face} * (recipe.n + 1) * (recipe.n + 1) + synth::grid_vertex(recipe.order, recipe.n, at.x, at.y);
      // A row that two chunks share counts once.
      if (at.y == plan.first_row + plan.row_count && at.y != recipe.n) continue;
      for (uint64_t axis = 0; axis < 3; ++axis) {
        uint32_t bits;
        std::memcpy(&bits, payload + streams.positions.offset + 12 * uint64_t{v} + 4 * axis, sizeof bits);
        positions += synth::check_term(uint64_t{plan.mesh} << 40 | (3 * number[v] + axis), bits);
      }
    }
    for (uint64_t i = 0; i < 3 * uint64_t{chunk.triangle_count}; ++i) {
      uint32_t local;
      std::memcpy(&local, payload + 4 * i, sizeof local);
      indices += synth::check_term(uint64_t{plan.mesh} << 40 | (3 * chunk.first_triangle + i),
                                   static_cast<uint32_t>(number[local]));
    }
  }
  const synth::SynthReport expected =
      must(synth::synthesize({.scene = name, .scale = scale, .order = scene.meshes[0].order, .checks = true}));
  CHECK(positions == expected.position_sum);
  CHECK(indices == expected.index_sum);
}

/// Compares two of the CPU's pictures of a scene: through synth and convert (in convert's own order), and as generated
/// here.
void check_picture(const char* name, const synth::Scene& scene, double scale, bool float32) {
  INFO(name << (float32 ? " float32" : " 16 bits"));
  const tests::TempFolder folder;
  const synth::SynthOptions synth_options{.scene = name, .output = folder.file("scene.gltf"), .scale = scale};
  REQUIRE(synth::synthesize(synth_options));
  convert::ConvertOptions convert_options;
  convert_options.input = synth_options.output;
  convert_options.output = folder.file("scene.scree");
  convert_options.order = convert::Order::kNone;
  convert_options.encoding = convert::Encoding::kIndexed;
  convert_options.float32 = float32;
  convert_options.share = false;  // scene D has equal slabs
  REQUIRE(convert::convert(convert_options));
  runtime::SceneFile file = must(runtime::SceneFile::open(convert_options.output));
  const runtime::Scene converted = must(runtime::Scene::load(std::move(file), 0, {true, 2}));
  Generated made(scene, {.float32 = float32});
  // glTF has y up, so the file is rotated: its matrices are the same with exchanged rows.
  for (size_t i = 0; i < made.tables.instances.size(); ++i) {
    const kernels::SceneView& view = converted.view();
    REQUIRE(made.tables.instances[i].mesh == view.instances[i].mesh);
    const format::MatrixRecord& turned = view.matrices[view.instances[i].matrix];
    format::MatrixRecord& matrix = made.tables.matrices[i];
    for (size_t column = 0; column < 4; ++column) {
      CHECK(matrix.rows[0][column] == turned.rows[0][column]);
      CHECK(matrix.rows[2][column] == turned.rows[1][column]);
      CHECK(matrix.rows[1][column] == -turned.rows[2][column]);
    }
    matrix = turned;
  }
  for (const synth::SceneCamera& camera : scene.cameras) {
    const kernels::View view = tests::must_view(converted, {.camera = camera.name, .width = 321, .height = 183});
    std::vector<uint64_t> expected(size_t{321} * 183);
    std::vector<uint64_t> samples(expected.size());
    REQUIRE(kernels::draw_cpu(converted.view(), view, expected, 2));
    const kernels::FrameStats stats = must(kernels::draw_cpu(made.view(), view, samples, 2));
    const VisibleCost cost = visible_cost(made.view(), {}, view);
    CHECK(cost.draws == stats.draws);
    const VisibleCost boxed = visible_cost(made.view(), made.tables.boxes, view);
    CHECK(boxed.draws <= cost.draws);
    CHECK(boxed.bytes <= cost.bytes);
    CHECK(cost.bytes > 0);
    CHECK(cost.bytes <= made.tables.geometry_bytes);
    CHECK(std::any_of(samples.begin(), samples.end(), [](uint64_t s) { return s != kernels::kBackground; }));
    uint64_t different = 0;
    for (size_t i = 0; i < samples.size(); ++i) different += samples[i] != expected[i] ? 1 : 0;
    CHECK(different == 0);
  }
}

}  // namespace

TEST_CASE("generated chunks have the scene functions' triangles", "[bench_scenes]") {
  constexpr Encoding kPacked{};
  constexpr Encoding kFloat{true, 16, false}, kCoarse{false, 8, false};
  constexpr Encoding kFine{false, 24, true};
  for (const synth::MeshOrder order : {synth::MeshOrder::kRow, synth::MeshOrder::kBlock}) {
    synth::Scene scene = synth::zorahlike_scene(order, 1e-6);  // n = 8: whole meshes per chunk
    scene.meshes.resize(3);
    synth::MeshRecipe terrain = synth::terrain_scene(order, 1e-6).meshes[7];
    terrain.n = 200;  // a face takes two chunks
    scene.meshes.push_back(terrain);
    synth::MeshRecipe blob = scene.meshes[0];
    blob.n = 104;  // three faces per chunk
    scene.meshes.push_back(blob);
    std::erase_if(scene.instances, [](const synth::SceneInstance& i) { return i.mesh >= 3; });
    CHECK(plan_chunks(scene).size() == 3 + 2 + 2);
    for (const Encoding& encoding : {kPacked, kFloat, kCoarse, kFine}) check_geometry(scene, encoding);
  }
  check_geometry(synth::sponzalike_scene(0.1), kPacked);  // sides that are not a multiple of 8
}

TEST_CASE("chunks stay below their limit at full scale and cover every quad", "[bench_scenes]") {
  for (const synth::MeshOrder order : {synth::MeshOrder::kRow, synth::MeshOrder::kBlock}) {
    for (const synth::Scene& scene :
         {synth::terrain_scene(order, 1), synth::lantern_scene(order, 1), synth::zorahlike_scene(order, 1)}) {
      uint64_t quads = 0;
      for (const ChunkPlan& plan : plan_chunks(scene)) {
        const synth::MeshRecipe& recipe = scene.meshes[plan.mesh];
        REQUIRE(2 * chunk_quads(recipe, plan) <= format::kMaxChunkTriangles);
        quads += chunk_quads(recipe, plan);
        if (order == synth::MeshOrder::kBlock) REQUIRE(plan.first_row % 8 == 0);
      }
      CHECK(2 * quads == scene.unique_triangles());
    }
  }
}

TEST_CASE("generated and converted scenes draw the same", "[bench_scenes]") {
  check_picture("A", synth::terrain_scene(synth::MeshOrder::kRow, 0.0005), 0.0005, false);
  check_picture("B", synth::lantern_scene(synth::MeshOrder::kRow, 0.001), 0.001, true);
  check_picture("D", synth::sponzalike_scene(0.1), 0.1, false);
}

TEST_CASE("generated scenes have the sums of their definition", "[bench_scenes]") {
  for (const synth::MeshOrder order : {synth::MeshOrder::kRow, synth::MeshOrder::kBlock}) {
    check_sums("A", synth::terrain_scene(order, 0.0025), 0.0025);  // faces take two chunks
    check_sums("B", synth::lantern_scene(order, 0.1), 0.1);
    check_sums("C", synth::zorahlike_scene(order, 1e-6), 1e-6);
  }
  check_sums("D", synth::sponzalike_scene(0.3), 0.3);
}
