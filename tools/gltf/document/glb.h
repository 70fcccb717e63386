// The chunks of a .glb file.
#pragma once

#include <cstdint>
#include <vector>

#include "format/result.h"
#include "tools/gltf/source.h"

namespace scree::convert {

struct GlbChunk {
  bool is_binary = false;  // "BIN"; otherwise JSON, or a type that is skipped
  uint64_t offset = 0;
  uint64_t bytes = 0;
};

struct GlbLayout {
  bool is_glb = false;  // false: the whole file is JSON
  uint64_t json_offset = 0;
  uint64_t json_bytes = 0;
  std::vector<GlbChunk> chunks;  // all chunks, by index
};

/// Reads the header and chunk headers, of version 2 (glTF 2.0) or 3 (the draft of glTF 2.1: lengths of 64 bits,
/// docs/import.md). In a version 2 file above 4 GiB the 32-bit lengths are modulo 2^32. They are accepted if they
/// agree with the file's size and the binary chunk ends with the file. Chunks of other types are skipped. Errors kFile,
/// kVersion, kTruncated, kTrailing, kFormat, kUnsupported (an encoded chunk).
Result<GlbLayout> read_glb_layout(const ByteSource& file);

}  // namespace scree::convert
