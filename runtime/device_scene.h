// A loaded scene's copy in GPU memory: one arena, its size known before the first byte is copied.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/scene.h"

namespace scree::runtime {

/// Whether a GPU can be used. Errors kDevice, with what to do: no driver, no device, one too old, or a program built
/// without CUDA.
Result<void> find_device();

struct UploadStats {
  uint64_t device_bytes = 0;  // of the arena
  double upload_ms = 0;
};

class DeviceScene {
 public:
  /// Copies `scene`, which outlives this, to the current device: records, pages as they are drawn from, textures. Raw
  /// pages go straight from the map through a ring of pinned buffers. `budget_bytes`: 0 takes what the device has free.
  /// Errors kDevice: no usable device, a CUDA call that failed (which and for what), or a scene that does not fit (both
  /// sizes named).
  static Result<DeviceScene> upload(const Scene& scene, uint64_t budget_bytes, uint32_t threads);
  DeviceScene(DeviceScene&&) noexcept;
  DeviceScene& operator=(DeviceScene&&) noexcept;
  ~DeviceScene();

  /// As kernels::draw_cpu, on the device, into host memory.
  Result<kernels::FrameStats> draw(const kernels::View& view, std::span<uint64_t> samples);

  /// Shades rows of the picture that draw() made last, from `first_row` on, as many as `rgba` (host memory) holds, as
  /// kernels::shade_cpu. `samples`: what draw() gave, for the range of depths that Show::kDepth needs.
  Result<void> shade(const kernels::View& view, std::span<const uint64_t> samples, const kernels::ShadeOptions& options,
                     std::span<float> rgba, uint32_t first_row);

  const UploadStats& stats() const;

 private:
  struct Impl;
  explicit DeviceScene(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::runtime
