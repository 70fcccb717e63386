// scree-batch times scree_draw_batch() with random cameras inside a scene. The depths and ids stay on the GPU. It
// checks that they equal single frames, and prints a line of CSV.
#include <scree/scree.hpp>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <exception>
#include <random>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

namespace {

constexpr scree_layer kLayers[] = {SCREE_DEPTH, SCREE_TRIANGLE, SCREE_INSTANCE};
constexpr uint32_t kMade = 1u << SCREE_DEPTH | 1u << SCREE_TRIANGLE | 1u << SCREE_INSTANCE;

struct Options {
  std::string file;
  uint32_t cameras = 1024;
  uint32_t width = 128;
  uint32_t height = 128;
  uint32_t samples = 1;
  uint32_t repeats = 20;
  uint32_t singles = 64;
  uint32_t seed = 1;
};

/// Cameras whose eyes and targets lie in the middle eight tenths of the scene's box.
std::vector<scree_camera> random_cameras(const scree_scene_stats& stats, uint32_t count, uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> inside(0.1, 0.9);
  const auto point = [&] {
    scree::Vec3 out;
    for (int i = 0; i < 3; ++i) out[i] = stats.box_min[i] + inside(random) * (stats.box_max[i] - stats.box_min[i]);
    return out;
  };
  std::vector<scree_camera> cameras;
  for (uint32_t i = 0; i < count; ++i) {
    const scree::Vec3 eye = point();
    cameras.push_back(scree::look_at(eye, point(), {0, 1, 0}, 70));
  }
  return cameras;
}

double milliseconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
}

struct Times {
  double median;
  double least;
  double most;
};

Times times_of(std::vector<double> ms) {
  std::sort(ms.begin(), ms.end());
  return {ms[ms.size() / 2], ms.front(), ms.back()};
}

/// Whether pictures from all parts of the batch equal frames that are drawn one by one.
bool equals_singles(const scree::View& batch, scree::View& single, const std::vector<scree_camera>& cameras,
                    const scree_draw_options& draw, uint32_t count) {
  const uint64_t step = std::max<uint64_t>(cameras.size() / std::max(count, 1u), 1);
  bool is_equal = true;
  for (uint64_t i = 0; count != 0 && i < cameras.size(); i += step) {
    single.draw(cameras[i], draw);
    for (const scree_layer layer : kLayers) {
      const scree_array all = batch.host_layer(layer);
      const scree_array one = single.host_layer(layer);
      is_equal = is_equal && std::memcmp(static_cast<const char*>(all.data) + i * one.bytes, one.data, one.bytes) == 0;
    }
  }
  return is_equal;
}

int run(const Options& options) {
  const scree::File file(options.file.c_str());
  const scree::Scene scene = file.load();
  const scree_scene_stats stats = scene.stats();
  const std::vector<scree_camera> cameras = random_cameras(stats, options.cameras, options.seed);
  auto draw = scree::make<scree_draw_options>();
  draw.width = options.width;
  draw.height = options.height;
  draw.samples = options.samples;
  scree::View batch = scene.view();
  scree::View single = scene.view();
  std::vector<double> batch_ms;
  std::vector<double> single_ms;
  for (uint32_t i = 0; i <= options.repeats; ++i) {
    const auto start = std::chrono::steady_clock::now();
    batch.draw_batch(cameras.data(), options.cameras, draw, kMade);
    if (i != 0) batch_ms.push_back(milliseconds_since(start));  // the first batch allocates memory
  }
  const scree_frame_stats drawn = batch.stats();
  for (uint32_t i = 0; i <= std::min(options.singles, options.cameras - 1); ++i) {
    const auto start = std::chrono::steady_clock::now();
    single.draw(cameras[i], draw);
    if (i != 0) single_ms.push_back(milliseconds_since(start));
  }
  const bool is_equal = equals_singles(batch, single, cameras, draw, options.singles);
  const Times whole = times_of(batch_ms);
  const Times one = single_ms.empty() ? Times{} : times_of(single_ms);
  std::printf(
      "device,triangles,cameras,width,height,samples,batch_ms,least_ms,most_ms,views_per_s,single_ms,triangles_per_"
      "view,"
      "clusters_per_view,equal\n");
  std::printf("%s,%llu,%u,%u,%u,%u,%.3f,%.3f,%.3f,%.0f,%.4f,%.0f,%.0f,%s\n", stats.on_gpu ? stats.gpu_name : "cpu",
              static_cast<unsigned long long>(stats.triangles), options.cameras, options.width, options.height,
              options.samples, whole.median, whole.least, whole.most, options.cameras / whole.median * 1e3, one.median,
              static_cast<double>(drawn.triangles) / options.cameras,
              static_cast<double>(drawn.clusters) / options.cameras, is_equal ? "yes" : "NO");
  return is_equal ? 0 : 3;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Times batches of cameras inside a scene, and compares them with single frames.");
  Options options;
  app.add_option("file", options.file, "A .scree file")->required();
  app.add_option("--cameras", options.cameras)->check(CLI::PositiveNumber)->capture_default_str();
  app.add_option("--width", options.width, "Pixels")->capture_default_str();
  app.add_option("--height", options.height, "Pixels")->capture_default_str();
  app.add_option("--samples", options.samples, "Per pixel along each side: 1, 2, 4")->capture_default_str();
  app.add_option("--repeats", options.repeats, "Number of timed batches")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--singles", options.singles, "Number of single frames that are timed and compared")
      ->capture_default_str();
  app.add_option("--seed", options.seed, "Seed of the cameras")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    return run(options);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "scree-batch: %s\n", error.what());
    return 2;
  }
}
