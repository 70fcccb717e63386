// Draws a scene whose chunks do not all fit into memory. Chunks are loaded batch by batch, near ones first, into a pool
// of fixed size, and each is drawn and shaded while it is there. The picture equals the picture of the whole scene in
// memory, bit for bit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/frame.h"
#include "kernels/scene_view.h"
#include "runtime/scene/scene.h"
#include "runtime/stream/residency.h"
#include "runtime/stream/visible_chunks.h"

namespace scree::runtime {

/// The drawing device and its pool. Called by one thread. Every error ends the frame.
class StreamTarget {
 public:
  /// Result of drawing a part of a frame, and the target's time for it in ms.
  struct Drawn {
    kernels::FrameStats stats;
    double ms;
  };

  /// Begins a frame with all samples cleared. `shade`: options for shading parts; null makes samples only.
  virtual Result<void> begin(const kernels::View& view, const kernels::ShadeOptions* shade) = 0;
  /// Chunks that the frame's view may show, near ones first (order_by_depth()). Valid until the next call.
  virtual Result<std::span<const uint32_t>> list() = 0;
  /// Starts the moves of a batch and then the loads of its chunks' payloads to their places, while parts are drawn.
  /// Started batches are executed in order, up to kMostLoads at a time.
  virtual Result<void> start_loading(const Residency::Batch& batch) = 0;
  /// Whether the oldest started batch is loaded, so that finish_loading() does not wait.
  virtual Result<bool> is_loaded() = 0;
  /// Waits until the oldest started batch is loaded. Returns the ms that its copies took.
  virtual Result<double> finish_loading() = 0;
  /// The share of its chunks that a part draws.
  enum class Share : uint8_t {
    kAll,         // all visible clusters
    kLikelySeen,  // the clusters that are probably visible in the finished picture, to hide others; not shaded
    kRest,        // the remaining clusters; must follow kLikelySeen in the same frame, for the same chunks at the same
                  // offsets
  };
  struct PartOptions {
    Share share;
    bool finds_depths;  // then finds the depths of all samples, for nearest_shown()
  };
  /// Starts drawing these chunks into the frame's samples, and shading the samples in which they are nearest. One part
  /// at a time.
  virtual Result<void> start_drawing(std::span<const Residency::Place> places, PartOptions options) = 0;
  /// Waits until the part is drawn. Its chunks are no longer needed, unless their kRest follows.
  virtual Result<Drawn> finish_drawing() = 0;
  /// The nearest depth code at which a chunk of the list may still change a sample, by the depths of the last finished
  /// part of this frame that found depths. kNotInView if it cannot, because all samples that it may cover are nearer.
  /// Before any depths are found: the nearest code by its bounds, as in the list's order.
  virtual uint32_t nearest_shown(uint32_t chunk) const = 0;
  /// After an error: waits until nothing is drawn or written to the pool any more.
  virtual void stop() = 0;

 protected:
  ~StreamTarget() = default;
};

/// Statistics of one frame. Bytes are sums of payloads. The first four times are the host's; their sum is the frame's
/// time without its beginning and end. The last two are the target's, and overlap.
struct StreamStats {
  kernels::FrameStats drawn;    // an instance counts once per part that it is in
  uint64_t seen_chunks = 0;     // in the view according to their bounds
  uint64_t seen_bytes = 0;      // of these chunks
  uint64_t missing_bytes = 0;   // of chunks in the view that were not in the pool when the frame began
  uint64_t hidden_bytes = 0;    // missing, hidden by chunks drawn before, and not loaded
  uint64_t streamed_bytes = 0;  // missing and loaded
  uint64_t joined_bytes = 0;    // of these, joined by the GPU from compressed pages (the target counts them)
  uint64_t left_bytes = 0;      // missing, not hidden by drawn chunks, and not loaded because the frame was ended
  uint64_t needed_bytes = 0;    // streamed and not hidden in the finished picture, according to bounds
  uint64_t moved_bytes = 0;     // within the pool
  uint64_t batches = 0;         // loaded batches
  uint64_t parts = 0;           // drawn parts: batches, resident chunks, and their expected visible clusters
  double list_ms = 0;           // finding the chunks in the view
  double choose_ms = 0;         // choosing loads and starting them
  double draw_ms = 0;           // starting parts and waiting for them
  double load_ms = 0;           // waiting for loads while nothing is drawn
  double drawing_ms = 0;        // from each part's start to its end, including its depths
  double copying_ms = 0;        // from each load's first copy to its end

  /// Adds the streaming of a layer of blended surfaces over the same picture. `drawn`, `seen_chunks` and `seen_bytes`
  /// stay as they are.
  void add_layer(const StreamStats& layer);
};

/// Returns whether the frame should end without the chunks whose loads have not started. Once true, it stays true.
/// Empty: never.
using IsOver = std::function<bool()>;

// How far loading runs ahead. Any values give the same picture.

/// A batch is this share of the pool, up to kMostBatchBytes. Large batches take less fixed time (a part passes over all
/// records and samples). With small batches, fewer hidden chunks are loaded, and the last batch is drawn soon.
inline constexpr uint64_t kBatchShare = 8;
inline constexpr uint64_t kMostBatchBytes = uint64_t{256} << 20;
/// Without the visibility of an earlier frame, the first batch is smaller by this factor, and each further batch is
/// twice as large as the batch before.
inline constexpr uint64_t kFirstBatchShare = 4;
/// Most loads in flight of chunks that may be hidden. With two, the link is not idle between loads.
inline constexpr size_t kLoadsAhead = 2;
/// Most loads in flight of chunks that are certainly needed.
inline constexpr size_t kMostLoads = 16;
/// Most batches that are drawn as one part, if several have arrived.
inline constexpr size_t kLoadsInPart = 4;

/// Draws the frames of one scene from one pool. Not thread-safe.
class Streamer {
 public:
  /// `scene`: must outlive this. `chunk_bytes`: ChunkSource::chunk_bytes(). `pool_bytes`: all the memory that chunks
  /// may take. `most_batch_bytes`: upper limit of a batch, except for a batch of one larger chunk. Errors, with the
  /// file: errors of Residency::create; kMemory.
  static Result<Streamer> create(const Scene& scene, uint64_t pool_bytes, std::vector<uint64_t> chunk_bytes,
                                 uint64_t most_batch_bytes = kMostBatchBytes);

  /// The scene in the form that `target` draws: each chunk in a page of its own, with the chunk's number, at offset 0.
  /// Its page pointers are null; a target has its own table (chunk_count pointers) with the places of the chunks that
  /// it draws.
  const kernels::SceneView& view() const { return view_; }

  /// Draws one frame through `target`, which must use this streamer's pool exclusively. After an error the next frame
  /// begins with an empty pool. With `is_over` at most kLoadsAhead loads are in flight. If it ends the frame, the
  /// picture has the chunks that were present or whose loads had started; StreamStats::left_bytes are missing. Errors
  /// kRange (kernels::check_frame), kMemory, errors of `target`.
  Result<StreamStats> draw(const kernels::View& view, const kernels::ShadeOptions* shade, StreamTarget& target,
                           const IsOver& is_over = {});

  /// Loads missing chunks into free room, in the order of the file, until `is_over`. Errors as draw().
  struct Rest {
    uint64_t left_bytes = 0;                // of chunks that are still missing
    std::vector<Residency::Place> present;  // the chunks that are there
  };
  Result<Rest> load_rest(StreamTarget& target, const IsOver& is_over = {});

  const Residency& residency() const { return residency_; }
  /// As Residency::resize(). A smaller pool has smaller batches.
  void resize_pool(uint64_t pool_bytes);

  /// Upper limit of a batch's bytes in the pool.
  uint64_t most_batch_bytes() const;

 private:
  /// Visibility of a chunk in the last picture that was examined.
  enum class LastSeen : uint8_t { kUnknown, kVisible, kHidden };
  class Frame;

  Streamer(const Scene& scene, Residency residency, uint64_t batch_bytes);
  template <class Work>
  auto guarded(StreamTarget& target, const Work& work) -> decltype(work());

  Residency residency_;
  uint64_t most_batch_bytes_;        // wanted size of a batch of the first pool
  uint64_t batch_bytes_;             // of this pool
  std::vector<LastSeen> last_seen_;  // by chunk
  std::vector<format::ChunkRecord> chunks_;
  kernels::SceneView view_{};
};

}  // namespace scree::runtime
