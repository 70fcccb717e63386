#include "lab/report/tables.h"

#include <algorithm>
#include <cmath>

#include "tools/common/options/options.h"
#include "tools/common/output/human.h"
#include "tools/common/output/text_table.h"

namespace scree::lab {
namespace {

using inspect::TextTable;
using tools::fixed;

std::string ms(double value) {
  return fixed(value, value < 10 ? 3 : value < 100 ? 2 : 1);
}
std::string ms(const std::optional<Times>& times) {
  return times ? ms(times->median) : "-";
}

std::string scene_name(const CaseResult& r) {
  return r.scale == 1 ? r.scene : r.scene + " x" + tools::short_number(r.scale);
}

std::string data_name(const CaseResult& r) {
  if (r.positions == "file") return "file";
  return r.positions + (r.positions == "float32" ? "" : "-bit") + ", " + r.indices;
}

std::string image_name(const CaseResult& r) {
  const std::string size = std::to_string(r.width) + "x" + std::to_string(r.height);
  const std::string side = std::to_string(r.samples_per_side);
  return size + (r.samples_per_side == 1 ? "" : " " + side + "x" + side) + (r.sampleless_test ? "" : " untested") +
         (r.culling == "all"    ? ""
          : r.culling == "none" ? " no culling"
                                : " no occlusion") +
         (r.effects == "none" ? "" : " " + r.effects);
}

}  // namespace

std::string times_table(std::span<const CaseResult> cases) {
  TextTable table(5);
  table.row({"scene",   "view",   "order",  "data", "image",  "clear", "cull",    "small",     "medium", "large",
             "pyramid", "second", "raster", "min",  "spread", "wall",  "resolve", "occlusion", "frame",  "G tri/s"});
  table.rule();
  for (const CaseResult& r : cases)
    table.row({scene_name(r),
               r.view,
               r.order,
               data_name(r),
               image_name(r),
               ms(r.clear),
               ms(r.cull),
               ms(r.small),
               ms(r.medium),
               ms(r.large),
               ms(r.pyramid),
               ms(r.second),
               ms(r.raster),
               r.raster ? ms(r.raster->minimum) : "-",
               r.raster ? ms(r.raster->spread) : "-",
               ms(r.wall),
               ms(r.resolve),
               ms(r.occlusion),
               ms(r.frame.median),
               fixed(r.triangles_per_s() * 1e-9, 2)});
  return table.text();
}

std::string counts_table(std::span<const CaseResult> cases, const Machine& machine) {
  TextTable table(4);
  table.row({"scene", "view", "order", "data", "bytes", "B/tri", "triangles", "culled", "small", "medium", "large",
             "clipped", "draws", "groups", "tested", "clusters", "covered", "touched", "of copy"});
  table.rule();
  for (const CaseResult& r : cases) {
    std::string touched = "-";
    std::string share = "-";
    if (r.touched_bytes) {
      touched = tools::format_bytes(*r.touched_bytes);
      const double rate = static_cast<double>(*r.touched_bytes) / (r.drawing().median * 1e6);  // GB/s
      share = fixed(100 * rate / machine.copy_gb_per_s, 1) + "%";
    }
    table.row({scene_name(r), r.view, r.order, data_name(r), tools::format_bytes(r.geometry_bytes),
               fixed(r.bytes_per_triangle(), 2), tools::format_count(static_cast<double>(r.drawn_triangles)),
               tools::format_count(static_cast<double>(r.culled_triangles())),
               tools::format_count(static_cast<double>(r.stats.triangles_small)),
               tools::format_count(static_cast<double>(r.stats.triangles_medium)),
               tools::format_count(static_cast<double>(r.stats.triangles_large)),
               tools::format_count(static_cast<double>(r.stats.triangles_clipped)), tools::grouped(r.stats.draws),
               tools::grouped(r.stats.groups_tested), tools::grouped(r.stats.clusters_tested),
               tools::grouped(r.stats.clusters_drawn), tools::grouped(r.covered_samples), touched, share});
  }
  return table.text();
}

std::string path_table(std::span<const CaseResult> cases) {
  TextTable table(4);
  table.row({"scene", "order", "data", "image", "frames", "mean", "worst", "least", "jump back", "G tri/s"});
  table.rule();
  for (const CaseResult& r : cases)
    table.row({scene_name(r), r.order, data_name(r), image_name(r), std::to_string(r.frames), ms(r.drawing().mean),
               ms(r.drawing().worst), ms(r.drawing().minimum), r.jump_ms ? ms(*r.jump_ms) : "-",
               fixed(static_cast<double>(r.drawn_triangles) / r.drawing().mean * 1e-6, 2)});
  return table.text();
}

std::string sweep_table(std::span<const CaseResult> cases) {
  TextTable table(3);
  table.row({"scene", "view", "data", "B/tri", "raster", "frame", "position error", "wrong pixels", "of covered",
             "depth max", "depth RMS", "PSNR dB"});
  table.rule();
  for (const CaseResult& r : cases) {
    std::vector<std::string> cells{
        scene_name(r), r.view, data_name(r), fixed(r.bytes_per_triangle(), 2), ms(r.raster), ms(r.frame.median)};
    if (r.error) {
      const double covered = static_cast<double>(std::max<uint64_t>(r.covered_samples, 1));
      const std::optional<uint64_t> wrong = r.error->wrong_pixels;
      for (const std::string& cell :
           {tools::short_number(r.error->position_error), wrong ? tools::grouped(*wrong) : std::string("-"),
            wrong ? fixed(100 * static_cast<double>(*wrong) / covered, 2) + "%" : std::string("-"),
            tools::short_number(r.error->depth_error_max), tools::short_number(r.error->depth_error_rms),
            std::isinf(r.error->psnr_db) ? std::string("equal") : fixed(r.error->psnr_db, 2)})
        cells.push_back(cell);
    } else {
      cells.insert(cells.end(), 6, "-");
    }
    table.row(std::move(cells));
  }
  return table.text();
}

std::string peer_table(std::span<const CaseResult> cases) {
  TextTable table(4);
  table.row({"scene", "view", "image", "peer", "device bytes", "ms", "min", "spread", "frames", "scree's ms", "covered",
             "same", "edge", "depth", "other", "depth gap"});
  table.rule();
  for (const CaseResult& r : cases) {
    if (!r.peer) continue;
    const Coverage& coverage = r.peer->coverage;
    const auto share = [&](uint64_t samples) {
      const double all = static_cast<double>(std::max<uint64_t>(coverage.covered(), 1));
      return fixed(100 * static_cast<double>(samples) / all, 4) + "%";
    };
    table.row({scene_name(r), r.view, image_name(r), r.indices, tools::format_bytes(r.device_bytes), ms(r.raster),
               ms(r.raster->minimum), ms(r.raster->spread), std::to_string(r.frames), ms(r.peer->scree_ms),
               tools::grouped(r.covered_samples), share(coverage.same), share(coverage.edge), share(coverage.depth),
               tools::grouped(coverage.other), tools::short_number(coverage.depth_gap)});
  }
  return table.text();
}

}  // namespace scree::lab
