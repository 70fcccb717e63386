// DeviceView where the program is built with CUDA; device_scene_none.cpp stands in elsewhere.
#include <algorithm>
#include <cassert>
#include <chrono>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "kernels/cuda/shade/layers.h"
#include "kernels/shade/pixels.h"
#include "runtime/draw/device_scene_impl.h"
#include "runtime/images/jpeg_head.h"

namespace scree::runtime {

namespace {

/// A priority above any of CUDA's; CUDA then takes the highest priority that the GPU has.
constexpr int kMostPriority = -100;

}  // namespace

HostMemory HostMemory::pinned(uint64_t bytes) {
  auto memory = std::make_shared<kernels::PinnedBuffer>();
  if (!memory->allocate_for_copies(bytes, "allocating pinned memory")) return plain(bytes);
  std::byte* const data = memory->data();
  return {std::move(memory), data, bytes};
}

/// Errors kRange: draw() made no picture of this size.
Result<void> DeviceView::Impl::check_drawn(const kernels::View& view) {
  if (width != view.width || height != view.height)
    return Error{ErrorCode::kRange, "no picture of " + std::to_string(view.width) + " x " +
                                        std::to_string(view.height) + " samples was drawn"};
  return draw_if_followed();
}

Result<kernels::FrameStats> DeviceView::Impl::draw_by_team(const kernels::View& view) {
  drawn_by_team = view;
  Result<kernels::FrameStats> drawn = scene.team->draw(view, sample_data());
  scene.team_view = drawn ? this : nullptr;
  return drawn;
}

/// The team has the transforms, and the rows of other GPUs, only of the picture that it drew last. So if another view
/// has drawn since, this view draws its picture again.
Result<void> DeviceView::Impl::draw_if_followed() {
  if (!drawn_by_team || scene.team_view == this) return {};
  SCREE_TRY(draw_by_team(*drawn_by_team));
  return {};
}

/// All samples of the picture, on the first GPU.
Result<uint64_t*> DeviceView::Impl::whole_samples() {
  SCREE_TRY(draw_if_followed());
  if (drawn_by_team) SCREE_TRY(scene.team->gather());
  return sample_data();
}

const kernels::Transform* DeviceView::Impl::transforms() const {
  if (drawn_by_team) return scene.team->transforms();
  return frames && !ahead ? frames->transforms() : nullptr;
}

/// Makes the frames for a batch's second picture. Returns false if the device has no room for them, or if the scene is
/// streamed.
bool DeviceView::Impl::open_second(const kernels::SceneView& host) {
  if (scene.streaming() != nullptr || !has_room_for_second) return false;
  std::optional<kernels::CudaFrames>& second = picture == 0 ? second_frames : frames;
  if (second) return true;
  // A scene that was streamed has chunk records of its own, on the device too.
  const kernels::SceneView& records = scene.stream != nullptr ? scene.stream->view() : host;
  Result<kernels::CudaFrames> made = kernels::CudaFrames::create(records, scene.scene.view());
  has_room_for_second = static_cast<bool>(made);
  if (made) second = std::move(*made);
  return has_room_for_second;
}

/// Makes the CudaViewBatch. Returns false if it does not take the scene, or if the device has no room.
bool DeviceView::Impl::open_view_batch(const kernels::SceneView& host) {
  if (view_batch || !takes_view_batches) return takes_view_batches;
  if (scene.streaming() != nullptr) return false;
  takes_view_batches = kernels::CudaViewBatch::takes(host);
  if (!takes_view_batches) return false;
  Result<kernels::CudaViewBatch> made = kernels::CudaViewBatch::create(host, scene.scene.view());
  takes_view_batches = static_cast<bool>(made);
  if (made) view_batch = std::move(*made);
  return takes_view_batches;
}

/// BlendTargets::over of the picture that was drawn last. A streamed scene's layers were drawn with the picture.
Result<const float*> DeviceView::Impl::blended_over(const kernels::View& view, const kernels::ShadeOptions& options) {
  if (const CudaStream* const stream = scene.streaming()) {
    blended = stream->blended();
    if (stream->over() == nullptr) return Error{ErrorCode::kRange, "the streamed frame was not drawn to be shaded so"};
    return stream->over();
  }
  if (ahead) return Error{ErrorCode::kUnsupported, "layers are not drawn beside another picture"};
  SCREE_TRY(whole_samples());
  const kernels::SceneView blended_scene = kernels::blended_view(scene.scene.view());
  const auto draw = [&](uint64_t* onto, const uint64_t* peeled, const kernels::FragmentSlots& to) -> Result<void> {
    kernels::DrawOptions drawing;
    drawing.part = kernels::FramePart::kPart;
    drawing.peeled = peeled;
    drawing.fragments = to;
    SCREE_TRY(blend_frames->draw(view, onto, drawing));
    return {};
  };
  const auto shade = [&](const uint64_t* layer, float* light) {
    return resolver.shade_part(blended_scene, view, layer, blend_frames->transforms(), options, light, nullptr,
                               scene.scene.texture_cache());
  };
  const kernels::LayerSource source{
      [&](const kernels::BlendTargets& at, const uint64_t* peeled) { return draw(at.drawn, peeled, {}); },
      [&](const kernels::BlendTargets& at) -> Result<void> {
        SCREE_TRY(shade(at.layer, at.colors));
        return kernels::start_finding_alphas(blended_scene, view, at.layer, blend_frames->transforms(), at.alphas,
                                             nullptr);
      }};
  const kernels::FragmentSource fragments{
      blended_scene, [&](const kernels::FragmentSlots& to) { return draw(sample_data(), nullptr, to); }, shade,
      [&] { return blend_frames->transforms(); }};
  return blend.blend(view, sample_data(), options.blend_layers, source, blended, &fragments);
}

DeviceView::DeviceView(std::shared_ptr<Impl> impl) : impl_(std::move(impl)) {}
DeviceView::DeviceView(DeviceView&&) noexcept = default;
DeviceView& DeviceView::operator=(DeviceView&&) noexcept = default;
DeviceView::~DeviceView() = default;

Result<void> DeviceView::make_current() const {
  return cuda_check(cudaSetDevice(impl_->scene.device), "choosing the GPU");
}

const kernels::BlendCounts& DeviceView::blended() const {
  return impl_->blended;
}

const std::optional<StreamStats>& DeviceView::stream_stats() const {
  return impl_->streamed;
}

Result<void> DeviceView::read_over(const kernels::View& view, const kernels::ShadeOptions& options,
                                   std::span<float> over) {
  Impl& own = *impl_;
  SCREE_TRY(own.check_drawn(view));
  if (over.size() != uint64_t{4} * view.width * view.height || !kernels::shows_layers(own.scene.scene.view(), options))
    return Error{ErrorCode::kRange, std::to_string(over.size()) + " values for the layers of " +
                                        std::to_string(view.width) + " x " + std::to_string(view.height) + " samples"};
  const float* const made = SCREE_TRY(own.blended_over(view, options));
  return cuda_check(cudaMemcpy(over.data(), made, over.size_bytes(), cudaMemcpyDeviceToHost), "reading the layers");
}

Result<void> DeviceView::read_colors(const kernels::View& view, const kernels::ShadeOptions& options,
                                     std::span<float> colors) {
  if (colors.size() != uint64_t{3} * view.width * view.height)
    return Error{ErrorCode::kRange, std::to_string(colors.size()) + " values for the colours of " +
                                        std::to_string(view.width) + " x " + std::to_string(view.height) + " samples"};
  float* const made = SCREE_TRY(make_colors(view, options));
  return cuda_check(cudaMemcpy(colors.data(), made, colors.size_bytes(), cudaMemcpyDeviceToHost),
                    "reading the samples' colours");
}

Result<float*> DeviceView::make_colors(const kernels::View& view, const kernels::ShadeOptions& options) {
  Impl& own = *impl_;
  SCREE_TRY(own.check_drawn(view));
  if (!kernels::shades_from_chunks(options.show))
    return Error{ErrorCode::kRange, "the picture has no colours from the scene's surfaces"};
  if (const CudaStream* const stream = own.scene.streaming()) {
    if (stream->colors() != nullptr) return stream->colors();
    return Error{ErrorCode::kRange, "the streamed frame was not drawn to be shaded so"};
  }
  uint64_t* const samples = SCREE_TRY(own.whole_samples());
  const uint64_t bytes = uint64_t{3} * view.width * view.height * sizeof(float);
  SCREE_TRY(own.colors.reserve(bytes, "allocating the samples' colours"));
  auto* const colors = reinterpret_cast<float*>(own.colors.data());
  SCREE_TRY(cuda_check(cudaMemsetAsync(colors, 0, bytes, own.stream()), "clearing the colours"));
  SCREE_TRY(own.resolver.shade_part(own.scene.scene.view(), view, samples, own.transforms(), options, colors,
                                    own.stream(), own.scene.scene.texture_cache()));
  return colors;
}

Result<uint32_t*> DeviceView::resolve_colors(const kernels::View& view, uint32_t samples_per_side,
                                             const kernels::ShadeOptions& options) {
  Impl& own = *impl_;
  SCREE_TRY(own.check_drawn(view));
  SCREE_TRY(kernels::check_resolve(view, samples_per_side));
  if (own.colors.bytes() < uint64_t{3} * view.width * view.height * sizeof(float))
    return Error{ErrorCode::kRange, "the picture's samples have no colours yet"};
  const uint64_t count = uint64_t{view.width / samples_per_side} * (view.height / samples_per_side);
  SCREE_TRY(own.pixels.reserve(count * sizeof(uint32_t), "allocating the picture"));
  SCREE_TRY(own.order_after_reads());
  auto* const pixels = reinterpret_cast<uint32_t*>(own.pixels.data());
  SCREE_TRY(own.resolver.resolve_colors(view, samples_per_side, own.sample_data(),
                                        reinterpret_cast<const float*>(own.colors.data()), nullptr, options, pixels,
                                        own.stream()));
  return pixels;
}

Result<kernels::FrameStats> DeviceView::draw(const kernels::View& view, kernels::FrameTimes* times,
                                             const kernels::ShadeOptions* shade, const IsOver& is_over) {
  Impl& impl = *impl_;
  impl.width = 0;
  const uint64_t bytes = uint64_t{view.width} * view.height * sizeof(uint64_t);
  SCREE_TRY(impl.samples.reserve(bytes, "allocating the visibility buffer"));
  SCREE_TRY(impl.scene.make_ready(impl));
  CudaStream* const stream = impl.scene.streaming();
  impl.drawn_by_team.reset();
  if (impl.beside != nullptr) SCREE_TRY(impl.order(impl.beside, nullptr));
  const auto start = std::chrono::steady_clock::now();
  const auto time = [&] {
    if (times == nullptr) return;
    *times = {};
    times->raster_ms = std::chrono::duration<float, std::milli>(std::chrono::steady_clock::now() - start).count();
  };
  if (impl.scene.team != nullptr) {
    const kernels::FrameStats drawn = SCREE_TRY(impl.draw_by_team(view));
    impl.set_size(view);
    time();
    return drawn;
  }
  if (stream == nullptr) {
    impl.streamed.reset();
    const kernels::FrameStats drawn = SCREE_TRY(impl.frames->draw(view, impl.sample_data(), {}, times));
    impl.set_size(view);
    return drawn;
  }
  if (DeviceBlockPager* const pager = impl.scene.scene.block_pager(); pager != nullptr) SCREE_TRY(pager->settle());
  const StreamStats streamed = SCREE_TRY(stream->draw_frame(view, shade, impl.sample_data(), is_over));
  impl.set_size(view);
  impl.streamed = streamed;
  time();
  return streamed.drawn;
}

Result<void> DeviceView::start(const kernels::View& view, const LowerSamples& join) {
  Impl& own = *impl_;
  assert(!own.ahead);
  if (own.scene.team != nullptr || own.scene.streaming() != nullptr)
    return Error{ErrorCode::kUnsupported, "several GPUs, or a GPU that streams, draw one picture at a time"};
  SCREE_TRY(own.second_samples.reserve(uint64_t{view.width} * view.height * sizeof(uint64_t),
                                       "allocating a second visibility buffer"));
  if (own.beside == nullptr) {
    SCREE_TRY(own.beside.make(cudaStreamNonBlocking, kMostPriority));
    SCREE_TRY(own.order(nullptr, own.beside));
  } else {
    SCREE_TRY(cuda_check(cudaStreamWaitEvent(nullptr, own.queued), "ordering a stream"));  // of finish()
  }
  auto* const samples = reinterpret_cast<uint64_t*>(own.second_samples.data());
  const std::function<Result<void>(void*)> join_samples = [&](void* stream) { return join(samples, stream); };
  kernels::DrawOptions drawing;
  own.joins_ahead = join != nullptr;
  if (own.joins_ahead) drawing.join = &join_samples;
  SCREE_TRY(own.frames->start(view, samples, drawing));
  own.ahead = view;
  return {};
}

bool DeviceView::has_started() const {
  return impl_->ahead.has_value();
}

Result<bool> DeviceView::finish() {
  Impl& own = *impl_;
  const kernels::View view = *std::exchange(own.ahead, std::nullopt);
  own.width = 0;
  SCREE_TRY(cuda_check(cudaEventRecord(own.queued, own.beside), "recording an event"));
  const kernels::CudaFrames::Finished finished = SCREE_TRY(own.frames->finish());
  if (finished.is_drawn_again && own.joins_ahead) {
    SCREE_TRY(own.frames->draw(view, reinterpret_cast<uint64_t*>(own.second_samples.data())));
  }
  std::swap(own.samples, own.second_samples);
  own.set_size(view);
  return !finished.is_drawn_again;
}

void* DeviceView::stream() const {
  return impl_->stream();
}

Result<void> DeviceView::read_samples(std::span<uint64_t> samples) {
  const uint64_t count = uint64_t{impl_->width} * impl_->height;
  if (count != samples.size())
    return Error{ErrorCode::kRange,
                 std::to_string(samples.size()) + " samples, but the picture has " + std::to_string(count)};
  uint64_t* const whole = SCREE_TRY(impl_->whole_samples());
  return impl_->copy(samples.data(), whole, samples.size_bytes(), cudaMemcpyDeviceToHost,
                     "reading the visibility buffer");
}

Result<void> DeviceView::write_samples(std::span<const uint64_t> samples) {
  const uint64_t count = uint64_t{impl_->width} * impl_->height;
  if (count != samples.size())
    return Error{ErrorCode::kRange,
                 std::to_string(samples.size()) + " samples, but the picture has " + std::to_string(count)};
  return impl_->copy(impl_->samples.data(), samples.data(), samples.size_bytes(), cudaMemcpyHostToDevice,
                     "writing the visibility buffer");
}

Result<uint64_t> DeviceView::read_sample(uint64_t index) {
  uint64_t* const samples = SCREE_TRY(impl_->whole_samples());
  uint64_t sample = 0;
  SCREE_TRY(
      cuda_check(cudaMemcpy(&sample, samples + index, sizeof sample, cudaMemcpyDeviceToHost), "reading a sample"));
  return sample;
}

Result<void> DeviceView::resolve(const kernels::View& view, uint32_t samples_per_side,
                                 const kernels::ShadeOptions& options, std::span<uint32_t> pixels,
                                 kernels::ResolveTimes* times, uint32_t* out) {
  Impl& impl = *impl_;
  SCREE_TRY(impl.check_drawn(view));
  SCREE_TRY(kernels::check_resolve(view, samples_per_side));
  const uint64_t count = uint64_t{view.width / samples_per_side} * (view.height / samples_per_side);
  if (out == nullptr) SCREE_TRY(impl.pixels.reserve(count * sizeof(uint32_t), "allocating the picture"));
  SCREE_TRY(impl.order_after_reads());
  uint32_t* const device_pixels = out != nullptr ? out : reinterpret_cast<uint32_t*>(impl.pixels.data());
  const CudaStream* const stream = impl.scene.streaming();
  const bool from_colors = stream != nullptr && kernels::shades_from_chunks(options.show);
  impl.blended = {};
  DeviceBlockPager* const pager = impl.scene.scene.block_pager();
  if (pager != nullptr && stream == nullptr && !impl.drawn_by_team) SCREE_TRY(pager->settle());
  const float* over = nullptr;
  const auto start = std::chrono::steady_clock::now();
  if (kernels::shows_layers(impl.scene.scene.view(), options)) {
    over = SCREE_TRY(impl.blended_over(view, options));
  }
  if (from_colors && stream->colors() == nullptr)
    return Error{ErrorCode::kRange, "the streamed frame was not drawn to be shaded so"};
  if (from_colors || over != nullptr) {
    const float* colors = from_colors ? stream->colors() : impl.blend.colors();
    if (!from_colors)
      SCREE_TRY(impl.resolver.shade_part(impl.scene.scene.view(), view, impl.sample_data(), impl.transforms(), options,
                                         impl.blend.colors(), nullptr, impl.scene.scene.texture_cache()));
    SCREE_TRY(impl.resolver.resolve_colors(view, samples_per_side, impl.sample_data(), colors, over, options,
                                           device_pixels, nullptr, times));
    if (over != nullptr && times != nullptr) {
      const std::chrono::duration<float, std::milli> taken = std::chrono::steady_clock::now() - start;
      times->resolve_ms = taken.count() - times->occlusion_ms;
    }
  } else if (impl.drawn_by_team && out == nullptr) {
    // Other GPUs might not reach the caller's memory, which another allocator may have mapped for one GPU.
    SCREE_TRY(impl.scene.team->resolve(view, samples_per_side, options, device_pixels, times));
  } else {
    uint64_t* const samples = SCREE_TRY(impl.whole_samples());
    SCREE_TRY(impl.resolver.resolve(impl.scene.scene.view(), view, samples_per_side, samples, impl.transforms(),
                                    options, device_pixels, impl.stream(), times, impl.scene.scene.texture_cache()));
  }
  if (pixels.empty()) return {};
  if (pixels.size() != count)
    return Error{ErrorCode::kRange,
                 std::to_string(pixels.size()) + " pixels, but the picture has " + std::to_string(count)};
  return impl.copy(pixels.data(), device_pixels, pixels.size_bytes(), cudaMemcpyDeviceToHost, "reading the picture");
}

Result<const std::byte*> DeviceView::make_layer(const kernels::View& view, uint32_t samples_per_side, Layer layer) {
  DeviceBuffer& buffer = impl_->layers[static_cast<size_t>(layer)];
  const uint64_t count = uint64_t{view.width / samples_per_side} * (view.height / samples_per_side);
  SCREE_TRY(buffer.reserve(count * bytes_of(layer), "allocating a layer"));
  SCREE_TRY(make_layers(view, samples_per_side, target_of(layer, buffer.data())));
  return buffer.data();
}

Result<void> DeviceView::read_layer(const kernels::View& view, uint32_t samples_per_side, Layer layer,
                                    std::span<std::byte> out) {
  const std::byte* const made = SCREE_TRY(make_layer(view, samples_per_side, layer));
  return read(made, out);
}

Result<void> DeviceView::make_layers(const kernels::View& view, uint32_t samples_per_side,
                                     const kernels::LayerTargets& out) {
  Impl& impl = *impl_;
  SCREE_TRY(impl.check_drawn(view));
  const bool reads_chunks = out.normal != nullptr || out.uv != nullptr;
  if (reads_chunks && impl.ahead)
    return Error{ErrorCode::kUnsupported, "normals and texture coordinates are not made beside another picture"};
  if (reads_chunks && impl.scene.streaming() != nullptr)
    return Error{ErrorCode::kUnsupported,
                 "a streamed scene has no normals and no texture coordinates to read: the GPU's memory or a larger "
                 "budget of it has to hold the scene, or the CPU draws it"};
  uint64_t* const samples = SCREE_TRY(impl.whole_samples());
  SCREE_TRY(impl.order_after_reads());
  return kernels::start_layers(impl.scene.scene.view(), view, samples_per_side, samples,
                               reads_chunks ? impl.transforms() : nullptr, out, impl.stream());
}

Result<kernels::FrameStats> DeviceView::draw_batch(const Scene& scene, std::span<const kernels::View> views,
                                                   const kernels::ShadeOptions* shade,
                                                   const std::function<Result<void>(size_t)>& make) {
  Impl& impl = *impl_;
  SCREE_TRY(impl.scene.make_ready(impl));
  kernels::FrameStats sum{};
  if (views.size() < 2 || !impl.open_second(scene.view())) {
    for (size_t i = 0; i < views.size(); ++i) {
      const kernels::FrameStats drawn = SCREE_TRY(draw(views[i], nullptr, shade));
      sum += drawn;
      SCREE_TRY(make(i));
    }
    return sum;
  }
  // The frames and samples of both pictures take turns in `frames` and `samples`.
  const auto end = [&](size_t i) -> Result<void> {
    impl.use_picture(i % 2);
    const kernels::CudaFrames::Finished finished = SCREE_TRY(impl.frames->finish());
    sum += finished.stats;
    return finished.is_drawn_again ? make(i) : Result<void>();
  };
  Result<void> done;
  size_t started = 0;
  size_t ended = 0;
  while (done && started < views.size()) {
    if (started >= 2) {
      done = end(ended++);
      if (!done) break;
    }
    impl.use_picture(started % 2);
    const kernels::View& view = views[started];
    impl.drawn_by_team.reset();
    done =
        impl.samples.reserve(uint64_t{view.width} * view.height * sizeof(uint64_t), "allocating the visibility buffer");
    if (done) done = impl.frames->start(view, impl.sample_data());
    if (!done) break;
    impl.set_size(view);
    done = make(started++);
  }
  // Also after an error: afterwards no queued work writes to the view's memory.
  while (ended < started)
    if (const Result<void> last = end(ended++); done) done = last;
  impl.use_picture((views.size() - 1) % 2);
  if (!done) impl.width = 0;
  if (!done) return done.error();
  return sum;
}

Result<std::optional<kernels::FrameStats>> DeviceView::draw_together(const Scene& scene,
                                                                     std::span<const kernels::View> views,
                                                                     uint32_t samples_per_side,
                                                                     const kernels::LayerTargets& out) {
  Impl& impl = *impl_;
  using Drawn = std::optional<kernels::FrameStats>;
  if (out.normal != nullptr || out.uv != nullptr || !kernels::CudaViewBatch::pays(views) ||
      !impl.open_view_batch(scene.view()) || !impl.view_batch->reserve(views))
    return Drawn();
  impl.width = 0;
  const kernels::FrameStats drawn = SCREE_TRY(impl.view_batch->draw(views, samples_per_side, out));
  return Drawn(drawn);
}

Result<std::vector<std::byte>> DeviceView::encode_jpeg(uint32_t width, uint32_t height, int quality, bool is_sharp) {
  if (uint64_t{width} * height * sizeof(uint32_t) > impl_->pixels.bytes())
    return Error{ErrorCode::kRange,
                 "no picture of " + std::to_string(width) + " x " + std::to_string(height) + " pixels was made"};
  JpegHead head = SCREE_TRY(
      make_jpeg_head(width, height, quality, is_sharp, static_cast<uint16_t>(kernels::jpeg_segment_mcus(is_sharp))));
  std::vector<std::byte> coded = SCREE_TRY(impl_->jpeg.encode(pixels(), head.header, is_sharp));
  std::vector<std::byte>& file = head.bytes;
  file.reserve(file.size() + coded.size() + 2);
  file.insert(file.end(), coded.begin(), coded.end());
  file.insert(file.end(), {std::byte{0xff}, std::byte{0xd9}});
  return std::move(file);
}

Result<std::byte*> DeviceView::reserve_block(size_t index, uint64_t bytes) {
  DeviceBuffer& block = impl_->blocks[index];
  SCREE_TRY(block.reserve(bytes, "allocating the pictures of a batch"));
  return block.data();
}

Result<uint64_t*> DeviceView::keep_samples(size_t index) {
  uint64_t* const samples = SCREE_TRY(impl_->whole_samples());
  const uint64_t bytes = uint64_t{impl_->width} * impl_->height * sizeof(uint64_t);
  std::byte* const kept = SCREE_TRY(reserve_block(index, bytes));
  SCREE_TRY(impl_->copy(kept, samples, bytes, cudaMemcpyDeviceToDevice, "keeping samples"));
  return reinterpret_cast<uint64_t*>(kept);
}

const uint32_t* DeviceView::pixels() const {
  return reinterpret_cast<const uint32_t*>(impl_->pixels.data());
}

Result<uint64_t*> DeviceView::samples() {
  return impl_->whole_samples();
}

std::shared_ptr<const void> DeviceView::hold(const std::byte* data) const {
  for (const std::span<const DeviceBuffer> buffers :
       {std::span<const DeviceBuffer>(&impl_->samples, 1), std::span<const DeviceBuffer>(&impl_->pixels, 1),
        std::span<const DeviceBuffer>(impl_->layers), std::span<const DeviceBuffer>(impl_->blocks)})
    for (const DeviceBuffer& buffer : buffers)
      if (buffer.data() == data) return buffer.hold();
  return nullptr;
}

Result<void> DeviceView::read(const void* device, std::span<std::byte> host) {
  return impl_->copy(host.data(), device, host.size_bytes(), cudaMemcpyDeviceToHost, "reading a layer");
}

Result<void> DeviceView::write(void* device, std::span<const std::byte> host) {
  return impl_->copy(device, host.data(), host.size_bytes(), cudaMemcpyHostToDevice, "writing samples");
}

Result<void> DeviceView::read_later(const void* device, std::span<std::byte> host) {
  Impl& own = *impl_;
  if (own.was_read == nullptr) SCREE_TRY(own.was_read.make(cudaEventDisableTiming));
  if (own.reads == nullptr) SCREE_TRY(own.reads.make(cudaStreamNonBlocking));
  SCREE_TRY(own.order(own.stream(), own.reads));
  SCREE_TRY(cuda_check(cudaMemcpyAsync(host.data(), device, host.size_bytes(), cudaMemcpyDeviceToHost, own.reads),
                       "reading a layer"));
  SCREE_TRY(cuda_check(cudaEventRecord(own.was_read, own.reads), "recording an event"));
  // The next picture's samples overwrite these. Its pixels and layers are ordered when they are made.
  return device == own.samples.data() ? own.order_after_reads() : Result<void>();
}

Result<void> DeviceView::end_reads() {
  if (impl_->reads == nullptr) return {};
  return cuda_check(cudaStreamSynchronize(impl_->reads), "reading a layer");
}

Result<void> DeviceView::order_before(void* stream) {
  return impl_->order(nullptr, static_cast<cudaStream_t>(stream));
}

Result<void> DeviceView::order_after(void* stream) {
  return impl_->order(static_cast<cudaStream_t>(stream), nullptr);
}

Result<void> DeviceView::check_memory(const void* data) const {
  cudaPointerAttributes found{};
  SCREE_TRY(cuda_check(cudaPointerGetAttributes(&found, data), "looking at a buffer"));
  const bool is_device = found.type == cudaMemoryTypeDevice && found.device == impl_->scene.device;
  if (is_device || found.type == cudaMemoryTypeManaged) return {};
  return Error{ErrorCode::kUsage, "a buffer that is not in the memory of GPU " + std::to_string(impl_->scene.device)};
}

}  // namespace scree::runtime
