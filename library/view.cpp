// Views: cameras, frames and their layers.
#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "library/handles.h"
#include "library/layers.h"
#include "library/structs.h"

namespace scree::library {
namespace {

using kernels::View;
using runtime::Layer;
using runtime::ViewRenderer;

bool are_finite(std::initializer_list<const double*> vectors) {
  return std::all_of(vectors.begin(), vectors.end(),
                     [](const double* v) { return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]); });
}

runtime::Vec3 vector_of(const double (&v)[3]) {
  return {v[0], v[1], v[2]};
}

/// An error of drawing, which may be one of the scene's file.
scree_status fail_draw(const ViewRenderer& renderer, const Error& error) {
  return fail(at(renderer.scene().scene().file().path(), error), Subject::kArguments);
}

/// Translates the camera for the engine, without its clipping box.
scree_status make_whole_view(const runtime::LoadedScene& scene, const scree_camera& camera, uint32_t width,
                             uint32_t height, View& out) {
  SCREE_CHECK(check_value(camera.kind, SCREE_CAMERA_AROUND, "scree_camera::kind"));
  runtime::CameraOptions options{.width = width, .height = height};
  if (camera.fov_degrees != 0) {
    if (!(camera.fov_degrees >= runtime::kSmallestFovDegrees && camera.fov_degrees < 180))
      return fail(SCREE_ERROR_ARGUMENT, "scree_camera::fov_degrees is " + std::to_string(camera.fov_degrees) +
                                            ", expected an angle of at least 1e-9 and below 180");
    options.fov_degrees = camera.fov_degrees;
  }
  if (camera.kind != SCREE_CAMERA_MATRICES && !are_finite({camera.eye, camera.target, camera.up}))
    return fail(SCREE_ERROR_ARGUMENT, "scree_camera: eye, target or up is not finite");
  if (camera.up[0] != 0 || camera.up[1] != 0 || camera.up[2] != 0) options.up = vector_of(camera.up);
  Result<View> view = View{};
  switch (camera.kind) {
    case SCREE_CAMERA_DEFAULT:
      break;
    case SCREE_CAMERA_NAMED:
      if (camera.name == nullptr || *camera.name == 0)
        return fail(SCREE_ERROR_ARGUMENT, "scree_camera::name is missing");
      options.camera = camera.name;
      options.up.reset();
      break;
    case SCREE_CAMERA_LOOK_AT:
      options.eye = vector_of(camera.eye);
      if (camera.look_at_box == 0) options.target = vector_of(camera.target);
      break;
    case SCREE_CAMERA_MATRICES: {
      if (!std::isfinite(camera.z_near)) return fail(SCREE_ERROR_ARGUMENT, "scree_camera::z_near is not finite");
      runtime::CameraMatrices matrices;
      std::copy_n(camera.view, 16, matrices.view.begin());
      std::copy_n(camera.projection, 16, matrices.projection.begin());
      matrices.z_near = camera.z_near;
      view = runtime::view_of_matrices(matrices, width, height);
      if (!view) return fail(view.error(), Subject::kArguments);
      out = *view;
      return SCREE_OK;
    }
    case SCREE_CAMERA_AROUND:
      if (!std::isfinite(camera.turn_degrees) || !(std::abs(camera.rise_degrees) <= 90))
        return fail(SCREE_ERROR_ARGUMENT, "scree_camera: turn_degrees is not finite, or rise_degrees not -90 to 90");
      options.turn_degrees = camera.turn_degrees;
      options.rise_degrees = camera.rise_degrees;
      break;
    case SCREE_CAMERA_32_BITS:
      break;
  }
  view = scene.view(options);
  if (!view) return fail(view.error(), Subject::kArguments);
  out = *view;
  return SCREE_OK;
}

/// Translates the camera for the engine, for a picture of `width` x `height` pixels.
scree_status make_view(const runtime::LoadedScene& scene, const scree_camera& camera, uint32_t width, uint32_t height,
                       View& out) {
  SCREE_CHECK(make_whole_view(scene, camera, width, height, out));
  if (camera.clips == 0) return SCREE_OK;
  bool is_box = are_finite({camera.clip_min, camera.clip_max});
  for (size_t i = 0; i < 3; ++i) is_box = is_box && camera.clip_min[i] <= camera.clip_max[i];
  if (!is_box)
    return fail(SCREE_ERROR_ARGUMENT,
                "scree_camera: clip_min and clip_max are not the smallest and the largest corner");
  out.clips = true;
  std::copy_n(camera.clip_min, 3, out.clip_min);
  std::copy_n(camera.clip_max, 3, out.clip_max);
  return SCREE_OK;
}

/// Checks and translates the light of a picture and its blended layers.
scree_status take_light(const runtime::LoadedScene& scene, const scree_draw_options& options,
                        kernels::ShadeOptions& shade) {
  SCREE_CHECK(check_value(options.light, SCREE_LIGHT_SCENE, "scree_draw_options::light"));
  if (options.light != SCREE_LIGHT_AUTO && (options.flags & SCREE_NO_LIGHT) != 0)
    return fail(SCREE_ERROR_ARGUMENT, "scree_draw_options: light and SCREE_NO_LIGHT exclude each other");
  if (options.light == SCREE_LIGHT_ENVIRONMENT && scene.scene().view().environment == nullptr)
    return fail(SCREE_ERROR_ARGUMENT,
                "scree_draw_options::light: the scene was loaded without an environment (scree_load_options::light)");
  if (options.light == SCREE_LIGHT_SCENE && scene.scene().view().light_count == 0)
    return fail(SCREE_ERROR_ARGUMENT, "scree_draw_options::light: the scene has no lights");
  if (!(std::abs(options.exposure) <= 20))
    return fail(SCREE_ERROR_ARGUMENT,
                "scree_draw_options::exposure is " + std::to_string(options.exposure) + ", expected -20 to 20 stops");
  if (options.blend_layers > UINT16_MAX)
    return fail(SCREE_ERROR_ARGUMENT,
                "scree_draw_options::blend_layers is " + std::to_string(options.blend_layers) + ", at most 65535");
  shade.lighting = options.light == SCREE_LIGHT_AUTO ? scene.lighting() : static_cast<kernels::Lighting>(options.light);
  shade.exposure = static_cast<float>(std::exp2(options.exposure));
  if (options.blend_layers != 0) shade.blend_layers = options.blend_layers;
  if ((options.flags & SCREE_NO_BLEND) != 0) shade.blend_layers = 0;
  if (options.shadow_size != 0 &&
      (options.shadow_size < runtime::kLeastShadowSide || options.shadow_size > kernels::kMaxImageSide))
    return fail(SCREE_ERROR_ARGUMENT, "scree_draw_options::shadow_size is " + std::to_string(options.shadow_size) +
                                          ", expected " + std::to_string(runtime::kLeastShadowSide) + " to " +
                                          std::to_string(kernels::kMaxImageSide));
  if ((options.flags & SCREE_SHADOWS) == 0) return SCREE_OK;
  if (shade.lighting != kernels::Lighting::kScene)
    return fail(SCREE_ERROR_ARGUMENT, "scree_draw_options::flags: SCREE_SHADOWS is for SCREE_LIGHT_SCENE");
  if (!runtime::find_sun(scene.scene().view()))
    return fail(SCREE_ERROR_ARGUMENT, "scree_draw_options::flags: SCREE_SHADOWS: the scene has no directional light");
  return SCREE_OK;
}

/// The side of the shadow map, as ViewRenderer::cast_shadows() takes it. `options`: checked by take_light().
uint32_t shadow_side(const scree_draw_options& options) {
  if ((options.flags & SCREE_SHADOWS) == 0) return 0;
  return options.shadow_size != 0 ? static_cast<uint32_t>(options.shadow_size) : runtime::kShadowSide;
}

scree_status take_shade(const runtime::LoadedScene& scene, const scree_draw_options& options,
                        kernels::ShadeOptions& shade) {
  SCREE_CHECK(check_value(options.show, SCREE_SHOW_DEPTH, "scree_draw_options::show"));
  if ((options.flags & ~uint32_t{SCREE_NO_LIGHT | SCREE_SSAO | SCREE_EDL | SCREE_NO_BLEND | SCREE_SHADOWS}) != 0)
    return fail(SCREE_ERROR_ARGUMENT, "scree_draw_options::flags has unknown flags: " + std::to_string(options.flags));
  if (!(options.edl_strength >= 0 && options.edl_strength <= 100))
    return fail(SCREE_ERROR_ARGUMENT,
                "scree_draw_options::edl_strength is " + std::to_string(options.edl_strength) + ", expected 0 to 100");
  if (options.edl_radius > 64)
    return fail(SCREE_ERROR_ARGUMENT,
                "scree_draw_options::edl_radius is " + std::to_string(options.edl_radius) + ", at most 64");
  shade.show = static_cast<kernels::Show>(options.show);
  shade.light = (options.flags & SCREE_NO_LIGHT) == 0;
  shade.ssao = (options.flags & SCREE_SSAO) != 0;
  shade.edl = (options.flags & SCREE_EDL) != 0;
  if (options.edl_strength > 0) shade.edl_strength = options.edl_strength;
  if (options.edl_radius > 0) shade.edl_radius = options.edl_radius;
  for (size_t i = 0; i < 4; ++i) {
    if (!std::isfinite(options.background[i]))
      return fail(SCREE_ERROR_ARGUMENT, "scree_draw_options::background is not finite");
    shade.background[i] = options.background[i];
  }
  return take_light(scene, options, shade);
}

/// Checks and translates the size, the samples and the shading of a frame.
scree_status take_frame(const runtime::LoadedScene& scene, const scree_draw_options* options, scree_draw_options& taken,
                        kernels::ShadeOptions& shade) {
  SCREE_CHECK(take(options, taken, "scree_draw_options"));
  if (taken.width == 0) taken.width = 1920;
  if (taken.height == 0) taken.height = 1080;
  if (taken.samples == 0) taken.samples = 1;
  if (taken.samples != 1 && taken.samples != 2 && taken.samples != 4)
    return fail(SCREE_ERROR_ARGUMENT,
                "scree_draw_options::samples is " + std::to_string(taken.samples) + ", expected 1, 2 or 4");
  const uint64_t side = uint64_t{std::max(taken.width, taken.height)} * taken.samples;
  if (side > kernels::kMaxImageSide)
    return fail(SCREE_ERROR_ARGUMENT, "the frame has " + std::to_string(side) + " samples per side, at most " +
                                          std::to_string(kernels::kMaxImageSide));
  return take_shade(scene, taken, shade);
}

/// Whether the scene has more instances than the instance layer, with ids of 32 bits, can number.
bool has_too_many_instances(const runtime::LoadedScene& scene) {
  return scene.scene().view().instance_count > uint64_t{1} << 31;
}

scree_status fail_of_instances() {
  return fail(SCREE_ERROR_DATA, "the scene has more instances than 32-bit ids can number");
}

/// The translated arguments of a batch.
struct Batch {
  std::vector<View> views;
  uint32_t samples;  // per side of a pixel
  uint64_t pixels;   // of one picture
  kernels::ShadeOptions shade;
};

/// Checks and translates the arguments of a batch, and calls body(renderer, batch).
template <class Body>
scree_status with_batch(scree_view* view, const scree_camera* cameras, uint32_t count,
                        const scree_draw_options* options, const Body& body) {
  return with<Views>(view, "scree_view", [&](DrawnView& drawn) {
    if (cameras == nullptr) return fail(SCREE_ERROR_ARGUMENT, "the batch's cameras are null");
    const std::lock_guard<std::mutex> lock(drawn.mutex);
    const runtime::LoadedScene& scene = drawn.renderer->scene();
    scree_draw_options taken;
    Batch batch;
    SCREE_CHECK(take_frame(scene, options, taken, batch.shade));
    batch.samples = taken.samples;
    batch.pixels = uint64_t{taken.width} * taken.height;
    batch.views.resize(count);
    const auto* next = reinterpret_cast<const std::byte*>(cameras);
    for (uint32_t i = 0; i < count; ++i, next += cameras->size) {
      const auto* const camera = reinterpret_cast<const scree_camera*>(next);
      scree_camera seen;
      SCREE_CHECK(take(camera, seen, "scree_camera"));
      if (camera->size != cameras->size)
        return fail(SCREE_ERROR_ARGUMENT, "camera " + std::to_string(i) + " of the batch has another size");
      if (const scree_status made = make_view(scene, seen, taken.width, taken.height, batch.views[i]); made != SCREE_OK)
        return fail(made, "camera " + std::to_string(i) + ": " + std::string(scree_error()));
    }
    drawn.renderer->cast_shadows(shadow_side(taken));
    return body(*drawn.renderer, batch);
  });
}

// The layers of the engine have the numbers of scree_layer.
static_assert(kLayerKinds.size() == runtime::kLayerCount);

/// For functions that read a layer: calls body(renderer, the engine's layer) if the view has a frame.
template <class Body>
scree_status with_layer(scree_view* view, scree_layer layer, const Body& body) {
  return with<Views>(view, "scree_view", [&](DrawnView& drawn) {
    if (static_cast<uint32_t>(layer) >= kLayerKinds.size())
      return fail(SCREE_ERROR_ARGUMENT, "no layer " + std::to_string(layer) + ", at most 7");
    const std::lock_guard<std::mutex> lock(drawn.mutex);
    ViewRenderer& renderer = *drawn.renderer;
    if (!renderer.has_frame())
      return fail(SCREE_ERROR_NO_FRAME, "the view has drawn nothing yet, or the last draw failed");
    if (layer == SCREE_INSTANCE && has_too_many_instances(renderer.scene())) return fail_of_instances();
    return body(renderer, static_cast<Layer>(layer));
  });
}

scree_array describe(const ViewRenderer& renderer, Layer layer, const std::byte* data, int32_t gpu) {
  scree_array array = array_of(static_cast<scree_layer>(layer), renderer.batch(), renderer.height(), renderer.width(),
                               renderer.samples_per_side());
  array.data = data;
  array.bytes = renderer.layer_bytes(layer);
  array.gpu = gpu;
  return array;
}

/// The point at `depth` on the ray through the middle sample of pixel (x, y), in world space.
void point_at(const ViewRenderer& renderer, uint32_t x, uint32_t y, double depth, double out[3]) {
  const View& view = renderer.view();
  const uint32_t side = renderer.samples_per_side();
  const double column = static_cast<double>(x * side + side / 2) + 0.5;
  const double row = static_cast<double>(y * side + side / 2) + 0.5;
  const double across = (2 * column / view.width - 1) * view.half_width * (view.orthographic ? 1 : depth);
  const double up = (1 - 2 * row / view.height) * view.half_height * (view.orthographic ? 1 : depth);
  for (int i = 0; i < 3; ++i) out[i] = view.eye[i] + depth * view.forward[i] + across * view.right[i] + up * view.up[i];
}

}  // namespace
}  // namespace scree::library

using namespace scree::library;

extern "C" {

scree_status scree_view_create(scree_scene* scene, scree_view** view) {
  return with<Scenes>(scene, "scree_scene", [&](const LoadedFile& loaded) {
    if (view == nullptr) return fail(SCREE_ERROR_ARGUMENT, "scree_view_create: view is null");
    scree::Result<std::unique_ptr<ViewRenderer>> renderer = ViewRenderer::create(loaded.scene);
    if (!renderer) return fail(renderer.error(), Subject::kArguments);
    auto made = std::make_shared<DrawnView>();
    made->renderer = std::move(*renderer);
    *view = Views::all().add(std::move(made));
    return SCREE_OK;
  });
}

scree_status scree_view_destroy(scree_view* view) {
  return end<Views>(view, "scree_view");
}

scree_status scree_draw(scree_view* view, const scree_camera* camera, const scree_draw_options* options) {
  return with<Views>(view, "scree_view", [&](DrawnView& drawn) {
    scree_camera seen;
    SCREE_CHECK(take(camera, seen, "scree_camera"));
    scree_draw_options taken;
    scree::kernels::ShadeOptions shade;
    SCREE_CHECK(take_frame(drawn.renderer->scene(), options, taken, shade));
    const std::lock_guard<std::mutex> lock(drawn.mutex);
    View seen_view{};
    SCREE_CHECK(make_view(drawn.renderer->scene(), seen, taken.width, taken.height, seen_view));
    drawn.renderer->cast_shadows(shadow_side(taken));
    const scree::Result<void> done = drawn.renderer->draw(seen_view, taken.samples, shade);
    return done ? SCREE_OK : fail_draw(*drawn.renderer, done.error());
  });
}

scree_status scree_draw_batch(scree_view* view, const scree_camera* cameras, uint32_t count,
                              const scree_draw_options* options, uint32_t layers) {
  return with_batch(view, cameras, count, options, [&](ViewRenderer& renderer, const Batch& batch) {
    if ((layers >> SCREE_INSTANCE & 1) != 0 && has_too_many_instances(renderer.scene())) return fail_of_instances();
    const scree::Result<void> done = renderer.draw_batch(batch.views, batch.samples, batch.shade, layers);
    return done ? SCREE_OK : fail_draw(renderer, done.error());
  });
}

scree_status scree_draw_batch_to(scree_view* view, const scree_camera* cameras, uint32_t count,
                                 const scree_draw_options* options, const scree_target* targets, uint32_t target_count,
                                 void* stream) {
  return with_batch(view, cameras, count, options, [&](ViewRenderer& renderer, const Batch& batch) {
    if (targets == nullptr || target_count == 0)
      return fail(SCREE_ERROR_ARGUMENT, "scree_draw_batch_to: targets is null, or there are none");
    ViewRenderer::BatchTargets taken{};
    const auto* next = reinterpret_cast<const std::byte*>(targets);
    for (uint32_t i = 0; i < target_count; ++i, next += targets->size) {
      scree_target target;
      const auto* const given = reinterpret_cast<const scree_target*>(next);
      SCREE_CHECK(take(given, target, "scree_target"));
      const std::string name = "target " + std::to_string(i);
      if (given->size != targets->size) return fail(SCREE_ERROR_ARGUMENT, name + " has another size");
      if (static_cast<uint32_t>(target.layer) >= taken.size() || target.layer == SCREE_SAMPLES)
        return fail(SCREE_ERROR_ARGUMENT, name + ": a batch has no layer " + std::to_string(target.layer));
      std::byte*& place = taken[target.layer];
      if (place != nullptr) return fail(SCREE_ERROR_ARGUMENT, name + " has the layer of another target");
      if (target.data == nullptr || reinterpret_cast<uintptr_t>(target.data) % 16 != 0)
        return fail(SCREE_ERROR_ARGUMENT, name + ": data is null, or does not begin at a multiple of 16 bytes");
      if (target.layer == SCREE_INSTANCE && has_too_many_instances(renderer.scene())) return fail_of_instances();
      const uint64_t bytes = scree::runtime::bytes_of(static_cast<Layer>(target.layer)) * count * batch.pixels;
      if (target.bytes != bytes)
        return fail(SCREE_ERROR_BUFFER, name + ": a buffer of " + std::to_string(target.bytes) +
                                            " bytes, but the layer has " + std::to_string(bytes));
      place = static_cast<std::byte*>(target.data);
    }
    const scree::Result<void> done = renderer.draw_batch_to(batch.views, batch.samples, batch.shade, taken, stream);
    return done ? SCREE_OK : fail_draw(renderer, done.error());
  });
}

scree_status scree_shade(scree_view* view, const scree_draw_options* options) {
  return with_layer(view, SCREE_COLOR, [&](ViewRenderer& renderer, Layer) {
    scree_draw_options taken;
    SCREE_CHECK(take(options, taken, "scree_draw_options"));
    scree::kernels::ShadeOptions shade;
    SCREE_CHECK(take_shade(renderer.scene(), taken, shade));
    renderer.cast_shadows(shadow_side(taken));
    const scree::Result<void> done = renderer.set_shade(shade);
    return done ? SCREE_OK : fail(done.error(), Subject::kArguments);
  });
}

scree_status scree_host_layer(scree_view* view, scree_layer layer, scree_array* array) {
  return with_layer(view, layer, [&](ViewRenderer& renderer, Layer engine_layer) {
    SCREE_CHECK(check_output(array, "scree_array"));
    const scree::Result<std::span<const std::byte>> bytes = renderer.layer(engine_layer);
    if (!bytes) return fail(bytes.error(), Subject::kArguments);
    give(array, describe(renderer, engine_layer, bytes->data(), -1));
    return SCREE_OK;
  });
}

scree_status scree_device_layer(scree_view* view, scree_layer layer, void* stream, scree_array* array) {
  return with_layer(view, layer, [&](ViewRenderer& renderer, Layer engine_layer) {
    SCREE_CHECK(check_output(array, "scree_array"));
    const scree::Result<const std::byte*> data = renderer.device_layer(engine_layer, stream);
    if (!data) return fail(data.error(), Subject::kArguments);
    give(array, describe(renderer, engine_layer, *data, renderer.scene().gpu()->index));
    return SCREE_OK;
  });
}

scree_status scree_hold(scree_view* view, const scree_array* array, scree_memory** memory) {
  return with<Views>(view, "scree_view", [&](DrawnView& drawn) {
    scree_array taken;
    if (array == nullptr || memory == nullptr) return fail(SCREE_ERROR_ARGUMENT, "scree_hold: array or memory is null");
    SCREE_CHECK(take(array, taken, "scree_array"));
    const std::lock_guard<std::mutex> lock(drawn.mutex);
    scree::Result<std::shared_ptr<const void>> held = drawn.renderer->hold(static_cast<const std::byte*>(taken.data));
    if (!held) return fail(held.error(), Subject::kArguments);
    *memory = Memories::all().add(std::make_shared<HeldMemory>(HeldMemory{std::move(*held)}));
    return SCREE_OK;
  });
}

scree_status scree_release(scree_memory* memory) {
  return end<Memories>(memory, "scree_memory");
}

scree_status scree_read(scree_view* view, scree_layer layer, void* buffer, uint64_t bytes) {
  return with_layer(view, layer, [&](ViewRenderer& renderer, Layer engine_layer) {
    if (buffer == nullptr) return fail(SCREE_ERROR_ARGUMENT, "scree_read: buffer is null");
    const uint64_t needed = renderer.layer_bytes(engine_layer);
    if (bytes != needed)
      return fail(SCREE_ERROR_BUFFER,
                  "a buffer of " + std::to_string(bytes) + " bytes, but the layer has " + std::to_string(needed));
    const scree::Result<void> done = renderer.read(engine_layer, {static_cast<std::byte*>(buffer), bytes});
    return done ? SCREE_OK : fail(done.error(), Subject::kArguments);
  });
}

scree_status scree_pick(scree_view* view, uint32_t x, uint32_t y, scree_pick_info* info) {
  return with_layer(view, SCREE_SAMPLES, [&](ViewRenderer& renderer, Layer) {
    SCREE_CHECK(check_output(info, "scree_pick_info"));
    const scree::Result<std::optional<scree::runtime::Pick>> pick = renderer.pick(x, y);
    if (!pick) return fail(pick.error(), Subject::kArguments);
    scree_pick_info out{};
    if (*pick) {
      const scree::runtime::Pick& found = **pick;
      out.hit = 1;
      out.mesh = found.mesh;
      out.node = found.node;
      out.node_instance = found.node_instance;
      out.instance = found.hit.instance;
      out.triangle = found.id;
      out.mesh_triangle = found.mesh_triangle;
      out.source_triangle = found.source_triangle ? static_cast<int64_t>(*found.source_triangle) : -1;
      out.depth = found.depth;
      point_at(renderer, x, y, found.depth, out.position);
    }
    give(info, out);
    return SCREE_OK;
  });
}

scree_status scree_get_frame_stats(scree_view* view, scree_frame_stats* stats) {
  return with_layer(view, SCREE_SAMPLES, [&](ViewRenderer& renderer, Layer) {
    SCREE_CHECK(check_output(stats, "scree_frame_stats"));
    scree_frame_stats out{};
    out.width = renderer.width();
    out.height = renderer.height();
    out.samples = renderer.samples_per_side();
    out.instances = renderer.stats().instances_drawn;
    out.triangles = renderer.stats().triangles;
    out.clusters = renderer.stats().clusters_drawn;
    out.draw_ms = renderer.draw_time().wall_ms;
    out.shadow_ms = renderer.shadow_time().wall_ms;
    out.gpu_ms = static_cast<double>(renderer.gpu_ms());
    out.cameras = renderer.batch();
    out.blended_layers = renderer.blended().layers;
    out.samples_with_more_layers = renderer.blended().samples_left_out;
    out.streamed_bytes = renderer.stream_stats() ? renderer.stream_stats()->streamed_bytes : 0;
    give(stats, out);
    return SCREE_OK;
  });
}

}  // extern "C"
