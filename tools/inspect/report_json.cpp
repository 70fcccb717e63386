#include <ranges>
#include <string>

#include "format/blocks/format.h"
#include "format/geometry/quantize.h"
#include "tools/common/output/json_writer.h"
#include "tools/compare/report.h"
#include "tools/inspect/report.h"

namespace scree::inspect {
namespace {

using tools::JsonWriter;

const char* codec_name(format::ImageCodec codec) {
  if (codec == format::ImageCodec::kIndexedJpeg) return "indexed_jpeg";
  if (codec == format::ImageCodec::kBlocks) return "blocks";
  return codec == format::ImageCodec::kJpeg ? "jpeg" : "png";
}

/// 0 to `count` - 1.
auto numbers_below(uint64_t count) {
  return std::views::iota(uint64_t{0}, count);
}

/// Ratios to zero are left out, because JSON cannot express them.
void ratio(JsonWriter& json, const char* name, uint64_t part, uint64_t whole) {
  if (whole != 0) json.member(name, static_cast<double>(part) / static_cast<double>(whole));
}

/// "bytes", "raw_bytes" and the ratios of one kind of content. `source`, `reference`: 0 if there is none.
void cost(JsonWriter& json, const Stats& stats, const Cost& bytes, uint64_t source, uint64_t reference) {
  json.member("bytes", bytes.stored);
  json.member("raw_bytes", bytes.raw);
  ratio(json, "share", bytes.stored, stats.file_bytes);
  ratio(json, "bits_per_triangle", 8 * bytes.stored, stats.triangles);
  if (source != 0) json.member("source_bytes", source);
  ratio(json, "source_ratio", bytes.stored, source);
  if (reference != 0) json.member("float32_bytes", reference);
  ratio(json, "float32_ratio", bytes.stored, reference);
}

void spread(JsonWriter& json, const char* name, const Spread& values) {
  json.object(name, [&] {
    json.member("min", values.min);
    json.member("median", values.median);
    json.member("max", values.max);
  });
}

void file_member(JsonWriter& json, const format::Container& file, const Stats& stats, const std::string& path) {
  const format::SourceRecord& source = file.source();
  json.object("file", [&] {
    json.member("path", path);
    json.member("bytes", stats.file_bytes);
    json.member("version_major", uint64_t{file.header().version_major});
    json.member("version_minor", uint64_t{file.header().version_minor});
    json.member("generator", file.string(source.generator));
    json.member("options", file.string(source.options));
    json.member("copyright", file.string(source.copyright));
  });
  json.line();

  json.object("source", [&] {
    json.member("name", file.string(source.name));
    json.member("json_bytes", source.json_bytes);
    json.member("buffer_bytes", source.buffer_bytes);
    json.member("file_bytes", source.file_bytes);
    json.member("index_bytes", source.index_bytes);
    json.member("position_bytes", source.position_bytes);
    json.member("attribute_bytes", source.attribute_bytes);
  });
  json.line();
}

void size_member(JsonWriter& json, const format::Container& file, const Stats& stats) {
  const format::SourceRecord& source = file.source();
  json.object("size", [&] {
    uint64_t reference = stats.images.raw;
    for (size_t i = 0; i < kStreamCount; ++i) {
      const auto stream = static_cast<Stream>(i);
      json.object(stream_key(stream), [&] {
        // The source's attribute bytes are a single sum, the member "attributes".
        const bool is_mixed = stats.stream_meshes[kIndices] != 0 && stats.stream_meshes[kClusterData] != 0;
        const uint64_t source_of = is_mixed || stats.stream_meshes[i] == 0 ? 0
                                   : stream == kIndices                    ? source.index_bytes
                                   : stream == kPositions                  ? source.position_bytes
                                   : stream == kClusterData                ? source.index_bytes + source.position_bytes
                                                                           : 0;
        cost(json, stats, stats.streams[i], source_of, stats.reference_bytes[i]);
      });
      reference += stats.reference_bytes[i];
    }
    json.object("textures", [&] { cost(json, stats, stats.images, 0, 0); });
    json.object("container", [&] { cost(json, stats, {stats.container_bytes(), stats.container_bytes()}, 0, 0); });
    json.object("total", [&] {
      json.member("bytes", stats.file_bytes);
      ratio(json, "bits_per_triangle", 8 * stats.file_bytes, stats.triangles);
      if (source.file_bytes != 0) json.member("source_bytes", source.file_bytes);
      ratio(json, "source_ratio", stats.file_bytes, source.file_bytes);
      if (reference != 0) json.member("float32_bytes", reference);
      ratio(json, "float32_ratio", stats.file_bytes, reference);
    });
  });
  json.line();
}

void scene_member(JsonWriter& json, const format::Container& file, const Stats& stats) {
  json.object("scene", [&] {
    json.member("nodes", file.nodes().size());
    json.member("groups", file.groups().size());
    json.member("meshes", file.meshes().size());
    json.member("instances", file.instances().size());
    json.member("node_instances", file.node_instances().size());
    json.member("matrices", file.matrices().size());
    json.member("materials", file.materials().size());
    json.member("textures", file.textures().size());
    json.member("images", file.images().size());
    json.member("cameras", file.cameras().size());
    json.objects("scenes", numbers_below(file.scenes().size()), [&](uint64_t i) {
      const format::SceneRecord& scene = file.scenes()[i];
      json.member("name", file.string(scene.name));
      json.member("default", (scene.flags & 1) != 0);
      json.member("roots", scene.root_count);
      json.member("instances", scene.instance_count);
      json.member("triangles_drawn", scene.triangle_count);
      if (!stats.extents[i].box.is_empty()) {
        json.array("min", stats.extents[i].box.min);
        json.array("max", stats.extents[i].box.max);
      }
      json.member("max_position_error", stats.extents[i].max_position_error);
    });
  });
  json.line();
}

void meshes_member(JsonWriter& json, const format::Container& file, const Stats& stats) {
  json.object("meshes", [&] {
    json.member("count", file.meshes().size());
    json.member("triangles", stats.triangles);
    json.member("vertices", stats.vertices);
    json.member("source_vertices", stats.source_vertices);
    json.member("bytes", stats.geometry_bytes());
    json.member("max_position_error", stats.max_position_error);
    spread(json, "triangles_each", stats.mesh_triangles);
    json.objects("top", stats.top_meshes, [&](const MeshCost& entry) {
      const format::MeshRecord& mesh = file.meshes()[entry.mesh];
      json.member("mesh", entry.mesh);
      json.member("name", file.string(file.groups()[mesh.group].name));
      json.member("group", mesh.group);
      json.member("bytes", entry.stored);
      json.member("triangles", mesh.triangle_count);
      json.member("vertices", mesh.vertex_count);
      json.member("source_vertices", mesh.source_vertex_count);
      json.member("chunks", mesh.chunk_count);
      const bool is_float32 = mesh.position_encoding == format::PositionEncoding::kFloat32;
      json.member("float32", is_float32);
      if (!is_float32) json.member("step", format::exp2i(mesh.lattice_exponent));
      json.member("max_position_error", mesh.max_position_error);
      json.member("max_uv_error", static_cast<double>(mesh.max_uv_error));
    });
  });
  json.line();
}

void chunks_member(JsonWriter& json, const format::Container& file, const Stats& stats) {
  json.object("chunks", [&] {
    json.member("count", file.chunks().size());
    spread(json, "triangles_each", stats.chunk_triangles);
    spread(json, "vertices_each", stats.chunk_vertices);
    spread(json, "bytes_each", stats.chunk_bytes);
    json.member("pages", stats.pages);
    json.member("geometry_pages", stats.geometry_pages);
    json.member("compressed_pages", stats.compressed_pages);
  });
  json.line();

  json.key("index_bits");
  json.begin_array();
  for (size_t bits = 0; bits < stats.index_bits.size(); ++bits) {
    const IndexBits& row = stats.index_bits[bits];
    if (row.chunks == 0) continue;
    json.object([&] {
      json.member("bits", uint64_t{bits});
      json.member("chunks", row.chunks);
      json.member("triangles", row.triangles);
    });
  }
  json.end_array();
  json.line();

  const ClusterStats& clusters = stats.clusters;
  json.object("clusters", [&] {
    json.member("chunks", clusters.chunks);
    json.member("count", clusters.clusters);
    json.member("triangles", clusters.triangles);
    json.member("vertices", clusters.vertices);
    if (stats.has_split) json.member("predicted", clusters.predicted);
    json.member("bounds_bytes", clusters.bytes[kClusterBounds]);
    json.member("record_bytes", clusters.bytes[kClusterRecords]);
    json.member("data_bytes", clusters.bytes[kIndices] + clusters.bytes[kPositions] + clusters.bytes[kClusterData]);
    if (stats.has_split) {
      json.member("index_bytes", clusters.bytes[kIndices]);
      json.member("position_bytes", clusters.bytes[kPositions]);
    }
    uint64_t attributes = clusters.bytes[kSourceIds];
    for (const Stream attribute : kAttributes) attributes += clusters.bytes[attribute];
    json.member("attribute_bytes", attributes);
  });
  json.line();

  json.objects("position_steps", stats.lattices, [&](const LatticeStats& lattice) {
    json.member("float32", lattice.is_float32);
    if (!lattice.is_float32) {
      json.member("step", format::exp2i(lattice.exponent));
      json.key("exponent");
      json.value(static_cast<double>(lattice.exponent));
    }
    json.member("meshes", lattice.meshes);
    json.member("triangles", lattice.triangles);
    json.member("vertices", lattice.vertices);
    json.member("bytes", lattice.stored);
    json.member("max_error", lattice.max_error);
  });
  json.line();
}

void attributes_member(JsonWriter& json, const format::Container& file, const Stats& stats) {
  json.object("attributes", [&] {
    const uint64_t source = file.source().attribute_bytes;
    json.member("bytes", stats.attribute_bytes());
    if (source != 0) json.member("source_bytes", source);
    ratio(json, "source_ratio", stats.attribute_bytes(), source);
    for (const Stream stream : {kUvs, kSecondUvs, kColors, kNormals, kTangents, kSourceIds}) {
      json.object(stream_key(stream), [&] {
        json.member("meshes", stats.stream_meshes[stream]);
        json.member(stream == kSourceIds ? "triangles" : "vertices", stats.stream_elements[stream]);
        json.member("bytes", stats.streams[stream].stored);
        if (stream == kUvs || stream == kSecondUvs) json.member("max_error", stats.max_uv_error);
        if (stream == kNormals) json.member("min_bits", stats.min_normal_bits);
        if (stream == kTangents) json.member("min_bits", stats.min_tangent_bits);
      });
    }
  });
  json.line();
}

void textures_member(JsonWriter& json, const format::Container& file, const Stats& stats) {
  json.object("textures", [&] {
    json.member("count", file.textures().size());
    json.member("images", file.images().size());
    json.member("mip_levels", stats.mip_levels);
    json.member("mip_level_bytes", stats.level_bytes);
    json.member("masks", stats.masks);
    json.member("mask_bytes", stats.mask_pages.stored);
    json.member("mask_memory_bytes", stats.mask_pages.raw);
    json.member("opaque_masks", stats.opaque_masks);
    json.member("blended_materials", stats.blended);
    for (const format::ImageCodec codec : {format::ImageCodec::kIndexedJpeg, format::ImageCodec::kBlocks,
                                           format::ImageCodec::kJpeg, format::ImageCodec::kPng}) {
      const ImageStats& kind = stats.image_kinds[static_cast<size_t>(codec)];
      json.object(codec_name(codec), [&] {
        json.member("images", kind.images);
        json.member("pixels", kind.pixels);
        json.member("bytes", kind.cost.stored);
      });
    }
    json.objects("top", stats.top_images, [&](const uint32_t number) {
      const format::ImageRecord& image = file.images()[number];
      json.member("image", number);
      json.member("name", file.string(image.name));
      json.member("codec", codec_name(image.codec));
      if (image.codec == format::ImageCodec::kBlocks)
        json.member("block_format", format::block_format_name(image.block_format));
      json.member("width", image.width);
      json.member("height", image.height);
      json.member("channels", uint32_t{image.channels});
      json.member("bytes", image_bytes(file, number));
    });
  });
  json.line();
}

void container_member(JsonWriter& json, const format::Container& file, const Stats& stats) {
  json.object("container", [&] {
    json.member("bytes", stats.container_bytes());
    json.member("header_bytes", stats.header_bytes);
    json.member("toc_bytes", stats.toc_bytes);
    json.member("page_gap_bytes", stats.page_gaps.stored);
    json.member("other_page_bytes", stats.other_pages);
    json.member("padding_bytes", stats.padding_bytes);
    json.objects("tables", stats.tables, [&](const TableCost& table) {
      json.member("name", table.name);
      json.member("kind", static_cast<uint32_t>(table.kind));
      json.member("records", table.records);
      json.member("record_bytes", table.record_bytes);
      json.member("bytes", table.bytes);
    });
  });
  json.line();

  json.objects("left_out", numbers_below(file.left_out().size()), [&](uint64_t i) {
    const format::LeftOutRecord& record = file.left_out()[i];
    json.member("what", file.string(record.what));
    json.member("count", record.count);
    json.member("source_bytes", record.source_bytes);
    // 0 means unknown, or that nothing would have been stored.
    if (!file.left_out_costs().empty() && file.left_out_costs()[i] != 0)
      json.member("stored_bytes", file.left_out_costs()[i]);
  });
}

void verify_member(JsonWriter& json, const VerifyReport& report) {
  json.object("verify", [&] {
    json.member("ok", report.failure_count == 0);
    json.member("tables", report.tables);
    json.member("pages", report.pages);
    json.member("page_bytes", report.page_bytes);
    json.member("raw_bytes", report.raw_bytes);
    json.member("padding_bytes", report.padding_bytes);
    json.member("chunks", report.chunks);
    json.member("triangles", report.triangles);
    json.member("vertices", report.vertices);
    json.member("meshes", report.meshes);
    json.member("images", report.images);
    json.member("pixels", report.pixels);
    json.array("warnings", report.warnings);
    json.member("failure_count", report.failure_count);
    json.objects("failures", report.failures, [&](const Failure& failure) {
      json.member("offset", failure.offset);
      json.member("message", failure.error.message);
    });
  });
}

/// Written in pieces, because a file may have millions of chunks.
void chunk_rows_member(JsonWriter& json, const format::Container& file, std::string& text, std::FILE* out) {
  constexpr size_t kDrainBytes = size_t{1} << 20;
  json.key("chunk_rows");
  json.begin_array();
  const auto chunks = file.chunks();
  for (uint64_t i = 0; i < chunks.size(); ++i) {
    const format::ChunkRecord& chunk = chunks[i];
    const uint32_t attributes = file.meshes()[chunk.mesh].attributes;
    json.line();
    json.begin_object();
    json.member("chunk", i);
    json.member("mesh", chunk.mesh);
    json.member("page", chunk.page);
    json.member("offset", chunk.offset);
    json.member("bytes", chunk.bytes);
    json.member("first_triangle", chunk.first_triangle);
    json.member("triangles", chunk.triangle_count);
    json.member("vertices", chunk.vertex_count);
    if (chunk.encoding == format::ChunkEncoding::kIndexed) {
      json.member("index_bits", uint32_t{chunk.index_bits});
    } else {
      json.member("clusters", chunk.cluster_count);
    }
    json.array("position_bits", chunk.position_bits, [&](const uint8_t bits) { json.value(uint32_t{bits}); });
    if (attributes & format::kHasUv) {
      json.array("uv_bits", chunk.uv_bits, [&](const uint8_t bits) { json.value(uint32_t{bits}); });
    }
    if (attributes & format::kHasNormal) json.member("normal_bits", uint32_t{chunk.normal_bits});
    if (attributes & format::kHasSecondUv) {
      json.array("second_uv_bits", chunk.second_uv_bits, [&](const uint8_t bits) { json.value(uint32_t{bits}); });
    }
    if (attributes & format::kHasTangent) json.member("tangent_bits", uint32_t{chunk.tangent_bits});
    if (attributes & format::kHasSourceIds) json.member("source_bits", uint32_t{chunk.source_bits});
    json.end_object();
    if (text.size() > kDrainBytes) {
      std::fwrite(text.data(), 1, text.size(), out);
      text.clear();
    }
  }
  json.end_array();
}

}  // namespace

void print_json(const format::Container& file, const Stats& stats, const std::string& path, const VerifyReport* verify,
                const compare::GeometryReport* against_source, bool with_chunks, std::FILE* out) {
  std::string text;
  JsonWriter json(text);
  json.begin_object();
  json.line();
  file_member(json, file, stats, path);
  size_member(json, file, stats);
  scene_member(json, file, stats);
  meshes_member(json, file, stats);
  chunks_member(json, file, stats);
  attributes_member(json, file, stats);
  textures_member(json, file, stats);
  container_member(json, file, stats);
  if (verify != nullptr) {
    json.line();
    verify_member(json, *verify);
  }
  if (against_source != nullptr) {
    json.line();
    compare::json_geometry(json, *against_source);
  }
  if (with_chunks) {
    json.line();
    chunk_rows_member(json, file, text, out);
  }
  json.line();
  json.end_object();
  json.line();
  std::fwrite(text.data(), 1, text.size(), out);
}

}  // namespace scree::inspect
