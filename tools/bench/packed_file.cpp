#include "tools/bench/packed_file.h"

#include <utility>

namespace scree::bench {

convert::ConvertOptions packing(const std::string& source, const std::string& path, const Encoding& encoding,
                                uint32_t threads) {
  convert::ConvertOptions options;
  options.input = source;
  options.output = path;
  options.float32 = encoding.float32;
  options.position_bits = encoding.position_bits;
  options.encoding = encoding.clustered ? convert::Encoding::kClustered : convert::Encoding::kIndexed;
  options.threads = threads;
  return options;
}

Result<runtime::Scene> open_default_scene(const std::string& path, const runtime::SceneOptions& options) {
  Result<runtime::SceneFile> file = runtime::SceneFile::open(path);
  if (!file) return file.error();
  const Result<uint32_t> number = file->find_scene("");
  if (!number) return number.error();
  return runtime::Scene::load(std::move(*file), *number, options);
}

}  // namespace scree::bench
