// The measured scenes equal their definition bit for bit, and files are the same for any number of threads.
#include "tools/synth/synth.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "tests/full_disk.h"
#include "tests/results.h"
#include "tests/tools/temp_folder.h"
#include "tests/tools/validator.h"
#include "tools/synth/textured.h"
#include "tools/synth/textures.h"

using namespace scree;
using namespace scree::synth;
using nlohmann::json;
using tests::read_whole;
using tests::TempFolder;

namespace {

SynthOptions scene_options(const char* scene, MeshOrder order = MeshOrder::kRow) {
  return {.scene = scene, .order = order};
}

/// The sums that the definition states, by scene and order: positions, indices.
struct Expected {
  const char* scene;
  MeshOrder order;
  uint64_t positions, indices;
};

void check_sums(const Expected& expected) {
  SynthOptions options = scene_options(expected.scene, expected.order);
  options.checks = true;
  const SynthReport report = must(synthesize(options));
  CHECK(report.position_sum == expected.positions);
  CHECK(report.index_sum == expected.indices);
}

/// A written scene, read without the importer.
struct Document {
  explicit Document(const std::string& path) : root(json::parse(read_whole(path))) {
    buffer = read_whole(std::filesystem::path(path).replace_extension(".bin").string());
    CHECK(root["buffers"][0]["byteLength"] == buffer.size());
  }
  template <class T>
  std::vector<T> values(size_t accessor_index, size_t components) const {
    const json& accessor = root["accessors"][accessor_index];
    const json& view = root["bufferViews"][accessor["bufferView"].get<size_t>()];
    const size_t count = accessor["count"].get<size_t>() * components;
    REQUIRE(view["byteLength"].get<size_t>() == count * sizeof(T));
    const size_t offset = view.value("byteOffset", size_t{0});
    REQUIRE(offset + count * sizeof(T) <= buffer.size());
    std::vector<T> out(count);
    std::memcpy(out.data(), &buffer[offset], count * sizeof(T));
    return out;
  }
  json root;
  std::string buffer;
};

using Matrix = std::array<double, 16>;

Matrix multiply(const Matrix& a, const Matrix& b) {
  Matrix out{};
  for (size_t column = 0; column < 4; ++column)
    for (size_t row = 0; row < 4; ++row)
      for (size_t k = 0; k < 4; ++k) out[column * 4 + row] += a[k * 4 + row] * b[column * 4 + k];
  return out;
}

Matrix node_matrix(const json& node) {
  if (node.contains("matrix")) return node["matrix"].get<Matrix>();
  return {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
}

}  // namespace

TEST_CASE("scenes B and D have the sums of their definition", "[synth]") {
  check_sums({"B", MeshOrder::kRow, 0xf0e272c633601e8a, 0x8594704c9338c711});
  check_sums({"B", MeshOrder::kBlock, 0x5cc377213b4bf0ad, 0x8e3db63e2a0998a6});
  check_sums({"D", MeshOrder::kRow, 0xa0f47004a686832c, 0x8306755979cb9ce2});
}

TEST_CASE("scenes A and C have the sums of their definition", "[.slow]") {
  check_sums({"A", MeshOrder::kRow, 0xd19e4df716b2312b, 0x0601895a3b61b968});
  check_sums({"A", MeshOrder::kBlock, 0xb0e2cb7a129fafb7, 0x3763687f5b9703e2});
  check_sums({"C", MeshOrder::kRow, 0x5337121d344b94ab, 0x3d3e0f728ff1ff02});
  check_sums({"C", MeshOrder::kBlock, 0x08a83478eb693d51, 0xdbc1e07a3262c27d});
}

TEST_CASE("the measured scenes have the stated sizes", "[synth]") {
  const Scene a = terrain_scene(MeshOrder::kRow, 1), b = lantern_scene(MeshOrder::kRow, 1);
  const Scene c = zorahlike_scene(MeshOrder::kRow, 1), d = sponzalike_scene(1);
  CHECK(a.unique_triangles() == 399513600);
  CHECK(a.instances.size() == 12);
  CHECK(b.unique_triangles() == 995328);
  CHECK(b.drawn_triangles() == 2985984000);
  CHECK(c.unique_triangles() == 1447883520);
  CHECK(c.instances.size() == 26000);
  CHECK(c.drawn_triangles() == 18733401600);
  CHECK(d.unique_triangles() == 262176);
  CHECK(d.meshes.size() == 100);
  const std::array<float, 16> identity{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  for (const SceneInstance& instance : a.instances) CHECK(instance.matrix == identity);
}

TEST_CASE("block order is a permutation of row order", "[synth]") {
  const MeshRecipe mesh{.n = 24, .seed = 7, .octaves = 2, .amplitude = 0.1, .frequency = 2};
  MeshRecipe blocks = mesh;
  blocks.order = MeshOrder::kBlock;
  const auto triangles = [](const MeshRecipe& recipe) {
    std::vector<std::array<float, 9>> all;
    for (uint32_t quad = 0; quad < triangle_count(recipe) / 2; ++quad) {
      uint32_t corners[6];
      quad_indices(recipe, quad, corners);
      for (int t = 0; t < 2; ++t) {
        std::array<float, 9> triangle{};
        for (size_t i = 0; i < 3; ++i) {
          REQUIRE(corners[static_cast<size_t>(t) * 3 + i] < vertex_count(recipe));
          const Float3 p = vertex_position(recipe, corners[static_cast<size_t>(t) * 3 + i]);
          triangle[i * 3] = p.x;
          triangle[i * 3 + 1] = p.y;
          triangle[i * 3 + 2] = p.z;
        }
        all.push_back(triangle);
      }
    }
    std::sort(all.begin(), all.end());
    return all;
  };
  CHECK(triangles(mesh) == triangles(blocks));
  for (uint32_t vertex = 0; vertex < 25 * 25; ++vertex) {
    uint32_t x, y;
    grid_place(MeshOrder::kBlock, 24, vertex, &x, &y);
    CHECK(grid_vertex(MeshOrder::kBlock, 24, x, y) == vertex);
  }
}

TEST_CASE("a written scene has the definition's vertices, indices, instances and cameras", "[synth]") {
  const TempFolder folder;
  for (const char* name : {"A", "B", "C", "D"}) {
    const bool zorahlike = name[0] == 'C', hall = name[0] == 'D';
    const MeshOrder order = hall ? MeshOrder::kRow : MeshOrder::kBlock;
    SynthOptions options = scene_options(name, order);
    options.scale = zorahlike ? 1e-9 : 0.0001;  // C: 8 quads per side
    if (hall) options.scale = 1;
    options.checks = true;
    options.output = folder.file(std::string(name) + ".gltf");
    const SynthReport report = must(synthesize(options));
    const Scene scene = name[0] == 'A'   ? terrain_scene(order, options.scale)
                        : name[0] == 'B' ? lantern_scene(order, options.scale)
                        : zorahlike      ? zorahlike_scene(order, options.scale)
                                         : sponzalike_scene(options.scale);
    const Document document(options.output);
    CHECK(report.file_bytes == document.buffer.size() + std::filesystem::file_size(options.output));

    // The sums over the file's content.
    uint64_t position_sum = 0, index_sum = 0;
    bool bounds_right = true, indices_right = true;
    for (size_t m = 0; m < scene.meshes.size(); ++m) {
      const json& primitive = document.root["meshes"][m]["primitives"][0];
      const size_t position = primitive["attributes"]["POSITION"], index = primitive["indices"];
      const std::vector<float> positions = document.values<float>(position, 3);
      REQUIRE(positions.size() == vertex_count(scene.meshes[m]) * 3);
      std::array<float, 3> min{1e30f, 1e30f, 1e30f}, max{-1e30f, -1e30f, -1e30f};
      for (size_t i = 0; i < positions.size(); ++i) {
        position_sum += check_term(uint64_t{m} << 40 | i, std::bit_cast<uint32_t>(positions[i]));
        min[i % 3] = std::min(min[i % 3], positions[i]);
        max[i % 3] = std::max(max[i % 3], positions[i]);
      }
      const json& accessor = document.root["accessors"][position];
      for (size_t axis = 0; axis < 3; ++axis)
        bounds_right = bounds_right && accessor["min"][axis].get<double>() == min[axis] &&
                       accessor["max"][axis].get<double>() == max[axis];
      const bool short_indices = document.root["accessors"][index]["componentType"] == 5123;
      CHECK(short_indices == (vertex_count(scene.meshes[m]) <= 65535));
      std::vector<uint32_t> indices;
      if (short_indices) {
        const std::vector<uint16_t> shorts = document.values<uint16_t>(index, 1);
        indices.assign(shorts.begin(), shorts.end());
      } else {
        indices = document.values<uint32_t>(index, 1);
      }
      indices_right = indices_right && indices.size() == triangle_count(scene.meshes[m]) * 3;
      for (size_t i = 0; i < indices.size(); ++i) index_sum += check_term(uint64_t{m} << 40 | i, indices[i]);
    }
    CHECK(bounds_right);
    CHECK(indices_right);
    CHECK(position_sum == report.position_sum);
    CHECK(index_sum == report.index_sum);

    // The nodes: one root that converts from z up to y up, then instances and cameras.
    const json& nodes = document.root["nodes"];
    REQUIRE(document.root["scenes"][0]["nodes"] == json{0});
    const Matrix root = node_matrix(nodes[0]);
    REQUIRE(nodes.size() == 1 + scene.instances.size() + scene.cameras.size());
    bool matrices_right = true;
    for (size_t i = 0; i < scene.instances.size(); ++i) {
      const json& node = nodes[nodes[0]["children"][i].get<size_t>()];
      const Matrix matrix = node_matrix(node);
      matrices_right = matrices_right && node["mesh"] == scene.instances[i].mesh;
      for (size_t k = 0; k < 16; ++k)
        matrices_right = matrices_right && matrix[k] == double{scene.instances[i].matrix[k]};
    }
    CHECK(matrices_right);
    for (size_t c = 0; c < scene.cameras.size(); ++c) {
      const SceneCamera& camera = scene.cameras[c];
      const json& node = nodes[nodes[0]["children"][scene.instances.size() + c].get<size_t>()];
      const json& lens = document.root["cameras"][node["camera"].get<size_t>()];
      CHECK(lens["name"] == camera.name);
      CHECK(lens["perspective"]["yfov"].get<double>() == Approx(3.14159265358979 / 3));
      const Matrix world = multiply(root, node_matrix(node));
      // In the world's axes (x, z, -y): the eye, and -z towards the target.
      const double eye[3] = {camera.eye[0], camera.eye[2], -camera.eye[1]};
      double forward[3] = {camera.target[0] - camera.eye[0], camera.target[2] - camera.eye[2],
                           -(camera.target[1] - camera.eye[1])};
      const double length = std::hypot(forward[0], forward[1], forward[2]);
      double determinant = world[0] * (world[5] * world[10] - world[9] * world[6]) -
                           world[4] * (world[1] * world[10] - world[9] * world[2]) +
                           world[8] * (world[1] * world[6] - world[5] * world[2]);
      CHECK(determinant == Approx(1));
      CHECK(world[1] == Approx(0).margin(1e-12));  // the horizon is level
      CHECK(world[5] > 0);                         // y points up
      for (size_t k = 0; k < 3; ++k) {
        CHECK(world[12 + k] == eye[k]);
        CHECK(-world[8 + k] == Approx(forward[k] / length).margin(1e-12));
      }
    }
  }
}

TEST_CASE("smaller versions keep the instances and the view", "[synth]") {
  const Scene quarter = terrain_scene(MeshOrder::kRow, 0.25);
  CHECK(quarter.meshes[0].n == 2040);
  CHECK(quarter.unique_triangles() == 399513600 / 4);
  const Scene tiny = terrain_scene(MeshOrder::kRow, 0.0001);
  CHECK(tiny.meshes[0].n == 40);  // 40.8
  // The last corner lies where it lies at full scale, within the grid's jitter.
  const MeshRecipe& tile = tiny.meshes.back();
  const Float3 corner = vertex_position(tile, static_cast<uint32_t>(vertex_count(tile) - 1));
  CHECK(corner.x * tiny.instances.back().matrix[0] == Approx(1020).margin(2));
  CHECK(corner.y * tiny.instances.back().matrix[5] == Approx(765).margin(2));
  // The close-up camera stays above the ground of the scene's own terrain.
  const double stretch = 4080.0 / 40;
  const Double3 ground =
      terrain_position(static_cast<int>(std::lround(4800 / stretch)), static_cast<int>(std::lround(3200 / stretch)));
  CHECK(tiny.cameras[1].eye[2] == ground.z + 14);

  CHECK(lantern_scene(MeshOrder::kBlock, 0.01).meshes[0].n == 32);
  CHECK(lantern_scene(MeshOrder::kBlock, 0.01).instances.size() == 3000);
  const Scene zorahlike = zorahlike_scene(MeshOrder::kBlock, 0.01);
  CHECK(zorahlike.instances.size() == 26000);
  for (const MeshRecipe& mesh : zorahlike.meshes) CHECK(mesh.n % 8 == 0);
  CHECK(sponzalike_scene(1e-6).unique_triangles() == 100 * 12);
}

TEST_CASE("the bytes do not depend on the number of threads", "[synth]") {
  const TempFolder folder;
  for (const char* name : {"B", "slope"}) {
    std::string first;
    for (const uint32_t threads : {1u, 2u, 5u}) {
      SynthOptions options = scene_options(name);
      options.scale = 0.05;
      options.normals = options.uvs = name[0] == 'B';
      options.threads = threads;
      if (name[0] == 's') options.texture_size = 64;
      options.output = folder.file(std::string(name) + ".glb");
      REQUIRE(synthesize(options));
      const std::string bytes = read_whole(options.output);
      if (threads == 1) first = bytes;
      CHECK(bytes == first);
    }
  }
}

TEST_CASE("normals point outwards and have unit length", "[synth]") {
  const TempFolder folder;
  SynthOptions options = scene_options("B");
  options.scale = 0.003;
  options.normals = options.uvs = true;
  options.output = folder.file("b.gltf");
  REQUIRE(synthesize(options));
  const Document document(options.output);
  const json& attributes = document.root["meshes"][0]["primitives"][0]["attributes"];
  const std::vector<float> positions = document.values<float>(attributes["POSITION"], 3);
  const std::vector<float> normals = document.values<float>(attributes["NORMAL"], 3);
  const std::vector<float> uvs = document.values<float>(attributes["TEXCOORD_0"], 2);
  REQUIRE(normals.size() == positions.size());
  bool unit = true, outwards = true, inside = true;
  for (size_t i = 0; i < normals.size(); i += 3) {
    const double length = std::hypot(normals[i], normals[i + 1], normals[i + 2]);
    const double along =
        normals[i] * positions[i] + normals[i + 1] * positions[i + 1] + normals[i + 2] * positions[i + 2];
    unit = unit && std::abs(length - 1) < 1e-6;
    outwards = outwards && along > 0;
  }
  for (const float part : uvs) inside = inside && part >= 0 && part <= 1;
  CHECK(unit);
  CHECK(outwards);
  CHECK(inside);
  CHECK(std::filesystem::exists(folder.file("b_granite.jpg")));
}

TEST_CASE("instances of EXT_mesh_gpu_instancing lie where the matrices place them", "[synth]") {
  const TempFolder folder;
  SynthOptions options = scene_options("C");
  options.scale = 1e-9;
  options.gpu_instancing = true;
  options.output = folder.file("c.gltf");
  REQUIRE(synthesize(options));
  const Document document(options.output);
  CHECK(document.root["extensionsRequired"] == json{"EXT_mesh_gpu_instancing"});
  const Scene scene = zorahlike_scene(MeshOrder::kRow, options.scale);
  std::vector<std::vector<const SceneInstance*>> of_mesh(scene.meshes.size());
  for (const SceneInstance& instance : scene.instances) of_mesh[instance.mesh].push_back(&instance);
  double worst = 0;
  size_t seen = 0;
  for (const json& node : document.root["nodes"]) {
    if (!node.contains("extensions")) continue;
    const json& attributes = node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"];
    const std::vector<float> t = document.values<float>(attributes["TRANSLATION"], 3);
    const std::vector<float> q = document.values<float>(attributes["ROTATION"], 4);
    const std::vector<float> s = document.values<float>(attributes["SCALE"], 3);
    const auto& instances = of_mesh[node["mesh"].get<size_t>()];
    REQUIRE(instances.size() * 3 == t.size());
    for (size_t i = 0; i < instances.size(); ++i, ++seen) {
      const auto& matrix = instances[i]->matrix;
      const double z = q[i * 4 + 2], w = q[i * 4 + 3];
      const double c = 1 - 2 * z * z, sine = 2 * z * w;
      const double expected[] = {c * s[i * 3], sine * s[i * 3], -sine * s[i * 3 + 1], c * s[i * 3 + 1]};
      const double found[] = {matrix[0], matrix[1], matrix[4], matrix[5]};
      for (size_t k = 0; k < 4; ++k) worst = std::max(worst, std::abs(expected[k] - found[k]));
      for (size_t k = 0; k < 3; ++k) CHECK(t[i * 3 + k] == matrix[12 + k]);
    }
  }
  CHECK(seen == 26000);
  CHECK(worst < 1e-6);
}

TEST_CASE("the slope has valid images, indices and rocks, and depends on its seed", "[synth]") {
  const TempFolder folder;
  SynthOptions options = scene_options("slope");
  options.scale = 0.02;
  options.texture_size = 128;
  options.output = folder.file("slope.gltf");
  const SynthReport report = must(synthesize(options));
  CHECK(report.unique_triangles <= 300000);
  CHECK(report.instances > 200);
  const Document document(options.output);
  CHECK(document.root["images"].size() == 4);
  for (const json& image : document.root["images"]) {
    const std::string bytes = read_whole(folder.file(image["uri"]));
    CHECK(bytes.substr(0, 2) == (image["mimeType"] == "image/png" ? "\x89P" : "\xff\xd8"));
  }
  CHECK(document.root["cameras"][0]["name"] == "view");
  for (const json& mesh : document.root["meshes"]) {
    const json& primitive = mesh["primitives"][0];
    const size_t vertices = document.root["accessors"][primitive["attributes"]["POSITION"].get<size_t>()]["count"];
    const size_t index = primitive["indices"];
    uint32_t largest = 0;
    if (document.root["accessors"][index]["componentType"] == 5123) {
      for (const uint16_t value : document.values<uint16_t>(index, 1)) largest = std::max<uint32_t>(largest, value);
    } else {
      for (const uint32_t value : document.values<uint32_t>(index, 1)) largest = std::max(largest, value);
    }
    CHECK(largest == vertices - 1);
  }
  // The front faces of rocks are outside: the signed volume is positive.
  for (const size_t m : {size_t{0}, size_t{5}}) {
    const json& primitive = document.root["meshes"][m]["primitives"][0];
    const std::vector<float> p = document.values<float>(primitive["attributes"]["POSITION"], 3);
    double volume = 0;
    const std::vector<uint16_t> indices = document.values<uint16_t>(primitive["indices"], 1);
    for (size_t i = 0; i < indices.size(); i += 3) {
      const float *a = &p[indices[i] * 3u], *b = &p[indices[i + 1] * 3u], *c = &p[indices[i + 2] * 3u];
      volume +=
          a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
    }
    CHECK(volume / 6 > 0.5);
    CHECK(volume / 6 < 6);
  }
  options.seed = 2;
  options.output = folder.file("other.gltf");
  REQUIRE(synthesize(options));
  CHECK(read_whole(folder.file("other.gltf")) != read_whole(folder.file("slope.gltf")));
}

TEST_CASE("the forest has masked trees and upright cameras, and depends on its seed", "[synth][mask]") {
  const TempFolder folder;
  SynthOptions options = scene_options("forest");
  options.scale = 0.002;
  options.texture_size = 128;
  options.output = folder.file("forest.gltf");
  CHECK(must(synthesize(options)).instances == 101);
  const Document document(options.output);
  REQUIRE(document.root["meshes"].size() == 21);
  uint64_t masked = 0;
  for (size_t m = 0; m < 20; ++m) {
    const json& primitive = document.root["meshes"][m]["primitives"][0];
    const json& material = document.root["materials"][primitive["material"].get<size_t>()];
    CHECK(material["alphaMode"] == "MASK");
    CHECK(material["doubleSided"] == true);
    masked += document.root["accessors"][primitive["indices"].get<size_t>()]["count"].get<uint64_t>() / 3;
  }
  CHECK(masked == 20 * 400);
  CHECK(document.root["cameras"].size() == 3);
  for (const json& node : document.root["nodes"])
    if (node.contains("camera")) CHECK(node["matrix"][5].get<double>() > 0);  // its y axis points up
  const std::string first = read_whole(options.output);
  options.seed = 2;
  options.threads = 1;
  options.output = folder.file("other.gltf");
  REQUIRE(synthesize(options));
  CHECK(read_whole(folder.file("other.gltf")) != first);
  CHECK(read_whole(folder.file("other_leaves.png")) == read_whole(folder.file("forest_leaves.png")));
}

TEST_CASE("the Khronos validator accepts files written by synth", "[synth]") {
  const TempFolder folder;
  for (const char* name : {"A", "B", "C", "D", "slope", "forest"})
    for (const bool full : {false, true}) {
      SynthOptions options = scene_options(name);
      const bool slope = name[0] == 's' || name[0] == 'f';
      options.scale = name[0] == 'C' ? 1e-9 : (slope ? 0.01 : 0.0001);
      if (slope) options.texture_size = 64;
      options.normals = options.uvs = full && !slope;
      options.gpu_instancing = full;
      options.output = folder.file(std::string(name) + (full ? ".glb" : ".gltf"));
      REQUIRE(synthesize(options));
    }
  const tests::ValidatorRun validated = tests::run_validator(folder.path());
  if (!tests::validator_result_is_there(validated)) return;
  INFO(validated.output);
  CHECK(validated.exit_code == 0);
}

TEST_CASE("textures are seamless", "[synth]") {
  for (const TextureKind kind :
       {TextureKind::kGranite, TextureKind::kSandstone, TextureKind::kSlate, TextureKind::kGround}) {
    constexpr uint32_t kSize = 256;
    const std::vector<uint8_t> rgb = must(make_texture(kind, kSize, 2));
    // Neighbours across the border differ no more than neighbours inside the texture.
    const auto step = [&](uint32_t x0, uint32_t x1, bool transposed) {
      double sum = 0;
      for (uint32_t i = 0; i < kSize; ++i)
        for (uint32_t c = 0; c < 3; ++c) {
          const uint32_t a = transposed ? x0 * kSize + i : i * kSize + x0;
          const uint32_t b = transposed ? x1 * kSize + i : i * kSize + x1;
          sum += std::abs(int{rgb[a * 3 + c]} - int{rgb[b * 3 + c]});
        }
      return sum / (kSize * 3);
    };
    for (const bool transposed : {false, true}) {
      double inside = 0;
      for (uint32_t x = 0; x + 1 < kSize; ++x) inside += step(x, x + 1, transposed) / (kSize - 1);
      CHECK(step(kSize - 1, 0, transposed) < inside * 1.4);
      CHECK(step(kSize / 2, 0, transposed) > inside * 1.05);  // otherwise the test could not fail
    }
  }
}

TEST_CASE("the flag to stop ends the making of a texture", "[synth]") {
  std::atomic<bool> stop{false};
  CHECK(must(make_texture(TextureKind::kSlate, 64, 2, &stop)).size() == 3 * 64 * 64);
  stop = true;
  check_refusal(make_texture(TextureKind::kSlate, 64, 2, &stop), ErrorCode::kFile, "interrupted");
}

TEST_CASE("synth refuses invalid options", "[synth]") {
  const TempFolder folder;
  const auto code = [](const SynthOptions& options) { return refusal(synthesize(options)).code; };
  SynthOptions options = scene_options("E");
  options.output = folder.file("x.gltf");
  CHECK(code(options) == ErrorCode::kUsage);
  options.scene = "D";
  options.order = MeshOrder::kBlock;
  CHECK(code(options) == ErrorCode::kUsage);
  options.order = MeshOrder::kRow;
  for (const double scale : {0.0, -1.0, 1.5, std::nan("")}) {
    options.scale = scale;
    CHECK(code(options) == ErrorCode::kUsage);
  }
  options.scale = 1;
  options.seed = 3;
  CHECK(code(options) == ErrorCode::kUsage);
  options.seed = 1;
  for (const uint32_t size : {0u, 63u, 100u, 16384u}) {
    options.texture_size = size;
    CHECK(code(options) == ErrorCode::kUsage);
  }
  options.texture_size = 64;  // only for scenes with textures of their own
  CHECK(code(options) == ErrorCode::kUsage);
  options.texture_size.reset();
  options.output.clear();
  CHECK(code(options) == ErrorCode::kUsage);
  options.output = folder.file("x.obj");
  CHECK(code(options) == ErrorCode::kUsage);
  options.output = folder.file("missing/x.glb");
  CHECK(code(options) == ErrorCode::kFile);
  options = scene_options("slope");
  options.output = folder.file("x.glb");
  options.uvs = true;
  CHECK(code(options) == ErrorCode::kUsage);
  CHECK(std::filesystem::is_empty(folder.path()));
}

TEST_CASE("a full disk ends synth and leaves nothing behind", "[synth]") {
  const TempFolder folder;
  for (const char* name : {"B", "slope"}) {
    SynthOptions options = scene_options(name);
    options.threads = 3;
    if (name[0] == 's') options.texture_size = 64;
    options.scale = name[0] == 'B' ? 1 : 0.01;
    options.output = folder.file(std::string(name) + ".gltf");
    CHECK(refusal(tests::on_full_disk(1 << 20, [&] { return synthesize(options); })).code == ErrorCode::kFile);
  }
  CHECK(std::filesystem::is_empty(folder.path()));
}

TEST_CASE("the textured scene has detailed textures, the same for any number of threads", "[synth]") {
  const TempFolder folder;
  TexturedOptions options{.output = folder.file("a.gltf"), .meshes = 7, .size = 512, .stone = 256, .threads = 1};
  const TexturedReport report = must(write_textured(options));
  CHECK(report.triangles == 7 * 2 * 256 * 256);
  const double bits = 8.0 * static_cast<double>(report.texture_bytes) / (7.0 * 512 * 512);
  CHECK(bits > 1.5);
  CHECK(bits < 4);
  options.threads = 4;
  options.output = folder.file("b.gltf");
  REQUIRE(write_textured(options));
  CHECK(read_whole(folder.file("a.bin")) == read_whole(folder.file("b.bin")));
  for (int i = 0; i < 7; ++i) {
    const std::string name = "_texture" + std::to_string(i) + ".jpg";
    CHECK(read_whole(folder.file("a" + name)) == read_whole(folder.file("b" + name)));
    if (i > 0)
      CHECK(read_whole(folder.file("a" + name)) !=
            read_whole(folder.file("a_texture" + std::to_string(i - 1) + ".jpg")));
  }
  for (const uint32_t size : {0u, 100u, 65536u}) {
    options.size = size;
    CHECK(refusal(write_textured(options)).code == ErrorCode::kUsage);
  }
}
