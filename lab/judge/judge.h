// A glTF scene, drawn exactly by the reference rasteriser, and the pictures of what convert makes of it beside that.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "format/result.h"
#include "lab/judge/judged_case.h"
#include "lab/options.h"
#include "runtime/draw/device_scene.h"
#include "runtime/draw/renderer.h"
#include "tools/bench/file_views.h"
#include "tools/bench/times.h"
#include "tools/compare/images.h"
#include "tools/compare/source_model.h"

namespace scree::lab {

/// How frames are drawn and timed.
struct DrawSettings {
  bool gpu = false;
  uint32_t threads = 1;
  uint32_t frames = 60;  // fewer where they take longer than bench::kTimeBudgetMs
  uint32_t warmup = 10;  // likewise, a quarter of that
};

/// A source as convert packs it one way, ready to draw. Its file is mapped: it may be unlinked, not changed.
class PackedScene {
 public:
  /// Writes `path`, with source triangle numbers, and loads it, without textures. Errors: those of convert,
  /// Scene::load, DeviceScene::upload.
  static Result<PackedScene> make(const std::string& source, const std::string& path, const Encoding& encoding,
                                  const DrawSettings& settings);

  runtime::Scene& scene() { return *scene_; }
  const runtime::Scene& scene() const { return *scene_; }

  struct Drawn {
    runtime::Picture picture;  // RGB, black behind
    Times times;
    uint32_t frames = 0;
    std::optional<runtime::Frame> frame;  // the last one, its samples on the host
  };
  /// Draws `view` (of one sample a pixel) with so many samples a side. Errors: those of drawing and shading.
  Result<Drawn> draw(const kernels::View& view, uint32_t samples_per_side) const;

  /// What is the same for every picture: sizes and errors.
  void describe(JudgedCase& row) const;

 private:
  DrawSettings settings_;
  std::unique_ptr<runtime::Scene> scene_;
  std::unique_ptr<runtime::DeviceScene> device_;  // null: the CPU draws
  uint64_t geometry_bytes_ = 0;
  uint64_t unique_triangles_ = 0;
  uint64_t drawn_triangles_ = 0;
  double position_error_ = 0;
  double position_bound_ = 0;
};

/// All of a source in memory, and its exact pictures.
class SourceJudge {
 public:
  /// `packed`: made of `source`. Errors: those of import_gltf and load_source_model.
  static Result<SourceJudge> open(const std::string& source, const PackedScene& packed, uint32_t threads);

  /// What is right, of one view.
  struct Truth {
    std::string name;
    kernels::View view;
    std::vector<compare::ReferencePixel> pixels;
    std::vector<uint8_t> rgb;
    uint64_t covered = 0;
  };
  /// Errors kMemory.
  Result<Truth> draw(const bench::FileView& view) const;
  /// The picture of `samples_per_side` squared samples a pixel. Errors kMemory, kRange (too large).
  Result<std::vector<uint8_t>> draw_supersampled(const kernels::View& view, uint32_t samples_per_side) const;

  /// Fills in what `drawn`, a picture of one sample a pixel, shows wrong. Errors as compare_frame.
  Result<void> judge(const PackedScene::Drawn& drawn, const Truth& truth, JudgedCase& row) const;
  /// Likewise what the reference shows wrong in one of its modes.
  Result<void> judge_mode(const compare::ReferenceMode& mode, const Truth& truth, JudgedCase& row) const;
  /// PSNR and FLIP alone, of two pictures of the size of `view`.
  void judge_picture(std::span<const uint8_t> rgb, std::span<const uint8_t> expected, const kernels::View& view,
                     JudgedCase& row) const;

 private:
  void keep(const compare::PixelReport& report, const Truth& truth, JudgedCase& row) const;

  std::unique_ptr<compare::SourceModel> model_;
  uint32_t threads_ = 1;
};

}  // namespace scree::lab
