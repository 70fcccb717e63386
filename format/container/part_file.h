// A file that takes its name only once it is whole.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "format/result.h"

namespace scree::format {

/// What happens to a file that already has the name of one to be written.
enum class Existing { kReplace, kRefuse };

/// Writes to "NAME.part"; commit() renames it to NAME, destruction without commit() removes it, and an earlier NAME is
/// untouched until then. The .part is locked (flock) from create() until it has its name or is removed: one that
/// another program holds is an error, one that was left behind is overwritten. Where NAME is a symbolic link to a file,
/// that file is replaced and the link stays; a replaced file passes its permissions on. Every error is kFile and names
/// the file and what the system said.
class PartFile {
 public:
  PartFile() = default;
  enum class Content { kEmpty, kAsItIs };
  /// kAsItIs: what an earlier .part holds stays, until it is written over. kRefuse: a file called `path`, now or at
  /// commit(), is an error and stays as it is.
  static Result<PartFile> create(const std::string& path, Content content = Content::kEmpty,
                                 Existing existing = Existing::kReplace);
  /// The file that `path` stands for: the target of a symbolic link, where that is there, else `path`.
  static std::string target_of(const std::string& path);
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
  /// Syncs and closes, so that many files can wait for their commit() without a descriptor each. The lock is given up
  /// until then: commit() refuses, and discard() leaves alone, a .part that another program has taken meanwhile.
  Result<void> park();
  /// Syncs, renames and then closes: the lock is held until the name is taken, so that the name never stands for
  /// another program's half-written file, nor for data that a power cut would lose.
  Result<void> commit();
  /// Takes the .part's name away at once: what is written lives as long as this does, whatever ends the program.
  Result<void> hide();
  /// From now on discard() leaves the .part where it is, for another create() to take over.
  void keep() { is_kept_ = true; }
  /// Removes the .part, if it has not got its name and is not to be kept, and closes it. Takes no memory: it may be
  /// what ran out.
  void discard() noexcept;

  bool is_open() const { return file_ >= 0; }
  /// commit() has renamed it, even if it then failed to close it.
  bool has_name() const { return has_name_; }
  /// commit() found the name taken, with Existing::kRefuse.
  bool is_refused() const { return is_refused_; }
  /// Of the finished file.
  const std::string& path() const { return path_; }
  const std::string& part_path() const { return part_path_; }

 private:
  /// Tells a parked .part from one that another program has opened, emptied or replaced since.
  struct Parked {
    uint64_t device;
    uint64_t inode;
    int64_t bytes;
    int64_t changed_s;
    int64_t changed_ns;
    bool operator==(const Parked&) const = default;
  };

  Error error_of(const char* call, int error) const;
  Error not_open() const { return {ErrorCode::kFile, part_path_ + ": is not open any more"}; }
  bool reopen() noexcept;
  Result<void> take_name();
  Result<void> take_free_name();

  int file_ = -1;
  bool is_part_ = false;  // there is a .part to be removed
  bool is_kept_ = false;
  bool is_parked_ = false;
  bool has_name_ = false;
  bool is_refused_ = false;
  Existing existing_ = Existing::kReplace;
  int mode_ = -1;  // permissions of the file to be replaced; -1: there is none
  Parked parked_{};
  std::string path_;
  std::string part_path_;
};

}  // namespace scree::format
