// A stream of EXT_meshopt_compression or KHR_meshopt_compression, unpacked some elements at a time. A saved
// MeshoptPlace is enough to continue, so any part can be unpacked again.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>

#include "format/result.h"
#include "tools/gltf/document/document.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// The state of decoding between two elements, from which it can continue.
struct MeshoptPlace {
  uint64_t offset;                   // in the stream: of the next block, triangle data or index
  std::array<std::byte, 328> state;  // of the decoder; each mode has its own
};

const char* mode_name(DocMeshopt::Mode mode);

/// A stream of any mode. Several threads may unpack different parts of it at the same time.
class MeshoptStream {
 public:
  /// Memory of one call of unpack(), in addition to its output.
  static constexpr uint64_t kScratchBytes = 160 << 10;

  /// `stated` has passed check_meshopt(). The stream is [stated.offset, stated.offset + stated.bytes) of `source`.
  static std::unique_ptr<const MeshoptStream> make(const DocMeshopt& stated, std::shared_ptr<const ByteSource> source);

  MeshoptStream(const DocMeshopt& stated, std::shared_ptr<const ByteSource> source)
      : stated_(stated), source_(std::move(source)) {}
  virtual ~MeshoptStream() = default;
  MeshoptStream(const MeshoptStream&) = delete;
  MeshoptStream& operator=(const MeshoptStream&) = delete;

  /// The number of elements that are coded together.
  virtual uint64_t granularity() const = 0;

  /// The state before the first element. Errors: those of reading; kFormat (not a stream of that mode); kUnsupported
  /// (an unknown version); kTruncated.
  Result<MeshoptPlace> begin() const;

  /// Unpacks the out.size() / stride elements from number `first` on. `at`: the state before them; on return the state
  /// after them. Does not undo filters. The number of elements must be a multiple of granularity(), except at the end
  /// of the stream. Errors, after which `at` and `out` are unspecified: those of reading; kTruncated: the stream ends
  /// too early; kTrailing: it continues after the last element. A whole stream gives the same error however it is
  /// divided.
  virtual Result<void> unpack(MeshoptPlace& at, uint64_t first, std::span<std::byte> out) const = 0;

  /// A hint that elements [first, end) will be unpacked soon; `end` is at most the stream's count. The bytes of
  /// elements are assumed to lie evenly in the stream.
  virtual void will_need(uint64_t first, uint64_t end) const;

  /// Undoes the filter of any elements.
  void undo_filter(std::span<std::byte> elements) const;

  /// "buffer view 3: EXT_meshopt_compression", for messages.
  std::string name() const;

  /// The file that contains the stream.
  const std::string& path() const { return source_->path(); }

 protected:
  /// The state before the first element of a stream of that version. Errors: those of reading, kTruncated.
  virtual Result<MeshoptPlace> start(uint32_t version) const = 0;

  const DocMeshopt& stated() const { return stated_; }
  const ByteSource& source() const { return *source_; }
  uint64_t end() const { return stated_.offset + stated_.bytes; }  // in source()
  /// The same hint for a part of the stream, from byte `begin` on, in which the bytes of all elements lie evenly.
  void hint_part(uint64_t begin, uint64_t first, uint64_t end) const;
  Error ends_early() const;
  Error has_more() const;

 private:
  const DocMeshopt stated_;
  const std::shared_ptr<const ByteSource> source_;
};

std::unique_ptr<const MeshoptStream> attribute_stream(const DocMeshopt& stated,
                                                      std::shared_ptr<const ByteSource> source);
std::unique_ptr<const MeshoptStream> triangle_stream(const DocMeshopt& stated,
                                                     std::shared_ptr<const ByteSource> source);
std::unique_ptr<const MeshoptStream> index_stream(const DocMeshopt& stated, std::shared_ptr<const ByteSource> source);

/// Bytes [at, end) of a source, read front to back in pieces.
class PieceReader {
 public:
  static constexpr size_t kPieceBytes = 64 << 10;

  PieceReader(const ByteSource& source, uint64_t at, uint64_t end) : source_(source), next_(at), end_(end) {}

  /// Reads more if fewer than `bytes` (at most kPieceBytes) are buffered and the source has more. Errors: those of
  /// reading.
  Result<void> want(size_t bytes);

  const std::byte* data() const { return bytes_.data() + first_; }
  size_t size() const { return last_ - first_; }
  bool is_at_end() const { return next_ == end_; }  // all bytes are buffered
  void skip(size_t bytes) { first_ += bytes; }
  uint64_t offset() const { return next_ - size(); }  // of data(), in the source

 private:
  const ByteSource& source_;
  uint64_t next_;
  const uint64_t end_;
  size_t first_ = 0, last_ = 0;
  std::array<std::byte, kPieceBytes> bytes_;  // left uninitialised, because it is large
};

}  // namespace scree::convert
