// scree-lab measures scree for its developers. It is not part of the package; users have `scree bench`.
#include <cstdio>
#include <exception>

#include <CLI/CLI.hpp>

#include "lab/frames/run.h"
#include "lab/judge/judge_run.h"
#include "lab/options.h"
#include "lab/sizes.h"
#include "tools/common/options/command.h"
#include "tools/common/options/suggest.h"
#include "tools/common/output/standard_output.h"
#include "tools/common/process/stop_signal.h"

namespace scree::lab {
namespace {

using tools::add_value;

void add_options(CLI::App& app, LabWords& words) {
  add_value(app, "files", "FILES", words.files,
            "A .scree file, instead of --scene; with --reference, --curves or --sizes .gltf and .glb models");
  add_value(app, "--scene", "NAMES", words.scenes,
            "A, B, C, D, lantern (B's mesh once) or A60 (A with 60 M triangles), separated by commas\n"
            "(default: A,B,C,D); or textured: JPEG textures, decoded as they are drawn");
  add_value(app, "--view", "NAMES", words.views,
            "Views by name: overview, closeup (A, B, C), inside, corner (D), or a file's cameras (default: all)");
  add_value(app, "--positions", "LIST", words.positions,
            "Encodings of generated scenes: 8 to 24 (bits per axis), float32")
      ->capture_default_str();
  add_value(app, "--indices", "LIST", words.indices,
            "packed, 32, clustered (clusters, not chunks of indices), or auto: 32 bits with float32 positions, "
            "else packed")
      ->capture_default_str();
  add_value(app, "--order", "ORDER", words.order, "Order of triangles and vertices: row, or block (A, B, C)")
      ->capture_default_str();
  add_value(app, "--scale", "SHARE", words.scale,
            "Share of the triangles of A, B and C to keep, above 0 to 1, as in synth")
      ->capture_default_str();
  add_value(app, "--samples", "LIST", words.samples, "Samples per pixel along each side: 1, 2, 4")
      ->capture_default_str();
  add_value(app, "--sampleless", "LIST", words.sampleless,
            "Early dropping of triangles that cover no pixel centre: on, off; the picture is the same")
      ->capture_default_str();
  add_value(app, "--culling", "LIST", words.culling,
            "Culling of clusters: all, bounds (keeps hidden clusters), none; the picture is the same")
      ->capture_default_str();
  add_value(app, "--effects", "LIST", words.effects,
            "none, ssao (ambient occlusion), edl (eye-dome lighting), ssao+edl")
      ->capture_default_str();
  add_value(app, "--size", "WxH", words.size, "Image size in pixels (default: the scene's; for a file 1920x1080)");
  add_value(app, "--near", "SHARE", words.near,
            "The near plane's distance as a share of the scene's diagonal (default: 0.1 units, or a camera's own);\n"
            "render uses 1e-6 if the eye is inside the scene");
  add_value(app, "--frames", "N", words.frames, "Number of measured frames")->capture_default_str();
  add_value(app, "--warmup", "N", words.warmup, "Frames drawn before the measured ones")->capture_default_str();
  app.add_flag("--stages", words.stages,
               "Measure the stages of frames. This makes frames slower; without it, a small scene is one submission");
  app.add_flag("--path", words.path,
               "Move from a scene's first view to its second over 120 frames: mean, worst, and the jump back");
  app.add_flag("--sweep", words.sweep,
               "Speed, size and error against float32 positions, for all --indices and --positions (default:\n"
               "8,10,12,14,16,18,20,24)");
  add_value(app, "--peer", "NAME", words.peer,
            "vulkan: also draw each view by the GPU's own rasteriser, with indexed draws (VK-ID) and with vertex\n"
            "shaders that read indices and positions themselves (VK-PIP), and compare the pictures with float32's");
  app.add_flag("--reference", words.reference,
               "Judge the pictures of --scene (default: D) and of models, as convert packs them with --positions and\n"
               "--indices, by a double-precision reference that draws every triangle of the source by brute force, so\n"
               "A, B and C need a small --scale. The CPU draws if there is no GPU");
  app.add_flag("--curves", words.curves,
               "--reference for 8 to 24 bits and float32, and the errors of snapping, depth codes and few samples");
  app.add_flag("--sizes", words.sizes,
               "Size of geometry, and seconds to encode and decode it: models (.gltf, .glb) as convert packs them,\n"
               "in meshoptimizer's codecs, and in the glTF");
  add_value(app, "--textures", "N", words.textures, "Textured: number of textures")->capture_default_str();
  add_value(app, "--texture-size", "N", words.texture_size, "Textured: texels per side")->capture_default_str();
  add_value(app, "--texture-cache", "SIZE", words.texture_cache,
            "Textured: memory for decoded blocks (default: 256MiB)");
  add_value(app, "--device", "N|UUID", words.device,
            "The GPU, by index or UUID as scree devices lists them (default: the first usable one)");
  add_value(app, "--csv", "FILE", words.csv, "Append a row per case to this file");
}

Result<void> measure(const LabWords& words) {
  if (words.sizes) {
    if (words.files.empty()) return Error{ErrorCode::kUsage, "--sizes takes models"};
    return run_sizes(words.files, words.csv);
  }
  const LabOptions options = SCREE_TRY(parse_options(words));
  return options.reference ? judge_scenes(options) : run_bench(options);
}

int run(int argc, char** argv) {
  CLI::App app(
      "Measures frames on the GPU: the scenes A to D of synth, made in its memory, or a .scree file; judges pictures\n"
      "and sizes. Prints tables, and appends a CSV row per case (docs/results/README.md).",
      "scree-lab");
  LabWords words;
  add_options(app, words);
  for (CLI::Option* option : app.get_options())  // --sizes is a separate mode, which accepts only files and --csv
    if (option->get_name() != "--sizes" && option->get_name() != "files" && option->get_name() != "--csv" &&
        option->get_name() != "--help")
      app.get_option("--sizes")->excludes(option);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);
    std::fprintf(stderr, "scree-lab: %s (see scree-lab --help)\n", tools::describe_parse_error(app, error).c_str());
    return exit_code(ErrorCode::kUsage);
  }
  tools::end_on_signal("lab");
  Result<void> done = measure(words);
  if (done) done = tools::finish_output();
  if (done) return 0;
  std::fprintf(stderr, "scree-lab: %s\n", done.error().message.c_str());
  return exit_code(done.error().code);
}

}  // namespace
}  // namespace scree::lab

int main(int argc, char** argv) {
  try {
    return scree::lab::run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "scree-lab: %s\n", error.what());
    return scree::exit_code(scree::ErrorCode::kMemory);
  }
}
