#include "tools/view/hub.h"
#include "runtime/images/png_writer.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <type_traits>
#include <utility>

#include "tools/view/replies.h"

namespace scree::tools::view {
namespace {

using namespace std::chrono_literals;
using Milliseconds = std::chrono::duration<double, std::milli>;

// Delays before the picture at rest, from the newest camera on. Without a delay this picture would block the next
// picture of a movement.
constexpr auto kRestDelay = 60ms;         // if the page has reported that the camera rests
constexpr auto kMovingRestDelay = 160ms;  // if the page has reported a movement and then sent no further message
// A picture with more samples cannot be interrupted. It is drawn at once if its estimated time is at most kQuickMs,
// after kPatientDelay if it is at most kPatientMs, and otherwise not at all.
constexpr double kQuickMs = 150;
constexpr double kPatientMs = 900;
constexpr auto kPatientDelay = 1200ms;
// Drawing waits this long for chunks that are still being loaded to a GPU. The picture is then sent without them.
constexpr auto kChunkPatience = 150ms;
// Drawing waits this long for the chunks of a shadow map, within that time.
constexpr auto kShadowPatience = 75ms;
// Drawing waits this long for pages of textures. The picture then shows coarser levels.
constexpr auto kTexturePatience = 40ms;
// Chunks that no picture needs yet are loaded for kLoading at a time, at the latest after kBetweenLoading of drawing.
// Pictures take two to three times as long while chunks are missing, so all chunks should be loaded soon.
constexpr auto kLoading = 30ms;
constexpr auto kBetweenLoading = 60ms;
// A viewer at rest waits at most this long for moving viewers.
constexpr auto kLongestWait = 3s;

double ms_between(Hub::Clock::time_point from, Hub::Clock::time_point to) {
  return Milliseconds(to - from).count();
}

/// Pictures of ids have colours that would smear at a quarter of the colour resolution.
bool has_sharp_colours(kernels::Show show) {
  return show == kernels::Show::kTriangle || show == kernels::Show::kCluster || show == kernels::Show::kMesh ||
         show == kernels::Show::kStage;
}

/// The most samples per side, up to `wanted`, that a picture of this size can have.
uint32_t possible_samples(uint32_t wanted, uint32_t width, uint32_t height) {
  while (wanted > 1 && uint64_t{wanted} * std::max(width, height) > kernels::kMaxImageSide) wanted /= 2;
  return wanted;
}

/// Whether both requests give the same pixels. A movement ends with a request that differs only in `is_moving`.
bool is_same_picture(const PictureRequest& a, const PictureRequest& b) {
  const kernels::ShadeOptions &s = a.shade, &t = b.shade;
  return a.camera == b.camera && a.clip_box == b.clip_box && a.width == b.width && a.height == b.height &&
         s.show == t.show && s.light == t.light && a.shadows == b.shadows &&
         std::equal(std::begin(s.background), std::end(s.background), std::begin(t.background)) && s.ssao == t.ssao &&
         s.edl == t.edl && s.edl_strength == t.edl_strength && s.edl_radius == t.edl_radius;
}

runtime::IsOver after(std::chrono::milliseconds patience) {
  return [end = Hub::Clock::now() + patience] { return Hub::Clock::now() >= end; };
}

uint32_t scaled(uint32_t side, double scale) {
  return std::max(1u, static_cast<uint32_t>(std::lround(side * scale)));
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
  viewer->link->send_text(is_ready_ ? scene_text_ : loading_text(options_.file));
  tell_viewers();
  return viewer->number;
}

void Hub::leave(uint32_t number) {
  const std::lock_guard lock(mutex_);
  if (viewers_.erase(number) != 0) left_.push_back(number);
  for (auto& [other, viewer] : viewers_)
    if (viewer->follows == number) viewer->follows = 0;
  tell_viewers();
}

void Hub::tell_viewers() const {
  std::vector<uint32_t> numbers;
  for (const auto& [number, viewer] : viewers_) numbers.push_back(number);
  for (const auto& [number, viewer] : viewers_) viewer->link->send_text(viewers_text(number, numbers));
}

void Hub::receive(uint32_t number, Message message) {
  const std::lock_guard lock(mutex_);
  const auto found = viewers_.find(number);
  if (found == viewers_.end()) return;
  Viewer& viewer = *found->second;
  const auto add_job = [&](Job job) {
    if (!is_ready_ || !viewer.wanted) return;  // there is nothing to draw yet
    if (viewer.jobs.size() >= kMaxJobs) return viewer.link->send_text(error_text("too many requests at once"));
    viewer.jobs.push_back(std::move(job));
  };
  std::visit(
      [&](auto& body) {
        using Body = std::decay_t<decltype(body)>;
        if constexpr (std::is_same_v<Body, PictureRequest>) {
          if (!viewer.wanted || !(viewer.wanted->camera == body.camera)) {
            const std::string text = camera_text(number, body.camera);
            for (const auto& [other_number, other] : viewers_)
              if (other->follows == number) other->link->send_text(text);
          }
          // If the last picture of a movement shows the view at rest, no other JPEG of that view is needed.
          const bool is_drawn =
              viewer.wanted && viewer.drawn_version == viewer.version && is_same_picture(*viewer.wanted, body);
          viewer.wanted = std::move(body);
          viewer.wanted_at = Clock::now();
          ++viewer.version;
          if (is_drawn && viewer.sharp_version == viewer.drawn_version) viewer.sharp_version = viewer.version;
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
          viewer.in_flight.erase(viewer.in_flight.begin(),
                                 acknowledged + 1);  // pages show pictures in order, so earlier ones are done too
        } else if constexpr (std::is_same_v<Body, Probe>) {
          // Depths of an older view would give a wrong point.
          const bool is_current = viewer.wanted && viewer.depths_version == viewer.version;
          if (!is_current || body.at.x >= viewer.wanted->width || body.at.y >= viewer.wanted->height) return;
          viewer.link->send_text(point_text(body.at, viewer.depths.point(body.at)));
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
          viewer.link->send_text(camera_text(body.viewer, leader->second->wanted->camera));
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

/// The work that this viewer needs now. If it needs work later, `wake` becomes that time if it is earlier.
std::optional<Hub::Work> Hub::work_of(const ViewerPtr& viewer, Clock::time_point now, Clock::time_point& wake) const {
  if (!viewer->wanted) return std::nullopt;
  Work work{viewer, *viewer->wanted, viewer->visibility, viewer->version, viewer->wanted_at, now, {}};
  work.is_again = viewer->tried_version == viewer->version;
  if (!viewer->jobs.empty()) {
    work.job = viewer->jobs.front();
    return work;
  }
  if (viewer->version != viewer->drawn_version) {
    if (viewer->in_flight.size() >= kMaxInFlight) return std::nullopt;  // an acknowledgement wakes the thread
    work.level = viewer->wanted->is_full_quality ? 0 : viewer->adaptation.level();
    return work;
  }
  // At rest one picture is sent at a time. After small pictures, as over a slow link, a JPEG of full size comes first:
  // it arrives in a third of the time of a lossless picture.
  work.is_at_rest = true;
  if (!viewer->in_flight.empty() && viewer->exact_samples != 0) return std::nullopt;
  if (viewer->in_flight.size() >= kMaxInFlight) return std::nullopt;
  const uint32_t most = possible_samples(viewer->wanted->most_samples, viewer->wanted->width, viewer->wanted->height);
  if (viewer->exact_samples >= most) return std::nullopt;
  work.samples = viewer->exact_samples == 0 ? 1 : 2 * viewer->exact_samples;
  Clock::time_point due = viewer->wanted_at + (viewer->wanted->is_moving ? kMovingRestDelay : kRestDelay);
  if (work.samples > 1) {
    const double guess_ms = 3 * viewer->exact_ms;  // four times the samples, but the same triangles
    if (guess_ms > kPatientMs) return std::nullopt;
    if (guess_ms > kQuickMs) due = viewer->wanted_at + kPatientDelay;
  }
  if (viewer->sharp_version != viewer->version) work.samples = 0;
  if (due <= now) return work;
  wake = std::min(wake, due);
  return std::nullopt;
}

/// Chooses a viewer by round robin. Pictures of moving viewers come before pictures at rest.
std::optional<Hub::Work> Hub::next_work(Clock::time_point now, Clock::time_point& wake) {
  std::optional<Work> at_rest;
  auto next = viewers_.upper_bound(served_);
  for (size_t i = 0; i < viewers_.size(); ++i, ++next) {
    if (next == viewers_.end()) next = viewers_.begin();
    std::optional<Work> work = work_of(next->second, now, wake);
    if (!work) continue;
    const bool can_wait = work->is_at_rest || (work->job && std::holds_alternative<Screenshot>(*work->job));
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
    std::string text = scene_text(*session_, options_), drawn_on = session_->drawn_on();
    std::unique_lock lock(mutex_);
    scene_text_ = std::move(text);
    is_ready_ = true;
    for (const auto& [number, viewer] : viewers_) viewer->link->send_text(scene_text_);
    Clock::time_point loaded_at = Clock::now();
    while (!is_stopping_) {
      if (const std::vector<uint32_t> left = std::exchange(left_, {}); !left.empty()) {
        lock.unlock();
        for (const uint32_t number : left) session_->forget(number);
        lock.lock();
      }
      const Clock::time_point now = Clock::now();
      Clock::time_point wake = now + 10s;
      std::optional<Work> work = next_work(now, wake);
      if (!work && left_bytes_ == 0) {
        changed_.wait_until(lock, wake);
        continue;
      }
      lock.unlock();
      Result<void> done;
      if (work) done = work->job ? do_job(*work) : work->samples == 0 ? draw_moving(*work) : draw_exact(*work);
      if (!done && done.error().code == ErrorCode::kFile) {  // the scene can no longer be read
        on_end_(done.error());
        return end();
      }
      if (left_bytes_ != 0 && (!work || Clock::now() - loaded_at >= kBetweenLoading)) {
        const Result<uint64_t> to_come = session_->load_rest(after(kLoading));
        if (!to_come) {
          on_end_(at(options_.file, to_come.error()));
          return end();
        }
        left_bytes_ = *to_come < left_bytes_ ? *to_come : 0;  // if no chunk was loaded, the GPU is full
        loaded_at = Clock::now();
      }
      const bool fell_back = session_->drawn_on() != drawn_on;  // the GPU failed, and now the CPU draws
      if (fell_back) text = scene_text(*session_, options_);
      lock.lock();
      if (fell_back) {
        drawn_on = session_->drawn_on();
        scene_text_ = text;
        for (const auto& [number, viewer] : viewers_) viewer->link->send_text(scene_text_);
      }
      if (done || !work) continue;
      // The request is too large or invalid. It counts as drawn, so that it is not tried again and again.
      work->viewer->link->send_text(error_text(done.error().message));
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

void Hub::sent(const Work& work, uint64_t frame, bool is_moving, bool is_whole) {
  const std::lock_guard lock(mutex_);
  Viewer& viewer = *work.viewer;
  viewer.in_flight.push_back({frame, work.begun, work.level, is_moving && is_whole});
  viewer.tried_version = work.version;
  if (!is_whole) return;
  viewer.drawn_version = std::max(viewer.drawn_version, work.version);
  if (work.samples != 0 || kQualities[work.level].scale == 1)
    viewer.sharp_version = std::max(viewer.sharp_version, work.version);
}

Result<void> Hub::draw_moving(const Work& work) {
  const PictureRequest& request = work.request;
  const Quality& quality = kQualities[work.level];
  const JpegKind jpeg{quality.jpeg, has_sharp_colours(request.shade.show)};
  // Drawing the second picture of a view waits until all pages are loaded or the view changes. Pages that exceed the
  // texture memory are never all loaded.
  const runtime::IsOver is_over = [&] { return is_outdated(work); };
  const runtime::IsOver textures = work.is_again ? is_over : after(kTexturePatience);
  // Likewise the chunks of a shadow map, once the GPU is full.
  const runtime::IsOver shadows = work.is_again && left_bytes_ == 0 ? is_over : after(kShadowPatience);
  const Drawn drawn = SCREE_TRY(session_->draw(work.viewer->number, request, scaled(request.width, quality.scale),
                                               scaled(request.height, quality.scale), 1, work.visibility, &jpeg,
                                               {after(kChunkPatience), textures, shadows}));

  std::optional<runtime::Vec3> point;
  if (request.cursor) {
    const Pixel at{std::min(static_cast<uint32_t>(request.cursor->x * quality.scale), drawn.pixels.width - 1),
                   std::min(static_cast<uint32_t>(request.cursor->y * quality.scale), drawn.pixels.height - 1)};
    point = session_->point(at);
  }
  uint64_t frame;
  {
    const std::lock_guard lock(mutex_);
    frame = ++frames_;
  }
  std::vector<std::byte> message =
      moving_picture(frame, request, quality, drawn, ms_between(work.wanted_at, work.begun), point);
  // A shadow map is drawn for many pictures, so its time is not the link's or the quality's.
  sent(work, frame, !work.is_at_rest && drawn.shadow_ms == 0, drawn.left_bytes == 0);
  work.viewer->link->send_picture(std::move(message));
  return {};
}

Result<void> Hub::draw_exact(const Work& work) {
  const PictureRequest& request = work.request;
  const runtime::IsOver is_over = [&] { return is_outdated(work); };
  const Drawn drawn = SCREE_TRY(session_->draw(work.viewer->number, request, request.width, request.height,
                                               work.samples, work.visibility, nullptr, {is_over, is_over, is_over}));
  if (is_outdated(work)) return {};
  const runtime::Stopwatch watch;
  const std::vector<std::byte> image = SCREE_TRY(runtime::encode_png(
      drawn.pixels, {.has_alpha = false, .workers = &session_->workers(), .is_abandoned = is_over}));
  if (image.empty()) return {};
  const double encode_ms = watch.elapsed().wall_ms;
  std::optional<DepthMap> depths;  // once per camera, from its first picture at rest
  if (work.samples == 1) depths = SCREE_TRY(session_->depths());
  const std::optional<runtime::Vec3> point = request.cursor && depths ? depths->point(*request.cursor) : std::nullopt;
  uint64_t frame;
  {
    const std::lock_guard lock(mutex_);
    Viewer& viewer = *work.viewer;
    if (viewer.version == work.version) {
      viewer.exact_samples = work.samples;
      viewer.exact_ms = drawn.buffer_ms + drawn.shade_ms;
      if (depths) {
        viewer.depths = std::move(*depths);
        viewer.depths_version = work.version;
      }
    }
    frame = ++frames_;
  }
  std::vector<std::byte> message =
      exact_picture(frame, request, drawn, encode_ms, session_->device_bytes(), point, image);
  sent(work, frame, false, true);
  work.viewer->link->send_picture(std::move(message));
  return {};
}

Result<void> Hub::do_job(const Work& work) {
  if (const auto* const request = std::get_if<PickRequest>(&*work.job)) return pick(work, *request);
  if (const auto* const shot = std::get_if<Screenshot>(&*work.job)) return take_screenshot(work, *shot);
  work.viewer->link->send_text(nodes_text(session_->scene()));
  return {};
}

Result<void> Hub::take_screenshot(const Work& work, const Screenshot& shot) {
  const uint32_t samples = possible_samples(shot.samples, shot.width, shot.height);
  const auto is_stopping = [&] {
    const std::lock_guard lock(mutex_);
    return is_stopping_;
  };
  const Drawn drawn = SCREE_TRY(session_->draw(0, work.request, shot.width, shot.height, samples, work.visibility,
                                               nullptr, {is_stopping, is_stopping, is_stopping}));
  if (drawn.left_bytes != 0) return {};
  const runtime::Stopwatch watch;
  const std::vector<std::byte> image = SCREE_TRY(runtime::encode_png(
      drawn.pixels, {.has_alpha = false, .workers = &session_->workers(), .is_abandoned = is_stopping}));
  session_->shrink();
  if (image.empty()) return {};
  work.viewer->link->send_picture(screenshot_picture(shot.id, drawn, watch.elapsed().wall_ms, image));
  return {};
}

Result<void> Hub::pick(const Work& work, const PickRequest& request) {
  PictureRequest shown = work.request;
  shown.shadows = false;  // its colours are not used
  const Result<Drawn> drawn = session_->draw(work.viewer->number, shown, shown.width, shown.height, 1, work.visibility,
                                             nullptr, {{}, [] { return true; }, {}});
  if (!drawn) return drawn.error();
  const std::optional<Picked> picked = SCREE_TRY(session_->pick(request.at));
  work.viewer->link->send_text(pick_text(request.id, picked));
  return {};
}

}  // namespace scree::tools::view
