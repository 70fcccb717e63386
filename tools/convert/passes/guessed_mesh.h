// Predicts the output mesh of a primitive from its document and its first window, so that a primitive of any size can
// be encoded while it is measured.
#pragma once

#include <cstdint>
#include <optional>

#include "tools/convert/plan/mesh_plan.h"

namespace scree::convert {

/// The mesh of `primitive` under these assumptions: it keeps all triangles, the box in its document is the box of the
/// vertices they use, and its colours are all white or not, as in `white`. Nullopt if the document has no box, or there
/// is no lattice for the box.
std::optional<PlannedMesh> guess_mesh(const ConvertOptions& options, const SourceScene& scene, uint32_t primitive,
                                      bool white);

/// Whether a window of the primitive can be encoded as a window of `guess`. `white`: whether all colours so far are
/// white. False means that the guess is wrong.
bool fits_guess(const PlannedMesh& guess, const WindowPlan& window, bool white);

/// Whether windows encoded for `guess` equal windows for `measured` byte for byte, including their log entries.
bool matches_measured(const PlannedMesh& guess, const PlannedMesh& measured);

}  // namespace scree::convert
