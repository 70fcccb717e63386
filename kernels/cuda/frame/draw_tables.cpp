#include "kernels/cuda/frame/draw_tables.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "format/geometry/cluster_layout.h"

namespace scree::kernels {
namespace {

/// Calls count(mesh, instances) for every mesh that is drawn.
template <class Count>
void for_each_drawn_mesh(const SceneView& scene, const std::vector<uint64_t>& instances, const Count& count) {
  for (uint64_t m = 0; m < scene.mesh_count; ++m) {
    if (instances[m] != 0) count(m, instances[m]);
  }
}

bool draws_instance(const SceneView& scene, uint64_t number) {
  const format::MeshRecord& mesh = scene.meshes[scene.instances[number].mesh];
  return mesh.triangle_count != 0 && draws_mesh(scene, mesh);
}

std::vector<uint64_t> instances_by_mesh(const SceneView& scene) {
  std::vector<uint64_t> count(scene.mesh_count);
  for (uint64_t i = 0; i < scene.instance_count; ++i)
    if (draws_instance(scene, i)) ++count[scene.instances[i].mesh];
  return count;
}

bool is_clustered(const SceneView& scene, uint64_t chunk) {
  return scene.chunks[chunk].encoding == format::ChunkEncoding::kClustered;
}

uint64_t cluster_group_count(const format::ChunkRecord& chunk) {
  return (uint64_t{chunk.cluster_count} + format::kGroupClusters - 1) / format::kGroupClusters;
}

/// `instances`: by mesh.
CandidateCounts count_candidates(const SceneView& scene, const std::vector<uint64_t>& instances) {
  CandidateCounts counts;
  for_each_drawn_mesh(scene, instances, [&](uint64_t m, uint64_t count) {
    const uint64_t parts = (count + kDrawInstances - 1) / kDrawInstances;
    const format::MeshRecord& mesh = scene.meshes[m];
    bool has_clustered = false;
    for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c) {
      if (!is_clustered(scene, c)) {
        counts.indexed += parts;
        continue;
      }
      has_clustered = true;
      counts.cluster_draws += count;
      counts.cluster_groups += count * cluster_group_count(scene.chunks[c]);
    }
    if (has_clustered) counts.clustered += (count * mesh.chunk_count + kDrawInstances - 1) / kDrawInstances;
  });
  return counts;
}

/// Lays out the hints of each instance: tables.cluster_chunks and hint_offset.
void place_hints(const SceneView& scene, DrawTables& tables) {
  tables.cluster_chunks.resize(scene.chunk_count);
  std::vector<uint64_t> mesh_groups(scene.mesh_count);
  for (uint64_t m = 0; m < scene.mesh_count; ++m) {
    const format::MeshRecord& mesh = scene.meshes[m];
    for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c) {
      if (!is_clustered(scene, c)) continue;
      const format::ChunkRecord& chunk = scene.chunks[c];
      tables.cluster_chunks[c] = {{chunk.position_min[0], chunk.position_min[1], chunk.position_min[2]},
                                  {chunk.position_bits[0], chunk.position_bits[1], chunk.position_bits[2]},
                                  0,
                                  chunk.page,
                                  chunk.cluster_count,
                                  chunk.triangle_count,
                                  static_cast<uint32_t>(mesh_groups[m]),
                                  chunk.offset,
                                  chunk.first_triangle};
      mesh_groups[m] += cluster_group_count(chunk);
    }
  }
  uint64_t word = 0;
  tables.hint_offset.reserve(scene.instance_count);
  for (uint64_t i = 0; i < scene.instance_count; ++i) {
    tables.hint_offset.push_back(word);
    if (draws_instance(scene, i)) word += mesh_groups[scene.instances[i].mesh];
  }
}

/// The box of a mesh's bounds under a matrix: center and half sides along each axis.
void bounds_in_world(const format::MeshRecord& mesh, const format::MatrixRecord& matrix, double center[3],
                     double half[3]) {
  for (int i = 0; i < 3; ++i) {
    center[i] = matrix.rows[i][3];
    half[i] = 0;
    for (int j = 0; j < 3; ++j) {
      const double from = mesh.bounds_min[j];
      const double to = mesh.bounds_max[j];
      center[i] += matrix.rows[i][j] * (0.5 * (from + to));
      half[i] += std::abs(matrix.rows[i][j]) * (0.5 * (to - from));
    }
  }
}

SceneBox find_scene_box(const SceneView& scene) {
  double low[3];
  double high[3];
  std::fill(low, low + 3, std::numeric_limits<double>::infinity());
  std::fill(high, high + 3, -std::numeric_limits<double>::infinity());
  for (uint64_t i = 0; i < scene.instance_count; ++i) {
    const format::InstanceRecord& instance = scene.instances[i];
    double center[3];
    double half[3];
    bounds_in_world(scene.meshes[instance.mesh], scene.matrices[instance.matrix], center, half);
    for (int axis = 0; axis < 3; ++axis) {
      if (!std::isfinite(center[axis]) || !std::isfinite(half[axis])) continue;
      low[axis] = std::min(low[axis], center[axis] - half[axis]);
      high[axis] = std::max(high[axis], center[axis] + half[axis]);
    }
  }
  SceneBox box;
  for (int axis = 0; axis < 3; ++axis) {
    if (!(low[axis] <= high[axis])) continue;
    box.center[axis] = 0.5 * low[axis] + 0.5 * high[axis];
    box.half[axis] = 0.5 * high[axis] - 0.5 * low[axis];
  }
  return box;
}

}  // namespace

CandidateCounts count_candidates(const SceneView& scene) {
  return count_candidates(scene, instances_by_mesh(scene));
}

std::vector<ClusterGroup> list_cluster_groups(const SceneView& scene) {
  std::vector<ClusterGroup> groups;
  for (uint64_t i = 0; i < scene.instance_count; ++i) {
    if (!draws_instance(scene, i)) continue;
    const format::MeshRecord& mesh = scene.meshes[scene.instances[i].mesh];
    for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c) {
      const auto count = static_cast<uint32_t>(cluster_group_count(scene.chunks[c]));
      for (uint32_t group = 0; group < count; ++group)
        groups.push_back({static_cast<uint32_t>(i), static_cast<uint32_t>(c), group});
    }
  }
  return groups;
}

Result<DrawTables> make_draw_tables(const SceneView& scene) {
  const std::vector<uint64_t> instances = instances_by_mesh(scene);
  DrawTables tables;
  CandidateCounts& candidates = tables;
  candidates = count_candidates(scene, instances);
  // Each instance of a clustered chunk is one draw. The work of both lists fits, because triangles have 36-bit ids.
  if (scene.instance_count >= UINT32_MAX || scene.chunk_count >= UINT32_MAX || candidates.indexed >= kMaxDraws ||
      candidates.cluster_draws >= kMaxDraws) {
    return Error{ErrorCode::kRange,
                 "the scene has " + std::to_string(scene.instance_count) + " instances and " +
                     std::to_string(candidates.indexed) + " groups of 16 instances of a chunk and " +
                     std::to_string(candidates.cluster_draws) +
                     " of a clustered chunk; a GPU draws fewer than 2^32 - 1, 2^28 and 2^28; use --backend cpu"};
  }
  tables.mesh_first.resize(scene.mesh_count);
  tables.candidates.reserve(tables.indexed);
  tables.cluster_candidates.reserve(tables.clustered);
  if (tables.clustered != 0) {
    place_hints(scene, tables);
    tables.box = find_scene_box(scene);
  }
  uint32_t place = 0;
  for_each_drawn_mesh(scene, instances, [&](uint64_t m, uint64_t count) {
    const format::MeshRecord& mesh = scene.meshes[m];
    tables.mesh_first[m] = place;
    place += static_cast<uint32_t>(count);
    bool has_clustered = false;
    for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c) {
      if (is_clustered(scene, c)) {
        has_clustered = true;
        continue;
      }
      (mesh.position_encoding == format::PositionEncoding::kFloat32 ? tables.has_float32 : tables.has_lattice) = true;
      tables.has_instances = tables.has_instances || count > 1;
      for (uint64_t first = 0; first < count; first += kDrawInstances)
        tables.candidates.push_back({static_cast<uint32_t>(c), static_cast<uint32_t>(first)});
    }
    if (!has_clustered) return;
    for (uint64_t pair = 0; pair < count * mesh.chunk_count; pair += kDrawInstances) {
      tables.cluster_candidates.push_back({static_cast<uint32_t>(mesh.first_chunk + pair % mesh.chunk_count),
                                           static_cast<uint32_t>(pair / mesh.chunk_count)});
    }
  });
  tables.order.resize(place);
  std::vector<uint32_t> next = tables.mesh_first;
  for (uint64_t i = 0; i < scene.instance_count; ++i) {
    if (draws_instance(scene, i)) tables.order[next[scene.instances[i].mesh]++] = static_cast<uint32_t>(i);
  }
  return tables;
}

}  // namespace scree::kernels
