// Measures how fast a .scree file loads and draws on this machine.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "format/result.h"
#include "tools/bench/machine.h"
#include "tools/bench/times.h"
#include "tools/common/options/draw_options.h"

namespace scree::bench {

struct BenchOptions : tools::DrawOptions {
  std::vector<std::string> files;
  tools::TextureOptions textures;
  std::vector<std::string> cameras;  // empty: all cameras of a file, or its default view
  uint32_t frames = 60;              // per view; fewer if they take longer than kTimeBudgetMs
  uint32_t warmup = 10;
  uint32_t repeats = 5;  // number of loads of each kind, at least 1
  std::string csv;       // empty: none
  bool json = false;
  bool quiet = false;
};

/// Loads of one file from one state of the page cache.
struct LoadResult {
  bool is_cold = false;
  double cached_share = 0;  // cached share of the file before its loads: the largest for cold loads, else the smallest
  Times load;               // ms, from opening the file until the scene is checked and ready to be drawn
  Times first_picture;      // the same, and the time until the first shaded picture
  uint64_t read_bytes = 0;  // without geometry that is not drawn, and without pages of textures that pixels ask for
  uint64_t device_bytes = 0;

  double gb_per_s() const { return static_cast<double>(read_bytes) * 1e-6 / load.median; }
};

struct ViewResult {
  std::string name;
  uint32_t frames = 0;
  double first_ms = 0;  // the first frame of this view, wall clock, without shading
  Times draw;           // ms, by the GPU's clock; wall clock for the CPU, several GPUs and streamed frames
  Times shade;
  std::optional<uint64_t> streamed_bytes;  // of the last frame, if the scene is streamed
  uint64_t picture = 0;                    // XXH3-64 of the visibility buffer; equal for equal pictures
};

struct FileResult {
  std::string file;
  uint64_t file_bytes = 0;
  uint64_t unique_triangles = 0;  // stored
  uint64_t drawn_triangles = 0;   // over all instances of the scene
  uint32_t gpus = 1;              // that draw it; 1 also for the CPU
  std::vector<LoadResult> loads;
  std::vector<ViewResult> views;
};

struct BenchReport {
  BenchOptions options;
  Machine machine;
  std::vector<FileResult> files;
};

/// Loads `path` several times from the disk and from the page cache, and draws frames of its views. `has_gpu`: draw on
/// the current device. Errors, with the file: errors of Scene::open, DeviceScene::upload, drawing and shading.
Result<FileResult> measure_file(const std::string& path, const BenchOptions& options, bool has_gpu);

/// Measures every file, prints the report and appends the CSV rows. Results from before an error are printed too.
Result<void> run_bench(const BenchOptions& options);

/// The report as tables, as one JSON object, and as one CSV row per view.
std::string bench_text(const BenchReport& report);
std::string bench_json(const BenchReport& report);
Result<void> append_rows(const BenchReport& report);

/// Finds the errors of append_rows() that are known before anything is measured.
Result<void> check_rows(const BenchOptions& options);

}  // namespace scree::bench
