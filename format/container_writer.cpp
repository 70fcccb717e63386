#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zstd.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <memory>
#include <new>
#include <unordered_map>

#include "format/bytes.h"
#include "format/checksum.h"
#include "format/container.h"

namespace scree::format {

namespace {

/// One zstd frame that says its content's size, or nothing where it would not be smaller than `raw` or memory is short.
std::vector<std::byte> compress(std::span<const std::byte> raw, int level) try {
  struct Free {
    void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  };
  const std::unique_ptr<ZSTD_CCtx, Free> context(ZSTD_createCCtx());
  if (!context) return {};
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, std::min(level, ZSTD_maxCLevel()));
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_contentSizeFlag, 1);
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_checksumFlag, 0);  // the page has its own
  std::vector<std::byte> frame(raw.size() - 1);                   // what does not fit is not smaller
  const size_t bytes = ZSTD_compress2(context.get(), frame.data(), frame.size(), raw.data(), raw.size());
  if (ZSTD_isError(bytes)) return {};
  return {frame.begin(), frame.begin() + static_cast<ptrdiff_t>(bytes)};
} catch (const std::bad_alloc&) {
  return {};
}

}  // namespace

SealedPage seal_page(PageKind kind, std::vector<std::byte> raw, int zstd_level) {
  SealedPage page;
  page.record.kind = kind;
  page.record.codec = PageCodec::kRaw;
  page.record.raw_bytes = raw.size();
  page.stored = std::move(raw);

  if (zstd_level > 0 && page.stored.size() > 1 && page.stored.size() <= kMaxZstdPageBytes) {
    std::vector<std::byte> compressed = compress(page.stored, zstd_level);
    // The last rule is the reader's (spec/container.md, pages): what unpacks to much must have been large itself.
    if (!compressed.empty() &&
        (page.stored.size() <= kPageTargetBytes || page.stored.size() / kMaxZstdRatio < compressed.size())) {
      page.stored = std::move(compressed);
      page.record.codec = PageCodec::kZstd;
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
  std::string part;  // empty once it is renamed or removed
  int file = -1;
  uint64_t end = kPageAlignment;  // of what is written; the header comes last
  std::vector<PageRecord> pages;
  std::vector<TocEntry> toc;  // of the tables that are written
  Checksum checksum;          // of the last of them, while it may grow

  Impl() = default;
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() { discard(); }

  /// Removes the .part (while the lock on it is held, so that it is ours) and closes it.
  void discard() {
    if (!part.empty()) ::unlink(part.c_str());
    part.clear();
    if (file >= 0) ::close(file);
    file = -1;
  }

  /// The error of a system call on the .part, which is given up.
  Error fail(const char* call, int error) {
    Error result{ErrorCode::kFile, path + ".part: " + call + ": " + std::strerror(error)};
    discard();
    return result;
  }

  Error not_open() const { return {ErrorCode::kFile, path + ".part: is not open any more"}; }

  Result<void> open();
  Result<void> write(uint64_t offset, std::span<const std::byte> bytes);
  Result<void> append_records(TableKind kind, uint32_t record_bytes, std::span<const std::byte> records);
  Result<void> rename_into_place();
};

/// Opens, locks and empties the .part. A stale one (of a run that was killed) is taken over; one that a running writer
/// holds is not.
Result<void> ContainerWriter::Impl::open() {
  if (path.empty()) return Error{ErrorCode::kFile, "a file without a name cannot be written"};
  struct stat target;
  if (::stat(path.c_str(), &target) == 0 && !S_ISREG(target.st_mode)) {
    return Error{ErrorCode::kFile, path + (S_ISDIR(target.st_mode) ? ": is a folder" : ": is not a regular file")};
  }
  const std::string name = path + ".part";
  // Between opening and locking, another writer may have renamed the file that was opened into place, and it must not
  // be emptied then: the lock counts only while the name still means the locked file.
  for (int attempt = 0; attempt < 100; ++attempt) {
    const int opened = ::open(name.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
    if (opened < 0) return Error{ErrorCode::kFile, name + ": open: " + std::strerror(errno)};
    struct stat of_file;
    if (::fstat(opened, &of_file) != 0 || !S_ISREG(of_file.st_mode)) {
      ::close(opened);
      return Error{ErrorCode::kFile, name + ": is not a regular file"};
    }
    int locked;
    do {
      locked = ::flock(opened, LOCK_EX | LOCK_NB);
    } while (locked != 0 && errno == EINTR);
    // Some file systems have no locks: writing is still right there, only not guarded against a second writer.
    if (locked != 0 && errno == EWOULDBLOCK) {
      ::close(opened);
      return Error{ErrorCode::kFile, name + ": another program is writing it"};
    }
    struct stat of_name;
    if (::lstat(name.c_str(), &of_name) == 0 && of_name.st_dev == of_file.st_dev && of_name.st_ino == of_file.st_ino) {
      file = opened;
      part = name;
      if (::ftruncate(file, 0) != 0) return fail("truncate", errno);
      return {};
    }
    ::close(opened);
  }
  return Error{ErrorCode::kFile, name + ": other programs keep replacing it"};
}

Result<void> ContainerWriter::Impl::write(uint64_t offset, std::span<const std::byte> bytes) {
  if (file < 0) return not_open();
  while (!bytes.empty()) {
    const ssize_t written = ::pwrite(file, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (written < 0) {
      if (errno == EINTR) continue;
      return fail("write", errno);
    }
    if (written == 0) return fail("write", ENOSPC);
    offset += static_cast<uint64_t>(written);
    bytes = bytes.subspan(static_cast<size_t>(written));
  }
  return {};
}

/// Empty tables are left out. Padding is what the file has where nothing was written: zeros.
Result<void> ContainerWriter::Impl::append_records(TableKind kind, uint32_t record_bytes,
                                                   std::span<const std::byte> records) {
  if (records.empty()) return {};
  if (file < 0) return not_open();
  if (toc.empty() || toc.back().kind != kind) {
    assert(std::none_of(toc.begin(), toc.end(), [&](const TocEntry& entry) { return entry.kind == kind; }));
    end = align_up(end, kTableAlignment);
    toc.push_back({kind, record_bytes, 0, end, 0});
    checksum = {};
  }
  TocEntry& entry = toc.back();
  assert(entry.record_bytes == record_bytes && records.size() % record_bytes == 0);
  entry.record_count += records.size() / record_bytes;
  if (entry.record_count >= kNone) {
    discard();
    return Error{ErrorCode::kRange, path + ": " + std::to_string(entry.record_count) + " records in table " +
                                        std::to_string(static_cast<uint32_t>(kind)) + ", more than a file can have"};
  }
  if (auto written = write(end, records); !written) return written;
  end += records.size();
  checksum.add(records);
  entry.checksum = checksum.value();
  return {};
}

/// The data must be on the disk before the name is, and the name before the caller is told.
Result<void> ContainerWriter::Impl::rename_into_place() {
  int flushed;
  do {
    flushed = ::fsync(file);
  } while (flushed != 0 && errno == EINTR);
  if (flushed != 0) return fail("sync", errno);
  if (::rename(part.c_str(), path.c_str()) != 0) return fail("rename", errno);
  part.clear();
  discard();
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  const int opened = ::open(folder.empty() ? "." : folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (opened < 0) return {};  // a folder that may be written but not read: the file is there, the name may be late
  const int synced = ::fsync(opened);
  const int error = errno;
  ::close(opened);
  if (synced != 0 && error != EINVAL && error != ENOTSUP) {  // those: a file system that syncs no folders
    return Error{ErrorCode::kFile, path + ": sync of its folder: " + std::strerror(error)};
  }
  return {};
}

Result<ContainerWriter> ContainerWriter::create(const std::string& path) {
  auto impl = std::make_unique<Impl>();
  impl->path = path;
  if (auto opened = impl->open(); !opened) return opened.error();
  return ContainerWriter(std::move(impl));
}

ContainerWriter::ContainerWriter(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ContainerWriter::ContainerWriter(ContainerWriter&&) noexcept = default;
ContainerWriter& ContainerWriter::operator=(ContainerWriter&&) noexcept = default;
ContainerWriter::~ContainerWriter() = default;

uint64_t ContainerWriter::bytes() const {
  return impl_->end;
}

Result<uint32_t> ContainerWriter::append(const SealedPage& page) {
  assert(page.record.stored_bytes == page.stored.size() && impl_->toc.empty());
  PageRecord record = page.record;
  record.offset = align_up(impl_->end, kPageAlignment);
  if (auto written = impl_->write(record.offset, page.stored); !written) return written.error();
  impl_->end = record.offset + record.stored_bytes;
  impl_->pages.push_back(record);
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
  Checksum checksum;
  std::vector<std::byte> block(static_cast<size_t>(std::min(bytes, kBlockBytes)));
  for (uint64_t done = 0; done < bytes;) {
    const std::span<std::byte> part(block.data(), static_cast<size_t>(std::min(kBlockBytes, bytes - done)));
    if (auto got = read(done, part); !got) return got.error();
    checksum.add(part);
    if (auto written = impl_->write(record.offset + done, part); !written) return written.error();
    done += part.size();
  }
  record.checksum = checksum.value();
  impl_->end = record.offset + bytes;
  impl_->pages.push_back(record);
  return static_cast<uint32_t>(impl_->pages.size() - 1);
}

Result<void> ContainerWriter::append_records(TableKind kind, uint32_t record_bytes,
                                             std::span<const std::byte> records) {
  return impl_->append_records(kind, record_bytes, records);
}

Result<uint64_t> ContainerWriter::finish(const TableSet& tables) {
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
  table(TableKind::kCameras, tables.cameras);
  table(TableKind::kScenes, tables.scenes);
  table(TableKind::kSceneRoots, tables.scene_roots);
  table(TableKind::kStrings, tables.strings.bytes());
  table(TableKind::kSource, std::span<const SourceRecord>(&tables.source, 1));
  table(TableKind::kLeftOut, tables.left_out);
  if (!written) return written.error();

  const std::vector<TocEntry>& toc = impl_->toc;
  FileHeader header{};
  std::memcpy(header.magic, kMagic, sizeof kMagic);
  header.version_major = kVersionMajor;
  header.version_minor = kVersionMinor;
  header.header_bytes = sizeof header;
  header.toc_offset = align_up(impl_->end, kTableAlignment);
  header.toc_count = static_cast<uint32_t>(toc.size());
  const std::span<const std::byte> toc_bytes = std::as_bytes(std::span<const TocEntry>(toc));
  header.toc_checksum = checksum(toc_bytes);
  header.file_bytes = header.toc_offset + toc_bytes.size();
  header.checksum = checksum(std::as_bytes(std::span(&header, 1)).first(offsetof(FileHeader, checksum)));
  if (written = impl_->write(header.toc_offset, toc_bytes); !written) return written.error();
  if (written = impl_->write(0, std::as_bytes(std::span<const FileHeader>(&header, 1))); !written) {
    return written.error();
  }
  if (written = impl_->rename_into_place(); !written) return written.error();
  impl_->end = header.file_bytes;
  return header.file_bytes;
}

}  // namespace scree::format
