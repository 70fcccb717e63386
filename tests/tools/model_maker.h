// Small glTF scenes for the tests of convert, written with the program's own glTF writer.
#pragma once

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "tests/models.h"
#include "tests/results.h"
#include "tests/tools/temp_folder.h"
#include "tools/gltf/write/writer.h"

namespace scree::tests {

/// A wavy grid of columns x rows squares, two triangles each.
struct GridSpec {
  uint32_t columns = 4, rows = 4;
  float size = 1;  // side, model units
  std::array<float, 3> origin{0, 0, 0};
  bool flat = false, uv = false, color = false, white = false;
  bool fading = false;  // with `color`: the alpha goes from 0 to 1 along x
  bool normal = false, indexed = true;
};

class ModelMaker {
 public:
  explicit ModelMaker(const std::string& path) : writer_(open(path)) {}

  tools::GltfWriter& writer() { return writer_; }

  uint32_t floats(const std::vector<float>& values, tools::GltfType type, bool bounds = false) {
    const uint32_t components = type == tools::GltfType::kScalar ? 1 : 2 + static_cast<uint32_t>(type) - 1;
    tools::GltfAccessor accessor{.buffer_view = view(std::as_bytes(std::span(values)), tools::GltfTarget::kVertices),
                                 .component = tools::GltfComponent::kFloat32,
                                 .type = type,
                                 .count = values.size() / components};
    if (bounds) {
      accessor.min.assign(components, 0);
      accessor.max.assign(components, 0);  // wrong on purpose: no code may rely on a file's statements
    }
    return writer_.add_accessor(accessor);
  }

  uint32_t indices(const std::vector<uint32_t>& values) {
    const tools::GltfAccessor accessor{
        .buffer_view = view(std::as_bytes(std::span(values)), tools::GltfTarget::kIndices),
        .component = tools::GltfComponent::kUint32,
        .type = tools::GltfType::kScalar,
        .count = values.size()};
    return writer_.add_accessor(accessor);
  }

  uint32_t positions(const std::vector<float>& values) { return floats(values, tools::GltfType::kVec3, true); }

  tools::GltfPrimitive primitive(const std::vector<float>& points, const std::vector<uint32_t>& corners) {
    tools::GltfPrimitive out;
    out.attributes.emplace_back("POSITION", positions(points));
    if (!corners.empty()) out.indices = indices(corners);
    return out;
  }

  tools::GltfPrimitive grid(const GridSpec& spec, uint32_t material = format::kNone) {
    std::vector<float> points, uvs, colors, normals;
    std::vector<uint32_t> corners;
    const uint32_t width = spec.columns + 1;
    const auto add_vertex = [&](uint32_t x, uint32_t y) {
      const float u = static_cast<float>(x) / static_cast<float>(spec.columns);
      const float v = static_cast<float>(y) / static_cast<float>(spec.rows);
      const float height = spec.flat ? 0.0f : 0.1f * spec.size * std::sin(7 * u) * std::cos(5 * v);
      points.insert(points.end(),
                    {spec.origin[0] + u * spec.size, spec.origin[1] + height, spec.origin[2] + v * spec.size});
      uvs.insert(uvs.end(), {3 * u, 1 - v});
      const float c = spec.white ? 1.0f : u;
      colors.insert(colors.end(), {c, spec.white ? 1.0f : v, 1.0f, spec.fading ? u : 1.0f});
      const float length = std::sqrt(1 + u * u);
      normals.insert(normals.end(), {u / length, 1 / length, 0.0f});
    };
    if (spec.indexed)
      for (uint32_t y = 0; y <= spec.rows; ++y)
        for (uint32_t x = 0; x <= spec.columns; ++x) add_vertex(x, y);
    for (uint32_t y = 0; y < spec.rows; ++y) {
      for (uint32_t x = 0; x < spec.columns; ++x) {
        const uint32_t at[6][2] = {{x, y}, {x, y + 1}, {x + 1, y}, {x + 1, y}, {x, y + 1}, {x + 1, y + 1}};
        for (const auto& corner : at) {
          if (spec.indexed) {
            corners.push_back(corner[1] * width + corner[0]);
          } else {
            add_vertex(corner[0], corner[1]);
          }
        }
      }
    }
    tools::GltfPrimitive out = primitive(points, corners);
    out.material = material;
    if (spec.uv) out.attributes.emplace_back("TEXCOORD_0", floats(uvs, tools::GltfType::kVec2));
    if (spec.color || spec.white) out.attributes.emplace_back("COLOR_0", floats(colors, tools::GltfType::kVec4));
    if (spec.normal) out.attributes.emplace_back("NORMAL", floats(normals, tools::GltfType::kVec3));
    return out;
  }

  /// Adds a texture with the bytes of an image file.
  tools::GltfTexture texture(const std::string& name, format::ImageCodec codec, std::span<const std::byte> bytes) {
    const uint32_t image = must(writer_.add_image(name, codec, bytes));
    return {.image = image};
  }

  /// Adds a material with such a texture.
  uint32_t textured(const std::string& name, format::ImageCodec codec, std::span<const std::byte> bytes) {
    return writer_.add_material({.texture = writer_.add_texture(texture(name, codec, bytes))});
  }

  /// Adds a material with tests/data/checker.png.
  uint32_t checker(const std::string& name = "checker") {
    return textured(name, format::ImageCodec::kPng, read_bytes(data_path("checker.png")));
  }

  uint32_t mesh(const std::string& name, std::vector<tools::GltfPrimitive> primitives) {
    return writer_.add_mesh({.name = name, .primitives = std::move(primitives)});
  }

  /// Adds a root node that draws `mesh` at a position.
  uint32_t node(const std::string& name, uint32_t mesh, std::array<double, 3> place = {0, 0, 0}) {
    tools::GltfNode out{.name = name, .mesh = mesh};
    for (size_t i = 0; i < 3; ++i) out.local[i] = place[i];
    const uint32_t number = writer_.add_node(out);
    roots_.push_back(number);
    return number;
  }

  /// Adds a mesh, and a root node of the same name that draws it at a position.
  uint32_t draw(const std::string& name, std::vector<tools::GltfPrimitive> primitives,
                std::array<double, 3> place = {0, 0, 0}) {
    return node(name, mesh(name, std::move(primitives)), place);
  }

  void finish(bool with_scene = true) {
    if (with_scene) writer_.add_scene({.name = "all", .nodes = roots_});
    must(writer_.finish());
  }

 private:
  static tools::GltfWriter open(const std::string& path) { return must(tools::GltfWriter::create(path)); }

  uint32_t view(std::span<const std::byte> bytes, tools::GltfTarget target) {
    return writer_.add_buffer_view({must(writer_.append(bytes)), bytes.size(), 0, target});
  }

  tools::GltfWriter writer_;
  std::vector<uint32_t> roots_;
};

/// Writes a file that fill(maker) fills.
template <std::invocable<ModelMaker&> Fill>
void make_model(const std::string& path, const Fill& fill) {
  ModelMaker maker(path);
  fill(maker);
  maker.finish();
}

/// Writes a file with one node and one mesh, a grid.
inline void make_model(const std::string& path, const GridSpec& spec) {
  make_model(path, [&](ModelMaker& maker) { maker.node("node", maker.mesh("mesh", {maker.grid(spec)})); });
}

/// Writes a file with one node and one mesh of these triangles.
inline void make_model(const std::string& path, const std::vector<float>& points, const std::vector<uint32_t>& corners,
                       std::array<double, 3> place = {0, 0, 0}) {
  make_model(path, [&](ModelMaker& maker) {
    maker.node("node", maker.mesh("mesh", {maker.primitive(points, corners)}), place);
  });
}

/// A strip of `side` squares per side, with its triangles in random order. It is sorted if it exceeds a window.
inline tools::GltfPrimitive shuffled_squares(ModelMaker& maker, uint32_t side) {
  std::vector<float> points;
  for (uint32_t y = 0; y <= side; ++y)
    for (uint32_t x = 0; x <= side; ++x)
      points.insert(points.end(), {static_cast<float>(x), static_cast<float>(x * y % 7), static_cast<float>(y)});
  std::vector<uint32_t> squares(size_t{side} * side), corners;
  std::iota(squares.begin(), squares.end(), 0u);
  std::shuffle(squares.begin(), squares.end(), std::mt19937(7));
  for (const uint32_t square : squares) {
    const uint32_t at = square / side * (side + 1) + square % side, below = at + side + 1;
    corners.insert(corners.end(), {at, below, at + 1, at + 1, below, below + 1});
  }
  return maker.primitive(points, corners);
}

/// Grids with every attribute, without an index buffer, and flat.
inline void make_grids(const std::string& path) {
  ModelMaker maker(path);
  const GridSpec all{.columns = 60, .rows = 40, .uv = true, .color = true, .normal = true};
  GridSpec loose = all;  // no index buffer, far from the origin
  loose.columns = 31;
  loose.indexed = false;
  loose.origin = {1000, -3, 0.25f};
  maker.draw("a", {maker.grid(all), maker.grid({.size = 30, .flat = true})});
  maker.draw("b", {maker.grid(loose)}, {5, 0, 0});
  maker.finish();
}

}  // namespace scree::tests
