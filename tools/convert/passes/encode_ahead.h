// Encodes measured windows while others are still being measured, so that the disk reads while the cores encode, and
// most windows are read once. A mesh of many windows is encoded before it is measured completely, with the values that
// its document states. If they turn out wrong, the mesh is removed from the file again. Any other problem ends encoding
// ahead, and the work is repeated after everything is measured. So the errors, their order and the output are the same
// as if everything were measured first.
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

/// Used only by the thread that measures. Destroy it before the pool.
class EncodeAhead final : public MeasureListener {
 public:
  /// The materials of `scene` are merged already. `progress(triangles)`: number of source triangles done so far.
  EncodeAhead(const ConvertOptions& options, const SourceScene& scene, WorkerPool& pool,
              format::ContainerWriter& writer, const AheadLimits& limits, StageTimes& times,
              std::function<void(uint64_t)> progress);

  HeldBudget& budget() override { return held_; }
  Window& window(uint32_t worker) override { return scratch_[worker].window; }
  bool is_ready() const override { return !has_failed_ && pass_->ready_locked(); }

  /// Errors of GeometryWriter::add (kFile, kRange, kMemory). Any other error ends encoding ahead.
  Result<void> take_one() override;
  Result<void> take_window(const std::vector<Measured>& primitives, const WindowPlan& window,
                           std::unique_ptr<HeldWindow>& held) override;
  Result<void> take_measured(const std::vector<Measured>& primitives, std::span<const WindowPlan> windows,
                             std::span<std::unique_ptr<HeldWindow>> held) override;
  Result<void> stop() override;
  bool is_stopped() const { return is_stopped_; }

  /// The windows in the file: the first ones of all measured windows that are in no repeated group, in order.
  struct Written {
    std::vector<WindowOutcome> windows;
    uint64_t before = 0;     // number of them written before finish()
    uint64_t guessed = 0;    // number of them encoded before their mesh was measured completely
    uint64_t discarded = 0;  // number of other windows, which were removed again
    GeometryWriter::OpenPage page;
  };
  /// Encodes the queued windows. Errors as take_one().
  Result<Written> finish();

 private:
  using Items = std::vector<EncodeItem>;

  /// State while the last one of meshes_ is not measured completely. No other mesh is added meanwhile.
  struct Guess {
    uint64_t windows;         // number of windows added, from the first on
    uint64_t batches_before;  // earlier batches that are not placed yet; once all are, `mark` is set
    std::optional<EncodePass::Mark> mark;
    uint64_t outcomes;  // sizes of outcomes_ and done_ at the mark
    uint64_t done;
  };

  void start_pass(EncodeStart start);
  void begin_guess(const WindowPlan& window, const Measured& measured);
  void mark_guess();
  Result<void> drop_guess();
  Result<uint64_t> confirm_or_roll_back(const std::vector<Measured>& primitives, std::span<const WindowPlan> windows,
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
  const uint64_t most_waiting_;  // in triangles
  const WindowNeeds largest_;    // largest window
  HeldBudget held_;
  EqualGroups equal_;
  std::set<ContentHash> first_windows_;  // hashes of the first windows of guessed meshes
  std::deque<PlannedMesh> meshes_;
  std::vector<WindowOutcome> outcomes_;
  Batch open_counts_;  // counts for open_batch_
  Items open_batch_;
  std::deque<Items> waiting_;
  uint64_t waiting_triangles_ = 0;
  uint64_t done_ = 0;
  bool is_stopped_ = false;  // nothing more is accepted
  bool has_failed_ = false;  // and nothing more is encoded
  std::optional<Guess> guess_;
  uint64_t guessed_windows_ = 0;
  uint64_t discarded_windows_ = 0;
  uint64_t discarded_triangles_ = 0;
  std::vector<EncodeScratch> scratch_;
  std::optional<EncodePass> pass_;  // always set
};

}  // namespace scree::convert
