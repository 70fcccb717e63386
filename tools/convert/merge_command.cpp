// scree merge: the command line.
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "tools/common/options/command.h"
#include "tools/common/options/options.h"
#include "tools/common/output/output_file.h"
#include "tools/common/output/standard_output.h"
#include "tools/common/process/sigbus.h"
#include "tools/common/process/stop_signal.h"
#include "tools/convert/convert.h"
#include "tools/gltf/document/uri.h"

namespace scree::tools {
namespace {

struct MergeWords {
  std::vector<std::string> shards;
  std::string output;
  std::string threads = "0";
  std::string memory = "2GiB";
  bool allow_outside = false;
  bool force = false;
  bool json = false;
  bool quiet = false;
};

Result<void> run(const MergeWords& words) {
  convert::MergeOptions options;
  options.shards = words.shards;
  options.output = words.output;
  SCREE_TRY(check_no_gltf(words.output, "merge"));
  options.existing = existing_of(words.force);
  SCREE_TRY(assign(options.threads, parse_whole(words.threads, 0, kMostThreads, "--threads")));
  options.memory = SCREE_TRY_AT("--memory", parse_size(words.memory));
  options.allow_outside = words.allow_outside;
  options.progress = !words.quiet;
  report_sigbus("merge", words.shards.front() + ", or another shard");
  Result<convert::ConvertReport> report = Error{ErrorCode::kFile, {}};
  {
    const StopOnSignal handlers;
    options.stop = StopOnSignal::flag();
    report = convert::merge(options);
  }
  if (!report) return report.error();
  note_written(report->output);
  for (const std::string& warning : report->warnings)
    std::fprintf(stderr, "scree merge: warning: %s\n", warning.c_str());
  convert::ConvertOptions described;
  described.input = std::to_string(words.shards.size()) + (words.shards.size() == 1 ? " shard" : " shards");
  if (words.json) {
    std::fputs(convert::json_report(described, *report).c_str(), stdout);
  } else if (!words.quiet) {
    if (!report->positions.rows().empty()) std::printf("%s", report->positions.text().c_str());
    std::fputs(convert::describe(described, *report, false).c_str(), stdout);
  }
  return finish_output();
}

}  // namespace

Command add_merge(CLI::App& parent) {
  const auto words = std::make_shared<MergeWords>();
  CLI::App* app = parent.add_subcommand(
      "merge", "Joins the shards of a conversion (scree convert --shard) to the .scree file of a single run");
  app->add_option("shards", words->shards, "All shards, in any order; their source must be unchanged")->required();
  add_value(*app, "-o,--output", "FILE", words->output, "The file to write")->required();
  add_value(*app, "--threads", "N", words->threads, "Threads; 0: one per processor (default)");
  add_value(*app, "--memory", "SIZE", words->memory, "Limit of memory (default: 2GiB)");
  app->add_flag("--allow-outside", words->allow_outside, convert::kAllowOutsideHelp);
  app->add_flag("-f,--force", words->force, kForceHelp);
  app->add_flag("--json", words->json, "Print one JSON object instead of the closing lines");
  app->add_flag("-q,--quiet", words->quiet, "No progress and no closing lines");
  return {app, [words] { return run(*words); }};
}

}  // namespace scree::tools
