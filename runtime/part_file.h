// A file that appears all at once or not at all.
#pragma once

#include <cstddef>
#include <cstdio>
#include <span>
#include <string>

#include "format/result.h"

namespace scree::runtime {

/// Writes `path`.part; commit() renames it to `path`. Destroyed before that, it removes the .part and leaves an earlier
/// `path` as it was. Not thread-safe.
class PartFile {
 public:
  /// Errors kFile.
  static Result<PartFile> create(const std::string& path);

  PartFile(PartFile&& other) noexcept;
  PartFile(const PartFile&) = delete;
  PartFile& operator=(const PartFile&) = delete;
  PartFile& operator=(PartFile&&) = delete;
  ~PartFile();

  /// Buffered. A failure is remembered, and commit() reports it; returns whether all is well so far.
  bool write(const void* bytes, size_t size);

  /// Flushes, closes and renames. Errors kFile: the first failure of any write (a full disk).
  Result<void> commit();

 private:
  PartFile(std::string path, std::FILE* file) : path_(std::move(path)), file_(file) {}

  std::string path_;
  std::FILE* file_ = nullptr;
  int failure_ = 0;  // errno of the first failure
};

}  // namespace scree::runtime
