#include "tools/convert/passes/source_files.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <system_error>

#include "tools/convert/passes/sort_scattered.h"

namespace scree::convert {

std::set<std::string> source_files(const std::string& input, const SourceScene& scene) {
  std::set<std::string> files{input};
  const auto add = [&](const std::shared_ptr<const ByteSource>& source) {
    if (source != nullptr && !source->path().empty()) files.insert(source->path());
  };
  const auto add_accessor = [&](const Accessor& accessor) {
    add(accessor.source);
    if (!accessor.sparse) return;
    add(accessor.sparse->index_source);
    add(accessor.sparse->value_source);
  };
  for (const Primitive& primitive : scene.primitives) {
    add_accessor(primitive.positions);
    if (primitive.indices) add_accessor(*primitive.indices);
    visit_attributes(primitive, true, add_accessor);
  }
  for (const SourceNode& node : scene.nodes) {
    if (!node.instances) continue;
    for (const std::optional<Accessor>* accessor :
         {&node.instances->translation, &node.instances->rotation, &node.instances->scale})
      if (*accessor) add_accessor(**accessor);
  }
  for (const SourceImage& image : scene.images) add(image.source);
  return files;
}

Result<uint64_t> total_bytes(const std::set<std::string>& files) {
  uint64_t total = 0;
  for (const std::string& file : files) {
    std::error_code failed;
    const uint64_t bytes = std::filesystem::file_size(file, failed);
    if (failed) return Error{ErrorCode::kFile, file + ": " + failed.message()};
    total += bytes;
  }
  return total;
}

Result<void> check_output(const std::string& output) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  if (fs::is_directory(output, ignored)) return Error{ErrorCode::kFile, output + ": is a folder"};
  fs::path folder = fs::path(output).parent_path();
  if (folder.empty()) folder = ".";
  if (::access(folder.c_str(), W_OK | X_OK) != 0)
    return Error{ErrorCode::kFile, folder.string() + ": " + std::strerror(errno)};
  return {};
}

Result<void> check_not_read(const std::set<std::string>& files, const std::string& output, const char* kind) {
  std::error_code ignored;
  for (const std::string& file : files)
    for (const std::string& written : {output, output + ".part", sort_file_name(output)})
      if (std::filesystem::equivalent(file, written, ignored))
        return Error{ErrorCode::kUsage, written + ": the output would replace " + (file == written ? kind : file)};
  return {};
}

}  // namespace scree::convert
