// The options of every command that draws a scene: render, bench, view.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/scene/scene.h"
#include "runtime/stream/upload.h"
#include "tools/common/options/backend.h"
#include "tools/common/options/options.h"

namespace CLI {
class App;
}

namespace scree::tools {

/// Options that choose threads and GPUs, as typed; empty if not given.
struct DeviceWords {
  std::string threads = "0";
  std::string backend = "auto";
  std::string device;
  std::string gpus = "1";
  std::string device_memory;
};

struct DeviceOptions {
  uint32_t threads = 1;
  BackendOptions backend;
  uint64_t device_memory = 0;  // limit for scene, frames and picture on the GPU, bytes; 0: all free memory
};

/// The same with the options of pictures and of reading, for render and bench.
struct DrawWords : DeviceWords {
  std::string size = "1920x1080";
  std::string samples = "1";
  std::string host_memory;
  std::string read = "auto";
};

struct DrawOptions : DeviceOptions {
  ImageSize size{1920, 1080};  // in pixels
  uint32_t samples_per_side = 1;
  uint64_t host_memory = 0;  // limit for pictures and pinned memory on the host; 0: no limit, no chunks kept
  runtime::Reading reading = runtime::Reading::kAuto;  // how a GPU's pages are read
};

/// Options of textures' memory, for render, view and bench.
struct TextureWords {
  std::string cache;
  std::string memory;
};

struct TextureOptions {
  uint64_t cache = 0;   // bytes of decoded blocks of JPEG textures; 0: the runtime's default for a host or a GPU
  uint64_t memory = 0;  // for runtime::set_texture_memory()

  uint64_t host_cache() const { return cache != 0 ? cache : runtime::kHostTextureCache; }
  uint64_t device_cache() const { return cache != 0 ? cache : runtime::kDeviceTextureCache; }
};

/// Options of light and blended surfaces, for render and view.
struct LightWords {
  std::string light;
  std::string environment;
  std::string exposure = "0";
  std::string blend_layers = "16";
  std::string shadow_size;
  bool shadows = false;
};

struct LightOptions {
  kernels::Lighting lighting = kernels::Lighting::kAuto;
  std::string environment;  // file; empty: the built-in clear sky
  float exposure = 1;       // factor
  uint32_t blend_layers = kernels::kBlendLayers;
  uint32_t shadow_side = 0;        // as for runtime::ShadowMap; 0: no shadows
  std::vector<std::string> words;  // as typed, without those of shadows: for the command that makes the same light
};

/// --light, --environment, --exposure, --blend-layers, --shadows, --shadow-size.
void add_light_options(CLI::App& app, LightWords& words);

/// Errors kUsage name the option, its value and the allowed values.
Result<LightOptions> parse_light_options(const LightWords& words);

/// Checks a scene that was loaded for drawing, and prints its warnings on stderr unless `quiet`. Errors kUsage name the
/// file: with --light scene it has no lights, or with --shadows no directional light.
Result<void> accept_scene(const char* command, const runtime::Scene& scene, const LightOptions& light, bool quiet);

/// Prints on stderr that `count` samples or frames (`kind`: "sample", "frame") have more layers of blended surfaces
/// than the `most` that were drawn; prints nothing if it is 0.
void warn_of_layers(const char* command, const std::string& path, uint64_t count, const std::string& kind,
                    uint32_t most);

/// --size and --samples.
void add_picture_options(CLI::App& app, DrawWords& words);
/// --threads, --backend, --device, --gpus and --device-memory.
void add_device_options(CLI::App& app, DeviceWords& words);
/// --host-memory and --read.
void add_reading_options(CLI::App& app, DrawWords& words);
/// --texture-cache and --texture-memory.
void add_texture_options(CLI::App& app, TextureWords& words);

/// Errors kUsage name the option, its value and the allowed values.
Result<DeviceOptions> parse_device_options(const DeviceWords& words);
Result<DrawOptions> parse_draw_options(const DrawWords& words);
Result<TextureOptions> parse_texture_options(const TextureWords& words);

}  // namespace scree::tools
