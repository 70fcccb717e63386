// DeviceScene where the program is built with CUDA; device_scene_none.cpp stands in elsewhere.
#include <algorithm>
#include <chrono>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "format/container/mip_levels.h"
#include "kernels/cull/depth_pyramid.h"
#include "kernels/shade/pixels.h"
#include "kernels/shade/resolve_rounds.h"
#include "kernels/shade/srgb.h"
#include "runtime/draw/device_list.h"
#include "runtime/draw/device_scene_impl.h"
#include "runtime/threads/job_thread.h"

namespace scree::runtime {

namespace {

/// The texture cache takes at most this part of a streamed scene's budget.
constexpr uint64_t kTextureCacheShare = 8;

/// The usual part of device memory for pages of textures that do not all fit.
constexpr uint64_t kTextureShare = 4;

/// The most of a streamed scene's device memory, and of its limit of pinned memory, for joining split pages.
constexpr uint64_t kJoinShare = 8;
constexpr uint64_t kPinnedJoinShare = 8;

/// The least memory for pages of textures beside streamed chunks.
constexpr uint64_t kLeastTextureRoom = uint64_t{16} << 20;

/// The part of the free memory that is left for kernels' code, their stacks and queues that grow. If the scene is
/// resident, it is at most kMostLeft. For a streamed scene the whole part stays free, because its pool would use all
/// the rest.
constexpr uint64_t kLeftShare = 16;
constexpr uint64_t kMostLeft = uint64_t{512} << 20;

/// The first queues of a frame, which take 58 MiB, and the tables of a small scene.
constexpr uint64_t kUsualFrameBytes = uint64_t{64} << 20;

/// A picture of C with 132 M samples (3840x2160, 4x4) queues a triangle for stage 2 per 95 samples.
constexpr uint64_t kSamplesPerMedium = 64;

/// The largest batch while a scene is loaded by its pictures. A frame may wait for two batches (Streamer::draw).
constexpr uint64_t kComingBatchBytes = uint64_t{64} << 20;

/// The tables of the resolver (kernels/cuda/shade/resolve.cu), with room for the range of depths.
constexpr uint64_t kResolverBytes = sizeof(kernels::SrgbTables) + 256;

/// Device memory of the resolver of shaded pictures.
uint64_t resolver_bytes(const PictureNeeds& needs) {
  const bool has_occlusion = needs.shade->ssao || needs.shade->edl;
  return kResolverBytes + (has_occlusion ? uint64_t{3} * needs.width * needs.height * sizeof(float) : 0);
}

uint64_t pyramid_bytes(uint64_t width, uint64_t height) {
  if (width == 0 || height == 0) return 0;
  kernels::DepthPyramid pyramid;
  return kernels::lay_out(pyramid, static_cast<int32_t>(width), static_cast<int32_t>(height)) * sizeof(uint32_t);
}

/// Two lists of the tiles of a picture of a scene with JPEG or paged levels (kernels/cuda/shade/texture_cache.cu).
uint64_t tile_list_bytes(uint64_t width, uint64_t height) {
  const kernels::PixelTiles tiles{static_cast<uint32_t>(width), 0, static_cast<uint32_t>(height)};
  return uint64_t{2} * tiles.count() * sizeof(kernels::UnfinishedTile);
}

/// Whether textured pictures of a scene are shaded in rounds.
bool has_rounds(const Scene& scene) {
  return scene.jpeg_groups().count != 0 || scene.block_pager() != nullptr;
}

/// Device memory of the rounds of resident pictures.
uint64_t round_bytes(const PictureNeeds& needs, const Scene& scene) {
  return has_rounds(scene) ? tile_list_bytes(needs.width, needs.height) : 0;
}

/// The number of words of DeviceScene::set_omitted().
uint64_t omitted_words(const kernels::SceneView& scene) {
  return (scene.instance_count + 31) / 32;
}

/// Device memory of the frames of the picture, and of its layers.
uint64_t frames_bytes(const kernels::SceneView& host) {
  uint64_t bytes = kernels::CudaFrames::device_bytes(host) + omitted_words(host) * sizeof(uint32_t);
  if (host.blend_masks != nullptr) bytes += kernels::CudaFrames::device_bytes(kernels::blended_view(host));
  return bytes;
}

/// Queues that hold the first of the pictures, so that it is not drawn again, if they take at most a quarter of `room`.
kernels::CudaQueueSizes roomy_queues(const kernels::SceneView& host, const PictureNeeds& needs, uint64_t room) {
  const uint64_t samples = uint64_t{needs.width} * needs.height * needs.samples_per_side * needs.samples_per_side;
  if (samples == 0) return {};
  kernels::CudaQueueSizes sizes{.holds_first_frame = true};
  sizes.medium = std::max(sizes.medium, samples / kSamplesPerMedium);
  return kernels::CudaFrames::device_bytes(host, sizes) <= room / 4 ? sizes : kernels::CudaQueueSizes{};
}

/// Device memory of the pictures beside the scene, its frames and the pool of chunks.
uint64_t picture_bytes(const PictureNeeds& needs, const Scene& scene, bool streamed) {
  const uint64_t pixels = uint64_t{needs.width} * needs.height;
  const uint64_t width = uint64_t{needs.width} * needs.samples_per_side;
  const uint64_t height = uint64_t{needs.height} * needs.samples_per_side;
  const uint64_t samples = width * height;
  uint64_t bytes = samples * sizeof(uint64_t) + pyramid_bytes(width, height);
  if (streamed) {
    // CudaStream::open() draws and shades a picture of one sample.
    bytes += pyramid_bytes(width, height) + kResolverBytes + 256 + tile_list_bytes(1, 1);
    if (needs.shade != nullptr && kernels::shades_from_chunks(needs.shade->show)) {
      bytes += 3 * samples * sizeof(float);
      if (has_rounds(scene)) bytes += tile_list_bytes(width, height);
    }
  }
  if (needs.starts_next) bytes += samples * sizeof(uint64_t) + scene.view().instance_count * sizeof(kernels::Transform);
  if (needs.shadow_side != 0) {  // a view of its own, and maps of half the side that are kept
    const uint64_t side = needs.shadow_side;
    bytes += 2 * side * side * sizeof(uint64_t) + pyramid_bytes(side, side);
    if (!streamed) bytes += frames_bytes(scene.view());
  }
  if (needs.shade == nullptr) return bytes;
  if (kernels::shows_layers(scene.view(), *needs.shade))
    bytes += kernels::CudaBlend::device_bytes(samples) + pyramid_bytes(width, height);
  bytes += pixels * sizeof(uint32_t) + resolver_bytes(needs);
  if (needs.is_encoded) bytes += kernels::CudaJpegCoder::device_bytes(needs.width, needs.height);
  if (!streamed) bytes += round_bytes(needs, scene);
  return bytes;
}

/// About picture_bytes(), before the scene is known.
uint64_t usual_picture_bytes(const PictureNeeds& needs) {
  const uint64_t pixels = uint64_t{needs.width} * needs.height, side = needs.shadow_side;
  const uint64_t samples = pixels * needs.samples_per_side * needs.samples_per_side * (needs.starts_next ? 2 : 1);
  return (samples + 2 * side * side) * sizeof(uint64_t) + pixels * sizeof(uint32_t);
}

/// Device memory of a streamed scene beside its pool, the room to move chunks and the room for pages of textures.
uint64_t fixed_bytes(const Scene& host, const PictureNeeds& pictures, uint64_t texture_cache) {
  return CudaScene::device_bytes(host, &host.view(), texture_cache) + frames_bytes(host.view()) +
         CudaStream::device_bytes(host.view()) + picture_bytes(pictures, host, true);
}

/// The bytes of a pool that holds all chunks. An empty chunk takes room too.
uint64_t whole_pool(std::span<const uint64_t> chunk_bytes) {
  return CudaStream::kept_bytes(chunk_bytes) + chunk_bytes.size() * Residency::kAlignment;
}

uint64_t largest_of(std::span<const uint64_t> chunk_bytes) {
  return chunk_bytes.empty() ? 0 : *std::max_element(chunk_bytes.begin(), chunk_bytes.end());
}

/// Whether the pool of a streamed scene would hold all of its chunks.
bool holds_all(const Scene& host, const PictureNeeds& pictures, uint64_t texture_cache, uint64_t budget) {
  const std::vector<uint64_t> bytes = ChunkSource(host).chunk_bytes();
  const uint64_t pool = whole_pool(bytes);
  return fixed_bytes(host, pictures, std::min(texture_cache, budget / kTextureCacheShare)) + pool +
             CudaStream::bounce_bytes(largest_of(bytes), UINT64_MAX) + 2 * Residency::kAlignment +
             DeviceBlockPager::usual_room(host) <=
         budget;
}

}  // namespace

DeviceScene::DeviceScene(std::unique_ptr<Impl> impl) : DeviceView(impl->own), impl_(std::move(impl)) {}
DeviceScene::DeviceScene(DeviceScene&&) noexcept = default;
DeviceScene& DeviceScene::operator=(DeviceScene&&) noexcept = default;
DeviceScene::~DeviceScene() {
  DeviceView::impl_.reset();  // a view is destroyed before its scene
}

const UploadStats& DeviceScene::stats() const {
  return impl_->stats;
}

Result<std::optional<kernels::TextureCacheCounts>> DeviceScene::texture_counts() const {
  const kernels::CudaTextureCache* const cache = impl_->scene.texture_cache();
  if (cache == nullptr || cache->slots() == 0 || impl_->streaming() != nullptr)
    return std::optional<kernels::TextureCacheCounts>();
  const kernels::TextureCacheCounts counts = SCREE_TRY(cache->counts());
  return std::optional<kernels::TextureCacheCounts>(counts);
}

BlockPager* DeviceScene::block_pager(uint32_t gpu) const {
  return gpu == 0 ? impl_->scene.block_pager() : impl_->team->block_pager(gpu);
}

uint32_t DeviceScene::gpu_count() const {
  return impl_->team != nullptr ? impl_->team->size() : 1;
}

bool DeviceScene::is_streamed() const {
  return impl_->streaming() != nullptr;
}

Result<uint64_t> DeviceScene::load_rest(const IsOver& is_over) {
  CudaStream* const stream = impl_->streaming();
  if (stream == nullptr) return uint64_t{0};
  const uint64_t left = SCREE_TRY(stream->load_rest(is_over));
  if (left != 0) return left;
  // Views that were added have no frames yet. The last picture must be drawn again before it is shaded, because its
  // transforms are valid for its last part only.
  DeviceView::Impl& own = *impl_->own;
  own.width = 0;
  SCREE_TRY(own.frames->pages_came());
  if (own.blend_frames) SCREE_TRY(own.blend_frames->pages_came());
  return left;
}

Result<DeviceView> DeviceScene::add_view(const Scene& scene) try {
  if (impl_->own.use_count() == 2) return DeviceView(impl_->own);  // only this object has it, as a view
  auto view = std::make_shared<DeviceView::Impl>(*impl_);
  if (impl_->stream == nullptr)  // otherwise make_ready() makes the frames
    SCREE_TRY(impl_->make_frames(*view, scene.view()));
  return DeviceView(std::move(view));
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left for another view"};
}

uint64_t DeviceScene::view_bytes(const Scene& scene, const PictureNeeds& pictures) {
  return frames_bytes(scene.view()) + picture_bytes(pictures, scene, false);
}

Result<const uint32_t*> DeviceScene::set_omitted(std::span<const uint32_t> bits) {
  if (bits.empty()) return static_cast<const uint32_t*>(nullptr);
  if (const uint64_t words = omitted_words(impl_->scene.view()); bits.size() != words)
    return Error{ErrorCode::kRange,
                 std::to_string(bits.size()) + " words of bits for the instances, expected " + std::to_string(words)};
  DeviceBuffer& omitted = impl_->omitted;
  constexpr const char* kWhat = "copying a bit for each instance";
  SCREE_TRY(omitted.reserve(bits.size_bytes(), "allocating a bit for each instance"));
  SCREE_TRY(cuda_check(cudaMemcpy(omitted.data(), bits.data(), bits.size_bytes(), cudaMemcpyHostToDevice), kWhat));
  // Other GPUs that draw the scene read the bits too, and wait for no stream of this one.
  SCREE_TRY(cuda_check(cudaStreamSynchronize(nullptr), kWhat));
  return reinterpret_cast<const uint32_t*>(omitted.data());
}

const kernels::SceneView& DeviceScene::device_view() const {
  return impl_->scene.view();
}

Result<void> DeviceScene::set_texture_memory(const SceneFile& file, uint64_t wanted, uint64_t budget_bytes,
                                             const PictureNeeds& pictures, SceneOptions& options) {
  const format::Container& container = file.container();
  const uint64_t budget = SCREE_TRY(device_budget(budget_bytes));
  uint64_t images = 0;  // in the form in which they are sampled
  for (uint64_t i = 0; i < container.images().size(); ++i) {
    const format::ImageRecord& image = container.images()[i];
    const bool is_blocks = image.codec == format::ImageCodec::kBlocks;
    if (!is_blocks && image.codec != format::ImageCodec::kIndexedJpeg) continue;
    if (!is_blocks) images += container.pages()[image.page].raw_bytes;
    for (uint32_t level = is_blocks ? 0 : 1; level <= image.level_count; ++level)
      images += is_blocks ? format::block_rows(image, level).bytes()
                          : container.mip_levels()[image.first_level + level - 1].bytes;
  }
  uint64_t all = kUsualFrameBytes + usual_picture_bytes(pictures);
  for (uint64_t i = 0; i < container.pages().size(); ++i) all += container.pages()[i].raw_bytes;
  const bool fits = wanted != 0 ? images <= wanted : all <= budget - budget / kLeftShare;
  options.texture_memory = fits ? 0 : wanted != 0 ? wanted : kHostTextureMemory;
  options.device_texture_memory = fits ? 0 : wanted != 0 ? wanted : budget / kTextureShare;
  options.device_texture_limit = fits ? 0 : wanted != 0 ? wanted : UINT64_MAX;
  return {};
}

Result<DeviceScene> DeviceScene::upload(const Scene& scene, uint64_t budget_bytes, uint32_t threads, Reading reading,
                                        uint64_t texture_cache, uint64_t host_memory, const PictureNeeds& pictures,
                                        JobProgress* progress, uint32_t gpus, bool comes_later,
                                        const PageShare* share) {
  const Gpu gpu = SCREE_TRY(current_gpu());
  const auto start = std::chrono::steady_clock::now();
  const uint64_t free = SCREE_TRY(device_budget(0));
  const uint64_t left = free / kLeftShare;
  const uint64_t usable = free - std::min(left, kMostLeft);
  const uint64_t budget = budget_bytes == 0 ? usable : std::min(budget_bytes, usable);
  const uint64_t beside = frames_bytes(scene.view()) + picture_bytes(pictures, scene, false);
  if (gpus > 1) {
    const std::vector<int> team = SCREE_TRY(gpus_from(gpu.index, gpus));
    const uint64_t own_frames = kernels::CudaFrames::device_bytes(scene.view());
    const uint64_t samples =
        std::max(uint64_t{pictures.width} * pictures.height * pictures.samples_per_side * pictures.samples_per_side,
                 uint64_t{pictures.shadow_side} * pictures.shadow_side) *
        sizeof(uint64_t);
    const uint64_t resolver = pictures.shade != nullptr ? resolver_bytes(pictures) + round_bytes(pictures, scene) : 0;
    const GpuTeam::Options options{
        budget,  beside + own_frames, own_frames + samples + resolver, threads, reading, texture_cache, host_memory,
        progress};
    if (team.size() > 1 && GpuTeam::fits(scene, static_cast<uint32_t>(team.size()), options)) {
      auto shared = std::make_unique<Impl>();
      shared->device = gpu.index;
      SCREE_TRY(shared->upload_shared(scene, team, options));
      return DeviceScene(std::move(shared));
    }
  }
  const uint64_t allowed = budget_bytes == 0 ? free - left : budget;
  if (comes_later) comes_later = holds_all(scene, pictures, texture_cache, allowed);
  const uint64_t resident = CudaScene::device_bytes(scene, nullptr, texture_cache) + beside;
  if (comes_later || (share == nullptr && resident > budget)) {
    auto streamed = std::make_unique<Impl>();
    streamed->device = gpu.index;
    SCREE_TRY(streamed->upload_streamed(scene, allowed, threads, reading, texture_cache, host_memory, pictures,
                                        progress, comes_later ? kComingBatchBytes : kMostBatchBytes));
    streamed->stats.upload_ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    return DeviceScene(std::move(streamed));
  }
  JobThread<void> loading;  // of kernels, beside the scene
  if (pictures.shade != nullptr)
    loading.add([&, index = gpu.index] {
      if (!set_current_gpu(index)) return;
      kernels::CudaResolver::load(scene.view(), pictures.samples_per_side, *pictures.shade, has_rounds(scene));
    });
  const uint64_t more = share == nullptr ? DeviceBlockPager::more_room(scene, budget - resident) : 0;
  CudaScene copy = SCREE_TRY(CudaScene::upload(scene, budget_bytes, beside, threads, reading, texture_cache, nullptr,
                                               host_memory, progress, share, more));
  auto impl = std::make_unique<Impl>();
  impl->device = gpu.index;
  impl->scene = std::move(copy);
  impl->fragment_room = budget - std::min(budget, impl->scene.stats().device_bytes);
  SCREE_TRY(impl->scene.keep_textures(scene, DeviceBlockPager::most_kept_bytes(scene, host_memory)));
  const kernels::CudaQueueSizes queues = roomy_queues(scene.view(), pictures, impl->fragment_room);
  SCREE_TRY(impl->make_frames(*impl->own, scene.view(), queues));
  impl->stats = impl->scene.stats();
  impl->stats.upload_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  return DeviceScene(std::move(impl));
}

Result<void> DeviceScene::Impl::upload_shared(const Scene& host, std::span<const int> gpus,
                                              const GpuTeam::Options& options) {
  team = std::make_unique<GpuTeam>();
  scene = SCREE_TRY(team->open(host, gpus, options));
  stats = team->stats();
  fragment_room = options.budget - std::min(options.budget, scene.stats().device_bytes);
  return make_frames(*own, host.view());
}

/// `budget`: of device memory, for records, textures, frames and the pool. The texture cache leaves most of it to
/// chunks.
Result<void> DeviceScene::Impl::upload_streamed(const Scene& host, uint64_t budget, uint32_t threads, Reading reading,
                                                uint64_t texture_cache, uint64_t host_memory,
                                                const PictureNeeds& pictures, JobProgress* progress,
                                                uint64_t most_batch) {
  std::vector<uint64_t> bytes = ChunkSource(host).chunk_bytes();
  const uint64_t largest = largest_of(bytes);
  SharedRoom pages;
  pages.least_room = std::min(DeviceBlockPager::usual_room(host), kLeastTextureRoom);
  pages.most_room = DeviceBlockPager::most_room(host);
  pages.least_pool = largest + 2 * Residency::kAlignment;
  const uint64_t room = 2 * pages.least_pool + pages.least_room;  // with memory to move a chunk
  texture_cache = std::min(texture_cache, budget / kTextureCacheShare);
  if (budget < fixed_bytes(host, pictures, texture_cache) + room)
    texture_cache = 1;  // rounded up to one group: slow, but the same picture
  const uint64_t fixed = fixed_bytes(host, pictures, texture_cache);
  const uint64_t least = fixed + room;
  if (budget < least)
    return Error{ErrorCode::kDevice, "the scene takes at least " + std::to_string(least) +
                                         " bytes of device memory where its chunks are streamed, but " +
                                         std::to_string(budget) + " are allowed"};
  const uint64_t bounce = CudaStream::bounce_bytes(largest, budget - fixed);
  const uint64_t beside = fixed + bounce + 2 * Residency::kAlignment;
  const uint64_t whole = whole_pool(bytes);
  const uint64_t all_rooms = CudaStream::kept_bytes(bytes);
  uint64_t lists =
      CudaStream::pinned_list_bytes(host.view()) +
      (host.block_pager() != nullptr ? DeviceBlockPager::pinned_bytes(host_memory) + DeviceBlockPager::table_bytes(host)
                                     : 0);
  const bool keeps_all = host_memory != 0 && lists + all_rooms <= host_memory;
  PageJoins::Sizes joins;
  if (!keeps_all)
    joins = PageJoins::sizes_for(ChunkSource(host), threads, (budget - least) / kJoinShare,
                                 host_memory != 0 ? host_memory / kPinnedJoinShare : PageJoins::kMostPinned);
  for (;; joins = {}) {
    pages.bytes = budget - beside - joins.device_bytes();
    pages.room = pages.within(DeviceBlockPager::usual_room(host), DeviceBlockPager::kUnit);
    // A scene that fits without memory for joins does not give up that.
    const bool could_hold_all = pages.pool() + joins.device_bytes() >= whole;
    if (!joins.any() || pages.pool() >= whole || !could_hold_all) break;
  }
  const uint64_t pool = std::min(pages.pool(), whole);
  if (pool == whole) {
    // All chunks stay, and pages may have the rest.
    pages.room = pages.within(pages.bytes - pool, DeviceBlockPager::kUnit);
    pages.least_room = pages.most_room = pages.room;
  }
  lists += joins.pinned_bytes();
  // Batches take a fifth of the pinned memory, unless one chunk takes more, and the chunks that are kept the rest.
  if (host_memory != 0) most_batch = std::min(most_batch, host_memory / (5 * CudaStream::kStagings));
  Streamer streamer = SCREE_TRY(Streamer::create(host, pool, std::move(bytes), most_batch));
  uint64_t kept = 0;
  if (host_memory != 0) {
    const uint64_t staging = CudaStream::kStagings * streamer.most_batch_bytes();
    if (!keeps_all && lists + staging > host_memory) {
      lists -= joins.pinned_bytes();
      joins = {};
    }
    const uint64_t least_host = lists + std::min(all_rooms, CudaStream::kStagings * (largest + Residency::kAlignment));
    if (!keeps_all && lists + staging > host_memory)
      return at(host.file().path(), Error{ErrorCode::kMemory, "streaming takes at least " + std::to_string(least_host) +
                                                                  " bytes of pinned host memory, but " +
                                                                  std::to_string(host_memory) + " are allowed"});
    kept = host_memory - lists - (keeps_all ? 0 : staging);
  }
  stream = std::make_unique<CudaStream>(host, std::move(streamer), bounce, joins, threads);
  scene = SCREE_TRY(CudaScene::upload(host, 0, frames_bytes(host.view()), threads, reading, texture_cache,
                                      &stream->view(), host_memory, progress));
  stats = scene.stats();
  stats.device_bytes = beside + joins.device_bytes() + pool + pages.room;
  fragment_room = budget - std::min(budget, stats.device_bytes);
  SCREE_TRY(make_frames(*own, stream->view()));
  const Result<void> opened =
      stream->open(scene.view(), *own->frames, own->blend_frames ? &*own->blend_frames : nullptr, own->resolver,
                   scene.texture_cache(), scene.block_pager(), pages, kept);
  if (!opened) return opened.error().code == ErrorCode::kDevice ? opened : at(host.file().path(), opened.error());
  // Pages of textures have the memory that is left when all chunks are kept.
  return scene.keep_textures(host, kept - std::min(kept, all_rooms));
}

}  // namespace scree::runtime
