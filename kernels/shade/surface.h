// Surfaces under light: glTF 2.0's metallic-roughness model (its appendix B: GGX, Smith, Schlick), with
// KHR_materials_specular and KHR_materials_ior, under an environment, the file's lights, or the camera's. Everything is
// in view space: x right, y down, z away from the eye, LightFrame::unit units per world unit.
#pragma once

#include "kernels/shade/environment.h"
#include "kernels/shade/shade.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

inline constexpr float kPi = 3.14159265f;
inline constexpr float kLeastRoughness =
    0.045f;  // a smoother surface is a mirror, whose highlights the samples would miss

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

/// Reflectance under equal light from the whole hemisphere: f0 * scale + f90 * bias. Source: B. Karis, Physically Based
/// Shading on Mobile, 2014, a fit of D. Lazarov, Getting More Physical in Call of Duty: Black Ops II, 2013.
SCREE_HD inline void split_sum(float roughness, float n_v, float& scale, float& bias) {
  const float x = 1.0f - roughness;
  const float y = 0.0425f - 0.0275f * roughness;
  const float reach = min_of(x * x, std::exp2(-9.28f * n_v)) * x + y;
  scale = -1.04f * reach + 1.04f - 0.572f * roughness;
  bias = max_of(1.04f * reach - 0.04f + 0.022f * roughness, 0.0f);
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

/// The share of the sun that reaches a sample: 1 less the dark part of the square of 2 x 2 samples of the map around
/// it. `face`: the triangle's normal. A call, so that pictures without shadows pay one test.
[[gnu::noinline]] SCREE_HD inline float sun_share(const SunMap& map, Float3 place, Float3 face) {
  float at[3];
  float normal[3];
  for (int r = 0; r < 3; ++r) {
    const Float3 row{map.rows[r][0], map.rows[r][1], map.rows[r][2]};
    at[r] = dot(row, place) + map.rows[r][3];
    normal[r] = abs_of(dot(row, face));
  }
  if (!(at[0] >= 0 && at[0] < static_cast<float>(map.width) && at[1] >= 0 && at[1] < static_cast<float>(map.height)))
    return 1.0f;
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

/// As LinearCodes; with a null table the values are the codes.
struct SurfaceCodes {
  const float* linear;
  SCREE_HD void read(const uint32_t texels[4], uint32_t shift, float values[4]) const {
    if (linear != nullptr) return LinearCodes{linear}.read(texels, shift, values);
    for (uint32_t i = 0; i < 4; ++i) values[i] = static_cast<float>(texels[i] >> shift & 255u);
  }
};

/// Whether two textures of one size have the same places for equal texture coordinates. `a`, `b`: uv_transform().
SCREE_HD inline bool same_transform(const float* a, const float* b) {
  bool same = true;
  for (uint32_t i = 0; i < 5; ++i) same = same && a[i] == b[i];
  return same;
}

/// Whether a texture of a surface uses the mesh's second texture coordinates.
SCREE_HD inline bool uses_second(const format::SurfaceRecord& surface, uint32_t use) {
  return (surface.second_uv >> use & 1u) != 0;
}

/// The direction of the mesh's tangents at the sample, in view space, around `normal`; the result's length is 0 if they
/// have none there. `focal`: as for view_normal(). Sets `bitangent` too.
SCREE_HD inline Float3 stored_tangent(const ShadeInputs& in, const PlacedChunk& at, const uint32_t vertex[3],
                                      const float weights[3], float focal, const Float3& normal, Float3& bitangent) {
  float object[3];
  const float sign = vertex_tangent(at, vertex, weights, object) * (at.transform.mirrored ? -1.0f : 1.0f);
  Float3 along = grey(0);
  for (int j = 0; j < 3; ++j)
    along = along + Float3{at.transform.x[j], at.transform.y[j] * in.aspect, at.transform.w[j] * focal} * object[j];
  along = unit_or(along, grey(0));
  const Float3 tangent = unit_or(along - normal * dot(normal, along), grey(0));
  bitangent = cross(normal, tangent) * sign;
  return tangent;
}

/// The normal that a normal map's `code` gives around `normal` (unit length, of the front). The tangent is the mesh's
/// or, if it stores none, comes from the triangle's transformed texture coordinates. Then it is constant on a triangle,
/// while MikkTSpace's is averaged at its corners.
SCREE_HD inline Float3 mapped_normal(const ShadeInputs& in, const PlacedChunk& at, const uint32_t vertex[3],
                                     const float weights[3], const format::SurfaceRecord& surface, const Float3& code,
                                     const Float3 edge[2], float focal, const Float3& normal) {
  constexpr uint32_t kUse = static_cast<uint32_t>(format::SurfaceUse::kNormalMap);
  Float3 tangent;
  Float3 bitangent;
  if (has_tangents(at)) {
    tangent = stored_tangent(in, at, vertex, weights, focal, normal, bitangent);
  } else {
    const TextureCorners<float> corners =
        texture_corners<float>(at, vertex, uv_transform(surface.textures[kUse]), uses_second(surface, kUse));
    const float(*d)[2] = corners.edge;
    const float side = d[0][0] * d[1][1] - d[1][0] * d[0][1] >= 0 ? 1.0f : -1.0f;
    const Float3 along_u = unit_or((edge[0] * d[1][1] - edge[1] * d[0][1]) * side, grey(0));
    const Float3 along_v = (edge[1] * d[0][0] - edge[0] * d[1][0]) * side;
    tangent = unit_or(along_u - normal * dot(normal, along_u), grey(0));
    bitangent = cross(normal, tangent);
    if (dot(bitangent, along_v) > 0) bitangent = bitangent * -1.0f;  // green is up, v goes down
  }
  const float bump_x = (2.0f * code.x - 1.0f) * surface.normal_scale;
  const float bump_y = (2.0f * code.y - 1.0f) * surface.normal_scale;
  const float bump_z = 2.0f * code.z - 1.0f;
  if (dot(tangent, tangent) == 0) return normal;  // the triangle has no area in the texture
  return unit_or(tangent * bump_x + bitangent * bump_y + normal * bump_z, normal);
}

/// A material at a sample: its factors times its textures.
struct SurfaceValues {
  Float3 base{1, 1, 1};
  Float3 bump{0, 0, 0};  // the normal map's code
  bool has_bump = false;
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

/// One bit per use of a texture: the uses of SurfaceUse, and after them the base colour.
SCREE_HD constexpr uint32_t use_bit(format::SurfaceUse use) {
  return 1u << static_cast<uint32_t>(use);
}
inline constexpr uint32_t kBaseUse = format::kSurfaceUses;
inline constexpr uint32_t kCameraUses = use_bit(format::SurfaceUse::kNormalMap) |
                                        use_bit(format::SurfaceUse::kOcclusion) |
                                        use_bit(format::SurfaceUse::kEmission);  // visible in the camera's light
inline constexpr uint32_t kColorUses = [] {
  uint32_t bits = 1u << kBaseUse;
  for (uint32_t i = 0; i < format::kSurfaceUses; ++i)
    if (format::is_color(static_cast<format::SurfaceUse>(i))) bits |= 1u << i;
  return bits;
}();

/// Multiplies a material's textures into `out`, which holds its factors. `surface`: null if there is only a base
/// colour. It is one loop over all textures, so that the kernel contains one sampler; with seven, nvcc took minutes to
/// compile it.
template <class Shader>
SCREE_HD inline void read_textures(const Shader& shader, const PlacedChunk& at, const uint32_t vertex[3],
                                   const format::MaterialRecord& material, const format::SurfaceRecord* surface,
                                   const PlaneHit<float>& m, const float weights[3], float x, float y,
                                   typename Shader::Texels::Lane& lane, SurfaceValues& out) {
  using Use = format::SurfaceUse;
  const ShadeInputs& in = shader.in;
  uint32_t uses = 1u << kBaseUse;
  if (surface != nullptr) uses |= in.light.lighting == Lighting::kCamera ? kCameraUses : (1u << kBaseUse) - 1u;
  if ((uses & use_bit(Use::kEmission)) != 0 && !(largest_of(out.emission) > 0)) uses &= ~use_bit(Use::kEmission);
  const auto number_of = [&](uint32_t use) {
    return use == kBaseUse ? material.texture : surface->textures[use].texture;
  };
  const auto transform_of = [&](uint32_t use) {
    return use == kBaseUse ? uv_transform(material) : uv_transform(surface->textures[use]);
  };
  const auto is_second_of = [&](uint32_t use) { return use != kBaseUse && uses_second(*surface, use); };
  // Metalness, roughness and occlusion often lie in one picture, which is then read once.
  constexpr uint32_t kRough = static_cast<uint32_t>(Use::kMetallicRoughness);
  constexpr uint32_t kOcclusion = static_cast<uint32_t>(Use::kOcclusion);
  constexpr uint32_t kPacked = 1u << kRough | 1u << kOcclusion;
  const bool is_packed = (uses & kPacked) == kPacked && number_of(kRough) == number_of(kOcclusion) &&
                         is_second_of(kRough) == is_second_of(kOcclusion) &&
                         same_transform(transform_of(kRough), transform_of(kOcclusion));
  if (is_packed) uses &= ~(1u << kOcclusion);
  const auto occlusion_of = [&](float code) { return 1.0f + surface->occlusion_strength * (code - 1.0f); };
  TexturePlace place{};
  uint32_t placed = format::kNone;  // the use of the texture whose place was computed last
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
  for (uint32_t i = 0; i <= kBaseUse; ++i) {
    if ((uses >> i & 1u) == 0) continue;
    const uint32_t number = number_of(i);
    if (number == format::kNone) continue;
    const TextureView& texture = in.scene.textures[number];
    const Use use = static_cast<Use>(i);
    if (texture.level_count == 0) continue;
    const bool is_second = is_second_of(i);
    if (is_second && (at.mesh.attributes & format::kHasSecondUv) == 0) continue;
    if (use == Use::kSpecular && texture.jpeg_level_count != 0) continue;  // no alpha in JPEGs
    const float* const transform = transform_of(i);
    // Most textures of a material have the same place.
    const TextureView& other = in.scene.textures[number_of(placed != format::kNone ? placed : i)];
    if (placed == format::kNone || texture.width != other.width || texture.height != other.height ||
        is_second != is_second_of(placed) || !same_transform(transform, transform_of(placed))) {
      place = shader.find_place(at, vertex, transform, static_cast<float>(texture.width),
                                static_cast<float>(texture.height), m, weights, x, y, is_second);
      placed = i;
    }
    float code[3];
    const bool is_color = (kColorUses >> i & 1u) != 0;
    sample_channels(shader.texels, lane, texture, SurfaceCodes{is_color ? in.srgb->linear : nullptr},
                    use == Use::kSpecular ? 24u : 0u, place.u, place.v, place.footprint, code);
    if (!is_color)
      for (float& channel : code) channel *= 1.0f / 255.0f;
    const Float3 color{code[0], code[1], code[2]};
    if (i == kBaseUse) {
      out.base = color;
    } else if (use == Use::kMetallicRoughness) {
      out.roughness *= code[1];
      out.metallic *= code[2];
      if (is_packed) out.occlusion = occlusion_of(code[0]);
    } else if (use == Use::kNormalMap) {
      out.bump = color;
      out.has_bump = true;
    } else if (use == Use::kOcclusion) {
      out.occlusion = occlusion_of(code[0]);
    } else if (use == Use::kEmission) {
      out.emission = out.emission * color;
    } else if (use == Use::kSpecular) {
      out.specular *= code[0];  // the alpha
    } else {
      out.specular_color = out.specular_color * color;
    }
  }
}

/// See shade.h.
template <bool kOrthographic, class Shader>
SCREE_HD void shade_surface(const Shader& shader, const PlacedChunk& at, const uint32_t vertex[3],
                            const PlaneHit<float>& m, const Corners<float>& corners, const float weights[3], float x,
                            float y, typename Shader::Texels::Lane& lane, float rgb[3]) {
  const ShadeInputs& in = shader.in;
  const Lighting lighting = in.light.lighting;
  const uint32_t number = at.mesh.material;
  const format::MaterialRecord* const material = number != format::kNone ? in.scene.materials + number : nullptr;
  const bool unlit = material != nullptr && (material->flags & format::kMaterialUnlit) != 0;
  const format::SurfaceRecord* surface = nullptr;
  if (material != nullptr && !unlit && in.scene.surface_of != nullptr && in.scene.surface_of[number] != format::kNone)
    surface = in.scene.surfaces + in.scene.surface_of[number];

  // The only value of the corners that is needed from here on, so that a GPU keeps few registers.
  float depth = at.transform.w[3];
  for (int i = 0; i < 3; ++i)
    depth = multiply_add(at.transform.w[i],
                         corners.first[i] + weights[1] * corners.edge[0][i] + weights[2] * corners.edge[1][i], depth);
  SurfaceValues values;
  if (surface != nullptr) {
    values.metallic = surface->metallic;
    values.roughness = surface->roughness;
    values.emission = {surface->emission[0], surface->emission[1], surface->emission[2]};
    values.specular = surface->specular;
    values.specular_color = {surface->specular_color[0], surface->specular_color[1], surface->specular_color[2]};
  }
  if (material != nullptr) {
    if ((at.mesh.attributes & format::kHasUv) != 0)
      read_textures(shader, at, vertex, *material, surface, m, weights, x, y, lane, values);
    values.base = values.base * Float3{material->base_color[0], material->base_color[1], material->base_color[2]};
  }
  rgb[0] = values.base.x;
  rgb[1] = values.base.y;
  rgb[2] = values.base.z;
  if ((at.mesh.attributes & format::kHasColor) != 0) Shader::vertex_color(at, vertex, weights, rgb);
  if (unlit) return;

  // The triangle's plane, and the ray that hits it.
  const float focal = kOrthographic ? -in.focal : in.focal;  // the depth row of an orthographic camera decreases
  Float3 edge[2];
  for (int n = 0; n < 2; ++n) {
    edge[n] = kOrthographic ? Float3{m.edge_x[n], m.edge_y[n] * in.aspect, m.edge_w[n] * focal}
                            : Float3{multiply_add(x, m.edge_w[n], m.edge_x[n]),
                                     multiply_add(y, m.edge_w[n], m.edge_y[n]) * in.aspect, m.edge_w[n] * focal};
  }
  const Float3 ray = kOrthographic ? Float3{0, 0, 1} : Float3{x, y * in.aspect, focal};
  SurfacePoint point;
  point.to_viewer = unit_or(ray * -1.0f, {0, 0, -1});
  const float hand = at.transform.mirrored ? -1.0f : 1.0f;
  const Float3 face = unit_or(cross(unit_or(edge[0], grey(0)), unit_or(edge[1], grey(0))) * hand, point.to_viewer);
  Float3 normal = face;
  if (has_vertex_normals(at)) {
    float object[3];
    float turned[3];
    vertex_normal(at, vertex, weights, object);
    view_normal(in, at, object, focal, turned);
    normal = unit_or(Float3{turned[0], turned[1], turned[2]} * hand, face);
  }
  if (values.has_bump) normal = mapped_normal(in, at, vertex, weights, *surface, values.bump, edge, focal, normal);
  if (dot(face, point.to_viewer) < 0) normal = normal * -1.0f;
  point.normal = normal;
  point.occlusion = values.occlusion;
  const Float3 base{rgb[0], rgb[1], rgb[2]};
  Float3 light;
  if (lighting == Lighting::kCamera) {
    const float cosine = unit_range(dot(point.normal, point.to_viewer));
    light = base * (kAmbient * point.occlusion + (1.0f - kAmbient) * cosine) + values.emission;
  } else {
    set_reflectance(values, base, surface != nullptr ? surface->ior : 1.5f, point);
    if (lighting == Lighting::kEnvironment) {
      light = environment_light(in, point);
    } else {
      const Float3 place = kOrthographic ? Float3{x, y * in.aspect, in.light.far_plane + depth * focal} : ray * depth;
      light = punctual_light(in, point, place, in.sun.samples != nullptr ? sun_share(in.sun, place, face) : 1.0f);
    }
    light = (light + values.emission) * in.options.exposure;
  }
  rgb[0] = light.x;
  rgb[1] = light.y;
  rgb[2] = light.z;
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
