#include "tools/convert/plan/left_out.h"

#include "format/geometry/attribute_codec.h"
#include "format/geometry/tangent_codec.h"

namespace scree::convert {
namespace {

using format::kNone;

/// Texture coordinates in the range 0 to 1 take about 16 bits per axis; a colour takes 32 bits.
constexpr uint64_t kSetBytes = 4;

/// Estimates the bytes that a left-out entry would have taken in the file: attributes of `elements` vertices, or else
/// `count` records, without the pages or instances that belong to them.
uint64_t cost_of(const LeftOut& entry) {
  const auto starts_with = [&](std::string_view prefix) { return entry.what.rfind(prefix, 0) == 0; };
  if (starts_with("TEXCOORD_") || starts_with("COLOR_")) return kSetBytes * entry.elements;
  if (entry.what == "unused images") return entry.source_bytes + sizeof(format::ImageRecord) * entry.count;
  if (entry.what == "unused materials") return sizeof(format::MaterialRecord) * entry.count;
  if (entry.what == "unused textures") return sizeof(format::TextureRecord) * entry.count;
  if (entry.what == "excluded nodes" || entry.what == "nodes outside every scene")
    return sizeof(format::NodeRecord) * entry.count;
  return 0;  // unknown without encoding it, or not supported by the format
}

uint64_t weld_cost(const Welded& welded) {
  return welded.cost_bits == Welded::kUnknownCost ? 0 : welded.cost_bits / 8;
}

/// The sum of `bytes(chunk)` over a mesh's chunks.
template <class Bytes>
uint64_t sum_of_chunks(const format::TableSet& tables, uint32_t mesh, const Bytes& bytes) {
  const format::MeshRecord& record = tables.meshes[mesh];
  uint64_t sum = 0;
  for (uint64_t c = record.first_chunk; c < record.first_chunk + record.chunk_count; ++c)
    sum += bytes(tables.chunks[c]);
  return sum;
}

}  // namespace

void AccessorBytes::add(const Primitive& primitive) {
  add(primitive.positions);
  if (primitive.indices) add(*primitive.indices);
  visit_attributes(primitive, true, [&](const Accessor& accessor) { add(accessor); });
}

void add_source_bytes(const SourceScene& scene, const std::vector<uint32_t>& mesh_of, format::SourceRecord& source) {
  AccessorBytes indices, positions, attributes;
  for (size_t i = 0; i < scene.primitives.size(); ++i) {
    if (mesh_of[i] == format::kNone) continue;
    const Primitive& primitive = scene.primitives[i];
    if (primitive.indices) indices.add(*primitive.indices);
    positions.add(primitive.positions);
    visit_attributes(primitive, true, [&](const Accessor& accessor) { attributes.add(accessor); });
  }
  source.index_bytes = indices.bytes();
  source.position_bytes = positions.bytes();
  source.attribute_bytes = attributes.bytes();
}

void add_left_out(const LeftOutFacts& facts, format::TableSet& tables) {
  const auto add = [&](std::string_view what, uint64_t count, uint64_t bytes, uint64_t cost) {
    if (count == 0) return;
    format::LeftOutRecord record{};
    record.what = tables.strings.add(what);
    record.count = count;
    record.source_bytes = bytes;
    tables.left_out.push_back(record);
    tables.left_out_costs.push_back(cost);
  };
  const SourceScene& scene = facts.scene;
  AccessorBytes kept, white, repeats;
  struct Dropped {
    const char* what;
    AccessorBytes bytes;
    uint64_t cost = 0;
  };
  Dropped normals[] = {{"NORMAL", {}}, {kFaceNormals, {}}, {kUnlitNormals, {}}};
  Dropped tangents[] = {{"TANGENT", {}}, {kDerivedTangents, {}}};
  uint64_t white_cost = 0, repeat_count = 0, repeat_cost = 0;
  std::vector<uint32_t> place(scene.groups.size());  // by group: number of the next primitive that keeps a triangle
  for (size_t i = 0; i < scene.primitives.size(); ++i) {
    if (facts.mesh_of[i] == kNone) continue;
    kept.add(scene.primitives[i]);
  }
  repeats.leave(kept);
  for (size_t i = 0; i < scene.primitives.size(); ++i) {
    const Primitive& primitive = scene.primitives[i];
    const uint32_t stored_group = facts.stored_group[primitive.group];
    if (facts.measured[i].triangles == 0) continue;
    if (stored_group != primitive.group) {
      const uint32_t mesh = tables.groups[stored_group].first_mesh + place[primitive.group]++;
      repeats.add(primitive);
      ++repeat_count;
      repeat_cost += sizeof(format::MeshRecord) + sum_of_chunks(tables, mesh, [](const format::ChunkRecord& chunk) {
                       return sizeof(format::ChunkRecord) + chunk.bytes;
                     });
      continue;
    }
    const uint32_t mesh = facts.mesh_of[i];
    const uint32_t stored = facts.plans[mesh].attributes;
    if (primitive.normal && !(stored & format::kHasNormal)) {
      const bool is_unlit = !may_keep_normals(scene, primitive, Normals::kAuto);
      Dropped& dropped = normals[facts.normals == Normals::kNever ? 0 : is_unlit ? 2 : 1];
      dropped.bytes.add(*primitive.normal);
      dropped.cost += sum_of_chunks(tables, mesh, [](const format::ChunkRecord& chunk) {
        return format::normal_stream_bytes(chunk.vertex_count, kNormalBits);
      });
    }
    if (primitive.tangent() != nullptr && !(stored & format::kHasTangent)) {
      Dropped& dropped = tangents[facts.normals == Normals::kNever ? 0 : 1];
      dropped.bytes.add(*primitive.tangent());
      dropped.cost += sum_of_chunks(tables, mesh, [](const format::ChunkRecord& chunk) {
        return format::tangent_stream_bytes(chunk.vertex_count, kTangentBits);
      });
    }
    if (primitive.color && !(stored & format::kHasColor)) {
      white.add(*primitive.color);
      white_cost += sum_of_chunks(tables, mesh, [](const format::ChunkRecord& chunk) {
        return format::color_stream_bytes(chunk.vertex_count);
      });
    }
  }
  uint64_t image_count = 0, image_bytes = 0;
  for (size_t i = 0; i < facts.images.places.size(); ++i) {
    const uint32_t record = facts.images.places[i];
    if (record == kNone || facts.images.sources[record] == i) continue;
    ++image_count;
    image_bytes += scene.images[i].bytes;
  }

  for (const LeftOut& entry : scene.left_out)
    if (entry.what != "NORMAL") add(entry.what, entry.count, entry.source_bytes, cost_of(entry));
  for (const Dropped& dropped : tangents) add(dropped.what, dropped.bytes.count(), dropped.bytes.bytes(), dropped.cost);
  for (const Dropped& dropped : normals) add(dropped.what, dropped.bytes.count(), dropped.bytes.bytes(), dropped.cost);
  add("COLOR_0 (all white)", white.count(), white.bytes(), white_cost);
  add("primitives no node draws", facts.undrawn, 0, 0);
  add("primitives their alpha masks hide", facts.clear, 0, 0);
  add("duplicate meshes", repeat_count, repeats.bytes(), repeat_cost);
  add("duplicate images", image_count, image_bytes, image_bytes + sizeof(format::ImageRecord) * image_count);
  add("duplicate textures", facts.merged.textures, 0, sizeof(format::TextureRecord) * facts.merged.textures);
  add("duplicate materials", facts.merged.materials, 0, sizeof(format::MaterialRecord) * facts.merged.materials);
  add("duplicate vertices", facts.encoded.welded.vertices, facts.encoded.welded.source_bytes,
      weld_cost(facts.encoded.welded));
  add("degenerate triangles of strips and fans", facts.dropped_degenerate, 0, 0);
  add("triangles with positions that are not finite", facts.dropped_nonfinite, 0, 0);
  add("texture coordinates that are not finite", facts.encoded.repaired_uvs, 0, 0);
  add("colours that are not finite", facts.encoded.repaired_colors, 0, 0);
  add("normals that are not finite or zero", facts.encoded.repaired_normals, 0, 0);
  add("tangents without a direction", facts.encoded.repaired_tangents, 0, 0);
}

std::vector<std::string> left_out_warnings(const LeftOutFacts& facts) {
  std::vector<std::string> warnings;
  const auto warn = [&](uint64_t count, const char* one, const char* many) {
    if (count > 0)
      warnings.push_back(facts.scene.file_name + ": " + std::to_string(count) + " " + (count == 1 ? one : many));
  };
  warn(facts.undrawn, "primitive that no node draws is left out", "primitives that no node draws are left out");
  warn(facts.clear, "primitive that its alpha mask hides everywhere is left out",
       "primitives that their alpha masks hide everywhere are left out");
  warn(facts.dropped_nonfinite, "triangle with a position that is not finite is left out",
       "triangles with positions that are not finite are left out");
  const EncodedFacts& encoded = facts.encoded;
  warn(encoded.repaired_uvs, "texture coordinate is not finite and became 0",
       "texture coordinates are not finite and became 0");
  warn(encoded.repaired_colors, "vertex colour is not finite and became 0",
       "vertex colours are not finite and became 0");
  warn(encoded.repaired_normals, "normal is zero or not finite and became +z",
       "normals are zero or not finite and became +z");
  warn(encoded.repaired_tangents, "tangent is zero, not finite or parallel to its normal and became arbitrary",
       "tangents are zero, not finite or parallel to their normal and became arbitrary");
  return warnings;
}

std::vector<LeftOut> lost_parts(const format::TableSet& tables) {
  std::vector<LeftOut> lost;
  for (const format::LeftOutRecord& record : tables.left_out) {
    const std::string_view what = tables.strings.bytes().data() + record.what;
    if (!what.starts_with("duplicate ") && !what.starts_with("unused ") && what != "COLOR_0 (all white)" &&
        what != kFaceNormals && what != kUnlitNormals && what != kDerivedTangents)
      lost.push_back({std::string(what), record.count, record.source_bytes, 0});
  }
  return lost;
}

}  // namespace scree::convert
