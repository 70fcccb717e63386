#include "runtime/files/mapped_file.h"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/results.h"
#include "tests/tools/temp_folder.h"

using namespace scree;
using namespace scree::runtime;
using namespace scree::tests;

TEST_CASE("cached_share() is right for a user who may only read the file", "[mapped_file]") {
  if (::geteuid() != 0) return;  // only root can become another user
  const TempFolder folder;
  REQUIRE(::chmod(folder.path().c_str(), 0755) == 0);
  const std::string path = folder.file("readable");
  {
    std::ofstream out(path, std::ios::binary);
    const std::string block(1 << 20, 'x');
    for (int i = 0; i < 16; ++i) out << block;
  }
  REQUIRE(::chmod(path.c_str(), 0644) == 0);
  const int file = ::open(path.c_str(), O_RDONLY);
  REQUIRE(::fsync(file) == 0);
  ::posix_fadvise(file, 0, 0, POSIX_FADV_DONTNEED);
  ::close(file);
  const auto share_of = [&](bool is_root) {
    const pid_t child = ::fork();
    if (child == 0) {
      if (!is_root && ::setresuid(65534, 65534, 65534) != 0) ::_exit(201);
      const Result<MappedFile> map = MappedFile::open(path);
      if (!map) ::_exit(202);
      if (map->mincore_is_true() != is_root) ::_exit(203);
      ::_exit(static_cast<int>(100 * map->cached_share()));
    }
    int status = 0;
    REQUIRE(::waitpid(child, &status, 0) == child);
    REQUIRE(WIFEXITED(status));
    return WEXITSTATUS(status);
  };
  const int share_of_owner = share_of(true), share = share_of(false);
  CAPTURE(share_of_owner, share);
  CHECK(share_of_owner <= 100);
  CHECK(share <= 100);
  // A file system in memory drops nothing. A file system without RWF_NOWAIT gives no information, and the share counts
  // as 1.
  iovec one{};
  char byte = 0;
  one = {&byte, 1};
  const int probe = ::open(path.c_str(), O_RDONLY);
  const bool has_probes = ::preadv2(probe, &one, 1, 0, RWF_NOWAIT) >= 0 || errno == EAGAIN;
  ::close(probe);
  if (has_probes && share_of_owner < 50) CHECK(share < 50);
  // Cached pages are found.
  CHECK(scree::tests::read_whole(path).size() == 16u << 20);
  CHECK(share_of(false) > 90);
}

TEST_CASE("a mapped file has the file's bytes and outlives moves", "[mapped_file]") {
  const TempFolder folder;
  const std::string path = folder.file("bytes");
  std::string text(10000, 'a');
  text[9999] = 'z';
  std::ofstream(path) << text;
  for (const Access access : {Access::kNormal, Access::kSequential}) {
    MappedFile file = must(MappedFile::open(path, access));
    MappedFile other;
    other = std::move(file);
    REQUIRE(other.size() == text.size());
    CHECK(file.bytes().empty());
    CHECK(static_cast<char>(other.bytes()[9999]) == 'z');
    other.will_need(0, ~uint64_t{0});
    other.release(1, ~uint64_t{0} - 5);
    other.release(20000, 5);
    CHECK(static_cast<char>(other.bytes()[9998]) == 'a');  // released bytes are read from the file again
    CHECK(static_cast<char>(other.bytes()[9999]) == 'z');
  }
}

TEST_CASE("a mapped file is read without its map, and errors give its new end", "[mapped_file]") {
  const TempFolder folder;
  const std::string path = folder.file("read");
  std::string text(10000, 'a');
  for (size_t i = 0; i < text.size(); ++i) text[i] = static_cast<char>(i * 7 + i / 256);
  std::ofstream(path, std::ios::binary) << text;
  const MappedFile file = must(MappedFile::open(path));
  std::filesystem::rename(path, path + "_elsewhere");  // the file is not found by its name any more
  const std::string elsewhere = path + "_elsewhere";
  std::vector<std::byte> out(10000, std::byte{'#'});
  for (const auto& [offset, size] : {std::pair<uint64_t, size_t>{0, 10000}, {1, 4096}, {9999, 1}, {10000, 0}}) {
    REQUIRE(file.read(offset, std::span(out).first(size)));
    CHECK(std::memcmp(out.data(), text.data() + offset, size) == 0);
  }
  std::filesystem::resize_file(elsewhere, 5000);
  CHECK(file.read(0, std::span(out).first(5000)));
  for (const uint64_t offset : {4001u, 4999u, 5000u, 9000u}) {
    check_refusal(file.read(offset, std::span(out).first(1000)),
                  {ErrorCode::kFile, "ends at byte " + std::to_string(std::max<uint64_t>(offset, 5000)) +
                                         ", but had 10000 when it was opened"});
  }
}

TEST_CASE("an empty file maps to nothing", "[mapped_file]") {
  const TempFolder folder;
  const std::string path = folder.write("empty", "");
  const MappedFile file = must(MappedFile::open(path));
  CHECK(file.bytes().empty());
  file.will_need(0, 1);
}

TEST_CASE("a file above 4 GiB is mapped with 64-bit offsets", "[mapped_file]") {
  const TempFolder folder;
  const std::string path = folder.file("sparse");
  const uint64_t size = (uint64_t{5} << 30) + 3;
  {
    std::ofstream file(path, std::ios::binary);
    file.seekp(static_cast<std::streamoff>(size - 1));
    file.put('!');
    if (!file.flush()) {
      WARN("skipped: no room for a sparse file");
      return;
    }
  }
  const MappedFile file = must(MappedFile::open(path));
  CHECK(file.size() == size);
  CHECK(static_cast<char>(file.bytes()[size - 1]) == '!');
}

TEST_CASE("bytes cut off the last page read as zeros, and check_unchanged() finds this", "[mapped_file]") {
  const TempFolder folder;
  const std::string path = folder.write("cut", std::string(10'000, 'x'));
  const MappedFile file = must(MappedFile::open(path));
  CHECK(file.check_unchanged());
  std::filesystem::resize_file(path, 9'999);
  CHECK(static_cast<char>(file.bytes()[9'998]) == 'x');
  CHECK(static_cast<char>(file.bytes()[9'999]) == 0);
  check_refusal(file.check_unchanged(), {ErrorCode::kFile, "ends at byte 9999, but had 10000 when it was opened"});
  CHECK(MappedFile().check_unchanged());
}

TEST_CASE("check_unchanged() finds bytes that were overwritten or appended", "[mapped_file]") {
  const TempFolder folder;
  const std::string path = folder.write("overwritten", std::string(10'000, 'x'));
  for (const auto mode : {std::ios::in | std::ios::out, std::ios::app | std::ios::out}) {
    const MappedFile file = must(MappedFile::open(path));
    CHECK(file.check_unchanged());
    std::this_thread::sleep_for(std::chrono::milliseconds(20));  // times of files have the steps of the system's clock
    std::fstream(path, mode | std::ios::binary).put('y');
    check_refusal(file.check_unchanged(), {ErrorCode::kFile, "was changed after it was opened"});
  }
}

TEST_CASE("a file that cannot be mapped is named with the reason", "[mapped_file]") {
  const TempFolder folder;
  const std::string missing = folder.file("missing");
  check_refusal(MappedFile::open(missing), {ErrorCode::kFile, missing + ": cannot open: No such file or directory"});

  check_refusal(MappedFile::open(folder.path().string()), ErrorCode::kFile, "is a folder");

  const std::string pipe = folder.file("pipe");
  REQUIRE(::mkfifo(pipe.c_str(), 0600) == 0);
  const Result<MappedFile> fifo = MappedFile::open(pipe);  // opening must not wait for a writer
  REQUIRE_FALSE(fifo);
  CHECK(fifo.error().message.find("not a regular file") != std::string::npos);
}
