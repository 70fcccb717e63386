#include "tools/common/options/draw_options.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <system_error>
#include <tuple>
#include <utility>

#include <CLI/CLI.hpp>

#include "kernels/visbuffer.h"
#include "runtime/draw/shadow_map.h"
#include "tools/common/options/command.h"

namespace scree::tools {

void add_picture_options(CLI::App& app, DrawWords& words) {
  add_value(app, "--size", "WxH", words.size, "Pixels, WxH (default: 1920x1080)");
  add_value(app, "--samples", "N", words.samples, "Samples per pixel along each side: 1 (default), 2 or 4");
}

void add_device_options(CLI::App& app, DeviceWords& words) {
  add_value(app, "--threads", "N", words.threads, "Threads; 0: one per processor (default)");
  add_value(app, "--backend", "NAME", words.backend,
            "cpu, cuda, or auto (default): the GPU if one is usable, else the CPU, with a line that gives the reason");
  add_value(app, "--device", "N|UUID", words.device,
            "The GPU, by index or UUID as scree devices lists them (default: the first usable one)");
  add_value(app, "--gpus", "N|all", words.gpus,
            "Number of GPUs that draw the scene together, beginning with --device, or all (default: 1); each GPU keeps "
            "only a part of the scene if its memory cannot hold all of it");
  add_value(app, "--device-memory", "SIZE", words.device_memory,
            "Limit of a GPU's memory for scene, frames and picture, such as 8GiB (default: all free memory); chunks "
            "that do not fit are streamed");
}

void add_reading_options(CLI::App& app, DrawWords& words) {
  add_value(
      app, "--host-memory", "SIZE", words.host_memory,
      "Limit of host memory, such as 16GiB, for picture buffers, pinned memory, and chunks and pages of textures that "
      "the GPU's memory cannot hold (default and 0: no limit, such chunks and pages are read from the file)");
  add_value(app, "--read", "NAME", words.read,
            "How pages are read for the GPU: mapped (through a map of the file); buffered (through the page cache); "
            "direct (past the page cache); auto (default): direct for large files that are not cached, else buffered");
}

void add_texture_options(CLI::App& app, TextureWords& words) {
  add_value(app, "--texture-cache", "SIZE", words.cache,
            "Memory for decoded blocks of JPEG textures, such as 1GiB; the picture does not depend on it (default: "
            "64MiB, on a GPU 256MiB)");
  add_value(app, "--texture-memory", "SIZE", words.memory,
            "Limit of memory for pages of KTX2, DDS and JPEG textures, such as 8GiB; pages are read from the file when "
            "pixels show them, and the picture does not depend on the limit (default: 2GiB on the CPU; on a GPU, "
            "textures that fit are loaded whole, else they share its memory with geometry)");
}

void add_light_options(CLI::App& app, LightWords& words) {
  add_value(app, "--light", "NAME", words.light,
            "The light: camera (from the eye, on matt surfaces), environment (from all around) or scene (the file's "
            "own lights); default: environment if a drawn material has more than a base colour, else camera");
  add_value(app, "--environment", "FILE", words.environment,
            "Light from all around, given by a Radiance picture (.hdr) of all directions (default: a clear sky); "
            "implies --light environment");
  add_value(app, "--exposure", "STOPS", words.exposure,
            "Exposure in stops, -20 to 20 (default: 0); it does not affect --light camera");
  add_value(app, "--blend-layers", "N", words.blend_layers,
            "Largest number of layers of blended surfaces, such as glass, per sample, 0 to 65535 (default: 16); a "
            "warning gives the number of samples with more layers");
  app.add_flag("--shadows", words.shadows,
               "With --light scene: the first directional light casts shadows; blended surfaces cast none");
  add_value(app, "--shadow-size", "N", words.shadow_size,
            "Samples along the longer side of the shadow map, 64 to 16384 (default: 4096); a deep view has four maps "
            "of half the side");
}

Result<LightOptions> parse_light_options(const LightWords& words) {
  const auto usage = [](std::string message) { return Error{ErrorCode::kUsage, std::move(message)}; };
  LightOptions options{.environment = words.environment};
  const LightWords defaults;
  for (const auto& [name, word] :
       {std::pair("--light", &LightWords::light), std::pair("--environment", &LightWords::environment),
        std::pair("--exposure", &LightWords::exposure), std::pair("--blend-layers", &LightWords::blend_layers)})
    if (words.*word != defaults.*word) options.words.insert(options.words.end(), {name, words.*word});
  if (words.light.empty()) {
    if (!words.environment.empty()) options.lighting = kernels::Lighting::kEnvironment;
  } else {
    SCREE_TRY(parse_choice(words.light, "--light", options.lighting,
                           {{"camera", kernels::Lighting::kCamera},
                            {"environment", kernels::Lighting::kEnvironment},
                            {"scene", kernels::Lighting::kScene}}));
  }
  if (!words.environment.empty() && options.lighting != kernels::Lighting::kEnvironment)
    return usage("--environment is for --light environment, not " + words.light);
  char* end = nullptr;
  const double stops = std::strtod(words.exposure.c_str(), &end);
  if (words.exposure.empty() || end != words.exposure.c_str() + words.exposure.size() || !(std::abs(stops) <= 20))
    return usage("--exposure: '" + words.exposure + "' is not a number from -20 to 20");
  options.exposure = static_cast<float>(std::exp2(stops));
  const std::string& layers = words.blend_layers;
  const auto [last, error] = std::from_chars(layers.data(), layers.data() + layers.size(), options.blend_layers);
  if (error != std::errc() || last != layers.data() + layers.size() || options.blend_layers > UINT16_MAX)
    return usage("--blend-layers: '" + layers + "' is not a number from 0 to 65535");
  if (!words.shadows && !words.shadow_size.empty()) return usage("--shadow-size needs --shadows");
  if (words.shadows && options.lighting != kernels::Lighting::kScene) return usage("--shadows needs --light scene");
  if (words.shadows) options.shadow_side = runtime::kShadowSide;
  if (!words.shadow_size.empty()) {
    SCREE_TRY(assign(options.shadow_side, parse_whole(words.shadow_size, runtime::kLeastShadowSide,
                                                      kernels::kMaxImageSide, "--shadow-size")));
  }
  return options;
}

void warn_of_layers(const char* command, const std::string& path, uint64_t count, const std::string& kind,
                    uint32_t most) {
  if (count == 0) return;
  std::fprintf(stderr,
               "scree %s: warning: %s: %llu %s more than %u layers of blended surfaces; those behind are left out "
               "(--blend-layers)\n",
               command, path.c_str(), static_cast<unsigned long long>(count),
               (kind + (count == 1 ? " has" : "s have")).c_str(), most);
}

Result<void> accept_scene(const char* command, const runtime::Scene& scene, const LightOptions& light, bool quiet) {
  const std::string& path = scene.file().path();
  if (light.lighting == kernels::Lighting::kScene && scene.view().light_count == 0)
    return at(path, Error{ErrorCode::kUsage, "--light scene: the scene has no lights"});
  if (light.shadow_side != 0 && !runtime::find_sun(scene.view()))
    return at(path, Error{ErrorCode::kUsage, "--shadows: the scene has no directional light"});
  if (quiet) return {};
  for (const std::string& warning : scene.warnings())
    std::fprintf(stderr, "scree %s: warning: %s: %s\n", command, path.c_str(), warning.c_str());
  return {};
}

Result<DeviceOptions> parse_device_options(const DeviceWords& words) {
  DeviceOptions options;
  options.threads = SCREE_TRY(parse_threads(words.threads));
  options.backend = SCREE_TRY(parse_backend(words.backend, words.device, words.gpus));
  options.device_memory = SCREE_TRY(parse_size(words.device_memory, "--device-memory", 0));
  return options;
}

Result<TextureOptions> parse_texture_options(const TextureWords& words) {
  TextureOptions options;
  for (const auto& [name, word, size] : {std::tuple("--texture-cache", &words.cache, &options.cache),
                                         std::tuple("--texture-memory", &words.memory, &options.memory)}) {
    if (word->empty()) continue;
    const uint64_t bytes = SCREE_TRY(parse_size(*word, name, 0));
    *size = std::max<uint64_t>(bytes, 1);
  }
  return options;
}

Result<DrawOptions> parse_draw_options(const DrawWords& words) {
  const auto usage = [](const char* option, const std::string& text, const char* expected) {
    return Error{ErrorCode::kUsage, std::string(option) + ": '" + text + "' is not " + expected};
  };
  DrawOptions options;
  const ImageSize size = SCREE_TRY(parse_image_size(words.size, "--size"));
  options.size = size;
  if (words.samples != "1" && words.samples != "2" && words.samples != "4")
    return usage("--samples", words.samples, "1, 2 or 4");
  options.samples_per_side = static_cast<uint32_t>(words.samples[0] - '0');
  const uint64_t longest = uint64_t{std::max(size.width, size.height)} * options.samples_per_side;
  if (longest > kernels::kMaxImageSide)
    return Error{ErrorCode::kUsage, "--size " + words.size + " with --samples " + words.samples + " makes " +
                                        std::to_string(longest) + " samples per side, at most " +
                                        std::to_string(kernels::kMaxImageSide)};
  SCREE_TRY(assign<DeviceOptions>(options, parse_device_options(words)));
  options.host_memory = SCREE_TRY(parse_size(words.host_memory, "--host-memory", 0));
  SCREE_TRY(parse_choice(words.read, "--read", options.reading,
                         {{"auto", runtime::Reading::kAuto},
                          {"mapped", runtime::Reading::kMapped},
                          {"buffered", runtime::Reading::kBuffered},
                          {"direct", runtime::Reading::kDirect}}));
  return options;
}

}  // namespace scree::tools
