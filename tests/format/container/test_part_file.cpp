// A file that gets its name only once it is complete, also with several writers of one name.
#include "format/container/part_file.h"

#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <mutex>
#include <thread>
#include <vector>

#include "format/container/container.h"
#include "runtime/images/image.h"
#include "tests/results.h"
#include "tests/tools/temp_folder.h"

namespace scree::tests {
namespace {

using namespace scree::format;

std::span<const std::byte> bytes_of(std::string_view text) {
  return std::as_bytes(std::span(text));
}

PartFile must_create(const std::string& path, Existing existing = Existing::kReplace) {
  PartFile made = must(PartFile::create(path, PartFile::Content::kEmpty, existing));
  REQUIRE(made.write_at(0, bytes_of("new")));
  return made;
}

mode_t mode_of(const std::string& path) {
  struct stat status {};
  REQUIRE(::stat(path.c_str(), &status) == 0);
  return status.st_mode & 07777;
}

TEST_CASE("part file: several writers of one name do not disturb each other", "[part]") {
  const TempFolder folder;
  const std::string path = folder.file("out.bin");
  std::atomic<int> written{0};
  std::atomic<bool> is_whole{true};
  std::string other_error;
  std::mutex mutex;
  const auto write = [&](uint64_t word) {
    const std::vector<uint64_t> samples(size_t{1} << word, word);
    for (int i = 0; i < 400; ++i) {
      const Result<void> done = runtime::write_visibility(path, samples);
      if (done) ++written;
      if (!done && done.error().message.find("another program is writing it") == std::string::npos &&
          done.error().message.find("other programs keep replacing it") == std::string::npos) {
        const std::lock_guard lock(mutex);
        other_error = done.error().message;
      }
      // The file is complete, whichever writer was the last.
      const std::string bytes = read_whole(path);
      if (bytes.size() % 8 != 0 || bytes.size() < 8) continue;
      std::vector<uint64_t> words(bytes.size() / 8);
      std::copy_n(bytes.data(), bytes.size(), reinterpret_cast<char*>(words.data()));
      for (const uint64_t value : words)
        if (value != words[0] || words.size() != size_t{1} << words[0]) is_whole = false;
    }
  };
  {
    std::vector<std::jthread> threads;
    for (uint64_t word = 8; word < 12; ++word) threads.emplace_back(write, word);
  }
  CHECK(other_error.empty());
  CHECK(is_whole);
  CHECK(written > 0);
  CHECK(folder.names() == std::vector<std::string>{"out.bin"});
}

TEST_CASE("part file: a parked .part that another writer has taken is neither renamed nor removed", "[part]") {
  const TempFolder folder;
  const std::string path = folder.file("out.jpg");
  for (const bool commits : {true, false}) {
    PartFile first = must_create(path);
    REQUIRE(first.park());
    CHECK_FALSE(first.is_open());
    PartFile second = must_create(path);
    if (commits) CHECK(refusal(first.commit()).message.find("another program has changed it") != std::string::npos);
    first.discard();
    REQUIRE(std::filesystem::exists(second.part_path()));
    REQUIRE(second.write_at(0, bytes_of("second")));
    REQUIRE(second.commit());
    CHECK(read_whole(path) == "second");
    REQUIRE(std::filesystem::remove(path));
  }
  // A .part that no other program has touched.
  PartFile third = must_create(path);
  REQUIRE(third.park());
  REQUIRE(third.commit());
  CHECK(read_whole(path) == "new");
  PartFile fourth = must_create(path);
  REQUIRE(fourth.park());
  fourth.discard();
  CHECK(folder.names() == std::vector<std::string>{"out.jpg"});
}

TEST_CASE("part file: an existing file is refused at the start and at the end", "[part]") {
  const TempFolder folder;
  const std::string path = folder.write("out.bin", "old");
  check_refusal(PartFile::create(path, PartFile::Content::kEmpty, Existing::kRefuse),
                {ErrorCode::kFile, path + ": exists already"});
  CHECK(folder.names() == std::vector<std::string>{"out.bin"});

  std::filesystem::remove(path);
  PartFile part = must_create(path, Existing::kRefuse);
  folder.write("out.bin", "made meanwhile");
  const auto done = refusal(part.commit());
  CHECK(part.is_refused());
  CHECK(done.message.find("exists already") != std::string::npos);
  CHECK(read_whole(path) == "made meanwhile");
  part.discard();
  CHECK(folder.names() == std::vector<std::string>{"out.bin"});

  std::filesystem::remove(path);
  PartFile free = must_create(path, Existing::kRefuse);
  REQUIRE(free.commit());
  CHECK(read_whole(path) == "new");
  CHECK(folder.names() == std::vector<std::string>{"out.bin"});
}

TEST_CASE("part file: a container whose name is taken meanwhile is kept as a .part", "[part]") {
  const TempFolder folder;
  const std::string path = folder.file("out.scree");
  Result<ContainerWriter> writer = ContainerWriter::create(path, Existing::kRefuse);
  REQUIRE(writer);
  folder.write("out.scree", "made meanwhile");
  const auto done = refusal(writer->finish(TableSet{}));
  CHECK(done.message.find("exists already") != std::string::npos);
  CHECK(done.message.find("the new file is " + path + ".part") != std::string::npos);
  CHECK(read_whole(path) == "made meanwhile");
  // The .part is complete: it can be read after a rename.
  writer = Error{ErrorCode::kFile, {}};
  std::filesystem::rename(path + ".part", path);
  CHECK(read_whole(path).substr(1, 5) == "SCREE");
  CHECK(folder.names() == std::vector<std::string>{"out.scree"});
}

TEST_CASE("part file: a program that ends at once removes open .part files, except kept and parked ones", "[part]") {
  const TempFolder folder;
  std::vector<PartFile> open;
  for (const std::string name : {"a", "b", "kept", "parked", "done"}) open.push_back(must_create(folder.file(name)));
  open[2].keep();
  REQUIRE(open[3].park());
  REQUIRE(open[4].commit());
  // As if another program had taken the .part.
  std::filesystem::remove(folder.file("b.part"));
  folder.write("b.part", "of another program");
  remove_open_parts();
  CHECK(folder.names() == std::vector<std::string>{"b.part", "done", "kept.part", "parked.part"});
  CHECK_FALSE(open[0].commit());
  open.clear();
  remove_open_parts();
  CHECK(folder.names() == std::vector<std::string>{"done", "kept.part"});
}

TEST_CASE("part file: a link stays a link, and permissions stay", "[part]") {
  const TempFolder folder;
  const std::string target = folder.write("data/target.bin", "old");
  REQUIRE(::chmod(target.c_str(), 0640) == 0);
  const std::string link = folder.file("out.bin");
  std::filesystem::create_symlink("data/target.bin", link);
  PartFile part = must_create(link);
  REQUIRE(part.commit());
  CHECK(std::filesystem::is_symlink(link));
  CHECK(read_whole(target) == "new");
  CHECK(mode_of(target) == 0640);
  CHECK_FALSE(PartFile::create(link, PartFile::Content::kEmpty, Existing::kRefuse));
  // A dangling link also counts as a taken name.
  const std::string nowhere = folder.file("nowhere.bin");
  std::filesystem::create_symlink("data/missing.bin", nowhere);
  CHECK_FALSE(PartFile::create(nowhere, PartFile::Content::kEmpty, Existing::kRefuse));
}

}  // namespace
}  // namespace scree::tests
