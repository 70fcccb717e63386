// The writer and the file system: the files that exist after success, a failure, a crash, and with a second writer; the
// worked examples of spec/container.md.
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <sstream>

#include "format/bytes.h"
#include "format/container/container.h"
#include "tests/format/container/container_fixture.h"
#include "tests/full_disk.h"
#include "tests/paths.h"
#include "tests/results.h"

namespace scree::tests {
namespace {

using namespace scree::format;
namespace fs = std::filesystem;

SealedPage noise_page(size_t bytes) {
  Bytes raw(bytes);
  uint32_t state = 7;
  for (std::byte& b : raw) b = static_cast<std::byte>((state = state * 1664525 + 1013904223) >> 24);
  return seal_page(PageKind::kImage, std::move(raw), 0);
}

TEST_CASE("container writer: a page written piece by piece equals the page in memory", "[container]") {
  const TempFolder folder;
  for (const size_t bytes : {size_t{1}, size_t{1} << 20, (size_t{1} << 20) + 1, size_t{3000000}}) {
    const SealedPage page = noise_page(bytes);
    auto held = must(ContainerWriter::create(folder.file("held")));
    auto read = must(ContainerWriter::create(folder.file("read")));
    uint64_t next = 0;
    const auto give = [&](uint64_t offset, std::span<std::byte> out) -> Result<void> {
      CHECK(offset == next);
      std::copy_n(page.stored.data() + offset, out.size(), out.data());
      next += out.size();
      return {};
    };
    REQUIRE(held.append(page));
    CHECK(must(read.append_raw(PageKind::kImage, bytes, give)) == 0);
    REQUIRE(held.finish({}));
    REQUIRE(read.finish({}));
    CHECK(read_bytes(folder.file("held")) == read_bytes(folder.file("read")));
  }
  auto writer = must(ContainerWriter::create(folder.file("failed")));
  const auto fail = [](uint64_t, std::span<std::byte>) { return Result<void>(Error{ErrorCode::kTruncated, "gone"}); };
  CHECK(refusal(writer.append_raw(PageKind::kImage, 10, fail)).message == "gone");
}

TEST_CASE("container writer: the name appears at the end, and the .part disappears", "[container]") {
  const TempFolder folder;
  const std::string path = folder.write("a.scree", "the earlier file");
  {
    auto writer = must(ContainerWriter::create(path));
    CHECK(fs::exists(path + ".part"));
    REQUIRE(writer.append(noise_page(5000)));
    CHECK(read_bytes(path).size() == 16);
    const auto size = must(writer.finish({}));
    CHECK(writer.bytes() == size);
    CHECK(fs::file_size(path) == size);
    CHECK(!fs::exists(path + ".part"));
    CHECK(folder.names().size() == 1);
    CHECK(refusal(writer.finish({})).message == path + ".part: is not open any more");
  }
  CHECK(fs::exists(path));
  CHECK(!verify_copy(read_bytes(path)));
}

TEST_CASE("container writer: a whole file whose check fails does not get its name", "[container]") {
  const TempFolder folder;
  const std::string path = folder.write("a.scree", "the earlier file");
  auto writer = must(ContainerWriter::create(path));
  REQUIRE(writer.append(noise_page(5000)));
  const auto refuse = [&](const std::string& part) -> Result<void> {
    CHECK(part == path + ".part");
    CHECK(!verify_copy(read_bytes(part)));
    return Error{ErrorCode::kRange, "refused"};
  };
  check_refusal(writer.finish({}, refuse), ErrorCode::kRange, "refused");
  CHECK(read_bytes(path).size() == 16);
  CHECK(folder.names().size() == 1);
}

TEST_CASE("container writer: pages that are dropped leave nothing", "[container]") {
  const TempFolder folder;
  const auto bytes_of = [&](bool drops) {
    auto writer = must(ContainerWriter::create(folder.file("a.scree")));
    REQUIRE(writer.append(noise_page(5000)));
    if (drops) {
      REQUIRE(writer.append(noise_page(60000)));
      REQUIRE(writer.append(noise_page(20000)));
      writer.drop_pages(1);
      CHECK(writer.page_count() == 1);
      CHECK(writer.bytes() == 4096 + 5000);
    }
    REQUIRE(writer.append(noise_page(100)));
    REQUIRE(writer.append(noise_page(200)));
    REQUIRE(writer.finish({}));
    return read_bytes(folder.file("a.scree"));
  };
  CHECK((bytes_of(true) == bytes_of(false)));
}

TEST_CASE("container writer: destroyed before finish(), it leaves nothing", "[container]") {
  const TempFolder folder;
  const std::string path = folder.write("a.scree", "the earlier file");
  {
    auto writer = must(ContainerWriter::create(path));
    REQUIRE(writer.append(noise_page(100)));
    ContainerWriter moved = std::move(writer);
    REQUIRE(moved.append(noise_page(100)));
    REQUIRE(*moved.append(noise_page(100)) == 2);
  }
  CHECK(folder.names().size() == 1);
  CHECK(read_bytes(path).size() == 16);
}

TEST_CASE("container writer: a stale .part is taken over, but not a locked one", "[container]") {
  const TempFolder folder;
  const std::string path = folder.file("a.scree");
  // Longer than the file that is written, so that leftovers would show.
  folder.write("a.scree.part", std::string(100000, 'x'));
  auto first = must(ContainerWriter::create(path));
  check_refusal(ContainerWriter::create(path), {ErrorCode::kFile, path + ".part: another program is writing it"});
  REQUIRE(first.append(noise_page(100)));
  REQUIRE(first.finish({}));
  CHECK(!verify_copy(read_bytes(path)));
  CHECK(ContainerWriter::create(path));
}

TEST_CASE("container writer: paths that cannot be written are errors", "[container]") {
  const TempFolder folder;
  const auto error = [](const std::string& path) {
    const Error refused = refusal(ContainerWriter::create(path));
    CHECK(refused.code == ErrorCode::kFile);
    return refused.message;
  };
  CHECK(error(folder.path().string()) == folder.path().string() + ": is a folder");
  const std::string missing = folder.file("missing/a.scree");
  CHECK(error(missing) == missing + ".part: open: No such file or directory");
  CHECK(error("") == "a file without a name cannot be written");
  CHECK(error("/dev/full") == "/dev/full: is not a regular file");
  const std::string path = folder.file("a.scree");
  fs::create_symlink("/dev/full", path + ".part");
  CHECK(error(path) == path + ".part: open: Too many levels of symbolic links");
  fs::remove(path + ".part");
  REQUIRE(::mkfifo((path + ".part").c_str(), 0600) == 0);
  CHECK(error(path) == path + ".part: is not a regular file");
  fs::remove(path + ".part");
  fs::create_directory(path + ".part");
  CHECK(error(path) == path + ".part: open: Is a directory");
}

TEST_CASE("container writer: a full disk is an error that leaves the earlier file", "[container]") {
  // Once while pages are written, and once at the tables. The limit first shortens a write and then refuses one.
  for (const rlim_t limit : {rlim_t{4096 + 3000}, rlim_t{4096 + 8192 + 10}}) {
    const TempFolder folder;
    const std::string path = folder.file("a.scree");
    folder.write("a.scree", "the earlier file");
    auto writer = must(ContainerWriter::create(path));
    const SealedPage page = noise_page(8192);
    std::string message;
    {
      const FullDisk full(limit);
      const auto appended = writer.append(page);
      if (!appended) {
        CHECK(appended.error().code == ErrorCode::kFile);
        message = appended.error().message;
        CHECK(refusal(writer.append(page)).code == ErrorCode::kFile);
      }
      const Error unfinished = refusal(writer.finish({}));
      if (message.empty()) message = unfinished.message;
    }
    CHECK(message == path + ".part: write: File too large");
    CHECK(folder.names().size() == 1);  // removed at once, not only by the writer's destructor
    CHECK(read_bytes(path).size() == 16);
  }
}

TEST_CASE("container writer: seal_page", "[container]") {
  Bytes raw(50000);
  for (size_t i = 0; i < raw.size(); ++i) raw[i] = static_cast<std::byte>(i / 100);
  for (const int level : {1, 9, 22}) {
    const SealedPage once = seal_page(PageKind::kGeometry, raw, level);
    const SealedPage twice = seal_page(PageKind::kGeometry, raw, level);
    CHECK(once.record.codec == PageCodec::kZstd);
    CHECK(once.stored == twice.stored);
    CHECK(std::memcmp(&once.record, &twice.record, sizeof once.record) == 0);
    CHECK(once.record.stored_bytes == once.stored.size());
    CHECK(once.record.raw_bytes == raw.size());
    CHECK(once.record.offset == 0);
  }
  const SealedPage kept = seal_page(PageKind::kGeometry, raw, 0);
  CHECK(kept.record.codec == PageCodec::kRaw);
  CHECK(kept.stored == raw);
  const SealedPage noise = seal_page(PageKind::kImage, noise_page(5000).stored, 22);
  CHECK(noise.record.codec == PageCodec::kRaw);
  // Nine parts of noise and one part of zeros are compressed. 29 parts and one are compressed only in geometry pages.
  for (const size_t parts : {10, 30}) {
    Bytes mixed = noise_page(3000 * (parts - 1)).stored;
    mixed.resize(3000 * parts);
    CHECK(seal_page(PageKind::kGeometry, mixed, 3).record.codec == PageCodec::kZstd);
    CHECK((seal_page(PageKind::kImage, mixed, 3).record.codec == PageCodec::kZstd) == (parts == 10));
  }
  for (const size_t bytes : {0, 1, 2})
    CHECK(seal_page(PageKind::kImage, Bytes(bytes), 3).record.codec == PageCodec::kRaw);
}

TEST_CASE("container writer: strings", "[container]") {
  StringTable strings;
  CHECK(strings.add("") == 0);
  CHECK(strings.add("slope") == 1);
  CHECK(strings.add("scree") == 7);
  CHECK(strings.add("slope") == 1);
  CHECK(strings.add(std::string_view("scree\0slope", 11)) == 7);
  CHECK(strings.add(std::string_view("\0x", 2)) == 0);
  CHECK(std::string(strings.bytes().data(), strings.bytes().size()) == std::string("\0slope\0scree\0", 13));
}

/// A worked example: lines of "offset: bytes   # meaning". All other bytes are zero. The last offset is the size.
Bytes read_vector(const char* name) {
  std::ifstream file(fs::path(tests::kVectorsFolder) / name);
  REQUIRE(file);
  Bytes bytes;
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line.substr(0, line.find('#')));
    std::string word;
    if (!(words >> word)) continue;
    REQUIRE(word.back() == ':');
    const size_t offset = std::stoul(word, nullptr, 16);
    REQUIRE(offset >= bytes.size());
    bytes.resize(offset);
    while (words >> word) bytes.push_back(static_cast<std::byte>(std::stoul(word, nullptr, 16)));
  }
  return bytes;
}

TEST_CASE("container writer: the worked examples of the specification", "[container]") {
  const Bytes tiny = read_vector("container_tiny.hex");
  CHECK(file_of(tiny_parts()) == tiny);
  const ExactCopy copy(tiny);
  const auto container = must(Container::open(copy.bytes()));
  CHECK(container.string(container.groups()[0].name) == "stone");
  CHECK(container.meshes()[0].bounds_max[0] == 0.75f);

  const Bytes header = read_vector("container_header.hex");
  REQUIRE(header.size() == sizeof(FileHeader));
  CHECK(std::equal(header.begin(), header.end(), tiny.begin()));
  CHECK(load<FileHeader>(header.data()).toc_count == 12);

  const Bytes entry = read_vector("container_toc_entry.hex");
  REQUIRE(entry.size() == sizeof(TocEntry));
  const size_t at = toc_entry_offset(tiny, TableKind::kPages);
  CHECK(std::equal(entry.begin(), entry.end(), tiny.begin() + static_cast<ptrdiff_t>(at)));
}

}  // namespace
}  // namespace scree::tests
