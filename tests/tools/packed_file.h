// Shared by the tests of export and inspect: a temporary folder, and a glTF that is converted and opened.
#pragma once

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "runtime/files/mapped_file.h"
#include "tests/tools/temp_folder.h"
#include "tools/convert/convert.h"

namespace scree::tests {

/// A .scree file, mapped and opened.
struct PackedFile {
  runtime::MappedFile map;
  format::Container file;
};

inline Result<PackedFile> open_packed(const std::string& path) {
  auto map = runtime::MappedFile::open(path);
  if (!map) return map.error();
  auto file = format::Container::open(map->bytes());
  if (!file) return file.error();
  return PackedFile{std::move(*map), std::move(*file)};
}

/// Converts with 2 threads and opens the result.
inline Result<PackedFile> pack(const std::string& input, const std::string& output,
                               convert::ConvertOptions options = {}) {
  options.input = input;
  options.output = output;
  options.threads = 2;
  const auto report = convert::convert(options);
  if (!report) return report.error();
  return open_packed(output);
}

/// All .gltf and .glb files below `folder`, in the order of their paths.
inline std::vector<std::filesystem::path> gltf_files(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    const auto extension = entry.path().extension();
    if (entry.is_regular_file() && (extension == ".gltf" || extension == ".glb")) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

inline void write_file(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

}  // namespace scree::tests
