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

/// The pictures that will be drawn of a scene, so that their memory is counted before the scene takes it.
struct PictureNeeds {
  uint32_t width = 0;  // in pixels; 0: nothing is counted
  uint32_t height = 0;
  uint32_t samples_per_side = 1;
  const kernels::ShadeOptions* shade = nullptr;  // null: they are not shaded
  bool is_encoded = false;                       // as JPEGs, on the device
  uint32_t shadow_side = 0;                      // of their ShadowMap; 0: none
};

/// What beside the colours can be made of a picture's pixels (kernels/shade/layers.h).
enum class PixelLayer { kDepth, kTriangle, kInstance, kNormal, kUv };
inline constexpr size_t kPixelLayerCount = 5;
inline constexpr size_t kBlockCount =
    7;  // of DeviceView::reserve_block(): one per Layer that a ViewRenderer makes in batches, by number

/// Bytes of a pixel of it.
constexpr uint64_t layer_bytes(PixelLayer layer) {
  constexpr uint64_t kBytes[kPixelLayerCount] = {sizeof(float), sizeof(int64_t), sizeof(int32_t), 3 * sizeof(float),
                                                 2 * sizeof(float)};
  return kBytes[static_cast<size_t>(layer)];
}

/// Where a layer goes.
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

/// What one view of a DeviceScene keeps on the device from frame to frame: samples, pictures, layers, and of a resident
/// scene a draw list with its queues and the bits of which clusters were seen. Buffers grow to the largest picture. All
/// views of a streamed scene draw through the same chunks and list. One thread at a time draws views of one device.
class DeviceView {
 public:
  DeviceView(DeviceView&&) noexcept;
  DeviceView& operator=(DeviceView&&) noexcept;
  ~DeviceView();

  /// Makes the scene's device the calling thread's current one, as all that follows needs it. Error kDevice.
  Result<void> make_current() const;

  /// As DeviceScene's.
  Result<kernels::FrameStats> draw(const kernels::View& view, kernels::FrameTimes* times = nullptr,
                                   const kernels::ShadeOptions* shade = nullptr, const IsOver& is_over = {});
  const std::optional<StreamStats>& stream_stats() const;
  Result<void> read_samples(std::span<uint64_t> samples);
  Result<void> resolve(const kernels::View& view, uint32_t samples_per_side, const kernels::ShadeOptions& options,
                       std::span<uint32_t> pixels, kernels::ResolveTimes* times = nullptr, uint32_t* out = nullptr);
  /// The layers of blended surfaces in what resolve() made last.
  const kernels::BlendCounts& blended() const;
  Result<void> read_over(const kernels::View& view, const kernels::ShadeOptions& options, std::span<float> over);
  Result<void> read_colors(const kernels::View& view, const kernels::ShadeOptions& options, std::span<float> colors);

  /// One sample of the picture that draw() made last; `index` below width * height. Error kDevice.
  Result<uint64_t> read_sample(uint64_t index);

  /// Queues a layer of that picture, in device memory that stays until the next call for this layer. Errors kRange (no
  /// such picture), kUnsupported (normals and texture coordinates of a streamed scene, whose chunks are not there any
  /// more), kDevice.
  Result<const std::byte*> make_layer(const kernels::View& view, uint32_t samples_per_side, PixelLayer layer);

  /// Queues several layers of that picture into device memory. Errors as make_layer().
  Result<void> make_layers(const kernels::View& view, uint32_t samples_per_side, const kernels::LayerTargets& out);

  /// Draws pictures of one size, one after the other. `make(i)` queues what is made of picture i, by resolve() and
  /// make_layers(); it may be called twice for a picture, whose second result holds. The scene's next picture is
  /// submitted before the host waits for this one, so that the device has work all the time: two pictures have samples
  /// and draw lists then, the second as long as the view lives. Where memory is missing for those, and where chunks are
  /// streamed, pictures are waited for one by one. `scene`: the one that was uploaded. Sums of what draw() counts.
  Result<kernels::FrameStats> draw_batch(const Scene& scene, std::span<const kernels::View> views,
                                         const kernels::ShadeOptions* shade,
                                         const std::function<Result<void>(size_t)>& make);

  /// The same in one set of launches, where kernels::CudaViewBatch takes the scene and its pictures: depths and ids
  /// alone, into `out`, view by view. Nothing where that is not so, or the device has no room for it. There is no
  /// picture to resolve() afterwards.
  Result<std::optional<kernels::FrameStats>> draw_together(const Scene& scene, std::span<const kernels::View> views,
                                                           uint32_t samples_per_side, const kernels::LayerTargets& out);

  /// The picture that resolve() made last of `width` x `height` pixels, as a JPEG file that is made on the device:
  /// baseline, with libjpeg's tables of `quality` (1 to 100) and a restart marker after every few MCUs. `is_sharp`:
  /// colours in full resolution in place of a quarter. Errors kDevice, kMemory, kRange (a side of 0 or over 65,535).
  Result<std::vector<std::byte>> encode_jpeg(uint32_t width, uint32_t height, int quality, bool is_sharp);

  /// Device memory for the pictures of a batch, `index` below kBlockCount: at least so many bytes, until it is asked
  /// for again.
  Result<std::byte*> reserve_block(size_t index, uint64_t bytes);

  /// Device memory: the picture that resolve() made last, RGBA8, and the samples.
  const uint32_t* pixels() const;
  const uint64_t* samples() const;

  /// Keeps the memory of a picture, a layer or the samples, where it is while the result lives, which is to end with
  /// the device current; null where `data` is none of these any more.
  std::shared_ptr<const void> hold(const std::byte* data) const;

  /// Waits for what is queued and copies from device memory. Error kDevice.
  Result<void> read(const void* device, std::span<std::byte> host);
  /// Lets a stream of the caller's, a cudaStream_t, wait for what is queued. Error kDevice.
  Result<void> order_before(void* stream);
  /// Lets what is queued from now on wait for what the caller queued on that stream. Error kDevice.
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
  /// those of Scene::load_pages. `progress`: hears of the bytes that are copied, and may stop the upload (kFile).
  /// `gpus`: the most GPUs that draw the scene together, each with a share of its pages and this budget: the current
  /// device and the next ones that can be used; kAllGpus: as many as there are. Views draw on all of them; batches and
  /// layers are drawn by the first, which reads the others' pages. Such a scene is not streamed. Errors kDevice: fewer
  /// GPUs, GPUs that cannot read each other's memory.
  /// `comes_later`: where the budget of one GPU holds the scene and what streaming takes beside it, no page is brought
  /// here. Pictures stream their chunks, and load_rest() brings all others, after which the scene is resident.
  static Result<DeviceScene> upload(const Scene& scene, uint64_t budget_bytes, uint32_t threads,
                                    Reading reading = Reading::kAuto, uint64_t texture_cache = kDeviceTextureCache,
                                    uint64_t host_memory = 0, const PictureNeeds& pictures = {},
                                    JobProgress* progress = nullptr, uint32_t gpus = 1, bool comes_later = false);
  DeviceScene(DeviceScene&&) noexcept;
  DeviceScene& operator=(DeviceScene&&) noexcept;
  ~DeviceScene();

  /// As runtime::set_texture_memory(), for the current device. Error kDevice.
  static Result<void> set_texture_memory(const SceneFile& file, uint64_t wanted, uint64_t budget_bytes,
                                         SceneOptions& options);

  /// A view of this scene, which outlives it: the first is the one that this draws with itself, others take as much
  /// device memory more as kernels::CudaFrames::device_bytes() where the scene is resident. `scene`: what was uploaded.
  /// Errors kDevice, kMemory.
  Result<DeviceView> add_view(const Scene& scene);

  /// Brings the bits of View::omitted to the device, in place of those of the call before, which no picture may need
  /// any more. Returns where they lie while this lives; null for none. Errors kRange (not a bit for each instance),
  /// kDevice.
  Result<const uint32_t*> set_omitted(std::span<const uint32_t> bits);

  /// How many GPUs draw it.
  uint32_t gpu_count() const;

  /// Whether chunks are brought to the device while frames are drawn.
  bool is_streamed() const;

  /// As Streamer::load_rest(); returns the bytes that are left. After the last the scene is resident: its next picture
  /// has to be drawn before another is resolved or read. 0 for a scene that is resident already. Errors also kDevice.
  Result<uint64_t> load_rest(const IsOver& is_over = {});

  /// As kernels::draw_cpu, on the device, where the visibility buffer stays. `times`: null, or filled in (of a streamed
  /// frame raster_ms alone, by the host's clock). `shade`: what resolve() will be asked to show, by which light, where
  /// the scene is streamed; null where it will not be asked. `is_over`: as Streamer::draw(), if it is streamed.
  Result<kernels::FrameStats> draw(const kernels::View& view, kernels::FrameTimes* times = nullptr,
                                   const kernels::ShadeOptions* shade = nullptr, const IsOver& is_over = {});

  /// Of the last frame, where the scene is streamed.
  const std::optional<StreamStats>& stream_stats() const;

  /// Copies the visibility buffer of the picture that draw() made last to host memory: `samples` is all of it.
  Result<void> read_samples(std::span<uint64_t> samples);

  /// Resolves the picture that draw() made last, as kernels::resolve_cpu with 4 channels, on the device; `view` as
  /// draw() had it, and of a streamed scene what `options` show and by which light too. `pixels`: RGBA8, red in the low
  /// byte, read back; may be empty where the time is all that is wanted.
  Result<void> resolve(const kernels::View& view, uint32_t samples_per_side, const kernels::ShadeOptions& options,
                       std::span<uint32_t> pixels, kernels::ResolveTimes* times = nullptr);

  const kernels::BlendCounts& blended() const;

  /// The layers over that picture, read back: as kernels::blend_cpu(), 4 floats a sample. What is shown has layers
  /// (kernels::shows_layers()). Errors as resolve().
  Result<void> read_over(const kernels::View& view, const kernels::ShadeOptions& options, std::span<float> over);

  /// Linear light of the samples of that picture, 3 floats each, read back: as kernels::shade_part_cpu() with all
  /// chunks. Those of the background hold anything. `view` and `options` as for resolve(); what they show is shaded
  /// from chunks. Errors as resolve().
  Result<void> read_colors(const kernels::View& view, const kernels::ShadeOptions& options, std::span<float> colors);

  /// A layer of the picture that draw() made last, read back: `out` is all of it. Errors as DeviceView::make_layer().
  Result<void> read_layer(const kernels::View& view, uint32_t samples_per_side, PixelLayer layer,
                          std::span<std::byte> out);

  /// As DeviceView's.
  Result<std::vector<std::byte>> encode_jpeg(uint32_t width, uint32_t height, int quality, bool is_sharp);

  const UploadStats& stats() const;

  /// The pages of textures that come when they are shown; null where there are none.
  const BlockPager* block_pager() const;

  /// Of the picture that resolve() made last; nothing where no texture has JPEG levels, or the scene is streamed, and
  /// shaded part by part. Errors kDevice.
  Result<std::optional<kernels::TextureCacheCounts>> texture_counts() const;

  /// For those who draw into device memory themselves: the frames, and the scene as they see it, in device memory.
  /// After a frame drawn so, resolve() needs a draw() first: it reads the transforms of the last frame.
  kernels::CudaFrames& frames();
  const kernels::SceneView& device_view() const;

 private:
  friend class DeviceView;
  struct Impl;
  explicit DeviceScene(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Decides whether the block images of a scene of `file` are loaded whole or page by page, and sets both memories of
/// `options` for pages. `wanted`: the room for them; 0: kHostTextureMemory on the CPU. On a GPU, the current device,
/// images that fit `wanted` are loaded whole; 0: whole if everything in the file fits `device_memory` (as
/// DeviceScene::upload() has it), else a quarter of that is for pages. Error kDevice.
inline Result<void> set_texture_memory(const SceneFile& file, uint64_t wanted, bool on_gpu, uint64_t device_memory,
                                       SceneOptions& options) {
  if (on_gpu) return DeviceScene::set_texture_memory(file, wanted, device_memory, options);
  options.texture_memory = wanted != 0 ? wanted : kHostTextureMemory;
  return {};
}

}  // namespace scree::runtime
