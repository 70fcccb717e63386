#include "lab/scenes/scene_tables.h"

#include <algorithm>
#include <bit>
#include <cassert>
#include <string>

#include "format/bytes.h"
#include "format/geometry/chunk_layout.h"
#include "format/geometry/position_codec.h"

namespace scree::lab {
namespace {

ChunkBox whole_box(std::span<const ChunkBox> boxes) {
  ChunkBox box = boxes[0];
  for (const ChunkBox& other : boxes) {
    for (int axis = 0; axis < 3; ++axis) {
      box.lo[axis] = std::min(box.lo[axis], other.lo[axis]);
      box.hi[axis] = std::max(box.hi[axis], other.hi[axis]);
    }
  }
  return box;
}

Result<format::MeshRecord> make_mesh(const synth::MeshRecipe& recipe, const ChunkBox& box, const Encoding& encoding) {
  format::MeshRecord mesh{.triangle_count = synth::triangle_count(recipe),
                          .source_vertex_count = synth::vertex_count(recipe),
                          .material = format::kNone,
                          .group = format::kNone};
  if (encoding.float32) {
    mesh.position_encoding = format::PositionEncoding::kFloat32;
    for (int axis = 0; axis < 3; ++axis) {
      mesh.bounds_min[axis] = box.lo[axis];
      mesh.bounds_max[axis] = box.hi[axis];
    }
    return mesh;
  }
  const format::MeshLattice lattice = SCREE_TRY(format::choose_lattice(box.lo, box.hi, encoding.position_bits, 0));
  mesh.position_encoding = format::PositionEncoding::kLattice;
  mesh.lattice_exponent = lattice.exponent;
  mesh.max_position_error = lattice.max_error;
  for (size_t axis = 0; axis < 3; ++axis) {
    mesh.lattice_min[axis] = lattice.min[axis];
    mesh.lattice_bits[axis] = lattice.bits[axis];
    mesh.bounds_min[axis] = format::dequantize(lattice.min[axis], lattice.exponent);
    mesh.bounds_max[axis] = format::dequantize(format::quantize(box.hi[axis], lattice.exponent), lattice.exponent);
  }
  return mesh;
}

format::ChunkRecord make_chunk(const synth::MeshRecipe& recipe, const ChunkPlan& plan, const format::MeshRecord& mesh,
                               const ChunkBox& box, const Encoding& encoding) {
  format::ChunkRecord chunk{.first_triangle = 2 * chunk_first_quad(recipe, plan),
                            .mesh = plan.mesh,
                            .triangle_count = 2 * chunk_quads(recipe, plan),
                            .vertex_count = chunk_vertices(recipe, plan)};
  // Every vertex of the chunk's grids is used, including the first.
  chunk.index_min = 0;
  chunk.index_bits =
      encoding.packed_indices ? static_cast<uint8_t>(std::bit_width(chunk.vertex_count - 1)) : uint8_t{32};
  for (size_t axis = 0; axis < 3; ++axis) {
    if (encoding.float32) {
      chunk.position_bits[axis] = 32;
      continue;
    }
    const format::LatticeAxis on_lattice = format::lattice_axis(box.lo[axis], box.hi[axis], mesh.lattice_exponent);
    chunk.position_min[axis] = static_cast<uint32_t>(on_lattice.min - mesh.lattice_min[axis]);
    chunk.position_bits[axis] = static_cast<uint8_t>(on_lattice.bits);
  }
  chunk.encoding = format::ChunkEncoding::kIndexed;
  chunk.bytes = format::chunk_streams(mesh, chunk).bytes;
  return chunk;
}

/// Puts a chunk into the last page. If the page would then exceed the page size, starts a new one, as convert does.
void place_chunk(SceneTables& tables, uint64_t& page_bytes, format::ChunkRecord& chunk) {
  if (tables.page_offset.empty() || page_bytes + chunk.bytes > format::kPageTargetBytes) {
    tables.arena_bytes = format::align_up(tables.arena_bytes, format::kPageAlignment);
    tables.page_offset.push_back(tables.arena_bytes);
    page_bytes = 0;
  }
  chunk.page = static_cast<uint32_t>(tables.page_offset.size() - 1);
  chunk.offset = page_bytes;
  page_bytes += chunk.bytes;
  tables.arena_bytes += chunk.bytes;
  tables.geometry_bytes += chunk.bytes;
}

void add_instances(const synth::Scene& scene, SceneTables& tables) {
  tables.instance_base.push_back(0);
  for (const synth::SceneInstance& instance : scene.instances) {
    const auto number = static_cast<uint32_t>(tables.instances.size());
    tables.instances.push_back({instance.mesh, number, number, 0});
    tables.matrices.push_back(matrix_record(instance));
    tables.instance_base.push_back(tables.instance_base.back() + tables.meshes[instance.mesh].triangle_count);
  }
}

}  // namespace

std::string encoding_name(const Encoding& encoding) {
  const std::string positions = encoding.float32 ? "float32" : std::to_string(encoding.position_bits) + "-bit";
  return positions + (encoding.clustered ? ", clustered" : encoding.packed_indices ? ", packed" : ", 32-bit");
}

void place_chunks(SceneTables& tables) {
  tables.page_offset.clear();
  tables.arena_bytes = 0;
  tables.geometry_bytes = 0;
  for (format::MeshRecord& mesh : tables.meshes) mesh.vertex_count = 0;
  uint64_t page_bytes = 0;
  for (format::ChunkRecord& chunk : tables.chunks) {
    place_chunk(tables, page_bytes, chunk);
    tables.meshes[chunk.mesh].vertex_count += chunk.vertex_count;
  }
}

uint64_t geometry_bytes(const format::MeshRecord& mesh, const format::ChunkRecord& chunk) {
  return format::chunk_streams(mesh, chunk).uvs.offset;
}

format::MatrixRecord matrix_record(const synth::SceneInstance& instance) {
  format::MatrixRecord matrix{};
  for (size_t row = 0; row < 3; ++row)
    for (size_t column = 0; column < 4; ++column)
      matrix.rows[row][column] = static_cast<double>(instance.matrix[4 * column + row]);
  return matrix;
}

std::vector<const std::byte*> SceneTables::page_pointers(const std::byte* base) const {
  std::vector<const std::byte*> pointers;
  pointers.reserve(page_offset.size());
  for (const uint64_t offset : page_offset) pointers.push_back(base + offset);
  return pointers;
}

kernels::SceneView SceneTables::view(const std::byte* const* pages) const {
  kernels::SceneView scene{};
  scene.meshes = meshes.data();
  scene.chunks = chunks.data();
  scene.instances = instances.data();
  scene.instance_base = instance_base.data();
  scene.matrices = matrices.data();
  scene.pages = pages;
  scene.mesh_count = meshes.size();
  scene.chunk_count = chunks.size();
  scene.chunk_kinds = kernels::kinds_of(meshes, chunks);
  scene.instance_count = instances.size();
  scene.matrix_count = matrices.size();
  return scene;
}

Result<SceneTables> make_tables(const synth::Scene& scene, std::span<const ChunkPlan> plans,
                                std::span<const ChunkBox> boxes, const Encoding& encoding) {
  assert(plans.size() == boxes.size());
  SceneTables tables;
  tables.boxes.assign(boxes.begin(), boxes.end());
  uint64_t page_bytes = 0;
  for (size_t first = 0; first < plans.size();) {
    const uint32_t number = plans[first].mesh;
    const synth::MeshRecipe& recipe = scene.meshes[number];
    size_t end = first;
    while (end < plans.size() && plans[end].mesh == number) ++end;
    Result<format::MeshRecord> mesh = make_mesh(recipe, whole_box(boxes.subspan(first, end - first)), encoding);
    if (!mesh) return Error{mesh.error().code, "mesh " + std::to_string(number) + ": " + mesh.error().message};
    mesh->first_chunk = first;
    mesh->chunk_count = end - first;
    for (; first < end; ++first) {
      format::ChunkRecord chunk = make_chunk(recipe, plans[first], *mesh, boxes[first], encoding);
      place_chunk(tables, page_bytes, chunk);
      mesh->vertex_count += chunk.vertex_count;
      tables.chunks.push_back(chunk);
    }
    tables.meshes.push_back(*mesh);
  }
  assert(tables.meshes.size() == scene.meshes.size());
  add_instances(scene, tables);
  return tables;
}

}  // namespace scree::lab
