#include "lab/setup/packed_file.h"

namespace scree::lab {

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

}  // namespace scree::lab
