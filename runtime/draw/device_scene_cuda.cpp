// DeviceScene where the program is built with CUDA; device_scene_none.cpp stands in elsewhere.
#include <algorithm>
#include <cassert>
#include <chrono>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "format/container/mip_levels.h"
#include "kernels/cuda/blend.h"
#include "kernels/cuda/check.h"
#include "kernels/cuda/frame.h"
#include "kernels/cuda/jpeg.h"
#include "kernels/cuda/layers.h"
#include "kernels/cuda/resolve.h"
#include "kernels/cuda/view_batch.h"
#include "kernels/cull/depth_pyramid.h"
#include "kernels/frame_parts.h"
#include "kernels/shade/pixels.h"
#include "kernels/shade/resolve_rounds.h"
#include "kernels/shade/srgb.h"
#include "runtime/draw/cuda_upload.h"
#include "runtime/draw/device_list.h"
#include "runtime/draw/device_scene.h"
#include "runtime/draw/gpu_team.h"
#include "runtime/draw/shared_device_buffer.h"
#include "runtime/draw/stream_cuda.h"
#include "runtime/images/jpeg_head.h"

namespace scree::runtime {

using kernels::cuda_check;
using DeviceBuffer = SharedDeviceBuffer;

namespace {

/// The texture cache takes at most this part of a streamed scene's budget.
constexpr uint64_t kTextureCacheShare = 8;

/// The usual part of device memory for pages of textures that do not all fit.
constexpr uint64_t kTextureShare = 4;

/// The least memory for pages of textures beside streamed chunks.
constexpr uint64_t kLeastTextureRoom = uint64_t{16} << 20;

/// The part of the free memory that is left for kernels' code, their stacks and queues that grow. If the scene is
/// resident, it is at most kMostLeft. A streamed scene leaves the whole part, because its pool would use all the rest.
constexpr uint64_t kLeftShare = 16;
constexpr uint64_t kMostLeft = uint64_t{512} << 20;

/// The largest batch while a scene is loaded by its pictures. A frame may wait for two batches (Streamer::draw).
constexpr uint64_t kComingBatchBytes = uint64_t{64} << 20;

/// The tables of the resolver (kernels/cuda/resolve.cu), with room for the range of depths.
constexpr uint64_t kResolverBytes = sizeof(kernels::SrgbTables) + 256;

/// The highest priority of a stream, in place of which CUDA takes the highest that the GPU has.
constexpr int kMostPriority = -100;

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

/// Two lists of the tiles of a picture of a scene with JPEG or paged levels (kernels/cuda/texture_cache.cu).
uint64_t tile_list_bytes(uint64_t width, uint64_t height) {
  const kernels::PixelTiles tiles{static_cast<uint32_t>(width), 0, static_cast<uint32_t>(height)};
  return uint64_t{2} * tiles.count() * sizeof(kernels::UnfinishedTile);
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

/// Device memory of the pictures beside the scene, its frames and the pool of chunks.
uint64_t picture_bytes(const PictureNeeds& needs, const Scene& scene, bool streamed) {
  const bool has_rounds = scene.jpeg_groups().count != 0 || scene.block_pager() != nullptr;
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
      if (has_rounds) bytes += tile_list_bytes(width, height);
    }
  }
  if (needs.starts_next) {
    const uint64_t shadow = uint64_t{needs.shadow_side} * needs.shadow_side;
    bytes += (samples + shadow) * sizeof(uint64_t) + scene.view().instance_count * sizeof(kernels::Transform);
  }
  if (needs.shadow_side != 0) {  // a view of its own
    const uint64_t side = needs.shadow_side;
    bytes += side * side * sizeof(uint64_t) + pyramid_bytes(side, side);
    if (!streamed) bytes += frames_bytes(scene.view());
  }
  if (needs.shade == nullptr) return bytes;
  if (kernels::shows_layers(scene.view(), *needs.shade))
    bytes += kernels::CudaBlend::device_bytes(samples) + pyramid_bytes(width, height);
  bytes += pixels * sizeof(uint32_t) + resolver_bytes(needs);
  if (needs.is_encoded) bytes += kernels::CudaJpegCoder::device_bytes(needs.width, needs.height);
  if (has_rounds && !streamed) bytes += tile_list_bytes(needs.width, needs.height);
  return bytes;
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

struct DeviceView::Impl {
  explicit Impl(DeviceScene::Impl& of) : scene(of) {}

  /// Makes `after` wait for the work that is queued on `before`.
  Result<void> order(cudaStream_t before, cudaStream_t after) {
    Result<void> done;
    if (queued == nullptr)
      done = cuda_check(cudaEventCreateWithFlags(&queued, cudaEventDisableTiming), "making an event");
    if (done) done = cuda_check(cudaEventRecord(queued, before), "recording an event");
    if (done) done = cuda_check(cudaStreamWaitEvent(after, queued), "ordering a stream");
    return done;
  }

  /// The stream of all work on the picture that was drawn last: from the first start() on, its own.
  cudaStream_t stream() const { return beside; }

  /// Copies once the queued work is done, and waits for the copy.
  Result<void> copy(void* to, const void* from, uint64_t bytes, cudaMemcpyKind kind, const char* what) const {
    const Result<void> done = cuda_check(cudaMemcpyAsync(to, from, bytes, kind, stream()), what);
    return done ? cuda_check(cudaStreamSynchronize(stream()), what) : done;
  }

  DeviceScene::Impl& scene;
  std::optional<kernels::CudaFrames> frames;        // none if chunks are streamed and another view has them
  std::optional<kernels::CudaFrames> blend_frames;  // of layers, if the scene has blended surfaces; likewise
  kernels::CudaResolver resolver;
  kernels::CudaBlend blend;
  kernels::BlendCounts blended;  // of the picture that resolve() made last
  DeviceBuffer samples;
  DeviceBuffer pixels;
  DeviceBuffer colors;  // of read_colors()
  DeviceBuffer layers[kPixelLayerCount];
  DeviceBuffer blocks[kBlockCount];
  // For the second picture that start(), or a batch, draws at the same time. They take turns with `frames` and
  // `samples`.
  std::optional<kernels::CudaFrames> second_frames;
  DeviceBuffer second_samples;
  size_t picture = 0;  // 0 or 1: the one that `frames` and `samples` belong to
  bool has_room_for_second = true;
  std::optional<kernels::CudaViewBatch> view_batch;
  bool takes_view_batches = true;  // false once the scene turns out not to suit them, or memory is short
  kernels::CudaJpegCoder jpeg;
  cudaEvent_t queued = nullptr;
  std::optional<kernels::View> ahead;  // of the picture between start() and finish(), into second_samples
  bool joins_ahead = false;            // with DrawOptions::join
  cudaStream_t beside = nullptr;
  std::optional<StreamStats> streamed;

  uint32_t width = 0;  // of the picture that draw() made last, in samples
  uint32_t height = 0;
  std::optional<kernels::View> drawn_by_team;  // that picture's, if several GPUs drew it

  ~Impl() {
    if (beside != nullptr) (void)cudaStreamDestroy(beside);
    if (queued != nullptr) (void)cudaEventDestroy(queued);
  }
  Result<void> check_drawn(const kernels::View& view);
  Result<kernels::FrameStats> draw_by_team(const kernels::View& view);
  Result<void> draw_if_followed();
  Result<uint64_t*> whole_samples();
  uint64_t* sample_data() const { return reinterpret_cast<uint64_t*>(samples.data()); }

  void use_picture(size_t number) {
    if (picture == number) return;
    std::swap(frames, second_frames);
    std::swap(samples, second_samples);
    picture = number;
  }
  /// Whether shading reads the cache of the first GPU's textures.
  bool uses_texture_cache(const kernels::ShadeOptions& options) const;
  /// The transforms of the picture that draw() made last. Null if they are gone.
  const kernels::Transform* transforms() const;
  bool open_second(const kernels::SceneView& host);
  bool open_view_batch(const kernels::SceneView& host);
  Result<const float*> blended_over(const kernels::View& view, const kernels::ShadeOptions& options);
};

struct DeviceScene::Impl {
  CudaScene scene;
  int device = 0;
  std::shared_ptr<DeviceView::Impl> own = std::make_shared<DeviceView::Impl>(*this);
  std::unique_ptr<CudaStream> stream;           // if not all of the scene's pages were uploaded
  std::unique_ptr<GpuTeam> team;                // if several GPUs have the pages
  const DeviceView::Impl* team_view = nullptr;  // whose picture the team drew last
  DeviceBuffer omitted;                         // the bits of set_omitted()
  UploadStats stats;
  uint64_t fragment_room = 0;  // bytes, of the fragments of blended surfaces of a view

  Result<void> make_frames(DeviceView::Impl& view, const kernels::SceneView& host) const {
    view.blend = kernels::CudaBlend(fragment_room);
    Result<kernels::CudaFrames> made = kernels::CudaFrames::create(host, scene.view());
    if (!made) return made.error();
    view.frames = std::move(*made);
    if (host.blend_masks == nullptr) return {};
    Result<kernels::CudaFrames> layers =
        kernels::CudaFrames::create(kernels::blended_view(host), kernels::blended_view(scene.view()));
    if (!layers) return layers.error();
    view.blend_frames = std::move(*layers);
    return {};
  }
  /// The stream while it streams; null if all chunks are present.
  CudaStream* streaming() const { return stream != nullptr && !stream->is_complete() ? stream.get() : nullptr; }
  /// Makes the frames of a view that was added while chunks were streamed, once the scene is resident.
  Result<void> make_ready(DeviceView::Impl& view) const {
    return view.frames || streaming() != nullptr ? Result<void>() : make_frames(view, stream->view());
  }
  Result<void> upload_streamed(const Scene& host, uint64_t budget, uint32_t threads, Reading reading,
                               uint64_t texture_cache, uint64_t host_memory, const PictureNeeds& pictures,
                               JobProgress* progress, uint64_t most_batch);
  Result<void> upload_shared(const Scene& host, std::span<const int> gpus, const GpuTeam::Options& options);
};

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
  const Result<kernels::FrameStats> drawn = draw_by_team(*drawn_by_team);
  return drawn ? Result<void>() : drawn.error();
}

/// All samples of the picture, on the first GPU.
Result<uint64_t*> DeviceView::Impl::whole_samples() {
  Result<void> done = draw_if_followed();
  if (done && drawn_by_team) done = scene.team->gather();
  if (!done) return done.error();
  return sample_data();
}

bool DeviceView::Impl::uses_texture_cache(const kernels::ShadeOptions& options) const {
  return options.show == kernels::Show::kTexture && scene.scene.texture_cache() != nullptr;
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
  const Result<uint64_t*> whole = whole_samples();
  if (!whole) return whole.error();
  const kernels::SceneView blended_scene = kernels::blended_view(scene.scene.view());
  const auto draw = [&](uint64_t* onto, const uint64_t* peeled, const kernels::FragmentSlots& to) -> Result<void> {
    kernels::DrawOptions drawing;
    drawing.part = kernels::FramePart::kPart;
    drawing.peeled = peeled;
    drawing.fragments = to;
    const Result<kernels::FrameStats> drawn = blend_frames->draw(view, onto, drawing);
    return drawn ? Result<void>() : drawn.error();
  };
  const auto shade = [&](const uint64_t* layer, float* light) {
    return resolver.shade_part(blended_scene, view, layer, blend_frames->transforms(), options, light, nullptr,
                               scene.scene.texture_cache());
  };
  const kernels::LayerSource source{
      [&](const kernels::BlendTargets& at, const uint64_t* peeled) { return draw(at.drawn, peeled, {}); },
      [&](const kernels::BlendTargets& at) -> Result<void> {
        if (Result<void> done = shade(at.layer, at.colors); !done) return done;
        return kernels::start_finding_alphas(blended_scene, view, at.layer, blend_frames->transforms(), at.alphas,
                                             nullptr);
      }};
  const kernels::FragmentSource fragments{
      blended_scene, [&](const kernels::FragmentSlots& to) { return draw(sample_data(), nullptr, to); }, shade,
      [&] { return blend_frames->transforms(); }};
  return blend.blend(view, sample_data(), options.blend_layers, source, blended, &fragments);
}

DeviceScene::DeviceScene(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DeviceScene::DeviceScene(DeviceScene&&) noexcept = default;
DeviceScene& DeviceScene::operator=(DeviceScene&&) noexcept = default;
DeviceScene::~DeviceScene() = default;

const UploadStats& DeviceScene::stats() const {
  return impl_->stats;
}

Result<std::optional<kernels::TextureCacheCounts>> DeviceScene::texture_counts() const {
  const kernels::CudaTextureCache* const cache = impl_->scene.texture_cache();
  if (cache == nullptr || cache->slots() == 0 || impl_->streaming() != nullptr)
    return std::optional<kernels::TextureCacheCounts>();
  const Result<kernels::TextureCacheCounts> counts = cache->counts();
  if (!counts) return counts.error();
  return std::optional<kernels::TextureCacheCounts>(*counts);
}

BlockPager* DeviceScene::block_pager() const {
  return impl_->scene.block_pager();
}

kernels::CudaFrames& DeviceScene::frames() {
  return *impl_->own->frames;
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
  const Result<uint64_t> left = stream->load_rest(is_over);
  if (!left || *left != 0) return left;
  // Views that were added have no frames yet. The last picture must be drawn again before it is shaded, because its
  // transforms are valid for its last part only.
  DeviceView::Impl& own = *impl_->own;
  own.width = 0;
  Result<void> done = own.frames->pages_came();
  if (done && own.blend_frames) done = own.blend_frames->pages_came();
  if (!done) return done.error();
  return left;
}

Result<DeviceView> DeviceScene::add_view(const Scene& scene) {
  if (impl_->own.use_count() == 1) return DeviceView(impl_->own);
  try {
    auto view = std::make_shared<DeviceView::Impl>(*impl_);
    if (impl_->stream == nullptr)  // otherwise make_ready() makes the frames
      if (const Result<void> made = impl_->make_frames(*view, scene.view()); !made) return made.error();
    return DeviceView(std::move(view));
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, "no memory left for another view"};
  }
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
  Result<void> done = omitted.reserve(bits.size_bytes(), "allocating a bit for each instance");
  if (done)
    done = cuda_check(cudaMemcpy(omitted.data(), bits.data(), bits.size_bytes(), cudaMemcpyHostToDevice),
                      "copying a bit for each instance");
  // Other GPUs that draw the scene read the bits too, and wait for no stream of this one.
  if (done) done = cuda_check(cudaStreamSynchronize(nullptr), "copying a bit for each instance");
  if (!done) return done.error();
  return reinterpret_cast<const uint32_t*>(omitted.data());
}

const kernels::SceneView& DeviceScene::device_view() const {
  return impl_->scene.view();
}

Result<void> DeviceScene::set_texture_memory(const SceneFile& file, uint64_t wanted, uint64_t budget_bytes,
                                             SceneOptions& options) {
  const format::Container& container = file.container();
  const Result<uint64_t> budget = device_budget(budget_bytes);
  if (!budget) return budget.error();
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
  uint64_t all = 0;
  for (uint64_t i = 0; i < container.pages().size(); ++i) all += container.pages()[i].raw_bytes;
  const bool fits = wanted != 0 ? images <= wanted : all <= *budget - *budget / kLeftShare;
  options.texture_memory = fits ? 0 : wanted != 0 ? wanted : kHostTextureMemory;
  options.device_texture_memory = fits ? 0 : wanted != 0 ? wanted : *budget / kTextureShare;
  options.device_texture_limit = fits ? 0 : wanted != 0 ? wanted : UINT64_MAX;
  return {};
}

Result<DeviceScene> DeviceScene::upload(const Scene& scene, uint64_t budget_bytes, uint32_t threads, Reading reading,
                                        uint64_t texture_cache, uint64_t host_memory, const PictureNeeds& pictures,
                                        JobProgress* progress, uint32_t gpus, bool comes_later,
                                        const PageShare* share) {
  const Result<Gpu> gpu = current_gpu();
  if (!gpu) return gpu.error();
  const auto start = std::chrono::steady_clock::now();
  const Result<uint64_t> free = device_budget(0);
  if (!free) return free.error();
  const uint64_t left = *free / kLeftShare;
  const uint64_t usable = *free - std::min(left, kMostLeft);
  const uint64_t budget = budget_bytes == 0 ? usable : std::min(budget_bytes, usable);
  const uint64_t beside = frames_bytes(scene.view()) + picture_bytes(pictures, scene, false);
  if (gpus > 1) {
    const Result<std::vector<int>> team = gpus_from(gpu->index, gpus);
    if (!team) return team.error();
    const uint64_t own_frames = kernels::CudaFrames::device_bytes(scene.view());
    const uint64_t samples =
        std::max(uint64_t{pictures.width} * pictures.height * pictures.samples_per_side * pictures.samples_per_side,
                 uint64_t{pictures.shadow_side} * pictures.shadow_side) *
        sizeof(uint64_t);
    const uint64_t resolver = pictures.shade != nullptr ? resolver_bytes(pictures) : 0;
    const GpuTeam::Options options{
        budget,  beside + own_frames, own_frames + samples + resolver, threads, reading, texture_cache, host_memory,
        progress};
    if (team->size() > 1 && GpuTeam::fits(scene, static_cast<uint32_t>(team->size()), options)) {
      auto shared = std::make_unique<Impl>();
      shared->device = gpu->index;
      if (const Result<void> done = shared->upload_shared(scene, *team, options); !done) return done.error();
      return DeviceScene(std::move(shared));
    }
  }
  const uint64_t allowed = budget_bytes == 0 ? *free - left : budget;
  if (comes_later) comes_later = holds_all(scene, pictures, texture_cache, allowed);
  const uint64_t resident = CudaScene::device_bytes(scene, nullptr, texture_cache) + beside;
  if (comes_later || (share == nullptr && resident > budget)) {
    auto streamed = std::make_unique<Impl>();
    streamed->device = gpu->index;
    if (Result<void> done =
            streamed->upload_streamed(scene, allowed, threads, reading, texture_cache, host_memory, pictures, progress,
                                      comes_later ? kComingBatchBytes : kMostBatchBytes);
        !done)
      return done.error();
    streamed->stats.upload_ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    return DeviceScene(std::move(streamed));
  }
  // Pages of textures get half of the rest. The other half is for blended surfaces and for queues that grow.
  uint64_t more = 0;
  if (share == nullptr)
    more = std::min(DeviceBlockPager::most_room(scene) - DeviceBlockPager::usual_room(scene),
                    (budget - resident) / 2 / DeviceBlockPager::kUnit * DeviceBlockPager::kUnit);
  Result<CudaScene> copy = CudaScene::upload(scene, budget_bytes, beside, threads, reading, texture_cache, nullptr,
                                             host_memory, progress, share, more);
  if (!copy) return copy.error();
  auto impl = std::make_unique<Impl>();
  impl->device = gpu->index;
  impl->scene = std::move(*copy);
  impl->fragment_room = budget - std::min(budget, impl->scene.stats().device_bytes);
  if (const Result<void> made = impl->make_frames(*impl->own, scene.view()); !made) return made.error();
  impl->stats = impl->scene.stats();
  impl->stats.upload_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  return DeviceScene(std::move(impl));
}

Result<void> DeviceScene::Impl::upload_shared(const Scene& host, std::span<const int> gpus,
                                              const GpuTeam::Options& options) {
  team = std::make_unique<GpuTeam>();
  Result<CudaScene> shared = team->open(host, gpus, options);
  if (!shared) return shared.error();
  scene = std::move(*shared);
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
  pages.bytes = budget - fixed - bounce - 2 * Residency::kAlignment;
  pages.room = pages.within(DeviceBlockPager::usual_room(host), DeviceBlockPager::kUnit);
  const uint64_t pool = std::min(pages.pool(), whole_pool(bytes));
  if (pool == whole_pool(bytes)) {
    // All chunks stay, and pages may have the rest.
    pages.room = pages.within(pages.bytes - pool, DeviceBlockPager::kUnit);
    pages.least_room = pages.most_room = pages.room;
  }
  const uint64_t all_rooms = CudaStream::kept_bytes(bytes);
  const uint64_t lists = CudaStream::pinned_list_bytes(host.view()) +
                         (host.block_pager() != nullptr ? DeviceBlockPager::pinned_bytes(host_memory) : 0);
  // Batches take a fifth of the pinned memory, unless one chunk takes more, and the chunks that are kept the rest.
  if (host_memory != 0) most_batch = std::min(most_batch, host_memory / (5 * CudaStream::kStagings));
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
  Result<CudaScene> copy = CudaScene::upload(host, 0, frames_bytes(host.view()), threads, reading, texture_cache,
                                             &stream->view(), host_memory, progress);
  if (!copy) return copy.error();
  scene = std::move(*copy);
  stats = scene.stats();
  stats.device_bytes = fixed + bounce + pool + pages.room + 2 * Residency::kAlignment;
  fragment_room = budget - std::min(budget, stats.device_bytes);
  if (const Result<void> made = make_frames(*own, stream->view()); !made) return made;
  return stream->open(scene.view(), *own->frames, own->blend_frames ? &*own->blend_frames : nullptr, own->resolver,
                      scene.texture_cache(), scene.block_pager(), pages, kept);
}

const std::optional<StreamStats>& DeviceScene::stream_stats() const {
  return impl_->own->streamed;
}

Result<kernels::FrameStats> DeviceScene::draw(const kernels::View& view, kernels::FrameTimes* times,
                                              const kernels::ShadeOptions* shade, const IsOver& is_over) {
  return DeviceView(impl_->own).draw(view, times, shade, is_over);
}

Result<void> DeviceScene::read_samples(std::span<uint64_t> samples) {
  return DeviceView(impl_->own).read_samples(samples);
}

Result<void> DeviceScene::write_samples(std::span<const uint64_t> samples) {
  return DeviceView(impl_->own).write_samples(samples);
}

Result<void> DeviceScene::resolve(const kernels::View& view, uint32_t samples_per_side,
                                  const kernels::ShadeOptions& options, std::span<uint32_t> pixels,
                                  kernels::ResolveTimes* times) {
  return DeviceView(impl_->own).resolve(view, samples_per_side, options, pixels, times);
}

const kernels::BlendCounts& DeviceScene::blended() const {
  return impl_->own->blended;
}

Result<void> DeviceScene::read_over(const kernels::View& view, const kernels::ShadeOptions& options,
                                    std::span<float> over) {
  return DeviceView(impl_->own).read_over(view, options, over);
}

Result<void> DeviceScene::read_colors(const kernels::View& view, const kernels::ShadeOptions& options,
                                      std::span<float> colors) {
  return DeviceView(impl_->own).read_colors(view, options, colors);
}

Result<void> DeviceScene::read_layer(const kernels::View& view, uint32_t samples_per_side, PixelLayer layer,
                                     std::span<std::byte> out) {
  DeviceView own(impl_->own);
  const Result<const std::byte*> made = own.make_layer(view, samples_per_side, layer);
  if (!made) return made.error();
  return own.read(*made, out);
}

Result<std::vector<std::byte>> DeviceScene::encode_jpeg(uint32_t width, uint32_t height, int quality, bool is_sharp) {
  return DeviceView(impl_->own).encode_jpeg(width, height, quality, is_sharp);
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
  if (Result<void> checked = own.check_drawn(view); !checked) return checked;
  if (over.size() != uint64_t{4} * view.width * view.height || !kernels::shows_layers(own.scene.scene.view(), options))
    return Error{ErrorCode::kRange, std::to_string(over.size()) + " values for the layers of " +
                                        std::to_string(view.width) + " x " + std::to_string(view.height) + " samples"};
  const Result<const float*> made = own.blended_over(view, options);
  if (!made) return made.error();
  return cuda_check(cudaMemcpy(over.data(), *made, over.size_bytes(), cudaMemcpyDeviceToHost), "reading the layers");
}

Result<void> DeviceView::read_colors(const kernels::View& view, const kernels::ShadeOptions& options,
                                     std::span<float> colors) {
  if (colors.size() != uint64_t{3} * view.width * view.height)
    return Error{ErrorCode::kRange, std::to_string(colors.size()) + " values for the colours of " +
                                        std::to_string(view.width) + " x " + std::to_string(view.height) + " samples"};
  const Result<float*> made = make_colors(view, options);
  if (!made) return made.error();
  return cuda_check(cudaMemcpy(colors.data(), *made, colors.size_bytes(), cudaMemcpyDeviceToHost),
                    "reading the samples' colours");
}

Result<float*> DeviceView::make_colors(const kernels::View& view, const kernels::ShadeOptions& options) {
  Impl& own = *impl_;
  if (Result<void> checked = own.check_drawn(view); !checked) return checked.error();
  if (!kernels::shades_from_chunks(options.show))
    return Error{ErrorCode::kRange, "the picture has no colours from the scene's surfaces"};
  if (const CudaStream* const stream = own.scene.streaming()) {
    if (stream->colors() != nullptr) return stream->colors();
    return Error{ErrorCode::kRange, "the streamed frame was not drawn to be shaded so"};
  }
  const Result<uint64_t*> samples = own.whole_samples();
  if (!samples) return samples.error();
  const uint64_t bytes = uint64_t{3} * view.width * view.height * sizeof(float);
  Result<void> done = own.colors.reserve(bytes, "allocating the samples' colours");
  auto* const colors = reinterpret_cast<float*>(own.colors.data());
  if (done) done = cuda_check(cudaMemsetAsync(colors, 0, bytes, own.stream()), "clearing the colours");
  if (done)
    done = own.resolver.shade_part(own.scene.scene.view(), view, *samples, own.transforms(), options, colors,
                                   own.stream(), own.scene.scene.texture_cache());
  if (!done) return done.error();
  return colors;
}

Result<uint32_t*> DeviceView::resolve_colors(const kernels::View& view, uint32_t samples_per_side,
                                             const kernels::ShadeOptions& options) {
  Impl& own = *impl_;
  Result<void> done = own.check_drawn(view);
  if (done) done = kernels::check_resolve(view, samples_per_side);
  if (done && own.colors.bytes() < uint64_t{3} * view.width * view.height * sizeof(float))
    done = Error{ErrorCode::kRange, "the picture's samples have no colours yet"};
  const uint64_t count = uint64_t{view.width / samples_per_side} * (view.height / samples_per_side);
  if (done) done = own.pixels.reserve(count * sizeof(uint32_t), "allocating the picture");
  auto* const pixels = reinterpret_cast<uint32_t*>(own.pixels.data());
  if (done)
    done = own.resolver.resolve_colors(view, samples_per_side, own.sample_data(),
                                       reinterpret_cast<const float*>(own.colors.data()), nullptr, options, pixels,
                                       own.stream());
  if (!done) return done.error();
  return pixels;
}

Result<kernels::FrameStats> DeviceView::draw(const kernels::View& view, kernels::FrameTimes* times,
                                             const kernels::ShadeOptions* shade, const IsOver& is_over) {
  Impl& impl = *impl_;
  impl.width = 0;
  const uint64_t bytes = uint64_t{view.width} * view.height * sizeof(uint64_t);
  if (const Result<void> reserved = impl.samples.reserve(bytes, "allocating the visibility buffer"); !reserved)
    return reserved.error();
  if (const Result<void> ready = impl.scene.make_ready(impl); !ready) return ready.error();
  CudaStream* const stream = impl.scene.streaming();
  impl.drawn_by_team.reset();
  if (impl.beside != nullptr)
    if (const Result<void> ordered = impl.order(impl.beside, nullptr); !ordered) return ordered.error();
  const auto start = std::chrono::steady_clock::now();
  const auto time = [&] {
    if (times == nullptr) return;
    *times = {};
    times->raster_ms = std::chrono::duration<float, std::milli>(std::chrono::steady_clock::now() - start).count();
  };
  if (impl.scene.team != nullptr) {
    const Result<kernels::FrameStats> drawn = impl.draw_by_team(view);
    if (!drawn) return drawn.error();
    impl.width = view.width;
    impl.height = view.height;
    time();
    return drawn;
  }
  if (stream == nullptr) {
    impl.streamed.reset();
    const Result<kernels::FrameStats> drawn = impl.frames->draw(view, impl.sample_data(), {}, times);
    if (!drawn) return drawn.error();
    impl.width = view.width;
    impl.height = view.height;
    return drawn;
  }
  const Result<StreamStats> streamed = stream->draw_frame(view, shade, impl.sample_data(), is_over);
  if (!streamed) return streamed.error();
  impl.width = view.width;
  impl.height = view.height;
  impl.streamed = *streamed;
  time();
  return streamed->drawn;
}

Result<void> DeviceView::start(const kernels::View& view, const LowerSamples& join) {
  Impl& own = *impl_;
  assert(!own.ahead);
  if (own.scene.team != nullptr || own.scene.streaming() != nullptr)
    return Error{ErrorCode::kUnsupported, "several GPUs, or a GPU that streams, draw one picture at a time"};
  Result<void> done = own.second_samples.reserve(uint64_t{view.width} * view.height * sizeof(uint64_t),
                                                 "allocating a second visibility buffer");
  if (done && own.beside == nullptr) {
    done =
        cuda_check(cudaStreamCreateWithPriority(&own.beside, cudaStreamNonBlocking, kMostPriority), "making a stream");
    if (done) done = own.order(nullptr, own.beside);
  } else if (done) {
    done = cuda_check(cudaStreamWaitEvent(nullptr, own.queued), "ordering a stream");  // of finish()
  }
  if (!done) return done;
  auto* const samples = reinterpret_cast<uint64_t*>(own.second_samples.data());
  const std::function<Result<void>(void*)> join_samples = [&](void* stream) { return join(samples, stream); };
  kernels::DrawOptions drawing;
  own.joins_ahead = join != nullptr;
  if (own.joins_ahead) drawing.join = &join_samples;
  done = own.frames->start(view, samples, drawing);
  if (done) own.ahead = view;
  return done;
}

bool DeviceView::has_started() const {
  return impl_->ahead.has_value();
}

Result<bool> DeviceView::finish() {
  Impl& own = *impl_;
  const kernels::View view = *std::exchange(own.ahead, std::nullopt);
  own.width = 0;
  Result<void> done = cuda_check(cudaEventRecord(own.queued, own.beside), "recording an event");
  if (!done) return done.error();
  const Result<kernels::CudaFrames::Finished> finished = own.frames->finish();
  if (!finished) return finished.error();
  if (finished->is_drawn_again && own.joins_ahead) {
    const auto drawn = own.frames->draw(view, reinterpret_cast<uint64_t*>(own.second_samples.data()));
    if (!drawn) return drawn.error();
  }
  std::swap(own.samples, own.second_samples);
  own.width = view.width;
  own.height = view.height;
  return !finished->is_drawn_again;
}

void* DeviceView::stream() const {
  return impl_->stream();
}

Result<void> DeviceView::read_samples(std::span<uint64_t> samples) {
  const uint64_t count = uint64_t{impl_->width} * impl_->height;
  if (count != samples.size())
    return Error{ErrorCode::kRange,
                 std::to_string(samples.size()) + " samples, but the picture has " + std::to_string(count)};
  const Result<uint64_t*> whole = impl_->whole_samples();
  if (!whole) return whole.error();
  return impl_->copy(samples.data(), *whole, samples.size_bytes(), cudaMemcpyDeviceToHost,
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
  const Result<uint64_t*> samples = impl_->whole_samples();
  if (!samples) return samples.error();
  uint64_t sample = 0;
  if (Result<void> done =
          cuda_check(cudaMemcpy(&sample, *samples + index, sizeof sample, cudaMemcpyDeviceToHost), "reading a sample");
      !done)
    return done.error();
  return sample;
}

Result<void> DeviceView::resolve(const kernels::View& view, uint32_t samples_per_side,
                                 const kernels::ShadeOptions& options, std::span<uint32_t> pixels,
                                 kernels::ResolveTimes* times, uint32_t* out) {
  Impl& impl = *impl_;
  if (Result<void> checked = impl.check_drawn(view); !checked) return checked;
  if (auto checked = kernels::check_resolve(view, samples_per_side); !checked) return checked;
  const uint64_t count = uint64_t{view.width / samples_per_side} * (view.height / samples_per_side);
  if (out == nullptr)
    if (auto reserved = impl.pixels.reserve(count * sizeof(uint32_t), "allocating the picture"); !reserved)
      return reserved.error();
  uint32_t* const device_pixels = out != nullptr ? out : reinterpret_cast<uint32_t*>(impl.pixels.data());
  const CudaStream* const stream = impl.scene.streaming();
  const bool from_colors = stream != nullptr && kernels::shades_from_chunks(options.show);
  impl.blended = {};
  const float* over = nullptr;
  const auto start = std::chrono::steady_clock::now();
  if (kernels::shows_layers(impl.scene.scene.view(), options)) {
    const Result<const float*> drawn = impl.blended_over(view, options);
    if (!drawn) return drawn.error();
    over = *drawn;
  }
  if (from_colors && stream->colors() == nullptr)
    return Error{ErrorCode::kRange, "the streamed frame was not drawn to be shaded so"};
  if (from_colors || over != nullptr) {
    const float* colors = from_colors ? stream->colors() : impl.blend.colors();
    Result<void> done;
    if (!from_colors)
      done = impl.resolver.shade_part(impl.scene.scene.view(), view, impl.sample_data(), impl.transforms(), options,
                                      impl.blend.colors(), nullptr, impl.scene.scene.texture_cache());
    if (done)
      done = impl.resolver.resolve_colors(view, samples_per_side, impl.sample_data(), colors, over, options,
                                          device_pixels, nullptr, times);
    if (!done) return done;
    if (over != nullptr && times != nullptr) {
      const std::chrono::duration<float, std::milli> taken = std::chrono::steady_clock::now() - start;
      times->resolve_ms = taken.count() - times->occlusion_ms;
    }
  } else if (impl.drawn_by_team && out == nullptr && !impl.uses_texture_cache(options)) {
    // Other GPUs might not reach the caller's memory, which another allocator may have mapped for one GPU.
    if (auto done = impl.scene.team->resolve(view, samples_per_side, options, device_pixels, times); !done) return done;
  } else {
    const Result<uint64_t*> samples = impl.whole_samples();
    if (!samples) return samples.error();
    if (auto done =
            impl.resolver.resolve(impl.scene.scene.view(), view, samples_per_side, *samples, impl.transforms(), options,
                                  device_pixels, impl.stream(), times, impl.scene.scene.texture_cache());
        !done)
      return done;
  }
  if (pixels.empty()) return {};
  if (pixels.size() != count)
    return Error{ErrorCode::kRange,
                 std::to_string(pixels.size()) + " pixels, but the picture has " + std::to_string(count)};
  return impl.copy(pixels.data(), device_pixels, pixels.size_bytes(), cudaMemcpyDeviceToHost, "reading the picture");
}

Result<const std::byte*> DeviceView::make_layer(const kernels::View& view, uint32_t samples_per_side,
                                                PixelLayer layer) {
  DeviceBuffer& buffer = impl_->layers[static_cast<size_t>(layer)];
  const uint64_t count = uint64_t{view.width / samples_per_side} * (view.height / samples_per_side);
  if (auto reserved = buffer.reserve(count * layer_bytes(layer), "allocating a layer"); !reserved)
    return reserved.error();
  if (Result<void> made = make_layers(view, samples_per_side, target_of(layer, buffer.data())); !made)
    return made.error();
  return buffer.data();
}

Result<void> DeviceView::make_layers(const kernels::View& view, uint32_t samples_per_side,
                                     const kernels::LayerTargets& out) {
  Impl& impl = *impl_;
  if (Result<void> checked = impl.check_drawn(view); !checked) return checked;
  const bool reads_chunks = out.normal != nullptr || out.uv != nullptr;
  if (reads_chunks && impl.ahead)
    return Error{ErrorCode::kUnsupported, "normals and texture coordinates are not made beside another picture"};
  if (reads_chunks && impl.scene.streaming() != nullptr)
    return Error{ErrorCode::kUnsupported,
                 "a streamed scene has no normals and no texture coordinates to read: the GPU's memory or a larger "
                 "budget of it has to hold the scene, or the CPU draws it"};
  const Result<uint64_t*> samples = impl.whole_samples();
  if (!samples) return samples.error();
  return kernels::start_layers(impl.scene.scene.view(), view, samples_per_side, *samples,
                               reads_chunks ? impl.transforms() : nullptr, out, impl.stream());
}

Result<kernels::FrameStats> DeviceView::draw_batch(const Scene& scene, std::span<const kernels::View> views,
                                                   const kernels::ShadeOptions* shade,
                                                   const std::function<Result<void>(size_t)>& make) {
  Impl& impl = *impl_;
  if (const Result<void> ready = impl.scene.make_ready(impl); !ready) return ready.error();
  kernels::FrameStats sum{};
  if (views.size() < 2 || !impl.open_second(scene.view())) {
    for (size_t i = 0; i < views.size(); ++i) {
      const Result<kernels::FrameStats> drawn = draw(views[i], nullptr, shade);
      if (!drawn) return drawn.error();
      sum += *drawn;
      if (Result<void> made = make(i); !made) return made.error();
    }
    return sum;
  }
  // The frames and samples of both pictures take turns in `frames` and `samples`.
  const auto end = [&](size_t i) -> Result<void> {
    impl.use_picture(i % 2);
    const Result<kernels::CudaFrames::Finished> finished = impl.frames->finish();
    if (!finished) return finished.error();
    sum += finished->stats;
    return finished->is_drawn_again ? make(i) : Result<void>();
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
    impl.width = view.width;
    impl.height = view.height;
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
  const Result<kernels::FrameStats> drawn = impl.view_batch->draw(views, samples_per_side, out);
  if (!drawn) return drawn.error();
  return Drawn(*drawn);
}

Result<std::vector<std::byte>> DeviceView::encode_jpeg(uint32_t width, uint32_t height, int quality, bool is_sharp) {
  if (uint64_t{width} * height * sizeof(uint32_t) > impl_->pixels.bytes())
    return Error{ErrorCode::kRange,
                 "no picture of " + std::to_string(width) + " x " + std::to_string(height) + " pixels was made"};
  Result<JpegHead> head =
      make_jpeg_head(width, height, quality, is_sharp, static_cast<uint16_t>(kernels::jpeg_segment_mcus(is_sharp)));
  if (!head) return head.error();
  Result<std::vector<std::byte>> coded = impl_->jpeg.encode(pixels(), head->header, is_sharp);
  if (!coded) return coded.error();
  std::vector<std::byte>& file = head->bytes;
  file.reserve(file.size() + coded->size() + 2);
  file.insert(file.end(), coded->begin(), coded->end());
  file.insert(file.end(), {std::byte{0xff}, std::byte{0xd9}});
  return std::move(file);
}

Result<std::byte*> DeviceView::reserve_block(size_t index, uint64_t bytes) {
  DeviceBuffer& block = impl_->blocks[index];
  if (auto reserved = block.reserve(bytes, "allocating the pictures of a batch"); !reserved) return reserved.error();
  return block.data();
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

Result<void> DeviceView::order_before(void* stream) {
  return impl_->order(nullptr, static_cast<cudaStream_t>(stream));
}

Result<void> DeviceView::order_after(void* stream) {
  return impl_->order(static_cast<cudaStream_t>(stream), nullptr);
}

Result<void> DeviceView::check_memory(const void* data) const {
  cudaPointerAttributes found{};
  if (Result<void> done = cuda_check(cudaPointerGetAttributes(&found, data), "looking at a buffer"); !done) return done;
  const bool is_device = found.type == cudaMemoryTypeDevice && found.device == impl_->scene.device;
  if (is_device || found.type == cudaMemoryTypeManaged) return {};
  return Error{ErrorCode::kUsage, "a buffer that is not in the memory of GPU " + std::to_string(impl_->scene.device)};
}

}  // namespace scree::runtime
