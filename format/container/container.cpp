#include "format/container/container.h"

#include <zstd.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cstddef>
#include <cstring>
#include <new>
#include <stdexcept>

#include "format/bytes.h"
#include "format/container/check.h"
#include "format/container/checksum.h"

namespace scree::format {

struct Container::Views : TableViews {};

namespace {

struct KnownTable {
  const char* name;
  uint32_t record_bytes;
  uint32_t alignment;
};

template <class Record>
constexpr KnownTable known(const char* name) {
  return {name, sizeof(Record), alignof(Record)};
}

constexpr std::array<KnownTable, kKnownTableKinds> kKnownTables = {{
    {nullptr, 0, 1},
    known<PageRecord>("page"),
    known<MeshRecord>("mesh"),
    known<ChunkRecord>("chunk"),
    known<GroupRecord>("group"),
    known<NodeRecord>("node"),
    known<InstanceRecord>("instance"),
    known<MatrixRecord>("matrix"),
    known<NodeInstanceRecord>("node instance"),
    known<MaterialRecord>("material"),
    known<TextureRecord>("texture"),
    known<ImageRecord>("image"),
    known<CameraRecord>("camera"),
    known<SceneRecord>("scene"),
    known<uint32_t>("scene root"),
    known<char>("string"),
    known<SourceRecord>("source"),
    known<LeftOutRecord>("left-out"),
    known<MipLevelRecord>("mip level"),
    known<uint64_t>("left-out cost"),
    known<SurfaceRecord>("surface"),
    known<LightRecord>("light"),
    known<MaskRecord>("mask"),
}};
static_assert(kKnownTables[static_cast<uint32_t>(TableKind::kMasks)].record_bytes == sizeof(MaskRecord));

constexpr bool is_known(uint32_t kind) {
  return kind < kKnownTableKinds && kKnownTables[kind].name != nullptr;
}

constexpr uint32_t kZstdMagic = 0xFD2FB528;  // RFC 8878, 3.1.1

/// Checks that the bytes in [begin, end) are zero. `base`: offset of `bytes` in the file, for the error.
Result<void> check_zero(std::span<const std::byte> bytes, uint64_t begin, uint64_t end, uint64_t base = 0) {
  const std::byte* const first = bytes.data() + begin;
  const uint64_t count = end - begin;
  // All bytes are zero if the first one is and each equals its neighbour; memcmp tests that at full speed.
  if (count == 0 || (*first == std::byte{0} && std::memcmp(first, first + 1, count - 1) == 0)) return {};
  uint64_t at = begin;
  while (bytes[at] == std::byte{0}) ++at;
  return fail(ErrorCode::kReserved, "byte ", base + at, " is padding, but not zero");
}

/// A file that is not a .scree file. A glTF is named, because many users try one first.
Error not_scree(std::span<const std::byte> file) {
  constexpr std::string_view kGlb = "glTF";
  const std::string_view head(reinterpret_cast<const char*>(file.data()), std::min<size_t>(file.size(), 64));
  if (head.starts_with(kGlb))
    return fail(ErrorCode::kFormat, "this is a glTF, not a scree file: `scree convert` packs it first");
  const size_t first = head.find_first_not_of(" \t\r\n\xef\xbb\xbf");
  if (first != std::string_view::npos && head[first] == '{')
    return fail(ErrorCode::kFormat, "not a scree file but JSON: if this is a glTF, `scree convert` packs it first");
  // convert writes the header last.
  if (head.size() == 64 && head.find_first_not_of('\0') == std::string_view::npos)
    return fail(ErrorCode::kFormat, "not a scree file, or one whose conversion did not end: it begins with zeros");
  return fail(ErrorCode::kFormat, "not a scree file");
}

Result<FileHeader> check_header(std::span<const std::byte> file) {
  if (file.size() < sizeof(FileHeader)) {
    if (!std::equal(file.begin(), file.begin() + static_cast<ptrdiff_t>(std::min(file.size(), sizeof kMagic)),
                    reinterpret_cast<const std::byte*>(kMagic))) {
      return not_scree(file);
    }
    return fail(ErrorCode::kTruncated, "the file has ", file.size(), " bytes, but its header takes ",
                sizeof(FileHeader));
  }
  const FileHeader header = load<FileHeader>(file.data());
  if (std::memcmp(header.magic, kMagic, sizeof kMagic) != 0) return not_scree(file);
  // The version comes first: another major version may change everything behind it, even the checksum.
  if (header.version_major != kVersionMajor && header.version_major != kSecondMajor) {
    return fail(ErrorCode::kVersion, "the file has version ", header.version_major, ".", header.version_minor,
                ", but this program reads versions ", kVersionMajor, " and ", kSecondMajor);
  }
  const uint64_t actual = checksum(file.first(offsetof(FileHeader, checksum)));
  if (actual != header.checksum) return fail(ErrorCode::kChecksum, "header: the checksum differs");
  if (header.header_bytes != sizeof(FileHeader)) {
    return fail(ErrorCode::kRange, "header: ", header.header_bytes, " bytes, expected ", sizeof(FileHeader));
  }
  if (header.reserved != 0 || header.reserved2 != 0)
    return fail(ErrorCode::kReserved, "header: a reserved field is set");
  if (header.file_bytes > file.size()) {
    return fail(ErrorCode::kTruncated, "the file has ", file.size(), " bytes, but its header gives ",
                header.file_bytes);
  }
  if (header.file_bytes < file.size()) {
    return fail(ErrorCode::kTrailing, "the file has ", file.size(), " bytes, but its header gives ", header.file_bytes);
  }
  return header;
}

/// Hashes the tables one block ahead of the records' checks, so that memory is read once for both.
class TableHashes final : public TableReader {
 public:
  explicit TableHashes(const TableViews& tables) : tables_(tables) {}

  uint64_t announce(TableKind kind, uint64_t record) override {
    const TableView& table = tables_.view(kind);
    const uint64_t block = std::max<uint64_t>(1, kBlockBytes / table.stride);
    hash_to(static_cast<uint32_t>(kind), std::min(table.count, record + block));
    return progress_[static_cast<uint32_t>(kind)].records;
  }

  /// The checksum of a whole table, no matter how much of it was hashed before.
  uint64_t checksum(uint32_t kind) {
    hash_to(kind, tables_.views[kind].count);
    return progress_[kind].checksum.value();
  }

 private:
  // Half of a first-level cache. The rest is for the tables that the records refer to.
  static constexpr uint64_t kBlockBytes = 16 << 10;

  struct Progress {
    Checksum checksum;
    uint64_t records = 0;
  };

  void hash_to(uint32_t kind, uint64_t end) {
    const TableView& table = tables_.views[kind];
    Progress& progress = progress_[kind];
    if (end <= progress.records) return;
    progress.checksum.add({table.first + progress.records * table.stride, (end - progress.records) * table.stride});
    progress.records = end;
  }

  const TableViews& tables_;
  std::array<Progress, kKnownTableKinds> progress_;
};

/// Stores one entry of the table of contents in `views` if its kind is known. The entry's bytes lie within the file.
Result<void> take_table(const TocEntry& entry, uint32_t index, std::span<const std::byte> file, TableViews& views) {
  const uint32_t kind = static_cast<uint32_t>(entry.kind);
  if (kind == 0) return fail(ErrorCode::kRange, "table ", index, ": kind 0");
  if (is_known(kind)) {
    const KnownTable& table = kKnownTables[kind];
    TableView& view = views.views[kind];
    if (view.first) return fail(ErrorCode::kFormat, "table ", index, ": a second ", table.name, " table");
    // Only a newer minor version has longer records, and strings are bytes in every version.
    const bool may_be_longer = views.newer_minor && entry.kind != TableKind::kStrings;
    if (entry.record_bytes < table.record_bytes || (entry.record_bytes > table.record_bytes && !may_be_longer)) {
      return fail(ErrorCode::kRange, table.name, " table: records of ", entry.record_bytes, " bytes, expected ",
                  table.record_bytes);
    }
    if (entry.record_bytes % table.alignment != 0) {
      return fail(ErrorCode::kRange, table.name, " table: records of ", entry.record_bytes,
                  " bytes, expected a multiple of ", table.alignment);
    }
    if (entry.record_count >= kNone) {
      return fail(ErrorCode::kRange, table.name, " table: ", entry.record_count, " records, expected less than ",
                  kNone);
    }
    view = {file.data() + entry.offset, entry.record_count, entry.record_bytes};
  }
  return {};
}

/// `index`: of the entry in the table of contents. `actual`: the checksum of the table's bytes.
Result<void> check_checksum(const TocEntry& entry, uint32_t index, uint64_t actual) {
  if (actual == entry.checksum) return {};
  const uint32_t kind = static_cast<uint32_t>(entry.kind);
  if (is_known(kind)) return fail(ErrorCode::kChecksum, kKnownTables[kind].name, " table: the checksum differs");
  return fail(ErrorCode::kChecksum, "table ", index, " of kind ", kind, ": the checksum differs");
}

TocEntry toc_entry(const FileHeader& header, std::span<const std::byte> file, uint32_t index) {
  return load<TocEntry>(file.data() + header.toc_offset + uint64_t{index} * sizeof(TocEntry));
}

enum class Checksums { kLater, kNow };

/// Checks that tables follow each other, each at the next multiple of kTableAlignment with zeros between, and that the
/// table of contents comes last and ends the file.
Result<void> take_tables(const FileHeader& header, std::span<const std::byte> file, Checksums checksums,
                         TableViews& views) {
  if (header.toc_offset % kTableAlignment != 0 || header.toc_offset < kPageAlignment ||
      !range_within(header.toc_offset, uint64_t{header.toc_count} * sizeof(TocEntry), file.size())) {
    return fail(ErrorCode::kRange, "table of contents: ", header.toc_count, " entries at byte ", header.toc_offset,
                ", but the file has ", file.size(), " bytes");
  }
  const uint64_t toc_bytes = uint64_t{header.toc_count} * sizeof(TocEntry);
  if (header.toc_offset + toc_bytes != file.size()) {
    return fail(ErrorCode::kTrailing, "table of contents: ends at byte ", header.toc_offset + toc_bytes,
                ", but the file has ", file.size(), " bytes");
  }
  if (checksum(file.subspan(header.toc_offset, toc_bytes)) != header.toc_checksum) {
    return fail(ErrorCode::kChecksum, "table of contents: the checksum differs");
  }
  views.tables_offset = header.toc_offset;
  uint64_t end = 0;
  for (uint32_t i = 0; i < header.toc_count; ++i) {
    const TocEntry entry = toc_entry(header, file, i);
    const auto bytes = checked_mul(entry.record_bytes, entry.record_count);
    if (!bytes || !range_within(entry.offset, *bytes, header.toc_offset)) {
      return fail(ErrorCode::kRange, "table ", i, ": ", entry.record_count, " records of ", entry.record_bytes,
                  " bytes at byte ", entry.offset, ", but the table of contents starts at byte ", header.toc_offset);
    }
    if (i == 0) {
      if (entry.offset % kTableAlignment != 0 || entry.offset < kPageAlignment) {
        return fail(ErrorCode::kRange, "table 0: at byte ", entry.offset, ", expected a multiple of ", kTableAlignment,
                    " from ", kPageAlignment, " on");
      }
      views.tables_offset = entry.offset;
    } else {
      if (entry.offset != align_up(end, kTableAlignment)) {
        return fail(ErrorCode::kRange, "table ", i, ": at byte ", entry.offset, ", expected ",
                    align_up(end, kTableAlignment));
      }
      SCREE_TRY(check_zero(file, end, entry.offset));
    }
    end = entry.offset + *bytes;
    SCREE_TRY(take_table(entry, i, file, views));
    if (checksums == Checksums::kNow) SCREE_TRY(check_checksum(entry, i, checksum(file.subspan(entry.offset, *bytes))));
  }
  if (header.toc_count > 0) {
    if (header.toc_offset != align_up(end, kTableAlignment)) {
      return fail(ErrorCode::kRange, "table of contents: at byte ", header.toc_offset, ", expected ",
                  align_up(end, kTableAlignment));
    }
    SCREE_TRY(check_zero(file, end, header.toc_offset));
  }
  return {};
}

/// Checks the offset, the records and the checksum of every table. The tables of a good file are read once.
Result<void> check_tables(const FileHeader& header, std::span<const std::byte> file, TableViews& views) {
  Result<void> checked = take_tables(header, file, Checksums::kLater, views);
  if (checked) {
    TableHashes hashes(views);
    checked = check_records(views, hashes);
    for (uint32_t i = 0; i < header.toc_count && checked; ++i) {
      const TocEntry entry = toc_entry(header, file, i);
      const uint32_t kind = static_cast<uint32_t>(entry.kind);
      checked = check_checksum(entry, i,
                               is_known(kind)
                                   ? hashes.checksum(kind)
                                   : checksum(file.subspan(entry.offset, entry.record_bytes * entry.record_count)));
    }
  }
  if (checked) return {};
  // The checks failed. Repeat them in the order of the tables, checksums before records: after a bit flip the wrong
  // checksum is the useful error, not the rule that the record happens to break.
  TableViews again;
  again.newer_minor = views.newer_minor;
  again.is_second = views.is_second;
  SCREE_TRY(take_tables(header, file, Checksums::kNow, again));
  return checked;
}

/// Decompresses exactly one zstd frame of out.size() raw bytes.
Result<void> decompress(uint32_t page, std::span<std::byte> out, std::span<const std::byte> stored) {
  struct Free {
    void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
  };
  // A context takes 160 KB. It is kept per thread, so that loading many pages does not map and fault it in for each.
  thread_local std::unique_ptr<ZSTD_DCtx, Free> context;
  if (!context) context.reset(ZSTD_createDCtx());
  if (!context) return fail(ErrorCode::kMemory, "page ", page, ": no memory to decompress");
  const size_t written = ZSTD_decompressDCtx(context.get(), out.data(), out.size(), stored.data(), stored.size());
  if (ZSTD_isError(written)) return fail(ErrorCode::kFormat, "page ", page, ": zstd: ", ZSTD_getErrorName(written));
  if (written != out.size()) {
    return fail(ErrorCode::kTruncated, "page ", page, ": ", written, " bytes after decompression, expected ",
                out.size());
  }
  return {};
}

/// Checks a compressed page before any memory is taken. It must be one frame of exactly the stored bytes, with
/// raw_bytes as its content size; the content of a split page may be kMaxSplitRatio times as large. Returns the content
/// size.
Result<uint64_t> check_frame(uint32_t page, const PageRecord& record, std::span<const std::byte> stored) {
  const uint64_t raw_bytes = record.raw_bytes;
  if (stored.size() < sizeof kZstdMagic || load<uint32_t>(stored.data()) != kZstdMagic) {
    return fail(ErrorCode::kFormat, "page ", page, ": not a zstd frame");
  }
  const unsigned long long content = ZSTD_getFrameContentSize(stored.data(), stored.size());
  if (content == ZSTD_CONTENTSIZE_ERROR) return fail(ErrorCode::kFormat, "page ", page, ": a bad zstd frame header");
  if (content == ZSTD_CONTENTSIZE_UNKNOWN) {
    return fail(ErrorCode::kFormat, "page ", page, ": the zstd frame does not give its size");
  }
  if (record.codec == PageCodec::kSplit ? content > kMaxSplitRatio * raw_bytes : content != raw_bytes) {
    return fail(ErrorCode::kFormat, "page ", page, ": the zstd frame holds ", content, " bytes, expected ",
                record.codec == PageCodec::kSplit ? "at most " : "",
                record.codec == PageCodec::kSplit ? kMaxSplitRatio * raw_bytes : raw_bytes);
  }
  const size_t frame = ZSTD_findFrameCompressedSize(stored.data(), stored.size());
  if (ZSTD_isError(frame)) return fail(ErrorCode::kTruncated, "page ", page, ": zstd: ", ZSTD_getErrorName(frame));
  if (frame != stored.size()) {
    return fail(ErrorCode::kTrailing, "page ", page, ": the zstd frame takes ", frame, " of ", stored.size(), " bytes");
  }
  return uint64_t{content};
}

/// Unpacks a page whose frame was checked and has a content of `content` bytes.
Result<void> unpack_frame(uint32_t page, const PageRecord& record, uint64_t content, std::span<std::byte> raw,
                          std::span<const std::byte> stored) {
  if (record.codec != PageCodec::kSplit) return decompress(page, raw, stored);
  const std::unique_ptr<std::byte[]> memory(new (std::nothrow) std::byte[content]);
  if (!memory) return fail(ErrorCode::kMemory, "page ", page, ": no memory for ", content, " bytes");
  const std::span<std::byte> split(memory.get(), content);
  SCREE_TRY(decompress(page, split, stored));
  const Result<void> joined = join_page(split, raw);
  if (!joined) return fail(joined.error().code, "page ", page, ": ", joined.error().message.c_str());
  return {};
}

}  // namespace

Result<Container> Container::open(std::span<const std::byte> file) {
  assert(reinterpret_cast<uintptr_t>(file.data()) % kTableAlignment == 0 && "records are read in place");
  const auto header = SCREE_TRY(check_header(file));
  auto views = std::make_shared<Views>();
  views->is_second = header.version_major == kSecondMajor;
  views->newer_minor = header.version_minor > (views->is_second ? kSecondMinor : kVersionMinor);
  SCREE_TRY(check_tables(header, file, *views));
  SCREE_TRY(check_zero(file, sizeof(FileHeader), kPageAlignment));
  Container container;
  container.file_ = file;
  container.views_ = std::move(views);
  return container;
}

const FileHeader& Container::header() const {
  return *reinterpret_cast<const FileHeader*>(file_.data());
}
const TableView& Container::view(TableKind kind) const {
  return views_->view(kind);
}

std::string_view Container::string(uint32_t offset) const {
  const TableView& strings = view(TableKind::kStrings);
  assert(offset < strings.count);
  // The table's last byte is zero, so this stops inside the table.
  return reinterpret_cast<const char*>(strings.first) + offset;
}

bool Container::string_is(uint32_t offset, std::string_view text) const {
  const TableView& strings = view(TableKind::kStrings);
  if (text.size() >= strings.count - offset || text.find('\0') != std::string_view::npos) return false;
  const char* const found = reinterpret_cast<const char*>(strings.first) + offset;
  return std::memcmp(found, text.data(), text.size()) == 0 && found[text.size()] == 0;
}

std::span<const std::byte> Container::stored_page(uint32_t page) const {
  const PageRecord& record = pages()[page];
  return file_.subspan(record.offset, record.stored_bytes);
}

std::span<const std::byte> Container::padded_page(uint32_t page) const {
  const Table<PageRecord> table = pages();
  const uint64_t next = page + uint64_t{1};
  const uint64_t end = next < table.size() ? table[next].offset : views_->tables_offset;
  return file_.subspan(table[page].offset, end - table[page].offset);
}

Result<void> Container::check_page(uint32_t page, std::span<const std::byte> padded) const {
  const PageRecord& record = pages()[page];
  assert(padded.size() == padded_page(page).size());
  if (checksum(padded.first(record.stored_bytes)) != record.checksum) {
    return fail(ErrorCode::kChecksum, "page ", page, ": the checksum differs");
  }
  return check_zero(padded, record.stored_bytes, padded.size(), record.offset);
}

Result<void> Container::unpack_page(uint32_t page, std::span<const std::byte> stored, std::span<std::byte> raw) const {
  assert(raw.size() == pages()[page].raw_bytes);
  const PageRecord& record = pages()[page];
  const auto content = SCREE_TRY(check_frame(page, record, stored));
  return unpack_frame(page, record, content, raw, stored);
}

Result<uint64_t> Container::content_bytes(uint32_t page, std::span<const std::byte> stored) const {
  return check_frame(page, pages()[page], stored);
}

Result<void> Container::unpack_content(uint32_t page, std::span<const std::byte> stored,
                                       std::span<std::byte> content) const {
  return decompress(page, content, stored);
}

Result<std::span<const std::byte>> Container::load_page(uint32_t page, std::vector<std::byte>& scratch) const {
  const Table<PageRecord> table = pages();
  if (page >= table.size()) {
    return fail(ErrorCode::kRange, "page ", page, ", but the file has ", table.size(), " pages");
  }
  const PageRecord& record = table[page];
  SCREE_TRY(check_page(page, padded_page(page)));
  const std::span<const std::byte> stored = stored_page(page);
  if (record.codec == PageCodec::kRaw) return stored;

  const auto content = SCREE_TRY(check_frame(page, record, stored));
  try {
    // A growing vector may take twice the requested size; an empty one takes exactly that size.
    if (scratch.capacity() < record.raw_bytes) scratch = std::vector<std::byte>();
    scratch.resize(record.raw_bytes);
  } catch (const std::bad_alloc&) {
    return fail(ErrorCode::kMemory, "page ", page, ": no memory for ", record.raw_bytes, " bytes");
  } catch (const std::length_error&) {
    return fail(ErrorCode::kMemory, "page ", page, ": no memory for ", record.raw_bytes, " bytes");
  }
  SCREE_TRY(unpack_frame(page, record, content, scratch, stored));
  return std::span<const std::byte>(scratch);
}

}  // namespace scree::format
