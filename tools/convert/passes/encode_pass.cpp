#include "tools/convert/passes/encode_pass.h"

#include <string>
#include <utility>

namespace scree::convert {
namespace {

uint64_t cost_of(const std::vector<EncodeItem>& batch) {
  uint64_t bytes = 0;
  for (const EncodeItem& item : batch) bytes += encoded_bytes_estimate(*item.plan, item.window);
  return bytes;
}

}  // namespace

EncodePass::EncodePass(const ConvertOptions& options, const SourceScene& scene, WorkerPool& pool,
                       std::span<EncodeScratch> scratch, format::ContainerWriter& writer, InFlight limit,
                       StageTimes& times, EncodeStart start)
    : scene_(scene),
      writer_(writer),
      options_{options.order, options.clusters, options.chunk_triangles, options.drop_nonfinite, options.weld},
      limit_(limit),
      times_(times),
      window_(start.window),
      mesh_(start.mesh),
      triangle_(start.triangle),
      placed_(std::move(start.placed)),
      scratch_(scratch),
      geometry_(pool, writer, options.zstd_level, times, std::move(start.page)),
      results_(pool, true) {}

bool EncodePass::has_room(const std::vector<EncodeItem>& batch) const {
  return results_.size() == 0 || (results_.size() < limit_.jobs && results_.cost() + cost_of(batch) <= limit_.cost);
}

void EncodePass::submit(std::vector<EncodeItem> batch) {
  const uint64_t cost = cost_of(batch);
  const auto items = std::make_shared<Items>(std::move(batch));
  const auto work = [this, items](uint32_t worker) -> Result<std::vector<EncodedWindow>> {
    const Timed timed(times_.encoding, Spent::kNotReading);
    std::vector<EncodedWindow> encoded;
    for (EncodeItem& item : *items) {
      EncodedWindow result = SCREE_TRY_AT(
          scene_.file_name, encode_window(*item.primitive, *item.plan, item.window,
                                          item.held ? &item.held->content : nullptr, options_, scratch_[worker]));
      item.held.reset();
      encoded.push_back(std::move(result));
    }
    return encoded;
  };
  results_.submit(work, cost);
  batches_.push_back(items);
}

Result<std::vector<EncodedWindow>> EncodePass::next() {
  return results_.take();
}

Result<std::vector<WindowOutcome>> EncodePass::place(std::vector<EncodedWindow> windows) {
  const std::shared_ptr<Items> items = std::move(batches_.front());
  batches_.pop_front();
  std::vector<WindowOutcome> outcomes;
  uint64_t triangles = 0;
  for (size_t i = 0; i < windows.size(); ++i) {
    outcomes.push_back(SCREE_TRY(place_window(windows[i], (*items)[i])));
    triangles += (*items)[i].window.count;
  }
  log_windows(writer_, window_, outcomes);
  window_ += windows.size();
  times_.encoded_triangles += triangles;
  return outcomes;
}

EncodePass::Mark EncodePass::mark() const {
  return {geometry_.page(), {geometry_.open_page(), window_, mesh_, triangle_, {}}};
}

/// Adds the chunks of a window to pages. Chunks that are already in the file keep their page and offset.
Result<WindowOutcome> EncodePass::place_window(EncodedWindow& window, const EncodeItem& item) {
  const format::MeshRecord& record = *item.record;
  if (window.position_error > record.max_position_error)
    return Error{ErrorCode::kRange, primitive_place(scene_, item.plan->primitive) + ": a position error of " +
                                        std::to_string(window.position_error) + ", but at most " +
                                        std::to_string(record.max_position_error) + " is allowed"};
  WindowOutcome outcome;
  outcome.made_from = window_id(item.window, item.mesh, record);
  static_cast<EncodedFacts&>(outcome) = window;
  if (item.mesh != mesh_) triangle_ = 0;
  mesh_ = item.mesh;
  for (size_t i = 0; i < window.chunks.size(); ++i) {
    EncodedChunk& chunk = window.chunks[i];
    chunk.record.mesh = item.mesh;
    chunk.record.first_triangle = triangle_;
    triangle_ += chunk.record.triangle_count;
    outcome.saved.push_back(chunk.saved);
    if (i < placed_.size()) {
      chunk.record.page = placed_[i].page;
      chunk.record.offset = placed_[i].offset;
    } else if (const Result<void> added = geometry_.add(chunk); !added) {
      return added.error();
    }
    outcome.chunks.push_back(chunk.record);
  }
  placed_.clear();
  return outcome;
}

}  // namespace scree::convert
