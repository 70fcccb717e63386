#include "lab/judge/judge.h"

#include <algorithm>
#include <utility>

#include "lab/setup/packed_file.h"
#include "tools/compare/against_source.h"
#include "tools/compare/flip.h"
#include "tools/compare/reference_shade.h"
#include "tools/convert/convert.h"

namespace scree::lab {
namespace {

convert::ConvertOptions convert_options(const std::string& source, const std::string& path, const Encoding& encoding,
                                        uint32_t threads) {
  convert::ConvertOptions options = packing(source, path, encoding, threads);
  options.source_ids = true;
  options.drop_nonfinite = true;
  options.images.textures = convert::Textures::kRaw;  // textures are not drawn
  return options;
}

}  // namespace

Result<PackedScene> PackedScene::make(const std::string& source, const std::string& path, const Encoding& encoding,
                                      const DrawSettings& settings) {
  const convert::ConvertReport report =
      SCREE_TRY(convert::convert(convert_options(source, path, encoding, settings.threads)));
  PackedScene packed;
  packed.settings_ = settings;
  packed.position_error_ = report.position_error;
  packed.position_bound_ = report.position_error_bound;
  runtime::Scene scene = SCREE_TRY(runtime::Scene::open(path, {.textures = false, .threads = settings.threads}));
  packed.scene_ = std::make_unique<runtime::Scene>(std::move(scene));
  if (settings.gpu) {
    runtime::DeviceScene device = SCREE_TRY(runtime::DeviceScene::upload(*packed.scene_, 0, settings.threads));
    packed.device_ = std::make_unique<runtime::DeviceScene>(std::move(device));
  }
  const kernels::SceneView& view = packed.scene_->view();
  packed.drawn_triangles_ = view.instance_base[view.instance_count];
  std::vector<bool> drawn(view.mesh_count);
  for (uint64_t i = 0; i < view.instance_count; ++i) drawn[view.instances[i].mesh] = true;
  for (uint64_t m = 0; m < view.mesh_count; ++m)
    if (drawn[m]) packed.unique_triangles_ += view.meshes[m].triangle_count;
  for (uint64_t c = 0; c < view.chunk_count; ++c)
    if (drawn[view.chunks[c].mesh])
      packed.geometry_bytes_ += geometry_bytes(view.meshes[view.chunks[c].mesh], view.chunks[c]);
  return packed;
}

Result<PackedScene::Drawn> PackedScene::draw(const kernels::View& view, uint32_t samples_per_side) const {
  kernels::View samples = view;
  samples.width *= samples_per_side;
  samples.height *= samples_per_side;
  Drawn drawn;
  drawn.samples.resize(uint64_t{samples.width} * samples.height);
  // Draws once more and returns the time in ms.
  const auto draw_one = [&]() -> Result<float> {
    if (device_ != nullptr) {
      kernels::FrameTimes times{};
      SCREE_TRY(device_->draw(samples, &times));
      return times.raster_ms;
    }
    const runtime::Stopwatch watch;
    SCREE_TRY(kernels::draw_cpu(scene_->view(), samples, drawn.samples, settings_.threads));
    return static_cast<float>(watch.elapsed().wall_ms);
  };
  const std::vector<float> times = SCREE_TRY(bench::timed_frames(settings_.frames, settings_.warmup, draw_one));
  drawn.times = summarize(times);
  drawn.frames = static_cast<uint32_t>(times.size());
  drawn.rgb.resize(uint64_t{3} * view.width * view.height);
  const kernels::ShadeOptions shading = compare::shading_of_reference();
  if (device_ == nullptr) {
    SCREE_TRY(kernels::resolve_cpu(scene_->view(), samples, samples_per_side, drawn.samples, shading, 3, drawn.rgb,
                                   settings_.threads));
    return drawn;
  }
  std::vector<uint32_t> rgba(uint64_t{view.width} * view.height);
  SCREE_TRY(device_->resolve(samples, samples_per_side, shading, rgba));
  SCREE_TRY(device_->read_samples(drawn.samples));
  for (size_t i = 0; i < drawn.rgb.size(); ++i) drawn.rgb[i] = static_cast<uint8_t>(rgba[i / 3] >> (8 * (i % 3)));
  return drawn;
}

void PackedScene::describe(JudgedCase& row) const {
  row.geometry_bytes = geometry_bytes_;
  row.unique_triangles = unique_triangles_;
  row.drawn_triangles = drawn_triangles_;
  row.position_error = position_error_;
  row.position_bound = position_bound_;
}

Result<SourceJudge> SourceJudge::open(const std::string& source, const PackedScene& packed, uint32_t threads) {
  const convert::SourceScene gltf = SCREE_TRY(convert::import_gltf(source, {}));
  const runtime::Scene& scene = packed.scene();
  compare::SourceModel model =
      SCREE_TRY_AT(source, compare::load_source_model(gltf, scene.container(), scene.scene_index()));
  SourceJudge judge;
  judge.model_ = std::make_unique<compare::SourceModel>(std::move(model));
  judge.threads_ = threads;
  return judge;
}

Result<SourceJudge::ReferencePicture> SourceJudge::draw(const bench::FileView& view) const {
  ReferencePicture reference{view.name, view.view, {}, {}, 0};
  reference.pixels = SCREE_TRY(compare::draw_reference(model_->views, model_->instances, reference.view, threads_));
  reference.covered = static_cast<uint64_t>(std::count_if(reference.pixels.begin(), reference.pixels.end(),
                                                          [](const auto& pixel) { return !pixel.is_background(); }));
  reference.rgb = SCREE_TRY(compare::shade_reference(*model_, reference.pixels, reference.view, 1, threads_));
  return reference;
}

Result<std::vector<uint8_t>> SourceJudge::draw_supersampled(const kernels::View& view,
                                                            uint32_t samples_per_side) const {
  kernels::View samples = view;
  samples.width *= samples_per_side;
  samples.height *= samples_per_side;
  const std::vector<compare::ReferencePixel> pixels =
      SCREE_TRY(compare::draw_reference(model_->views, model_->instances, samples, threads_));
  return compare::shade_reference(*model_, pixels, samples, samples_per_side, threads_);
}

Result<void> SourceJudge::judge(const PackedScene& packed, const PackedScene::Drawn& drawn,
                                const ReferencePicture& reference, JudgedCase& row) const {
  const compare::PixelReport report = SCREE_TRY(
      compare::compare_frame(packed.scene(), drawn.samples, *model_, reference.pixels, reference.view, threads_));
  keep(report, reference, row);
  judge_picture(drawn.rgb, reference.rgb, reference.view, row);
  return {};
}

Result<void> SourceJudge::judge_mode(const compare::ReferenceMode& mode, const ReferencePicture& reference,
                                     JudgedCase& row) const {
  const std::vector<compare::ReferencePixel> pixels =
      SCREE_TRY(compare::draw_reference(model_->views, model_->instances, reference.view, threads_, mode));
  const compare::PixelReport report =
      SCREE_TRY(compare::compare_references(pixels, *model_, reference.pixels, reference.view, threads_));
  const std::vector<uint8_t> rgb = SCREE_TRY(compare::shade_reference(*model_, pixels, reference.view, 1, threads_));
  keep(report, reference, row);
  judge_picture(rgb, reference.rgb, reference.view, row);
  return {};
}

void SourceJudge::judge_picture(std::span<const uint8_t> rgb, std::span<const uint8_t> expected,
                                const kernels::View& view, JudgedCase& row) const {
  const compare::PictureReport report = compare::compare_rgb(
      {view.width, view.height, rgb}, {view.width, view.height, expected}, compare::kPixelsPerDegree, threads_);
  row.psnr_db = report.psnr;
  row.flip_mean = report.flip_mean;
  row.flip_max = report.flip_max;
}

void SourceJudge::keep(const compare::PixelReport& report, const ReferencePicture& reference, JudgedCase& row) const {
  row.pixels =
      JudgedCase::Pixels{reference.covered, report.wrong(), report.counts(), report.same_depth, report.surface_depth};
}

}  // namespace scree::lab
