#include "tools/compare/against_source.h"

#include <array>
#include <cmath>
#include <optional>
#include <string>

#include "runtime/renderer.h"
#include "tools/compare/reference.h"

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

}  // namespace

Result<PixelReport> compare_with_source(const runtime::Scene& scene, const SourceModel& model,
                                        const kernels::View& view, uint32_t threads) {
  const Result<runtime::Frame> frame = runtime::Frame::draw(scene, view, 1, threads);
  if (!frame) return frame.error();
  const Result<std::vector<ReferencePixel>> reference = draw_reference(model.views, model.instances, view, threads);
  if (!reference) return reference.error();

  PixelReport report;
  report.width = view.width;
  report.height = view.height;
  report.kinds.resize(reference->size());
  const Judge judge(model, view);
  for (uint32_t y = 0; y < view.height; ++y) {
    for (uint32_t x = 0; x < view.width; ++x) {
      const uint64_t at = uint64_t{y} * view.width + x;
      const ReferencePixel& expected = (*reference)[at];
      const Result<std::optional<runtime::Pick>> picked = frame->pick(x, y);
      if (!picked) return picked.error();
      const std::optional<runtime::Pick>& pick = *picked;
      PixelKind& kind = report.kinds[at];
      if (!pick || expected.is_background()) {
        kind = pick || !expected.is_background() ? PixelKind::kBackground : PixelKind::kBothBackground;
        continue;
      }
      // The files were matched when the model was loaded; the numbers inside a chunk are checked only here.
      if (!pick->source_triangle || *pick->source_triangle >= model.meshes[pick->mesh].kept.size())
        return Error{ErrorCode::kRange, "mesh " + std::to_string(pick->mesh) + ": triangle " +
                                            std::to_string(pick->mesh_triangle) + " has no triangle in the source"};
      kind = judge.kind({static_cast<uint32_t>(pick->hit.instance), *pick->source_triangle}, expected, x, y);
      report.surface_depth.add(pick->depth, expected.depth);
      if (kind == PixelKind::kSame) report.same_depth.add(pick->depth, expected.depth);
    }
  }
  return report;
}

}  // namespace scree::compare
