#include "tools/convert/passes/sort_scattered.h"

#include <algorithm>
#include <filesystem>
#include <memory>
#include <utility>
#include <vector>

#include "tools/common/options/options.h"
#include "tools/convert/sort/sort_primitive.h"

namespace scree::convert {
namespace {

std::string sort_name(const std::string& output) {
  return output + ".sorted";
}

/// Checks the disk's free space before hours of work. If other programs fill the disk meanwhile, a write fails.
Result<void> check_room(const std::string& output, const std::string& place, uint64_t bytes) {
  std::filesystem::path folder = std::filesystem::path(output).parent_path();
  if (folder.empty()) folder = ".";
  std::error_code failed;
  const std::filesystem::space_info space = std::filesystem::space(folder, failed);
  if (failed || space.available >= bytes) return {};
  return Error{ErrorCode::kFile, output + ": sorting the triangles of " + place + " takes a temporary file of " +
                                     tools::format_bytes(bytes) + " beside it, but only " +
                                     tools::format_bytes(space.available) + " are free"};
}

}  // namespace

std::string sort_file_name(const std::string& output) {
  return sort_name(output) + ".part";
}

Result<SortedPrimitives> sort_scattered(const SourceScene& scene, const std::string& output, const MemoryPlan& memory,
                                        const MeasureOptions& options, const std::atomic<bool>* stop,
                                        tools::Progress& progress, StageTimes& times, Measurement& measurement) {
  SortedPrimitives sorted;
  if (measurement.scattered.empty()) return sorted;
  uint64_t kept = 0, steps = 0;
  for (const ScatteredPrimitive& scattered : measurement.scattered) {
    const Primitive& primitive = scene.primitives[scattered.primitive];
    const SortNeeds needs = sort_needs(primitive, scattered.vertex_count, options.normals != Normals::kNever);
    sorted.file_bytes = std::max(sorted.file_bytes, kept + needs.file_bytes);
    kept += needs.kept_file_bytes;
    sorted.triangles += primitive.triangle_count();
    steps += 2 * (primitive.triangle_count() + scattered.vertex_count);
  }
  const std::string place = primitive_place(scene, measurement.scattered.front().primitive);
  SCREE_TRY(check_room(output, place, sorted.file_bytes));

  format::PartFile made = SCREE_TRY(format::PartFile::create(sort_name(output)));
  SCREE_TRY(made.hide());
  const auto file = std::make_shared<const format::PartFile>(std::move(made));
  progress.stage("sort", steps);
  SourceScene copies;
  copies.file_name = scene.file_name;
  copies.materials = scene.materials;
  MeasureOptions copy_options = options;
  copy_options.may_sort = false;
  copy_options.hashed.clear();
  uint64_t offset = 0, done = 0;
  for (const ScatteredPrimitive& scattered : measurement.scattered) {
    const Primitive& primitive = scene.primitives[scattered.primitive];
    const SortNeeds needs = sort_needs(primitive, scattered.vertex_count, options.normals != Normals::kNever);
    Result<Primitive> copy =
        sort_primitive(primitive, scattered, options.normals != Normals::kNever, memory.sort(needs), file, offset, stop,
                       [&](uint64_t now) { progress.update(done + now, 0); });
    if (!copy) return at(scene.file_name, copy.error());
    offset += needs.kept_file_bytes;
    done += 2 * (primitive.triangle_count() + scattered.vertex_count);
    sorted.copies.emplace(scattered.primitive, *copy);
    copies.primitives.push_back(std::move(*copy));
    if (!options.hashed.empty()) copy_options.hashed.push_back(options.hashed[scattered.primitive]);
  }

  progress.stage("measure", sorted.triangles);
  WorkerPool pool(memory.measure().threads, stop);
  const MeasureRun run{pool, times, [&](uint64_t triangles) { progress.update(triangles, 0); }};
  Measurement measured =
      SCREE_TRY(measure(copies, std::vector<bool>(copies.primitives.size(), true), copy_options, run));
  for (size_t i = 0; i < copies.primitives.size(); ++i) {
    Measured& total = measurement.primitives[measurement.scattered[i].primitive];
    measured.primitives[i].dropped_degenerate = total.dropped_degenerate;
    total = measured.primitives[i];
  }
  for (WindowPlan& window : measured.windows) window.primitive = measurement.scattered[window.primitive].primitive;
  measurement.windows.insert(measurement.windows.end(), measured.windows.begin(), measured.windows.end());
  sort_windows(measurement.windows);
  return sorted;
}

}  // namespace scree::convert
