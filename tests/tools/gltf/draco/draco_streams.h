// Makes Draco streams and glTF files of them for the tests, if scree is built with libdraco.
#pragma once

#include <draco/compression/encode.h>
#include <draco/core/encoder_buffer.h>
#include <draco/mesh/mesh.h>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <vector>

#include "tests/catch.h"

namespace scree::tests {

struct DracoRecipe {
  bool is_sequential = false;  // false: edgebreaker
  int speed = 5;               // 0 smallest to 10
  int position_bits = 0;       // 0: lossless
  bool has_uv = true;
  bool has_tangent = false;  // an attribute that scree leaves out
};

inline constexpr uint32_t kDracoPosition = 0, kDracoUv = 1, kDracoTangent = 2;  // numbers of attributes

/// A wavy grid of side x side squares.
struct DracoGrid {
  std::vector<float> positions, uvs, tangents;
  std::vector<uint32_t> corners;

  explicit DracoGrid(uint32_t side) {
    for (uint32_t y = 0; y <= side; ++y)
      for (uint32_t x = 0; x <= side; ++x) {
        const float u = static_cast<float>(x) / static_cast<float>(side);
        const float v = static_cast<float>(y) / static_cast<float>(side);
        positions.insert(positions.end(), {u, u * v * (1 - v), v});
        uvs.insert(uvs.end(), {u, 1 - v});
        tangents.insert(tangents.end(), {1, 0, 0, 1});
        if (x == side || y == side) continue;
        const uint32_t at = y * (side + 1) + x, below = at + side + 1;
        corners.insert(corners.end(), {at, below, at + 1, at + 1, below, below + 1});
      }
  }
  uint32_t vertices() const { return static_cast<uint32_t>(positions.size() / 3); }
  uint32_t triangles() const { return static_cast<uint32_t>(corners.size() / 3); }
};

inline std::vector<std::byte> make_draco(const DracoGrid& grid, const DracoRecipe& recipe) {
  draco::Mesh mesh;
  mesh.set_num_points(grid.vertices());
  const auto add = [&](draco::GeometryAttribute::Type type, int8_t components, const std::vector<float>& values) {
    draco::GeometryAttribute attribute;
    attribute.Init(type, nullptr, components, draco::DT_FLOAT32, false, components * 4, 0);
    const int id = mesh.AddAttribute(attribute, true, grid.vertices());
    for (uint32_t i = 0; i < grid.vertices(); ++i)
      mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(i),
                                            values.data() + i * static_cast<size_t>(components));
  };
  add(draco::GeometryAttribute::POSITION, 3, grid.positions);
  if (recipe.has_uv) add(draco::GeometryAttribute::TEX_COORD, 2, grid.uvs);
  if (recipe.has_tangent) add(draco::GeometryAttribute::GENERIC, 4, grid.tangents);
  for (uint32_t i = 0; i < grid.triangles(); ++i)
    mesh.AddFace({draco::PointIndex(grid.corners[3 * i]), draco::PointIndex(grid.corners[3 * i + 1]),
                  draco::PointIndex(grid.corners[3 * i + 2])});
  draco::Encoder encoder;
  encoder.SetSpeedOptions(recipe.speed, recipe.speed);
  encoder.SetEncodingMethod(recipe.is_sequential ? draco::MESH_SEQUENTIAL_ENCODING : draco::MESH_EDGEBREAKER_ENCODING);
  if (recipe.position_bits != 0)
    encoder.SetAttributeQuantization(draco::GeometryAttribute::POSITION, recipe.position_bits);
  draco::EncoderBuffer buffer;
  const draco::Status status = encoder.EncodeMeshToBuffer(mesh, &buffer);
  if (!status.ok()) FAIL(status.error_msg_string());
  std::vector<std::byte> stream(buffer.size());
  std::memcpy(stream.data(), buffer.data(), buffer.size());
  return stream;
}

inline std::string base64(std::span<const std::byte> bytes) {
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (size_t i = 0; i < bytes.size(); i += 3) {
    uint32_t word = 0;
    for (size_t k = 0; k < 3; ++k) word = word << 8 | (i + k < bytes.size() ? static_cast<uint32_t>(bytes[i + k]) : 0);
    for (size_t k = 0; k < 4; ++k) text += i + k > bytes.size() ? '=' : kDigits[word >> (18 - 6 * k) & 63];
  }
  return text;
}

/// A document with one mesh. Its primitives have one stream each, with `triangles` and `vertices`.
inline std::string draco_document(const std::vector<std::vector<std::byte>>& streams, uint32_t triangles,
                                  uint32_t vertices, const DracoRecipe& recipe) {
  std::string primitives, views, buffers, accessors;
  const auto add_comma = [](std::string& list) { list += list.empty() ? "" : ","; };
  for (size_t i = 0; i < streams.size(); ++i) {
    add_comma(primitives);
    add_comma(views);
    add_comma(buffers);
    const std::string number = std::to_string(i), bytes = std::to_string(streams[i].size());
    primitives += R"({"indices":1,"attributes":{"POSITION":0)" +
                  std::string(recipe.has_uv ? R"(,"TEXCOORD_0":2)" : "") +
                  (recipe.has_tangent ? R"(,"TANGENT":3)" : "") +
                  R"(},"material":0,"extensions":{"KHR_draco_mesh_compression":{"bufferView":)" + number +
                  R"(,"attributes":{"POSITION":0)" + (recipe.has_uv ? R"(,"TEXCOORD_0":1)" : "") +
                  (recipe.has_tangent ? R"(,"TANGENT":2)" : "") + "}}}}";
    views += R"({"buffer":)" + number + R"(,"byteLength":)" + bytes + "}";
    buffers += R"({"byteLength":)" + bytes + R"(,"uri":"data:;base64,)" + base64(streams[i]) + "\"}";
  }
  const auto count = [&](bool is_used) { return R"(,"count":)" + std::to_string(is_used ? vertices : 1); };
  accessors = R"({"componentType":5126,"type":"VEC3","min":[0,0,0],"max":[1,1,1])" + count(true) +
              R"(},{"componentType":5123,"type":"SCALAR","count":)" + std::to_string(3 * triangles) +
              R"(},{"componentType":5126,"type":"VEC2")" + count(recipe.has_uv) +
              R"(},{"componentType":5126,"type":"VEC4")" + count(recipe.has_tangent) + "}";
  return R"({"asset":{"version":"2.0"},"extensionsRequired":["KHR_draco_mesh_compression"],"scene":0,)"
         R"("scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],"meshes":[{"primitives":[)" +
         primitives +
         R"(]}],"materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],)"
         R"("textures":[{"source":0}],"images":[{"uri":"t.png"}],"accessors":[)" +
         accessors + R"(],"bufferViews":[)" + views + R"(],"buffers":[)" + buffers + "]}";
}

}  // namespace scree::tests
