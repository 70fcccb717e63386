// The HTTP and WebSocket side of the hub: embedded files, one WebSocket per page, limits.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "format/result.h"

namespace scree::tools::view {

class Hub;

/// An embedded file of the page.
struct Asset {
  std::string_view path;  // "/main.js"; "/" is index.html
  std::string_view type;  // "text/javascript; charset=utf-8"
  std::span<const unsigned char> bytes;
};

/// All files of the server (cmake/embed.cmake embeds tools/view/page/).
std::span<const Asset> page_assets();

struct ServerOptions {
  std::string host = "127.0.0.1";  // an address, or "localhost"
  uint16_t port = 8080;            // 0: any free port
  bool is_port_fixed = false;      // false: one of the next 20 if the port is in use
  std::string base_path;           // as parse_base_path() returns it
  std::vector<std::string> allowed_hosts;
  std::string token;
  uint32_t max_viewers = 8;
  std::chrono::milliseconds idle_timeout{20000};  // a connection without an answer to a ping for this long is closed
};

// Limits of a server, for any number of clients.
inline constexpr uint32_t kMaxSockets = 64;
inline constexpr uint32_t kMaxHeaderBytes = 8 << 10;
inline constexpr uint32_t kMaxMessagesPerSecond =
    240;  // per viewer and second, without acknowledgements; a viewer that sends more is disconnected
inline constexpr size_t kMaxQueuedBytes =
    size_t{32} << 20;  // of unsent data per viewer, beside the largest message; a slower viewer is disconnected
inline constexpr size_t kMaxQueuedMessages = 512;
inline constexpr std::chrono::seconds kRequestTimeout{10};  // for a request's head, and for a WebSocket's handshake
inline constexpr std::chrono::seconds kHelloTimeout{5};
inline constexpr std::chrono::seconds kCloseTimeout{5};  // from the decision to close a WebSocket until it is cut off

// Close codes of WebSockets that the page explains. RFC 6455 reserves 4000 to 4999 for applications.
enum class CloseCode : uint16_t {
  kEnding = 4000,
  kWrongToken = 4001,
  kTooManyViewers = 4002,
  kBadMessage = 4003,
  kTooSlow = 4004,
  kTooManyMessages = 4005
};

/// Runs on the thread of run(). Serves only embedded files, and never opens a path from a request.
class ViewServer {
 public:
  /// Errors kUsage (invalid address), kFile (the port is in use), kUnsupported (built without Boost).
  static Result<ViewServer> listen(ServerOptions options);
  ViewServer(ViewServer&&) noexcept;
  ViewServer& operator=(ViewServer&&) noexcept;
  ~ViewServer();

  uint16_t port() const;

  /// Serves until `ends()`, called every 50 ms, returns true; then closes every connection within 250 ms. The hub must
  /// outlive the call, and must have stopped before the server is destroyed.
  void run(Hub& hub, const std::function<bool()>& ends);

  struct Impl;

 private:
  explicit ViewServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::tools::view
