// A file of any size as read-only memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include <sys/stat.h>

#include "format/result.h"

namespace scree::runtime {

/// The access pattern of a mapped file, which sets the kernel's read-ahead.
enum class Access {
  kNormal,
  kSequential,  // front to back, once
};

/// A kFile error: the file ends at `end`, but had `size` bytes when it was opened.
Error ends_early(uint64_t end, uint64_t size);

/// A read-only, private map of a whole file. The file must not change while it is mapped. Reading pages past its new
/// end raises SIGBUS, which the tools turn into an error (tools/common/process/sigbus.h). In the page that contains the
/// new end, lost bytes read as zeros; check_unchanged() detects that. Move-only; reading is thread-safe.
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

  /// Descriptor of the open file, or -1.
  int descriptor() const { return descriptor_; }

  /// The share of the file's pages that are in the page cache, 0 to 1, estimated from a few hundred of them. 1 for an
  /// empty file, and if the system does not report it.
  double cached_share() const;

  /// Whether mincore() is right about the file. Since Linux 5.2 it reports every page as cached to a caller that
  /// neither owns the file nor may write it.
  bool mincore_is_true() const;

  /// Fills `out` from `offset`, all of it within the file, by read(). This uses the page cache but not the map. So
  /// there are no page faults, and a file that has become shorter is an error, not a signal. Errors kFile, without the
  /// file's name.
  Result<void> read(uint64_t offset, std::span<std::byte> out) const;

  /// Checks that the file is as it was when it was opened. Call it after reading the mapped bytes: a byte that was cut
  /// off reads as zero, and a byte that was overwritten has its new value. Errors kFile, without the file's name: the
  /// file is shorter, its contents have a later time of change, or fstat() fails.
  Result<void> check_unchanged() const;

  /// Whether the file ends before the mapped bytes now.
  bool is_shorter() const;

  /// Asks the system to read [offset, offset + size) ahead; clipped to the file. A hint: failures are not reported.
  void will_need(uint64_t offset, uint64_t size) const;

  /// Drops [offset, offset + size) from resident memory; call it for bytes that will not be read again soon. Only whole
  /// pages inside the range are dropped.
  void release(uint64_t offset, uint64_t size) const;

 private:
  void unmap();

  const std::byte* data_ = nullptr;
  uint64_t size_ = 0;
  struct stat opened_ {};
  int descriptor_ = -1;
  std::string path_;
};

}  // namespace scree::runtime
