// Drawing a scene whose chunks do not all fit into the memory that they are drawn from: chunks come batch by batch,
// near ones first, into a pool of fixed size, and each is drawn and shaded while it is there. The picture is that of
// the whole scene in memory, bit for bit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/frame.h"
#include "kernels/scene_view.h"
#include "runtime/residency.h"
#include "runtime/scene.h"

namespace scree::runtime {

/// What draws, and the pool that it draws from. Called by one thread; all errors end the frame.
class StreamTarget {
 public:
  /// Begins a frame: no sample has a triangle. `shade`: how draw() shades; null where only samples are wanted.
  virtual Result<void> begin(const kernels::View& view, const kernels::ShadeOptions* shade) = 0;
  /// Moves bytes within the pool, in this order.
  virtual Result<void> move(std::span<const Residency::Move> moves) = 0;
  /// Starts bringing the chunks' payloads to their places in the pool, while draw() and other loads go on; up to
  /// kLoadsAhead at a time.
  virtual Result<void> start_loading(std::span<const Residency::Place> places) = 0;
  /// Returns when those of the oldest start are there.
  virtual Result<void> finish_loading() = 0;
  /// After an error: returns when nothing is written to the pool any more.
  virtual void stop_loading() = 0;
  /// Draws these chunks, all that is seen of them, into the samples of the frame, and shades the samples that they win;
  /// returns when the chunks are not needed any more.
  virtual Result<kernels::FrameStats> draw(std::span<const Residency::Place> places) = 0;
  /// Chunks that the frame's view may show, near ones first (order_by_depth()); until the next call.
  virtual Result<std::span<const uint32_t>> list() = 0;
  /// Looks at the depths of the samples so far, for is_hidden(). After list().
  virtual Result<void> find_depths() = 0;
  /// Whether the chunk, one of the list, cannot change a sample any more: all that it may cover lies behind what was
  /// there when find_depths() was called last, in this frame.
  virtual bool is_hidden(uint32_t chunk) const = 0;

 protected:
  ~StreamTarget() = default;
};

/// Of one frame. Bytes are the chunks' own.
struct StreamStats {
  kernels::FrameStats drawn;    // an instance counts once for each batch that it is in
  uint64_t seen_chunks = 0;     // in the view, as far as their boxes tell
  uint64_t seen_bytes = 0;      // of them
  uint64_t missing_bytes = 0;   // of those that were not in the pool when the frame began
  uint64_t hidden_bytes = 0;    // of the missing: behind what was drawn before, and not loaded
  uint64_t streamed_bytes = 0;  // of the missing: loaded
  uint64_t needed_bytes = 0;    // of those: not behind the picture as it is in the end, as far as boxes tell
  uint64_t moved_bytes = 0;     // within the pool
  uint64_t batches = 0;         // that were loaded
  double list_ms = 0;           // finding the chunks in the view
  double choose_ms = 0;         // choosing what is loaded, moving and asking for it
  double draw_ms = 0;           // drawing batches
  double depths_ms = 0;         // finding what hides behind what is drawn
  double load_ms = 0;           // waiting for loads while nothing was drawn
};

/// Batches that are loaded while one is drawn: the second is asked for before the first is there, so that the link is
/// not idle in between.
inline constexpr size_t kLoadsAhead = 2;
inline constexpr uint64_t kMostBatchBytes = uint64_t{256} << 20;

/// The frames of one scene over one pool. Not thread-safe.
class Streamer {
 public:
  /// `scene`: outlives this. `chunk_bytes`: ChunkSource::chunk_bytes(). `pool_bytes`: all the memory that chunks may
  /// take. Errors, the file named: those of Residency::create; kMemory.
  static Result<Streamer> create(const Scene& scene, uint64_t pool_bytes, std::vector<uint64_t> chunk_bytes);

  /// The scene as `target` has to see it: each chunk in a page of its own, of its number, at offset 0. Its pages are
  /// null; a target has a table of its own (chunk_count pointers), in which the chunks that it draws have their places.
  const kernels::SceneView& view() const { return view_; }

  /// Draws one frame through `target`, whose pool is this one's, and nobody else's. After an error the next frame
  /// begins with an empty pool. Errors kRange (kernels::check_frame), kMemory, those of `target`.
  Result<StreamStats> draw(const kernels::View& view, const kernels::ShadeOptions* shade, StreamTarget& target);

  const Residency& residency() const { return residency_; }

  /// The most that a batch takes of the pool.
  uint64_t most_batch_bytes() const;

 private:
  Streamer(const Scene& scene, Residency residency);
  Result<StreamStats> draw_all(const kernels::View& view, const kernels::ShadeOptions* shade, StreamTarget& target);

  Residency residency_;
  std::vector<bool> was_hidden_;  // by chunk: when it was missing last, so that it was not loaded
  std::vector<format::ChunkRecord> chunks_;
  kernels::SceneView view_{};
};

}  // namespace scree::runtime
