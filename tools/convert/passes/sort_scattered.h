// Sorts the primitives without locality through one temporary file beside the output, then measures the sorted copies.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "format/result.h"
#include "tools/common/output/progress.h"
#include "tools/convert/passes/memory_plan.h"
#include "tools/convert/windows/measure.h"
#include "tools/gltf/source.h"

namespace scree::convert {

struct SortedPrimitives {
  std::map<uint32_t, Primitive> copies;  // by index in SourceScene::primitives; they keep the file open
  uint64_t triangles = 0;
  uint64_t file_bytes = 0;  // upper bound of the file's size
};

/// The temporary file's name between its creation and its unlinking, which follows at once. Only a kill between the two
/// leaves the file behind.
std::string sort_file_name(const std::string& output);

/// Sorts Measurement::scattered and adds the measurements of the copies to `measurement`. `options`: of the first
/// measuring. Errors of sort_primitive and measure; kFile: the file cannot be made, or the disk has too little room.
Result<SortedPrimitives> sort_scattered(const SourceScene& scene, const std::string& output, const MemoryPlan& memory,
                                        const MeasureOptions& options, const std::atomic<bool>* stop,
                                        tools::Progress& progress, StageTimes& times, Measurement& measurement);

}  // namespace scree::convert
