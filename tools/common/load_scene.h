// Loads the scene of a command that draws.
#pragma once

#include <memory>

#include "format/result.h"
#include "runtime/draw/loaded_scene.h"
#include "tools/common/options/backend.h"
#include "tools/common/options/draw_options.h"

namespace scree::tools {

/// The part of LoadOptions that the options of all these commands determine.
runtime::LoadOptions load_options(const DeviceOptions& device, const TextureOptions& textures);

/// Loads a scene on the device that `backend` chooses. If the CPU draws instead of a GPU, one line on stderr gives the
/// reason, unless `quiet`. Sets load.on and load.gpu. Errors as LoadedScene::load(), with a hint at --backend cpu.
Result<std::shared_ptr<runtime::LoadedScene>> load_scene(const char* command, runtime::SceneFile file,
                                                         const BackendOptions& backend, runtime::LoadOptions load,
                                                         bool quiet);

/// "cuda:0 (NVIDIA H200)", "the CPU, 16 threads".
std::string name_of_device(const runtime::LoadedScene& scene);

}  // namespace scree::tools
