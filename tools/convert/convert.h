// Converts glTF to .scree. Memory stays bounded for any size of scene: windows of triangles are measured and then
// encoded, with a bounded number of them in flight.
#pragma once

#include <string>
#include <vector>

#include "format/result.h"
#include "tools/convert/plan/convert_options.h"
#include "tools/convert/report.h"

namespace scree::convert {

/// Converts a scene. After an error, `output` has no new file; with ConvertOptions::resume an unfinished .part may
/// remain. A .part of an earlier run stays unchanged if checking or measuring finds errors in the source, and is
/// replaced once new data are written. Errors: kUsage (options that exclude each other or are out of range; the output
/// is the input; ConvertOptions::memory is too small, and the message gives the minimum), and those of import_gltf,
/// measure, check_images, write_images, encode_window and ContainerWriter. The output is the same for any number of
/// threads and any memory.
Result<ConvertReport> convert(const ConvertOptions& options);

struct MergeOptions : RunOptions {
  std::vector<std::string> shards;  // all of a conversion, in any order
};

/// Joins shards (ConvertOptions::shards) into the file that one run would write, byte for byte. Reads the source's
/// document again, but not its geometry and images. After an error, `output` has no new file. Errors: those of
/// open_shards, import_gltf and ContainerWriter; kFile: the source has changed; kFormat, kRange: a shard is not as
/// convert() wrote it; kChecksum.
Result<ConvertReport> merge(const MergeOptions& options);

}  // namespace scree::convert
