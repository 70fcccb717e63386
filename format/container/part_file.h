// A file that takes its name only once it is whole.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "format/result.h"

namespace scree::format {

/// Writes to "NAME.part"; commit() renames it to NAME, destruction without commit() removes it, and an earlier NAME is
/// untouched until then. A .part that another program is busy with is an error, one that was left behind is
/// overwritten. Every error is kFile and names the file and what the system said.
class PartFile {
 public:
  PartFile() = default;
  enum class Content { kEmpty, kAsItIs };
  /// kAsItIs: what an earlier .part holds stays, until it is written over.
  static Result<PartFile> create(const std::string& path, Content content = Content::kEmpty);
  PartFile(PartFile&& other) noexcept;
  PartFile& operator=(PartFile&& other) noexcept;
  ~PartFile() { discard(); }

  /// Thread-safe for ranges that do not overlap; the file grows as far as it is written, with zeros in between.
  Result<void> write_at(uint64_t offset, std::span<const std::byte> bytes) const;
  /// Fills `out` with what was written.
  Result<void> read_at(uint64_t offset, std::span<std::byte> out) const;
  Result<uint64_t> size() const;
  /// Sets the size, with zeros behind what is written.
  Result<void> resize(uint64_t bytes) const;
  /// What was written is on the disk.
  Result<void> sync() const;
  /// Closes before commit(): some file systems find only now that the disk is full. Others may then take the .part.
  Result<void> close();
  Result<void> commit();
  /// Takes the .part's name away at once: what is written lives as long as this does, whatever ends the program.
  Result<void> hide();
  /// From now on discard() leaves the .part where it is, for another create() to take over.
  void keep() { is_kept_ = true; }
  /// Removes the .part, if it has not got its name and is not to be kept, and closes it. Takes no memory: it may be
  /// what ran out.
  void discard() noexcept;

  bool is_open() const { return file_ >= 0; }
  /// Of the finished file.
  const std::string& path() const { return path_; }

 private:
  Error error_of(const char* call, int error) const;
  Error not_open() const { return {ErrorCode::kFile, part_path_ + ": is not open any more"}; }

  int file_ = -1;
  bool is_part_ = false;  // there is a .part to be removed
  bool is_kept_ = false;
  std::string path_;
  std::string part_path_;
};

}  // namespace scree::format
