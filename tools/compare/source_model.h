// A glTF scene for the reference rasteriser: float32 positions and indices of the source, world matrices composed in
// double, and the mesh and instance of a .scree file that each corresponds to.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/compare/reference.h"
#include "tools/convert/images/masks.h"
#include "tools/gltf/source.h"

namespace scree::compare {

/// One primitive, held in memory: 12 bytes per vertex (24 with colours, 12 more with a mask) and 12 per triangle.
struct SourceMesh {
  uint32_t primitive = 0;         // in SourceScene::primitives
  std::vector<float> positions;   // x y z
  std::vector<uint32_t> corners;  // 3 per triangle, each below the number of vertices
  std::vector<bool> kept;         // by triangle: whether convert keeps it
  uint64_t kept_count = 0;
  std::array<double, 3> base_color{1, 1, 1};  // the material's factor, linear
  std::vector<float> colors;                  // of vertices, linear red, green, blue; empty if there are none
  bool double_sided = false;
  bool unlit = false;
  std::vector<float> uvs;     // u v, if the material has a mask
  std::vector<float> alphas;  // of vertex colours with alpha, if the material has a mask
};

/// Reads a primitive. Triangles of strips and fans with two equal indices (they cover nothing) and triangles with a
/// position that is not finite are not kept. Errors as read_triangles and read_floats.
Result<SourceMesh> load_source_mesh(const convert::SourceScene& scene, uint32_t primitive);

/// Calls `take(mesh number in `file`, source mesh)` for every mesh of the file in order, one source mesh in memory at a
/// time. Source meshes that the file stores as a repeat of an earlier one are read and compared with that one, triangle
/// by triangle, but not passed to `take`. Errors: those of load_source_mesh and `take`; kFormat if the file cannot come
/// from this source (another number of nodes, meshes or triangles; a repeat that is not equal); kUnsupported if a mesh
/// has no source triangle numbers.
template <class Take>
Result<void> for_each_mesh(const convert::SourceScene& scene, const format::Container& file, const Take& take);

/// All meshes of a file, and the instances of one of its scenes in the file's order.
struct SourceModel {
  std::vector<SourceMesh> meshes;            // by mesh number in the file
  std::vector<ReferenceInstance> instances;  // in the order of the scene's instances
  std::vector<ReferenceMesh> views;          // of `meshes`, for draw_reference()
  std::map<uint32_t, ReferenceMask> masks;   // by material of the source
};

/// Upper bound of the memory that load_source_model() takes for vertices and triangles: all primitives of `scene`.
uint64_t source_model_bytes(const convert::SourceScene& scene);

/// Reads the source of everything that scene number `file_scene` of `file` draws. World matrices are composed from the
/// source's nodes. Errors as for_each_mesh, kFormat (other nodes or instances), those of read_instances.
Result<SourceModel> load_source_model(const convert::SourceScene& scene, const format::Container& file,
                                      uint32_t file_scene);

/// Steps through the source primitives that became meshes of the file, with the checks of for_each_mesh().
class MeshMatcher {
 public:
  MeshMatcher(const convert::SourceScene& scene, const format::Container& file);
  /// The next source primitive that has a mesh; nullopt at the end.
  Result<std::optional<SourceMesh>> next();
  /// The alpha masks of the source; valid after next().
  const convert::MaskPlan& masks() const { return *masks_; }
  /// The mesh number of the last one that next() returned.
  uint64_t mesh() const { return mesh_ - 1; }

 private:
  Result<void> find_stored_groups();
  Result<void> find_masks();
  Result<void> check_repeat(const SourceMesh& mesh);

  const convert::SourceScene& scene_;
  const format::Container& file_;
  std::optional<convert::MaskPlan> masks_;
  std::vector<uint32_t> stored_as_;          // by group of the source: the group of the file's nodes; kNone: not drawn
  std::vector<uint32_t> kept_;               // by group: primitives that keep a triangle, so far
  std::vector<uint32_t> primitive_of_mesh_;  // by mesh, so far
  uint32_t primitive_ = 0;
  uint64_t mesh_ = 0;
};

template <class Take>
Result<void> for_each_mesh(const convert::SourceScene& scene, const format::Container& file, const Take& take) {
  MeshMatcher matcher(scene, file);
  for (;;) {
    std::optional<SourceMesh> mesh = SCREE_TRY(matcher.next());
    if (!mesh.has_value()) return {};
    SCREE_TRY(take(matcher.mesh(), std::move(*mesh)));
  }
}

}  // namespace scree::compare
