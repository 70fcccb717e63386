// The viewpoint of a scene: a camera of the file, the caller's eye, or a view that shows the whole scene.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "format/vec3.h"
#include "kernels/frame.h"
#include "kernels/scene_view.h"

namespace scree::runtime {

using scree::Vec3;

/// An axis-aligned box in world space; empty where min > max.
struct WorldBox {
  static constexpr double kFar = std::numeric_limits<double>::infinity();
  Vec3 min{kFar, kFar, kFar};
  Vec3 max{-kFar, -kFar, -kFar};
  bool operator==(const WorldBox&) const = default;
  bool is_empty() const { return !(min[0] <= max[0]); }
  /// Extends the box to the point.
  void add(const Vec3& point) {
    for (size_t i = 0; i < 3; ++i) {
      min[i] = point[i] < min[i] ? point[i] : min[i];
      max[i] = point[i] > max[i] ? point[i] : max[i];
    }
  }
};

/// The eight corners of a mesh's box in world space.
std::array<Vec3, 8> box_corners(const format::MeshRecord& mesh, const format::MatrixRecord& matrix);

/// The box of everything that the scene's instances draw. It is made from their meshes' boxes, so it is slightly too
/// large for rotated instances.
WorldBox scene_box(const kernels::SceneView& scene);

/// A camera of the document on a node of the chosen scene.
struct PlacedCamera {
  uint32_t camera;  // number in the document
  uint32_t node;
  std::array<std::array<double, 4>, 3> world;  // of the node, rows of (x, y, z, translation)
};

/// The cameras of a scene in the order of their nodes.
std::vector<PlacedCamera> placed_cameras(const format::Container& container, uint32_t scene);

/// The caller's choices. The defaults give a view that shows the whole scene, from the front, right and above (glTF
/// models look along +z).
struct CameraOptions {
  std::string camera = {};          // name of a camera or of its node, or the camera's number in the document
  std::optional<Vec3> eye = {};     // excludes `camera`
  std::optional<Vec3> target = {};  // default: the middle of the scene's box
  std::optional<Vec3> up = {};      // default: y
  // Direction of the default view: degrees to the right of the scene's front, and degrees above it, -90 to 90.
  double turn_degrees = 30;
  double rise_degrees = 20;
  std::optional<double> fov_degrees = {};  // vertical, at least 1e-9, below 180; replaces a document camera's own
  std::optional<WorldBox> clip_box = {};   // the view's clipping box; it does not change the camera
  uint32_t width = 1920;                   // of the picture, in samples; width / height is the aspect ratio
  uint32_t height = 1080;
};

inline constexpr double kDefaultFovDegrees = 45;
inline constexpr double kSmallestFovDegrees = 1e-9;  // below it the sides of the picture get lost in rounding

/// A camera as two row-major 4 x 4 matrices: world to camera, which looks along -z with y up, and camera to clip space,
/// as in OpenGL (w = -z, depths from -1 to 1).
struct CameraMatrices {
  std::array<double, 16> view;
  std::array<double, 16> projection;
  double z_near = 0;  // if above 0: replaces the near plane of `projection`, for other depth ranges
};

/// The view of `camera`, of width x height samples. Errors kUsage: a view that is no rotation and translation (to 1e-4;
/// it is orthonormalised to 1e-12), a projection that is neither a perspective nor an orthographic one around the
/// middle of the picture, no near plane.
Result<kernels::View> view_of_matrices(const CameraMatrices& camera, uint32_t width, uint32_t height);

/// The world matrix, rows first, of each node of the file; nullopt for nodes that are not in the scene.
using Rows = std::array<std::array<double, 4>, 3>;
std::vector<std::optional<Rows>> world_matrices(const format::Container& container, uint32_t scene);

class Scene;

/// Whether make_view() reads vertices, so that `drawn` must have its pages. True for the default view if at most 2^20
/// vertices are drawn.
bool view_reads_vertices(const kernels::SceneView& drawn, const CameraOptions& options);

/// The view of `options`. The vertical field of view stays the same for any aspect ratio. The default view shows all
/// vertices, or the corners of the instances' boxes if there are more than 2^20 vertices. The near plane is the
/// camera's own (see below), else a small fraction of the distance to the scene's box (of the box's size if the eye is
/// inside).
/// `scene` must have its pages loaded if view_reads_vertices(). Errors kUsage (no such camera, with a list of the
/// existing ones; an eye without a direction), kFormat (a camera node whose matrix has no direction), kMemory.
Result<kernels::View> make_view(const Scene& scene, const CameraOptions& options);

/// The view of one of placed_cameras(), whatever its name. The planes of an orthographic camera are brought to the
/// scene's box, and a near plane below 2^-60 of the scene's distance is raised. Errors kUsage, kFormat as above.
Result<kernels::View> make_view(const Scene& scene, const PlacedCamera& camera, const CameraOptions& options);

}  // namespace scree::runtime
