// The light that a surface reflects to the viewer: glTF 2.0's metallic-roughness model (its appendix B: GGX, Smith,
// Schlick), with KHR_materials_specular and KHR_materials_ior, under an environment or the file's lights. All vectors
// are in view space: x right, y down, z away from the eye, LightFrame::unit units per world unit.
#pragma once

#include <cmath>

#include "kernels/shade/approximate.h"
#include "kernels/shade/environment.h"
#include "kernels/shade/shade_inputs.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

struct Float3 {
  float x;
  float y;
  float z;
};
SCREE_HD inline Float3 operator+(const Float3& a, const Float3& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
SCREE_HD inline Float3 operator-(const Float3& a, const Float3& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
SCREE_HD inline Float3 operator*(const Float3& a, const Float3& b) {
  return {a.x * b.x, a.y * b.y, a.z * b.z};
}
SCREE_HD inline Float3 operator*(const Float3& a, float scale) {
  return {a.x * scale, a.y * scale, a.z * scale};
}
SCREE_HD inline Float3 grey(float value) {
  return {value, value, value};
}
SCREE_HD inline float dot(const Float3& a, const Float3& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
SCREE_HD inline Float3 cross(const Float3& a, const Float3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
SCREE_HD inline float largest_of(const Float3& a) {
  return max_of(a.x, max_of(a.y, a.z));
}
/// Scaled to unit length, or `otherwise` if there is no direction.
SCREE_HD inline Float3 unit_or(const Float3& a, const Float3& otherwise) {
  const float largest = max_of(abs_of(a.x), max_of(abs_of(a.y), abs_of(a.z)));
  if (!(largest > 0) || !(largest < 8e37f)) return otherwise;
  const Float3 scaled = a * reciprocal(largest);  // squares of tiny lengths would underflow
  return scaled * inverse_root(dot(scaled, scaled));
}
SCREE_HD inline float unit_range(float value) {
  return min_of(max_of(value, 0.0f), 1.0f);
}
SCREE_HD inline Float3 mix(const Float3& a, const Float3& b, float share) {
  return a + (b - a) * share;
}

inline constexpr float kPi = 3.14159265f;
inline constexpr float kLeastRoughness =
    0.045f;  // a smoother surface is a mirror, whose highlights the samples would miss

/// The surface that light hits at a sample.
struct SurfacePoint {
  Float3 diffuse;  // albedo of the light that enters the surface
  Float3 f0;       // reflectance at normal incidence
  float f90;       // and at grazing incidence
  float coat_f0;   // f0 of the dielectric alone, in the colour that it reflects most; coat_f90 likewise
  float coat_f90;
  float roughness;   // perceptual
  float occlusion;   // share of the surroundings' light that arrives
  Float3 normal;     // unit, towards the viewer
  Float3 to_viewer;  // unit
};

/// mix(a, b, share) of numbers.
SCREE_HD inline float between(float a, float b, float share) {
  return a + (b - a) * share;
}

/// Appendix B's BRDF times the cosine, for light from the unit direction `to_light`. It is mix(dielectric, metal,
/// metallic). Both have the same roughness, so they share one reflection, of mixed reflectances. Light enters the
/// dielectric alone, reduced by the dielectric's own reflection.
SCREE_HD inline Float3 reflected_share(const SurfacePoint& at, const Float3& to_light) {
  const float n_l = dot(at.normal, to_light);
  if (!(n_l > 0)) return grey(0);
  const float n_v = max_of(abs_of(dot(at.normal, at.to_viewer)), 1e-4f);
  const Float3 half = unit_or(to_light + at.to_viewer, at.normal);
  const float n_h = unit_range(dot(at.normal, half));
  const float v_h = unit_range(dot(at.to_viewer, half));
  const float alpha = at.roughness * at.roughness;
  const float square = alpha * alpha;
  const float spread = n_h * n_h * (square - 1.0f) + 1.0f;
  const float distribution = square / (kPi * spread * spread);
  const float masking =
      (n_l + std::sqrt(square + (1.0f - square) * n_l * n_l)) * (n_v + std::sqrt(square + (1.0f - square) * n_v * n_v));
  const float grazing = 1.0f - v_h;
  const float fifth = grazing * grazing * grazing * grazing * grazing;
  const Float3 fresnel = mix(at.f0, grey(at.f90), fifth);
  const float entering = 1.0f - between(at.coat_f0, at.coat_f90, fifth);
  return (at.diffuse * (entering / kPi) + fresnel * (distribution / masking)) * n_l;
}

/// Reflectance under equal light from the whole hemisphere: f0 * scale + f90 * bias. Fitted by least squares to the
/// integrals of appendix B's BRDF over the light's directions, for 20 roughnesses and 22 angles. For n_v of 0.2 and
/// more, the error of scale + bias is at most 0.014, and that of bias at most 0.007. At grazing angles they are at most
/// 0.072 and 0.038.
SCREE_HD inline void split_sum(float roughness, float n_v, float& scale, float& bias) {
  const float alpha = roughness * roughness;
  const float lost =
      alpha * (5.709f + n_v * (0.9123f * n_v + 53.74f * alpha - 5.985f) + alpha * (112.2f * alpha - 13.44f)) *
      reciprocal(1.0f + n_v * (49.37f * n_v - 86.37f * alpha + 9.832f) + alpha * (240.8f * alpha + 3.767f));
  const float away = 1.0f - n_v;
  bias = away * away * away * (0.9527f - 0.9117f * roughness) *
         reciprocal(1.0f + n_v * (10.06f * n_v - 12.98f * roughness + 0.6484f) +
                    roughness * (10.26f * roughness - 0.4651f));
  scale = 1.0f - lost - bias;
}

SCREE_HD inline Float3 environment_light(const ShadeInputs& in, const SurfacePoint& at) {
  const auto world = [&](const Float3& v, float out[3]) {
    const float(*axes)[3] = in.light.axes;
    for (int i = 0; i < 3; ++i) out[i] = axes[0][i] * v.x + axes[1][i] * v.y + axes[2][i] * v.z;
  };
  const float n_v = unit_range(dot(at.normal, at.to_viewer));
  float scale;
  float bias;
  split_sum(at.roughness, n_v, scale, bias);
  const Float3 specular = at.f0 * scale + grey(at.f90 * bias);
  float direction[3];
  float light[3];
  world(at.normal, direction);
  diffuse_environment(in.scene.environment, direction, light);
  const float entering = 1.0f - unit_range(at.coat_f0 * scale + at.coat_f90 * bias);
  const Float3 diffuse = at.diffuse * entering * Float3{light[0], light[1], light[2]};
  world(at.normal * (2.0f * dot(at.normal, at.to_viewer)) - at.to_viewer, direction);
  reflected_light(in.scene.environment, direction, at.roughness, light);
  return (diffuse + specular * Float3{light[0], light[1], light[2]}) * at.occlusion;
}

/// The share of the sun that reaches a sample: 1 less the dark part of the square of 2 x 2 samples of a map around it.
/// `face`: the triangle's normal. A call, so that pictures without shadows need only one test.
[[gnu::noinline]] SCREE_HD inline float sun_share(const ShadeInputs& in, Float3 place, Float3 face) {
  const SunMaps& sun = in.sun;
  const SunMap* at_map = sun.maps;
  float at[3];
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
  for (;; ++at_map) {
    for (int r = 0; r < 3; ++r)
      at[r] = dot(Float3{at_map->rows[r][0], at_map->rows[r][1], at_map->rows[r][2]}, place) + at_map->rows[r][3];
    // A map before the last one has all samples around its surfaces, and ends behind these.
    const bool is_last = at_map == sun.maps + sun.count - 1;
    const float border = is_last ? 0.0f : 1.0f;
    const bool is_inside = at[0] >= border && at[0] < static_cast<float>(at_map->width) - border && at[1] >= border &&
                           at[1] < static_cast<float>(at_map->height) - border;
    if (is_inside && (is_last || at[2] >= 0)) break;
    if (is_last) return 1.0f;
  }
  const SunMap& map = *at_map;
  float normal[3];
  for (int r = 0; r < 3; ++r) normal[r] = abs_of(dot(Float3{map.rows[r][0], map.rows[r][1], map.rows[r][2]}, face));
  // The triangle's plane rises within 1.5 samples along both axes, up to the farthest centre that is read. Levels have
  // a few roundings of 2^-24 of their range.
  constexpr float kRounding = static_cast<float>(1u << kDepthBits) / static_cast<float>(1u << 21);
  const float rise = 1.5f * ((normal[0] + normal[1]) / normal[2]) * map.steepness;
  const float limit = at[2] + rise + map.half_sample + kRounding;
  const int32_t x = static_cast<int32_t>(at[0]);
  const int32_t y = static_cast<int32_t>(at[1]);
  const float right = at[0] - static_cast<float>(x);
  const float below = at[1] - static_cast<float>(y);
  float dark = 0;
  for (int32_t j = -1; j <= 1; ++j) {
    for (int32_t i = -1; i <= 1; ++i) {
      const int32_t column = min_of(max_of(x + i, 0), map.width - 1);
      const int32_t row = min_of(max_of(y + j, 0), map.height - 1);
      const uint64_t sample = map.samples[int64_t{row} * map.width + column];
      if (!(static_cast<float>(kFarthestDepthCode - sample_depth_code(sample)) > limit)) continue;
      dark += (i < 0 ? 1.0f - right : i > 0 ? right : 1.0f) * (j < 0 ? 1.0f - below : j > 0 ? below : 1.0f);
    }
  }
  return 1.0f - 0.25f * dark;
}

/// The light from the file's lights (KHR_lights_punctual). `place`: the sample, relative to the eye. `sun`: the share
/// of the light that ShadeInputs::sun is of.
SCREE_HD inline Float3 punctual_light(const ShadeInputs& in, const SurfacePoint& at, const Float3& place, float sun) {
  const float(*axes)[3] = in.light.axes;
  const auto turned = [&](const float v[3]) {
    float out[3];
    for (int i = 0; i < 3; ++i) out[i] = axes[i][0] * v[0] + axes[i][1] * v[1] + axes[i][2] * v[2];
    return Float3{out[0], out[1], out[2]};
  };
  Float3 sum = grey(0);
  for (uint32_t i = 0; i < in.scene.light_count; ++i) {
    const PlacedLight& light = in.scene.lights[i];
    const Float3 along = turned(light.direction);
    Float3 to_light = along * -1.0f;
    float strength = i == in.sun.light ? sun : 1.0f;
    if (light.kind != format::LightKind::kDirectional) {
      // Both are large if a scene lies far from the origin, so the difference is taken first.
      const float offset[3] = {static_cast<float>(light.position[0] - in.view.eye[0]),
                               static_cast<float>(light.position[1] - in.view.eye[1]),
                               static_cast<float>(light.position[2] - in.view.eye[2])};
      const Float3 way = turned(offset) - place * (1.0f / in.light.unit);
      const float squared = max_of(dot(way, way), 1e-12f);
      to_light = unit_or(way, to_light);
      strength = 1.0f / squared;
      if (light.range > 0) {
        const float share = squared / (light.range * light.range);
        strength *= unit_range(1.0f - share * share);
      }
      if (light.kind == format::LightKind::kSpot) {
        const float cone = unit_range(light.cone_scale * (dot(along, to_light) * -1.0f) + light.cone_offset);
        strength *= cone * cone;
      }
    }
    if (!(strength > 0)) continue;
    sum = sum + reflected_share(at, to_light) * Float3{light.color[0], light.color[1], light.color[2]} * strength;
  }
  return sum;
}

/// A material at a sample: its factors times its textures.
struct SurfaceValues {
  Float3 base{1, 1, 1};
  float metallic = 0;  // a material without a surface is matt
  float roughness = 1;
  float occlusion = 1;
  Float3 emission{0, 0, 0};
  float specular = 1;
  Float3 specular_color{1, 1, 1};
};

/// Sets which share of the light is reflected and which enters. `base`: the colour; `ior`: the index of refraction.
SCREE_HD inline void set_reflectance(const SurfaceValues& values, const Float3& base, float ior, SurfacePoint& out) {
  const float root = (ior - 1.0f) / (ior + 1.0f);  // 1 if ior is 0
  const Float3 tinted = values.specular_color * (root * root);
  const Float3 dielectric =
      Float3{min_of(tinted.x, 1.0f), min_of(tinted.y, 1.0f), min_of(tinted.z, 1.0f)} * values.specular;
  out.roughness = max_of(values.roughness, kLeastRoughness);
  out.diffuse = base * (1.0f - values.metallic);
  out.f0 = mix(dielectric, base, values.metallic);
  out.f90 = between(values.specular, 1.0f, values.metallic);
  out.coat_f0 = largest_of(dielectric);
  out.coat_f90 = values.specular;
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
