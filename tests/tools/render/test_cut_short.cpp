// A .scree file that is truncated while it is drawn gives one line, exit code 2, and no output.
#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <numeric>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "runtime/files/mapped_file.h"
#include "runtime/scene/camera.h"
#include "runtime/scene/scene.h"
#include "runtime/stream/chunk_source.h"
#include "tests/gpu.h"
#include "tests/runtime/stream/cpu_stream.h"
#include "tests/tools/convert/convert_fixture.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/run_program.h"
#include "tools/common/process/sigbus.h"
#include "tools/export/export.h"
#include "tools/inspect/inspect.h"

namespace scree::tests {
namespace {

// The limit for work that takes seconds on an idle machine.
constexpr std::chrono::seconds kDeadline{120};

std::string line_of(const std::string& file, const std::string& command = "render") {
  return "scree " + command + ": " + file +
         ": cannot read: the file was cut short while it was read, or its disk failed (SIGBUS)\n";
}

/// A square of triangles with incompressible corner positions.
void write_noise(const std::string& path) {
  constexpr uint32_t kSide = 500;
  std::mt19937 random(7);
  std::uniform_real_distribution<float> unit(0, 1);
  std::vector<float> points;
  std::vector<uint32_t> corners;
  for (uint32_t y = 0; y <= kSide; ++y)
    for (uint32_t x = 0; x <= kSide; ++x)
      points.insert(points.end(),
                    {static_cast<float>(x) + unit(random), kSide * unit(random), static_cast<float>(y) + unit(random)});
  for (uint32_t y = 0; y < kSide; ++y)
    for (uint32_t x = 0; x < kSide; ++x) {
      const uint32_t at = y * (kSide + 1) + x, below = at + kSide + 1;
      corners.insert(corners.end(), {at, below, at + 1, at + 1, below, below + 1});
    }
  make_model(path, points, corners);
}

/// Cuts the last byte, which belongs to the table of contents. An open file does not need it any more, so no read
/// reaches the file's end.
void cut_last_byte(const std::string& path) {
  std::filesystem::resize_file(path, std::filesystem::file_size(path) - 1);
}

/// A file of some megabytes, in chunks that are streamed one by one, and the program that draws it until it ends.
class CutFile {
 public:
  explicit CutFile(int zstd_level, convert::Encoding encoding = convert::Encoding::kClustered) {
    write_noise(folder_.file("in.glb"));
    convert::ConvertOptions options = options_of(folder_);
    options.zstd_level = zstd_level;
    options.encoding = encoding;
    options.chunk_triangles = 8192;
    options.position_bits = 24;
    must_convert(options);
    REQUIRE(std::filesystem::file_size(path()) > uint64_t{2} << 20);
    folder_.write("out.png", "earlier");
  }

  const TempFolder& folder() const { return folder_; }
  std::string path() const { return folder_.file("out.scree"); }

  uint64_t bytes_but_the_last() const { return std::filesystem::file_size(path()) - 1; }

  /// Offset of the last page, plus one byte.
  uint64_t bytes_to_the_last_page() const {
    constexpr uint64_t kPageBytes = 4096;
    return bytes_but_the_last() / kPageBytes * kPageBytes + 1;
  }

  /// Truncates the file to `to_bytes` when half of the command's work is done. `words`: a command that writes its own
  /// outputs to the folder.
  void cut_halfway(const std::vector<std::string>& words, double seconds_of_all, uint64_t to_bytes) const {
    must_end(words, seconds_of_all / 2, to_bytes);
  }

  /// Truncates the file, to nothing and to half, once frames are drawn one after another. `words`: arguments of render,
  /// in addition to the file and its picture.
  void cut_while_drawn(const std::vector<std::string>& words) const {
    const auto command = [&](const char* frames, const std::string& picture) {
      std::vector<std::string> all = words_of("render --force --quiet --size 160x120 --frames " + std::string(frames));
      all.insert(all.end(), {path(), "-o", picture});
      all.insert(all.end(), words.begin(), words.end());
      return all;
    };
    // The time before the second frame is shorter than a complete run with one frame.
    const std::string once = folder_.file("once.png");
    const ProgramRun one = must_run(command("1", once), folder_.file("log"));
    std::filesystem::remove(once);
    const std::string whole = read_whole(path());
    for (const uint64_t bytes : {uint64_t{0}, whole.size() / 2}) {
      CAPTURE(bytes);
      folder_.write("out.scree", whole);
      must_end(command("1000000", folder_.file("out.png")), 2 * one.seconds + 0.2, bytes);
    }
  }

 private:
  /// Runs the command, and truncates the file to `to_bytes` after `seconds` of processor time.
  void must_end(const std::vector<std::string>& command, double seconds, uint64_t to_bytes) const {
    const pid_t child = start_program(command, folder_.file("log"));
    const auto goes_on = [&] { return maps_file(child) && seconds_of(child) > seconds; };
    wait_until([&] { return goes_on() || has_ended(child); }, kDeadline);
    const bool is_drawing = goes_on() && !has_ended(child);
    std::filesystem::resize_file(path(), to_bytes);
    const bool ended = wait_until([&] { return has_ended(child); }, kDeadline);
    if (!ended) kill(child, SIGKILL);
    const int status = wait_for(child);
    CHECK(is_drawing);
    CHECK(ended);
    REQUIRE(WIFEXITED(status));
    CHECK(WEXITSTATUS(status) == 2);
    CHECK(read_whole(folder_.file("log")) == line_of(path(), command[0]));
    CHECK(read_whole(folder_.file("out.png")) == "earlier");
    CHECK(folder_.names() == std::vector<std::string>{"in.glb", "log", "out.png", "out.scree"});
  }

  bool maps_file(pid_t process) const {
    return read_whole("/proc/" + std::to_string(process) + "/maps").find(path()) != std::string::npos;
  }

  /// Processor time, user and system.
  static double seconds_of(pid_t process) {
    const std::string text = read_whole("/proc/" + std::to_string(process) + "/stat");
    unsigned long user = 0, system = 0;
    const size_t name_end = text.rfind(')');
    if (name_end == std::string::npos ||
        std::sscanf(text.c_str() + name_end, ") %*c %*d %*d %*d %*d %*d %*u %*u %*u %*u %*u %lu %lu", &user, &system) !=
            2)
      return 0;
    return static_cast<double>(user + system) / static_cast<double>(sysconf(_SC_CLK_TCK));
  }

  TempFolder folder_;
};

/// The output of a child process on stderr until its end, and the way it ended.
struct ChildEnd {
  int status = 0;
  std::string errors;
};

/// Runs `body` in a child process, which an alarm ends as the last resort. `meanwhile` runs here once the child has
/// called the function that `body` gets. `child`: its process id.
template <class Body, class Meanwhile>
ChildEnd run_child(pid_t& child, const Body& body, const Meanwhile& meanwhile) {
  int errors[2], ready[2];
  REQUIRE(::pipe(errors) == 0);
  REQUIRE(::pipe(ready) == 0);
  child = ::fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    ::alarm(kDeadline.count());
    ::dup2(errors[1], STDERR_FILENO);
    ::close(ready[0]);
    body([&] { (void)!::write(ready[1], "r", 1); });
    ::_exit(98);
  }
  ::close(errors[1]);
  ::close(ready[1]);
  char buffer[256];
  const bool is_ready = ::read(ready[0], buffer, 1) == 1;
  if (is_ready) meanwhile();
  ChildEnd end;
  for (ssize_t count; (count = ::read(errors[0], buffer, sizeof buffer)) > 0;)
    end.errors.append(buffer, static_cast<size_t>(count));
  ::close(errors[0]);
  ::close(ready[0]);
  end.status = wait_for(child);
  CHECK(is_ready);
  return end;
}

/// Writes to a pipe until it is full, so that further writers wait.
void fill(int pipe_end) {
  const int flags = ::fcntl(pipe_end, F_GETFL);
  ::fcntl(pipe_end, F_SETFL, flags | O_NONBLOCK);
  while (::write(pipe_end, "\n", 1) == 1) {
  }
  ::fcntl(pipe_end, F_SETFL, flags);
}

uint64_t sleeping_threads(pid_t process) {
  uint64_t count = 0;
  for (const auto& task : std::filesystem::directory_iterator("/proc/" + std::to_string(process) + "/task")) {
    const std::string text = read_whole(task.path() / "stat");
    const size_t name_end = text.rfind(") ");
    count += name_end != std::string::npos && text[name_end + 2] == 'S' ? 1 : 0;
  }
  return count;
}

/// Draws frames from a pool that holds a third of the chunks, until something ends the process.
template <class Ready>
void stream_frames(const std::string& path, const Ready& ready) {
  const Result<runtime::Scene> scene = runtime::Scene::open(path, {.threads = 2, .pages = false});
  if (!scene) return;
  const std::vector<uint64_t> bytes = runtime::ChunkSource(*scene).chunk_bytes();
  const uint64_t all = std::accumulate(bytes.begin(), bytes.end(), uint64_t{0});
  const auto stream = tests::CpuStream::create(*scene, all / 3, 2);
  if (!stream) return;
  for (uint64_t frame = 0;; ++frame) {
    const runtime::CameraOptions camera{.eye = runtime::Vec3{250, 1200, frame % 2 == 0 ? 750.0 : -250.0},
                                        .target = runtime::Vec3{250, 0, 250},
                                        .width = 160,
                                        .height = 120};
    const Result<kernels::View> view = runtime::make_view(*scene, camera);
    if (!view) return;
    const Result<runtime::StreamStats> drawn = (*stream)->draw_frame(*view, nullptr);
    if (!drawn || drawn->streamed_bytes == 0) return;
    if (frame == 2) ready();
  }
}

}  // namespace

TEST_CASE("a file cut short while it is drawn ends in one line and exit code 2", "[render][cut]") {
  CutFile(0, GENERATE(convert::Encoding::kClustered, convert::Encoding::kIndexed))
      .cut_while_drawn({"--backend", "cpu", "--threads", "4"});
}

// Frames continue from memory: from unpacked copies of compressed pages and copies of tables, or from zeros behind the
// end within the last page. The check of the file's size before a picture is written ends the program.
TEST_CASE("a file that is cut behind the parts that frames read ends in the same line", "[render][cut]") {
  enum class Left { kAllButAByte, kToTheLastPage, kNothing };
  const auto [zstd_level, left] =
      GENERATE(table<int, Left>({{0, Left::kAllButAByte}, {0, Left::kToTheLastPage}, {3, Left::kNothing}}));
  CAPTURE(zstd_level, left);
  const CutFile file(zstd_level);
  const auto command = [&](uint32_t frames) {
    return std::vector<std::string>{"render",    file.path(), "-o",       file.folder().file("out.png"),
                                    "--force",   "--quiet",   "--size",   "160x120",
                                    "--backend", "cpu",       "--frames", std::to_string(frames)};
  };
  uint32_t frames = 1;
  ProgramRun all;
  do {
    frames *= 2;
    all = must_run(command(frames), file.folder().file("log"));
  } while (all.seconds < 1);
  file.folder().write("out.png", "earlier");
  file.cut_halfway(command(frames), all.seconds,
                   left == Left::kAllButAByte     ? file.bytes_but_the_last()
                   : left == Left::kToTheLastPage ? file.bytes_to_the_last_page()
                                                  : 0);
}

TEST_CASE("a file cut within its last page while it is compared ends in the same line", "[compare][cut]") {
  const CutFile file(0);
  const std::vector<std::string> command{
      "compare", file.path(), file.folder().file("in.glb"), "-o", file.folder().file("out.png"), "--force",
      "--size",  "160x120"};
  const ProgramRun all = must_run(command, file.folder().file("log"));
  file.folder().write("out.png", "earlier");
  file.cut_halfway(command, all.seconds, file.bytes_but_the_last());
}

TEST_CASE("a file cut within its last page while it is exported leaves no output", "[export][cut]") {
  const CutFile file(0);
  const PackedFile opened = must_open(file.path());
  file.folder().write("out.glb", "earlier");
  const tools::ExportOptions options{.check_source = [&] {
    CHECK(read_whole(file.folder().file("out.glb")) == "earlier");
    CHECK(tools::check_unchanged(opened.map));
    cut_last_byte(file.path());
    return tools::check_unchanged(opened.map);
  }};
  const auto exported = refusal(tools::export_gltf(opened.file, file.folder().file("out.glb"), options));
  CHECK(exported.code == ErrorCode::kFile);
  CHECK("scree render: " + exported.message + "\n" == line_of(file.path()));
  CHECK(file.folder().names() == std::vector<std::string>{"in.glb", "out.glb", "out.png", "out.scree"});
  CHECK(read_whole(file.folder().file("out.glb")) == "earlier");
}

TEST_CASE("a file cut within its last page while a report of it is printed is an error", "[inspect][cut]") {
  const CutFile file(0);
  const std::string path = file.path();
  struct Cut {
    std::string path;
    bool is_done = false;
  } cut{path};
  cookie_io_functions_t cuts{};
  cuts.write = [](void* cookie, const char*, size_t size) {
    auto& once = *static_cast<Cut*>(cookie);
    if (!std::exchange(once.is_done, true)) cut_last_byte(once.path);  // when the first bytes arrive
    return static_cast<ssize_t>(size);
  };
  std::FILE* const out = fopencookie(&cut, "w", cuts);
  REQUIRE(out != nullptr);
  std::setvbuf(out, nullptr, _IONBF, 0);
  const Result<void> inspected = inspect::inspect_file(path, {}, out);
  std::fclose(out);
  REQUIRE_FALSE(inspected);
  CHECK("scree inspect: " + inspected.error().message + "\n" == line_of(path, "inspect"));
  CHECK(inspected.error().code == ErrorCode::kFile);
}

TEST_CASE("a file cut short while chunks are streamed ends in one line and exit code 2", "[render][cut][stream]") {
  const int zstd_level = GENERATE(0, 3);
  const bool to_nothing = GENERATE(true, false);
  CAPTURE(zstd_level, to_nothing);
  const CutFile file(zstd_level);
  pid_t process = -1;
  const ChildEnd end = run_child(
      process,
      [&](const auto& ready) {
        tools::report_sigbus("render", file.path());
        stream_frames(file.path(), ready);
      },
      [&] { std::filesystem::resize_file(file.path(), to_nothing ? 0 : std::filesystem::file_size(file.path()) / 2); });
  CHECK(end.errors == line_of(file.path()));
  REQUIRE(WIFEXITED(end.status));
  CHECK(WEXITSTATUS(end.status) == 2);
}

TEST_CASE("a file cut short while a GPU is streamed to ends in one line and exit code 2", "[cuda][cut][stream]") {
  if (!has_gpu()) return;
  const CutFile file(0);
  // The limit includes the picture, so the picture's size must be the frames'.
  const ProgramRun refused = run_program({"render", file.path(), "--backend", "cuda", "--size", "160x120",
                                          "--device-memory", "1", "-o", file.folder().file("refused.png")},
                                         file.folder().file("log"));
  // The budget leaves room for a third of the chunks.
  const uint64_t budget = least_device_memory(refused.output) + std::filesystem::file_size(file.path()) / 3;
  file.cut_while_drawn({"--backend", "cuda", "--device-memory", std::to_string(budget), "--host-memory", "0"});
}

TEST_CASE("threads that read past a file's new end at once print one error", "[render][cut]") {
  constexpr uint64_t kThreads = 8;
  const TempFolder folder;
  const std::string path = folder.write("cut.bin", std::string(kThreads << 16, 'x'));
  pid_t process = -1;
  // stderr is a full pipe, so that the first thread cannot print before the last one arrives.
  const ChildEnd end = run_child(
      process,
      [&](const auto& ready) {
        tools::report_sigbus("render", path);
        const Result<runtime::MappedFile> file = runtime::MappedFile::open(path);
        if (!file || ::truncate(path.c_str(), 0) != 0) return;
        fill(STDERR_FILENO);
        std::atomic<uint64_t> there = 0;
        const auto touch = [&](uint64_t thread) {
          ++there;
          while (there < kThreads) {
          }
          const volatile std::byte first = file->bytes()[thread << 16];
          (void)first;
        };
        std::vector<std::thread> threads;
        ready();
        for (uint64_t i = 0; i < kThreads; ++i) threads.emplace_back(touch, i);
        for (std::thread& thread : threads) thread.join();
      },
      [&] { CHECK(wait_until([&] { return sleeping_threads(process) == kThreads + 1; }, kDeadline)); });
  REQUIRE(end.errors.find('s') != std::string::npos);
  CHECK(end.errors.substr(end.errors.find('s')) == line_of(path));
  REQUIRE(WIFEXITED(end.status));
  CHECK(WEXITSTATUS(end.status) == 2);
}

}  // namespace scree::tests
