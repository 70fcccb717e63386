// Every rule of spec/container.md is broken once, with checksums that fit, and open() must name the place.
#include <zstd.h>

#include <cmath>
#include <limits>

#include "format/bytes.h"
#include "format/container.h"
#include "tests/catch.h"
#include "tests/format/container_fixture.h"

#define XXH_STATIC_LINKING_ONLY
#include <xxhash.h>

namespace scree::tests {
namespace {

using namespace scree::format;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// Opens a file in which one thing was changed, and wants just that message.
class Breaker {
 public:
  explicit Breaker(const Parts& parts) : file_(file_of(parts)) {
    const auto error = verify_copy(file_);
    if (error) FAIL(error->message);
  }

  template <class Record, class Change>
  void record(TableKind kind, uint64_t index, Change change, const char* message,
              ErrorCode code = ErrorCode::kRange) const {
    expect(patched<Record>(file_, kind, index, change), message, code);
  }

  /// Changes the file's header and makes its own checksum fit, unless `seal` is false.
  template <class Change>
  void header(Change change, const char* message, ErrorCode code, bool seal = true) const {
    Bytes file = file_;
    auto header = load<FileHeader>(file.data());
    change(header);
    if (seal) header.checksum = XXH3_64bits(&header, offsetof(FileHeader, checksum));
    store(file.data(), header);
    expect(file, message, code);
  }

  template <class Change>
  void toc(TableKind kind, Change change, const char* message, ErrorCode code = ErrorCode::kRange) const {
    Bytes file = file_;
    const size_t offset = toc_entry_offset(file, kind);
    auto entry = load<TocEntry>(file.data() + offset);
    change(entry);
    store(file.data() + offset, entry);
    reseal(file);
    expect(file, message, code);
  }

  static void expect(const Bytes& file, const char* message, ErrorCode code) {
    INFO("expected: " << message);
    const auto error = verify_copy(file);
    REQUIRE(error);
    CHECK(error->message == message);
    CHECK(error->code == code);
    CHECK(error->message.find('\n') == std::string::npos);
  }

  const Bytes& file() const { return file_; }

 private:
  Bytes file_;
};

TEST_CASE("container rules: header", "[container]") {
  const Breaker b(tiny_parts());
  using H = FileHeader;
  b.header([](H& h) { h.magic[0] = 'S'; }, "not a scree file", ErrorCode::kFormat);
  b.header([](H& h) { h.version_major = 0; }, "the file has version 0.0, but this program reads version 1",
           ErrorCode::kVersion);
  b.header([](H& h) { h.file_bytes = 0; }, "header: the checksum differs", ErrorCode::kChecksum, false);
  b.header([](H& h) { h.header_bytes = 72; }, "header: 72 bytes, expected 64", ErrorCode::kRange);
  b.header([](H& h) { h.reserved = 1; }, "header: a reserved field is set", ErrorCode::kReserved);
  b.header([](H& h) { h.reserved2 = uint64_t{1} << 63; }, "header: a reserved field is set", ErrorCode::kReserved);
  b.header([](H& h) { h.toc_checksum ^= 1; }, "table of contents: the checksum differs", ErrorCode::kChecksum);
  const std::string size = std::to_string(b.file().size());
  b.header([](H& h) { h.file_bytes = UINT64_MAX; },
           ("the file has " + size + " bytes, but its header says 18446744073709551615").c_str(),
           ErrorCode::kTruncated);
  b.header([](H& h) { h.file_bytes -= 1; },
           ("the file has " + size + " bytes, but its header says " + std::to_string(b.file().size() - 1)).c_str(),
           ErrorCode::kTrailing);
  for (const uint64_t offset :
       {uint64_t{0}, uint64_t{64}, uint64_t{4097}, uint64_t{b.file().size()}, UINT64_MAX - 63}) {
    b.header(
        [&](H& h) { h.toc_offset = offset; },
        ("table of contents: 12 entries at byte " + std::to_string(offset) + ", but the file has " + size + " bytes")
            .c_str(),
        ErrorCode::kRange);
  }
  const uint64_t toc = load<FileHeader>(b.file().data()).toc_offset;
  b.header(
      [](H& h) { h.toc_count = UINT32_MAX; },
      ("table of contents: 4294967295 entries at byte " + std::to_string(toc) + ", but the file has " + size + " bytes")
          .c_str(),
      ErrorCode::kRange);
  b.header([](H& h) { h.toc_count -= 1; },
           ("table of contents: ends at byte " + std::to_string(b.file().size() - 32) + ", but the file has " + size +
            " bytes")
               .c_str(),
           ErrorCode::kTrailing);
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
  b.toc(
      TableKind::kMeshes, [](T& t) { t.kind = TableKind{0}; }, "table 1: kind 0");
  b.toc(
      TableKind::kMeshes, [](T& t) { t.kind = TableKind::kPages; }, "table 1: a second page table", ErrorCode::kFormat);
  b.toc(
      TableKind::kMeshes, [](T& t) { t.record_bytes = 112; }, "mesh table: records of 112 bytes, expected 120");
  b.toc(
      TableKind::kMeshes, [](T& t) { t.record_bytes = 0; }, "mesh table: records of 0 bytes, expected 120");
  b.toc(
      TableKind::kMeshes, [](T& t) { t.record_count = 0; },
      ("table 2: at byte " + std::to_string(entry.offset + 128) + ", expected " + at).c_str());
  b.toc(
      TableKind::kMeshes, [](T& t) { t.record_count = uint64_t{1} << 60; },
      ("table 1: 1152921504606846976 records of 120 bytes at byte " + at +
       ", but the table of contents starts at byte " + start)
          .c_str());
  b.toc(
      TableKind::kMeshes, [](T& t) { t.offset = UINT64_MAX; },
      ("table 1: 1 records of 120 bytes at byte 18446744073709551615, but the table of contents starts at byte " +
       start)
          .c_str());
  b.toc(
      TableKind::kMeshes, [](T& t) { t.offset += 8; },
      ("table 1: at byte " + std::to_string(entry.offset + 8) + ", expected " + at).c_str());
  b.toc(
      TableKind::kPages, [](T& t) { t.offset = 64; }, "table 0: at byte 64, expected a multiple of 64 from 4096 on");
  b.toc(
      TableKind::kPages, [](T& t) { t.offset += 8; },
      ("table 0: at byte " + std::to_string(entry.offset - 64 + 8) + ", expected a multiple of 64 from 4096 on")
          .c_str());
  b.toc(
      TableKind::kStrings, [](T& t) { t.kind = TableKind{99}; }, "the file has no string table", ErrorCode::kFormat);
  b.toc(
      TableKind::kSource, [](T& t) { t.kind = TableKind{99}; }, "source table: 0 records, expected 1",
      ErrorCode::kFormat);

  // A table that lies at the end, shortened: the table of contents no longer follows it.
  RawFile raw(b.file());
  Bytes two = raw.build();
  raw.table(TableKind::kSource).bytes.resize(128);
  two = raw.build();
  Breaker::expect(two, "source table: 2 records, expected 1", ErrorCode::kFormat);

  // Wrong checksums and set padding are found without resealing.
  Bytes flipped = b.file();
  flipped[entry.offset] ^= std::byte{1};
  Breaker::expect(flipped, "mesh table: the checksum differs", ErrorCode::kChecksum);
  flipped = b.file();
  flipped[entry.offset + 121] = std::byte{1};
  Breaker::expect(flipped, ("byte " + std::to_string(entry.offset + 121) + " is padding, but not zero").c_str(),
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
  b.record<P>(
      k, 0, [](P& p) { p.offset = 0; }, "page 0: at byte 0, expected 4096");
  b.record<P>(
      k, 1, [](P& p) { p.offset += 4096; },
      ("page 1: at byte " + std::to_string(second.offset + 4096) + ", expected " + std::to_string(second.offset))
          .c_str());
  b.record<P>(
      k, 1, [](P& p) { p.offset -= 4096; },
      ("page 1: at byte " + std::to_string(second.offset - 4096) + ", expected " + std::to_string(second.offset))
          .c_str());
  b.record<P>(
      k, 0, [](P& p) { p.stored_bytes = UINT64_MAX; },
      ("page 0: 18446744073709551615 bytes at byte 4096, but the tables start at byte " + tables).c_str());
  b.record<P>(
      k, 0, [](P& p) { p.raw_bytes += 16; },
      ("page 0: " + std::to_string(first.raw_bytes + 16) + " raw bytes, but " + std::to_string(first.raw_bytes) +
       " are stored raw")
          .c_str());
  b.record<P>(
      k, 1, [](P& p) { p.raw_bytes = p.stored_bytes; },
      ("page 1: " + std::to_string(second.stored_bytes) + " bytes compressed to " + std::to_string(second.stored_bytes))
          .c_str());
  b.record<P>(
      k, 1, [](P& p) { p.raw_bytes = uint64_t{1} << 32; },
      ("page 1: 4294967296 bytes compressed to " + std::to_string(second.stored_bytes) +
       ", which is more than is allowed")
          .c_str());
  b.record<P>(
      k, 1, [](P& p) { p.raw_bytes = UINT64_MAX; },
      ("page 1: 18446744073709551615 bytes compressed to " + std::to_string(second.stored_bytes) +
       ", which is more than is allowed")
          .c_str());
  b.record<P>(
      k, 2, [](P& p) { p.codec = PageCodec{2}; }, "page 2: codec 2");
  b.record<P>(
      k, 2, [](P& p) { p.stored_bytes = p.raw_bytes = 3; }, "page 2: the checksum differs", ErrorCode::kChecksum);
  b.record<P>(
      k, 2, [](P& p) { p.checksum ^= 1; }, "page 2: the checksum differs", ErrorCode::kChecksum);
  b.record<P>(
      k, 2, [](P& p) { p.kind = PageKind::kGeometry; }, "image 0: page 2 is of kind 1, which holds no image");
  b.record<P>(
      k, 1, [](P& p) { p.kind = PageKind::kImage; }, "chunk 2: page 1 is of kind 2, which holds no chunks");
  b.record<P>(
      k, 1, [](P& p) { p.raw_bytes += 1; },
      ("page 1: the zstd frame holds " + std::to_string(second.raw_bytes) + " bytes, expected " +
       std::to_string(second.raw_bytes + 1))
          .c_str(),
      ErrorCode::kFormat);

  // The tables must start where the last page ends.
  RawFile raw(b.file());
  raw.page_area.resize(raw.page_area.size() + 64);
  const Bytes gap = raw.build();
  const auto third = load<PageRecord>(b.file().data() + record_offset(b.file(), k, 2));
  Breaker::expect(gap,
                  ("the pages end at byte " + std::to_string(third.offset + third.stored_bytes) +
                   ", but the tables start at byte " + std::to_string(std::stoull(tables) + 64))
                      .c_str(),
                  ErrorCode::kRange);
}

/// A file whose second page holds these stored bytes in place of the zstd frame, checksum fitting.
Bytes with_frame(Bytes frame, uint64_t raw_bytes) {
  Parts parts = full_parts();
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
                  ("page 1: the zstd frame takes " + std::to_string(frame.size()) + " of " +
                   std::to_string(frame.size() + 1) + " bytes")
                      .c_str(),
                  ErrorCode::kTrailing);
  Bytes twice = frame;
  twice.insert(twice.end(), frame.begin(), frame.end());
  CHECK(verify_copy(with_frame(twice, raw_bytes))->code == ErrorCode::kTrailing);

  // A skippable frame in front would be passed over by zstd.
  Bytes skippable(12);
  store<uint32_t>(skippable.data(), 0x184D2A50);
  store<uint32_t>(skippable.data() + 4, 4);
  skippable.insert(skippable.end(), frame.begin(), frame.end());
  Breaker::expect(with_frame(skippable, raw_bytes), "page 1: not a zstd frame", ErrorCode::kFormat);
  Breaker::expect(with_frame(Bytes(3), raw_bytes), "page 1: not a zstd frame", ErrorCode::kFormat);

  for (size_t size = 4; size < frame.size(); ++size) {
    const auto error =
        verify_copy(with_frame(Bytes(frame.begin(), frame.begin() + static_cast<ptrdiff_t>(size)), raw_bytes));
    REQUIRE(error);
  }
  // Any flipped bit gives an error or the right size; nothing else, and no crash.
  for (size_t i = 0; i < frame.size(); ++i) {
    Bytes flipped = frame;
    flipped[i] ^= std::byte{1} << (i % 8);
    (void)verify_copy(with_frame(flipped, raw_bytes));
  }

  // A frame that does not say its size.
  Bytes unsized(ZSTD_compressBound(raw_bytes));
  ZSTD_CCtx* const context = ZSTD_createCCtx();
  ZSTD_CCtx_setParameter(context, ZSTD_c_contentSizeFlag, 0);
  const Bytes raw(raw_bytes);
  unsized.resize(ZSTD_compress2(context, unsized.data(), unsized.size(), raw.data(), raw.size()));
  ZSTD_freeCCtx(context);
  Breaker::expect(with_frame(unsized, raw_bytes), "page 1: the zstd frame does not say its size", ErrorCode::kFormat);
}

TEST_CASE("container rules: what a compressed page may grow to", "[container]") {
  // Zeros compress to almost nothing: kept raw where a reader would refuse them.
  for (const auto& [bytes, codec] : {std::pair{size_t{kPageTargetBytes}, PageCodec::kZstd},
                                     std::pair{size_t{kPageTargetBytes} + 1, PageCodec::kRaw}}) {
    const SealedPage page = seal_page(PageKind::kImage, Bytes(bytes), 3);
    CHECK(page.record.codec == codec);
    Parts parts = full_parts();
    parts.pages[2] = page;
    CHECK(!verify_copy(file_of(parts)));
  }
  // The same page compressed by someone else.
  const Bytes zeros(kPageTargetBytes + 1);
  Bytes frame(ZSTD_compressBound(zeros.size()));
  frame.resize(ZSTD_compress(frame.data(), frame.size(), zeros.data(), zeros.size(), 3));
  Breaker::expect(
      with_frame(frame, zeros.size()),
      ("page 1: 1048577 bytes compressed to " + std::to_string(frame.size()) + ", which is more than is allowed")
          .c_str(),
      ErrorCode::kRange);
  // Past 1 MiB, but not 16 to 1.
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

TEST_CASE("container rules: meshes", "[container]") {
  const Breaker b(full_parts());
  using M = MeshRecord;
  constexpr TableKind k = TableKind::kMeshes;
  b.record<M>(
      k, 0, [](M& m) { m.group = 2; }, "mesh 0: group 2, but the file has 2 groups");
  b.record<M>(
      k, 0, [](M& m) { m.group = 1; }, "mesh 0: group 1, but it is a mesh of group 0");
  b.record<M>(
      k, 0, [](M& m) { m.group = kNone; }, "mesh 0: group 4294967295, but the file has 2 groups");
  b.record<M>(
      k, 0, [](M& m) { m.material = 2; }, "mesh 0: material 2, but the file has 2 materials");
  b.record<M>(
      k, 0, [](M& m) { m.attributes |= 16; }, "mesh 0: attributes 31", ErrorCode::kReserved);
  b.record<M>(
      k, 1, [](M& m) { m.bounds_max[2] = kInfinity; }, "mesh 1: bounds that are not finite");
  b.record<M>(
      k, 1, [](M& m) { m.bounds_min[0] = float(kNan); }, "mesh 1: bounds that are not finite");
  b.record<M>(
      k, 2, [](M& m) { m.bounds_min[1] = 0.5f; }, "mesh 2: bounds from 0.5 to 0");
  b.record<M>(
      k, 0, [](M& m) { m.max_position_error = -1; }, "mesh 0: position error -1");
  b.record<M>(
      k, 0, [](M& m) { m.max_position_error = kNan; }, "mesh 0: position error nan");
  b.record<M>(
      k, 1, [](M& m) { m.max_position_error = 1; }, "mesh 1: position error 1, but float32 positions");
  b.record<M>(
      k, 0, [](M& m) { m.max_uv_error = kInfinity; }, "mesh 0: uv error inf");
  b.record<M>(
      k, 0, [](M& m) { m.lattice_bits[1] = 25; }, "mesh 0: 25 lattice bits, expected at most 24");
  const char* const lattice = "mesh 0: lattice from 0, step 2^128, whose points are no finite floats";
  b.record<M>(
      k, 0, [](M& m) { m.lattice_exponent = 128; }, lattice);
  b.record<M>(
      k, 0, [](M& m) { m.lattice_exponent = INT32_MIN; },
      "mesh 0: lattice from 0, step 2^-2147483648, whose points are no finite floats");
  b.record<M>(
      k, 0, [](M& m) { m.lattice_exponent = 113; },
      "mesh 0: lattice from 0, step 2^113, whose points are no finite floats");
  b.record<M>(
      k, 0, [](M& m) { m.lattice_min[2] = int64_t{1} << 52; },
      "mesh 0: lattice from 4503599627370496, step 2^-10, whose points are no finite floats");
  b.record<M>(
      k, 0, [](M& m) { m.lattice_min[2] = INT64_MIN; },
      "mesh 0: lattice from -9223372036854775808, step 2^-10, whose points are no finite floats");
  b.record<M>(
      k, 1, [](M& m) { m.lattice_min[0] = 1; }, "mesh 1: a lattice, but float32 positions", ErrorCode::kReserved);
  b.record<M>(
      k, 1, [](M& m) { m.lattice_exponent = 1; }, "mesh 1: a lattice, but float32 positions", ErrorCode::kReserved);
  b.record<M>(
      k, 1, [](M& m) { m.lattice_bits[2] = 1; }, "mesh 1: a lattice, but float32 positions", ErrorCode::kReserved);
  b.record<M>(
      k, 1, [](M& m) { m.position_encoding = PositionEncoding{2}; }, "mesh 1: position encoding 2");
  b.record<M>(
      k, 1, [](M& m) { m.first_chunk = 1; }, "mesh 1: 1 chunks from 1, expected from 2 to at most 3");
  b.record<M>(
      k, 1, [](M& m) { m.chunk_count = 2; }, "mesh 1: 2 chunks from 2, expected from 2 to at most 3");
  b.record<M>(
      k, 1, [](M& m) { m.chunk_count = UINT64_MAX; },
      "mesh 1: 18446744073709551615 chunks from 2, expected from 2 to at most 3");
  b.record<M>(
      k, 0, [](M& m) { m.triangle_count += 1; },
      "mesh 0: 229 triangles and 180 vertices, but its chunks have 228 and 180");
  b.record<M>(
      k, 0, [](M& m) { m.vertex_count -= 1; },
      "mesh 0: 228 triangles and 179 vertices, but its chunks have 228 and 180");
  b.record<M>(
      k, 2, [](M& m) { m.triangle_count = 1; }, "mesh 2: 1 triangles and 0 vertices, but its chunks have 0 and 0");
  b.record<M>(
      k, 1, [](M& m) { m.source_vertex_count = UINT64_MAX; }, "mesh 1: 18446744073709551615 vertices in its source");
  // A chunk that no mesh has.
  Parts parts = full_parts();
  parts.tables.chunks.push_back(parts.tables.chunks[2]);
  Breaker::expect(file_of(parts), "chunk 3: belongs to no mesh", ErrorCode::kRange);
}

TEST_CASE("container rules: chunks", "[container]") {
  const Breaker b(full_parts());
  using C = ChunkRecord;
  constexpr TableKind k = TableKind::kChunks;
  b.record<C>(
      k, 1, [](C& c) { c.page = 3; }, "chunk 1: page 3, but the file has 3 pages");
  b.record<C>(
      k, 1, [](C& c) { c.page = 2; }, "chunk 1: page 2 is of kind 2, which holds no chunks");
  b.record<C>(
      k, 1, [](C& c) { c.mesh = 1; }, "chunk 1: mesh 1, but it is a chunk of mesh 0");
  b.record<C>(
      k, 1, [](C& c) { c.encoding = ChunkEncoding{1}; }, "chunk 1: encoding 1");
  b.record<C>(
      k, 1, [](C& c) { c.reserved[2] = 1; }, "chunk 1: a reserved field is set", ErrorCode::kReserved);
  b.record<C>(
      k, 1, [](C& c) { c.first_triangle = 0; }, "chunk 1: first triangle 0, but the chunks before have 100");
  b.record<C>(
      k, 1, [](C& c) { c.triangle_count = 0; }, "chunk 1: no triangles");
  b.record<C>(
      k, 1, [](C& c) { c.triangle_count = 29; }, "chunk 1: 90 vertices, but 29 triangles");
  b.record<C>(
      k, 2, [](C& c) { c.vertex_count = 295; }, "chunk 2: 295 vertices, but 98 triangles");
  b.record<C>(
      k, 0, [](C& c) { c.bytes += 16; }, "chunk 0: 1888 bytes, but its streams take 1872");
  b.record<C>(
      k, 0, [](C& c) { c.offset = 8; }, "chunk 0: offset 8 is no multiple of 16");
  b.record<C>(
      k, 1, [](C& c) { c.offset += 16; }, "chunk 1: 1984 bytes at 1888 of page 0, which has 3856");
  b.record<C>(
      k, 1, [](C& c) { c.offset = UINT64_MAX - 15; },
      "chunk 1: 1984 bytes at 18446744073709551600 of page 0, which has 3856");

  b.record<C>(
      k, 0, [](C& c) { c.index_bits = 33; }, "chunk 0: 33 index bits");
  b.record<C>(
      k, 0, [](C& c) { c.index_min = 90; }, "chunk 0: indices from 90 of 7 bits, but it has 90 vertices");
  b.record<C>(
      k, 0, [](C& c) { c.index_min = 26; }, "chunk 0: indices from 26 of 7 bits, but it has 90 vertices");
  b.record<C>(
      k, 0, [](C& c) { c.index_min = UINT32_MAX; },
      "chunk 0: indices from 4294967295 of 7 bits, but it has 90 vertices");
  b.record<C>(
      k, 0, [](C& c) { c.index_bits = 32; }, "chunk 0: indices from 3 of 32 bits, but it has 90 vertices");
  b.record<C>(
      k, 0, [](C& c) { c.vertex_count = 0; }, "chunk 0: indices from 3 of 7 bits, but it has 0 vertices");
  b.record<C>(
      k, 0, [](C& c) { c.triangle_count = 65537, c.index_bits = 0; },
      "chunk 0: 65537 triangles of 0 index bits, expected at most 65536");
  b.record<C>(
      k, 0, [](C& c) { c.position_bits[0] = 25; },
      "chunk 0: positions from 5 of 25 bits, but the mesh's lattice has 16 bits");
  b.record<C>(
      k, 0, [](C& c) { c.position_bits[2] = 15; },
      "chunk 0: positions from 5 of 15 bits, but the mesh's lattice has 14 bits");
  b.record<C>(
      k, 0, [](C& c) { c.position_min[2] = 8192; },
      "chunk 0: positions from 8192 of 14 bits, but the mesh's lattice has 14 bits");
  b.record<C>(
      k, 0, [](C& c) { c.position_min[0] = UINT32_MAX; },
      "chunk 0: positions from 4294967295 of 12 bits, but the mesh's lattice has 16 bits");
  b.record<C>(
      k, 2, [](C& c) { c.position_bits[1] = 24; }, "chunk 2: position bits or minimum, but float32 positions");
  b.record<C>(
      k, 2, [](C& c) { c.position_min[1] = 1; }, "chunk 2: position bits or minimum, but float32 positions");
  b.record<C>(
      k, 0, [](C& c) { c.uv_bits[1] = 25; }, "chunk 0: 25 uv bits, expected at most 24");
  b.record<C>(
      k, 0, [](C& c) { c.uv_exponent = 127; },
      "chunk 0: uv lattice from -7, step 2^127, whose points are no finite floats");
  b.record<C>(
      k, 0, [](C& c) { c.uv_exponent = -150; },
      "chunk 0: uv lattice from -7, step 2^-150, whose points are no finite floats");
  b.record<C>(
      k, 0, [](C& c) { c.uv_min[1] = -(int64_t{1} << 52); },
      "chunk 0: uv lattice from -4503599627370496, step 2^-16, whose points are no finite floats");
  b.record<C>(
      k, 0, [](C& c) { c.normal_bits = 1; }, "chunk 0: 1 normal bits, expected 2 to 16");
  b.record<C>(
      k, 0, [](C& c) { c.normal_bits = 17; }, "chunk 0: 17 normal bits, expected 2 to 16");
  b.record<C>(
      k, 0, [](C& c) { c.source_bits = 33; }, "chunk 0: source triangles from 0 of 33 bits");
  b.record<C>(
      k, 0, [](C& c) { c.source_min = UINT64_MAX; }, "chunk 0: source triangles from 18446744073709551615 of 9 bits");
  const char* const uv = "chunk 2: uv fields are set, but the mesh has no uv";
  b.record<C>(
      k, 2, [](C& c) { c.uv_min[0] = 1; }, uv, ErrorCode::kReserved);
  b.record<C>(
      k, 2, [](C& c) { c.uv_exponent = 1; }, uv, ErrorCode::kReserved);
  b.record<C>(
      k, 2, [](C& c) { c.uv_bits[0] = 1; }, uv, ErrorCode::kReserved);
  b.record<C>(
      k, 2, [](C& c) { c.normal_bits = 8; }, "chunk 2: normal bits are set, but the mesh has no normals",
      ErrorCode::kReserved);
  const char* const ids = "chunk 2: source triangle fields are set, but the mesh has none";
  b.record<C>(
      k, 2, [](C& c) { c.source_bits = 1; }, ids, ErrorCode::kReserved);
  b.record<C>(
      k, 2, [](C& c) { c.source_min = 1; }, ids, ErrorCode::kReserved);
}

TEST_CASE("container rules: a chunk of all-equal indices and a large page for one chunk", "[container]") {
  Parts parts = tiny_parts();
  MeshRecord& mesh = parts.tables.meshes[0];
  ChunkRecord& chunk = parts.tables.chunks[0];
  const auto triangles = [&](uint32_t count, uint8_t bits) {
    mesh.triangle_count = chunk.triangle_count = count;
    mesh.vertex_count = chunk.vertex_count = 1;
    parts.tables.scenes[0].triangle_count = count;
    chunk.index_bits = bits;
    chunk.bytes = bits == 0 ? 0 : align_up((3 * uint64_t{count} * bits + 7) / 8 + 8, 16);
    for (uint8_t& b : chunk.position_bits) b = 0;
    parts.pages[0] = seal_page(PageKind::kGeometry, Bytes(chunk.bytes), 0);
    return verify_copy(file_of(parts));
  };
  CHECK(!triangles(1, 0));
  CHECK(!triangles(65536, 0));
  CHECK(triangles(65537, 0));
  CHECK(!triangles(65537, 1));
  CHECK(triangles(65537, 2));  // of one vertex, a second bit has no meaning

  CHECK(!triangles(3000000, 1));  // 1.1 MB in a page of its own
  REQUIRE(chunk.bytes > kPageTargetBytes);
  parts.pages[0] = seal_page(PageKind::kGeometry, Bytes(chunk.bytes + 16), 0);
  Breaker::expect(file_of(parts),
                  "chunk 0: shares page 0, which has 1125024 bytes; only a page for one chunk may pass 1048576",
                  ErrorCode::kRange);
}

TEST_CASE("container rules: coordinates near the largest float are no error", "[container]") {
  Parts parts = tiny_parts();
  MeshRecord& mesh = parts.tables.meshes[0];
  mesh.lattice_exponent = 126;  // x: 0 to 2^127; that 3 x 2^126 would be one more code does not matter, 4 x would
  mesh.bounds_max[0] = std::ldexp(1.0f, 127);
  CHECK(!verify_copy(file_of(parts)));
  mesh.lattice_exponent = 127;
  CHECK(verify_copy(file_of(parts)));
}

TEST_CASE("container rules: groups and nodes", "[container]") {
  const Breaker b(full_parts());
  using G = GroupRecord;
  using N = NodeRecord;
  const auto strings =
      std::to_string(load<TocEntry>(b.file().data() + toc_entry_offset(b.file(), TableKind::kStrings)).record_count);
  const uint32_t end = static_cast<uint32_t>(std::stoul(strings));
  const auto name = [&](const char* place) {
    return place + (": string at " + strings) + ", but the strings take " + strings + " bytes";
  };
  constexpr TableKind g = TableKind::kGroups;
  b.record<G>(
      g, 1, [&](G& r) { r.name = end; }, name("group 1").c_str());
  b.record<G>(
      g, 1, [](G& r) { r.reserved = 1; }, "group 1: a reserved field is set", ErrorCode::kReserved);
  b.record<G>(
      g, 1, [](G& r) { r.first_mesh = 1; }, "group 1: 1 meshes from 1, expected from 2 to at most 3");
  b.record<G>(
      g, 1, [](G& r) { r.mesh_count = UINT32_MAX; }, "group 1: 4294967295 meshes from 2, expected from 2 to at most 3");
  b.record<G>(
      g, 1, [](G& r) { r.mesh_count = 0; }, "mesh 2: belongs to no group");

  constexpr TableKind k = TableKind::kNodes;
  b.record<N>(
      k, 1, [&](N& n) { n.name = end; }, name("node 1").c_str());
  b.record<N>(
      k, 1, [](N& n) { n.parent = 1; }, "node 1: parent 1, expected a node before it");
  b.record<N>(
      k, 0, [](N& n) { n.parent = 3; }, "node 0: parent 3, expected a node before it");
  b.record<N>(
      k, 1, [](N& n) { n.group = 2; }, "node 1: group 2, but the file has 2 groups");
  b.record<N>(
      k, 1, [](N& n) { n.camera = 2; }, "node 1: camera 2, but the file has 2 cameras");
  b.record<N>(
      k, 1, [](N& n) { n.flags = 2; }, "node 1: a reserved field or flag is set", ErrorCode::kReserved);
  b.record<N>(
      k, 1, [](N& n) { n.reserved = 2; }, "node 1: a reserved field or flag is set", ErrorCode::kReserved);
  b.record<N>(
      k, 2, [](N& n) { n.node_instance_count = 3; }, "node 2: 3 node instances from 0, but the file has 2");
  b.record<N>(
      k, 2, [](N& n) { n.first_node_instance = UINT64_MAX; },
      "node 2: 2 node instances from 18446744073709551615, but the file has 2");
  b.record<N>(
      k, 0, [](N& n) { n.local[15] = kNan; }, "node 0: a transform that is not finite");
  b.record<N>(
      k, 1, [](N& n) { n.local[0] = HUGE_VAL; }, "node 1: a transform that is not finite");
  b.record<N>(
      k, 1, [](N& n) { n.local[10] = 1; }, "node 1: more than translation, rotation and scale", ErrorCode::kReserved);
  using I = NodeInstanceRecord;
  b.record<I>(
      TableKind::kNodeInstances, 1, [](I& i) { i.translation[2] = kInfinity; },
      "node instance 1: a transform that is not finite");
  b.record<I>(
      TableKind::kNodeInstances, 1, [](I& i) { i.rotation[3] = kInfinity; },
      "node instance 1: a transform that is not finite");
  b.record<I>(
      TableKind::kNodeInstances, 1, [](I& i) { i.scale[0] = float(kNan); },
      "node instance 1: a transform that is not finite");
}

TEST_CASE("container rules: instances and scenes", "[container]") {
  const Breaker b(full_parts());
  using I = InstanceRecord;
  constexpr TableKind k = TableKind::kInstances;
  b.record<I>(
      k, 0, [](I& i) { i.mesh = 3; }, "instance 0: mesh 3, but the file has 3 meshes");
  b.record<I>(
      k, 0, [](I& i) { i.node = 4; }, "instance 0: node 4, but the file has 4 nodes");
  b.record<I>(
      k, 0, [](I& i) { i.matrix = 2; }, "instance 0: matrix 2, but the file has 2 matrices");
  b.record<I>(
      k, 0, [](I& i) { i.node = 3; }, "instance 0: mesh 0 of group 0, but node 3 has group 1");
  b.record<I>(
      k, 0, [](I& i) { i.node = 0; }, "instance 0: mesh 0 of group 0, but node 0 has group 4294967295");
  b.record<I>(
      k, 0, [](I& i) { i.node_instance = 1; }, "instance 0: node instance 1, but node 1 has 0");
  b.record<I>(
      k, 1, [](I& i) { i.node_instance = 2; }, "instance 1: node instance 2, but node 2 has 2");
  b.record<I>(
      k, 0, [](I& i) { i.mesh = 1; }, "instance 1: mesh 0 after mesh 1, expected ascending order");
  using M = MatrixRecord;
  b.record<M>(
      TableKind::kMatrices, 1, [](M& m) { m.rows[2][3] = kNan; }, "matrix 1: not finite");

  using S = SceneRecord;
  constexpr TableKind s = TableKind::kScenes;
  b.record<S>(
      s, 1, [](S& r) { r.flags = 2; }, "scene 1: flags 2", ErrorCode::kReserved);
  b.record<S>(
      s, 0, [](S& r) { r.flags = 1; }, "scene 1: a second default scene");
  b.record<S>(
      s, 0, [](S& r) { r.root_count = 4; }, "scene 0: 4 roots from 0, but the file has 3");
  b.record<S>(
      s, 0, [](S& r) { r.first_root = UINT64_MAX; }, "scene 0: 1 roots from 18446744073709551615, but the file has 3");
  b.record<S>(
      s, 1, [](S& r) { r.first_instance = 3; }, "scene 1: 2 instances from 3, expected from 4 to at most 6");
  b.record<S>(
      s, 1, [](S& r) { r.instance_count = UINT64_MAX; },
      "scene 1: 18446744073709551615 instances from 4, expected from 4 to at most 6");
  b.record<S>(
      s, 1, [](S& r) { r.instance_count = 1; }, "instance 5: belongs to no scene");
  b.record<S>(
      s, 0, [](S& r) { r.triangle_count += 1; }, "scene 0: 783 triangles, but its instances have 782");
  b.record<S>(
      s, 0, [](S& r) { r.name = UINT32_MAX; },
      ("scene 0: string at 4294967295, but the strings take " +
       std::to_string(load<TocEntry>(b.file().data() + toc_entry_offset(b.file(), TableKind::kStrings)).record_count) +
       " bytes")
          .c_str());
  b.record<uint32_t>(
      TableKind::kSceneRoots, 2, [](uint32_t& root) { root = 4; }, "scene root 2: node 4, but the file has 4 nodes");
}

TEST_CASE("container rules: materials, textures, images, cameras, source", "[container]") {
  const Breaker b(full_parts());
  const auto strings =
      std::to_string(load<TocEntry>(b.file().data() + toc_entry_offset(b.file(), TableKind::kStrings)).record_count);
  const uint32_t end = static_cast<uint32_t>(std::stoul(strings));
  const auto name = [&](const char* place) {
    return place + (": string at " + strings) + ", but the strings take " + strings + " bytes";
  };
  using M = MaterialRecord;
  constexpr TableKind m = TableKind::kMaterials;
  b.record<M>(
      m, 0, [&](M& r) { r.name = end; }, name("material 0").c_str());
  b.record<M>(
      m, 1, [](M& r) { r.texture = 1; }, "material 1: texture 1, but the file has 1 textures");
  b.record<M>(
      m, 1, [](M& r) { r.flags |= 16; }, "material 1: a reserved field or flag is set", ErrorCode::kReserved);
  b.record<M>(
      m, 1, [](M& r) { r.reserved = 1; }, "material 1: a reserved field or flag is set", ErrorCode::kReserved);
  const char* const factor = "material 1: a factor that is not finite";
  b.record<M>(
      m, 1, [](M& r) { r.base_color[3] = kInfinity; }, factor);
  b.record<M>(
      m, 1, [](M& r) { r.uv_offset[1] = kInfinity; }, factor);
  b.record<M>(
      m, 1, [](M& r) { r.uv_scale[1] = kInfinity; }, factor);
  b.record<M>(
      m, 1, [](M& r) { r.uv_rotation = kInfinity; }, factor);
  b.record<M>(
      m, 1, [](M& r) { r.alpha_cutoff = float(kNan); }, factor);

  using T = TextureRecord;
  constexpr TableKind t = TableKind::kTextures;
  b.record<T>(
      t, 0, [&](T& r) { r.name = end; }, name("texture 0").c_str());
  b.record<T>(
      t, 0, [](T& r) { r.image = kNone; }, "texture 0: image 4294967295, but the file has 1 images");
  b.record<T>(
      t, 0, [](T& r) { r.wrap_s = Wrap{3}; }, "texture 0: wrap 3 and 2");
  b.record<T>(
      t, 0, [](T& r) { r.wrap_t = Wrap{65535}; }, "texture 0: wrap 1 and 65535");
  b.record<T>(
      t, 0, [](T& r) { r.mag_filter = 9984; }, "texture 0: filters 9984 and 9987");
  b.record<T>(
      t, 0, [](T& r) { r.min_filter = 9988; }, "texture 0: filters 9729 and 9988");

  using I = ImageRecord;
  constexpr TableKind i = TableKind::kImages;
  b.record<I>(
      i, 0, [&](I& r) { r.name = end; }, name("image 0").c_str());
  b.record<I>(
      i, 0, [](I& r) { r.page = 3; }, "image 0: page 3, but the file has 3 pages");
  b.record<I>(
      i, 0, [](I& r) { r.page = 0; }, "image 0: page 0 is of kind 1, which holds no image");
  b.record<I>(
      i, 0, [](I& r) { r.codec = ImageCodec{0}; }, "image 0: codec 0");
  b.record<I>(
      i, 0, [](I& r) { r.codec = ImageCodec{3}; }, "image 0: codec 3");
  b.record<I>(
      i, 0, [](I& r) { r.width = 0; }, "image 0: 0 x 480 pixels, expected 1 to 16777216");
  b.record<I>(
      i, 0, [](I& r) { r.height = UINT32_MAX; }, "image 0: 640 x 4294967295 pixels, expected 1 to 16777216");
  b.record<I>(
      i, 0, [](I& r) { r.channels = 0; }, "image 0: 0 channels");
  b.record<I>(
      i, 0, [](I& r) { r.channels = 5; }, "image 0: 5 channels");
  b.record<I>(
      i, 0, [](I& r) { r.index_page = 2; }, "image 0: index page 2, which this version does not have");
  b.record<I>(
      i, 0, [](I& r) { r.reserved = 1; }, "image 0: a reserved field is set", ErrorCode::kReserved);

  using C = CameraRecord;
  constexpr TableKind c = TableKind::kCameras;
  b.record<C>(
      c, 0, [&](C& r) { r.name = end; }, name("camera 0").c_str());
  b.record<C>(
      c, 0, [](C& r) { r.kind = CameraKind{3}; }, "camera 0: kind 3");
  b.record<C>(
      c, 0, [](C& r) { r.y = 0; }, "camera 0: angle 0");
  b.record<C>(
      c, 0, [](C& r) { r.y = 3.2; }, "camera 0: angle 3.2");
  b.record<C>(
      c, 0, [](C& r) { r.x = -1; }, "camera 0: aspect ratio -1");
  b.record<C>(
      c, 0, [](C& r) { r.z_near = 0; }, "camera 0: depths from 0 to 0");
  b.record<C>(
      c, 0, [](C& r) { r.z_far = 0.1; }, "camera 0: depths from 0.1 to 0.1");
  b.record<C>(
      c, 0, [](C& r) { r.z_far = HUGE_VAL; }, "camera 0: a number that is not finite");
  b.record<C>(
      c, 1, [](C& r) { r.x = 0; }, "camera 1: size 0 by 10");
  b.record<C>(
      c, 1, [](C& r) { r.z_near = -1; }, "camera 1: depths from -1 to 100");
  b.record<C>(
      c, 1, [](C& r) { r.z_far = 0; }, "camera 1: depths from 0 to 0");

  using S = SourceRecord;
  b.record<S>(
      TableKind::kSource, 0, [&](S& r) { r.name = end; }, name("source 0").c_str());
  b.record<S>(
      TableKind::kSource, 0, [&](S& r) { r.options = end; }, name("source 0").c_str());
  b.record<S>(
      TableKind::kSource, 0, [&](S& r) { r.generator = end; }, name("source 0").c_str());
  b.record<S>(
      TableKind::kSource, 0, [&](S& r) { r.copyright = end; }, name("source 0").c_str());
  using L = LeftOutRecord;
  b.record<L>(
      TableKind::kLeftOut, 1, [&](L& r) { r.what = end; }, name("left-out 1").c_str());
  b.record<L>(
      TableKind::kLeftOut, 1, [&](L& r) { r.reserved = 1; }, "left-out 1: a reserved field is set",
      ErrorCode::kReserved);
}

TEST_CASE("container rules: counts of triangles", "[container]") {
  // Triangles that take bits take bytes.
  Parts parts = tiny_parts();
  parts.tables.meshes[0].triangle_count = parts.tables.chunks[0].triangle_count = UINT32_MAX;
  parts.tables.chunks[0].bytes = 0;
  Breaker::expect(file_of(parts), "chunk 0: 0 bytes, but its streams take 3221225504", ErrorCode::kRange);

  // A scene of more triangles than 36-bit ids tell apart is a valid file.
  parts = tiny_parts();
  TableSet& tables = parts.tables;
  ChunkRecord& chunk = tables.chunks[0];
  chunk.triangle_count = kMaxChunkTriangles;
  chunk.index_bits = 0;
  chunk.bytes = 16;
  tables.chunks.resize(16, chunk);
  for (uint32_t i = 0; i < 16; ++i) tables.chunks[i].first_triangle = uint64_t{i} * kMaxChunkTriangles;
  tables.meshes[0].chunk_count = 16;
  tables.meshes[0].triangle_count = 16 * uint64_t{kMaxChunkTriangles};
  tables.meshes[0].vertex_count = 16 * 3;
  tables.instances.resize(65537, tables.instances[0]);
  tables.scenes[0].instance_count = tables.instances.size();
  tables.scenes[0].triangle_count = tables.instances.size() * tables.meshes[0].triangle_count;
  REQUIRE(tables.scenes[0].triangle_count > uint64_t{1} << 36);
  CHECK(!verify_copy(file_of(parts)));
}

/// Any bytes in any record: an error or a file that opens; never a crash, a wrong read or a long wait.
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
