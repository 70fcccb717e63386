// glTF in, .scree out. Memory stays bounded however big the scene is: windows of triangles are measured and then
// encoded, a bounded number of them in flight.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "format/result.h"
#include "tools/convert/plan/convert_options.h"
#include "tools/convert/report.h"

namespace scree::convert {

/// Converts. On an error nothing is left at `output` that was not there before; with ConvertOptions::resume there may
/// be an unfinished .part. One that an earlier run left stays as it is where checking or measuring finds the source
/// bad, and is replaced once there is something to be written instead. Errors kUsage (options that exclude each other
/// or are out of range, output is the input), those of import_gltf, measure, check_images, write_images, encode_window
/// and ContainerWriter; kUsage where ConvertOptions::memory is too little, with the least that is needed. The bytes
/// written are the same for any number of threads and any memory.
Result<ConvertReport> convert(const ConvertOptions& options);

struct MergeOptions {
  std::vector<std::string> shards;                         // all of a conversion, in any order
  std::string output;
  format::Existing existing = format::Existing::kReplace;  // of `output`
  uint32_t threads = 0;                                    // as in ConvertOptions, and the rest too
  uint64_t memory = uint64_t{2} << 30;
  bool allow_outside = false;
  bool progress = false;
  const std::atomic<bool>* stop = nullptr;
};

/// Makes of shards (ConvertOptions::shards) the file that one run makes, byte for byte. The source's document is read
/// again, its geometry and images are not. On an error nothing is left at `output` that was not there before. Errors
/// those of open_shards, import_gltf and ContainerWriter; kFile: the source has changed; kFormat, kRange: a shard is
/// not what convert() wrote; kChecksum.
Result<ConvertReport> merge(const MergeOptions& options);

}  // namespace scree::convert
