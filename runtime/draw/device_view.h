// The memory and the pictures of one view of a scene in GPU memory (device_scene.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/cuda/frame/frame.h"
#include "kernels/frame.h"
#include "kernels/frame_parts.h"
#include "kernels/shade/layers.h"
#include "runtime/draw/host_memory.h"
#include "runtime/scene/scene.h"
#include "runtime/stream/streamer.h"

namespace scree::runtime {

/// The layers of a frame, rows from the top. A pixel shows its nearest sample, except in colours
/// (kernels::LayerTargets).
enum class Layer {
  kColor,     // 4 bytes per pixel: red, green, blue as 8-bit sRGB, alpha linear, not premultiplied
  kDepth,     // float: distance from the eye's plane in world units, infinity on the background
  kTriangle,  // int64_t: global triangle id, -1 on the background
  kInstance,  // int32_t: index in the scene's instances, -1 on the background
  kSamples,   // uint64_t per sample: the visibility buffer (kernels/visbuffer.h)
  kNormal,    // 3 floats: unit length, world space, 0 on the background
  kUv,        // 2 floats: texture coordinates, 0 on the background and if the mesh has none
  kLinear,    // 4 floats: the colours of linear_picture(), in host memory alone
};
inline constexpr size_t kLayerCount = 8;
inline constexpr size_t kBlockCount = 7;  // the layers before kLinear, which a batch can make in the GPU's memory

/// Bytes per pixel; of kSamples, per sample.
constexpr uint64_t bytes_of(Layer layer) {
  constexpr uint64_t kBytes[kLayerCount] = {4, 4, 8, 4, 8, 12, 8, 16};
  return kBytes[static_cast<size_t>(layer)];
}

/// Makes `out` the memory that a layer of kernels::LayerTargets is written to.
inline void set_target(kernels::LayerTargets& targets, Layer layer, std::byte* out) {
  if (layer == Layer::kDepth) targets.depth = reinterpret_cast<float*>(out);
  if (layer == Layer::kTriangle) targets.triangle = reinterpret_cast<int64_t*>(out);
  if (layer == Layer::kInstance) targets.instance = reinterpret_cast<int32_t*>(out);
  if (layer == Layer::kNormal) targets.normal = reinterpret_cast<float*>(out);
  if (layer == Layer::kUv) targets.uv = reinterpret_cast<float*>(out);
}
inline kernels::LayerTargets target_of(Layer layer, std::byte* out) {
  kernels::LayerTargets targets{};
  set_target(targets, layer, out);
  return targets;
}

/// The device memory that one view of a DeviceScene keeps from frame to frame: samples, pictures and layers, and for a
/// resident scene a draw list with its queues and hints. Buffers grow to the largest picture. All views of a streamed
/// scene share its chunks and draw list. One thread at a time draws views of one device.
class DeviceView {
 public:
  DeviceView(DeviceView&&) noexcept;
  DeviceView& operator=(DeviceView&&) noexcept;
  ~DeviceView();

  /// Makes the scene's device the calling thread's current one. All functions below require that. Error kDevice.
  Result<void> make_current() const;

  /// As kernels::draw_cpu, on the device, where the visibility buffer stays. `times`: null, or filled in; a streamed
  /// frame has only raster_ms, by the host's clock. `shade`: for a streamed scene, the picture and the light that
  /// resolve() will make; null if it will not be called. `is_over`: as for Streamer::draw(), if the scene is streamed.
  Result<kernels::FrameStats> draw(const kernels::View& view, kernels::FrameTimes* times = nullptr,
                                   const kernels::ShadeOptions* shade = nullptr, const IsOver& is_over = {});

  /// Statistics of the last frame, if the scene is streamed.
  const std::optional<StreamStats>& stream_stats() const;

  /// Queues work that lowers samples in device memory, on a cudaStream_t.
  using LowerSamples = std::function<Result<void>(uint64_t* samples, void* stream)>;
  /// Begins to draw the next picture, into samples of its own; finish() ends it. Until then this view cannot draw
  /// another picture. All other functions refer to the previous picture, which they shade and read at the same time, on
  /// stream(). They make no layers of blended surfaces, no normals and no texture coordinates. `join`: empty, or called
  /// before this returns, as DrawOptions::join: in a two-pass frame after pass 1 and at the end, otherwise at the end.
  /// Errors kUnsupported (a streamed scene, or several GPUs), kRange (as draw()), kDevice, those of `join`.
  Result<void> start(const kernels::View& view, const LowerSamples& join = {});
  bool has_started() const;
  /// Ends the picture that start() began. Returns false if a queue was too small: the picture was then drawn again,
  /// without `join`. Pictures that are started later wait for all work on the picture before this one.
  Result<bool> finish();
  /// The cudaStream_t on which these functions queue work on the last picture; null: the default stream.
  void* stream() const;

  /// Copies the visibility buffer of the picture that draw() made last to host memory: `samples` is all of it.
  Result<void> read_samples(std::span<uint64_t> samples);

  /// Replaces that visibility buffer by samples that also show the chunks of other processes. Error kRange (another
  /// number of samples), kDevice.
  Result<void> write_samples(std::span<const uint64_t> samples);

  /// Resolves the picture that draw() made last, as kernels::resolve_cpu with 4 channels, on the device. `view`: as for
  /// draw(). If the scene is streamed, the picture and the light of `options` are also as for draw(). `pixels`: RGBA8,
  /// red in the low byte, read back; may be empty if only the time is wanted. `out`: null, or device memory for the
  /// pixels.
  Result<void> resolve(const kernels::View& view, uint32_t samples_per_side, const kernels::ShadeOptions& options,
                       std::span<uint32_t> pixels, kernels::ResolveTimes* times = nullptr, uint32_t* out = nullptr);

  /// The layers of blended surfaces in the picture that resolve() made last.
  const kernels::BlendCounts& blended() const;

  /// The layers over that picture, read back: as kernels::blend_cpu(), 4 floats per sample. Requires
  /// kernels::shows_layers(). Errors as resolve().
  Result<void> read_over(const kernels::View& view, const kernels::ShadeOptions& options, std::span<float> over);

  /// Linear light of the samples of that picture, 3 floats each, read back: as kernels::shade_part_cpu() with all
  /// chunks. Samples of the background, and of chunks that others have, are 0. `view` and `options`: as for resolve(),
  /// of a picture that is shaded from chunks (kernels::shades_from_chunks()). Errors as resolve().
  Result<void> read_colors(const kernels::View& view, const kernels::ShadeOptions& options, std::span<float> colors);

  /// As read_colors(), but in device memory, valid until the next call.
  Result<float*> make_colors(const kernels::View& view, const kernels::ShadeOptions& options);

  /// Queues the work that makes a picture of the colours in the memory of make_colors(), which the caller may have
  /// overwritten. Otherwise as resolve(), without layers of blended surfaces. Returns pixels().
  Result<uint32_t*> resolve_colors(const kernels::View& view, uint32_t samples_per_side,
                                   const kernels::ShadeOptions& options);

  /// One sample of the picture that draw() made last; `index` below width * height. Error kDevice.
  Result<uint64_t> read_sample(uint64_t index);

  /// Queues the work that makes a layer of that picture. Returns device memory that stays until the next call for this
  /// layer. Errors kRange (no such picture), kUnsupported (normals and texture coordinates of a streamed scene, whose
  /// chunks are not present any more), kDevice.
  Result<const std::byte*> make_layer(const kernels::View& view, uint32_t samples_per_side, Layer layer);

  /// The same, read back: `out` is all of it. Errors as make_layer().
  Result<void> read_layer(const kernels::View& view, uint32_t samples_per_side, Layer layer, std::span<std::byte> out);

  /// Queues the work that makes several layers of that picture in the caller's device memory. Errors as make_layer().
  Result<void> make_layers(const kernels::View& view, uint32_t samples_per_side, const kernels::LayerTargets& out);

  /// Draws pictures of one size, one after the other. `make(i)` queues the work after drawing picture i, by resolve()
  /// and make_layers(). If it is called twice for a picture, the second result holds. The next picture is submitted
  /// before the host waits for this one, so that the device always has work. For that a second picture has samples and
  /// a draw list of its own, as long as the view lives. Without memory for them, and if chunks are streamed, the host
  /// waits for each picture. `scene`: the uploaded one. Returns the sums of the pictures' counts.
  Result<kernels::FrameStats> draw_batch(const Scene& scene, std::span<const kernels::View> views,
                                         const kernels::ShadeOptions* shade,
                                         const std::function<Result<void>(size_t)>& make);

  /// The same in one set of launches, for depths and ids alone, into `out`, view by view. Returns nullopt if
  /// kernels::CudaViewBatch does not take the scene or the pictures, or if the device has no room. There is no picture
  /// to resolve() afterwards.
  Result<std::optional<kernels::FrameStats>> draw_together(const Scene& scene, std::span<const kernels::View> views,
                                                           uint32_t samples_per_side, const kernels::LayerTargets& out);

  /// Codes the picture that resolve() made last, of `width` x `height` pixels, on the device. Returns a baseline JPEG
  /// file with libjpeg's tables of `quality` (1 to 100) and a restart marker after every few MCUs. `is_sharp`: colours
  /// in full resolution instead of a quarter. Errors kDevice, kMemory, kRange (a side of 0 or over 65,535).
  Result<std::vector<std::byte>> encode_jpeg(uint32_t width, uint32_t height, int quality, bool is_sharp);

  /// Device memory for a layer of a batch: at least `bytes`, valid until the next call with this `index`, which is
  /// below kBlockCount.
  Result<std::byte*> reserve_block(size_t index, uint64_t bytes);

  /// Copies the samples of the picture that draw() made last to device memory of their own, valid until the next call
  /// with this `index`, which is below kBlockCount. Batches use the same memory. Error kDevice.
  Result<uint64_t*> keep_samples(size_t index);

  /// Device memory: the picture that resolve() made last, RGBA8.
  const uint32_t* pixels() const;
  /// Device memory: the samples of the picture that draw() made last. The caller may overwrite them with samples that
  /// also show the chunks of other processes. Error kDevice.
  Result<uint64_t*> samples();

  /// Keeps the memory of a picture, a layer or the samples at its place while the result lives. The result must be
  /// destroyed with the device current. Null if `data` is none of these any more.
  std::shared_ptr<const void> hold(const std::byte* data) const;

  /// Waits for the queued work, then copies from device memory. Error kDevice.
  Result<void> read(const void* device, std::span<std::byte> host);
  /// The same, to memory of this view. Error kDevice.
  Result<void> write(void* device, std::span<const std::byte> host);
  /// As read(), but without waiting, from memory of this view: the copy runs beside work that is queued later. `host`
  /// is complete after end_reads(); if it is not HostMemory::pinned(), this may wait. Later pictures and layers of this
  /// view are written once the copy has ended. Error kDevice.
  Result<void> read_later(const void* device, std::span<std::byte> host);
  /// Waits for the copies of read_later(). Error kDevice.
  Result<void> end_reads();
  /// Makes a stream of the caller's, a cudaStream_t, wait for the work that is queued now. Error kDevice.
  Result<void> order_before(void* stream);
  /// Makes all work that is queued from now on wait for the caller's work on that stream. Error kDevice.
  Result<void> order_after(void* stream);
  /// Errors kUsage: `data` is not in the memory of the GPU that draws; kDevice.
  Result<void> check_memory(const void* data) const;

 private:
  friend class DeviceScene;
  struct Impl;
  explicit DeviceView(std::shared_ptr<Impl> impl);
  std::shared_ptr<Impl> impl_;
};

}  // namespace scree::runtime
