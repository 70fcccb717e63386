// The command line of `scree render`.
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
#include "runtime/draw/loaded_scene.h"
#include "runtime/scene/camera.h"
#include "runtime/scene/scene.h"
#include "tools/common/options/draw_options.h"
#include "tools/render/path_frames.h"

namespace scree::tools {

/// Options that are not parsed from text.
struct PlainRenderOptions {
  std::string file;
  std::string output;     // of the picture; empty: none
  std::string depth;      // likewise
  std::string normals;    // likewise
  std::string uvs;        // likewise
  std::string visbuffer;  // likewise
  std::string scene;
  bool list_cameras = false;
  bool stats = false;
  bool json = false;
  bool quiet = false;
};

/// The others as typed; empty if not given.
struct RenderWords : DrawWords, PlainRenderOptions {
  std::string layers;
  std::string camera;
  std::string view;
  std::string eye;
  std::string target;
  std::string up;
  std::string fov;
  std::string clip_box;
  std::string show = "texture";
  std::string background = "#9aa4b0";
  std::string path;
  std::string frames;
  std::string exchange = "auto";
  std::string share;
  std::string fps;
  std::vector<std::string> picks;
  std::string edl_strength;
  std::string edl_radius;
  TextureWords textures;
  LightWords light;
  bool no_light = false;
  bool ssao = false;
  bool edl = false;
  bool float_color = false;
  bool resume = false;
  bool force = false;
};

/// The layers of an .exr.
struct ExrLayers {
  bool color = true;
  bool depth = true;
  bool normal = true;
  bool uv = true;
  bool id = true;
  bool are_chosen = false;  // named by --layers
  bool float_color = false;
};

/// How ranks that draw one picture exchange its samples and colours.
enum class Exchange {
  kAuto,  // by NCCL, if it is found and saves time and each rank has a GPU of its own; otherwise by MPI
  kMpi,   // through host memory
  kNccl,  // from GPU to GPU; otherwise an error
};

struct PixelPlace {
  uint32_t x;
  uint32_t y;
};

/// Options of a moving camera. The outputs' names are then patterns (FramePattern).
struct PathOptions {
  std::string file;
  FrameRange frames;
  std::optional<double> frames_per_second;  // unset: the value in the file
  bool resume = false;                      // complete frames that exist are not drawn again
  bool shares_geometry = false;             // ranks draw every frame together
};

struct RenderOptions : DrawOptions, PlainRenderOptions {
  ExrLayers layers;               // of the picture, if it is an .exr
  runtime::CameraOptions camera;  // its size is the picture's, in pixels
  kernels::ShadeOptions shade;
  LightOptions light;
  TextureOptions textures;
  uint32_t frames = 1;  // of a still camera, drawn one after the other
  Exchange exchange = Exchange::kAuto;
  std::optional<PathOptions> path;
  std::vector<PixelPlace> picks;
  format::Existing existing = format::Existing::kReplace;  // of all outputs

  struct Output {
    const char* name;  // name of the option, without the dashes
    const std::string& path;
  };
  bool writes_exr() const;

  /// The parts of a scene that must be loaded for these outputs, including its pages.
  runtime::SceneOptions scene_options() const;
  /// The same for LoadedScene, with the needs of the picture. Refers to `shade`.
  runtime::LoadOptions load_options() const;

  /// All outputs, in the order in which they are written.
  std::array<Output, 5> outputs() const {
    return {{{"output", output}, {"depth", depth}, {"normals", normals}, {"uvs", uvs}, {"visbuffer", visbuffer}}};
  }
};

/// --scene, --camera, --view, --eye, --target, --up and --fov, of render and compare.
void add_camera_options(CLI::App& app, RenderWords& words);

/// Parses and checks all options. Without any output, the picture is written beside the scene with the extension .png.
/// Errors kUsage name the option, its value and the allowed values.
Result<RenderOptions> parse_render_options(const RenderWords& words);

/// Parses a name of --show. The error kUsage lists the names.
Result<kernels::Show> parse_show(std::string_view text);

/// "#rgb", "#rrggbb", "#rrggbbaa", "none" or a name, as linear RGBA. Errors kUsage.
Result<std::array<float, 4>> parse_color(std::string_view text);

/// Checks that `path` has the extension .png. Error kUsage names `option`.
Result<void> check_picture_path(std::string_view option, const std::string& path);

}  // namespace scree::tools
