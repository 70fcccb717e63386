// Alpha masks: which covered samples of a masked triangle are drawn. This depends on triangle and sample alone, so it
// is the same in every stage and for every piece that clipping leaves. Source: spec/rasterization.md, alpha masks.
#pragma once

#include <cmath>

#include "kernels/raster/queues.h"
#include "kernels/shade/locate.h"

namespace scree::kernels {
inline namespace SCREE_ISA {

/// The triangles that a build (a template instance) of the kernels draws. Layers of blended surfaces have builds of
/// their own, so that masks do not pay for them.
enum class Alpha : uint8_t { kOpaque, kMasked, kBlended };

/// For opaque triangles: tests nothing.
struct NoMask {
  static constexpr bool kTests = false;
};

/// A test that passes returns this bit, and below it the alpha of the mask's texels, in 1 / kMaxMaskThreshold. A test
/// that fails returns 0.
inline constexpr uint32_t kShown = 1u << 31;
inline constexpr uint32_t kShownOpaque = kShown | format::kMaxMaskThreshold;

/// The place of a sample on a mask along one axis, in a level of `size` texels: the two texels around it, and the
/// weight of the second, in 1 / 256. `value`: the texture coordinate, finite.
struct MaskTexels {
  uint32_t first;
  uint32_t second;
  uint32_t weight;
};

SCREE_HD inline MaskTexels mask_texels(double value, uint32_t size, format::Wrap wrap, bool nearest) {
  double wrapped = value - std::floor(value);
  if (wrap == format::Wrap::kMirror) {
    const double period = value - 2.0 * std::floor(value * 0.5);
    wrapped = period > 1.0 ? 2.0 - period : period;
  } else if (wrap == format::Wrap::kClamp) {
    wrapped = value;
  }
  wrapped = min_of(max_of(wrapped, 0.0), 1.0);
  const int32_t last = static_cast<int32_t>(size) - 1;
  const int32_t place = static_cast<int32_t>(std::floor(wrapped * (256.0 * static_cast<double>(size))));  // <= 2^24
  if (nearest) {
    const auto texel = static_cast<uint32_t>(min_of(place >> 8, last));
    return {texel, texel, 0};
  }
  const int32_t first = (place - 128) >> 8;
  const int32_t second = first + 1;
  const bool repeats = wrap == format::Wrap::kRepeat;
  return {static_cast<uint32_t>(first < 0 ? (repeats ? last : 0) : first),
          static_cast<uint32_t>(second > last ? (repeats ? 0 : last) : second),
          static_cast<uint32_t>(place - 128) & 255u};
}

/// The alpha at texture coordinates (u, v), which are finite, in 1 / kMaxMaskThreshold. `footprint`: as for
/// nearest_level().
SCREE_HD inline uint32_t mask_alpha(const MaskView& mask, double u, double v, float footprint) {
  const uint32_t level = nearest_level(footprint, mask.level_count);
  const uint8_t* alpha = mask.alpha;
  uint32_t width = mask.width;
  uint32_t height = mask.height;
  for (uint32_t l = 0; l < level; ++l) {
    alpha += uint64_t{width} * height;
    width = max_of(width >> 1, 1u);
    height = max_of(height >> 1, 1u);
  }
  const bool nearest = footprint <= 1.0f ? mask.magnified_nearest : mask.minified_nearest;
  const MaskTexels column = mask_texels(u, width, mask.wrap_s, nearest);
  const MaskTexels row = mask_texels(v, height, mask.wrap_t, nearest);
  const uint8_t* const above = alpha + uint64_t{row.first} * width;
  const uint8_t* const below = alpha + uint64_t{row.second} * width;
  const uint32_t upper = above[column.first] * (256 - column.weight) + above[column.second] * column.weight;
  const uint32_t lower = below[column.first] * (256 - column.weight) + below[column.second] * column.weight;
  return upper * (256 - row.weight) + lower * row.weight;
}

SCREE_HD inline bool mask_passes(const MaskView& mask, double u, double v, float footprint) {
  return mask_alpha(mask, u, v, footprint) >= mask.threshold;
}

/// The alpha codes of three corners, 8 bits each from corner 0 on.
inline constexpr uint32_t kOpaqueCorners = 0xffffff;
/// An alpha interpolated between corners is in units of 1 / kOpaqueVertices.
inline constexpr uint32_t kOpaqueVertices = 255 * 256;

/// The alpha of vertex colours at a sample, in 1 / kOpaqueVertices: `moved` codes from corner 0's, brought into the
/// range of the corners. `codes`: the corners', as in MaskPlane::corners.
SCREE_HD inline uint32_t corner_alpha(uint32_t codes, double moved) {
  const auto first = static_cast<double>(codes & 255);
  const double to1 = static_cast<double>(codes >> 8 & 255) - first;
  const double to2 = static_cast<double>(codes >> 16) - first;
  const double least = min_of(min_of(to1, to2), 0.0);
  const double most = max_of(max_of(to1, to2), 0.0);
  return static_cast<uint32_t>(std::floor(256.0 * (first + min_of(max_of(moved, least), most))));
}

/// A triangle on its mask: the data by which its samples are tested. `weight`, `moved[c]` and `moved_alpha` are linear
/// functions of the sample (x, y, 1). moved[c] / weight is the distance of texture coordinate c from corner 0's,
/// `first[c]`.
struct MaskPlane {
  const MaskView* mask;  // null: every sample passes
  double weight[3];
  double moved[2][3];
  double first[2];
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
    const auto x = static_cast<double>(sample_x);
    const auto y = static_cast<double>(sample_y);
    const double inverse = 1.0 / (weight[0] * x + weight[1] * y + weight[2]);
    const double sum = static_cast<double>(moved_alpha[0]) * x + static_cast<double>(moved_alpha[1]) * y +
                       static_cast<double>(moved_alpha[2]);
    return corner_alpha(corners, sum * inverse);
  }

  /// mask_alpha() at a sample, without the vertex colours' alpha. Requires a mask.
  SCREE_HD uint32_t alpha(int32_t sample_x, int32_t sample_y) const {
    const auto x = static_cast<double>(sample_x);
    const auto y = static_cast<double>(sample_y);
    const double inverse = 1.0 / (weight[0] * x + weight[1] * y + weight[2]);
    const double size[2] = {static_cast<double>(mask->width), static_cast<double>(mask->height)};
    double place[2];
    double right = 0;  // squared lengths of a step of one sample, in texels of level 0
    double down = 0;
    for (int c = 0; c < 2; ++c) {
      const double at = (moved[c][0] * x + moved[c][1] * y + moved[c][2]) * inverse;
      const double to_right = (moved[c][0] - at * weight[0]) * inverse * size[c];
      const double to_down = (moved[c][1] - at * weight[1]) * inverse * size[c];
      right = right + to_right * to_right;
      down = down + to_down * to_down;
      // After snapping a sample may lie outside its triangle, and far outside an edge-on one. NaN becomes the least.
      place[c] = first[c] + min_of(max_of(at, static_cast<double>(least[c])), static_cast<double>(most[c]));
    }
    return mask_alpha(*mask, place[0], place[1], static_cast<float>(max_of(right, down)));
  }
};

/// The tests of a triangle's samples: its mask and the view's clipping box.
struct TestedTriangle {
  static constexpr bool kTests = true;
  static constexpr bool kBlends = true;  // the triangle may be blended: the Target decides

  const MaskPlane& plane;
  const FrameView& view;

  /// As MaskPlane::shown(), and 0 outside the clipping box. `value`: the word that would be stored.
  SCREE_HD uint32_t shown(int32_t x, int32_t y, uint64_t value) const {
    return is_cut_away(view, x, y, value) ? 0 : plane.shown(x, y);
  }
};

/// Draws `value` into the target if it lies behind the layer before (Target::peeled) and `mask` shows sample (x, y).
/// Requires that `value` is in front of `sample`.
template <class Team, class Mask>
SCREE_HD inline void draw_tested(Team team, const Target& target, uint64_t* sample, uint64_t value, const Mask& mask,
                                 int32_t x, int32_t y) {
  if constexpr (Mask::kBlends) {
    if (!target.is_behind_peeled(sample, value)) return;
    const uint32_t shown = mask.shown(x, y, value);
    if (shown != 0) team.draw_blended(target, sample, value, shown);
  } else {
    if (mask.shown(x, y, value) != 0) team.atomic_min(sample, value);
  }
}

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
  double step;

  SCREE_HD MaskVertices(const format::ChunkRecord& chunk, const std::byte* uvs, const std::byte* with_colors)
      : stream(uvs),
        colors(with_colors),
        bits{chunk.uv_bits[0], chunk.uv_bits[1]},
        min{chunk.uv_min[0], chunk.uv_min[1]},
        step(format::exp2i(chunk.uv_exponent)) {}

  SCREE_HD uint32_t alpha(uint32_t vertex) const {
    return colors != nullptr ? static_cast<uint32_t>(colors[4 * uint64_t{vertex} + 3]) : 255u;
  }

  SCREE_HD void read_uv(uint32_t vertex, double out[2]) const {
    uint64_t bit = uint64_t{vertex} * (bits[0] + bits[1]);
    for (int c = 0; c < 2; ++c) {
      const uint32_t code = bits[c] == 0 ? 0u : unpack_bits(stream, bit, bits[c]);
      bit += bits[c];
      out[c] = static_cast<double>(wrapping_add(min[c], int64_t{code})) * step;
    }
  }
};

/// Makes the plane of a triangle, in double, in which corners and texture coordinates are exact. `corner(n, d)`:
/// returns the vertex number of corner n and writes its position minus the transform's reference to d, 3 doubles.
template <bool kOrthographic, class Corner>
SCREE_HD inline void make_mask_plane(const MaskView* mask, const FrameView& view, const Transform& transform,
                                     const MaskVertices& vertices, const Corner& corner, MaskPlane& out) {
  // Homogeneous, in sub-pixels from the centre of the image's first sample.
  const double origin_x = static_cast<double>(view.width * (kSubpixels / 2) - kSubpixels / 2);
  const double origin_y = static_cast<double>(view.height * (kSubpixels / 2) - kSubpixels / 2);
  double x[3] = {};
  double y[3] = {};
  double w[3] = {};
  double uv[3][2] = {};
  uint32_t codes = 0;
  // Not unrolled on a GPU, because a multiprocessor's instruction cache is small.
#if defined(__CUDA_ARCH__)
#pragma unroll 1
#endif
  for (int n = 0; n < 3; ++n) {
    for (int i = 0; i < 2; ++i) {
      x[i] = x[i + 1];
      y[i] = y[i + 1];
      w[i] = w[i + 1];
      for (int c = 0; c < 2; ++c) uv[i][c] = uv[i + 1][c];
    }
    double d[3];
    const uint32_t vertex = corner(n, d);
    const auto row = [&](const double* m) { return m[0] * d[0] + m[1] * d[1] + m[2] * d[2] + m[3]; };
    w[2] = kOrthographic ? 1.0 : row(transform.exact_w);
    x[2] = row(transform.exact_x) + origin_x * w[2];
    y[2] = row(transform.exact_y) + origin_y * w[2];
    double stored[2];
    vertices.read_uv(vertex, stored);
    codes = codes >> 8 | vertices.alpha(vertex) << 16;
    for (int c = 0; c < 2; ++c)
      uv[2][c] = mask->place[c][0] * stored[0] + mask->place[c][1] * stored[1] + mask->place[c][2];
  }
  out.mask = mask;
  out.corners = codes;
  for (int c = 0; c < 2; ++c) {
    const double to1 = uv[1][c] - uv[0][c];
    const double to2 = uv[2][c] - uv[0][c];
    out.first[c] = uv[0][c];
    out.least[c] = static_cast<float>(min_of(min_of(to1, to2), 0.0));
    out.most[c] = static_cast<float>(max_of(max_of(to1, to2), 0.0));
  }
  // The edge function opposite corner n, over samples.
  const auto edge_of = [&](int n, double edge[3]) {
    const int a = n == 2 ? 0 : n + 1;
    const int b = a == 2 ? 0 : a + 1;
    edge[0] = (y[a] * w[b] - w[a] * y[b]) * kSubpixels;
    edge[1] = (w[a] * x[b] - x[a] * w[b]) * kSubpixels;
    edge[2] = x[a] * y[b] - y[a] * x[b];
  };
  for (int n = 0; n < 3; ++n) {
    double edge[3];
    edge_of(n, edge);
    for (int i = 0; i < 3; ++i) {
      out.weight[i] = n == 0 ? edge[i] : out.weight[i] + edge[i];
      for (int c = 0; c < 2 && n != 0; ++c) {
        const double product = (uv[n][c] - uv[0][c]) * edge[i];
        out.moved[c][i] = n == 1 ? product : out.moved[c][i] + product;
      }
    }
  }
  if (codes == kOpaqueCorners) return;
  const auto code = [&](int n) { return static_cast<double>(codes >> 8 * n & 255); };
  double edge1[3];
  double edge2[3];
  edge_of(1, edge1);
  edge_of(2, edge2);
  for (int i = 0; i < 3; ++i)
    out.moved_alpha[i] = static_cast<float>((code(1) - code(0)) * edge1[i] + (code(2) - code(0)) * edge2[i]);
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
  const auto corner = [&](int n, double d[3]) {
    reader.exact_relative(vertex[n], d);
    return vertex[n];
  };
  make_mask_plane<kOrthographic>(mask, view, transform, vertices, corner, out);
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

/// The data by which stages 2 and 3 make the planes of their triangles. Empty in builds that test nothing.
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
