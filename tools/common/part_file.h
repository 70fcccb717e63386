// A file that takes its name only once it is whole.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "format/result.h"

namespace scree::tools {

/// Writes to "NAME.part"; commit() renames it to NAME, destruction without commit() removes it. Every error is kFile
/// and names the file and what the system said.
class PartFile {
 public:
  PartFile() = default;
  static Result<PartFile> create(std::string path);
  PartFile(PartFile&& other) noexcept;
  PartFile& operator=(PartFile&& other) noexcept;
  ~PartFile();

  /// Thread-safe for ranges that do not overlap; the file grows as far as it is written.
  Result<void> write_at(uint64_t offset, std::span<const std::byte> bytes) const;
  /// Fills `out` with what was written.
  Result<void> read_at(uint64_t offset, std::span<std::byte> out) const;
  /// Sets the size, with zeros behind what is written.
  Result<void> resize(uint64_t bytes) const;
  /// Closes (a full disk may show only now), then commit() renames.
  Result<void> close();
  Result<void> commit();

  bool is_open() const { return file_ >= 0; }
  const std::string& path() const { return path_; }

 private:
  int file_ = -1;
  std::string path_;  // of the finished file; empty: nothing to remove
};

}  // namespace scree::tools
