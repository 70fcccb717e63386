// Which lattice each mesh's positions lie on.
#pragma once

#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/convert/encode/encode.h"
#include "tools/convert/plan/convert_options.h"
#include "tools/convert/plan/scene_tables.h"

namespace scree::convert {

/// Chooses the lattice of a mesh that shares its step with no other, and writes it into both. Errors as
/// choose_lattices(), and kRange where that would keep the mesh's floats.
Result<void> choose_lattice(const ConvertOptions& options, const SourceScene& scene, MeshPlan& plan,
                            format::MeshRecord& record);

/// Chooses the lattices of `plans` (as tables.meshes), of boxes measured before, and writes them into both. With
/// options.max_error or options.pixel_bound a mesh that no lattice of 24 bits an axis serves keeps its floats. Errors
/// kRange (the primitive named): a lattice that would need more bits; those of read_instances.
Result<void> choose_lattices(const ConvertOptions& options, const SourceScene& scene, const InstancePlan& instances,
                             std::vector<MeshPlan>& plans, format::TableSet& tables);

}  // namespace scree::convert
