#include "tools/convert/encode_ahead.h"

#include <algorithm>
#include <utility>

#include "tools/convert/lattices.h"

namespace scree::convert {
namespace {

constexpr uint64_t kJobsPerThread = 2;

// Measured triangles that wait for a thread: beside the jobs in flight enough that no thread is without work where
// meshes become ready together.
constexpr uint64_t kWaitingPerThread = kWindowTriangles;

// A window counts as so many triangles at least, so that a million small meshes do not wait.
constexpr uint64_t kLeastWeight = 1024;

uint64_t weight_of(const EncodeItem& item) {
  return std::max(item.window.count, kLeastWeight);
}

}  // namespace

EncodeAhead::EncodeAhead(const ConvertOptions& options, const SourceScene& scene, WorkerPool& pool,
                         format::ContainerWriter& writer, const AheadLimits& limits, StageTimes& times,
                         std::function<void(uint64_t)> progress)
    : options_(options),
      scene_(scene),
      progress_(std::move(progress)),
      most_waiting_(kWaitingPerThread * pool.threads()),
      held_(limits.held_bytes),
      pass_(options, scene, pool, writer, {kJobsPerThread * pool.threads(), limits.flight_bytes}, times, {}) {}

Result<void> EncodeAhead::take_one() {
  Result<std::vector<EncodedWindow>> encoded = pass_.next();
  if (!encoded) {  // it is said when all before it is known to be good
    stop();
    has_failed_ = true;
    waiting_.clear();
    open_batch_.clear();
    return {};
  }
  Result<std::vector<WindowOutcome>> placed = pass_.place(std::move(*encoded));
  if (!placed) return placed.error();
  for (WindowOutcome& outcome : *placed) {
    for (const format::ChunkRecord& chunk : outcome.chunks) done_ += chunk.triangle_count;
    outcomes_.push_back(std::move(outcome));
  }
  if (!is_stopped_) progress_(done_);
  submit();
  return {};
}

Result<void> EncodeAhead::take_measured(const std::vector<Measured>& primitives, std::span<const WindowPlan> windows,
                                        std::span<std::unique_ptr<HeldWindow>> held) {
  if (is_stopped_ || windows.empty()) return {};
  if (is_repeat(primitives, windows.front().primitive)) {
    for (const WindowPlan& window : windows) done_ += window.kept;
    return {};
  }
  for (size_t i = 0; i < windows.size(); ++i) {
    const uint32_t primitive = windows[i].primitive;
    if (i == 0 || windows[i - 1].primitive != primitive) {
      PlannedMesh mesh = plan_mesh(options_, scene_, primitive, primitives[primitive], false);
      if (!choose_lattice(options_, scene_, mesh.plan, mesh.record)) {
        stop();
        return {};
      }
      meshes_.push_back(std::move(mesh));
    }
    const PlannedMesh& mesh = meshes_.back();
    add({windows[i], &scene_.primitives[primitive], &mesh.plan, &mesh.record, static_cast<uint32_t>(meshes_.size() - 1),
         std::move(held[i])});
  }
  submit();
  while (waiting_triangles_ > most_waiting_ && pass_.in_flight() > 0 && !has_failed_)
    if (const Result<void> taken = take_one(); !taken) return taken;
  return {};
}

void EncodeAhead::stop() {
  is_stopped_ = true;
  held_.close();
}

Result<EncodeAhead::Written> EncodeAhead::finish() {
  const uint64_t before = outcomes_.size();
  if (!has_failed_) close_batch();
  submit();
  while (pass_.in_flight() > 0 && !has_failed_)
    if (const Result<void> taken = take_one(); !taken) return taken.error();
  Result<GeometryWriter::OpenPage> page = pass_.release();
  if (!page) return page.error();
  return Written{std::move(outcomes_), before, std::move(*page)};
}

bool EncodeAhead::is_repeat(const std::vector<Measured>& primitives, uint32_t primitive) {
  if (!primitives[primitive].content) return false;
  const uint32_t group = scene_.primitives[primitive].group;
  size_t first = primitive;
  while (first > 0 && scene_.primitives[first - 1].group == group) --first;
  return equal_.find_first(scene_, primitives, group, first) != group;
}

void EncodeAhead::add(EncodeItem item) {
  if (!open_batch_.empty() && !may_join(open_counts_, item.window)) close_batch();
  ++open_counts_.count;
  open_counts_.triangles += item.window.count;
  waiting_triangles_ += weight_of(item);
  open_batch_.push_back(std::move(item));
}

void EncodeAhead::close_batch() {
  if (!open_batch_.empty()) waiting_.push_back(std::exchange(open_batch_, {}));
  open_counts_ = {};
}

void EncodeAhead::submit() {
  while (!waiting_.empty() && pass_.has_room(waiting_.front())) {
    for (const EncodeItem& item : waiting_.front()) waiting_triangles_ -= weight_of(item);
    pass_.submit(std::move(waiting_.front()));
    waiting_.pop_front();
  }
}

}  // namespace scree::convert
