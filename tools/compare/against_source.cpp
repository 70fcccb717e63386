#include "tools/compare/against_source.h"

#include <array>
#include <cmath>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "runtime/draw/pick.h"
#include "runtime/threads/parallel.h"
#include "tools/compare/reference.h"
#include "tools/compare/reference_shade.h"

namespace scree::compare {
namespace {

/// A triangle of an instance.
struct Place {
  uint32_t instance;
  uint64_t triangle;
};

class Judge {
 public:
  Judge(const SourceModel& model, const kernels::View& view) : model_(model), view_(view) {}

  PixelKind kind(const Place& drawn, const ReferencePixel& expected, uint32_t x, uint32_t y) const {
    if (drawn.instance == expected.instance && drawn.triangle == expected.triangle) return PixelKind::kSame;
    const ReferenceInstance& instance = model_.instances[drawn.instance];
    const std::optional<double> depth =
        reference_depth(model_.views[instance.mesh], instance, drawn.triangle, view_, x, y);
    if (depth && std::abs(*depth - expected.depth) <= kCoincidence * std::abs(expected.depth))
      return PixelKind::kCoincident;
    if (drawn.instance != expected.instance) return PixelKind::kOtherMesh;
    return share_vertex(corners(instance.mesh, drawn.triangle), corners(instance.mesh, expected.triangle))
               ? PixelKind::kNeighbour
               : PixelKind::kApart;
  }

 private:
  std::array<std::array<float, 3>, 3> corners(uint32_t mesh_number, uint64_t triangle) const {
    const SourceMesh& mesh = model_.meshes[mesh_number];
    std::array<std::array<float, 3>, 3> out{};
    for (size_t n = 0; n < 3; ++n)
      for (size_t axis = 0; axis < 3; ++axis)
        out[n][axis] = mesh.positions[3 * uint64_t{mesh.corners[3 * triangle + n]} + axis];
    return out;
  }

  const SourceModel& model_;
  const kernels::View& view_;
};

/// Classifies all pixels. Threads process rows; the sums of errors are added row by row, so the number of threads does
/// not change them. `found(x, y)`: a Result of the triangle drawn there; instance kNone for the background.
template <class Find>
Result<PixelReport> judge_pixels(const SourceModel& model, std::span<const ReferencePixel> reference,
                                 const kernels::View& view, uint32_t threads, const Find& found) try {
  struct Row {
    DepthError same, surface;
    std::optional<Error> failed;
  };
  PixelReport report{.width = view.width, .height = view.height};
  report.kinds.resize(reference.size());
  const Judge judge(model, view);
  std::vector<Row> rows(view.height);
  runtime::parallel_for(view.height, threads, [&](uint64_t row_number) {
    const auto y = static_cast<uint32_t>(row_number);
    Row& row = rows[y];
    for (uint32_t x = 0; x < view.width; ++x) {
      const uint64_t at = uint64_t{y} * view.width + x;
      const ReferencePixel& expected = reference[at];
      const Result<ReferencePixel> drawn = found(x, y);
      if (!drawn) {
        row.failed = drawn.error();
        return;
      }
      PixelKind& kind = report.kinds[at];
      if (drawn->is_background() || expected.is_background()) {
        kind = drawn->is_background() && expected.is_background() ? PixelKind::kBothBackground : PixelKind::kBackground;
        continue;
      }
      kind = judge.kind({drawn->instance, drawn->triangle}, expected, x, y);
      row.surface.add(drawn->depth, expected.depth);
      if (kind == PixelKind::kSame) row.same.add(drawn->depth, expected.depth);
    }
  });
  for (const Row& row : rows) {
    if (row.failed) return *row.failed;
    report.same_depth.add(row.same);
    report.surface_depth.add(row.surface);
  }
  return report;
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left to compare pictures"};
}

/// Shades a frame like the reference: by the faces' normals, even if the file has vertex normals. Throws
/// std::bad_alloc.
Result<std::vector<uint8_t>> shade_faces(const runtime::Scene& scene, const kernels::View& view,
                                         std::span<const uint64_t> samples, uint32_t threads) {
  kernels::SceneView faces = scene.view();
  std::vector<format::MeshRecord> meshes(faces.meshes, faces.meshes + faces.mesh_count);
  // Clearing the flag is enough, because the stream of normals comes after all streams that are read here.
  for (format::MeshRecord& mesh : meshes) mesh.attributes &= ~uint32_t{format::kHasNormal};
  faces.meshes = meshes.data();
  std::vector<uint8_t> pixels(uint64_t{3} * view.width * view.height);
  SCREE_TRY(kernels::resolve_cpu(faces, view, 1, samples, shading_of_reference(), 3, pixels, threads));
  return pixels;
}

}  // namespace

Result<PixelReport> compare_frame(const runtime::Scene& scene, std::span<const uint64_t> samples,
                                  const SourceModel& model, std::span<const ReferencePixel> expected,
                                  const kernels::View& view, uint32_t threads) {
  return judge_pixels(model, expected, view, threads, [&](uint32_t x, uint32_t y) -> Result<ReferencePixel> {
    const std::optional<runtime::Pick> picked =
        SCREE_TRY(runtime::pick_sample(scene, view, samples[uint64_t{y} * view.width + x]));
    if (!picked) return ReferencePixel{};
    const runtime::Pick& pick = *picked;
    // Scene and source were matched when the model was loaded, but source triangle numbers are checked only here.
    if (!pick.source_triangle || *pick.source_triangle >= model.meshes[pick.mesh].kept.size())
      return Error{ErrorCode::kRange, "mesh " + std::to_string(pick.mesh) + ": triangle " +
                                          std::to_string(pick.mesh_triangle) + " has no triangle in the source"};
    return ReferencePixel{static_cast<uint32_t>(pick.hit.instance), *pick.source_triangle, pick.depth};
  });
}

Result<PixelReport> compare_references(std::span<const ReferencePixel> found, const SourceModel& model,
                                       std::span<const ReferencePixel> expected, const kernels::View& view,
                                       uint32_t threads) {
  return judge_pixels(model, expected, view, threads, [&](uint32_t x, uint32_t y) -> Result<ReferencePixel> {
    return found[uint64_t{y} * view.width + x];
  });
}

kernels::ShadeOptions shading_of_reference() {
  kernels::ShadeOptions options;
  options.show = kernels::Show::kColor;
  options.background[3] = 1;
  options.blend_layers = 0;
  return options;
}

Result<SourceReport> compare_with_source(const runtime::Scene& scene, const SourceModel& model,
                                         const kernels::View& view, double pixels_per_degree, uint32_t threads) try {
  std::vector<uint64_t> samples(uint64_t{view.width} * view.height);
  SCREE_TRY(kernels::draw_cpu(scene.view(), view, samples, threads));
  const std::vector<ReferencePixel> reference = SCREE_TRY(draw_reference(model.views, model.instances, view, threads));
  PixelReport pixels = SCREE_TRY(compare_frame(scene, samples, model, reference, view, threads));
  const std::vector<uint8_t> expected = SCREE_TRY(shade_reference(model, reference, view, 1, threads));
  const std::vector<uint8_t> picture = SCREE_TRY(shade_faces(scene, view, samples, threads));
  return SourceReport{std::move(pixels), compare_rgb({view.width, view.height, picture},
                                                     {view.width, view.height, expected}, pixels_per_degree, threads)};
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left to compare pictures"};
}

}  // namespace scree::compare
