// scree-lab's command line.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "format/result.h"
#include "lab/scenes/scene_tables.h"
#include "runtime/scene/scene.h"
#include "tools/common/options/backend.h"
#include "tools/common/options/options.h"
#include "tools/synth/scenes.h"

namespace scree::lab {

/// Options that are not parsed from text.
struct PlainLabOptions {
  std::vector<std::string> files;  // one .scree file, or none for generated scenes; with --reference glTF models
  double near = 0;                 // the near plane as a share of the scene's diagonal; 0: the view's own
  double scale = 1;                // for A, B and C
  uint32_t frames = 60;
  uint32_t warmup = 10;
  bool path = false;
  bool sweep = false;
  bool curves = false;  // the comparison of --reference for every width, and the studies
  std::string csv;      // empty: none
  // For the scene "textured", which is measured alone:
  uint32_t textures = 12;
  uint32_t texture_size = 16384;  // texels per side
};

/// The options that are parsed, as typed. Empty if not given.
struct LabWords : PlainLabOptions {
  std::string scenes;
  std::string views;
  std::string positions = "16,float32";
  std::string indices = "auto";
  std::string order = "row";
  std::string samples = "1";
  std::string sampleless = "on";
  bool stages = false;
  std::string culling = "all";
  std::string effects = "none";
  std::string size;
  std::string texture_cache;
  bool reference = false;
  bool sizes = false;
  std::string peer;
  std::string device;
};

using tools::ImageSize;

constexpr uint32_t kReferenceSamples = 8;  // per side of a pixel, for the supersampled reference of --curves

/// Effects drawn in addition to the shaded triangles.
struct Effects {
  bool ssao = false;  // ambient occlusion
  bool edl = false;   // eye-dome lighting
};

/// The kinds of clusters that are culled. The picture is always the same.
struct Culling {
  bool bounds = true;     // clusters outside the picture, and between pixel centres
  bool occlusion = true;  // also hidden clusters
};

struct LabOptions : PlainLabOptions {
  std::vector<std::string> scenes;  // names for make_scene()
  std::vector<std::string> views;   // empty: all of a scene
  std::vector<Encoding> encodings;  // for generated scenes
  synth::MeshOrder order = synth::MeshOrder::kRow;
  std::vector<uint32_t> samples_per_side;  // 1, 2, 4
  std::vector<Culling> culling;
  std::vector<Effects> effects;
  std::vector<bool> sampleless_tests;  // true: with the test
  bool stage_times = false;            // makes frames slower
  std::optional<ImageSize> size;       // replaces the scene's own size
  bool reference = false;              // compare with an exact picture of the source (judge_run.h); with `curves` too
  bool has_peer = false;               // measure Vulkan beside scree (peer/peer.h); some encoding is float32 then
  tools::BackendOptions backend;       // --reference and --curves draw on the CPU without a GPU; the others need one
  bool is_textured = false;            // the scene "textured", which is measured alone
  uint64_t texture_cache = runtime::kDeviceTextureCache;
};

/// "all", "bounds" or "none".
std::string culling_name(const Culling& culling);

/// "none", "ssao", "edl" or "ssao+edl".
std::string effects_name(const Effects& effects);

/// The last part of a path.
std::string file_name(const std::string& path);

/// Errors kUsage: an impossible value, with the possible ones.
Result<LabOptions> parse_options(const LabWords& words);

/// The share of a scene's triangles that are generated: `scale`, except for D and A60, which are always complete.
double scene_scale(const std::string& name, double scale);

/// A, B, C or D; "lantern": B's mesh, one instance; "A60": A with 60 M triangles. `name`: accepted by parse_options().
synth::Scene make_scene(const std::string& name, synth::MeshOrder order, double scale);

}  // namespace scree::lab
