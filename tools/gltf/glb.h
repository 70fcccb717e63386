// The chunks of a .glb file.
#pragma once

#include <cstdint>

#include "format/result.h"
#include "tools/gltf/source.h"

namespace scree::convert {

struct GlbLayout {
  bool is_glb = false;  // false: the whole file is JSON
  uint64_t json_offset = 0;
  uint64_t json_bytes = 0;
  bool has_bin = false;
  uint64_t bin_offset = 0;
  uint64_t bin_bytes = 0;
};

/// Looks at the header and chunk headers. A file past 4 GiB has its 32-bit lengths modulo 2^32: they are accepted where
/// they agree with the file's size and the binary chunk ends with the file. Chunks of other types are skipped. Errors
/// kFile, kVersion (not version 2), kTruncated, kTrailing, kFormat.
Result<GlbLayout> read_glb_layout(const ByteSource& file);

}  // namespace scree::convert
