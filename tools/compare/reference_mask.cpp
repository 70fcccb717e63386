#include "tools/compare/reference_mask.h"

#include <algorithm>
#include <cmath>

namespace scree::compare {
namespace {

using kernels::View;
using TexturePoint = std::array<double, 2>;

/// The corners' weights at the point where the ray hits the triangle's plane; their sum is 1. With `inside` the point
/// is moved into the triangle.
std::array<double, 3> shares_of(const View& view, const std::array<SeenPoint, 3>& corners, Ray ray, bool inside) {
  std::array<double, 3> weights = corner_weights(view, corners, ray);
  const double orientation = weights[0] + weights[1] + weights[2] < 0 ? -1 : 1;
  double sum = 0;
  for (double& weight : weights) {
    weight = inside ? std::max(orientation * weight, 0.0) : orientation * weight;
    sum += weight;
  }
  for (double& weight : weights) weight /= sum;
  return weights;
}

TexturePoint place_of(const std::array<TexturePoint, 3>& places, const std::array<double, 3>& shares) {
  TexturePoint place{};
  for (size_t n = 0; n < 3; ++n)
    for (size_t c = 0; c < 2; ++c) place[c] += shares[n] * places[n][c];
  return place;
}

double wrapped(double value, format::Wrap wrap) {
  if (wrap == format::Wrap::kRepeat) return value - std::floor(value);
  if (wrap == format::Wrap::kMirror) return 1 - std::abs(value - 2 * std::floor(value / 2) - 1);
  return std::clamp(value, 0.0, 1.0);
}

int64_t neighbour(int64_t texel, int64_t size, format::Wrap wrap) {
  if (wrap == format::Wrap::kRepeat) return (texel + size) % size;
  return std::clamp<int64_t>(texel, 0, size - 1);
}

}  // namespace

bool mask_passes(const View& view, const ReferenceMesh& mesh, uint64_t triangle,
                 const std::array<SeenPoint, 3>& corners, uint32_t x, uint32_t y) {
  const ReferenceMask& mask = *mesh.mask;
  std::array<TexturePoint, 3> places;
  for (size_t n = 0; n < 3; ++n) {
    const float* const uv = &mesh.uvs[2 * uint64_t{mesh.corners[3 * triangle + n]}];
    for (size_t c = 0; c < 2; ++c)
      places[n][c] = mask.place[c][0] * static_cast<double>(uv[0]) + mask.place[c][1] * static_cast<double>(uv[1]) +
                     mask.place[c][2];
  }
  // The footprint of a sample comes from rays that are a thousandth of a pixel aside.
  constexpr double kStep = 1e-3;
  const Ray ray = ray_of(view, x, y);
  const double pixel_x = 2 * view.half_width / view.width, pixel_y = 2 * view.half_height / view.height;
  const auto place_at = [&](Ray through) { return place_of(places, shares_of(view, corners, through, false)); };
  const TexturePoint at = place_at(ray);
  const TexturePoint right = place_at({ray.x + kStep * pixel_x, ray.y});
  const TexturePoint down = place_at({ray.x, ray.y - kStep * pixel_y});
  const auto step = [&](const TexturePoint& to) {
    return std::hypot((to[0] - at[0]) * mask.width, (to[1] - at[1]) * mask.height) / kStep;
  };
  const double footprint = std::max(step(right), step(down));
  size_t level = 0;
  while (level + 1 < mask.levels.size() && !(footprint < std::sqrt(2.0) * static_cast<double>(1u << level))) ++level;

  const std::array<double, 3> shares = shares_of(view, corners, ray, true);
  const TexturePoint inside = place_of(places, shares);
  const int64_t size[2] = {std::max(1u, mask.width >> level), std::max(1u, mask.height >> level)};
  int64_t texel[2][2];
  double weight[2];
  for (size_t c = 0; c < 2; ++c) {
    const double place = wrapped(inside[c], mask.wrap[c]) * static_cast<double>(size[c]);
    if (footprint <= 1 ? mask.magnified_nearest : mask.minified_nearest) {
      texel[c][0] = texel[c][1] = std::clamp<int64_t>(static_cast<int64_t>(std::floor(place)), 0, size[c] - 1);
      weight[c] = 0;
      continue;
    }
    const auto first = static_cast<int64_t>(std::floor(place - 0.5));
    weight[c] = place - 0.5 - static_cast<double>(first);
    for (int64_t i = 0; i < 2; ++i) texel[c][i] = neighbour(first + i, size[c], mask.wrap[c]);
  }
  double alpha = 0;
  for (size_t j = 0; j < 2; ++j)
    for (size_t i = 0; i < 2; ++i)
      alpha += (i == 0 ? 1 - weight[0] : weight[0]) * (j == 0 ? 1 - weight[1] : weight[1]) *
               static_cast<double>(mask.levels[level][static_cast<size_t>(texel[1][j] * size[0] + texel[0][i])]);
  double colors = mesh.alphas.empty() ? 1 : 0;
  for (size_t n = 0; n < 3 && !mesh.alphas.empty(); ++n)
    colors += shares[n] * static_cast<double>(mesh.alphas[mesh.corners[3 * triangle + n]]);
  return alpha * colors >= mask.cutoff;
}

}  // namespace scree::compare
