// Reads past the page cache, for files that are too big to go through it once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <span>

#include "format/result.h"
#include "runtime/files/mapped_file.h"

namespace scree::runtime {

/// The file of a MappedFile, opened again with O_DIRECT. Move-only; reading is thread-safe.
class DirectFile {
 public:
  /// What offsets, sizes and addresses are multiples of: page size and sector size of the disks there are.
  static constexpr uint64_t kAlignment = 4096;

  /// Errors, without the file's name: kUnsupported (the file system has no such reads), kFile.
  static Result<DirectFile> open(const MappedFile& map);

  DirectFile(DirectFile&& other) noexcept;
  DirectFile& operator=(DirectFile&& other) noexcept;
  DirectFile(const DirectFile&) = delete;
  DirectFile& operator=(const DirectFile&) = delete;
  ~DirectFile();

  /// Fills `out` from `offset`; all of kAlignment. What of `out` lies past the end of the file is left as it is.
  /// Returns when it is read. Errors kUnsupported (not into this memory, not from this file system), kFile (an I/O
  /// error; the file has become shorter).
  Result<void> read(uint64_t offset, std::span<std::byte> out) const;

 private:
  DirectFile() = default;

  int descriptor_ = -1;
  uint64_t size_ = 0;
};

struct FreeDirectMemory {
  void operator()(std::byte* memory) const { ::operator delete (memory, std::align_val_t{DirectFile::kAlignment}); }
};
using DirectMemory = std::unique_ptr<std::byte, FreeDirectMemory>;

/// Memory that DirectFile reads into, aligned as it wants. Throws std::bad_alloc.
inline DirectMemory direct_memory(uint64_t bytes) {
  return DirectMemory(static_cast<std::byte*>(::operator new (bytes, std::align_val_t{DirectFile::kAlignment})));
}

}  // namespace scree::runtime
