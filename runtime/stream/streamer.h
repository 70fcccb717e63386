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
#include "runtime/scene/scene.h"
#include "runtime/stream/residency.h"
#include "runtime/stream/visible_chunks.h"

namespace scree::runtime {

/// What draws, and the pool that it draws from. Called by one thread; all errors end the frame.
class StreamTarget {
 public:
  /// Drawing a part of a frame, and how long that took the target, in ms.
  struct Drawn {
    kernels::FrameStats stats;
    double ms;
  };

  /// Begins a frame: no sample has a triangle. `shade`: how parts are shaded; null where only samples are wanted.
  virtual Result<void> begin(const kernels::View& view, const kernels::ShadeOptions* shade) = 0;
  /// Chunks that the frame's view may show, near ones first (order_by_depth()); until the next call.
  virtual Result<std::span<const uint32_t>> list() = 0;
  /// Starts the moves of a batch and, after them, bringing its chunks' payloads to their places, while parts are drawn.
  /// What was started before comes before. Up to kMostLoads at a time.
  virtual Result<void> start_loading(const Residency::Batch& batch) = 0;
  /// Whether the oldest start is done, as far as the target cares to look: then finish_loading() does not wait.
  virtual Result<bool> is_loaded() = 0;
  /// Returns when the oldest start is done; the ms for which it kept copying.
  virtual Result<double> finish_loading() = 0;
  /// What a part draws of its chunks.
  enum class Share : uint8_t {
    kAll,         // that is seen of them
    kLikelySeen,  // what the target takes to be seen in the end, for others to hide behind; not shaded
    kRest,        // what that left: follows in the same frame for each of those chunks, which stay where they are
  };
  struct PartOptions {
    Share share;
    bool finds_depths;  // looks at the depths of all samples after that, for nearest_shown()
  };
  /// Starts drawing these chunks into the samples of the frame, and shading the samples that they win. One part at a
  /// time.
  virtual Result<void> start_drawing(std::span<const Residency::Place> places, PartOptions options) = 0;
  /// Returns when the part is drawn; its chunks are not needed any more, unless the rest of them follows.
  virtual Result<Drawn> finish_drawing() = 0;
  /// Of a chunk of the list: the nearest depth code that it may have where it can still change a sample; kNotInView
  /// where it cannot, since all that it may cover lies behind what was there when depths were found last, in a part of
  /// this frame that is finished. Before that by its place alone, as the list is ordered.
  virtual uint32_t nearest_shown(uint32_t chunk) const = 0;
  /// After an error: returns when nothing is drawn, nor written to the pool, any more.
  virtual void stop() = 0;

 protected:
  ~StreamTarget() = default;
};

/// Of one frame. Bytes are the chunks' own. The first times are the host's, one after the other: their sum is the
/// frame's but for its beginning and end. The last two are the target's, and pass meanwhile.
struct StreamStats {
  kernels::FrameStats drawn;    // an instance counts once for each part that it is in
  uint64_t seen_chunks = 0;     // in the view, as far as their boxes tell
  uint64_t seen_bytes = 0;      // of them
  uint64_t missing_bytes = 0;   // of those that were not in the pool when the frame began
  uint64_t hidden_bytes = 0;    // of the missing: behind what was drawn before, and not loaded
  uint64_t streamed_bytes = 0;  // of the missing: loaded
  uint64_t needed_bytes = 0;    // of those: not behind the picture as it is in the end, as far as boxes tell
  uint64_t moved_bytes = 0;     // within the pool
  uint64_t batches = 0;         // that were loaded
  uint64_t parts = 0;           // that were drawn, of batches, of what was there, or of what was likely seen of that
  double list_ms = 0;           // finding the chunks in the view
  double choose_ms = 0;         // choosing what is loaded, and asking for it
  double draw_ms = 0;           // asking for parts, and waiting for them
  double load_ms = 0;           // waiting for loads while nothing is drawn
  double drawing_ms = 0;        // from each part's start to its end, its depths with it
  double copying_ms = 0;        // from each load's first copy to its end
};

// How far loading runs ahead. All may be any number; the picture is the same.

/// A batch is this share of the pool, and this much at most: large enough that what each costs beside its bytes (a part
/// passes over all records and samples) stays small, small enough that little is loaded before it is known to hide, and
/// that the last one is drawn soon.
inline constexpr uint64_t kBatchShare = 8;
inline constexpr uint64_t kMostBatchBytes = uint64_t{256} << 20;
/// The first batches of a frame that nothing is known of are so much smaller, and double from one to the next.
inline constexpr uint64_t kFirstBatchShare = 4;
/// Batches that are loaded at a time, of chunks that may hide: the second is asked for before the first is there, so
/// that the link is not idle in between.
inline constexpr size_t kLoadsAhead = 2;
/// And of chunks that are wanted for sure.
inline constexpr size_t kMostLoads = 16;
/// Batches that are drawn as one part, where they are there before they can be drawn.
inline constexpr size_t kLoadsInPart = 4;

/// The frames of one scene over one pool. Not thread-safe.
class Streamer {
 public:
  /// `scene`: outlives this. `chunk_bytes`: ChunkSource::chunk_bytes(). `pool_bytes`: all the memory that chunks may
  /// take. `most_batch_bytes`: no batch takes more of it, unless its one chunk does. Errors, the file named: those of
  /// Residency::create; kMemory.
  static Result<Streamer> create(const Scene& scene, uint64_t pool_bytes, std::vector<uint64_t> chunk_bytes,
                                 uint64_t most_batch_bytes = kMostBatchBytes);

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
  /// What a chunk was in the last picture that was asked.
  enum class Known : uint8_t { kNothing, kNeeded, kHidden };
  class Frame;

  Streamer(const Scene& scene, Residency residency, uint64_t batch_bytes);

  Residency residency_;
  uint64_t batch_bytes_;      // wanted
  std::vector<Known> known_;  // by chunk
  std::vector<format::ChunkRecord> chunks_;
  kernels::SceneView view_{};
};

}  // namespace scree::runtime
