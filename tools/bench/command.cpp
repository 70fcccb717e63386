// The command line of scree bench.
#include "tools/common/command.h"

#include <memory>

#include "tools/bench/bench.h"
#include "tools/common/standard_output.h"

namespace scree::tools {
namespace {

struct BenchWords : DrawWords {
  TextureWords textures;
  bench::BenchOptions options;  // options that are not parsed from text
};

Result<bench::BenchOptions> parse(const BenchWords& words) {
  const DrawOptions drawing = SCREE_TRY(parse_draw_options(words));
  bench::BenchOptions options = words.options;
  static_cast<DrawOptions&>(options) = drawing;
  options.textures = SCREE_TRY(parse_texture_options(words.textures));
  return options;
}

}  // namespace

Command add_bench(CLI::App& parent) {
  const auto words = std::make_shared<BenchWords>();
  bench::BenchOptions& options = words->options;
  CLI::App* app = parent.add_subcommand(
      "bench", "Times how fast .scree files load, from the disk and from the page cache, and how fast they are drawn");
  add_value(*app, "files", "FILES", options.files, "The scenes: .scree files")->required();
  add_value(*app, "--camera", "NAME", options.cameras,
            "A camera of the files, by name, node name or number; may be repeated (default: all cameras of a file, or "
            "the default view of render)")
      ->type_size(1)
      ->expected(1)
      ->allow_extra_args(false)  // the next argument is a file
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  add_picture_options(*app, *words);
  add_whole(*app, "--frames", options.frames, 1, kMostWhole,
            "Frames per view; fewer if they take more than two seconds");
  add_whole(*app, "--warmup", options.warmup, 0, kMostWhole, "Frames before the measured ones");
  add_whole(*app, "--repeats", options.repeats, 1, kMostWhole,
            "Number of loads from the disk, and also of loads from the page cache");
  add_device_options(*app, *words);
  add_reading_options(*app, *words);
  add_texture_options(*app, words->textures);
  add_value(*app, "--csv", "FILE", options.csv, "Append a row per view to this file");
  app->add_flag("--json", options.json, "Print one JSON object instead of tables");
  app->add_flag("-q,--quiet", options.quiet, "No progress and no warnings");
  return {app, [words] {
            const Result<bench::BenchOptions> parsed = parse(*words);
            if (!parsed) return Result<void>(parsed.error());
            const Result<void> done = bench::run_bench(*parsed);
            return done ? finish_output() : done;
          }};
}

}  // namespace scree::tools
