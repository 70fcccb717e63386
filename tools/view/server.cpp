// The only file that includes Boost.
#include "tools/view/server.h"

#include <algorithm>
#include <deque>
#include <optional>
#include <set>
#include <utility>  // must come before Asio: the headers of 1.74 lack it with C++20

#include <boost/asio.hpp>
#include <boost/beast.hpp>

#include "tools/view/access.h"
#include "tools/view/hub.h"
#include "tools/view/message.h"
#include "tools/view/replies.h"

namespace scree::tools::view {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using asio::ip::tcp;
using BoostError = boost::system::error_code;
using Stream = beast::tcp_stream;

// The send buffer has room for about one picture. A larger one would fill with outdated pictures.
constexpr int kSendBufferBytes = 256 << 10;

constexpr const char* kContentPolicy =
    "default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

constexpr uint32_t kPortsTried = 20;

std::vector<std::byte> bytes_of(std::string_view text) {
  const auto* const first = reinterpret_cast<const std::byte*>(text.data());
  return {first, first + text.size()};
}

class WebSocketViewer;

}  // namespace

struct ViewServer::Impl {
  explicit Impl(ServerOptions server_options)
      : options(std::move(server_options)), access(options.host, options.allowed_hosts) {}

  ServerOptions options;
  AccessList access;
  Hub* hub = nullptr;
  uint32_t sockets = 0;
  uint32_t viewers = 0;
  std::set<WebSocketViewer*> open;
  asio::io_context context{1};  // declared after the members that its connections use when they end
  tcp::acceptor acceptor{context};

  void accept();
};

namespace {

/// Counts a socket while it is open.
class SocketCount {
 public:
  explicit SocketCount(uint32_t& count) : count_(&count) { ++*count_; }
  SocketCount(SocketCount&& other) noexcept : count_(std::exchange(other.count_, nullptr)) {}
  SocketCount& operator=(SocketCount&&) = delete;
  ~SocketCount() {
    if (count_ != nullptr) --*count_;
  }

 private:
  uint32_t* count_;
};

/// A page's connection, from the upgrade on. Everything except the ViewerLink's functions runs on the server's thread.
class WebSocketViewer : public std::enable_shared_from_this<WebSocketViewer> {
 public:
  WebSocketViewer(ViewServer::Impl& server, Stream stream, SocketCount count)
      : server_(server), count_(std::move(count)), stream_(std::move(stream)), timer_(server.context) {
    server_.open.insert(this);
  }
  WebSocketViewer(const WebSocketViewer&) = delete;
  WebSocketViewer& operator=(const WebSocketViewer&) = delete;
  ~WebSocketViewer() { server_.open.erase(this); }

  void start(http::request<http::empty_body> request) {
    websocket::stream_base::timeout timeout{};
    timeout.handshake_timeout = kRequestTimeout;
    timeout.idle_timeout = server_.options.idle_timeout;
    timeout.keep_alive_pings = true;
    stream_.set_option(timeout);
    stream_.read_message_max(kMaxMessageBytes);
    stream_.auto_fragment(
        true);  // pings are sent between the parts of a large picture; otherwise a slow link would seem dead
    stream_.write_buffer_bytes(64 << 10);
    auto self = shared_from_this();
    auto kept = std::make_shared<http::request<http::empty_body>>(std::move(request));
    stream_.async_accept(*kept, [self, kept](BoostError error) {
      if (error) return;
      self->timer_.expires_after(kHelloTimeout);
      self->timer_.async_wait([self](BoostError waited) {
        if (!waited && self->number_ == 0) self->close(CloseCode::kWrongToken, "no token was sent");
      });
      self->read();
    });
  }

  void send(std::vector<std::byte> bytes, bool is_text) {
    if (is_closing_) return;
    // A single picture may be larger than the limit, so neither the message that is being written counts nor the
    // largest one behind it.
    size_t waiting_bytes = 0, largest = 0;
    for (size_t i = 1; i < queue_.size(); ++i) {
      waiting_bytes += queue_[i].bytes.size();
      largest = std::max(largest, queue_[i].bytes.size());
    }
    if (waiting_bytes - largest > kMaxQueuedBytes || queue_.size() >= kMaxQueuedMessages)
      return close(CloseCode::kTooSlow, "the connection is too slow");
    if (!is_text) ++acks_due_;
    queue_.push_back({std::move(bytes), is_text});
    if (queue_.size() == 1) write();
  }

  void close(CloseCode code, const char* reason) {
    if (std::exchange(is_closing_, true)) return;
    leave();
    close_reason_ = websocket::close_reason(static_cast<websocket::close_code>(code), reason);
    auto self = shared_from_this();
    timer_.expires_after(kCloseTimeout);  // a client that does not read blocks the write and the close frame
    timer_.async_wait([self](BoostError waited) {
      if (!waited) self->cut();
    });
    // Queued messages are dropped; a write that has begun ends first.
    if (queue_.size() > 1) queue_.erase(queue_.begin() + 1, queue_.end());
    if (queue_.empty()) close_now();
  }

  /// Closes without a handshake, which a dead page would not answer. Used when the server ends.
  void cut() {
    leave();
    is_closing_ = true;
    timer_.cancel();
    BoostError ignored;
    stream_.next_layer().socket().close(ignored);
  }

 private:
  struct Outgoing {
    std::vector<std::byte> bytes;
    bool is_text;
  };

  /// The hub's link to a viewer. It may outlive the connection.
  class Link : public ViewerLink {
   public:
    Link(asio::io_context& context, std::weak_ptr<WebSocketViewer> viewer)
        : context_(context), viewer_(std::move(viewer)) {}
    void send_text(std::string text) override { post(bytes_of(text), true); }
    void send_picture(std::vector<std::byte> message) override { post(std::move(message), false); }

   private:
    void post(std::vector<std::byte> bytes, bool is_text) {
      asio::post(context_, [viewer = viewer_, bytes = std::move(bytes), is_text]() mutable {
        if (const auto self = viewer.lock()) self->send(std::move(bytes), is_text);
      });
    }
    asio::io_context& context_;
    std::weak_ptr<WebSocketViewer> viewer_;
  };

  void read() {
    auto self = shared_from_this();
    stream_.async_read(buffer_, [self](BoostError error, size_t) {
      if (error) return self->ended();
      self->receive();
      self->buffer_.consume(self->buffer_.size());
      // Beast answers a close frame only while a read is pending, so reading continues while closing.
      self->read();
    });
  }

  void receive() {
    if (is_closing_) return;
    if (!stream_.got_text()) return close(CloseCode::kBadMessage, "a binary message");
    const auto now = std::chrono::steady_clock::now();
    if (now - second_ >= std::chrono::seconds(1)) {
      second_ = now;
      messages_ = 0;
    }
    const auto data = buffer_.data();
    Result<Message> message = parse_message({static_cast<const char*>(data.data()), data.size()});
    // Acknowledgements are limited by the number of pictures sent.
    if (message && std::holds_alternative<Ack>(*message) && acks_due_ != 0)
      --acks_due_;
    else if (++messages_ > kMaxMessagesPerSecond)
      return close(CloseCode::kTooManyMessages, "too many messages");
    const Hello* const hello = message ? std::get_if<Hello>(&*message) : nullptr;
    if (number_ == 0) {
      if (hello == nullptr || !is_same_token(hello->token, server_.options.token))
        return close(CloseCode::kWrongToken, "wrong token");
      if (server_.viewers >= server_.options.max_viewers) return close(CloseCode::kTooManyViewers, "too many viewers");
      timer_.cancel();
      ++server_.viewers;
      number_ = server_.hub->join(std::make_shared<Link>(server_.context, weak_from_this()));
      return;
    }
    // A page may send a number beyond a limit, such as a camera that flew too far. That message has no effect.
    if (!message && message.error().code == ErrorCode::kRange)
      return send(bytes_of(error_text(message.error().message)), true);
    if (!message) return close(CloseCode::kBadMessage, "an invalid message");
    server_.hub->receive(number_, std::move(*message));
  }

  void write() {
    auto self = shared_from_this();
    stream_.text(queue_.front().is_text);
    stream_.async_write(asio::buffer(queue_.front().bytes), [self](BoostError error, size_t) {
      if (error) return self->ended();
      self->queue_.pop_front();
      if (!self->queue_.empty()) return self->write();
      if (self->is_closing_) self->close_now();
    });
  }

  void close_now() {
    auto self = shared_from_this();
    stream_.async_close(close_reason_, [self](BoostError) { self->ended(); });
  }

  void ended() {
    leave();
    is_closing_ = true;
    timer_.cancel();
  }

  void leave() {
    if (number_ == 0 || has_left_) return;
    has_left_ = true;
    --server_.viewers;
    server_.hub->leave(number_);
  }

  ViewServer::Impl& server_;
  SocketCount count_;
  websocket::stream<Stream> stream_;
  asio::steady_timer timer_;
  beast::flat_buffer buffer_{kMaxMessageBytes};
  std::deque<Outgoing> queue_;  // the first is being written
  uint32_t number_ = 0;         // the hub's number; 0: not yet accepted
  bool has_left_ = false;
  bool is_closing_ = false;
  websocket::close_reason close_reason_;
  std::chrono::steady_clock::time_point second_{};  // the second in which messages_ arrived
  uint32_t messages_ = 0;
  uint64_t acks_due_ = 0;  // pictures that were sent and not yet acknowledged
};

/// The requests of one connection, one after another, until it becomes a WebSocket.
class HttpConnection : public std::enable_shared_from_this<HttpConnection> {
 public:
  HttpConnection(ViewServer::Impl& server, tcp::socket socket)
      : server_(server), count_(server.sockets), stream_(std::move(socket)) {}

  void read() {
    parser_.emplace();
    parser_->header_limit(kMaxHeaderBytes);
    parser_->body_limit(uint64_t{0});
    stream_.expires_after(kRequestTimeout);
    auto self = shared_from_this();
    http::async_read(stream_, buffer_, *parser_, [self](BoostError error, size_t) {
      if (!error) return self->answer(self->parser_->release());
      if (error == http::error::header_limit || error == http::error::body_limit ||
          error == http::error::buffer_overflow)
        return self->refuse(http::status::bad_request, "too long\n", false);
    });
  }

 private:
  using Response = http::response<http::span_body<const unsigned char>>;

  static std::string_view text_of(beast::string_view text) { return {text.data(), text.size()}; }

  void answer(http::request<http::empty_body> request) {
    keep_alive_ = request.keep_alive();
    is_head_ = request.method() == http::verb::head;
    const std::string_view host = text_of(request[http::field::host]);
    if (request.count(http::field::host) != 1 || !server_.access.allows_host(host))
      return refuse(http::status::misdirected_request,
                    "scree view: this host name is not allowed (--allow-host NAME)\n", true);
    const std::string_view target = text_of(request.target());
    const std::string_view path = path_below(target, server_.options.base_path);
    if (path == "/ws") return upgrade(std::move(request), host);
    if (request.method() != http::verb::get && !is_head_)
      return refuse(http::status::method_not_allowed, "GET only\n", true);
    if (path.empty()) return redirect();
    for (const Asset& asset : page_assets())
      if (path == asset.path) return respond(http::status::ok, asset.type, asset.bytes);
    refuse(http::status::not_found, "not found\n", true);
  }

  void upgrade(http::request<http::empty_body> request, std::string_view host) {
    if (!websocket::is_upgrade(request)) return refuse(http::status::upgrade_required, "a WebSocket\n", true);
    const std::string_view origin = text_of(request[http::field::origin]);
    if (request.count(http::field::origin) != 1 || !server_.access.allows_origin(origin, host))
      return refuse(http::status::forbidden, "this origin is not allowed\n", false);
    stream_.expires_never();  // the WebSocket has its own timeouts
    std::make_shared<WebSocketViewer>(server_, std::move(stream_), std::move(count_))->start(std::move(request));
  }

  void redirect() {
    location_ = server_.options.base_path + "/";
    respond(http::status::permanent_redirect, "text/plain", {});
  }

  void refuse(http::status status, std::string_view text, bool may_keep_alive) {
    keep_alive_ = keep_alive_ && may_keep_alive;
    respond(status, "text/plain; charset=utf-8", {reinterpret_cast<const unsigned char*>(text.data()), text.size()});
  }

  /// `body` must stay valid until it is sent: an asset or a literal.
  void respond(http::status status, std::string_view type, std::span<const unsigned char> body) {
    response_.emplace(status, 11);
    Response& response = *response_;
    response.set(http::field::content_type, beast::string_view(type.data(), type.size()));
    response.set(http::field::cache_control, "no-store");
    response.set("Content-Security-Policy", kContentPolicy);
    response.set("X-Content-Type-Options", "nosniff");
    response.set("Referrer-Policy", "no-referrer");
    response.set("Cross-Origin-Resource-Policy", "same-origin");
    response.set("Cross-Origin-Opener-Policy", "same-origin");
    if (!location_.empty()) response.set(http::field::location, std::exchange(location_, {}));
    response.keep_alive(keep_alive_);
    response.body() = beast::span<const unsigned char>(body.data(), is_head_ ? 0 : body.size());
    response.content_length(body.size());
    stream_.expires_after(kRequestTimeout);
    auto self = shared_from_this();
    http::async_write(stream_, response, [self](BoostError error, size_t) {
      if (error) return;
      if (self->keep_alive_) return self->read();
      BoostError ignored;
      self->stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
    });
  }

  ViewServer::Impl& server_;
  SocketCount count_;
  Stream stream_;
  beast::flat_buffer buffer_{kMaxHeaderBytes};
  std::optional<http::request_parser<http::empty_body>> parser_;
  std::optional<Response> response_;
  std::string location_;
  bool keep_alive_ = false;
  bool is_head_ = false;
};

/// Starts listening on `endpoint`.
BoostError open_acceptor(tcp::acceptor& acceptor, const tcp::endpoint& endpoint) {
  BoostError error;
  acceptor.open(endpoint.protocol(), error);
  if (!error) acceptor.set_option(asio::socket_base::reuse_address(true), error);
  if (!error) acceptor.bind(endpoint, error);
  if (!error) acceptor.listen(static_cast<int>(kMaxSockets), error);
  if (error) {
    BoostError ignored;
    acceptor.close(ignored);
  }
  return error;
}

}  // namespace

void ViewServer::Impl::accept() {
  acceptor.async_accept([this](BoostError error, tcp::socket socket) {
    if (!acceptor.is_open()) return;
    if (!error && sockets < kMaxSockets) {
      BoostError ignored;
      socket.set_option(tcp::no_delay(true), ignored);
      socket.set_option(asio::socket_base::send_buffer_size(kSendBufferBytes), ignored);
      std::make_shared<HttpConnection>(*this, std::move(socket))->read();
    }
    if (!error) return accept();
    // Probably no file descriptor is free, so the server tries again a moment later.
    auto pause = std::make_shared<asio::steady_timer>(context, std::chrono::milliseconds(100));
    pause->async_wait([this, pause](BoostError) {
      if (acceptor.is_open()) accept();
    });
  });
}

ViewServer::ViewServer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ViewServer::ViewServer(ViewServer&&) noexcept = default;
ViewServer& ViewServer::operator=(ViewServer&&) noexcept = default;
ViewServer::~ViewServer() = default;

Result<ViewServer> ViewServer::listen(ServerOptions options) {
  auto impl = std::make_unique<Impl>(std::move(options));
  const ServerOptions& wanted = impl->options;
  BoostError error;
  const std::string host = SCREE_TRY(address_of(wanted.host));
  const asio::ip::address address = asio::ip::make_address(host);
  impl->access = AccessList(host, wanted.allowed_hosts);
  const bool has_one_port = wanted.is_port_fixed || wanted.port == 0;
  const uint32_t last = has_one_port ? wanted.port : std::min(wanted.port + kPortsTried - 1, 65535u);
  for (uint32_t port = wanted.port; port <= last; ++port) {
    error = open_acceptor(impl->acceptor, {address, static_cast<uint16_t>(port)});
    if (error != boost::system::errc::address_in_use) break;
  }
  if (error)
    return Error{ErrorCode::kFile, wanted.host + ":" + std::to_string(wanted.port) +
                                       (last > wanted.port ? " to " + std::to_string(last) : "") +
                                       ": cannot listen there: " + error.message()};
  return ViewServer(std::move(impl));
}

uint16_t ViewServer::port() const {
  BoostError ignored;
  return impl_->acceptor.local_endpoint(ignored).port();
}

void ViewServer::run(Hub& hub, const std::function<bool()>& ends) {
  impl_->hub = &hub;
  impl_->accept();
  while (!ends()) impl_->context.run_for(std::chrono::milliseconds(50));
  BoostError ignored;
  impl_->acceptor.close(ignored);
  // A page that receives this code tries to connect again. The 200 ms are for sending it, not for answers.
  const std::set<WebSocketViewer*> open = impl_->open;
  for (WebSocketViewer* const viewer : open) viewer->close(CloseCode::kEnding, "the server ends");
  impl_->context.restart();
  impl_->context.run_for(std::chrono::milliseconds(200));
  const std::set<WebSocketViewer*> left = impl_->open;
  for (WebSocketViewer* const viewer : left) viewer->cut();
  impl_->context.restart();
  impl_->context.run_for(std::chrono::milliseconds(50));
}

}  // namespace scree::tools::view
