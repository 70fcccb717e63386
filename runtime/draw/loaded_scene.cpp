#include "runtime/draw/loaded_scene.h"

#include <new>
#include <utility>

namespace scree::runtime {

LoadedScene::GpuLock LoadedScene::gpu_lock() {
  static std::mutex mutex;
  return GpuLock(mutex);
}

LoadedScene::~LoadedScene() {
  drop_device();
}

void LoadedScene::drop_device() {
  if (device_ == nullptr) return;
  const GpuLock lock = gpu_lock();
  (void)set_current_gpu(gpu_->index);
  device_.reset();
}

Result<void> LoadedScene::use_cpu() {
  drop_device();
  gpu_.reset();
  return scene_->load_pages(threads_);
}

Result<std::shared_ptr<LoadedScene>> LoadedScene::load(SceneFile file, LoadOptions options) {
  const std::string path = file.path();
  const uint32_t index = SCREE_TRY(file.find_scene(options.scene));
  try {
    std::shared_ptr<LoadedScene> loaded(new LoadedScene);
    SceneOptions scene_options;
    loaded->threads_ = options.threads;
    loaded->lighting_ = options.lighting;
    if (options.on != DrawOn::kCpu) {
      const GpuLock lock = gpu_lock();
      Result<Gpu> gpu = use_gpu(options.gpu);
      if (!gpu && options.on == DrawOn::kGpu) return at(path, gpu.error());
      if (gpu)
        loaded->gpu_ = std::move(*gpu);
      else
        loaded->why_cpu_ = gpu.error().message;
      if (loaded->gpu_)
        SCREE_TRY_AT(path, set_texture_memory(file, options.texture_memory, true, options.device_memory,
                                              options.pictures, scene_options));
    }
    if (!loaded->gpu_) {
      options.on = DrawOn::kCpu;
      (void)set_texture_memory(file, options.texture_memory, false, options.device_memory, options.pictures,
                               scene_options);
    }
    scene_options.textures = options.textures;
    scene_options.threads = options.threads;
    scene_options.lighting = options.lighting;
    scene_options.environment = options.environment;
    scene_options.texture_cache = options.texture_cache != 0 ? options.texture_cache : kHostTextureCache;
    scene_options.reading = options.reading;
    scene_options.pages = !loaded->gpu_;
    scene_options.progress = options.progress;
    Scene scene = SCREE_TRY(Scene::load(std::move(file), index, scene_options));
    loaded->scene_ = std::make_unique<Scene>(std::move(scene));
    const auto load_pages = [&] { return loaded->scene_->load_pages(options.threads, options.progress); };
    if (view_reads_vertices(loaded->scene_->view(), options.camera)) SCREE_TRY(load_pages());
    if (options.accept) SCREE_TRY(options.accept(*loaded->scene_, options));
    if (loaded->gpu_) {
      const auto upload = [&] { return loaded->upload(options); };
      // The progress function may draw another scene, for which it takes the lock that uploading holds.
      const Result<void> uploaded = options.progress != nullptr ? options.progress->relay(upload) : upload();
      if (!uploaded) {
        if (uploaded.error().code != ErrorCode::kDevice) return uploaded.error();
        if (options.on == DrawOn::kGpu) return at(path, uploaded.error());
        loaded->gpu_.reset();
        loaded->why_cpu_ = uploaded.error().message;
        SCREE_TRY(load_pages());
      }
    }
    return loaded;
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::kMemory, path + ": no memory left to load it"};
  }
}

Result<void> LoadedScene::upload(const LoadOptions& options) {
  const GpuLock lock = gpu_lock();
  SCREE_TRY(set_current_gpu(gpu_->index));
  DeviceScene device = SCREE_TRY(
      DeviceScene::upload(*scene_, options.device_memory, options.threads, options.reading,
                          options.texture_cache != 0 ? options.texture_cache : kDeviceTextureCache, options.host_memory,
                          options.pictures, options.progress, options.gpus, options.comes_later));
  device_ = std::make_unique<DeviceScene>(std::move(device));
  return {};
}

}  // namespace scree::runtime
