#include "tools/inspect/report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <sstream>
#include <string_view>

#include "format/blocks/format.h"
#include "format/bytes.h"
#include "format/geometry/quantize.h"
#include "tools/common/options/options.h"
#include "tools/common/output/human.h"
#include "tools/common/output/text_table.h"

namespace scree::inspect {
namespace {

using tools::fixed;
using tools::grouped;
using tools::short_number;

constexpr size_t kBarLetters = 40;

/// The footnotes. note('a') returns a reference to the first one.
constexpr const char* kNotes[] = {
    "8 x bytes / stored triangles; a mesh counts once for any number of instances.",
    "bytes / bytes of the same content in the source: the used accessors, each once; for the file: document, buffers\n"
    "      and images.",
    "bytes / bytes of the same content without packing: 12 per triangle (32-bit indices), 12 per position, 12 per\n"
    "      normal, 8 per texture coordinate, 16 per colour (float32); per mesh for the source's or the stored number\n"
    "      of vertices, whichever is smaller; images unchanged.",
    "A mesh is a glTF primitive: triangles with one material.",
    "A vertex on the border of chunks is stored in each of them; a vertex that no triangle uses is not stored.",
    "Positions are whole multiples of the step, in model units (before the nodes' transforms).",
    "The largest distance between a stored and a source coordinate, per axis: half a step and half an ulp, 0 for\n"
    "      float32. In model units; for a scene in world units.",
    "The stored bytes of a compressed page are divided among its streams in proportion to their raw bytes.",
    "A chunk's indices are stored as differences from the smallest one, all with the bits of the largest difference.",
    "Estimated without encoding, before compression; -: unknown (as for duplicate vertices in clusters), or nothing."};

/// A reference to a note, lettered by add_footnotes(). It is a control character, which printable() removes from all
/// names.
constexpr char kFirstNote = 0x0e;
std::string note(char letter) {
  return {'[', static_cast<char>(kFirstNote + letter - 'a'), ']'};
}

/// "812 B", "1.46 MiB": short, because columns are narrow.
std::string human_bytes(uint64_t bytes) {
  return bytes < 1024 ? std::to_string(bytes) + " B" : tools::format_bytes(bytes);
}

double divided(uint64_t a, uint64_t b) {
  return b == 0 ? 0 : static_cast<double>(a) / static_cast<double>(b);
}

/// "31.2%", or "-" if there is nothing to compare with.
std::string percent(uint64_t part, uint64_t whole) {
  if (whole == 0) return "-";
  const double value = 100.0 * divided(part, whole);
  return fixed(value, value < 999.95 ? 1 : 0) + "%";
}

std::string bits_each(uint64_t bytes, uint64_t count) {
  return count == 0 ? "-" : fixed(8.0 * divided(bytes, count), 2);
}

std::string times(uint64_t count, const char* one, const char* many) {
  return grouped(count) + " " + (count == 1 ? one : many);
}

std::string bar(uint64_t part, uint64_t most) {
  if (part == 0 || most == 0) return "";
  return std::string(std::max<size_t>(1, static_cast<size_t>(std::lround(divided(part, most) * kBarLetters))), '#');
}

std::string step_text(const LatticeStats& lattice) {
  if (lattice.is_float32) return "float32";
  return "2^" + std::to_string(lattice.exponent) + " = " + short_number(format::exp2i(lattice.exponent));
}

std::string step_of(const format::MeshRecord& mesh) {
  if (mesh.position_encoding == format::PositionEncoding::kFloat32) return "float32";
  return "2^" + std::to_string(mesh.lattice_exponent);
}

void add_head(const format::Container& file, const Stats& stats, const std::string& path, std::string& text) {
  const format::FileHeader& header = file.header();
  const format::SourceRecord& source = file.source();
  text += printable(path, 400) + ": " + human_bytes(stats.file_bytes) + " (" + grouped(stats.file_bytes) + " bytes)\n";
  TextTable table(2);
  table.row({"format", std::to_string(header.version_major) + "." + std::to_string(header.version_minor)});
  const auto add = [&](const char* what, uint32_t offset) {
    if (const std::string_view value = file.string(offset); !value.empty()) table.row({what, printable(value, 400)});
  };
  add("written by", source.generator);
  add("from", source.name);
  add("options", source.options);
  add("copyright", source.copyright);
  text += table.text();
}

void add_size(const format::Container& file, const Stats& stats, std::string& text) {
  const format::SourceRecord& source = file.source();
  TextTable table;
  const auto row = [&](const char* what, uint64_t bytes, uint64_t source_of, uint64_t reference) {
    table.row({what, human_bytes(bytes), percent(bytes, stats.file_bytes), bits_each(bytes, stats.triangles),
               percent(bytes, source_of), percent(bytes, reference)});
  };
  const auto stream = [&](Stream which, uint64_t source_of) {
    if (stats.stream_meshes[which] != 0)
      row(stream_title(which), stats.streams[which].stored, source_of, stats.reference_bytes[which]);
  };
  table.row({"", "bytes", "share", "bits/tri " + note('a'), "of source " + note('b'), "of float32 " + note('c')});
  // The source's bytes are not known for part of the triangles.
  const bool is_mixed = stats.stream_meshes[kIndices] != 0 && stats.stream_meshes[kClusterData] != 0;
  stream(kIndices, is_mixed ? 0 : source.index_bytes);
  stream(kPositions, is_mixed ? 0 : source.position_bytes);
  stream(kClusterData, is_mixed ? 0 : source.index_bytes + source.position_bytes);
  stream(kClusterBounds, 0);
  stream(kClusterRecords, 0);
  uint64_t attribute_reference = 0;
  for (const Stream attribute : kAttributes) attribute_reference += stats.reference_bytes[attribute];
  if (attribute_reference != 0) row("attributes", stats.attribute_bytes(), source.attribute_bytes, attribute_reference);
  stream(kSourceIds, 0);
  if (!file.images().empty()) row("textures", stats.images.stored, 0, 0);
  row("container", stats.container_bytes(), 0, 0);
  table.rule();
  uint64_t reference = stats.images.raw;
  for (const uint64_t bytes : stats.reference_bytes) reference += bytes;
  row("file", stats.file_bytes, source.file_bytes, reference);
  text += "\nSize\n" + table.text();
}

/// "-1.2 0 3.5".
std::string point_text(const runtime::Vec3& point) {
  return short_number(point[0]) + " " + short_number(point[1]) + " " + short_number(point[2]);
}

void add_scenes(const format::Container& file, const Stats& stats, std::string& text) {
  text += "\nScene\n";
  TextTable counts(2);
  counts.row({"nodes", grouped(file.nodes().size()), "glTF meshes", grouped(file.groups().size())});
  counts.row({"primitives", grouped(file.meshes().size()), "materials", grouped(file.materials().size())});
  counts.row({"textures", grouped(file.textures().size()), "images", grouped(file.images().size())});
  counts.row({"cameras", grouped(file.cameras().size()), "world matrices", grouped(file.matrices().size())});
  text += counts.text();
  TextTable table;
  table.row({"scene", "roots", "instances", "triangles drawn", "from x y z", "to x y z", "error " + note('g')});
  const auto scenes = file.scenes();
  for (uint64_t i = 0; i < scenes.size(); ++i) {
    const std::string_view name = file.string(scenes[i].name);
    std::string label = std::to_string(i);
    if (!name.empty()) label += " " + printable(name);
    if (scenes[i].flags & 1) label += " (default)";
    const SceneExtent& extent = stats.extents[i];
    const bool is_empty = extent.box.is_empty();
    table.row({label, grouped(scenes[i].root_count), grouped(scenes[i].instance_count),
               grouped(scenes[i].triangle_count), is_empty ? "-" : point_text(extent.box.min),
               is_empty ? "-" : point_text(extent.box.max), short_number(extent.max_position_error)});
  }
  if (!scenes.empty()) text += table.text();
}

std::string spread(const Spread& values, uint64_t sum, uint64_t count, bool in_bytes) {
  const auto show = [&](uint64_t value) { return in_bytes ? human_bytes(value) : grouped(value); };
  return "least " + show(values.min) + ", median " + show(values.median) + ", mean " +
         show(count == 0 ? 0 : static_cast<uint64_t>(std::llround(divided(sum, count)))) + ", most " + show(values.max);
}

void add_meshes(const format::Container& file, const Stats& stats, std::string& text) {
  const auto meshes = file.meshes();
  text += "\nMeshes\n  " + times(meshes.size(), "mesh", "meshes") + " " + note('d') + ", " +
          times(stats.triangles, "triangle", "triangles") + ", " + times(stats.vertices, "vertex", "vertices") +
          " stored, " + grouped(stats.source_vertices) + " in the source " + note('e') + "\n";
  if (meshes.empty()) return;
  text += "  triangles per mesh: " + spread(stats.mesh_triangles, stats.triangles, meshes.size(), false) + "\n";
  if (stats.top_meshes.empty()) return;
  TextTable table;
  table.row({"largest by bytes", "bytes", "share", "triangles", "vertices", "chunks", "bits/tri", "step " + note('f'),
             "max error " + note('g')});
  const auto row = [&](std::string name, uint64_t bytes, uint64_t triangles, uint64_t vertices, uint64_t chunks,
                       std::string step, std::string error) {
    table.row({std::move(name), human_bytes(bytes), percent(bytes, stats.file_bytes), grouped(triangles),
               grouped(vertices), grouped(chunks), bits_each(bytes, triangles), std::move(step), std::move(error)});
  };
  uint64_t bytes = stats.geometry_bytes(), triangles = stats.triangles, vertices = stats.vertices,
           chunks = file.chunks().size();
  for (const MeshCost& cost : stats.top_meshes) {
    const format::MeshRecord& mesh = meshes[cost.mesh];
    row(printable(mesh_name(file, cost.mesh), 32), cost.stored, mesh.triangle_count, mesh.vertex_count,
        mesh.chunk_count, step_of(mesh), short_number(mesh.max_position_error));
    bytes -= cost.stored;
    triangles -= mesh.triangle_count;
    vertices -= mesh.vertex_count;
    chunks -= mesh.chunk_count;
  }
  const uint64_t others = meshes.size() - stats.top_meshes.size();
  if (others != 0) row(times(others, "other", "others"), bytes, triangles, vertices, chunks, "", "");
  table.rule();
  row("all", stats.geometry_bytes(), stats.triangles, stats.vertices, file.chunks().size(), "",
      short_number(stats.max_position_error));
  text += table.text();
}

void add_chunks(const format::Container& file, const Stats& stats, std::string& text) {
  const uint64_t chunks = file.chunks().size();
  if (chunks == 0) return;
  uint64_t payload = 0;
  for (const Cost& cost : stats.streams) payload += cost.raw;
  text += "\nChunks\n";
  TextTable table(2);
  table.row({"chunks", grouped(chunks)});
  table.row({"triangles each", spread(stats.chunk_triangles, stats.triangles, chunks, false)});
  table.row({"vertices each", spread(stats.chunk_vertices, stats.vertices, chunks, false)});
  table.row({"bytes each", spread(stats.chunk_bytes, payload, chunks, true)});
  table.row({"vertices per triangle", fixed(divided(stats.vertices, stats.triangles), 3)});
  std::string pages = times(stats.geometry_pages, "of geometry", "of geometry") + ", " +
                      times(stats.pages - stats.geometry_pages, "other", "others");
  if (stats.compressed_pages != 0) {
    pages += ", " + grouped(stats.compressed_pages) + " compressed: geometry " + human_bytes(payload) + " -> " +
             human_bytes(stats.geometry_bytes()) + " (" + percent(stats.geometry_bytes(), payload) + ") " + note('h');
  }
  table.row({"pages", pages});
  text += table.text();
}

void add_indices(const Stats& stats, std::string& text) {
  const Cost& cost = stats.streams[kIndices];
  if (stats.stream_elements[kIndices] == 0) return;
  text += "\nIndices\n  " + human_bytes(cost.stored) + ", " + bits_each(cost.stored, stats.stream_elements[kIndices]) +
          " bits per index, " + bits_each(cost.stored, stats.triangles) + " bits per triangle\n";
  if (stats.clusters.triangles == stats.triangles) return;
  uint64_t most = 0;
  for (const IndexBits& bits : stats.index_bits) most = std::max(most, bits.triangles);
  TextTable table(0);
  table.row({"bits " + note('i'), "chunks", "triangles", "share"});
  std::vector<std::string> tails{""};
  for (size_t bits = 0; bits < stats.index_bits.size(); ++bits) {
    const IndexBits& row = stats.index_bits[bits];
    if (row.chunks == 0) continue;
    table.row(
        {std::to_string(bits), grouped(row.chunks), grouped(row.triangles), percent(row.triangles, stats.triangles)});
    tails.push_back(bar(row.triangles, most));
  }
  // The bars are appended after the columns, flush left.
  std::istringstream columns(table.text());
  std::string line;
  for (const std::string& tail : tails) {
    std::getline(columns, line);
    text += line + (tail.empty() ? "" : "  ") + tail + '\n';
  }
}

void add_clusters(const Stats& stats, std::string& text) {
  const ClusterStats& clusters = stats.clusters;
  if (clusters.clusters == 0) return;
  const auto each = [](uint64_t count, uint64_t of) { return fixed(divided(count, of), 2); };
  text += "\nClusters\n  " + grouped(clusters.clusters) + " in " + times(clusters.chunks, "chunk", "chunks") + ", " +
          each(clusters.triangles, clusters.clusters) + " triangles and " + each(clusters.vertices, clusters.clusters) +
          " vertices each";
  if (stats.has_split) text += "; an axis is predicted in " + percent(clusters.predicted, clusters.clusters);
  text += "\n";
  const auto& bytes = clusters.bytes;
  uint64_t attributes = bytes[kSourceIds];
  for (const Stream attribute : kAttributes) attributes += bytes[attribute];
  const uint64_t data = bytes[kIndices] + bytes[kPositions] + bytes[kClusterData];
  const uint64_t geometry = bytes[kClusterBounds] + bytes[kClusterRecords] + data;
  TextTable table;
  std::vector<std::string> titles{"bytes per triangle, unpacked", "bounds", "records"};
  std::vector<uint64_t> columns{bytes[kClusterBounds], bytes[kClusterRecords]};
  if (stats.has_split) {
    titles.insert(titles.end(), {"indices", "positions"});
    columns.insert(columns.end(), {bytes[kIndices], bytes[kPositions]});
  } else {
    titles.emplace_back("indices, positions");
    columns.push_back(data);
  }
  titles.insert(titles.end(), {"sum", "attributes"});
  columns.insert(columns.end(), {geometry, attributes});
  std::vector<std::string> cells{""};
  for (const uint64_t column : columns) cells.push_back(each(column, clusters.triangles));
  table.row(titles);
  table.row(cells);
  text += table.text();
}

void add_positions(const Stats& stats, std::string& text) {
  if (stats.vertices == 0) return;
  const Cost& cost = stats.streams[kPositions];
  const bool is_known = stats.stream_meshes[kClusterData] == 0;
  text += "\nPositions\n  ";
  if (is_known)
    text += human_bytes(cost.stored) + ", " + bits_each(cost.stored, stats.vertices) + " bits per vertex, " +
            bits_each(cost.stored, stats.triangles) + " bits per triangle, ";
  text += "error at most " + short_number(stats.max_position_error) + " model units " + note('g') + "\n";
  TextTable table;
  table.row({"step " + note('f'), "meshes", "triangles", "vertices", "bits/vertex", "max error " + note('g')});
  for (const LatticeStats& lattice : stats.lattices) {
    table.row({step_text(lattice), grouped(lattice.meshes), grouped(lattice.triangles), grouped(lattice.vertices),
               is_known ? bits_each(lattice.stored, lattice.vertices) : "-", short_number(lattice.max_error)});
  }
  text += table.text();
}

void add_attributes(const Stats& stats, std::string& text) {
  TextTable table;
  table.row({"", "meshes", "vertices", "bytes", "share", "bits/vertex", "bits/tri " + note('a'),
             "of float32 " + note('c'), "max error"});
  bool any = false;
  for (const Stream stream : {kUvs, kSecondUvs, kColors, kNormals, kTangents, kSourceIds}) {
    if (stats.stream_meshes[stream] == 0) continue;
    any = true;
    const uint64_t bytes = stats.streams[stream].stored, elements = stats.stream_elements[stream];
    const bool is_per_vertex = stream != kSourceIds;
    const bool is_uv = stream == kUvs || stream == kSecondUvs;
    const std::string error = is_uv                 ? short_number(stats.max_uv_error)
                              : stream == kColors   ? "1/510"
                              : stream == kNormals  ? std::to_string(stats.min_normal_bits) + " bits per axis"
                              : stream == kTangents ? std::to_string(stats.min_tangent_bits) + " bits"
                                                    : "0";
    table.row({stream_title(stream), grouped(stats.stream_meshes[stream]), is_per_vertex ? grouped(elements) : "-",
               human_bytes(bytes), percent(bytes, stats.file_bytes), is_per_vertex ? bits_each(bytes, elements) : "-",
               bits_each(bytes, stats.triangles), percent(bytes, stats.reference_bytes[stream]), error});
  }
  if (any) text += "\nAttributes\n" + table.text();
}

const char* kind_name(format::ImageCodec codec) {
  if (codec == format::ImageCodec::kIndexedJpeg) return "indexed JPEG";
  if (codec == format::ImageCodec::kBlocks) return "blocks";
  return codec == format::ImageCodec::kJpeg ? "JPEG" : "PNG";
}

void add_textures(const format::Container& file, const Stats& stats, std::string& text) {
  const auto images = file.images();
  if (images.empty()) return;
  text += "\nTextures\n  " + times(file.textures().size(), "texture", "textures") + " of " +
          times(images.size(), "image", "images") + ", " + human_bytes(stats.images.stored) + "\n";
  TextTable table;
  table.row({"kind", "images", "pixels", "bytes", "share", "bits/pixel"});
  for (const format::ImageCodec codec : {format::ImageCodec::kIndexedJpeg, format::ImageCodec::kBlocks,
                                         format::ImageCodec::kJpeg, format::ImageCodec::kPng}) {
    const ImageStats& kind = stats.image_kinds[static_cast<size_t>(codec)];
    if (kind.images == 0) continue;
    table.row({kind_name(codec), grouped(kind.images), grouped(kind.pixels), human_bytes(kind.cost.stored),
               percent(kind.cost.stored, stats.file_bytes), bits_each(kind.cost.stored, kind.pixels)});
  }
  text += table.text();
  if (stats.mip_levels != 0) {
    text += "  of which " + human_bytes(stats.level_bytes) + " in " +
            times(stats.mip_levels, "mip level", "mip levels") + "\n";
  }
  if (stats.masks + stats.opaque_masks != 0) {
    text += "  of which " + human_bytes(stats.mask_pages.stored) + " in " +
            times(stats.masks, "alpha mask", "alpha masks") + " (" + human_bytes(stats.mask_pages.raw) +
            " in memory, always)";
    if (stats.opaque_masks != 0)
      text += "; " + times(stats.opaque_masks, "material has a mask that hides nothing",
                           "materials have masks that hide nothing");
    text += "\n";
  }
  if (stats.blended != 0) text += "  " + times(stats.blended, "material blends", "materials blend") + "\n";
  if (stats.top_images.empty()) return;
  TextTable largest;
  largest.row({"largest by bytes", "kind", "size", "channels", "bytes", "share"});
  for (const uint32_t number : stats.top_images) {
    const format::ImageRecord& image = images[number];
    const uint64_t bytes = image_bytes(file, number);
    const std::string_view name = file.string(image.name);
    largest.row({name.empty() ? "image " + std::to_string(number) : printable(name, 32),
                 image.codec == format::ImageCodec::kBlocks ? format::block_format_name(image.block_format)
                                                            : kind_name(image.codec),
                 std::to_string(image.width) + " x " + std::to_string(image.height), std::to_string(image.channels),
                 human_bytes(bytes), percent(bytes, stats.file_bytes)});
  }
  text += largest.text();
}

void add_container(const Stats& stats, std::string& text) {
  TextTable table;
  table.row({"", "records", "bytes each", "bytes", "share", "bits/tri " + note('a')});
  const auto row = [&](const std::string& what, uint64_t records, uint64_t each, uint64_t bytes) {
    table.row({what, records == 0 ? "-" : grouped(records), each == 0 ? "-" : grouped(each), human_bytes(bytes),
               percent(bytes, stats.file_bytes), bits_each(bytes, stats.triangles)});
  };
  row("header", 1, stats.header_bytes, stats.header_bytes);
  row("table of contents", stats.tables.size(), sizeof(format::TocEntry), stats.toc_bytes);
  for (const TableCost& cost : stats.tables) {
    if (cost.bytes != 0) row(cost.name, cost.records, cost.record_bytes, cost.bytes);
  }
  if (stats.page_gaps.stored != 0) row("gaps in pages", 0, 0, stats.page_gaps.stored);
  if (stats.other_pages != 0) row("other pages", 0, 0, stats.other_pages);
  row("padding", 0, 0, stats.padding_bytes);
  table.rule();
  row("container", 0, 0, stats.container_bytes());
  text += "\nContainer\n" + table.text();
}

void add_left_out(const format::Container& file, std::string& text) {
  const auto left_out = file.left_out();
  if (left_out.empty()) return;
  TextTable table;
  const auto costs = file.left_out_costs();
  const auto known = [](uint64_t bytes) { return bytes == 0 ? "-" : human_bytes(bytes); };
  table.row({"what", "count", "bytes in the source", "would take here " + note('j')});
  uint64_t in_source = 0, here = 0;
  for (uint64_t i = 0; i < left_out.size(); ++i) {
    const uint64_t cost = costs.empty() ? 0 : costs[i];
    table.row({printable(file.string(left_out[i].what), 60), grouped(left_out[i].count),
               known(left_out[i].source_bytes), known(cost)});
    in_source = format::checked_add(in_source, left_out[i].source_bytes).value_or(UINT64_MAX);
    here = format::checked_add(here, cost).value_or(UINT64_MAX);
  }
  table.rule();
  table.row({"all", "", known(in_source), known(here)});
  text += "\nLeft out (in the source, not in this file)\n" + table.text();
}

/// Replaces the references in `text` by letters in the order of their first use, and appends these notes.
void add_footnotes(std::string& text) {
  std::array<char, std::size(kNotes)> letters{};
  std::string notes;
  char next = 'a';
  for (char& c : text) {
    if (c < kFirstNote || c >= kFirstNote + static_cast<char>(std::size(kNotes))) continue;
    const auto index = static_cast<size_t>(c - kFirstNote);
    if (letters[index] == 0) {
      letters[index] = next++;
      notes += std::string("  [") + letters[index] + "] " + kNotes[index] + "\n";
    }
    c = letters[index];
  }
  text += "\n" + notes;
}

}  // namespace

std::string text_report(const format::Container& file, const Stats& stats, const std::string& path) {
  std::string text;
  add_head(file, stats, path, text);
  add_size(file, stats, text);
  add_scenes(file, stats, text);
  add_meshes(file, stats, text);
  add_chunks(file, stats, text);
  add_indices(stats, text);
  add_clusters(stats, text);
  add_positions(stats, text);
  add_attributes(stats, text);
  add_textures(file, stats, text);
  add_container(stats, text);
  add_left_out(file, text);
  add_footnotes(text);
  return text;
}

std::string text_verify(const VerifyReport& report) {
  std::string text = "Verified\n";
  text += "  " + times(report.tables, "table", "tables") + ": checksum, every record\n";
  text += "  " + times(report.pages, "page", "pages") + ": checksum over " + human_bytes(report.page_bytes) +
          ", unpacked to " + human_bytes(report.raw_bytes) + "\n";
  text += "  " + times(report.chunks, "chunk", "chunks") + ": decoded to " +
          times(report.triangles, "triangle", "triangles") + " and " + times(report.vertices, "vertex", "vertices") +
          ", every index and coordinate in range\n";
  text += "  " + times(report.meshes, "mesh", "meshes") + ": box and vertex count as decoded\n";
  text +=
      "  " + times(report.images, "image", "images") + ": decoded to " + times(report.pixels, "pixel", "pixels") + "\n";
  text += "  " + times(report.padding_bytes, "byte", "bytes") + " of padding: zero\n";
  if (report.is_shard) text += "  a shard of a conversion: scree merge checks its chunks and images\n";
  for (const std::string& warning : report.warnings) text += "  warning: " + printable(warning, 400) + "\n";
  for (const Failure& failure : report.failures) text += "  FAILED " + printable(failure.error.message, 400) + "\n";
  if (report.failure_count > report.failures.size())
    text += "  ... and " + grouped(report.failure_count - report.failures.size()) + " more\n";
  text +=
      report.failure_count == 0 ? "  all is well\n" : "  " + times(report.failure_count, "failure", "failures") + "\n";
  return text;
}

void print_chunks(const format::Container& file, std::FILE* out) {
  const auto chunks = file.chunks();
  std::fprintf(out, "%10s %8s %8s %12s %10s %10s %10s %6s %9s %6s %7s %6s %9s  %s\n", "chunk", "mesh", "page", "offset",
               "bytes", "triangles", "vertices", "index", "position", "uv", "normal", "source", "bits/tri", "name");
  for (uint64_t i = 0; i < chunks.size(); ++i) {
    const format::ChunkRecord& chunk = chunks[i];
    const format::MeshRecord& mesh = file.meshes()[chunk.mesh];
    char index[16] = "-", position[16], uv[16] = "-", normal[16] = "-", source[16] = "-";
    if (chunk.encoding == format::ChunkEncoding::kIndexed) std::snprintf(index, sizeof index, "%u", chunk.index_bits);
    std::snprintf(position, sizeof position, "%u+%u+%u", chunk.position_bits[0], chunk.position_bits[1],
                  chunk.position_bits[2]);
    if (mesh.attributes & format::kHasUv) std::snprintf(uv, sizeof uv, "%u+%u", chunk.uv_bits[0], chunk.uv_bits[1]);
    if (mesh.attributes & format::kHasNormal) std::snprintf(normal, sizeof normal, "%u", chunk.normal_bits);
    if (mesh.attributes & format::kHasSourceIds) std::snprintf(source, sizeof source, "%u", chunk.source_bits);
    std::fprintf(out, "%10llu %8u %8u %12llu %10llu %10u %10u %6s %9s %6s %7s %6s %9s  %s\n",
                 static_cast<unsigned long long>(i), chunk.mesh, chunk.page,
                 static_cast<unsigned long long>(chunk.offset), static_cast<unsigned long long>(chunk.bytes),
                 chunk.triangle_count, chunk.vertex_count, index, position, uv, normal, source,
                 bits_each(chunk.bytes, chunk.triangle_count).c_str(), printable(mesh_name(file, chunk.mesh)).c_str());
  }
}

}  // namespace scree::inspect
