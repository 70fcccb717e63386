// scree render: draws a packed scene.
#include <cstdio>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "runtime/draw/device_scene.h"
#include "runtime/draw/view_renderer.h"
#include "runtime/images/image.h"
#include "runtime/scene/scene.h"
#include "runtime/threads/stopwatch.h"
#include "tools/common/load_scene.h"
#include "tools/common/options/command.h"
#include "tools/common/options/options.h"
#include "tools/common/output/json_writer.h"
#include "tools/common/output/output_file.h"
#include "tools/common/output/standard_output.h"
#include "tools/common/output/text_table.h"
#include "tools/common/process/ranks.h"
#include "tools/common/process/sigbus.h"
#include "tools/render/exr.h"
#include "tools/render/layers.h"
#include "tools/render/outputs.h"
#include "tools/render/render_options.h"
#include "tools/render/render_path.h"
#include "tools/render/render_ranks.h"

namespace scree::tools {
namespace {

using runtime::Duration;
using runtime::Stopwatch;

std::string milliseconds(double ms) {
  char text[32];
  std::snprintf(text, sizeof text, ms < 100 ? "%.1f ms" : "%.0f ms", ms);
  return text;
}

/// "41.2 ms (80.3 ms of processor time)".
std::string both_times(const Duration& time) {
  return milliseconds(time.wall_ms) + " (" + milliseconds(time.cpu_ms) + " of processor time)";
}

void list_cameras(const runtime::SceneFile& file, uint32_t scene) {
  const format::Container& container = file.container();
  const std::vector<runtime::PlacedCamera> cameras = runtime::placed_cameras(container, scene);
  for (const runtime::PlacedCamera& placed : cameras) {
    const format::CameraRecord& camera = container.cameras()[placed.camera];
    const std::string place = "camera " + number_and_name(placed.camera, container.string(camera.name)) + " at node " +
                              number_and_name(placed.node, container.string(container.nodes()[placed.node].name));
    if (camera.kind == format::CameraKind::kOrthographic) {
      std::printf("%s: orthographic, %g x %g units, from %g to %g\n", place.c_str(), 2 * camera.x, 2 * camera.y,
                  camera.z_near, camera.z_far);
    } else {
      std::printf("%s: perspective, %g degrees high, from %g\n", place.c_str(), camera.y * 180 / 3.14159265358979323846,
                  camera.z_near);
    }
  }
  if (cameras.empty()) std::printf("scene %u has no cameras\n", scene);
}

struct Times {
  Duration open;
  std::optional<runtime::UploadStats> upload;
  std::optional<runtime::StreamStats> streamed;
  std::optional<kernels::TextureCacheCounts> looked;  // of a GPU's JPEG textures
  uint64_t texel_page_bytes = 0;                      // of all texture pages
  uint64_t texel_room_bytes = 0;                      // room for these pages where they are sampled, of all GPUs
  runtime::PagerStats texel_pages;                    // of the texture pages in the picture
  kernels::BlendCounts blended;
  std::optional<Duration> shadows;  // of drawing the shadow map
  Duration shade;
  Duration write;
  std::string drawn_on;  // "cuda:0 (NVIDIA H200)", "the CPU, 16 threads"
};

void print_stream(const runtime::StreamStats& stream, const Duration& draw) {
  // The rate of a PCIe 5 x16 link.
  constexpr double kLinkGbPerS = 55;
  const double gb_per_s = static_cast<double>(stream.streamed_bytes) * 1e-6 / draw.wall_ms;
  std::printf(
      "stream: %s: %llu chunks of %s in the view, %s missing, %s of it hidden, %s streamed in %llu batches, %s of it "
      "reassembled by the GPU, %s visible in the end, %s moved in device memory; %.2f GB/s, %.0f%% of %.0f; finding "
      "chunks took %s, choosing %s, "
      "starting and waiting for %llu parts %s, waiting for loads %s; drawing took %s and copying %s at the same time\n",
      milliseconds(draw.wall_ms).c_str(), static_cast<unsigned long long>(stream.seen_chunks),
      format_bytes(stream.seen_bytes).c_str(), format_bytes(stream.missing_bytes).c_str(),
      format_bytes(stream.hidden_bytes).c_str(), format_bytes(stream.streamed_bytes).c_str(),
      static_cast<unsigned long long>(stream.batches), format_bytes(stream.joined_bytes).c_str(),
      format_bytes(stream.needed_bytes).c_str(), format_bytes(stream.moved_bytes).c_str(), gb_per_s,
      gb_per_s / kLinkGbPerS * 100, kLinkGbPerS, milliseconds(stream.list_ms).c_str(),
      milliseconds(stream.choose_ms).c_str(), static_cast<unsigned long long>(stream.parts),
      milliseconds(stream.draw_ms).c_str(), milliseconds(stream.load_ms).c_str(),
      milliseconds(stream.drawing_ms).c_str(), milliseconds(stream.copying_ms).c_str());
}

void print_stats(const runtime::Scene& scene, const runtime::ViewRenderer& frame, const kernels::View& view,
                 const Times& times) {
  const runtime::LoadStats& load = scene.stats();
  const kernels::FrameStats& drawn = frame.stats();
  std::printf("open: %s\n", both_times(times.open).c_str());
  std::printf("geometry: %llu pages, %s in the file, %s decompressed, %s\n",
              static_cast<unsigned long long>(load.pages), format_bytes(load.stored_bytes).c_str(),
              format_bytes(load.decoded_bytes).c_str(), both_times(load.geometry).c_str());
  if (times.upload) {
    const runtime::UploadCounts& counts = times.upload->counts;
    std::printf(
        "upload: %llu pages, %s in the file, %s read past the page cache, %s decompressed, %s copied, %s of device "
        "memory taken, %s, "
        "%.2f GB/s\n",
        static_cast<unsigned long long>(counts.pages), format_bytes(counts.stored_bytes).c_str(),
        format_bytes(counts.direct_bytes).c_str(), format_bytes(counts.unpacked_bytes).c_str(),
        format_bytes(counts.copied_bytes).c_str(), format_bytes(times.upload->device_bytes).c_str(),
        milliseconds(times.upload->upload_ms).c_str(), times.upload->gb_per_s());
  }
  if (times.streamed) print_stream(*times.streamed, frame.draw_time());
  std::printf("textures: %llu images, %s with levels, %s\n", static_cast<unsigned long long>(load.images),
              format_bytes(load.texture_bytes).c_str(), both_times(load.textures).c_str());
  if (times.looked)
    std::printf("JPEG levels: %s, %llu groups decoded in %llu rounds, %llu tiles decoded individually\n",
                format_bytes(load.jpeg_bytes).c_str(), static_cast<unsigned long long>(times.looked->decoded),
                static_cast<unsigned long long>(times.looked->rounds),
                static_cast<unsigned long long>(times.looked->tiles));
  else if (const kernels::JpegGroupCache* blocks = scene.jpeg_group_cache())
    std::printf("JPEG levels: %s, %llu groups decoded into a cache of %s\n", format_bytes(load.jpeg_bytes).c_str(),
                static_cast<unsigned long long>(blocks->decoded()), format_bytes(blocks->bytes()).c_str());
  if (times.texel_page_bytes != 0)
    std::printf(
        "pages of textures: %s in all, room for %s, %llu read (%llu past the page cache), %s unpacked, %s in the "
        "file\n",
        format_bytes(times.texel_page_bytes).c_str(), format_bytes(times.texel_room_bytes).c_str(),
        static_cast<unsigned long long>(times.texel_pages.read_pages),
        static_cast<unsigned long long>(times.texel_pages.direct_pages),
        format_bytes(times.texel_pages.read_bytes).c_str(), format_bytes(times.texel_pages.stored_bytes).c_str());
  std::printf("view: eye %.9g,%.9g,%.9g forward %.6f,%.6f,%.6f up %.6f,%.6f,%.6f near %g\n", view.eye[0], view.eye[1],
              view.eye[2], view.forward[0], view.forward[1], view.forward[2], view.up[0], view.up[1], view.up[2],
              view.z_near);
  std::printf(
      "draws: %llu%s instances, %llu draws, %llu triangles: %llu small, %llu medium, %llu large, %llu clipped\n",
      static_cast<unsigned long long>(drawn.instances_drawn),
      times.streamed ? "" : (" of " + std::to_string(scene.view().instance_count)).c_str(),  // once per part
      static_cast<unsigned long long>(drawn.draws), static_cast<unsigned long long>(drawn.triangles),
      static_cast<unsigned long long>(drawn.triangles_small), static_cast<unsigned long long>(drawn.triangles_medium),
      static_cast<unsigned long long>(drawn.triangles_large), static_cast<unsigned long long>(drawn.triangles_clipped));
  if (drawn.clusters_drawn != 0 || drawn.clusters_tested != 0) {
    std::printf("clusters: %llu groups and %llu clusters tested, %llu drawn\n",
                static_cast<unsigned long long>(drawn.groups_tested),
                static_cast<unsigned long long>(drawn.clusters_tested),
                static_cast<unsigned long long>(drawn.clusters_drawn));
  }
  if (scene.view().blend_masks != nullptr)
    std::printf("blended surfaces: %u layers, %llu samples with more\n", times.blended.layers,
                static_cast<unsigned long long>(times.blended.samples_left_out));
  if (times.shadows) std::printf("shadows: %s\n", both_times(*times.shadows).c_str());
  std::printf("draw: %s\nshade: %s\nwrite: %s\n", both_times(frame.draw_time()).c_str(),
              both_times(times.shade).c_str(), both_times(times.write).c_str());
}

double loading_ms(const runtime::Scene& scene, const Times& times) {
  const runtime::LoadStats& load = scene.stats();
  return times.open.wall_ms + load.geometry.wall_ms + load.textures.wall_ms +
         (times.upload ? times.upload->upload_ms : 0);
}

/// Prints one line: the scene, the times and the files.
void print_summary(const RenderOptions& options, const runtime::Scene& scene, const runtime::ViewRenderer& frame,
                   const Times& times) {
  std::string places;
  for (const auto& [name, path] : options.outputs())
    if (!path.empty()) places += (places.empty() ? "" : ", ") + path;
  if (places.empty()) return;  // picks only
  const uint64_t triangles = scene.view().instance_base[scene.view().instance_count];
  std::string size = std::to_string(frame.width()) + " x " + std::to_string(frame.height());
  if (options.samples_per_side > 1)
    size += " (" + std::to_string(options.samples_per_side * options.samples_per_side) + " samples per pixel)";
  std::printf("%s: %s triangles at %s in %s on %s (shading %s, loading %s) -> %s\n", options.file.c_str(),
              format_count(static_cast<double>(triangles)).c_str(), size.c_str(),
              milliseconds(frame.draw_time().wall_ms).c_str(), times.drawn_on.c_str(),
              milliseconds(times.shade.wall_ms).c_str(), milliseconds(loading_ms(scene, times)).c_str(),
              places.c_str());
}

/// Prints the same, the counts and the picks as one JSON object.
void print_json(const RenderOptions& options, const runtime::Scene& scene, const runtime::ViewRenderer& frame,
                const Times& times, std::span<const FoundPick> picks) {
  const std::string text = json_object([&](JsonWriter& json) {
    json.member("file", options.file);
    for (const auto& [name, path] : options.outputs())
      if (!path.empty()) json.member(name, path);
    json.member("width", frame.width());
    json.member("height", frame.height());
    json.member("samples_per_side", options.samples_per_side);
    json.member("device", times.drawn_on);
    json.member("triangles", scene.view().instance_base[scene.view().instance_count]);
    json.member("instances_drawn", frame.stats().instances_drawn);
    json.member("draws", frame.stats().draws);
    json.member("triangles_drawn", frame.stats().triangles);
    json.member("clusters_drawn", frame.stats().clusters_drawn);
    json.member("blended_layers", uint64_t{times.blended.layers});
    json.member("samples_with_more_layers", times.blended.samples_left_out);
    json.member("load_ms", loading_ms(scene, times));
    if (times.shadows) json.member("shadow_ms", times.shadows->wall_ms);
    json.member("draw_ms", frame.draw_time().wall_ms);
    json.member("shade_ms", times.shade.wall_ms);
    json.member("write_ms", times.write.wall_ms);
    if (times.streamed) json.member("streamed_bytes", times.streamed->streamed_bytes);
    write_picks(json, scene.container(), picks);
  });
  std::printf("%s\n", text.c_str());
}

/// Whether a GPU's samples are copied to the host.
bool reads_samples(const RenderOptions& options) {
  return !options.visbuffer.empty() || !options.picks.empty() || layers_need_samples(options);
}

/// Host memory for the pictures: samples, depths, and shaded pixels. 0 if there is no limit.
uint64_t host_picture_bytes(const RenderOptions& options, const runtime::Scene& scene, bool on_gpu) {
  if (options.host_memory == 0) return 0;
  const uint64_t pixels = uint64_t{options.camera.width} * options.camera.height;
  const uint64_t samples = pixels * options.samples_per_side * options.samples_per_side;
  const bool reads = reads_samples(options);
  uint64_t bytes = 0;
  if (!on_gpu || reads) bytes += samples * sizeof(uint64_t);
  if (!options.output.empty()) bytes += pixels * sizeof(uint32_t);
  bytes += layer_bytes(options);
  if (!on_gpu) bytes += uint64_t{options.light.shadow_side} * options.light.shadow_side * sizeof(uint64_t);
  if (!options.output.empty() && !on_gpu && (options.shade.ssao || options.shade.edl))
    bytes += 3 * pixels * sizeof(float);
  constexpr uint64_t kLayerBytes = 48;  // kernels::blend_cpu()
  if (!options.output.empty() && kernels::shows_layers(scene.view(), options.shade)) {
    if (!on_gpu) bytes += kLayerBytes * samples;
    if (on_gpu && options.writes_exr()) bytes += 4 * samples * sizeof(float);
  }
  return bytes;
}

/// Error kMemory: --host-memory is not larger than the pictures. It does not name the file.
Result<void> check_host_memory(const RenderOptions& options, uint64_t needs) {
  if (options.host_memory == 0 || needs < options.host_memory) return {};
  return Error{ErrorCode::kMemory, "the picture takes " + std::to_string(needs) +
                                       " bytes of host memory, but --host-memory allows " +
                                       std::to_string(options.host_memory)};
}

/// Draws the frames of `view`, and makes the requested outputs of the last one, which are valid as long as `renderer`.
/// Every call that may fail on a GPU is in here. Errors do not name the file.
Result<FrameOutputs> draw(const RenderOptions& options, const kernels::View& view, runtime::ViewRenderer& renderer,
                          Times& times) {
  using runtime::Layer;
  const bool makes_picture = !options.output.empty() && !options.writes_exr();
  std::optional<Layer> colors;
  if (makes_picture) colors = Layer::kColor;
  if (options.writes_exr() && options.layers.color) colors = Layer::kLinear;
  renderer.cast_shadows(options.light.shadow_side);
  if (options.light.shadow_side != 0) times.shadows.emplace();
  for (uint32_t i = 0; i < options.frames; ++i) {
    if (i != 0 && options.stats && renderer.stream_stats())
      print_stream(*renderer.stream_stats(), renderer.draw_time());
    SCREE_TRY(renderer.draw(view, options.samples_per_side, options.shade, colors));
    if (renderer.shadow_time().wall_ms != 0) times.shadows = renderer.shadow_time();  // later frames keep the map
  }
  FrameOutputs outputs;
  if (reads_samples(options)) {
    const auto samples = SCREE_TRY(renderer.layer(Layer::kSamples));
    outputs.samples = {reinterpret_cast<const uint64_t*>(samples.data()), samples.size() / sizeof(uint64_t)};
  }
  const Stopwatch watch;
  const runtime::LoadedScene& loaded = renderer.scene();
  Result<FrameLayers> layers = make_layers(
      options, loaded.scene(), [&](Layer layer, std::span<std::byte> out) { return renderer.read(layer, out); },
      loaded.is_streamed());
  if (!layers) return layers.error();
  outputs.layers = std::move(*layers);
  if (makes_picture) outputs.rgba = SCREE_TRY(renderer.layer(Layer::kColor));
  if (!options.output.empty()) times.shade = watch.elapsed();
  times.blended = renderer.blended();
  runtime::DeviceScene* const device = loaded.device();
  for (const runtime::BlockPager* const pager : runtime::block_pagers(loaded.scene(), device)) {
    times.texel_page_bytes = pager->all_bytes();
    times.texel_room_bytes += pager->room_bytes();
    times.texel_pages += pager->stats();
  }
  times.drawn_on = name_of_device(loaded);
  if (device == nullptr) return outputs;
  times.upload = device->stats();
  times.streamed = renderer.stream_stats();
  times.looked = SCREE_TRY(device->texture_counts());
  return outputs;
}

Result<void> render(const RenderOptions& options) {
  Ranks ranks = SCREE_TRY(Ranks::join());
  if (options.list_cameras && !ranks.is_first()) {
    ranks.leave();
    return {};
  }
  if (ranks.count() > 1 && !options.list_cameras) return render_ranks(options, ranks);
  for (const auto& [name, path] : options.outputs()) SCREE_TRY(check_output_file(path, options.existing));
  if (options.writes_exr()) SCREE_TRY_AT(options.output, check_exr_support());
  Times times;
  const Stopwatch open_watch;
  report_sigbus("render", options.file);
  runtime::SceneFile file = SCREE_TRY(runtime::SceneFile::open(options.file));
  const uint32_t scene_index = SCREE_TRY(file.find_scene(options.scene));
  if (options.list_cameras) {
    list_cameras(file, scene_index);
    ranks.leave();
    return check_unchanged(file.map());
  }
  times.open = open_watch.elapsed();

  kernels::View view;
  runtime::LoadOptions load = options.load_options();
  load.accept = [&](const runtime::Scene& scene, runtime::LoadOptions& upload) -> Result<void> {
    SCREE_TRY(accept_scene("render", scene, options.light, options.quiet));
    view = SCREE_TRY_AT(options.file, runtime::make_view(scene, options.camera));
    const uint64_t needs = host_picture_bytes(options, scene, upload.on != runtime::DrawOn::kCpu);
    upload.host_memory = options.host_memory - needs;
    const Result<void> fits = check_host_memory(options, needs);
    return fits ? fits : at(options.file, fits.error());
  };
  const auto opened = SCREE_TRY(load_scene("render", std::move(file), options.backend, std::move(load), options.quiet));
  runtime::LoadedScene& loaded = *opened;
  const runtime::Scene& scene = loaded.scene();
  std::unique_ptr<runtime::ViewRenderer> renderer;
  const auto draw_frame = [&]() -> Result<FrameOutputs> {
    if (!loaded.gpu()) SCREE_TRY(check_host_memory(options, host_picture_bytes(options, scene, false)));
    renderer = SCREE_TRY(runtime::ViewRenderer::create(opened));
    return draw(options, view, *renderer, times);
  };
  Result<FrameOutputs> outputs = draw_frame();
  if (!outputs && outputs.error().code == ErrorCode::kDevice && loaded.gpu() &&
      options.backend.choice == BackendChoice::kAuto) {
    // The CPU draws the same picture.
    if (!options.quiet) warn_of_cpu("render", name_of(*loaded.gpu()) + ": " + outputs.error().message);
    renderer.reset();
    times.upload.reset();
    times.streamed.reset();
    SCREE_TRY(loaded.use_cpu());
    outputs = draw_frame();
  }
  if (!outputs) return at(options.file, with_cpu_advice(outputs.error()));
  const runtime::ViewRenderer& frame = *renderer;
  times.write = SCREE_TRY(write_outputs(options, scene.file().map(), *outputs));
  const std::vector<FoundPick> picks = SCREE_TRY(find_picks(options, scene, frame.view(), outputs->samples));
  if (!options.json) print_picks(scene.container(), picks);
  if (!options.quiet)
    warn_of_layers("render", options.file, times.blended.samples_left_out, "sample", times.blended.layers);
  if (options.stats) print_stats(scene, frame, view, times);
  if (options.json) {
    print_json(options, scene, frame, times, picks);
  } else if (!options.quiet) {
    print_summary(options, scene, frame, times);
  }
  return {};
}

Result<void> run(const RenderWords& words) {
  const RenderOptions options = SCREE_TRY(parse_render_options(words));
  SCREE_TRY(options.path ? render_path(options) : render(options));
  return finish_output();
}

}  // namespace

void add_camera_options(CLI::App& app, RenderWords& words) {
  add_value(app, "--scene", "NAME", words.scene, "Scene of the file, by name or number (default: the file's default)");
  add_value(app, "--camera", "NAME", words.camera, "Camera of the file, by name, node name or number");
  add_value(app, "--view", "NAME", words.view,
            "Show the whole scene from front, right, back, left, top, bottom or iso (default: from 30 degrees to the "
            "right of the front and 20 degrees above it)");
  add_value(app, "--eye", "X,Y,Z", words.eye, "Position of the camera, X,Y,Z");
  add_value(app, "--target", "X,Y,Z", words.target, "Point that --eye looks at, X,Y,Z (default: middle of the scene)");
  add_value(app, "--up", "X,Y,Z", words.up, "Up direction in the picture, X,Y,Z (default: 0,1,0)");
  add_value(app, "--fov", "DEGREES", words.fov, "Vertical field of view in degrees (default: 45, or the camera's)");
}

Command add_render(CLI::App& parent) {
  const auto words = std::make_shared<RenderWords>();
  CLI::App* app = parent.add_subcommand("render", "Draws a packed scene");
  app->add_option("file", words->file, "The scene: a .scree file")->required();
  add_value(*app, "-o,--output", "FILE", words->output,
            "The picture to write, a .png, or an .exr of all --layers (default: a .png beside the file)");
  add_value(
      *app, "--layers", "NAMES", words->layers,
      "Layers of an .exr: color: R, G, B, A, linear and premultiplied; depth: Z; normal: N.X, N.Y, N.Z; uv: UV.U, "
      "UV.V; id: id.instance, id.mesh, id.material, id.triangle of the mesh, 4294967295 if there is none (default: "
      "color,depth,normal,uv,id)");
  app->add_flag("--float", words->float_color, "Colours of an .exr with 32 bits instead of 16");
  add_picture_options(*app, *words);
  add_camera_options(*app, *words);
  add_value(*app, "--clip-box", "X0,Y0,Z0,X1,Y1,Z1", words->clip_box,
            "Draw only the part of the scene in the box X0,Y0,Z0,X1,Y1,Z1: its smallest coordinates, then its largest, "
            "in the scene's units");
  app->add_flag("--list-cameras", words->list_cameras, "List the scene's cameras and draw nothing");
  add_value(*app, "--show", "NAME", words->show,
            "The kind of picture: texture (default), color (without textures), uv, normal, triangle, cluster, mesh, "
            "stage (of the rasteriser) or depth");
  app->add_flag("--no-light", words->no_light, "No light: surface colours only");
  add_light_options(*app, words->light);
  app->add_flag("--ssao", words->ssao, "Ambient occlusion: darkens corners and surfaces close behind others");
  app->add_flag("--edl", words->edl, "Eye-dome lighting: darkens pixels whose neighbours are nearer");
  add_value(*app, "--edl-strength", "N", words->edl_strength,
            "Strength of the darkening by --edl, 0 to 100 (default: 1)");
  add_value(*app, "--edl-radius", "N", words->edl_radius,
            "Distance of the neighbours for --edl in pixels, 1 to 64 (default: 1)");
  add_value(*app, "--background", "COLOR", words->background,
            "Colour of the background: #rgb, #rrggbb, #rrggbbaa, a name such as black or skyblue, or transparent "
            "(default: #9aa4b0)");
  add_value(
      *app, "--depth", "FILE", words->depth,
      "Write the depth image, a .pfm: distances from the eye's plane in the scene's units, inf on the background");
  add_value(*app, "--normals", "FILE", words->normals,
            "Write the normals, a .pfm of three floats per pixel: of unit length, in world space, of the front side "
            "even where the back is visible, 0 on the background");
  add_value(*app, "--uvs", "FILE", words->uvs,
            "Write the texture coordinates, a .pfm of three floats per pixel: u, v as stored in the mesh, and 0");
  add_value(*app, "--visbuffer", "FILE", words->visbuffer,
            "Write the visibility buffer: one little-endian 64-bit word per sample, top row first, 28 bits of "
            "depth code above 36 of triangle id, all ones on the background");
  add_repeated(*app, "--pick", "X,Y", words->picks,
               "Print the object under pixel X,Y (may be repeated); without -o no picture is written");
  add_device_options(*app, *words);
  add_reading_options(*app, *words);
  add_value(*app, "--path", "FILE", words->path,
            "Draw the frames of a camera's path, a JSON file as scree view saves it (docs/scale.md); outputs are "
            "then patterns, such as -o frame_%05d.png");
  add_value(*app, "--frames", "FRAMES", words->frames,
            "With --path, the frames to draw: FIRST:END, such as 0:600 for frames 0 to 599; I/N, every N-th frame, "
            "beginning with the I-th; or both, such as 0:600,1/8 (default: all). Without --path: draw this many frames "
            "of a still camera and write the last one (default: 1); --stats then prints the streaming of each frame");
  add_value(*app, "--fps", "N", words->fps, "Frames per second of a path (default: the file's, else 30)");
  app->add_flag(
      "--resume", words->resume,
      "With --path: leave out frames whose files exist, complete and of this size, even if another run wrote them");
  add_value(*app, "--share", "NAME", words->share,
            "With --path, how ranks under mpirun share the work: frames (default): each frame is drawn by one rank; "
            "geometry: all ranks draw every frame, each with a part of the scene, for a scene that is too large for "
            "one rank");
  add_value(*app, "--exchange", "NAME", words->exchange,
            "How ranks under mpirun exchange pictures (docs/scale.md): nccl, from GPU to GPU; mpi, through host "
            "memory; or auto (default): nccl for 16 frames or more, if its library is found and each rank has a "
            "GPU of its own");
  add_texture_options(*app, words->textures);
  app->add_flag("-f,--force", words->force, kForceHelp);
  app->add_flag("--stats", words->stats, "Print counts and times of every step");
  app->add_flag("--json", words->json, "Print one JSON object instead of the closing line and the lines of --pick");
  app->add_flag("-q,--quiet", words->quiet, "No closing line and no warnings");
  return {app, [words] { return run(*words); }};
}

}  // namespace scree::tools
