// Encodes what is measured while more is still being measured, so that the disk reads while the cores encode, and most
// windows are read once. A mesh of many windows is encoded before it is measured whole, as what its document says of
// it; where that turns out to be wrong, it is taken out of the file again. Whatever else does not go smoothly ends it,
// and is done again after all is measured: so errors are the same and come in the same order, and the bytes are those
// of measuring first.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <vector>

#include "format/result.h"
#include "tools/convert/passes/encode_pass.h"
#include "tools/convert/passes/memory_plan.h"
#include "tools/convert/plan/mesh_plan.h"
#include "tools/convert/windows/duplicates.h"
#include "tools/convert/windows/held_windows.h"
#include "tools/convert/windows/measure.h"

namespace scree::convert {

/// Used by one thread, that which measures. Destroy it before the pool.
class EncodeAhead final : public MeasureListener {
 public:
  /// `scene`: its materials merged. `progress(triangles)`: of the source, done with so far.
  EncodeAhead(const ConvertOptions& options, const SourceScene& scene, WorkerPool& pool,
              format::ContainerWriter& writer, const AheadLimits& limits, StageTimes& times,
              std::function<void(uint64_t)> progress);

  HeldBudget& budget() override { return held_; }
  bool is_ready() const override { return !has_failed_ && pass_->ready_locked(); }

  /// Errors: those of GeometryWriter::add (kFile, kRange, kMemory); after any other it goes no further.
  Result<void> take_one() override;
  Result<void> take_window(const std::vector<Measured>& primitives, const WindowPlan& window,
                           std::unique_ptr<HeldWindow>& held) override;
  Result<void> take_measured(const std::vector<Measured>& primitives, std::span<const WindowPlan> windows,
                             std::span<std::unique_ptr<HeldWindow>> held) override;
  Result<void> stop() override;
  bool is_stopped() const { return is_stopped_; }

  /// What it wrote: the first windows of those that are measured and of no repeated group, in order.
  struct Written {
    std::vector<WindowOutcome> windows;
    uint64_t before = 0;     // of them, that were written before finish()
    uint64_t guessed = 0;    // of them, that were taken before their mesh was measured whole
    uint64_t discarded = 0;  // others, that were taken out again
    GeometryWriter::OpenPage page;
  };
  /// Encodes what it has. Errors as take_one().
  Result<Written> finish();

 private:
  using Items = std::vector<EncodeItem>;

  /// The last of meshes_, while it is one that is not measured whole. Behind it nothing is added.
  struct Guess {
    uint64_t windows;         // added, the first ones
    uint64_t batches_before;  // that are not placed; then there is a mark:
    std::optional<EncodePass::Mark> mark;
    uint64_t outcomes;  // and what outcomes_ and done_ had there
    uint64_t done;
  };

  void start_pass(EncodeStart start);
  void begin_guess(const WindowPlan& window, const Measured& measured);
  void mark_guess();
  Result<void> drop_guess();
  Result<uint64_t> settle_guess(const std::vector<Measured>& primitives, std::span<const WindowPlan> windows,
                                bool is_again);
  bool fits(const WindowPlan& window) const;
  bool is_group_alone(uint32_t primitive) const;
  bool is_repeat(const std::vector<Measured>& primitives, uint32_t primitive);
  void add(const WindowPlan& window, std::unique_ptr<HeldWindow> held);
  Result<void> make_room();
  void close_batch();
  void submit();

  const ConvertOptions& options_;
  const SourceScene& scene_;
  WorkerPool& pool_;
  format::ContainerWriter& writer_;
  const InFlight in_flight_;
  StageTimes& times_;
  const std::function<void(uint64_t)> progress_;
  const uint64_t most_waiting_;  // triangles
  const WindowNeeds largest_;    // window
  HeldBudget held_;
  EqualGroups equal_;
  std::set<ContentHash> first_windows_;  // of hashed meshes that were guessed
  std::deque<PlannedMesh> meshes_;
  std::vector<WindowOutcome> outcomes_;
  Batch open_counts_;  // of open_batch_
  Items open_batch_;
  std::deque<Items> waiting_;
  uint64_t waiting_triangles_ = 0;
  uint64_t done_ = 0;
  bool is_stopped_ = false;  // nothing more is taken
  bool has_failed_ = false;  // nor encoded
  std::optional<Guess> guess_;
  uint64_t guessed_windows_ = 0;
  uint64_t discarded_windows_ = 0;
  uint64_t discarded_triangles_ = 0;
  std::optional<EncodePass> pass_;  // always one
};

}  // namespace scree::convert
