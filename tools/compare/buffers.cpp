#include "tools/compare/buffers.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <unordered_map>

#include "kernels/depth.h"
#include "kernels/frame.h"
#include "kernels/visbuffer.h"
#include "runtime/mapped_file.h"
#include "tools/common/chunk_decode.h"

namespace scree::compare {
namespace {

using Corners = std::array<std::array<float, 3>, 3>;

static_assert(std::endian::native == std::endian::little);

struct Triangle {
  uint64_t chunk;
  uint32_t place;  // in the chunk
};

uint64_t key_of(const Triangle& triangle) {
  return triangle.chunk << 32 | triangle.place;  // fewer than 2^32 chunks fit into any file
}

/// The corners of many triangles, each chunk decoded once.
Result<std::unordered_map<uint64_t, Corners>> read_corners(const format::Container& file,
                                                           std::vector<Triangle> triangles) {
  std::sort(triangles.begin(), triangles.end(),
            [](const Triangle& a, const Triangle& b) { return key_of(a) < key_of(b); });
  std::unordered_map<uint64_t, Corners> out;
  tools::ChunkReader reader(file);
  const tools::DecodedChunk* chunk = nullptr;
  uint64_t read_chunk = UINT64_MAX;
  for (const Triangle& triangle : triangles) {
    if (triangle.chunk != read_chunk) {
      const auto read = reader.read(triangle.chunk, tools::kPartIndices | tools::kPartPositions);
      if (!read) return read.error();
      chunk = *read;
      read_chunk = triangle.chunk;
    }
    Corners corners{};
    for (size_t n = 0; n < 3; ++n)
      for (size_t axis = 0; axis < 3; ++axis)
        corners[n][axis] = chunk->positions[3 * size_t{chunk->indices[3 * size_t{triangle.place} + n]} + axis];
    out[key_of(triangle)] = corners;
  }
  return out;
}

/// Two different triangles of one pixel.
struct Pair {
  uint64_t pixel;
  Triangle a, b;
};

/// Sorts out the pixels of other triangles.
Result<void> name_kinds(std::span<const uint64_t> a, std::span<const uint64_t> b, const runtime::Scene& scene,
                        PixelReport& report) {
  const kernels::SceneView& view = scene.view();
  const uint64_t triangles = view.instance_base[view.instance_count];
  std::vector<Pair> pairs;
  std::vector<Triangle> needed;
  for (uint64_t i = 0; i < a.size(); ++i) {
    if (report.kinds[i] != PixelKind::kOtherTriangle) continue;
    const uint64_t largest = std::max(kernels::sample_id(a[i]), kernels::sample_id(b[i]));
    if (largest >= triangles)
      return Error{ErrorCode::kRange, "pixel " + std::to_string(i % report.width) + "," +
                                          std::to_string(i / report.width) + ": triangle " + std::to_string(largest) +
                                          ", but the scene draws " + std::to_string(triangles)};
    const kernels::Hit hit_a = kernels::find_triangle(view, kernels::sample_id(a[i]));
    const kernels::Hit hit_b = kernels::find_triangle(view, kernels::sample_id(b[i]));
    if (hit_a.instance != hit_b.instance) {
      report.kinds[i] = PixelKind::kOtherMesh;
      continue;
    }
    pairs.push_back({i, {hit_a.chunk, hit_a.triangle}, {hit_b.chunk, hit_b.triangle}});
    needed.push_back(pairs.back().a);
    needed.push_back(pairs.back().b);
  }
  const auto corners = read_corners(scene.container(), std::move(needed));
  if (!corners) return at(scene.file().path(), corners.error());
  for (const Pair& pair : pairs)
    report.kinds[pair.pixel] = share_vertex(corners->at(key_of(pair.a)), corners->at(key_of(pair.b)))
                                   ? PixelKind::kNeighbour
                                   : PixelKind::kApart;
  return {};
}

/// In units of the near plane.
double distance_of(uint64_t sample) {
  return 1 / kernels::depth_value_of_code(kernels::sample_depth_code(sample), false);
}

}  // namespace

Result<std::vector<uint64_t>> read_visibility(const std::string& path, uint32_t width, uint32_t height) {
  const auto map = runtime::MappedFile::open(path);
  if (!map) return map.error();
  const uint64_t count = uint64_t{width} * height;
  if (map->size() != 8 * count)
    return Error{map->size() < 8 * count ? ErrorCode::kTruncated : ErrorCode::kTrailing,
                 path + ": " + std::to_string(map->size()) + " bytes, but a visibility buffer of " +
                     std::to_string(width) + " x " + std::to_string(height) + " samples (--size) takes " +
                     std::to_string(8 * count)};
  std::vector<uint64_t> samples(count);
  std::memcpy(samples.data(), map->bytes().data(), 8 * count);
  return samples;
}

Result<PixelReport> compare_buffers(std::span<const uint64_t> a, std::span<const uint64_t> b, uint32_t width,
                                    uint32_t height, const runtime::Scene* scene) {
  PixelReport report;
  report.width = width;
  report.height = height;
  report.triangles_known = scene != nullptr;
  report.kinds.resize(a.size());
  for (uint64_t i = 0; i < a.size(); ++i) {
    const bool empty_a = a[i] == kernels::kBackground, empty_b = b[i] == kernels::kBackground;
    if (empty_a || empty_b) {
      report.kinds[i] = empty_a && empty_b ? PixelKind::kBothBackground : PixelKind::kBackground;
      continue;
    }
    const bool same = kernels::sample_id(a[i]) == kernels::sample_id(b[i]);
    report.kinds[i] = same ? PixelKind::kSame : PixelKind::kOtherTriangle;
    report.surface_depth.add(distance_of(a[i]), distance_of(b[i]));
    if (same) report.same_depth.add(distance_of(a[i]), distance_of(b[i]));
  }
  if (scene != nullptr)
    if (const Result<void> named = name_kinds(a, b, *scene, report); !named) return named.error();
  return report;
}

}  // namespace scree::compare
