// A scene that is ready to be drawn, on the CPU or on a GPU, by any number of views.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "format/result.h"
#include "runtime/draw/device_list.h"
#include "runtime/draw/device_scene.h"
#include "runtime/scene/camera.h"
#include "runtime/scene/scene.h"
#include "runtime/threads/job_progress.h"

namespace scree::runtime {

/// The device that draws a scene. kAuto: a GPU if one is usable and takes the scene, else the CPU.
enum class DrawOn { kAuto, kCpu, kGpu };

struct LoadOptions {
  std::string scene;  // by name or number; empty: the file's default
  DrawOn on = DrawOn::kAuto;
  std::string gpu;    // as use_gpu(); empty: the first that can be used
  uint32_t gpus = 1;  // as DeviceScene::upload(); kAllGpus: all
  uint32_t threads = 1;
  bool textures = true;
  uint64_t texture_cache = 0;        // bytes of decoded blocks; 0: kHostTextureCache, kDeviceTextureCache
  uint64_t texture_memory = 0;       // `wanted` of set_texture_memory()
  uint64_t device_memory = 0;        // as DeviceScene::upload()
  uint64_t host_memory = 0;          // likewise
  PictureNeeds pictures;             // likewise
  bool comes_later = false;          // likewise
  Reading reading = Reading::kAuto;  // likewise
  kernels::Lighting lighting = kernels::Lighting::kAuto;  // as SceneOptions
  std::string environment;                                // likewise
  CameraOptions camera;             // of the views: where view_reads_vertices(), the host gets the pages too
  JobProgress* progress = nullptr;  // gets the progress of loading, and may stop it (kFile)
  /// Called before the scene is uploaded: may refuse it, and change the options of DeviceScene::upload(). `on` is kCpu
  /// there if there is no GPU.
  std::function<Result<void>(const Scene& scene, LoadOptions& options)> accept;
};

class LoadedScene {
 public:
  /// Errors as SceneFile::find_scene, Scene::load and DeviceScene::upload, the file named; those of `accept`.
  static Result<std::shared_ptr<LoadedScene>> load(SceneFile file, LoadOptions options);
  LoadedScene(const LoadedScene&) = delete;
  LoadedScene& operator=(const LoadedScene&) = delete;
  ~LoadedScene();

  Scene& scene() { return *scene_; }
  const Scene& scene() const { return *scene_; }
  uint32_t threads() const { return threads_; }
  /// LoadOptions::lighting.
  kernels::Lighting lighting() const { return lighting_; }
  /// The GPU that draws the scene; nullopt if the CPU does.
  const std::optional<Gpu>& gpu() const { return gpu_; }
  /// One line with the reason why no GPU draws the scene; empty if a GPU does, or if DrawOn::kAuto was not given.
  const std::string& why_cpu() const { return why_cpu_; }
  /// Null if the CPU draws. To be used with gpu_lock() held, except for its statistics.
  DeviceScene* device() const { return device_.get(); }
  bool is_streamed() const { return device_ != nullptr && device_->is_streamed(); }

  /// Lets the CPU draw from now on; there must be no view of the GPU any more. Errors as Scene::load_pages().
  Result<void> use_cpu();

  /// Thread-safe; errors as make_view().
  Result<kernels::View> view(const CameraOptions& options) const { return make_view(*scene_, options); }

  /// The lock for the GPU work of all scenes. One thread at a time submits it, because freeing device memory or waiting
  /// for a device would end the recording of another thread's frame (kernels/cuda/common/graph.h). The holder has to
  /// make the scene's device current first. The lock's destructor restores the caller's device.
  class GpuLock : public std::unique_lock<std::mutex> {
   public:
    explicit GpuLock(std::mutex& mutex) : std::unique_lock<std::mutex>(mutex) {}

   private:
    KeptGpu kept_;  // ends while the lock is held
  };
  static GpuLock gpu_lock();

 private:
  LoadedScene() = default;
  Result<void> upload(const LoadOptions& options);
  void drop_device();

  std::unique_ptr<Scene> scene_;
  uint32_t threads_ = 1;
  kernels::Lighting lighting_ = kernels::Lighting::kAuto;
  std::optional<Gpu> gpu_;
  std::string why_cpu_;
  std::unique_ptr<DeviceScene> device_;
};

}  // namespace scree::runtime
