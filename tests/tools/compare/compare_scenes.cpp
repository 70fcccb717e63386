#include "tests/tools/compare/compare_scenes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>
#include <optional>
#include <span>

#include "runtime/images/block_file.h"
#include "runtime/images/image.h"
#include "tests/format/jpeg/jpeg_maker.h"
#include "tests/tools/compare/source_compare.h"
#include "tools/common/chunk_decode.h"

namespace scree::tests {
namespace {

using namespace convert;
using format::kNone;

// Float arithmetic in between adds this to the stated errors.
constexpr double kColorError = 0.5 / 255 + 1e-6;
constexpr double kNormalDegrees = 0.06;  // 12 bits per axis of the octahedral map: below 0.05
constexpr size_t kMaxLines = 12;

/// Whether coefficients, quantisation and colour space are the same. Segments and Huffman tables may differ.
bool is_same_jpeg(std::span<const std::byte> a, std::span<const std::byte> b) {
  const auto before = read_coefficients(a);
  const auto after = read_coefficients(b);
  if (before.size() != after.size()) return false;
  for (size_t c = 0; c < before.size(); ++c)
    if (before[c].blocks_across != after[c].blocks_across || before[c].values != after[c].values) return false;
  return read_quant_tables(a) == read_quant_tables(b) && read_colour_space(a) == read_colour_space(b);
}

bool is_webp(std::span<const std::byte> file) {
  return file.size() >= 12 && std::memcmp(file.data(), "RIFF", 4) == 0 && std::memcmp(file.data() + 8, "WEBP", 4) == 0;
}

class SceneComparison {
 public:
  SceneComparison(const SourceScene& source, const format::Container& packed, const SourceScene& back)
      : source_(source), packed_(packed), back_(back) {}

  std::vector<std::string> run() {
    compare_meshes();
    compare_nodes();
    compare_cameras();
    compare_lights();
    compare_scene_roots();
    return std::move(lines_);
  }

 private:
  void differ(std::string line) {
    if (lines_.size() < kMaxLines) lines_.push_back(std::move(line));
  }
  template <class T>
  bool same(const std::string& what, const T& was, const T& is) {
    if (was == is) return true;
    differ(what + " differs");
    return false;
  }
  bool same_number(const std::string& what, uint64_t was, uint64_t is) {
    if (was == is) return true;
    differ(what + ": was " + std::to_string(was) + ", is " + std::to_string(is));
    return false;
  }
  bool close(const std::string& what, double was, double is, double error) {
    if (std::abs(was - is) <= error) return true;
    char text[160];
    std::snprintf(text, sizeof text, ": was %.9g, is %.9g, but the error should be at most %.3g", was, is, error);
    differ(what + text);
    return false;
  }

  struct Vertices {
    std::vector<float> positions, uvs, colors, normals;
    uint32_t color_components = 4;
  };

  std::vector<float> floats(const std::optional<Accessor>& accessor) {
    if (!accessor) return {};
    Result<std::vector<float>> values = all_floats(*accessor);
    if (values) return std::move(*values);
    differ(values.error().message);
    return std::vector<float>(accessor->count * accessor->components);
  }

  Vertices vertices(const Primitive& primitive) {
    Vertices all{floats(primitive.positions), floats(primitive.uv), floats(primitive.color), floats(primitive.normal),
                 4};
    if (primitive.color) all.color_components = primitive.color->components;
    return all;
  }

  SourceTriangles triangles(const Primitive& primitive, const Vertices& vertices) {
    Result<SourceTriangles> read = source_triangles(primitive, vertices.positions);
    if (read) return std::move(*read);
    differ(read.error().message);
    return {};
  }

  void compare_meshes() {
    // By group of the source: the group of the file that the source's nodes draw, which is the same or an equal one.
    std::vector<uint32_t> stored_as(source_.groups.size(), kNone);
    for (size_t i = 0; i < source_.nodes.size() && i < packed_.nodes().size(); ++i)
      if (source_.nodes[i].group != kNone) stored_as[source_.nodes[i].group] = packed_.nodes()[i].group;
    std::vector<uint32_t> kept_primitives(source_.groups.size());
    uint32_t meshes = 0;
    for (uint32_t i = 0; i < source_.primitives.size(); ++i) {
      const Primitive& primitive = source_.primitives[i];
      const uint32_t group = stored_as[primitive.group];
      if (group == kNone) continue;
      const Vertices was = vertices(primitive);
      const SourceTriangles source = triangles(primitive, was);
      if (source.kept_count == 0) continue;
      const uint32_t place = kept_primitives[primitive.group]++;
      const uint32_t mesh = packed_.groups()[group].first_mesh + place;
      if (place >= packed_.groups()[group].mesh_count || mesh >= back_.primitives.size()) {
        differ("primitive " + std::to_string(i) + " is missing");
        return;
      }
      compare_mesh("primitive " + std::to_string(i), primitive, source, was, mesh);
      meshes += group == primitive.group ? 1 : 0;
    }
    same_number("meshes in the file", meshes, packed_.meshes().size());
    same_number("primitives", meshes, back_.primitives.size());
  }

  std::vector<uint64_t> source_ids(uint32_t mesh) {
    std::vector<uint64_t> ids;
    tools::ChunkReader reader(packed_);
    const format::MeshRecord& record = packed_.meshes()[mesh];
    for (uint64_t chunk = record.first_chunk; chunk < record.first_chunk + record.chunk_count; ++chunk) {
      const auto read = reader.read(chunk, tools::kPartSourceIds);
      if (!read) {
        differ(read.error().message);
        return {};
      }
      ids.insert(ids.end(), (*read)->source_ids.begin(), (*read)->source_ids.end());
    }
    return ids;
  }

  void compare_mesh(const std::string& place, const Primitive& source, const SourceTriangles& from, const Vertices& was,
                    uint32_t mesh) {
    const Primitive& back = back_.primitives[mesh];
    const std::vector<uint64_t> ids = source_ids(mesh);
    const Vertices is = vertices(back);
    const std::vector<uint32_t> back_corners = triangles(back, is).corners;
    if (!same_number(place + ": triangles", from.kept_count, ids.size()) ||
        !same_number(place + ": exported triangles", ids.size(), back_corners.size() / 3))
      return;
    std::vector<bool> keep = from.kept;
    const format::MeshRecord& record = packed_.meshes()[mesh];
    compare_material(place, source, back);
    if (source.uv && is.uvs.empty()) differ(place + ": no texture coordinates");
    const bool has_color = record.attributes & format::kHasColor;
    if (has_color != back.color.has_value()) differ(place + ": vertex colours came or went");

    for (size_t t = 0; t < ids.size() && lines_.size() < kMaxLines; ++t) {
      if (ids[t] >= keep.size() || !keep[ids[t]]) {
        differ(place + ": source triangle " + std::to_string(ids[t]) + " comes twice or should not come");
        return;
      }
      keep[ids[t]] = false;  // each triangle occurs once
      compare_triangle(place + ", triangle " + std::to_string(ids[t]), &from.corners[3 * ids[t]], &back_corners[3 * t],
                       was, is, record);
    }
  }

  /// Corners may be rotated. If a triangle is smaller than the error, several rotations fit its positions. One of them
  /// must fit all attributes.
  void compare_triangle(const std::string& place, const uint32_t* from, const uint32_t* to, const Vertices& was,
                        const Vertices& is, const format::MeshRecord& record) {
    const size_t before = lines_.size();
    std::vector<std::string> first;  // the differences of the first rotation whose positions fit
    for (uint32_t turn = 0; turn < 3; ++turn) {
      bool fits = true;
      for (uint32_t corner = 0; corner < 3; ++corner) {
        const size_t a = from[corner], b = to[(corner + turn) % 3];
        for (size_t axis = 0; axis < 3; ++axis)
          fits = fits && std::abs(static_cast<double>(was.positions[3 * a + axis]) -
                                  static_cast<double>(is.positions[3 * b + axis])) <= record.max_position_error;
      }
      if (!fits) continue;
      bool good = true;
      for (uint32_t corner = 0; corner < 3; ++corner)
        good = good && compare_attributes(place, from[corner], to[(corner + turn) % 3], was, is, record);
      if (good) return;
      if (first.empty()) first = lines_;
      lines_.resize(before);
    }
    if (!first.empty()) {
      lines_ = first;
      return;
    }
    differ(place + ": no corner lies within the stated error");
  }

  bool compare_attributes(const std::string& place, size_t a, size_t b, const Vertices& was, const Vertices& is,
                          const format::MeshRecord& record) {
    bool good = true;
    if (!was.uvs.empty() && !is.uvs.empty()) {
      for (size_t axis = 0; axis < 2; ++axis) {
        const double value = static_cast<double>(was.uvs[2 * a + axis]);
        if (std::isfinite(value))
          good = good && close(place + ": texture coordinate", value, static_cast<double>(is.uvs[2 * b + axis]),
                               static_cast<double>(record.max_uv_error));
      }
    }
    if (!was.colors.empty() && !is.colors.empty()) {
      for (size_t i = 0; i < 4; ++i) {
        const double value =
            i < was.color_components ? static_cast<double>(was.colors[was.color_components * a + i]) : 1.0;
        good = good && close(place + ": colour", std::clamp(value, 0.0, 1.0),
                             static_cast<double>(is.colors[is.color_components * b + i]), kColorError);
      }
    }
    if (!was.normals.empty() && !is.normals.empty())
      good = good && compare_normal(place, &was.normals[3 * a], &is.normals[3 * b]);
    return good;
  }

  bool compare_normal(const std::string& place, const float* was, const float* is) {
    double dot = 0, length = 0, back_length = 0;
    for (size_t i = 0; i < 3; ++i) {
      dot += static_cast<double>(was[i]) * static_cast<double>(is[i]);
      length += static_cast<double>(was[i]) * static_cast<double>(was[i]);
      back_length += static_cast<double>(is[i]) * static_cast<double>(is[i]);
    }
    if (!(length > 1e-12) || !std::isfinite(length)) return true;  // the source's normal has no direction
    const double cosine = std::clamp(dot / std::sqrt(length * back_length), -1.0, 1.0);
    return close(place + ": angle of the normal", 0, std::acos(cosine) * 180 / std::numbers::pi, kNormalDegrees);
  }

  void compare_material(const std::string& place, const Primitive& source, const Primitive& back) {
    if ((source.material == kNone) != (back.material == kNone)) {
      differ(place + ": material came or went");
      return;
    }
    if (source.material == kNone) return;
    const auto& was = source_.materials[source.material];
    const auto& is = back_.materials[back.material];
    same(place + ": material name", was.name, is.name);
    for (size_t i = 0; i < 4; ++i) {
      close(place + ": base colour", static_cast<double>(was.record.base_color[i]),
            static_cast<double>(is.record.base_color[i]), 0);
    }
    same_number(place + ": material flags", was.record.flags, is.record.flags);
    if (was.record.flags & format::kMaterialAlphaMask) {
      close(place + ": alpha cutoff", static_cast<double>(was.record.alpha_cutoff),
            static_cast<double>(is.record.alpha_cutoff), 0);
    }
    if (!source.uv) {  // a texture is not read without texture coordinates
      same_number(place + ": texture", kNone, is.record.texture);
      return;
    }
    if (!same_number(place + ": has texture", was.record.texture != kNone, is.record.texture != kNone)) return;
    if (was.record.texture == kNone) return;
    for (size_t i = 0; i < 2; ++i) {
      close(place + ": uv offset", static_cast<double>(was.record.uv_offset[i]),
            static_cast<double>(is.record.uv_offset[i]), 0);
      close(place + ": uv scale", static_cast<double>(was.record.uv_scale[i]),
            static_cast<double>(is.record.uv_scale[i]), 0);
    }
    close(place + ": uv rotation", static_cast<double>(was.record.uv_rotation),
          static_cast<double>(is.record.uv_rotation), 0);
    compare_texture(place, was.record.texture, is.record.texture);
  }

  void compare_texture(const std::string& place, uint32_t was_number, uint32_t is_number) {
    const auto& was = source_.textures[was_number];
    const auto& is = back_.textures[is_number];
    same(place + ": texture name", was.name, is.name);
    same(place + ": wrap", std::pair(was.record.wrap_s, was.record.wrap_t),
         std::pair(is.record.wrap_s, is.record.wrap_t));
    same(place + ": filter", std::pair(was.record.mag_filter, was.record.min_filter),
         std::pair(is.record.mag_filter, is.record.min_filter));
    const auto& from = source_.images[was.record.image];
    const auto& to = back_.images[is.record.image];
    const bool has_blocks = from.codec == format::ImageCodec::kBlocks;  // KTX2 or DDS, which export writes as a PNG
    same_number(place + ": image codec", static_cast<uint64_t>(has_blocks ? format::ImageCodec::kPng : from.codec),
                static_cast<uint64_t>(to.codec));
    std::vector<std::byte> a(from.bytes), b(to.bytes);
    if (!from.source->read(from.offset, a) || !to.source->read(to.offset, b)) {
      differ(place + ": image cannot be read");
    } else if (has_blocks) {
      runtime::ImageFile file(a);
      auto head = runtime::open_block_file(file);
      const auto blocks = head ? runtime::read_block_level(file, *head, 0) : head.error();
      const auto png = runtime::decode_image(b);
      if (!blocks || !png ||
          runtime::decode_block_level(head->format, head->swizzle, head->width, head->height, blocks->data()).rgba !=
              png->rgba)
        differ(place + ": pixels differ");
    } else if (is_webp(a)) {  // stored as a PNG
      const auto was_pixels = runtime::decode_image(a), is_pixels = runtime::decode_image(b);
      if (!was_pixels || !is_pixels || was_pixels->rgba != is_pixels->rgba) differ(place + ": pixels differ");
    } else if (from.codec == format::ImageCodec::kJpeg ? !is_same_jpeg(a, b) : a != b) {
      differ(place + ": image differs");
    }
  }

  using Matrix = std::array<double, 16>;  // column-major

  static Matrix local_matrix(const convert::SourceNode& node) {
    if (node.has_matrix) return node.local.values();
    const double *t = node.local.values().data(), *q = t + 3, *s = t + 7;
    const double length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    const double x = q[0] / length, y = q[1] / length, z = q[2] / length, w = q[3] / length;
    return {s[0] * (1 - 2 * (y * y + z * z)),
            s[0] * 2 * (x * y + z * w),
            s[0] * 2 * (x * z - y * w),
            0,
            s[1] * 2 * (x * y - z * w),
            s[1] * (1 - 2 * (x * x + z * z)),
            s[1] * 2 * (y * z + x * w),
            0,
            s[2] * 2 * (x * z + y * w),
            s[2] * 2 * (y * z - x * w),
            s[2] * (1 - 2 * (x * x + y * y)),
            0,
            t[0],
            t[1],
            t[2],
            1};
  }

  static std::vector<Matrix> world_matrices(const SourceScene& scene) {
    std::vector<Matrix> world;
    for (const auto& node : scene.nodes) {
      const Matrix local = local_matrix(node);
      if (node.parent == kNone) {
        world.push_back(local);
        continue;
      }
      const Matrix parent = world[node.parent];
      Matrix product{};
      for (size_t column = 0; column < 4; ++column)
        for (size_t row = 0; row < 4; ++row)
          for (size_t k = 0; k < 4; ++k) product[4 * column + row] += parent[4 * k + row] * local[4 * column + k];
      world.push_back(product);
    }
    return world;
  }

  void compare_nodes() {
    if (!same_number("nodes", source_.nodes.size(), back_.nodes.size())) return;
    if (!same_number("nodes of the file", source_.nodes.size(), packed_.nodes().size())) return;
    // The exported meshes are the groups that have a primitive left.
    std::vector<uint32_t> group_of_mesh;
    for (uint32_t group = 0; group < packed_.groups().size(); ++group)
      if (packed_.groups()[group].mesh_count != 0) group_of_mesh.push_back(group);
    same_number("glTF meshes", group_of_mesh.size(), back_.groups.size());

    const std::vector<Matrix> was_world = world_matrices(source_), is_world = world_matrices(back_);
    for (size_t i = 0; i < source_.nodes.size(); ++i) {
      const auto& was = source_.nodes[i];
      const auto& is = back_.nodes[i];
      const std::string place = "node " + std::to_string(i);
      same(place + ": name", was.name, is.name);
      same_number(place + ": parent", was.parent, is.parent);
      same_number(place + ": camera", was.camera, is.camera);
      const uint32_t group = packed_.nodes()[i].group;
      const bool drawn = group != kNone && packed_.groups()[group].mesh_count != 0;
      same_number(place + ": mesh", drawn ? group : kNone,
                  is.group < group_of_mesh.size() ? group_of_mesh[is.group] : kNone);
      for (size_t k = 0; k < 16; ++k)
        close(place + ": world matrix", was_world[i][k], is_world[i][k], 1e-12 * (1 + std::abs(was_world[i][k])));
      compare_node_instances(place, drawn ? tests::all_instances(was) : std::vector<format::NodeInstanceRecord>{},
                             tests::all_instances(is));
    }
    for (size_t i = 0; i < group_of_mesh.size() && i < back_.groups.size(); ++i)
      same("name of glTF mesh " + std::to_string(i), source_.groups[group_of_mesh[i]].name, back_.groups[i].name);
  }

  void compare_node_instances(const std::string& place, const std::vector<format::NodeInstanceRecord>& was,
                              const std::vector<format::NodeInstanceRecord>& is) {
    if (!same_number(place + ": instances", was.size(), is.size())) return;
    for (size_t i = 0; i < was.size(); ++i) {
      const auto near = [&](const float* a, const float* b, size_t count) {
        for (size_t k = 0; k < count; ++k)
          close(place + ": instance " + std::to_string(i), static_cast<double>(a[k]), static_cast<double>(b[k]), 1e-7);
      };
      near(was[i].translation, is[i].translation, 3);
      near(was[i].rotation, is[i].rotation, 4);
      near(was[i].scale, is[i].scale, 3);
    }
  }

  void compare_cameras() {
    if (!same_number("cameras", source_.cameras.size(), back_.cameras.size())) return;
    for (size_t i = 0; i < source_.cameras.size(); ++i) {
      const auto& was = source_.cameras[i];
      const auto& is = back_.cameras[i];
      const std::string place = "camera " + std::to_string(i);
      same(place + ": name", was.name, is.name);
      same_number(place + ": kind", static_cast<uint64_t>(was.record.kind), static_cast<uint64_t>(is.record.kind));
      close(place + ": x", was.record.x, is.record.x, 0);
      close(place + ": y", was.record.y, is.record.y, 0);
      close(place + ": near", was.record.z_near, is.record.z_near, 0);
      close(place + ": far", was.record.z_far, is.record.z_far, 0);
    }
  }

  void compare_lights() {
    if (!same_number("lights", source_.lights.size(), back_.lights.size())) return;
    for (size_t i = 0; i < source_.lights.size(); ++i) {
      const format::LightRecord& was = source_.lights[i].record;
      const format::LightRecord& is = back_.lights[i].record;
      const std::string place = "light " + std::to_string(i);
      same(place + ": name", source_.lights[i].name, back_.lights[i].name);
      same_number(place + ": node", was.node, is.node);
      same_number(place + ": kind", static_cast<uint64_t>(was.kind), static_cast<uint64_t>(is.kind));
      for (size_t c = 0; c < 3; ++c) same(place + ": colour", was.color[c], is.color[c]);
      same(place + ": intensity", was.intensity, is.intensity);
      same(place + ": range", was.range, is.range);
      same(place + ": inner cone", was.inner_cone, is.inner_cone);
      same(place + ": outer cone", was.outer_cone, is.outer_cone);
    }
  }

  void compare_scene_roots() {
    if (!same_number("scenes", source_.scenes.size(), back_.scenes.size())) return;
    for (size_t i = 0; i < source_.scenes.size(); ++i) {
      const std::string place = "scene " + std::to_string(i);
      same(place + ": name", source_.scenes[i].name, back_.scenes[i].name);
      same(place + ": roots", source_.scenes[i].roots, back_.scenes[i].roots);
      same_number(place + ": default", source_.scenes[i].is_default, back_.scenes[i].is_default);
    }
  }

  const SourceScene& source_;
  const format::Container& packed_;
  const SourceScene& back_;
  std::vector<std::string> lines_;
};

}  // namespace

std::vector<format::NodeInstanceRecord> all_instances(const convert::SourceNode& node) {
  std::vector<format::NodeInstanceRecord> all(node.instances ? node.instances->count : 0);
  if (!all.empty() && !convert::read_instances(*node.instances, 0, all)) all.clear();
  return all;
}

std::vector<std::string> compare_scenes(const SourceScene& source, const format::Container& packed,
                                        const SourceScene& back) {
  return SceneComparison(source, packed, back).run();
}

}  // namespace scree::tests
