// Upper bounds of the size of a converted file.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "tools/convert/images/images.h"
#include "tools/convert/passes/memory_plan.h"
#include "tools/convert/plan/convert_options.h"
#include "tools/convert/plan/mesh_plan.h"
#include "tools/convert/windows/measure.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// A bound for the geometry. `plans`: by mesh. `mesh_of`: the mesh of each primitive.
uint64_t most_geometry_bytes(const ConvertOptions& options, std::span<const WindowPlan> windows,
                             std::span<const MeshPlan> plans, std::span<const uint32_t> mesh_of);
/// The same from the document alone. `wanted`: by primitive.
uint64_t most_geometry_bytes(const SourceScene& scene, const std::vector<bool>& wanted, const MemoryPlan& memory);

/// A bound for the whole file: the bytes of its parts, and a quarter as a reserve. `geometry`, `masks` and `strings`
/// are the bytes of three of the parts.
uint64_t most_file_bytes(uint64_t geometry, const SourceScene& scene, const ImagePlan& images, uint64_t masks,
                         uint64_t strings);

}  // namespace scree::convert
