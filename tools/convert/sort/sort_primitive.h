// Sorts a primitive without locality (locality.h) into a copy in a temporary file. The copy's vertices are ordered
// along a space-filling curve, and its triangles in the order of their vertices. The time is proportional to the size
// of the primitive, not to its square, and memory is bounded. Afterwards the copy is treated like any other primitive.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>

#include "format/container/part_file.h"
#include "format/result.h"
#include "tools/convert/windows/measure.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// Resources that sorting takes, computed from the primitive alone. Memory: `shared_bytes`, `thread_bytes` per thread,
/// and up to 4 bytes per vertex for new numbers (`map_bytes`). Less map memory means that triangles are read more
/// often.
struct SortNeeds {
  uint64_t shared_bytes = 0;
  uint64_t thread_bytes = 0;
  uint64_t map_bytes = 0;
  uint64_t kept_file_bytes = 0;  // of the temporary file: the copy
  uint64_t file_bytes = 0;       // the same, including temporary data
};
SortNeeds sort_needs(const Primitive& primitive, uint64_t vertex_count, bool normals);

/// Limits of sorting. The copy is the same for any values.
struct SortLimits {
  uint32_t threads = 1;
  uint64_t map_vertices = UINT64_MAX;  // vertices whose new numbers are in memory at a time; at least 1
};

/// Sorts a primitive into `file` from `offset` on. The result takes SortNeeds::kept_file_bytes, up to the end of the
/// file. The copy is a list of all triangles except the degenerate ones of strips and fans, with the attributes of the
/// source (normals if requested) bit for bit. Primitive::numbers has the source's numbers. Vertices lie along a Morton
/// curve; vertices with equal keys keep the source's order. Triangles are ordered by the middle one of their vertices,
/// then as in the source. `stop`: as for WorkerPool. `progress(done)` counts vertices and triangles, each twice. Errors
/// of reading the source; kFile for the temporary file; kFormat: the source differs from the measured one.
Result<Primitive> sort_primitive(const Primitive& primitive, const ScatteredPrimitive& scattered, bool normals,
                                 const SortLimits& limits, std::shared_ptr<const format::PartFile> file,
                                 uint64_t offset, const std::atomic<bool>* stop,
                                 const std::function<void(uint64_t)>& progress);

}  // namespace scree::convert
