// DeviceScene where the program is built without CUDA.
#include "runtime/draw/device_scene.h"

#include <cstdlib>

#include "runtime/draw/device_list.h"

namespace scree::runtime {

struct DeviceScene::Impl {};

DeviceScene::DeviceScene(std::unique_ptr<Impl> impl) : DeviceView(nullptr), impl_(std::move(impl)) {}
DeviceScene::DeviceScene(DeviceScene&&) noexcept = default;
DeviceScene& DeviceScene::operator=(DeviceScene&&) noexcept = default;
DeviceScene::~DeviceScene() = default;

BlockPager* DeviceScene::block_pager(uint32_t) const {
  return nullptr;
}

Result<void> DeviceScene::set_texture_memory(const SceneFile&, uint64_t, uint64_t, const PictureNeeds&, SceneOptions&) {
  return {};
}

const UploadStats& DeviceScene::stats() const {
  static const UploadStats none;
  return none;
}

uint64_t DeviceScene::view_bytes(const Scene&, const PictureNeeds&) {
  return 0;
}

uint32_t DeviceScene::gpu_count() const {
  return 1;
}

bool DeviceScene::is_streamed() const {
  return false;
}

HostMemory HostMemory::pinned(uint64_t bytes) {
  return plain(bytes);
}

struct DeviceView::Impl {};

DeviceView::DeviceView(std::shared_ptr<Impl> impl) : impl_(std::move(impl)) {}
DeviceView::DeviceView(DeviceView&&) noexcept = default;
DeviceView& DeviceView::operator=(DeviceView&&) noexcept = default;
DeviceView::~DeviceView() = default;

const std::optional<StreamStats>& DeviceView::stream_stats() const {
  static const std::optional<StreamStats> none;
  return none;
}

bool DeviceView::has_started() const {
  return false;
}

void* DeviceView::stream() const {
  return nullptr;
}

const kernels::BlendCounts& DeviceView::blended() const {
  static const kernels::BlendCounts none;
  return none;
}

const uint32_t* DeviceView::pixels() const {
  return nullptr;
}

Result<uint64_t*> DeviceView::samples() {
  return nullptr;
}

std::shared_ptr<const void> DeviceView::hold(const std::byte*) const {
  return nullptr;
}

// Never called, because no DeviceScene can be made.
const kernels::SceneView& DeviceScene::device_view() const {
  std::abort();
}

// upload() refuses with the reason why there is no GPU. No DeviceScene or DeviceView is ever made, so the others are
// linked but never called.
#define SCREE_NEEDS_GPU(...)      \
  __VA_ARGS__ {                   \
    return current_gpu().error(); \
  }
SCREE_NEEDS_GPU(Result<DeviceScene> DeviceScene::upload(const Scene&, uint64_t, uint32_t, Reading, uint64_t, uint64_t,
                                                        const PictureNeeds&, JobProgress*, uint32_t, bool,
                                                        const PageShare*))
SCREE_NEEDS_GPU(Result<void> DeviceView::order_after(void*))
SCREE_NEEDS_GPU(Result<uint64_t*> DeviceView::keep_samples(size_t))
SCREE_NEEDS_GPU(Result<void> DeviceView::write(void*, std::span<const std::byte>))
SCREE_NEEDS_GPU(Result<void> DeviceView::check_memory(const void*) const)
SCREE_NEEDS_GPU(Result<void> DeviceView::read_colors(const kernels::View&, const kernels::ShadeOptions&,
                                                     std::span<float>))
SCREE_NEEDS_GPU(Result<void> DeviceView::read_over(const kernels::View&, const kernels::ShadeOptions&,
                                                   std::span<float>))
SCREE_NEEDS_GPU(Result<void> DeviceView::read_layer(const kernels::View&, uint32_t, Layer, std::span<std::byte>))
SCREE_NEEDS_GPU(Result<std::optional<kernels::TextureCacheCounts>> DeviceScene::texture_counts() const)
SCREE_NEEDS_GPU(Result<uint64_t> DeviceScene::load_rest(const IsOver&))
SCREE_NEEDS_GPU(Result<DeviceView> DeviceScene::add_view(const Scene&))
SCREE_NEEDS_GPU(Result<const uint32_t*> DeviceScene::set_omitted(std::span<const uint32_t>))
SCREE_NEEDS_GPU(Result<void> DeviceView::make_current() const)
SCREE_NEEDS_GPU(Result<kernels::FrameStats> DeviceView::draw(const kernels::View&, kernels::FrameTimes*,
                                                             const kernels::ShadeOptions*, const IsOver&))
SCREE_NEEDS_GPU(Result<void> DeviceView::start(const kernels::View&, const LowerSamples&))
SCREE_NEEDS_GPU(Result<bool> DeviceView::finish())
SCREE_NEEDS_GPU(Result<void> DeviceView::read_samples(std::span<uint64_t>))
SCREE_NEEDS_GPU(Result<void> DeviceView::write_samples(std::span<const uint64_t>))
SCREE_NEEDS_GPU(Result<void> DeviceView::resolve(const kernels::View&, uint32_t, const kernels::ShadeOptions&,
                                                 std::span<uint32_t>, kernels::ResolveTimes*, uint32_t*))
SCREE_NEEDS_GPU(Result<uint64_t> DeviceView::read_sample(uint64_t))
SCREE_NEEDS_GPU(Result<const std::byte*> DeviceView::make_layer(const kernels::View&, uint32_t, Layer))
SCREE_NEEDS_GPU(Result<void> DeviceView::make_layers(const kernels::View&, uint32_t, const kernels::LayerTargets&))
SCREE_NEEDS_GPU(Result<kernels::FrameStats> DeviceView::draw_batch(const Scene&, std::span<const kernels::View>,
                                                                   const kernels::ShadeOptions*,
                                                                   const std::function<Result<void>(size_t)>&))
SCREE_NEEDS_GPU(Result<std::optional<kernels::FrameStats>> DeviceView::draw_together(
    const Scene&, std::span<const kernels::View>, uint32_t, const kernels::LayerTargets&))
SCREE_NEEDS_GPU(Result<std::vector<std::byte>> DeviceView::encode_jpeg(uint32_t, uint32_t, int, bool))
SCREE_NEEDS_GPU(Result<std::byte*> DeviceView::reserve_block(size_t, uint64_t))
SCREE_NEEDS_GPU(Result<float*> DeviceView::make_colors(const kernels::View&, const kernels::ShadeOptions&))
SCREE_NEEDS_GPU(Result<uint32_t*> DeviceView::resolve_colors(const kernels::View&, uint32_t,
                                                             const kernels::ShadeOptions&))
SCREE_NEEDS_GPU(Result<void> DeviceView::read(const void*, std::span<std::byte>))
SCREE_NEEDS_GPU(Result<void> DeviceView::read_later(const void*, std::span<std::byte>))
SCREE_NEEDS_GPU(Result<void> DeviceView::end_reads())
SCREE_NEEDS_GPU(Result<void> DeviceView::order_before(void*))
#undef SCREE_NEEDS_GPU

}  // namespace scree::runtime
