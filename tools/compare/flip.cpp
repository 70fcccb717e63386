#include "tools/compare/flip.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "format/vec3.h"
#include "runtime/textures/srgb.h"
#include "runtime/threads/parallel.h"

namespace scree::compare {
namespace {

constexpr double kPi = 3.14159265358979323846;

using Triple = Vec3;
using Plane = std::vector<float>;

struct Size {
  uint32_t width, height;
  uint64_t pixels() const { return uint64_t{width} * height; }
};

// sRGB's primaries as exact fractions. The result for (1, 1, 1) is the white point.
Triple xyz_of_linear(const Triple& rgb) {
  return {10135552.0 / 24577794 * rgb[0] + 8788810.0 / 24577794 * rgb[1] + 4435075.0 / 24577794 * rgb[2],
          2613072.0 / 12288897 * rgb[0] + 8788810.0 / 12288897 * rgb[1] + 887015.0 / 12288897 * rgb[2],
          1425312.0 / 73733382 * rgb[0] + 8788810.0 / 73733382 * rgb[1] + 70074185.0 / 73733382 * rgb[2]};
}

const Triple& white() {
  static const Triple kWhite = xyz_of_linear({1, 1, 1});
  return kWhite;
}

/// The inverse of xyz_of_linear by cofactors.
Triple linear_of_xyz(const Triple& xyz) {
  static const std::array<Triple, 3> kRows = [] {
    const std::array<Triple, 3> c{xyz_of_linear({1, 0, 0}), xyz_of_linear({0, 1, 0}), xyz_of_linear({0, 0, 1})};
    std::array<Triple, 3> rows{scree::cross(c[1], c[2]), scree::cross(c[2], c[0]), scree::cross(c[0], c[1])};
    const double det = dot(c[0], rows[0]);
    for (Triple& row : rows)
      for (double& value : row) value /= det;
    return rows;
  }();
  Triple out;
  for (size_t i = 0; i < 3; ++i) out[i] = dot(kRows[i], xyz);
  return out;
}

/// YCxCz: CIELAB without its cube roots, in which filters are linear.
Triple ycc_of_linear(const Triple& rgb) {
  const Triple xyz = xyz_of_linear(rgb);
  const double x = xyz[0] / white()[0], y = xyz[1] / white()[1], z = xyz[2] / white()[2];
  return {116 * y - 16, 500 * (x - y), 200 * (y - z)};
}

Triple linear_of_ycc(const Triple& ycc) {
  const double y = (ycc[0] + 16) / 116;
  return linear_of_xyz({(ycc[1] / 500 + y) * white()[0], y * white()[1], (y - ycc[2] / 200) * white()[2]});
}

/// CIELAB, its chroma scaled by lightness (the Hunt effect: dark colours look less colourful).
Triple hunt_lab_of_linear(const Triple& rgb) {
  const Triple xyz = xyz_of_linear(rgb);
  Triple f;
  for (size_t i = 0; i < 3; ++i) {
    constexpr double kDelta = 6.0 / 29;
    const double t = xyz[i] / white()[i];
    f[i] = t > kDelta * kDelta * kDelta ? std::cbrt(t) : t / (3 * kDelta * kDelta) + 4.0 / 29;
  }
  const double lightness = 116 * f[1] - 16;
  return {lightness, 0.01 * lightness * 500 * (f[0] - f[1]), 0.01 * lightness * 200 * (f[1] - f[2])};
}

/// The HyAB distance, raised to 0.7 so that large differences count less.
double colour_distance(const Triple& a, const Triple& b) {
  return std::pow(std::abs(a[0] - b[0]) + std::hypot(a[1] - b[1], a[2] - b[2]), 0.7);
}

/// Maps `distance` to 0..1: the first 40% of the largest distance (green against blue) take 95% of the range.
double remapped(double distance) {
  static const double kLargest = colour_distance(hunt_lab_of_linear({0, 1, 0}), hunt_lab_of_linear({0, 0, 1}));
  constexpr double kShare = 0.4, kRange = 0.95;
  const double knee = kShare * kLargest;
  return distance < knee ? kRange / knee * distance : kRange + (distance - knee) / (kLargest - knee) * (1 - kRange);
}

/// Weights of offsets -radius to radius.
using Kernel = std::vector<double>;

template <class Weight>
Kernel make_kernel(int radius, const Weight& weight) {
  Kernel kernel;
  for (int i = -radius; i <= radius; ++i) kernel.push_back(weight(i));
  return kernel;
}

double sum_of(const Kernel& kernel) {
  double sum = 0;
  for (const double weight : kernel) sum += weight;
  return sum;
}

/// Convolution with `across` along rows and `along` down columns. The border pixels are repeated outside the picture.
Plane filtered(const Plane& in, Size size, const Kernel& across, const Kernel& along, uint32_t threads) {
  const auto clamped = [](int64_t place, uint32_t side) {
    return static_cast<uint64_t>(std::clamp<int64_t>(place, 0, int64_t{side} - 1));
  };
  Plane rows(in.size()), out(in.size());
  const auto radius = [](const Kernel& kernel) { return static_cast<int64_t>(kernel.size() / 2); };
  runtime::parallel_for(size.height, threads, [&](uint64_t y) {
    for (uint64_t x = 0; x < size.width; ++x) {
      double sum = 0;
      for (size_t k = 0; k < across.size(); ++k)
        sum += across[k] * static_cast<double>(
                               in[y * size.width + clamped(static_cast<int64_t>(x + k) - radius(across), size.width)]);
      rows[y * size.width + x] = static_cast<float>(sum);
    }
  });
  runtime::parallel_for(size.height, threads, [&](uint64_t y) {
    std::vector<double> sums(size.width);
    for (size_t k = 0; k < along.size(); ++k) {
      const float* const row = &rows[clamped(static_cast<int64_t>(y + k) - radius(along), size.height) * size.width];
      for (uint64_t x = 0; x < size.width; ++x) sums[x] += along[k] * static_cast<double>(row[x]);
    }
    for (uint64_t x = 0; x < size.width; ++x) out[y * size.width + x] = static_cast<float>(sums[x]);
  });
  return out;
}

/// A contrast sensitivity function in space: a sqrt(pi / b) exp(-pi^2 x^2 / b) for each pair, x in degrees.
struct Sensitivity {
  double a1, b1, a2, b2;
};
constexpr std::array<Sensitivity, 3> kSensitivities{{
    {1, 0.0047, 0, 1e-5},       // achromatic
    {1, 0.0053, 0, 1e-5},       // red-green
    {34.1, 0.04, 13.5, 0.025},  // blue-yellow
}};

/// A channel filtered by its contrast sensitivity function. Each Gaussian is filtered by rows, then columns; the
/// weights of both together add up to 1.
Plane seen_channel(const Plane& in, Size size, const Sensitivity& csf, double ppd, uint32_t threads) {
  constexpr double kWidest = 0.04;
  const int radius = static_cast<int>(std::ceil(3 * std::sqrt(kWidest / (2 * kPi * kPi)) * ppd));
  const auto gaussian = [&](double b) {
    return make_kernel(radius, [&](int i) { return std::exp(-kPi * kPi * (i / ppd) * (i / ppd) / b); });
  };
  const Kernel g1 = gaussian(csf.b1), g2 = gaussian(csf.b2);
  const double c1 = csf.a1 * std::sqrt(kPi / csf.b1), c2 = csf.a2 * std::sqrt(kPi / csf.b2);
  const double total = c1 * sum_of(g1) * sum_of(g1) + c2 * sum_of(g2) * sum_of(g2);
  Plane out = filtered(in, size, g1, g1, threads);
  if (c2 == 0) {
    for (float& value : out) value = static_cast<float>(c1 / total * static_cast<double>(value));
    return out;
  }
  const Plane second = filtered(in, size, g2, g2, threads);
  for (size_t i = 0; i < out.size(); ++i)
    out[i] = static_cast<float>((c1 * static_cast<double>(out[i]) + c2 * static_cast<double>(second[i])) / total);
  return out;
}

/// Strength of edges (first derivative of a Gaussian) or points (second) in lightness 0..1.
Plane feature(const Plane& lightness, Size size, bool points, double ppd, uint32_t threads) {
  constexpr double kFeatureDegrees = 0.082;
  const double deviation = 0.5 * kFeatureDegrees * ppd;
  const int radius = static_cast<int>(std::ceil(3 * deviation));
  Kernel gauss = make_kernel(radius, [&](int i) { return std::exp(-i * i / (2 * deviation * deviation)); });
  Kernel slope = make_kernel(radius, [&](int i) {
    const double g = gauss[static_cast<size_t>(i + radius)];
    return points ? (i * i / (deviation * deviation) - 1) * g : -i * g;
  });
  // Across the feature, positive weights add up to 1 and negative ones to -1. Along it, all weights add up to 1.
  double positive = 0, negative = 0;
  for (const double weight : slope) (weight > 0 ? positive : negative) += std::abs(weight);
  for (double& weight : slope) weight /= weight > 0 ? positive : negative;
  const double sum = sum_of(gauss);
  for (double& weight : gauss) weight /= sum;
  Plane x = filtered(lightness, size, slope, gauss, threads);
  const Plane y = filtered(lightness, size, gauss, slope, threads);
  for (size_t i = 0; i < x.size(); ++i) x[i] = std::hypot(x[i], y[i]);
  return x;
}

/// The parts of a picture that are compared.
struct Seen {
  std::array<Plane, 3> lab;  // filtered, Hunt-adjusted
  Plane edges, points;
};

Seen look_at(const RgbView& picture, double ppd, uint32_t threads) {
  const Size size{picture.width, picture.height};
  std::array<Plane, 3> channels;
  for (Plane& plane : channels) plane.resize(size.pixels());
  Plane lightness(size.pixels());
  for (uint64_t i = 0; i < size.pixels(); ++i) {
    Triple linear;
    for (size_t c = 0; c < 3; ++c) linear[c] = static_cast<double>(runtime::linear_of_srgb(picture.rgb[3 * i + c]));
    const Triple ycc = ycc_of_linear(linear);
    for (size_t c = 0; c < 3; ++c) channels[c][i] = static_cast<float>(ycc[c]);
    lightness[i] = static_cast<float>((ycc[0] + 16) / 116);
  }
  Seen seen{.edges = feature(lightness, size, false, ppd, threads),
            .points = feature(lightness, size, true, ppd, threads)};
  for (size_t c = 0; c < 3; ++c) channels[c] = seen_channel(channels[c], size, kSensitivities[c], ppd, threads);
  for (uint64_t i = 0; i < size.pixels(); ++i) {
    Triple linear = linear_of_ycc({channels[0][i], channels[1][i], channels[2][i]});
    for (double& value : linear) value = std::clamp(value, 0.0, 1.0);
    const Triple lab = hunt_lab_of_linear(linear);
    for (size_t c = 0; c < 3; ++c) channels[c][i] = static_cast<float>(lab[c]);
  }
  seen.lab = std::move(channels);
  return seen;
}

}  // namespace

std::vector<float> flip_map(const RgbView& test, const RgbView& reference, double pixels_per_degree, uint32_t threads) {
  const Seen a = look_at(test, pixels_per_degree, threads), b = look_at(reference, pixels_per_degree, threads);
  std::vector<float> map(a.edges.size());
  for (size_t i = 0; i < map.size(); ++i) {
    const double colour =
        remapped(colour_distance({a.lab[0][i], a.lab[1][i], a.lab[2][i]}, {b.lab[0][i], b.lab[1][i], b.lab[2][i]}));
    const double features = std::max(std::abs(static_cast<double>(a.edges[i]) - static_cast<double>(b.edges[i])),
                                     std::abs(static_cast<double>(a.points[i]) - static_cast<double>(b.points[i])));
    const double strength = std::sqrt(features / std::sqrt(2.0));
    map[i] = static_cast<float>(std::clamp(std::pow(colour, 1 - std::min(strength, 1.0)), 0.0, 1.0));
  }
  return map;
}

}  // namespace scree::compare
