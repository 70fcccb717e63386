// Alpha masks: which covered samples of a masked triangle are drawn. This depends on triangle and sample alone, so it
// is the same in every stage and for every piece that clipping leaves. Source: spec/rasterization.md, alpha masks.
#pragma once

#include <cmath>
#include <type_traits>

#include "kernels/raster/queues.h"
#include "kernels/shade/locate.h"
#include "kernels/shade/texture_point.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// The triangles that a build (a template instance) of the kernels draws. Layers of blended surfaces have builds of
/// their own, so that they do not slow down masks.
enum class Alpha : uint8_t { kOpaque, kMasked, kBlended };

/// For opaque triangles: has no test.
struct NoMask {
  static constexpr bool kTests = false;

  SCREE_HD static bool any(bool of_lane) { return of_lane; }
};

/// A test that passes returns this bit, and below it the alpha of the mask's texels, in 1 / kMaxMaskThreshold. A test
/// that fails returns 0.
inline constexpr uint32_t kShown = 1u << 31;
inline constexpr uint32_t kShownOpaque = kShown | format::kMaxMaskThreshold;

/// The place of a sample on a mask along one axis, in a level of `size` texels: the two texels around it, and the
/// weight of the second, in 1 / 256. `wrapped`: of wrap_point().
struct MaskTexels {
  uint32_t first;
  uint32_t second;
  uint32_t weight;
};

SCREE_HD inline MaskTexels mask_texels(uint32_t wrapped, uint32_t size, format::Wrap wrap, bool nearest) {
  const auto place = static_cast<int32_t>(uint64_t{wrapped} * (256 * size) >> 32);  // in 1 / 256 of a texel
  if (nearest) {
    const auto texel = static_cast<uint32_t>(place) >> 8;
    return {texel, texel, 0};
  }
  const int32_t last = static_cast<int32_t>(size) - 1;
  const int32_t first = (place - 128) >> 8;
  const int32_t second = first + 1;
  const bool repeats = wrap == format::Wrap::kRepeat;
  return {static_cast<uint32_t>(first < 0 ? (repeats ? last : 0) : first),
          static_cast<uint32_t>(second > last ? (repeats ? 0 : last) : second),
          static_cast<uint32_t>(place - 128) & 255u};
}

/// The alpha at a place on a mask, in 1 / kMaxMaskThreshold. `footprint`: as for nearest_level().
SCREE_HD inline uint32_t mask_alpha(const MaskView& mask, TexturePoint u, TexturePoint v, float footprint) {
  const uint32_t level = nearest_level(footprint, mask.level_count);
  const uint8_t* const alpha = mask.alpha + mask.level_offset[level];
  const uint32_t width = max_of(mask.width >> level, 1u);
  const uint32_t height = max_of(mask.height >> level, 1u);
  const bool nearest = footprint <= 1.0f ? mask.magnified_nearest : mask.minified_nearest;
  const MaskTexels column = mask_texels(wrap_point(u, mask.wrap_s), width, mask.wrap_s, nearest);
  const MaskTexels row = mask_texels(wrap_point(v, mask.wrap_t), height, mask.wrap_t, nearest);
  const uint8_t* const above = alpha + uint64_t{row.first} * width;
  const uint8_t* const below = alpha + uint64_t{row.second} * width;
  const uint32_t upper = above[column.first] * (256 - column.weight) + above[column.second] * column.weight;
  const uint32_t lower = below[column.first] * (256 - column.weight) + below[column.second] * column.weight;
  return upper * (256 - row.weight) + lower * row.weight;
}

/// The alpha codes of three corners, 8 bits each from corner 0 on.
inline constexpr uint32_t kOpaqueCorners = 0xffffff;
/// An alpha interpolated between corners is in units of 1 / kOpaqueVertices.
inline constexpr uint32_t kOpaqueVertices = 255 * 256;

/// The alpha of vertex colours at a sample, in 1 / kOpaqueVertices: `moved` codes from corner 0's, brought into the
/// range of the corners. `codes`: the corners', as in MaskPlane::corners.
SCREE_HD inline uint32_t corner_alpha(uint32_t codes, float moved) {
  const auto first = static_cast<float>(codes & 255);
  const float to1 = static_cast<float>(codes >> 8 & 255) - first;
  const float to2 = static_cast<float>(codes >> 16) - first;
  const float least = min_of(min_of(to1, to2), 0.0f);
  const float most = max_of(max_of(to1, to2), 0.0f);
  return static_cast<uint32_t>(256.0f * (first + min_of(max_of(moved, least), most)));
}

/// A triangle on its mask: the data by which its samples are tested. `weight`, `moved[c]` and `moved_alpha` are linear
/// functions of the sample (x, y, 1), counted from `origin`. moved[c] / weight is the distance of texture coordinate c
/// from corner 0's, `first[c]`.
struct MaskPlane {
  const MaskView* mask;  // null: every sample passes
  TexturePoint first[2];
  int32_t origin[2];
  float weight[3];
  float moved[2][3];
  float least[2];  // the range of moved / weight at the corners
  float most[2];
  float moved_alpha[3];  // the same for the vertex colours' alpha, in codes; set if a corner has less than 255
  uint32_t corners;      // the corners' alpha codes, 8 bits each from corner 0 on

  /// Returns 0 if the mask hides the sample; otherwise kShown and the alpha of the mask's texels.
  SCREE_HD uint32_t shown(int32_t sample_x, int32_t sample_y) const {
    if (mask == nullptr) return kShownOpaque;
    const uint32_t texels = alpha(sample_x, sample_y);
    const bool is_there = corners == kOpaqueCorners ? texels >= mask->threshold
                                                    : uint64_t{texels} * vertex_alpha(sample_x, sample_y) >=
                                                          uint64_t{mask->threshold} * kOpaqueVertices;
    return is_there ? kShown | texels : 0;
  }

  /// corner_alpha() at a sample. Requires that `corners` is not kOpaqueCorners.
  SCREE_HD uint32_t vertex_alpha(int32_t sample_x, int32_t sample_y) const {
    return corner_alpha(corners, at(moved_alpha, sample_x, sample_y) * (1.0f / at(weight, sample_x, sample_y)));
  }

  /// mask_alpha() at a sample, without the vertex colours' alpha. Requires a mask.
  SCREE_HD uint32_t alpha(int32_t sample_x, int32_t sample_y) const {
    const float inverse = 1.0f / at(weight, sample_x, sample_y);
    const uint32_t size[2] = {mask->width, mask->height};
    TexturePoint place[2];
    float right = 0;  // squared lengths of a step of one sample, in texels of level 0
    float down = 0;
    for (int c = 0; c < 2; ++c) {
      const float distance = at(moved[c], sample_x, sample_y) * inverse;
      const float scale = inverse * static_cast<float>(size[c]);
      const float to_right = (moved[c][0] - distance * weight[0]) * scale;
      const float to_down = (moved[c][1] - distance * weight[1]) * scale;
      right = right + to_right * to_right;
      down = down + to_down * to_down;
      // After snapping a sample may lie outside its triangle, and far outside an edge-on one. NaN becomes the least.
      place[c] = first[c] + texture_point(min_of(max_of(distance, least[c]), most[c]));
    }
    return mask_alpha(*mask, place[0], place[1], max_of(right, down));
  }

 private:
  SCREE_HD float at(const float plane[3], int32_t x, int32_t y) const {
    return plane[0] * static_cast<float>(x - origin[0]) + plane[1] * static_cast<float>(y - origin[1]) + plane[2];
  }
};

/// The tests of a triangle's samples: its mask and the view's clipping box.
struct TestedTriangle {
  static constexpr bool kTests = true;

  const MaskPlane& plane;
  const FrameView& view;

  /// As MaskPlane::shown(), and 0 outside the clipping box. `value`: the word that would be stored.
  SCREE_HD uint32_t shown(int32_t x, int32_t y, uint64_t value) const {
    return is_cut_away(view, x, y, value) ? 0 : plane.shown(x, y);
  }

  SCREE_HD static bool any(bool of_lane) { return of_lane; }

  /// Draws `value` at sample (x, y) into the target if it is in front of `sample` (`is_nearer`), lies behind the layer
  /// before (Target::peeled), and passes the tests. The triangle may be blended: the Target decides.
  template <class Team>
  SCREE_HD void draw(Team team, const Target& target, bool is_nearer, uint64_t* sample, uint64_t value, int32_t x,
                     int32_t y) const {
    if (!is_nearer || !target.is_behind_peeled(sample, value)) return;
    const uint32_t passed = shown(x, y, value);
    if (passed != 0) team.draw_blended(target, sample, value, passed);
  }
};

/// The mask of a mesh's triangles; null if they have none.
SCREE_HD inline const MaskView* mask_of(const SceneView& scene, const format::MeshRecord& mesh) {
  if (scene.masks == nullptr || mesh.material == format::kNone) return nullptr;
  const MaskView* const mask = scene.masks + mesh.material;
  return mask->alpha != nullptr && (mesh.attributes & mask->needs) != 0 ? mask : nullptr;
}

/// Triangle::is_masked of a mesh's triangles: 1 if their samples are tested before they are drawn. That is so if the
/// mesh has a mask, for all triangles of layers, and for all triangles of a view with a clipping box.
SCREE_HD inline uint32_t is_tested(const SceneView& scene, const FrameView& view, const MaskView* mask) {
  return scene.draws_blended || mask != nullptr || view.clip_box.is_set ? 1 : 0;
}

/// Whether the alpha of a masked mesh's vertex colours is multiplied in. Blended surfaces leave it to their layers
/// (blended_alpha()).
SCREE_HD inline bool masks_by_colors(const SceneView& scene, const format::MeshRecord& mesh) {
  return (mesh.attributes & format::kHasColor) != 0 && !scene.draws_blended;
}

/// The vertices of a chunk as a mask reads them: texture coordinates, before the mask's transform, and colours.
struct MaskVertices {
  const std::byte* stream;
  const std::byte* colors;  // null: their alpha is 1
  uint32_t bits[2];
  int64_t min[2];
  int32_t exponent;  // of a step

  SCREE_HD MaskVertices(const format::ChunkRecord& chunk, const std::byte* uvs, const std::byte* with_colors)
      : stream(uvs),
        colors(with_colors),
        bits{chunk.uv_bits[0], chunk.uv_bits[1]},
        min{chunk.uv_min[0], chunk.uv_min[1]},
        exponent(chunk.uv_exponent) {}

  SCREE_HD uint32_t alpha(uint32_t vertex) const {
    return colors != nullptr ? static_cast<uint32_t>(colors[4 * uint64_t{vertex} + 3]) : 255u;
  }

  /// Texture coordinates in steps.
  SCREE_HD void read_uv(uint32_t vertex, int64_t out[2]) const {
    uint64_t bit = uint64_t{vertex} * (bits[0] + bits[1]);
    for (int c = 0; c < 2; ++c) {
      const uint32_t code = bits[c] == 0 ? 0u : unpack_bits(stream, bit, bits[c]);
      bit += bits[c];
      out[c] = wrapping_add(min[c], int64_t{code});
    }
  }
};

/// 2^-k for a magnitude in [2^k, 2^(k+1)), but from 2^-1022 to 2^1023.
SCREE_HD inline double inverse_power(double value) {
  uint64_t bits;
  memcpy(&bits, &value, sizeof bits);
  return format::exp2i(1023 - static_cast<int32_t>(min_of(bits >> 52 & 2047, uint64_t{2045})));
}

/// A corner of a triangle as a mask's plane reads it. `relative`: its position minus the transform's reference.
template <class T>
struct MaskCorner {
  uint32_t vertex;
  T relative[3];
};

// a - b, for coordinates of two corners. Integers differ by less than 2^31, because the corners lie in one chunk.
SCREE_HD inline double difference(double a, double b) {
  return a - b;
}
SCREE_HD inline int32_t difference(int32_t a, int32_t b) {
  return static_cast<int32_t>(static_cast<uint32_t>(a) - static_cast<uint32_t>(b));
}

/// make_mask_plane() with edges in Real. Returns false if a float would be too coarse.
template <bool kOrthographic, class Real, class T>
SCREE_HD inline bool make_plane_in(const MaskView* mask, const FrameView& view, const Transform& transform,
                                   const MaskVertices& vertices, const MaskCorner<T> (&corners)[3], MaskPlane& out) {
  const double* const rows[3] = {transform.exact_x, transform.exact_y, transform.exact_w};
  const auto row = [&](const double* m) {
    const auto d = [&](int i) { return static_cast<double>(corners[0].relative[i]); };
    return m[0] * d(0) + m[1] * d(1) + m[2] * d(2) + m[3];
  };
  const double w = kOrthographic ? 1.0 : row(rows[2]);
  const int32_t sizes[2] = {view.width, view.height};
  Real from[3][3];   // corner 0, and the edges to the others: samples from the origin times w, and w
  double center[2];  // of the origin, in sub-pixels from the image's centre
  for (int k = 0; k < 2; ++k) {
    const double exact = row(rows[k]);
    // The sample nearest to the corner, or at the border of the picture.
    const float sample =
        static_cast<float>(exact) / static_cast<float>(w) * (1.0f / kSubpixels) + static_cast<float>(sizes[k]) * 0.5f;
    out.origin[k] = static_cast<int32_t>(min_of(max_of(sample, 0.0f), static_cast<float>(sizes[k] - 1)));
    center[k] = static_cast<double>(out.origin[k] * kSubpixels - sizes[k] * (kSubpixels / 2) + kSubpixels / 2);
    from[0][k] = static_cast<Real>((exact - center[k] * w) * (1.0 / kSubpixels));
  }
  from[0][2] = static_cast<Real>(w);
  for (int n = 1; n < 3; ++n) {
    const auto edge = [&](const double* m) {
      const auto moved = [&](int i) {
        return static_cast<Real>(m[i]) * static_cast<Real>(difference(corners[n].relative[i], corners[0].relative[i]));
      };
      return moved(0) + moved(1) + moved(2);
    };
    from[n][2] = kOrthographic ? Real{0} : edge(rows[2]);
    for (int k = 0; k < 2; ++k)
      from[n][k] = (edge(rows[k]) - static_cast<Real>(center[k]) * from[n][2]) * static_cast<Real>(1.0 / kSubpixels);
  }
  double largest = w;
  if constexpr (std::is_same_v<Real, float>) {
    constexpr float kMostSamples = 256;  // from corner 0
    const float most = kMostSamples * from[0][2];
    bool fits = from[0][2] > 1e-36f && from[0][2] < 1e36f;
    for (int n = 0; n < 3; ++n) fits = fits && abs_of(from[n][0]) <= most && abs_of(from[n][1]) <= most;
    for (int n = 1; n < 3; ++n) fits = fits && abs_of(from[n][2]) <= 0.25f * from[0][2];
    if (!fits) return false;
  } else {
    largest = max_of(max_of(abs_of(w), abs_of(w + from[1][2])), abs_of(w + from[2][2]));
  }
  // Products stay within a float's range.
  const Real scale = static_cast<Real>(inverse_power(largest));
  for (auto& of : from)
    for (Real& number : of) number = number * scale;

  const double step = format::exp2i(vertices.exponent);
  int64_t uv[3][2];
  uint32_t codes = 0;
  for (int n = 0; n < 3; ++n) {
    vertices.read_uv(corners[n].vertex, uv[n]);
    codes |= vertices.alpha(corners[n].vertex) << 8 * n;
  }
  const auto code = [&](int n) { return static_cast<Real>(codes >> 8 * n & 255); };
  Real grows[2][3];  // u, v and alpha along the edges
  for (int n = 0; n < 2; ++n) {
    Real stored[2];
    for (int k = 0; k < 2; ++k)
      stored[k] = static_cast<Real>(wrapping_sub(uv[n + 1][k], uv[0][k])) * static_cast<Real>(step);
    for (int k = 0; k < 2; ++k)
      grows[n][k] = mask->is_placed ? static_cast<Real>(mask->place[k][0]) * stored[0] +
                                          static_cast<Real>(mask->place[k][1]) * stored[1]
                                    : stored[k];
    grows[n][2] = code(n + 1) - code(0);
  }
  out.mask = mask;
  out.corners = codes;
  const auto write_cross = [](const Real a[3], const Real b[3], float to[3]) {
    to[0] = static_cast<float>(a[1] * b[2] - a[2] * b[1]);
    to[1] = static_cast<float>(a[2] * b[0] - a[0] * b[2]);
    to[2] = static_cast<float>(a[0] * b[1] - a[1] * b[0]);
  };
  const auto write_plane = [&](int k, float to[3]) {
    Real turned[3];
    for (int i = 0; i < 3; ++i) turned[i] = grows[1][k] * from[1][i] - grows[0][k] * from[2][i];
    write_cross(from[0], turned, to);
  };
  write_cross(from[1], from[2], out.weight);
  for (int k = 0; k < 2; ++k) {
    const auto stored = [&](int i) { return static_cast<double>(uv[0][i]) * step; };
    const double* const m = mask->place[k];
    out.first[k] = mask->is_placed ? texture_point(m[0] * stored(0) + m[1] * stored(1) + m[2])
                                   : texture_point(uv[0][k], vertices.exponent);
    out.least[k] = static_cast<float>(min_of(min_of(grows[0][k], grows[1][k]), Real{0}));
    out.most[k] = static_cast<float>(max_of(max_of(grows[0][k], grows[1][k]), Real{0}));
    write_plane(k, out.moved[k]);
  }
  if (codes != kOpaqueCorners) write_plane(2, out.moved_alpha);
  return true;
}

/// Out of line, because few triangles need it.
template <bool kOrthographic, class T>
[[gnu::noinline]] SCREE_HD void make_large_plane(const MaskView* mask, const FrameView& view,
                                                 const Transform& transform, const MaskVertices& vertices,
                                                 const MaskCorner<T> (&corners)[3], MaskPlane& out) {
  (void)make_plane_in<kOrthographic, double>(mask, view, transform, vertices, corners, out);
}

/// Makes the plane of a triangle: in float if it is small and not close to the eye, else in double.
template <bool kOrthographic, class T>
SCREE_HD inline void make_mask_plane(const MaskView* mask, const FrameView& view, const Transform& transform,
                                     const MaskVertices& vertices, const MaskCorner<T> (&corners)[3], MaskPlane& out) {
  if (!make_plane_in<kOrthographic, float>(mask, view, transform, vertices, corners, out))
    make_large_plane<kOrthographic>(mask, view, transform, vertices, corners, out);
}

/// The same for triangle `number` of the chunk that `reader` reads. Out of line, because it takes many registers.
template <bool kOrthographic>
[[gnu::noinline]] SCREE_HD void make_mask_plane(const SceneView& scene, const FrameView& view,
                                                const Transform& transform, const format::MeshRecord& mesh,
                                                const format::ChunkRecord& chunk, const std::byte* page,
                                                const ChunkReader& reader, uint32_t number, MaskPlane& out) {
  const MaskView* const mask = mask_of(scene, mesh);
  out.mask = nullptr;
  if (mask == nullptr) return;
  uint32_t vertex[3];
  reader.triangle(number, vertex);
  const format::ChunkStreams streams = streams_of(mesh, chunk);
  const std::byte* const data = page + chunk.offset;
  const MaskVertices vertices(chunk, data + streams.uvs.offset,
                              masks_by_colors(scene, mesh) ? data + streams.colors.offset : nullptr);
  MaskCorner<double> corners[3];
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
  for (int n = 0; n < 3; ++n) {
    corners[n].vertex = vertex[n];
    reader.exact_relative(vertex[n], corners[n].relative);
  }
  make_mask_plane<kOrthographic>(mask, view, transform, vertices, corners, out);
}

/// The same for triangle `number` of a chunk of the scene.
template <bool kOrthographic>
[[gnu::noinline]] SCREE_HD void make_mask_plane(const SceneView& scene, const FrameView& view,
                                                const Transform& transform, uint64_t chunk_number, uint32_t number,
                                                MaskPlane& out) {
  const format::ChunkRecord& chunk = scene.chunks[chunk_number];
  const format::MeshRecord& mesh = scene.meshes[chunk.mesh];
  const std::byte* const page = scene.pages[chunk.page];
  const ChunkReader reader = make_reader(mesh, chunk, page, transform, number);
  make_mask_plane<kOrthographic>(scene, view, transform, mesh, chunk, page, reader, number, out);
}

/// The data by which stages 2 and 3 make the planes of their triangles. Empty in builds without tests.
template <bool kMasked>
struct MaskSource {};
template <>
struct MaskSource<true> {
  SceneView scene;
  const Transform* transforms;  // by instance; null where a team makes its own (Team::kMakesTransforms)

  /// Makes the plane of a triangle that is known by its id alone.
  template <bool kOrthographic, class Team>
  SCREE_HD void make_plane(Team, const FrameView& view, uint64_t id, MaskPlane& out) const {
    out.mask = nullptr;
    if (scene.masks == nullptr) return;
    const Hit hit = locate_triangle(scene, id);
    if constexpr (Team::kMakesTransforms) {
      const format::InstanceRecord& instance = scene.instances[hit.instance];
      const format::MeshRecord& mesh = scene.meshes[instance.mesh];
      if (mask_of(scene, mesh) == nullptr) return;
      const Transform own = make_transform(view, scene.matrices[instance.matrix], mesh.lattice_exponent,
                                           mesh.position_encoding == format::PositionEncoding::kFloat32);
      make_mask_plane<kOrthographic>(scene, view, own, hit.chunk, hit.triangle, out);
    } else {
      make_mask_plane<kOrthographic>(scene, view, transforms[hit.instance], hit.chunk, hit.triangle, out);
    }
  }
};

}  // namespace SCREE_ISA
}  // namespace scree::kernels
