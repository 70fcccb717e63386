// All passes of a conversion in their order: masks, measuring, sorting, images, encoding, tables.
#pragma once

#include <set>
#include <string>

#include "format/result.h"
#include "tools/common/output/progress.h"
#include "tools/convert/passes/shard.h"
#include "tools/convert/plan/convert_options.h"
#include "tools/convert/report.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// Writes report.output, and fills in `report` except for times and peak memory. Changes `scene`: references to equal
/// meshes become references to the first of them. `files`: all files that the scene is read from. `shards`: merges
/// these instead of measuring and encoding; null otherwise. Errors as convert() and merge().
Result<void> run_conversion(const ConvertOptions& options, SourceScene& scene, const std::set<std::string>& files,
                            ShardSet* shards, tools::Progress& progress, ConvertReport& report);

}  // namespace scree::convert
