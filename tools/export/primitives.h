// The geometry of an export: reserves the buffer ranges of each mesh's accessors, and writes their data.
#pragma once

#include <cstdint>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/export/export.h"
#include "tools/gltf/write/writer.h"

namespace scree::tools {

/// A mesh as accessors of the document, or a part of it if glTF's 32-bit indices do not suffice for the whole.
struct ExportedPrimitive {
  uint32_t mesh = 0;
  bool has_uv = false;
  bool has_second_uv = false;
  uint64_t vertices = 0;
  uint64_t triangles = 0;
  GltfPrimitive primitive;  // without its material
};

/// Decodes every chunk of `file` with options.threads threads into the buffer of `writer` and adds views and accessors.
/// Results are in the order of the meshes; meshes without triangles have none. A mesh is cut between chunks before its
/// vertices exceed `max_vertices` (at most 2^32 - 1: glTF reserves the largest index). Errors as ChunkReader and
/// GltfWriter.
Result<std::vector<ExportedPrimitive>> write_primitives(const format::Container& file, GltfWriter& writer,
                                                        const ExportOptions& options, uint64_t max_vertices);

}  // namespace scree::tools
