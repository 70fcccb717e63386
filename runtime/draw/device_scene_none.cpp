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

Result<DeviceScene> DeviceScene::upload(const Scene&, uint64_t, uint32_t, Reading, uint64_t, uint64_t,
                                        const PictureNeeds&, JobProgress*, uint32_t, bool, const PageShare*) {
  return current_gpu().error();
}

Result<void> DeviceView::order_after(void*) {
  return current_gpu().error();
}

Result<uint64_t*> DeviceView::keep_samples(size_t) {
  return current_gpu().error();
}

Result<void> DeviceView::write(void*, std::span<const std::byte>) {
  return current_gpu().error();
}

Result<void> DeviceView::check_memory(const void*) const {
  return current_gpu().error();
}

Result<void> DeviceView::read_colors(const kernels::View&, const kernels::ShadeOptions&, std::span<float>) {
  return current_gpu().error();
}

Result<void> DeviceView::read_over(const kernels::View&, const kernels::ShadeOptions&, std::span<float>) {
  return current_gpu().error();
}

Result<void> DeviceView::read_layer(const kernels::View&, uint32_t, Layer, std::span<std::byte>) {
  return current_gpu().error();
}

Result<std::optional<kernels::TextureCacheCounts>> DeviceScene::texture_counts() const {
  return current_gpu().error();
}

BlockPager* DeviceScene::block_pager(uint32_t) const {
  return nullptr;
}

Result<void> DeviceScene::set_texture_memory(const SceneFile&, uint64_t, uint64_t, SceneOptions&) {
  return {};
}

const UploadStats& DeviceScene::stats() const {
  static const UploadStats none;
  return none;
}

Result<uint64_t> DeviceScene::load_rest(const IsOver&) {
  return current_gpu().error();
}

Result<DeviceView> DeviceScene::add_view(const Scene&) {
  return current_gpu().error();
}

uint64_t DeviceScene::view_bytes(const Scene&, const PictureNeeds&) {
  return 0;
}

uint32_t DeviceScene::gpu_count() const {
  return 1;
}

Result<const uint32_t*> DeviceScene::set_omitted(std::span<const uint32_t>) {
  return current_gpu().error();
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

Result<void> DeviceView::make_current() const {
  return current_gpu().error();
}

Result<kernels::FrameStats> DeviceView::draw(const kernels::View&, kernels::FrameTimes*, const kernels::ShadeOptions*,
                                             const IsOver&) {
  return current_gpu().error();
}

const std::optional<StreamStats>& DeviceView::stream_stats() const {
  static const std::optional<StreamStats> none;
  return none;
}

Result<void> DeviceView::start(const kernels::View&, const LowerSamples&) {
  return current_gpu().error();
}

bool DeviceView::has_started() const {
  return false;
}

Result<bool> DeviceView::finish() {
  return current_gpu().error();
}

void* DeviceView::stream() const {
  return nullptr;
}

Result<void> DeviceView::read_samples(std::span<uint64_t>) {
  return current_gpu().error();
}

Result<void> DeviceView::write_samples(std::span<const uint64_t>) {
  return current_gpu().error();
}

Result<void> DeviceView::resolve(const kernels::View&, uint32_t, const kernels::ShadeOptions&, std::span<uint32_t>,
                                 kernels::ResolveTimes*, uint32_t*) {
  return current_gpu().error();
}

const kernels::BlendCounts& DeviceView::blended() const {
  static const kernels::BlendCounts none;
  return none;
}

Result<uint64_t> DeviceView::read_sample(uint64_t) {
  return current_gpu().error();
}

Result<const std::byte*> DeviceView::make_layer(const kernels::View&, uint32_t, Layer) {
  return current_gpu().error();
}

Result<void> DeviceView::make_layers(const kernels::View&, uint32_t, const kernels::LayerTargets&) {
  return current_gpu().error();
}

Result<kernels::FrameStats> DeviceView::draw_batch(const Scene&, std::span<const kernels::View>,
                                                   const kernels::ShadeOptions*,
                                                   const std::function<Result<void>(size_t)>&) {
  return current_gpu().error();
}

Result<std::optional<kernels::FrameStats>> DeviceView::draw_together(const Scene&, std::span<const kernels::View>,
                                                                     uint32_t, const kernels::LayerTargets&) {
  return current_gpu().error();
}

Result<std::vector<std::byte>> DeviceView::encode_jpeg(uint32_t, uint32_t, int, bool) {
  return current_gpu().error();
}

Result<std::byte*> DeviceView::reserve_block(size_t, uint64_t) {
  return current_gpu().error();
}

const uint32_t* DeviceView::pixels() const {
  return nullptr;
}

Result<float*> DeviceView::make_colors(const kernels::View&, const kernels::ShadeOptions&) {
  return current_gpu().error();
}

Result<uint32_t*> DeviceView::resolve_colors(const kernels::View&, uint32_t, const kernels::ShadeOptions&) {
  return current_gpu().error();
}

Result<uint64_t*> DeviceView::samples() {
  return nullptr;
}

std::shared_ptr<const void> DeviceView::hold(const std::byte*) const {
  return nullptr;
}

Result<void> DeviceView::read(const void*, std::span<std::byte>) {
  return current_gpu().error();
}

Result<void> DeviceView::read_later(const void*, std::span<std::byte>) {
  return current_gpu().error();
}

Result<void> DeviceView::end_reads() {
  return current_gpu().error();
}

Result<void> DeviceView::order_before(void*) {
  return current_gpu().error();
}

// Never called, because no DeviceScene can be made.
const kernels::SceneView& DeviceScene::device_view() const {
  std::abort();
}

}  // namespace scree::runtime
