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

/// All files that the server has (made of tools/view/page/ by cmake/embed.cmake).
std::span<const Asset> page_assets();

struct ServerOptions {
  std::string host = "127.0.0.1";  // an address, or "localhost"
  uint16_t port = 8080;            // 0: any that is free
  bool is_port_fixed = false;      // else one of the next 20 where it is taken
  std::string base_path;           // as parse_base_path() returns it
  std::vector<std::string> allowed_hosts;
  std::string token;
  uint32_t max_viewers = 8;
  std::chrono::milliseconds idle_timeout{20000};  // without an answer to a ping
};

// Limits of a server, whoever its clients are.
inline constexpr uint32_t kMaxSockets = 64;
inline constexpr uint32_t kMaxHeaderBytes = 8 << 10;
inline constexpr uint32_t kMaxMessagesPerSecond = 240;       // of a viewer, but its acks; more end its connection,
inline constexpr size_t kMaxQueuedBytes = size_t{32} << 20;  // and so does this much that it has not taken
inline constexpr size_t kMaxQueuedMessages = 512;
inline constexpr std::chrono::seconds kRequestTimeout{10};  // for a request's head, and for a WebSocket's handshake
inline constexpr std::chrono::seconds kHelloTimeout{5};
inline constexpr std::chrono::seconds kCloseTimeout{5};  // from deciding to close a WebSocket to cutting it off

// Close codes of WebSockets that the page explains; RFC 6455 leaves 4000 to 4999 to applications.
enum class CloseCode : uint16_t {
  kEnding = 4000,
  kWrongToken = 4001,
  kTooManyViewers = 4002,
  kBadMessage = 4003,
  kTooSlow = 4004,
  kTooManyMessages = 4005
};

/// One thread, that of run(). No file of the machine is served, and no path of a request is opened.
class ViewServer {
 public:
  /// Errors kUsage (no such address), kFile (the port is taken), kUnsupported (built without Boost).
  static Result<ViewServer> listen(ServerOptions options);
  ViewServer(ViewServer&&) noexcept;
  ViewServer& operator=(ViewServer&&) noexcept;
  ~ViewServer();

  uint16_t port() const;

  /// Serves until `ends()`, called every 50 ms, then closes every connection within 250 ms. The hub outlives the call,
  /// and has stopped when the server is destroyed.
  void run(Hub& hub, const std::function<bool()>& ends);

  struct Impl;

 private:
  explicit ViewServer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::tools::view
