#include "tools/compare/reference_shade.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <new>

#include "format/vec3.h"
#include "runtime/threads/parallel.h"
#include "tools/compare/reference_geometry.h"

namespace scree::compare {
namespace {

using kernels::View;

constexpr double kAmbient = 0.2;  // ambient share of the light; the camera's light is the rest

Vec3 minus(const SeenPoint& a, const SeenPoint& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}

/// `v` with length 1, so that the cross product of two tiny edges does not underflow. 0 stays 0.
Vec3 unit(Vec3 v) {
  const double size = length(v);
  for (double& part : v) part = size > 0 ? part / size : 0;
  return v;
}

double cosine(const View& view, const std::array<SeenPoint, 3>& corners, Ray at) {
  const Vec3 a = unit(minus(corners[1], corners[0])), b = unit(minus(corners[2], corners[0]));
  const Vec3 normal = unit(scree::cross(a, b));
  const Vec3 ray = view.orthographic ? Vec3{0, 0, 1} : unit({at.x, at.y, 1});
  return std::min(std::abs(dot(normal, ray)), 1.0);
}

/// The vertex colour at the point where the ray hits the triangle. If a rounding mode drew the triangle beside that
/// point, the weights are moved to the nearest valid ones.
Vec3 vertex_color(const SourceMesh& mesh, uint64_t triangle, std::array<double, 3> weights) {
  const double orientation = weights[0] + weights[1] + weights[2] < 0 ? -1 : 1;
  double sum = 0;
  for (double& weight : weights) {
    weight = std::max(orientation * weight, 0.0);
    sum += weight;
  }
  Vec3 color{};
  for (size_t n = 0; n < 3; ++n) {
    const float* const corner = &mesh.colors[3 * uint64_t{mesh.corners[3 * triangle + n]}];
    for (size_t c = 0; c < 3; ++c) color[c] += weights[n] / sum * static_cast<double>(corner[c]);
  }
  return color;
}

/// The colour of a sample in linear light.
Vec3 shade(const SourceModel& model, const ReferencePixel& sample, const View& view, uint32_t x, uint32_t y) {
  if (sample.is_background()) return {};
  const ReferenceInstance& instance = model.instances[sample.instance];
  const SourceMesh& mesh = model.meshes[instance.mesh];
  const std::array<SeenPoint, 3> corners = seen_corners(view, model.views[instance.mesh], instance, sample.triangle);
  const Ray ray = ray_of(view, x, y);
  Vec3 light = mesh.base_color;
  if (!mesh.colors.empty()) {
    const Vec3 color = vertex_color(mesh, sample.triangle, corner_weights(view, corners, ray));
    for (size_t c = 0; c < 3; ++c) light[c] *= color[c];
  }
  const double lit = mesh.unlit ? 1 : kAmbient + (1 - kAmbient) * cosine(view, corners, ray);
  for (double& part : light) part *= lit;
  return light;
}

uint8_t srgb_code(double linear) {
  const double coded = linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
  return static_cast<uint8_t>(std::lround(255 * std::clamp(coded, 0.0, 1.0)));
}

}  // namespace

Result<std::vector<uint8_t>> shade_reference(const SourceModel& model, std::span<const ReferencePixel> samples,
                                             const View& view, uint32_t samples_per_side, uint32_t threads) try {
  const uint32_t side = samples_per_side;
  const uint32_t width = view.width / side, height = view.height / side;
  std::vector<uint8_t> pixels(uint64_t{3} * width * height);
  runtime::parallel_for(height, threads, [&](uint64_t row) {
    for (uint32_t column = 0; column < width; ++column) {
      Vec3 sum{};
      for (uint32_t j = 0; j < side; ++j) {
        for (uint32_t i = 0; i < side; ++i) {
          const uint32_t x = column * side + i, y = static_cast<uint32_t>(row) * side + j;
          const Vec3 light = shade(model, samples[uint64_t{y} * view.width + x], view, x, y);
          for (size_t c = 0; c < 3; ++c) sum[c] += light[c];
        }
      }
      for (size_t c = 0; c < 3; ++c) pixels[3 * (row * width + column) + c] = srgb_code(sum[c] / (side * side));
    }
  });
  return pixels;
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left for the reference picture"};
}

}  // namespace scree::compare
