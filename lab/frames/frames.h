// How bench draws a frame: the only file here that knows which functions of kernels/ do it.
#pragma once

#include <memory>
#include <optional>

#include "format/result.h"
#include "kernels/cuda/frame.h"
#include "kernels/frame.h"
#include "lab/frames/picture_error.h"
#include "lab/options.h"
#include "lab/scenes/resident_scene.h"

namespace scree::lab {

/// Of one frame, ms; what the backend does not time apart is missing.
struct FrameMs {
  std::optional<float> clear, cull, small, medium, large, pyramid, second, raster, resolve, occlusion;
  float wall = 0;   // by the host's clock: from the call to the finished visibility buffer
  float frame = 0;  // all of it, with the waits between
};

struct FrameOptions {
  uint32_t samples_per_side = 1;
  bool sampleless_test = true;  // triangles that cover no pixel centre go early
  Culling culling;
  Effects effects;
  bool stage_times = false;  // of small scenes too, which take longer then
};

/// Draws frames of one scene, which outlives it.
class Frames {
 public:
  static Result<Frames> create(const ResidentScene& scene, const kernels::CudaQueueSizes& sizes = {});
  Frames(Frames&&) noexcept;
  Frames& operator=(Frames&&) noexcept;
  ~Frames();

  /// Draws and resolves `view`, width and height in samples. Errors kDevice, kRange.
  Result<kernels::FrameStats> draw(const kernels::View& view, const FrameOptions& options, FrameMs& ms);

  /// The visibility buffer of the last frame, read back.
  Result<std::vector<uint64_t>> samples() const;
  /// The last frame with its picture.
  Result<HostPicture> picture() const;

 private:
  struct Impl;
  explicit Frames(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::lab
