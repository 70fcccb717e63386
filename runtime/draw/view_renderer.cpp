#include "runtime/draw/view_renderer.h"

#include <algorithm>
#include <cstring>
#include <mutex>
#include <new>
#include <numeric>
#include <string>
#include <utility>

#include "format/fail.h"
#include "runtime/threads/first_error.h"
#include "runtime/threads/parallel.h"

namespace scree::runtime {
namespace {

/// The layers that a batch can make, one bit each.
constexpr uint32_t kPixelLayers = ((1u << kBlockCount) - 1) & ~(1u << static_cast<uint32_t>(Layer::kSamples));
static_assert(kBlockCount == static_cast<size_t>(Layer::kLinear));

void add(kernels::BlendCounts& sum, const kernels::BlendCounts& frame) {
  sum.layers = std::max(sum.layers, frame.layers);
  sum.samples_left_out += frame.samples_left_out;
}

Error out_of_memory(uint64_t bytes) {
  return {ErrorCode::kMemory, "no memory left for " + std::to_string(bytes) + " bytes of a frame"};
}

}  // namespace

Result<kernels::View> view_of_samples(kernels::View view, uint32_t samples_per_side) {
  const uint64_t width = uint64_t{view.width} * samples_per_side;
  const uint64_t height = uint64_t{view.height} * samples_per_side;
  if (width == 0 || height == 0 || width > kernels::kMaxImageSide || height > kernels::kMaxImageSide)
    return fail(ErrorCode::kRange, "a picture of ", width, " x ", height, " samples, expected 1 to ",
                kernels::kMaxImageSide, " per side");
  view.width = static_cast<uint32_t>(width);
  view.height = static_cast<uint32_t>(height);
  return view;
}

Result<std::unique_ptr<ViewRenderer>> ViewRenderer::create(std::shared_ptr<const LoadedScene> scene) try {
  std::unique_ptr<ViewRenderer> renderer(new ViewRenderer(std::move(scene)));
  if (DeviceScene* const device = renderer->scene_->device()) {
    const LoadedScene::GpuLock lock = LoadedScene::gpu_lock();
    SCREE_TRY(set_current_gpu(renderer->scene_->gpu()->index));
    renderer->device_ = SCREE_TRY(device->add_view(renderer->scene_->scene()));
  }
  renderer->shadows_.emplace(renderer->scene_->scene(), renderer->scene_->device());
  return renderer;
} catch (const std::bad_alloc&) {
  return out_of_memory(sizeof(ViewRenderer));
}

ViewRenderer::~ViewRenderer() {
  if (!device_) return;
  const LoadedScene::GpuLock lock = LoadedScene::gpu_lock();
  (void)device_->make_current();
  shadows_.reset();
  device_.reset();
}

uint64_t ViewRenderer::layer_bytes(Layer layer) const {
  const uint64_t samples = uint64_t{view_.width} * view_.height;
  return bytes_of(layer) * std::max(batch_, 1u) * (layer == Layer::kSamples ? samples : uint64_t{width()} * height());
}

Result<void> ViewRenderer::check_frame() const {
  if (has_frame_) return {};
  return Error{ErrorCode::kRange, "no frame was drawn yet, or the last one failed"};
}

Result<void> ViewRenderer::check_single() const {
  if (Result<void> checked = check_frame(); !checked || batch_ == 0) return checked;
  return Error{ErrorCode::kRange, "the last draw was a batch, of which there is nothing but its layers"};
}

kernels::View ViewRenderer::in_samples(kernels::View view) const {
  view.width *= samples_per_side_;
  view.height *= samples_per_side_;
  return view;
}

/// The beginning of every draw. `view`: the size of its frames, in pixels.
Result<void> ViewRenderer::begin(const kernels::View& view, uint32_t samples_per_side,
                                 const kernels::ShadeOptions& shade) {
  has_frame_ = false;
  batch_ = 0;
  for (HostLayer& layer : host_) layer.is_made = false;
  std::fill(std::begin(on_gpu_), std::end(on_gpu_), nullptr);
  streamed_.reset();
  gpu_ms_ = 0;
  shadow_time_ = {};
  blended_ = {};
  shade_ = shade;
  const kernels::View in_samples = SCREE_TRY(view_of_samples(view, samples_per_side));
  samples_per_side_ = samples_per_side;
  view_ = in_samples;
  return kernels::check_resolve(view_, samples_per_side);
}

Result<void> ViewRenderer::draw(const kernels::View& view, uint32_t samples_per_side,
                                const kernels::ShadeOptions& shade, std::optional<Layer> streamed) {
  SCREE_TRY(begin(view, samples_per_side, shade));
  if (Result<void> done = on_device([&] { return cast_shadows_in(view_); }); !done) return done;
  const Stopwatch watch;
  if (device_) {
    SCREE_TRY(draw_on_gpu(streamed));
  } else {
    const uint64_t count = uint64_t{view_.width} * view_.height;
    try {
      if (samples_.size() < count) samples_.resize(count);
    } catch (const std::bad_alloc&) {
      return out_of_memory(count * sizeof(uint64_t));
    }
    stats_ = SCREE_TRY(
        kernels::draw_cpu(scene_->scene().view(), view_, std::span(samples_).first(count), scene_->threads()));
  }
  draw_time_ = watch.elapsed();
  has_frame_ = true;
  return {};
}

/// Calls `body` with the GPUs' lock held and the device current, if a GPU draws.
template <class Body>
Result<void> ViewRenderer::on_device(const Body& body) const {
  if (!device_) return body();
  const LoadedScene::GpuLock lock = LoadedScene::gpu_lock();
  const Result<void> done = device_->make_current();
  return done ? body() : done;
}

/// Sets ShadeOptions::sun for a picture of `view`, in samples. Requires the GPUs' lock, and the device current.
Result<void> ViewRenderer::cast_shadows_in(const kernels::View& view) {
  shade_.sun = nullptr;
  if (shadow_side_ == 0 || !shows_sun(scene_->scene().view(), shade_)) return {};
  shade_.sun = SCREE_TRY(shadows_->draw(view, shadow_side_, scene_->threads()));
  shadow_time_.wall_ms += shadows_->draw_time().wall_ms;
  shadow_time_.cpu_ms += shadows_->draw_time().cpu_ms;
  return {};
}

Result<void> ViewRenderer::begin_batch(std::span<const kernels::View> views, uint32_t samples_per_side,
                                       const kernels::ShadeOptions& shade, uint32_t layers) {
  if (views.empty() || views.size() > UINT32_MAX) return Error{ErrorCode::kUsage, "a batch has 1 to 2^32 - 1 cameras"};
  if (layers == 0 || (layers & ~kPixelLayers) != 0)
    return Error{ErrorCode::kUsage,
                 "a batch has one layer at least, of colour, depth, triangle, instance, normal and uv"};
  for (const kernels::View& view : views)
    if (view.width != views[0].width || view.height != views[0].height)
      return Error{ErrorCode::kUsage, "all frames of a batch have one size"};
  SCREE_TRY(begin(views[0], samples_per_side, shade));
  batch_ = static_cast<uint32_t>(views.size());
  stats_ = {};
  return {};
}

Result<void> ViewRenderer::draw_batch(std::span<const kernels::View> views, uint32_t samples_per_side,
                                      const kernels::ShadeOptions& shade, uint32_t layers) {
  SCREE_TRY(begin_batch(views, samples_per_side, shade, layers));
  const Stopwatch watch;
  BatchTargets targets{};
  if (!device_) {
    try {
      for (size_t i = 0; i < kBlockCount; ++i) {
        if ((layers >> i & 1) == 0) continue;
        const uint64_t bytes = layer_bytes(static_cast<Layer>(i));
        if (host_[i].bytes.size() < bytes) host_[i].bytes.resize(bytes);
        targets[i] = host_[i].bytes.data();
      }
    } catch (const std::bad_alloc&) {
      return out_of_memory(layer_bytes(Layer::kColor));
    }
    SCREE_TRY(draw_batch_on_cpu(views, layers, targets));
    for (size_t i = 0; i < kLayerCount; ++i) host_[i].is_made = (layers >> i & 1) != 0;
  } else {
    const LoadedScene::GpuLock lock = LoadedScene::gpu_lock();
    SCREE_TRY(device_->make_current());
    for (size_t i = 0; i < kBlockCount; ++i) {
      if ((layers >> i & 1) == 0) continue;
      targets[i] = SCREE_TRY(device_->reserve_block(i, layer_bytes(static_cast<Layer>(i))));
    }
    SCREE_TRY(draw_batch_on_gpu(views, layers, targets));
    std::copy(targets.begin(), targets.end(), std::begin(on_gpu_));
  }
  draw_time_ = watch.elapsed();
  has_frame_ = true;
  return {};
}

Result<void> ViewRenderer::draw_batch_to(std::span<const kernels::View> views, uint32_t samples_per_side,
                                         const kernels::ShadeOptions& shade, const BatchTargets& targets,
                                         void* stream) {
  uint32_t layers = 0;
  for (size_t i = 0; i < targets.size(); ++i) layers |= targets[i] != nullptr ? 1u << i : 0u;
  if (device_) {  // before the view gives up its frame
    const LoadedScene::GpuLock lock = LoadedScene::gpu_lock();
    Result<void> done = device_->make_current();
    for (const std::byte* const target : targets)
      if (done && target != nullptr) done = device_->check_memory(target);
    if (!done) return done;
  }
  SCREE_TRY(begin_batch(views, samples_per_side, shade, layers));
  const Stopwatch watch;
  if (!device_) {
    SCREE_TRY(draw_batch_on_cpu(views, layers, targets));
  } else {
    const LoadedScene::GpuLock lock = LoadedScene::gpu_lock();
    SCREE_TRY(device_->make_current());
    SCREE_TRY(device_->order_after(stream));
    SCREE_TRY(draw_batch_on_gpu(views, layers, targets));
    SCREE_TRY(device_->order_before(stream));
  }
  draw_time_ = watch.elapsed();
  has_frame_ = true;
  return {};
}

/// The targets of frame `v` of a batch. `all`: the targets of all frames.
ViewRenderer::FrameTargets ViewRenderer::targets_of(uint32_t layers, uint64_t v, const BatchTargets& all) const {
  FrameTargets targets;
  for (size_t i = 0; i < kBlockCount; ++i) {
    if ((layers >> i & 1) == 0) continue;
    const auto layer = static_cast<Layer>(i);
    const uint64_t bytes = layer_bytes(layer) / batch_;
    std::byte* const out = all[i] + v * bytes;
    if (layer == Layer::kColor) {
      targets.color = out;
      targets.color_bytes = bytes;
    } else {
      set_target(targets.others, layer, out);
      targets.has_others = true;
    }
  }
  return targets;
}

Result<void> ViewRenderer::draw_batch_on_cpu(std::span<const kernels::View> views, uint32_t layers,
                                             const BatchTargets& all) {
  const uint64_t count = uint64_t{view_.width} * view_.height;
  const bool shades = (layers & 1u << static_cast<uint32_t>(Layer::kColor)) != 0;
  // All pictures share the shadow map, so that they are drawn one after the other.
  const bool has_shadows = shades && shadow_side_ != 0;
  const auto shared = has_shadows ? 1 : static_cast<uint32_t>(std::min<uint64_t>(scene_->threads(), views.size()));
  const uint32_t threads_each = std::max(1u, scene_->threads() / shared);
  try {
    // A worker has samples for one frame.
    if (samples_.size() < shared * count) samples_.resize(shared * count);
    FirstError failure;
    std::mutex mutex;
    std::vector<uint32_t> free(shared);
    std::iota(free.begin(), free.end(), 0u);
    parallel_for(views.size(), shared, [&](uint64_t v) {
      if (failure.is_superseded(v)) return;
      std::unique_lock<std::mutex> lock(mutex);
      const uint32_t worker = free.back();
      free.pop_back();
      lock.unlock();
      const auto samples = std::span(samples_).subspan(worker * count, count);
      const kernels::View view = in_samples(views[v]);
      const Result<kernels::FrameStats> drawn = kernels::draw_cpu(scene_->scene().view(), view, samples, threads_each);
      Result<void> done = drawn ? Result<void>() : drawn.error();
      if (done && has_shadows) done = cast_shadows_in(view);
      const FrameTargets targets = targets_of(layers, v, all);
      kernels::BlendCounts blended;
      if (done && targets.color != nullptr)
        done = kernels::resolve_cpu(scene_->scene().view(), view, samples_per_side_, samples, shade_, 4,
                                    {reinterpret_cast<uint8_t*>(targets.color), targets.color_bytes}, threads_each,
                                    &blended);
      if (done && targets.has_others)
        done =
            kernels::layers_cpu(scene_->scene().view(), view, samples_per_side_, samples, targets.others, threads_each);
      if (!done) failure.report(v, done.error());
      lock.lock();
      free.push_back(worker);
      if (drawn) stats_ += *drawn;
      add(blended_, blended);
    });
    if (failure.any()) return failure.error();
  } catch (const std::bad_alloc&) {
    return out_of_memory(shared * count * sizeof(uint64_t));
  }
  return {};
}

/// Requires that the GPUs' lock is held.
Result<void> ViewRenderer::draw_batch_on_gpu(std::span<const kernels::View> views, uint32_t layers,
                                             const BatchTargets& blocks) {
  const bool shades = (layers & 1u << static_cast<uint32_t>(Layer::kColor)) != 0;
  std::vector<kernels::View> in;
  std::vector<kernels::BlendCounts> blended;  // by picture, because some are made twice
  try {
    for (const kernels::View& view : views) in.push_back(in_samples(view));
    blended.resize(views.size());
  } catch (const std::bad_alloc&) {
    return out_of_memory(views.size_bytes());
  }
  const FrameTargets all = targets_of(layers, 0, blocks);
  if (!shades) {
    const std::optional<kernels::FrameStats> together =
        SCREE_TRY(device_->draw_together(scene_->scene(), in, samples_per_side_, all.others));
    if (together) {
      stats_ = *together;
      return {};
    }
  }
  // All pictures share the shadow map, so that one is whole before the next one's map is drawn.
  const size_t at_once = shades && shadow_side_ != 0 ? 1 : in.size();
  for (size_t first = 0; first < in.size(); first += at_once) {
    SCREE_TRY(shades ? cast_shadows_in(in[first]) : Result<void>());
    const auto part = std::span(in).subspan(first, at_once);
    const Result<kernels::FrameStats> drawn = device_->draw_batch(
        scene_->scene(), part, scene_->is_streamed() && shades ? &shade_ : nullptr, [&](size_t i) -> Result<void> {
          const size_t v = first + i;
          const FrameTargets targets = targets_of(layers, v, blocks);
          Result<void> done;
          if (targets.color != nullptr)
            done = device_->resolve(in[v], samples_per_side_, shade_, {}, nullptr,
                                    reinterpret_cast<uint32_t*>(targets.color));
          if (targets.color != nullptr) blended[v] = device_->blended();
          if (done && targets.has_others) done = device_->make_layers(in[v], samples_per_side_, targets.others);
          return done;
        });
    if (!drawn) return drawn.error();
    stats_ += *drawn;
  }
  for (const kernels::BlendCounts& picture : blended) add(blended_, picture);
  return {};
}

Result<void> ViewRenderer::draw_on_gpu(std::optional<Layer> colors) {
  const LoadedScene::GpuLock lock = LoadedScene::gpu_lock();
  SCREE_TRY(device_->make_current());
  const bool is_streamed = scene_->is_streamed();
  kernels::FrameTimes times{};
  stats_ = SCREE_TRY(device_->draw(view_, is_streamed ? nullptr : &times, is_streamed && colors ? &shade_ : nullptr));
  gpu_ms_ = times.raster_ms;
  streamed_ = device_->stream_stats();
  if (!is_streamed || !colors) return {};
  // Made now, because the colours of the parts belong to the stream, and another view's frame overwrites them.
  if (*colors == Layer::kLinear) {
    HostLayer& linear = host_[static_cast<size_t>(Layer::kLinear)];
    const Result<std::span<std::byte>> room = room_of(Layer::kLinear);
    const Result<void> made = room ? linear_of_gpu(*room) : room.error();
    linear.is_made = static_cast<bool>(made);
    return made;
  }
  SCREE_TRY(device_->resolve(view_, samples_per_side_, shade_, {}));
  blended_ = device_->blended();
  on_gpu_[static_cast<size_t>(Layer::kColor)] = reinterpret_cast<const std::byte*>(device_->pixels());
  return {};
}

Result<void> ViewRenderer::set_shade(const kernels::ShadeOptions& shade) {
  SCREE_TRY(check_single());
  if (scene_->is_streamed())
    return Error{ErrorCode::kUnsupported, "a streamed frame is shaded while it is drawn: draw it again"};
  shade_ = shade;
  shadow_time_ = {};
  if (Result<void> done = on_device([&] { return cast_shadows_in(view_); }); !done) {
    has_frame_ = false;
    return done;
  }
  blended_ = {};
  for (const Layer layer : {Layer::kColor, Layer::kLinear}) host_[static_cast<size_t>(layer)].is_made = false;
  on_gpu_[static_cast<size_t>(Layer::kColor)] = nullptr;
  return {};
}

Result<std::span<const std::byte>> ViewRenderer::layer(Layer layer) {
  SCREE_TRY(check_frame());
  if (layer == Layer::kSamples && !device_ && batch_ == 0)
    return std::as_bytes(std::span(samples_).first(layer_bytes(layer) / sizeof(uint64_t)));
  const std::span<std::byte> room = SCREE_TRY(room_of(layer));
  HostLayer& host = host_[static_cast<size_t>(layer)];
  if (!host.is_made) SCREE_TRY(make(layer, room));
  host.is_made = true;
  return std::span<const std::byte>(room);
}

/// Host memory for a layer.
Result<std::span<std::byte>> ViewRenderer::room_of(Layer layer) {
  SharedBuffer<std::byte>& memory = host_[static_cast<size_t>(layer)].bytes;
  const uint64_t bytes = layer_bytes(layer);
  try {
    if (memory.size() < bytes) memory.resize(bytes);
  } catch (const std::bad_alloc&) {
    return out_of_memory(bytes);
  }
  return std::span(memory).first(bytes);
}

Result<void> ViewRenderer::check_size(Layer layer, std::span<const std::byte> out) const {
  SCREE_TRY(check_frame());
  if (out.size() == layer_bytes(layer)) return {};
  return fail(ErrorCode::kRange, out.size(), " bytes, but the layer has ", layer_bytes(layer));
}

Result<void> ViewRenderer::read_later(Layer layer, std::span<std::byte> out) {
  if (!device_ || layer == Layer::kLinear || host_[static_cast<size_t>(layer)].is_made) return read(layer, out);
  SCREE_TRY(check_size(layer, out));
  const LoadedScene::GpuLock lock = LoadedScene::gpu_lock();
  const Result<const std::byte*> made = make_on_gpu(layer);
  return made ? device_->read_later(*made, out) : made.error();
}

Result<void> ViewRenderer::end_reads() {
  return device_ ? on_device([&] { return device_->end_reads(); }) : Result<void>();
}

Result<void> ViewRenderer::read(Layer layer, std::span<std::byte> out) {
  SCREE_TRY(check_size(layer, out));
  const HostLayer& host = host_[static_cast<size_t>(layer)];
  if (!host.is_made) return make(layer, out);
  std::copy_n(host.bytes.begin(), out.size(), out.begin());
  return {};
}

Result<void> ViewRenderer::make(Layer layer, std::span<std::byte> out) {
  if (batch_ != 0 && (!device_ || layer == Layer::kLinear))
    return Error{ErrorCode::kRange, "the batch was drawn without this layer"};
  if (layer == Layer::kLinear) return make_linear(out);
  if (!device_) return make_on_cpu(layer, out);
  const LoadedScene::GpuLock lock = LoadedScene::gpu_lock();
  const std::byte* const made = SCREE_TRY(make_on_gpu(layer));
  return device_->read(made, out);
}

Result<void> ViewRenderer::make_on_cpu(Layer layer, std::span<std::byte> out) {
  const kernels::SceneView& scene = scene_->scene().view();
  const auto samples = std::span<const uint64_t>(samples_).first(uint64_t{view_.width} * view_.height);
  if (layer == Layer::kSamples) {
    std::memcpy(out.data(), samples.data(), out.size());
    return {};
  }
  if (layer == Layer::kColor)
    return kernels::resolve_cpu(scene, view_, samples_per_side_, samples, shade_, 4,
                                {reinterpret_cast<uint8_t*>(out.data()), out.size()}, scene_->threads(), &blended_);
  return kernels::layers_cpu(scene, view_, samples_per_side_, samples, target_of(layer, out.data()), scene_->threads());
}

Result<void> ViewRenderer::make_linear(std::span<std::byte> out) {
  if (!device_) {
    const kernels::SceneView& scene = scene_->scene().view();
    const auto samples = std::span<const uint64_t>(samples_).first(uint64_t{view_.width} * view_.height);
    return linear_of(light_of_cpu(scene, view_, samples_per_side_, samples, shade_, scene_->threads()), samples, out);
  }
  if (scene_->is_streamed())
    return Error{ErrorCode::kUnsupported, "a streamed frame has no linear colours: its chunks are no longer present"};
  return on_device([&] { return linear_of_gpu(out); });
}

/// Requires the GPUs' lock, and the device current. The samples become a layer in host memory.
Result<void> ViewRenderer::linear_of_gpu(std::span<std::byte> out) {
  const std::span<std::byte> room = SCREE_TRY(room_of(Layer::kSamples));
  const std::span<uint64_t> samples(reinterpret_cast<uint64_t*>(room.data()), room.size() / sizeof(uint64_t));
  bool& is_made = host_[static_cast<size_t>(Layer::kSamples)].is_made;
  if (!is_made) SCREE_TRY(device_->read_samples(samples));
  is_made = true;
  return linear_of(light_of(*device_, view_, samples_per_side_, shade_), samples, out);
}

Result<void> ViewRenderer::linear_of(const PictureLight& light, std::span<const uint64_t> samples,
                                     std::span<std::byte> out) try {
  return linear_picture(scene_->scene().view(), view_, samples_per_side_, samples, shade_, scene_->threads(), light,
                        {reinterpret_cast<float*>(out.data()), out.size() / sizeof(float)}, blended_);
} catch (const std::bad_alloc&) {
  return out_of_memory(12 * samples.size());
}

/// Requires that the GPUs' lock is held.
Result<const std::byte*> ViewRenderer::make_on_gpu(Layer layer) {
  SCREE_TRY(device_->make_current());
  const std::byte*& made = on_gpu_[static_cast<size_t>(layer)];
  if (made != nullptr) return made;
  if (batch_ != 0) return Error{ErrorCode::kRange, "the batch was drawn without this layer"};
  if (layer == Layer::kSamples) {
    uint64_t* const samples = SCREE_TRY(device_->samples());
    return reinterpret_cast<const std::byte*>(samples);
  }
  if (layer == Layer::kColor) {
    SCREE_TRY(device_->resolve(view_, samples_per_side_, shade_, {}));
    blended_ = device_->blended();
    made = reinterpret_cast<const std::byte*>(device_->pixels());
  } else {
    made = SCREE_TRY(device_->make_layer(view_, samples_per_side_, layer));
  }
  return made;
}

Result<const std::byte*> ViewRenderer::device_layer(Layer layer, void* stream) {
  SCREE_TRY(check_frame());
  if (!device_) return Error{ErrorCode::kDevice, "the scene is drawn on the CPU: its layers are in host memory"};
  if (layer == Layer::kLinear) return Error{ErrorCode::kUnsupported, "linear colours are made in host memory alone"};
  const LoadedScene::GpuLock lock = LoadedScene::gpu_lock();
  const std::byte* const made = SCREE_TRY(make_on_gpu(layer));
  SCREE_TRY(device_->order_before(stream));
  return made;
}

Result<std::shared_ptr<const void>> ViewRenderer::hold(const std::byte* data) const try {
  const Error gone{ErrorCode::kRange, "the view has drawn to other memory since"};
  if (data == nullptr) return gone;
  for (const HostLayer& layer : host_)
    if (layer.bytes.data() == data) return layer.bytes.hold();
  if (reinterpret_cast<const std::byte*>(samples_.data()) == data) return samples_.hold();
  if (!device_) return gone;
  const LoadedScene::GpuLock lock = LoadedScene::gpu_lock();
  std::shared_ptr<const void> memory = device_->hold(data);
  if (!memory) return gone;
  // Device memory is freed under the same conditions as all GPU work: with the lock held and its device current.
  return std::shared_ptr<const void>(data, [memory, gpu = scene_->gpu()->index](const void*) mutable {
    const LoadedScene::GpuLock freeing = LoadedScene::gpu_lock();
    (void)set_current_gpu(gpu);
    memory.reset();
  });
} catch (const std::bad_alloc&) {
  return out_of_memory(sizeof(std::shared_ptr<const void>));
}

Result<std::optional<Pick>> ViewRenderer::pick(uint32_t x, uint32_t y) {
  SCREE_TRY(check_single());
  if (x >= width() || y >= height())
    return fail(ErrorCode::kRange, "pixel ", x, ",", y, " of a picture of ", width(), " x ", height());
  const uint64_t index = sample_index(view_, samples_per_side_, x, y);
  if (!device_) return pick_sample(scene_->scene(), view_, samples_[index]);
  Result<uint64_t> sample = uint64_t{0};
  {
    const LoadedScene::GpuLock lock = LoadedScene::gpu_lock();
    SCREE_TRY(device_->make_current());
    sample = device_->read_sample(index);
  }
  if (!sample) return sample.error();
  return pick_sample(scene_->scene(), view_, *sample);
}

}  // namespace scree::runtime
