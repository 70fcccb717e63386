// A primitive whose triangles lie in no order (locality.h) becomes a copy in a temporary file, whose vertices lie along
// a space-filling curve and whose triangles follow them. Time grows with the primitive, not with its square, and memory
// is bounded. From then on the copy is a primitive like any other.
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

/// What sorting takes, reckoned from the primitive alone. Memory: `shared_bytes`, `thread_bytes` for every thread, and
/// up to 4 bytes a vertex for their new numbers (`map_bytes`), or less where the triangles may be read more often.
struct SortNeeds {
  uint64_t shared_bytes = 0;
  uint64_t thread_bytes = 0;
  uint64_t map_bytes = 0;
  uint64_t kept_file_bytes = 0;  // of the temporary file: the copy
  uint64_t file_bytes = 0;       // and with what is there while it is made
};
SortNeeds sort_needs(const Primitive& primitive, uint64_t vertex_count, bool normals);

/// What may be used; the copy is the same for any.
struct SortLimits {
  uint32_t threads = 1;
  uint64_t map_vertices = UINT64_MAX;  // whose new numbers are in memory at a time; at least 1
};

/// Sorts a primitive into `file` from `offset` on, which takes SortNeeds::kept_file_bytes there afterwards, at the end
/// of the file. The copy is a list of all triangles but the degenerate ones of strips and fans, with the attributes of
/// the source (normals if asked for) bit for bit; Primitive::numbers tells the source's numbers. Vertices lie along a
/// Morton curve, those it hardly tells apart as in the source; triangles by the middle one of their vertices, then as
/// in the source. `stop`: as WorkerPool's. `progress(done)`: vertices and triangles, in all twice their number. Errors:
/// those of reading the source; kFile for the temporary file; kFormat: the source is not what was measured.
Result<Primitive> sort_primitive(const Primitive& primitive, const ScatteredPrimitive& scattered, bool normals,
                                 const SortLimits& limits, std::shared_ptr<const format::PartFile> file,
                                 uint64_t offset, const std::atomic<bool>* stop,
                                 const std::function<void(uint64_t)>& progress);

}  // namespace scree::convert
