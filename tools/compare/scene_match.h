// Which triangle of one .scree file is which of another that was made from the same source, however each is encoded.
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
  uint64_t instance;  // of the second scene
  uint64_t number;    // in the mesh: of the source primitive, or as stored
  bool operator==(const CommonTriangle&) const = default;
};

/// A triangle as a file stores it.
struct StoredTriangle {
  uint64_t chunk;
  uint32_t place;  // in the chunk
  auto operator<=>(const StoredTriangle&) const = default;
};

/// The places 0, 1, ... of `triangles`, those of a chunk beside each other, so that each is decoded once. Throws
/// std::bad_alloc.
std::vector<uint64_t> by_chunk(std::span<const StoredTriangle> triangles);

/// Two scenes, each of a file, that show one source; or one scene, twice. They outlive it, and need no pages loaded.
class SceneMatch {
 public:
  /// One scene: its own triangle numbers.
  explicit SceneMatch(const runtime::Scene& both) : a_(&both), b_(&both) {}

  /// Two scenes. Instances are matched by node, node instance and place in the glTF mesh; triangles by their source
  /// numbers where all meshes that are drawn have them, else by their place in the mesh. Errors kFormat where the files
  /// cannot be of one source: they draw other instances, world matrices, numbers of triangles, or boxes that lie
  /// farther apart than the stated errors allow. Throws std::bad_alloc.
  static Result<SceneMatch> match(const runtime::Scene& a, const runtime::Scene& b);

  const runtime::Scene& first() const { return *a_; }
  const runtime::Scene& second() const { return *b_; }

  struct Resolved {
    std::vector<CommonTriangle> a, b;  // as many as ids, in their order
  };
  /// What triangle ids of the two scenes stand for, each below its scene's number of triangles. Errors: kUnsupported
  /// where the scenes are two, without source numbers, and a chunk that an id lies in is not that of the other file: as
  /// many triangles from the same place on, the same index list, vertices no farther apart than the stated errors
  /// allow; those of ChunkReader::read, the file named. Throws std::bad_alloc.
  Result<Resolved> resolve(std::span<const uint64_t> ids_a, std::span<const uint64_t> ids_b) const;

  /// Where the second scene stores triangles: as many as are asked for, in their order. Errors: kFormat where a mesh
  /// has no triangle of that number; those of ChunkReader::read, the file named. Throws std::bad_alloc.
  Result<std::vector<StoredTriangle>> find(std::span<const CommonTriangle> triangles) const;

 private:
  SceneMatch(const runtime::Scene& a, const runtime::Scene& b) : a_(&a), b_(&b) {}
  std::string names() const;
  Result<void> match_instances();

  const runtime::Scene* a_;
  const runtime::Scene* b_;
  std::vector<uint64_t> b_of_a_;  // instance of b by that of a; empty for one scene
  std::vector<uint64_t> a_of_b_;
  bool by_source_ = false;
};

}  // namespace scree::compare
