#include "lab/frames/textured.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "kernels/cuda/frame/frame.h"
#include "kernels/cuda/shade/resolve.h"
#include "lab/setup/gpu_timer.h"
#include "lab/setup/views.h"
#include "lab/setup/work_folder.h"
#include "runtime/draw/cuda_upload.h"
#include "runtime/scene/scene.h"
#include "runtime/threads/stopwatch.h"
#include "tools/common/options/options.h"
#include "tools/common/output/human.h"
#include "tools/common/output/text_table.h"
#include "tools/convert/convert.h"
#include "tools/synth/textured.h"

namespace scree::lab {
namespace {

using kernels::DeviceBuffer;
using tools::fixed;

constexpr uint32_t kTexturedPathFrames = 60;

/// The scene, on the host and on the GPU.
class TexturedBench {
 public:
  explicit TexturedBench(const LabOptions& options)
      : options_(options), size_(options.size.value_or(ImageSize{3840, 2160})) {}

  Result<void> load() {
    WorkFolder folder = SCREE_TRY(WorkFolder::make());
    const runtime::Stopwatch synth_watch;
    const uint32_t threads = std::max(1u, std::thread::hardware_concurrency());
    const synth::TexturedReport written = SCREE_TRY(synth::write_textured({.output = folder.file("textured.gltf"),
                                                                           .meshes = options_.textures,
                                                                           .size = options_.texture_size,
                                                                           .threads = threads}));
    const double synth_s = synth_watch.elapsed().wall_ms * 1e-3;
    const runtime::Stopwatch convert_watch;
    convert::ConvertOptions convert;
    convert.input = folder.file("textured.gltf");
    convert.output = folder.file("textured.scree");
    convert.threads = threads;
    convert.memory = uint64_t{12} << 30;
    convert.images.memory = uint64_t{8} << 30;
    SCREE_TRY(convert::convert(convert));
    const double convert_s = convert_watch.elapsed().wall_ms * 1e-3;

    runtime::SceneFile file = SCREE_TRY(runtime::SceneFile::open(convert.output));
    scene_ = SCREE_TRY(runtime::Scene::load(
        std::move(file), 0, {.threads = threads, .texture_cache = runtime::kHostTextureCache, .pages = false}));
    copy_ =
        SCREE_TRY(runtime::CudaScene::upload(*scene_, 0, 0, threads, runtime::Reading::kAuto, options_.texture_cache));
    frames_ = SCREE_TRY(kernels::CudaFrames::create(scene_->view(), copy_.view()));
    samples_ = SCREE_TRY(DeviceBuffer::allocate(pixel_count() * sizeof(uint64_t), "allocating a picture"));
    pixels_ = SCREE_TRY(DeviceBuffer::allocate(pixel_count() * sizeof(uint32_t), "allocating a picture"));
    std::printf(
        "textured: %u textures of %u x %u, %s triangles; made in %.1f s, packed in %.1f s, uploaded in %.2f s\n",
        options_.textures, options_.texture_size, options_.texture_size,
        tools::format_count(static_cast<double>(written.triangles)).c_str(), synth_s, convert_s,
        copy_.stats().upload_ms * 1e-3);
    print_sizes(written.texture_bytes);
    return {};
  }

  Result<void> measure() {
    inspect::TextTable table(2);
    table.row({"view", "textures", "resolve ms", "least", "worst", "groups asked", "decoded", "rounds", "own tiles"});
    table.rule();
    const std::array<synth::SceneCamera, 2> cameras = synth::textured_cameras();
    std::vector<kernels::View> jumps;
    for (const synth::SceneCamera& camera : cameras) {
      const kernels::View view = scene_view(camera, size_.width, size_.height);
      jumps.push_back(view);
      const std::vector<kernels::View> still(options_.frames, view);
      SCREE_TRY(series(table, camera.name, "none", still, kernels::Show::kColor, false));
      SCREE_TRY(series(table, camera.name, "warm", still, kernels::Show::kTexture, false));
      SCREE_TRY(series(table, camera.name, "cold", still, kernels::Show::kTexture, true));
    }
    std::vector<kernels::View> alternating;
    for (uint32_t i = 0; i < options_.frames; ++i) alternating.push_back(jumps[i % 2]);
    SCREE_TRY(series(table, "jumps", "warm", alternating, kernels::Show::kTexture, false));
    const std::vector<kernels::View> path = path_views(cameras, size_.width, size_.height, kTexturedPathFrames);
    SCREE_TRY(series(table, "path", "none", path, kernels::Show::kColor, false));
    SCREE_TRY(copy_.texture_cache()->clear(nullptr));
    SCREE_TRY(series(table, "path", "from cold", path, kernels::Show::kTexture, false, false));
    std::printf("\nresolve at %u x %u, median of %u frames after %u (the path: %u frames, their mean):\n%s",
                size_.width, size_.height, options_.frames, options_.warmup, kTexturedPathFrames, table.text().c_str());
    return measure_decoder();
  }

 private:
  uint64_t pixel_count() const { return uint64_t{size_.width} * size_.height; }

  void print_sizes(uint64_t jpeg_bytes) {
    uint64_t base_pixels = 0;
    uint64_t base_bytes = 0;
    uint64_t base_index = 0;
    uint64_t all_bytes = 0;
    for (const runtime::JpegTexture& jpeg : scene_->jpeg_textures()) {
      for (size_t l = 0; l < jpeg.jpeg_levels().size(); ++l) {
        const format::JpegIndex& level = jpeg.index(l);
        const uint64_t bytes = jpeg.level_bytes(l).size() + level.tables.size() * sizeof(format::JpegHuffmanTable) +
                               jpeg.factors(l).size_bytes() + sizeof(kernels::JpegLevel);
        all_bytes += bytes;
        if (l != 0) continue;
        base_pixels += uint64_t{level.width} * level.height;
        base_bytes += bytes;
        base_index += level.index_bytes();
      }
    }
    const auto pixels = static_cast<double>(base_pixels);
    std::printf(
        "JPEG files %s, %.3f bits per pixel; on the GPU base levels %s (%.3f of the files), %.4f bits per pixel of "
        "index; "
        "all "
        "levels %s, the cache %s; decoded with levels they would take %s\n",
        tools::format_bytes(jpeg_bytes).c_str(), 8 * static_cast<double>(jpeg_bytes) / pixels,
        tools::format_bytes(base_bytes).c_str(), static_cast<double>(base_bytes) / static_cast<double>(jpeg_bytes),
        8 * static_cast<double>(base_index) / pixels, tools::format_bytes(all_bytes).c_str(),
        tools::format_bytes(copy_.texture_cache()->bytes()).c_str(),
        tools::format_bytes(static_cast<uint64_t>(pixels * 4 * 4 / 3)).c_str());
  }

  struct Drawn {
    float resolve_ms;
    kernels::TextureCacheCounts counts;
  };
  Result<Drawn> draw(const kernels::View& view, kernels::Show show, bool cold) {
    auto* const samples = reinterpret_cast<uint64_t*>(samples_.data());
    SCREE_TRY(frames_->draw(view, samples));
    kernels::CudaTextureCache* const cache = copy_.texture_cache();
    if (cold) SCREE_TRY(cache->clear(nullptr));
    const kernels::ShadeOptions shade{.show = show};
    kernels::ResolveTimes times;
    SCREE_TRY(resolver_.resolve(copy_.view(), view, 1, samples, frames_->transforms(), shade,
                                reinterpret_cast<uint32_t*>(pixels_.data()), nullptr, &times, cache));
    Drawn drawn{times.resolve_ms, {}};
    if (show != kernels::Show::kTexture) return drawn;
    drawn.counts = SCREE_TRY(cache->counts());
    return drawn;
  }

  /// Measures a row: draws the views one after another. Warm-up frames draw the views in turn.
  Result<void> series(inspect::TextTable& table, const std::string& name, const char* textures,
                      const std::vector<kernels::View>& views, kernels::Show show, bool cold, bool warms_up = true) {
    for (uint32_t i = 0; warms_up && i < options_.warmup; ++i) SCREE_TRY(draw(views[i % views.size()], show, cold));
    std::vector<float> ms;
    kernels::TextureCacheCounts sum;
    for (const kernels::View& view : views) {
      const auto drawn = SCREE_TRY(draw(view, show, cold));
      ms.push_back(drawn.resolve_ms);
      sum.asked += drawn.counts.asked;
      sum.decoded += drawn.counts.decoded;
      sum.rounds = std::max(sum.rounds, drawn.counts.rounds);
      sum.tiles = std::max(sum.tiles, drawn.counts.tiles);
    }
    const Times times = summarize(ms);
    const double frames = static_cast<double>(views.size());
    table.row({name, textures, fixed(name == "path" ? times.mean : times.median, 3), fixed(times.minimum, 3),
               fixed(times.worst, 3), fixed(static_cast<double>(sum.asked) / frames, 0),
               fixed(static_cast<double>(sum.decoded) / frames, 0), std::to_string(sum.rounds),
               std::to_string(sum.tiles)});
    return {};
  }

  /// Decodes every base level completely, one launch each.
  Result<void> measure_decoder() {
    GpuTimer timer = SCREE_TRY(GpuTimer::create());
    const uint32_t slot_bytes = scene_->jpeg_slot_bytes();
    DeviceBuffer out;
    double pixels = 0;
    double sample_bytes = 0;
    double jpeg_bytes = 0;
    double mcus = 0;
    double ms = 0;
    for (const runtime::JpegTexture& jpeg : scene_->jpeg_textures()) {
      if (jpeg.jpeg_levels().empty()) continue;
      const format::JpegIndex& level = jpeg.index(0);
      const uint64_t bytes = uint64_t{level.layout.group_count} * slot_bytes;
      SCREE_TRY(out.reserve(bytes, "allocating decoded samples"));
      for (const bool counts : {false, true}) {
        SCREE_TRY(timer.start());
        SCREE_TRY(kernels::CudaTextureCache::decode(copy_.jpeg_level(jpeg.jpeg_levels()[0].number),
                                                    level.layout.group_count, reinterpret_cast<uint8_t*>(out.data()),
                                                    slot_bytes, nullptr));
        const float took = SCREE_TRY(timer.stop());
        if (!counts) continue;
        ms += static_cast<double>(took);
        pixels += static_cast<double>(level.width) * level.height;
        sample_bytes += 64.0 * level.layout.mcu_blocks * level.layout.mcu_count();
        jpeg_bytes += static_cast<double>(level.data.size());
        mcus += level.layout.mcu_count();
      }
    }
    std::printf(
        "\ndecoding whole base levels, one thread per group: %.2f Gpixel/s, %.2f GMCU/s, %.1f GB/s of samples, %.1f "
        "GB/s "
        "as RGB, from %.2f GB/s of JPEG\n",
        pixels * 1e-6 / ms, mcus * 1e-6 / ms, sample_bytes * 1e-6 / ms, 3 * pixels * 1e-6 / ms, jpeg_bytes * 1e-6 / ms);
    return {};
  }

  const LabOptions& options_;
  ImageSize size_;
  std::optional<runtime::Scene> scene_;
  runtime::CudaScene copy_;
  std::optional<kernels::CudaFrames> frames_;
  kernels::CudaResolver resolver_;
  DeviceBuffer samples_;
  DeviceBuffer pixels_;
};

}  // namespace

Result<void> run_textured(const LabOptions& options, const Machine& machine) {
  std::printf("%s, driver %s, copies %.2f TB/s; commit %s\n", machine.device.c_str(), machine.driver.c_str(),
              machine.copy_gb_per_s * 1e-3, machine.commit.c_str());
  TexturedBench bench(options);
  SCREE_TRY(bench.load());
  return bench.measure();
}

}  // namespace scree::lab
