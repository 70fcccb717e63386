// One frame, seen from outside kernels/: what to draw, from where, into which buffers. The CPU draws it by the passes
// of passes.h, a GPU as cuda/frame.h says.
#pragma once

#include <cstdint>
#include <span>

#include "format/hd.h"
#include "format/result.h"
#include "kernels/scene_view.h"
#include "kernels/visbuffer.h"

namespace scree::kernels {

/// A camera. World space is right-handed; view space looks along `forward`, x right, y up; the picture's row 0 is its
/// top. right, up and forward are orthonormal to 1e-12.
struct View {
  double eye[3];
  double right[3];
  double up[3];
  double forward[3];
  bool orthographic = false;
  double
      half_width;  // at distance 1 (perspective: tan of half the horizontal field of view) or in units (orthographic)
  double half_height;
  double z_near;   // > 0 for perspective; triangles nearer are clipped
  double z_far;    // orthographic only; perspective has no far plane
  uint32_t width;  // samples (after supersampling), 1 to kMaxImageSide
  uint32_t height;
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
  kSurface,  // kTexture where lighting_of() says so: nobody asks for it
};

/// Where the light of a textured picture comes from.
enum class Lighting : uint32_t {
  kAuto,         // kEnvironment where the drawn scene has surfaces and an environment, else kCamera
  kCamera,       // from the camera, on matt surfaces: base colours, normal maps, occlusion and emission
  kEnvironment,  // from all around (SceneView::environment; where there is none, kCamera)
  kScene,        // the file's lights alone
};

inline constexpr uint32_t kBlendLayers = 16;

struct ShadeOptions {
  Show show = Show::kTexture;
  bool light = true;  // false: base colours as they are (kTexture and kColor)
  Lighting lighting = Lighting::kAuto;
  float exposure = 1;                    // a factor for the light of kEnvironment and kScene
  float background[4] = {0, 0, 0, 0};    // linear RGBA
  uint32_t blend_layers = kBlendLayers;  // of blended surfaces, the most that are drawn; in pictures of light alone
  // Factors a pixel, from the picture's depths, for the light of its surfaces, whatever is shown.
  bool ssao = false;              // ambient occlusion
  bool edl = false;               // eye-dome lighting
  float ssao_radius = 1.0f / 40;  // of the picture's height, at the pixel's depth
  float edl_strength = 1;         // 0: none
  uint32_t edl_radius = 1;        // pixels
};

inline namespace SCREE_ISA {

/// The light that a picture has.
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

/// Whether a picture has layers of blended surfaces (kernels/blend.h). What else is shown is the opaque picture.
inline bool shows_layers(const SceneView& scene, const ShadeOptions& options) {
  return scene.blend_masks != nullptr && (options.show == Show::kTexture || options.show == Show::kColor);
}

}  // namespace SCREE_ISA

/// The layers of blended surfaces in a picture.
struct BlendCounts {
  uint32_t layers = 0;
  uint64_t samples_left_out = 0;  // that have more layers than were drawn
};

/// Times of one resolve by the GPU's clock.
struct ResolveTimes {
  float occlusion_ms = 0;  // ambient occlusion and eye-dome lighting: 0 where neither is asked for
  float resolve_ms = 0;    // shading, averaging and coding
};

/// What the last picture asked of a GPU's cache of JPEG textures.
struct TextureCacheCounts {
  uint64_t asked = 0;    // groups that pixels did not find, each round's once
  uint64_t decoded = 0;  // of them, into the cache
  uint64_t rounds = 0;   // in which pixels were left over
  uint64_t tiles = 0;    // of 8 x 4 pixels, whose pixels decoded for themselves in the end
};

/// Which triangle and where: what picking prints and shading starts from.
struct Hit {
  uint64_t instance;  // of SceneView::instances
  uint64_t chunk;     // of SceneView::chunks
  uint32_t triangle;  // in the chunk
};

/// Counters of one frame. What was left out because something hid it depends on who drew first: on threads, on queues
/// that were too small at first. `triangles` counts it.
struct FrameStats {
  uint64_t instances_drawn;
  uint64_t draws;  // (instance, chunk) pairs after culling
  uint64_t triangles;
  uint64_t triangles_small;
  uint64_t triangles_medium;
  uint64_t triangles_large;
  uint64_t triangles_clipped;
  // Of clustered chunks.
  uint64_t groups_tested;  // of 32 clusters
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

/// What every backend asks of a frame. Errors kRange: an image side of 0 or over kMaxImageSide, a camera that is not
/// finite or sees nothing, more than 2^36 - 1 drawn triangles.
Result<void> check_frame(const View& view, uint64_t triangle_count);

/// What every backend asks of a picture to resolve: whole pixels of `samples_per_side` (1, 2 or 4) samples a side, and
/// a camera as check_frame() wants it. Errors kRange.
Result<void> check_resolve(const View& view, uint32_t samples_per_side);

/// Draws with `threads` CPU threads into `samples` (width * height, row by row), which it clears first. The result does
/// not depend on the number of threads or on the instruction set. Errors kRange: more than 2^36 - 1 drawn triangles, an
/// image side over kMaxImageSide; kMemory.
Result<FrameStats> draw_cpu(const SceneView& scene, const View& view, std::span<uint64_t> samples, uint32_t threads);

/// Shades a band of rows: linear RGBA floats, 4 a sample, not premultiplied; background where there is no triangle.
/// `samples`: the whole picture's. `rgba`: whole rows from `first_row` on; its size says how many, so that the floats
/// of a large picture need not all be there at once. Show::kDepth spreads its greys over the whole picture.
Result<void> shade_cpu(const SceneView& scene, const View& view, std::span<const uint64_t> samples,
                       const ShadeOptions& options, std::span<float> rgba, uint32_t threads, uint32_t first_row = 0);

/// Finished pixels: every sample shaded, `samples_per_side` squared of them averaged a pixel in linear light weighted
/// by their alpha, coded as 8-bit sRGB. `view` and `samples`: the whole picture's, in samples; both sides are multiples
/// of `samples_per_side` (1, 2 or 4). `pixels`: width * height pixels of `channels` bytes, row by row: 4 are RGBA,
/// alpha linear and not premultiplied; 3 leave the alpha out. Errors kRange (sizes that do not fit each other),
/// kMemory. Layers of blended surfaces are drawn here, over the samples; `blended`: null, or filled in.
Result<void> resolve_cpu(const SceneView& scene, const View& view, uint32_t samples_per_side,
                         std::span<const uint64_t> samples, const ShadeOptions& options, uint32_t channels,
                         std::span<uint8_t> pixels, uint32_t threads, BlendCounts* blended = nullptr);

/// What ShadeOptions::ssao and edl leave of the light of every pixel's surfaces: factors from 0 to 1, row by row. Both
/// work on pixels, not on samples: a pixel's depth is that of its nearest sample. Errors kRange, kMemory.
Result<void> occlusion_cpu(const View& view, uint32_t samples_per_side, std::span<const uint64_t> samples,
                           const ShadeOptions& options, std::span<float> visibility, uint32_t threads);

/// What programs read of a picture beside its colours, row by row from the top. A pixel shows its nearest sample. Null
/// pointers are not made. The CPU and every GPU give the same bits.
struct LayerTargets {
  float* depth;       // depth_of_code(), infinity on the background
  int64_t* triangle;  // global id, -1 on the background
  int32_t* instance;  // index in SceneView::instances (2^31 at most), -1 on the background
  float* normal;      // 3: unit length, world space, of the front also where the back is seen; 0 on the background
  float* uv;          // 2: as the mesh has them, no material's transform applied; 0 without any and on the background
};

/// Makes the layers of a picture; `view` and `samples` as for resolve_cpu(). Errors kRange, kMemory.
Result<void> layers_cpu(const SceneView& scene, const View& view, uint32_t samples_per_side,
                        std::span<const uint64_t> samples, const LayerTargets& out, uint32_t threads);

/// The triangle of a global id below instance_base[instance_count]; binary search.
Hit find_triangle(const SceneView& scene, uint64_t triangle_id);

/// Distance from the eye's plane (perspective) or eye plane (orthographic) in world units at a depth code's centre;
/// infinity for the background.
double depth_of_code(const View& view, uint32_t depth_code);

}  // namespace scree::kernels
