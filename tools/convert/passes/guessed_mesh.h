// Predicts the output mesh of a primitive from its document and its first window, so that a primitive of any size can
// be encoded while it is measured.
#pragma once

#include <cstdint>
#include <optional>

#include "tools/convert/plan/mesh_plan.h"

namespace scree::convert {

/// The mesh that `primitive` becomes if it keeps all of its triangles, the box that its document states of its
/// positions is that of the vertices they use, and its colours and normals are like those `so_far`. Nothing where no
/// box is stated or there is no lattice for it.
std::optional<PlannedMesh> guess_mesh(const ConvertOptions& options, const SourceScene& scene, uint32_t primitive,
                                      const Measured& so_far);

/// Whether a window of the primitive can be encoded as a window of `guess`. `so_far`: whether its colours are all white
/// and its normals those of its faces. False means that the guess is wrong.
bool fits_guess(const ConvertOptions& options, const SourceScene& scene, const PlannedMesh& guess,
                const WindowPlan& window, const Measured& so_far);

/// Whether windows encoded for `guess` equal windows for `measured` byte for byte, including their log entries.
bool matches_measured(const PlannedMesh& guess, const PlannedMesh& measured);

}  // namespace scree::convert
