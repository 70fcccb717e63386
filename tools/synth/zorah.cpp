#include "tools/synth/zorah.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "format/text.h"
#include "tools/common/jobs/ordered_pool.h"
#include "tools/common/output/progress.h"
#include "tools/gltf/box.h"
#include "tools/gltf/write/writer.h"
#include "tools/synth/gltf_parts.h"
#include "tools/synth/sheet.h"

namespace scree::synth {
namespace {

using namespace tools;
using format::kNone;

constexpr uint64_t kInFlightBytes = uint64_t{1} << 30;

// ---- Streams of meshopt ----

using Bytes = std::vector<std::byte>;

/// Runs encode(out, capacity), which returns the number of bytes it wrote. Unused memory of the capacity is never
/// touched.
template <class Encode>
Bytes encode_into(size_t capacity, const Encode& encode) {
  const auto space = std::make_unique_for_overwrite<unsigned char[]>(capacity);
  const size_t bytes = encode(space.get(), capacity);
  const auto* const first = reinterpret_cast<const std::byte*>(space.get());
  return {first, first + bytes};
}

Bytes encode_vertices(const std::vector<float>& values, uint32_t width) {
  const size_t stride = width * sizeof(float), count = values.size() / width;
  return encode_into(meshopt_encodeVertexBufferBound(count, stride), [&](unsigned char* out, size_t capacity) {
    return meshopt_encodeVertexBuffer(out, capacity, values.data(), count, stride);
  });
}

Bytes encode_triangles(const std::vector<uint32_t>& indices, uint64_t vertices) {
  return encode_into(meshopt_encodeIndexBufferBound(indices.size(), vertices),
                     [&](unsigned char* out, size_t capacity) {
                       return meshopt_encodeIndexBuffer(out, capacity, indices.data(), indices.size());
                     });
}

// ---- Groups of accessors ----

enum class Stream : uint8_t { kPositions, kNormals, kUvs, kTangents, kIndices };
constexpr const char* kSemantics[] = {"POSITION", "NORMAL", "TEXCOORD_0", "TANGENT"};

struct StreamJob {
  uint32_t group;
  Stream stream;
};

std::vector<StreamJob> stream_jobs(const ZorahPlan& plan) {
  std::vector<StreamJob> jobs;
  for (uint32_t g = 0; g < plan.groups.size(); ++g) {
    const ZorahGroup& group = plan.groups[g];
    jobs.push_back({g, Stream::kPositions});
    if (group.normals) jobs.push_back({g, Stream::kNormals});
    if (group.uvs) jobs.push_back({g, Stream::kUvs});
    if (group.tangents) jobs.push_back({g, Stream::kTangents});
    jobs.push_back({g, Stream::kIndices});
  }
  return jobs;
}

uint64_t unpacked_bytes(const ZorahGroup& group, Stream stream) {
  if (stream == Stream::kIndices) return group.triangles * 12;
  return group.vertices * 4 * stream_width(static_cast<SheetStream>(stream));
}

struct Encoded {
  Bytes bytes;
  convert::Box box;  // of positions
};

SheetShape shape_of(uint32_t group, ZorahKind kind) {
  const uint32_t hash = hash2(9501u, group, 0);
  SheetShape shape{.seed = 60000u + 131u * group, .frequency = 2.0 + hash % 4u};
  switch (kind) {
    case ZorahKind::kFloor:
    case ZorahKind::kWall:
      shape.round8 = hash >> 2 & 1u;
      shape.amplitude = 0.04;
      break;
    case ZorahKind::kColumn:
      shape.round8 = 4 + (hash >> 2) % 5u;
      shape.amplitude = 0.06;
      break;
    case ZorahKind::kMountain:
      shape.round8 = 8;
      shape.octaves = 8;
      shape.amplitude = 0.35;
      break;
    default:
      shape.round8 = 2 + (hash >> 2) % 7u;
      shape.amplitude = 0.08 + 0.12 * unit24(hash);
  }
  return shape;
}

Encoded encode(const ZorahGroup& group, const SheetShape& shape, Stream stream) {
  const SheetGrid grid(group.triangles, group.vertices);
  Encoded out;
  if (stream == Stream::kIndices) {
    out.bytes = encode_triangles(make_indices(grid), group.vertices);
    return out;
  }
  const auto kind = static_cast<SheetStream>(stream);
  const std::vector<float> values = make_stream(grid, shape, kind);
  if (stream == Stream::kPositions) out.box = convert::box_of(values);
  out.bytes = encode_vertices(values, stream_width(kind));
  return out;
}

/// The accessors of a group.
struct GroupAccessors {
  std::vector<std::pair<std::string, uint32_t>> attributes;
  uint32_t indices = kNone;
};

Result<uint32_t> add_encoded(GltfWriter& writer, const ZorahGroup& group, Stream stream, const Encoded& encoded) {
  const uint64_t offset = SCREE_TRY(writer.append(encoded.bytes));
  const bool is_indices = stream == Stream::kIndices;
  GltfAccessor accessor{.count = is_indices ? group.triangles * 3 : group.vertices};
  constexpr GltfType kTypes[] = {GltfType::kVec3, GltfType::kVec3, GltfType::kVec2, GltfType::kVec4, GltfType::kScalar};
  accessor.type = kTypes[static_cast<size_t>(stream)];
  if (is_indices) accessor.component = GltfComponent::kUint32;
  if (stream == Stream::kPositions) {
    accessor.min.assign(encoded.box.lo.begin(), encoded.box.lo.end());
    accessor.max.assign(encoded.box.hi.begin(), encoded.box.hi.end());
  }
  GltfBufferView view;
  view.bytes = unpacked_bytes(group, stream);
  view.target = is_indices ? GltfTarget::kIndices : GltfTarget::kVertices;
  view.meshopt = GltfMeshopt{offset, encoded.bytes.size(),
                             is_indices ? GltfMeshopt::Mode::kTriangles : GltfMeshopt::Mode::kAttributes,
                             accessor.count, static_cast<uint32_t>(view.bytes / accessor.count)};
  accessor.buffer_view = writer.add_buffer_view(view);
  return writer.add_accessor(std::move(accessor));
}

/// By group: the kind of its mesh.
std::vector<ZorahKind> kinds_of_groups(const ZorahPlan& plan) {
  std::vector<ZorahKind> kinds(plan.groups.size());
  for (const ZorahMesh& mesh : plan.meshes)
    std::fill_n(kinds.begin() + mesh.first_group, mesh.materials.size(), mesh.kind);
  return kinds;
}

/// The data that the two stages of work share.
struct Stage {
  Progress& progress;
  convert::WorkerPool& pool;
};

Result<std::vector<GroupAccessors>> write_groups(GltfWriter& writer, const ZorahPlan& plan, Stage stage) {
  const std::vector<StreamJob> jobs = stream_jobs(plan);
  const std::vector<ZorahKind> kinds = kinds_of_groups(plan);
  std::vector<GroupAccessors> accessors(plan.groups.size());
  uint64_t triangles = 0, bytes = 0;
  uint32_t buffer = UINT32_MAX;
  stage.progress.stage("synth " + plan.name, plan.unique_triangles());
  const auto work = [&](uint64_t i, uint32_t) -> Result<Encoded> {
    const StreamJob& job = jobs[i];
    return encode(plan.groups[job.group], shape_of(job.group, kinds[job.group]), job.stream);
  };
  // Memory of the values and of their packed form, which is usually smaller.
  const auto cost = [&](uint64_t i) { return 2 * unpacked_bytes(plan.groups[jobs[i].group], jobs[i].stream); };
  const auto take = [&](uint64_t i, const Encoded& encoded) -> Result<void> {
    const ZorahGroup& group = plan.groups[jobs[i].group];
    // A scene with a single buffer already has it open.
    if (plan.buffers > 1 && group.buffer != buffer) {
      buffer = group.buffer;
      SCREE_TRY(writer.next_buffer("geometry" + std::to_string(buffer)));
    }
    const uint32_t added = SCREE_TRY(add_encoded(writer, group, jobs[i].stream, encoded));
    bytes += encoded.bytes.size();
    GroupAccessors& of_group = accessors[jobs[i].group];
    if (jobs[i].stream != Stream::kIndices) {
      of_group.attributes.emplace_back(kSemantics[static_cast<size_t>(jobs[i].stream)], added);
      return {};
    }
    of_group.indices = added;
    triangles += group.triangles;
    stage.progress.update(triangles, bytes);
    return {};
  };
  SCREE_TRY(convert::run_ordered<Encoded>(stage.pool, jobs.size(), {4ull * stage.pool.threads(), kInFlightBytes}, work,
                                          cost, take));
  return accessors;
}

// ---- Textures and materials ----

std::string texture_name(const ZorahPlan& plan, uint32_t number) {
  constexpr const char* kParts[] = {"BaseColor", "BaseColor", "ORM", "Normal", "Specular"};
  const std::string part = kParts[static_cast<size_t>(plan.textures[number].picture)];
  // Every name stands for one file; numbers in the form of UDIM tiles have no meaning.
  return "T_" + std::to_string(number) + "_" + part + (number < plan.tile_images ? ".1001" : "");
}

Result<void> write_textures(GltfWriter& writer, const ZorahPlan& plan, Stage stage) {
  if (plan.textures.empty()) return {};
  stage.progress.stage("synth textures of " + plan.name, plan.textures.size(), "textures");
  uint64_t bytes = 0;
  const auto work = [&](uint64_t i, uint32_t) { return make_block_file(plan.textures[i]); };
  const auto cost = [&](uint64_t i) { return 2 * block_bytes_of(plan.textures[i]); };
  const auto take = [&](uint64_t i, const Bytes& file) -> Result<void> {
    const auto number = static_cast<uint32_t>(i);
    const uint32_t image = SCREE_TRY(writer.add_image(texture_name(plan, number), format::ImageCodec::kBlocks, file,
                                                      number < plan.png_images ? "image/png" : "image/ktx2"));
    writer.add_texture(trilinear(image));
    bytes += file.size();
    stage.progress.update(i + 1, bytes);
    return {};
  };
  return convert::run_ordered<Bytes>(stage.pool, plan.textures.size(), {4ull * stage.pool.threads(), kInFlightBytes},
                                     work, cost, take);
}

void add_material(GltfWriter& writer, const ZorahMaterial& plan, uint32_t number) {
  GltfMaterial material;
  material.name = "material" + std::to_string(number);
  material.alpha = plan.alpha == ZorahMaterial::Alpha::kMask    ? GltfAlpha::kMask
                   : plan.alpha == ZorahMaterial::Alpha::kBlend ? GltfAlpha::kBlend
                                                                : GltfAlpha::kOpaque;
  material.double_sided = plan.double_sided;
  material.unlit = plan.unlit;
  material.transmission = plan.transmission ? 1 : 0;
  material.texture = plan.color;
  if (plan.color == kNone)
    for (uint32_t c = 0; c < 3; ++c) material.base_color[c] = 0.1 + 0.6 * unit24(hash2(9601u, number, c));
  format::SurfaceRecord surface{};
  const format::SurfaceTexture none{kNone, {0, 0}, {1, 1}, 0};
  std::fill(std::begin(surface.textures), std::end(surface.textures), none);
  surface.roughness = plan.surface == kNone ? 0.8f : 1.0f;
  surface.metallic = plan.surface == kNone ? 0.0f : 1.0f;
  surface.normal_scale = surface.occlusion_strength = 1;
  surface.ior = 1.5f;
  surface.specular = plan.specular ? 0.5f : 1.0f;
  std::fill(std::begin(surface.specular_color), std::end(surface.specular_color), 1.0f);
  if (plan.emission != kNone) std::fill(std::begin(surface.emission), std::end(surface.emission), 0.2f);
  const auto use = [&](format::SurfaceUse which, uint32_t texture) {
    format::SurfaceTexture& entry = surface.textures[static_cast<size_t>(which)];
    entry.texture = texture;
    if (plan.transform) entry.uv_scale[0] = entry.uv_scale[1] = 2;
  };
  use(format::SurfaceUse::kMetallicRoughness, plan.surface);
  use(format::SurfaceUse::kNormalMap, plan.normals);
  use(format::SurfaceUse::kSpecular, plan.specular_texture);
  use(format::SurfaceUse::kEmission, plan.emission);
  if (plan.transform) material.transform.scale[0] = material.transform.scale[1] = 2;
  material.surface = surface;
  writer.add_material(std::move(material));
}

// ---- Instances ----

/// The quaternion of a rotation about y; `turn` in [0, 1) is the share of a full turn.
std::array<double, 4> yaw(double turn) {
  const double half = std::numbers::pi * turn;
  return {0, std::sin(half), 0, std::cos(half)};
}

/// The placement of an instance in a hall of 120 x 60 units with three levels 8 units apart, around the cameras; y up.
/// `number`: its number among all instances. `of_mesh`: its number among the instances of its mesh.
Placement place(const ZorahPlan& plan, uint32_t mesh, uint32_t number, uint32_t of_mesh) {
  const auto chance = [&](uint32_t i) { return unit24(hash2(9701u, number, i)); };
  const uint32_t hash = hash2(9702u, number, 0);
  Placement at{.mesh = mesh};
  switch (plan.meshes[mesh].kind) {
    case ZorahKind::kFloor: {
      // Tiles of 4 x 4 units. A mesh that is drawn often covers most of the ground.
      const bool is_ground = plan.meshes[mesh].nodes > 300;
      const uint32_t cell = is_ground ? of_mesh : static_cast<uint32_t>(chance(0) * 1350), r = cell % 450;
      at.rotation = yaw((hash & 3u) * 0.25);
      at.scale = {2.1, 0.3, 2.1};
      at.translation = {-58 + 4.0 * (r % 30), 8.0 * (cell / 450) + (chance(1) - 0.5) * 0.2, -28 + 4.0 * (r / 30)};
      break;
    }
    case ZorahKind::kWall: {
      const auto cell = static_cast<uint32_t>(chance(0) * 540), r = cell % 90;
      const double y = 2 + 4.0 * (cell / 90), off = (chance(1) - 0.5) * 0.3;
      const bool is_long = r < 60;
      at.scale = is_long ? std::array<double, 3>{2.1, 2.1, 0.35} : std::array<double, 3>{0.35, 2.1, 2.1};
      if (is_long) {
        at.translation = {-58 + 4.0 * (r % 30), y, (r < 30 ? -30 : 30) + off};
      } else {
        at.translation = {(r < 75 ? -60 : 60) + off, y, -28 + 4.0 * ((r - 60) % 15)};
      }
      break;
    }
    case ZorahKind::kColumn: {
      const auto cell = static_cast<uint32_t>(chance(0) * 360), r = cell % 72;
      at.rotation = yaw(chance(1));
      at.scale = {0.9, 2.5, 0.9};
      at.translation = {-55 + 10.0 * (r % 12), 2.4 + 4.8 * (cell / 72), -25 + 10.0 * (r / 12)};
      break;
    }
    case ZorahKind::kMountain: {
      const double angle = 2 * std::numbers::pi * chance(0), away = 220 + 200 * chance(1), size = 40 + 50 * chance(2);
      at.rotation = yaw(chance(3));
      at.scale = {size, size * (0.6 + 0.4 * chance(4)), size};
      at.translation = {away * std::cos(angle), -10, away * std::sin(angle)};
      break;
    }
    case ZorahKind::kKite: {
      at.rotation = yaw(chance(1));
      at.scale = {0.8, 0.05, 0.8};
      at.translation = {(chance(2) - 0.5) * 100, 26 + 10 * chance(3), (chance(4) - 0.5) * 50};
      break;
    }
    case ZorahKind::kProp: {
      const double size = 0.12 + 1.1 * std::pow(chance(2), 3);
      const double levels[4] = {0, 0, 8, 16}, level = levels[hash >> 2 & 3u];
      at.rotation = yaw(chance(3));
      at.scale = {(hash >> 4 & 15u) == 0 ? -size : size, size, size};  // one in 16 is mirrored
      at.translation = {(chance(0) - 0.5) * 116, level + 0.3 + size * 0.8 + chance(4) * 0.5, (chance(1) - 0.5) * 56};
      const double dx = at.translation[0] - plan.camera.eye[0], dz = at.translation[2] - plan.camera.eye[2];
      if (dx * dx + dz * dz < 16) at.translation[0] -= 8;  // keeps a distance from the camera
      break;
    }
  }
  return at;
}

const char* kind_name(ZorahKind kind) {
  constexpr const char* kNames[] = {"floor", "wall", "column", "prop", "mountain", "kite"};
  return kNames[static_cast<size_t>(kind)];
}

/// Nodes without a mesh in a tree with four children per node, and their world positions.
struct Parents {
  std::vector<uint32_t> nodes;
  std::vector<Vec3> places;
};

Parents add_parents(GltfWriter& writer, uint32_t count) {
  Parents parents;
  for (uint32_t i = 0; i < count; ++i) {
    const Vec3 step{unit24(hash2(9801u, i, 0)) - 0.5, 0, unit24(hash2(9801u, i, 1)) - 0.5};
    GltfNode node{.name = "group" + std::to_string(i)};
    std::copy(step.begin(), step.end(), node.local.begin());
    parents.nodes.push_back(writer.add_node(std::move(node)));
    parents.places.push_back(i == 0 ? step : parents.places[(i - 1) / 4] + step);
    if (i != 0) writer.node(parents.nodes[(i - 1) / 4]).children.push_back(parents.nodes[i]);
  }
  return parents;
}

/// The placements of a mesh's nodes and of its instances. `first`: the number of the first one among all instances.
struct MeshPlacements {
  std::vector<Placement> nodes, instances;
};

MeshPlacements placements_of(const ZorahPlan& plan, uint32_t mesh, uint32_t first) {
  MeshPlacements out;
  const uint32_t nodes = plan.meshes[mesh].nodes;
  for (uint32_t i = 0; i < nodes + plan.meshes[mesh].instances; ++i)
    (i < nodes ? out.nodes : out.instances).push_back(place(plan, mesh, first + i, i));
  return out;
}

/// Adds all nodes and the data of their instances. Returns the scene's roots. Meshes have the same numbers as in the
/// plan.
Result<std::vector<uint32_t>> add_nodes(GltfWriter& writer, const ZorahPlan& plan) {
  const Parents parents = add_parents(writer, plan.parents);
  std::vector<uint32_t> roots;
  if (!parents.nodes.empty()) roots.push_back(parents.nodes[0]);
  uint32_t leaf = 0;
  const auto attach = [&](uint32_t node) {  // each parent gets one child before any gets two
    if (parents.nodes.empty()) {
      roots.push_back(node);
      return;
    }
    const size_t parent = leaf++ % parents.nodes.size();
    for (size_t i = 0; i < 3; ++i) writer.node(node).local[i] -= parents.places[parent][i];
    writer.node(parents.nodes[parent]).children.push_back(node);
  };
  uint32_t number = 0;
  for (uint32_t m = 0; m < plan.meshes.size(); ++m) {
    const MeshPlacements placements = placements_of(plan, m, number);
    for (const Placement& at : placements.nodes)
      attach(writer.add_node(node_of(at, kind_name(plan.meshes[m].kind) + ("_" + std::to_string(number++)))));
    number += static_cast<uint32_t>(placements.instances.size());
    std::vector<uint32_t> instanced;
    SCREE_TRY(add_instanced_nodes(writer, placements.instances, instanced));
    for (const uint32_t node : instanced) attach(node);
  }
  const GltfCamera lens{
      .name = plan.camera.name, .y = std::numbers::pi / 3, .x = 16.0 / 9.0, .z_near = 0.02, .z_far = 29999.998};
  roots.push_back(add_camera(writer, lens, plan.camera.eye, plan.camera.target));
  return roots;
}

}  // namespace

Result<SynthReport> write_zorah(const ZorahPlan& plan, const SynthOptions& options) {
  if (format::lower_case(std::filesystem::path(options.output).extension().string()) == ".glb")
    return Error{ErrorCode::kUsage, options.output + ": " + plan.name + " is written as .gltf, with files beside it"};
  meshopt_encodeIndexVersion(1);  // the version of EXT_meshopt_compression
  GltfWriter writer = SCREE_TRY(GltfWriter::create(options.output, {}, options.existing));
  writer.stop_on(options.stop);
  Progress progress(options.progress);
  convert::WorkerPool pool(thread_count(options.threads, UINT64_MAX), options.stop);

  std::vector<uint32_t> roots = SCREE_TRY(add_nodes(writer, plan));
  const std::vector<GroupAccessors> accessors = SCREE_TRY(write_groups(writer, plan, {progress, pool}));
  SCREE_TRY(write_textures(writer, plan, {progress, pool}));
  for (uint32_t i = 0; i < plan.materials.size(); ++i) add_material(writer, plan.materials[i], i);
  for (uint32_t m = 0; m < plan.meshes.size(); ++m) {
    GltfMesh mesh{.name = kind_name(plan.meshes[m].kind) + ("_mesh" + std::to_string(m))};
    for (uint32_t i = 0; i < plan.meshes[m].materials.size(); ++i) {
      const GroupAccessors& group = accessors[plan.meshes[m].first_group + i];
      mesh.primitives.push_back({group.attributes, group.indices, plan.meshes[m].materials[i]});
    }
    writer.add_mesh(std::move(mesh));
  }
  writer.add_scene({plan.name, std::move(roots)});
  SCREE_TRY(writer.finish());

  return SynthReport{.unique_triangles = plan.unique_triangles(),
                     .drawn_triangles = plan.drawn_triangles(),
                     .vertices = plan.vertices(),
                     .instances = plan.drawn_meshes(),
                     .file_bytes = writer.total_bytes()};
}

}  // namespace scree::synth
