#include "tools/view/session.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <new>
#include <utility>

#include "runtime/draw/loaded_scene.h"
#include "runtime/draw/shadow_map.h"
#include "runtime/scene/camera.h"
#include "runtime/threads/stopwatch.h"
#include "tools/common/load_scene.h"
#include "tools/common/process/sigbus.h"

namespace scree::tools::view {
namespace {

using runtime::Stopwatch;
using runtime::Vec3;

constexpr uint64_t kKeptSampleBytes = uint64_t{512} << 20;  // of the CPU's samples: 1920 x 1080 with 4 x 4 need half
constexpr uint64_t kMostDepths = uint64_t{1} << 20;         // per DepthMap: 4 MiB

/// The point in world space of a sample's centre, at a distance from the eye's plane.
Vec3 place_of(const kernels::View& view, double x, double y, double depth) {
  const double across = (2 * x / view.width - 1) * view.half_width;
  const double along = (1 - 2 * y / view.height) * view.half_height;
  Vec3 out;
  for (size_t i = 0; i < 3; ++i)
    out[i] = view.eye[i] + depth * (view.forward[i] + across * view.right[i] + along * view.up[i]);
  return out;
}

/// The bits of kernels::View::omitted. Throws std::bad_alloc.
std::vector<uint32_t> omitted_bits(const runtime::Scene& scene, const Visibility& wanted) {
  const auto nodes = scene.container().nodes();
  std::vector<bool> hidden(nodes.size(), false), shown(nodes.size(), wanted.only.empty());
  for (const uint32_t node : wanted.hidden)
    if (node < nodes.size()) hidden[node] = true;
  for (const uint32_t node : wanted.only)
    if (node < nodes.size()) shown[node] = true;
  for (uint64_t n = 0; n < nodes.size(); ++n) {  // parents come before their children
    const uint32_t parent = nodes[n].parent;
    if (parent == format::kNone) continue;
    hidden[n] = hidden[n] || hidden[parent];
    shown[n] = shown[n] || shown[parent];
  }
  const kernels::SceneView& view = scene.view();
  std::vector<uint32_t> bits((view.instance_count + 31) / 32, 0);
  for (uint64_t i = 0; i < view.instance_count; ++i) {
    const uint32_t node = view.instances[i].node;
    if (hidden[node] || !shown[node]) bits[i / 32] |= 1u << (i % 32);
  }
  return bits;
}

/// Everything that determines a visibility buffer.
struct BufferKey {
  Camera camera;
  uint32_t width = 0;
  uint32_t height = 0;
  uint32_t samples = 0;
  Visibility visibility;
  std::optional<runtime::WorldBox> clip_box;
  bool operator==(const BufferKey&) const = default;
};

/// A picture and its visibility buffer.
struct Picture {
  std::optional<runtime::DeviceView> device;  // unset: the CPU drew it
  std::optional<BufferKey> key;               // unset: there is no picture
  kernels::View view{};                       // in samples
  uint32_t samples_per_side = 1;
  kernels::FrameStats stats{};
  kernels::BlendCounts blended;
  uint64_t left_bytes = 0;  // of chunks that are missing in the picture
  double buffer_ms = 0;     // the time of drawing it
};

std::string string_of(const format::Container& container, uint32_t offset) {
  return std::string(container.string(offset));
}

}  // namespace

std::optional<double> DepthMap::depth(Pixel at) const {
  const uint64_t place = uint64_t{at.y / step_} * across_ + at.x / step_;
  if (codes_.empty() || at.x / step_ >= across_ || place >= codes_.size()) return std::nullopt;
  const double depth = kernels::depth_of_code(view_, codes_[place]);
  return std::isfinite(depth) ? std::optional(depth) : std::nullopt;
}

std::optional<Vec3> DepthMap::point(Pixel at) const {
  const std::optional<double> distance = depth(at);
  if (!distance) return std::nullopt;
  const double middle = samples_ / 2 + 0.5;  // the sample that was kept
  return place_of(view_, at.x / step_ * step_ * samples_ + middle, at.y / step_ * step_ * samples_ + middle, *distance);
}

struct ViewSession::Impl {
  explicit Impl(SessionOptions session_options) : options(std::move(session_options)), workers(options.threads) {}

  SessionOptions options;
  const uint32_t shadow_side = options.light.shadow_side != 0 ? options.light.shadow_side : runtime::kShadowSide;
  std::shared_ptr<runtime::LoadedScene> loaded;
  std::optional<runtime::ShadowMap> shadows;  // of all pictures; none where the scene has no sun to show
  std::string drawn_on;
  runtime::Workers workers;
  // For the last picture that did not show all nodes:
  Visibility visibility;
  std::vector<uint32_t> omitted;
  const uint32_t* omitted_on_device = nullptr;  // null: not uploaded yet

  // Pictures of single viewers. On a GPU each has its own visibility hints of clusters, so that the cameras of other
  // viewers do not spoil them.
  std::map<uint32_t, Picture> own;
  uint64_t most_own = 0;
  Picture shared;
  Picture* last = &shared;
  // Samples of a picture, the CPU's or read back from the GPU:
  std::vector<uint64_t> samples;
  const Picture* sampled = nullptr;  // null: there are none
  std::vector<uint8_t> pixels;
  std::vector<uint32_t> device_pixels;

  const runtime::Scene& scene() const { return loaded->scene(); }
  runtime::DeviceScene* device() const { return loaded->device(); }

  /// Begins to draw on the device of the loaded scene(). `each`: device memory of another view.
  Result<void> begin(uint64_t each) {
    drawn_on = name_of_device(*loaded);
    if (can_cast_shadows(scene())) shadows.emplace(scene(), device());
    if (device() == nullptr) return {};
    shared.device = SCREE_TRY(device()->add_view(scene()));
    // Without --device-memory, the device's free memory is the limit.
    const uint64_t taken = std::min(device()->stats().device_bytes, options.device_memory);
    most_own = options.device_memory == 0 ? UINT64_MAX : (options.device_memory - taken) / each;
    return {};
  }

  bool can_cast_shadows(const runtime::Scene& of) const {
    return runtime::find_sun(of.view()).has_value() && options.light.lighting == kernels::Lighting::kScene;
  }

  void forget_pictures() {
    own.clear();
    shared = {};
    last = &shared;
    sampled = nullptr;
  }

  void forget(uint32_t viewer) {
    const auto found = own.find(viewer);
    if (found == own.end()) return;
    if (last == &found->second) last = &shared;
    if (sampled == &found->second) sampled = nullptr;
    own.erase(found);
  }

  /// Sets `last` to the picture that is drawn next: the viewer's own if there is room for one, else the shared one.
  /// Throws std::bad_alloc.
  void choose_picture(uint32_t viewer, uint32_t wanted_samples) {
    last = &shared;
    // Pictures of many samples per pixel would take too much memory for each viewer.
    if (device() == nullptr || viewer == 0 || wanted_samples != 1) return;
    auto found = own.find(viewer);
    if (found == own.end()) {
      if (own.size() >= most_own) return;
      Result<runtime::DeviceView> view = device()->add_view(scene());
      if (!view) {
        most_own = own.size();
        return;
      }
      found = own.try_emplace(viewer).first;
      found->second.device = std::move(*view);
    }
    last = &found->second;
  }

  /// Lets the CPU draw from now on.
  Result<void> use_cpu() {
    forget_pictures();
    if (shadows) shadows.emplace(scene(), nullptr);
    const Result<void> ready = loaded->use_cpu();
    drawn_on = name_of_device(*loaded);
    return ready;
  }

  bool may_fall_back(const Error& error) const {
    return error.code == ErrorCode::kDevice && device() != nullptr && options.backend.choice == BackendChoice::kAuto;
  }
  Result<void> fall_back(const Error& error) {
    if (!options.quiet) warn_of_cpu("view", drawn_on + ": " + error.message);
    return use_cpu();
  }

  /// Returns View::omitted for the next picture. Throws std::bad_alloc.
  Result<const uint32_t*> omit(const Visibility& wanted) {
    if (wanted.is_all()) return static_cast<const uint32_t*>(nullptr);
    if (wanted != visibility) {
      Visibility copy = wanted;
      omitted = omitted_bits(scene(), wanted);
      visibility = std::move(copy);
      omitted_on_device = nullptr;
      if (shadows) shadows->forget();
    }
    if (device() == nullptr) return static_cast<const uint32_t*>(omitted.data());
    if (omitted_on_device != nullptr) return omitted_on_device;
    const Result<const uint32_t*> brought = device()->set_omitted(omitted);
    if (brought) omitted_on_device = *brought;
    return brought;
  }

  /// The view of a picture of all nodes, in samples.
  Result<kernels::View> view_of(const BufferKey& wanted) const {
    runtime::CameraOptions camera;
    camera.eye = wanted.camera.eye;
    camera.target = wanted.camera.target;
    camera.up = wanted.camera.up;
    camera.fov_degrees = wanted.camera.fov_degrees;
    camera.clip_box = wanted.clip_box;
    camera.width = wanted.width;
    camera.height = wanted.height;
    kernels::View view = SCREE_TRY(loaded->view(camera));
    view.width *= wanted.samples;
    view.height *= wanted.samples;
    return view;
  }

  /// picture.view and samples_per_side are set.
  Result<void> draw_buffer(const BufferKey& wanted, const kernels::ShadeOptions& shade,
                           const runtime::IsOver& is_over) {
    Picture& picture = *last;
    const kernels::View& view = picture.view;
    picture.key.reset();
    picture.left_bytes = 0;
    if (sampled == last) sampled = nullptr;
    Result<kernels::FrameStats> drawn = kernels::FrameStats{};
    if (picture.device) {
      drawn = picture.device->draw(view, nullptr, &shade, is_over);
      if (const std::optional<runtime::StreamStats>& stream = picture.device->stream_stats(); drawn && stream)
        picture.left_bytes = stream->left_bytes;
    } else {
      samples.resize(uint64_t{view.width} * view.height);
      drawn = kernels::draw_cpu(scene().view(), view, samples, options.threads);
      if (drawn) sampled = last;
    }
    if (!drawn) return drawn.error();
    picture.stats = *drawn;
    if (picture.left_bytes == 0) picture.key = wanted;
    return {};
  }

  Result<PixelView> shade_buffer(const kernels::ShadeOptions& shade, bool reads_pixels) {
    Picture& picture = *last;
    const uint32_t side = picture.samples_per_side;
    PixelView out{.width = picture.view.width / side, .height = picture.view.height / side};
    const size_t count = size_t{out.width} * out.height;
    if (picture.device) {
      out.channels = 4;
      device_pixels.resize(reads_pixels ? count : 0);
      SCREE_TRY(picture.device->resolve(picture.view, side, shade, device_pixels));
      picture.blended = picture.device->blended();
      out.bytes = {reinterpret_cast<const uint8_t*>(device_pixels.data()), 4 * device_pixels.size()};
    } else {
      out.channels = 3;
      pixels.resize(3 * count);
      SCREE_TRY(kernels::resolve_cpu(scene().view(), picture.view, side, samples, shade, 3, pixels, options.threads,
                                     &picture.blended));
      out.bytes = pixels;
    }
    return out;
  }

  Result<Drawn> draw(const BufferKey& wanted, const kernels::ShadeOptions& shade, bool has_shadows,
                     const JpegKind* jpeg, const Patience& patience) {
    if (!patience.textures) return draw_now(wanted, shade, has_shadows, jpeg, patience);
    struct Pagers {
      std::vector<runtime::BlockPager*> all;
      ~Pagers() { set_patience({}); }
      void set_patience(const runtime::IsOver& is_over) const {
        for (runtime::BlockPager* const pager : all) pager->set_patience(is_over);
      }
    } const pagers{runtime::block_pagers(scene(), device())};
    pagers.set_patience(patience.textures);
    Result<Drawn> drawn = draw_now(wanted, shade, has_shadows, jpeg, patience);
    for (const runtime::BlockPager* const pager : pagers.all)
      if (drawn) drawn->left_bytes += pager->missing_bytes();
    return drawn;
  }

  Result<Drawn> draw_now(const BufferKey& wanted, kernels::ShadeOptions shade, bool has_shadows, const JpegKind* jpeg,
                         const Patience& patience) {
    Drawn out{.samples = wanted.samples};
    // A streamed frame keeps only the colours of a part, so other shading needs another frame.
    const bool is_streamed = loaded->is_streamed();
    Picture& picture = *last;
    const bool is_kept = picture.key == wanted && !is_streamed;
    kernels::View view = SCREE_TRY(is_kept ? picture.view : view_of(wanted));
    // Other pictures may have left out other nodes since a kept one was drawn.
    view.omitted = SCREE_TRY(omit(wanted.visibility));
    if (has_shadows && shadows && runtime::shows_sun(scene().view(), shade)) {
      shade.sun = SCREE_TRY(shadows->draw(view, shadow_side, options.threads,
                                          jpeg != nullptr ? runtime::ShadowFit::kMoving : runtime::ShadowFit::kExact,
                                          patience.shadows));
      out.shadow_ms = shadows->draw_time().wall_ms;
      out.left_bytes = shadows->left_bytes();
    }
    picture.view = view;
    picture.samples_per_side = wanted.samples;
    if (!is_kept) {
      const Stopwatch draw_watch;
      SCREE_TRY(draw_buffer(wanted, shade, patience.chunks));
      out.draw_ms = picture.buffer_ms = draw_watch.elapsed().wall_ms;
    }
    out.left_bytes += picture.left_bytes;
    out.buffer_ms = picture.buffer_ms;
    const Stopwatch shade_watch;
    const PixelView shaded = SCREE_TRY(shade_buffer(shade, jpeg == nullptr));
    out.shade_ms = shade_watch.elapsed().wall_ms;
    out.pixels = shaded;
    out.stats = picture.stats;
    out.blended = picture.blended;
    if (jpeg == nullptr) return out;
    const Stopwatch encode_watch;
    out.jpeg = SCREE_TRY(
        picture.device ? picture.device->encode_jpeg(out.pixels.width, out.pixels.height, jpeg->quality, jpeg->is_sharp)
                       : encode_jpeg(out.pixels, jpeg->quality, jpeg->is_sharp, workers));
    out.encode_ms = encode_watch.elapsed().wall_ms;
    return out;
  }

  Result<void> need_samples() {
    if (!last->key) return Error{ErrorCode::kUsage, "no picture was drawn"};
    if (sampled == last) return {};
    sampled = nullptr;
    samples.resize(uint64_t{last->view.width} * last->view.height);
    SCREE_TRY(last->device->read_samples(samples));
    sampled = last;
    return {};
  }
};

ViewSession::ViewSession(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ViewSession::ViewSession(ViewSession&&) noexcept = default;
ViewSession& ViewSession::operator=(ViewSession&&) noexcept = default;
ViewSession::~ViewSession() = default;

Result<ViewSession> ViewSession::open(const SessionOptions& options) {
  report_sigbus("view", options.file);
  runtime::SceneFile file = SCREE_TRY(runtime::SceneFile::open(options.file));
  ViewSession session(std::make_unique<Impl>(options));
  Impl& impl = *session.impl_;
  runtime::LoadOptions load = load_options(options, options.textures);
  load.scene = options.scene;
  load.lighting = options.light.lighting;
  load.environment = options.light.environment;
  const kernels::ShadeOptions shade{.ssao = true, .edl = true};
  load.pictures = {.width = 3840, .height = 2160, .shade = &shade, .is_encoded = true};
  load.comes_later = true;
  uint64_t each = 0;
  load.accept = [&](const runtime::Scene& scene, runtime::LoadOptions& upload) {
    each = runtime::DeviceScene::view_bytes(scene, upload.pictures);
    if (impl.can_cast_shadows(scene)) upload.pictures.shadow_side = impl.shadow_side;
    return accept_scene("view", scene, options.light, options.quiet);
  };
  impl.loaded = SCREE_TRY(load_scene("view", std::move(file), options.backend, std::move(load), options.quiet));
  Result<void> begun = impl.begin(each);
  if (!begun && impl.may_fall_back(begun.error())) begun = impl.fall_back(begun.error());
  if (!begun) return at(options.file, begun.error());
  return Result<ViewSession>(std::move(session));
}

Result<Drawn> ViewSession::draw(uint32_t viewer, const PictureRequest& request, uint32_t width, uint32_t height,
                                uint32_t samples, const Visibility& visibility, const JpegKind* jpeg,
                                const Patience& patience) try {
  BufferKey wanted{request.camera, width, height, samples, visibility, request.clip_box};
  kernels::ShadeOptions shade = request.shade;
  shade.lighting = impl_->options.light.lighting;
  shade.exposure = impl_->options.light.exposure;
  shade.blend_layers = impl_->options.light.blend_layers;
  impl_->choose_picture(viewer, samples);
  Result<Drawn> drawn = impl_->draw(wanted, shade, request.shadows, jpeg, patience);
  if (!drawn && drawn.error().code == ErrorCode::kDevice && impl_->last != &impl_->shared) {
    // There may be no memory for a picture of this viewer's own.
    impl_->most_own = impl_->own.size() - 1;
    impl_->forget(viewer);
    drawn = impl_->draw(wanted, shade, request.shadows, jpeg, patience);
  }
  if (drawn) {
    SCREE_TRY(check_unchanged(impl_->scene().file().map()));
    return drawn;
  }
  if (!impl_->may_fall_back(drawn.error())) return drawn;
  SCREE_TRY(impl_->fall_back(drawn.error()));
  return impl_->draw(wanted, shade, request.shadows, jpeg, patience);
} catch (const std::bad_alloc&) {
  impl_->last->key.reset();
  return Error{ErrorCode::kMemory,
               "no memory left for a picture of " + std::to_string(width) + " x " + std::to_string(height) + " pixels"};
}

void ViewSession::shrink() {
  Impl& impl = *impl_;
  if (impl.samples.capacity() * sizeof impl.samples[0] <= kKeptSampleBytes) return;
  impl.samples = {};
  impl.pixels = {};
  impl.sampled = nullptr;
  if (!impl.shared.device) impl.shared.key.reset();
  for (auto& [viewer, picture] : impl.own)
    if (!picture.device) picture.key.reset();
}

void ViewSession::forget(uint32_t viewer) {
  impl_->forget(viewer);
}

Result<uint64_t> ViewSession::load_rest(const runtime::IsOver& is_over) {
  if (impl_->device() == nullptr) return uint64_t{0};
  const Result<uint64_t> left = impl_->device()->load_rest(is_over);
  if (left && *left == 0) {
    impl_->shared.key.reset();
    if (impl_->shadows) impl_->shadows->forget();
    for (auto& [viewer, picture] : impl_->own) picture.key.reset();
  }
  if (left || !impl_->may_fall_back(left.error())) return left;
  SCREE_TRY(impl_->fall_back(left.error()));
  return uint64_t{0};
}

bool ViewSession::can_cast_shadows(std::string* why) const {
  const bool can = impl_->can_cast_shadows(impl_->scene());
  if (why != nullptr)
    *why = can                                        ? ""
           : runtime::find_sun(impl_->scene().view()) ? "Needs scree view --light scene"
                                                      : "The scene has no directional light";
  return can;
}

Result<DepthMap> ViewSession::depths() try {
  SCREE_TRY(impl_->need_samples());
  const kernels::View& view = impl_->last->view;
  DepthMap map;
  map.view_ = view;
  map.samples_ = impl_->last->samples_per_side;
  const uint32_t width = view.width / map.samples_, height = view.height / map.samples_;
  while (uint64_t{width / map.step_} * (height / map.step_) > kMostDepths) ++map.step_;
  map.across_ = (width + map.step_ - 1) / map.step_;
  map.codes_.reserve(uint64_t{map.across_} * ((height + map.step_ - 1) / map.step_));
  for (uint64_t y = 0; y < height; y += map.step_)
    for (uint64_t x = 0; x < width; x += map.step_)
      map.codes_.push_back(kernels::sample_depth_code(
          impl_->samples[(y * map.samples_ + map.samples_ / 2) * view.width + x * map.samples_ + map.samples_ / 2]));
  return map;
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left for the picture's depths"};
}

std::optional<Vec3> ViewSession::point(Pixel at) const {
  const uint32_t side = impl_->last->samples_per_side;
  const kernels::View& view = impl_->last->view;
  const uint64_t column = uint64_t{at.x} * side + side / 2, row = uint64_t{at.y} * side + side / 2;
  if (impl_->sampled != impl_->last || column >= view.width || row >= view.height) return std::nullopt;
  const uint64_t sample = impl_->samples[row * view.width + column];
  if (sample == kernels::kBackground) return std::nullopt;
  return place_of(view, static_cast<double>(column) + 0.5, static_cast<double>(row) + 0.5,
                  kernels::depth_of_code(view, kernels::sample_depth_code(sample)));
}

Result<std::optional<Picked>> ViewSession::pick(Pixel at) try {
  SCREE_TRY(impl_->need_samples());
  const uint32_t side = impl_->last->samples_per_side;
  const kernels::View& view = impl_->last->view;
  const uint64_t column = uint64_t{at.x} * side + side / 2, row = uint64_t{at.y} * side + side / 2;
  if (column >= view.width || row >= view.height) return std::optional<Picked>();
  const uint64_t sample = impl_->samples[row * view.width + column];
  if (sample == kernels::kBackground) return std::optional<Picked>();
  const kernels::SceneView& scene = impl_->scene().view();
  const format::Container& container = impl_->scene().container();
  const kernels::Hit hit = kernels::find_triangle(scene, kernels::sample_id(sample));
  const format::InstanceRecord& instance = scene.instances[hit.instance];
  const format::MeshRecord& mesh = scene.meshes[instance.mesh];
  Picked out;
  out.node = instance.node;
  out.node_instance = instance.node_instance;
  out.instance = hit.instance;
  out.mesh = instance.mesh;
  out.triangle = scene.chunks[hit.chunk].first_triangle + hit.triangle;
  out.material = mesh.material;
  out.node_name = string_of(container, container.nodes()[instance.node].name);
  out.mesh_name = string_of(container, container.groups()[mesh.group].name);
  if (mesh.material != format::kNone) out.material_name = string_of(container, scene.materials[mesh.material].name);
  out.depth = kernels::depth_of_code(view, kernels::sample_depth_code(sample));
  out.point = *point(at);
  const format::MatrixRecord& matrix = scene.matrices[instance.matrix];
  for (size_t k = 0; k < 8; ++k) {
    for (size_t i = 0; i < 3; ++i) {
      out.box[k][i] = matrix.rows[i][3];
      for (size_t axis = 0; axis < 3; ++axis)
        out.box[k][i] += matrix.rows[i][axis] *
                         static_cast<double>((k >> axis & 1) != 0 ? mesh.bounds_max[axis] : mesh.bounds_min[axis]);
    }
  }
  return std::optional<Picked>(std::move(out));
} catch (const std::bad_alloc&) {
  return Error{ErrorCode::kMemory, "no memory left to pick"};
}

Result<Camera> ViewSession::home(uint32_t width, uint32_t height) const {
  const runtime::CameraOptions options{.width = width, .height = height};
  const kernels::View view = SCREE_TRY(impl_->loaded->view(options));
  // The target is the point of the line of sight that is nearest to the middle of the scene's box.
  const runtime::WorldBox bounds = box();
  double distance = 1;
  if (!bounds.is_empty()) {
    distance = 0;
    for (size_t i = 0; i < 3; ++i) distance += (0.5 * (bounds.min[i] + bounds.max[i]) - view.eye[i]) * view.forward[i];
    if (!(distance > 0)) distance = 1;
  }
  Camera camera;
  for (size_t i = 0; i < 3; ++i) {
    camera.eye[i] = view.eye[i];
    camera.target[i] = view.eye[i] + distance * view.forward[i];
  }
  return camera;
}

std::vector<NamedCamera> ViewSession::cameras() const {
  const format::Container& container = impl_->scene().container();
  std::vector<NamedCamera> out;
  for (const runtime::PlacedCamera& placed : runtime::placed_cameras(container, impl_->scene().scene_index())) {
    const format::CameraRecord& record = container.cameras()[placed.camera];
    if (record.kind != format::CameraKind::kPerspective || out.size() == 200) continue;
    NamedCamera named;
    named.name = string_of(container, record.name);
    if (named.name.empty()) named.name = string_of(container, container.nodes()[placed.node].name);
    if (named.name.empty()) named.name = "camera " + std::to_string(placed.camera);
    double forward = 0;
    for (size_t i = 0; i < 3; ++i) forward += placed.world[i][2] * placed.world[i][2];
    if (!(forward > 0) || !std::isfinite(forward)) continue;
    // The target is as far away as the middle of the scene.
    const runtime::WorldBox bounds = box();
    double distance = 0;
    for (size_t i = 0; i < 3 && !bounds.is_empty(); ++i) {
      const double offset = 0.5 * (bounds.min[i] + bounds.max[i]) - placed.world[i][3];
      distance += offset * offset;
    }
    distance = distance > 0 ? std::sqrt(distance) : 1;
    for (size_t i = 0; i < 3; ++i) {
      named.camera.eye[i] = placed.world[i][3];
      named.camera.target[i] = placed.world[i][3] - distance * placed.world[i][2] / std::sqrt(forward);
      named.camera.up[i] = placed.world[i][1];
    }
    named.camera.fov_degrees = std::clamp(record.y * 180 / 3.14159265358979323846, 0.001, 179.9);
    out.push_back(std::move(named));
  }
  return out;
}

runtime::WorldBox ViewSession::box() const {
  return impl_->scene().box();
}
const runtime::Scene& ViewSession::scene() const {
  return impl_->scene();
}
const std::string& ViewSession::drawn_on() const {
  return impl_->drawn_on;
}
uint64_t ViewSession::device_bytes() const {
  return impl_->device() != nullptr ? impl_->device()->stats().device_bytes : 0;
}
runtime::Workers& ViewSession::workers() {
  return impl_->workers;
}

}  // namespace scree::tools::view
