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
  const Result<convert::ConvertReport> report =
      convert::convert(convert_options(source, path, encoding, settings.threads));
  if (!report) return report.error();
  PackedScene packed;
  packed.settings_ = settings;
  packed.position_error_ = report->position_error;
  packed.position_bound_ = report->position_error_bound;
  Result<runtime::Scene> scene = runtime::Scene::open(path, {.textures = false, .threads = settings.threads});
  if (!scene) return scene.error();
  packed.scene_ = std::make_unique<runtime::Scene>(std::move(*scene));
  if (settings.gpu) {
    Result<runtime::DeviceScene> device = runtime::DeviceScene::upload(*packed.scene_, 0, settings.threads);
    if (!device) return device.error();
    packed.device_ = std::make_unique<runtime::DeviceScene>(std::move(*device));
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
      const Result<kernels::FrameStats> stats = device_->draw(samples, &times);
      if (!stats) return stats.error();
      return times.raster_ms;
    }
    const runtime::Stopwatch watch;
    const auto stats = kernels::draw_cpu(scene_->view(), samples, drawn.samples, settings_.threads);
    if (!stats) return stats.error();
    return static_cast<float>(watch.elapsed().wall_ms);
  };
  const Result<std::vector<float>> times = bench::timed_frames(settings_.frames, settings_.warmup, draw_one);
  if (!times) return times.error();
  drawn.times = summarize(*times);
  drawn.frames = static_cast<uint32_t>(times->size());
  drawn.rgb.resize(uint64_t{3} * view.width * view.height);
  const kernels::ShadeOptions shading = compare::shading_of_reference();
  if (device_ == nullptr) {
    const Result<void> shaded = kernels::resolve_cpu(scene_->view(), samples, samples_per_side, drawn.samples, shading,
                                                     3, drawn.rgb, settings_.threads);
    if (!shaded) return shaded.error();
    return drawn;
  }
  std::vector<uint32_t> rgba(uint64_t{view.width} * view.height);
  Result<void> done = device_->resolve(samples, samples_per_side, shading, rgba);
  if (done) done = device_->read_samples(drawn.samples);
  if (!done) return done.error();
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
  const Result<convert::SourceScene> gltf = convert::import_gltf(source, {});
  if (!gltf) return gltf.error();
  const runtime::Scene& scene = packed.scene();
  Result<compare::SourceModel> model = compare::load_source_model(*gltf, scene.container(), scene.scene_index());
  if (!model) return at(source, model.error());
  SourceJudge judge;
  judge.model_ = std::make_unique<compare::SourceModel>(std::move(*model));
  judge.threads_ = threads;
  return judge;
}

Result<SourceJudge::ReferencePicture> SourceJudge::draw(const bench::FileView& view) const {
  ReferencePicture reference{view.name, view.view, {}, {}, 0};
  Result<std::vector<compare::ReferencePixel>> pixels =
      compare::draw_reference(model_->views, model_->instances, reference.view, threads_);
  if (!pixels) return pixels.error();
  reference.pixels = std::move(*pixels);
  reference.covered = static_cast<uint64_t>(std::count_if(reference.pixels.begin(), reference.pixels.end(),
                                                          [](const auto& pixel) { return !pixel.is_background(); }));
  Result<std::vector<uint8_t>> rgb = compare::shade_reference(*model_, reference.pixels, reference.view, 1, threads_);
  if (!rgb) return rgb.error();
  reference.rgb = std::move(*rgb);
  return reference;
}

Result<std::vector<uint8_t>> SourceJudge::draw_supersampled(const kernels::View& view,
                                                            uint32_t samples_per_side) const {
  kernels::View samples = view;
  samples.width *= samples_per_side;
  samples.height *= samples_per_side;
  const Result<std::vector<compare::ReferencePixel>> pixels =
      compare::draw_reference(model_->views, model_->instances, samples, threads_);
  if (!pixels) return pixels.error();
  return compare::shade_reference(*model_, *pixels, samples, samples_per_side, threads_);
}

Result<void> SourceJudge::judge(const PackedScene& packed, const PackedScene::Drawn& drawn,
                                const ReferencePicture& reference, JudgedCase& row) const {
  const Result<compare::PixelReport> report =
      compare::compare_frame(packed.scene(), drawn.samples, *model_, reference.pixels, reference.view, threads_);
  if (!report) return report.error();
  keep(*report, reference, row);
  judge_picture(drawn.rgb, reference.rgb, reference.view, row);
  return {};
}

Result<void> SourceJudge::judge_mode(const compare::ReferenceMode& mode, const ReferencePicture& reference,
                                     JudgedCase& row) const {
  const Result<std::vector<compare::ReferencePixel>> pixels =
      compare::draw_reference(model_->views, model_->instances, reference.view, threads_, mode);
  if (!pixels) return pixels.error();
  const Result<compare::PixelReport> report =
      compare::compare_references(*pixels, *model_, reference.pixels, reference.view, threads_);
  if (!report) return report.error();
  const Result<std::vector<uint8_t>> rgb = compare::shade_reference(*model_, *pixels, reference.view, 1, threads_);
  if (!rgb) return rgb.error();
  keep(*report, reference, row);
  judge_picture(*rgb, reference.rgb, reference.view, row);
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
