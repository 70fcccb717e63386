#include "tools/synth/gltf_parts.h"

#include <algorithm>
#include <map>
#include <thread>
#include <utility>

#include "tools/gltf/box.h"

namespace scree::synth {

using namespace tools;

namespace {

constexpr uint64_t kMostShortVertices = 65535;  // index 65535 would be a primitive restart

}  // namespace

void Mesh::add_vertex(const Vec3& at, double u, double v) {
  for (const double part : at) positions.push_back(static_cast<float>(part));
  uvs.insert(uvs.end(), {static_cast<float>(u), static_cast<float>(v)});
}

void Mesh::add_quad(uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
  indices.insert(indices.end(), {a, b, c, a, c, d});
}

void Mesh::add_grid(uint32_t columns, uint32_t rows, Rows direction) {
  for (uint32_t y = 0; y < rows; ++y)
    for (uint32_t x = 0; x < columns; ++x) {
      const uint32_t corner = y * (columns + 1) + x, next = corner + columns + 1;
      if (direction == Rows::kUp)
        add_quad(corner, corner + 1, next + 1, next);
      else
        add_quad(corner, next, next + 1, corner + 1);
    }
}

Result<GltfPrimitive> append_primitive(GltfWriter& writer, const Mesh& mesh) {
  GltfPrimitive primitive{.material = mesh.material};
  GltfAccessor accessor{.count = mesh.vertex_count()};
  const auto attribute = [&](const char* semantic, const auto& values) -> Result<void> {
    const uint32_t added = SCREE_TRY(append_stream(writer, values, accessor, GltfTarget::kVertices));
    primitive.attributes.emplace_back(semantic, added);
    return {};
  };
  const convert::Box box = convert::box_of(mesh.positions);
  accessor.min.assign(box.lo.begin(), box.lo.end());
  accessor.max.assign(box.hi.begin(), box.hi.end());
  SCREE_TRY(attribute("POSITION", mesh.positions));
  accessor.min.clear();
  accessor.max.clear();
  accessor.type = GltfType::kVec2;
  if (!mesh.uvs.empty()) SCREE_TRY(attribute("TEXCOORD_0", mesh.uvs));
  accessor.type = GltfType::kVec4;
  accessor.component = GltfComponent::kUint8;
  accessor.normalized = true;
  if (!mesh.colors.empty()) SCREE_TRY(attribute("COLOR_0", mesh.colors));

  const bool is_short = mesh.may_have_short_indices && mesh.vertex_count() <= kMostShortVertices;
  const GltfAccessor list{.component = is_short ? GltfComponent::kUint16 : GltfComponent::kUint32,
                          .type = GltfType::kScalar,
                          .count = mesh.indices.size()};
  const std::vector<uint16_t> shorts(mesh.indices.begin(), is_short ? mesh.indices.end() : mesh.indices.begin());
  primitive.indices = SCREE_TRY(is_short ? append_stream(writer, shorts, list, GltfTarget::kIndices)
                                         : append_stream(writer, mesh.indices, list, GltfTarget::kIndices));
  return primitive;
}

GltfTexture trilinear(uint32_t image, std::string name, format::Wrap wrap) {
  return {.name = std::move(name),
          .image = image,
          .wrap_s = wrap,
          .wrap_t = wrap,
          .mag_filter = 9729,   // linear
          .min_filter = 9987};  // linear between mip levels too
}

GltfNode node_of(const Placement& placement, std::string name) {
  GltfNode node{.name = std::move(name), .mesh = placement.mesh};
  std::copy(placement.translation.begin(), placement.translation.end(), node.local.begin());
  std::copy(placement.rotation.begin(), placement.rotation.end(), node.local.begin() + 3);
  std::copy(placement.scale.begin(), placement.scale.end(), node.local.begin() + 7);
  return node;
}

uint32_t add_camera(GltfWriter& writer, const GltfCamera& lens, const Vec3& eye, const Vec3& target) {
  const Vec3 back = normalized(eye - target), right = normalized(cross({0, 1, 0}, back)), up = cross(back, right);
  GltfNode node{.name = lens.name, .camera = writer.add_camera(lens), .has_matrix = true};
  node.local = {right[0], right[1], right[2], 0, up[0],  up[1],  up[2],  0,
                back[0],  back[1],  back[2],  0, eye[0], eye[1], eye[2], 1};
  return writer.add_node(std::move(node));
}

uint32_t add_stream(GltfWriter& writer, uint64_t offset, uint64_t bytes, GltfAccessor accessor, GltfTarget target) {
  accessor.buffer_view = writer.add_buffer_view({offset, bytes, 0, target});
  return writer.add_accessor(std::move(accessor));
}

Result<void> add_instanced_nodes(GltfWriter& writer, std::span<const Placement> placements,
                                 std::vector<uint32_t>& nodes) {
  struct Streams {
    std::vector<float> translations, rotations, scales;
  };
  std::map<uint32_t, Streams> of_mesh;
  for (const Placement& placement : placements) {
    Streams& streams = of_mesh[placement.mesh];
    for (const double part : placement.translation) streams.translations.push_back(static_cast<float>(part));
    for (const double part : placement.rotation) streams.rotations.push_back(static_cast<float>(part));
    for (const double part : placement.scale) streams.scales.push_back(static_cast<float>(part));
  }
  for (const auto& [mesh, streams] : of_mesh) {
    GltfNode node{.name = "instances of mesh" + std::to_string(mesh), .mesh = mesh};
    const auto attribute = [&](const char* semantic, const std::vector<float>& values, GltfType type,
                               uint64_t components) -> Result<void> {
      const uint32_t added = SCREE_TRY(
          append_stream(writer, values, {.type = type, .count = values.size() / components}, GltfTarget::kNone));
      node.instancing.emplace_back(semantic, added);
      return {};
    };
    SCREE_TRY(attribute("TRANSLATION", streams.translations, GltfType::kVec3, 3));
    SCREE_TRY(attribute("ROTATION", streams.rotations, GltfType::kVec4, 4));
    SCREE_TRY(attribute("SCALE", streams.scales, GltfType::kVec3, 3));
    nodes.push_back(writer.add_node(std::move(node)));
  }
  return {};
}

uint32_t thread_count(uint32_t wanted, uint64_t items) {
  const uint64_t count = wanted != 0 ? wanted : std::thread::hardware_concurrency();
  return static_cast<uint32_t>(std::max<uint64_t>(1, std::min(count, items)));
}

}  // namespace scree::synth
