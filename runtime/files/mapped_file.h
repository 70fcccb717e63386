// A file of any size as read-only memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "format/result.h"

namespace scree::runtime {

/// How a mapped file will be read; the kernel's read-ahead follows.
enum class Access {
  kNormal,
  kSequential,  // front to back, once
  kRandom,      // no read-ahead: small reads all over a file that need not fit in memory
};

/// kFile: what reading finds of a file that ends at `end` and had `size` bytes when it was opened.
Error ends_early(uint64_t end, uint64_t size);

/// A read-only, private map of a whole file. The file must not shrink while it is mapped: touching pages past its new
/// end raises SIGBUS, which the tools turn into an error (tools/common/sigbus.h), and what is gone of the page in which
/// it ends now reads as zeros (check_size() tells). Move-only; reading is thread-safe.
class MappedFile {
 public:
  /// Maps `path`; an empty file gives an empty span. The span starts page-aligned. Errors kFile (missing, unreadable,
  /// not a regular file), kMemory (no address space); the message is "path: reason".
  static Result<MappedFile> open(const std::string& path, Access access = Access::kNormal);

  MappedFile() = default;
  MappedFile(MappedFile&& other) noexcept;
  MappedFile& operator=(MappedFile&& other) noexcept;
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;
  ~MappedFile();

  std::span<const std::byte> bytes() const { return {data_, static_cast<size_t>(size_)}; }
  uint64_t size() const { return size_; }
  const std::string& path() const { return path_; }

  /// Of the open file; -1 where there is none.
  int descriptor() const { return descriptor_; }

  /// Which share of the file's memory pages is in the page cache, 0 to 1, by looking at a few hundred of them. 1 for an
  /// empty file, and where the system does not tell.
  double cached_share() const;

  /// Whether mincore() tells the truth about the file: since Linux 5.2 it reports every page as cached to a caller who
  /// neither owns the file nor may write it.
  bool mincore_is_true() const;

  /// Fills `out` from `offset`, all of it within the file, by read(): through the page cache, but not through the map,
  /// so that nothing is faulted in, and a file that has become shorter is an error and no signal. Errors kFile, without
  /// the file's name.
  Result<void> read(uint64_t offset, std::span<std::byte> out) const;

  /// Whether the file still has the bytes that are mapped, or more. Asked once they were read, so that none of them was
  /// a zero in place of what was cut off. Errors kFile, without the file's name: it is shorter, or the system does not
  /// say.
  Result<void> check_size() const;

  /// Asks for [offset, offset + size) to be read ahead; clipped to the file. A hint: nothing is reported.
  void will_need(uint64_t offset, uint64_t size) const;

  /// Says that [offset, offset + size) will not be read again soon, so that it no longer counts as resident. Only whole
  /// pages inside the range are let go.
  void release(uint64_t offset, uint64_t size) const;

 private:
  void unmap();

  const std::byte* data_ = nullptr;
  uint64_t size_ = 0;
  int descriptor_ = -1;
  std::string path_;
};

}  // namespace scree::runtime
