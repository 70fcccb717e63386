// Compares a .scree file with its source glTF, triangle by triangle, for the tests of convert and of the models.
#pragma once

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "format/container/container.h"
#include "tests/tools/packed_file.h"
#include "tools/common/chunk_decode.h"
#include "tools/convert/images/masks.h"
#include "tools/gltf/source.h"

namespace scree::tests {

struct Comparison {
  std::string difference;  // empty: the file equals the source within its stated errors
  uint64_t triangles = 0;
  double position_error = 0;  // largest found, model units, per axis
};

struct SourceTriangles {
  std::vector<uint32_t> corners;  // 3 per triangle of the source
  std::vector<bool> kept;
  uint64_t kept_count = 0;
};

/// The triangles of a primitive that convert keeps: no triangle of a strip with two equal indices, and none with a
/// position that is not finite.
inline Result<SourceTriangles> source_triangles(const convert::Primitive& primitive,
                                                const std::vector<float>& positions) {
  SourceTriangles out;
  const uint64_t count = primitive.triangle_count();
  out.corners.resize(3 * count);
  if (const Result<void> read = convert::read_triangles(primitive, 0, count, out.corners); !read) return read.error();
  out.kept.resize(count);
  for (uint64_t t = 0; t < count; ++t) {
    const uint32_t* c = &out.corners[3 * t];
    bool keep = primitive.mode == convert::PrimitiveMode::kTriangles || (c[0] != c[1] && c[1] != c[2] && c[2] != c[0]);
    for (int corner = 0; corner < 3; ++corner)
      for (int axis = 0; axis < 3; ++axis) keep = keep && std::isfinite(positions[3 * size_t{c[corner]} + axis]);
    out.kept[t] = keep;
    out.kept_count += keep ? 1 : 0;
  }
  return out;
}

inline Result<std::vector<float>> all_floats(const convert::Accessor& accessor) {
  std::vector<float> out(accessor.count * accessor.components);
  if (const Result<void> read = convert::read_floats(accessor, 0, accessor.count, out); !read) return read.error();
  return out;
}

/// Checks one mesh of a file made with --source-ids against its primitive. Every kept source triangle must occur once,
/// with its corners in the same order (in clusters: rotated), each position within the mesh's stated error, and each
/// attribute within its own error.
inline std::string compare_mesh(const convert::Primitive& primitive, const SourceTriangles& source,
                                const std::vector<float>& positions, const format::Container& file,
                                uint64_t mesh_number, tools::ChunkReader& reader, Comparison& out) {
  const format::MeshRecord& mesh = file.meshes()[mesh_number];
  const std::string place = "mesh " + std::to_string(mesh_number);
  if (mesh.triangle_count != source.kept_count)
    return place + ": " + std::to_string(mesh.triangle_count) + " triangles, but the source has " +
           std::to_string(source.kept_count);
  if (!(mesh.attributes & format::kHasSourceIds)) return place + ": no source ids";
  std::vector<float> uvs, colors, normals;
  const auto load = [](const std::optional<convert::Accessor>& accessor, std::vector<float>& values) {
    if (!accessor) return false;
    Result<std::vector<float>> read = all_floats(*accessor);
    if (read) values = std::move(*read);
    return static_cast<bool>(read);
  };
  if ((mesh.attributes & format::kHasUv) && !load(primitive.uv, uvs)) return place + ": no uv in the source";
  if ((mesh.attributes & format::kHasColor) && !load(primitive.color, colors))
    return place + ": no colour in the source";
  if ((mesh.attributes & format::kHasNormal) && !load(primitive.normal, normals)) return place + ": no normal there";
  std::vector<bool> seen(source.kept.size());
  for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c) {
    const Result<const tools::DecodedChunk*> read = reader.read(c);
    if (!read) return read.error().message;
    const tools::DecodedChunk& chunk = **read;
    for (size_t t = 0; t < chunk.source_ids.size(); ++t) {
      const uint64_t id = chunk.source_ids[t];
      const std::string triangle = place + ": source triangle " + std::to_string(id);
      if (id >= seen.size() || !source.kept[id]) return triangle + " is none that is kept";
      if (seen[id]) return triangle + " is there twice";
      seen[id] = true;
      double largest = 0;  // position error
      // Compares with the source's corners after a rotation by `turn`. Returns the difference; empty if there is none.
      const auto compare_turned = [&](size_t turn) -> std::string {
        largest = 0;
        for (size_t corner = 0; corner < 3; ++corner) {
          const size_t from = source.corners[3 * id + corner];
          const size_t to = chunk.indices[3 * t + (corner + turn) % 3];
          for (size_t axis = 0; axis < 3; ++axis) {
            const double error = std::fabs(static_cast<double>(chunk.positions[3 * to + axis]) -
                                           static_cast<double>(positions[3 * from + axis]));
            largest = std::max(largest, error);
            if (!(error <= mesh.max_position_error)) return triangle + ": position error " + std::to_string(error);
            if (chunk.positions[3 * to + axis] < mesh.bounds_min[axis] ||
                chunk.positions[3 * to + axis] > mesh.bounds_max[axis])
              return triangle + ": outside the bounds";
          }
          for (size_t i = 0; i < 2 && !uvs.empty(); ++i) {
            const float want = std::isfinite(uvs[2 * from + i]) ? uvs[2 * from + i] : 0.0f;
            if (!(std::fabs(chunk.uvs[2 * to + i] - want) <= mesh.max_uv_error)) return triangle + ": uv error";
          }
          for (size_t i = 0; i < 4 && !colors.empty(); ++i) {
            const size_t components = primitive.color->components;
            float want = i < components ? colors[components * from + i] : 1.0f;
            want = std::isfinite(want) ? std::clamp(want, 0.0f, 1.0f) : 0.0f;
            if (!(std::fabs(chunk.colors[4 * to + i] - want) <= 0.5f / 255 + 1e-6f)) return triangle + ": colour error";
          }
          if (!normals.empty()) {
            double dot = 0, length = 0;
            for (size_t i = 0; i < 3; ++i) {
              dot += static_cast<double>(normals[3 * from + i]) * static_cast<double>(chunk.normals[3 * to + i]);
              length += static_cast<double>(normals[3 * from + i]) * static_cast<double>(normals[3 * from + i]);
            }
            // Within 0.05 degrees. A zero or infinite normal has no direction.
            if (length > 1e-30 && std::isfinite(length) &&
                dot / std::sqrt(length) < std::cos(0.05 * 3.14159265358979 / 180))
              return triangle + ": normal error";
          }
        }
        return {};
      };
      // Clusters may rotate a triangle's corners.
      std::string difference = compare_turned(0);
      if (file.chunks()[c].encoding == format::ChunkEncoding::kClustered) {
        for (size_t turn = 1; turn < 3 && !difference.empty(); ++turn)
          if (std::string turned = compare_turned(turn); turned.empty()) difference.clear();
      }
      if (!difference.empty()) return difference;
      out.position_error = std::max(out.position_error, largest);
      ++out.triangles;
    }
  }
  for (size_t t = 0; t < seen.size(); ++t)
    if (source.kept[t] && !seen[t]) return place + ": source triangle " + std::to_string(t) + " is missing";
  return {};
}

/// Compares all meshes. `exclude`: the value given to convert.
inline Comparison compare_with_source(const std::string& gltf, const std::string& scree,
                                      const std::string& exclude = {}) {
  Comparison out;
  const Result<convert::SourceScene> scene = convert::import_gltf(gltf, {.exclude = exclude});
  if (!scene) return {scene.error().message, 0, 0};
  const Result<PackedFile> opened = open_packed(scree);
  if (!opened) return {opened.error().message, 0, 0};
  const format::Container& file = opened->file;
  // By glTF mesh: the mesh as which it is stored, which is itself or an equal one. It is compared in either case.
  std::map<uint32_t, uint32_t> stored_as;
  if (file.nodes().size() != scene->nodes.size()) return {"another number of nodes", 0, 0};
  for (size_t i = 0; i < scene->nodes.size(); ++i) {
    const uint32_t group = scene->nodes[i].group;
    if (group == format::kNone) continue;
    if (stored_as.try_emplace(group, file.nodes()[i].group).first->second != file.nodes()[i].group)
      return {"nodes of one mesh draw several", 0, 0};
  }
  convert::WorkerPool pool(1, nullptr);
  const convert::ImageOptions images{.keep_going = true};
  const std::vector<bool> all(scene->primitives.size(), true);
  const Result<convert::MaskPlan> masks = convert::plan_masks(*scene, all, images, pool, [](uint64_t) {});
  if (!masks) return {masks.error().message, 0, 0};
  tools::ChunkReader reader(file);
  std::map<uint32_t, uint32_t> kept;  // by group: primitives so far
  uint64_t meshes = 0;
  for (const convert::Primitive& primitive : scene->primitives) {
    if (!stored_as.contains(primitive.group)) continue;
    if (masks->kind(primitive) == convert::MaskKind::kClear) continue;
    const Result<std::vector<float>> positions = all_floats(primitive.positions);
    if (!positions) return {positions.error().message, 0, 0};
    const Result<SourceTriangles> source = source_triangles(primitive, *positions);
    if (!source) return {source.error().message, 0, 0};
    if (source->kept_count == 0) continue;
    const uint32_t group = stored_as[primitive.group], place = kept[primitive.group]++;
    if (place >= file.groups()[group].mesh_count) return {"meshes are missing", 0, 0};
    Comparison repeat;
    Comparison& into = group == primitive.group ? out : repeat;
    out.difference =
        compare_mesh(primitive, *source, *positions, file, file.groups()[group].first_mesh + place, reader, into);
    if (!out.difference.empty()) return out;
    meshes += group == primitive.group ? 1 : 0;
  }
  if (meshes != file.meshes().size()) out.difference = "more meshes than the source has";
  for (const auto& [group, count] : kept)
    if (count != file.groups()[stored_as[group]].mesh_count) out.difference = "more primitives than the source has";
  return out;
}

}  // namespace scree::tests
