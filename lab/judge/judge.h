// Draws a glTF scene with the exact reference rasteriser, and compares the pictures of convert's file with it.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "format/result.h"
#include "lab/judge/judged_case.h"
#include "lab/options.h"
#include "runtime/draw/device_scene.h"
#include "tools/bench/file_views.h"
#include "tools/bench/times.h"
#include "tools/compare/source_model.h"

namespace scree::lab {

/// The device on which frames are drawn, and the numbers of timed frames.
struct DrawSettings {
  bool gpu = false;
  uint32_t threads = 1;
  uint32_t frames = 60;  // fewer if they take longer than bench::kTimeBudgetMs
  uint32_t warmup = 10;  // likewise, with a quarter of that time
};

/// A source that convert packed in one encoding, ready to draw. Its file is mapped: it may be unlinked, but not
/// changed.
class PackedScene {
 public:
  /// Writes `path`, with source triangle numbers, and loads it without textures. Errors of convert, Scene::load,
  /// DeviceScene::upload.
  static Result<PackedScene> make(const std::string& source, const std::string& path, const Encoding& encoding,
                                  const DrawSettings& settings);

  runtime::Scene& scene() { return *scene_; }
  const runtime::Scene& scene() const { return *scene_; }

  struct Drawn {
    std::vector<uint8_t> rgb;  // on black
    Times times;
    uint32_t frames = 0;
    std::vector<uint64_t> samples;  // of the last frame
  };
  /// Draws `view` (of one sample per pixel) with `samples_per_side` squared samples per pixel. Errors of drawing and
  /// shading.
  Result<Drawn> draw(const kernels::View& view, uint32_t samples_per_side) const;

  /// Fills in the columns that are equal for all pictures: sizes and errors.
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

/// A source, completely in memory, and exact pictures of it.
class SourceJudge {
 public:
  /// `packed`: made from `source`. Errors of import_gltf and load_source_model.
  static Result<SourceJudge> open(const std::string& source, const PackedScene& packed, uint32_t threads);

  /// The exact picture of one view.
  struct ReferencePicture {
    std::string name;
    kernels::View view;
    std::vector<compare::ReferencePixel> pixels;
    std::vector<uint8_t> rgb;
    uint64_t covered = 0;
  };
  /// Draws the exact picture. Errors kMemory.
  Result<ReferencePicture> draw(const bench::FileView& view) const;
  /// The picture with `samples_per_side` squared samples per pixel. Errors kMemory, kRange (too large).
  Result<std::vector<uint8_t>> draw_supersampled(const kernels::View& view, uint32_t samples_per_side) const;

  /// Fills in the errors of `drawn`, a picture of one sample per pixel. Errors as compare_frame.
  Result<void> judge(const PackedScene& packed, const PackedScene::Drawn& drawn, const ReferencePicture& reference,
                     JudgedCase& row) const;
  /// Fills in the errors of the reference in one of its modes.
  Result<void> judge_mode(const compare::ReferenceMode& mode, const ReferencePicture& reference, JudgedCase& row) const;
  /// Fills in PSNR and FLIP only, for two pictures of the size of `view`.
  void judge_picture(std::span<const uint8_t> rgb, std::span<const uint8_t> expected, const kernels::View& view,
                     JudgedCase& row) const;

 private:
  void keep(const compare::PixelReport& report, const ReferencePicture& reference, JudgedCase& row) const;

  std::unique_ptr<compare::SourceModel> model_;
  uint32_t threads_ = 1;
};

}  // namespace scree::lab
