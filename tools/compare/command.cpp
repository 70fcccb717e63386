// scree compare: one picture of a scene, or its geometry, against another.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "format/layout.h"
#include "format/text.h"
#include "runtime/files/mapped_file.h"
#include "runtime/scene/camera.h"
#include "runtime/scene/scene.h"
#include "tools/common/options/command.h"
#include "tools/common/options/options.h"
#include "tools/common/output/json_writer.h"
#include "tools/common/output/output_file.h"
#include "tools/common/output/standard_output.h"
#include "tools/common/process/memory_use.h"
#include "tools/common/process/sigbus.h"
#include "tools/common/process/stop_signal.h"
#include "tools/compare/against_source.h"
#include "tools/compare/buffers.h"
#include "tools/compare/flip.h"
#include "tools/compare/geometry.h"
#include "tools/compare/images.h"
#include "tools/compare/report.h"
#include "tools/compare/source_model.h"
#include "tools/gltf/document/uri.h"
#include "tools/gltf/source.h"
#include "tools/render/render_options.h"

namespace scree::tools {
namespace {

using namespace compare;

/// Camera, size and output are options of render, and are checked in the same way.
struct CompareArguments {
  RenderWords render;  // `file`: the first one
  std::string other;
  std::vector<std::string> of;  // no file, one file for both buffers, or one file each
  std::string exclude;
  bool allow_outside = false;
  std::string flip;  // file for the picture of the FLIP error; empty: none
  double pixels_per_degree = kPixelsPerDegree;
  std::string memory;  // a size; empty: the available memory
  bool json = false;
  bool force = false;
};

enum class FileKind { kPicture, kScene, kSource, kBuffer };

constexpr const char* kWhatItCompares =
    "two PNG pictures, two visibility buffers (render --visbuffer), or a .scree file and the .gltf or .glb it was made "
    "from";

/// Recognises a glTF by its name, pictures and .scree files by their first bytes. Any other file is a visibility
/// buffer, which has no signature.
Result<FileKind> kind_of(const std::string& path) {
  const auto map = SCREE_TRY(runtime::MappedFile::open(path));
  const std::string extension = format::lower_case(std::filesystem::path(path).extension().string());
  if (extension == ".gltf" || extension == ".glb") return FileKind::kSource;
  constexpr uint8_t kPngMagic[8] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  const auto starts_with = [&](const uint8_t(&magic)[8]) {
    return map.size() >= sizeof magic && std::memcmp(map.bytes().data(), magic, sizeof magic) == 0;
  };
  if (starts_with(format::kMagic)) return FileKind::kScene;
  if (starts_with(kPngMagic)) return FileKind::kPicture;
  return FileKind::kBuffer;
}

const char* kind_name(FileKind kind) {
  constexpr const char* kNames[] = {"a PNG picture", "a .scree file", "a glTF", "a visibility buffer"};
  return kNames[static_cast<size_t>(kind)];
}

/// The reports of one comparison, printed together.
struct Findings {
  std::optional<PixelReport> pixels;
  std::optional<GeometryReport> geometry;
  std::optional<PictureReport> pictures;
};

Result<void> print(const CompareArguments& words, const Findings& findings) {
  std::string text;
  if (words.json) {
    JsonWriter json(text);
    json.begin_object();
    json.member("a", words.render.file);
    json.member("b", words.other);
    json.line();
    if (findings.pixels) json_pixels(json, *findings.pixels);
    if (findings.pictures) json_pictures(json, *findings.pictures, findings.pixels.has_value());
    if (findings.geometry) json_geometry(json, *findings.geometry);
    json.end_object();
    json.line();
    if (json.met_non_finite()) return Error{ErrorCode::kRange, "a result is not a finite number"};
  } else {
    text = words.render.file + " against " + words.other + "\n";
    if (findings.pixels) text += "\n" + text_pixels(*findings.pixels);
    if (findings.pictures) text += "\n" + text_pictures(*findings.pictures, findings.pixels.has_value());
    if (findings.geometry) text += "\n" + text_geometry(*findings.geometry);
  }
  std::fwrite(text.data(), 1, text.size(), stdout);
  return finish_output();
}

/// Loads a scene without textures. `pages`: whether to load its pages, for drawing.
Result<runtime::Scene> load_scene(const std::string& path, const RenderOptions& options, bool pages) {
  report_sigbus("compare", path);
  runtime::SceneFile file = SCREE_TRY(runtime::SceneFile::open(path));
  const uint32_t scene = SCREE_TRY(file.find_scene(options.scene));
  const runtime::SceneOptions load{.textures = false, .threads = options.threads, .pages = pages};
  return runtime::Scene::load(std::move(file), scene, load);
}

/// Checks the memory for the source, which the reference holds completely. Errors kMemory: more than --memory allows,
/// or than is available.
Result<void> check_memory(const CompareArguments& words, const std::string& source, uint64_t needed) {
  uint64_t allowed = available_memory();
  if (!words.memory.empty()) allowed = SCREE_TRY_AT("--memory", parse_size(words.memory));
  if (needed <= allowed || (allowed == 0 && words.memory.empty())) return {};
  return at(source, Error{ErrorCode::kMemory, "its vertices and triangles take " + format_bytes(needed) +
                                                  " of memory, but " + format_bytes(allowed) + " are " +
                                                  (words.memory.empty() ? "available" : "allowed (--memory)")});
}

Result<Findings> compare_scene(const CompareArguments& words, const std::string& file, const std::string& source,
                               const RenderOptions& options) {
  const convert::SourceScene gltf =
      SCREE_TRY(convert::import_gltf(source, {.exclude = words.exclude, .allow_outside = words.allow_outside}));
  SCREE_TRY(check_memory(words, source, source_model_bytes(gltf)));
  const runtime::Scene scene = SCREE_TRY(load_scene(file, options, true));
  Findings findings;
  findings.geometry = SCREE_TRY_AT(file, compare_geometry(gltf, scene.container()));

  const SourceModel model = SCREE_TRY_AT(file, load_source_model(gltf, scene.container(), scene.scene_index()));
  const kernels::View view = SCREE_TRY_AT(file, runtime::make_view(scene, options.camera));
  SourceReport drawn =
      SCREE_TRY_AT(file, compare_with_source(scene, model, view, words.pixels_per_degree, options.threads));
  SCREE_TRY(check_unchanged(scene.file().map()));
  findings.pixels = std::move(drawn.pixels);
  findings.pictures = std::move(drawn.pictures);
  return findings;
}

Result<Findings> compare_two_buffers(const CompareArguments& words, const RenderOptions& options) {
  const uint32_t width = options.camera.width, height = options.camera.height;
  const auto a = SCREE_TRY(read_visibility(words.render.file, width, height));
  const auto b = SCREE_TRY(read_visibility(words.other, width, height));
  std::vector<runtime::Scene> scenes;
  scenes.reserve(words.of.size());
  for (const std::string& path : words.of) {
    runtime::Scene loaded = SCREE_TRY(load_scene(path, options, false));
    scenes.push_back(std::move(loaded));
  }
  std::optional<SceneMatch> match;
  if (scenes.size() == 1) match.emplace(scenes[0]);
  if (scenes.size() == 2) {
    SceneMatch matched = SCREE_TRY(SceneMatch::match(scenes[0], scenes[1]));
    match.emplace(std::move(matched));
  }
  std::optional<kernels::View> view;  // a camera of a file may be orthographic
  if (!scenes.empty() && !options.camera.camera.empty())
    view = SCREE_TRY_AT(words.of.back(), runtime::make_view(scenes.back(), options.camera));
  PixelReport report =
      SCREE_TRY(compare_buffers(a, b, width, height, match ? &*match : nullptr, view ? &*view : nullptr));
  for (const runtime::Scene& scene : scenes) SCREE_TRY(check_unchanged(scene.file().map()));
  return Findings{.pixels = std::move(report)};
}

Result<Findings> find(const CompareArguments& words, const RenderOptions& options) {
  const FileKind a = SCREE_TRY(kind_of(words.render.file));
  const FileKind b = SCREE_TRY(kind_of(words.other));
  const bool buffers = a == FileKind::kBuffer && b == FileKind::kBuffer;
  if (!words.flip.empty() && buffers)
    return Error{ErrorCode::kUsage, "--flip needs two PNG pictures, or a .scree file and its glTF"};
  if (words.of.size() > 2) return Error{ErrorCode::kUsage, "--of may be given once, or twice: for A and for B"};
  if (!words.of.empty() && !buffers) return Error{ErrorCode::kUsage, "--of needs two visibility buffers"};
  if (buffers) return compare_two_buffers(words, options);
  if (a == FileKind::kPicture && b == FileKind::kPicture) {
    PictureReport report =
        SCREE_TRY(compare_pictures(words.render.file, words.other, words.pixels_per_degree, options.threads));
    return Findings{.pictures = std::move(report)};
  }
  if (a == FileKind::kScene && b == FileKind::kSource)
    return compare_scene(words, words.render.file, words.other, options);
  if (a == FileKind::kSource && b == FileKind::kScene)
    return compare_scene(words, words.other, words.render.file, options);
  return Error{ErrorCode::kUsage, words.render.file + " is " + kind_name(a) + " and " + words.other + " is " +
                                      kind_name(b) + "; expected " + kWhatItCompares};
}

/// Checks that neither output replaces an input or the other output.
Result<void> check_outputs(const CompareArguments& words) {
  const std::pair<const char*, const std::string*> outputs[] = {{"--output", &words.render.output},
                                                                {"--flip", &words.flip}};
  for (const auto& [name, output] : outputs) {
    if (output->empty()) continue;
    std::vector<std::string> inputs = words.of;
    inputs.insert(inputs.end(), {words.render.file, words.other});
    for (const std::string& path : inputs) {
      if (is_same_file(*output, path))
        return Error{ErrorCode::kUsage, std::string(name) + ": " + *output + " is one of the files to compare"};
    }
  }
  if (!words.flip.empty()) {
    if (!words.render.output.empty() && is_same_file(words.flip, words.render.output))
      return Error{ErrorCode::kUsage, "--output and --flip are both " + words.flip};
    SCREE_TRY(check_picture_path("--flip", words.flip));
  }
  for (const auto& [name, output] : outputs) SCREE_TRY(check_output_file(*output, existing_of(words.force)));
  return {};
}

Result<void> write_outputs(const CompareArguments& words, const Findings& findings) {
  const format::Existing existing = existing_of(words.force);
  const StopOnSignal handlers;
  if (const std::string& output = words.render.output; !output.empty()) {
    SCREE_TRY(findings.pixels ? write_difference(output, *findings.pixels, existing)
                              : write_flip(output, *findings.pictures, existing));
    note_written(output);
    if (StopOnSignal::flag()->load()) return Error{ErrorCode::kFile, "interrupted"};
  }
  if (words.flip.empty()) return {};
  SCREE_TRY(write_flip(words.flip, *findings.pictures, existing));
  note_written(words.flip);
  return {};
}

Result<void> run(const CompareArguments& words) try {
  RenderWords render = words.render;
  render.file.clear();
  render.list_cameras = true;  // without any output, render would choose one beside its file
  if (!render.output.empty()) SCREE_TRY(check_picture_path("--output", render.output));
  const RenderOptions options = SCREE_TRY(parse_render_options(render));
  if (std::isnan(words.pixels_per_degree))  // CLI::Range accepts nan
    return Error{ErrorCode::kUsage, "--ppd: nan, expected 1 to 1000"};
  SCREE_TRY(check_outputs(words));
  report_sigbus("compare", words.render.file);
  const Findings findings = SCREE_TRY(find(words, options));
  SCREE_TRY(write_outputs(words, findings));
  return print(words, findings);
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left to compare " + words.render.file + " with " + words.other};
}

}  // namespace

Command add_compare(CLI::App& parent) {
  const auto words = std::make_shared<CompareArguments>();
  RenderWords& render = words->render;
  CLI::App* app = parent.add_subcommand(
      "compare",
      "Measures how A differs from B: two PNG pictures, two visibility buffers of one view, or a .scree file (made\n"
      "with convert --source-ids) and its glTF, which a double-precision rasteriser draws and lights exactly. For a\n"
      ".scree file and its glTF it compares vertices, the pixels' triangles, depths, and the lit pictures without\n"
      "textures (PSNR and FLIP).");
  app->add_option("A", render.file, "A PNG, a visibility buffer, or a .scree file")->required();
  app->add_option("B", words->other, "The reference: a PNG, a visibility buffer, a .gltf or .glb")->required();
  add_value(*app, "-o,--output", "FILE", render.output,
            "A picture of the difference, a .png: right surfaces grey, background against surface blue, other\n"
            "mesh or triangle red, triangle sharing no vertex orange, neighbouring triangle green; of two\n"
            "PNGs the FLIP error, black 0 to white 1");
  add_value(*app, "--flip", "FILE", words->flip,
            "A picture of the FLIP error, a .png, black 0 to white 1: of two PNGs, or of the lit pictures of a\n"
            ".scree file and its glTF");
  add_value(*app, "--size", "WxH", render.size, "Pixels, WxH (default: 1920x1080)");
  add_camera_options(*app, render);
  add_repeated(
      *app, "--of", "FILE", words->of,
      "The .scree file of the buffers, to distinguish meshes and neighbours. Give it twice, A's file "
      "first, if the two differ in encoding (needs convert --source-ids). The depths of an orthographic camera "
      "also need --camera");
  add_value(*app, "--exclude", "REGEX", words->exclude, "The --exclude with which the .scree file was converted");
  app->add_flag("--allow-outside", words->allow_outside, convert::kAllowOutsideHelp);
  app->add_option(
         "--ppd", words->pixels_per_degree,
         "Pixels per degree of the viewer's eye for FLIP (default: 67, a 3840-pixel screen viewed from its width)")
      ->check(CLI::Range(1.0, 1000.0));
  add_value(*app, "--memory", "SIZE", words->memory,
            "Limit of memory for the glTF's vertices and triangles, all held at once, such as 8GiB (default: "
            "available memory)");
  add_value(*app, "--threads", "N", render.threads, "Threads; 0: one per processor (default)");
  app->add_flag("-f,--force", words->force, kForceHelp);
  app->add_flag("--json", words->json, "One JSON object");
  return {app, [words] { return run(*words); }};
}

}  // namespace scree::tools
