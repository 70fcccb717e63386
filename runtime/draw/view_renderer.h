// A view of a scene that lives for many frames.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "format/result.h"
#include "kernels/frame.h"
#include "runtime/draw/linear_picture.h"
#include "runtime/draw/loaded_scene.h"
#include "runtime/draw/pick.h"
#include "runtime/draw/shadow_map.h"
#include "runtime/draw/shared_buffer.h"
#include "runtime/threads/stopwatch.h"

namespace scree::runtime {

/// The view whose pixels are the samples of `view`. Errors kRange: a side of 0 or over kernels::kMaxImageSide.
Result<kernels::View> view_of_samples(kernels::View view, uint32_t samples_per_side);

/// Draws frame after frame of one scene, with any camera, size, samples and shading. Layers are made on first request.
/// Buffers grow to the largest frame and stay, so a frame no larger than an earlier one allocates nothing. On a GPU the
/// view has hints of its own. One thread at a time uses a view; several threads may use several views of a scene.
class ViewRenderer {
 public:
  /// Errors as DeviceScene::add_view().
  static Result<std::unique_ptr<ViewRenderer>> create(std::shared_ptr<const LoadedScene> scene);
  ViewRenderer(const ViewRenderer&) = delete;
  ViewRenderer& operator=(const ViewRenderer&) = delete;
  ~ViewRenderer();

  /// Lets the sun cast shadows in the frames of later draws and of set_shade(), under Lighting::kScene, by a map of
  /// `side` samples (ShadowMap::draw(), whose errors these calls then have too); 0: no more.
  void cast_shadows(uint32_t side) { shadow_side_ = side; }

  /// Draws a frame. `view`: its sides in pixels, of `samples_per_side` squared samples (1, 2 or 4). Returns when the
  /// samples are drawn; after an error there is no frame. `streamed`: the colours, kColor or kLinear, that are made at
  /// once if the scene is streamed, because they cannot be made later; nullopt: the frame is then not shaded. Errors
  /// kRange (no such size or camera), kMemory, kDevice.
  Result<void> draw(const kernels::View& view, uint32_t samples_per_side, const kernels::ShadeOptions& shade,
                    std::optional<Layer> streamed = Layer::kColor);

  /// Draws one frame for each of `views`, all of one size, and makes their layers. `layers`: a bit 1 << Layer for each
  /// layer, without kSamples and kLinear. A layer is then one block, frame by frame. On the CPU the frames are shared
  /// out among the threads, each with samples of its own. Until the next draw, picking and other layers are not
  /// available. Errors as draw(); kUsage: no view, views of several sizes, no such layers.
  Result<void> draw_batch(std::span<const kernels::View> views, uint32_t samples_per_side,
                          const kernels::ShadeOptions& shade, uint32_t layers);

  /// Memory for the layers of a batch, by Layer: of the GPU that draws, or of the host. Null: the layer is not made.
  using BatchTargets = std::array<std::byte*, kBlockCount>;

  /// The same into the caller's memory, of layer_bytes() each. The GPU draws after the earlier work of `stream`, a
  /// cudaStream_t, and before its later work. The view then has no layer. Errors as draw_batch(); kUsage: no target, or
  /// one that is not in the GPU's memory.
  Result<void> draw_batch_to(std::span<const kernels::View> views, uint32_t samples_per_side,
                             const kernels::ShadeOptions& shade, const BatchTargets& targets, void* stream);

  /// Changes the shading of the frame without drawing it again. Errors kRange (no frame), kUnsupported: a streamed
  /// frame is shaded while it is drawn.
  Result<void> set_shade(const kernels::ShadeOptions& shade);

  /// A layer in host memory of this view, valid until the next draw() or set_shade() or the view's end. Errors kRange
  /// (no frame), kUnsupported (as DeviceView::make_layer(), and colours of a streamed frame that draw() did not make),
  /// kMemory, kDevice.
  Result<std::span<const std::byte>> layer(Layer layer);

  /// Copies a layer to `out`, which has layer_bytes().
  Result<void> read(Layer layer, std::span<std::byte> out);

  /// The same without waiting, if a GPU draws: the copy runs beside later work, also that of the next draw(). `out` is
  /// complete after end_reads(), and should be HostMemory::pinned(). Errors as layer().
  Result<void> read_later(Layer layer, std::span<std::byte> out);
  /// Waits for the copies of read_later(). Error kDevice.
  Result<void> end_reads();

  /// A layer in the GPU's memory, without a copy. `stream`, a cudaStream_t, waits until it is written. Valid until the
  /// next draw() or set_shade() or the view's end. Errors as layer(); kDevice: the CPU draws; kUnsupported: kLinear.
  Result<const std::byte*> device_layer(Layer layer, void* stream);

  /// Keeps a layer's memory, `data` from layer() or device_layer(), at its place as long as the result lives, also
  /// beyond the view. Later draws write to it if their frames fit; larger frames get other memory. Errors kRange: the
  /// view has no such memory any more; kMemory, kDevice.
  Result<std::shared_ptr<const void>> hold(const std::byte* data) const;

  /// pick_sample() of sample_index(); reads one sample. Errors kRange: no frame, no such pixel.
  Result<std::optional<Pick>> pick(uint32_t x, uint32_t y);

  const LoadedScene& scene() const { return *scene_; }
  bool has_frame() const { return has_frame_; }
  uint32_t batch() const { return batch_; }                             // frames; 0: the last draw was no batch
  uint32_t width() const { return view_.width / samples_per_side_; }    // of the frame, in pixels
  uint32_t height() const { return view_.height / samples_per_side_; }  // likewise
  uint32_t samples_per_side() const { return samples_per_side_; }
  uint64_t layer_bytes(Layer layer) const;
  const kernels::View& view() const { return view_; }  // its sides in samples
  const kernels::FrameStats& stats() const { return stats_; }
  /// The layers of blended surfaces, once the colours are made. For a batch: the largest number of layers of a frame,
  /// and the sum of the samples left out.
  const kernels::BlendCounts& blended() const { return blended_; }
  const Duration& draw_time() const { return draw_time_; }
  /// The time of drawing the frame's shadow map, before draw_time(); 0 without one, and if the last frame's was kept.
  /// For a batch the sum, part of draw_time().
  const Duration& shadow_time() const { return shadow_time_; }
  /// The GPU's time for the samples of a resident frame, by its own clock. 0 for a batch, and if the CPU drew or the
  /// scene was streamed.
  float gpu_ms() const { return gpu_ms_; }
  /// Statistics of the frame, if the scene is streamed and the frame was no batch.
  const std::optional<StreamStats>& stream_stats() const { return streamed_; }

 private:
  explicit ViewRenderer(std::shared_ptr<const LoadedScene> scene) : scene_(std::move(scene)) {}
  Result<void> check_frame() const;
  Result<void> check_single() const;
  Result<void> check_size(Layer layer, std::span<const std::byte> out) const;
  Result<void> begin(const kernels::View& view, uint32_t samples_per_side, const kernels::ShadeOptions& shade);
  Result<void> begin_batch(std::span<const kernels::View> views, uint32_t samples_per_side,
                           const kernels::ShadeOptions& shade, uint32_t layers);
  Result<void> draw_batch_on_cpu(std::span<const kernels::View> views, uint32_t layers, const BatchTargets& targets);
  Result<void> draw_batch_on_gpu(std::span<const kernels::View> views, uint32_t layers, const BatchTargets& targets);
  struct FrameTargets {
    std::byte* color = nullptr;
    uint64_t color_bytes = 0;
    kernels::LayerTargets others{};
    bool has_others = false;
  };
  FrameTargets targets_of(uint32_t layers, uint64_t v, const BatchTargets& all) const;
  kernels::View in_samples(kernels::View view) const;
  template <class Body>
  Result<void> on_device(const Body& body) const;
  Result<void> cast_shadows_in(const kernels::View& view);
  Result<void> draw_on_gpu(std::optional<Layer> colors);
  Result<std::span<std::byte>> room_of(Layer layer);
  Result<void> make(Layer layer, std::span<std::byte> out);
  Result<void> make_on_cpu(Layer layer, std::span<std::byte> out);
  Result<void> make_linear(std::span<std::byte> out);
  Result<void> linear_of_gpu(std::span<std::byte> out);
  Result<void> linear_of(const PictureLight& light, std::span<const uint64_t> samples, std::span<std::byte> out);
  Result<const std::byte*> make_on_gpu(Layer layer);

  std::shared_ptr<const LoadedScene> scene_;
  std::optional<DeviceView> device_;
  std::optional<ShadowMap> shadows_;  // always; ends with its GPU current
  uint32_t shadow_side_ = 0;          // 0: no shadows
  kernels::View view_{};              // of the frame, in samples
  uint32_t samples_per_side_ = 1;
  kernels::ShadeOptions shade_;
  bool has_frame_ = false;
  uint32_t batch_ = 0;
  SharedBuffer<uint64_t> samples_;  // if the CPU draws; may be longer than the frame
  struct HostLayer {
    SharedBuffer<std::byte> bytes;  // may be longer than the frame's
    bool is_made = false;
  };
  HostLayer host_[kLayerCount];
  const std::byte* on_gpu_[kLayerCount] = {};  // null: not made
  kernels::FrameStats stats_{};
  kernels::BlendCounts blended_;
  Duration draw_time_;
  Duration shadow_time_;
  float gpu_ms_ = 0;
  std::optional<StreamStats> streamed_;
};

}  // namespace scree::runtime
