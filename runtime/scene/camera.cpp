#include "runtime/scene/camera.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <new>
#include <span>
#include <string_view>
#include <utility>

#include "format/geometry/chunk_layout.h"
#include "format/geometry/cluster_codec.h"
#include "format/geometry/position_codec.h"
#include "format/geometry/rotation.h"
#include "format/text.h"
#include "runtime/scene/scene.h"

namespace scree::runtime {
namespace {

using kernels::View;

constexpr double kDegree = 3.14159265358979323846 / 180.0;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Returns nullopt for a vector without a direction.
std::optional<Vec3> normalized(const Vec3& a) {
  const double size = length(a);
  if (!(size > 0) || !std::isfinite(size)) return std::nullopt;
  const Vec3 once = (1.0 / size) * a;
  return (1.0 / length(once)) * once;  // the second pass normalises tiny vectors to within 1e-16
}

Rows compose(const Rows& a, const Rows& b) {
  Rows out{};
  for (size_t i = 0; i < 3; ++i)
    for (size_t j = 0; j < 4; ++j)
      out[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j] + (j == 3 ? a[i][3] : 0.0);
  return out;
}

Rows local_matrix(const format::NodeRecord& node) {
  Rows rows{};
  const double* const v = node.local;
  if (node.flags & format::kNodeHasMatrix) {
    for (size_t i = 0; i < 3; ++i)
      for (size_t j = 0; j < 4; ++j) rows[i][j] = v[4 * j + i];
    return rows;
  }
  double rotation[3][3];
  format::rotation_matrix(v + 3, rotation);
  for (size_t i = 0; i < 3; ++i) {
    for (size_t j = 0; j < 3; ++j) rows[i][j] = rotation[i][j] * v[7 + j];
    rows[i][3] = v[i];
  }
  return rows;
}

template <class Visit>
void for_each_corner(const kernels::SceneView& scene, const Visit& visit) {
  for (uint64_t i = 0; i < scene.instance_count; ++i) {
    const format::InstanceRecord& instance = scene.instances[i];
    const format::MeshRecord& mesh = scene.meshes[instance.mesh];
    if (mesh.triangle_count == 0) continue;
    for (const Vec3& corner : box_corners(mesh, scene.matrices[instance.matrix])) visit(corner);
  }
}

constexpr uint64_t kMostVertices = 1u << 20;  // 24 MiB, a few milliseconds

bool has_few_vertices(const kernels::SceneView& scene) {
  uint64_t count = 0;
  for (uint64_t i = 0; i < scene.instance_count && count <= kMostVertices; ++i)
    count += scene.meshes[scene.instances[i].mesh].vertex_count;
  return count <= kMostVertices;
}

/// The points that the default view must show: all drawn vertices if there are few, otherwise the corners of the
/// instances' boxes. Vertices are better, because empty corners push the scene out of the middle.
class Outline {
 public:
  explicit Outline(const kernels::SceneView& scene) : scene_(scene) {
    if (has_few_vertices(scene) && !collect()) points_.clear();
  }

  template <class Visit>
  void for_each(const Visit& visit) const {
    if (points_.empty()) {
      for_each_corner(scene_, visit);
    } else {
      for (const Vec3& point : points_) visit(point);
    }
  }

 private:
  bool collect() {
    uint32_t decoded_mesh = format::kNone;  // instances of one mesh follow each other
    std::vector<float> positions;
    for (uint64_t i = 0; i < scene_.instance_count; ++i) {
      const format::InstanceRecord& instance = scene_.instances[i];
      if (instance.mesh != decoded_mesh && !decode(instance.mesh, positions)) return false;
      decoded_mesh = instance.mesh;
      const format::MatrixRecord& m = scene_.matrices[instance.matrix];
      for (size_t v = 0; v + 3 <= positions.size(); v += 3) {
        Vec3 point;
        for (size_t r = 0; r < 3; ++r)
          point[r] = m.rows[r][0] * static_cast<double>(positions[v]) +
                     m.rows[r][1] * static_cast<double>(positions[v + 1]) +
                     m.rows[r][2] * static_cast<double>(positions[v + 2]) + m.rows[r][3];
        points_.push_back(point);
      }
    }
    return true;
  }

  bool decode(uint32_t mesh_index, std::vector<float>& positions) const {
    const format::MeshRecord& mesh = scene_.meshes[mesh_index];
    positions.resize(3 * mesh.vertex_count);
    const format::MeshLattice lattice = format::lattice_of(mesh);
    uint64_t first = 0;
    for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c) {
      const format::ChunkRecord& chunk = scene_.chunks[c];
      if (first + chunk.vertex_count > mesh.vertex_count) return false;
      const std::span<float> out(positions.data() + 3 * first, 3 * size_t{chunk.vertex_count});
      const std::span<const std::byte> payload(scene_.pages[chunk.page] + chunk.offset, chunk.bytes);
      if (chunk.encoding == format::ChunkEncoding::kClustered) {
        if (!format::decode_clusters(format::cluster_streams_of(mesh, chunk, payload), {{}, {}, out})) return false;
      } else {
        const format::ChunkStream stream = format::chunk_streams(mesh, chunk).positions;
        const std::span<const std::byte> bytes = payload.subspan(stream.offset, stream.bytes);
        if (!format::decode_positions(out, lattice, format::position_range_of(chunk), bytes)) return false;
      }
      first += chunk.vertex_count;
    }
    return true;
  }

  const kernels::SceneView& scene_;
  std::vector<Vec3> points_;
};

/// Sets right, up and forward. `forward`: of unit length; `up`: any vector.
bool orient(View& view, const Vec3& forward, const Vec3& up) {
  const auto upright = normalized(up - dot(up, forward) * forward);
  if (!upright || !(length(cross(forward, up)) > 1e-9 * length(up))) return false;
  const Vec3 right = cross(forward, *upright);
  std::copy(right.begin(), right.end(), view.right);
  std::copy(upright->begin(), upright->end(), view.up);
  std::copy(forward.begin(), forward.end(), view.forward);
  return true;
}

void set_eye(View& view, const Vec3& eye) {
  std::copy(eye.begin(), eye.end(), view.eye);
}

void set_field_of_view(View& view, double radians) {
  view.half_height = std::tan(0.5 * radians);
  view.half_width = view.half_height * static_cast<double>(view.width) / view.height;
}

/// The least distance from the eye at which a part of the box may be visible. Depth keeps its precision for 64 octaves
/// from the near plane (spec/rasterization.md), so a very near plane loses no precision.
double near_of_box(const WorldBox& box, const Vec3& eye) {
  if (box.is_empty()) return 0.01;
  Vec3 outside{};
  for (size_t i = 0; i < 3; ++i) outside[i] = std::max({box.min[i] - eye[i], eye[i] - box.max[i], 0.0});
  const double size = length(box.max - box.min);
  const double near = std::max(0.01 * length(outside), 1e-6 * size);
  return near > 0 && std::isfinite(near) ? near : 0.01;
}

/// Brings the planes of a file's camera to the scene. The depths of an orthographic view divide the range between the
/// planes evenly, and those of a perspective one end 64 octaves behind the near plane.
void fit_planes(View& view, const WorldBox& box) {
  if (box.is_empty()) return;
  const Vec3 eye{view.eye[0], view.eye[1], view.eye[2]}, forward{view.forward[0], view.forward[1], view.forward[2]};
  const double size = length(box.max - box.min);
  double low = kInfinity, high = -kInfinity;
  for (size_t k = 0; k < 8; ++k) {
    const Vec3 corner{(k & 1 ? box.max : box.min)[0], (k & 2 ? box.max : box.min)[1], (k & 4 ? box.max : box.min)[2]};
    const double depth = dot(corner - eye, forward);
    low = std::min(low, depth);
    high = std::max(high, depth);
  }
  if (!std::isfinite(low) || !std::isfinite(high)) return;
  if (!view.orthographic) {
    view.z_near = std::max(view.z_near, high * 0x1p-60);
    return;
  }
  const double margin = 1e-3 * size + 1e-6 * std::max(std::abs(low), std::abs(high));  // for rounded positions
  const double near = std::max(view.z_near, low - margin), far = std::min(view.z_far, high + margin);
  if (!(near < far)) return;  // the scene lies outside
  view.z_near = near;
  view.z_far = far;
}

/// The outermost points along one direction of the picture, seen from (offset, depth).
struct Extremes {
  double high = -kInfinity, low = kInfinity;  // tangents
  double high_offset = 0, high_depth = 0, low_offset = 0, low_depth = 0;

  void add(double offset, double depth) {
    const double tangent = offset / depth;
    if (tangent > high) {
      high = tangent;
      high_offset = offset;
      high_depth = depth;
    }
    if (tangent < low) {
      low = tangent;
      low_offset = offset;
      low_depth = depth;
    }
  }
  /// Distance to move the eye so that these two points are equally far from the middle.
  double shift() const { return (high_offset * low_depth + low_offset * high_depth) / (high_depth + low_depth); }
};

/// Puts the eye as near to the scene as possible, with every point in the picture, a margin around the points, and the
/// scene in the middle. In the view's axes a point (x, y, z) is inside if |x - ex| <= hw (z - ez), and likewise for y.
/// So the four extremes of x - hw z, -x - hw z, y - hh z and -y - hh z bound the eye's position.
void frame(View& view, const kernels::SceneView& scene, const WorldBox& box) {
  const Outline outline(scene);
  constexpr double kMargin = 0.94;  // of the picture's half sides
  const double hw = kMargin * view.half_width;
  const double hh = kMargin * view.half_height;
  const Vec3 right{view.right[0], view.right[1], view.right[2]};
  const Vec3 up{view.up[0], view.up[1], view.up[2]};
  const Vec3 forward{view.forward[0], view.forward[1], view.forward[2]};
  double x_high = -kInfinity, x_low = -kInfinity, y_high = -kInfinity, y_low = -kInfinity, nearest = kInfinity;
  outline.for_each([&](const Vec3& p) {
    const double x = dot(p, right), y = dot(p, up), z = dot(p, forward);
    x_high = std::max(x_high, x - hw * z);
    x_low = std::max(x_low, -x - hw * z);
    y_high = std::max(y_high, y - hh * z);
    y_low = std::max(y_low, -y - hh * z);
    nearest = std::min(nearest, z);
  });
  const double size = length(box.max - box.min);
  double ex = 0.5 * (x_high - x_low);
  double ey = 0.5 * (y_high - y_low);
  double ez = std::min(-0.5 * (x_high + x_low) / hw, -0.5 * (y_high + y_low) / hh);
  ez = std::min(ez, nearest - (size > 0 ? 1e-3 * size : 1e-3));

  // Only one of the two directions determines the distance. Along the other, moving the eye makes both margins equal.
  // The outermost points may then change, but converge in a few rounds.
  for (int round = 0; round < 8; ++round) {
    Extremes across, along;
    outline.for_each([&](const Vec3& p) {
      const double depth = dot(p, forward) - ez;
      across.add(dot(p, right) - ex, depth);
      along.add(dot(p, up) - ey, depth);
    });
    ex += across.shift();
    ey += along.shift();
    if (std::abs(across.shift()) + std::abs(along.shift()) <= 1e-6 * size) break;
  }
  set_eye(view, ex * right + ey * up + ez * forward);
  view.z_near = 0.5 * (nearest - ez);
}

std::string camera_list(const format::Container& container, const std::vector<PlacedCamera>& cameras) {
  if (cameras.empty()) return "but the scene has no cameras";
  std::string text = "expected one of ";
  for (size_t i = 0; i < cameras.size() && i < 20; ++i) {
    text += (i == 0 ? "" : ", ") + std::to_string(cameras[i].camera);
    std::string_view name = container.string(container.cameras()[cameras[i].camera].name);
    if (name.empty()) name = container.string(container.nodes()[cameras[i].node].name);
    text += format::in_brackets(name);
  }
  return cameras.size() > 20 ? text + ", ..." : text;
}

const PlacedCamera* find_camera(const format::Container& container, const std::vector<PlacedCamera>& cameras,
                                const std::string& wanted) {
  for (const PlacedCamera& placed : cameras)
    if (container.string_is(container.cameras()[placed.camera].name, wanted)) return &placed;
  for (const PlacedCamera& placed : cameras)
    if (container.string_is(container.nodes()[placed.node].name, wanted)) return &placed;
  uint32_t index = 0;
  const char* const end = wanted.data() + wanted.size();
  const auto [rest, status] = std::from_chars(wanted.data(), end, index);
  if (status != std::errc{} || rest != end) return nullptr;
  for (const PlacedCamera& placed : cameras)
    if (placed.camera == index) return &placed;
  return nullptr;
}

/// A view with the picture's size and the clipping box of `options`.
View empty_view(const CameraOptions& options) {
  View view{.width = options.width, .height = options.height};
  if (!options.clip_box) return view;
  view.clips = true;
  std::copy(options.clip_box->min.begin(), options.clip_box->min.end(), view.clip_min);
  std::copy(options.clip_box->max.begin(), options.clip_box->max.end(), view.clip_max);
  return view;
}

Result<View> document_view(const format::Container& container, const WorldBox& box, const PlacedCamera& placed,
                           View view, const CameraOptions& options) {
  const format::CameraRecord& camera = container.cameras()[placed.camera];
  const Rows& world = placed.world;
  set_eye(view, {world[0][3], world[1][3], world[2][3]});
  // A camera looks along its node's -z with +y up. Scale and mirroring of the node do not affect its view.
  const auto forward = normalized({-world[0][2], -world[1][2], -world[2][2]});
  if (!forward || !orient(view, *forward, {world[0][1], world[1][1], world[2][1]}))
    return Error{ErrorCode::kFormat, "camera " + std::to_string(placed.camera) + ": the matrix of its node " +
                                         std::to_string(placed.node) + " has no direction"};
  if (camera.kind == format::CameraKind::kOrthographic) {
    if (options.fov_degrees)
      return Error{ErrorCode::kUsage,
                   "camera " + std::to_string(placed.camera) + " is orthographic and has no field of view to set"};
    view.orthographic = true;
    view.half_height = std::abs(camera.y);
    view.half_width = view.half_height * static_cast<double>(view.width) / view.height;
    view.z_far = camera.z_far;
  } else {
    set_field_of_view(view, options.fov_degrees ? *options.fov_degrees * kDegree : camera.y);
  }
  view.z_near = camera.z_near;
  fit_planes(view, box);
  return view;
}

Result<View> eye_view(const WorldBox& box, View view, const CameraOptions& options) {
  const Vec3 middle = box.is_empty() ? Vec3{} : 0.5 * (box.min + box.max);
  const Vec3 eye = *options.eye;
  const auto forward = normalized(options.target.value_or(middle) - eye);
  if (!forward) return Error{ErrorCode::kUsage, "the eye and the target are the same point"};
  if (options.up && !normalized(*options.up)) return Error{ErrorCode::kUsage, "up has the length 0"};
  // If the view direction is straight up or down, -z is the top of the picture, since y lies along the view direction.
  const bool is_oriented =
      orient(view, *forward, options.up.value_or(Vec3{0, 1, 0})) || (!options.up && orient(view, *forward, {0, 0, -1}));
  if (!is_oriented) return Error{ErrorCode::kUsage, "up lies along the direction of view"};
  set_eye(view, eye);
  view.z_near = near_of_box(box, eye);
  return view;
}

Result<View> default_view(const kernels::SceneView& drawn, const WorldBox& box, View view,
                          const CameraOptions& options) {
  const double turn = options.turn_degrees * kDegree, rise = options.rise_degrees * kDegree;
  const Vec3 up = options.up.value_or(Vec3{0, 1, 0});
  const auto upright = normalized(up);
  if (!upright) return Error{ErrorCode::kUsage, "up has no direction"};
  // The front is +z if possible, for any up direction.
  Vec3 front = Vec3{0, 0, 1} - (*upright)[2] * *upright;
  if (length(front) < 0.5) front = Vec3{0, -1, 0} + (*upright)[1] * *upright;
  front = *normalized(front);
  const Vec3 side = cross(*upright, front);
  const Vec3 around = std::cos(turn) * front + std::sin(turn) * side;
  const Vec3 towards_eye = std::cos(rise) * around + std::sin(rise) * *upright;
  const Vec3 forward = *normalized(-1.0 * towards_eye);
  // From straight above or below, the scene's back or front is the top of the picture.
  if (!orient(view, forward, *upright)) orient(view, forward, (rise > 0 ? -1.0 : 1.0) * around);
  if (box.is_empty()) {
    set_eye(view, 3.0 * towards_eye);
    view.z_near = 0.01;
    return view;
  }
  try {
    frame(view, drawn, box);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "no memory left to find a view of the scene"};
  }
  return view;
}

/// Sets the view's projection from the rows of a projection matrix.
Result<void> set_projection(View& view, const std::array<double, 16>& p, double z_near) {
  const auto is_zero = [&](std::initializer_list<size_t> places) {
    return std::all_of(places.begin(), places.end(), [&](size_t i) { return std::abs(p[i]) <= 1e-9; });
  };
  const bool is_perspective = p[14] == -1 && is_zero({15, 2, 6});
  const bool is_orthographic = p[15] == 1 && is_zero({14, 3, 7});
  if (!(is_perspective || is_orthographic) || !is_zero({1, 4, 8, 9, 12, 13}) || !(p[0] > 0) || !(p[5] > 0))
    return Error{ErrorCode::kUsage,
                 "the projection is neither perspective nor orthographic around the middle of the picture, rows first, "
                 "w = -z or 1"};
  view.half_width = 1 / p[0];
  view.half_height = 1 / p[5];
  view.orthographic = is_orthographic;
  view.z_near = is_orthographic ? (p[11] + 1) / p[10] : p[11] / (p[10] - 1);
  if (is_orthographic) view.z_far = (p[11] - 1) / p[10];
  if (z_near > 0) view.z_near = z_near;
  const bool has_depth = std::isfinite(view.z_near) &&
                         (is_orthographic ? std::isfinite(view.z_far) && view.z_far > view.z_near : view.z_near > 0);
  if (!has_depth) return Error{ErrorCode::kUsage, "the projection has no near plane before its far one"};
  return {};
}

}  // namespace

std::array<Vec3, 8> box_corners(const format::MeshRecord& mesh, const format::MatrixRecord& matrix) {
  std::array<Vec3, 8> out;
  for (size_t k = 0; k < 8; ++k) {
    Vec3 p;
    for (size_t axis = 0; axis < 3; ++axis)
      p[axis] = static_cast<double>((k >> axis & 1) != 0 ? mesh.bounds_max[axis] : mesh.bounds_min[axis]);
    for (size_t i = 0; i < 3; ++i)
      out[k][i] = matrix.rows[i][0] * p[0] + matrix.rows[i][1] * p[1] + matrix.rows[i][2] * p[2] + matrix.rows[i][3];
  }
  return out;
}

WorldBox scene_box(const kernels::SceneView& scene) {
  WorldBox box;
  for_each_corner(scene, [&](const Vec3& p) { box.add(p); });
  return box;
}

std::vector<std::optional<Rows>> world_matrices(const format::Container& container, uint32_t scene) {
  const auto nodes = container.nodes();
  std::vector<bool> in_scene(nodes.size(), false);
  const format::SceneRecord& record = container.scenes()[scene];
  for (uint64_t i = 0; i < record.root_count; ++i) in_scene[container.scene_roots()[record.first_root + i]] = true;
  std::vector<Rows> world(nodes.size());
  std::vector<std::optional<Rows>> found(nodes.size());
  for (uint64_t n = 0; n < nodes.size(); ++n) {  // parents come before their children
    const format::NodeRecord& node = nodes[n];
    const bool is_root = node.parent == format::kNone;
    world[n] = is_root ? local_matrix(node) : compose(world[node.parent], local_matrix(node));
    if (!is_root && in_scene[node.parent]) in_scene[n] = true;
    if (in_scene[n]) found[n] = world[n];
  }
  return found;
}

std::vector<PlacedCamera> placed_cameras(const format::Container& container, uint32_t scene) {
  std::vector<PlacedCamera> found;
  if (container.cameras().empty()) return found;
  const std::vector<std::optional<Rows>> world = world_matrices(container, scene);
  for (uint32_t n = 0; n < world.size(); ++n)
    if (const uint32_t camera = container.nodes()[n].camera; world[n] && camera != format::kNone)
      found.push_back({camera, n, *world[n]});
  return found;
}

bool view_reads_vertices(const kernels::SceneView& drawn, const CameraOptions& options) {
  return options.camera.empty() && !options.eye && !options.target && has_few_vertices(drawn);
}

Result<View> make_view(const Scene& scene, const PlacedCamera& camera, const CameraOptions& options) {
  return document_view(scene.container(), scene.box(), camera, empty_view(options), options);
}

Result<View> make_view(const Scene& scene, const CameraOptions& options) {
  const format::Container& container = scene.container();
  if (!options.camera.empty()) {
    if (options.eye || options.target || options.up)
      return Error{ErrorCode::kUsage, "a camera of the scene excludes an eye, a target and an up"};
    const std::vector<PlacedCamera> cameras = placed_cameras(container, scene.scene_index());
    const PlacedCamera* const placed = find_camera(container, cameras, options.camera);
    if (placed == nullptr)
      return Error{ErrorCode::kUsage, "no camera '" + options.camera + "', " + camera_list(container, cameras)};
    return make_view(scene, *placed, options);
  }
  View view = empty_view(options);
  set_field_of_view(view, options.fov_degrees.value_or(kDefaultFovDegrees) * kDegree);
  if (options.eye) return eye_view(scene.box(), view, options);
  if (options.target) return Error{ErrorCode::kUsage, "a target needs an eye"};
  return default_view(scene.view(), scene.box(), view, options);
}

Result<View> view_of_matrices(const CameraMatrices& camera, uint32_t width, uint32_t height) {
  const std::array<double, 16>& m = camera.view;
  const Vec3 right{m[0], m[1], m[2]}, up{m[4], m[5], m[6]}, back{m[8], m[9], m[10]};
  const auto is_near = [](double a, double b) { return std::abs(a - b) <= 1e-4; };
  const bool is_rotation = is_near(dot(right, right), 1) && is_near(dot(up, up), 1) && is_near(dot(back, back), 1) &&
                           is_near(dot(right, up), 0) && is_near(dot(up, back), 0) && is_near(dot(back, right), 0) &&
                           dot(cross(right, up), back) > 0;
  const bool is_affine = m[12] == 0 && m[13] == 0 && m[14] == 0 && m[15] == 1;
  if (!is_rotation || !is_affine || !std::isfinite(m[3] + m[7] + m[11]))
    return Error{ErrorCode::kUsage, "the view is no rotation and translation from world to camera, rows first"};
  View view{.width = width, .height = height};
  (void)orient(view, *normalized(-1.0 * back), up);
  Vec3 eye{};
  for (size_t i = 0; i < 3; ++i) eye[i] = -m[3] * view.right[i] - m[7] * view.up[i] + m[11] * view.forward[i];
  set_eye(view, eye);
  SCREE_TRY(set_projection(view, camera.projection, camera.z_near));
  return view;
}

}  // namespace scree::runtime
