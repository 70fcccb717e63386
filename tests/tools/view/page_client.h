// scree view as a process, and what a page does, done without one: HTTP and WebSocket by hand, so that a test can also
// do them wrong.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <sys/types.h>

#include "tests/tools/temp_folder.h"

namespace scree::tests {

/// A small scene, packed; `scree view` of it on a free port of 127.0.0.1. The test fails where it does not start.
class ViewProcess {
 public:
  explicit ViewProcess(const std::vector<std::string>& more_words = {});
  ViewProcess(const ViewProcess&) = delete;
  ViewProcess& operator=(const ViewProcess&) = delete;
  ~ViewProcess();

  uint16_t port() const { return port_; }
  const std::string& token() const { return token_; }
  const std::string& scene() const { return scene_; }
  std::string address() const { return "127.0.0.1:" + std::to_string(port_); }
  std::string output() const;
  TempFolder& folder() { return folder_; }
  /// Bytes resident now.
  uint64_t resident() const;

  struct End {
    int exit_code = -1;  // -1: by a signal
    double seconds = 0;  // from the signal on
  };
  End interrupt();

 private:
  TempFolder folder_;
  std::string scene_;
  std::string token_;
  pid_t child_ = -1;
  uint16_t port_ = 0;
};

/// A socket to 127.0.0.1 whose reads give up after `patience`.
class PageClient {
 public:
  explicit PageClient(uint16_t port, std::chrono::milliseconds patience = std::chrono::seconds(20));
  PageClient(const PageClient&) = delete;
  PageClient& operator=(const PageClient&) = delete;
  ~PageClient();

  void send_raw(std::string_view bytes);
  /// What comes until the other side closes or nothing comes any more.
  std::string read_all();

  /// Sends the upgrade; an empty origin or host: no such header. Returns the HTTP status, 0 where there was no answer.
  int upgrade(const std::string& host, const std::string& origin, const std::string& path = "/ws");
  /// upgrade() with the right names, and the token.
  void join(const ViewProcess& server);

  struct Received {
    bool is_text = false;
    uint16_t close_code = 0;  // of a close frame, else 0
    std::string bytes;
  };
  /// Masked, as pages send it. `opcode`: 1 text, 2 binary.
  void send(std::string_view message, uint8_t opcode = 1);
  /// Nothing: the connection broke, or `patience` is over. Pings are answered.
  std::optional<Received> receive();
  /// The next text whose type is `type`; the test fails where none comes.
  std::string receive_text(std::string_view type);
  /// The next picture, its JSON head and its file.
  struct Picture {
    std::string head;
    std::string file;
    bool is_exact() const { return head.find("\"exact\":true") != std::string::npos; }
    uint64_t number(std::string_view name) const;
  };
  std::optional<Picture> receive_picture();
  void acknowledge(const Picture& picture);

 private:
  bool read_exactly(char* out, size_t count);
  int socket_ = -1;
};

/// The "view" message of a camera in front of the scene.
std::string view_text(uint64_t sequence, uint32_t width, uint32_t height, double eye_x = 0.5, bool moving = false,
                      uint32_t samples = 1);

/// An HTTP request on a connection of its own, whole as it comes back.
std::string http(uint16_t port, std::string_view request);

}  // namespace scree::tests
