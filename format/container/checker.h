// The checks behind check_records, table by table. check.cpp has their order.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <optional>
#include <type_traits>

#include "format/blocks/format.h"
#include "format/container/check.h"

namespace scree::format {

/// Branch-free, so that the compiler vectorises it. A number is NaN or infinite if its exponent is all ones; adding one
/// to the exponent then carries into the sign bit.
template <class Float>
bool all_finite(const Float* values, uint32_t count) {
  using Bits = std::conditional_t<sizeof(Float) == 4, uint32_t, uint64_t>;
  constexpr Bits kSign = Bits{1} << (8 * sizeof(Bits) - 1);
  constexpr Bits kExponentOne = sizeof(Float) == 4 ? Bits{1} << 23 : static_cast<Bits>(uint64_t{1} << 52);
  Bits carries = 0;
  for (uint32_t i = 0; i < count; ++i) carries |= (std::bit_cast<Bits>(values[i]) & ~kSign) + kExponentOne;
  return (carries & kSign) == 0;
}

/// "mesh 3: group 7, but the file has 2 groups".
inline Error fail_index(const char* kind, uint64_t index, const char* field, uint64_t value, uint64_t count,
                        const char* things) {
  return fail(ErrorCode::kRange, kind, " ", index, ": ", field, " ", value, ", but the file has ", count, " ", things);
}

/// Part `index` of `count` parts of a table. The parts are checked in order.
struct Part {
  uint64_t index = 0;
  uint64_t count = 1;

  uint64_t begin(uint64_t records) const { return records * index / count; }  // records < 2^32, parts < 2^32
  uint64_t end(uint64_t records) const { return records * (index + 1) / count; }
  bool is_last() const { return index + 1 == count; }
};

inline constexpr uint64_t kReadAheadBytes = 16 << 10;

class Checker {
 public:
  Checker(const TableViews& tables, TableReader& reader) : tables_(tables), reader_(reader) {}

  // One function per table or per part of a table. Errors kRange, kReserved, kFormat; each gives the record and the
  // field.
  Result<void> strings();
  Result<void> pages() const;
  Result<void> meshes(Part part);
  Result<void> groups() const;
  Result<void> nodes(Part part) const;
  Result<void> node_instances() const;
  Result<void> matrices(Part part) const;
  Result<void> scenes(Part part);
  Result<void> scene_roots() const;
  Result<void> materials() const;
  Result<void> surfaces() const;
  Result<void> lights() const;
  Result<void> textures() const;
  Result<void> images() const;
  Result<void> masks() const;
  Result<void> cameras() const;
  Result<void> source() const;

 private:
  std::optional<Error> mesh_fields(uint64_t index) const;
  std::optional<Error> scene_fields(uint64_t index) const;
  std::optional<Error> page_of(const char* kind, uint64_t index, uint64_t page, PageKind expected,
                               const char* content) const;
  std::optional<Error> blocks_of(uint64_t image) const;
  std::optional<Error> block_pages_of(const char* what, uint64_t number, uint64_t first, const BlockRows& rows) const;
  std::optional<Error> levels_of(uint64_t image, uint64_t first) const;
  Result<void> instances_to(uint64_t end);

  /// Called before a record is read for the first time. Prefetches the records one block ahead, so that the next
  /// block's checksum does not wait for memory.
  void announce(TableKind kind, uint64_t index) const {
    const TableView& table = tables_.view(kind);
    const uintptr_t ahead = reinterpret_cast<uintptr_t>(table.first) + index * table.stride + kReadAheadBytes;
    for (uint64_t line = 0; line < std::min<uint64_t>(table.stride, 192); line += 64) {
      __builtin_prefetch(reinterpret_cast<const void*>(ahead + line), 0, 2);
    }
    uint64_t& announced = announced_[static_cast<uint32_t>(kind)];
    if (index >= announced) [[unlikely]]
      announced = reader_.announce(kind, index);
  }

  bool name_is_bad(uint32_t offset) const { return offset >= string_bytes_; }
  Error fail_name(const char* kind, uint64_t index, uint32_t offset) const {
    return fail(ErrorCode::kRange, kind, " ", index, ": string at ", offset, ", but the strings take ", string_bytes_,
                " bytes");
  }

  const TableViews& tables_;
  TableReader& reader_;
  mutable std::array<uint64_t, kKnownTableKinds> announced_{};
  uint64_t string_bytes_ = 0;

  // State of meshes().
  uint64_t next_chunk_ = 0;
  uint64_t source_vertices_ = 0;
  uint64_t group_ = 0;              // groups begun so far; meshes must be in the order of their groups
  uint64_t group_end_ = 0;          // the first mesh after it
  bool groups_may_differ_ = false;  // groups() has to check every mesh

  // State of scenes().
  uint64_t scene_ = 0;
  bool in_scene_ = false;  // its instances are being checked
  bool default_seen_ = false;
  uint64_t next_instance_ = 0;
  uint64_t instances_end_ = 0;  // first instance after the scene's
  uint64_t scene_triangles_ = 0;
  uint32_t previous_mesh_ = 0;

  Table<PageRecord> pages_ = tables_.table<PageRecord>(TableKind::kPages);
  Table<MeshRecord> meshes_ = tables_.table<MeshRecord>(TableKind::kMeshes);
  Table<ChunkRecord> chunks_ = tables_.table<ChunkRecord>(TableKind::kChunks);
  Table<GroupRecord> groups_ = tables_.table<GroupRecord>(TableKind::kGroups);
  Table<NodeRecord> nodes_ = tables_.table<NodeRecord>(TableKind::kNodes);
  Table<InstanceRecord> instances_ = tables_.table<InstanceRecord>(TableKind::kInstances);
  Table<MatrixRecord> matrices_ = tables_.table<MatrixRecord>(TableKind::kMatrices);
  Table<NodeInstanceRecord> node_instances_ = tables_.table<NodeInstanceRecord>(TableKind::kNodeInstances);
  Table<MaterialRecord> materials_ = tables_.table<MaterialRecord>(TableKind::kMaterials);
  Table<TextureRecord> textures_ = tables_.table<TextureRecord>(TableKind::kTextures);
  Table<ImageRecord> images_ = tables_.table<ImageRecord>(TableKind::kImages);
  Table<SurfaceRecord> surfaces_ = tables_.table<SurfaceRecord>(TableKind::kSurfaces);
  Table<LightRecord> lights_ = tables_.table<LightRecord>(TableKind::kLights);
  Table<MipLevelRecord> mip_levels_ = tables_.table<MipLevelRecord>(TableKind::kMipLevels);
  Table<MaskRecord> masks_ = tables_.table<MaskRecord>(TableKind::kMasks);
  Table<CameraRecord> cameras_ = tables_.table<CameraRecord>(TableKind::kCameras);
  Table<SceneRecord> scenes_ = tables_.table<SceneRecord>(TableKind::kScenes);
  Table<uint32_t> scene_roots_ = tables_.table<uint32_t>(TableKind::kSceneRoots);
};

}  // namespace scree::format
