// The viewers of a scene, and the thread that draws for them. The hub uses no sockets: a viewer is a ViewerLink.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "tools/view/adaptation.h"
#include "tools/view/message.h"
#include "tools/view/session.h"

namespace scree::tools::view {

/// The connection to one page. Its functions are called from any thread. They must not block, and must not call the
/// hub.
class ViewerLink {
 public:
  virtual ~ViewerLink() = default;
  virtual void send_text(std::string text) = 0;
  /// A picture message: a little-endian u32 with the size of the JSON head, the head, then the image file.
  virtual void send_picture(std::vector<std::byte> message) = 0;
};

/// The most pictures sent to a viewer that it has not acknowledged. More would only queue up on the network.
inline constexpr size_t kMaxInFlight = 2;

/// The most requests of one viewer that are not answered yet. A further one gets an error.
inline constexpr size_t kMaxJobs = 16;

/// Thread-safe. For each viewer the hub holds at most kMaxInFlight pictures, kMaxJobs jobs and a depth map of 4 MiB. No
/// viewer delays the others for longer than the drawing of one picture.
class Hub {
 public:
  using Clock = std::chrono::steady_clock;

  /// Starts opening the scene on the hub's own thread. `on_end`: called on that thread if opening fails, and if the hub
  /// can no longer draw. It then draws no further picture.
  Hub(SessionOptions options, std::function<void(Error)> on_end);
  Hub(const Hub&) = delete;
  Hub& operator=(const Hub&) = delete;
  ~Hub();

  /// Returns the new viewer's number, from 1 on.
  uint32_t join(std::shared_ptr<ViewerLink> link);
  void leave(uint32_t viewer);
  void receive(uint32_t viewer, Message message);

  /// Ends the thread after the picture that it is drawing. Returns whether it ended within `patience`; if not, the
  /// destructor waits for it.
  bool stop(std::chrono::milliseconds patience);

 private:
  using Job = std::variant<PickRequest, Screenshot, NodesRequest>;

  struct InFlight {
    uint64_t frame;
    Clock::time_point begun;
    size_t level;
    bool is_moving;  // counts for the adaptation
  };

  struct Viewer {
    uint32_t number = 0;
    std::shared_ptr<ViewerLink> link;
    std::optional<PictureRequest> wanted;  // the newest request
    Clock::time_point wanted_at;
    Visibility visibility;
    uint64_t version = 0;        // number of the state of wanted and visibility
    uint64_t drawn_version = 0;  // version of the last complete picture sent
    uint64_t sharp_version = 0;  // version of the last JPEG of full size sent
    uint64_t tried_version = 0;  // version of the last picture sent, complete or not
    uint32_t exact_samples = 0;  // per side, of this version's lossless picture; 0: none was sent yet
    double exact_ms = 0;         // time of drawing it
    std::deque<InFlight> in_flight;
    std::deque<Job> jobs;
    Adaptation adaptation;
    DepthMap depths;
    uint64_t depths_version = 0;  // version of the depths
    uint32_t follows = 0;
  };
  using ViewerPtr = std::shared_ptr<Viewer>;

  /// A picture or job to do. Holds copies of the viewer's state, because that changes meanwhile.
  struct Work {
    ViewerPtr viewer;
    PictureRequest request;
    Visibility visibility;
    uint64_t version = 0;
    Clock::time_point wanted_at;
    Clock::time_point begun;
    std::optional<Job> job;  // unset: draw a picture,
    uint32_t samples = 0;    // lossless with this many samples per side; 0: a JPEG
    size_t level = 0;
    bool is_at_rest = false;
    bool is_again = false;  // the last picture of this version was not complete
  };

  void run();
  std::optional<Work> next_work(Clock::time_point now, Clock::time_point& wake);
  std::optional<Work> work_of(const ViewerPtr& viewer, Clock::time_point now, Clock::time_point& wake) const;
  Result<void> draw_moving(const Work& work);
  Result<void> draw_exact(const Work& work);
  Result<void> do_job(const Work& work);
  Result<void> take_screenshot(const Work& work, const Screenshot& shot);
  Result<void> pick(const Work& work, const PickRequest& request);
  void sent(const Work& work, uint64_t frame, bool is_moving, bool is_whole);
  void tell_viewers() const;
  bool is_outdated(const Work& work) const;

  const SessionOptions options_;
  const std::function<void(Error)> on_end_;
  std::optional<ViewSession> session_;  // used only by the hub's thread
  uint64_t left_bytes_ = UINT64_MAX;    // likewise; of chunks that are not loaded yet

  mutable std::mutex mutex_;  // for all members below
  std::condition_variable changed_;
  std::condition_variable ended_;
  bool is_ready_ = false;
  bool is_stopping_ = false;
  bool has_ended_ = false;
  std::map<uint32_t, ViewerPtr> viewers_;
  std::vector<uint32_t> left_;  // numbers of viewers that have left and that are still in the session
  uint32_t last_number_ = 0;
  uint32_t served_ = 0;     // the viewer that was served last
  uint64_t frames_ = 0;     // pictures sent so far
  std::string scene_text_;  // the same for all viewers; empty until the scene is open
  std::thread thread_;
};

}  // namespace scree::tools::view
