// Reads that bypass the page cache, for large files that are read only once.
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
  /// Alignment of offsets, sizes and addresses: the page size, and at least the sector size of existing disks.
  static constexpr uint64_t kAlignment = 4096;

  /// Opens the map's file. Errors, without the file's name: kUnsupported (the file system has no direct reads), kFile.
  static Result<DirectFile> open(const MappedFile& map);

  DirectFile(DirectFile&& other) noexcept;
  DirectFile& operator=(DirectFile&& other) noexcept;
  DirectFile(const DirectFile&) = delete;
  DirectFile& operator=(const DirectFile&) = delete;
  ~DirectFile();

  /// Fills `out` from `offset`; offset, size and address must be multiples of kAlignment. Bytes of `out` past the end
  /// of the file are left unchanged. Returns when the data are read. Errors kUnsupported (not into this memory, not
  /// from this file system), kFile (an I/O error; the file has become shorter).
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

/// Memory with the alignment that DirectFile needs. Throws std::bad_alloc.
inline DirectMemory direct_memory(uint64_t bytes) {
  return DirectMemory(static_cast<std::byte*>(::operator new (bytes, std::align_val_t{DirectFile::kAlignment})));
}

}  // namespace scree::runtime
