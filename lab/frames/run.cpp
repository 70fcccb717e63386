#include "lab/frames/run.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <iterator>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "format/container/checksum.h"
#include "lab/frames/frames.h"
#include "lab/frames/textured.h"
#include "lab/peer/peer_case.h"
#include "lab/report/case_row.h"
#include "lab/report/tables.h"
#include "lab/scenes/visible_cost.h"
#include "lab/setup/machine.h"
#include "lab/setup/views.h"
#include "runtime/scene/scene.h"
#include "tools/bench/csv.h"
#include "tools/bench/file_views.h"
#include "tools/common/options/options.h"

namespace scree::lab {
namespace {

/// The times of all frames, stage by stage.
struct Series {
  std::vector<float> clear, cull, small, medium, large, pyramid, second, raster, wall, resolve, occlusion, frame;

  static void add(std::vector<float>& times, const std::optional<float>& ms) {
    if (ms) times.push_back(*ms);
  }
  void add(const FrameMs& ms) {
    add(clear, ms.clear);
    add(cull, ms.cull);
    add(small, ms.small);
    add(medium, ms.medium);
    add(large, ms.large);
    add(pyramid, ms.pyramid);
    add(second, ms.second);
    add(raster, ms.raster);
    add(resolve, ms.resolve);
    add(occlusion, ms.occlusion);
    wall.push_back(ms.wall);
    frame.push_back(ms.frame);
  }
  static std::optional<Times> times(const std::vector<float>& series) {
    if (series.empty()) return std::nullopt;
    return summarize(series);
  }
  void summarize_into(CaseResult& result) const {
    result.clear = times(clear);
    result.cull = times(cull);
    result.small = times(small);
    result.medium = times(medium);
    result.large = times(large);
    result.pyramid = times(pyramid);
    result.second = times(second);
    result.raster = times(raster);
    result.wall = times(wall);
    result.resolve = times(resolve);
    result.occlusion = times(occlusion);
    result.frame = summarize(frame);
  }
};

class Runner {
 public:
  Runner(const LabOptions& options, Machine machine) : options_(options), machine_(std::move(machine)) {}

  Result<void> run(const runtime::Gpu& gpu) {
    if (options_.has_peer) peer_ = SCREE_TRY(open_vulkan_peer(gpu.uuid));
    std::printf("%s, driver %s, copies %.2f TB/s; commit %s; median of %u frames after %u, ms\n",
                machine_.device.c_str(), machine_.driver.c_str(), machine_.copy_gb_per_s * 1e-3,
                machine_.commit.c_str(), options_.frames, options_.warmup);
    // Results measured before a failure are printed as well.
    const Result<void> done = measure_all();
    if (!results_.empty()) print();
    return done;
  }

 private:
  Result<void> measure_all() {
    if (!options_.files.empty()) return measure_file(options_.files[0]);
    for (const std::string& name : options_.scenes) SCREE_TRY(options_.sweep ? sweep_scene(name) : measure_scene(name));
    return {};
  }

  ImageSize image_size(ImageSize own) const { return options_.size.value_or(own); }

  std::vector<NamedView> views_of(const synth::Scene& scene, uint32_t samples_per_side) const {
    const ImageSize size = image_size({scene.width, scene.height});
    const uint32_t width = size.width * samples_per_side;
    const uint32_t height = size.height * samples_per_side;
    if (options_.path) return {{"path", path_views(scene.cameras, width, height)}};
    std::vector<NamedView> views;
    for (const synth::SceneCamera& camera : scene.cameras)
      if (options_.views.empty() ||
          std::find(options_.views.begin(), options_.views.end(), camera.name) != options_.views.end())
        views.push_back({camera.name, {scene_view(camera, width, height)}});
    return views;
  }

  CaseResult describe(const std::string& name, const synth::Scene& scene, const Encoding& encoding,
                      const ResidentScene& resident) const {
    CaseResult result;
    result.scene = name;
    result.order = name == "D" || options_.order == synth::MeshOrder::kRow ? "row" : "block";  // D has row order only
    result.scale = scene_scale(name, options_.scale);
    result.positions = encoding.float32 ? "float32" : std::to_string(encoding.position_bits);
    result.indices = encoding.clustered ? "clustered" : encoding.packed_indices ? "packed" : "32";
    const ImageSize size = image_size({scene.width, scene.height});
    result.width = size.width;
    result.height = size.height;
    add_sizes(resident, result);
    return result;
  }
  static void add_sizes(const ResidentScene& resident, CaseResult& result) {
    result.unique_triangles = resident.unique_triangles();
    result.drawn_triangles = resident.drawn_triangles();
    result.geometry_bytes = resident.geometry_bytes();
    result.device_bytes = resident.device_bytes();
  }

  Result<ResidentScene> generate(const std::string& name, const synth::Scene& scene, const Encoding& encoding) const {
    const auto start = std::chrono::steady_clock::now();
    Result<ResidentScene> resident = ResidentScene::generate(scene, encoding);
    if (!resident) return Error{resident.error().code, "scene " + name + ": " + resident.error().message};
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    std::fprintf(stderr, "scene %s, %s: %s in %.2f s\n", name.c_str(), encoding_name(encoding).c_str(),
                 tools::format_bytes(resident->geometry_bytes()).c_str(), seconds);
    return resident;
  }

  /// Measures one view and number of samples with each kind of culling and each effect.
  Result<void> measure_view(const ResidentScene& resident, Frames& frames, const NamedView& view, CaseResult result) {
    for (const bool test : options_.sampleless_tests) {
      for (const Culling& culling : options_.culling) {
        for (const Effects& effects : options_.effects) {
          result.sampleless_test = test;
          result.culling = culling_name(culling);
          result.effects = effects_name(effects);
          SCREE_TRY(measure(resident, frames, view, culling, effects, result));
          SCREE_TRY(keep(result));
        }
      }
    }
    return {};
  }

  Result<void> measure_scene(const std::string& name) {
    const synth::Scene scene = make_scene(name, options_.order, options_.scale);
    std::vector<ScreePicture> pictures;  // for the peer
    for (const Encoding& encoding : options_.encodings) {
      const ResidentScene resident = SCREE_TRY(generate(name, scene, encoding));
      Frames frames = SCREE_TRY(Frames::create(resident));
      const bool is_compared = peer_ != nullptr && encoding.float32 && pictures.empty();
      for (const uint32_t samples : options_.samples_per_side) {
        for (const NamedView& view : views_of(scene, samples)) {
          CaseResult result = describe(name, scene, encoding, resident);
          result.samples_per_side = samples;
          SCREE_TRY(measure_view(resident, frames, view, std::move(result)));
          if (!is_compared) continue;
          std::vector<uint64_t> picture = SCREE_TRY(frames.samples());
          pictures.push_back({view.frames[0], std::move(picture), results_.back()});
        }
      }
    }
    return peer_ == nullptr ? Result<void>() : measure_peers(name, scene, pictures);
  }

  /// Measures the peer on the views of `pictures`. scree's scene has left the GPU.
  Result<void> measure_peers(const std::string& name, const synth::Scene& scene,
                             const std::vector<ScreePicture>& pictures) {
    Result<void> done = peer_->load(scene, std::max(1u, std::thread::hardware_concurrency()));
    for (const ScreePicture& picture : pictures)
      if (done) done = measure_peer_cases(scene, picture);
    peer_->unload();
    if (done || done.error().code != ErrorCode::kMemory) return done;
    peer_notes_ += "scene " + name + " does not fit: " + done.error().message + "\n";
    return {};
  }

  Result<void> measure_peer_cases(const synth::Scene& scene, const ScreePicture& picture) {
    std::vector<CaseResult> results = SCREE_TRY(measure_peer(*peer_, scene, picture, options_.frames, options_.warmup));
    for (CaseResult& result : results) SCREE_TRY(keep(std::move(result)));
    return {};
  }

  /// Compares every encoding with packed float32 in the same view.
  Result<void> sweep_scene(const std::string& name) {
    const synth::Scene scene = make_scene(name, options_.order, options_.scale);
    std::vector<HostPicture> references;
    std::vector<Encoding> encodings{{.float32 = true}};
    std::copy_if(options_.encodings.begin(), options_.encodings.end(), std::back_inserter(encodings),
                 [](const Encoding& encoding) { return !encoding.float32; });
    for (const Encoding& encoding : encodings) {
      const ResidentScene resident = SCREE_TRY(generate(name, scene, encoding));
      Frames frames = SCREE_TRY(Frames::create(resident));
      size_t number = 0;
      for (const NamedView& view : views_of(scene, 1)) {
        CaseResult result = describe(name, scene, encoding, resident);
        SCREE_TRY(measure(resident, frames, view, Culling{}, Effects{}, result));
        HostPicture picture = SCREE_TRY(frames.picture());
        if (encoding.float32) references.push_back(picture);
        result.error = compare_pictures(view.frames[0], picture, references[number]);
        if (result.indices == "clustered") result.error->wrong_pixels.reset();
        result.error->position_error = largest_position_error(resident.host());
        SCREE_TRY(keep(std::move(result)));
        ++number;
      }
    }
    return {};
  }

  static double largest_position_error(const kernels::SceneView& scene) {
    double largest = 0;
    for (uint64_t m = 0; m < scene.mesh_count; ++m) largest = std::max(largest, scene.meshes[m].max_position_error);
    return largest;
  }

  static void print_upload(const std::string& path, const runtime::UploadStats& stats) {
    std::printf(
        "%s: %s of pages in the file, %s read past the page cache, %s decompressed, %s to the device in %.3f s, %.2f "
        "GB/s\n",
        path.c_str(), tools::format_bytes(stats.counts.stored_bytes).c_str(),
        tools::format_bytes(stats.counts.direct_bytes).c_str(),
        tools::format_bytes(stats.counts.unpacked_bytes).c_str(),
        tools::format_bytes(stats.counts.copied_bytes).c_str(), stats.upload_ms * 1e-3, stats.gb_per_s());
  }

  Result<void> measure_file(const std::string& path) {
    const uint32_t threads = std::max(1u, std::thread::hardware_concurrency());
    runtime::Scene loaded =
        SCREE_TRY(runtime::Scene::open(path, {.textures = false, .threads = threads, .pages = false}));
    Result<ResidentScene> resident = ResidentScene::upload(std::move(loaded), threads);
    if (!resident && resident.error().code == ErrorCode::kDevice) return at(path, resident.error());
    if (!resident) return resident.error();
    print_upload(path, resident->upload_stats());
    Frames frames = SCREE_TRY(Frames::create(*resident));
    const ImageSize size = image_size({1920, 1080});
    for (const uint32_t samples : options_.samples_per_side) {
      const auto views = SCREE_TRY(bench::file_views(resident->file(), path, options_.views,
                                                     {size.width * samples, size.height * samples}, threads));
      for (const bench::FileView& view : views) {
        CaseResult result{.scene = file_name(path),
                          .order = "file",
                          .positions = "file",
                          .indices = "file",
                          .width = size.width,
                          .height = size.height,
                          .samples_per_side = samples};
        add_sizes(*resident, result);
        SCREE_TRY(measure_view(*resident, frames, {view.name, {view.view}}, std::move(result)));
      }
    }
    return {};
  }

  /// Warms up, then times options_.frames frames, or the frames of a path once.
  Result<void> measure(const ResidentScene& resident, Frames& frames, NamedView view, const Culling& culling,
                       const Effects& effects, CaseResult& result) {
    if (options_.near > 0) view = with_near(std::move(view), resident.host(), options_.near);
    result.view = view.name;
    result.frames = view.frames.size() > 1 ? static_cast<uint32_t>(view.frames.size()) : options_.frames;
    Series series;
    FrameMs ms;
    const FrameOptions frame{.samples_per_side = result.samples_per_side,
                             .sampleless_test = result.sampleless_test,
                             .culling = culling,
                             .effects = effects,
                             .stage_times = options_.stage_times};
    for (uint32_t i = 0; i < options_.warmup; ++i) SCREE_TRY(frames.draw(view.frames.front(), frame, ms));
    for (uint32_t i = 0; i < result.frames; ++i) {
      result.stats = SCREE_TRY(frames.draw(view.frames[i % view.frames.size()], frame, ms));
      series.add(ms);
    }
    series.summarize_into(result);
    const std::vector<uint64_t> samples = SCREE_TRY(frames.samples());
    if (view.frames.size() > 1) {
      SCREE_TRY(frames.draw(view.frames.front(), frame, ms));
      result.jump_ms = ms.raster.value_or(ms.frame);
    }
    result.covered_samples = static_cast<uint64_t>(
        std::count_if(samples.begin(), samples.end(), [](uint64_t sample) { return sample != kernels::kBackground; }));
    result.picture = format::checksum(std::as_bytes(std::span(samples)));
    const VisibleCost cost = visible_cost(resident.host(), resident.boxes(), view.frames.back());
    // The frame read these bytes only if it drew exactly these chunks.
    if (view.frames.size() == 1 && result.stats.clusters_drawn == 0 && cost.draws == result.stats.draws)
      result.touched_bytes = cost.bytes;
    return {};
  }

  Result<void> keep(CaseResult result) {
    std::fprintf(stderr, "  %s %s %ux%u: %.3f ms\n", result.scene.c_str(), result.view.c_str(),
                 result.width * result.samples_per_side, result.height * result.samples_per_side,
                 result.drawing().median);
    if (!options_.csv.empty()) SCREE_TRY(bench::append_csv(options_.csv, case_cells(machine_, result)));
    results_.push_back(std::move(result));
    return {};
  }

  void print() const {
    if (options_.sweep) {
      std::printf("\n%s", sweep_table(results_).c_str());
      return;
    }
    if (options_.path) {
      std::printf("\n%s", path_table(results_).c_str());
      return;
    }
    std::printf("\n%s\n%s", times_table(results_).c_str(), counts_table(results_, machine_).c_str());
    if (peer_ != nullptr) print_peer();
  }

  void print_peer() const {
    std::printf("\nVulkan on %s, beside scree with float32 positions\n%s%s", peer_->device().c_str(),
                peer_table(results_).c_str(), peer_notes_.c_str());
    if (machine_.device.find("H100") != std::string::npos || machine_.device.find("H200") != std::string::npos)
      std::printf(
          "H100 and H200 run vertex and fragment shaders on only 4 of their 132 multiprocessors, so the peers' times\n"
          "say nothing about graphics cards.\n");
  }

  const LabOptions& options_;
  Machine machine_;
  std::vector<CaseResult> results_;
  std::unique_ptr<Peer> peer_;  // null: only scree is measured
  std::string peer_notes_;      // a line for each scene that does not fit
};

}  // namespace

Result<void> run_bench(const LabOptions& options) {
  const Result<runtime::Gpu> gpu = runtime::use_gpu(options.backend.device);
  if (!gpu) return Error{gpu.error().code, gpu.error().message + "; frames are measured on a GPU"};
  Machine machine = SCREE_TRY(find_machine(*gpu));
  if (options.is_textured) return run_textured(options, machine);
  return Runner(options, std::move(machine)).run(*gpu);
}

}  // namespace scree::lab
