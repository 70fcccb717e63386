#include "tools/common/command.h"

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "tools/bench/disk/end_to_end.h"
#include "tools/bench/disk/load_report.h"
#include "tools/bench/frames/run.h"
#include "tools/bench/judge/judge_run.h"
#include "tools/bench/judge/sizes.h"
#include "tools/bench/report/plot.h"
#include "tools/bench/setup/options.h"

namespace scree::tools {
namespace {

/// A mode of its own: no other option goes with it.
void takes_only(CLI::App& app, CLI::Option& mode, const std::vector<std::string>& names) {
  for (CLI::Option* option : app.get_options())
    if (option != &mode && option->get_name() != "--help" &&
        std::find(names.begin(), names.end(), option->get_name()) == names.end())
      mode.excludes(option);
}

}  // namespace

Command add_bench(CLI::App& parent) {
  const auto words = std::make_shared<bench::BenchWords>();
  CLI::App* app =
      parent.add_subcommand("bench",
                            "Measures frames on the GPU: the scenes A to D of synth, made in its memory, or a .scree "
                            "file. Prints a table of\n"
                            "times a stage and one of counts, and appends a CSV row a case (docs/results/README.md).");
  app->add_option("files", words->files,
                  "A .scree file, instead of --scene; with --reference or --curves .gltf and .glb models")
      ->type_name("FILES");
  app->add_option("--scene", words->scenes,
                  "A, B, C, D, lantern (B's mesh once) or A60 (A with 60 M triangles), with commas between\n"
                  "(default: A,B,C,D); or textured: JPEG textures, decoded as they are looked at")
      ->type_name("NAMES");
  app->add_option("--view", words->views,
                  "Views by name: overview, closeup (A, B, C), inside, corner (D), or a file's cameras\n"
                  "(default: all)")
      ->type_name("NAMES");
  app->add_option("--positions", words->positions, "Encodings of generated scenes: 8 to 24 (bits an axis), float32")
      ->capture_default_str()
      ->type_name("LIST");
  app->add_option(
         "--indices", words->indices,
         "packed, 32, clustered (clusters, not chunks of indices), or auto: 32 bits with float32 positions, else "
         "packed")
      ->capture_default_str()
      ->type_name("LIST");
  app->add_option("--order", words->order, "Order of triangles and vertices: row, or block (A, B, C)")
      ->capture_default_str()
      ->type_name("ORDER");
  app->add_option("--scale", words->scale, "Share of the triangles of A, B and C to keep, above 0 to 1, as in synth")
      ->capture_default_str()
      ->type_name("SHARE");
  app->add_option("--samples", words->samples, "Samples a side of a pixel: 1, 2, 4")
      ->capture_default_str()
      ->type_name("LIST");
  app->add_option("--sampleless", words->sampleless,
                  "Dropping triangles that cover no pixel centre early: on, off; the picture is the same")
      ->capture_default_str()
      ->type_name("LIST");
  app->add_option("--culling", words->culling,
                  "Of clusters: all, bounds (not those hidden by others), none; the picture is the same")
      ->capture_default_str()
      ->type_name("LIST");
  app->add_option("--effects", words->effects, "none, ssao (ambient occlusion), edl (eye-dome lighting), ssao+edl")
      ->capture_default_str()
      ->type_name("LIST");
  app->add_option("--size", words->size, "Image size in pixels (default: the scene's; of a file 1920x1080)")
      ->type_name("WxH");
  app->add_option("--frames", words->frames, "Frames measured")->capture_default_str()->type_name("N");
  app->add_option("--warmup", words->warmup, "Frames before them")->capture_default_str()->type_name("N");
  app->add_flag("--stages", words->stages,
                "Time the stages of small scenes too, whose frames are one submission otherwise and take less");
  app->add_flag("--path", words->path,
                "Move from a scene's first view to its second over 120 frames: mean, worst, and the jump back");
  app->add_flag(
      "--sweep", words->sweep,
      "Speed beside size beside error against float32 positions, for all --indices and --positions (default:\n"
      "8,10,12,14,16,18,20,24)");
  app->add_flag("--reference", words->reference,
                "Judge the pictures of --scene (default: D) and of models, as convert packs them with --positions and\n"
                "--indices, by a double-precision reference that draws the source's own vertices: every triangle, by\n"
                "brute force, so that A, B and C want a small --scale. The CPU draws where there is no GPU");
  app->add_flag("--curves", words->curves,
                "--reference for 8 to 24 bits and float32, and what snapping, depth codes and supersampling cost");
  app->add_option("--plot", words->plot,
                  "Draw the rows of --curves in this CSV file as curves_*.svg beside it, and do nothing else")
      ->type_name("FILE.csv");
  app->add_option("--textures", words->textures, "Textured: how many")->capture_default_str()->type_name("N");
  app->add_option("--texture-size", words->texture_size, "Textured: texels a side")
      ->capture_default_str()
      ->type_name("N");
  app->add_option("--texture-cache", words->texture_cache, "Textured: memory for decoded blocks (default: 256MiB)")
      ->type_name("SIZE");
  app->add_option("--csv", words->csv, "Append a row a case to this file")->type_name("FILE");
  const auto sizes = std::make_shared<bool>(false);
  CLI::Option* const sizes_flag = app->add_flag(
      "--sizes", *sizes,
      "What geometry takes, and seconds to encode and decode it: models (.gltf, .glb) as convert packs them, through\n"
      "meshoptimizer's codecs, through draco_encoder where it is installed, and in the glTF");
  CLI::Option* const load_flag = app->add_flag(
      "--load", words->load,
      "How fast .scree files load: cold, dropped from the page cache, and out of it, to all resident and to the first\n"
      "picture, as rates and as shares of what reading the raw disk gives. On the CPU the ring that feeds a GPU fills\n"
      "host memory instead");
  CLI::Option* const story_flag = app->add_flag(
      "--end-to-end", words->end_to_end,
      "One --scene or one glTF from the source to the picture: convert's seconds and memory, sizes, the load from the\n"
      "disk, frames resident and from a quarter of the memory, position error. Takes one encoding (default: 16, "
      "packed)\n"
      "and files of twice the glTF's size on the way");
  app->add_option("--backend", words->backend, "--load, --end-to-end: auto, cpu or cuda")
      ->capture_default_str()
      ->type_name("NAME");
  app->add_option("--device", words->device,
                  "The GPU, by its index or UUID, as scree devices lists them (default: the first that can be used)")
      ->type_name("N|UUID");
  app->add_option("--threads", words->threads, "--load, --end-to-end: threads; 0: one per processor")
      ->capture_default_str()
      ->type_name("N");
  app->add_option("--repeats", words->repeats, "--load, --end-to-end: loads of each kind; medians are told")
      ->capture_default_str()
      ->type_name("N");
  app->add_option("--work", words->work, "--end-to-end: a folder for files on the way (default: $TMPDIR, else /tmp)")
      ->type_name("FOLDER");
  app->add_option("--memory", words->memory, "--end-to-end: the most that convert may take (default: 2GiB)")
      ->type_name("SIZE");
  takes_only(*app, *sizes_flag, {"files", "--csv"});
  takes_only(*app, *load_flag,
             {"files", "--csv", "--view", "--size", "--backend", "--device", "--threads", "--repeats"});
  takes_only(*app, *story_flag,
             {"files", "--scene", "--scale", "--order", "--positions", "--indices", "--view", "--size", "--frames",
              "--warmup", "--csv", "--backend", "--device", "--threads", "--repeats", "--work", "--memory"});
  for (const char* name : {"--work", "--memory"}) app->get_option(name)->needs(story_flag);
  return {app, [app, words, sizes]() -> Result<void> {
            if (*sizes && words->files.empty()) return Error{ErrorCode::kUsage, "--sizes takes models"};
            if (*sizes) return bench::run_sizes(words->files, words->csv);
            if (words->load) {
              const Result<bench::LoadOptions> options = bench::parse_loads(*words);
              return options ? bench::run_loads(*options) : options.error();
            }
            if (words->end_to_end) {
              const Result<bench::EndToEndOptions> options = bench::parse_end_to_end(*words);
              return options ? bench::run_end_to_end(*options) : options.error();
            }
            for (const char* name : {"--backend", "--threads", "--repeats"})
              if (app->count(name) != 0)
                return Error{ErrorCode::kUsage, std::string(name) + " goes with --load or --end-to-end"};
            const Result<bench::BenchOptions> options = bench::parse_options(*words);
            if (!options) return options.error();
            if (!options->plot.empty()) return bench::plot_csv(options->plot);
            return options->reference ? bench::judge_scenes(*options) : bench::run_bench(*options);
          }};
}

}  // namespace scree::tools
