// Frames of one scene on a GPU: as frame.h's draw_cpu(), over device memory. The visibility buffer is
// the CPU's, bit for bit. A frame is one submission: the host hears of it when it is done, and draws it again only if a
// queue was too small.
#pragma once

#include <cstdint>
#include <memory>

#include "format/result.h"
#include "kernels/frame.h"
#include "kernels/raster/transform.h"

namespace scree::kernels {

/// What of a frame is drawn. A part (frame_parts.h) leaves the samples of those before; pages came and went since then.
enum class FramePart : uint8_t {
  kWhole,  // all of it; the samples are cleared first
  kPart,   // all of the chunks whose pages are there
  // Of those, clusters that were seen last time, for others to hide behind. Each chunk is in one kRest after that, of
  // the same view and options, and in no part between.
  kPreviouslyVisible,
  kRest,  // what that left
};

struct DrawOptions {
  // All leave the picture as it is.
  bool sampleless_test = true;  // triangles that cover no pixel centre go early
  bool cluster_bounds = true;   // so do clusters, and those outside of the picture
  bool occlusion = true;        // clusters behind the depth pyramid go; takes cluster_bounds
  FramePart part = FramePart::kWhole;
  const uint64_t* peeled = nullptr;  // of Target, in device memory; of frames that draw blended surfaces
  // Frames of small scenes are one submission, whose stages have no times of their own. With this they are submitted
  // kernel by kernel, which costs 0.02 ms on D.
  bool stage_times = false;
};

/// Milliseconds of one frame by CUDA events: clearing and, at the same time, culling; stages 1 to 3 of the first pass,
/// of which 2 and 3 run side by side; the depth pyramid and the second pass (with the pyramids of its rounds), where
/// there are clusters enough; and from the first to the end of all. The counters are cleared behind a frame and are in
/// none of them.
struct FrameTimes {
  float clear_ms;  // of the picture where nothing is culled; before the first frame the counters too
  float cull_ms;   // and, where there is anything to cull, clearing the picture
  float small_ms;
  float medium_ms;
  float large_ms;
  float pyramid_ms;
  float second_ms;
  float raster_ms;
  bool has_stages;  // false: the frame was one submission (DrawOptions::stage_times), and all but raster_ms are 0
};

/// What a frame is drawn with: first capacities, and when a frame of clusters takes more passes. The queues of
/// triangles grow as frames ask; tiles that find no room are drawn at once.
struct CudaQueueSizes {
  uint64_t medium = 1u << 20;  // triangles
  uint64_t large = 1u << 16;
  uint64_t tiles = 1u << 20;
  uint64_t clusters = 1u << 24;  // or as many as there are, if fewer
  uint64_t to_clip = 1u << 16;   // triangles of clusters
  uint64_t clipped = 1u << 15;   // what is left of those, medium and large ones each
  // Scenes of fewer groups of clusters are drawn in one pass: the pyramid and the second would cost more than they
  // save. Where they have no other chunks one kernel culls them, with a ClusterDraw for each group.
  uint64_t two_pass_groups = 2048;
  // Where the camera moves the second pass goes in one round for less than twice so many groups, and in one more for
  // every doubling.
  uint64_t round_groups = 1u << 17;
};

/// Draws on the current device, on streams that the default stream is ordered with, one frame at a time.
class CudaFrames {
 public:
  /// `host`: the scene's records in host memory (its pages and texels are not read), needed during the call only.
  /// `device`: the same scene, every pointer of the current device, which outlives this. Errors kRange: 2^32 instances,
  /// or 2^28 groups of 16 instances of a chunk; kDevice: a CUDA call that failed (which and for what), no memory left.
  static Result<CudaFrames> create(const SceneView& host, const SceneView& device, const CudaQueueSizes& sizes = {});
  CudaFrames(CudaFrames&&) noexcept;
  CudaFrames& operator=(CudaFrames&&) noexcept;
  ~CudaFrames();

  /// What create() takes of device memory, in bytes, before any queue grows; the depth pyramid, 4/3 bytes a
  /// sample, comes with the first frame.
  static uint64_t device_bytes(const SceneView& host, const CudaQueueSizes& sizes = {});

  /// Draws into `samples` (device memory, view.width * view.height), which is cleared first unless `options` says that
  /// this is a part; returns when it is drawn.
  /// `times`: null, or filled in for the frame that stayed. Errors kRange (as draw_cpu),
  /// kDevice.
  Result<FrameStats> draw(const View& view, uint64_t* samples, const DrawOptions& options = {},
                          FrameTimes* times = nullptr);

  /// As draw(), but only begins the frame; finish() ends it. `samples` must stay until then. Work that is queued on the
  /// default stream meanwhile runs after the frame. If a queue overflowed, that work ran on an incomplete frame:
  /// finish() then returns is_drawn_again, and the caller must queue it again.
  struct Finished {
    FrameStats stats;
    bool is_drawn_again;  // after start(), since a queue was too small
  };
  Result<void> start(const View& view, uint64_t* samples, const DrawOptions& options = {});
  Result<Finished> finish(FrameTimes* times = nullptr);

  /// Device memory, by instance number: of the instances that the last frame drew.
  const Transform* transforms() const;

 private:
  struct Impl;
  explicit CudaFrames(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::kernels
