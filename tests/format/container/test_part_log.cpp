// Continuing a small .part: with every cut, with every damaged byte, and without room for the log.
#include <fcntl.h>
#include <unistd.h>

#include "format/container/container.h"
#include "format/container/part_log.h"
#include "tests/format/container/container_fixture.h"
#include "tests/results.h"

namespace scree::tests {
namespace {

using namespace scree::format;
namespace fs = std::filesystem;

constexpr PartId kId{0x1234, 0x5678};
constexpr uint64_t kMostBytes = 40000;
constexpr uint32_t kPages = 5;
constexpr uint32_t kNote = 16;

SealedPage page_of(uint32_t number) {
  return seal_page(PageKind::kImage, Bytes(100 + 1700 * number, static_cast<std::byte>(number + 1)), 0);
}

/// Appends pages [first, last), each with a log entry of its number.
void append(ContainerWriter& writer, uint32_t first, uint32_t last) {
  for (uint32_t number = first; number < last; ++number) {
    CHECK(must(writer.append(page_of(number))) == number);
    writer.log(kNote, std::as_bytes(std::span(&number, 1)));
  }
}

class Unfinished {
 public:
  Unfinished() {
    auto whole = must(ContainerWriter::create(path));
    append(whole, 0, kPages);
    REQUIRE(whole.finish({}));
    expected = read_bytes(path);
    fs::remove(path);
    auto writer = must(ContainerWriter::create(path));
    writer.keep_log(kId, kMostBytes);
    writer.keep_part();
    append(writer, 0, 4);
  }

  /// Continues with `bytes` as the .part. Returns the number of pages that are kept, 0 also if it has to start again.
  uint32_t finish(const Bytes& bytes) {
    folder.write("a.scree.part", bytes);
    std::vector<uint32_t> notes;
    auto writer = ContainerWriter::resume(path, kId, [&](uint32_t kind, std::span<const std::byte> entry) {
      CHECK(kind == kNote);
      REQUIRE(entry.size() == 4);
      notes.push_back(0);
      std::memcpy(&notes.back(), entry.data(), 4);
    });
    if (!writer) {
      CHECK(writer.error().code == ErrorCode::kFormat);
      CHECK(fs::exists(path + ".part"));
      return 0;
    }
    for (uint32_t i = 0; i < notes.size(); ++i) CHECK(notes[i] == i);
    const uint32_t kept = writer->page_count();
    CHECK(kept <= notes.size() + 1);  // a run may be killed between a page and its log entry
    append(*writer, kept, kPages);
    REQUIRE(writer->finish({}));
    CHECK((read_bytes(path) == expected));
    fs::remove(path);
    return kept;
  }

  TempFolder folder;
  std::string path = folder.file("a.scree");
  Bytes expected;
};

}  // namespace

TEST_CASE("part log: a cut or damaged .part is continued to the same bytes", "[container][resume]") {
  Unfinished unfinished;
  const Bytes part = read_bytes(unfinished.path + ".part");
  REQUIRE(part.size() > kMostBytes);
  CHECK(unfinished.finish(part) == 4);
  for (size_t size = 0; size < part.size(); size += 1 + part.size() / 97)
    CHECK(unfinished.finish({part.begin(), part.begin() + static_cast<ptrdiff_t>(size)}) <= 4);
  for (size_t at = 0; at < part.size(); at += at < 64 ? 1 : 61) {
    Bytes damaged = part;
    damaged[at] ^= std::byte{0x40};
    const uint32_t kept = unfinished.finish(damaged);
    if (at >= 4096 && at < 4196) CHECK(kept == 0);
    if (at < 64) CHECK(kept == 0);
  }
  // Page 1 is damaged, and the run that wrote it again was killed too.
  Bytes damaged = part;
  damaged[2 * kPageAlignment + 5] ^= std::byte{1};
  unfinished.folder.write("a.scree.part", damaged);
  {
    auto writer = must(ContainerWriter::resume(unfinished.path, kId, [](uint32_t, std::span<const std::byte>) {}));
    REQUIRE(writer.page_count() == 1);
    REQUIRE(writer.append(page_of(1)));
    REQUIRE(writer.append(page_of(2)));
  }
  CHECK(unfinished.finish(read_bytes(unfinished.path + ".part")) == 3);
}

TEST_CASE("part log: another id or no .part is refused, dropped pages are written again", "[container][resume]") {
  Unfinished unfinished;
  const auto ignore = [](uint32_t, std::span<const std::byte>) {};
  CHECK(refusal(ContainerWriter::resume(unfinished.path, {1, 2}, ignore)).code == ErrorCode::kFormat);
  CHECK(refusal(ContainerWriter::resume(unfinished.folder.file("none.scree"), kId, ignore)).code == ErrorCode::kFormat);
  CHECK(!fs::exists(unfinished.folder.file("none.scree.part")));
  auto writer = must(ContainerWriter::resume(unfinished.path, kId, ignore));
  REQUIRE(writer.page_count() == 4);
  writer.drop_pages(2);
  append(writer, 2, kPages);
  REQUIRE(writer.finish({}));
  CHECK((read_bytes(unfinished.path) == unfinished.expected));
}

TEST_CASE("part log: dropped pages are not continued, even if they are intact", "[container][resume]") {
  Unfinished unfinished;
  const auto ignore = [](uint32_t, std::span<const std::byte>) {};
  const auto resumed = [&] { return must(ContainerWriter::resume(unfinished.path, kId, ignore)); };
  {
    ContainerWriter writer = resumed();
    REQUIRE(writer.page_count() == 4);
    writer.drop_pages(1);
  }
  {
    ContainerWriter writer = resumed();
    CHECK(writer.page_count() == 1);
    REQUIRE(writer.append(page_of(1)));
    REQUIRE(writer.append(page_of(3)));
    REQUIRE(writer.append(page_of(2)));
    writer.drop_pages(2);
    REQUIRE(writer.append(page_of(2)));
  }
  ContainerWriter writer = resumed();
  CHECK(writer.page_count() == 3);
  append(writer, 3, kPages);
  REQUIRE(writer.finish({}));
  CHECK((read_bytes(unfinished.path) == unfinished.expected));
}

TEST_CASE("part log: a file that grows past its log is correct and has the right size", "[container][resume]") {
  Unfinished unfinished;
  auto writer = ContainerWriter::create(unfinished.path);  // overwrites the leftover .part
  REQUIRE(writer);
  writer->keep_log(kId, 3 * kPageAlignment);
  append(*writer, 0, kPages);
  REQUIRE(writer->finish({}));
  CHECK((read_bytes(unfinished.path) == unfinished.expected));
}

}  // namespace scree::tests
