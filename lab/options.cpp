#include "lab/options.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <string_view>

#include "kernels/visbuffer.h"

namespace scree::lab {

namespace {

constexpr std::array<std::string_view, 6> kScenes{"A", "B", "C", "D", "lantern", "A60"};
constexpr double kSixtyMillion = 0.15;  // the share of A's triangles that gives 60 M
constexpr uint32_t kLeastBits = 8;
constexpr const char* kAllPositions = "8,9,10,11,12,13,14,15,16,17,18,19,20,21,22,23,24,float32";
constexpr const char* kSweepPositions = "8,10,12,14,16,18,20,24";  // compared with float32
constexpr uint32_t kMaxCurveSide = kernels::kMaxImageSide / kReferenceSamples;

Error usage(std::string message) {
  return {ErrorCode::kUsage, std::move(message)};
}

/// Splits "a,b,c". Removes spaces around the parts.
std::vector<std::string> split(std::string_view text) {
  std::vector<std::string> parts;
  while (true) {
    const size_t end = text.find(',');
    std::string_view part = text.substr(0, end);
    while (part.starts_with(' ')) part.remove_prefix(1);
    while (part.ends_with(' ')) part.remove_suffix(1);
    parts.emplace_back(part);
    if (end == std::string_view::npos) return parts;
    text.remove_prefix(end + 1);
  }
}

Result<std::vector<std::string>> parse_scenes(const std::string& text) {
  const std::vector<std::string> names = split(text.empty() ? "A,B,C,D" : text);
  for (const std::string& name : names)
    if (std::find(kScenes.begin(), kScenes.end(), name) == kScenes.end())
      return usage("--scene: no scene \"" + name + "\": A, B, C, D, lantern or A60, separated by commas, or textured");
  return names;
}

Result<std::vector<Encoding>> parse_encodings(const std::string& positions, const std::string& indices) {
  std::vector<Encoding> encodings;
  for (const std::string& word : split(positions)) {
    Encoding encoding;
    encoding.float32 = word == "float32";
    if (!encoding.float32) {
      const Result<uint64_t> bits = tools::parse_whole(word, kLeastBits, format::kMaxPositionBits, "--positions");
      if (!bits) return usage("--positions: '" + word + "' is not float32 or a number of bits from 8 to 24");
      encoding.position_bits = static_cast<uint32_t>(*bits);
    }
    for (const std::string& kind : split(indices)) {
      if (kind != "auto" && kind != "packed" && kind != "32" && kind != "clustered")
        return usage("--indices: '" + kind + "' is not packed, 32, clustered or auto");
      if (kind == "clustered" && encoding.float32) continue;  // clusters need lattice positions
      encoding.packed_indices = kind == "auto" ? !encoding.float32 : kind == "packed";
      encoding.clustered = kind == "clustered";
      encodings.push_back(encoding);
    }
  }
  if (encodings.empty()) return usage("--indices: clustered needs --positions in bits, not float32");
  return encodings;
}

Result<std::vector<Culling>> parse_culling(const std::string& text) {
  std::vector<Culling> cullings;
  for (const std::string& word : split(text)) {
    if (word != "all" && word != "bounds" && word != "none")
      return usage("--culling: '" + word + "' is not all, bounds or none");
    cullings.push_back({word != "none", word == "all"});
  }
  return cullings;
}

Result<std::vector<uint32_t>> parse_samples(const std::string& text) {
  std::vector<uint32_t> samples;
  for (const std::string& word : split(text)) {
    if (word != "1" && word != "2" && word != "4")
      return usage("--samples: '" + word + "' is not 1, 2 or 4 (per side of a pixel)");
    samples.push_back(static_cast<uint32_t>(word[0] - '0'));
  }
  return samples;
}

Result<std::vector<bool>> parse_switches(const char* option, const std::string& text) {
  std::vector<bool> switches;
  for (const std::string& word : split(text)) {
    if (word != "on" && word != "off") return usage(std::string(option) + ": '" + word + "' is not on or off");
    switches.push_back(word == "on");
  }
  return switches;
}

Result<std::vector<Effects>> parse_effects(const std::string& text) {
  constexpr Effects kAll[] = {{false, false}, {true, false}, {false, true}, {true, true}};
  std::vector<Effects> effects;
  for (const std::string& word : split(text)) {
    const auto* named =
        std::find_if(std::begin(kAll), std::end(kAll), [&](const Effects& one) { return effects_name(one) == word; });
    if (named == std::end(kAll)) return usage("--effects: '" + word + "' is not none, ssao, edl or ssao+edl");
    effects.push_back(*named);
  }
  return effects;
}

/// Rejects options that --reference and --curves cannot use, because they draw convert's file in one way only.
Result<void> check_reference(const LabWords& words, const LabOptions& options) {
  const LabWords defaults;
  if (words.path || words.sweep || words.stages || words.near != defaults.near)
    return usage("--reference and --curves exclude --path, --sweep, --stages and --near");
  if (words.samples != defaults.samples || words.sampleless != defaults.sampleless ||
      words.culling != defaults.culling || words.effects != defaults.effects)
    return usage("--reference and --curves exclude --samples, --sampleless, --culling and --effects");
  for (const Encoding& encoding : options.encodings)
    if (!encoding.float32 && !encoding.packed_indices && !encoding.clustered)
      return usage("--indices: convert writes only packed or clustered");
  if (options.curves && options.size && std::max(options.size->width, options.size->height) > kMaxCurveSide)
    return usage("--size: --curves allows at most " + std::to_string(kMaxCurveSide) +
                 " pixels per side, because its reference has " + std::to_string(kReferenceSamples) +
                 " samples per side of a pixel");
  return {};
}

/// The peer draws generated scenes with float32 positions, once per view.
Result<void> check_peer(const LabWords& words, const LabOptions& options) {
  if (words.peer != "vulkan") return usage("--peer: '" + words.peer + "' is not vulkan");
  if (options.scenes.empty()) return usage("--peer draws generated scenes: it needs --scene, not a file");
  if (words.path || words.sweep || words.near != LabWords().near)
    return usage("--peer excludes --path, --sweep and --near");
  if (options.reference) return usage("--peer excludes --reference and --curves");
  if (std::none_of(options.encodings.begin(), options.encodings.end(), [](const Encoding& one) { return one.float32; }))
    return usage("--peer is compared with float32: add it to --positions");
  return {};
}

/// Options of the scene "textured", which is measured alone.
Result<LabOptions> parse_textured(const LabWords& words, LabOptions options) {
  const LabWords defaults;
  if (words.positions != defaults.positions || words.indices != defaults.indices || words.order != defaults.order ||
      words.scale != defaults.scale || words.samples != defaults.samples || words.sampleless != defaults.sampleless ||
      words.culling != defaults.culling || words.effects != defaults.effects || !words.views.empty() || words.path ||
      words.near != defaults.near || words.sweep || words.stages || words.reference || words.curves ||
      !words.peer.empty() || !words.csv.empty())
    return usage(
        "--scene textured allows only --textures, --texture-size, --texture-cache, --size, --frames and --warmup");
  options.is_textured = true;
  if (words.textures < 1 || words.textures > 1000) return usage("--textures: 1 to 1000");
  if (words.texture_size == 0 || words.texture_size % 1024 != 0 || words.texture_size > 32768)
    return usage("--texture-size: expected 1024, 2048, ... 32768 texels per side");
  options.texture_cache = SCREE_TRY(tools::parse_size(words.texture_cache, "--texture-cache", options.texture_cache));
  if (!words.size.empty()) options.size = SCREE_TRY(tools::parse_image_size(words.size, "--size"));
  if (words.frames == 0) return usage("--frames is at least 1");
  return options;
}

/// The named views. Each must belong to at least one of the scenes.
Result<std::vector<std::string>> parse_views(const std::string& text, const std::vector<std::string>& scenes) {
  std::vector<std::string> views;
  if (text.empty()) return views;
  views = split(text);
  if (scenes.empty()) return views;  // a file's cameras are known only when it is open
  std::vector<std::string> known;
  for (const std::string& scene : scenes)
    for (const synth::SceneCamera& camera : make_scene(scene, synth::MeshOrder::kRow, 1e-6).cameras)
      if (std::find(known.begin(), known.end(), camera.name) == known.end()) known.push_back(camera.name);
  for (const std::string& view : views) {
    if (std::find(known.begin(), known.end(), view) != known.end()) continue;
    std::string list;
    for (const std::string& name : known) list += (list.empty() ? "" : ", ") + name;
    return usage("--view: no view \"" + view + "\" in these scenes: " + list);
  }
  return views;
}

}  // namespace

std::string culling_name(const Culling& culling) {
  return culling.occlusion ? "all" : culling.bounds ? "bounds" : "none";
}

std::string effects_name(const Effects& effects) {
  if (!effects.ssao) return effects.edl ? "edl" : "none";
  return effects.edl ? "ssao+edl" : "ssao";
}

std::string file_name(const std::string& path) {
  return path.substr(path.find_last_of('/') + 1);
}

Result<LabOptions> parse_options(const LabWords& words) {
  LabOptions options;
  static_cast<PlainLabOptions&>(options) = words;
  options.backend = SCREE_TRY(tools::parse_backend("auto", words.device));
  options.reference = words.reference || words.curves;
  const bool has_file = !words.files.empty() && !options.reference;
  if (has_file && words.files.size() > 1) return usage("one .scree file at a time; --reference takes several models");
  if (has_file && !words.scenes.empty()) return usage("a file and --scene exclude each other");
  const LabWords defaults;
  if (has_file && (words.positions != defaults.positions || words.indices != defaults.indices ||
                   words.order != defaults.order || words.scale != defaults.scale))
    return usage("--positions, --indices, --order and --scale are for generated scenes, not for a file");
  if (words.scenes != "textured" && (words.files.empty() || !words.scenes.empty())) {
    options.scenes = SCREE_TRY(parse_scenes(options.reference && words.scenes.empty() ? "D" : words.scenes));
  }
  if (words.scenes == "textured") return parse_textured(words, std::move(options));
  if (!words.texture_cache.empty() || words.textures != defaults.textures ||
      words.texture_size != defaults.texture_size)
    return usage("--textures, --texture-size and --texture-cache are for --scene textured");
  std::string positions = words.positions;
  if (positions == defaults.positions && (options.curves || words.sweep))
    positions = options.curves ? kAllPositions : kSweepPositions;
  options.stage_times = words.stages;
  options.views = SCREE_TRY(parse_views(words.views, options.scenes));
  options.encodings = SCREE_TRY(parse_encodings(positions, words.indices));
  options.samples_per_side = SCREE_TRY(parse_samples(words.samples));
  options.sampleless_tests = SCREE_TRY(parse_switches("--sampleless", words.sampleless));
  options.culling = SCREE_TRY(parse_culling(words.culling));
  options.effects = SCREE_TRY(parse_effects(words.effects));
  if (!words.size.empty()) options.size = SCREE_TRY(tools::parse_image_size(words.size, "--size"));
  if (options.reference) SCREE_TRY(check_reference(words, options));
  if (words.order != "row" && words.order != "block")
    return usage("--order: '" + words.order + "' is not row or block");
  options.order = words.order == "row" ? synth::MeshOrder::kRow : synth::MeshOrder::kBlock;
  if (!(words.scale > 0 && words.scale <= 1)) return usage("--scale must be above 0 and at most 1");
  if (!(words.near >= 0 && words.near <= 1)) return usage("--near must be a share of the scene's size, from 0 to 1");
  if (words.frames == 0) return usage("--frames is at least 1");
  if (words.path && words.sweep) return usage("--path and --sweep exclude each other");
  if (words.sweep && has_file) return usage("--sweep generates its scene: it needs --scene, not a file");
  if (words.path && has_file) return usage("--path is the path of a generated scene: it needs --scene, not a file");
  if (words.path && !words.views.empty()) return usage("--path moves between a scene's two views: it excludes --view");
  options.has_peer = !words.peer.empty();
  if (options.has_peer) SCREE_TRY(check_peer(words, options));
  return options;
}

double scene_scale(const std::string& name, double scale) {
  return name == "D" || name == "A60" ? 1 : scale;
}

synth::Scene make_scene(const std::string& name, synth::MeshOrder order, double scale) {
  scale = scene_scale(name, scale);
  if (name == "A") return synth::terrain_scene(order, scale);
  if (name == "A60") return synth::terrain_scene(order, kSixtyMillion);
  if (name == "C") return synth::zorahlike_scene(order, scale);
  if (name == "D") return synth::sponzalike_scene(scale);
  synth::Scene scene = synth::lantern_scene(order, scale);
  if (name == "lantern") scene.instances.resize(1);
  return scene;
}

}  // namespace scree::lab
