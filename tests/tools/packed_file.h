// A glTF that is converted and opened.
#pragma once

#include <string>
#include <utility>

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

}  // namespace scree::tests
