// The instances of the scenes of a file. With EXT_mesh_gpu_instancing few are held and compared, and many are streamed.
#include <array>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "tests/speed.h"
#include "tests/tools/compare/source_compare.h"
#include "tests/tools/model_maker.h"
#include "tools/convert/convert.h"
#include "tools/convert/plan/scene_tables.h"

using namespace scree;
using tests::ModelMaker;
using tests::TempFolder;

namespace {

/// Positions along a line. The first `equal` of them are the same.
std::vector<float> places(uint64_t count, uint64_t equal) {
  std::vector<float> values;
  for (uint64_t i = 0; i < count; ++i) values.insert(values.end(), {i < equal ? 0.0f : static_cast<float>(i), 2, 3});
  return values;
}

/// Two nodes at the same position with the same instances, one node with another world matrix, and a small one.
void make_many(const std::string& path, uint64_t count, uint64_t equal) {
  ModelMaker maker(path);
  const uint32_t trunk = maker.mesh("trunk", {maker.grid({})});
  const uint32_t leaves = maker.mesh("leaves", {maker.grid({}), maker.grid({.origin = {0, 1, 0}})});
  const uint32_t large = maker.floats(places(count, equal), tools::GltfType::kVec3);
  const uint32_t small = maker.floats(places(3, 1), tools::GltfType::kVec3);
  const auto add = [&](const char* name, uint32_t mesh, std::array<double, 3> place, uint32_t instances) {
    const uint32_t node = maker.node(name, mesh, place);
    maker.writer().node(node).instancing.emplace_back("TRANSLATION", instances);
  };
  add("trunks", trunk, {0, 0, 0}, large);
  add("leaves", leaves, {0, 0, 0}, large);
  add("moved", trunk, {0, 7, 0}, large);
  add("few", trunk, {0, 9, 0}, small);
  maker.node("once", trunk, {0, 2, 3});
  maker.finish();
}

tests::PackedFile converted(const TempFolder& folder, uint64_t count, uint64_t equal,
                            convert::Grid grid = convert::Grid::kMesh) {
  make_many(folder.file("in.glb"), count, equal);
  convert::ConvertOptions options;
  options.input = folder.file("in.glb");
  options.output = folder.file("out.scree");
  options.grid = grid;
  must(convert::convert(options));
  return must(tests::open_packed(options.output));
}

/// Checks that every instance lies at the place given by its node and its index among the node's instances.
void check_instances(const format::Container& file, uint64_t count, uint64_t equal) {
  REQUIRE(file.node_instances().size() == 3 * count + 3);
  REQUIRE(file.instances().size() == count * 4 + 3 + 1);
  bool in_place = true, is_sorted = true;
  for (uint64_t i = 0; i < file.instances().size(); ++i) {
    const format::InstanceRecord& instance = file.instances()[i];
    const std::string_view name = file.string(file.nodes()[instance.node].name);
    const format::MatrixRecord& m = file.matrices()[instance.matrix];
    const uint64_t k = instance.node_instance;
    const double x = name == "once" || (name != "few" && k < equal) ? 0 : static_cast<double>(k);
    const double y = name == "moved" ? 9 : name == "few" ? 11 : 2;
    in_place &= m.rows[0][0] == 1 && m.rows[0][3] == x && m.rows[1][3] == y && m.rows[2][3] == 3;
    if (i == 0) continue;
    const format::InstanceRecord& last = file.instances()[i - 1];
    is_sorted &= std::tie(last.mesh, last.node, last.node_instance) <
                 std::tie(instance.mesh, instance.node, instance.node_instance);
  }
  CHECK(in_place);
  CHECK(is_sorted);
  CHECK(file.scenes()[0].triangle_count == 32 * file.instances().size());
}

}  // namespace

TEST_CASE("with few instances each world matrix is stored once", "[convert]") {
  const TempFolder folder;
  const tests::PackedFile opened = converted(folder, 500, 100);
  check_instances(opened.file, 500, 100);
  CHECK(opened.file.matrices().size() == 401 + 401 + 3);
}

TEST_CASE("more instances than fit in memory are written in order", "[convert]") {
  const TempFolder folder;
  const uint64_t count = convert::kMaxHeldInstances + 1;
  const tests::PackedFile opened = converted(folder, count, 100);
  check_instances(opened.file, count, 100);
  // The instances of the first two nodes are written once for both nodes. The nodes "few" and "once" are held.
  CHECK(opened.file.matrices().size() == 2 * count + 3 + 1);
}

TEST_CASE("meshes share a step if their matrices may be equal", "[convert]") {
  const TempFolder folder;
  const tests::PackedFile opened = converted(folder, convert::kMaxHeldInstances + 1, 1, convert::Grid::kScene);
  REQUIRE(opened.file.meshes().size() == 3);
  for (uint64_t i = 1; i < 3; ++i)
    CHECK(opened.file.meshes()[i].lattice_exponent == opened.file.meshes()[0].lattice_exponent);
}

TEST_CASE("the instances of each scene are sorted by mesh and node", "[convert]") {
  const TempFolder folder;
  ModelMaker maker(folder.file("in.glb"));
  const uint32_t pair = maker.mesh("pair", {maker.grid({}), maker.grid({.origin = {0, 1, 0}})});
  const uint32_t single = maker.mesh("single", {maker.grid({.columns = 5})});
  const auto add = [&](const char* name, uint32_t mesh, const std::vector<uint32_t>& children = {}) {
    return maker.writer().add_node({.name = name, .mesh = mesh, .children = children});
  };
  const uint32_t leaf = add("leaf", pair), twig = add("twig", single, {leaf}), tree = add("tree", pair, {twig});
  const uint32_t stone = add("stone", single), bare = add("bare", format::kNone);
  const std::vector<std::vector<uint32_t>> scenes{{stone, tree}, {tree}, {bare}, {bare, stone}};
  for (const std::vector<uint32_t>& roots : scenes) maker.writer().add_scene({.name = "", .nodes = roots});
  maker.finish(false);
  convert::ConvertOptions options;
  options.input = folder.file("in.glb");
  options.output = folder.file("out.scree");
  must(convert::convert(options));
  const tests::PackedFile opened = must(tests::open_packed(options.output));
  std::string found;
  for (uint64_t i = 0; i < opened.file.scenes().size(); ++i) {
    const format::SceneRecord& scene = opened.file.scenes()[i];
    for (uint64_t k = scene.first_instance; k < scene.first_instance + scene.instance_count; ++k) {
      const format::InstanceRecord& instance = opened.file.instances()[k];
      found += std::to_string(instance.mesh) + std::string(opened.file.string(opened.file.nodes()[instance.node].name));
    }
    found += "|";
  }
  CHECK(found == "0tree0leaf1tree1leaf2twig2stone|0tree0leaf1tree1leaf2twig||2stone|");
}

TEST_CASE("the time for many scenes of one node each grows with their number, not with its square", "[convert]") {
  constexpr uint32_t kCount = 200000;
  convert::SourceScene scene;
  scene.groups.resize(1);
  scene.nodes.resize(kCount);
  scene.scenes.resize(kCount);
  for (uint32_t i = 0; i < kCount; ++i) {
    scene.nodes[i].group = 0;
    scene.scenes[i].roots = {i};
  }
  format::TableSet tables;
  tables.meshes.resize(1);
  tables.groups.push_back({0, 0, 1, 0});
  const TempFolder folder;
  format::ContainerWriter writer = must(format::ContainerWriter::create(folder.file("out.scree")));
  const double start = tests::cpu_seconds();
  const convert::InstancePlan plan = must(convert::plan_scenes(scene, tables));
  must(convert::write_nodes(scene, plan, tables, writer));
  CHECK(tables.scenes.size() == kCount);
  CHECK(tables.scenes.back().first_instance == kCount - 1);
  CHECK(tests::cpu_seconds() - start < 20);  // 0.1 s in a release build; 4e10 steps take longer anywhere
}
