// A scene in GPU memory: one arena, its size known before the first byte is copied.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "format/result.h"
#include "kernels/cuda/frame.h"
#include "kernels/frame.h"
#include "runtime/scene/scene.h"
#include "runtime/stream/streamer.h"
#include "runtime/stream/upload.h"

namespace scree::runtime {

/// The pictures that will be drawn of a scene. Their memory is counted before the scene takes memory.
struct PictureNeeds {
  uint32_t width = 0;  // in pixels; 0: nothing is counted
  uint32_t height = 0;
  uint32_t samples_per_side = 1;
  const kernels::ShadeOptions* shade = nullptr;  // null: they are not shaded
  bool is_encoded = false;                       // as JPEGs, on the device
  uint32_t shadow_side = 0;                      // of their ShadowMap; 0: none
  bool starts_next = false;                      // by DeviceView::start()
};

/// The layers of a picture's pixels beside its colours (kernels/shade/layers.h).
enum class PixelLayer { kDepth, kTriangle, kInstance, kNormal, kUv };
inline constexpr size_t kPixelLayerCount = 5;
inline constexpr size_t kBlockCount =
    7;  // of DeviceView::reserve_block(): one per Layer that a ViewRenderer makes in batches, by number

/// Bytes per pixel of a layer.
constexpr uint64_t layer_bytes(PixelLayer layer) {
  constexpr uint64_t kBytes[kPixelLayerCount] = {sizeof(float), sizeof(int64_t), sizeof(int32_t), 3 * sizeof(float),
                                                 2 * sizeof(float)};
  return kBytes[static_cast<size_t>(layer)];
}

/// Makes `out` the memory that a layer is written to.
inline void set_target(kernels::LayerTargets& targets, PixelLayer layer, std::byte* out) {
  if (layer == PixelLayer::kDepth) targets.depth = reinterpret_cast<float*>(out);
  if (layer == PixelLayer::kTriangle) targets.triangle = reinterpret_cast<int64_t*>(out);
  if (layer == PixelLayer::kInstance) targets.instance = reinterpret_cast<int32_t*>(out);
  if (layer == PixelLayer::kNormal) targets.normal = reinterpret_cast<float*>(out);
  if (layer == PixelLayer::kUv) targets.uv = reinterpret_cast<float*>(out);
}
inline kernels::LayerTargets target_of(PixelLayer layer, std::byte* out) {
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

  // The next functions are as in DeviceScene. `out`: null, or device memory for the pixels.
  Result<kernels::FrameStats> draw(const kernels::View& view, kernels::FrameTimes* times = nullptr,
                                   const kernels::ShadeOptions* shade = nullptr, const IsOver& is_over = {});
  const std::optional<StreamStats>& stream_stats() const;

  /// Queues work that lowers samples in device memory, on a cudaStream_t.
  using LowerSamples = std::function<Result<void>(uint64_t* samples, void* stream)>;
  /// Begins to draw the next picture, into samples of its own; finish() ends it. Meanwhile this view draws nothing
  /// else, and all other functions are about the picture before it, which they shade and read beside the drawing, on
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

  Result<void> read_samples(std::span<uint64_t> samples);
  Result<void> write_samples(std::span<const uint64_t> samples);
  Result<void> resolve(const kernels::View& view, uint32_t samples_per_side, const kernels::ShadeOptions& options,
                       std::span<uint32_t> pixels, kernels::ResolveTimes* times = nullptr, uint32_t* out = nullptr);
  /// The layers of blended surfaces in the picture that resolve() made last.
  const kernels::BlendCounts& blended() const;
  Result<void> read_over(const kernels::View& view, const kernels::ShadeOptions& options, std::span<float> over);
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
  Result<const std::byte*> make_layer(const kernels::View& view, uint32_t samples_per_side, PixelLayer layer);

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

  /// The same in one set of launches, for depths and ids alone, into `out`, view by view. Returns nothing if
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

class DeviceScene {
 public:
  /// Copies `scene` to the current device (device_list.h): records, pages, textures. Pages that the scene has are
  /// copied. Others come from the file, are checked as by Scene::load_pages, and stay on the device alone
  /// (runtime/stream/upload.h). JPEG levels that the scene has not decoded stay JPEGs. Their groups are decoded when
  /// they are sampled. Pages of textures are read when they are sampled; where chunks are streamed too, both share the
  /// memory.
  /// - `budget_bytes`: for the scene, the first sizes of its frames' queues (which may grow), and `pictures`. 0: the
  ///   free memory less a sixteenth, which is at most 512 MiB for a resident scene. If the budget does not hold the
  ///   scene, its chunks are streamed (runtime/stream/streamer.h); `scene` then outlives this.
  /// - `texture_cache`: bytes for decoded groups of JPEGs. The picture does not depend on it. A streamed scene takes at
  ///   most an eighth of the budget for them, and at least one group.
  /// - `host_memory`: the most pinned memory that uploading and streaming take. The part that batches leave keeps
  ///   chunks. 0: as much as batches need, and no chunks are kept.
  /// - `progress`: gets the number of copied bytes, and may stop the upload (kFile).
  /// - `gpus`: the most GPUs that draw the scene together: the current device and the next usable GPUs; kAllGpus: all.
  ///   Each has this budget. It gets all pages if they fit the budget, otherwise a share of them. Views draw on all
  ///   GPUs. The first GPU draws batches and layers, also from the others' pages. If a share exceeds the budget, one
  ///   GPU streams the scene.
  /// - `comes_later`: uploads no page if the budget of one GPU holds the scene and the memory for streaming. Pictures
  ///   then stream their chunks, and load_rest() loads all others, after which the scene is resident.
  /// - `share`: null, or the pages that the GPU gets, as one of several processes. Such a scene is not streamed, and
  ///   `gpus` is 1. Frames show the chunks of these pages. write_samples() joins them with those of others.
  /// Errors kDevice: no usable device, too few GPUs, GPUs that cannot read each other's memory, a CUDA call that failed
  /// (which and for what), a budget that does not hold the data that cannot be streamed (both sizes named). kMemory: a
  /// `host_memory` that holds no batch (both sizes named). With the file named, the errors of Scene::load_pages.
  static Result<DeviceScene> upload(const Scene& scene, uint64_t budget_bytes, uint32_t threads,
                                    Reading reading = Reading::kAuto, uint64_t texture_cache = kDeviceTextureCache,
                                    uint64_t host_memory = 0, const PictureNeeds& pictures = {},
                                    JobProgress* progress = nullptr, uint32_t gpus = 1, bool comes_later = false,
                                    const PageShare* share = nullptr);
  DeviceScene(DeviceScene&&) noexcept;
  DeviceScene& operator=(DeviceScene&&) noexcept;
  ~DeviceScene();

  /// As runtime::set_texture_memory(), for the current device. Error kDevice.
  static Result<void> set_texture_memory(const SceneFile& file, uint64_t wanted, uint64_t budget_bytes,
                                         SceneOptions& options);

  /// Makes a view of this scene, which outlives the view. The first view is the one that draw() below uses. Each other
  /// view of a resident scene takes kernels::CudaFrames::device_bytes() more device memory. `scene`: the uploaded one.
  /// Errors kDevice, kMemory.
  Result<DeviceView> add_view(const Scene& scene);

  /// Device memory of another view, with queues of their first sizes and all of `pictures`.
  static uint64_t view_bytes(const Scene& scene, const PictureNeeds& pictures);

  /// Copies the bits of View::omitted to the device, over the bits of the previous call, which no picture may need any
  /// more. Returns their address, valid as long as this; null if `bits` is empty. Errors kRange (not one bit per
  /// instance), kDevice.
  Result<const uint32_t*> set_omitted(std::span<const uint32_t> bits);

  /// The number of GPUs that draw the scene.
  uint32_t gpu_count() const;

  /// Whether chunks are loaded to the device while frames are drawn.
  bool is_streamed() const;

  /// As Streamer::load_rest(). Returns the bytes that are left, 0 if the scene is resident. When the last chunk is
  /// loaded, the scene becomes resident; a new picture has to be drawn then before one is resolved or read. Errors also
  /// kDevice.
  Result<uint64_t> load_rest(const IsOver& is_over = {});

  /// As kernels::draw_cpu, on the device, where the visibility buffer stays. `times`: null, or filled in; a streamed
  /// frame has only raster_ms, by the host's clock. `shade`: for a streamed scene, the picture and the light that
  /// resolve() will make; null if it will not be called. `is_over`: as for Streamer::draw(), if the scene is streamed.
  Result<kernels::FrameStats> draw(const kernels::View& view, kernels::FrameTimes* times = nullptr,
                                   const kernels::ShadeOptions* shade = nullptr, const IsOver& is_over = {});

  /// Statistics of the last frame, if the scene is streamed.
  const std::optional<StreamStats>& stream_stats() const;

  /// Copies the visibility buffer of the picture that draw() made last to host memory: `samples` is all of it.
  Result<void> read_samples(std::span<uint64_t> samples);

  /// Replaces that visibility buffer by samples that also show the chunks of other processes. Error kRange (another
  /// number of samples), kDevice.
  Result<void> write_samples(std::span<const uint64_t> samples);

  /// Resolves the picture that draw() made last, as kernels::resolve_cpu with 4 channels, on the device. `view`: as for
  /// draw(). If the scene is streamed, the picture and the light of `options` are also as for draw(). `pixels`: RGBA8,
  /// red in the low byte, read back; may be empty if only the time is wanted.
  Result<void> resolve(const kernels::View& view, uint32_t samples_per_side, const kernels::ShadeOptions& options,
                       std::span<uint32_t> pixels, kernels::ResolveTimes* times = nullptr);

  const kernels::BlendCounts& blended() const;

  /// The layers over that picture, read back: as kernels::blend_cpu(), 4 floats per sample. Requires
  /// kernels::shows_layers(). Errors as resolve().
  Result<void> read_over(const kernels::View& view, const kernels::ShadeOptions& options, std::span<float> over);

  /// Linear light of the samples of that picture, 3 floats each, read back: as kernels::shade_part_cpu() with all
  /// chunks. Samples of the background, and of chunks that others have, are 0. `view` and `options`: as for resolve(),
  /// of a picture that is shaded from chunks (kernels::shades_from_chunks()). Errors as resolve().
  Result<void> read_colors(const kernels::View& view, const kernels::ShadeOptions& options, std::span<float> colors);

  /// A layer of the picture that draw() made last, read back: `out` is all of it. Errors as DeviceView::make_layer().
  Result<void> read_layer(const kernels::View& view, uint32_t samples_per_side, PixelLayer layer,
                          std::span<std::byte> out);

  /// As DeviceView's.
  Result<std::vector<std::byte>> encode_jpeg(uint32_t width, uint32_t height, int quality, bool is_sharp);

  const UploadStats& stats() const;

  /// The pages of textures that are read when pixels show them; null if there are none.
  BlockPager* block_pager() const;

  /// Counts of the picture that resolve() made last. Nothing if no texture has JPEG levels, or if the scene is streamed
  /// and shaded part by part. Errors kDevice.
  Result<std::optional<kernels::TextureCacheCounts>> texture_counts() const;

  /// For callers that draw into device memory themselves: the frames, and the scene that they draw, in device memory.
  /// After such a frame draw() has to be called before resolve(), which reads the transforms of the last frame.
  kernels::CudaFrames& frames();
  const kernels::SceneView& device_view() const;

 private:
  friend class DeviceView;
  struct Impl;
  explicit DeviceScene(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Decides whether the block images and JPEGs of a scene of `file` are loaded whole or page by page, and sets the room
/// for pages, in host and in device memory, in `options`. `wanted`: the most room in bytes. On the CPU 0 is
/// kHostTextureMemory. On the current GPU images that fit `wanted` are loaded whole. 0: they are loaded whole if
/// everything in the file fits `device_memory` (as for DeviceScene::upload()); otherwise a quarter of it is for pages
/// at first, and more or less later, as pictures show more pages or more geometry (SharedRoom). Error kDevice.
inline Result<void> set_texture_memory(const SceneFile& file, uint64_t wanted, bool on_gpu, uint64_t device_memory,
                                       SceneOptions& options) {
  if (on_gpu) return DeviceScene::set_texture_memory(file, wanted, device_memory, options);
  options.texture_memory = wanted != 0 ? wanted : kHostTextureMemory;
  return {};
}

}  // namespace scree::runtime
