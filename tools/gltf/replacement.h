// Several files that belong together take the place of earlier ones.
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

/// Several files that get their names together: those they replace keep a second name, NAME.earlier.part, until all
/// have theirs, so that what was there before is put back where one fails. A file system without links loses it then.
/// Errors kFile.
class Replacement {
 public:
  explicit Replacement(std::span<format::PartFile* const> files) {
    for (format::PartFile* file : files) files_.push_back({file, file->path(), file->path() + ".earlier.part"});
  }
  Replacement(const Replacement&) = delete;
  Replacement& operator=(const Replacement&) = delete;
  /// Nothing here may need memory: it may be what ran out.
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
      // A second name may be left of a run that was killed.
      if (::unlink(file.earlier.c_str()) != 0 && errno != ENOENT) return remove_error(file);
      file.has_earlier = ::link(file.name.c_str(), file.earlier.c_str()) == 0;
    }
    Result<void> done = file.part->commit();
    // One file alone has nothing to be put back: once it has its name it is whole, whatever fails after that.
    file.is_renamed = files_.size() > 1 && file.part->has_name();
    return done;
  }
  /// Takes the second names away, once all have theirs. Where one stays, the new files are whole all the same.
  Result<void> keep() {
    Result<void> done;
    for (File& file : files_) file.is_renamed = false;  // there is nothing to be put back any more
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
