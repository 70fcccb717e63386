// Encodes windows on a pool, places their chunks in pages in order, and logs them for --resume.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <span>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "tools/common/jobs/ordered_pool.h"
#include "tools/common/jobs/stage_rates.h"
#include "tools/convert/encode/encode.h"
#include "tools/convert/encode/geometry_writer.h"
#include "tools/convert/passes/resume.h"
#include "tools/convert/plan/convert_options.h"
#include "tools/convert/windows/held_windows.h"
#include "tools/convert/windows/measure.h"
#include "tools/gltf/source.h"

namespace scree::convert {

/// A window to be encoded. The objects pointed to must stay valid until the window is placed.
struct EncodeItem {
  WindowPlan window;
  const Primitive* primitive = nullptr;  // the source's, or its sorted copy
  const MeshPlan* plan = nullptr;
  const format::MeshRecord* record = nullptr;
  uint32_t mesh = 0;
  std::unique_ptr<HeldWindow> held;  // null: the window is read again
};

/// State at the beginning of a pass.
struct EncodeStart {
  GeometryWriter::OpenPage page;
  uint64_t window = 0;                      // number of its first window
  uint32_t mesh = format::kNone;            // mesh of the previous chunk, if there is one
  uint64_t triangle = 0;                    // the next triangle of that mesh
  std::vector<format::ChunkRecord> placed;  // chunks of the first window that are already in the file
};

/// Used by one thread, except ready_locked(). Destroy it before the pool.
class EncodePass {
 public:
  /// `scratch`: one for each thread of the pool; must outlive this. `limit`: the most batches and encoded bytes in
  /// flight.
  EncodePass(const ConvertOptions& options, const SourceScene& scene, WorkerPool& pool,
             std::span<EncodeScratch> scratch, format::ContainerWriter& writer, InFlight limit, StageTimes& times,
             EncodeStart start);

  /// Whether a batch may be submitted now. If none is in flight, any batch may.
  bool has_room(const std::vector<EncodeItem>& batch) const;
  void submit(std::vector<EncodeItem> batch);

  /// Batches that are not placed yet.
  uint64_t in_flight() const { return batches_.size(); }

  /// Whether next() would return at once. Called with the pool's lock held.
  bool ready_locked() const { return results_.ready_locked(); }

  /// The windows of the oldest batch in flight. Errors of encode_window.
  Result<std::vector<EncodedWindow>> next();

  /// Adds the chunks of the last next() to pages, and returns the records for the tables. Errors of
  /// GeometryWriter::add.
  Result<std::vector<WindowOutcome>> place(std::vector<EncodedWindow> windows);

  /// A state from which another pass can continue, once this one is released and the file is cut back to these pages.
  struct Mark {
    uint32_t pages = 0;
    EncodeStart start;
  };
  /// The state after the last place().
  Mark mark() const;

  /// Writes everything that is left.
  Result<void> finish() { return geometry_.finish(); }
  /// The same except for the last page, which another pass continues.
  Result<GeometryWriter::OpenPage> release() { return geometry_.release(); }

 private:
  using Items = std::vector<EncodeItem>;

  Result<WindowOutcome> place_window(EncodedWindow& window, const EncodeItem& item);

  const SourceScene& scene_;
  format::ContainerWriter& writer_;
  EncodeOptions options_;
  InFlight limit_;
  StageTimes& times_;
  uint64_t window_;
  uint32_t mesh_;
  uint64_t triangle_;
  std::vector<format::ChunkRecord> placed_;
  std::span<EncodeScratch> scratch_;
  GeometryWriter geometry_;
  std::deque<std::shared_ptr<Items>> batches_;
  OrderedResults<std::vector<EncodedWindow>> results_;
};

}  // namespace scree::convert
