#include "lab/judge/judge_run.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <new>
#include <thread>
#include <utility>

#include "lab/judge/judge.h"
#include "lab/judge/judged_case.h"
#include "lab/setup/machine.h"
#include "lab/setup/work_folder.h"
#include "runtime/threads/stopwatch.h"
#include "tools/bench/file_views.h"
#include "tools/synth/synth.h"

namespace scree::lab {
namespace {

constexpr ImageSize kImageSize{1920, 1080};

/// A glTF to be judged.
struct Source {
  std::string name;
  std::string path;
  double scale = 1;
  std::vector<std::string> views;  // by name; empty: all
};

class JudgeRun {
 public:
  JudgeRun(const LabOptions& options, Machine machine, DrawSettings settings, WorkFolder folder)
      : options_(options), machine_(std::move(machine)), settings_(settings), folder_(std::move(folder)) {}

  Result<void> run() {
    std::printf("%s; commit %s; median of up to %u frames, ms\n", machine_.device.c_str(), machine_.commit.c_str(),
                settings_.frames);
    // Rows judged before a failure are printed as well.
    const Result<void> done = judge_all();
    if (!rows_.empty()) std::printf("\n%s", judged_tables(rows_).c_str());
    return done;
  }

 private:
  Result<void> judge_all() {
    for (const std::string& name : options_.scenes) {
      if (!has_view(name)) continue;  // the scene has none of the named views
      const Source source = SCREE_TRY(synthesize(name));
      SCREE_TRY(judge_source(source));
      std::error_code ignored;
      std::filesystem::remove_all(folder_.file(kSceneFolder), ignored);
    }
    for (const std::string& path : options_.files) {
      // If scenes are named too, the named views belong to the scenes.
      const std::vector<std::string> views = options_.scenes.empty() ? options_.views : std::vector<std::string>();
      SCREE_TRY(judge_source({file_name(path), path, 1, views}));
    }
    return {};
  }

  /// Whether a scene has one of the named views; true if none is named, since all are drawn then.
  bool has_view(const std::string& name) const {
    if (options_.views.empty()) return true;
    const synth::Scene scene = make_scene(name, options_.order, options_.scale);
    return std::any_of(scene.cameras.begin(), scene.cameras.end(), [&](const synth::SceneCamera& camera) {
      return std::find(options_.views.begin(), options_.views.end(), camera.name) != options_.views.end();
    });
  }

  /// Writes a measured scene as a glTF.
  Result<Source> synthesize(const std::string& name) const {
    const synth::Scene scene = make_scene(name, options_.order, options_.scale);
    std::error_code failed;
    std::filesystem::create_directories(folder_.file(kSceneFolder), failed);
    if (failed) return Error{ErrorCode::kFile, folder_.file(kSceneFolder) + ": " + failed.message()};
    const synth::SynthOptions synth{
        .scene = name, .output = folder_.file(std::string(kSceneFolder) + "/scene.gltf"), .threads = settings_.threads};
    SCREE_TRY(synth::write_scene(scene, synth));
    Source source{name, synth.output, scene_scale(name, options_.scale), {}};
    for (const synth::SceneCamera& camera : scene.cameras)
      if (std::find(options_.views.begin(), options_.views.end(), camera.name) != options_.views.end())
        source.views.push_back(camera.name);
    return source;
  }

  Result<PackedScene> pack(const Source& source, const Encoding& encoding) const {
    const std::string path = folder_.file("packed.scree");
    Result<PackedScene> packed = PackedScene::make(source.path, path, encoding, settings_);
    std::error_code ignored;
    std::filesystem::remove(path, ignored);  // the file stays mapped
    return packed;
  }

  Result<void> judge_source(const Source& source) {
    Encoding exact;
    exact.float32 = true;
    Result<PackedScene> packed = pack(source, exact);
    if (!packed) return packed.error();
    const SourceJudge judge = SCREE_TRY(SourceJudge::open(source.path, *packed, settings_.threads));
    // The default view depends slightly on the vertices, so all pictures use the view for float32 positions.
    const auto views = SCREE_TRY(bench::file_views(packed->scene(), source.path, source.views,
                                                   options_.size.value_or(kImageSize), settings_.threads));
    std::vector<SourceJudge::ReferencePicture> references;
    std::vector<std::vector<uint8_t>> supersampled;
    for (const bench::FileView& view : views) {
      const runtime::Stopwatch watch;
      SourceJudge::ReferencePicture reference = SCREE_TRY(judge.draw(view));
      std::fprintf(
          stderr, "%s %s: reference of %llu triangles in %.2f s\n", source.name.c_str(), view.name.c_str(),
          static_cast<unsigned long long>(packed->scene().view().instance_base[packed->scene().view().instance_count]),
          watch.elapsed().wall_ms * 1e-3);
      references.push_back(std::move(reference));
      if (!options_.curves) continue;
      supersampled.push_back(SCREE_TRY(judge.draw_supersampled(references.back().view, kReferenceSamples)));
    }
    bool is_exact = true;  // `packed` is the float32 file
    for (const Encoding& encoding : options_.encodings) {
      if (!encoding.float32 || !is_exact) packed = pack(source, encoding);
      if (!packed) return packed.error();
      is_exact = encoding.float32;
      for (size_t i = 0; i < references.size(); ++i) {
        JudgedCase row = describe(source, references[i], *packed);
        row.positions = encoding.float32 ? "float32" : std::to_string(encoding.position_bits);
        row.indices = encoding.clustered ? "clustered" : "packed";
        SCREE_TRY(judge_positions(*packed, judge, references[i], row));
        const bool studied = options_.curves && (encoding.float32 || encoding.position_bits == 16);
        if (!studied) continue;
        SCREE_TRY(judge_samples(*packed, judge, references[i], supersampled[i], row));
      }
    }
    if (!options_.curves) return {};
    for (const SourceJudge::ReferencePicture& reference : references)
      SCREE_TRY(judge_modes(judge, reference, describe(source, reference, *packed)));
    return {};
  }

  JudgedCase describe(const Source& source, const SourceJudge::ReferencePicture& reference,
                      const PackedScene& packed) const {
    JudgedCase row{.scene = source.name,
                   .scale = source.scale,
                   .view = reference.name,
                   .width = reference.view.width,
                   .height = reference.view.height};
    packed.describe(row);
    return row;
  }

  Result<void> judge_positions(const PackedScene& packed, const SourceJudge& judge,
                               const SourceJudge::ReferencePicture& reference, JudgedCase row) {
    const PackedScene::Drawn drawn = SCREE_TRY(packed.draw(reference.view, 1));
    row.drawing = drawn.times;
    row.frames = drawn.frames;
    SCREE_TRY(judge.judge(packed, drawn, reference, row));
    return keep(std::move(row));
  }

  Result<void> judge_samples(const PackedScene& packed, const SourceJudge& judge,
                             const SourceJudge::ReferencePicture& reference, const std::vector<uint8_t>& expected,
                             JudgedCase row) {
    row.study = Study::kSupersample;
    for (const uint32_t samples : {1u, 2u, 4u}) {
      const PackedScene::Drawn drawn = SCREE_TRY(packed.draw(reference.view, samples));
      row.samples_per_side = samples;
      row.drawing = drawn.times;
      row.frames = drawn.frames;
      judge.judge_picture(drawn.rgb, expected, reference.view, row);
      SCREE_TRY(keep(row));
    }
    return {};
  }

  Result<void> judge_modes(const SourceJudge& judge, const SourceJudge::ReferencePicture& reference, JudgedCase row) {
    row.positions = "source";
    row.geometry_bytes = 0;
    const auto judge_mode = [&](Study study, const compare::ReferenceMode& mode) -> Result<void> {
      row.study = study;
      row.snap = mode.snap;
      row.depth_bits = mode.depth_bits;
      SCREE_TRY(judge.judge_mode(mode, reference, row));
      return keep(row);
    };
    for (const uint32_t snap : {16u, 256u, 4096u})
      SCREE_TRY(judge_mode(Study::kSnapping, {.snap = snap, .depth_bits = 0}));
    for (const uint32_t bits : {28u, 32u}) SCREE_TRY(judge_mode(Study::kDepth, {.snap = 0, .depth_bits = bits}));
    return {};
  }

  Result<void> keep(JudgedCase row) {
    if (!options_.csv.empty()) SCREE_TRY(bench::append_csv(options_.csv, judged_cells(machine_, row)));
    rows_.push_back(std::move(row));
    return {};
  }

  static constexpr const char* kSceneFolder = "scene";

  const LabOptions& options_;
  Machine machine_;
  DrawSettings settings_;
  WorkFolder folder_;
  std::vector<JudgedCase> rows_;
};

}  // namespace

Result<void> judge_scenes(const LabOptions& options) try {
  DrawSettings settings;
  const std::optional<runtime::Gpu> gpu = SCREE_TRY(tools::choose_gpu("lab", options.backend));
  settings.gpu = gpu.has_value();
  settings.threads = std::max(1u, std::thread::hardware_concurrency());
  settings.frames = options.frames;
  settings.warmup = options.warmup;
  Machine machine = SCREE_TRY(settings.gpu ? find_machine(*gpu) : Result<Machine>(Machine{bench::cpu_machine(), 0}));
  WorkFolder folder = SCREE_TRY(WorkFolder::make());
  return JudgeRun(options, std::move(machine), settings, std::move(folder)).run();
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left for the reference; a smaller --scale or --size needs less"};
}

}  // namespace scree::lab
