#include "runtime/draw/shadow_map.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <string>
#include <utility>

namespace scree::runtime {
namespace {

using kernels::View;

double dot(const Vec3& a, const Vec3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

Vec3 normalized(const Vec3& a) {
  const double length = std::hypot(a[0], a[1], a[2]);
  return {a[0] / length, a[1] / length, a[2] / length};
}

Vec3 vector_of(const double (&v)[3]) {
  return {v[0], v[1], v[2]};
}

/// Where dot(normal, point) is at least `least`; points are relative to the eye.
struct HalfSpace {
  Vec3 normal;
  double least;
};

/// The half-spaces whose points a camera sees.
std::vector<HalfSpace> frustum(const View& camera) {
  const Vec3 forward = vector_of(camera.forward);
  std::vector<HalfSpace> planes{{forward, camera.z_near}};
  for (const auto& [axis, half] :
       {std::pair(vector_of(camera.right), camera.half_width), std::pair(vector_of(camera.up), camera.half_height)}) {
    for (const double sign : {1.0, -1.0}) {
      const double ahead = camera.orthographic ? 0.0 : half;
      Vec3 normal;
      for (size_t i = 0; i < 3; ++i) normal[i] = ahead * forward[i] + sign * axis[i];
      planes.push_back({normal, camera.orthographic ? -half : 0.0});
    }
  }
  if (camera.orthographic) planes.push_back({{-forward[0], -forward[1], -forward[2]}, -camera.z_far});
  return planes;
}

std::vector<Vec3> clip(const std::vector<Vec3>& polygon, const HalfSpace& plane) {
  std::vector<Vec3> out;
  for (size_t i = 0; i < polygon.size(); ++i) {
    const Vec3& a = polygon[i];
    const Vec3& b = polygon[(i + 1) % polygon.size()];
    const double inside_a = dot(plane.normal, a) - plane.least;
    const double inside_b = dot(plane.normal, b) - plane.least;
    if (inside_a >= 0) out.push_back(a);
    if ((inside_a >= 0) == (inside_b >= 0)) continue;
    const double share = inside_a / (inside_a - inside_b);
    Vec3 cut;
    for (size_t k = 0; k < 3; ++k) cut[k] = a[k] + share * (b[k] - a[k]);
    out.push_back(cut);
  }
  return out;
}

/// The corners of the part of a box that a camera sees: those of the box's faces, clipped, and those of the camera's
/// planes in the box. All relative to the eye, as `box` is.
std::vector<Vec3> seen_corners(const WorldBox& box, const View& camera) {
  std::vector<Vec3> seen;
  const std::vector<HalfSpace> planes = frustum(camera);
  for (size_t axis = 0; axis < 3; ++axis) {
    for (const double place : {box.min[axis], box.max[axis]}) {
      const size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
      std::vector<Vec3> face;
      for (const auto& [at_u, at_v] : {std::pair(box.min[u], box.min[v]), std::pair(box.max[u], box.min[v]),
                                       std::pair(box.max[u], box.max[v]), std::pair(box.min[u], box.max[v])}) {
        Vec3 corner;
        corner[axis] = place;
        corner[u] = at_u;
        corner[v] = at_v;
        face.push_back(corner);
      }
      for (const HalfSpace& plane : planes) face = clip(face, plane);
      seen.insert(seen.end(), face.begin(), face.end());
    }
  }
  std::vector<double> depths{camera.z_near};
  if (camera.orthographic) depths.push_back(camera.z_far);
  for (const double depth : depths) {
    for (const double x : {-camera.half_width, camera.half_width}) {
      for (const double y : {-camera.half_height, camera.half_height}) {
        const double scale = camera.orthographic ? 1.0 : depth;
        Vec3 corner;
        bool is_inside = true;
        for (size_t i = 0; i < 3; ++i) {
          corner[i] = depth * camera.forward[i] + scale * (x * camera.right[i] + y * camera.up[i]);
          is_inside = is_inside && corner[i] >= box.min[i] && corner[i] <= box.max[i];
        }
        if (is_inside) seen.push_back(corner);
      }
    }
  }
  return seen;
}

/// The range of the products of points with an axis.
struct Span {
  double low = WorldBox::kFar, high = -WorldBox::kFar;
  Span(const std::vector<Vec3>& points, const Vec3& axis) {
    for (const Vec3& point : points) {
      low = std::min(low, dot(axis, point));
      high = std::max(high, dot(axis, point));
    }
  }
  double size() const { return high - low; }
  double middle() const { return 0.5 * (low + high); }
};

}  // namespace

std::optional<uint32_t> find_sun(const kernels::SceneView& scene) {
  for (uint32_t i = 0; i < scene.light_count; ++i)
    if (scene.lights[i].kind == format::LightKind::kDirectional) return i;
  return std::nullopt;
}

std::optional<View> sun_view(const Vec3& direction, const WorldBox& box, const View& camera, uint32_t side) {
  WorldBox around;  // relative to the eye
  for (size_t i = 0; i < 3; ++i) {
    around.min[i] = (camera.clips ? std::max(box.min[i], camera.clip_min[i]) : box.min[i]) - camera.eye[i];
    around.max[i] = (camera.clips ? std::min(box.max[i], camera.clip_max[i]) : box.max[i]) - camera.eye[i];
    if (!(around.min[i] <= around.max[i])) return std::nullopt;
  }
  const std::vector<Vec3> seen = seen_corners(around, camera);
  if (seen.empty()) return std::nullopt;
  std::vector<Vec3> all;
  for (size_t k = 0; k < 8; ++k)
    all.push_back({k & 1 ? around.max[0] : around.min[0], k & 2 ? around.max[1] : around.min[1],
                   k & 4 ? around.max[2] : around.min[2]});

  const Vec3 forward = normalized(direction);
  Vec3 across{};  // the axis that the light is least along
  across[static_cast<size_t>(
      std::min_element(forward.begin(), forward.end(), [](double a, double b) { return std::abs(a) < std::abs(b); }) -
      forward.begin())] = 1;
  const Vec3 right = normalized(cross(forward, across));
  const Vec3 up = normalized(cross(right, forward));
  const Span x(seen, right), y(seen, up);
  const double nearest = Span(all, forward).low, farthest = Span(seen, forward).high;

  constexpr double kMargin = 2;  // samples
  double sample = std::max(x.size(), y.size()) / (side - 2 * kMargin);
  // Places are floats relative to the eye, as are the weights that they are made of.
  for (const Vec3& point : seen) sample = std::max(sample, std::hypot(point[0], point[1], point[2]) * 0x1p-18);
  if (!(sample > 0)) sample = 1;  // only the eye is seen
  const auto samples = [&](const Span& span) {
    const double wanted = std::ceil(span.size() / sample) + 2 * kMargin;
    return wanted < side ? static_cast<uint32_t>(wanted) : side;  // also of a box that is not finite
  };
  View view{};
  view.orthographic = true;
  view.width = samples(x);
  view.height = samples(y);
  view.half_width = 0.5 * sample * view.width;
  view.half_height = 0.5 * sample * view.height;
  const double room = kMargin * sample + (farthest - nearest) * 0x1p-20;
  view.z_far = farthest - nearest + 2 * room;
  for (size_t i = 0; i < 3; ++i) {
    view.eye[i] = camera.eye[i] + x.middle() * right[i] + y.middle() * up[i] + (nearest - room) * forward[i];
    view.right[i] = right[i];
    view.up[i] = up[i];
    view.forward[i] = forward[i];
  }
  view.omitted = camera.omitted;
  view.clips = camera.clips;
  std::copy(std::begin(camera.clip_min), std::end(camera.clip_min), view.clip_min);
  std::copy(std::begin(camera.clip_max), std::end(camera.clip_max), view.clip_max);
  return view;
}

Result<ShadowMap> ShadowMap::create(const Scene& scene, uint32_t side, DeviceScene* device) {
  const std::optional<uint32_t> sun = find_sun(scene.view());
  if (!sun) return Error{ErrorCode::kUsage, "the scene has no directional light"};
  ShadowMap map(scene, side, *sun);
  if (device != nullptr) {
    Result<DeviceView> own = device->add_view(scene);
    if (!own) return own.error();
    map.device_ = std::move(*own);
  }
  return map;
}

Result<const kernels::SunShadow*> ShadowMap::draw(const View& camera, uint32_t threads) {
  const Stopwatch watch;
  draw_time_ = {};
  const float* const d = scene_->view().lights[sun_.light].direction;
  const std::optional<View> view = sun_view({d[0], d[1], d[2]}, scene_->box(), camera, side_);
  if (!view) return static_cast<const kernels::SunShadow*>(nullptr);
  sun_.view = *view;
  if (device_) {
    if (const Result<void> done = device_->make_current(); !done) return done.error();
    if (const auto drawn = device_->draw(*view); !drawn) return drawn.error();
    sun_.samples = device_->samples();
  } else {
    const uint64_t count = uint64_t{view->width} * view->height;
    try {
      if (samples_.size() < count) samples_.resize(count);
    } catch (const std::bad_alloc&) {
      return Error{ErrorCode::kMemory, "no memory left for " + std::to_string(count) + " samples of shadows"};
    }
    const auto drawn = kernels::draw_cpu(scene_->view(), *view, std::span(samples_).first(count), threads);
    if (!drawn) return drawn.error();
    sun_.samples = samples_.data();
  }
  draw_time_ = watch.elapsed();
  return static_cast<const kernels::SunShadow*>(&sun_);
}

}  // namespace scree::runtime
