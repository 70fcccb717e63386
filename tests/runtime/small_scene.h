// Small .scree files for the tests of runtime/ and of `scree render`, written without glTF.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <unistd.h>

#include "format/container/container.h"
#include "format/geometry/attribute_codec.h"
#include "format/geometry/chunk_layout.h"
#include "format/geometry/index_codec.h"
#include "format/geometry/position_codec.h"
#include "runtime/images/png_writer.h"
#include "tests/format/geometry/index_range.h"
#include "tests/results.h"
#include "tests/tools/temp_folder.h"

namespace scree::tests {

/// A PNG of 2 x 2 texels: red and green over blue and white.
inline std::vector<std::byte> four_colors_png() {
  const std::vector<uint8_t> pixels{255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255};
  return must(runtime::encode_png({2, 2, 3, pixels}));
}

/// The tables and pages of a file: a quad of two triangles from (-1, -1, 0) to (1, 1, 0) that faces +z. Its source
/// triangles are 70 and 71. Its texture has four colours, with the texture's top row at the quad's top. Node 1, named
/// "Quad", draws it below node 0. `change` may alter the tables before they are written.
struct SmallScene {
  int zstd_level = 0;
  bool nearest = true;
  std::function<void(format::TableSet&)> change;

  void write(const std::string& path) const {
    format::TableSet tables;
    format::ContainerWriter writer = must(format::ContainerWriter::create(path));

    const std::vector<uint32_t> indices{0, 1, 2, 0, 2, 3};
    const std::vector<float> positions{-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0};
    const std::vector<float> uvs{0, 1, 1, 1, 1, 0, 0, 0};
    const std::vector<uint64_t> sources{70, 71};
    const float lo[3] = {-1, -1, 0}, hi[3] = {1, 1, 0};
    const format::MeshLattice lattice = must(format::choose_lattice(lo, hi, 16, 0));
    std::vector<uint32_t> coordinates(positions.size());
    format::quantize_positions(coordinates, positions, lattice);
    const format::IndexRange index_range = scree::tests::index_range(indices);
    const format::PositionRange position_range = format::position_range(coordinates);
    const format::UvRange uv_range = format::choose_uv_range(uvs);
    const format::SourceIdRange source_range = format::source_id_range(sources);

    format::MeshRecord mesh{.triangle_count = 2, .vertex_count = 4, .source_vertex_count = 4, .chunk_count = 1};
    format::ChunkRecord chunk{};
    for (size_t i = 0; i < 3; ++i) {
      mesh.lattice_min[i] = lattice.min[i];
      mesh.lattice_bits[i] = lattice.bits[i];
      mesh.bounds_min[i] = lo[i];
      mesh.bounds_max[i] = hi[i];
      chunk.position_min[i] = position_range.min[i];
      chunk.position_bits[i] = position_range.bits[i];
    }
    mesh.lattice_exponent = lattice.exponent;
    mesh.max_position_error = lattice.max_error;
    mesh.attributes = format::kHasUv | format::kHasSourceIds;
    chunk.page = 0;
    chunk.triangle_count = 2;
    chunk.vertex_count = 4;
    chunk.index_min = index_range.min;
    chunk.index_bits = static_cast<uint8_t>(index_range.bits);
    chunk.uv_exponent = uv_range.exponent;
    for (size_t i = 0; i < 2; ++i) {
      chunk.uv_min[i] = uv_range.min[i];
      chunk.uv_bits[i] = uv_range.bits[i];
    }
    chunk.source_min = source_range.min;
    chunk.source_bits = static_cast<uint8_t>(source_range.bits);
    const format::ChunkStreams streams = format::chunk_streams(mesh, chunk);
    chunk.bytes = streams.bytes;
    std::vector<std::byte> payload(streams.bytes);
    const auto stream = [&](const format::ChunkStream& place) {
      return std::span<std::byte>(payload).subspan(place.offset, place.bytes);
    };
    format::encode_indices(stream(streams.indices), indices, index_range);
    format::encode_positions(stream(streams.positions), coordinates, position_range);
    format::encode_uvs(stream(streams.uvs), uvs, uv_range);
    format::encode_source_ids(stream(streams.source_ids), sources, source_range);
    REQUIRE(writer.append(format::seal_page(format::PageKind::kGeometry, std::move(payload), zstd_level)));
    REQUIRE(writer.append(format::seal_page(format::PageKind::kImage, four_colors_png(), 0)));

    tables.meshes.push_back(mesh);
    tables.chunks.push_back(chunk);
    tables.groups.push_back({tables.strings.add("Quad mesh"), 0, 1, 0});
    tables.images.push_back(
        {0, 1, format::ImageCodec::kPng, 2, 2, 3, format::BlockFormat::kNoBlocks, 0, format::kNone, 0});
    tables.textures.push_back(
        {0, 0, format::Wrap::kClamp, format::Wrap::kClamp, static_cast<uint16_t>(nearest ? 9728 : 9729), 0});
    format::MaterialRecord material{.texture = 0};
    for (float& factor : material.base_color) factor = 1;
    material.uv_scale[0] = material.uv_scale[1] = 1;
    material.flags = format::kMaterialUnlit;
    tables.materials.push_back(material);
    tables.nodes.push_back(node(tables, "Root", format::kNone, format::kNone, format::kNone));
    tables.nodes.push_back(node(tables, "Quad", 0, 0, format::kNone));
    tables.matrices.push_back(identity());
    tables.instances.push_back({0, 1, 0, 0});
    tables.scene_roots.push_back(0);
    tables.scenes.push_back({tables.strings.add("Main"), 1, 0, 1, 0, 1, 2});
    if (change) change(tables);
    REQUIRE(writer.finish(tables));
  }

  static format::MatrixRecord identity() {
    format::MatrixRecord matrix{};
    for (size_t i = 0; i < 3; ++i) matrix.rows[i][i] = 1;
    return matrix;
  }

  /// A node without a transform.
  static format::NodeRecord node(format::TableSet& tables, const char* name, uint32_t parent, uint32_t group,
                                 uint32_t camera) {
    format::NodeRecord record{};
    record.name = tables.strings.add(name);
    record.parent = parent;
    record.group = group;
    record.camera = camera;
    record.local[6] = 1;  // rotation w
    for (size_t i = 7; i < 10; ++i) record.local[i] = 1;
    return record;
  }
};

}  // namespace scree::tests
