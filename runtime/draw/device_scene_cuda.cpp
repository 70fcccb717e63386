// DeviceScene where the program is built with CUDA; device_scene_none.cpp stands in elsewhere.
#include <algorithm>
#include <chrono>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "kernels/cuda/check.h"
#include "kernels/cuda/frame.h"
#include "kernels/cuda/resolve.h"
#include "kernels/frame_parts.h"
#include "runtime/draw/cuda_upload.h"
#include "runtime/draw/device_list.h"
#include "runtime/draw/device_scene.h"
#include "runtime/draw/stream_cuda.h"

namespace scree::runtime {

using kernels::cuda_check;
using kernels::DeviceBuffer;

/// Of a streamed scene's budget at most one part in so many is a cache of its textures.
constexpr uint64_t kTextureCacheShare = 8;

struct DeviceScene::Impl {
  CudaScene scene;
  DeviceBuffer samples;
  DeviceBuffer pixels;
  kernels::CudaResolver resolver;
  std::optional<kernels::CudaFrames> frames;
  std::unique_ptr<CudaStream> stream;  // where the scene's pages do not lie on the device
  std::optional<StreamStats> streamed;
  UploadStats stats;

  Result<void> upload_streamed(const Scene& host, uint64_t budget, uint32_t threads, Reading reading,
                               uint64_t texture_cache, uint64_t host_memory);
};

DeviceScene::DeviceScene(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DeviceScene::DeviceScene(DeviceScene&&) noexcept = default;
DeviceScene& DeviceScene::operator=(DeviceScene&&) noexcept = default;
DeviceScene::~DeviceScene() = default;

const UploadStats& DeviceScene::stats() const {
  return impl_->stats;
}

Result<std::optional<kernels::TextureCacheCounts>> DeviceScene::texture_counts() const {
  const kernels::CudaTextureCache* const cache = impl_->scene.texture_cache();
  if (cache == nullptr || impl_->stream != nullptr) return std::optional<kernels::TextureCacheCounts>();
  const Result<kernels::TextureCacheCounts> counts = cache->counts();
  if (!counts) return counts.error();
  return std::optional<kernels::TextureCacheCounts>(*counts);
}

kernels::CudaFrames& DeviceScene::frames() {
  return *impl_->frames;
}

const kernels::SceneView& DeviceScene::device_view() const {
  return impl_->scene.view();
}

Result<DeviceScene> DeviceScene::upload(const Scene& scene, uint64_t budget_bytes, uint32_t threads, Reading reading,
                                        uint64_t texture_cache, uint64_t host_memory) {
  if (const Result<Gpu> gpu = current_gpu(); !gpu) return gpu.error();
  const auto start = std::chrono::steady_clock::now();
  const Result<uint64_t> budget = device_budget(budget_bytes);
  if (!budget) return budget.error();
  if (CudaScene::device_bytes(scene, nullptr, texture_cache) + kernels::CudaFrames::device_bytes(scene.view()) >
      *budget) {
    auto streamed = std::make_unique<Impl>();
    // Pictures and queues that grow come later, and beside the scene.
    const uint64_t allowed = budget_bytes == 0 ? *budget - *budget / 16 : *budget;
    if (Result<void> done = streamed->upload_streamed(scene, allowed, threads, reading, texture_cache, host_memory);
        !done)
      return done.error();
    streamed->stats.upload_ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    return DeviceScene(std::move(streamed));
  }
  Result<CudaScene> copy = CudaScene::upload(scene, budget_bytes, kernels::CudaFrames::device_bytes(scene.view()),
                                             threads, reading, texture_cache);
  if (!copy) return copy.error();
  auto impl = std::make_unique<Impl>();
  impl->scene = std::move(*copy);
  Result<kernels::CudaFrames> frames = kernels::CudaFrames::create(scene.view(), impl->scene.view());
  if (!frames) return frames.error();
  impl->frames = std::move(*frames);
  impl->stats = impl->scene.stats();
  impl->stats.upload_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  return DeviceScene(std::move(impl));
}

/// `budget`: of device memory, which the records, textures and frames take their part of. A cache of textures leaves
/// most of it to chunks.
Result<void> DeviceScene::Impl::upload_streamed(const Scene& host, uint64_t budget, uint32_t threads, Reading reading,
                                                uint64_t texture_cache, uint64_t host_memory) {
  const uint64_t frames_bytes = kernels::CudaFrames::device_bytes(host.view());
  std::vector<uint64_t> bytes = ChunkSource(host).chunk_bytes();
  const uint64_t largest = bytes.empty() ? 0 : *std::max_element(bytes.begin(), bytes.end());
  const uint64_t room = 2 * (largest + 2 * Residency::kAlignment);  // the least pool, and what moving a chunk takes
  const auto fixed_with = [&](uint64_t cache) {
    return CudaScene::device_bytes(host, &host.view(), cache) + frames_bytes + CudaStream::device_bytes(host.view());
  };
  texture_cache = std::min(texture_cache, budget / kTextureCacheShare);
  if (budget < fixed_with(texture_cache) + room) texture_cache = 1;  // one group: slow, and the same picture
  const uint64_t fixed = fixed_with(texture_cache);
  const uint64_t least = fixed + room;
  if (budget < least)
    return Error{ErrorCode::kDevice, "the scene takes at least " + std::to_string(least) +
                                         " bytes of device memory where its chunks are streamed, but " +
                                         std::to_string(budget) + " are allowed"};
  const uint64_t bounce = CudaStream::bounce_bytes(largest, budget - fixed);
  Result<Streamer> streamer =
      Streamer::create(host, budget - fixed - bounce - 2 * Residency::kAlignment, std::move(bytes));
  if (!streamer) return streamer.error();
  stream = std::make_unique<CudaStream>(host, std::move(*streamer), bounce, threads);
  Result<CudaScene> copy = CudaScene::upload(host, 0, frames_bytes, threads, reading, texture_cache, &stream->view());
  if (!copy) return copy.error();
  scene = std::move(*copy);
  Result<kernels::CudaFrames> made = kernels::CudaFrames::create(stream->view(), scene.view());
  if (!made) return made.error();
  frames = std::move(*made);
  stats = scene.stats();
  stats.device_bytes = budget;
  return stream->open(scene.view(), *frames, resolver, scene.texture_cache(), host_memory);
}

const std::optional<StreamStats>& DeviceScene::stream_stats() const {
  return impl_->streamed;
}

Result<kernels::FrameStats> DeviceScene::draw(const kernels::View& view, kernels::FrameTimes* times,
                                              const kernels::ShadeOptions* shade) {
  const uint64_t bytes = uint64_t{view.width} * view.height * sizeof(uint64_t);
  if (impl_->samples.bytes() != bytes) {
    if (const Result<void> freed = impl_->samples.release("freeing the visibility buffer"); !freed)
      return freed.error();
    Result<DeviceBuffer> buffer = DeviceBuffer::allocate(bytes, "allocating the visibility buffer");
    if (!buffer) return buffer.error();
    impl_->samples = std::move(*buffer);
  }
  const auto samples = reinterpret_cast<uint64_t*>(impl_->samples.data());
  if (impl_->stream == nullptr) return impl_->frames->draw(view, samples, {}, times);
  const auto start = std::chrono::steady_clock::now();
  const Result<StreamStats> streamed = impl_->stream->draw_frame(view, shade, samples);
  if (!streamed) return streamed.error();
  impl_->streamed = *streamed;
  if (times != nullptr) {
    *times = {};
    times->raster_ms = std::chrono::duration<float, std::milli>(std::chrono::steady_clock::now() - start).count();
  }
  return streamed->drawn;
}

Result<void> DeviceScene::read_samples(std::span<uint64_t> samples) {
  if (impl_->samples.bytes() != samples.size_bytes())
    return Error{ErrorCode::kRange, std::to_string(samples.size()) + " samples, but the picture has " +
                                        std::to_string(impl_->samples.bytes() / sizeof(uint64_t))};
  return cuda_check(cudaMemcpy(samples.data(), impl_->samples.data(), samples.size_bytes(), cudaMemcpyDeviceToHost),
                    "reading the visibility buffer");
}

Result<void> DeviceScene::resolve(const kernels::View& view, uint32_t samples_per_side,
                                  const kernels::ShadeOptions& options, std::span<uint32_t> pixels,
                                  kernels::ResolveTimes* times) {
  if (impl_->samples.bytes() != uint64_t{view.width} * view.height * sizeof(uint64_t))
    return Error{ErrorCode::kRange, "no picture of " + std::to_string(view.width) + " x " +
                                        std::to_string(view.height) + " samples was drawn"};
  if (auto checked = kernels::check_resolve(view, samples_per_side); !checked) return checked;
  const uint64_t count = uint64_t{view.width / samples_per_side} * (view.height / samples_per_side);
  if (auto reserved = impl_->pixels.reserve(count * sizeof(uint32_t), "allocating the picture"); !reserved)
    return reserved.error();
  const auto device_pixels = reinterpret_cast<uint32_t*>(impl_->pixels.data());
  const bool from_colors = impl_->stream != nullptr && kernels::shades_from_chunks(options.show);
  if (from_colors && impl_->stream->colors() == nullptr)
    return Error{ErrorCode::kRange, "the streamed frame was not drawn to be shaded so"};
  if (from_colors) {
    if (auto done = impl_->resolver.resolve_colors(view, samples_per_side,
                                                   reinterpret_cast<const uint64_t*>(impl_->samples.data()),
                                                   impl_->stream->colors(), options, device_pixels, nullptr, times);
        !done)
      return done;
  } else if (auto done = impl_->resolver.resolve(
                 impl_->scene.view(), view, samples_per_side, reinterpret_cast<const uint64_t*>(impl_->samples.data()),
                 impl_->frames->transforms(), options, device_pixels, nullptr, times, impl_->scene.texture_cache());
             !done)
    return done;
  if (pixels.empty()) return {};
  if (pixels.size() != count)
    return Error{ErrorCode::kRange,
                 std::to_string(pixels.size()) + " pixels, but the picture has " + std::to_string(count)};
  return cuda_check(cudaMemcpy(pixels.data(), device_pixels, pixels.size_bytes(), cudaMemcpyDeviceToHost),
                    "reading the picture");
}

}  // namespace scree::runtime
