// One frame, seen from outside kernels/: the scene, the view and the buffers. cpu/passes.h draws it on the CPU,
// cuda/frame/frame.h on a GPU.
#pragma once

#include <cstdint>
#include <span>

#include "format/hd.h"
#include "format/result.h"
#include "kernels/scene_view.h"
#include "kernels/visbuffer.h"

namespace scree::kernels {

/// A camera, and the instances and the space that it leaves out. World space is right-handed. View space looks along
/// `forward`, with x to the right and y up. Row 0 is the top of the picture. right, up and forward are orthonormal to
/// 1e-12.
struct View {
  double eye[3];
  double right[3];
  double up[3];
  double forward[3];
  bool orthographic = false;
  double half_width;  // at distance 1 (perspective: tan of half the horizontal field of view) or in world units
                      // (orthographic)
  double half_height;
  double z_near;   // > 0 for perspective; triangles nearer are clipped
  double z_far;    // orthographic only; perspective has no far plane
  uint32_t width;  // samples (after supersampling), 1 to kMaxImageSide
  uint32_t height;
  // One bit per instance of the scene, the lowest of a word first; instances whose bit is set are not drawn. In memory
  // that the drawing device reads. Null: all are drawn.
  const uint32_t* omitted = nullptr;
  // The clipping box, if `clips`: samples outside are not drawn. World space, the smallest and largest corner.
  bool clips = false;
  double clip_min[3] = {};
  double clip_max[3] = {};

  bool operator==(const View&) const = default;
};

/// Rows of a picture, from `first` to `end` - 1.
struct RowRange {
  uint32_t first = 0;
  uint32_t end = 0;

  bool is_empty() const { return first == end; }
};

enum class Show : uint32_t {
  kTexture,
  kColor,
  kUv,
  kNormal,
  kTriangle,
  kCluster,
  kMesh,
  kStage,
  kDepth,
  kSurface,  // kTexture with materials or lights (shades_surfaces()); chosen internally
};

/// The light of a textured picture.
enum class Lighting : uint32_t {
  kAuto,         // kEnvironment if the drawn scene has surfaces and an environment, else kCamera
  kCamera,       // from the camera, on matt surfaces: base colours, normal maps, occlusion and emission
  kEnvironment,  // from all around (SceneView::environment; kCamera if there is none)
  kScene,        // only the file's lights
};

inline constexpr uint32_t kBlendLayers = 16;

inline constexpr uint32_t kMostSunMaps = 4;

/// The places that the rays of a directional light reach: visibility buffers of orthographic views along them. A
/// surface has the shadows of the first map that contains all samples around it, or of the last map.
struct SunShadow {
  struct Map {
    const uint64_t* samples;  // view.width * view.height, in memory that the shading device reads
    View view;                // its samples are squares
  };
  uint32_t light;  // index in SceneView::lights
  uint32_t map_count;
  Map maps[kMostSunMaps];
};

struct ShadeOptions {
  Show show = Show::kTexture;
  bool light = true;  // false: base colours without light (kTexture and kColor)
  Lighting lighting = Lighting::kAuto;
  float exposure = 1;                    // factor of the light of kEnvironment and kScene
  float background[4] = {0, 0, 0, 0};    // linear RGBA
  uint32_t blend_layers = kBlendLayers;  // the most layers of blended surfaces that are drawn
  const SunShadow* sun = nullptr;        // of kScene; outlives the shading. Null: no light casts shadows
  // One factor per pixel for the light of its surfaces, computed from the picture's depths. Applies to every Show.
  bool ssao = false;              // ambient occlusion
  bool edl = false;               // eye-dome lighting
  float ssao_radius = 1.0f / 40;  // share of the picture's height, at the pixel's depth
  float edl_strength = 1;         // 0: none
  uint32_t edl_radius = 1;        // pixels
};

inline namespace SCREE_ISA {

/// The light that a picture gets.
inline Lighting lighting_of(const SceneView& scene, const ShadeOptions& options) {
  if (!options.light) return Lighting::kCamera;
  const bool has_environment = scene.environment != nullptr;
  if (options.lighting == Lighting::kAuto)
    return has_environment && scene.surface_count != 0 ? Lighting::kEnvironment : Lighting::kCamera;
  return options.lighting == Lighting::kEnvironment && !has_environment ? Lighting::kCamera : options.lighting;
}

/// Whether samples are shaded as Show::kSurface. Scenes of base colours under the camera's light are not.
inline bool shades_surfaces(const SceneView& scene, const ShadeOptions& options) {
  if (options.show != Show::kTexture || !options.light) return false;
  return scene.surface_count != 0 || lighting_of(scene, options) != Lighting::kCamera;
}

/// Whether a picture has layers of blended surfaces (kernels/blend.h). All other kinds of pictures show the opaque
/// picture.
inline bool shows_layers(const SceneView& scene, const ShadeOptions& options) {
  return scene.blend_masks != nullptr && (options.show == Show::kTexture || options.show == Show::kColor);
}

}  // namespace SCREE_ISA

/// The layers of blended surfaces in a picture.
struct BlendCounts {
  uint32_t layers = 0;
  uint64_t samples_left_out = 0;  // samples with more layers than were drawn
};

/// Times of one resolve by the GPU's clock.
struct ResolveTimes {
  float occlusion_ms = 0;  // ambient occlusion and eye-dome lighting; 0 if neither is requested
  float resolve_ms = 0;    // shading, averaging and coding; with blended layers all of it, by the host's clock
};

/// How the last picture used a GPU's cache of JPEG textures.
struct TextureCacheCounts {
  uint64_t asked = 0;    // groups that pixels requested because they were absent, counted once per round
  uint64_t decoded = 0;  // of these, decoded into the cache
  uint64_t rounds = 0;   // rounds that left pixels unfinished
  uint64_t tiles = 0;    // tiles of 8 x 4 pixels with pixels that decoded groups by themselves in the end
};

/// A triangle and where it lies in the scene. Picking prints it, and shading starts from it.
struct Hit {
  uint64_t instance;  // index in SceneView::instances
  uint64_t chunk;     // index in SceneView::chunks
  uint32_t triangle;  // number in the chunk
};

/// Counters of one frame. `triangles` includes triangles that occlusion culling removed. Their number depends on the
/// order of drawing: on threads, and on queues that were too small at first.
struct FrameStats {
  uint64_t instances_drawn;
  uint64_t draws;  // (instance, chunk) pairs after culling
  uint64_t triangles;
  uint64_t triangles_small;
  uint64_t triangles_medium;
  uint64_t triangles_large;
  uint64_t triangles_clipped;
  // Counts of clustered chunks.
  uint64_t groups_tested;  // groups of 32 clusters
  uint64_t clusters_tested;
  uint64_t clusters_drawn;
};

inline FrameStats& operator+=(FrameStats& sum, const FrameStats& frame) {
  sum.instances_drawn += frame.instances_drawn;
  sum.draws += frame.draws;
  sum.triangles += frame.triangles;
  sum.triangles_small += frame.triangles_small;
  sum.triangles_medium += frame.triangles_medium;
  sum.triangles_large += frame.triangles_large;
  sum.triangles_clipped += frame.triangles_clipped;
  sum.groups_tested += frame.groups_tested;
  sum.clusters_tested += frame.clusters_tested;
  sum.clusters_drawn += frame.clusters_drawn;
  return sum;
}

/// The checks of a frame that all backends share. Errors kRange: an image side of 0 or over kMaxImageSide, a camera
/// that is not finite or whose view is empty, more than 2^36 - 1 drawn triangles.
Result<void> check_frame(const View& view, uint64_t triangle_count);

/// The checks of a resolve that all backends share: whole pixels of `samples_per_side` (1, 2 or 4) samples per side,
/// and a camera that check_frame() accepts. Errors kRange.
Result<void> check_resolve(const View& view, uint32_t samples_per_side);

/// Draws with `threads` CPU threads into `samples` (width * height, row by row), which it clears first. The result does
/// not depend on the number of threads or on the instruction set. Errors kRange: more than 2^36 - 1 drawn triangles, an
/// image side over kMaxImageSide; kMemory.
Result<FrameStats> draw_cpu(const SceneView& scene, const View& view, std::span<uint64_t> samples, uint32_t threads);

/// Finished pixels: shades every sample, averages the `samples_per_side` squared samples of a pixel in linear light,
/// weighted by their alpha, and codes the result as 8-bit sRGB. `view` and `samples`: of the whole picture, in samples;
/// both sides are multiples of `samples_per_side` (1, 2 or 4). `pixels`: width * height pixels of `channels` bytes, row
/// by row. 4 channels are RGBA with linear alpha, not premultiplied; 3 leave the alpha out. Draws layers of blended
/// surfaces over the samples; `blended`: null, or filled in. Errors kRange (sizes that do not fit each other), kMemory.
Result<void> resolve_cpu(const SceneView& scene, const View& view, uint32_t samples_per_side,
                         std::span<const uint64_t> samples, const ShadeOptions& options, uint32_t channels,
                         std::span<uint8_t> pixels, uint32_t threads, BlendCounts* blended = nullptr);

/// The share of the light of each pixel's surfaces that ShadeOptions::ssao and edl leave: factors from 0 to 1, row by
/// row. Both work on pixels, not on samples; a pixel's depth is that of its nearest sample. Errors kRange, kMemory.
Result<void> occlusion_cpu(const View& view, uint32_t samples_per_side, std::span<const uint64_t> samples,
                           const ShadeOptions& options, std::span<float> visibility, uint32_t threads);

/// The layers of a picture beside its colours, row by row from the top. A pixel shows its nearest sample. Layers with
/// null pointers are not made. The CPU and every GPU give the same bits.
struct LayerTargets {
  float* depth;       // depth_of_code(), infinity on the background
  int64_t* triangle;  // global id, -1 on the background
  int32_t* instance;  // index in SceneView::instances (at most 2^31), -1 on the background
  float* normal;      // 3 floats: unit length, world space, of the front side even where the back is visible; 0 on the
                      // background
  float* uv;  // 2 floats: as stored in the mesh, without a material's transform; 0 if there are none, and on the
              // background
};

/// Makes the layers of a picture. `view` and `samples`: as for resolve_cpu(). Errors kRange, kMemory.
Result<void> layers_cpu(const SceneView& scene, const View& view, uint32_t samples_per_side,
                        std::span<const uint64_t> samples, const LayerTargets& out, uint32_t threads);

/// Finds the triangle of a global id below instance_base[instance_count], by binary search.
Hit find_triangle(const SceneView& scene, uint64_t triangle_id);

/// The distance of the centre of a depth code from the plane through the eye that is perpendicular to View::forward, in
/// world units; infinity for the background.
double depth_of_code(const View& view, uint32_t depth_code);

}  // namespace scree::kernels
