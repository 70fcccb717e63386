#include "tools/synth/zorah_plan.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numeric>

#include "format/layout.h"
#include "tools/synth/scene_functions.h"

namespace scree::synth {
namespace {

using format::kNone;

/// Counts of the files. Source: an audit of them, and NVIDIA's page of scenes (vk_lod_clusters), 2026.
namespace main_file {
constexpr uint64_t kUnique = 1627207159, kDrawn = 18937042387, kVertices = 1013678594;
constexpr uint64_t kLargestTriangles = 32054609, kLargestVertices = 16005261;
constexpr uint64_t kFloor = 19461216;
constexpr uint32_t kFloors = 365, kMountains = 50;
constexpr uint32_t kMeshes = 2068, kPrimitives = 3163, kNodes = 16988, kDrawnPrimitives = 19144;
constexpr uint32_t kMaterials = 3283, kUsedMaterials = 2882;
}  // namespace main_file

namespace textured_file {
constexpr uint64_t kNamed = 3310614344, kUnique = 1630979739, kDrawn = 18930392835;
constexpr uint32_t kMeshes = 2812, kGroups = 5408, kPrimitives = 7277, kDrawnMeshes = 16118, kDrawnPrimitives = 43068;
constexpr uint32_t kNodes = 13079, kParents = 3736, kInstancingNodes = 1092;
constexpr uint32_t kBuffers = 2034, kKites = 52;
constexpr uint32_t kWithoutUvs = 40, kWithTangents = 1713;
constexpr uint32_t kMaterials = 1514, kMasks = 110, kDoubleSided = 157, kSpecular = 1388, kTransforms = 501;
constexpr uint32_t kColors = 1583, kSurfaces = 1375, kNormals = 1399, kSpeculars = 61;
constexpr uint32_t kPngImages = 4069, kTileImages = 3420;
// Numbers of textures by size. They are chosen so that levels up to 512, 1024 and 2048 texels, and all levels, take
// 1.36, 5.41, 21.5 and 85.0 GiB.
constexpr uint32_t k8192 = 40, k512 = 30, k1024 = 28, k2048 = 225, k4096x2048 = 404, k4096x4200 = 12;
}  // namespace textured_file

/// Vertices per triangle of all primitives except the largest.
constexpr double kVertexShare = static_cast<double>(main_file::kVertices - main_file::kLargestVertices) /
                                static_cast<double>(main_file::kUnique - main_file::kLargestTriangles);

/// The numbers below `count` in pseudo-random order.
std::vector<uint32_t> shuffled(uint32_t count, uint32_t seed) {
  std::vector<uint32_t> order(count);
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) {
    const uint32_t first = hash2(seed, a, 0), second = hash2(seed, b, 0);
    return first != second ? first < second : a < b;
  });
  return order;
}

/// Few large weights and many small ones in pseudo-random order: (from / (k + from))^power.
std::vector<double> weights(uint32_t count, uint32_t seed, double from, double power) {
  const std::vector<uint32_t> rank = shuffled(count, seed);
  std::vector<double> out(count);
  for (uint32_t i = 0; i < count; ++i) out[i] = std::pow(from / (rank[i] + from), power);
  return out;
}

/// Divides `total` into whole shares: `least` each, and the rest in proportion to the weights.
std::vector<uint64_t> shares(uint64_t total, const std::vector<double>& weight, uint64_t least) {
  assert(total >= least * weight.size());
  const double sum = std::accumulate(weight.begin(), weight.end(), 0.0);
  const auto rest = static_cast<double>(total - least * weight.size());
  std::vector<uint64_t> out;
  double reached = 0;
  uint64_t given = 0;
  for (const double w : weight) {  // the borders between shares are rounded, so the sum stays exact
    reached += w;
    const auto end = static_cast<uint64_t>(std::llround(rest * std::min(reached / sum, 1.0)));
    out.push_back(least + end - given);
    given = end;
  }
  out.back() += total - least * weight.size() - given;
  return out;
}

/// Approximate triangles of the two groups that make the sums exact.
constexpr uint64_t kLeft = 300000;

/// A group whose size is to be chosen.
struct Sized {
  uint64_t* triangles;
  uint64_t draws;  // draws of its primitive
  double weight;
};

/// Chooses sizes in proportion to the weights, with the sum `unique`, and the sum `drawn` over all draws. Groups with
/// three draws or more have one factor, all others another one. The first group with one draw and the first with two
/// take the remainders of rounding.
void choose_sizes(std::vector<Sized> groups, uint64_t unique, uint64_t drawn) {
  const auto take = [&](uint64_t draws) {
    const auto found =
        std::find_if(groups.begin(), groups.end(), [&](const Sized& group) { return group.draws == draws; });
    assert(found != groups.end());
    uint64_t* const triangles = found->triangles;
    groups.erase(found);
    return triangles;
  };
  uint64_t* const once = take(1);
  uint64_t* const twice = take(2);
  double sum[2] = {0, 0}, drawn_sum[2] = {0, 0};
  for (const Sized& group : groups) {
    sum[group.draws >= 3] += group.weight;
    drawn_sum[group.draws >= 3] += group.weight * static_cast<double>(group.draws);
  }
  const double wanted = static_cast<double>(unique - 2 * kLeft), wanted_drawn = static_cast<double>(drawn - 3 * kLeft);
  const double determinant = sum[0] * drawn_sum[1] - sum[1] * drawn_sum[0];
  const double factor[2] = {(wanted * drawn_sum[1] - sum[1] * wanted_drawn) / determinant,
                            (sum[0] * wanted_drawn - wanted * drawn_sum[0]) / determinant};
  for (const Sized& group : groups) {
    *group.triangles = static_cast<uint64_t>(std::llround(group.weight * factor[group.draws >= 3]));
    unique -= *group.triangles;
    drawn -= *group.triangles * group.draws;
  }
  *twice = drawn - unique;
  *once = unique - *twice;
}

uint64_t scaled(uint64_t count, double scale, uint64_t least) {
  return std::max(least, static_cast<uint64_t>(std::llround(static_cast<double>(count) * scale)));
}

void scale_groups(ZorahPlan& plan, double scale) {
  for (ZorahGroup& group : plan.groups) {
    group.triangles = scaled(group.triangles, scale, 2);
    group.vertices = scaled(group.vertices, scale, 4);
  }
}

ZorahKind kind_of(uint32_t mesh) {
  constexpr ZorahKind kKinds[8] = {ZorahKind::kFloor, ZorahKind::kWall, ZorahKind::kColumn, ZorahKind::kProp,
                                   ZorahKind::kProp,  ZorahKind::kProp, ZorahKind::kProp,   ZorahKind::kProp};
  return kKinds[hash2(9101u, mesh, 0) & 7u];
}

ZorahMaterial plain_material() {
  return {.color = kNone, .surface = kNone, .normals = kNone, .specular_texture = kNone, .emission = kNone};
}

}  // namespace

uint64_t ZorahPlan::unique_triangles() const {
  uint64_t sum = 0;
  for (const ZorahGroup& group : groups) sum += group.triangles;
  return sum;
}

uint64_t ZorahPlan::vertices() const {
  uint64_t sum = 0;
  for (const ZorahGroup& group : groups) sum += group.vertices;
  return sum;
}

uint64_t ZorahPlan::primitives() const {
  uint64_t sum = 0;
  for (const ZorahMesh& mesh : meshes) sum += mesh.materials.size();
  return sum;
}

uint64_t ZorahPlan::drawn_meshes() const {
  uint64_t sum = 0;
  for (const ZorahMesh& mesh : meshes) sum += mesh.nodes + mesh.instances;
  return sum;
}

uint64_t ZorahPlan::drawn_triangles() const {
  uint64_t sum = 0;
  for (const ZorahMesh& mesh : meshes)
    for (size_t i = 0; i < mesh.materials.size(); ++i)
      sum += groups[mesh.first_group + i].triangles * (mesh.nodes + mesh.instances);
  return sum;
}

ZorahPlan zorah_plan(double scale) {
  using namespace main_file;
  ZorahPlan plan{.name = "zorah",
                 .camera = {"view", {55.34291, 6.4527273, 0.32432523}, {46.38051, 5.7994967, 0.5308178}}};

  // Meshes by class: 5 mountains, the floor, 548 meshes with several primitives (547 with three, one with two); the
  // others have one.
  constexpr uint32_t kMountainMeshes = 5, kSeveral = 548;
  constexpr uint64_t kMountainTriangles[kMountainMeshes] = {kLargestTriangles, 12000000, 9000000, 7000000, 5000000};
  plan.meshes.resize(kMeshes);
  std::vector<uint64_t> sizes(kPrimitives);
  std::vector<Sized> sized;
  uint64_t unique = kUnique, drawn = kDrawn, single_nodes = kNodes - kFloors - kMountains;
  const std::vector<double> weight = weights(kPrimitives, 9201u, 80, 1.8);
  uint32_t group = 0;
  std::vector<ZorahMesh*> singles;
  for (uint32_t m = 0; m < kMeshes; ++m) {
    ZorahMesh& mesh = plan.meshes[m];
    mesh.first_group = group;
    const uint32_t several = m - kMountainMeshes - 1;
    const bool is_fixed = m <= kMountainMeshes, has_several = !is_fixed && several < kSeveral;
    const uint32_t primitives = !has_several ? 1 : several == 0 ? 2 : 3;
    mesh.materials.resize(primitives);
    mesh.kind = m < kMountainMeshes ? ZorahKind::kMountain : m == kMountainMeshes ? ZorahKind::kFloor : kind_of(m);
    if (is_fixed) {
      mesh.nodes = m < kMountainMeshes ? kMountains / kMountainMeshes : kFloors;
      sizes[group] = m < kMountainMeshes ? kMountainTriangles[m] : kFloor;
      unique -= sizes[group];
      drawn -= sizes[group] * mesh.nodes;
    } else if (has_several) {  // drawn primitives exceed nodes by 2 * 2 * 530 + 2 * 17 + 2
      mesh.nodes = several < kSeveral - 17 ? 2 : 1;
      single_nodes -= mesh.nodes;
    } else {
      singles.push_back(&mesh);
    }
    group += primitives;
  }
  // choose_sizes() needs a mesh that is drawn once and one that is drawn twice.
  const auto others = static_cast<uint32_t>(singles.size());
  const std::vector<uint64_t> nodes = shares(single_nodes, weights(others, 9202u, 20, 1.3), 1);
  for (uint32_t i = 0; i < others; ++i) singles[i]->nodes = static_cast<uint32_t>(nodes[i]);
  for (const ZorahMesh& mesh : plan.meshes)
    for (uint32_t i = 0; i < mesh.materials.size(); ++i)
      if (const uint32_t g = mesh.first_group + i; sizes[g] == 0) sized.push_back({&sizes[g], mesh.nodes, weight[g]});
  choose_sizes(std::move(sized), unique, drawn);

  std::vector<double> by_size(sizes.begin() + 1, sizes.end());
  const std::vector<uint64_t> vertices = shares(kVertices - kLargestVertices, by_size, 0);
  for (uint32_t g = 0; g < kPrimitives; ++g)
    plan.groups.push_back({sizes[g], g == 0 ? kLargestVertices : vertices[g - 1], 0, false, false, false});

  // About one in eight of the declared materials is not used. All used ones have an alpha of 1.
  plan.materials.resize(kMaterials, plain_material());
  for (uint32_t i = 0; i < kMaterials; ++i) {
    const uint32_t hash = hash2(9203u, i, 0) % 16;
    plan.materials[i].alpha = hash == 0   ? ZorahMaterial::Alpha::kMask
                              : hash == 1 ? ZorahMaterial::Alpha::kBlend
                                          : ZorahMaterial::Alpha::kOpaque;
  }
  uint32_t primitive = 0;
  for (ZorahMesh& mesh : plan.meshes)
    for (uint32_t& material : mesh.materials) {
      const uint64_t used = primitive < kUsedMaterials ? primitive : hash2(9204u, primitive, 0) % kUsedMaterials;
      material = static_cast<uint32_t>(used * kMaterials / kUsedMaterials);
      ++primitive;
    }
  scale_groups(plan, scale);
  return plan;
}

namespace {

void plan_textures(ZorahPlan& plan, double scale) {
  using namespace textured_file;
  constexpr uint32_t kTextures = kColors + kSurfaces + kNormals + kSpeculars, kWide = kTextures - kSpeculars;
  plan.png_images = kPngImages;
  plan.tile_images = kTileImages;
  const std::vector<uint32_t> rank = shuffled(kWide, 9301u);
  const auto side = [&](uint32_t texels) {  // whole blocks
    return std::max(4u, 4 * static_cast<uint32_t>(std::lround(texels / 4 * std::sqrt(scale))));
  };
  for (uint32_t i = 0; i < kTextures; ++i) {
    BlockTexture texture{.picture = i < kColors               ? BlockPicture::kColor
                                    : i < kColors + kSurfaces ? BlockPicture::kSurface
                                    : i < kWide               ? BlockPicture::kNormals
                                                              : BlockPicture::kSpecular,
                         .seed = i};
    uint32_t width = 4096, height = 4096, below = i < kWide ? rank[i] : kTextures;
    const auto is_next = [&](uint32_t count) {
      const bool is = below < count;
      below = is ? kTextures : below - count;
      return is;
    };
    if (is_next(k8192)) width = height = 8192;
    if (is_next(k512)) width = height = 512;
    if (is_next(k1024)) width = height = 1024;
    if (is_next(k2048)) width = height = 2048;
    if (is_next(k4096x2048)) height = 2048;
    if (is_next(k4096x4200)) height = 4200;
    texture.width = side(width);
    texture.height = side(height);
    plan.textures.push_back(texture);
  }
}

void plan_materials(ZorahPlan& plan) {
  using namespace textured_file;
  const std::vector<uint32_t> masks = shuffled(kMaterials, 9302u), sides = shuffled(kMaterials, 9303u),
                              surfaces = shuffled(kMaterials, 9304u), normals = shuffled(kMaterials, 9305u),
                              speculars = shuffled(kMaterials, 9306u), emissions = shuffled(kMaterials, 9307u);
  uint32_t transforms = kTransforms / 3;  // materials with three textures each
  for (uint32_t m = 0; m < kMaterials; ++m) {
    ZorahMaterial material = plain_material();
    material.alpha = masks[m] < kMasks    ? ZorahMaterial::Alpha::kMask
                     : masks[m] == kMasks ? ZorahMaterial::Alpha::kBlend
                                          : ZorahMaterial::Alpha::kOpaque;
    material.double_sided = sides[m] < kDoubleSided;
    material.transmission = sides[m] == kMaterials - 1;
    material.unlit = surfaces[m] == kMaterials - 1;
    material.specular = speculars[m] < kSpecular;
    material.color = m;
    if (material.alpha == ZorahMaterial::Alpha::kMask) plan.textures[m].picture = BlockPicture::kCutout;
    if (emissions[m] < kColors - kMaterials) material.emission = kMaterials + emissions[m];
    if (surfaces[m] < kSurfaces) material.surface = kColors + surfaces[m];
    if (normals[m] < kNormals) material.normals = kColors + kSurfaces + normals[m];
    if (speculars[m] < kSpeculars) material.specular_texture = kColors + kSurfaces + kNormals + speculars[m];
    if (transforms != 0 && material.surface != kNone && material.normals != kNone && material.emission == kNone &&
        material.specular_texture == kNone) {
      material.transform = true;
      --transforms;
    }
    plan.materials.push_back(material);
  }
}

}  // namespace

ZorahPlan zorah_textured_plan(double scale) {
  using namespace textured_file;
  ZorahPlan plan{.name = "zorah-textured",
                 .parents = kParents,
                 .camera = {"view", {7.729439, 2.278318, -11.146186}, {-0.484482, 4.163491, -8.020232}}};

  // There are 2,812 meshes: 1,653 with three primitives, the others with two. 623 of the meshes with three are variants
  // of others with different materials: 88 meshes have seven variants, one has six, one has one.
  constexpr uint32_t kThree = kPrimitives - 2 * kMeshes, kVariants = (kPrimitives - kGroups) / 3;
  constexpr uint32_t kShared = 90, kSharedGroups = 3 * kShared;
  constexpr uint32_t kUniqueMeshes = kMeshes - kVariants, kUniqueThree = kThree - kVariants;
  const auto variants = [](uint32_t base) { return base < kShared - 2 ? 7u : base == kShared - 2 ? 6u : 1u; };
  plan.meshes.resize(kMeshes);
  uint32_t group = 0, variant = kUniqueMeshes;
  for (uint32_t m = 0; m < kUniqueMeshes; ++m) {
    ZorahMesh& mesh = plan.meshes[m];
    mesh.first_group = group;
    mesh.materials.resize(m < kUniqueThree ? 3 : 2);
    mesh.kind = m + 2 >= kUniqueMeshes ? ZorahKind::kKite : kind_of(m);
    for (uint32_t i = 0; m < kShared && i < variants(m); ++i) plan.meshes[variant++] = mesh;
    const auto buffer = static_cast<uint32_t>(uint64_t{m} * kBuffers / kUniqueMeshes);
    for (size_t i = 0; i < mesh.materials.size(); ++i, ++group)
      plan.groups.push_back({0, 0, buffer, true, true, false});
  }
  plan.buffers = kBuffers;

  // The number of draws of each mesh. Meshes with three primitives are drawn 10,832 times in all; meshes that share
  // their geometry with variants are drawn six times each.
  constexpr uint32_t kDrawnThree = kDrawnPrimitives - 2 * kDrawnMeshes, kSharedMeshes = kShared + kVariants;
  constexpr uint32_t kSharedDraws = 6;
  const std::vector<uint64_t> three =
      shares(kDrawnThree - kSharedDraws * kSharedMeshes, weights(kThree - kSharedMeshes, 9401u, 25, 1.2), 1);
  const std::vector<uint64_t> two =
      shares(kDrawnMeshes - kDrawnThree - kKites, weights(kMeshes - kThree - 2, 9402u, 25, 1.2), 1);
  size_t next_three = 0, next_two = 0;
  for (ZorahMesh& mesh : plan.meshes)
    mesh.nodes = static_cast<uint32_t>(mesh.kind == ZorahKind::kKite      ? kKites / 2
                                       : mesh.first_group < kSharedGroups ? kSharedDraws
                                       : mesh.materials.size() == 3       ? three[next_three++]
                                                                          : two[next_two++]);

  // Sizes: first of geometry that variants share, so that the sum over meshes is right, then of the rest.
  std::vector<uint64_t> sizes(kGroups);
  const std::vector<double> weight = weights(kGroups, 9403u, 80, 1.6);
  // The mesh of the last shared group has one variant, so this group takes the remainder of rounding.
  constexpr uint32_t kLast = kSharedGroups - 1;
  uint64_t repeated = kNamed - kUnique;
  double sum = 0;
  for (uint32_t g = 0; g < kLast; ++g) sum += weight[g] * variants(g / 3);
  const double factor = static_cast<double>(repeated - kLeft) / sum;
  for (uint32_t g = 0; g < kLast; ++g) {
    sizes[g] = static_cast<uint64_t>(std::llround(weight[g] * factor));
    repeated -= sizes[g] * variants(g / 3);
  }
  sizes[kLast] = repeated;
  uint64_t unique = kUnique, drawn = kDrawn;
  for (uint32_t g = 0; g < kSharedGroups; ++g) unique -= sizes[g];
  std::vector<Sized> sized;
  for (const ZorahMesh& mesh : plan.meshes)
    for (uint32_t i = 0; i < mesh.materials.size(); ++i) {
      const uint32_t g = mesh.first_group + i;
      if (g < kSharedGroups)
        drawn -= sizes[g] * mesh.nodes;
      else
        sized.push_back({&sizes[g], mesh.nodes, weight[g]});
    }
  choose_sizes(std::move(sized), unique, drawn);
  uint32_t tangents = kWithTangents, bare = kWithoutUvs;
  for (uint32_t g = 0; g < kGroups; ++g) {
    plan.groups[g].triangles = sizes[g];
    plan.groups[g].vertices = static_cast<uint64_t>(std::llround(static_cast<double>(sizes[g]) * kVertexShare));
    if (g < kSharedGroups) continue;  // from here on, each primitive has its own group
    if (bare != 0 && g % 100 == 0) {
      plan.groups[g].uvs = false;
      plan.groups[g].normals = bare != 1;
      --bare;
    } else if (tangents != 0 && g % 3 != 0) {
      plan.groups[g].tangents = true;
      --tangents;
    }
  }

  // The 1,092 meshes that are drawn most have a node with instances beside their plain nodes.
  constexpr uint32_t kPlainNodes = kNodes - kParents - kInstancingNodes;
  std::vector<uint32_t> order(kMeshes);
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(),
                   [&](uint32_t a, uint32_t b) { return plan.meshes[a].nodes > plan.meshes[b].nodes; });
  std::vector<double> draws;
  for (uint32_t i = 0; i < kInstancingNodes; ++i) draws.push_back(plan.meshes[order[i]].nodes);
  const std::vector<uint64_t> instances = shares(kDrawnMeshes - kPlainNodes, draws, 0);
  for (uint32_t i = 0; i < kInstancingNodes; ++i) {
    ZorahMesh& mesh = plan.meshes[order[i]];
    mesh.instances = static_cast<uint32_t>(instances[i]);
    mesh.nodes -= mesh.instances;
  }

  uint32_t primitive = 0;
  for (ZorahMesh& mesh : plan.meshes)
    for (uint32_t& material : mesh.materials) {
      material = primitive < kMaterials ? primitive : hash2(9404u, primitive, 0) % kMaterials;
      ++primitive;
    }
  plan_textures(plan, scale);
  plan_materials(plan);
  scale_groups(plan, scale);
  return plan;
}

}  // namespace scree::synth
