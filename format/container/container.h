// Reading and writing .scree files (spec/container.md): header, table of contents, record tables, pages.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "format/container/part_file.h"
#include "format/container/part_log.h"
#include "format/geometry/cluster_page.h"
#include "format/layout.h"
#include "format/result.h"

namespace scree::format {

/// The records of one kind. Strided, because a newer minor version may have made the records longer.
template <class Record>
class Table {
 public:
  Table() = default;
  Table(const std::byte* first, uint64_t count, uint64_t stride) : first_(first), count_(count), stride_(stride) {}

  uint64_t size() const { return count_; }
  bool empty() const { return count_ == 0; }
  const Record& operator[](uint64_t index) const { return *reinterpret_cast<const Record*>(first_ + index * stride_); }

 private:
  const std::byte* first_ = nullptr;
  uint64_t count_ = 0;
  uint64_t stride_ = sizeof(Record);
};

/// A validated view of a .scree file's bytes. open() checks the header, the table of contents, every table's checksum
/// and every field of every record (indices into other tables, ranges, bit counts, prefix sums, finite numbers): what
/// the accessors return can be used without further checks. It touches no page and allocates nothing per record; 15 ns
/// a record where six tables have a million each. Page contents are checked by load_page and, stream by stream, by the
/// codecs: the records bound a code's width, not its value. Views stay valid as long as the bytes given to open(),
/// which nobody may change meanwhile.
class Container {
 public:
  /// `file`: the whole file, kTableAlignment-aligned in memory (a map is). Errors kFormat, kVersion, kTruncated,
  /// kTrailing, kChecksum, kRange, kReserved, each with the place in the file but without its name.
  static Result<Container> open(std::span<const std::byte> file);

  const FileHeader& header() const;
  Table<PageRecord> pages() const;
  Table<MeshRecord> meshes() const;
  Table<ChunkRecord> chunks() const;
  Table<GroupRecord> groups() const;
  Table<NodeRecord> nodes() const;
  Table<InstanceRecord> instances() const;
  Table<MatrixRecord> matrices() const;
  Table<NodeInstanceRecord> node_instances() const;
  Table<MaterialRecord> materials() const;
  Table<TextureRecord> textures() const;
  Table<ImageRecord> images() const;
  Table<MipLevelRecord> mip_levels() const;
  Table<CameraRecord> cameras() const;
  Table<SceneRecord> scenes() const;
  Table<uint32_t> scene_roots() const;
  Table<LeftOutRecord> left_out() const;
  Table<uint64_t> left_out_costs() const;  // one for each of left_out(), or none
  const SourceRecord& source() const;

  /// The zero-terminated UTF-8 string at `offset` of the string table.
  std::string_view string(uint32_t offset) const;

  /// The stored bytes of a page, unchecked.
  std::span<const std::byte> stored_page(uint32_t page) const;

  /// Checks a page's checksum and gives its raw bytes: a view of the file where the page is raw, else of `scratch`,
  /// which is resized. kGeometry raw bytes start 16-byte aligned. Takes raw_bytes, which a small file cannot make large
  /// (kMaxZstdRatio); while a split page is put together kMaxSplitRatio times as much more, and 1.1 MiB a thread.
  /// Reentrant with different scratch. Errors kChecksum, kReserved (padding after the page that is not zero), kFormat,
  /// kTruncated, kTrailing (not exactly one zstd frame of raw_bytes), kRange (no such page; a split page's streams),
  /// kMemory.
  Result<std::span<const std::byte>> load_page(uint32_t page, std::vector<std::byte>& scratch) const;

  // For those who keep pages in memory of their own, the steps of load_page; `page` is one the file has.

  /// The stored bytes of a page and the padding after them, up to the next page or the first table; unchecked.
  std::span<const std::byte> padded_page(uint32_t page) const;
  /// Checks `padded`, padded_page() or a copy of it. Errors kChecksum, kReserved as load_page.
  Result<void> check_page(uint32_t page, std::span<const std::byte> padded) const;
  /// Unpacks a compressed page from `stored`, its stored bytes, into `raw`, which has raw_bytes. Safe on any bytes;
  /// reentrant. Errors kFormat, kTruncated, kTrailing, kRange, kReserved, kMemory as load_page.
  Result<void> unpack_page(uint32_t page, std::span<const std::byte> stored, std::span<std::byte> raw) const;

 private:
  struct Views;  // the tables' places in the file
  std::span<const std::byte> file_;
  std::shared_ptr<const Views> views_;
};

/// The bytes of a page, compressed if that made them smaller, and their record without its place in the file.
struct SealedPage {
  PageRecord record{};
  std::vector<std::byte> stored;
};

/// Compresses (zstd_level 1 to 22; 0 keeps the bytes raw) and checksums a page, split where it has clusters (in the
/// order in which they lie) and can be. Raw as well where zstd does not make it
/// smaller, where a reader would refuse the size it unpacks to (kMaxZstdRatio), and where memory for compressing is
/// short. Pure but for the last: the same bytes for the same arguments.
SealedPage seal_page(PageKind kind, std::vector<std::byte> raw, int zstd_level,
                     std::span<const PageClusters> clusters = {});

/// All strings of a file; equal strings are kept once, the empty string is at offset 0.
class StringTable {
 public:
  StringTable();
  uint32_t add(std::string_view text);  // up to 4 GiB in all; a zero byte ends the text
  std::span<const char> bytes() const;

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

/// Everything of a file but its pages.
struct TableSet {
  std::vector<MeshRecord> meshes;
  std::vector<ChunkRecord> chunks;
  std::vector<GroupRecord> groups;
  std::vector<NodeRecord> nodes;
  std::vector<InstanceRecord> instances;
  std::vector<MatrixRecord> matrices;
  std::vector<NodeInstanceRecord> node_instances;
  std::vector<MaterialRecord> materials;
  std::vector<TextureRecord> textures;
  std::vector<ImageRecord> images;
  std::vector<MipLevelRecord> mip_levels;
  std::vector<CameraRecord> cameras;
  std::vector<SceneRecord> scenes;
  std::vector<uint32_t> scene_roots;
  std::vector<LeftOutRecord> left_out;
  std::vector<uint64_t> left_out_costs;
  SourceRecord source{};
  StringTable strings;
};

/// Writes `path`.part and renames it to `path` in finish(). A writer destroyed before that, or that met an error,
/// removes the .part; the earlier `path` is untouched until the rename. A .part that another writer is busy with is an
/// error, one that was left behind is overwritten, or gone on with by resume(). Errors name the file. Equal pages and
/// tables give equal bytes. Not thread-safe.
class ContainerWriter {
 public:
  /// Errors kFile.
  static Result<ContainerWriter> create(const std::string& path, Existing existing = Existing::kReplace);

  /// Goes on with a .part that was left behind by a writer which called keep_log() with this id: with as many pages as
  /// lie in it whole and good, from the first one on. `take`: for what log() noted, in that order. Errors kFile;
  /// kFormat: there is nothing to go on from, and why.
  static Result<ContainerWriter> resume(const std::string& path, const PartId& id, const PartLog::Take& take,
                                        Existing existing = Existing::kReplace);

  /// Keeps a log in the .part from now on, behind the first `most_bytes` bytes, for resume(); before the first page.
  /// Where it cannot be written, or the file grows past `most_bytes`, the writer goes on without.
  void keep_log(const PartId& id, uint64_t most_bytes);

  /// Notes an entry of the caller's in the log, if there is one; `kind`: 16 and up.
  void log(uint32_t kind, std::span<const std::byte> entry);

  /// The .part stays when the writer is destroyed before finish(), whatever the reason.
  void keep_part();

  uint32_t page_count() const;

  /// Forgets the pages from number `page_count` on, of which nothing stays in the file; before the first table.
  void drop_pages(uint32_t page_count);
  ContainerWriter(ContainerWriter&&) noexcept;
  ContainerWriter& operator=(ContainerWriter&&) noexcept;
  ~ContainerWriter();

  /// Appends a page and returns its number, which counts from 0 in the order of the calls. Errors kFile (disk full).
  Result<uint32_t> append(const SealedPage& page);

  using Read = std::function<Result<void>(uint64_t offset, std::span<std::byte> out)>;

  /// Appends a raw page of `bytes` bytes that nobody holds: `read` gives them in order, at most 1 MiB at a time. Errors
  /// kFile, and those of `read`, after which the writer can only be destroyed.
  Result<uint32_t> append_raw(PageKind kind, uint64_t bytes, const Read& read);

  /// Likewise a page that is sealed already, as another file has it: `read` gives its stored bytes. Its record's place is
  /// not looked at. Errors as append_raw; kChecksum: its bytes are not those that were sealed.
  Result<uint32_t> append_stored(const PageRecord& page, const Read& read);

  /// Appends records to a table that nobody holds: consecutive calls for one kind make one table. After the last page;
  /// the TableSet given to finish() has nothing of these kinds. Errors kFile, kRange (2^32 - 1 records or more).
  Result<void> append_records(TableKind kind, uint32_t record_bytes, std::span<const std::byte> records);

  /// Bytes written so far.
  uint64_t bytes() const;
  /// Of the pages of a kind, as stored.
  uint64_t page_bytes(PageKind kind) const;

  /// Writes the tables and the header, syncs and renames. Returns the file's size in bytes. Errors kFile; where the
  /// name was taken meanwhile (Existing::kRefuse), the .part stays: it is the whole file, and took long to make.
  Result<uint64_t> finish(const TableSet& tables);

 private:
  struct Impl;
  explicit ContainerWriter(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::format
