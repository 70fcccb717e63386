// The words of `scree render`'s command line and what they mean.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "format/container/part_file.h"
#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/scene/camera.h"
#include "runtime/stream/upload.h"
#include "tools/common/backend.h"

namespace scree::tools {

/// As typed; empty where nothing was.
struct RenderWords {
  std::string file;
  std::string output;
  std::string depth;
  std::string visbuffer;
  std::string size = "1920x1080";
  std::string scene;
  std::string camera;
  std::string eye;
  std::string target;
  std::string up;
  std::string fov;
  std::string show = "texture";
  std::string samples = "1";
  std::string background = "#9aa4b0";
  std::string threads = "0";
  std::string backend = "auto";
  std::string device;
  std::string device_memory;
  std::string frames = "1";
  std::string host_memory;
  std::string texture_cache;
  std::string read = "auto";
  std::vector<std::string> picks;
  std::string edl_strength;
  std::string edl_radius;
  bool no_light = false;
  bool ssao = false;
  bool edl = false;
  bool list_cameras = false;
  bool stats = false;
  bool force = false;
  bool quiet = false;
};

struct PixelPlace {
  uint32_t x;
  uint32_t y;
};

struct RenderOptions {
  std::string file;
  std::string output;     // of the picture; empty: none
  std::string depth;      // likewise
  std::string visbuffer;  // likewise
  std::string scene;
  runtime::CameraOptions camera;  // its size is the picture's, in pixels
  kernels::ShadeOptions shade;
  uint32_t samples_per_side = 1;
  uint32_t threads = 1;
  BackendOptions backend;
  // Bytes of decoded blocks of JPEG textures; nothing: runtime::kHostTextureCache, on a GPU
  // runtime::kDeviceTextureCache.
  std::optional<uint64_t> texture_cache;
  uint64_t device_memory = 0;  // bytes the scene, its frames and the picture may take on the GPU; 0: what is free
  uint32_t frames = 1;         // drawn one after the other
  uint64_t host_memory = 0;    // bytes of pictures and pinned memory on the host; 0: no limit, no chunks kept
  runtime::Reading reading = runtime::Reading::kAuto;  // of a GPU's pages
  std::vector<PixelPlace> picks;
  format::Existing existing = format::Existing::kReplace;  // of all outputs
  bool list_cameras = false;
  bool stats = false;
  bool quiet = false;
};

/// Checks every word. Where nothing at all is asked for, the picture goes beside the file, with the extension .png.
/// Errors kUsage: the option, what was typed, what is allowed.
Result<RenderOptions> parse_render_options(const RenderWords& words);

/// A name of --show. Errors kUsage: the names there are.
Result<kernels::Show> parse_show(std::string_view text);

/// "#rgb", "#rrggbb", "#rrggbbaa", "none" or a name, as linear RGBA. Errors kUsage.
Result<std::array<float, 4>> parse_color(std::string_view text);

/// Whether `path` names a picture that can be written, a .png. Errors kUsage; `option` is named.
Result<void> check_picture_path(std::string_view option, const std::string& path);

/// "1,-2.5,3e4": three finite numbers. Errors kUsage; `what` names the option.
Result<runtime::Vec3> parse_vector(std::string_view text, std::string_view what);

}  // namespace scree::tools
