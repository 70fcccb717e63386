// Measures the distances of the vertices and normals of a .scree file from its source.
#pragma once

#include <cstdint>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/gltf/source.h"

namespace scree::compare {

/// Distances of vertices in model units, and relative to the diagonal of the mesh's box in the source.
class Distances {
 public:
  void add(double distance, double diagonal);
  uint64_t count() const { return count_; }
  double max() const { return max_; }
  double rms() const { return root(squares_); }
  double relative_max() const { return relative_max_; }
  double relative_rms() const { return root(relative_squares_); }

 private:
  double root(double squares) const;
  uint64_t count_ = 0;
  double max_ = 0, squares_ = 0, relative_max_ = 0, relative_squares_ = 0;
};

/// A mesh whose largest error is above the bound that its record states.
struct BrokenBound {
  uint64_t mesh;
  double error;  // per axis
  double bound;
};

struct GeometryReport {
  uint64_t meshes = 0;
  uint64_t triangles = 0;
  uint64_t missing_triangles = 0;   // of the source, which the file lacks
  uint64_t unknown_triangles = 0;   // of the file, which the source lacks (or which the file has twice)
  Distances stored;                 // of every stored vertex from its source vertex
  Distances source;                 // of every used source vertex from the farthest of its stored copies
  double axis_error = 0;            // largest error of a coordinate; MeshRecord::max_position_error is its bound
  double axis_bound = 0;            // largest stated bound
  std::vector<BrokenBound> broken;  // meshes that exceed their own bound
  uint64_t normals = 0;             // compared vertex normals; source normals without a direction are not compared
  double normal_degrees = 0;        // largest angle
  uint64_t faces = 0;               // triangles with an area in both
  double face_degrees = 0;          // largest angle between their normals
};

/// Matches every stored triangle with its source by number. Holds one source primitive and one chunk in memory at a
/// time. Errors: those of for_each_mesh (source_model.h; kUnsupported: no source triangle numbers) and
/// ChunkReader::read.
Result<GeometryReport> compare_geometry(const convert::SourceScene& scene, const format::Container& file);

}  // namespace scree::compare
