#include "tools/inspect/inspect.h"

#include <memory>
#include <new>
#include <optional>
#include <string>

#include "format/container/container.h"
#include "runtime/files/mapped_file.h"
#include "tools/common/options/command.h"
#include "tools/common/output/human.h"
#include "tools/common/output/progress.h"
#include "tools/common/output/standard_output.h"
#include "tools/common/process/sigbus.h"
#include "tools/compare/geometry.h"
#include "tools/compare/report.h"
#include "tools/convert/passes/shard.h"
#include "tools/gltf/document/uri.h"
#include "tools/gltf/source.h"
#include "tools/inspect/report.h"
#include "tools/inspect/stats.h"
#include "tools/inspect/verify.h"

namespace scree::inspect {
namespace {

void print(const std::string& text, std::FILE* out) {
  std::fwrite(text.data(), 1, text.size(), out);
}

/// The error if the file exceeds its stated bounds or lacks triangles; nullopt if all is well.
std::optional<Error> bound_error(const compare::GeometryReport& report, const InspectOptions& options) {
  if (!report.broken.empty()) {
    const compare::BrokenBound& first = report.broken.front();
    std::string message = "mesh " + std::to_string(first.mesh) + ": position error " +
                          tools::short_number(first.error) + " against " + options.source + ", but at most " +
                          tools::short_number(first.bound) + " is allowed";
    if (report.broken.size() > 1) message += " (and " + tools::grouped(report.broken.size() - 1) + " more)";
    return Error{ErrorCode::kRange, message};
  }
  if (report.missing_triangles != 0 || report.unknown_triangles != 0)
    return Error{ErrorCode::kRange, tools::grouped(report.missing_triangles) + " triangles of " + options.source +
                                        " are missing and " + tools::grouped(report.unknown_triangles) +
                                        " do not belong to it"};
  return std::nullopt;
}

Result<compare::GeometryReport> measure_against(const format::Container& file, const InspectOptions& options) try {
  SCREE_TRY(convert::check_no_shard(file));
  const convert::SourceScene source = SCREE_TRY(
      convert::import_gltf(options.source, {.exclude = options.exclude, .allow_outside = options.allow_outside}));
  return compare::compare_geometry(source, file);
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left to compare it with " + options.source};
}

}  // namespace

Result<void> inspect_file(const std::string& path, const InspectOptions& options, std::FILE* out) {
  const auto map = SCREE_TRY(runtime::MappedFile::open(path));
  const auto file = SCREE_TRY_AT(path, format::Container::open(map.bytes()));

  std::optional<VerifyReport> verified;
  if (options.verify) {
    tools::Progress progress(options.progress);
    uint64_t triangles = 0;
    for (uint64_t i = 0; i < file.meshes().size(); ++i) triangles += file.meshes()[i].triangle_count;
    progress.stage("verify", triangles);
    VerifyHooks hooks{.progress = [&](uint64_t done, uint64_t bytes) { progress.update(done, bytes); }};
    // Checked parts of the file are released, since the file may be larger than memory.
    hooks.is_done_with = [&](uint64_t offset, uint64_t bytes) { map.release(offset, bytes); };
    verified = verify(file, map.bytes(), options.threads, hooks);
  }
  std::optional<compare::GeometryReport> measured;
  if (!options.source.empty()) measured = SCREE_TRY_AT(path, measure_against(file, options));
  const Stats stats = gather(file, map.bytes(), options.top, options.verify);
  if (options.json) {
    print_json(file, stats, path, verified ? &*verified : nullptr, measured ? &*measured : nullptr, options.chunks,
               out);
  } else {
    print(text_report(file, stats, path), out);
    if (options.chunks) {
      print("\n", out);
      print_chunks(file, out);
    }
    if (verified) print("\n" + text_verify(*verified), out);
    if (measured) print("\nagainst " + options.source + "\n\n" + compare::text_geometry(*measured), out);
  }
  SCREE_TRY(tools::check_unchanged(map));
  SCREE_TRY(tools::finish_output(out));
  if (verified && verified->failure_count != 0) {
    const uint64_t others = verified->failure_count - 1;
    Error error = at(path, verified->failures.front().error);
    if (others != 0) error.message += " (and " + tools::grouped(others) + " more)";
    return error;
  }
  if (measured)
    if (const auto broken = bound_error(*measured, options)) return at(path, *broken);
  return {};
}

}  // namespace scree::inspect

namespace scree::tools {

Command add_inspect(CLI::App& parent) {
  struct Arguments {
    std::string path;
    inspect::InspectOptions options;
  };
  auto arguments = std::make_shared<Arguments>();
  inspect::InspectOptions& options = arguments->options;
  CLI::App* app = parent.add_subcommand("inspect", "Shows the contents and costs of a .scree file, and checks it");
  app->add_option("FILE", arguments->path, "The .scree file")->required();
  app->add_flag("--json", options.json, "One JSON object, amounts in bytes");
  app->add_flag("--verify", options.verify,
                "Check every checksum and decode all data; also print the share that indices take in clusters");
  app->add_flag("--chunks", options.chunks, "Print a row for every chunk");
  add_value(*app, "--source", "FILE", options.source,
            "Measure the true position error against this .gltf or .glb (needs convert --source-ids)");
  add_value(*app, "--exclude", "REGEX", options.exclude,
            "For --source: the --exclude with which the file was converted");
  app->add_flag("--allow-outside", options.allow_outside, convert::kAllowOutsideHelp);
  add_whole(*app, "--top", options.top, 0, kMostWhole, "Meshes and images to list by name");
  add_whole(*app, "--threads", options.threads, 0, kMostThreads, "Threads of --verify; 0: one per processor");
  const auto quiet = std::make_shared<bool>(false);
  app->add_flag("-q,--quiet", *quiet, "No progress");
  return {app, [arguments, quiet] {
            report_sigbus("inspect", arguments->path);
            arguments->options.progress = !*quiet;
            return inspect::inspect_file(arguments->path, arguments->options, stdout);
          }};
}

}  // namespace scree::tools
