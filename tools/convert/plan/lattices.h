// Chooses the lattice of each mesh's positions.
#pragma once

#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/convert/encode/encode.h"
#include "tools/convert/plan/convert_options.h"
#include "tools/convert/plan/scene_tables.h"

namespace scree::convert {

/// Chooses the lattice of a mesh that shares its step with no other, and writes it into `plan` and `record`. Errors as
/// choose_lattices(), and kRange if that function would keep the mesh's floats.
Result<void> choose_lattice(const ConvertOptions& options, const SourceScene& scene, MeshPlan& plan,
                            format::MeshRecord& record);

/// Chooses the lattices of `plans` (in the order of tables.meshes), whose boxes were measured before, and writes them
/// into `plans` and `tables`. With options.max_error or options.pixel_bound, a mesh keeps its floats if no lattice of
/// 24 bits per axis keeps the bound. Errors kRange (with the primitive): a lattice would need more bits; errors of
/// read_instances.
Result<void> choose_lattices(const ConvertOptions& options, const SourceScene& scene, const InstancePlan& instances,
                             std::vector<MeshPlan>& plans, format::TableSet& tables);

}  // namespace scree::convert
