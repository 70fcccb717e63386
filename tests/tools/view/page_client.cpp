#include "tests/tools/view/page_client.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <thread>

#include "tests/runtime/small_scene.h"
#include "tests/tools/run_program.h"

namespace scree::tests {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

ViewProcess::ViewProcess(const std::vector<std::string>& more_words, const std::string& scene) {
  scene_ = scene.empty() ? folder_.file("small.scree") : scene;
  if (scene.empty()) SmallScene{}.write(scene_);
  std::vector<std::string> words{"view", scene_, "--port", "0", "--backend", "cpu", "--threads", "2"};
  words.insert(words.end(), more_words.begin(), more_words.end());
  child_ = start_program(words, folder_.file("log"));
  for (const auto start = Clock::now(); Clock::now() - start < 30s; std::this_thread::sleep_for(10ms)) {
    const std::string text = output();
    const size_t mark = text.find("#token="), line = text.find('\n', mark);
    if (mark == std::string::npos || line == std::string::npos) continue;
    token_ = text.substr(mark + 7, 32);
    const size_t colon = text.rfind(':', mark);
    port_ = static_cast<uint16_t>(std::atoi(text.c_str() + colon + 1));
    break;
  }
  INFO(output());
  REQUIRE(port_ != 0);
}

ViewProcess::~ViewProcess() {
  if (child_ > 0) interrupt();
}

std::string ViewProcess::output() const {
  return read_whole(folder_.file("log"));
}

uint64_t ViewProcess::resident() const {
  std::ifstream in("/proc/" + std::to_string(child_) + "/statm");
  uint64_t size = 0, resident = 0;
  in >> size >> resident;
  return resident * static_cast<uint64_t>(::sysconf(_SC_PAGESIZE));
}

ViewProcess::End ViewProcess::interrupt() {
  ::kill(child_, SIGINT);
  return wait();
}

ViewProcess::End ViewProcess::wait() {
  const auto start = Clock::now();
  int status = 0;
  ::waitpid(child_, &status, 0);
  child_ = -1;
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, std::chrono::duration<double>(Clock::now() - start).count()};
}

PageClient::PageClient(uint16_t port, std::chrono::milliseconds patience) {
  socket_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  REQUIRE(socket_ >= 0);
  const timeval time{patience.count() / 1000, patience.count() % 1000 * 1000};
  ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &time, sizeof time);
  ::setsockopt(socket_, SOL_SOCKET, SO_SNDTIMEO, &time, sizeof time);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  REQUIRE(::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
}

PageClient::~PageClient() {
  if (socket_ >= 0) ::close(socket_);
}

void PageClient::send_raw(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t sent = ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent <= 0) return;  // the other side has closed; its answer states the reason
    bytes.remove_prefix(static_cast<size_t>(sent));
  }
}

bool PageClient::read_exactly(char* out, size_t count) {
  while (count > 0) {
    const ssize_t got = ::recv(socket_, out, count, 0);
    if (got <= 0) return false;
    out += got;
    count -= static_cast<size_t>(got);
  }
  return true;
}

std::string PageClient::read_all() {
  std::string all;
  char block[4096];
  for (ssize_t got; (got = ::recv(socket_, block, sizeof block, 0)) > 0;) all.append(block, static_cast<size_t>(got));
  return all;
}

int PageClient::upgrade(const std::string& host, const std::string& origin, const std::string& path) {
  send_raw("GET " + path + " HTTP/1.1\r\n" + (host.empty() ? "" : "Host: " + host + "\r\n") +
           (origin.empty() ? "" : "Origin: " + origin + "\r\n") +
           "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
           "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n");
  std::string head;
  for (char byte; head.find("\r\n\r\n") == std::string::npos && read_exactly(&byte, 1);) head += byte;
  return head.size() > 12 ? std::atoi(head.c_str() + 9) : 0;
}

void PageClient::join(const ViewProcess& server) {
  REQUIRE(upgrade(server.address(), "http://" + server.address()) == 101);
  send("{\"type\":\"hello\",\"token\":\"" + server.token() + "\"}");
  receive_text("scene");
}

void PageClient::send(std::string_view message, uint8_t opcode) {
  std::string frame;
  frame += static_cast<char>(0x80 | opcode);
  if (message.size() < 126) {
    frame += static_cast<char>(0x80 | message.size());
  } else if (message.size() < 65536) {
    frame += static_cast<char>(0x80 | 126);
    frame += static_cast<char>(message.size() >> 8);
    frame += static_cast<char>(message.size());
  } else {
    frame += static_cast<char>(0x80 | 127);
    for (int shift = 56; shift >= 0; shift -= 8) frame += static_cast<char>(message.size() >> shift);
  }
  frame.append(4, '\0');  // a mask that changes nothing
  frame += message;
  send_raw(frame);
}

std::optional<PageClient::Received> PageClient::receive(Clock::time_point until) {
  Received parts;  // of a message in several frames, between which pings may arrive
  while (Clock::now() < until) {
    unsigned char head[2];
    if (!read_exactly(reinterpret_cast<char*>(head), 2)) return std::nullopt;
    uint64_t size = head[1] & 127u;
    unsigned char longer[8];
    const size_t more = size == 126 ? 2 : size == 127 ? 8 : 0;
    if (!read_exactly(reinterpret_cast<char*>(longer), more)) return std::nullopt;
    if (more != 0) size = 0;
    for (size_t i = 0; i < more; ++i) size = size << 8 | longer[i];
    std::string bytes(size, 0);
    if (!read_exactly(bytes.data(), bytes.size())) return std::nullopt;
    const unsigned opcode = head[0] & 15u;
    if (opcode == 9) {
      send(bytes, 10);
      continue;
    }
    if (opcode < 8 && (opcode == 0 || (head[0] & 128) == 0)) {
      if (opcode != 0) parts.is_text = opcode == 1;
      parts.bytes += bytes;
      if ((head[0] & 128) != 0) return parts;
      continue;
    }
    Received out{.is_text = opcode == 1};
    if (opcode == 8 && bytes.size() >= 2)
      out.close_code =
          static_cast<uint16_t>(static_cast<unsigned char>(bytes[0]) << 8 | static_cast<unsigned char>(bytes[1]));
    out.bytes = std::move(bytes);
    return out;
  }
  return std::nullopt;
}

std::string PageClient::receive_text(std::string_view type) {
  const std::string start = "{\"type\":\"" + std::string(type) + "\"";
  const Clock::time_point until = Clock::now() + kLongestWait;
  for (;;) {
    const std::optional<Received> got = receive(until);
    INFO("waiting for " << type);
    REQUIRE(got);
    INFO(got->bytes);
    REQUIRE(got->close_code == 0);
    if (got->is_text && got->bytes.starts_with(start)) return got->bytes;
  }
}

uint64_t PageClient::Picture::number(std::string_view name) const {
  const size_t at = head.find("\"" + std::string(name) + "\":");
  return at == std::string::npos ? 0 : std::strtoull(head.c_str() + at + name.size() + 3, nullptr, 10);
}

std::optional<PageClient::Picture> PageClient::receive_picture() {
  const Clock::time_point until = Clock::now() + kLongestWait;
  for (;;) {
    const std::optional<Received> got = receive(until);
    if (!got || got->close_code != 0) return std::nullopt;
    if (got->is_text) {
      INFO(got->bytes);
      CHECK_FALSE(got->bytes.starts_with("{\"type\":\"error\""));
      continue;
    }
    REQUIRE(got->bytes.size() > 4);
    size_t head = 0;
    for (size_t i = 0; i < 4; ++i) head |= size_t{static_cast<unsigned char>(got->bytes[i])} << (8 * i);
    REQUIRE(head + 4 < got->bytes.size());
    return Picture{got->bytes.substr(4, head), got->bytes.substr(4 + head)};
  }
}

void PageClient::acknowledge(const Picture& picture) {
  send("{\"type\":\"ack\",\"frame\":" + std::to_string(picture.number("frame")) + "}");
}

std::string view_text(uint64_t sequence, uint32_t width, uint32_t height, double eye_x, bool moving, uint32_t samples) {
  char text[512];
  std::snprintf(
      text, sizeof text,
      "{\"type\":\"view\",\"seq\":%llu,\"eye\":[%.17g,0.25,2.5],\"target\":[0,0,0],\"up\":[0,1,0],\"fov\":45,"
      "\"width\":%u,\"height\":%u,\"show\":\"texture\",\"light\":true,\"shadows\":false,\"ssao\":false,\"edl\":false,"
      "\"edlStrength\":1,\"edlRadius\":1,\"samples\":%u,\"background\":\"#20252d\",\"moving\":%s,\"full\":false}",
      static_cast<unsigned long long>(sequence), eye_x, width, height, samples, moving ? "true" : "false");
  return text;
}

std::string http(uint16_t port, std::string_view request) {
  PageClient client(port);
  client.send_raw(request);
  return client.read_all();
}

}  // namespace scree::tests
