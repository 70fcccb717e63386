#include "tools/synth/synth.h"

#include <bit>
#include <chrono>
#include <cinttypes>
#include <cstdio>
#include <memory>
#include <string>

#include "tools/common/options/command.h"
#include "tools/common/output/json_writer.h"
#include "tools/common/output/output_file.h"
#include "tools/common/output/standard_output.h"
#include "tools/common/process/stop_signal.h"
#include "tools/synth/forest.h"
#include "tools/synth/panes.h"
#include "tools/synth/slope.h"
#include "tools/synth/zorah.h"

namespace scree::synth {
namespace {

Error usage(const std::string& message) {
  return {ErrorCode::kUsage, message};
}

Result<void> check_options(const SynthOptions& options) {
  const bool is_zorah = options.scene.starts_with("zorah");
  const bool is_scattered = options.scene == "slope" || options.scene == "forest";
  const bool is_pane = options.scene == "panes" || options.scene == "panes-textured";
  const bool is_other = is_zorah || is_scattered || is_pane;
  if (!(options.scale > 0 && options.scale <= 1)) return usage("--scale must be above 0 and at most 1");
  if (options.output.empty() && !options.checks) return usage("no output (-o FILE.gltf or FILE.glb)");
  if (is_other && options.output.empty()) return usage("no output (-o FILE.gltf or FILE.glb)");
  if (is_other && options.checks) return usage("--checks is for the scenes A, B, C and D");
  if (is_other && (options.normals || options.uvs))
    return usage("--normals and --uvs are for the scenes A, B, C and D");
  if (is_other && options.order != MeshOrder::kRow) return usage("--order is for the scenes A, B and C");
  if (is_zorah && options.gpu_instancing)
    return usage("--gpu-instancing cannot be used with zorah, which has its own instances");
  if (is_pane && options.gpu_instancing)
    return usage("--gpu-instancing cannot be used with panes: each pane is a mesh of its own");
  if (options.scene == "D" && options.order != MeshOrder::kRow) return usage("scene D has row order only");
  const uint32_t size = options.texture_size.value_or(64);
  if (!std::has_single_bit(size) || size < 64 || size > 8192)
    return usage("--texture-size must be a power of two from 64 to 8192");
  if (!is_scattered && options.scene != "panes-textured" && options.texture_size)
    return usage("--texture-size can be used only with slope, forest and panes-textured");
  if (!is_scattered && options.seed != 1)
    return usage("--seed can be used only with slope and forest: the other scenes are fixed");
  return {};
}

}  // namespace

Result<SynthReport> synthesize(const SynthOptions& options) {
  SCREE_TRY(check_options(options));
  SynthOptions sized = options;
  if (!sized.texture_size) sized.texture_size = options.scene == "forest" ? 4096 : 1024;
  if (options.scene == "slope") return write_slope(sized);
  if (options.scene == "forest") return write_forest(sized);
  if (options.scene == "panes" || options.scene == "panes-textured") return write_panes(sized);
  if (options.scene == "A") return write_scene(terrain_scene(options.order, options.scale), options);
  if (options.scene == "B") return write_scene(lantern_scene(options.order, options.scale), options);
  if (options.scene == "C") return write_scene(zorahlike_scene(options.order, options.scale), options);
  if (options.scene == "D") return write_scene(sponzalike_scene(options.scale), options);
  if (options.scene == "zorah") return write_zorah(zorah_plan(options.scale), options);
  if (options.scene == "zorah-textured") return write_zorah(zorah_textured_plan(options.scale), options);
  return usage("no scene \"" + options.scene +
               "\": A, B, C, D, slope, forest, panes, panes-textured, zorah or zorah-textured");
}

}  // namespace scree::synth

namespace scree::tools {
namespace {

Result<synth::SynthReport> synthesize_or_stop(synth::SynthOptions options) {
  if (options.output.empty()) return synth::synthesize(options);
  const StopOnSignal handlers;
  options.stop = StopOnSignal::flag();
  return synth::synthesize(options);
}

std::string hexadecimal(uint64_t value) {
  char text[20];
  std::snprintf(text, sizeof text, "%016" PRIx64, value);
  return text;
}

Result<void> run_synth(const synth::SynthOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  SCREE_TRY(check_output_file(options.output, options.existing));
  const synth::SynthReport report = SCREE_TRY(synthesize_or_stop(options));
  if (!options.output.empty()) note_written(options.output);
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  if (options.json) {
    const std::string text = json_object([&](JsonWriter& json) {
      json.member("scene", options.scene);
      if (!options.output.empty()) json.member("output", options.output);
      json.member("triangles", report.drawn_triangles);
      json.member("unique_triangles", report.unique_triangles);
      json.member("instances", report.instances);
      json.member("vertices", report.vertices);
      json.member("output_bytes", report.file_bytes);
      if (options.checks) {
        // As texts, because readers of JSON may keep only 53 of the 64 bits.
        json.member("position_sum", hexadecimal(report.position_sum));
        json.member("index_sum", hexadecimal(report.index_sum));
      }
      json.member("seconds", seconds);
    });
    std::printf("%s\n", text.c_str());
    return finish_output();
  }
  if (options.checks)
    std::printf("%s %s 0 %s %s\n", options.scene.c_str(), options.order == synth::MeshOrder::kRow ? "row" : "block",
                hexadecimal(report.position_sum).c_str(), hexadecimal(report.index_sum).c_str());
  if (!options.progress) return finish_output();
  std::fprintf(stderr,
               "scene %s -> %s: %" PRIu64 " triangles in %" PRIu64 " instances (%" PRIu64 " unique), %" PRIu64
               " bytes, %.2f s, %.2f M vertices/s\n",
               options.scene.c_str(), options.output.empty() ? "(no file)" : options.output.c_str(),
               report.drawn_triangles, report.instances, report.unique_triangles, report.file_bytes, seconds,
               static_cast<double>(report.vertices) / seconds * 1e-6);
  return finish_output();
}

}  // namespace

Command add_synth(CLI::App& parent) {
  const auto options = std::make_shared<synth::SynthOptions>();
  CLI::App* app = parent.add_subcommand(
      "synth",
      "Writes a generated scene as glTF, streaming: the measured scenes A (terrain), B (one mesh 3000 times), C (2000\n"
      "meshes, 26,000 instances) and D (a small hall), a slope of textured stones, a forest of leaf cards with alpha\n"
      "masks, 8 panes of glass that fill the picture one behind another, or scenes with the counts of NVIDIA's\n"
      "Zorah: zorah (geometry behind EXT_meshopt_compression, 10 GB) and zorah-textured (also 4,418 KTX2 textures,\n"
      "78 GB).");
  add_value(*app, "scene", "SCENE", options->scene,
            "A, B, C, D, slope, forest, panes, panes-textured, zorah or zorah-textured")
      ->required();
  add_value(
      *app, "-o,--output", "FILE", options->output,
      "FILE.gltf, with FILE.bin and others beside it, or FILE.glb (not for zorah; a .glb past 4 GiB has version 3,\n"
      "which few programs read)");
  add_value(*app, "--scale", "SHARE", options->scale,
            "Share of the triangles to keep, above 0 to 1: A to D have coarser grids (n * sqrt(scale)) under\n"
            "the same cameras (A's tiles are stretched to cover the same ground), the slope fewer stones, the\n"
            "forest fewer plants, zorah fewer triangles per primitive and texels per texture, and there are fewer\n"
            "panes")
      ->capture_default_str();
  const auto order = std::make_shared<std::string>("row");
  add_value(*app, "--order", "ORDER", *order,
            "Order of triangles and vertices: row, or block: blocks of 8 x 8 quads (A, B, C)")
      ->check(CLI::IsMember({"row", "block"}))
      ->capture_default_str();
  app->add_flag("--normals", options->normals, "A to D: add normals");
  app->add_flag("--uvs", options->uvs, "A to D: add texture coordinates and a texture");
  app->add_flag("--gpu-instancing", options->gpu_instancing,
                "EXT_mesh_gpu_instancing instead of one node per instance");
  app->add_flag(
      "--checks", options->checks,
      "A to D: print scene, order, 0 and the order-independent sums of positions and indices (-o is not needed)");
  add_whole(*app, "--threads", options->threads, 0, kMostThreads, "Threads; 0: one per processor");
  add_whole(*app, "--seed", options->seed, 0, kMostWhole, "Slope, forest: seed of the positions of stones or plants");
  add_value(*app, "--texture-size", "N", options->texture_size,
            "Slope, forest, panes-textured: texels per side, a power of two from 64 to 8192 (default: 1024, for the\n"
            "forest 4096)");
  const auto force = std::make_shared<bool>(false);
  app->add_flag("-f,--force", *force, kForceHelp);
  app->add_flag("--json", options->json,
                "Print one JSON object on standard output instead of the closing line and the sums of --checks");
  const auto quiet = std::make_shared<bool>(false);
  app->add_flag("-q,--quiet", *quiet, "No progress and no closing line");
  return {app, [options, order, force, quiet] {
            options->progress = !*quiet;
            options->existing = existing_of(*force);
            if (*order == "block") options->order = synth::MeshOrder::kBlock;
            return run_synth(*options);
          }};
}

}  // namespace scree::tools
