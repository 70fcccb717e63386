// scree view as a process, and a client with its own HTTP and WebSocket code, which allows a test to break the
// protocol.
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

/// `scree view` on a free port of 127.0.0.1, of `scene` or else of a small packed scene. If it does not start, the test
/// fails.
class ViewProcess {
 public:
  explicit ViewProcess(const std::vector<std::string>& more_words = {}, const std::string& scene = {});
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
    int exit_code = -1;  // -1: ended by a signal
    double seconds = 0;  // from the call to the end
  };
  End interrupt();
  /// Waits until the process ends by itself.
  End wait();

 private:
  TempFolder folder_;
  std::string scene_, token_;
  pid_t child_ = -1;
  uint16_t port_ = 0;
};

/// A socket to 127.0.0.1 whose reads time out after `patience`.
class PageClient {
 public:
  static constexpr std::chrono::minutes kLongestWait{2};

  explicit PageClient(uint16_t port, std::chrono::milliseconds patience = std::chrono::seconds(20));
  PageClient(const PageClient&) = delete;
  PageClient& operator=(const PageClient&) = delete;
  ~PageClient();

  void send_raw(std::string_view bytes);
  /// All bytes until the other side closes or a read times out.
  std::string read_all();

  /// Sends the upgrade request. An empty origin or host omits that header. Returns the HTTP status, or 0 without an
  /// answer.
  int upgrade(const std::string& host, const std::string& origin, const std::string& path = "/ws");
  /// Calls upgrade() with the right host, origin and token.
  void join(const ViewProcess& server);

  struct Received {
    bool is_text = false;
    uint16_t close_code = 0;  // of a close frame; else 0
    std::string bytes;
  };
  /// Sends a masked frame, as pages do. `opcode`: 1 text, 2 binary.
  void send(std::string_view message, uint8_t opcode = 1);
  using Clock = std::chrono::steady_clock;
  /// The next message; nullopt if the connection breaks, or `patience` or the time has passed. Pings are answered.
  std::optional<Received> receive(Clock::time_point until = Clock::now() + kLongestWait);
  /// The next text of the given type. The test fails if none arrives within kLongestWait.
  std::string receive_text(std::string_view type);
  /// The next picture: its JSON header and its file.
  struct Picture {
    std::string head, file;
    bool is_exact() const { return head.find("\"exact\":true") != std::string::npos; }
    uint64_t number(std::string_view name) const;
  };
  std::optional<Picture> receive_picture();
  void acknowledge(const Picture& picture);

 private:
  bool read_exactly(char* out, size_t count);
  int socket_ = -1;
};

/// The "view" message for a camera in front of the scene.
std::string view_text(uint64_t sequence, uint32_t width, uint32_t height, double eye_x = 0.5, bool moving = false,
                      uint32_t samples = 1);

/// Makes an HTTP request on its own connection. Returns the complete response.
std::string http(uint16_t port, std::string_view request);

}  // namespace scree::tests
