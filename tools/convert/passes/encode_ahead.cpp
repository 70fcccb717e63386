#include "tools/convert/passes/encode_ahead.h"

#include <algorithm>
#include <utility>

#include "tools/convert/passes/guessed_mesh.h"
#include "tools/convert/plan/lattices.h"

namespace scree::convert {
namespace {

constexpr uint64_t kAheadJobsPerThread = 2;

// Measured triangles per thread that may be queued beside the jobs in flight: enough that no thread idles when several
// meshes become ready together.
constexpr uint64_t kWaitingPerThread = kWindowTriangles;

// A window counts as at least this many triangles, so that the queue never holds millions of small meshes.
constexpr uint64_t kLeastWeight = 1024;

// A primitive is guessed only if it has at least this many triangles per triangle encoded in vain so far. So at most
// 1.25 times the largest mesh is encoded in vain, whatever the sources state.
constexpr uint64_t kDiscardedShare = 4;

uint64_t weight_of(const EncodeItem& item) {
  return std::max(item.window.count, kLeastWeight);
}

}  // namespace

EncodeAhead::EncodeAhead(const ConvertOptions& options, const SourceScene& scene, WorkerPool& pool,
                         format::ContainerWriter& writer, const AheadLimits& limits, StageTimes& times,
                         std::function<void(uint64_t)> progress)
    : options_(options),
      scene_(scene),
      pool_(pool),
      writer_(writer),
      in_flight_{kAheadJobsPerThread * pool.threads(), limits.flight_bytes},
      times_(times),
      progress_(std::move(progress)),
      most_waiting_(kWaitingPerThread * pool.threads()),
      largest_(limits.window),
      held_(limits.held_bytes),
      scratch_(pool.threads()) {
  start_pass({});
}

Result<void> EncodeAhead::take_one() {
  Result<std::vector<EncodedWindow>> encoded = pass_->next();
  if (!encoded) {  // reported only after everything before it has succeeded
    has_failed_ = true;
    waiting_.clear();
    open_batch_.clear();
    if (guess_ && !guess_->mark) guess_.reset();  // no window of it is in the file
    return stop();
  }
  std::vector<WindowOutcome> placed = SCREE_TRY(pass_->place(std::move(*encoded)));
  for (WindowOutcome& outcome : placed) {
    for (const format::ChunkRecord& chunk : outcome.chunks) done_ += chunk.triangle_count;
    outcomes_.push_back(std::move(outcome));
  }
  if (guess_ && !guess_->mark && --guess_->batches_before == 0) mark_guess();
  if (!is_stopped_) progress_(done_);
  submit();
  return {};
}

Result<void> EncodeAhead::take_window(const std::vector<Measured>& primitives, const WindowPlan& window,
                                      std::unique_ptr<HeldWindow>& held) {
  if (is_stopped_) return {};
  if (!fits(window)) return stop();
  const Measured& measured = primitives[window.primitive];
  if (window.first == 0) begin_guess(window, measured);
  if (!guess_) return {};
  if (!fits_guess(options_, scene_, meshes_.back(), window, measured)) return drop_guess();
  add(window, std::move(held));
  ++guess_->windows;
  return make_room();
}

Result<void> EncodeAhead::take_measured(const std::vector<Measured>& primitives, std::span<const WindowPlan> windows,
                                        std::span<std::unique_ptr<HeldWindow>> held) {
  if (is_stopped_ || windows.empty()) return {};
  if (!std::ranges::all_of(windows, [&](const WindowPlan& window) { return fits(window); })) return stop();
  const bool is_again = is_repeat(primitives, windows.front().primitive);
  const uint64_t first = SCREE_TRY(confirm_or_roll_back(primitives, windows, is_again));
  if (is_stopped_) return {};
  if (is_again) {
    for (const WindowPlan& window : windows) done_ += window.kept;
    return {};
  }
  for (size_t i = first; i < windows.size(); ++i) {
    const uint32_t primitive = windows[i].primitive;
    if (i == 0 || windows[i - 1].primitive != primitive) {
      PlannedMesh mesh = plan_mesh(options_, scene_, primitive, primitives[primitive], false);
      if (!choose_lattice(options_, scene_, mesh.plan, mesh.record)) return stop();
      meshes_.push_back(std::move(mesh));
    }
    add(windows[i], std::move(held[i]));
  }
  return make_room();
}

Result<void> EncodeAhead::stop() {
  is_stopped_ = true;
  held_.close();
  return drop_guess();
}

Result<EncodeAhead::Written> EncodeAhead::finish() {
  const uint64_t before = outcomes_.size();
  if (!has_failed_) close_batch();
  submit();
  while (pass_->in_flight() > 0 && !has_failed_) SCREE_TRY(take_one());
  GeometryWriter::OpenPage page = SCREE_TRY(pass_->release());
  return Written{std::move(outcomes_), before, guessed_windows_, discarded_windows_, std::move(page)};
}

void EncodeAhead::start_pass(EncodeStart start) {
  pass_.emplace(options_, scene_, pool_, scratch_, writer_, in_flight_, times_, std::move(start));
}

/// Starts encoding a primitive at its first window, with the values that its document states. Does nothing if such
/// guesses have lost too much so far, or if the window equals the first one of an earlier guess, because the primitive
/// may then be a repeat.
void EncodeAhead::begin_guess(const WindowPlan& window, const Measured& measured) {
  const uint64_t triangles = scene_.primitives[window.primitive].triangle_count();
  if (window.count == triangles || discarded_triangles_ > triangles / kDiscardedShare) return;
  if (measured.content && (!is_group_alone(window.primitive) || !first_windows_.insert(*measured.content).second))
    return;
  std::optional<PlannedMesh> mesh = guess_mesh(options_, scene_, window.primitive, measured);
  // The first window is checked before the guess begins, because rolling back must
  // wait until everything before is written.
  if (!mesh || !fits_guess(options_, scene_, *mesh, window, measured)) return;
  close_batch();
  submit();
  meshes_.push_back(std::move(*mesh));
  guess_ = Guess{0, waiting_.size() + pass_->in_flight(), std::nullopt, 0, 0};
  if (guess_->batches_before == 0) mark_guess();
}

void EncodeAhead::mark_guess() {
  guess_->mark = pass_->mark();
  guess_->outcomes = outcomes_.size();
  guess_->done = done_;
}

/// The number of measured windows that are already encoded, if the guess was right.
Result<uint64_t> EncodeAhead::confirm_or_roll_back(const std::vector<Measured>& primitives,
                                                   std::span<const WindowPlan> windows, bool is_again) {
  if (!guess_) return uint64_t{0};
  const uint32_t primitive = windows.front().primitive;
  PlannedMesh mesh = plan_mesh(options_, scene_, primitive, primitives[primitive], false);
  if (!is_again && fits_guess(options_, scene_, meshes_.back(), windows.back(), primitives[primitive]) &&
      choose_lattice(options_, scene_, mesh.plan, mesh.record) && matches_measured(meshes_.back(), mesh)) {
    guessed_windows_ += guess_->windows;
    return std::exchange(guess_, std::nullopt)->windows;
  }
  SCREE_TRY(drop_guess());
  return uint64_t{0};
}

/// Removes everything that was placed for a guess from the file, restoring the earlier state.
Result<void> EncodeAhead::drop_guess() {
  if (!guess_) return {};
  open_batch_.clear();
  open_counts_ = {};
  const uint64_t before = guess_->batches_before - std::min(guess_->batches_before, pass_->in_flight());
  while (waiting_.size() > before) waiting_.pop_back();
  while (guess_ && !guess_->mark) SCREE_TRY(take_one());
  if (!guess_) return {};  // a mesh before it failed
  waiting_triangles_ = 0;
  Guess guess = std::move(*guess_);
  guess_.reset();
  SCREE_TRY(pass_->release());
  pass_.reset();  // its jobs refer to the mesh
  meshes_.pop_back();
  const uint64_t bytes = writer_.bytes();
  writer_.drop_pages(guess.mark->pages);
  times_.discarded_bytes += bytes - writer_.bytes();
  log_windows(writer_, guess.mark->start.window, {});  // makes the log entries from this window on void
  start_pass(std::move(guess.mark->start));
  outcomes_.erase(outcomes_.begin() + static_cast<ptrdiff_t>(guess.outcomes), outcomes_.end());
  done_ = guess.done;
  discarded_windows_ += guess.windows;
  discarded_triangles_ += guess.windows * kWindowTriangles;
  return {};
}

/// Whether the threads' memory was computed for a window of this size.
bool EncodeAhead::fits(const WindowPlan& window) const {
  return window.vertices <= largest_.vertices && window.span <= largest_.span;
}

bool EncodeAhead::is_group_alone(uint32_t primitive) const {
  const auto is_of_group = [&](size_t other) {
    return other < scene_.primitives.size() && scene_.primitives[other].group == scene_.primitives[primitive].group;
  };
  return !is_of_group(size_t{primitive} - 1) && !is_of_group(size_t{primitive} + 1);
}

bool EncodeAhead::is_repeat(const std::vector<Measured>& primitives, uint32_t primitive) {
  if (!primitives[primitive].content) return false;
  const uint32_t group = scene_.primitives[primitive].group;
  size_t first = primitive;
  while (first > 0 && scene_.primitives[first - 1].group == group) --first;
  return equal_.find_first(scene_, primitives, group, first) != group;
}

/// Adds a window of the last mesh.
void EncodeAhead::add(const WindowPlan& window, std::unique_ptr<HeldWindow> held) {
  const PlannedMesh& mesh = meshes_.back();
  EncodeItem item{window,       &scene_.primitives[window.primitive],      &mesh.plan,
                  &mesh.record, static_cast<uint32_t>(meshes_.size() - 1), std::move(held)};
  if (!open_batch_.empty() && !may_join(open_counts_, item.window)) close_batch();
  ++open_counts_.count;
  open_counts_.triangles += item.window.count;
  waiting_triangles_ += weight_of(item);
  open_batch_.push_back(std::move(item));
}

/// Takes results while too many triangles are queued.
Result<void> EncodeAhead::make_room() {
  submit();
  while (waiting_triangles_ > most_waiting_ && pass_->in_flight() > 0 && !has_failed_) SCREE_TRY(take_one());
  return {};
}

void EncodeAhead::close_batch() {
  if (!open_batch_.empty()) waiting_.push_back(std::exchange(open_batch_, {}));
  open_counts_ = {};
}

void EncodeAhead::submit() {
  while (!waiting_.empty() && pass_->has_room(waiting_.front())) {
    for (const EncodeItem& item : waiting_.front()) waiting_triangles_ -= weight_of(item);
    pass_->submit(std::move(waiting_.front()));
    waiting_.pop_front();
  }
}

}  // namespace scree::convert
