// glTF in, .scree out. Memory stays bounded however big the scene is: windows of triangles are measured and then
// encoded, a bounded number of them in flight.
#pragma once

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

}  // namespace scree::convert
