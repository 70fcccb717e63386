// DeviceScene where the program is built without CUDA.
#include "runtime/draw/device_scene.h"

#include <cstdlib>

namespace scree::runtime {

struct DeviceScene::Impl {};

Result<void> find_device() {
  return Error{ErrorCode::kDevice, "this program was built without CUDA; use --backend cpu"};
}

DeviceScene::DeviceScene(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
DeviceScene::DeviceScene(DeviceScene&&) noexcept = default;
DeviceScene& DeviceScene::operator=(DeviceScene&&) noexcept = default;
DeviceScene::~DeviceScene() = default;

Result<DeviceScene> DeviceScene::upload(const Scene&, uint64_t, uint32_t, Reading, uint64_t, uint64_t) {
  return find_device().error();
}

Result<kernels::FrameStats> DeviceScene::draw(const kernels::View&, kernels::FrameTimes*,
                                              const kernels::ShadeOptions*) {
  return find_device().error();
}

Result<void> DeviceScene::read_samples(std::span<uint64_t>) {
  return find_device();
}

Result<void> DeviceScene::resolve(const kernels::View&, uint32_t, const kernels::ShadeOptions&, std::span<uint32_t>,
                                  kernels::ResolveTimes*) {
  return find_device();
}

Result<std::optional<kernels::TextureCacheCounts>> DeviceScene::texture_counts() const {
  return find_device().error();
}

const std::optional<StreamStats>& DeviceScene::stream_stats() const {
  static const std::optional<StreamStats> none;
  return none;
}

const UploadStats& DeviceScene::stats() const {
  static const UploadStats none;
  return none;
}

// Nobody has a DeviceScene to ask.
kernels::CudaFrames& DeviceScene::frames() {
  std::abort();
}
const kernels::SceneView& DeviceScene::device_view() const {
  std::abort();
}

}  // namespace scree::runtime
