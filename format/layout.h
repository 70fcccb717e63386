// Every fixed-size record of a .scree file, as it lies on disk (spec/container.md). Little-endian, no implicit padding:
// each struct's size is asserted. Reserved fields are written as zero and refused when set.
#pragma once

#include <cstdint>
#include <type_traits>

namespace scree::format {

inline constexpr uint8_t kMagic[8] = {0x89, 'S', 'C', 'R', 'E', 'E', '\r', '\n'};
inline constexpr uint16_t kVersionMajor = 1;
inline constexpr uint16_t kVersionMinor =
    1;  // a reader skips the additions of newer ones; TableKind marks the additions of 1
// A file has this major version if a mesh or a surface uses second texture coordinates, a mesh has tangents, or a page
// is split. A reader of version 1 refuses it.
inline constexpr uint16_t kSecondMajor = 2;
inline constexpr uint16_t kSecondMinor = 0;

inline constexpr uint64_t kPageAlignment = 4096;        // so that O_DIRECT can read pages
inline constexpr uint64_t kPageTargetBytes = 1u << 20;  // a chunk that would take a page past this starts a new page
inline constexpr uint64_t kChunkAlignment = 16;         // of chunks in a page and streams in a chunk
inline constexpr uint64_t kTableAlignment = 64;
inline constexpr uint32_t kNone = 0xffffffffu;         // no mesh, parent, texture, camera, ...
inline constexpr uint32_t kMaxChunkTriangles = 65536;  // the default limit; --chunk-triangles 0 lifts it
inline constexpr uint32_t kMaxPositionBits = 24;       // a lattice offset is exact in a float
inline constexpr uint32_t kMaxUvBits = 24;
// Limits of a zstd page's raw bytes, so that a small hostile file cannot make a reader allocate much memory:
// kPageTargetBytes, or more if the file has at least one stored byte per kMaxZstdRatio raw bytes, up to
// kMaxZstdPageBytes. Larger pages are kept raw.
inline constexpr uint64_t kMaxZstdRatio = 16;
inline constexpr uint64_t kMaxZstdPageBytes = 1u << 30;
// Pixels. The product of two sides and a pixel's bytes fits 64 bits.
inline constexpr uint32_t kMaxImageSide = 1u << 24;

/// First bytes of the file. `checksum` is XXH3-64 (seed 0) of the 56 bytes before it.
struct FileHeader {
  uint8_t magic[8];
  uint16_t version_major;
  uint16_t version_minor;
  uint32_t header_bytes;  // sizeof(FileHeader)
  uint64_t file_bytes;    // of the whole file
  uint64_t toc_offset;    // bytes from the start, kTableAlignment
  uint32_t toc_count;     // entries
  uint32_t reserved;
  uint64_t toc_checksum;  // XXH3-64 of the entries
  uint64_t reserved2;
  uint64_t checksum;
};
static_assert(sizeof(FileHeader) == 64);

enum class TableKind : uint32_t {
  kPages = 1,
  kMeshes = 2,
  kChunks = 3,
  kGroups = 4,
  kNodes = 5,
  kInstances = 6,
  kMatrices = 7,
  kNodeInstances = 8,
  kMaterials = 9,
  kTextures = 10,
  kImages = 11,
  kCameras = 12,
  kScenes = 13,
  kSceneRoots = 14,
  kStrings = 15,
  kSource = 16,
  kLeftOut = 17,
  kMipLevels = 18,
  kLeftOutCosts = 19,
  kSurfaces = 20,  // of minor version 1, as all below
  kLights = 21,
  kMasks = 22,
};

/// One table. A reader skips unknown kinds. Records of a known kind may be larger (a newer minor version); they are
/// read with the stride `record_bytes`.
struct TocEntry {
  TableKind kind;
  uint32_t record_bytes;
  uint64_t record_count;
  uint64_t offset;    // bytes from the start of the file, kTableAlignment
  uint64_t checksum;  // XXH3-64 of the record_bytes * record_count bytes
};
static_assert(sizeof(TocEntry) == 32);

enum class PageKind : uint32_t { kGeometry = 1, kImage = 2, kMask = 3 };
enum class PageCodec : uint32_t {
  kRaw = 0,
  kZstd = 1,
  // 2 was an earlier way to split clusters, of scree 0.1.
  kSplit = 3,  // of major version 2; zstd of clusters split into streams (spec/codecs.md, split pages)
};

/// A range of the file that is read, checked, compressed and kept resident as a whole. Geometry pages hold chunks and
/// have at most kPageTargetBytes; a larger chunk has a page of its own. An image page holds one image file, a mask page
/// the levels of one mask.
struct PageRecord {
  uint64_t offset;        // kPageAlignment
  uint64_t stored_bytes;  // in the file
  uint64_t raw_bytes;     // after decompression; equal to stored_bytes when raw
  uint64_t checksum;      // XXH3-64 of the stored bytes
  PageKind kind;          // a reader skips unknown kinds
  PageCodec codec;        // kZstd, kSplit: exactly one frame
};
static_assert(sizeof(PageRecord) == 40);

enum class PositionEncoding : uint8_t { kLattice = 0, kFloat32 = 1 };

/// Bits of MeshRecord::attributes: the streams of each chunk of the mesh, in this order after indices and positions.
enum AttributeFlags : uint32_t {
  kHasUv = 1,
  kHasColor = 2,
  kHasNormal = 4,
  kHasSourceIds = 8,
  kHasSecondUv = 16,  // of major version 2, with kHasUv
  kHasTangent = 32,   // of major version 2, with kHasNormal
};
inline constexpr uint32_t kSecondAttributes = kHasSecondUv | kHasTangent;

/// A glTF primitive: triangles with one material. A lattice position is (lattice_min + offset) * 2^lattice_exponent,
/// with offset < 2^lattice_bits on each axis. With float32 positions the lattice fields are zero.
struct MeshRecord {
  uint64_t triangle_count;
  uint64_t vertex_count;         // stored, summed over chunks (border vertices count once per chunk)
  uint64_t source_vertex_count;  // of the source's position accessor
  uint64_t first_chunk;
  uint64_t chunk_count;
  int64_t lattice_min[3];
  float bounds_min[3];  // of the decoded positions
  float bounds_max[3];
  double max_position_error;  // model units, per axis, stated bound: half a step and half an ulp; 0 for float32
  float max_uv_error;         // per axis
  int32_t lattice_exponent;   // the step is 2^lattice_exponent model units; -149 to 127
  uint8_t lattice_bits[3];    // 0 (flat) to kMaxPositionBits
  PositionEncoding position_encoding;
  uint32_t attributes;  // AttributeFlags
  uint32_t material;    // or kNone: the default material
  uint32_t group;
};
static_assert(sizeof(MeshRecord) == 120);

enum class ChunkEncoding : uint8_t { kIndexed = 0, kClustered = 1 };

/// Triangles of one mesh and the vertices they use (spec/codecs.md). The payload is a sequence of streams, each
/// kChunkAlignment-aligned: indices and positions, or the clusters' data for both; then the streams of the mesh's
/// attributes.
struct ChunkRecord {
  uint64_t offset;          // bytes from the start of the page's raw bytes, kChunkAlignment
  uint64_t bytes;           // of the payload, a multiple of kChunkAlignment
  uint64_t first_triangle;  // in the mesh; the sum of the triangle counts of the chunks before
  uint32_t page;
  uint32_t mesh;
  uint32_t triangle_count;  // at least 1; at most kMaxChunkTriangles if index_bits is 0 (such indices take no bytes)
  uint32_t vertex_count;    // at least 1, at most 3 * triangle_count
  uint32_t index_min;
  uint32_t position_min[3];  // lattice offset of code 0, relative to MeshRecord::lattice_min
  int64_t uv_min[2];         // lattice coordinate of code 0
  int32_t uv_exponent;       // as MeshRecord::lattice_exponent
  uint8_t index_bits;        // 0 to 32
  uint8_t position_bits[3];  // 0 to kMaxPositionBits; 32 each for float32
  uint8_t uv_bits[2];        // 0 to 24
  uint8_t normal_bits;       // per axis of the octahedral map; 0 without normals
  uint8_t source_bits;       // 0 to 32
  ChunkEncoding encoding;
  uint8_t second_uv_bits[2];  // 0 to 24; the rest of the range is in a SecondUvHeader
  uint8_t tangent_bits;       // 3 to 16: one of them is the bitangent's sign; 0 without tangents
  uint64_t source_min;        // source triangle number of code 0
  uint32_t cluster_count;     // clustered: at least 1
  uint32_t cluster_words;     // clustered: 4-byte words of the clusters' data
};
static_assert(sizeof(ChunkRecord) == 104);

/// The first bytes of a chunk's stream of second texture coordinates, which continues like the first coordinates.
struct SecondUvHeader {
  int64_t min[2];    // as ChunkRecord::uv_min
  int32_t exponent;  // as ChunkRecord::uv_exponent
  uint32_t reserved[3];
};
static_assert(sizeof(SecondUvHeader) == 32);

/// A glTF mesh: consecutive MeshRecords.
struct GroupRecord {
  uint32_t name;  // string offset
  uint32_t first_mesh;
  uint32_t mesh_count;
  uint32_t reserved;
};
static_assert(sizeof(GroupRecord) == 16);

enum NodeFlags : uint32_t { kNodeHasMatrix = 1 };

/// A glTF node. A parent comes before its children.
struct NodeRecord {
  uint32_t name;
  uint32_t parent;  // or kNone
  uint32_t group;   // or kNone
  uint32_t camera;  // or kNone
  uint32_t flags;   // NodeFlags
  uint32_t reserved;
  uint64_t first_node_instance;  // EXT_mesh_gpu_instancing: kNodeInstances records of this node
  uint64_t node_instance_count;  // 0: the node is drawn once
  double local[16];  // kNodeHasMatrix: column-major matrix; else translation 3, rotation xyzw 4, scale 3, zeros
};
static_assert(sizeof(NodeRecord) == 168);

/// An instance of a mesh in a scene. Sorted by scene, then mesh, then node and index in the node. Global triangle ids
/// are the exclusive prefix sum of the meshes' triangle counts over the instances of one scene.
struct InstanceRecord {
  uint32_t mesh;
  uint32_t node;
  uint32_t matrix;
  uint32_t node_instance;  // index among the node's instances; 0 where it has none
};
static_assert(sizeof(InstanceRecord) == 16);

/// A world matrix, composed in double from the nodes: three rows of (x, y, z, translation).
struct MatrixRecord {
  double rows[3][4];
};
static_assert(sizeof(MatrixRecord) == 96);

struct NodeInstanceRecord {
  float translation[3];
  float rotation[4];  // xyzw, unit length
  float scale[3];
};
static_assert(sizeof(NodeInstanceRecord) == 40);

enum MaterialFlags : uint32_t {
  kMaterialDoubleSided = 1,
  kMaterialUnlit = 2,
  kMaterialAlphaMask = 4,   // kept for export; a MaskRecord decides what is drawn
  kMaterialAlphaBlend = 8,  // blends; a MaskRecord has the alpha of its texture
};
inline constexpr uint32_t kMaterialCutOut = kMaterialAlphaMask | kMaterialAlphaBlend;  // may have a MaskRecord

struct MaterialRecord {
  uint32_t name;
  uint32_t texture;     // base colour, or kNone
  float base_color[4];  // linear RGBA factor
  float uv_offset[2];   // KHR_texture_transform
  float uv_scale[2];
  float uv_rotation;  // radians, counter-clockwise
  float alpha_cutoff;
  uint32_t flags;  // MaterialFlags
  uint32_t reserved;
};
static_assert(sizeof(MaterialRecord) == 56);

/// The uses of a surface's textures, in the order of SurfaceRecord::textures. Emission and the specular colour are
/// sRGB-coded. The other textures hold numbers: roughness in green and metalness in blue, the normal map's x, y and z
/// in red, green and blue, occlusion in red, specular in alpha.
enum class SurfaceUse : uint32_t { kMetallicRoughness, kNormalMap, kOcclusion, kEmission, kSpecular, kSpecularColor };
inline constexpr uint32_t kSurfaceUses = 6;

/// Whether a texture of this use is sRGB-coded colour.
constexpr bool is_color(SurfaceUse use) {
  return use == SurfaceUse::kEmission || use == SurfaceUse::kSpecularColor;
}

struct SurfaceTexture {
  uint32_t texture;    // or kNone
  float uv_offset[2];  // KHR_texture_transform
  float uv_scale[2];
  float uv_rotation;  // radians, counter-clockwise
};
static_assert(sizeof(SurfaceTexture) == 24);

/// The part of a material beyond its base colour: glTF's metallic-roughness model. A material without such a part has
/// no record. The records ascend by material.
struct SurfaceRecord {
  uint32_t material;
  float metallic;   // 0 to 1
  float roughness;  // 0 to 1, perceptual
  float normal_scale;
  float occlusion_strength;  // 0 to 1
  float emission[3];         // linear, KHR_materials_emissive_strength multiplied in
  float ior;                 // KHR_materials_ior: 1 or more; 0 reflects all light
  float specular;            // KHR_materials_specular, 0 to 1
  float specular_color[3];
  uint32_t second_uv;  // bits by SurfaceUse: the textures that use the mesh's second texture coordinates
  SurfaceTexture textures[kSurfaceUses];
};
static_assert(sizeof(SurfaceRecord) == 200);

enum class LightKind : uint32_t { kDirectional = 1, kPoint = 2, kSpot = 3 };

/// A light of KHR_lights_punctual at a node. It shines along the node's -z, in the scenes that have the node.
struct LightRecord {
  uint32_t name;
  uint32_t node;
  LightKind kind;
  uint32_t reserved;
  float color[3];    // linear
  float intensity;   // candela; directional: lux
  float range;       // in units; 0: unlimited
  float inner_cone;  // spot: radians from the axis, where the light begins to fall off
  float outer_cone;  // spot: radians at which the light ends, above inner_cone, at most pi / 2
  uint32_t reserved2;
};
static_assert(sizeof(LightRecord) == 48);

enum class Wrap : uint16_t { kRepeat = 0, kMirror = 1, kClamp = 2 };

/// glTF's numbers of a sampler's filters; 0 where the source gives none.
enum Filter : uint16_t {
  kFilterNearest = 9728,
  kFilterLinear = 9729,
  kFilterNearestMipmapNearest = 9984,
  kFilterLinearMipmapNearest = 9985,
  kFilterNearestMipmapLinear = 9986,
  kFilterLinearMipmapLinear = 9987,
};
/// Whether a filter takes the nearest texel of a level.
constexpr bool takes_nearest_texel(uint16_t filter) {
  return filter == kFilterNearest || filter == kFilterNearestMipmapNearest || filter == kFilterNearestMipmapLinear;
}
/// Whether a minification filter takes level 0 alone.
constexpr bool takes_finest_level(uint16_t filter) {
  return filter == kFilterNearest || filter == kFilterLinear;
}
/// Whether a minification filter takes the nearest level alone.
constexpr bool takes_nearest_level(uint16_t filter) {
  return filter == kFilterNearestMipmapNearest || filter == kFilterLinearMipmapNearest;
}

struct TextureRecord {
  uint32_t name;
  uint32_t image;
  Wrap wrap_s;
  Wrap wrap_t;
  uint16_t mag_filter;
  uint16_t min_filter;
};
static_assert(sizeof(TextureRecord) == 16);

/// kIndexedJpeg and kBlocks: spec/codecs.md, indexed JPEG and block image. The others are unchanged image files.
enum class ImageCodec : uint32_t { kJpeg = 1, kPng = 2, kIndexedJpeg = 3, kBlocks = 4 };

/// Content of a block of a block image: 4 x 4 pixels compressed as BCn, or one uncompressed pixel.
enum class BlockFormat : uint8_t {
  kNoBlocks = 0,
  kBc1 = 1,
  kBc2 = 2,
  kBc3 = 3,
  kBc4 = 4,
  kBc5 = 5,
  kBc7 = 7,
  kR8 = 8,
  kRg8 = 9,
  kRgba8 = 10
};

struct ImageRecord {
  uint32_t name;
  uint32_t page;  // the page that it fills
  ImageCodec codec;
  uint32_t width;  // pixels
  uint32_t height;
  uint8_t channels;          // 1 to 4
  BlockFormat block_format;  // for kBlocks, else kNoBlocks
  uint16_t swizzle;          // for kBlocks (format/blocks/format.h), else 0
  uint32_t first_level;      // index of its mip level 1 in kMipLevels, or kNone
  uint32_t level_count;      // stored_level_count() for an indexed JPEG, any number for a block image, else 0
};
static_assert(sizeof(ImageRecord) == 32);

/// A mip level of an indexed JPEG or a block image, in the image's own codec.
struct MipLevelRecord {
  uint64_t offset;  // bytes from the start of the page's raw bytes, a multiple of 16
  uint64_t bytes;
  uint32_t page;
  uint32_t image;
};
static_assert(sizeof(MipLevelRecord) == 24);

enum MaskFlags : uint32_t { kMaskNearest = 1, kMaskOfColors = 2 };

/// How a masked material cuts triangles that have texture coordinates, or vertex colours if kMaskOfColors is set
/// (spec/rasterization.md, alpha masks).
/// Level l of the alpha is max(1, width >> l) by max(1, height >> l) bytes. The levels fill the page one after the
/// other.
struct MaskRecord {
  uint32_t material;  // strictly ascending
  uint32_t page;      // a page of kind kMask; masks may share it
  uint32_t width;     // texels of level 0, 1 to kMaxMaskSide
  uint32_t height;
  uint32_t level_count;  // 1 to max_mask_levels()
  uint32_t threshold;    // smallest alpha that passes, 1 to kMaxMaskThreshold, in 1 / 65536 of an 8-bit code
  Wrap wrap_s;
  Wrap wrap_t;
  uint32_t flags;      // MaskFlags
  double place[2][3];  // maps texture coordinates (u, v, 1) to the mask: KHR_texture_transform
};
static_assert(sizeof(MaskRecord) == 80);

inline constexpr uint32_t kMaxMaskSide = 65536;
inline constexpr uint32_t kMaxMaskThreshold = 255 * 65536;

enum class CameraKind : uint32_t { kPerspective = 1, kOrthographic = 2 };

struct CameraRecord {
  uint32_t name;
  CameraKind kind;
  double y;  // perspective: vertical field of view in radians; orthographic: half height in units
  double x;  // perspective: aspect ratio or 0; orthographic: half width
  double z_near;
  double z_far;  // 0: infinite
};
static_assert(sizeof(CameraRecord) == 40);

struct SceneRecord {
  uint32_t name;
  uint32_t flags;  // 1: the document's default scene
  uint64_t first_instance;
  uint64_t instance_count;
  uint64_t first_root;  // in kSceneRoots: u32 node indices
  uint64_t root_count;
  uint64_t triangle_count;  // drawn: summed over the instances
};
static_assert(sizeof(SceneRecord) == 48);

/// The source that the file was made from, one record, for inspect's ratios.
struct SourceRecord {
  uint64_t json_bytes;
  uint64_t buffer_bytes;     // of all buffers, as declared
  uint64_t file_bytes;       // of the files read: document, buffers, images
  uint64_t index_bytes;      // of the index accessors used, each counted once
  uint64_t position_bytes;   // of the position accessors used, each counted once
  uint64_t attribute_bytes;  // of all other vertex attributes of the primitives used, each accessor once
  uint32_t name;             // file name without its folder
  uint32_t options;          // the options that shaped the bytes, as one string
  uint32_t generator;        // the program and its version, "scree 0.2.0"
  uint32_t copyright;        // the source's asset.copyright
};
static_assert(sizeof(SourceRecord) == 64);

/// Source data that this file leaves out: its kind (a string such as "NORMAL" or "skins"), its count, its bytes in the
/// source.
struct LeftOutRecord {
  uint32_t what;
  uint32_t reserved;
  uint64_t count;
  uint64_t source_bytes;
};
static_assert(sizeof(LeftOutRecord) == 24);

// kLeftOutCosts has a u64 per LeftOutRecord: about the bytes that the data would have taken in the file; 0 where
// unknown. A file need not have the table.

}  // namespace scree::format
