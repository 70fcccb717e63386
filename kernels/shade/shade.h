// The colour of a sample. Source: spec/rasterization.md, resolve.
#pragma once

#include <cmath>

#include "kernels/shade/normals.h"
#include "kernels/shade/texture_place.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

SCREE_HD inline float srgb_to_linear(float value) {
  return value <= 0.04045f ? value / 12.92f : std::pow((value + 0.055f) / 1.055f, 2.4f);
}

SCREE_HD inline uint64_t mix_bits(uint64_t value) {
  value += 0x9e3779b97f4a7c15u;
  value = (value ^ (value >> 30)) * 0xbf58476d1ce4e5b9u;
  value = (value ^ (value >> 27)) * 0x94d049bb133111ebu;
  return value ^ (value >> 31);
}

/// Returns the transform of a sample's instance: from the frame's array.
template <bool kMakes>
struct TransformSource {
  SCREE_HD const Transform& get(const ShadeInputs& in, uint64_t instance) { return in.transforms[instance]; }
};

/// Without an array, the transform is made whenever the instance changes.
template <>
struct TransformSource<true> {
  Transform own;
  uint64_t own_instance = ~uint64_t{0};

  SCREE_HD const Transform& get(const ShadeInputs& in, uint64_t instance) {
    if (in.transforms != nullptr) return in.transforms[instance];
    if (own_instance != instance) {
      const format::InstanceRecord& record = in.scene.instances[instance];
      const format::MeshRecord& mesh = in.scene.meshes[record.mesh];
      own = make_transform(in.view, in.scene.matrices[record.matrix], mesh.lattice_exponent,
                           mesh.position_encoding == format::PositionEncoding::kFloat32);
      own_instance = instance;
    }
    return own;
  }
};

/// The state that a lane keeps from sample to sample.
template <class Team, class Shader>
struct ShadeState {
  Location at;
  TransformSource<Team::kMakesTransforms> source;
  typename Shader::Texels::Lane texels;
};

/// Show::kSurface: the light of a sample (shade/surface.h).
template <bool kOrthographic, class Shader>
SCREE_HD void shade_surface(const Shader& shader, const PlacedChunk& at, const uint32_t vertex[3],
                            const PlaneHit<float>& m, const Corners<float>& corners, const float weights[3], float x,
                            float y, typename Shader::Texels::Lane& lane, float rgb[3]);

/// The colour of a sample. There is a type for each kind of picture, camera, chunks and textures, so that no kind takes
/// the registers of another.
template <bool kOrthographic, Show kShow, ChunkKinds kKinds = ChunkKinds::kMixed, class TexelSource = SceneTexels>
struct Shader {
  using Texels = TexelSource;

  ShadeInputs in;
  Texels texels;

  /// Computes sample (x, y) of the picture in linear light. All lanes of a team must call it; `wanted`: whether the
  /// lane has a sample that is not background.
  template <class Team>
  SCREE_HD void operator()(Team team, bool wanted, uint64_t sample, int32_t x, int32_t y,
                           ShadeState<Team, Shader>& state, float rgb[3]) const {
    const uint64_t id = sample_id(sample);
    // Debug views hold values, not light: they are converted from sRGB to linear here, so that the picture's 8-bit code
    // is the value.
    if constexpr (kShow == Show::kTriangle) {
      random_color(id, rgb);
    } else if constexpr (kShow == Show::kDepth) {
      rgb[0] = rgb[1] = rgb[2] = srgb_to_linear(depth_grey(sample_depth_code(sample)));
    } else {
      locate(team, in.scene, id, wanted, state.at);
      if (!wanted) return;
      if constexpr (kShow == Show::kMesh) {
        random_color(in.scene.instances[state.at.instance].mesh, rgb);
      } else {
        const uint32_t triangle = static_cast<uint32_t>(id - state.at.first_id);
        const PlacedChunk at =
            place_chunk<kKinds>(in.scene, state.at.chunk, triangle, state.source.get(in, state.at.instance));
        uint32_t vertex[3];
        fetch_triangle(at.reader, triangle, vertex);
        if constexpr (kShow == Show::kCluster) {
          // An indexed chunk counts as one cluster.
          random_color(state.at.chunk << 32 | (at.reader.clustered ? at.reader.cluster.first_triangle : 0u), rgb);
        } else if constexpr (kShow == Show::kStage) {
          const int stage = stage_of<kOrthographic>(at, vertex, in.view, x, y);
          for (int c = 0; c < 3; ++c) rgb[c] = stage == c + 1 ? 1.0f : 0.05f;
        } else {
          const float center_x = static_cast<float>(x * kSubpixels + kSubpixels / 2) - in.view.half_width;
          const float center_y = static_cast<float>(y * kSubpixels + kSubpixels / 2) - in.view.half_height;
          shade(at, state.at.instance, vertex, center_x, center_y, state.texels, rgb);
        }
      }
    }
  }

  /// `corners`: from texture_corners(); `transform` and `is_second` are its.
  SCREE_HD TexturePlace find_place(const PlacedChunk& at, const TextureCorners<float>& corners, const float* transform,
                                   bool is_second, float width, float height, const PlaneHit<float>& m,
                                   const float weights[3], float x, float y) const {
    const TexturePlace place = texture_place<kOrthographic>(in, corners, width, height, m, weights);
    if (place.exact) [[likely]]
      return place;
    return place_alone<double>(in, chunk_number(at), at.triangle, &at.transform, transform, is_second, width, height, x,
                               y);
  }

  /// find_place() for callers that no longer have the corners.
  SCREE_HD TexturePlace find_place_again(const PlacedChunk& at, const float* transform, bool is_second, float width,
                                         float height, float x, float y) const {
    const TexturePlace place =
        place_alone<float>(in, chunk_number(at), at.triangle, &at.transform, transform, is_second, width, height, x, y);
    if (place.exact) [[likely]]
      return place;
    return place_alone<double>(in, chunk_number(at), at.triangle, &at.transform, transform, is_second, width, height, x,
                               y);
  }

  SCREE_HD uint64_t chunk_number(const PlacedChunk& at) const {
    return static_cast<uint64_t>(&at.chunk - in.scene.chunks);
  }

  /// Rarely called, and takes many registers. A call that takes only values, so that on a GPU the caller's values stay
  /// in registers. Only surfaces have second texture coordinates, so other shaders have no code for them.
  template <class Real>
  [[gnu::noinline]] SCREE_HD static TexturePlace place_alone(const ShadeInputs& in, uint64_t chunk, uint32_t triangle,
                                                             const Transform* transform, const float* transform_uv,
                                                             bool is_second, float width, float height, float x,
                                                             float y) {
    const PlacedChunk at = place_chunk<kKinds>(in.scene, chunk, triangle, *transform);
    uint32_t vertex[3];
    fetch_triangle(at.reader, triangle, vertex);
    const PlaneHit<Real> m = intersect_plane<kOrthographic>(at.transform, fetch_corners<Real>(at.reader, vertex),
                                                            static_cast<Real>(x), static_cast<Real>(y));
    Real weights[3];
    hit_weights(m, weights);
    const auto corners = texture_corners<Real>(at, vertex, transform_uv, kShow == Show::kSurface && is_second);
    return texture_place<kOrthographic>(in, corners, width, height, m, weights);
  }

  /// Multiplies `rgb` by the colours of the vertices.
  SCREE_HD static void vertex_color(const PlacedChunk& at, const uint32_t vertex[3], const float weights[3],
                                    float rgb[3]) {
    const std::byte* stream = at.page + at.chunk.offset + streams_of(at.mesh, at.chunk).colors.offset;
    float color[3] = {0, 0, 0};
    for (int i = 0; i < 3; ++i) {
      const uint8_t* texel = reinterpret_cast<const uint8_t*>(stream) + 4 * uint64_t{vertex[i]};
      for (int c = 0; c < 3; ++c) color[c] = multiply_add(weights[i], static_cast<float>(texel[c]), color[c]);
    }
    for (int c = 0; c < 3; ++c) rgb[c] = rgb[c] * (color[c] * (1.0f / 255.0f));
  }

 private:
  SCREE_HD void shade(const PlacedChunk& at, uint64_t instance, const uint32_t vertex[3], float x, float y,
                      [[maybe_unused]] typename Texels::Lane& lane, float rgb[3]) const {
    const Corners<float> corners = fetch_corners<float>(at.reader, vertex);
    const PlaneHit<float> m = intersect_plane<kOrthographic>(at.transform, corners, x, y);
    float weights[3];
    hit_weights(m, weights);
    if constexpr (kShow == Show::kNormal) {
      double normal[3];
      world_normal(at, in.scene.matrices[in.scene.instances[instance].matrix], vertex,
                   fetch_corners<double>(at.reader, vertex), weights, normal);
      for (int c = 0; c < 3; ++c) rgb[c] = srgb_to_linear(static_cast<float>(0.5 + 0.5 * normal[c]));
    } else if constexpr (kShow == Show::kUv) {
      rgb[0] = rgb[1] = rgb[2] = 0;
      if ((at.mesh.attributes & format::kHasUv) == 0) return;
      const auto uv = texture_corners<float>(at, vertex, nullptr, false);
      const TexturePlace place = find_place(at, uv, nullptr, false, 1.0f, 1.0f, m, weights, x, y);
      rgb[0] = srgb_to_linear(static_cast<float>(static_cast<uint32_t>(place.u)) * (1.0f / 4294967296.0f));
      rgb[1] = srgb_to_linear(static_cast<float>(static_cast<uint32_t>(place.v)) * (1.0f / 4294967296.0f));
    } else if constexpr (kShow == Show::kSurface) {
      shade_surface<kOrthographic>(*this, at, vertex, m, corners, weights, x, y, lane, rgb);
    } else if constexpr (kShow == Show::kTexture || kShow == Show::kColor) {
      const format::MaterialRecord* material =
          at.mesh.material != format::kNone ? in.scene.materials + at.mesh.material : nullptr;
      const bool unlit = material != nullptr && (material->flags & format::kMaterialUnlit) != 0;
      const float light = in.options.light && !unlit ? diffuse_light(at, vertex, m, weights, x, y) : 1.0f;
      rgb[0] = rgb[1] = rgb[2] = 1.0f;
      if (material != nullptr) {
        if constexpr (kShow == Show::kTexture) {
          if ((at.mesh.attributes & format::kHasUv) != 0 && material->texture != format::kNone) {
            const TextureView& texture = in.scene.textures[material->texture];
            if (texture.level_count != 0) {
              const float* const transform = uv_transform(*material);
              const TexturePlace place =
                  find_place(at, texture_corners<float>(at, vertex, transform, false), transform, false,
                             static_cast<float>(texture.width), static_cast<float>(texture.height), m, weights, x, y);
              sample_texture(texels, lane, texture, in.srgb->linear, place.u, place.v, place.footprint, rgb);
            }
          }
        }
        for (int c = 0; c < 3; ++c) rgb[c] = rgb[c] * material->base_color[c];
      }
      if ((at.mesh.attributes & format::kHasColor) != 0) vertex_color(at, vertex, weights, rgb);
      for (int c = 0; c < 3; ++c) rgb[c] = rgb[c] * light;
    }
  }

  SCREE_HD float diffuse_light(const PlacedChunk& at, const uint32_t vertex[3], const PlaneHit<float>& m,
                               const float weights[3], float x, float y) const {
    float cosine = -1.0f;
    if (has_vertex_normals(at)) {
      float normal[3];
      vertex_normal(at, vertex, weights, normal);
      cosine = vertex_cosine<kOrthographic>(in, at, normal, x, y);
    }
    if (!(cosine >= 0)) cosine = face_cosine<kOrthographic>(in, m, x, y);
    return kAmbient + (1.0f - kAmbient) * (cosine >= 0 ? min_of(cosine, 1.0f) : 0.0f);
  }

  SCREE_HD static void random_color(uint64_t number, float rgb[3]) {
    const uint64_t bits = mix_bits(number);
    for (int c = 0; c < 3; ++c) {
      rgb[c] = srgb_to_linear(0.2f + 0.8f * static_cast<float>((bits >> (8 * c)) & 255u) * (1.0f / 255.0f));
    }
  }

  /// White for the nearest sample of the picture to nearly black for the farthest; perspective codes are logarithmic.
  SCREE_HD float depth_grey(uint32_t code) const {
    const float range = static_cast<float>(in.depth_range->farthest - in.depth_range->nearest);
    const float place = range > 0 ? static_cast<float>(code - in.depth_range->nearest) / range : 0.0f;
    return 1.0f - 0.95f * min_of(max_of(place, 0.0f), 1.0f);
  }
};

/// Calls visit(shader) with the shader of the picture. `kApart`: with the one built for the scene's kind of chunks;
/// otherwise one shader handles all kinds.
template <bool kApart, bool kOrthographic, Show kShow, class Texels, class Visit>
inline void visit_kinds(const ShadeInputs& in, const Texels& texels, const Visit& visit) {
  if constexpr (kApart) {
    switch (in.scene.chunk_kinds) {
      case ChunkKinds::kMixed:
        break;
      case ChunkKinds::kFloat32:
        return visit(Shader<kOrthographic, kShow, ChunkKinds::kFloat32, Texels>{in, texels});
      case ChunkKinds::kPacked:
        return visit(Shader<kOrthographic, kShow, ChunkKinds::kPacked, Texels>{in, texels});
      case ChunkKinds::kClustered:
        return visit(Shader<kOrthographic, kShow, ChunkKinds::kClustered, Texels>{in, texels});
    }
  }
  visit(Shader<kOrthographic, kShow, ChunkKinds::kMixed, Texels>{in, texels});
}

/// Calls visit(shader) with the shader of the camera and the kind of picture. `kApart`: as for visit_kinds(). A scene
/// without textures uses a shader without texture code.
template <bool kApart, class Visit>
inline void visit_shader(const ShadeInputs& in, const Visit& visit) {
  const SceneTexels texels{in.scene.blocks, in.scene.pager != nullptr ? in.scene.pager->pages() : TexelPages{}};
  const auto with_kinds = [&]<bool kOrthographic, Show kShow>() {
    visit_kinds<kApart, kOrthographic, kShow>(in, texels, visit);
  };
  // One shader for all kinds of chunks, because light takes most of its time.
  const auto with_surfaces = [&]<bool kOrthographic>() { visit(Shader<kOrthographic, Show::kSurface>{in, texels}); };
  const auto with_camera = [&]<bool kOrthographic>() {
    switch (in.options.show) {
      case Show::kSurface:
        return with_surfaces.template operator()<kOrthographic>();
      case Show::kTexture:
        if (shades_surfaces(in.scene, in.options)) return with_surfaces.template operator()<kOrthographic>();
        if (in.scene.texture_count == 0) return with_kinds.template operator()<kOrthographic, Show::kColor>();
        return with_kinds.template operator()<kOrthographic, Show::kTexture>();
      case Show::kColor:
        return with_kinds.template operator()<kOrthographic, Show::kColor>();
      case Show::kUv:
        return visit(Shader<kOrthographic, Show::kUv>{in, {in.scene.blocks}});
      case Show::kNormal:
        return visit(Shader<kOrthographic, Show::kNormal>{in, {in.scene.blocks}});
      case Show::kTriangle:
        return visit(Shader<kOrthographic, Show::kTriangle>{in, {in.scene.blocks}});
      case Show::kCluster:
        return visit(Shader<kOrthographic, Show::kCluster>{in, {in.scene.blocks}});
      case Show::kMesh:
        return visit(Shader<kOrthographic, Show::kMesh>{in, {in.scene.blocks}});
      case Show::kStage:
        return visit(Shader<kOrthographic, Show::kStage>{in, {in.scene.blocks}});
      case Show::kDepth:
        return visit(Shader<kOrthographic, Show::kDepth>{in, {in.scene.blocks}});
    }
  };
  in.view.orthographic ? with_camera.template operator()<true>() : with_camera.template operator()<false>();
}

}  // namespace SCREE_ISA
}  // namespace scree::kernels
