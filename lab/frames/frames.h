// Draws frames for the lab. The only file here that depends on the drawing functions of kernels/.
#pragma once

#include <memory>
#include <optional>

#include "format/result.h"
#include "kernels/cuda/frame/frame.h"
#include "kernels/frame.h"
#include "lab/frames/picture_error.h"
#include "lab/options.h"
#include "lab/scenes/resident_scene.h"

namespace scree::lab {

/// Times of one frame, ms. Stages that the backend does not time separately are missing.
struct FrameMs {
  std::optional<float> clear, cull, small, medium, large, pyramid, second, raster, resolve, occlusion;
  float wall = 0;   // by the host's clock, from the call to the finished visibility buffer
  float frame = 0;  // the whole frame, including waits between stages
};

struct FrameOptions {
  uint32_t samples_per_side = 1;
  bool sampleless_test = true;  // drops triangles that cover no pixel centre early
  Culling culling;
  Effects effects;
  bool stage_times = false;  // makes frames slower
};

/// Draws frames of one scene, which must outlive it.
class Frames {
 public:
  static Result<Frames> create(const ResidentScene& scene, const kernels::CudaQueueSizes& sizes = {});
  Frames(Frames&&) noexcept;
  Frames& operator=(Frames&&) noexcept;
  ~Frames();

  /// Draws and resolves `view`, whose width and height are in samples. Errors kDevice, kRange.
  Result<kernels::FrameStats> draw(const kernels::View& view, const FrameOptions& options, FrameMs& ms);

  /// The visibility buffer of the last frame, read back.
  Result<std::vector<uint64_t>> samples() const;
  /// The picture and the visibility buffer of the last frame.
  Result<HostPicture> picture() const;

 private:
  struct Impl;
  explicit Frames(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::lab
