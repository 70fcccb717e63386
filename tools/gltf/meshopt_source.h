// Buffer views that are compressed by EXT_meshopt_compression or KHR_meshopt_compression: their bytes, unpacked in
// windows when they are read, so that a view may be of any size.
#pragma once

#include <cstdint>
#include <memory>

#include "format/result.h"
#include "tools/gltf/document.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// Checks what the extension says of a view of `view_bytes` bytes (and byteStride `view_stride`, 0: none): count,
/// stride, mode and filter that go together, and no more elements than the stream's bytes can hold, so that a small
/// file cannot ask for much memory. Errors kFormat, kRange, kTruncated.
Result<void> check_meshopt(const DocMeshopt& stated, uint64_t view_bytes, uint64_t view_stride);

/// The unpacked bytes of a compressed view. A window of them is unpacked when it is read, and again where the cache let
/// it go; the windows before it have to be unpacked once, since only that tells where it begins. Reads have, beside the
/// stream's errors, kFormat (no such stream), kUnsupported (a version that is not read), kTruncated, kTrailing,
/// kMemory. That it is such a stream is checked at the first read; that its bytes last for a window when that is read;
/// that they end behind the last window, when that is.
class MeshoptView : public ByteSource {
 public:
  /// A thread that reads holds a window, whose place among those that are kept another may have taken, and what
  /// unpacking takes; where each window begins stays.
  virtual PackedViewMemory memory() const = 0;
};

class KeptWindows;

/// Makes such views. They share the memory for windows that are kept for the next read: the ones used last, up to
/// `kept_bytes`, or one. Thread-safe.
class MeshoptCache {
 public:
  static constexpr uint64_t kKeptBytes = uint64_t{1} << 30;
  /// Unpacked, and less where elements do not fill it.
  static constexpr uint64_t kWindowBytes = uint64_t{512} << 10;

  explicit MeshoptCache(uint64_t kept_bytes = kKeptBytes, uint64_t window_bytes = kWindowBytes);

  /// Where the windows are kept, for other sources.
  const std::shared_ptr<KeptWindows>& kept() const { return kept_; }

  /// A view whose stream is [stated.offset, stated.offset + stated.bytes) of `stream`. `stated` has passed
  /// check_meshopt().
  std::shared_ptr<const MeshoptView> view(const DocMeshopt& stated, std::shared_ptr<const ByteSource> stream) const;

 private:
  std::shared_ptr<KeptWindows> kept_;
  const uint64_t window_bytes_;
};

}  // namespace scree::convert
