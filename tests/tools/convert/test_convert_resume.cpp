// convert --resume gives the same bytes after being killed at any point, and detects everything that does not fit.
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "format/layout.h"
#include "tests/format/jpeg/jpeg_maker.h"
#include "tests/models.h"
#include "tests/sanitized.h"
#include "tests/tools/model_maker.h"
#include "tests/tools/run_program.h"
#include "tools/convert/convert.h"
#include "tools/convert/passes/resume.h"

using namespace scree;
using namespace scree::tests;

namespace {

/// Two images, five windows in three meshes: 9 MB.
void make_resumed_scene(const std::string& path) {
  ModelMaker maker(path);
  const uint32_t jpeg =
      maker.textured("jpeg", format::ImageCodec::kJpeg,
                     tests::make_jpeg({.width = 200, .height = 200, .factors = {{2, 2}, {1, 1}, {1, 1}}}));
  const uint32_t checker = maker.checker("png");
  GridSpec large{.columns = 600, .rows = 500, .uv = true};
  maker.draw("a", {maker.grid(large, jpeg), maker.grid({.uv = true, .color = true}, checker)});
  large.rows = 300;
  large.color = true;
  maker.draw("b", {maker.grid(large)}, {1.5, 0, 0});
  maker.finish();
}

class Conversion {
 public:
  explicit Conversion(const std::string& encoding = "indexed") : encoding_(encoding) {
    make_resumed_scene(in_);
    run({"-o", reference_path()}, 0);
    reference_ = tests::read_whole(reference_path());
    REQUIRE(reference_.size() > (encoding == "indexed" ? 5000000 : 1000000));
    std::filesystem::remove(reference_path());
  }

  const TempFolder& folder() const { return folder_; }
  const std::string& input() const { return in_; }
  std::string part() const { return out_ + ".part"; }
  const std::string& reference() const { return reference_; }

  /// Whether the .part already has its header: the process was killed between the last two short calls, and the .part
  /// can no longer be continued.
  bool has_header() const {
    if (!std::filesystem::exists(part())) return false;
    const std::string begin = tests::read_whole(part()).substr(0, sizeof format::kMagic);
    return begin.size() == sizeof format::kMagic && std::memcmp(begin.data(), format::kMagic, begin.size()) == 0;
  }

  std::vector<std::string> words(std::vector<std::string> more) const {
    more.insert(more.begin(), {"convert", in_, "--zstd", "9", "--threads", std::to_string(threads_), "--max-error",
                               "1e-5", "--encoding", encoding_});
    return more;
  }

  /// The number of threads of later runs.
  void use_threads(uint32_t threads) { threads_ = threads; }

  /// Runs the command to its end and returns its output.
  std::string run(std::vector<std::string> more, int expected = 0) {
    const tests::ProgramRun run = tests::run_program(words(std::move(more)), folder_.file("log"));
    INFO(run.output);
    REQUIRE(run.exit_code == expected);
    return run.output;
  }

  /// Starts the command, and sends `signal` as soon as the .part takes `bytes` on the disk. It may have finished by
  /// then.
  void stop_at(uint64_t bytes, int signal, const std::string& option) {
    std::vector<std::string> more{"-o", out_};
    if (!option.empty()) more.push_back(option);
    const pid_t child = tests::start_program(words(more), folder_.file("log"));
    tests::wait_until([&] { return tests::has_ended(child) || tests::disk_bytes(part()) >= bytes; });
    kill(child, signal);
    tests::wait_for(child);
  }

  /// Makes a .part to continue from and moves it away. take_kept() puts it back.
  void keep_part(uint64_t bytes) {
    stop_at(bytes, SIGKILL, "");
    REQUIRE(std::filesystem::exists(part()));
    std::filesystem::rename(part(), kept_);
  }
  void take_kept() const {
    std::filesystem::copy_file(kept_, part(), std::filesystem::copy_options::overwrite_existing);
  }

  /// Continues the conversion, checks its bytes, and returns its output.
  std::string resume() {
    const std::string said = run({"-o", out_, "--resume", "--force"});
    CHECK((tests::read_whole(out_) == reference_));
    CHECK_FALSE(std::filesystem::exists(part()));
    std::filesystem::remove(out_);
    return said;
  }

 private:
  std::string reference_path() const { return folder_.file("reference.scree"); }

  TempFolder folder_;
  std::string in_ = folder_.file("in.glb"), out_ = folder_.file("out.scree");
  std::string kept_ = folder_.file("kept");
  std::string reference_, encoding_;
  uint32_t threads_ = 2;
};

bool says(const std::string& text, const char* words) {
  return text.find(words) != std::string::npos;
}

}  // namespace

TEST_CASE("convert --resume: a run killed at any point resumes to the same bytes", "[convert][resume]") {
  Conversion conversion(GENERATE("indexed", "clustered"));
  int resumed = 0;
  constexpr int kKills = tests::kIsSanitized ? 4 : 7;
  // The run continues with another number of threads than the killed run. The reference uses two.
  uint32_t threads = 0;
  const uint64_t size = conversion.reference().size();
  for (uint64_t bytes = 4096; bytes < size; bytes += size / kKills) {
    conversion.use_threads(1 + threads % 3);
    conversion.stop_at(bytes, SIGKILL, threads % 2 == 0 ? "--resume" : "");
    const bool is_left = std::filesystem::exists(conversion.part());
    const bool has_header = conversion.has_header();
    conversion.use_threads(1 + ++threads % 3);
    const std::string said = conversion.resume();
    INFO(bytes << ": " << said);
    if (bytes > 100000) CHECK(says(said, "starts afresh") == has_header);  // otherwise there may be no page yet
    if (is_left) resumed += says(said, "resumed after") ? 1 : 0;
  }
  CHECK(resumed >= kKills / 2 - 1);
  // A conversion that is killed repeatedly still finishes.
  for (uint64_t i = 1; i < 6; ++i) {
    conversion.use_threads(static_cast<uint32_t>(i));
    conversion.stop_at(i * size / 9, SIGKILL, "--resume");
  }
  conversion.resume();
  CHECK(conversion.folder().names() == std::vector<std::string>{"in.glb", "log"});
}

TEST_CASE("convert --resume: a signal leaves the .part only with the option", "[convert][resume]") {
  Conversion conversion;
  conversion.stop_at(2000000, SIGTERM, "");
  CHECK_FALSE(std::filesystem::exists(conversion.part()));
  conversion.stop_at(2000000, SIGINT, "--resume");
  REQUIRE(std::filesystem::exists(conversion.part()));
  CHECK(says(conversion.resume(), "resumed after"));
  CHECK_FALSE(says(conversion.resume(), "resume"));  // there is nothing to resume
}

TEST_CASE("convert --resume: a .part is reported once there is one to continue", "[convert][resume]") {
  const TempFolder folder;
  make_model(folder.file("in.glb"), GridSpec{});
  const std::string part = folder.file("out.scree.part");
  std::atomic<bool> stop = true;
  int reports = 0;
  convert::ConvertOptions options;
  options.input = folder.file("in.glb");
  options.output = folder.file("out.scree");
  options.resume = true;
  options.stop = &stop;
  options.on_part = [&] {
    CHECK(std::filesystem::exists(part));
    ++reports;
  };
  check_refusal(convert::convert(options), ErrorCode::kFile, "interrupted");  // while it measures
  CHECK(reports == 0);
  CHECK_FALSE(std::filesystem::exists(part));
  folder.write("out.scree.part", "of an earlier run");
  check_refusal(convert::convert(options), ErrorCode::kFile, "interrupted");
  CHECK(reports == 1);
  CHECK(std::filesystem::exists(part));
  std::filesystem::remove(part);
  stop = false;
  must(convert::convert(options));
  CHECK(reports == 2);
}

TEST_CASE("convert --resume: a damaged .part is noticed", "[convert][resume]") {
  Conversion conversion;
  conversion.keep_part(4500000);
  conversion.take_kept();
  const uint64_t size = std::filesystem::file_size(conversion.part());
  const auto check = [&](uint64_t offset, bool cut, const char* expected) {
    conversion.take_kept();
    cut ? std::filesystem::resize_file(conversion.part(), offset) : tests::damage(conversion.part(), offset);
    const std::string said = conversion.resume();
    INFO("byte " << offset << (cut ? " cut" : "") << ": " << said);
    CHECK(says(said, expected));
  };
  check(8, false, "starts afresh");    // the mark
  check(100, false, "resumed after");  // here the padding behind the header will be
  check(4096, false, "");              // the first page
  check(1000000, false, "resumed after");
  check(2500000, false, "resumed after");
  check(size - 10, false, "resumed after");  // the log
  check(2500000, true, "");                  // pages and no log
  check(size - 10, true, "resumed after");
  check(30, true, "starts afresh");
}

TEST_CASE("convert --resume: another input or other options start afresh", "[convert][resume]") {
  Conversion conversion;
  conversion.keep_part(3000000);
  const std::string out = conversion.folder().file("out.scree");
  conversion.take_kept();
  const std::string other = conversion.run({"-o", out, "--resume", "--order", "none"});
  CHECK(says(other, "starts afresh: it was made from another input or with other options"));
  CHECK((tests::read_whole(out) != conversion.reference()));
  conversion.take_kept();
  CHECK(says(conversion.run({"-o", out, "--resume", "--force", "--memory", "4GiB"}), "resumed after"));
  CHECK((tests::read_whole(out) == conversion.reference()));
  conversion.take_kept();
  std::filesystem::last_write_time(conversion.input(),
                                   std::filesystem::last_write_time(conversion.input()) + std::chrono::seconds(1));
  CHECK(says(conversion.resume(), "starts afresh"));
}

TEST_CASE("resume: an entry whose lists differ in length is ignored", "[convert][resume]") {
  // An invented log with fewer saved amounts than chunks. The two lists are read in parallel.
  const TempFolder folder;
  const std::string path = folder.file("out.scree");
  const format::PartId id{1, 2};
  for (const size_t saved : {size_t{2}, size_t{0}, size_t{3}}) {
    {
      auto writer = must(format::ContainerWriter::create(path));
      writer.keep_part();
      writer.keep_log(id, 100000);
      convert::WindowOutcome window;
      window.chunks.resize(2);
      window.saved.resize(saved);
      convert::log_windows(writer, 0, {window});
    }
    convert::Resumed resumed;
    REQUIRE(format::ContainerWriter::resume(
        path, id, [&](uint32_t kind, std::span<const std::byte> entry) { convert::read_entry(kind, entry, resumed); }));
    CHECK(resumed.windows.size() == (saved == 2 ? 1 : 0));
  }
}
