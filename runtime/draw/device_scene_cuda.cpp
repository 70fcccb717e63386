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
#include "kernels/cull/depth_pyramid.h"
#include "kernels/frame_parts.h"
#include "kernels/shade/pixels.h"
#include "kernels/shade/resolve_rounds.h"
#include "kernels/shade/srgb.h"
#include "runtime/draw/cuda_upload.h"
#include "runtime/draw/device_list.h"
#include "runtime/draw/device_scene.h"
#include "runtime/draw/stream_cuda.h"

namespace scree::runtime {

using kernels::cuda_check;
using kernels::DeviceBuffer;

namespace {

/// Of a streamed scene's budget at most one part in so many is a cache of its textures.
constexpr uint64_t kTextureCacheShare = 8;

/// Of the free memory what is left to kernels' code, their stacks and queues that grow: a part, and this much at most
/// where the scene is resident. A streamed scene's pool could use all of it.
constexpr uint64_t kLeftShare = 16;
constexpr uint64_t kMostLeft = uint64_t{512} << 20;

/// The tables of the resolver (kernels/cuda/resolve.cu), with room for the range of depths.
constexpr uint64_t kResolverBytes = sizeof(kernels::SrgbTables) + 256;

uint64_t pyramid_bytes(uint64_t width, uint64_t height) {
  if (width == 0 || height == 0) return 0;
  kernels::DepthPyramid pyramid;
  return kernels::lay_out(pyramid, static_cast<int32_t>(width), static_cast<int32_t>(height)) * sizeof(uint32_t);
}

/// Two lists of the tiles of a picture of a scene with JPEG levels (kernels/cuda/texture_cache.cu).
uint64_t tile_list_bytes(uint64_t width, uint64_t height) {
  const kernels::PixelTiles tiles{static_cast<uint32_t>(width), 0, static_cast<uint32_t>(height)};
  return uint64_t{2} * tiles.count() * sizeof(kernels::UnfinishedTile);
}

/// Device memory of the pictures beside the scene, its frames and the pool of chunks.
uint64_t picture_bytes(const PictureNeeds& needs, bool streamed, bool has_jpegs) {
  const uint64_t pixels = uint64_t{needs.width} * needs.height;
  const uint64_t width = uint64_t{needs.width} * needs.samples_per_side;
  const uint64_t height = uint64_t{needs.height} * needs.samples_per_side;
  const uint64_t samples = width * height;
  uint64_t bytes = samples * sizeof(uint64_t) + pyramid_bytes(width, height);
  if (streamed) {
    // A picture of one sample is drawn and shaded before the first (CudaStream::open).
    bytes += pyramid_bytes(width, height) + kResolverBytes + 256 + tile_list_bytes(1, 1);
    if (needs.shade != nullptr && kernels::shades_from_chunks(needs.shade->show)) {
      bytes += 3 * samples * sizeof(float);
      if (has_jpegs) bytes += tile_list_bytes(width, height);
    }
  }
  if (needs.shade == nullptr) return bytes;
  bytes += pixels * sizeof(uint32_t) + kResolverBytes;
  if (needs.shade->ssao || needs.shade->edl) bytes += 3 * pixels * sizeof(float);
  if (has_jpegs && !streamed) bytes += tile_list_bytes(needs.width, needs.height);
  return bytes;
}

}  // namespace

struct DeviceScene::Impl {
  CudaScene scene;
  DeviceBuffer samples;
  DeviceBuffer pixels;
  kernels::CudaResolver resolver;
  std::optional<kernels::CudaFrames> frames;
  std::unique_ptr<CudaStream> stream;  // where the scene's pages do not lie on the device
  std::optional<StreamStats> streamed;
  UploadStats stats;

  uint32_t width = 0;  // in samples, of what draw() made last
  uint32_t height = 0;

  Result<void> upload_streamed(const Scene& host, uint64_t budget, uint32_t threads, Reading reading,
                               uint64_t texture_cache, uint64_t host_memory, const PictureNeeds& pictures);
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
                                        uint64_t texture_cache, uint64_t host_memory, const PictureNeeds& pictures) {
  if (const Result<Gpu> gpu = current_gpu(); !gpu) return gpu.error();
  const auto start = std::chrono::steady_clock::now();
  const Result<uint64_t> free = device_budget(0);
  if (!free) return free.error();
  const uint64_t left = *free / kLeftShare;
  const uint64_t usable = *free - std::min(left, kMostLeft);
  const uint64_t budget = budget_bytes == 0 ? usable : std::min(budget_bytes, usable);
  const uint64_t beside =
      kernels::CudaFrames::device_bytes(scene.view()) + picture_bytes(pictures, false, scene.jpeg_slot_bytes() != 0);
  if (CudaScene::device_bytes(scene, nullptr, texture_cache) + beside > budget) {
    auto streamed = std::make_unique<Impl>();
    const uint64_t allowed = budget_bytes == 0 ? *free - left : budget;
    if (Result<void> done =
            streamed->upload_streamed(scene, allowed, threads, reading, texture_cache, host_memory, pictures);
        !done)
      return done.error();
    streamed->stats.upload_ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    return DeviceScene(std::move(streamed));
  }
  Result<CudaScene> copy =
      CudaScene::upload(scene, budget_bytes, beside, threads, reading, texture_cache, nullptr, host_memory);
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
                                                uint64_t texture_cache, uint64_t host_memory,
                                                const PictureNeeds& pictures) {
  const uint64_t picture = picture_bytes(pictures, true, host.jpeg_slot_bytes() != 0);
  const uint64_t frames_bytes = kernels::CudaFrames::device_bytes(host.view());
  std::vector<uint64_t> bytes = ChunkSource(host).chunk_bytes();
  const uint64_t largest = bytes.empty() ? 0 : *std::max_element(bytes.begin(), bytes.end());
  const uint64_t room = 2 * (largest + 2 * Residency::kAlignment);  // the least pool, and what moving a chunk takes
  const auto fixed_with = [&](uint64_t cache) {
    return CudaScene::device_bytes(host, &host.view(), cache) + frames_bytes + CudaStream::device_bytes(host.view()) +
           picture;
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
  const uint64_t pool = budget - fixed - bounce - 2 * Residency::kAlignment;
  const uint64_t all_rooms = CudaStream::kept_bytes(bytes);
  const uint64_t lists = CudaStream::pinned_list_bytes(host.view());
  // Batches take a fifth of the pinned memory, unless one chunk takes more, and the chunks that are kept the rest.
  const uint64_t most_batch = host_memory == 0 ? kMostBatchBytes : host_memory / (5 * CudaStream::kStagings);
  Result<Streamer> streamer = Streamer::create(host, pool, std::move(bytes), most_batch);
  if (!streamer) return streamer.error();
  uint64_t kept = 0;
  if (host_memory != 0) {
    const uint64_t staging = CudaStream::kStagings * streamer->most_batch_bytes();
    const uint64_t least_host = lists + std::min(all_rooms, CudaStream::kStagings * (largest + Residency::kAlignment));
    const bool keeps_all = lists + all_rooms <= host_memory;
    if (!keeps_all && lists + staging > host_memory)
      return at(host.file().path(), Error{ErrorCode::kMemory, "streaming takes at least " + std::to_string(least_host) +
                                                                  " bytes of pinned host memory, but " +
                                                                  std::to_string(host_memory) + " are allowed"});
    kept = host_memory - lists - (keeps_all ? 0 : staging);
  }
  stream = std::make_unique<CudaStream>(host, std::move(*streamer), bounce, threads);
  Result<CudaScene> copy =
      CudaScene::upload(host, 0, frames_bytes, threads, reading, texture_cache, &stream->view(), host_memory);
  if (!copy) return copy.error();
  scene = std::move(*copy);
  Result<kernels::CudaFrames> made = kernels::CudaFrames::create(stream->view(), scene.view());
  if (!made) return made.error();
  frames = std::move(*made);
  stats = scene.stats();
  stats.device_bytes = budget;
  return stream->open(scene.view(), *frames, resolver, scene.texture_cache(), kept);
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
  impl_->width = view.width;
  impl_->height = view.height;
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
  if (impl_->width != view.width || impl_->height != view.height)
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
