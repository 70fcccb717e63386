#include "tools/common/load_scene.h"

#include <optional>
#include <string>
#include <utility>

namespace scree::tools {

runtime::LoadOptions load_options(const DeviceOptions& device, const TextureOptions& textures) {
  runtime::LoadOptions load;
  load.gpus = device.backend.gpus;
  load.threads = device.threads;
  load.device_memory = device.device_memory;
  load.texture_cache = textures.cache;
  load.texture_memory = textures.memory;
  return load;
}

Result<std::shared_ptr<runtime::LoadedScene>> load_scene(const char* command, runtime::SceneFile file,
                                                         const BackendOptions& backend, runtime::LoadOptions load,
                                                         bool quiet) {
  const Result<std::optional<runtime::Gpu>> gpu = choose_gpu(command, backend, quiet);
  if (!gpu) return at(file.path(), with_cpu_advice(gpu.error()));
  load.gpu = backend.device;
  load.on = !gpu->has_value()                        ? runtime::DrawOn::kCpu
            : backend.choice == BackendChoice::kAuto ? runtime::DrawOn::kAuto
                                                     : runtime::DrawOn::kGpu;
  auto scene = runtime::LoadedScene::load(std::move(file), std::move(load));
  if (!scene) return with_cpu_advice(scene.error());
  if (const std::string& why = (*scene)->why_cpu(); !why.empty() && !quiet)
    warn_of_cpu(command, name_of(**gpu) + ": " + why);
  return scene;
}

std::string name_of_device(const runtime::LoadedScene& scene) {
  if (!scene.gpu()) return name_of_cpu(scene.threads());
  return name_of(*scene.gpu(), scene.device()->gpu_count());
}

}  // namespace scree::tools
