#include "runtime/light/environment.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <span>

#include "kernels/shade/environment.h"
#include "runtime/files/mapped_file.h"
#include "runtime/images/hdr.h"
#include "runtime/threads/parallel.h"

namespace scree::runtime {
namespace {

using kernels::kEnvironmentLevels;
using kernels::kFinestEnvironment;

constexpr uint32_t kMostWidth = 1024;
constexpr float kBrightest = 1e6f;  // largest value of a texel, so that all sums stay finite, in pictures too

using Color = std::array<float, 3>;

/// All directions, longitude by latitude; -z in the middle, y up.
struct Panorama {
  uint32_t width = 0;
  uint32_t height = 0;
  std::vector<Color> texels;

  const Color& at(int64_t x, int64_t y) const {
    const int64_t w = width;
    return texels[static_cast<size_t>(std::clamp<int64_t>(y, 0, int64_t{height} - 1) * w + (x % w + w) % w)];
  }

  Color in_direction(const float d[3]) const {
    const float length = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    const float u = 0.5f + std::atan2(d[0], -d[2]) * (0.5f / std::numbers::pi_v<float>);
    const float v = std::acos(std::clamp(d[1] / length, -1.0f, 1.0f)) * (1.0f / std::numbers::pi_v<float>);
    const float x = u * static_cast<float>(width) - 0.5f;
    const float y = v * static_cast<float>(height) - 0.5f;
    const float x0 = std::floor(x);
    const float y0 = std::floor(y);
    const float wx = x - x0;
    const float wy = y - y0;
    const auto column = static_cast<int64_t>(x0);
    const auto row = static_cast<int64_t>(y0);
    Color out{};
    for (size_t c = 0; c < 3; ++c) {
      const float above = at(column, row)[c] * (1 - wx) + at(column + 1, row)[c] * wx;
      const float below = at(column, row + 1)[c] * (1 - wx) + at(column + 1, row + 1)[c] * wx;
      out[c] = above * (1 - wy) + below * wy;
    }
    return out;
  }

  /// The direction of the middle of a texel, unit length.
  void direction(uint32_t x, uint32_t y, double d[3]) const {
    const double longitude = ((x + 0.5) / width - 0.5) * 2 * std::numbers::pi;
    const double latitude = (y + 0.5) / height * std::numbers::pi;
    d[0] = std::sin(latitude) * std::sin(longitude);
    d[1] = std::cos(latitude);
    d[2] = -std::sin(latitude) * std::cos(longitude);
  }
};

/// Octahedral maps with 4 floats per texel, the last 0. The first map is the finest, the last is a single texel.
struct Octahedra {
  std::vector<std::vector<float>> levels;

  uint32_t side(size_t level) const { return kFinestEnvironment >> level; }
};

Octahedra make_octahedra(const Panorama& panorama, uint32_t threads) {
  Octahedra maps;
  maps.levels.emplace_back(size_t{4} * kFinestEnvironment * kFinestEnvironment);
  parallel_for(kFinestEnvironment, threads, [&](uint64_t y) {
    for (uint32_t x = 0; x < kFinestEnvironment; ++x) {
      Color sum{};
      for (uint32_t i = 0; i < 4; ++i) {
        float d[3];
        kernels::octahedral_direction(
            (static_cast<float>(x) + 0.25f + 0.5f * static_cast<float>(i & 1)) / kFinestEnvironment,
            (static_cast<float>(y) + 0.25f + 0.5f * static_cast<float>(i >> 1)) / kFinestEnvironment, d);
        const Color light = panorama.in_direction(d);
        for (size_t c = 0; c < 3; ++c) sum[c] += 0.25f * light[c];
      }
      std::copy(sum.begin(), sum.end(), &maps.levels[0][4 * (y * kFinestEnvironment + x)]);
    }
  });
  for (uint32_t side = kFinestEnvironment / 2; side >= 1; side /= 2) {
    const std::vector<float>& finer = maps.levels.back();
    std::vector<float> level(size_t{4} * side * side);
    for (size_t y = 0; y < side; ++y)
      for (size_t x = 0; x < side; ++x)
        for (size_t c = 0; c < 3; ++c) {
          const float* const from = &finer[4 * (2 * y * 2 * side + 2 * x) + c];
          level[4 * (y * side + x) + c] = 0.25f * (from[0] + from[4] + from[8 * side] + from[8 * side + 4]);
        }
    maps.levels.push_back(std::move(level));
  }
  return maps;
}

/// A sample of GGX around +z, for a view along the normal.
struct LobeSample {
  float direction[3];
  float weight;    // cosine
  uint32_t level;  // map whose texels are about as large as the solid angle of the sample
};

std::vector<LobeSample> sample_lobe(float roughness, uint32_t count) {
  const float alpha = roughness * roughness;
  const float square = alpha * alpha;
  std::vector<LobeSample> samples;
  for (uint32_t i = 0; i < count; ++i) {
    uint32_t bits = i;  // the radical inverse to base 2
    bits = (bits << 16) | (bits >> 16);
    bits = ((bits & 0x55555555u) << 1) | ((bits & 0xaaaaaaaau) >> 1);
    bits = ((bits & 0x33333333u) << 2) | ((bits & 0xccccccccu) >> 2);
    bits = ((bits & 0x0f0f0f0fu) << 4) | ((bits & 0xf0f0f0f0u) >> 4);
    bits = ((bits & 0x00ff00ffu) << 8) | ((bits & 0xff00ff00u) >> 8);
    const float first = (static_cast<float>(i) + 0.5f) / static_cast<float>(count);
    const float angle = 2 * std::numbers::pi_v<float> * static_cast<float>(bits >> 8) / 16777216.0f;
    const float cosine = std::sqrt((1 - first) / (1 + (square - 1) * first));
    const float sine = std::sqrt(std::max(0.0f, 1 - cosine * cosine));
    const float half[3] = {sine * std::cos(angle), sine * std::sin(angle), cosine};
    LobeSample sample{{2 * cosine * half[0], 2 * cosine * half[1], 2 * cosine * cosine - 1}, 0, 0};
    if (sample.direction[2] <= 0) continue;
    sample.weight = sample.direction[2];
    const float spread = cosine * cosine * (square - 1) + 1;
    const float density = square / (std::numbers::pi_v<float> * spread * spread) / 4;
    const float texel = 4 * std::numbers::pi_v<float> / (kFinestEnvironment * kFinestEnvironment);
    const float level = 0.5f * std::log2(1 / (static_cast<float>(count) * density * texel)) + 1;
    sample.level = static_cast<uint32_t>(std::clamp(level + 0.5f, 0.0f, 6.0f));
    samples.push_back(sample);
  }
  return samples;
}

void filter_level(const Octahedra& maps, uint32_t level, uint32_t threads, float* out) {
  const uint32_t side = kernels::environment_side(level);
  const std::vector<LobeSample> samples =
      sample_lobe(static_cast<float>(level) / (kEnvironmentLevels - 1), std::min(16u << level, 256u));
  parallel_for(side, threads, [&](uint64_t y) {
    for (uint32_t x = 0; x < side; ++x) {
      float n[3];
      kernels::octahedral_direction((static_cast<float>(x) + 0.5f) / static_cast<float>(side),
                                    (static_cast<float>(y) + 0.5f) / static_cast<float>(side), n);
      const float length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
      for (float& c : n) c /= length;
      // Two directions at right angles to it.
      const float up[3] = {0, std::fabs(n[1]) < 0.9f ? 1.0f : 0.0f, std::fabs(n[1]) < 0.9f ? 0.0f : 1.0f};
      float t[3] = {up[1] * n[2] - up[2] * n[1], up[2] * n[0] - up[0] * n[2], up[0] * n[1] - up[1] * n[0]};
      const float t_length = std::sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2]);
      for (float& c : t) c /= t_length;
      const float b[3] = {n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2], n[0] * t[1] - n[1] * t[0]};
      Color sum{};
      float weights = 0;
      for (const LobeSample& sample : samples) {
        float d[3], place[2], light[3];
        for (int i = 0; i < 3; ++i)
          d[i] = sample.direction[0] * t[i] + sample.direction[1] * b[i] + sample.direction[2] * n[i];
        kernels::octahedral_place(d, place);
        kernels::sample_octahedral(maps.levels[sample.level].data(), maps.side(sample.level), place, light);
        for (size_t c = 0; c < 3; ++c) sum[c] += sample.weight * light[c];
        weights += sample.weight;
      }
      float* const texel = out + 4 * (y * side + x);
      for (size_t c = 0; c < 3; ++c) texel[c] = sum[c] / weights;
    }
  });
}

/// Source: R. Ramamoorthi, P. Hanrahan, An Efficient Representation for Irradiance Environment Maps, 2001.
void find_irradiance(const Panorama& panorama, float* out) {
  std::array<double, 3 * kernels::kIrradianceTerms> sums{};
  for (uint32_t y = 0; y < panorama.height; ++y) {
    for (uint32_t x = 0; x < panorama.width; ++x) {
      double wide[3];
      panorama.direction(x, y, wide);
      const float d[3] = {static_cast<float>(wide[0]), static_cast<float>(wide[1]), static_cast<float>(wide[2])};
      const double angle = 2 * std::numbers::pi / panorama.width * std::numbers::pi / panorama.height *
                           std::sqrt(std::max(0.0, 1 - wide[1] * wide[1]));
      float terms[kernels::kIrradianceTerms];
      kernels::harmonics(d, terms);
      const Color& light = panorama.texels[size_t{y} * panorama.width + x];
      for (size_t i = 0; i < kernels::kIrradianceTerms; ++i)
        for (size_t c = 0; c < 3; ++c) sums[3 * i + c] += angle * double{terms[i]} * double{light[c]};
    }
  }
  // The harmonics of the cosine, divided by pi.
  for (size_t i = 0; i < sums.size(); ++i)
    out[i] = static_cast<float>(sums[i] * (i < 3 ? 1.0 : i < 12 ? 2.0 / 3 : 0.25));
}

std::vector<float> filter(const Panorama& panorama, uint32_t threads) {
  std::vector<float> out(kernels::kEnvironmentFloats);
  find_irradiance(panorama, out.data());
  const Octahedra maps = make_octahedra(panorama, threads);
  std::copy(maps.levels[0].begin(), maps.levels[0].end(), out.begin() + kernels::environment_offset(0));
  for (uint32_t level = 1; level < kEnvironmentLevels; ++level)
    filter_level(maps, level, threads, out.data() + kernels::environment_offset(level));
  return out;
}

float smooth_step(float low, float high, float value) {
  const float t = std::clamp((value - low) / (high - low), 0.0f, 1.0f);
  return t * t * (3 - 2 * t);
}

Color sky_color(const double d[3]) {
  constexpr Color kHorizon{0.80f, 0.84f, 0.88f}, kZenith{0.30f, 0.42f, 0.62f}, kGround{0.22f, 0.21f, 0.20f};
  constexpr Color kPatch{6.0f, 5.7f, 5.2f};
  constexpr double kPatchPlace[3] = {0.4666667, 0.6666667, 0.5811865};  // unit length
  const auto height = static_cast<float>(d[1]);
  const bool is_sky = height >= 0;
  const float share = is_sky ? std::sqrt(height) : std::min(1.0f, 6 * -height);
  const float towards_patch = static_cast<float>(d[0] * kPatchPlace[0] + d[1] * kPatchPlace[1] + d[2] * kPatchPlace[2]);
  const float patch = smooth_step(0.906f, 0.990f, towards_patch);  // 25 to 8 degrees
  Color out{};
  for (size_t c = 0; c < 3; ++c)
    out[c] = kHorizon[c] + ((is_sky ? kZenith[c] : kGround[c]) - kHorizon[c]) * share + kPatch[c] * patch;
  return out;
}

}  // namespace

std::vector<float> make_sky(uint32_t threads) {
  Panorama panorama{512, 256, std::vector<Color>(size_t{512} * 256)};
  for (uint32_t y = 0; y < panorama.height; ++y) {
    for (uint32_t x = 0; x < panorama.width; ++x) {
      double d[3];
      panorama.direction(x, y, d);
      panorama.texels[size_t{y} * panorama.width + x] = sky_color(d);
    }
  }
  return filter(panorama, threads);
}

const std::vector<float>& sky(uint32_t threads) {
  static const std::vector<float> made = make_sky(threads);
  return made;
}

Result<std::vector<float>> load_environment(const std::string& path, uint32_t threads) {
  const MappedFile map = SCREE_TRY(MappedFile::open(path));
  const HdrSize size = SCREE_TRY_AT(path, read_hdr_size(map.bytes()));
  Panorama panorama{.width = std::min(size.width, kMostWidth), .height = std::min(size.height, kMostWidth / 2)};
  // Rows of larger pictures are averaged as they are read.
  std::vector<double> sums(size_t{4} * panorama.width * panorama.height);
  const Result<void> read = read_hdr(map.bytes(), [&](uint32_t y, std::span<const float> row) {
    const uint64_t line = uint64_t{y} * panorama.height / size.height * panorama.width;
    for (uint64_t x = 0; x < size.width; ++x) {
      double* const sum = &sums[4 * (line + x * panorama.width / size.width)];
      for (size_t c = 0; c < 3; ++c) sum[c] += static_cast<double>(std::min(row[3 * x + c], kBrightest));
      sum[3] += 1;
    }
  });
  if (!read) return at(path, read.error());
  panorama.texels.resize(sums.size() / 4);
  for (size_t i = 0; i < panorama.texels.size(); ++i)
    for (size_t c = 0; c < 3; ++c) panorama.texels[i][c] = static_cast<float>(sums[4 * i + c] / sums[4 * i + 3]);
  return filter(panorama, threads);
}

}  // namespace scree::runtime
