// A glTF before and after the way through a .scree file and export, compared piece by piece.
#pragma once

#include <string>
#include <vector>

#include "format/container/container.h"
#include "tools/gltf/source.h"

namespace scree::tests {

/// Everything by which `back` (the export of `packed`, imported) differs from `source` (imported), beyond the errors
/// that `packed` states, one line each; empty where they agree. `packed` was converted from `source` with source ids
/// and drop_nonfinite. Compared: every triangle of every primitive by its source number, its three positions, texture
/// coordinates, colours and normals; nodes, names, hierarchy and world matrices; node instances; materials, textures
/// and the bytes of images; cameras; scenes.
std::vector<std::string> compare_scenes(const convert::SourceScene& source, const format::Container& packed,
                                        const convert::SourceScene& back);

/// All instances of a node; none where it has none or where they cannot be read.
std::vector<format::NodeInstanceRecord> all_instances(const convert::SourceNode& node);

}  // namespace scree::tests
