#include "tools/view/hub.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <type_traits>
#include <utility>

#include "tools/common/json_writer.h"
#include "tools/common/memory_use.h"

namespace scree::tools::view {
namespace {

using namespace std::chrono_literals;
using Milliseconds = std::chrono::duration<double, std::milli>;

// A picture at rest comes so long after the newest camera: at once would be in the way of the next of a movement.
constexpr auto kRestDelay = 60ms;         // the page says that it does not move
constexpr auto kMovingRestDelay = 160ms;  // it said that it moves, and has sent nothing since
// More samples keep the thread busy, and nothing can interrupt it: only where that is hardly noticed, or after a while.
constexpr double kQuickMs = 150;
constexpr double kPatientMs = 900;
constexpr auto kPatientDelay = 1200ms;
// A viewer at rest waits no longer for those who move.
constexpr auto kLongestWait = 3s;

double ms_between(Hub::Clock::time_point from, Hub::Clock::time_point to) {
  return Milliseconds(to - from).count();
}

template <class Numbers>
void write_numbers(JsonWriter& json, std::string_view name, const Numbers& numbers) {
  json.key(name);
  json.begin_array();
  for (const auto number : numbers) json.value(number);
  json.end_array();
}

void write_camera(JsonWriter& json, const Camera& camera) {
  write_numbers(json, "eye", camera.eye);
  write_numbers(json, "target", camera.target);
  write_numbers(json, "up", camera.up);
  json.member("fov", camera.fov_degrees);
}

std::string text_of_error(const std::string& message) {
  std::string text;
  JsonWriter json(text);
  json.begin_object();
  json.member("type", "error");
  json.member("message", std::string_view(message));
  json.end_object();
  return text;
}

/// u32, JSON, image: one message.
std::vector<std::byte> picture_message(const std::string& head, const std::vector<std::byte>& image) {
  std::vector<std::byte> out;
  out.reserve(4 + head.size() + image.size());
  for (int shift = 0; shift < 32; shift += 8) out.push_back(static_cast<std::byte>(head.size() >> shift));
  const auto* const text = reinterpret_cast<const std::byte*>(head.data());
  out.insert(out.end(), text, text + head.size());
  out.insert(out.end(), image.begin(), image.end());
  return out;
}

/// Ids have colours that a quarter of the colour resolution would smear.
bool has_sharp_colours(kernels::Show show) {
  return show == kernels::Show::kTriangle || show == kernels::Show::kCluster || show == kernels::Show::kMesh ||
         show == kernels::Show::kStage;
}

/// The most samples a side, up to `wanted`, that a picture of this size can have.
uint32_t possible_samples(uint32_t wanted, uint32_t width, uint32_t height) {
  while (wanted > 1 && uint64_t{wanted} * std::max(width, height) > kernels::kMaxImageSide) wanted /= 2;
  return wanted;
}

/// Whether two requests are answered by the same pixels: one with `is_moving` comes at the end of each movement.
bool is_same_picture(const PictureRequest& a, const PictureRequest& b) {
  const kernels::ShadeOptions &s = a.shade, &t = b.shade;
  return a.camera == b.camera && a.width == b.width && a.height == b.height && s.show == t.show && s.light == t.light &&
         std::equal(std::begin(s.background), std::end(s.background), std::begin(t.background)) && s.ssao == t.ssao &&
         s.edl == t.edl && s.edl_strength == t.edl_strength && s.edl_radius == t.edl_radius;
}

uint32_t scaled(uint32_t side, double scale) {
  return std::max(1u, static_cast<uint32_t>(std::lround(side * scale)));
}

/// Which picture it is, and for which view.
void write_place(JsonWriter& json, uint64_t frame, const PictureRequest& request) {
  json.member("frame", frame);
  json.member("seq", request.sequence);
  json.member("fullWidth", request.width);
  json.member("fullHeight", request.height);
}

/// What the head of a picture and of a screenshot have in common.
void write_head(JsonWriter& json, const Drawn& drawn, double encode_ms) {
  json.member("width", drawn.pixels.width);
  json.member("height", drawn.pixels.height);
  json.member("samples", drawn.samples);
  json.member("drawMs", drawn.draw_ms);
  json.member("shadeMs", drawn.shade_ms);
  json.member("encodeMs", encode_ms);
}

}  // namespace

Hub::Hub(SessionOptions options, std::function<void(Error)> on_end)
    : options_(std::move(options)), on_end_(std::move(on_end)), thread_([this] { run(); }) {}

Hub::~Hub() {
  stop(0ms);
  thread_.join();
}

bool Hub::stop(std::chrono::milliseconds patience) {
  std::unique_lock lock(mutex_);
  is_stopping_ = true;
  changed_.notify_all();
  return ended_.wait_for(lock, patience, [&] { return has_ended_; });
}

uint32_t Hub::join(std::shared_ptr<ViewerLink> link) {
  const std::lock_guard lock(mutex_);
  auto viewer = std::make_shared<Viewer>();
  viewer->number = ++last_number_;
  viewer->link = std::move(link);
  viewers_[viewer->number] = viewer;
  viewer->link->send_text(scene_text());
  tell_viewers();
  return viewer->number;
}

void Hub::leave(uint32_t number) {
  const std::lock_guard lock(mutex_);
  viewers_.erase(number);
  for (auto& [other, viewer] : viewers_)
    if (viewer->follows == number) viewer->follows = 0;
  tell_viewers();
}

void Hub::tell_viewers() const {
  for (const auto& [number, viewer] : viewers_) viewer->link->send_text(viewers_text(number));
}

std::string Hub::viewers_text(uint32_t viewer) const {
  std::string text;
  JsonWriter json(text);
  json.begin_object();
  json.member("type", "viewers");
  json.member("you", viewer);
  json.key("viewers");
  json.begin_array();
  for (const auto& [number, other] : viewers_) json.value(number);
  json.end_array();
  json.end_object();
  return text;
}

std::string Hub::scene_text() const {
  if (is_ready_) return R"({"type":"scene",)" + scene_members_ + "}";
  std::string text;
  JsonWriter json(text);
  json.begin_object();
  json.member("type", "loading");
  json.member("file", std::string_view(options_.file));
  json.end_object();
  return text;
}

void Hub::receive(uint32_t number, Message message) {
  const std::lock_guard lock(mutex_);
  const auto found = viewers_.find(number);
  if (found == viewers_.end()) return;
  Viewer& viewer = *found->second;
  const auto add_job = [&](Job job) {
    if (!is_ready_ || !viewer.wanted) return;  // there is nothing to look at yet
    if (viewer.jobs.size() >= kMaxJobs) return viewer.link->send_text(text_of_error("too many questions at once"));
    viewer.jobs.push_back(std::move(job));
  };
  std::visit(
      [&](auto& body) {
        using Body = std::decay_t<decltype(body)>;
        if constexpr (std::is_same_v<Body, PictureRequest>) {
          if (!viewer.wanted || !(viewer.wanted->camera == body.camera)) {
            std::string text;
            for (const auto& [other_number, other] : viewers_) {
              if (other->follows != number) continue;
              if (text.empty()) {
                JsonWriter json(text);
                json.begin_object();
                json.member("type", "camera");
                json.member("viewer", number);
                write_camera(json, body.camera);
                json.end_object();
              }
              other->link->send_text(text);
            }
          }
          // What was sent for a moment of movement is the moving picture of the rest as well.
          const bool is_drawn =
              viewer.wanted && viewer.drawn_version == viewer.version && is_same_picture(*viewer.wanted, body);
          viewer.wanted = std::move(body);
          viewer.wanted_at = Clock::now();
          ++viewer.version;
          if (is_drawn) viewer.drawn_version = viewer.version;
          viewer.exact_samples = 0;
        } else if constexpr (std::is_same_v<Body, Ack>) {
          const auto acknowledged = std::find_if(viewer.in_flight.begin(), viewer.in_flight.end(),
                                                 [&](const InFlight& sent) { return sent.frame == body.frame; });
          if (acknowledged == viewer.in_flight.end()) return;
          if (acknowledged->is_moving) {
            const Clock::time_point now = Clock::now();
            viewer.adaptation.note(acknowledged->level, ms_between(acknowledged->begun, now), ms_between({}, now));
          }
          viewer.in_flight.erase(viewer.in_flight.begin(), acknowledged + 1);  // pages show them in order
        } else if constexpr (std::is_same_v<Body, Probe>) {
          // Depths of another view would name a point that lies elsewhere by now.
          const bool is_current = viewer.wanted && viewer.depths_version == viewer.version;
          if (!is_current || body.at.x >= viewer.wanted->width || body.at.y >= viewer.wanted->height) return;
          std::string text;
          JsonWriter json(text);
          json.begin_object();
          json.member("type", "point");
          json.member("x", body.at.x);
          json.member("y", body.at.y);
          if (const auto point = viewer.depths.point(body.at)) write_numbers(json, "point", *point);
          json.end_object();
          viewer.link->send_text(std::move(text));
        } else if constexpr (std::is_same_v<Body, Visibility>) {
          if (body == viewer.visibility) return;
          viewer.visibility = std::move(body);
          ++viewer.version;
          viewer.exact_samples = 0;
          viewer.wanted_at = Clock::now();
        } else if constexpr (std::is_same_v<Body, Follow>) {
          const auto leader = viewers_.find(body.viewer);
          viewer.follows = leader == viewers_.end() || body.viewer == number ? 0 : body.viewer;
          if (viewer.follows == 0 || !leader->second->wanted) return;
          std::string text;
          JsonWriter json(text);
          json.begin_object();
          json.member("type", "camera");
          json.member("viewer", body.viewer);
          write_camera(json, leader->second->wanted->camera);
          json.end_object();
          viewer.link->send_text(std::move(text));
        } else if constexpr (!std::is_same_v<Body, Hello>) {
          add_job(std::move(body));
        }
      },
      message);
  changed_.notify_all();
}

bool Hub::is_outdated(const Work& work) const {
  const std::lock_guard lock(mutex_);
  return is_stopping_ || work.viewer->version != work.version;
}

/// What this viewer needs now; where that is later, `wake` is brought forward to then.
std::optional<Hub::Work> Hub::work_of(const ViewerPtr& viewer, Clock::time_point now, Clock::time_point& wake) const {
  if (!viewer->wanted) return std::nullopt;
  Work work{viewer, *viewer->wanted, viewer->visibility, viewer->version, viewer->wanted_at, now, {}, 0, 0};
  if (!viewer->jobs.empty()) {
    work.job = viewer->jobs.front();
    return work;
  }
  if (viewer->version != viewer->drawn_version) {
    if (viewer->in_flight.size() >= kMaxInFlight) return std::nullopt;  // an acknowledgement wakes the thread
    work.level = viewer->wanted->is_full_quality ? 0 : viewer->adaptation.level();
    return work;
  }
  // At rest: a picture more at a time.
  if (!viewer->in_flight.empty() && viewer->exact_samples != 0) return std::nullopt;
  if (viewer->in_flight.size() >= kMaxInFlight) return std::nullopt;
  const uint32_t most = possible_samples(viewer->wanted->most_samples, viewer->wanted->width, viewer->wanted->height);
  if (viewer->exact_samples >= most) return std::nullopt;
  work.samples = viewer->exact_samples == 0 ? 1 : 2 * viewer->exact_samples;
  Clock::time_point due = viewer->wanted_at + (viewer->wanted->is_moving ? kMovingRestDelay : kRestDelay);
  if (work.samples > 1) {
    const double guess_ms = 3 * viewer->exact_ms;  // four times the samples, but not the triangles
    if (guess_ms > kPatientMs) return std::nullopt;
    if (guess_ms > kQuickMs) due = viewer->wanted_at + kPatientDelay;
  }
  if (due <= now) return work;
  wake = std::min(wake, due);
  return std::nullopt;
}

/// Round robin; pictures of those who move come before pictures at rest.
std::optional<Hub::Work> Hub::next_work(Clock::time_point now, Clock::time_point& wake) {
  std::optional<Work> at_rest;
  auto next = viewers_.upper_bound(served_);
  for (size_t i = 0; i < viewers_.size(); ++i, ++next) {
    if (next == viewers_.end()) next = viewers_.begin();
    std::optional<Work> work = work_of(next->second, now, wake);
    if (!work) continue;
    const bool can_wait = work->samples != 0 || (work->job && std::holds_alternative<Screenshot>(*work->job));
    const bool is_urgent = !can_wait || now - work->wanted_at > kLongestWait;
    if (!is_urgent) {
      if (!at_rest) at_rest = std::move(work);
      continue;
    }
    served_ = work->viewer->number;
    if (work->job) next->second->jobs.pop_front();
    return work;
  }
  if (at_rest) {
    served_ = at_rest->viewer->number;
    if (at_rest->job) at_rest->viewer->jobs.pop_front();
  }
  return at_rest;
}

void Hub::run() {
  const auto end = [this] {
    session_.reset();
    const std::lock_guard lock(mutex_);
    has_ended_ = true;
    ended_.notify_all();
  };
  try {
    Result<ViewSession> opened = ViewSession::open(options_);
    if (!opened) {
      on_end_(opened.error());
      return end();
    }
    session_ = std::move(*opened);
    std::string members = [&] {
      std::string text;
      JsonWriter json(text);
      json.begin_object();
      const runtime::Scene& scene = session_->scene();
      const format::Container& container = scene.container();
      const std::string_view name = container.string(container.source().name);
      const size_t slash = options_.file.find_last_of('/');
      json.member("name", std::string_view(options_.file).substr(slash == std::string::npos ? 0 : slash + 1));
      json.member("source", name);
      json.member("file", std::string_view(options_.file));
      json.member("scene", std::string_view(options_.scene));
      json.member("triangles", scene.view().instance_base[scene.view().instance_count]);
      json.member("instances", scene.view().instance_count);
      json.member("meshes", scene.view().mesh_count);
      json.member("nodes", uint64_t{container.nodes().size()});
      json.member("drawnOn", std::string_view(session_->drawn_on()));
      json.member("deviceBytes", session_->device_bytes());
      json.member("canHide", session_->can_hide());
      const runtime::WorldBox box = session_->box();
      if (!box.is_empty()) {
        write_numbers(json, "boxMin", box.min);
        write_numbers(json, "boxMax", box.max);
      }
      json.key("home");
      json.begin_object();
      // A wide picture's home; pages with a narrow one step back.
      if (const Result<Camera> home = session_->home(1920, 1080); home) write_camera(json, *home);
      json.end_object();
      json.key("cameras");
      json.begin_array();
      for (const NamedCamera& camera : session_->cameras()) {
        json.begin_object();
        json.member("name", std::string_view(camera.name));
        write_camera(json, camera.camera);
        json.end_object();
      }
      json.end_array();
      json.end_object();
      return text.substr(1, text.size() - 2);
    }();

    std::unique_lock lock(mutex_);
    scene_members_ = std::move(members);
    is_ready_ = true;
    for (const auto& [number, viewer] : viewers_) viewer->link->send_text(scene_text());
    while (!is_stopping_) {
      const Clock::time_point now = Clock::now();
      Clock::time_point wake = now + 10s;
      std::optional<Work> work = next_work(now, wake);
      if (!work) {
        changed_.wait_until(lock, wake);
        continue;
      }
      lock.unlock();
      const Result<void> done = work->job ? do_job(*work) : work->samples == 0 ? draw_moving(*work) : draw_exact(*work);
      lock.lock();
      if (done) continue;
      // The request asks too much, or is none: it counts as drawn, so that it is not tried again and again.
      work->viewer->link->send_text(text_of_error(done.error().message));
      if (!work->job && work->viewer->version == work->version) {
        work->viewer->drawn_version = work->version;
        work->viewer->exact_samples = 4;
      }
    }
  } catch (const std::bad_alloc&) {
    on_end_(Error{ErrorCode::kMemory, "no memory left for the viewers"});
  }
  end();
}

void Hub::sent(const Work& work, uint64_t frame, bool is_moving) {
  const std::lock_guard lock(mutex_);
  Viewer& viewer = *work.viewer;
  viewer.in_flight.push_back({frame, work.begun, work.level, is_moving});
  viewer.drawn_version = std::max(viewer.drawn_version, work.version);
}

Result<void> Hub::draw_moving(const Work& work) {
  const PictureRequest& request = work.request;
  const Quality& quality = kQualities[work.level];
  const JpegKind jpeg{quality.jpeg, has_sharp_colours(request.shade.show)};
  const Result<Drawn> drawn = session_->draw(request, scaled(request.width, quality.scale),
                                             scaled(request.height, quality.scale), 1, work.visibility, &jpeg);
  if (!drawn) return drawn.error();

  std::optional<runtime::Vec3> point;
  if (request.cursor) {
    const Pixel at{std::min(static_cast<uint32_t>(request.cursor->x * quality.scale), drawn->pixels.width - 1),
                   std::min(static_cast<uint32_t>(request.cursor->y * quality.scale), drawn->pixels.height - 1)};
    point = session_->point(at);
  }
  uint64_t frame;
  {
    const std::lock_guard lock(mutex_);
    frame = ++frames_;
  }
  std::string head;
  JsonWriter json(head);
  json.begin_object();
  json.member("kind", "jpeg");
  json.member("exact", false);
  write_place(json, frame, request);
  json.member("quality", static_cast<uint32_t>(quality.jpeg));
  json.member("scale", quality.scale);
  write_head(json, *drawn, drawn->encode_ms);
  json.member("waitMs", ms_between(work.wanted_at, work.begun));
  json.member("triangles", drawn->stats.triangles);
  if (point) write_numbers(json, "point", *point);
  json.end_object();
  std::vector<std::byte> message = picture_message(head, drawn->jpeg);
  sent(work, frame, true);
  work.viewer->link->send_picture(std::move(message));
  return {};
}

Result<void> Hub::draw_exact(const Work& work) {
  const PictureRequest& request = work.request;
  const Result<Drawn> drawn = session_->draw(request, request.width, request.height, work.samples, work.visibility);
  if (!drawn) return drawn.error();
  if (is_outdated(work)) return {};
  const runtime::Stopwatch watch;
  const Result<std::vector<std::byte>> image =
      encode_png(drawn->pixels, session_->workers(), [&] { return is_outdated(work); });
  if (!image) return image.error();
  if (image->empty()) return {};
  const double encode_ms = watch.elapsed().wall_ms;
  std::optional<DepthMap> depths;  // once for a camera, of its first picture at rest
  if (work.samples == 1) {
    Result<DepthMap> read = session_->depths();
    if (!read) return read.error();
    depths = std::move(*read);
  }
  const std::optional<runtime::Vec3> point = request.cursor && depths ? depths->point(*request.cursor) : std::nullopt;
  uint64_t frame;
  {
    const std::lock_guard lock(mutex_);
    Viewer& viewer = *work.viewer;
    if (viewer.version == work.version) {
      viewer.exact_samples = work.samples;
      viewer.exact_ms = drawn->buffer_ms + drawn->shade_ms;
      if (depths) {
        viewer.depths = std::move(*depths);
        viewer.depths_version = work.version;
      }
    }
    frame = ++frames_;
  }
  std::string head;
  JsonWriter json(head);
  json.begin_object();
  json.member("kind", "png");
  json.member("exact", true);
  json.member("scale", 1.0);
  write_place(json, frame, request);
  write_head(json, *drawn, encode_ms);
  json.member("triangles", drawn->stats.triangles);
  json.member("instancesDrawn", drawn->stats.instances_drawn);
  json.member("clustersDrawn", drawn->stats.clusters_drawn);
  json.member("hostBytes", memory_use().anonymous);
  json.member("deviceBytes", session_->device_bytes());
  if (point) write_numbers(json, "point", *point);
  json.end_object();
  std::vector<std::byte> message = picture_message(head, *image);
  sent(work, frame, false);
  work.viewer->link->send_picture(std::move(message));
  return {};
}

Result<void> Hub::do_job(const Work& work) {
  if (const auto* const request = std::get_if<PickRequest>(&*work.job)) return pick(work, *request);
  if (const auto* const shot = std::get_if<Screenshot>(&*work.job)) return take_screenshot(work, *shot);
  send_nodes(work);
  return {};
}

Result<void> Hub::take_screenshot(const Work& work, const Screenshot& shot) {
  const uint32_t samples = possible_samples(shot.samples, shot.width, shot.height);
  const Result<Drawn> drawn = session_->draw(work.request, shot.width, shot.height, samples, work.visibility);
  if (!drawn) return drawn.error();
  const runtime::Stopwatch watch;
  const auto is_stopping = [&] {
    const std::lock_guard lock(mutex_);
    return is_stopping_;
  };
  const Result<std::vector<std::byte>> image = encode_png(drawn->pixels, session_->workers(), is_stopping);
  if (!image) return image.error();
  if (image->empty()) return {};
  std::string head;
  JsonWriter json(head);
  json.begin_object();
  json.member("kind", "screenshot");
  json.member("id", shot.id);
  write_head(json, *drawn, watch.elapsed().wall_ms);
  json.end_object();
  work.viewer->link->send_picture(picture_message(head, *image));
  return {};
}

Result<void> Hub::pick(const Work& work, const PickRequest& request) {
  const Result<Drawn> drawn = session_->draw(work.request, work.request.width, work.request.height, 1, work.visibility);
  if (!drawn) return drawn.error();
  const Result<std::optional<Picked>> picked = session_->pick(request.at);
  if (!picked) return picked.error();
  std::string text;
  JsonWriter json(text);
  json.begin_object();
  json.member("type", "pick");
  json.member("id", request.id);
  json.member("hit", picked->has_value());
  if (const std::optional<Picked>& hit = *picked) {
    json.member("node", hit->node);
    json.member("nodeName", std::string_view(hit->node_name));
    json.member("nodeInstance", hit->node_instance);
    json.member("instance", hit->instance);
    json.member("mesh", hit->mesh);
    json.member("meshName", std::string_view(hit->mesh_name));
    json.member("triangle", hit->triangle);
    if (hit->material != format::kNone) json.member("material", hit->material);
    json.member("materialName", std::string_view(hit->material_name));
    json.member("depth", hit->depth);
    write_numbers(json, "point", hit->point);
    json.key("box");
    json.begin_array();
    for (const runtime::Vec3& corner : hit->box) {
      json.begin_array();
      for (const double coordinate : corner) json.value(coordinate);
      json.end_array();
    }
    json.end_array();
  }
  json.end_object();
  work.viewer->link->send_text(std::move(text));
  return {};
}

void Hub::send_nodes(const Work& work) const {
  // 200,000 nodes are some MB; a page with more would be slow, and says that it has not all.
  constexpr uint64_t kMostNodes = 200000;
  const format::Container& container = session_->scene().container();
  const auto nodes = container.nodes();
  const uint64_t count = std::min<uint64_t>(nodes.size(), kMostNodes);
  std::string text;
  JsonWriter json(text);
  json.begin_object();
  json.member("type", "nodes");
  json.member("total", uint64_t{nodes.size()});
  json.key("names");
  json.begin_array();
  for (uint64_t n = 0; n < count; ++n) {
    std::string_view name = container.string(nodes[n].name);
    if (name.empty() && nodes[n].group != format::kNone)
      name = container.string(container.groups()[nodes[n].group].name);
    json.value(name);
  }
  json.end_array();
  json.key("parents");  // -1: none, but JsonWriter has no sign: one more than the number, and 0
  json.begin_array();
  for (uint64_t n = 0; n < count; ++n)
    json.value(nodes[n].parent == format::kNone ? uint64_t{0} : uint64_t{nodes[n].parent} + 1);
  json.end_array();
  std::vector<uint64_t> triangles(count, 0);
  const kernels::SceneView& scene = session_->scene().view();
  for (uint64_t i = 0; i < scene.instance_count; ++i)
    if (scene.instances[i].node < count)
      triangles[scene.instances[i].node] += scene.meshes[scene.instances[i].mesh].triangle_count;
  write_numbers(json, "triangles", triangles);
  json.end_object();
  work.viewer->link->send_text(std::move(text));
}

}  // namespace scree::tools::view
