// The command line of scree bench.
#include "tools/common/options/command.h"

#include <memory>

#include "tools/bench/bench.h"
#include "tools/common/output/standard_output.h"

namespace scree::tools {
namespace {

struct BenchWords : DrawWords {
  TextureWords textures;
  bench::BenchOptions options;  // options that are not parsed from text
};

Result<bench::BenchOptions> parse(const BenchWords& words) {
  bench::BenchOptions options = words.options;
  SCREE_TRY(assign<DrawOptions>(options, parse_draw_options(words)));
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
  add_repeated(
      *app, "--camera", "NAME", options.cameras,
      "A camera of the files, by name, node name or number; may be repeated (default: all cameras of a file, or "
      "the default view of render)");
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
  return {app, [words]() -> Result<void> {
            const bench::BenchOptions parsed = SCREE_TRY(parse(*words));
            SCREE_TRY(bench::run_bench(parsed));
            return finish_output();
          }};
}

}  // namespace scree::tools
