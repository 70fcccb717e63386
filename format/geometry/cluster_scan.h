// A cluster's check without its output, for processors with AVX2: what decode_clusters() finds out, in a quarter of
// its time.
#pragma once

#include <cstddef>
#include <cstdint>

#include "format/geometry/cluster_read.h"

namespace scree::format {

/// What a cluster's data hold. Codes: stored ones with the predicted part added; sums wrap.
struct ClusterScan {
  bool triangles_are_good;  // every distance within what goes before, and the last vertex below vertex_count
  uint32_t largest[3];      // code of each axis
};

namespace isa_avx2 {
#ifdef SCREE_HAS_AVX2_CODE
inline constexpr bool kScansClusters = true;
/// `bytes`: of the chunk's cluster data, from which the reader's layout must not lead out; its widths are within their
/// limits, and the bits after its triangles and positions are zero. Whether `scan` was filled: a cluster with
/// positions wider than 60 bits is not scanned.
bool scan_cluster(const ClusterReader& reader, size_t bytes, ClusterScan& scan);
#else
inline constexpr bool kScansClusters = false;
inline bool scan_cluster(const ClusterReader&, size_t, ClusterScan&) {
  return false;
}
#endif
}  // namespace isa_avx2

}  // namespace scree::format
