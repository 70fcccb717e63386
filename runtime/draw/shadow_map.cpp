#include "runtime/draw/shadow_map.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <string>
#include <utility>

namespace scree::runtime {
namespace {

using kernels::View;

constexpr double kMarginSamples = 2;  // of a map beside the visible part

Vec3 normalized(const Vec3& a) {
  const double size = length(a);
  return {a[0] / size, a[1] / size, a[2] / size};
}

Vec3 vector_of(const double (&v)[3]) {
  return {v[0], v[1], v[2]};
}

/// Where dot(normal, point) is at least `least`; points are relative to the eye.
struct HalfSpace {
  Vec3 normal;
  double least;
};

/// The half-spaces whose intersection is visible to a camera, up to the distance `farthest` from the eye's plane.
std::vector<HalfSpace> frustum(const View& camera, double farthest) {
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
  if (std::isfinite(farthest)) planes.push_back({{-forward[0], -forward[1], -forward[2]}, -farthest});
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

/// The corners of the part of a box that is visible to a camera up to a distance: the corners of the box's clipped
/// faces, and those of the camera's planes in the box. All relative to the eye, as `box` is.
std::vector<Vec3> seen_corners(const WorldBox& box, const View& camera, double farthest) {
  std::vector<Vec3> seen;
  if (camera.orthographic) farthest = std::min(farthest, camera.z_far);
  const std::vector<HalfSpace> planes = frustum(camera, farthest);
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
  if (std::isfinite(farthest)) depths.push_back(farthest);
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
  /// Adds a share of the size on each side, within `most`.
  void widen(double share, const Span& most) {
    const double more = share * size();
    low = std::max(low - more, most.low);
    high = std::min(high + more, most.high);
  }
  double size() const { return high - low; }
  double middle() const { return 0.5 * (low + high); }
};

/// The part of a box that `camera` does not clip away, relative to the eye. nullopt if that is none of it.
std::optional<WorldBox> box_around_eye(const WorldBox& box, const View& camera) {
  WorldBox around;
  for (size_t i = 0; i < 3; ++i) {
    around.min[i] = (camera.clips ? std::max(box.min[i], camera.clip_min[i]) : box.min[i]) - camera.eye[i];
    around.max[i] = (camera.clips ? std::min(box.max[i], camera.clip_max[i]) : box.max[i]) - camera.eye[i];
    if (!(around.min[i] <= around.max[i])) return std::nullopt;
  }
  return around;
}

/// Whether a map has everything that the map `exact` is for.
bool serves(const View& map, const View& exact, ShadowFit fit, double most_coarser) {
  if (map == exact) return true;
  if (fit == ShadowFit::kExact) return false;
  if (map.omitted != exact.omitted || map.clips != exact.clips ||
      !std::equal(std::begin(map.clip_min), std::end(map.clip_min), exact.clip_min) ||
      !std::equal(std::begin(map.clip_max), std::end(map.clip_max), exact.clip_max))
    return false;
  // Both look along the sun's rays with the same axes, and both begin before the whole box. Shading reads 1.5 samples
  // around the visible part.
  const double sample = 2 * map.half_width / map.width, own_sample = 2 * exact.half_width / exact.width;
  if (sample > most_coarser * own_sample) return false;
  const double more =
      kMarginSamples * own_sample - 1.5 * sample;  // beside the visible part, by which the map may be smaller
  const auto reaches = [&](const double(&axis)[3], double own_half, double half) {
    double offset = 0;
    for (size_t i = 0; i < 3; ++i) offset += (exact.eye[i] - map.eye[i]) * axis[i];
    return std::abs(offset) + own_half <= half + more;
  };
  return reaches(map.right, exact.half_width, map.half_width) && reaches(map.up, exact.half_height, map.half_height) &&
         reaches(map.forward, exact.z_far, map.z_far);
}

}  // namespace

std::optional<uint32_t> find_sun(const kernels::SceneView& scene) {
  for (uint32_t i = 0; i < scene.light_count; ++i)
    if (scene.lights[i].kind == format::LightKind::kDirectional) return i;
  return std::nullopt;
}

std::optional<View> sun_view(const Vec3& direction, const WorldBox& box, const View& camera, uint32_t side,
                             double margin, double farthest_seen) {
  const std::optional<WorldBox> around = box_around_eye(box, camera);
  if (!around) return std::nullopt;
  const std::vector<Vec3> seen = seen_corners(*around, camera, farthest_seen);
  if (seen.empty()) return std::nullopt;
  std::vector<Vec3> all;
  for (size_t k = 0; k < 8; ++k)
    all.push_back({k & 1 ? around->max[0] : around->min[0], k & 2 ? around->max[1] : around->min[1],
                   k & 4 ? around->max[2] : around->min[2]});

  const Vec3 forward = normalized(direction);
  Vec3 across{};  // the axis that the light is least along
  across[static_cast<size_t>(
      std::min_element(forward.begin(), forward.end(), [](double a, double b) { return std::abs(a) < std::abs(b); }) -
      forward.begin())] = 1;
  const Vec3 right = normalized(cross(forward, across));
  const Vec3 up = normalized(cross(right, forward));
  Span x(seen, right), y(seen, up);
  const double nearest = Span(all, forward).low;
  double farthest = Span(seen, forward).high;
  if (margin > 0) {
    x.widen(margin, Span(all, right));
    y.widen(margin, Span(all, up));
    farthest = Span(all, forward).high;
  }

  double sample = std::max(x.size(), y.size()) / (side - 2 * kMarginSamples);
  // Places are floats relative to the eye, as are the weights that they are made of.
  for (const Vec3& point : seen) sample = std::max(sample, std::hypot(point[0], point[1], point[2]) * 0x1p-18);
  if (!(sample > 0)) sample = 1;  // only the eye is visible
  const auto samples = [&](const Span& span) {
    const double wanted = std::ceil(span.size() / sample) + 2 * kMarginSamples;
    return wanted < side ? static_cast<uint32_t>(wanted) : side;  // also of a box that is not finite
  };
  View view{};
  view.orthographic = true;
  view.width = samples(x);
  view.height = samples(y);
  view.half_width = 0.5 * sample * view.width;
  view.half_height = 0.5 * sample * view.height;
  const double room = kMarginSamples * sample + (farthest - nearest) * 0x1p-20;
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

std::optional<kernels::SunShadow> sun_of(const kernels::SceneView& scene, const WorldBox& box, const View& camera,
                                         uint32_t side, double margin) {
  kernels::SunShadow sun{*find_sun(scene), 0, {}};
  const float* const d = scene.lights[sun.light].direction;
  const std::optional<WorldBox> around = box_around_eye(box, camera);
  if (!around) return std::nullopt;
  constexpr double kAll = std::numeric_limits<double>::infinity();
  const Span depths(seen_corners(*around, camera, kAll), vector_of(camera.forward));
  const bool is_deep = !camera.orthographic && depths.high > kDeepView * depths.low;
  const double ratio = std::min(std::pow(depths.high / depths.low, 1.0 / kernels::kMostSunMaps), kMostSunRatio);
  for (uint32_t i = is_deep ? kernels::kMostSunMaps : 1; i-- != 0;) {
    const double farthest = i != 0 ? depths.high / std::pow(ratio, i) : kAll;
    const std::optional<View> map =
        sun_view({d[0], d[1], d[2]}, box, camera, is_deep ? side / 2 : side, margin, farthest);
    if (map) sun.maps[sun.map_count++] = {nullptr, *map};
  }
  return sun.map_count != 0 ? std::optional(sun) : std::nullopt;
}

Result<const kernels::SunShadow*> ShadowMap::draw(const View& camera, uint32_t side, uint32_t threads, ShadowFit fit,
                                                  const IsOver& is_over) {
  const Stopwatch watch;
  draw_time_ = {};
  left_bytes_ = 0;
  if (!find_sun(scene_->view())) return Error{ErrorCode::kUsage, "the scene has no directional light"};
  const std::optional<kernels::SunShadow> exact = sun_of(scene_->view(), scene_->box(), camera, side);
  if (!exact) return static_cast<const kernels::SunShadow*>(nullptr);
  if (side != side_ || exact->map_count != sun_.map_count) forget();
  side_ = side;
  sun_.light = exact->light;
  sun_.map_count = exact->map_count;
  for (uint32_t i = 0; i < exact->map_count; ++i) {
    if (is_drawn_[i] && serves(sun_.maps[i].view, exact->maps[i].view, fit, kMostCoarser)) continue;
    is_drawn_[i] = false;
    const bool has_margin = fit == ShadowFit::kMoving;
    sun_.maps[i].view =
        has_margin ? sun_of(scene_->view(), scene_->box(), camera, side, kMargin)->maps[i].view : exact->maps[i].view;
    const uint64_t left = left_bytes_;
    SCREE_TRY(draw_map(i, threads, is_over));
    is_drawn_[i] = left_bytes_ == left;
    draw_time_ = watch.elapsed();
  }
  return static_cast<const kernels::SunShadow*>(&sun_);
}

Result<void> ShadowMap::draw_map(uint32_t number, uint32_t threads, const IsOver& is_over) {
  kernels::SunShadow::Map& map = sun_.maps[number];
  if (device_ != nullptr) {
    if (!on_device_) on_device_ = SCREE_TRY(device_->add_view(*scene_));
    SCREE_TRY(on_device_->draw(map.view, nullptr, nullptr, is_over));
    if (const std::optional<StreamStats>& stream = on_device_->stream_stats()) left_bytes_ += stream->left_bytes;
    map.samples = SCREE_TRY(sun_.map_count == 1 ? on_device_->samples() : on_device_->keep_samples(number));
    return {};
  }
  const uint64_t count = uint64_t{map.view.width} * map.view.height;
  std::vector<uint64_t>& samples = samples_[number];
  try {
    if (samples.size() < count) samples.resize(count);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "no memory left for " + std::to_string(count) + " samples of shadows"};
  }
  SCREE_TRY(kernels::draw_cpu(scene_->view(), map.view, std::span(samples).first(count), threads));
  map.samples = samples.data();
  return {};
}

}  // namespace scree::runtime
