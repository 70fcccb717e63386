// The chunks of a .glb file.
#pragma once

#include <cstdint>
#include <vector>

#include "format/result.h"
#include "tools/gltf/source.h"

namespace scree::convert {

struct GlbChunk {
  bool is_binary = false;  // "BIN"; else JSON, or of a type that is skipped
  uint64_t offset = 0;
  uint64_t bytes = 0;
};

struct GlbLayout {
  bool is_glb = false;  // false: the whole file is JSON
  uint64_t json_offset = 0;
  uint64_t json_bytes = 0;
  std::vector<GlbChunk> chunks;  // all of them, by index
};

/// Looks at the header and chunk headers, of version 2 (glTF 2.0) or 3 (the draft of glTF 2.1: lengths of 64 bits,
/// docs/design.md). A version 2 file past 4 GiB has its 32-bit lengths modulo 2^32: they are accepted where they agree
/// with the file's size and the binary chunk ends with the file. Chunks of other types are skipped. Errors kFile,
/// kVersion, kTruncated, kTrailing, kFormat, kUnsupported (an encoded chunk).
Result<GlbLayout> read_glb_layout(const ByteSource& file);

}  // namespace scree::convert
