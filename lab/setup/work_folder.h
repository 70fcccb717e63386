// Temporary files of a measurement.
#pragma once

#include <stdlib.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <string>
#include <utility>

#include "format/result.h"

namespace scree::lab {

/// Registers a folder that is removed with all its content if a signal ends the program (tools::end_on_signal). Only
/// one folder at a time: a second one would not be removed.
void remove_on_signal(const std::string& path);
void forget_folder();

/// A temporary folder. It is removed with all its content when this object is destroyed or a signal ends the program.
class WorkFolder {
 public:
  /// Makes a folder in $TMPDIR, else /tmp. Errors kFile.
  static Result<WorkFolder> make() {
    std::error_code failed;
    const std::filesystem::path parent = std::filesystem::temp_directory_path(failed);
    if (failed) return Error{ErrorCode::kFile, "the folder for temporary files: " + failed.message()};
    std::string pattern = parent.string() + "/scree-lab-XXXXXX";
    if (::mkdtemp(pattern.data()) == nullptr) return Error{ErrorCode::kFile, pattern + ": " + std::strerror(errno)};
    return WorkFolder(pattern);
  }
  WorkFolder(WorkFolder&& other) noexcept : path_(std::exchange(other.path_, {})) {}
  WorkFolder& operator=(WorkFolder&&) = delete;
  ~WorkFolder() {
    std::error_code ignored;
    if (path_.empty()) return;
    std::filesystem::remove_all(path_, ignored);
    forget_folder();
  }
  const std::string& path() const { return path_; }
  std::string file(const std::string& name) const { return path_ + "/" + name; }

 private:
  explicit WorkFolder(std::string path) : path_(std::move(path)) { remove_on_signal(path_); }
  std::string path_;
};

}  // namespace scree::lab
