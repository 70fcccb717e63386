// What measuring found to have no locality is sorted through one temporary file beside the output, and measured then.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "format/result.h"
#include "tools/common/progress.h"
#include "tools/convert/passes/memory_plan.h"
#include "tools/convert/windows/measure.h"
#include "tools/gltf/source.h"

namespace scree::convert {

struct SortedPrimitives {
  std::map<uint32_t, Primitive> copies;  // by number in SourceScene::primitives; they hold the file open
  uint64_t triangles = 0;
  uint64_t file_bytes = 0;  // that the file takes at most
};

/// The name that the temporary file has for the moment between being made and being removed; in which state it is
/// written, so that nothing that ends the program leaves it but a kill between the two.
std::string sort_file_name(const std::string& output);

/// Sorts Measurement::scattered and adds what measuring the copies finds to `measurement`. `options`: of the first
/// measuring. Errors: those of sort_primitive and measure; kFile: the file cannot be made, or the disk has less room
/// than it will take.
Result<SortedPrimitives> sort_scattered(const SourceScene& scene, const std::string& output, const MemoryPlan& memory,
                                        const MeasureOptions& options, const std::atomic<bool>* stop,
                                        tools::Progress& progress, StageTimes& times, Measurement& measurement);

}  // namespace scree::convert
