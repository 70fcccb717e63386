// The hub without a server.
#include "tools/view/hub.h"

#include <condition_variable>
#include <cstdlib>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "runtime/images/image.h"
#include "tests/gpu.h"
#include "tests/runtime/small_scene.h"

using namespace scree::tools::view;
using namespace std::chrono_literals;
using scree::tests::ScratchPath;
using scree::tests::SmallScene;

namespace {

/// A page that records its messages.
class Page : public ViewerLink {
 public:
  void send_text(std::string text) override {
    const std::lock_guard lock(mutex_);
    texts_.push_back(std::move(text));
    changed_.notify_all();
  }
  void send_picture(std::vector<std::byte> message) override {
    const std::lock_guard lock(mutex_);
    const char* const bytes = reinterpret_cast<const char*>(message.data());
    const size_t head = static_cast<unsigned char>(bytes[0]) + 256 * static_cast<unsigned char>(bytes[1]);
    pictures_.emplace_back(bytes + 4, head);
    changed_.notify_all();
  }
  /// The header of picture number `index`; empty if it does not arrive in time.
  std::string picture(size_t index, std::chrono::milliseconds patience = 20s) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, patience, [&] { return pictures_.size() > index; });
    return pictures_.size() > index ? pictures_[index] : "";
  }
  bool hears(const std::string& part, std::chrono::milliseconds patience = 20s) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, patience, [&] {
      for (const std::string& text : texts_)
        if (text.find(part) != std::string::npos) return true;
      return false;
    });
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::string> texts_, pictures_;
};

uint64_t frame_of(const std::string& head) {
  return std::strtoull(head.c_str() + head.find("\"frame\":") + 8, nullptr, 10);
}

PictureRequest request(uint64_t sequence, double x) {
  PictureRequest out{.sequence = sequence};
  out.camera.eye = {x, 0, 2.5};
  out.width = 96;
  out.height = 54;
  out.shade.background[3] = 1;
  out.most_samples = 2;
  return out;
}

SessionOptions options_of(const std::string& path) {
  SessionOptions options;
  options.file = path;
  options.threads = 2;
  options.backend.choice = scree::tools::BackendChoice::kCpu;
  options.quiet = true;
  return options;
}

SessionOptions small_scene(const ScratchPath& path, scree::tools::BackendChoice backend) {
  SmallScene{}.write(path.string());
  SessionOptions options = options_of(path.string());
  options.backend.choice = backend;
  return options;
}

/// A hub of a small scene, and a page that has joined it.
struct JoinedPage {
  explicit JoinedPage(scree::tools::BackendChoice backend = scree::tools::BackendChoice::kCpu)
      : hub(small_scene(path, backend), [](scree::Error error) { FAIL(error.message); }), number(hub.join(page)) {}

  ScratchPath path{"hub.scree"};
  std::shared_ptr<Page> page = std::make_shared<Page>();
  Hub hub;
  uint32_t number;
};

}  // namespace

TEST_CASE_METHOD(JoinedPage, "a hub draws the newest camera, then the picture at rest, then more samples",
                 "[view][view-hub]") {
  CHECK(number == 1);
  REQUIRE(page->hears("\"type\":\"scene\""));
  hub.receive(number, request(1, 0));
  REQUIRE(page->picture(0).find("\"seq\":1,") != std::string::npos);
  for (uint64_t i = 2; i <= 30; ++i) hub.receive(number, request(i, 0.01 * static_cast<double>(i)));
  REQUIRE(!page->picture(1).empty());
  CHECK(page->picture(2, 300ms).empty());  // two pictures are in flight
  size_t count = 2;
  for (size_t i = 0; i < count; ++i) {
    hub.receive(number, Ack{frame_of(page->picture(i))});
    if (!page->picture(count, 600ms).empty()) ++count;  // longer than the delay before a picture at rest
  }
  REQUIRE(count >= 4);
  // At most one picture was drawn between the first and the last camera. The late acknowledgements may have led to a
  // smaller picture, which a picture of full size follows first.
  CHECK(count <= 6);
  const std::string exact = page->picture(count - 2), finer = page->picture(count - 1);
  for (const std::string& head : {exact, finer}) {
    CHECK(head.find("\"seq\":30,") != std::string::npos);
    CHECK(head.find("\"exact\":true") != std::string::npos);
  }
  CHECK(exact.find("\"samples\":1,") != std::string::npos);
  CHECK(finer.find("\"samples\":2,") != std::string::npos);
  hub.leave(number);
  hub.receive(number, request(99, 0));  // a request from a page that has left
  CHECK(hub.stop(5s));
}

TEST_CASE_METHOD(JoinedPage, "a viewer with a slow link gets a JPEG of full size at rest, then a lossless picture",
                 "[view][view-hub]") {
  REQUIRE(page->hears("\"type\":\"scene\""));
  size_t count = 0;
  const auto next = [&] {
    const std::string head = page->picture(count++);
    REQUIRE(!head.empty());
    return head;
  };
  bool is_small = false;
  for (uint64_t i = 1; !is_small; ++i) {
    REQUIRE(i < 30);
    PictureRequest moving = request(i, 0.01 * static_cast<double>(i));
    moving.is_moving = true;
    hub.receive(number, moving);
    std::string head;
    while (head.find("\"seq\":" + std::to_string(i) + ",") == std::string::npos) {
      if (!head.empty()) hub.receive(number, Ack{frame_of(head)});  // the picture at rest of the previous camera
      head = next();
    }
    is_small = head.find("\"scale\":0.75") != std::string::npos;
    std::this_thread::sleep_for(130ms);  // the time that a picture takes to reach the page
    hub.receive(number, Ack{frame_of(head)});
  }
  const std::string sharp = next(), exact = next();
  CHECK(sharp.find("\"exact\":false") != std::string::npos);
  CHECK(sharp.find("\"quality\":88,") != std::string::npos);
  CHECK(exact.find("\"exact\":true") != std::string::npos);
  CHECK(hub.stop(5s));
}

TEST_CASE("a hub draws on a GPU while the scene is loaded", "[view][view-hub][cuda]") {
  if (!scree::tests::has_gpu()) return;
  JoinedPage joined(scree::tools::BackendChoice::kCuda);
  Hub& hub = joined.hub;
  Page* const page = joined.page.get();
  const uint32_t number = joined.number;
  hub.receive(number, request(1, 0));  // before the scene is open
  for (size_t i = 0;; ++i) {
    REQUIRE(i < 100);
    const std::string head = page->picture(i);
    REQUIRE(!head.empty());
    hub.receive(number, Ack{frame_of(head)});
    if (head.find("\"exact\":true") == std::string::npos) continue;
    CHECK(head.find("\"instancesDrawn\":1,") != std::string::npos);
    break;
  }
  CHECK(hub.stop(5s));
}

TEST_CASE_METHOD(JoinedPage, "requests to a hub are limited", "[view][view-hub]") {
  REQUIRE(page->hears("\"type\":\"scene\""));
  hub.receive(number, PickRequest{1, {5, 5}});  // there is no camera yet, so no answer
  hub.receive(number, request(1, 0));
  REQUIRE(!page->picture(0).empty());
  for (uint64_t i = 0; i < 200; ++i) hub.receive(number, Screenshot{i, 512, 512, 2});
  CHECK(page->hears("too many requests"));
  CHECK(hub.stop(20s));
}

TEST_CASE("a hub whose file cannot be drawn reports it once", "[view][view-hub]") {
  std::mutex mutex;
  std::condition_variable changed;
  std::string said;
  Hub hub(options_of("/nowhere/none.scree"), [&](scree::Error error) {
    const std::lock_guard lock(mutex);
    said = error.message;
    changed.notify_all();
  });
  std::unique_lock lock(mutex);
  REQUIRE(changed.wait_for(lock, 20s, [&] { return !said.empty(); }));
  CHECK(said.find("none.scree") != std::string::npos);
  lock.unlock();
  CHECK(hub.stop(5s));
}

TEST_CASE("a GPU's JPEG of a view shows its pixels", "[view][view-hub][cuda]") {
  if (!scree::tests::has_gpu()) return;
  const ScratchPath path("session.scree");
  auto session = must(ViewSession::open(small_scene(path, scree::tools::BackendChoice::kCuda)));
  const PictureRequest wanted = request(1, 0);
  for (const bool is_sharp : {false, true}) {
    const auto with_pixels = must(session.draw(1, wanted, wanted.width, wanted.height, 1, {}));
    const std::vector<uint8_t> pixels(with_pixels.pixels.bytes.begin(), with_pixels.pixels.bytes.end());
    REQUIRE(pixels.size() == size_t{4} * wanted.width * wanted.height);
    const JpegKind kind{100, is_sharp};
    const auto coded = must(session.draw(1, wanted, wanted.width, wanted.height, 1, {}, &kind));
    const auto image = must(scree::runtime::decode_image(coded.jpeg));
    REQUIRE(image.rgba.size() == pixels.size());
    double sum = 0;
    for (size_t i = 0; i < pixels.size(); ++i)
      if (i % 4 != 3) sum += std::abs(int{image.rgba[i]} - int{pixels[i]});
    CHECK(sum / static_cast<double>(pixels.size()) < (is_sharp ? 1.0 : 4.0));
  }
}
