// Buffer views that are compressed by EXT_meshopt_compression or KHR_meshopt_compression. Reading unpacks them in
// windows, so that a view may have any size.
#pragma once

#include <cstdint>
#include <memory>

#include "format/result.h"
#include "tools/gltf/document/document.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// Checks the extension's object of a view of `view_bytes` bytes (and byteStride `view_stride`; 0: none). Count,
/// stride, mode and filter must fit each other. There must be no more elements than the stream's bytes can hold, so
/// that a small file cannot require much memory. Errors kFormat, kRange, kTruncated.
Result<void> check_meshopt(const DocMeshopt& stated, uint64_t view_bytes, uint64_t view_stride);

/// The unpacked bytes of a compressed view. A window of them is unpacked when it is read, and again if the cache
/// dropped it. The windows before it must be unpacked once, to find its beginning. Reads have the stream's errors, and
/// kFormat (not such a stream), kUnsupported (an unknown version), kTruncated, kTrailing, kMemory. The first read
/// checks the kind of stream; the read of a window checks that its bytes suffice; the read of the last window checks
/// that the stream ends after it.
class MeshoptView : public ByteSource {
 public:
  /// Each reading thread holds one window, which the cache may drop meanwhile, and the scratch memory of unpacking. The
  /// decoder states at the beginnings of windows are kept.
  virtual PackedViewMemory memory() const = 0;
};

class KeptWindows;

/// Makes such views. They share memory for windows that are kept for the next read: the most recently used ones, up to
/// `kept_bytes`, but at least one. Thread-safe.
class MeshoptCache {
 public:
  static constexpr uint64_t kKeptBytes = uint64_t{1} << 30;
  /// Unpacked size of a window, rounded down to whole elements.
  static constexpr uint64_t kWindowBytes = uint64_t{512} << 10;

  explicit MeshoptCache(uint64_t kept_bytes = kKeptBytes, uint64_t window_bytes = kWindowBytes);

  /// The kept windows, for other sources.
  const std::shared_ptr<KeptWindows>& kept() const { return kept_; }

  /// A view whose stream is [stated.offset, stated.offset + stated.bytes) of `stream`. `stated` has passed
  /// check_meshopt().
  std::shared_ptr<const MeshoptView> view(const DocMeshopt& stated, std::shared_ptr<const ByteSource> stream) const;

 private:
  std::shared_ptr<KeptWindows> kept_;
  const uint64_t window_bytes_;
};

}  // namespace scree::convert
