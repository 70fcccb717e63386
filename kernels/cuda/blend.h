// Layers of blended surfaces on a GPU, in device memory. Source: spec/rasterization.md, blending.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <memory>

#include "format/result.h"
#include "kernels/blend.h"
#include "kernels/raster/transform.h"

namespace scree::kernels {

/// Keeps its memory from one picture to the next.
class CudaBlend {
 public:
  CudaBlend();
  CudaBlend(CudaBlend&&) noexcept;
  CudaBlend& operator=(CudaBlend&&) noexcept;
  ~CudaBlend();

  /// What a picture takes of device memory.
  static uint64_t device_bytes(uint64_t sample_count) { return 48 * sample_count + sizeof(uint64_t); }

  /// As blend_cpu(): BlendTargets::over, in device memory until the next call. Work goes to the default stream, with
  /// which the work of `source` is ordered; the host waits for each layer. Errors kDevice, those of `source`.
  Result<const float*> blend(const View& view, const uint64_t* samples, uint32_t most, const LayerSource& source,
                             BlendCounts& counts);

  /// 3 floats per sample that blend() used, free after it.
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
