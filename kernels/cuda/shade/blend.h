// Layers of blended surfaces on a GPU, in device memory. Source: spec/rasterization.md, blending.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <functional>
#include <memory>

#include "format/result.h"
#include "kernels/blend.h"
#include "kernels/raster/queues.h"
#include "kernels/raster/transform.h"

namespace scree::kernels {

/// How fragments are drawn and shaded, in device memory, for a scene whose pages are all present.
struct FragmentSource {
  SceneView scene;  // blended_view()
  /// Draws all fragments in front of the opaque picture (DrawOptions::fragments).
  std::function<Result<void>(const FragmentSlots& to)> draw;
  /// Fills in the colours of samples that show something, 3 floats each.
  std::function<Result<void>(const uint64_t* samples, float* colors)> shade;
  std::function<const Transform*()> transforms;  // by instance, valid after draw()
};

/// Keeps its memory from one picture to the next.
class CudaBlend {
 public:
  /// `fragment_room`: bytes of device memory for fragments. With 4 bytes per sample and 12 more per fragment, up to 8
  /// fragments per sample are drawn at once. The layers of samples with more are drawn one by one.
  explicit CudaBlend(uint64_t fragment_room = 0);
  CudaBlend(CudaBlend&&) noexcept;
  CudaBlend& operator=(CudaBlend&&) noexcept;
  ~CudaBlend();

  /// Device memory of a picture, beside its fragments.
  static uint64_t device_bytes(uint64_t sample_count) { return 48 * sample_count + sizeof(uint64_t); }

  /// As blend_cpu(): returns BlendTargets::over, in device memory, valid until the next call. Work is queued on the
  /// default stream, and the work of `source` has to be ordered with it. The host waits for each layer. `fragments`:
  /// null, or the source that draws the same layers at once; the host then waits twice. Errors kDevice, and the errors
  /// of the sources.
  Result<const float*> blend(const View& view, const uint64_t* samples, uint32_t most, const LayerSource& source,
                             BlendCounts& counts, const FragmentSource* fragments = nullptr);

  /// Memory of 3 floats per sample that blend() used; the caller may use it afterwards.
  float* colors() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Queues finding the alphas of samples whose triangle's chunk has its page. `scene`: blended_view(). `transforms`: by
/// instance number, of the instances that `samples` show. Error kDevice.
Result<void> start_finding_alphas(const SceneView& scene, const View& view, const uint64_t* samples,
                                  const Transform* transforms, float* alphas, cudaStream_t stream);

}  // namespace scree::kernels
