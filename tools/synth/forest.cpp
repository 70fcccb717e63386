#include "tools/synth/forest.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "format/vec3.h"
#include "runtime/images/image.h"
#include "runtime/images/png_writer.h"
#include "runtime/threads/parallel.h"
#include "tools/common/jobs/stop_flag.h"
#include "tools/gltf/write/writer.h"
#include "tools/synth/gltf_parts.h"
#include "tools/synth/scene_functions.h"

namespace scree::synth {
namespace {

using namespace tools;

constexpr uint32_t kTrees = 12, kBushes = 4, kGrasses = 4;
constexpr uint32_t kPlants = kTrees + kBushes + kGrasses;
constexpr uint32_t kCards = 200;  // per plant
constexpr uint32_t kPlantCount = 50000;
constexpr double kArea = 12.0;  // square metres per plant
constexpr uint32_t kCells = 4;  // sprigs along a side of an atlas

constexpr uint32_t kStream = 77;  // of all random numbers

Vec3 direction(Random& chance) {
  const double z = chance.between(-1, 1), angle = chance.between(0, 2 * std::numbers::pi);
  const double side = std::sqrt(1 - z * z);
  return {side * std::cos(angle), z, side * std::sin(angle)};
}

double hills(double x, double z) {
  return 3.0 * std::sin(0.021 * x + 1) * std::cos(0.017 * z) + 0.8 * std::sin(0.09 * x) * std::sin(0.083 * z + 2);
}

/// A card that shows one sprig of the atlas: its stem begins at `foot`, follows `up` and is `size` long.
void add_card(Mesh& part, const Vec3& foot, const Vec3& up, const Vec3& side, double size, uint32_t sprig) {
  const auto first = static_cast<uint32_t>(part.vertex_count());
  const double u = (sprig % kCells) / double{kCells}, v = (sprig / kCells % kCells) / double{kCells};
  for (uint32_t corner = 0; corner < 4; ++corner) {
    const double across = (corner == 1 || corner == 2) ? 0.5 : -0.5, along = corner < 2 ? 0.0 : 1.0;
    Vec3 at;
    for (size_t i = 0; i < 3; ++i) at[i] = foot[i] + size * (across * side[i] + along * up[i]);
    part.add_vertex(at, u + (0.5 + across) / kCells, v + (1 - along) / kCells);
  }
  part.add_quad(first, first + 1, first + 2, first + 3);
}

/// Leaves of plant number `plant`, whose foot is at the origin.
Mesh make_leaves(uint32_t plant, uint32_t material) {
  Mesh part{.material = material};
  Random chance(1000 + plant, kStream);
  const bool is_tree = plant < kTrees, is_grass = plant >= kTrees + kBushes;
  const double height = is_tree ? chance.between(6, 14) : is_grass ? 0.7 : chance.between(1.2, 2.2);
  for (uint32_t card = 0; card < kCards; ++card) {
    const auto sprig = static_cast<uint32_t>(chance.next() * kCells * kCells);
    if (is_grass) {
      const double angle = chance.between(0, 2 * std::numbers::pi), away = 1.5 * std::sqrt(chance.next());
      const double turn = chance.between(0, std::numbers::pi);
      const Vec3 foot{away * std::cos(angle), -0.03, away * std::sin(angle)};
      const Vec3 lean = normalized({chance.between(-0.4, 0.4), 1, chance.between(-0.4, 0.4)});
      add_card(part, foot, lean, {std::cos(turn), 0, std::sin(turn)}, height * chance.between(0.6, 1.1), sprig);
      continue;
    }
    // In the outer half of an ellipsoid, stems outwards and a little down.
    const Vec3 out = direction(chance);
    const double reach = 0.5 + 0.5 * std::sqrt(chance.next());
    const double wide = is_tree ? 0.3 * height : 0.6 * height, high = is_tree ? 0.36 * height : 0.5 * height;
    const double middle = is_tree ? 0.64 * height : 0.45 * height;
    const Vec3 foot{wide * reach * out[0], middle + high * reach * out[1], wide * reach * out[2]};
    const Vec3 up = normalized({out[0], out[1] - 0.3, out[2]});
    const Vec3 side = normalized(cross(up, direction(chance)));
    add_card(part, foot, up, side, (is_tree ? 0.16 : 0.4) * height * chance.between(0.7, 1.2), sprig);
  }
  return part;
}

/// A trunk of 5 rings of 6 sides, a little crooked.
Mesh make_trunk(uint32_t plant, uint32_t material) {
  constexpr uint32_t kSides = 6, kRings = 5;
  Mesh part{.material = material};
  Random chance(1000 + plant, kStream);
  const double height = 0.8 * chance.between(6, 14);
  for (uint32_t ring = 0; ring <= kRings; ++ring) {
    const double t = static_cast<double>(ring) / kRings, radius = 0.022 * height * (1.3 - t);
    const double shift_x = 0.02 * height * t * chance.between(-1, 1),
                 shift_z = 0.02 * height * t * chance.between(-1, 1);
    for (uint32_t side = 0; side < kSides; ++side) {
      const double angle = 2 * std::numbers::pi * side / kSides;
      part.add_vertex({shift_x + radius * std::cos(angle), -0.2 + t * height, shift_z + radius * std::sin(angle)},
                      static_cast<double>(side) / kSides, t);
    }
  }
  for (uint32_t ring = 0; ring < kRings; ++ring) {
    for (uint32_t side = 0; side < kSides; ++side) {
      const uint32_t a = ring * kSides + side, b = ring * kSides + (side + 1) % kSides;
      part.add_quad(a, a + kSides, b + kSides, b);
    }
  }
  return part;
}

Mesh make_ground(double side, uint32_t material) {
  constexpr uint32_t kQuads = 160;
  Mesh part{.material = material};
  for (uint32_t j = 0; j <= kQuads; ++j)
    for (uint32_t i = 0; i <= kQuads; ++i) {
      const double x = side * (static_cast<double>(i) / kQuads - 0.5),
                   z = side * (static_cast<double>(j) / kQuads - 0.5);
      part.add_vertex({x, hills(x, z), z}, x, z);
    }
  part.add_grid(kQuads, kQuads, Mesh::Rows::kDown);
  return part;
}

/// A leaf of a sprig: an ellipse from `foot` along (dx, dy), in fractions of the cell.
struct Leaf {
  double x, y, dx, dy, length, width, tone;
};

/// Stems rise from the middle of the lower edge. Atlas 0 has broad leaves, atlas 1 blades.
std::vector<Leaf> make_sprig(uint32_t atlas, uint32_t sprig) {
  Random chance(500 + 37 * atlas + sprig, kStream);
  std::vector<Leaf> leaves;
  const uint32_t count = atlas == 0 ? 15 : 9;
  for (uint32_t i = 0; i < count; ++i) {
    if (atlas == 0) {
      const double t = (i + 1.0) / count, angle = (i % 2 == 0 ? 1 : -1) * chance.between(0.5, 1.3) * (1.1 - 0.8 * t);
      leaves.push_back({0.5 + 0.05 * std::sin(7 * t), 0.97 - 0.75 * t, std::sin(angle), -std::cos(angle),
                        chance.between(0.2, 0.32), chance.between(0.05, 0.09), chance.next()});
    } else {
      const double angle = chance.between(-0.35, 0.35);
      leaves.push_back({chance.between(0.3, 0.7), 0.99, std::sin(angle), -std::cos(angle), chance.between(0.5, 0.92),
                        chance.between(0.012, 0.024), chance.next()});
    }
  }
  return leaves;
}

/// RGBA. A leaf's edge is one texel wide, and transparent texels have a leaf's colour. Error kFile "interrupted".
Result<std::vector<uint8_t>> make_atlas(uint32_t atlas, const SynthOptions& options) {
  const uint32_t size = *options.texture_size;
  std::vector<std::vector<Leaf>> sprigs;
  for (uint32_t i = 0; i < kCells * kCells; ++i) sprigs.push_back(make_sprig(atlas, i));
  const uint32_t cell = size / kCells;
  std::vector<uint8_t> rgba(size_t{4} * size * size);
  runtime::parallel_for(size, thread_count(options.threads, size), [&](uint64_t y) {
    if (tools::is_stopped(options.stop)) return;
    for (uint32_t x = 0; x < size; ++x) {
      const std::vector<Leaf>& leaves = sprigs[y / cell * kCells + x / cell];
      const double px = (x % cell + 0.5) / cell, py = (static_cast<double>(y % cell) + 0.5) / cell;
      double alpha = 0, tone = 0.5, vein = 1;
      for (const Leaf& leaf : leaves) {
        const double along = (px - leaf.x) * leaf.dx + (py - leaf.y) * leaf.dy;
        const double aside = (px - leaf.x) * leaf.dy - (py - leaf.y) * leaf.dx;
        const double t = 2 * along / leaf.length - 1;
        if (t < -1.1 || t > 1.1) continue;
        const double edge = leaf.width * std::sqrt(std::max(0.0, 1 - t * t)) * (1 - 0.35 * t);
        const double inside = std::clamp((edge - std::abs(aside)) * cell + 0.5, 0.0, 1.0);
        if (inside < alpha) continue;
        alpha = inside;
        tone = leaf.tone;
        vein = 0.75 + 0.25 * std::min(1.0, std::abs(aside) / (0.15 * leaf.width));
      }
      const bool is_stem =
          atlas == 0 && std::abs(px - 0.5 - 0.05 * std::sin(7 * (0.97 - py) / 0.75)) < 0.008 && py > 0.2;
      if (is_stem) alpha = 1;
      const double light = (0.75 + 0.25 * unit24(hash2(9 + atlas, x / 3, static_cast<uint32_t>(y) / 3))) * vein;
      uint8_t* const out = &rgba[4 * (y * size + x)];
      out[0] = static_cast<uint8_t>((60 + 70 * tone) * light);
      out[1] = static_cast<uint8_t>((95 + 60 * tone) * light);
      out[2] = static_cast<uint8_t>((35 + 20 * tone) * light);
      out[3] = static_cast<uint8_t>(255 * alpha + 0.5);
    }
  });
  SCREE_TRY(tools::check_stop(options.stop));
  return rgba;
}

/// Materials 0 and 1: the atlases; 2 and 3: bark and ground.
Result<void> add_materials(GltfWriter& writer, const SynthOptions& options) {
  for (uint32_t atlas = 0; atlas < 2; ++atlas) {
    const uint32_t size = *options.texture_size;
    const std::vector<uint8_t> rgba = SCREE_TRY(make_atlas(atlas, options));
    const std::vector<std::byte> png = SCREE_TRY(runtime::encode_png({size, size, 4, rgba}, {.is_small = true}));
    GltfMaterial material{.name = atlas == 0 ? "leaves" : "blades"};
    const uint32_t image = SCREE_TRY(writer.add_image(material.name, format::ImageCodec::kPng, png));
    material.texture = writer.add_texture(trilinear(image, material.name, format::Wrap::kClamp));
    material.alpha = GltfAlpha::kMask;
    material.double_sided = true;
    writer.add_material(std::move(material));
  }
  for (const auto& [name, color] :
       {std::pair<const char*, Vec3>{"bark", {0.11, 0.08, 0.05}}, {"ground", {0.09, 0.08, 0.04}}}) {
    GltfMaterial material{.name = name};
    std::copy(color.begin(), color.end(), material.base_color);
    writer.add_material(std::move(material));
  }
  return {};
}

std::vector<Placement> scatter(uint32_t count, double side, uint32_t seed) {
  const auto across = static_cast<uint32_t>(std::ceil(std::sqrt(count)));
  std::vector<Placement> placements;
  for (uint32_t i = 0; i < count; ++i) {
    Random chance(hash2(seed, i, 5), kStream);
    const double cell = side / across;
    const double x = (i % across + chance.next()) * cell - side / 2, z = (i / across + chance.next()) * cell - side / 2;
    const double kind = chance.next();
    const double part = chance.next();
    Placement placement;
    if (i < kPlants) {
      placement.mesh = i;  // so that each mesh is placed at least once
    } else if (kind < 0.25) {
      placement.mesh = static_cast<uint32_t>(part * kTrees);
    } else if (kind < 0.5) {
      placement.mesh = kTrees + static_cast<uint32_t>(part * kBushes);
    } else {
      placement.mesh = kTrees + kBushes + static_cast<uint32_t>(part * kGrasses);
    }
    const double turn = chance.between(0, std::numbers::pi), size = chance.between(0.7, 1.3);
    placement.translation = {x, hills(x, z), z};
    placement.rotation = {0, std::sin(turn), 0, std::cos(turn)};
    placement.scale = {size, size, size};
    placements.push_back(placement);
  }
  return placements;
}

uint32_t add_view(GltfWriter& writer, const char* name, const Vec3& eye, const Vec3& target) {
  return add_camera(writer, {.name = name, .y = std::numbers::pi / 3, .x = 16.0 / 9.0}, eye, target);
}

}  // namespace

Result<SynthReport> write_forest(const SynthOptions& options) {
  GltfWriter writer = SCREE_TRY(GltfWriter::create(options.output, {}, options.existing));
  writer.stop_on(options.stop);
  SCREE_TRY(add_materials(writer, options));

  const uint32_t count = std::max(kPlants, static_cast<uint32_t>(std::lround(kPlantCount * options.scale)));
  const double side = std::sqrt(count * kArea);
  SynthReport report;
  std::vector<uint64_t> triangles;
  const auto add_mesh = [&](const std::string& name, const std::vector<Mesh>& parts) -> Result<void> {
    GltfMesh mesh{.name = name};
    triangles.push_back(0);
    for (const Mesh& part : parts) {
      mesh.primitives.push_back(SCREE_TRY(append_primitive(writer, part)));
      report.vertices += part.vertex_count();
      triangles.back() += part.indices.size() / 3;
    }
    report.unique_triangles += triangles.back();
    writer.add_mesh(std::move(mesh));
    return {};
  };
  for (uint32_t plant = 0; plant < kPlants; ++plant) {
    const bool is_tree = plant < kTrees;
    std::vector<Mesh> parts{make_leaves(plant, plant < kTrees + kBushes ? 0 : 1)};
    if (is_tree) parts.push_back(make_trunk(plant, 2));
    const char* const kind = is_tree ? "tree " : plant < kTrees + kBushes ? "bush " : "grass ";
    SCREE_TRY(add_mesh(kind + std::to_string(plant), parts));
  }
  SCREE_TRY(add_mesh("ground", {make_ground(side + 20, 3)}));

  const std::vector<Placement> placements = scatter(count, side, options.seed);
  std::vector<uint32_t> children;
  children.push_back(writer.add_node({.name = "ground", .mesh = kPlants}));
  report.drawn_triangles = triangles[kPlants];
  for (const Placement& placement : placements) report.drawn_triangles += triangles[placement.mesh];
  report.instances = placements.size() + 1;
  if (options.gpu_instancing) {
    SCREE_TRY(add_instanced_nodes(writer, placements, children));
  } else {
    for (const Placement& placement : placements) children.push_back(writer.add_node(node_of(placement, "plant")));
  }
  const double edge = side / 2;
  children.push_back(add_view(writer, "overview", {0, 0.3 * edge + 12, 1.1 * edge}, {0, 0, 0}));
  children.push_back(add_view(writer, "within", {0, hills(0, 0) + 1.7, 0}, {10, hills(10, -30) + 3, -30}));
  children.push_back(
      add_view(writer, "clearing", {0.4 * edge, hills(0.4 * edge, 0) + 9, 0}, {-0.2 * edge, 2, -0.3 * edge}));
  writer.add_scene({"forest", {writer.add_node({.name = "forest", .children = std::move(children)})}});
  SCREE_TRY(writer.finish());
  report.file_bytes = writer.total_bytes();
  return report;
}

}  // namespace scree::synth
