// Frames of one scene on a GPU: as frame.h's draw_cpu(), over device memory. The visibility buffer equals the CPU's bit
// for bit. A frame is one submission. The host reads its counters when it is done, and draws it again only if a queue
// was too small.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include "format/result.h"
#include "kernels/frame.h"
#include "kernels/raster/queues.h"
#include "kernels/raster/transform.h"

namespace scree::kernels {

/// The part of a frame that is drawn. A part (frame_parts.h) keeps the samples of earlier parts; in between, pages were
/// loaded and removed.
enum class FramePart : uint8_t {
  kWhole,  // the whole frame; clears the samples first
  kPart,   // the chunks whose pages are present, completely
  // Only the clusters of these chunks that were visible last time, so that they hide others. Each chunk must then be in
  // one kRest with the same view and options, and in no part between.
  kPreviouslyVisible,
  kRest,  // the clusters that kPreviouslyVisible left
};

struct DrawOptions {
  // The first three do not change the picture.
  bool sampleless_test = true;  // culls triangles that cover no pixel centre
  bool cluster_bounds = true;   // culls such clusters, and clusters outside the picture
  bool occlusion = true;        // culls clusters behind the depth pyramid; requires cluster_bounds
  FramePart part = FramePart::kWhole;
  // Target::peeled and Target::fragments of frames that draw blended surfaces; in device memory.
  const uint64_t* peeled = nullptr;
  FragmentSlots fragments = {};
  // The rows of samples that are drawn, within the picture; samples of other rows are undefined. Empty: all rows.
  RowRange rows = {};
  // Null, or, for a whole frame of GPUs that share the pages, a call that queues the joining of their samples on a
  // cudaStream_t. It is called once all clusters are queued. In a two-pass frame it is also called before that, once
  // the clusters that were visible last time are queued. All GPUs must have the same tables, so that they join equally
  // often. With `join` finish() does not draw again.
  const std::function<Result<void>(void* stream)>* join = nullptr;
  // Whether FrameTimes has the stages. The events between kernels take 0.01 to 0.03 ms. A small scene's frame,
  // otherwise one submission, is launched kernel by kernel, which takes 0.02 ms more on scene D.
  bool stage_times = false;
};

/// Milliseconds of one frame by CUDA events: clearing and culling, which run at the same time; stages 1 to 3 of the
/// first pass, of which 2 and 3 run side by side; the depth pyramid and the second pass (with the pyramids of its
/// rounds) if the frame has one; and the whole from start to end. Clearing the counters runs after the frame and is not
/// included.
struct FrameTimes {
  float clear_ms;  // clearing the picture if no culling kernel runs; in the first frame also the counters
  float cull_ms;   // includes clearing the picture if anything is culled
  float small_ms;
  float medium_ms;
  float large_ms;
  float pyramid_ms;
  float second_ms;
  float raster_ms;
  bool has_stages;  // false: without DrawOptions::stage_times; all but raster_ms are 0
};

/// First capacities of a frame's queues, and when a frame of clusters takes more passes. The queues of triangles grow
/// on demand; tiles without room are drawn at once.
struct CudaQueueSizes {
  uint64_t medium = 1u << 20;  // triangles
  uint64_t large = 1u << 16;
  uint64_t tiles = 1u << 20;
  uint64_t clusters = 1u << 24;  // or the number of clusters, if that is smaller
  uint64_t to_clip = 1u << 16;   // triangles of clusters
  uint64_t clipped = 1u << 15;   // the pieces of these: medium and large ones each
  // Scenes of fewer groups of clusters are drawn in one pass: the pyramid and a second pass would take longer than the
  // time they save. If they have no other chunks, one kernel culls them, with a ClusterDraw for each group.
  uint64_t two_pass_groups = 2048;
  // If the camera moves, the second pass takes one round for up to twice this many groups, and one more round for every
  // doubling.
  uint64_t round_groups = 1u << 17;
  // Scenes in one pass of fewer groups have a block of stage 1 per cluster instead of a warp (D has 128).
  uint64_t few_groups = 192;
  // Whether the queue of clusters holds at least a quarter of all clusters. Then a first frame, in which no cluster is
  // hidden, need not be drawn again: it queues 20% of C's (7680x4320 samples).
  bool holds_first_frame = false;
};

/// Draws on the current device, on streams that the default stream is ordered with, one frame at a time.
class CudaFrames {
 public:
  /// `host`: the scene's records in host memory (pages and texels are not read), needed only during the call. `device`:
  /// the same records; every pointer is on the current device, and outlives this. Errors kRange: 2^32 instances, or
  /// 2^28 groups of 16 instances of a chunk; kDevice: a CUDA call failed (which and for what), or no memory is left.
  static Result<CudaFrames> create(const SceneView& host, const SceneView& device, const CudaQueueSizes& sizes = {});
  CudaFrames(CudaFrames&&) noexcept;
  CudaFrames& operator=(CudaFrames&&) noexcept;
  ~CudaFrames();

  /// Device memory of create() in bytes, before any queue grows. The first frame adds the depth pyramid, 4/3 bytes per
  /// sample.
  static uint64_t device_bytes(const SceneView& host, const CudaQueueSizes& sizes = {});

  /// Draws into `samples` (device memory, view.width * view.height) and returns when it is done. Clears them first
  /// unless `options` chooses a part. `times`: null, or filled with the times of the last attempt. Errors kRange (as
  /// draw_cpu), kDevice.
  Result<FrameStats> draw(const View& view, uint64_t* samples, const DrawOptions& options = {},
                          FrameTimes* times = nullptr);

  /// As draw(), but only begins the frame; finish() ends it. `samples` must stay valid until then. Work that is queued
  /// on the default stream meanwhile runs after the frame. If a queue overflowed, that work ran on an incomplete frame:
  /// finish() then returns is_drawn_again, and the caller must queue it again.
  struct Finished {
    FrameStats stats;
    bool is_drawn_again;  // after start(), because a queue was too small; with DrawOptions::join: must be drawn again
  };
  Result<void> start(const View& view, uint64_t* samples, const DrawOptions& options = {});
  Result<Finished> finish(FrameTimes* times = nullptr);

  /// To be called before a whole frame if pages have come to the scene's table since create(). Error kDevice.
  Result<void> pages_came();

  /// Device memory, by instance number: valid for the instances that the last frame drew.
  const Transform* transforms() const;

 private:
  struct Impl;
  explicit CudaFrames(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::kernels
