#include "tools/render/render_options.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <optional>
#include <utility>

#include "format/text.h"
#include "runtime/textures/srgb.h"
#include "tools/common/load_scene.h"
#include "tools/common/options/options.h"

namespace scree::tools {
namespace {

Error usage(std::string_view option, std::string_view text, const std::string& expected) {
  return {ErrorCode::kUsage, std::string(option) + ": '" + std::string(text) + "' is not " + expected};
}

bool has_extension(const std::string& path, std::string_view extension) {
  return format::lower_case(std::filesystem::path(path).extension().string()) == extension;
}

struct NamedColor {
  std::string_view name;
  std::string_view code;
};

constexpr std::array<NamedColor, 10> kColors{{{"black", "#000000"},
                                              {"white", "#ffffff"},
                                              {"gray", "#808080"},
                                              {"grey", "#808080"},
                                              {"red", "#ff0000"},
                                              {"green", "#008000"},
                                              {"blue", "#0000ff"},
                                              {"skyblue", "#87ceeb"},
                                              {"none", "#00000000"},
                                              {"transparent", "#00000000"}}};

/// A direction of --view.
struct Direction {
  double turn_degrees;  // to the right of the front
  double rise_degrees;
};

/// The parts of "a,b,c"; a text without the separator is one part.
std::vector<std::string_view> split(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  for (;;) {
    const size_t end = text.find(separator);
    parts.push_back(text.substr(0, end));
    if (end == std::string_view::npos) return parts;
    text.remove_prefix(end + 1);
  }
}

std::optional<double> number(std::string_view text) {
  while (!text.empty() && text.front() == ' ') text.remove_prefix(1);
  while (!text.empty() && text.back() == ' ') text.remove_suffix(1);
  if (text.starts_with('+')) text.remove_prefix(1);
  double value = 0;
  const auto [rest, status] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (status != std::errc{} || rest != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::optional<uint32_t> whole(std::string_view text) {
  uint32_t value = 0;
  const auto [rest, status] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (status != std::errc{} || rest != text.data() + text.size()) return std::nullopt;
  return value;
}

Result<PixelPlace> parse_pick(std::string_view text, uint32_t width, uint32_t height) {
  const std::vector<std::string_view> parts = split(text, ',');
  const std::string expected = "a pixel X,Y with X below " + std::to_string(width) + " and Y below " +
                               std::to_string(height) + ", counted from the top left";
  if (parts.size() != 2) return usage("--pick", text, expected);
  const auto x = whole(parts[0]);
  const auto y = whole(parts[1]);
  if (!x || !y || *x >= width || *y >= height) return usage("--pick", text, expected);
  return PixelPlace{*x, *y};
}

/// Parses kCount numbers separated by commas.
template <size_t kCount>
std::optional<std::array<double, kCount>> numbers(std::string_view text) {
  const std::vector<std::string_view> parts = split(text, ',');
  if (parts.size() != kCount) return std::nullopt;
  std::array<double, kCount> out{};
  for (size_t i = 0; i < kCount; ++i) {
    const std::optional<double> value = number(parts[i]);
    if (!value) return std::nullopt;
    out[i] = *value;
  }
  return out;
}

/// "1,-2.5,3e4": three finite numbers. `what` names the option.
Result<runtime::Vec3> parse_vector(std::string_view text, std::string_view what) {
  if (const std::optional<runtime::Vec3> out = numbers<3>(text)) return *out;
  return usage(what, text, "three numbers X,Y,Z");
}

/// "0,0,0,1,2.5,3": a box in the world, the smallest X, Y and Z and then the largest.
Result<runtime::WorldBox> parse_clip_box(std::string_view text) {
  const std::optional<std::array<double, 6>> corners = numbers<6>(text);
  bool is_box = corners.has_value();
  runtime::WorldBox box;
  for (size_t i = 0; i < 3 && is_box; ++i) {
    box.min[i] = (*corners)[i];
    box.max[i] = (*corners)[i + 3];
    is_box = box.min[i] <= box.max[i];
  }
  if (!is_box)
    return usage("--clip-box", text, "six numbers X0,Y0,Z0,X1,Y1,Z1, the smaller corner of a box and then the larger");
  return box;
}

/// Layers of an .exr, "color,depth".
Result<ExrLayers> parse_layers(std::string_view text) {
  ExrLayers out{false, false, false, false, false, true, false};
  const std::pair<std::string_view, bool*> names[] = {
      {"color", &out.color}, {"depth", &out.depth}, {"normal", &out.normal}, {"uv", &out.uv}, {"id", &out.id}};
  for (const std::string_view part : split(text, ',')) {
    const auto* const named =
        std::find_if(std::begin(names), std::end(names), [&](const auto& one) { return one.first == part; });
    if (named == std::end(names)) return usage("--layers", text, "a list of color, depth, normal, uv, id");
    *named->second = true;
  }
  return out;
}

/// Parses --camera, --view, --eye, --target, --up and --fov.
Result<void> parse_camera(const RenderWords& words, runtime::CameraOptions& camera) {
  camera.camera = words.camera;
  const std::pair<const std::string*, std::optional<runtime::Vec3>*> vectors[] = {
      {&words.eye, &camera.eye}, {&words.target, &camera.target}, {&words.up, &camera.up}};
  const char* const names[] = {"--eye", "--target", "--up"};
  for (size_t i = 0; i < 3; ++i) {
    if (vectors[i].first->empty()) continue;
    if (!words.camera.empty())
      return Error{ErrorCode::kUsage, std::string("--camera and ") + names[i] + " exclude each other"};
    *vectors[i].second = SCREE_TRY(parse_vector(*vectors[i].first, names[i]));
  }
  if (!words.view.empty()) {
    if (!words.camera.empty() || camera.eye) return Error{ErrorCode::kUsage, "--view excludes --camera and --eye"};
    Direction direction{};
    SCREE_TRY(parse_choice(words.view, "--view", direction,
                           {{"front", {0, 0}},
                            {"right", {90, 0}},
                            {"back", {180, 0}},
                            {"left", {-90, 0}},
                            {"top", {0, 90}},
                            {"bottom", {0, -90}},
                            {"iso", {45, 35.26438968275465}}}));  // atan(1 / sqrt(2))
    camera.turn_degrees = direction.turn_degrees;
    camera.rise_degrees = direction.rise_degrees;
  }
  if (camera.target && !camera.eye) return Error{ErrorCode::kUsage, "--target needs --eye"};
  if (!words.fov.empty()) {
    const std::optional<double> degrees = number(words.fov);
    if (!degrees || !(*degrees >= runtime::kSmallestFovDegrees && *degrees < 180))
      return usage("--fov", words.fov, "an angle of at least 1e-9 and below 180 degrees");
    camera.fov_degrees = *degrees;
  }
  return {};
}

/// Parses --ssao and --edl.
Result<void> parse_occlusion(const RenderWords& words, kernels::ShadeOptions& shade) {
  shade.ssao = words.ssao;
  shade.edl = words.edl;
  const std::pair<const char*, const std::string*> numbers[] = {{"--edl-strength", &words.edl_strength},
                                                                {"--edl-radius", &words.edl_radius}};
  for (const auto& [name, text] : numbers)
    if (!text->empty() && !words.edl) return Error{ErrorCode::kUsage, std::string(name) + " needs --edl"};
  if (!words.edl_strength.empty()) {
    const std::optional<double> strength = number(words.edl_strength);
    if (!strength || *strength < 0 || *strength > 100)
      return usage("--edl-strength", words.edl_strength, "a number from 0 to 100");
    shade.edl_strength = static_cast<float>(*strength);
  }
  if (words.edl_radius.empty()) return {};
  return assign(shade.edl_radius, parse_whole(words.edl_radius, 1, 64, "--edl-radius"));
}

/// Parses --path and its options. `options` already has the outputs.
Result<void> parse_path(const RenderWords& words, RenderOptions& options) {
  if (words.path.empty()) {
    for (const auto& [name, is_given] : {std::pair("--fps", !words.fps.empty()), std::pair("--resume", words.resume),
                                         std::pair("--share", !words.share.empty())})
      if (is_given) return Error{ErrorCode::kUsage, std::string(name) + " needs --path"};
    if (words.frames.find_first_of(":/") != std::string::npos)
      return Error{ErrorCode::kUsage,
                   "--frames: '" + words.frames + "' selects frames of a --path, but there is no --path"};
    return assign(options.frames, parse_whole(words.frames.empty() ? "1" : words.frames, 1, 1000000, "--frames"));
  }
  const std::pair<const char*, bool> others[] = {{"--camera", !words.camera.empty()},
                                                 {"--view", !words.view.empty()},
                                                 {"--eye", !words.eye.empty()},
                                                 {"--target", !words.target.empty()},
                                                 {"--up", !words.up.empty()},
                                                 {"--fov", !words.fov.empty()},
                                                 {"--pick", !words.picks.empty()},
                                                 {"--list-cameras", words.list_cameras},
                                                 {"--stats", words.stats},
                                                 {"--normals", !words.normals.empty()},
                                                 {"--uvs", !words.uvs.empty()}};
  for (const auto& [name, is_given] : others)
    if (is_given) return Error{ErrorCode::kUsage, std::string("--path and ") + name + " exclude each other"};
  if (words.resume && words.force)
    return Error{ErrorCode::kUsage,
                 "--resume and --force exclude each other: existing frames are either kept or replaced"};
  if (options.writes_exr()) return usage("--output", options.output, "a .png file, as frames of a --path are");
  PathOptions path;
  path.file = words.path;
  path.resume = words.resume;
  if (!words.share.empty())
    SCREE_TRY(parse_choice(words.share, "--share", path.shares_geometry, {{"frames", false}, {"geometry", true}}));
  if (!words.frames.empty()) path.frames = SCREE_TRY(parse_frame_range(words.frames));
  if (!words.fps.empty()) {
    const std::optional<double> fps = number(words.fps);
    if (!fps || !(*fps >= 1e-9 && *fps < 1e6))
      return usage("--fps", words.fps, "frames per second, above 0 and below 1e6");
    path.frames_per_second = *fps;
  }
  const std::pair<const char*, const std::string*> outputs[] = {
      {"--output", &options.output}, {"--depth", &options.depth}, {"--visbuffer", &options.visbuffer}};
  for (const auto& [name, text] : outputs)
    if (!text->empty()) SCREE_TRY(FramePattern::parse(name, *text));
  // Pictures and depth images have fixed extensions; --visbuffer needs another one, so that the files of a frame have
  // different names.
  const std::string extension = format::lower_case(std::filesystem::path(options.visbuffer).extension().string());
  if (extension == ".png" || extension == ".pfm")
    return usage("--visbuffer", options.visbuffer, "a file with another extension than .png and .pfm");
  options.path = path;
  return {};
}

/// Checks the extensions of the outputs, and that no output replaces the scene or another output.
Result<void> check_outputs(const RenderOptions& options) {
  if (!options.writes_exr()) {
    if (!options.output.empty() && !has_extension(options.output, ".png"))
      return usage("--output", options.output, "a .png or .exr file");
    if (options.layers.are_chosen) return Error{ErrorCode::kUsage, "--layers needs -o NAME.exr"};
    if (options.layers.float_color) return Error{ErrorCode::kUsage, "--float needs -o NAME.exr"};
  }
  const auto outputs = options.outputs();
  for (const auto& [name, path] : outputs) {
    if (path.empty()) continue;
    if (is_same_file(path, options.file))
      return Error{ErrorCode::kUsage, "--" + std::string(name) + ": " + path + " is the file to draw"};
    if (!options.light.environment.empty() && is_same_file(path, options.light.environment))
      return Error{ErrorCode::kUsage, "--" + std::string(name) + ": " + path + " is the environment"};
    for (const auto& [other_name, other] : outputs)
      if (&other != &path && !other.empty() && is_same_file(other, path))
        return Error{ErrorCode::kUsage, "--" + std::string(name) + " and --" + other_name + " are both " + path};
  }
  const std::array<std::pair<RenderOptions::Output, const char*>, 3> floats{
      {{{"depth", options.depth}, "a .pfm file, which holds a float per pixel (--show depth draws a .png)"},
       {{"normals", options.normals}, "a .pfm file, which holds three floats per pixel (--show normal draws a .png)"},
       {{"uvs", options.uvs}, "a .pfm file, which holds three floats per pixel (--show uv draws a .png)"}}};
  for (const auto& [output, expected] : floats)
    if (!output.path.empty() && !has_extension(output.path, ".pfm"))
      return usage("--" + std::string(output.name), output.path, expected);
  return {};
}

}  // namespace

Result<kernels::Show> parse_show(std::string_view text) {
  using kernels::Show;
  Show show{};
  SCREE_TRY(parse_choice(text, "--show", show,
                         {{"texture", Show::kTexture},
                          {"color", Show::kColor},
                          {"uv", Show::kUv},
                          {"normal", Show::kNormal},
                          {"triangle", Show::kTriangle},
                          {"cluster", Show::kCluster},
                          {"mesh", Show::kMesh},
                          {"stage", Show::kStage},
                          {"depth", Show::kDepth}}));
  return show;
}

Result<std::array<float, 4>> parse_color(std::string_view text) {
  const std::string expected =
      "a colour: #rgb, #rrggbb, #rrggbbaa, none, transparent, black, white, gray, red, green, blue or skyblue";
  std::string code = format::lower_case(text);
  for (const NamedColor& named : kColors)
    if (code == named.name) code = named.code;
  if (!code.starts_with('#')) return usage("--background", text, expected);
  code.erase(0, 1);
  if (code.size() == 3) code = {code[0], code[0], code[1], code[1], code[2], code[2]};
  if (code.size() == 6) code += "ff";
  if (code.size() != 8) return usage("--background", text, expected);
  std::array<uint8_t, 4> bytes{};
  for (size_t i = 0; i < 4; ++i) {
    const char* const first = code.data() + 2 * i;
    const auto [rest, status] = std::from_chars(first, first + 2, bytes[i], 16);
    if (status != std::errc{} || rest != first + 2) return usage("--background", text, expected);
  }
  return std::array<float, 4>{runtime::linear_of_srgb(bytes[0]), runtime::linear_of_srgb(bytes[1]),
                              runtime::linear_of_srgb(bytes[2]), static_cast<float>(bytes[3]) / 255.0f};
}

runtime::SceneOptions RenderOptions::scene_options() const {
  runtime::SceneOptions load;
  load.textures = !output.empty() && shade.show == kernels::Show::kTexture;
  load.threads = threads;
  load.lighting = load.textures && shade.light ? light.lighting : kernels::Lighting::kCamera;
  load.environment = light.environment;
  load.texture_cache = textures.host_cache();
  load.reading = reading;
  return load;
}

runtime::LoadOptions RenderOptions::load_options() const {
  const runtime::SceneOptions parts = scene_options();
  runtime::LoadOptions load = tools::load_options(*this, textures);
  load.scene = scene;
  load.textures = parts.textures;
  load.lighting = parts.lighting;
  load.environment = parts.environment;
  load.reading = reading;
  load.camera = camera;
  load.pictures = {camera.width, camera.height, samples_per_side, output.empty() ? nullptr : &shade};
  load.pictures.shadow_side = light.shadow_side;
  return load;
}

bool RenderOptions::writes_exr() const {
  return has_extension(output, ".exr");
}

Result<void> check_picture_path(std::string_view option, const std::string& path) {
  if (has_extension(path, ".png")) return {};
  return usage(option, path, "a .png file");
}

Result<RenderOptions> parse_render_options(const RenderWords& words) {
  RenderOptions options;
  static_cast<PlainRenderOptions&>(options) = words;
  SCREE_TRY(assign<DrawOptions>(options, parse_draw_options(words)));
  options.camera.width = options.size.width;
  options.camera.height = options.size.height;
  if (!words.layers.empty()) options.layers = SCREE_TRY(parse_layers(words.layers));
  options.layers.float_color = words.float_color;
  options.existing = words.force ? format::Existing::kReplace : format::Existing::kRefuse;
  for (const auto& [name, is_given] :
       {std::pair("--stats", words.stats), std::pair("--list-cameras", words.list_cameras)})
    if (words.json && is_given)
      return Error{ErrorCode::kUsage, std::string("--json and ") + name + " exclude each other"};
  SCREE_TRY(parse_camera(words, options.camera));
  if (!words.clip_box.empty()) options.camera.clip_box = SCREE_TRY(parse_clip_box(words.clip_box));
  options.shade.show = SCREE_TRY(parse_show(words.show));
  options.shade.light = !words.no_light;
  options.light = SCREE_TRY(parse_light_options(words.light));
  if (words.no_light && options.light.lighting != kernels::Lighting::kAuto)
    return Error{ErrorCode::kUsage, "--no-light and --light exclude each other"};
  options.shade.lighting = options.light.lighting;
  options.shade.exposure = options.light.exposure;
  options.shade.blend_layers = options.light.blend_layers;
  SCREE_TRY(parse_occlusion(words, options.shade));
  const std::array<float, 4> background = SCREE_TRY(parse_color(words.background));
  std::copy(background.begin(), background.end(), options.shade.background);
  SCREE_TRY(parse_path(words, options));
  SCREE_TRY(parse_choice(words.exchange, "--exchange", options.exchange,
                         {{"auto", Exchange::kAuto}, {"mpi", Exchange::kMpi}, {"nccl", Exchange::kNccl}}));
  options.textures = SCREE_TRY(parse_texture_options(words.textures));
  for (const std::string& text : words.picks) {
    options.picks.push_back(SCREE_TRY(parse_pick(text, options.camera.width, options.camera.height)));
  }
  const auto outputs = options.outputs();
  const bool writes = std::any_of(outputs.begin(), outputs.end(), [](const auto& one) { return !one.path.empty(); });
  if (!writes && options.picks.empty() && !options.list_cameras) {
    if (options.path)
      return Error{ErrorCode::kUsage, "--path needs file names for the frames, such as -o frame_%05d.png"};
    options.output = std::filesystem::path(options.file).replace_extension(".png").string();
  }
  SCREE_TRY(check_outputs(options));
  if (options.scene_options().lighting != kernels::Lighting::kScene) options.light.shadow_side = 0;
  return options;
}

}  // namespace scree::tools
