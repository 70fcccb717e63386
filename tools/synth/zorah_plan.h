// The counts of NVIDIA's Zorah, for scenes with the same counts and generated content. This file has no data of Zorah.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/synth/block_texture.h"
#include "tools/synth/scenes.h"

namespace scree::synth {

/// A set of accessors, which several primitives may share.
struct ZorahGroup {
  uint64_t triangles = 0;
  uint64_t vertices = 0;
  uint32_t buffer = 0;  // number of its buffer file
  bool normals = false, uvs = false, tangents = false;
};

enum class ZorahKind : uint8_t { kFloor, kWall, kColumn, kProp, kMountain, kKite };

struct ZorahMesh {
  uint32_t first_group = 0;         // a group per primitive, one after another
  std::vector<uint32_t> materials;  // one per primitive
  uint32_t nodes = 0;               // nodes that draw it once
  uint32_t instances = 0;           // instances of its node with EXT_mesh_gpu_instancing; 0: there is no such node
  ZorahKind kind = ZorahKind::kProp;
};

/// The properties of a material. Textures are numbers, or kNone.
struct ZorahMaterial {
  enum class Alpha : uint8_t { kOpaque, kMask, kBlend };
  Alpha alpha = Alpha::kOpaque;
  bool double_sided = false, unlit = false, transmission = false, specular = false, transform = false;
  uint32_t color, surface, normals, specular_texture, emission;
};

struct ZorahPlan {
  std::string name;  // "zorah" or "zorah-textured"
  std::vector<ZorahGroup> groups;
  std::vector<ZorahMesh> meshes;
  std::vector<ZorahMaterial> materials;
  std::vector<BlockTexture> textures;
  uint32_t buffers = 1;      // of geometry
  uint32_t parents = 0;      // nodes that have children
  uint32_t png_images = 0;   // the first textures, this many, are declared as PNGs
  uint32_t tile_images = 0;  // number of textures, from the first on, that are named like UDIM tiles
  SceneCamera camera;        // y up, 60 degrees

  uint64_t unique_triangles() const;
  uint64_t drawn_triangles() const;
  uint64_t vertices() const;
  uint64_t drawn_meshes() const;
  uint64_t primitives() const;
};

/// The geometry alone ("zorah_main_public.v2.gltf"), and the textured scene ("zorah_textured_public.v1.gltf"). `scale`
/// (0 < scale <= 1) is the share of the triangles, vertices and texels that is kept; all other counts stay. At scale 1
/// the counts equal those of the files.
ZorahPlan zorah_plan(double scale);
ZorahPlan zorah_textured_plan(double scale);

}  // namespace scree::synth
