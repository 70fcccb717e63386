// Encodes what is measured while later meshes are still being measured, so that the disk reads while the cores encode,
// and most windows are read once. Whatever does not go smoothly ends it, and is done again after all is measured: so
// errors are the same and come in the same order, and the bytes are those of measuring first.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "format/result.h"
#include "tools/convert/duplicates.h"
#include "tools/convert/encode_pass.h"
#include "tools/convert/held_windows.h"
#include "tools/convert/measure.h"
#include "tools/convert/memory_plan.h"
#include "tools/convert/mesh_plan.h"

namespace scree::convert {

/// Used by one thread, that which measures. Destroy it before the pool.
class EncodeAhead final : public MeasureListener {
 public:
  /// `scene`: its materials merged. `progress(triangles)`: of the source, done with so far.
  EncodeAhead(const ConvertOptions& options, const SourceScene& scene, WorkerPool& pool,
              format::ContainerWriter& writer, const AheadLimits& limits, StageTimes& times,
              std::function<void(uint64_t)> progress);

  HeldBudget& budget() override { return held_; }
  bool is_ready() const override { return !has_failed_ && pass_.ready_locked(); }

  /// Errors: those of GeometryWriter::add (kFile, kRange, kMemory); after any other it goes no further.
  Result<void> take_one() override;
  Result<void> take_measured(const std::vector<Measured>& primitives, std::span<const WindowPlan> windows,
                             std::span<std::unique_ptr<HeldWindow>> held) override;
  void stop() override;
  bool is_stopped() const { return is_stopped_; }

  /// What it wrote: the first windows of those that are measured and of no repeated group, in order.
  struct Written {
    std::vector<WindowOutcome> windows;
    uint64_t before = 0;  // of them, that were written before finish()
    GeometryWriter::OpenPage page;
  };
  /// Encodes what it has. Errors as take_one().
  Result<Written> finish();

 private:
  using Items = std::vector<EncodeItem>;

  bool is_repeat(const std::vector<Measured>& primitives, uint32_t primitive);
  void add(EncodeItem item);
  void close_batch();
  void submit();

  const ConvertOptions& options_;
  const SourceScene& scene_;
  const std::function<void(uint64_t)> progress_;
  const uint64_t most_waiting_;  // triangles
  HeldBudget held_;
  EqualGroups equal_;
  std::deque<PlannedMesh> meshes_;
  std::vector<WindowOutcome> outcomes_;
  Batch open_counts_;  // of open_batch_
  Items open_batch_;
  std::deque<Items> waiting_;
  uint64_t waiting_triangles_ = 0;
  uint64_t done_ = 0;
  bool is_stopped_ = false;  // nothing more is taken
  bool has_failed_ = false;  // nor encoded
  EncodePass pass_;
};

}  // namespace scree::convert
