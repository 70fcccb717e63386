// The input of the passes: plain pointers into memory that the runtime owns (the mapped file on a CPU, device memory on
// a GPU). Records are the file's own (format/layout.h), validated. Page contents are validated before a pass reads
// them.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>

#include "format/container/mip_levels.h"
#include "format/jpeg/pixels.h"
#include "format/layout.h"
#include "kernels/math.h"

namespace scree::kernels {

/// A mip level that is decoded when it is sampled. The picture and the data of a paged level lie in a page of
/// SceneView::pager. The picture lies `place` bytes from the page's address.
struct JpegLevel {
  static constexpr uint32_t kNotPaged = ~uint32_t{0};

  format::JpegPicture picture;  // unused if the level is paged
  uint32_t number;              // unique in the scene
  uint32_t page = kNotPaged;    // its number
  uint64_t place = 0;
  uint64_t first_group = 0;  // the number of its group 0 among all groups of the scene
  uint32_t group_count = 0;  // numbered groups; a paged level may turn out to have more
};

/// The groups (format/jpeg/pixels.h) of a scene's JPEG levels.
struct JpegGroups {
  uint64_t count = 0;
  uint32_t pixels = 0;  // of the largest; 0: there are no JPEG levels
};

/// The alpha of a masked material's triangles (spec/rasterization.md, alpha masks): level l is max(1, width >> l) by
/// max(1, height >> l) bytes, rows top to bottom, the levels one after the other.
struct MaskView {
  static constexpr uint32_t kMostLevels = std::bit_width(format::kMaxMaskSide);

  const uint8_t* alpha;                // null: the material is opaque
  uint64_t level_offset[kMostLevels];  // bytes from `alpha` to each level
  uint32_t width;
  uint32_t height;
  uint32_t level_count;
  uint32_t threshold;  // of the alpha at a point, in 1 / 65536 of an 8-bit code
  double place[2][3];  // of texture coordinates (u, v, 1)
  bool is_placed;      // `place` changes them
  format::Wrap wrap_s;
  format::Wrap wrap_t;
  bool magnified_nearest;  // the nearest texel where a sample covers less than one
  bool minified_nearest;   // and where it covers more
  uint32_t needs;  // an attribute of meshes: kHasUv, or kHasColor if the alpha of vertex colours alone is the mask

  /// Sets level_offset and is_placed from the other members.
  void complete() {
    for (uint32_t l = 0; l < level_count; ++l) level_offset[l] = format::mask_bytes(width, height, l);
    is_placed = false;
    for (int i = 0; i < 6; ++i) is_placed = is_placed || place[i / 3][i % 3] != (i % 4 == 0 ? 1.0 : 0.0);
  }
};

class JpegGroupCache;
class TexelPager;

/// How a scene's chunks are encoded, so that a pass over one kind is compiled without the others: indexed with float32
/// positions, indexed with lattice positions, clustered (always on a lattice), or kMixed for any of them.
enum class ChunkKinds : uint32_t { kMixed, kFloat32, kPacked, kClustered };

inline ChunkKinds kinds_of(std::span<const format::MeshRecord> meshes, std::span<const format::ChunkRecord> chunks) {
  bool first = true;
  ChunkKinds kinds = ChunkKinds::kMixed;
  for (const format::ChunkRecord& chunk : chunks) {
    const bool float32 = meshes[chunk.mesh].position_encoding == format::PositionEncoding::kFloat32;
    const ChunkKinds kind = chunk.encoding == format::ChunkEncoding::kClustered ? ChunkKinds::kClustered
                            : float32                                           ? ChunkKinds::kFloat32
                                                                                : ChunkKinds::kPacked;
    if (!std::exchange(first, false) && kind != kinds) return ChunkKinds::kMixed;
    kinds = kind;
  }
  return kinds;
}

/// A texture with its mip levels. Level l is max(1, width >> l) by max(1, height >> l) texels. The first levels may be
/// JPEGs, the first of which may be paged, and `level_offset[l]` is then JpegLevel::first_group; or blocks that begin
/// `level_offset[l]` bytes from `blocks`. The first levels of blocks may be paged: their rows lie in the pages of
/// SceneView::pager from number `level_offset[l]` on (format::block_rows()). The others are decoded: 4 bytes per texel
/// (RGBA8, sRGB-coded colour, linear alpha), rows top to bottom, `level_offset[l]` texels from `texels`.
struct TextureView {
  static constexpr uint32_t kMaxLevels = 17;  // 65536 x 65536
  const uint8_t* texels;
  uint64_t level_offset[kMaxLevels];
  uint32_t width;
  uint32_t height;
  uint32_t level_count;       // 0: no picture, drawn as white
  uint32_t jpeg_level_count;  // the first of them
  const JpegLevel* jpeg;      // levels 0 to jpeg_level_count - 1
  const uint8_t* blocks;      // levels 0 to block_level_count - 1 (format/blocks/pixels.h)
  uint32_t block_level_count;
  uint32_t paged_level_count;  // the first of them
  format::BlockFormat block_format;
  uint16_t swizzle;
  format::Wrap wrap_s;
  format::Wrap wrap_t;
  bool magnified_nearest;  // the nearest texel where a sample covers less than one
  bool minified_nearest;   // and where it covers more
  bool one_level;          // the nearest level alone, not two
  bool finest_level;       // level 0 alone
};

/// A material's surface and textures. The textures are in bundles: those of a bundle have their texels at the same
/// places, so that a sample finds the places once for all of them (shade/material_views.h makes these records).
struct MaterialView {
  static constexpr uint32_t kMostBundles = format::kSurfaceUses + 1;
  static constexpr uint32_t kBaseUse = format::kSurfaceUses;  // the use of the base colour's texture
  static constexpr uint32_t kSamePoint = 0x80;

  uint32_t surface = format::kNone;
  bool is_packed = false;  // occlusion lies in the picture of metalness and roughness, at the same places
  uint8_t uses = 0;        // the bits of all bundles
  /// By bundle: one bit per use, SurfaceUse or kBaseUse; 0 after the last bundle. kSamePoint: the bundle differs from
  /// the bundle before, but has the same point and footprint on its textures.
  uint8_t bundles[kMostBundles] = {};
};

/// A light of the drawn scene, in world space.
struct PlacedLight {
  double position[3];
  float direction[3];  // unit length, the direction of the light's rays
  float color[3];      // times its intensity
  float range;         // 0: unlimited
  float cone_scale;    // spot: KHR_lights_punctual's lightAngleScale and lightAngleOffset
  float cone_offset;
  format::LightKind kind;
};

/// One scene of a file. "By material" and the like name the index of an array.
struct SceneView {
  const format::MeshRecord* meshes;
  const format::ChunkRecord* chunks;
  const format::InstanceRecord* instances;  // the drawn scene's
  const uint64_t*
      instance_base;  // instance_count + 1 values: exclusive prefix sum of triangles, each instance's first global id
  const format::MatrixRecord* matrices;
  const format::MaterialRecord* materials;
  const format::SurfaceRecord* surfaces;
  const MaterialView* material_views;  // by material
  const PlacedLight* lights;           // the drawn scene's
  const float* environment;            // shade/environment.h; null if there is none
  const TextureView* textures;         // by texture record
  const std::byte* const* pages;       // raw bytes by page number, 16-byte aligned; null: not a geometry page
  uint64_t mesh_count;
  uint64_t chunk_count;
  uint64_t instance_count;
  uint64_t matrix_count;
  uint64_t material_count;
  uint64_t texture_count;
  uint64_t surface_count;  // 0: only base colours
  uint32_t light_count;
  ChunkKinds chunk_kinds;  // kMixed is correct for every scene
  JpegGroupCache* blocks;  // cache of the textures' JPEG levels; null if there are none, and on a GPU
  TexelPager* pager;       // of the textures' paged levels; null likewise (on a GPU CudaTextureCache has it)
  const MaskView* masks;   // by material; null: no material is masked
  // By material: the alpha of blended surfaces (spec/rasterization.md, blending). The threshold leaves out samples of
  // alpha 0. Null: no material blends.
  const MaskView* blend_masks;
  bool draws_blended;  // frames draw layers of blended surfaces, not the opaque picture
};

inline namespace SCREE_ISA {

/// The level whose texels are nearest in size to a footprint, found by the exponent alone. `footprint`: squared, in
/// texels of level 0. NaN and infinity take the last level.
SCREE_HD inline uint32_t nearest_level(float footprint, uint32_t level_count) {
  const int32_t exponent = static_cast<int32_t>(float_bits(footprint) >> 23 & 255u) - 127;
  return min_of(exponent <= 0 ? 0u : static_cast<uint32_t>(exponent + 1) >> 1, level_count - 1);
}

/// Whether samples of the mesh's triangles may have an alpha below 1 that blends.
SCREE_HD inline bool may_blend(const SceneView& scene, const format::MeshRecord& mesh) {
  if (scene.blend_masks == nullptr || mesh.material == format::kNone) return false;
  const format::MaterialRecord& material = scene.materials[mesh.material];
  if ((material.flags & format::kMaterialAlphaBlend) == 0) return false;
  return material.base_color[3] < 1.0f || (mesh.attributes & format::kHasColor) != 0 ||
         ((mesh.attributes & format::kHasUv) != 0 && scene.blend_masks[mesh.material].alpha != nullptr);
}

/// Whether frames of the view draw the mesh. The opaque picture has the samples of blended surfaces whose alpha is 1. A
/// mask finds them if the alpha comes from a texture alone.
SCREE_HD inline bool draws_mesh(const SceneView& scene, const format::MeshRecord& mesh) {
  if (scene.blend_masks == nullptr) return true;
  if (!may_blend(scene, mesh)) return !scene.draws_blended;
  return scene.draws_blended ||
         (scene.materials[mesh.material].base_color[3] >= 1.0f && (mesh.attributes & format::kHasColor) == 0);
}

/// The view whose frames draw the layers of blended surfaces. Requires that scene.blend_masks is not null.
inline SceneView blended_view(SceneView scene) {
  scene.masks = scene.blend_masks;
  scene.draws_blended = true;
  return scene;
}

}  // namespace SCREE_ISA

}  // namespace scree::kernels
