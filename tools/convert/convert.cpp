#include "tools/convert/convert.h"

#include <algorithm>
#include <chrono>
#include <exception>
#include <filesystem>
#include <functional>
#include <new>
#include <set>
#include <thread>

#include "tools/common/options/options.h"
#include "tools/common/output/output_file.h"
#include "tools/common/output/progress.h"
#include "tools/common/process/memory_use.h"
#include "tools/convert/passes/converter.h"
#include "tools/convert/passes/memory_plan.h"
#include "tools/convert/passes/shard.h"
#include "tools/convert/passes/source_files.h"
#include "tools/convert/plan/convert_options.h"
#include "tools/gltf/source.h"

namespace scree::convert {
namespace {

/// Error kFile: a file of the source has changed since the shards were made.
Result<void> check_same_source(const ShardSet& shards, const std::vector<FileStamp>& now) {
  const std::vector<FileStamp>& then = shards.plan.files;
  if (now == then) return {};
  const std::string place = shards.files.front().map.path() + ": ";
  for (const FileStamp& stamp : now)
    if (std::find(then.begin(), then.end(), stamp) == then.end())
      return Error{ErrorCode::kFile, place + stamp.name + " has changed since the shards were made"};
  return Error{ErrorCode::kFile, place + "the source has fewer files than when the shards were made"};
}

/// `shards`: the shards to merge, made from the source that `options` names; null for a conversion.
Result<ConvertReport> convert_or_throw(const ConvertOptions& options, ShardSet* shards) {
  const auto start = std::chrono::steady_clock::now();
  const tools::MemoryUse before = tools::memory_use();
  SCREE_TRY(check_options(options));
  ConvertReport report;
  report.output = options.output;
  report.threads_asked = options.threads != 0 ? options.threads : std::max(1u, std::thread::hardware_concurrency());
  if (report.output.empty())
    report.output = std::filesystem::path(options.input)
                        .replace_extension(options.shards > 0 ? std::to_string(options.shard + 1) + ".part" : "scree")
                        .string();
  SCREE_TRY(check_output(report.output));
  if (!tools::is_same_file(report.output, options.input))  // check_not_read() refuses that file, even with --force
    SCREE_TRY(tools::check_output_file(report.output, options.existing));
  report.output = format::PartFile::target_of(report.output);
  std::error_code ignored;
  if (options.resume && options.on_part && std::filesystem::exists(report.output + ".part", ignored))
    options.on_part();
  ImportOptions import_options;
  import_options.exclude = options.exclude;
  import_options.allow_outside = options.allow_outside;
  import_options.keep_going = options.images.keep_going;
  import_options.kept_view_bytes = kept_view_bytes(options.memory);
  import_options.memory = options.memory;
  import_options.threads = report.threads_asked;
  import_options.stop = options.stop;
  SourceScene scene = SCREE_TRY(import_gltf(options.input, import_options));
  report.warnings = scene.warnings;
  const std::set<std::string> files = source_files(options.input, scene);
  SCREE_TRY(check_not_read(files, report.output, "a file of the source"));
  report.input_bytes = SCREE_TRY(total_bytes(files));
  if (shards != nullptr) SCREE_TRY(check_same_source(*shards, stamp_files(options.input, files)));
  {
    tools::Progress progress(options.progress, options.on_progress);
    SCREE_TRY(run_conversion(options, scene, files, shards, progress, report));
  }
  report.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  report.peak_bytes = tools::peak_anonymous(before);
  return report;
}

Result<ConvertReport> without_throwing(const std::string& input, const std::function<Result<ConvertReport>()>& work) {
  try {
    return work();
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, input + ": out of memory"};
  } catch (const std::exception& error) {  // a thread could not be started
    return Error{ErrorCode::kMemory, input + ": " + error.what()};
  }
}

Result<ConvertReport> merge_or_throw(const MergeOptions& merging) {
  SCREE_TRY(check_not_read({merging.shards.begin(), merging.shards.end()}, format::PartFile::target_of(merging.output),
                           "a shard"));
  ShardSet shards = SCREE_TRY(open_shards(merging.shards));
  ConvertOptions options = shards.plan.options;
  options.input = shards.files.front().share.input;
  static_cast<RunOptions&>(options) = merging;
  return convert_or_throw(options, &shards);
}

}  // namespace

Result<ConvertReport> convert(const ConvertOptions& options) {
  return without_throwing(options.input, [&] { return convert_or_throw(options, nullptr); });
}

Result<ConvertReport> merge(const MergeOptions& options) {
  return without_throwing(options.output, [&] { return merge_or_throw(options); });
}

}  // namespace scree::convert
