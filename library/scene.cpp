// Loads scenes.
#include <algorithm>
#include <string>
#include <thread>
#include <utility>

#include "library/handles.h"
#include "library/structs.h"

namespace scree::library {
namespace {

static_assert(SCREE_LIGHT_AUTO == static_cast<int>(kernels::Lighting::kAuto) &&
              SCREE_LIGHT_CAMERA == static_cast<int>(kernels::Lighting::kCamera) &&
              SCREE_LIGHT_ENVIRONMENT == static_cast<int>(kernels::Lighting::kEnvironment) &&
              SCREE_LIGHT_SCENE == static_cast<int>(kernels::Lighting::kScene));

/// Translates `options` for the engine, except for the progress.
scree_status translate(const scree_load_options& options, runtime::LoadOptions& out) {
  constexpr uint32_t kMostThreads = 4096;
  if (options.threads > kMostThreads)
    return fail(SCREE_ERROR_ARGUMENT, "scree_load_options::threads is " + std::to_string(options.threads) +
                                          ", at most " + std::to_string(kMostThreads));
  SCREE_CHECK(check_value(options.backend, SCREE_BACKEND_CUDA, "scree_load_options::backend"));
  switch (options.backend) {
    case SCREE_BACKEND_AUTO:
      out.on = options.gpu != nullptr || options.gpus > 1 ? runtime::DrawOn::kGpu : runtime::DrawOn::kAuto;
      break;
    case SCREE_BACKEND_CPU:
      if (options.gpu != nullptr || options.gpus > 1)
        return fail(SCREE_ERROR_ARGUMENT, "scree_load_options names GPUs, but the backend is the CPU");
      out.on = runtime::DrawOn::kCpu;
      break;
    case SCREE_BACKEND_CUDA:
      out.on = runtime::DrawOn::kGpu;
      break;
    case SCREE_BACKEND_32_BITS:
      break;
  }
  if (options.scene != nullptr) out.scene = options.scene;
  if (options.gpu != nullptr) out.gpu = options.gpu;
  if (!out.gpu.empty() && !runtime::names_gpu(out.gpu))
    return fail(SCREE_ERROR_ARGUMENT, "'" + out.gpu + "' is neither the index of a GPU nor its UUID, GPU-...");
  if (options.gpus > runtime::kMostGpus && options.gpus != SCREE_ALL_GPUS)
    return fail(SCREE_ERROR_ARGUMENT, "scree_load_options::gpus is " + std::to_string(options.gpus) + ", at most " +
                                          std::to_string(runtime::kMostGpus) + " or SCREE_ALL_GPUS");
  out.gpus = std::max(static_cast<uint32_t>(options.gpus), 1u);
  static_assert(SCREE_ALL_GPUS == runtime::kAllGpus);
  out.threads = options.threads != 0 ? options.threads : std::max(1u, std::thread::hardware_concurrency());
  out.textures = options.no_textures == 0;
  out.texture_cache = options.texture_cache;
  out.texture_memory = options.texture_memory;
  SCREE_CHECK(check_value(options.light, SCREE_LIGHT_SCENE, "scree_load_options::light"));
  out.lighting = static_cast<kernels::Lighting>(options.light);
  if (options.environment != nullptr && *options.environment != 0) {
    out.environment = options.environment;
    if (options.light != SCREE_LIGHT_AUTO && options.light != SCREE_LIGHT_ENVIRONMENT)
      return fail(SCREE_ERROR_ARGUMENT,
                  "scree_load_options::environment is for SCREE_LIGHT_ENVIRONMENT, but light is another");
    out.lighting = kernels::Lighting::kEnvironment;
  }
  SCREE_CHECK(check_value(options.reading, SCREE_READ_DIRECT, "scree_load_options::reading"));
  constexpr runtime::Reading kReadings[] = {runtime::Reading::kAuto, runtime::Reading::kMapped,
                                            runtime::Reading::kBuffered, runtime::Reading::kDirect};
  out.reading = kReadings[options.reading];
  out.device_memory = options.device_memory;
  out.host_memory = options.host_memory;
  out.pictures.width = options.max_width;
  out.pictures.height = options.max_height;
  if (options.max_samples > 4 || options.max_samples == 3)
    return fail(SCREE_ERROR_ARGUMENT,
                "scree_load_options::max_samples is " + std::to_string(options.max_samples) + ", expected 1, 2 or 4");
  out.pictures.samples_per_side = std::max(options.max_samples, 1u);
  const uint64_t side = uint64_t{std::max(options.max_width, options.max_height)} * out.pictures.samples_per_side;
  if (side > kernels::kMaxImageSide)
    return fail(SCREE_ERROR_ARGUMENT, "the largest frames have " + std::to_string(side) +
                                          " samples per side, at most " + std::to_string(kernels::kMaxImageSide));
  if (options.max_shadow_size > kernels::kMaxImageSide)
    return fail(SCREE_ERROR_ARGUMENT, "scree_load_options::max_shadow_size is " +
                                          std::to_string(options.max_shadow_size) + ", at most " +
                                          std::to_string(kernels::kMaxImageSide));
  out.pictures.shadow_side = static_cast<uint32_t>(options.max_shadow_size);
  return SCREE_OK;
}

}  // namespace
}  // namespace scree::library

using namespace scree::library;
namespace runtime = scree::runtime;

extern "C" {

scree_status scree_load(scree_file* file, const scree_load_options* options, scree_scene** scene) {
  return with<Files>(file, "scree_file", [&](const File& opened) {
    if (scene == nullptr) return fail(SCREE_ERROR_ARGUMENT, "scree_load: scene is null");
    scree_load_options taken;
    SCREE_CHECK(take(options, taken, "scree_load_options"));
    runtime::LoadOptions load;
    SCREE_CHECK(translate(taken, load));
    scree::kernels::ShadeOptions shade{.ssao = true};
    if (load.pictures.width != 0) load.pictures.shade = &shade;
    runtime::JobProgress progress([&](const char* stage, uint64_t done, uint64_t total) {
      return taken.progress(taken.user, stage, done, total) == 0;
    });
    if (taken.progress != nullptr) load.progress = &progress;
    const runtime::Stopwatch watch;
    scree::Result<std::shared_ptr<runtime::LoadedScene>> loaded = runtime::LoadedScene::load(opened.file, load);
    if (!loaded && progress.is_stopped()) return fail(SCREE_ERROR_CANCELLED, loaded.error().message);
    if (!loaded) return fail(loaded.error(), Subject::kData);
    const runtime::Scene& ready = (*loaded)->scene();
    if (load.lighting == scree::kernels::Lighting::kScene && ready.view().light_count == 0)
      return fail(SCREE_ERROR_ARGUMENT, ready.file().path() + ": scree_load_options::light: the scene has no lights");
    if (taken.warning != nullptr)
      for (const std::string& line : ready.warnings())
        taken.warning(taken.user, (ready.file().path() + ": " + line).c_str());
    *scene = Scenes::all().add(std::make_shared<LoadedFile>(LoadedFile{std::move(*loaded), watch.elapsed().wall_ms}));
    return SCREE_OK;
  });
}

scree_status scree_unload(scree_scene* scene) {
  return end<Scenes>(scene, "scree_scene");
}

scree_status scree_get_scene_stats(scree_scene* scene, scree_scene_stats* stats) {
  return with<Scenes>(scene, "scree_scene", [&](const LoadedFile& loaded) {
    SCREE_CHECK(check_output(stats, "scree_scene_stats"));
    const runtime::LoadedScene& ready = *loaded.scene;
    const scree::kernels::SceneView& view = ready.scene().view();
    scree_scene_stats out{};
    out.triangles = view.instance_base[view.instance_count];
    out.instances = view.instance_count;
    const runtime::WorldBox& box = ready.scene().box();
    std::copy(box.min.begin(), box.min.end(), out.box_min);
    std::copy(box.max.begin(), box.max.end(), out.box_max);
    out.on_gpu = ready.device() != nullptr;
    out.gpu = ready.gpu() ? ready.gpu()->index : -1;
    out.streamed = ready.is_streamed();
    out.scene = ready.scene().scene_index();
    out.device_bytes = ready.device() != nullptr ? ready.device()->stats().device_bytes : 0;
    out.load_ms = loaded.load_ms;
    out.gpu_name = ready.gpu() ? ready.gpu()->name.c_str() : "";
    out.why_cpu = ready.why_cpu().c_str();
    out.lights = view.light_count;
    out.light = static_cast<scree_light>(scree::kernels::lighting_of(view, {.lighting = ready.lighting()}));
    give(stats, out);
    return SCREE_OK;
  });
}

scree_status scree_get_instance_info(scree_scene* scene, uint64_t index, scree_instance_info* info) {
  return with<Scenes>(scene, "scree_scene", [&](const LoadedFile& loaded) {
    SCREE_CHECK(check_output(info, "scree_instance_info"));
    const scree::kernels::SceneView& view = loaded.scene->scene().view();
    if (index >= view.instance_count)
      return fail(SCREE_ERROR_ARGUMENT,
                  "no instance " + std::to_string(index) + ", there are " + std::to_string(view.instance_count));
    const scree::format::InstanceRecord& record = view.instances[index];
    const uint32_t material = view.meshes[record.mesh].material;
    scree_instance_info out{};
    out.mesh = record.mesh;
    out.node = record.node;
    out.node_instance = record.node_instance;
    out.material = material == scree::format::kNone ? -1 : static_cast<int32_t>(material);
    out.first_triangle = view.instance_base[index];
    std::copy_n(&view.matrices[record.matrix].rows[0][0], 12, out.world);
    give(info, out);
    return SCREE_OK;
  });
}

}  // extern "C"
