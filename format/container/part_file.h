// A file that takes its name only once it is complete.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "format/result.h"

namespace scree::format {

/// How to treat an existing file that has the name of the one to be written.
enum class Existing { kReplace, kRefuse };

/// Removes the open .part files of this process, except kept ones. For a program that is about to end without its
/// destructors (std::terminate, a second signal). Makes only calls that POSIX allows in signal handlers.
void remove_open_parts() noexcept;

/// Writes to "NAME.part". commit() renames it to NAME; destruction without commit() removes it. An earlier NAME is
/// untouched until then. The .part is locked (flock) from create() until it has its name or is removed. A .part that
/// another program has locked is an error; a .part left behind is overwritten. If NAME is a symbolic link to a file,
/// that file is replaced and the link stays. A replaced file passes on its permissions. Every error is kFile and gives
/// the file and the system's message.
class PartFile {
 public:
  PartFile() = default;
  enum class Content { kEmpty, kAsItIs };
  /// kAsItIs: the content of an earlier .part stays until it is overwritten. kRefuse: a file called `path`, now or at
  /// commit(), is an error and stays as it is.
  static Result<PartFile> create(const std::string& path, Content content = Content::kEmpty,
                                 Existing existing = Existing::kReplace);
  /// The file that `path` refers to: the target of a symbolic link if that exists, else `path`.
  static std::string target_of(const std::string& path);
  PartFile(PartFile&& other) noexcept;
  PartFile& operator=(PartFile&& other) noexcept;
  ~PartFile() { discard(); }

  /// Thread-safe for ranges that do not overlap. The file grows to the end of the range; gaps read as zeros.
  Result<void> write_at(uint64_t offset, std::span<const std::byte> bytes) const;
  /// Fills `out` from the bytes written so far.
  Result<void> read_at(uint64_t offset, std::span<std::byte> out) const;
  Result<uint64_t> size() const;
  /// Sets the size; bytes past the written ones are zeros.
  Result<void> resize(uint64_t bytes) const;
  /// Makes sure that all written bytes are on the disk.
  Result<void> sync() const;
  /// Syncs and closes the file, so that many files can await their commit() without an open descriptor each. It is not
  /// locked until then. If another program takes the .part meanwhile, commit() fails and discard() leaves it alone.
  Result<void> park();
  /// Syncs, renames, then closes. The lock is held until the name is taken, so that the name never refers to another
  /// program's half-written file, nor to data that a power cut would lose.
  Result<void> commit();
  /// Unlinks the .part at once: its bytes live as long as this object, however the program ends.
  Result<void> hide();
  /// From now on discard() keeps the .part, which a later create() can take over.
  void keep();
  /// Closes the .part, and removes it unless it has its name or is to be kept. Allocates no memory, because it may run
  /// when memory is exhausted.
  void discard() noexcept;

  bool is_open() const { return file_ >= 0; }
  /// commit() has renamed it, even if it then failed to close it.
  bool has_name() const { return has_name_; }
  /// commit() found the name taken, with Existing::kRefuse.
  bool is_refused() const { return is_refused_; }
  /// Path of the finished file.
  const std::string& path() const { return path_; }
  const std::string& part_path() const { return part_path_; }

 private:
  /// Identifies a parked .part, to detect changes by another program.
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
  bool is_part_ = false;  // a .part exists that has to be removed
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
