// Several files that belong together take the place of earlier ones.
#pragma once

#include <cstddef>
#include <cstdio>
#include <span>
#include <string>
#include <vector>

#include <unistd.h>

#include "format/part_file.h"
#include "format/result.h"

namespace scree::tools {

/// Several files that get their names together: those they replace keep a second name until all have theirs, so that
/// what was there before is put back where one fails. A file system without links loses it then.
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
      if (is_kept_ || !file.is_renamed) {
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
      ::unlink(file.earlier.c_str());  // of a run that was killed
      file.has_earlier = ::link(file.name.c_str(), file.earlier.c_str()) == 0;
    }
    Result<void> done = file.part->commit();
    file.is_renamed = bool(done);
    return done;
  }
  void keep() { is_kept_ = true; }

 private:
  struct File {
    format::PartFile* part;
    std::string name;
    std::string earlier;
    bool has_earlier = false;
    bool is_renamed = false;
  };
  std::vector<File> files_;
  bool is_kept_ = false;
};

}  // namespace scree::tools
