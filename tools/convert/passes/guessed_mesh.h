// What a primitive will become, as far as its document and its first window say: so that a primitive of any size can be
// encoded while it is being measured.
#pragma once

#include <cstdint>
#include <optional>

#include "tools/convert/plan/mesh_plan.h"

namespace scree::convert {

/// The mesh that `primitive` becomes if it keeps all of its triangles, the box that its document states of its
/// positions is that of the vertices they use, and its colours are all `white`, or not. Nothing where no box is stated
/// or there is no lattice for it.
std::optional<PlannedMesh> guess_mesh(const ConvertOptions& options, const SourceScene& scene, uint32_t primitive,
                                      bool white);

/// Whether a window of it, and colours that are all white so far, or not, can be encoded as a window of `guess`. What
/// can not is none of this mesh.
bool may_be_of(const PlannedMesh& guess, const WindowPlan& window, bool white);

/// Whether windows that were encoded as of `guess` are those of `measured`, byte for byte, what is noted of them too.
bool is_same(const PlannedMesh& guess, const PlannedMesh& measured);

}  // namespace scree::convert
