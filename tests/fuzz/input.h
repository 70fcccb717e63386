// Functions that the fuzz targets share.
#pragma once

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "tests/exact_copy.h"
#include "tests/fuzz/targets.h"

namespace scree::fuzz {

/// Ends the program, as a crash would, if a promise is broken.
inline void must(bool holds, const char* promise) {
  if (holds) return;
  std::fprintf(stderr, "broken promise: %s\n", promise);
  std::abort();
}

/// Numbers from the front of an input, zeros past its end. rest() is the stream that they describe.
class Parameters {
 public:
  explicit Parameters(Bytes bytes) : bytes_(bytes) {}

  template <class T>
  T take() {
    T value{};
    const size_t size = std::min(sizeof value, bytes_.size());
    if (size > 0) std::memcpy(&value, bytes_.data(), size);
    bytes_ = bytes_.subspan(size);
    return value;
  }
  Bytes rest() const { return bytes_; }

 private:
  Bytes bytes_;
};

using tests::ExactCopy;

/// A folder of this process, in memory if possible, removed at exit.
class Folder {
 public:
  static const std::filesystem::path& path() {
    static const Folder folder;
    return folder.path_;
  }
  static std::string file(const char* name) { return (path() / name).string(); }
  static std::string write(const char* name, Bytes bytes) {
    const std::string path = file(name);
    std::ofstream out(path, std::ios::binary | std::ios::trunc);
    out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
    out.close();
    must(out.good(), "the input can be written to a file");
    return path;
  }

 private:
  Folder() {
    std::error_code ignored;
    const std::filesystem::path memory = "/dev/shm";
    const bool has_memory = std::filesystem::is_directory(memory, ignored) && ::access(memory.c_str(), W_OK) == 0;
    std::string name = ((has_memory ? memory : std::filesystem::temp_directory_path()) / "scree-fuzz-XXXXXX").string();
    must(::mkdtemp(name.data()) != nullptr, "a folder can be made");
    path_ = name;
  }
  ~Folder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }

  std::filesystem::path path_;
};

}  // namespace scree::fuzz
