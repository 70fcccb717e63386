// The last pass: the colour of every sample. Source: spec/rasterization.md, resolve.
#pragma once

#include <cmath>

#include "format/attribute_codec.h"
#include "kernels/queues.h"
#include "kernels/resolve.h"
#include "kernels/texture.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

inline constexpr float kAmbient = 0.2f;  // what a surface seen edge-on still gets of the camera's light

SCREE_HD inline float srgb_to_linear(float value) {
  return value <= 0.04045f ? value / 12.92f : std::pow((value + 0.055f) / 1.055f, 2.4f);
}

SCREE_HD inline uint64_t mix_bits(uint64_t value) {
  value += 0x9e3779b97f4a7c15u;
  value = (value ^ (value >> 30)) * 0xbf58476d1ce4e5b9u;
  value = (value ^ (value >> 27)) * 0x94d049bb133111ebu;
  return value ^ (value >> 31);
}

SCREE_HD inline double dot3(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

SCREE_HD inline void cross3(const double a[3], const double b[3], double out[3]) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

/// Unit length, or all zero where there is no direction.
SCREE_HD inline void normalize3(double v[3]) {
  const double largest = max_of(abs_of(v[0]), max_of(abs_of(v[1]), abs_of(v[2])));
  if (!(largest > 0) || !(largest < 1e300)) {
    v[0] = v[1] = v[2] = 0;
    return;
  }
  for (int i = 0; i < 3; ++i) v[i] = v[i] / largest;  // squares of tiny lengths would vanish
  const double length = std::sqrt(dot3(v, v));
  for (int i = 0; i < 3; ++i) v[i] = v[i] / length;
}

/// The texture coordinates of a vertex as the source has them.
SCREE_HD inline void vertex_uv(const ResolvedChunk& chunk, uint32_t vertex, double uv[2]) {
  const format::ChunkRecord& record = *chunk.chunk;
  const std::byte* stream = chunk.payload + chunk.streams.uvs.offset;
  uint64_t bit = uint64_t{vertex} * (uint32_t{record.uv_bits[0]} + record.uv_bits[1]);
  const double step = format::exp2i(record.uv_exponent);
  for (int i = 0; i < 2; ++i) {
    const uint32_t code = record.uv_bits[i] == 0 ? 0u : unpack_bits(stream, bit, record.uv_bits[i]);
    bit += record.uv_bits[i];
    uv[i] = static_cast<double>(wrapping_add(record.uv_min[i], static_cast<int64_t>(code))) * step;
  }
}

/// The normal of a face in world space, outwards for glTF's counter-clockwise fronts, also under mirroring matrices; or
/// the mesh's own normals between the corners.
SCREE_HD inline void world_normal(const ResolvedChunk& chunk, const ResolvedTriangle& triangle, const double weights[3],
                                  double normal[3]) {
  const format::ChunkRecord& record = *chunk.chunk;
  const double(*m)[4] = chunk.matrix->rows;
  if ((chunk.mesh->attributes & format::kHasNormal) != 0 && record.normal_bits >= 2) {
    const std::byte* stream = chunk.payload + chunk.streams.normals.offset;
    double object[3] = {0, 0, 0};
    for (int i = 0; i < 3; ++i) {
      const uint64_t bit = uint64_t{triangle.vertex[i]} * (2u * record.normal_bits);
      float unit[3];
      format::decode_octahedral(unpack_bits(stream, bit, record.normal_bits),
                                unpack_bits(stream, bit + record.normal_bits, record.normal_bits), record.normal_bits,
                                unit);
      for (int j = 0; j < 3; ++j) object[j] += weights[i] * static_cast<double>(unit[j]);
    }
    // The inverse transpose is the cofactor matrix over the determinant, whose sign is all that matters here.
    const double sign = chunk.transform.mirrored ? -1.0 : 1.0;
    for (int i = 0; i < 3; ++i) {
      const int a = (i + 1) % 3;
      const int b = (i + 2) % 3;
      double cofactors[3];
      const double row_a[3] = {m[a][0], m[a][1], m[a][2]};
      const double row_b[3] = {m[b][0], m[b][1], m[b][2]};
      cross3(row_a, row_b, cofactors);
      normal[i] = sign * dot3(cofactors, object);
    }
    normalize3(normal);
    if (dot3(normal, normal) > 0) return;
  }
  double edge[2][3];
  for (int i = 0; i < 2; ++i) {
    double object[3];
    for (int j = 0; j < 3; ++j) object[j] = triangle.d[i + 1][j] - triangle.d[0][j];
    for (int j = 0; j < 3; ++j) edge[i][j] = m[j][0] * object[0] + m[j][1] * object[1] + m[j][2] * object[2];
    normalize3(edge[i]);
  }
  cross3(edge[0], edge[1], normal);
  if (chunk.transform.mirrored) {
    for (int i = 0; i < 3; ++i) normal[i] = -normal[i];
  }
  normalize3(normal);
}

/// One row of samples an item, from `first_row` on.
template <bool kOrthographic>
struct Shade {
  SceneView scene;
  FrameView view;
  View camera;
  ShadeOptions options;
  const uint64_t* samples;
  const float* srgb_table;  // linear light of the 256 sRGB codes
  uint32_t nearest_code;    // Show::kDepth: the range of the picture
  uint32_t farthest_code;
  uint32_t first_row;
  float* rgba;  // of row first_row

  template <class Team>
  SCREE_HD void operator()(uint32_t item, Team team) const {
    const uint64_t width = static_cast<uint64_t>(view.width);
    const uint32_t y = first_row + item;
    ResolvedChunk chunk;
    for (uint32_t x = team.rank(); x < static_cast<uint32_t>(view.width); x += team.size()) {
      const uint64_t sample = samples[y * width + x];
      float* out = rgba + 4 * (item * width + x);
      if (sample == kBackground) {
        for (int c = 0; c < 4; ++c) out[c] = options.background[c];
        continue;
      }
      shade(sample, static_cast<int32_t>(x), static_cast<int32_t>(y), chunk, out);
      out[3] = 1.0f;
    }
  }

  SCREE_HD void shade(uint64_t sample, int32_t x, int32_t y, ResolvedChunk& chunk, float rgb[3]) const {
    const uint64_t id = sample_id(sample);
    // The pictures that are not of light are seen as 8-bit sRGB; they are given so that the code is the value.
    switch (options.show) {
      case Show::kTriangle:
        return random_color(id, rgb);
      case Show::kDepth: {
        const float grey = srgb_to_linear(depth_grey(sample_depth_code(sample)));
        rgb[0] = rgb[1] = rgb[2] = grey;
        return;
      }
      default:
        break;
    }
    resolve_chunk(scene, view, id, chunk);
    if (options.show == Show::kMesh) return random_color(scene.instances[chunk.instance].mesh, rgb);
    const ResolvedTriangle triangle =
        resolve_triangle(chunk, static_cast<uint32_t>(id - chunk.first_id), kOrthographic);
    if (options.show == Show::kStage) {
      const int stage = stage_of<kOrthographic>(chunk, triangle, view, x, y);
      for (int c = 0; c < 3; ++c) rgb[c] = stage == c + 1 ? 1.0f : 0.05f;
      return;
    }
    const double center_x = static_cast<double>(x * kSubpixels + kSubpixels / 2) - static_cast<double>(view.half_width);
    const double center_y =
        static_cast<double>(y * kSubpixels + kSubpixels / 2) - static_cast<double>(view.half_height);
    double weights[3];
    bool turned;
    if (!meet_plane(triangle, center_x, center_y, weights, turned)) weights[0] = weights[1] = weights[2] = 1.0 / 3.0;
    clamp_weights(weights);
    if (options.show == Show::kNormal) {
      double normal[3];
      world_normal(chunk, triangle, weights, normal);
      for (int c = 0; c < 3; ++c) rgb[c] = srgb_to_linear(static_cast<float>(0.5 + 0.5 * normal[c]));
      return;
    }
    const bool has_uv = (chunk.mesh->attributes & format::kHasUv) != 0;
    double corner_uv[3][2] = {};
    if (has_uv) {
      for (int i = 0; i < 3; ++i) vertex_uv(chunk, triangle.vertex[i], corner_uv[i]);
    }
    if (options.show == Show::kUv) {
      for (int c = 0; c < 2; ++c) {
        const double uv = weights[0] * corner_uv[0][c] + weights[1] * corner_uv[1][c] + weights[2] * corner_uv[2][c];
        rgb[c] = srgb_to_linear(static_cast<float>(uv - std::floor(uv)));
      }
      rgb[2] = 0.0f;
      return;
    }
    rgb[0] = rgb[1] = rgb[2] = 1.0f;
    bool lit = options.light;
    if (chunk.mesh->material != format::kNone) {
      const format::MaterialRecord& material = scene.materials[chunk.mesh->material];
      if ((material.flags & format::kMaterialUnlit) != 0) lit = false;
      if (options.show == Show::kTexture && has_uv && material.texture != format::kNone) {
        texture_color(scene.textures[material.texture], material, triangle, corner_uv, weights, center_x, center_y,
                      turned, rgb);
      }
      for (int c = 0; c < 3; ++c) rgb[c] = rgb[c] * material.base_color[c];
    }
    if ((chunk.mesh->attributes & format::kHasColor) != 0) {
      const uint8_t* colors = reinterpret_cast<const uint8_t*>(chunk.payload + chunk.streams.colors.offset);
      for (uint32_t c = 0; c < 3; ++c) {
        double color = 0;
        for (int i = 0; i < 3; ++i)
          color += weights[i] * static_cast<double>(colors[4 * uint64_t{triangle.vertex[i]} + c]);
        rgb[c] = rgb[c] * static_cast<float>(color * (1.0 / 255.0));
      }
    }
    if (lit) {
      double normal[3];
      world_normal(chunk, triangle, weights, normal);
      double ray[3];
      for (int i = 0; i < 3; ++i) {
        ray[i] = camera.forward[i];
        if (!kOrthographic) {
          ray[i] += camera.right[i] * (center_x / static_cast<double>(view.half_width) * camera.half_width) -
                    camera.up[i] * (center_y / static_cast<double>(view.half_height) * camera.half_height);
        }
      }
      normalize3(ray);
      const float diffuse = kAmbient + (1.0f - kAmbient) * static_cast<float>(abs_of(dot3(normal, ray)));
      for (int c = 0; c < 3; ++c) rgb[c] = rgb[c] * diffuse;
    }
  }

 private:
  SCREE_HD static void random_color(uint64_t number, float rgb[3]) {
    const uint64_t bits = mix_bits(number);
    for (int c = 0; c < 3; ++c) {
      rgb[c] = srgb_to_linear(0.2f + 0.8f * static_cast<float>((bits >> (8 * c)) & 255u) * (1.0f / 255.0f));
    }
  }

  /// White for the nearest sample of the picture to nearly black for the farthest; perspective codes are logarithmic.
  SCREE_HD float depth_grey(uint32_t code) const {
    const float range = static_cast<float>(farthest_code - nearest_code);
    const float place = range > 0 ? static_cast<float>(code - nearest_code) / range : 0.0f;
    return 1.0f - 0.95f * min_of(max_of(place, 0.0f), 1.0f);
  }

  SCREE_HD void texture_color(const TextureView& texture, const format::MaterialRecord& material,
                              const ResolvedTriangle& triangle, double corner_uv[3][2], const double weights[3],
                              double center_x, double center_y, bool turned, float rgb[3]) const {
    // KHR_texture_transform: scale, then rotation, then offset. It is affine, so corners can take it.
    const double cosine = std::cos(static_cast<double>(material.uv_rotation));
    const double sine = std::sin(static_cast<double>(material.uv_rotation));
    for (int i = 0; i < 3; ++i) {
      const double u = corner_uv[i][0] * static_cast<double>(material.uv_scale[0]);
      const double v = corner_uv[i][1] * static_cast<double>(material.uv_scale[1]);
      corner_uv[i][0] = cosine * u + sine * v + static_cast<double>(material.uv_offset[0]);
      corner_uv[i][1] = cosine * v - sine * u + static_cast<double>(material.uv_offset[1]);
    }
    double uv[2];
    interpolate(corner_uv, weights, uv);
    // The plane under the rays of the pixels to the right and below says how many texels a pixel spans.
    float footprint = 0;
    for (int side = 0; side < 2; ++side) {
      double moved[3];
      bool moved_turned;
      const bool met = meet_plane(triangle, center_x + (side == 0 ? kSubpixels : 0),
                                  center_y + (side == 1 ? kSubpixels : 0), moved, moved_turned);
      if (!met || moved_turned != turned) {
        footprint = 1e30f;
        continue;
      }
      double there[2];
      interpolate(corner_uv, moved, there);
      const double du = (there[0] - uv[0]) * texture.width;
      const double dv = (there[1] - uv[1]) * texture.height;
      footprint = max_of(footprint, static_cast<float>(min_of(std::sqrt(du * du + dv * dv), 1e30)));
    }
    sample_texture(texture, srgb_table, uv[0], uv[1], footprint, rgb);
  }

  SCREE_HD static void interpolate(const double corner_uv[3][2], const double weights[3], double uv[2]) {
    for (int c = 0; c < 2; ++c) {
      uv[c] = weights[0] * corner_uv[0][c] + weights[1] * corner_uv[1][c] + weights[2] * corner_uv[2][c];
    }
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
