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

/// As LinearCodes; with a null table the values are the codes.
struct SurfaceCodes {
  const float* linear;
  SCREE_HD void read(const uint32_t texels[4], float values[3][4]) const {
    if (linear != nullptr) return LinearCodes{linear}.read(texels, values);
    for (uint32_t c = 0; c < 3; ++c)
      for (uint32_t i = 0; i < 4; ++i) values[c][i] = static_cast<float>(texels[i] >> 8 * c & 255u);
  }
};

/// Whether a texture of a surface uses the mesh's second texture coordinates.
SCREE_HD inline bool uses_second(const format::SurfaceRecord& surface, uint32_t use) {
  return (surface.second_uv >> use & 1u) != 0;
}

/// The axes of a normal map at a sample, in view space.
struct NormalAxes {
  Float3 normal;   // unit; of the front
  Float3 tangent;  // unit, or 0: the normal map has no direction there
  float side;      // 1 or -1; the bitangent is this times cross(normal, tangent)
};

/// Sets the tangent to the mesh's own, around the normal. `focal`: as for view_normal().
SCREE_HD inline void set_stored_tangent(const ShadeInputs& in, const PlacedChunk& at, const uint32_t vertex[3],
                                        const float weights[3], float focal, NormalAxes& axes) {
  float object[3];
  axes.side = vertex_tangent(at, vertex, weights, object) * (at.transform.mirrored ? -1.0f : 1.0f);
  Float3 along = grey(0);
  for (int j = 0; j < 3; ++j)
    along = along + Float3{at.transform.x[j], at.transform.y[j] * in.aspect, at.transform.w[j] * focal} * object[j];
  along = unit_or(along, grey(0));
  axes.tangent = unit_or(along - axes.normal * dot(axes.normal, along), grey(0));
}

/// Sets the tangent to that of the triangle's transformed texture coordinates. It is constant on a triangle, while
/// MikkTSpace's is averaged at its corners. `d`: TextureCorners::edge; `edge`: of the triangle, in view space.
SCREE_HD inline void set_flat_tangent(const float d[2][2], const Float3 edge[2], NormalAxes& axes) {
  const float side = d[0][0] * d[1][1] - d[1][0] * d[0][1] >= 0 ? 1.0f : -1.0f;
  const Float3 along_u = unit_or((edge[0] * d[1][1] - edge[1] * d[0][1]) * side, grey(0));
  const Float3 along_v = (edge[1] * d[0][0] - edge[0] * d[1][0]) * side;
  axes.tangent = unit_or(along_u - axes.normal * dot(axes.normal, along_u), grey(0));
  axes.side = dot(cross(axes.normal, axes.tangent), along_v) > 0 ? -1.0f : 1.0f;  // green is up, v goes down
}

/// Turns the normal by a normal map's `code`.
SCREE_HD inline void bend_normal(const Float3& code, float scale, NormalAxes& axes) {
  if (dot(axes.tangent, axes.tangent) == 0) return;  // the triangle has no area in the texture
  const float bump_x = (2.0f * code.x - 1.0f) * scale;
  const float bump_y = (2.0f * code.y - 1.0f) * scale;
  const float bump_z = 2.0f * code.z - 1.0f;
  const Float3 bitangent = cross(axes.normal, axes.tangent) * axes.side;
  axes.normal = unit_or(axes.tangent * bump_x + bitangent * bump_y + axes.normal * bump_z, axes.normal);
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

/// One bit per use of a texture, as in MaterialView.
SCREE_HD constexpr uint32_t use_bit(format::SurfaceUse use) {
  return 1u << static_cast<uint32_t>(use);
}
inline constexpr uint32_t kBaseUse = MaterialView::kBaseUse;
inline constexpr uint32_t kCameraUses = use_bit(format::SurfaceUse::kNormalMap) |
                                        use_bit(format::SurfaceUse::kOcclusion) |
                                        use_bit(format::SurfaceUse::kEmission);  // visible in the camera's light
inline constexpr uint32_t kColorUses = [] {
  uint32_t bits = 1u << kBaseUse;
  for (uint32_t i = 0; i < format::kSurfaceUses; ++i)
    if (format::is_color(static_cast<format::SurfaceUse>(i))) bits |= 1u << i;
  return bits;
}();

/// The texels of a sample's textures, three channels by use: linear colours, and the 8-bit codes of numbers. Kept in
/// memory, and filled in only for the textures that the sample has.
inline constexpr uint32_t kTint = MaterialView::kMostBundles;  // the vertex colours
struct alignas(16) TextureCodes {
  float of[kTint + 1][4];
};

/// The textures that a sample reads.
struct MaterialTextures {
  // Numbers, because a GPU keeps pointers in two registers.
  uint32_t material = format::kNone;
  uint32_t surface = format::kNone;  // kNone: there is only a base colour
  uint32_t uses = 0;                 // bits of the textures
  uint32_t first = 0;                // the first bundle that is read

  SCREE_HD const MaterialView& view_in(const SceneView& scene) const { return scene.material_views[material]; }
  SCREE_HD uint32_t number_of(const SceneView& scene, uint32_t use) const {
    return use == kBaseUse ? scene.materials[material].texture : scene.surfaces[surface].textures[use].texture;
  }
  SCREE_HD const float* transform_of(const SceneView& scene, uint32_t use) const {
    return use == kBaseUse ? uv_transform(scene.materials[material])
                           : uv_transform(scene.surfaces[surface].textures[use]);
  }
  SCREE_HD bool is_second_of(const SceneView& scene, uint32_t use) const {
    return use != kBaseUse && uses_second(scene.surfaces[surface], use);
  }
  SCREE_HD bool has(uint32_t use) const { return (uses >> use & 1u) != 0; }
  SCREE_HD bool has(format::SurfaceUse use) const { return has(static_cast<uint32_t>(use)); }
};

SCREE_HD inline MaterialTextures textures_of(const ShadeInputs& in, const format::MeshRecord& mesh) {
  using Use = format::SurfaceUse;
  if (mesh.material == format::kNone) return {};
  const format::MaterialRecord& material = in.scene.materials[mesh.material];
  const MaterialView& view = in.scene.material_views[mesh.material];
  MaterialTextures out{mesh.material};
  constexpr uint32_t kBaseBit = 1u << kBaseUse;
  uint32_t uses = kBaseBit;
  if ((material.flags & format::kMaterialUnlit) == 0 && view.surface != format::kNone) {
    const format::SurfaceRecord& surface = in.scene.surfaces[view.surface];
    out.surface = view.surface;
    uses |= in.light.lighting == Lighting::kCamera ? kCameraUses : kBaseBit - 1u;
    const float* const emission = surface.emission;
    if (!(max_of(emission[0], max_of(emission[1], emission[2])) > 0)) uses &= ~use_bit(Use::kEmission);
    if ((mesh.attributes & format::kHasSecondUv) == 0) uses &= ~surface.second_uv | kBaseBit;
  }
  uses &= (mesh.attributes & format::kHasUv) != 0 ? view.uses : 0u;
  // A packed occlusion is read with metalness and roughness.
  const bool is_packed = view.is_packed && (uses & use_bit(Use::kMetallicRoughness)) != 0;
  out.uses = is_packed ? uses & ~use_bit(Use::kOcclusion) : uses;
  while (out.uses != 0 && (view.bundles[out.first] & out.uses) == 0) ++out.first;
  return out;
}

/// Reads a material's textures. `place`: of the first bundle. The textures of a bundle share the places of their
/// texels. They are read in a loop, so that the kernel contains one sampler; with seven, nvcc took minutes to compile
/// it. The loop over the textures is the inner one, so that a GPU keeps the places on one level in registers.
template <class Shader>
SCREE_HD inline void read_textures(const Shader& shader, const PlacedChunk& at, const MaterialTextures& textures,
                                   TexturePlace place, float x, float y, typename Shader::Texels::Lane& lane,
                                   TextureCodes& out) {
  const ShadeInputs& in = shader.in;
  bool is_placed = true;
  uint32_t rest = textures.uses;
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
  for (uint32_t b = textures.first; rest != 0; ++b) {
    const uint32_t bundle = textures.view_in(in.scene).bundles[b];
    if (b != textures.first && (bundle & MaterialView::kSamePoint) == 0) is_placed = false;
    const uint32_t uses = bundle & rest;
    rest &= ~bundle;
    if (uses == 0) continue;
    const uint32_t first = lowest_bit(uses);
    const TextureView& layout = in.scene.textures[textures.number_of(in.scene, first)];
    if (!is_placed) [[unlikely]]
      place =
          shader.find_place_again(at, textures.transform_of(in.scene, first), textures.is_second_of(in.scene, first),
                                  static_cast<float>(layout.width), static_cast<float>(layout.height), x, y);
    is_placed = true;
    const SampledLevels levels = sampled_levels(layout, place.footprint);
    const uint32_t u = wrap_point(place.u, layout.wrap_s);
    const uint32_t v = wrap_point(place.v, layout.wrap_t);
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
    for (uint32_t i = 0; i < levels.count(); ++i) {
      LevelPoint point;
      place_level(shader.texels, lane, layout, levels.fine + i, u, v, levels.nearest, point);
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
      for (uint32_t left = uses; left != 0; left &= left - 1) {
        const uint32_t use = lowest_bit(left);
        const TextureView& texture = in.scene.textures[textures.number_of(in.scene, use)];
        const bool is_color = (kColorUses >> use & 1u) != 0;
        const uint32_t first_bit = use == static_cast<uint32_t>(format::SurfaceUse::kSpecular) ? 24 : 0;
        float some[3];
        sample_level(shader.texels, lane, texture, SurfaceCodes{is_color ? in.srgb->linear : nullptr}, first_bit, point,
                     some);
        mix_level(i, some, levels.between, out.of[use]);
      }
    }
  }
}

SCREE_HD inline Float3 color_of(const TextureCodes& codes, uint32_t use) {
  const float* const code = codes.of[use];
  return {code[0], code[1], code[2]};
}
SCREE_HD inline Float3 color_of(const TextureCodes& codes, format::SurfaceUse use) {
  return color_of(codes, static_cast<uint32_t>(use));
}
/// The texel of a texture of numbers, from 0 to 1.
SCREE_HD inline Float3 numbers_of(const TextureCodes& codes, format::SurfaceUse use) {
  return color_of(codes, use) * (1.0f / 255.0f);
}
SCREE_HD inline float occluded(const format::SurfaceRecord& surface, float code) {
  return 1.0f + surface.occlusion_strength * (code - 1.0f);
}

/// The values of a material at a sample: its factors times its textures.
SCREE_HD inline SurfaceValues surface_values(const ShadeInputs& in, const MaterialTextures& textures,
                                             const TextureCodes& codes) {
  using Use = format::SurfaceUse;
  SurfaceValues out;
  if (textures.has(kBaseUse)) out.base = color_of(codes, kBaseUse);
  if (textures.material != format::kNone) {
    const float* const color = in.scene.materials[textures.material].base_color;
    out.base = out.base * Float3{color[0], color[1], color[2]};
  }
  if (textures.surface == format::kNone) return out;
  const format::SurfaceRecord& surface = in.scene.surfaces[textures.surface];
  out.metallic = surface.metallic;
  out.roughness = surface.roughness;
  out.emission = {surface.emission[0], surface.emission[1], surface.emission[2]};
  out.specular = surface.specular;
  out.specular_color = {surface.specular_color[0], surface.specular_color[1], surface.specular_color[2]};
  if (textures.has(Use::kMetallicRoughness)) {
    const Float3 code = numbers_of(codes, Use::kMetallicRoughness);
    out.roughness *= code.y;
    out.metallic *= code.z;
    // An occlusion in the red of the same picture is read with it.
    if (textures.view_in(in.scene).is_packed) out.occlusion = occluded(surface, code.x);
  }
  if (textures.has(Use::kOcclusion)) out.occlusion = occluded(surface, numbers_of(codes, Use::kOcclusion).x);
  if (textures.has(Use::kEmission)) out.emission = out.emission * color_of(codes, Use::kEmission);
  if (textures.has(Use::kSpecular)) out.specular *= numbers_of(codes, Use::kSpecular).x;  // the alpha
  if (textures.has(Use::kSpecularColor)) out.specular_color = out.specular_color * color_of(codes, Use::kSpecularColor);
  return out;
}

/// Whether a use of a texture has the point of the first bundle.
SCREE_HD inline bool has_first_point(const ShadeInputs& in, const MaterialTextures& textures, uint32_t use) {
  const uint8_t* const bundles = textures.view_in(in.scene).bundles;
  uint32_t b = textures.first;
  while ((bundles[b] >> use & 1u) == 0 && (bundles[b + 1] & MaterialView::kSamePoint) != 0) ++b;
  return (bundles[b] >> use & 1u) != 0;
}

/// Everything of a sample that depends on its triangle. It is computed before textures are read, so that a GPU need not
/// keep the triangle in registers meanwhile.
struct SampleFrame {
  NormalAxes axes;
  float depth;   // the w of the sample, for the file's lights
  float sun;     // as for punctual_light()
  bool is_back;  // the viewer looks at the triangle's back
};

/// The sample's ray in view space, not normalised.
template <bool kOrthographic>
SCREE_HD inline Float3 sample_ray(const ShadeInputs& in, float x, float y) {
  return kOrthographic ? Float3{0, 0, 1} : Float3{x, y * in.aspect, in.focal};
}
SCREE_HD inline Float3 towards_viewer(const Float3& ray) {
  return unit_or(ray * -1.0f, {0, 0, -1});
}
/// The depth row of an orthographic camera decreases.
template <bool kOrthographic>
SCREE_HD inline float signed_focal(const ShadeInputs& in) {
  return kOrthographic ? -in.focal : in.focal;
}
/// The place of a sample relative to the eye, as for punctual_light().
template <bool kOrthographic>
SCREE_HD inline Float3 sample_place(const ShadeInputs& in, float x, float y, float depth) {
  return kOrthographic ? Float3{x, y * in.aspect, in.light.far_plane + depth * signed_focal<kOrthographic>(in)}
                       : sample_ray<kOrthographic>(in, x, y) * depth;
}

/// `uv`: of the first bundle of textures.
template <bool kOrthographic>
SCREE_HD inline SampleFrame sample_frame(const ShadeInputs& in, const PlacedChunk& at, const uint32_t vertex[3],
                                         const PlaneHit<float>& m, const Corners<float>& corners,
                                         const float weights[3], float x, float y, const MaterialTextures& textures,
                                         const TextureCorners<float>& uv) {
  // The triangle's plane, and the ray that hits it.
  const float focal = signed_focal<kOrthographic>(in);
  Float3 edge[2];
  for (int n = 0; n < 2; ++n) {
    edge[n] = kOrthographic ? Float3{m.edge_x[n], m.edge_y[n] * in.aspect, m.edge_w[n] * focal}
                            : Float3{multiply_add(x, m.edge_w[n], m.edge_x[n]),
                                     multiply_add(y, m.edge_w[n], m.edge_y[n]) * in.aspect, m.edge_w[n] * focal};
  }
  SampleFrame out;
  const Float3 to_viewer = towards_viewer(sample_ray<kOrthographic>(in, x, y));
  const float hand = at.transform.mirrored ? -1.0f : 1.0f;
  const Float3 face = unit_or(cross(unit_or(edge[0], grey(0)), unit_or(edge[1], grey(0))) * hand, to_viewer);
  out.is_back = dot(face, to_viewer) < 0;
  out.axes = {face, grey(0), 1.0f};
  if (has_vertex_normals(at)) {
    float object[3];
    float turned[3];
    vertex_normal(at, vertex, weights, object);
    view_normal(in, at, object, focal, turned);
    out.axes.normal = unit_or(Float3{turned[0], turned[1], turned[2]} * hand, face);
  }
  constexpr uint32_t kUse = static_cast<uint32_t>(format::SurfaceUse::kNormalMap);
  if (textures.has(kUse)) {
    if (has_tangents(at)) {
      set_stored_tangent(in, at, vertex, weights, focal, out.axes);
    } else {
      const auto own = has_first_point(in, textures, kUse)
                           ? uv
                           : texture_corners<float>(at, vertex, textures.transform_of(in.scene, kUse),
                                                    textures.is_second_of(in.scene, kUse));
      set_flat_tangent(own.edge, edge, out.axes);
    }
  }
  out.depth = 0;
  out.sun = 1.0f;
  if (in.light.lighting == Lighting::kScene) {
    out.depth = at.transform.w[3];
    for (int i = 0; i < 3; ++i)
      out.depth =
          multiply_add(at.transform.w[i],
                       corners.first[i] + weights[1] * corners.edge[0][i] + weights[2] * corners.edge[1][i], out.depth);
    if (in.sun.count != 0) out.sun = sun_share(in, sample_place<kOrthographic>(in, x, y, out.depth), face);
  }
  return out;
}

/// See shade.h.
template <bool kOrthographic, class Shader>
SCREE_HD void shade_surface(const Shader& shader, const PlacedChunk& at, const uint32_t vertex[3],
                            const PlaneHit<float>& m, const Corners<float>& corners, const float weights[3], float x,
                            float y, typename Shader::Texels::Lane& lane, float rgb[3]) {
  const ShadeInputs& in = shader.in;
  const Lighting lighting = in.light.lighting;
  TextureCodes codes;
  const bool has_color = (at.mesh.attributes & format::kHasColor) != 0;
  float* const tint = codes.of[kTint];
  if (has_color) {
    tint[0] = tint[1] = tint[2] = 1.0f;
    Shader::vertex_color(at, vertex, weights, tint);
  }
  const MaterialTextures textures = textures_of(in, at.mesh);
  TextureCorners<float> uv{};
  TexturePlace place{};
  if (textures.uses != 0) {
    const uint32_t use = lowest_bit(textures.view_in(in.scene).bundles[textures.first] & textures.uses);
    const TextureView& texture = in.scene.textures[textures.number_of(in.scene, use)];
    const float* const transform = textures.transform_of(in.scene, use);
    const bool is_second = textures.is_second_of(in.scene, use);
    uv = texture_corners<float>(at, vertex, transform, is_second);
    place = shader.find_place(at, uv, transform, is_second, static_cast<float>(texture.width),
                              static_cast<float>(texture.height), m, weights, x, y);
  }
  SampleFrame frame = sample_frame<kOrthographic>(in, at, vertex, m, corners, weights, x, y, textures, uv);
  read_textures(shader, at, textures, place, x, y, lane, codes);
  const SurfaceValues values = surface_values(in, textures, codes);
  using Use = format::SurfaceUse;
  if (textures.has(Use::kNormalMap))
    bend_normal(numbers_of(codes, Use::kNormalMap), in.scene.surfaces[textures.surface].normal_scale, frame.axes);
  const Float3 base = has_color ? values.base * Float3{tint[0], tint[1], tint[2]} : values.base;
  Float3 light = base;
  if (textures.material == format::kNone ||
      (in.scene.materials[textures.material].flags & format::kMaterialUnlit) == 0) {
    SurfacePoint point;
    point.to_viewer = towards_viewer(sample_ray<kOrthographic>(in, x, y));
    point.normal = frame.is_back ? frame.axes.normal * -1.0f : frame.axes.normal;
    point.occlusion = values.occlusion;
    if (lighting == Lighting::kCamera) {
      const float cosine = unit_range(dot(point.normal, point.to_viewer));
      light = base * (kAmbient * point.occlusion + (1.0f - kAmbient) * cosine) + values.emission;
    } else {
      const bool has_surface = textures.surface != format::kNone;
      set_reflectance(values, base, has_surface ? in.scene.surfaces[textures.surface].ior : 1.5f, point);
      light = lighting == Lighting::kEnvironment
                  ? environment_light(in, point)
                  : punctual_light(in, point, sample_place<kOrthographic>(in, x, y, frame.depth), frame.sun);
      light = (light + values.emission) * in.options.exposure;
    }
  }
  rgb[0] = light.x;
  rgb[1] = light.y;
  rgb[2] = light.z;
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
