#include "tools/compare/buffers.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "format/fail.h"
#include "kernels/frame.h"
#include "kernels/shade/layers.h"
#include "kernels/visbuffer.h"
#include "runtime/files/mapped_file.h"
#include "tools/common/chunk_decode.h"

namespace scree::compare {
namespace {

template <class Number>
using Corners = std::array<std::array<Number, 3>, 3>;

static_assert(std::endian::native == std::endian::little);

/// The corners of stored triangles in the order of the list, in model units. Decodes each chunk once.
Result<std::vector<Corners<float>>> read_corners(const runtime::Scene& scene,
                                                 std::span<const StoredTriangle> triangles) {
  std::vector<Corners<float>> out(triangles.size());
  tools::ChunkReader reader(scene.container());
  const tools::DecodedChunk* chunk = nullptr;
  uint64_t read_chunk = UINT64_MAX;
  for (const uint64_t i : by_chunk(triangles)) {
    if (triangles[i].chunk != read_chunk) {
      chunk = SCREE_TRY_AT(scene.file().path(),
                           reader.read(triangles[i].chunk, tools::kPartIndices | tools::kPartPositions));
      read_chunk = triangles[i].chunk;
    }
    for (size_t n = 0; n < 3; ++n)
      for (size_t axis = 0; axis < 3; ++axis)
        out[i][n][axis] = chunk->positions[3 * size_t{chunk->indices[3 * size_t{triangles[i].place} + n]} + axis];
  }
  return out;
}

Corners<double> placed(const runtime::Scene& scene, uint64_t instance, const Corners<float>& corners) {
  const auto& rows = scene.container().matrices()[scene.view().instances[instance].matrix].rows;
  Corners<double> out{};
  for (size_t n = 0; n < 3; ++n)
    for (size_t i = 0; i < 3; ++i) {
      out[n][i] = rows[i][3];
      for (size_t j = 0; j < 3; ++j) out[n][i] += rows[i][j] * static_cast<double>(corners[n][j]);
    }
  return out;
}

/// The relation of two different triangles at a pixel. Their corners are those of the second scene.
PixelKind kind_of(const runtime::Scene& scene, const CommonTriangle& a, const Corners<float>& corners_a,
                  const CommonTriangle& b, const Corners<float>& corners_b) {
  const auto coincide = [](const auto& p, const auto& q) { return std::is_permutation(p.begin(), p.end(), q.begin()); };
  if (a.instance != b.instance)
    return coincide(placed(scene, a.instance, corners_a), placed(scene, b.instance, corners_b)) ? PixelKind::kCoincident
                                                                                                : PixelKind::kOtherMesh;
  if (coincide(corners_a, corners_b)) return PixelKind::kCoincident;
  return share_vertex(corners_a, corners_b) ? PixelKind::kNeighbour : PixelKind::kApart;
}

/// The different triangle ids of a buffer, in order. Errors kRange (one past the scene's triangles).
Result<std::vector<uint64_t>> ids_of(std::span<const uint64_t> samples, uint32_t width, const char* which,
                                     const runtime::Scene& scene) {
  const uint64_t triangles = scene.view().instance_base[scene.view().instance_count];
  std::vector<uint64_t> ids;
  for (uint64_t i = 0; i < samples.size(); ++i) {
    if (samples[i] == kernels::kBackground) continue;
    const uint64_t id = kernels::sample_id(samples[i]);
    if (id >= triangles)
      return fail(ErrorCode::kRange, "pixel ", i % width, ",", i / width, " of the ", which, " buffer: triangle ", id,
                  ", but ", scene.file().path(), " draws ", triangles);
    if (ids.empty() || ids.back() != id) ids.push_back(id);
  }
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
  return ids;
}

/// Sets the kinds of all pixels that show a surface in both buffers.
Result<void> name_kinds(std::span<const uint64_t> a, std::span<const uint64_t> b, const SceneMatch& match,
                        PixelReport& report) {
  const auto ids_a = SCREE_TRY(ids_of(a, report.width, "first", match.first()));
  const auto ids_b = SCREE_TRY(ids_of(b, report.width, "second", match.second()));
  const SceneMatch::Resolved resolved = SCREE_TRY(match.resolve(ids_a, ids_b));
  const auto common = [](const std::vector<uint64_t>& ids, const std::vector<CommonTriangle>& triangles,
                         uint64_t sample) -> const CommonTriangle& {
    const auto found = std::lower_bound(ids.begin(), ids.end(), kernels::sample_id(sample));
    return triangles[static_cast<size_t>(found - ids.begin())];
  };
  std::vector<uint64_t> pixels;
  std::vector<CommonTriangle> differing;  // two per pixel
  for (uint64_t i = 0; i < a.size(); ++i) {
    if (report.kinds[i] != PixelKind::kSame && report.kinds[i] != PixelKind::kOtherTriangle) continue;
    const CommonTriangle& in_a = common(ids_a, resolved.a, a[i]);
    const CommonTriangle& in_b = common(ids_b, resolved.b, b[i]);
    if (in_a == in_b) {
      report.kinds[i] = PixelKind::kSame;
      continue;
    }
    pixels.push_back(i);
    differing.push_back(in_a);
    differing.push_back(in_b);
  }
  const std::vector<StoredTriangle> stored = SCREE_TRY(match.find(differing));
  const auto corners = SCREE_TRY(read_corners(match.second(), stored));
  for (size_t n = 0; n < pixels.size(); ++n)
    report.kinds[pixels[n]] =
        kind_of(match.second(), differing[2 * n], corners[2 * n], differing[2 * n + 1], corners[2 * n + 1]);
  return {};
}

/// The distance of a sample; without a view in units of the near plane of a perspective one.
double distance_of(uint64_t sample, const kernels::View* view) {
  const bool orthographic = view != nullptr && view->orthographic;
  return kernels::distance_of_code(kernels::sample_depth_code(sample), orthographic, orthographic ? view->z_near : 1,
                                   orthographic ? view->z_far : 0);
}

}  // namespace

Result<std::vector<uint64_t>> read_visibility(const std::string& path, uint32_t width, uint32_t height) {
  const auto map = SCREE_TRY(runtime::MappedFile::open(path));
  const uint64_t count = uint64_t{width} * height;
  if (map.size() != 8 * count)
    return fail(map.size() < 8 * count ? ErrorCode::kTruncated : ErrorCode::kTrailing, path, ": ", map.size(),
                " bytes, but a visibility buffer of ", width, " x ", height, " samples (--size) takes ", 8 * count);
  std::vector<uint64_t> samples(count);
  std::memcpy(samples.data(), map.bytes().data(), 8 * count);
  return samples;
}

Result<PixelReport> compare_buffers(std::span<const uint64_t> a, std::span<const uint64_t> b, uint32_t width,
                                    uint32_t height, const SceneMatch* match, const kernels::View* view) {
  PixelReport report{.width = width, .height = height, .triangles_known = match != nullptr};
  report.kinds.resize(a.size());
  for (uint64_t i = 0; i < a.size(); ++i) {
    const bool empty_a = a[i] == kernels::kBackground, empty_b = b[i] == kernels::kBackground;
    if (empty_a || empty_b) {
      report.kinds[i] = empty_a && empty_b ? PixelKind::kBothBackground : PixelKind::kBackground;
      continue;
    }
    const bool same = kernels::sample_id(a[i]) == kernels::sample_id(b[i]);
    report.kinds[i] = same ? PixelKind::kSame : PixelKind::kOtherTriangle;
  }
  if (match != nullptr) SCREE_TRY(name_kinds(a, b, *match, report));
  for (uint64_t i = 0; i < a.size(); ++i) {
    if (report.kinds[i] == PixelKind::kBothBackground || report.kinds[i] == PixelKind::kBackground) continue;
    const double depth_a = distance_of(a[i], view), depth_b = distance_of(b[i], view);
    report.surface_depth.add(depth_a, depth_b);
    if (report.kinds[i] == PixelKind::kSame) report.same_depth.add(depth_a, depth_b);
  }
  return report;
}

}  // namespace scree::compare
