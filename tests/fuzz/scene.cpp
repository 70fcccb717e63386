// A .scree file as read by render, on the CPU: any content gives a picture or an error.
#include "runtime/scene/scene.h"

#include "runtime/scene/camera.h"
#include "tests/fuzz/input.h"
#include "tests/runtime/frame.h"

namespace scree::fuzz {
namespace {

void draw(const runtime::Scene& scene, const runtime::CameraOptions& camera) {
  const auto view = runtime::make_view(scene, camera);
  if (!view) return;
  const auto frame = tests::Frame::draw(scene, *view, 1, 1);
  if (!frame) return;
  kernels::ShadeOptions shade;
  const bool is_shaded = bool(frame->shade(shade, 1));
  must(is_shaded || scene.block_pager() != nullptr, "a frame that was drawn is shaded, if its textures are there");
  for (const runtime::Layer layer : {runtime::Layer::kDepth, runtime::Layer::kNormal, runtime::Layer::kUv})
    (void)frame->layer<float>(layer, 1);
  for (uint32_t x = 0; x < camera.width; x += 7) (void)frame->pick(x, camera.height / 2);
}

}  // namespace

void scene(Bytes bytes) {
  auto file = runtime::SceneFile::open(Folder::write("in.scree", bytes));
  if (!file) return;
  const auto chosen = file->find_scene("");
  if (!chosen) return;
  // A few bytes can cause a lot of drawing, which takes time and tests nothing.
  const format::SceneRecord& record = file->container().scenes()[*chosen];
  if (record.triangle_count > 200000 || record.instance_count > 20000) return;
  for (uint64_t i = 0; i < file->container().images().size(); ++i) {
    const format::ImageRecord& image = file->container().images()[i];
    if (uint64_t{image.width} * image.height > 1024 * 1024 && bytes.size() > 16384) return;
  }
  runtime::SceneOptions options;
  options.texture_cache = options.texture_memory = 65536;
  const auto loaded = runtime::Scene::load(std::move(*file), *chosen, options);
  if (!loaded) return;
  runtime::CameraOptions camera{.width = 40, .height = 24};
  draw(*loaded, camera);
  for (const runtime::PlacedCamera& placed : runtime::placed_cameras(loaded->container(), *chosen)) {
    camera.camera = std::to_string(placed.camera);
    draw(*loaded, camera);
    break;
  }
}

}  // namespace scree::fuzz
