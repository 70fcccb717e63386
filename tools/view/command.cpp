// scree view: serves pictures of a scene, and the page that shows them.
#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <iterator>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "runtime/scene/scene.h"
#include "tools/common/options/backend.h"
#include "tools/common/options/command.h"
#include "tools/common/options/options.h"
#include "tools/common/output/standard_output.h"
#include "tools/common/process/stop_signal.h"
#include "tools/view/access.h"
#include "tools/view/hub.h"
#include "tools/view/server.h"

extern char** environ;

namespace scree::tools {
namespace {

/// The options as typed; empty if not given.
struct ViewWords : DeviceWords {
  std::string file;
  std::string scene;
  std::string host = "127.0.0.1";
  std::string port;
  std::string base_path;
  std::vector<std::string> allowed_hosts;
  std::string viewers = "8";
  TextureWords textures;
  LightWords light;
  bool open = false;
  bool quiet = false;
};

struct ViewOptions {
  view::SessionOptions session;
  view::ServerOptions server;
  bool open = false;
  bool quiet = false;
};

Result<ViewOptions> parse_view_options(const ViewWords& words) {
  ViewOptions options;
  options.open = words.open;
  options.quiet = words.quiet;
  options.session.file = words.file;
  options.session.scene = words.scene;
  options.session.quiet = words.quiet;
  SCREE_TRY(assign<DeviceOptions>(options.session, parse_device_options(words)));
  options.session.light = SCREE_TRY(parse_light_options(words.light));
  options.session.textures = SCREE_TRY(parse_texture_options(words.textures));
  SCREE_TRY(assign(options.server.host, view::address_of(words.host)));
  options.server.is_port_fixed = !words.port.empty();
  if (options.server.is_port_fixed) SCREE_TRY(assign(options.server.port, parse_whole(words.port, 0, 65535, "--port")));
  options.server.base_path = SCREE_TRY(view::parse_base_path(words.base_path));
  for (const std::string& host : words.allowed_hosts) {
    if (view::host_of(host).empty() || (host.find(':') != std::string::npos && host.front() != '['))
      return Error{ErrorCode::kUsage, "--allow-host: '" + host + "' is not a host name without a port"};
    options.server.allowed_hosts.push_back(host);
  }
  SCREE_TRY(assign(options.server.max_viewers, parse_whole(words.viewers, 1, view::kMaxSockets / 2, "--viewers")));
  return options;
}

std::string host_name() {
  char name[256] = {};
  return ::gethostname(name, sizeof name - 1) == 0 && name[0] != 0 ? name : "HOST";
}

std::string user_name() {
  const char* const name = std::getenv("USER");
  return name != nullptr && name[0] != 0 ? name : "USER";
}

/// `host` in the form for an address: "[::1]".
std::string bracketed(const std::string& host) {
  return host.find(':') == std::string::npos ? host : "[" + host + "]";
}

/// "http://127.0.0.1:8080/scree/#token=...".
std::string page_url(const view::ServerOptions& options, uint16_t port) {
  const bool is_any_address = options.host == "0.0.0.0" || options.host == "::";
  const std::string host = bracketed(is_any_address ? host_name() : options.host);
  return "http://" + host + ":" + std::to_string(port) + options.base_path + "/#token=" + options.token;
}

void print_places(const view::ServerOptions& options, uint16_t port) {
  std::printf("%s\n", page_url(options, port).c_str());
  if (view::is_loopback(options.host)) {
    const std::string number = std::to_string(port);
    std::printf("from another machine: ssh -N -L %s:%s:%s %s@%s, then the same address there\n", number.c_str(),
                bracketed(options.host).c_str(), number.c_str(), user_name().c_str(), host_name().c_str());
  }
  std::fflush(stdout);
}

/// Opens a browser with a file that redirects to the server's address. Only this user can read the file, while other
/// users could read a command line, and so the token. The file is removed at the end of the program.
class BrowserPage {
 public:
  explicit BrowserPage(const std::string& url) {
    const char* const folder = std::getenv("XDG_RUNTIME_DIR");
    path_ = std::string(folder != nullptr && folder[0] == '/' ? folder : "/tmp") + "/scree-view-XXXXXX.html";
    const int file = ::mkstemps(path_.data(), 5);  // mode 0600
    if (file < 0) {
      path_.clear();
      return;
    }
    const std::string page = "<!doctype html><meta http-equiv=\"refresh\" content=\"0;url=" + url + "\">\n";
    const bool written = ::write(file, page.data(), page.size()) == static_cast<ssize_t>(page.size());
    ::close(file);
    if (!written) return;
    std::string program = "xdg-open", argument = "file://" + path_;
    char* words[] = {program.data(), argument.data(), nullptr};
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    for (const int output : {STDOUT_FILENO, STDERR_FILENO})
      posix_spawn_file_actions_addopen(&actions, output, "/dev/null", O_WRONLY, 0);
    pid_t child = 0;
    is_opened_ = ::posix_spawnp(&child, "xdg-open", &actions, nullptr, words, environ) == 0;
    posix_spawn_file_actions_destroy(&actions);
    if (is_opened_) std::thread([child] { ::waitpid(child, nullptr, 0); }).detach();
  }
  BrowserPage(const BrowserPage&) = delete;
  BrowserPage& operator=(const BrowserPage&) = delete;
  ~BrowserPage() {
    if (!path_.empty()) ::unlink(path_.c_str());
  }
  bool is_opened() const { return is_opened_; }

 private:
  std::string path_;
  bool is_opened_ = false;
};

Result<void> serve(ViewOptions options) {
  // A wrong name or a damaged file is an error of the command, not of a page.
  runtime::SceneFile file = SCREE_TRY(runtime::SceneFile::open(options.session.file));
  SCREE_TRY(file.find_scene(options.session.scene));
  options.server.token = SCREE_TRY(view::make_token());
  if (!view::is_loopback(options.server.host) && !options.quiet)
    std::fprintf(
        stderr,
        "scree view: warning: --host %s: other machines can connect, and nothing is encrypted; use an SSH tunnel or "
        "a proxy with TLS where others share the network\n",
        options.server.host.c_str());
  const StopOnSignal handlers("no longer served");
  view::ViewServer listening = SCREE_TRY(view::ViewServer::listen(options.server));
  auto server = std::make_unique<view::ViewServer>(std::move(listening));
  print_places(options.server, server->port());
  std::optional<BrowserPage> page;
  if (options.open) {
    page.emplace(page_url(options.server, server->port()));
    if (!page->is_opened() && !options.quiet)
      std::fprintf(stderr, "scree view: warning: --open: xdg-open does not start; open the address yourself\n");
  }

  std::mutex mutex;
  std::optional<Error> failure;  // of the hub's thread
  const auto failed = [&] {
    const std::lock_guard lock(mutex);
    return failure;
  };
  auto hub = std::make_unique<view::Hub>(options.session, [&](Error error) {
    const std::lock_guard lock(mutex);
    failure = std::move(error);
  });
  server->run(*hub, [&] { return StopOnSignal::flag()->load() || failed(); });
  if (!hub->stop(std::chrono::milliseconds(500)) && !failed()) {
    // A picture is still being drawn. It is not needed any more, so the program does not wait for it.
    if (!options.quiet) std::fprintf(stderr, "scree view: stopped\n");
    std::_Exit(finish_output() ? 0 : exit_code(ErrorCode::kFile));
  }
  hub.reset();
  if (const std::optional<Error> error = failed()) return *error;
  if (!options.quiet) std::fprintf(stderr, "scree view: stopped\n");
  return finish_output();
}

}  // namespace

Command add_view(CLI::App& parent) {
  const auto words = std::make_shared<ViewWords>();
  CLI::App* app =
      parent.add_subcommand("view", "Serves a scene to browsers, for looking around, picking and measuring");
  app->add_option("file", words->file, "The scene: a .scree file")->required();
  add_value(*app, "--scene", "NAME", words->scene,
            "Scene of the file, by name or number (default: the file's default)");
  app->add_flag("--open", words->open, "Open the page in this machine's browser");
  add_value(*app, "--host", "HOST", words->host,
            "The address to listen on (default: 127.0.0.1, reachable only from this machine)");
  add_value(*app, "--port", "N", words->port,
            "The port to listen on; 0: any free port (default: the first free port of the 20 from 8080 on)");
  add_value(*app, "--base-path", "PATH", words->base_path, "Path under which a proxy serves the page, such as /scree");
  add_repeated(*app, "--allow-host", "HOST", words->allowed_hosts,
               "Host name that browsers may use, such as the name of a proxy; may be repeated");
  add_value(*app, "--viewers", "N", words->viewers,
            "Largest number of pages that are open at the same time, 1 to 32 (default: 8)");
  add_device_options(*app, *words);
  add_texture_options(*app, words->textures);
  add_light_options(*app, words->light);
  app->add_flag("-q,--quiet", words->quiet, "No warnings");
  return {app, [words]() -> Result<void> {
            ViewOptions options = SCREE_TRY(parse_view_options(*words));
            return serve(std::move(options));
          }};
}

}  // namespace scree::tools
