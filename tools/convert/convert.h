// Converts glTF to .scree. Memory stays bounded for any size of scene: windows of triangles are measured and then
// encoded, with a bounded number of them in flight.
#pragma once

#include "format/result.h"
#include "tools/convert/plan/convert_options.h"
#include "tools/convert/report.h"

namespace scree::convert {

/// Converts a scene. After an error, `output` has no new file; with ConvertOptions::resume an unfinished .part may
/// remain. A .part of an earlier run stays unchanged if checking or measuring finds errors in the source, and is
/// replaced once new data are written. Errors kUsage (options that exclude each other or are out of range, output is
/// the input, ConvertOptions::memory is too small, with the minimum), errors of import_gltf, measure, check_images,
/// write_images, encode_window and ContainerWriter. The bytes written are the same for any number of threads and any
/// memory.
Result<ConvertReport> convert(const ConvertOptions& options);

}  // namespace scree::convert
