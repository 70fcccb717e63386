// Shades a sample of a material that has more than a base colour, or that another light than the camera's shows. All
// vectors are in view space, as in surface_light.h.
#pragma once

#include "kernels/shade/shade.h"
#include "kernels/shade/surface_light.h"
#include "kernels/shade/surface_textures.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

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
