// Light from all around, in the form that shading reads. runtime/light/environment.cpp makes it once per scene.
#pragma once

#include <cmath>
#include <cstdint>

#include "kernels/math.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// An environment is kEnvironmentFloats floats: the light that a matt surface reflects, then octahedral maps of the
/// reflections of mirrors of increasing roughness.
inline constexpr uint32_t kIrradianceTerms = 9;  // spherical harmonics up to degree 2, for each of red, green and blue
inline constexpr uint32_t kEnvironmentLevels = 6;    // perceptual roughness 0, 0.2, ... 1
inline constexpr uint32_t kFinestEnvironment = 256;  // texels per side of level 0
inline constexpr uint32_t kCoarsestEnvironment = 16;

SCREE_HD constexpr uint32_t environment_side(uint32_t level) {
  return (kFinestEnvironment >> level) > kCoarsestEnvironment ? kFinestEnvironment >> level : kCoarsestEnvironment;
}

/// The first float of a level. Texels are red, green, blue and 0, rows from the top.
SCREE_HD constexpr uint32_t environment_offset(uint32_t level) {
  uint32_t offset = 28;  // the irradiance, and one float that aligns texels to 16 bytes
  for (uint32_t i = 0; i < level; ++i) offset += 4 * environment_side(i) * environment_side(i);
  return offset;
}
inline constexpr uint32_t kEnvironmentFloats = environment_offset(kEnvironmentLevels);

/// The point of the unit square for a direction of any length but 0. The octahedron's upper half (y >= 0) fills the
/// middle, its lower half is folded outwards.
SCREE_HD inline void octahedral_place(const float direction[3], float place[2]) {
  const float sum = abs_of(direction[0]) + abs_of(direction[1]) + abs_of(direction[2]);
  const float scale = sum > 0 ? 1.0f / sum : 0.0f;
  float u = direction[0] * scale;
  float v = direction[2] * scale;
  if (direction[1] < 0) {
    const float folded_u = (1.0f - abs_of(v)) * (u >= 0 ? 1.0f : -1.0f);
    const float folded_v = (1.0f - abs_of(u)) * (v >= 0 ? 1.0f : -1.0f);
    u = folded_u;
    v = folded_v;
  }
  place[0] = 0.5f + 0.5f * u;
  place[1] = 0.5f + 0.5f * v;
}

/// The inverse: the direction, not normalised, of a point in [0, 1].
SCREE_HD inline void octahedral_direction(float u, float v, float direction[3]) {
  const float x = 2.0f * u - 1.0f;
  const float z = 2.0f * v - 1.0f;
  const float y = 1.0f - abs_of(x) - abs_of(z);
  direction[0] = y >= 0 ? x : (1.0f - abs_of(z)) * (x >= 0 ? 1.0f : -1.0f);
  direction[1] = y;
  direction[2] = y >= 0 ? z : (1.0f - abs_of(x)) * (z >= 0 ? 1.0f : -1.0f);
}

/// Samples one level of a map, bilinearly. Beyond an edge the map continues at the mirrored point of the same edge.
SCREE_HD inline void sample_octahedral(const float* texels, uint32_t side, const float place[2], float rgb[3]) {
  const int32_t size = static_cast<int32_t>(side);
  float weight[2];
  int32_t first[2];
  for (int i = 0; i < 2; ++i) {
    const float at = place[i] * static_cast<float>(size) - 0.5f;
    const float below = std::floor(at);
    weight[i] = at - below;
    first[i] = min_of(max_of(static_cast<int32_t>(below), -1), size - 1);
  }
  rgb[0] = rgb[1] = rgb[2] = 0;
  for (int32_t i = 0; i < 4; ++i) {
    int32_t x = first[0] + (i & 1);
    int32_t y = first[1] + (i >> 1);
    if (x < 0 || x >= size) {
      x = min_of(max_of(x, 0), size - 1);
      y = size - 1 - y;
    }
    if (y < 0 || y >= size) {
      y = min_of(max_of(y, 0), size - 1);
      x = size - 1 - x;
    }
    const float share = ((i & 1) != 0 ? weight[0] : 1.0f - weight[0]) * ((i >> 1) != 0 ? weight[1] : 1.0f - weight[1]);
    const float* texel = texels + 4 * (y * size + x);
#if defined(__CUDA_ARCH__)
    const float4 colour = *reinterpret_cast<const float4*>(texel);
    const float light[3] = {colour.x, colour.y, colour.z};
#else
    const float* const light = texel;
#endif
    for (int c = 0; c < 3; ++c) rgb[c] += share * light[c];
  }
}

/// The light that a mirror of a roughness (perceptual, 0 to 1) reflects in a direction.
SCREE_HD inline void reflected_light(const float* environment, const float direction[3], float roughness,
                                     float rgb[3]) {
  float place[2];
  octahedral_place(direction, place);
  const float level = min_of(max_of(roughness, 0.0f), 1.0f) * static_cast<float>(kEnvironmentLevels - 1);
  const uint32_t fine = min_of(static_cast<uint32_t>(level), kEnvironmentLevels - 2);
  const float between = level - static_cast<float>(fine);
  float coarse[3];
  sample_octahedral(environment + environment_offset(fine), environment_side(fine), place, rgb);
  sample_octahedral(environment + environment_offset(fine + 1), environment_side(fine + 1), place, coarse);
  for (int c = 0; c < 3; ++c) rgb[c] += (coarse[c] - rgb[c]) * between;
}

/// The spherical harmonics of degrees 0 to 2 in a unit direction.
SCREE_HD inline void harmonics(const float d[3], float terms[kIrradianceTerms]) {
  terms[0] = 0.282095f;
  terms[1] = 0.488603f * d[1];
  terms[2] = 0.488603f * d[2];
  terms[3] = 0.488603f * d[0];
  terms[4] = 1.092548f * d[0] * d[1];
  terms[5] = 1.092548f * d[1] * d[2];
  terms[6] = 0.315392f * (3.0f * d[2] * d[2] - 1.0f);
  terms[7] = 1.092548f * d[0] * d[2];
  terms[8] = 0.546274f * (d[0] * d[0] - d[1] * d[1]);
}

/// The light that a white matt surface with a unit normal reflects; at least 0.
SCREE_HD inline void diffuse_environment(const float* environment, const float normal[3], float rgb[3]) {
  float terms[kIrradianceTerms];
  harmonics(normal, terms);
  for (int c = 0; c < 3; ++c) {
    rgb[c] = 0;
    for (uint32_t i = 0; i < kIrradianceTerms; ++i) rgb[c] += environment[3 * i + static_cast<uint32_t>(c)] * terms[i];
    rgb[c] = max_of(rgb[c], 0.0f);
  }
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
