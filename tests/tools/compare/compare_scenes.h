// Compares a glTF with its export from a .scree file, item by item.
#pragma once

#include <string>
#include <vector>

#include "format/container/container.h"
#include "tools/gltf/source.h"

namespace scree::tests {

/// All differences between `back` (the export of `packed`, imported) and `source` (imported) that exceed the errors
/// stated by `packed`, one line each; empty if they agree. `packed` was converted from `source` with source ids and
/// drop_nonfinite. The comparison covers every triangle of every primitive by its source number, with its three
/// positions, texture coordinates, colours and normals; nodes, names, hierarchy and world matrices; node instances;
/// materials, textures and the bytes of images; cameras; scenes.
std::vector<std::string> compare_scenes(const convert::SourceScene& source, const format::Container& packed,
                                        const convert::SourceScene& back);

/// All instances of a node; empty if it has none or they cannot be read.
std::vector<format::NodeInstanceRecord> all_instances(const convert::SourceNode& node);

}  // namespace scree::tests
