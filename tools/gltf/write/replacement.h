// Replaces several files that belong together.
#pragma once

#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <unistd.h>

#include "format/container/part_file.h"
#include "format/result.h"

namespace scree::tools {

/// Several files that get their names together. Each replaced file keeps a second name, NAME.earlier.part, until all
/// new files have their names. If a file cannot get its name, the earlier files are restored; on a file system without
/// hard links they are lost. Errors kFile.
class Replacement {
 public:
  explicit Replacement(std::span<format::PartFile* const> files) {
    for (format::PartFile* file : files) files_.push_back({file, file->path(), file->path() + ".earlier.part"});
  }
  Replacement(const Replacement&) = delete;
  Replacement& operator=(const Replacement&) = delete;
  /// Must not allocate: memory may have run out.
  ~Replacement() {
    for (const File& file : files_) {
      if (!file.is_renamed) {
        if (file.has_earlier) ::unlink(file.earlier.c_str());
      } else if (!file.has_earlier) {
        ::unlink(file.name.c_str());
      } else {
        (void)std::rename(file.earlier.c_str(), file.name.c_str());
      }
    }
  }

  Result<void> commit(size_t index) {
    File& file = files_[index];
    if (files_.size() > 1) {
      // A killed run may have left a second name.
      if (::unlink(file.earlier.c_str()) != 0 && errno != ENOENT) return remove_error(file);
      file.has_earlier = ::link(file.name.c_str(), file.earlier.c_str()) == 0;
    }
    Result<void> done = file.part->commit();
    // A single file is never restored: once it has its name it is complete, whatever fails afterwards.
    file.is_renamed = files_.size() > 1 && file.part->has_name();
    return done;
  }
  /// Removes the second names, after all files have theirs. If one cannot be removed, the new files are complete
  /// nevertheless.
  Result<void> keep() {
    Result<void> done;
    for (File& file : files_) file.is_renamed = false;  // nothing is restored any more
    for (File& file : files_) {
      if (std::exchange(file.has_earlier, false) && ::unlink(file.earlier.c_str()) != 0 && done)
        done = remove_error(file);
    }
    return done;
  }

 private:
  struct File {
    format::PartFile* part;
    std::string name;
    std::string earlier;
    bool has_earlier = false;
    bool is_renamed = false;
  };

  static Error remove_error(const File& file) {
    return {ErrorCode::kFile, file.earlier + ": remove: " + std::strerror(errno)};
  }

  std::vector<File> files_;
};

}  // namespace scree::tools
