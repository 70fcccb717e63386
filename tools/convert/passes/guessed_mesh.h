// Predicts the output mesh of a primitive from its document and its first window, so that a primitive of any size can
// be encoded while it is measured.
#pragma once

#include <cstdint>
#include <optional>

#include "tools/convert/plan/mesh_plan.h"

namespace scree::convert {

/// The mesh that `primitive` becomes if it keeps all of its triangles, if the box in its document is the box of the
/// vertices in use, and if the rest of its colours and normals is like the part measured `so_far`. Nothing if the
/// document states no box, or there is no lattice for it.
std::optional<PlannedMesh> guess_mesh(const ConvertOptions& options, const SourceScene& scene, uint32_t primitive,
                                      const Measured& so_far);

/// Whether a window of the primitive can be encoded as a window of `guess`. `so_far`: shows whether all its colours are
/// white and all its normals equal the faces'. False means that the guess is wrong.
bool fits_guess(const ConvertOptions& options, const SourceScene& scene, const PlannedMesh& guess,
                const WindowPlan& window, const Measured& so_far);

/// Whether windows encoded for `guess` equal windows for `measured` byte for byte, including their log entries.
bool matches_measured(const PlannedMesh& guess, const PlannedMesh& measured);

}  // namespace scree::convert
