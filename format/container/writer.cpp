#include <fcntl.h>
#include <unistd.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <memory>
#include <new>
#include <optional>
#include <unordered_map>

#include "format/bytes.h"
#include "format/container/checksum.h"
#include "format/container/container.h"
#include "format/container/part_file.h"

namespace scree::format {

namespace {

// Entries of a PartLog:
constexpr uint32_t kPageEntry = 1;  // a PageRecord
constexpr uint32_t kDropEntry = 2;  // the number of pages that remain (u32)

/// A page of images is compressed only if that saves a 20th of its bytes. A raw page is read faster.
constexpr uint64_t kLeastImageSaving = 20;

/// One zstd frame with its content size in the header. Empty if it would take `limit` bytes or more, or memory is
/// short. `ends`: offsets in `content` where bytes of another kind begin; each kind gets blocks and codes of its own.
std::vector<std::byte> compress(std::span<const std::byte> content, std::span<const uint64_t> ends, uint64_t limit,
                                int level) try {
  struct Free {
    void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  };
  const std::unique_ptr<ZSTD_CCtx, Free> context(ZSTD_createCCtx());
  if (!context) return {};
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, std::min(level, ZSTD_maxCLevel()));
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_contentSizeFlag, 1);
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_checksumFlag, 0);  // the page has its own checksum
  const uint64_t room = limit - 1;
  const auto frame = std::make_unique_for_overwrite<std::byte[]>(room);
  if (ends.empty()) {
    const size_t bytes = ZSTD_compress2(context.get(), frame.get(), room, content.data(), content.size());
    if (ZSTD_isError(bytes)) return {};
    return {frame.get(), frame.get() + bytes};
  }
  ZSTD_CCtx_setPledgedSrcSize(context.get(), content.size());
  ZSTD_outBuffer out{frame.get(), room, 0};
  ZSTD_inBuffer in{content.data(), 0, 0};
  const auto feed = [&](uint64_t end, ZSTD_EndDirective directive) {
    in.size = end;
    return ZSTD_compressStream2(context.get(), &out, &in, directive) == 0;  // false on an error or when room runs out
  };
  for (const uint64_t end : ends)
    if (end != in.pos && end != content.size() && !feed(end, ZSTD_e_flush)) return {};
  if (!feed(content.size(), ZSTD_e_end)) return {};
  return {frame.get(), frame.get() + out.pos};
} catch (const std::bad_alloc&) {
  return {};
}

}  // namespace

SealedPage seal_page(PageKind kind, std::vector<std::byte> raw, int zstd_level,
                     std::span<const PageClusters> clusters) {
  SealedPage page;
  page.record.kind = kind;
  page.record.codec = PageCodec::kRaw;
  page.record.raw_bytes = raw.size();
  page.stored = std::move(raw);

  if (zstd_level > 0 && page.stored.size() > 1 && page.stored.size() <= kMaxZstdPageBytes) {
    const SplitPage split = clusters.empty() ? SplitPage{} : split_page(page.stored, clusters);
    const bool is_split = !split.bytes.empty();
    const uint64_t least_saving = kind == PageKind::kImage ? page.stored.size() / kLeastImageSaving : 0;
    std::vector<std::byte> compressed = compress(is_split ? split.bytes : page.stored, split.stream_ends,
                                                 page.stored.size() - least_saving, zstd_level);
    // The last condition is the reader's limit (spec/container.md, pages): a page with many raw bytes must have many
    // stored bytes.
    if (!compressed.empty() &&
        (page.stored.size() <= kPageTargetBytes || page.stored.size() / kMaxZstdRatio < compressed.size())) {
      page.stored = std::move(compressed);
      page.record.codec = is_split ? PageCodec::kSplit : PageCodec::kZstd;
    }
  }
  page.record.stored_bytes = page.stored.size();
  page.record.checksum = checksum(page.stored);
  return page;
}

struct StringTable::Impl {
  std::vector<char> bytes{'\0'};
  std::unordered_map<std::string, uint32_t> offsets{{"", 0}};
};

StringTable::StringTable() : impl_(std::make_shared<Impl>()) {}

uint32_t StringTable::add(std::string_view text) {
  text = text.substr(0, text.find('\0'));
  const auto [found, added] = impl_->offsets.try_emplace(std::string(text), static_cast<uint32_t>(impl_->bytes.size()));
  if (added) {
    impl_->bytes.insert(impl_->bytes.end(), text.begin(), text.end());
    impl_->bytes.push_back('\0');
  }
  return found->second;
}

std::span<const char> StringTable::bytes() const {
  return impl_->bytes;
}

struct ContainerWriter::Impl {
  std::string path;
  PartFile file;
  std::optional<PartLog> log;
  bool is_longer = false;         // bytes lie behind the file's end, a log or dropped pages, and are cut off at the end
  bool overwrites = false;        // the .part had other pages before, so that unwritten bytes are not zero
  uint64_t end = kPageAlignment;  // of the written bytes; the header comes last
  std::vector<PageRecord> pages;
  std::vector<TocEntry> toc;  // of the tables written so far
  Checksum checksum;          // of the last table, while it may grow

  /// The end of the last page, or where the first page may begin.
  uint64_t end_of_pages() const {
    return pages.empty() ? kPageAlignment : pages.back().offset + pages.back().stored_bytes;
  }

  Result<void> write(uint64_t offset, std::span<const std::byte> bytes);
  Result<void> pad(uint64_t from, uint64_t to);
  void add_page(const PageRecord& record);
  void note(uint32_t kind, std::span<const std::byte> entry);
  Result<bool> is_whole(const PageRecord& record, uint64_t earlier_end);
  Result<void> append_records(TableKind kind, uint32_t record_bytes, std::span<const std::byte> records);
  Result<void> rename_into_place(const FileHeader& header, const Check& check);
};

/// Gives up the .part at once if a write fails, to free its disk space.
Result<void> ContainerWriter::Impl::write(uint64_t offset, std::span<const std::byte> bytes) {
  if (log && offset + bytes.size() > log->offset()) log.reset();
  Result<void> written = file.write_at(offset, bytes);
  if (!written) file.discard();
  return written;
}

/// Writes zeros between two pages or tables, where old bytes may lie.
Result<void> ContainerWriter::Impl::pad(uint64_t from, uint64_t to) {
  static constexpr std::array<std::byte, kPageAlignment> kZeros{};
  if (!overwrites || from == to) return {};
  return write(from, std::span(kZeros).first(to - from));
}

void ContainerWriter::Impl::add_page(const PageRecord& record) {
  end = record.offset + record.stored_bytes;
  pages.push_back(record);
  note(kPageEntry, std::as_bytes(std::span(&record, 1)));
}

/// A failed log write only disables --resume; a full disk also fails the next data write, which is reported.
void ContainerWriter::Impl::note(uint32_t kind, std::span<const std::byte> entry) {
  if (log && !log->add(file, kind, entry)) log.reset();
}

/// Returns whether a page from the log directly follows the page before it, and its stored bytes match its checksum.
Result<bool> ContainerWriter::Impl::is_whole(const PageRecord& record, uint64_t earlier_end) {
  constexpr uint64_t kBlockBytes = 1 << 20;
  if (record.offset != align_up(earlier_end, kPageAlignment) ||
      !range_within(record.offset, record.stored_bytes, log->offset()))
    return false;
  Checksum sum;
  std::vector<std::byte> block(static_cast<size_t>(std::min(record.stored_bytes, kBlockBytes)));
  for (uint64_t done = 0; done < record.stored_bytes;) {
    const std::span<std::byte> part(block.data(),
                                    static_cast<size_t>(std::min(kBlockBytes, record.stored_bytes - done)));
    SCREE_TRY(file.read_at(record.offset + done, part));
    sum.add(part);
    done += part.size();
  }
  return sum.value() == record.checksum;
}

/// Empty tables are left out. Padding needs no writing: unwritten bytes of the file are zero.
Result<void> ContainerWriter::Impl::append_records(TableKind kind, uint32_t record_bytes,
                                                   std::span<const std::byte> records) {
  if (records.empty()) return {};
  if (!file.is_open()) return write(end, records);  // returns the error
  if (toc.empty() || toc.back().kind != kind) {
    assert(std::none_of(toc.begin(), toc.end(), [&](const TocEntry& entry) { return entry.kind == kind; }));
    const uint64_t begin = align_up(end, kTableAlignment);
    SCREE_TRY(pad(end, begin));
    end = begin;
    toc.push_back({kind, record_bytes, 0, end, 0});
    checksum = {};
  }
  TocEntry& entry = toc.back();
  assert(entry.record_bytes == record_bytes && records.size() % record_bytes == 0);
  entry.record_count += records.size() / record_bytes;
  if (entry.record_count >= kNone) {
    file.discard();
    return Error{ErrorCode::kRange, path + ": " + std::to_string(entry.record_count) + " records in table " +
                                        std::to_string(static_cast<uint32_t>(kind)) + ", more than a file can have"};
  }
  SCREE_TRY(write(end, records));
  end += records.size();
  checksum.add(records);
  entry.checksum = checksum.value();
  return {};
}

/// The data must reach the disk before the name, and the name before the caller continues. This can take long, and a
/// killed process must be able to resume, so the header, which replaces the log's mark, is written last.
Result<void> ContainerWriter::Impl::rename_into_place(const FileHeader& header, const Check& check) {
  Result<void> done = file.sync();
  if (done) done = file.write_at(0, std::as_bytes(std::span<const FileHeader>(&header, 1)));
  if (done && is_longer) done = file.resize(header.file_bytes);
  if (done && check) done = check(file.part_path());
  if (done) done = file.commit();  // which syncs again
  if (!done && file.is_refused()) {
    file.keep();
    done = Error{done.error().code, done.error().message + "; the new file is " + file.part_path()};
  }
  if (!done) {
    file.discard();
    return done;
  }
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  const int opened = ::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  // A folder may be writable but not readable. The file exists; its name may reach the disk later.
  if (opened < 0) return {};
  const int synced = ::fsync(opened);
  const int error = errno;
  ::close(opened);
  if (synced != 0 && error != EINVAL && error != ENOTSUP) {  // the file system syncs no folders
    return Error{ErrorCode::kFile, path + ": sync of its folder: " + std::strerror(error)};
  }
  return {};
}

Result<ContainerWriter> ContainerWriter::create(const std::string& path, Existing existing) {
  auto part = SCREE_TRY(PartFile::create(path, PartFile::Content::kEmpty, existing));
  auto impl = std::make_unique<Impl>();
  impl->path = path;
  impl->file = std::move(part);
  return ContainerWriter(std::move(impl));
}

Result<ContainerWriter> ContainerWriter::resume(const std::string& path, const PartId& id, const PartLog::Take& take,
                                                Existing existing) {
  std::error_code ignored;
  if (!std::filesystem::exists(PartFile::target_of(path) + ".part", ignored))
    return Error{ErrorCode::kFormat, "there is none"};
  auto part = SCREE_TRY(PartFile::create(path, PartFile::Content::kAsItIs, existing));
  part.keep();
  auto impl = std::make_unique<Impl>();
  impl->path = path;
  impl->file = std::move(part);
  impl->overwrites = impl->is_longer = true;
  bool fits = true;  // so far
  const auto take_page = [&](const PageRecord& record) {
    // The log has a page twice if resume() found it damaged and it was written again.
    while (!impl->pages.empty() && impl->pages.back().offset >= record.offset) impl->pages.pop_back();
    fits = record.offset == align_up(impl->end_of_pages(), kPageAlignment);
    if (fits) impl->pages.push_back(record);
  };
  auto log = PartLog::read(impl->file, id, [&](uint32_t kind, std::span<const std::byte> entry) {
    PageRecord record;
    uint32_t left = 0;
    if (kind == kPageEntry && entry.size() == sizeof record) {
      std::memcpy(&record, entry.data(), sizeof record);
      if (fits) take_page(record);
    } else if (kind == kDropEntry && entry.size() == sizeof left) {
      std::memcpy(&left, entry.data(), sizeof left);
      if (left < impl->pages.size()) impl->pages.resize(left);
    } else if (kind != kPageEntry && kind != kDropEntry) {
      take(kind, entry);
    }
  });
  if (!log) return log.error();
  impl->log = *log;
  for (size_t i = 0; i < impl->pages.size(); ++i) {
    const auto is_whole = SCREE_TRY(impl->is_whole(impl->pages[i], impl->end));
    if (!is_whole) {
      impl->pages.resize(i);
      break;
    }
    SCREE_TRY(impl->pad(impl->end, impl->pages[i].offset));
    impl->end = impl->pages[i].offset + impl->pages[i].stored_bytes;
  }
  // A page's checksum covers neither the padding nor the bytes behind the header.
  SCREE_TRY(impl->pad(sizeof(FileHeader), kPageAlignment));
  return ContainerWriter(std::move(impl));
}

void ContainerWriter::keep_log(const PartId& id, uint64_t most_bytes) {
  assert(impl_->pages.empty() && impl_->toc.empty());
  impl_->is_longer = true;
  auto log = PartLog::start(impl_->file, id, align_up(most_bytes, kPageAlignment));
  if (log) impl_->log = *log;
}

void ContainerWriter::log(uint32_t kind, std::span<const std::byte> entry) {
  assert(kind != kPageEntry && kind != kDropEntry);
  impl_->note(kind, entry);
}

void ContainerWriter::keep_part() {
  impl_->file.keep();
}

uint32_t ContainerWriter::page_count() const {
  return static_cast<uint32_t>(impl_->pages.size());
}

void ContainerWriter::drop_pages(uint32_t page_count) {
  assert(page_count <= impl_->pages.size() && impl_->toc.empty());
  if (page_count == impl_->pages.size()) return;
  // The dropped pages may still be intact in the .part, so the log has to note that they are dropped.
  impl_->note(kDropEntry, std::as_bytes(std::span(&page_count, 1)));
  impl_->overwrites = impl_->is_longer = true;
  impl_->pages.resize(page_count);
  impl_->end = impl_->end_of_pages();
}

ContainerWriter::ContainerWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ContainerWriter::ContainerWriter(ContainerWriter&&) noexcept = default;
ContainerWriter& ContainerWriter::operator=(ContainerWriter&&) noexcept = default;
ContainerWriter::~ContainerWriter() = default;

uint64_t ContainerWriter::bytes() const {
  return impl_->end;
}

uint64_t ContainerWriter::page_bytes(PageKind kind) const {
  uint64_t bytes = 0;
  for (const PageRecord& page : impl_->pages) bytes += page.kind == kind ? page.stored_bytes : 0;
  return bytes;
}

Result<uint32_t> ContainerWriter::append(const SealedPage& page) {
  assert(page.record.stored_bytes == page.stored.size() && impl_->toc.empty());
  PageRecord record = page.record;
  record.offset = align_up(impl_->end, kPageAlignment);
  SCREE_TRY(impl_->pad(impl_->end, record.offset));
  SCREE_TRY(impl_->write(record.offset, page.stored));
  impl_->add_page(record);
  return static_cast<uint32_t>(impl_->pages.size() - 1);
}

Result<uint32_t> ContainerWriter::append_raw(PageKind kind, uint64_t bytes, const Read& read) {
  constexpr uint64_t kBlockBytes = 1 << 20;
  assert(impl_->toc.empty());
  PageRecord record{};
  record.kind = kind;
  record.codec = PageCodec::kRaw;
  record.offset = align_up(impl_->end, kPageAlignment);
  record.stored_bytes = record.raw_bytes = bytes;
  SCREE_TRY(impl_->pad(impl_->end, record.offset));
  Checksum checksum;
  std::vector<std::byte> block(static_cast<size_t>(std::min(bytes, kBlockBytes)));
  for (uint64_t done = 0; done < bytes;) {
    const std::span<std::byte> part(block.data(), static_cast<size_t>(std::min(kBlockBytes, bytes - done)));
    SCREE_TRY(read(done, part));
    checksum.add(part);
    SCREE_TRY(impl_->write(record.offset + done, part));
    done += part.size();
  }
  record.checksum = checksum.value();
  impl_->add_page(record);
  return static_cast<uint32_t>(impl_->pages.size() - 1);
}

Result<void> ContainerWriter::append_records(TableKind kind, uint32_t record_bytes,
                                             std::span<const std::byte> records) {
  return impl_->append_records(kind, record_bytes, records);
}

Result<uint64_t> ContainerWriter::finish(const TableSet& tables, const Check& check) {
  Result<void> written;
  const auto table = [&](TableKind kind, const auto& records) {
    if (written) written = impl_->append_records(kind, sizeof(records[0]), std::as_bytes(std::span(records)));
  };
  table(TableKind::kPages, impl_->pages);
  table(TableKind::kMeshes, tables.meshes);
  table(TableKind::kChunks, tables.chunks);
  table(TableKind::kGroups, tables.groups);
  table(TableKind::kNodes, tables.nodes);
  table(TableKind::kInstances, tables.instances);
  table(TableKind::kMatrices, tables.matrices);
  table(TableKind::kNodeInstances, tables.node_instances);
  table(TableKind::kMaterials, tables.materials);
  table(TableKind::kTextures, tables.textures);
  table(TableKind::kImages, tables.images);
  table(TableKind::kMipLevels, tables.mip_levels);
  table(TableKind::kCameras, tables.cameras);
  table(TableKind::kScenes, tables.scenes);
  table(TableKind::kSceneRoots, tables.scene_roots);
  table(TableKind::kStrings, tables.strings.bytes());
  table(TableKind::kSource, std::span<const SourceRecord>(&tables.source, 1));
  table(TableKind::kLeftOut, tables.left_out);
  table(TableKind::kLeftOutCosts, tables.left_out_costs);
  table(TableKind::kSurfaces, tables.surfaces);
  table(TableKind::kLights, tables.lights);
  table(TableKind::kMasks, tables.masks);
  if (!written) return written.error();

  const std::vector<TocEntry>& toc = impl_->toc;
  FileHeader header{};
  std::memcpy(header.magic, kMagic, sizeof kMagic);
  const bool is_second =
      std::any_of(tables.meshes.begin(), tables.meshes.end(),
                  [](const MeshRecord& mesh) { return (mesh.attributes & kSecondAttributes) != 0; }) ||
      std::any_of(tables.surfaces.begin(), tables.surfaces.end(),
                  [](const SurfaceRecord& surface) { return surface.second_uv != 0; }) ||
      std::any_of(impl_->pages.begin(), impl_->pages.end(),
                  [](const PageRecord& page) { return page.codec == PageCodec::kSplit; });
  const bool is_older = tables.surfaces.empty() && tables.lights.empty() && tables.masks.empty();
  header.version_major = is_second ? kSecondMajor : kVersionMajor;
  // Version 1.1 added surfaces, lights and masks.
  header.version_minor = is_second ? kSecondMinor : is_older ? 0 : kVersionMinor;
  header.header_bytes = sizeof header;
  header.toc_offset = align_up(impl_->end, kTableAlignment);
  header.toc_count = static_cast<uint32_t>(toc.size());
  const std::span<const std::byte> toc_bytes = std::as_bytes(std::span<const TocEntry>(toc));
  header.toc_checksum = checksum(toc_bytes);
  header.file_bytes = header.toc_offset + toc_bytes.size();
  header.checksum = checksum(std::as_bytes(std::span(&header, 1)).first(offsetof(FileHeader, checksum)));
  SCREE_TRY(impl_->pad(impl_->end, header.toc_offset));
  SCREE_TRY(impl_->write(header.toc_offset, toc_bytes));
  SCREE_TRY(impl_->rename_into_place(header, check));
  impl_->end = header.file_bytes;
  return header.file_bytes;
}

}  // namespace scree::format
