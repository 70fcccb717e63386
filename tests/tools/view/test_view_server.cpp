// scree view over loopback: access, responses, and the cost of bad or slow pages.
#include <chrono>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "runtime/images/image.h"
#include "tests/models.h"
#include "tests/results.h"
#include "tests/sanitized.h"
#include "tests/tools/run_program.h"
#include "tests/tools/view/page_client.h"
#include "tools/convert/convert.h"
#include "tools/view/server.h"

using namespace scree::tests;
using scree::must;

namespace {

std::string get(const ViewProcess& server, const std::string& path, const std::string& host = {},
                const std::string& more = {}) {
  return http(server.port(), "GET " + path + " HTTP/1.1\r\nHost: " + (host.empty() ? server.address() : host) + "\r\n" +
                                 more + "Connection: close\r\n\r\n");
}

int status_of(const std::string& response) {
  return response.size() > 12 ? std::atoi(response.c_str() + 9) : 0;
}

bool holds(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// The code of the close frame that ends a connection; 0 if it ends without one.
uint16_t close_code(PageClient& client) {
  for (;;) {
    const auto got = client.receive();
    if (!got) return 0;
    if (got->close_code != 0) return got->close_code;
  }
}

std::vector<uint8_t> rgba_of(const std::string& file) {
  return must(scree::runtime::decode_image(std::as_bytes(std::span(file)))).rgba;
}

}  // namespace

TEST_CASE("scree view serves its page and nothing else", "[view][view-server]") {
  ViewProcess server;
  CHECK(server.token().size() == 32);
  CHECK(holds(server.output(), "ssh -N -L"));
  const std::string page = get(server, "/");
  CHECK(status_of(page) == 200);
  CHECK(holds(page, "text/html"));
  CHECK(holds(page, "default-src 'none'"));
  CHECK(holds(page, "nosniff"));
  CHECK(holds(page, "no-referrer"));
  CHECK(holds(page, "main.js"));
  CHECK_FALSE(holds(page, server.token()));
  CHECK(holds(get(server, "/main.js?v=1"), "text/javascript"));
  CHECK(status_of(get(server, "/worker.js")) == 200);
  CHECK(status_of(get(server, "/../etc/passwd")) == 404);
  CHECK(status_of(get(server, "/page/main.js")) == 404);
  CHECK(status_of(get(server, "/ws")) == 426);
  CHECK(status_of(http(server.port(), "POST / HTTP/1.1\r\nHost: " + server.address() +
                                          "\r\nConnection: close\r\nContent-Length: 0\r\n\r\n")) == 405);
  CHECK(status_of(http(server.port(),
                       "HEAD / HTTP/1.1\r\nHost: " + server.address() + "\r\nConnection: close\r\n\r\n")) == 200);

  SECTION("hosts") {
    CHECK(status_of(get(server, "/", "localhost:9999")) == 200);  // a tunnel's port
    CHECK(status_of(get(server, "/", "[::1]")) == 200);
    CHECK(status_of(get(server, "/", "evil.example")) == 421);
    CHECK(status_of(get(server, "/", "127.0.0.1.evil.example")) == 421);
    CHECK(status_of(get(server, "/", server.address(), "Host: evil.example\r\n")) == 421);
    CHECK(status_of(http(server.port(), "GET / HTTP/1.0\r\n\r\n")) == 421);
  }
  SECTION("long or broken requests") {
    CHECK(status_of(get(server, "/", {}, "X-Long: " + std::string(9000, 'x') + "\r\n")) == 400);
    CHECK(status_of(http(server.port(), "POST / HTTP/1.1\r\nHost: " + server.address() +
                                            "\r\nContent-Length: 999999999\r\n\r\n")) == 400);
    http(server.port(), std::string("\0\xff\r\n\r\n", 6));
    CHECK(status_of(get(server, "/")) == 200);
  }
}

TEST_CASE("scree view admits a page by token and origin", "[view][view-server]") {
  ViewProcess server({"--viewers", "1", "--allow-host", "viewer.example"});
  const std::string own = server.address(), origin = "http://" + own;
  const auto upgrade = [&](const std::string& host, const std::string& from) {
    PageClient client(server.port());
    return client.upgrade(host, from);
  };
  CHECK(upgrade(own, "http://evil.example") == 403);
  CHECK(upgrade(own, "http://127.0.0.1:1") == 403);  // another server on this machine
  CHECK(upgrade(own, "") == 403);
  CHECK(upgrade(own, "null") == 403);
  CHECK(upgrade("evil.example", "http://evil.example") == 421);  // DNS rebinding: host and origin are equal
  CHECK(upgrade(own, "https://viewer.example") == 101);          // a proxy that changes Host
  CHECK(upgrade("viewer.example", "https://viewer.example") == 101);

  const auto refused_with = [&](const std::string& first) {
    PageClient client(server.port());
    REQUIRE(client.upgrade(own, origin) == 101);
    client.send(first);
    return close_code(client);
  };
  CHECK(refused_with("{\"type\":\"hello\",\"token\":\"00000000000000000000000000000000\"}") == 4001);
  CHECK(refused_with("{\"type\":\"hello\",\"token\":\"\"}") == 4001);
  CHECK(refused_with(view_text(1, 64, 64)) == 4001);
  CHECK(refused_with("nothing") == 4001);

  PageClient first(server.port());
  first.join(server);
  CHECK(refused_with("{\"type\":\"hello\",\"token\":\"" + server.token() + "\"}") == 4002);  // --viewers 1
}

TEST_CASE("scree view draws the same as scree render", "[view][view-server]") {
  ViewProcess server;
  PageClient client(server.port());
  client.join(server);
  client.send(view_text(5, 160, 90, 0.5, false, 4));
  auto picture = must(client.receive_picture());
  CHECK_FALSE(picture.is_exact());
  CHECK(picture.number("seq") == 5);
  for (const uint32_t samples : {1u, 2u, 4u}) {
    client.acknowledge(picture);
    picture = must(client.receive_picture());
    CHECK(picture.is_exact());
    CHECK(picture.number("samples") == samples);
    const std::string file = server.folder().file("render.png");
    must_run({"render", server.scene(), "--size", "160x90", "--eye=0.5,0.25,2.5", "--target=0,0,0", "--up=0,1,0",
              "--fov", "45", "--background", "#20252d", "--samples", std::to_string(samples), "-o", file, "-f", "-q"},
             server.folder().file("render.log"));
    CHECK(rgba_of(picture.file) == rgba_of(read_whole(file)));
  }

  client.send("{\"type\":\"pick\",\"id\":3,\"x\":80,\"y\":45}");
  const std::string pick = client.receive_text("pick");
  CHECK(holds(pick, "\"id\":3"));
  CHECK(holds(pick, "\"nodeName\":\"Quad\""));
  client.send("{\"type\":\"probe\",\"x\":80,\"y\":45}");
  CHECK(holds(client.receive_text("point"), "\"point\":["));
  client.send("{\"type\":\"probe\",\"x\":0,\"y\":0}");
  CHECK_FALSE(holds(client.receive_text("point"), "\"point\":["));
  client.send("{\"type\":\"nodes\"}");
  CHECK(holds(client.receive_text("nodes"), "\"names\":["));
  client.send("{\"type\":\"screenshot\",\"id\":9,\"width\":33,\"height\":21,\"samples\":2}");
  const auto shot = must(client.receive_picture());
  CHECK(holds(shot.head, "screenshot"));
  CHECK(rgba_of(shot.file).size() == 33 * 21 * 4);

  client.send("{\"type\":\"hide\",\"hidden\":[0],\"only\":[]}");
  do {
    picture = must(client.receive_picture());
    client.acknowledge(picture);
  } while (!picture.is_exact());
  const std::vector<uint8_t> empty = rgba_of(picture.file);
  CHECK(std::equal(empty.begin() + 4, empty.end(), empty.begin()));  // nothing but background
  client.send("{\"type\":\"pick\",\"id\":4,\"x\":80,\"y\":45}");
  CHECK(holds(client.receive_text("pick"), "\"hit\":false"));
}

TEST_CASE("scree view reports the number of layers of its pictures", "[view][view-server][blend]") {
  const TempFolder folder;
  scree::convert::ConvertOptions options;
  options.input = data_path("glass.glb").string();
  options.output = folder.file("glass.scree");
  REQUIRE(scree::convert::convert(options));
  for (const uint64_t most : {uint64_t{16}, uint64_t{18}}) {
    ViewProcess server({"--blend-layers", std::to_string(most)}, options.output);
    PageClient client(server.port());
    client.join(server);
    client.send(view_text(1, 64, 36));
    for (bool is_exact = false; !is_exact;) {
      const auto picture = must(client.receive_picture());
      client.acknowledge(picture);
      CHECK(picture.number("blendedLayers") == most);
      CHECK((picture.number("samplesWithMoreLayers") > 0) == (most == 16));
      is_exact = picture.is_exact();
    }
  }
}

TEST_CASE("a page that never acknowledges does not slow the others", "[view][view-server]") {
  ViewProcess server;
  PageClient dead(server.port(), std::chrono::milliseconds(400)), alive(server.port());
  dead.join(server);
  alive.join(server);
  for (uint64_t i = 1; i <= 40; ++i) dead.send(view_text(i, 320, 180, 0.01 * static_cast<double>(i), true));
  size_t got = 0;
  while (dead.receive_picture()) ++got;
  CHECK(got == 2);

  const uint64_t before = server.resident();
  uint64_t shown = 0;
  for (uint64_t i = 1; i <= 60; ++i) {
    dead.send(view_text(100 + i, 320, 180, -0.01 * static_cast<double>(i), true));
    alive.send(view_text(i, 64, 36, 0.01 * static_cast<double>(i), true));
    const auto picture = must(alive.receive_picture());
    alive.acknowledge(picture);
    shown = picture.number("seq");
  }
  CHECK(shown >= 55);
  // ASan keeps up to 256 MiB of freed memory.
  CHECK(server.resident() < before + (uint64_t{kIsSanitized ? 288 : 32} << 20));
}

TEST_CASE("scree view closes connections that break its limits, and continues", "[view][view-server]") {
  ViewProcess server;
  const auto ended_by = [&](const auto& act) {
    PageClient client(server.port());
    client.join(server);
    act(client);
    return close_code(client);
  };
  CHECK(ended_by([](PageClient& client) { client.send(std::string(20000, ' ')); }) == 1009);  // RFC 6455: too big
  CHECK(ended_by([](PageClient& client) { client.send(view_text(1, 64, 64), 2); }) == 4003);
  CHECK(ended_by([](PageClient& client) { client.send("{\"type\":\"view\"}"); }) == 4003);
  CHECK(ended_by([](PageClient& client) {
          for (int i = 0; i < 400; ++i) client.send("{\"type\":\"ack\",\"frame\":1}");
        }) == 4005);
  // A camera without a direction gives an error that is not fatal. So do nodes that do not exist.
  PageClient client(server.port());
  client.join(server);
  std::string nowhere = view_text(1, 64, 64);
  nowhere.replace(nowhere.find("\"eye\":["), nowhere.find("],\"target\"") - nowhere.find("\"eye\":["),
                  "\"eye\":[0,0,0");
  client.send(nowhere);
  CHECK(holds(client.receive_text("error"), "same point"));
  // Nor is a number beyond a limit.
  client.send(view_text(1, 8192, 8192));
  CHECK(holds(client.receive_text("error"), "width times height is above"));
  client.send(view_text(2, 64, 64));
  client.send("{\"type\":\"hide\",\"hidden\":[4000000000],\"only\":[]}");
  CHECK(client.receive_picture());

  // More sockets than allowed: the surplus ones are closed at once, and later there is room again.
  {
    std::vector<std::unique_ptr<PageClient>> crowd;
    for (uint32_t i = 0; i < scree::tools::view::kMaxSockets + 6; ++i)
      crowd.push_back(std::make_unique<PageClient>(server.port(), std::chrono::milliseconds(2000)));
    CHECK(crowd.back()->read_all().empty());
  }
  CHECK(scree::tests::wait_until([&] { return status_of(get(server, "/")) == 200; }, std::chrono::seconds(2)));
}

TEST_CASE("acknowledgements of pictures do not count as messages", "[view][view-server]") {
  ViewProcess server;
  PageClient client(server.port());
  client.join(server);
  client.send(view_text(1, 64, 36));
  const auto moving = must(client.receive_picture());
  const auto exact = must(client.receive_picture());
  std::this_thread::sleep_for(std::chrono::milliseconds(1100));  // the next message starts a new second
  for (uint32_t i = 1; i < scree::tools::view::kMaxMessagesPerSecond; ++i)
    client.send("{\"type\":\"probe\",\"x\":0,\"y\":0}");
  client.acknowledge(moving);
  client.acknowledge(exact);
  client.send(view_text(2, 64, 36, 0.25));
  CHECK(client.receive_picture());
}

TEST_CASE("viewers follow each other, and Ctrl-C ends scree view within a second", "[view][view-server]") {
  ViewProcess server({"--base-path", "scree/"});
  CHECK(status_of(get(server, "/scree")) == 308);
  CHECK(status_of(get(server, "/scree/")) == 200);
  CHECK(status_of(get(server, "/scree/main.js")) == 200);
  CHECK(status_of(get(server, "/main.js")) == 200);  // as from a proxy that strips the path
  CHECK(status_of(get(server, "/screen/main.js")) == 404);
  PageClient leader(server.port()), follower(server.port());
  leader.join(server);
  follower.join(server);
  follower.send("{\"type\":\"follow\",\"viewer\":1}");
  leader.send(view_text(1, 64, 64, 0.125));
  CHECK(holds(follower.receive_text("camera"), "\"eye\":[0.125,0.25,2.5]"));
  const ViewProcess::End end = server.interrupt();
  CHECK(end.exit_code == 0);
  CHECK(end.seconds < 1);
  CHECK(close_code(leader) == 4000);
}

TEST_CASE("eight viewers move at once, each with its own camera, and one follows another", "[view][view-server]") {
  ViewProcess server;
  constexpr size_t kViewers = 8;
  constexpr uint64_t kMoves = kIsSanitized ? 10 : 40;
  std::vector<std::unique_ptr<PageClient>> pages;
  for (size_t i = 0; i < kViewers; ++i) {
    pages.push_back(std::make_unique<PageClient>(server.port()));
    pages.back()->join(server);
  }
  const uint64_t before = server.resident();
  // Each viewer has its own picture: the last exact one of viewer i shows the camera of viewer i.
  std::vector<std::string> last(kViewers);
  std::vector<uint64_t> shown(kViewers, 0);
  std::vector<std::thread> threads;
  for (size_t i = 0; i + 1 < kViewers; ++i)
    threads.emplace_back([&, i] {
      // These threads use no Catch macros, which are for one thread only.
      for (uint64_t move = 1; move <= kMoves; ++move) {
        const bool is_last = move == kMoves;
        const double eye = is_last ? 0.1 * static_cast<double>(i) : 0.01 * static_cast<double>(move);
        pages[i]->send(view_text(move, 64, 36, eye, !is_last));
        for (;;) {
          const auto got = pages[i]->receive();
          if (!got || got->close_code != 0) return;
          if (got->is_text) continue;
          const size_t head = static_cast<unsigned char>(got->bytes[0]) | static_cast<unsigned char>(got->bytes[1])
                                                                              << 8;
          const PageClient::Picture picture{got->bytes.substr(4, head), got->bytes.substr(4 + head)};
          pages[i]->acknowledge(picture);
          shown[i] = picture.number("seq");
          const bool is_exact = is_last && shown[i] == move && picture.is_exact();
          if (is_exact) last[i] = picture.file;
          if (is_last ? is_exact : shown[i] == move) break;
        }
      }
    });
  PageClient& follower = *pages.back();
  follower.send("{\"type\":\"follow\",\"viewer\":1}");
  for (std::thread& thread : threads) thread.join();
  for (size_t i = 0; i + 1 < kViewers; ++i) {
    INFO("viewer " << i);
    CHECK(shown[i] == kMoves);
    CHECK_FALSE(last[i].empty());
    for (size_t j = 0; j < i; ++j) CHECK(last[i] != last[j]);
  }
  CHECK(holds(follower.receive_text("camera"), "\"viewer\":1"));
  CHECK(server.resident() < before + (uint64_t{kIsSanitized ? 288 : 48} << 20));
}

TEST_CASE("scree view ends if its file is overwritten", "[view][view-server]") {
  ViewProcess server;
  PageClient client(server.port());
  client.join(server);
  client.send(view_text(1, 64, 36));
  CHECK(client.receive_picture());
  std::this_thread::sleep_for(std::chrono::milliseconds(20));  // times of files have the steps of the system's clock
  std::fstream(server.scene(), std::ios::in | std::ios::out | std::ios::binary).put('x');
  client.send(view_text(2, 64, 36, 0.25));
  CHECK(close_code(client) == 4000);
  CHECK(server.wait().exit_code == 2);
  CHECK(holds(server.output(), server.scene() + ": cannot read: the file was changed while it was read"));
}

TEST_CASE("scree view names errors in its arguments", "[view][view-server]") {
  TempFolder folder;
  const auto run = [&](std::vector<std::string> words) {
    words.insert(words.begin(), "view");
    return run_program(words, folder.file("log"));
  };
  ProgramRun done = run({folder.file("none.scree")});
  CHECK(done.exit_code == 2);
  CHECK(holds(done.output, "none.scree"));
  folder.write("bad.scree", "not a scene");
  CHECK(run({folder.file("bad.scree")}).exit_code == 3);
  ViewProcess server;
  CHECK(run({server.scene(), "--port", "70000"}).exit_code == 1);
  CHECK(run({server.scene(), "--host", "nowhere"}).exit_code == 1);
  CHECK(run({server.scene(), "--base-path", "/a/../b"}).exit_code == 1);
  CHECK(run({server.scene(), "--allow-host", "http://x"}).exit_code == 1);
  done = run({server.scene(), "--port", std::to_string(server.port())});
  CHECK(done.exit_code == 2);
  CHECK(holds(done.output, "cannot listen"));
}
