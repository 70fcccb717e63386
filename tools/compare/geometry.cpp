#include "tools/compare/geometry.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>

#include "format/vec3.h"
#include "tools/common/chunk_decode.h"
#include "tools/compare/source_model.h"

namespace scree::compare {
namespace {

constexpr double kDegrees = 180 / 3.14159265358979323846;

Vec3 vector_at(std::span<const float> values, uint64_t place) {
  return {values[3 * place], values[3 * place + 1], values[3 * place + 2]};
}

/// The angle in degrees; nullopt if a vector has no direction. The arc tangent is exact for small angles, unlike the
/// arc cosine.
std::optional<double> angle(const Vec3& a, const Vec3& b) {
  const double size_a = length(a), size_b = length(b);
  if (!(size_a > 0 && size_b > 0) || !std::isfinite(size_a) || !std::isfinite(size_b)) return std::nullopt;
  const Vec3 u{a[0] / size_a, a[1] / size_a, a[2] / size_a}, v{b[0] / size_b, b[1] / size_b, b[2] / size_b};
  return std::atan2(length(scree::cross(u, v)), dot(u, v)) * kDegrees;
}

double diagonal_of(const SourceMesh& mesh) {
  Vec3 lo{INFINITY, INFINITY, INFINITY}, hi{-INFINITY, -INFINITY, -INFINITY};
  for (uint64_t t = 0; t < mesh.kept.size(); ++t) {
    if (!mesh.kept[t]) continue;
    for (size_t n = 0; n < 3; ++n) {
      const Vec3 p = vector_at(mesh.positions, mesh.corners[3 * t + n]);
      for (size_t axis = 0; axis < 3; ++axis) {
        lo[axis] = std::min(lo[axis], p[axis]);
        hi[axis] = std::max(hi[axis], p[axis]);
      }
    }
  }
  return length(hi - lo);
}

/// Compares the triangles of one mesh, one after another.
class MeshComparison {
 public:
  MeshComparison(const SourceMesh& source, std::span<const float> normals, GeometryReport& report)
      : source_(source),
        normals_(normals),
        report_(report),
        diagonal_(diagonal_of(source)),
        seen_(source.kept.size()),
        farthest_(source.positions.size() / 3, -1.0) {}

  void add(const tools::DecodedChunk& chunk) {
    stored_.assign(chunk.positions.size() / 3, -1.0);
    for (size_t t = 0; t < chunk.source_ids.size(); ++t) {
      const uint64_t id = chunk.source_ids[t];
      ++report_.triangles;
      if (id >= seen_.size() || !source_.kept[id] || seen_[id]) {
        ++report_.unknown_triangles;
        continue;
      }
      seen_[id] = true;
      add_triangle(chunk, t, id);
    }
    for (const double distance : stored_)
      if (distance >= 0) report_.stored.add(distance, diagonal_);
  }

  /// Returns the largest error of a coordinate.
  double finish() {
    for (size_t t = 0; t < seen_.size(); ++t)
      if (source_.kept[t] && !seen_[t]) ++report_.missing_triangles;
    for (const double distance : farthest_)
      if (distance >= 0) report_.source.add(distance, diagonal_);
    return axis_error_;
  }

 private:
  /// Clusters may rotate a triangle's corners. Returns the rotation with the nearest corners, which an equal shift of
  /// all corners does not change.
  size_t turn_of(const tools::DecodedChunk& chunk, size_t triangle, uint64_t id) const {
    size_t best = 0;
    double least = std::numeric_limits<double>::infinity();
    for (size_t turn = 0; turn < 3; ++turn) {
      double sum = 0;
      for (size_t n = 0; n < 3; ++n) {
        const Vec3 difference = vector_at(chunk.positions, chunk.indices[3 * triangle + (n + turn) % 3]) -
                                vector_at(source_.positions, source_.corners[3 * id + n]);
        sum += length(difference) * length(difference);
      }
      if (sum >= least) continue;
      least = sum;
      best = turn;
    }
    return best;
  }

  void add_triangle(const tools::DecodedChunk& chunk, size_t triangle, uint64_t id) {
    std::array<Vec3, 3> found{}, expected{};
    const size_t turn = turn_of(chunk, triangle, id);
    for (size_t n = 0; n < 3; ++n) {
      const uint64_t to = chunk.indices[3 * triangle + (n + turn) % 3], from = source_.corners[3 * id + n];
      found[n] = vector_at(chunk.positions, to);
      expected[n] = vector_at(source_.positions, from);
      const Vec3 difference = found[n] - expected[n];
      for (const double axis : difference) axis_error_ = std::max(axis_error_, std::abs(axis));
      const double distance = length(difference);
      stored_[to] = std::max(stored_[to], distance);
      farthest_[from] = std::max(farthest_[from], distance);
      if (chunk.normals.empty() || normals_.empty()) continue;
      if (const auto degrees = angle(vector_at(chunk.normals, to), vector_at(normals_, from))) {
        ++report_.normals;
        report_.normal_degrees = std::max(report_.normal_degrees, *degrees);
      }
    }
    const auto normal = [](const std::array<Vec3, 3>& p) { return scree::cross(p[1] - p[0], p[2] - p[0]); };
    if (const auto degrees = angle(normal(found), normal(expected))) {
      ++report_.faces;
      report_.face_degrees = std::max(report_.face_degrees, *degrees);
    }
  }

  const SourceMesh& source_;
  std::span<const float> normals_;
  GeometryReport& report_;
  double diagonal_;
  double axis_error_ = 0;
  std::vector<bool> seen_;        // by source triangle
  std::vector<double> farthest_;  // by source vertex; -1: not used
  std::vector<double> stored_;    // by vertex of the chunk; -1: not used
};

}  // namespace

void Distances::add(double distance, double diagonal) {
  const double relative = diagonal > 0 ? distance / diagonal : 0;
  max_ = std::max(max_, distance);
  relative_max_ = std::max(relative_max_, relative);
  squares_ += distance * distance;
  relative_squares_ += relative * relative;
  ++count_;
}

double Distances::root(double squares) const {
  return count_ == 0 ? 0 : std::sqrt(squares / static_cast<double>(count_));
}

Result<GeometryReport> compare_geometry(const convert::SourceScene& scene, const format::Container& file) {
  GeometryReport report;
  tools::ChunkReader reader(file);
  const Result<void> done = for_each_mesh(scene, file, [&](uint64_t number, const SourceMesh& source) -> Result<void> {
    const format::MeshRecord& mesh = file.meshes()[number];
    const convert::Primitive& primitive = scene.primitives[source.primitive];
    std::vector<float> normals;
    if ((mesh.attributes & format::kHasNormal) != 0 && primitive.normal) {
      normals.resize(3 * primitive.normal->count);
      SCREE_TRY_AT(scene.file_name, convert::read_floats(*primitive.normal, 0, primitive.normal->count, normals));
    }
    MeshComparison comparison(source, normals, report);
    for (uint64_t c = mesh.first_chunk; c < mesh.first_chunk + mesh.chunk_count; ++c) {
      const auto chunk = SCREE_TRY(
          reader.read(c, tools::kPartIndices | tools::kPartPositions | tools::kPartNormals | tools::kPartSourceIds));
      comparison.add(*chunk);
    }
    const double error = comparison.finish();
    ++report.meshes;
    report.axis_error = std::max(report.axis_error, error);
    report.axis_bound = std::max(report.axis_bound, mesh.max_position_error);
    if (!(error <= mesh.max_position_error)) report.broken.push_back({number, error, mesh.max_position_error});
    return {};
  });
  if (!done) return done.error();
  return report;
}

}  // namespace scree::compare
