// Matches the triangles of two .scree files that were made from the same source, with any encodings.
#pragma once

#include <compare>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "format/result.h"
#include "runtime/scene/scene.h"

namespace scree::compare {

/// A triangle of an instance, by numbers that two scenes have in common.
struct CommonTriangle {
  uint64_t instance;  // in the second scene
  uint64_t number;    // in the mesh: source number, or number as stored
  bool operator==(const CommonTriangle&) const = default;
};

/// A triangle as a file stores it.
struct StoredTriangle {
  uint64_t chunk;
  uint32_t place;  // triangle number in the chunk
  auto operator<=>(const StoredTriangle&) const = default;
};

/// The indices of `triangles` sorted by chunk, so that each chunk is decoded once. Throws std::bad_alloc.
std::vector<uint64_t> by_chunk(std::span<const StoredTriangle> triangles);

/// Matches two scenes of different files of one source, or one scene with itself. The scenes must outlive it; their
/// pages need not be loaded.
class SceneMatch {
 public:
  /// One scene; its own triangle numbers are used.
  explicit SceneMatch(const runtime::Scene& both) : a_(&both), b_(&both) {}

  /// Two scenes. Instances are matched by node, node instance and primitive of the glTF mesh. Triangles are matched by
  /// their source numbers if all drawn meshes have them, else by their number in the mesh. Errors kFormat: the files
  /// cannot be from one source, because their instances, world matrices or numbers of triangles differ, or their boxes
  /// are farther apart than the stated errors allow. Throws std::bad_alloc.
  static Result<SceneMatch> match(const runtime::Scene& a, const runtime::Scene& b);

  const runtime::Scene& first() const { return *a_; }
  const runtime::Scene& second() const { return *b_; }

  struct Resolved {
    std::vector<CommonTriangle> a, b;  // one per id, in the same order
  };
  /// The triangles of ids of the two scenes. Each id must be below its scene's number of triangles. Errors:
  /// kUnsupported if there are two scenes without source numbers, and the chunk of an id differs from its counterpart
  /// in the other file. (Equal chunks have the same number of triangles from the same first one, the same index list,
  /// and vertices no farther apart than the stated errors allow.) Errors of ChunkReader::read, with the file. Throws
  /// std::bad_alloc.
  Result<Resolved> resolve(std::span<const uint64_t> ids_a, std::span<const uint64_t> ids_b) const;

  /// Finds where the second scene stores `triangles`; results are in the same order. Errors: kFormat if a mesh has no
  /// triangle of that number; those of ChunkReader::read, with the file. Throws std::bad_alloc.
  Result<std::vector<StoredTriangle>> find(std::span<const CommonTriangle> triangles) const;

 private:
  SceneMatch(const runtime::Scene& a, const runtime::Scene& b) : a_(&a), b_(&b) {}
  std::string names() const;
  Result<void> match_instances();

  const runtime::Scene* a_;
  const runtime::Scene* b_;
  std::vector<uint64_t> b_of_a_;  // by instance of a: the instance of b; empty for one scene
  std::vector<uint64_t> a_of_b_;
  bool by_source_ = false;
};

}  // namespace scree::compare
