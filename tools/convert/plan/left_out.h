// Lists the parts of a source that convert leaves out, with their bytes in the source and in the file.
#pragma once

#include <cstdint>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "format/container/container.h"
#include "tools/convert/encode/encode.h"
#include "tools/convert/images/images.h"
#include "tools/convert/windows/duplicates.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// Sums the bytes of accessors, each counted once.
class AccessorBytes {
 public:
  void add(const Accessor& accessor) {
    if (!seen_.insert(accessor.index).second) return;
    bytes_ += accessor.count * accessor.element_bytes();
    ++count_;
  }
  /// Adds all accessors of a primitive.
  void add(const Primitive& primitive);
  /// Excludes these accessors from the sum.
  void leave(const AccessorBytes& others) { seen_.insert(others.seen_.begin(), others.seen_.end()); }
  uint64_t bytes() const { return bytes_; }
  uint64_t count() const { return count_; }

 private:
  std::set<uint32_t> seen_;
  uint64_t bytes_ = 0;
  uint64_t count_ = 0;
};

/// Sets the bytes in the source of the stored primitives' indices, positions and attributes. `mesh_of`: by primitive of
/// SourceScene::primitives, its mesh or kNone.
void add_source_bytes(const SourceScene& scene, const std::vector<uint32_t>& mesh_of, format::SourceRecord& source);

/// Names for normals that Normals::kAuto leaves out because they change no picture.
inline constexpr const char* kFaceNormals = "NORMAL (as of the faces)";
inline constexpr const char* kUnlitNormals = "NORMAL (of unlit materials)";
/// The same for tangents (derived_tangents.h).
inline constexpr const char* kDerivedTangents = "TANGENT (as texture coordinates give them)";

/// The results of a conversion after its geometry is written.
struct LeftOutFacts {
  const SourceScene& scene;
  std::span<const MeshPlan> plans;         // in the order of the tables' meshes
  std::span<const uint32_t> mesh_of;       // by primitive, or kNone
  std::span<const Measured> measured;      // by primitive
  std::span<const uint32_t> stored_group;  // by group
  const ImagePlan& images;
  MergedMaterials merged;
  EncodedFacts encoded;
  Normals normals = Normals::kAuto;
  uint64_t undrawn = 0;  // primitives
  uint64_t dropped_degenerate = 0;
  uint64_t dropped_nonfinite = 0;
  uint64_t clear = 0;  // primitives that their alpha masks hide entirely
};

/// Fills left_out and left_out_costs of `tables`, whose meshes and chunks are complete.
void add_left_out(const LeftOutFacts& facts, format::TableSet& tables);

/// One line per kind of data that is left out or replaced although it may show in a picture.
std::vector<std::string> left_out_warnings(const LeftOutFacts& facts);

/// The parts that are lost, from TableSet::left_out. Repeated and unused data, and data that readers derive, are not.
std::vector<LeftOut> lost_parts(const format::TableSet& tables);

}  // namespace scree::convert
