// A scene in GPU memory: one arena, its size known before the first byte is copied.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "format/result.h"
#include "kernels/cuda/frame.h"
#include "kernels/frame.h"
#include "runtime/scene/scene.h"
#include "runtime/stream/streamer.h"
#include "runtime/stream/upload.h"

namespace scree::runtime {

/// The pictures that will be drawn of a scene, so that their memory is counted before the scene takes it.
struct PictureNeeds {
  uint32_t width = 0;  // in pixels; 0: nothing is counted
  uint32_t height = 0;
  uint32_t samples_per_side = 1;
  const kernels::ShadeOptions* shade = nullptr;  // null: they are not shaded
};

class DeviceScene {
 public:
  /// Brings `scene` to the current device (device_list.h): records, pages, textures. Pages that the scene has are
  /// copied; others come from the file, checked as Scene::load_pages does, and stay on the device alone
  /// (runtime/stream/upload.h). JPEG levels that the scene has not decoded stay JPEGs, decoded as they are looked at
  /// into `texture_cache` bytes; the picture does not depend on how many. `budget_bytes`: of all that is allocated on
  /// the device for the scene, for the first sizes of its frames' queues (which a frame may make grow), and for
  /// `pictures`; 0: what the device has free, less a sixteenth. Where that does not hold the scene, its chunks are
  /// streamed (runtime/stream/streamer.h): `scene` then outlives this, and at most an eighth of the budget is for
  /// samples of JPEGs (one group at least). `host_memory`: the most pinned memory that uploading and streaming take;
  /// what batches leave of it keeps chunks. 0: as much as batches want, and no chunks are kept. Errors kDevice: no
  /// usable device, a CUDA call that failed (which and for what), or a budget that does not hold what cannot be
  /// streamed (both sizes named); kMemory: a `host_memory` that holds no batch (both sizes named); with the file named,
  /// those of Scene::load_pages.
  static Result<DeviceScene> upload(const Scene& scene, uint64_t budget_bytes, uint32_t threads,
                                    Reading reading = Reading::kAuto, uint64_t texture_cache = kDeviceTextureCache,
                                    uint64_t host_memory = 0, const PictureNeeds& pictures = {});
  DeviceScene(DeviceScene&&) noexcept;
  DeviceScene& operator=(DeviceScene&&) noexcept;
  ~DeviceScene();

  /// As kernels::draw_cpu, on the device, where the visibility buffer stays. `times`: null, or filled in (of a streamed
  /// frame raster_ms alone, by the host's clock). `shade`: what resolve() will be asked to show, by which light, where
  /// the scene is streamed; null where it will not be asked.
  Result<kernels::FrameStats> draw(const kernels::View& view, kernels::FrameTimes* times = nullptr,
                                   const kernels::ShadeOptions* shade = nullptr);

  /// Of the last frame, where the scene is streamed.
  const std::optional<StreamStats>& stream_stats() const;

  /// Copies the visibility buffer of the picture that draw() made last to host memory: `samples` is all of it.
  Result<void> read_samples(std::span<uint64_t> samples);

  /// Resolves the picture that draw() made last, as kernels::resolve_cpu with 4 channels, on the device; `view` as
  /// draw() had it, and of a streamed scene what `options` show and by which light too. `pixels`: RGBA8, red in the low
  /// byte, read back; may be empty where the time is all that is wanted.
  Result<void> resolve(const kernels::View& view, uint32_t samples_per_side, const kernels::ShadeOptions& options,
                       std::span<uint32_t> pixels, kernels::ResolveTimes* times = nullptr);

  const UploadStats& stats() const;

  /// Of the picture that resolve() made last; nothing where no texture has JPEG levels, or the scene is streamed, and
  /// shaded part by part. Errors kDevice.
  Result<std::optional<kernels::TextureCacheCounts>> texture_counts() const;

  /// For those who draw into device memory themselves: the frames, and the scene as they see it, in device memory.
  /// After a frame drawn so, resolve() needs a draw() first: it reads the transforms of the last frame.
  kernels::CudaFrames& frames();
  const kernels::SceneView& device_view() const;

 private:
  struct Impl;
  explicit DeviceScene(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::runtime
