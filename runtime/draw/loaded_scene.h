// A scene that is ready to be drawn, on the CPU or on a GPU, by any number of views.
#pragma once

#include <cstdint>
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

/// Where a scene is drawn; kAuto: on a GPU where one can be used and takes the scene, else on the CPU.
enum class DrawOn { kAuto, kCpu, kGpu };

struct LoadOptions {
  std::string scene;  // by name or number; empty: the file's default
  DrawOn on = DrawOn::kAuto;
  std::string gpu;    // as use_gpu(); empty: the first that can be used
  uint32_t gpus = 1;  // as DeviceScene::upload(); kAllGpus: all
  uint32_t threads = 1;
  bool textures = true;
  uint64_t texture_cache = 0;        // bytes of decoded blocks; 0: kHostTextureCache, kDeviceTextureCache
  uint64_t texture_memory = 0;       // as set_texture_memory() has it
  uint64_t device_memory = 0;        // as DeviceScene::upload()
  uint64_t host_memory = 0;          // likewise
  PictureNeeds pictures;             // likewise
  Reading reading = Reading::kAuto;  // likewise
  kernels::Lighting lighting = kernels::Lighting::kAuto;  // as SceneOptions has it
  std::string environment;                                // likewise
  JobProgress* progress = nullptr;                        // hears of loading, and may stop it (kFile)
};

class LoadedScene {
 public:
  /// Errors as SceneFile::find_scene, Scene::load and DeviceScene::upload, the file named.
  static Result<std::shared_ptr<LoadedScene>> load(SceneFile file, const LoadOptions& options);
  LoadedScene(const LoadedScene&) = delete;
  LoadedScene& operator=(const LoadedScene&) = delete;
  ~LoadedScene();

  const Scene& scene() const { return *scene_; }
  uint32_t threads() const { return threads_; }
  /// LoadOptions::lighting.
  kernels::Lighting lighting() const { return lighting_; }
  /// Which draws it; nothing: the CPU.
  const std::optional<Gpu>& gpu() const { return gpu_; }
  /// Why no GPU draws it, where DrawOn::kAuto looked for one: one line; else empty.
  const std::string& why_cpu() const { return why_cpu_; }
  /// Null where the CPU draws. Used with gpu_lock() held, but for its statistics.
  DeviceScene* device() const { return device_.get(); }
  bool is_streamed() const { return device_ != nullptr && device_->is_streamed(); }

  /// Thread-safe; errors as make_view().
  Result<kernels::View> view(const CameraOptions& options) const { return make_view(*scene_, options); }

  /// The GPUs' work of all scenes is asked for by one thread at a time: a thread that frees device memory or waits for
  /// a device would end the recording of another thread's frame (kernels/cuda/graph.h). Whoever holds the lock makes
  /// the scene's device current first; its end restores the device that the caller had.
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

  std::unique_ptr<Scene> scene_;
  uint32_t threads_ = 1;
  kernels::Lighting lighting_ = kernels::Lighting::kAuto;
  std::optional<Gpu> gpu_;
  std::string why_cpu_;
  std::unique_ptr<DeviceScene> device_;
};

}  // namespace scree::runtime
