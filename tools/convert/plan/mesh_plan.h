// The output mesh of a measured primitive, before its lattice is chosen.
#pragma once

#include <cstdint>

#include "format/layout.h"
#include "tools/convert/encode/encode.h"
#include "tools/convert/plan/convert_options.h"
#include "tools/convert/windows/measure.h"
#include "tools/gltf/source.h"

namespace scree::convert {

struct PlannedMesh {
  MeshPlan plan;
  format::MeshRecord record{};  // its material and group as in SourceScene
};

/// format::AttributeFlags of the streams that a primitive has in the file.
uint32_t stored_attributes(const ConvertOptions& options, const Primitive& source, const Measured& measured);

/// `is_sorted`: its windows come from a sorted copy.
PlannedMesh plan_mesh(const ConvertOptions& options, const SourceScene& scene, uint32_t primitive,
                      const Measured& measured, bool is_sorted);

}  // namespace scree::convert
