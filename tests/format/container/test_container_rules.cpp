// Every rule of spec/container.md for the file as a whole (header, table of contents, pages) is broken once, and the
// error of open() must name the place. test_record_rules.cpp has the records' rules.
#include <zstd.h>

#include "format/bytes.h"
#include "format/container/container.h"
#include "tests/format/container/container_breaker.h"

#define XXH_STATIC_LINKING_ONLY
#include <xxhash.h>

namespace scree::tests {
namespace {

using namespace scree::format;

TEST_CASE("container rules: header", "[container]") {
  const Breaker b(tiny_parts());
  using H = FileHeader;
  b.header(ErrorCode::kFormat, "not a scree file", [](H& h) { h.magic[0] = 'S'; });
  b.header(ErrorCode::kVersion, "the file has version 0.0, but this program reads versions 1 and 2",
           [](H& h) { h.version_major = 0; });
  b.header(
      ErrorCode::kChecksum, "header: the checksum differs", [](H& h) { h.file_bytes = 0; }, false);
  b.header(ErrorCode::kRange, "header: 72 bytes, expected 64", [](H& h) { h.header_bytes = 72; });
  b.header(ErrorCode::kReserved, "header: a reserved field is set", [](H& h) { h.reserved = 1; });
  b.header(ErrorCode::kReserved, "header: a reserved field is set", [](H& h) { h.reserved2 = uint64_t{1} << 63; });
  b.header(ErrorCode::kChecksum, "table of contents: the checksum differs", [](H& h) { h.toc_checksum ^= 1; });
  const std::string size = std::to_string(b.file().size());
  b.header(ErrorCode::kTruncated, "the file has " + size + " bytes, but its header gives 18446744073709551615",
           [](H& h) { h.file_bytes = UINT64_MAX; });
  b.header(ErrorCode::kTrailing,
           "the file has " + size + " bytes, but its header gives " + std::to_string(b.file().size() - 1),
           [](H& h) { h.file_bytes -= 1; });
  for (const uint64_t offset :
       {uint64_t{0}, uint64_t{64}, uint64_t{4097}, uint64_t{b.file().size()}, UINT64_MAX - 63}) {
    b.header(
        ErrorCode::kRange,
        "table of contents: 12 entries at byte " + std::to_string(offset) + ", but the file has " + size + " bytes",
        [&](H& h) { h.toc_offset = offset; });
  }
  const uint64_t toc = load<FileHeader>(b.file().data()).toc_offset;
  b.header(
      ErrorCode::kRange,
      "table of contents: 4294967295 entries at byte " + std::to_string(toc) + ", but the file has " + size + " bytes",
      [](H& h) { h.toc_count = UINT32_MAX; });
  b.header(ErrorCode::kTrailing,
           "table of contents: ends at byte " + std::to_string(b.file().size() - 32) + ", but the file has " + size +
               " bytes",
           [](H& h) { h.toc_count -= 1; });
  Breaker::expect({}, "the file has 0 bytes, but its header takes 64", ErrorCode::kTruncated);
  Breaker::expect(Bytes(10, std::byte{'x'}), "not a scree file", ErrorCode::kFormat);
  Breaker::expect(Bytes(1000, std::byte{'x'}), "not a scree file", ErrorCode::kFormat);
}

TEST_CASE("container rules: table of contents", "[container]") {
  const Breaker b(tiny_parts());
  using T = TocEntry;
  const auto start = std::to_string(load<FileHeader>(b.file().data()).toc_offset);
  const auto entry = load<TocEntry>(b.file().data() + toc_entry_offset(b.file(), TableKind::kMeshes));
  const auto at = std::to_string(entry.offset);
  b.toc(TableKind::kMeshes, "table 1: kind 0", [](T& t) { t.kind = TableKind{0}; });
  b.toc(TableKind::kMeshes, ErrorCode::kFormat, "table 1: a second page table",
        [](T& t) { t.kind = TableKind::kPages; });
  b.toc(TableKind::kMeshes, "mesh table: records of 112 bytes, expected 120", [](T& t) { t.record_bytes = 112; });
  b.toc(TableKind::kMeshes, "mesh table: records of 0 bytes, expected 120", [](T& t) { t.record_bytes = 0; });
  b.toc(TableKind::kMeshes, "table 2: at byte " + std::to_string(entry.offset + 128) + ", expected " + at,
        [](T& t) { t.record_count = 0; });
  b.toc(TableKind::kMeshes,
        "table 1: 1152921504606846976 records of 120 bytes at byte " + at +
            ", but the table of contents starts at byte " + start,
        [](T& t) { t.record_count = uint64_t{1} << 60; });
  b.toc(
      TableKind::kMeshes,
      "table 1: 1 records of 120 bytes at byte 18446744073709551615, but the table of contents starts at byte " + start,
      [](T& t) { t.offset = UINT64_MAX; });
  b.toc(TableKind::kMeshes, "table 1: at byte " + std::to_string(entry.offset + 8) + ", expected " + at,
        [](T& t) { t.offset += 8; });
  b.toc(TableKind::kPages, "table 0: at byte 64, expected a multiple of 64 from 4096 on", [](T& t) { t.offset = 64; });
  b.toc(TableKind::kPages,
        "table 0: at byte " + std::to_string(entry.offset - 64 + 8) + ", expected a multiple of 64 from 4096 on",
        [](T& t) { t.offset += 8; });
  b.toc(TableKind::kStrings, ErrorCode::kFormat, "the file has no string table", [](T& t) { t.kind = TableKind{99}; });
  b.toc(TableKind::kSource, ErrorCode::kFormat, "source table: 0 records, expected 1",
        [](T& t) { t.kind = TableKind{99}; });

  // Without a part of the last table, the table of contents no longer follows it directly.
  RawFile raw(b.file());
  Bytes two = raw.build();
  raw.table(TableKind::kSource).bytes.resize(128);
  two = raw.build();
  Breaker::expect(two, "source table: 2 records, expected 1", ErrorCode::kFormat);

  // Wrong checksums and nonzero padding are found without resealing.
  Bytes flipped = b.file();
  flipped[entry.offset] ^= std::byte{1};
  Breaker::expect(flipped, "mesh table: the checksum differs", ErrorCode::kChecksum);
  flipped = b.file();
  flipped[entry.offset + 121] = std::byte{1};
  Breaker::expect(flipped, "byte " + std::to_string(entry.offset + 121) + " is padding, but not zero",
                  ErrorCode::kReserved);
  flipped = b.file();
  flipped[64] = std::byte{1};
  Breaker::expect(flipped, "byte 64 is padding, but not zero", ErrorCode::kReserved);
  flipped = b.file();
  flipped[4096 + 32 + 5] = std::byte{1};
  Breaker::expect(flipped, "byte 4133 is padding, but not zero", ErrorCode::kReserved);

  // No table at all.
  raw.tables.clear();
  Breaker::expect(raw.build(), "the file has no string table", ErrorCode::kFormat);
  raw = RawFile(b.file());
  raw.table(TableKind::kStrings).bytes.back() = std::byte{'x'};
  Breaker::expect(raw.build(), "string table: the last string has no end", ErrorCode::kFormat);
  raw = RawFile(b.file());
  raw.table(TableKind::kStrings).bytes.front() = std::byte{'x'};
  Breaker::expect(raw.build(), "string table: the string at 0 is not empty", ErrorCode::kFormat);
  raw.table(TableKind::kStrings).bytes.clear();
  Breaker::expect(raw.build(), "the file has no string table", ErrorCode::kFormat);
}

TEST_CASE("container rules: pages", "[container]") {
  const Breaker b(full_parts());
  using P = PageRecord;
  constexpr TableKind k = TableKind::kPages;
  const auto first = load<PageRecord>(b.file().data() + record_offset(b.file(), k, 0));
  const auto second = load<PageRecord>(b.file().data() + record_offset(b.file(), k, 1));
  const auto tables = std::to_string(load<TocEntry>(b.file().data() + toc_entry_offset(b.file(), k)).offset);
  const auto pages = b.records<P>(k);
  pages(0, "page 0: at byte 0, expected 4096", [](P& p) { p.offset = 0; });
  pages(1, "page 1: at byte " + std::to_string(second.offset + 4096) + ", expected " + std::to_string(second.offset),
        [](P& p) { p.offset += 4096; });
  pages(1, "page 1: at byte " + std::to_string(second.offset - 4096) + ", expected " + std::to_string(second.offset),
        [](P& p) { p.offset -= 4096; });
  pages(0, "page 0: 18446744073709551615 bytes at byte 4096, but the tables start at byte " + tables,
        [](P& p) { p.stored_bytes = UINT64_MAX; });
  pages(0,
        "page 0: " + std::to_string(first.raw_bytes + 16) + " raw bytes, but " + std::to_string(first.raw_bytes) +
            " are stored raw",
        [](P& p) { p.raw_bytes += 16; });
  pages(
      1,
      "page 1: " + std::to_string(second.stored_bytes) + " bytes compressed to " + std::to_string(second.stored_bytes),
      [](P& p) { p.raw_bytes = p.stored_bytes; });
  pages(1,
        "page 1: 4294967296 bytes compressed to " + std::to_string(second.stored_bytes) +
            ", which is more than is allowed",
        [](P& p) { p.raw_bytes = uint64_t{1} << 32; });
  pages(1,
        "page 1: 18446744073709551615 bytes compressed to " + std::to_string(second.stored_bytes) +
            ", which is more than is allowed",
        [](P& p) { p.raw_bytes = UINT64_MAX; });
  pages(2, "page 2: codec 2, which only scree 0.1 reads; convert the scene again",
        [](P& p) { p.codec = PageCodec{2}; });
  pages(2, "page 2: codec 3, but the file has major version 1", [](P& p) { p.codec = PageCodec::kSplit; });
  pages(2, "page 2: codec 4", [](P& p) { p.codec = PageCodec{4}; });
  pages(2, ErrorCode::kChecksum, "page 2: the checksum differs", [](P& p) { p.stored_bytes = p.raw_bytes = 3; });
  pages(2, ErrorCode::kChecksum, "page 2: the checksum differs", [](P& p) { p.checksum ^= 1; });
  pages(2, "image 0: page 2 is of kind 1, which holds no image", [](P& p) { p.kind = PageKind::kGeometry; });
  pages(1, "chunk 2: page 1 is of kind 2, which holds no chunks", [](P& p) { p.kind = PageKind::kImage; });
  pages(1, ErrorCode::kFormat,
        "page 1: the zstd frame holds " + std::to_string(second.raw_bytes) + " bytes, expected " +
            std::to_string(second.raw_bytes + 1),
        [](P& p) { p.raw_bytes += 1; });

  // The tables must start where the last page ends.
  RawFile raw(b.file());
  raw.page_area.resize(raw.page_area.size() + 64);
  const Bytes gap = raw.build();
  const auto third = load<PageRecord>(b.file().data() + record_offset(b.file(), k, 2));
  Breaker::expect(gap,
                  "the pages end at byte " + std::to_string(third.offset + third.stored_bytes) +
                      ", but the tables start at byte " + std::to_string(std::stoull(tables) + 64),
                  ErrorCode::kRange);
}

/// A file whose second page has `frame` in place of its zstd frame, with a matching checksum.
Bytes with_frame(Bytes frame, uint64_t raw_bytes, PageCodec codec = PageCodec::kZstd) {
  Parts parts = full_parts();
  parts.pages[1].record.codec = codec;
  parts.pages[1].record.stored_bytes = frame.size();
  parts.pages[1].record.raw_bytes = raw_bytes;
  parts.pages[1].record.checksum = XXH3_64bits(frame.data(), frame.size());
  parts.pages[1].stored = std::move(frame);
  return file_of(parts);
}

TEST_CASE("container rules: a zstd page is one frame of its size", "[container]") {
  const Parts parts = full_parts();
  const Bytes frame = parts.pages[1].stored;
  const uint64_t raw_bytes = parts.pages[1].record.raw_bytes;
  REQUIRE(!verify_copy(with_frame(frame, raw_bytes)));

  Bytes trailing = frame;
  trailing.push_back(std::byte{0});
  Breaker::expect(with_frame(trailing, raw_bytes),
                  "page 1: the zstd frame takes " + std::to_string(frame.size()) + " of " +
                      std::to_string(frame.size() + 1) + " bytes",
                  ErrorCode::kTrailing);
  Bytes twice = frame;
  twice.insert(twice.end(), frame.begin(), frame.end());
  CHECK(verify_copy(with_frame(twice, raw_bytes))->code == ErrorCode::kTrailing);

  // zstd would skip a skippable frame in front of the page's frame.
  Bytes skippable(12);
  store<uint32_t>(skippable.data(), 0x184D2A50);
  store<uint32_t>(skippable.data() + 4, 4);
  skippable.insert(skippable.end(), frame.begin(), frame.end());
  Breaker::expect(with_frame(skippable, raw_bytes), "page 1: not a zstd frame", ErrorCode::kFormat);
  Breaker::expect(with_frame(Bytes(3), raw_bytes), "page 1: not a zstd frame", ErrorCode::kFormat);

  for (size_t size = 4; size < frame.size(); ++size) {
    const auto error =
        must(verify_copy(with_frame(Bytes(frame.begin(), frame.begin() + static_cast<ptrdiff_t>(size)), raw_bytes)));
  }
  // A flipped bit gives an error or the right size, never a crash.
  for (size_t i = 0; i < frame.size(); ++i) {
    Bytes flipped = frame;
    flipped[i] ^= std::byte{1} << (i % 8);
    (void)verify_copy(with_frame(flipped, raw_bytes));
  }

  // A frame without a content size.
  Bytes unsized(ZSTD_compressBound(raw_bytes));
  ZSTD_CCtx* const context = ZSTD_createCCtx();
  ZSTD_CCtx_setParameter(context, ZSTD_c_contentSizeFlag, 0);
  const Bytes raw(raw_bytes);
  unsized.resize(ZSTD_compress2(context, unsized.data(), unsized.size(), raw.data(), raw.size()));
  ZSTD_freeCCtx(context);
  Breaker::expect(with_frame(unsized, raw_bytes), "page 1: the zstd frame does not give its size", ErrorCode::kFormat);
}

TEST_CASE("container rules: a split page has at most twice its bytes, and yields all of them", "[container]") {
  const uint64_t raw_bytes = full_parts().pages[1].record.raw_bytes;
  const auto zeros = [&](uint64_t bytes) {
    const Bytes content(bytes);
    Bytes frame(ZSTD_compressBound(bytes));
    frame.resize(ZSTD_compress(frame.data(), frame.size(), content.data(), content.size(), 3));
    return with_frame(frame, raw_bytes, PageCodec::kSplit);
  };
  Breaker::expect(zeros(2 * raw_bytes + 1),
                  "page 1: the zstd frame holds " + std::to_string(2 * raw_bytes + 1) + " bytes, expected at most " +
                      std::to_string(2 * raw_bytes),
                  ErrorCode::kFormat);
  Breaker::expect(zeros(2 * raw_bytes), "page 1: split page: tall codes of 0 bytes, expected 1 or 2",
                  ErrorCode::kRange);
  Breaker::expect(zeros(1), "page 1: split page: no header", ErrorCode::kTruncated);
  Parts parts = full_parts();
  parts.pages[2].record.codec = PageCodec::kSplit;
  Breaker::expect(file_of(parts), "page 2: split, but of kind 2", ErrorCode::kRange);
}

TEST_CASE("container rules: the limit of a compressed page's raw bytes", "[container]") {
  // Zeros compress to almost nothing, so a page of zeros stays raw if a reader would refuse the ratio.
  for (const auto& [bytes, codec] : {std::pair{size_t{kPageTargetBytes}, PageCodec::kZstd},
                                     std::pair{size_t{kPageTargetBytes} + 1, PageCodec::kRaw}}) {
    const SealedPage page = seal_page(PageKind::kImage, Bytes(bytes), 3);
    CHECK(page.record.codec == codec);
    Parts parts = full_parts();
    parts.pages[2] = page;
    CHECK(!verify_copy(file_of(parts)));
  }
  // The same page compressed by another writer.
  const Bytes zeros(kPageTargetBytes + 1);
  Bytes frame(ZSTD_compressBound(zeros.size()));
  frame.resize(ZSTD_compress(frame.data(), frame.size(), zeros.data(), zeros.size(), 3));
  Breaker::expect(
      with_frame(frame, zeros.size()),
      "page 1: 1048577 bytes compressed to " + std::to_string(frame.size()) + ", which is more than is allowed",
      ErrorCode::kRange);
  // More than 1 MiB, but compressed by less than 16 to 1.
  Bytes half(3 << 20);
  uint32_t state = 1;
  for (size_t i = 0; i < half.size() / 4; ++i)
    half[i] = static_cast<std::byte>((state = state * 1664525 + 1013904223) >> 24);
  const SealedPage page = seal_page(PageKind::kImage, half, 1);
  CHECK(page.record.codec == PageCodec::kZstd);
  Parts parts = full_parts();
  parts.pages[2] = page;
  CHECK(!verify_copy(file_of(parts)));
  // A page whose chunks need no bytes.
  const SealedPage empty = seal_page(PageKind::kGeometry, {}, 9);
  CHECK(empty.record.codec == PageCodec::kRaw);
  CHECK(empty.stored.empty());
  parts.pages.push_back(empty);
  parts.pages.push_back(empty);
  CHECK(!verify_copy(file_of(parts)));
}

/// Random bytes in any record give an error or a file that opens. They never cause a crash, an invalid read or a long
/// wait.
TEST_CASE("container rules: random damage with fitting checksums", "[container]") {
  const Bytes file = file_of(full_parts());
  const auto header = load<FileHeader>(file.data());
  const auto first = load<TocEntry>(file.data() + header.toc_offset);
  uint64_t state = 12345;
  const auto random = [&state](uint64_t limit) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (state >> 33) % limit;
  };
  size_t opened = 0;
  for (int round = 0; round < 4000; ++round) {
    Bytes damaged = file;
    for (uint64_t n = 1 + random(3); n > 0; --n) {
      const size_t at = first.offset + random(file.size() - first.offset);
      constexpr unsigned kValues[] = {0, 1, 0x7f, 0x80, 0xff};
      damaged[at] = random(2) ? static_cast<std::byte>(kValues[random(5)]) : static_cast<std::byte>(random(256));
    }
    reseal(damaged);
    if (!verify_copy(damaged)) ++opened;
  }
  CHECK(opened < 4000);
}

}  // namespace
}  // namespace scree::tests
