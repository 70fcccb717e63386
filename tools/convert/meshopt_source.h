// Buffer views that are compressed by EXT_meshopt_compression or KHR_meshopt_compression: their bytes, unpacked.
#pragma once

#include <cstdint>
#include <memory>

#include "format/result.h"
#include "tools/convert/gltf_document.h"
#include "tools/convert/gltf_source.h"

namespace scree::convert {

/// Checks what the extension says of a view of `view_bytes` bytes (and byteStride `view_stride`, 0: none): count,
/// stride, mode and filter that go together, and no more elements than the stream's bytes can hold, so that a small
/// file cannot ask for much memory. Errors kFormat, kRange, kTruncated, kUnsupported.
Result<void> check_meshopt(const DocMeshopt& stated, uint64_t view_bytes, uint64_t view_stride);

class KeptViews;

/// Unpacked views that are kept for the next read: the ones used last, up to kKeptBytes of them (one that is larger
/// alone). Those that are being read are held by their readers. Thread-safe.
class MeshoptCache {
 public:
  static constexpr uint64_t kKeptBytes = uint64_t{1} << 30;

  explicit MeshoptCache(uint64_t kept_bytes = kKeptBytes);

  /// The unpacked bytes of a view whose stream is [stated.offset, stated.offset + stated.bytes) of `stream`. `stated`
  /// has passed check_meshopt(). They are unpacked as a whole when they are first read, and again where the cache let
  /// them go. Its reads have, beside the stream's errors, kFormat (no such stream), kTruncated, kTrailing, kMemory,
  /// kUnsupported (a version this meshoptimizer does not read).
  std::shared_ptr<const ByteSource> source(const DocMeshopt& stated, std::shared_ptr<const ByteSource> stream);

 private:
  std::shared_ptr<KeptViews> kept_;
};

}  // namespace scree::convert
