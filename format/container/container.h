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

/// Where the records of one kind lie. Strided, because a newer minor version may have made the records longer.
struct TableView {
  const std::byte* first = nullptr;
  uint64_t count = 0;
  uint64_t stride = 1;
};

/// The records of one kind.
template <class Record>
class Table {
 public:
  Table() = default;
  explicit Table(const TableView& view) : view_(view) {}

  uint64_t size() const { return view_.count; }
  bool empty() const { return view_.count == 0; }
  const Record& operator[](uint64_t index) const {
    return *reinterpret_cast<const Record*>(view_.first + index * view_.stride);
  }

 private:
  TableView view_;
};

/// A validated view of a .scree file's bytes. open() checks the header, the table of contents, every table's checksum
/// and every field of every record (indices into other tables, ranges, bit counts, prefix sums, finite numbers).
/// Therefore results of the accessors can be used without further checks. open() reads no page and allocates nothing
/// per record; it takes 15 ns per record where six tables have a million records each. Page contents are checked by
/// load_page and, stream by stream, by the codecs: the records bound a code's width, not its value. Views stay valid as
/// long as the bytes given to open(), which must not change meanwhile.
class Container {
 public:
  /// `file`: the whole file, kTableAlignment-aligned in memory, as a memory map is. Errors kFormat, kVersion,
  /// kTruncated, kTrailing, kChecksum, kRange, kReserved; messages give the place in the file, but not its name.
  static Result<Container> open(std::span<const std::byte> file);

  const FileHeader& header() const;
  Table<PageRecord> pages() const { return table<PageRecord>(TableKind::kPages); }
  Table<MeshRecord> meshes() const { return table<MeshRecord>(TableKind::kMeshes); }
  Table<ChunkRecord> chunks() const { return table<ChunkRecord>(TableKind::kChunks); }
  Table<GroupRecord> groups() const { return table<GroupRecord>(TableKind::kGroups); }
  Table<NodeRecord> nodes() const { return table<NodeRecord>(TableKind::kNodes); }
  Table<InstanceRecord> instances() const { return table<InstanceRecord>(TableKind::kInstances); }
  Table<MatrixRecord> matrices() const { return table<MatrixRecord>(TableKind::kMatrices); }
  Table<NodeInstanceRecord> node_instances() const { return table<NodeInstanceRecord>(TableKind::kNodeInstances); }
  Table<MaterialRecord> materials() const { return table<MaterialRecord>(TableKind::kMaterials); }
  Table<TextureRecord> textures() const { return table<TextureRecord>(TableKind::kTextures); }
  Table<ImageRecord> images() const { return table<ImageRecord>(TableKind::kImages); }
  Table<MipLevelRecord> mip_levels() const { return table<MipLevelRecord>(TableKind::kMipLevels); }
  Table<SurfaceRecord> surfaces() const { return table<SurfaceRecord>(TableKind::kSurfaces); }
  Table<LightRecord> lights() const { return table<LightRecord>(TableKind::kLights); }
  Table<MaskRecord> masks() const { return table<MaskRecord>(TableKind::kMasks); }
  Table<CameraRecord> cameras() const { return table<CameraRecord>(TableKind::kCameras); }
  Table<SceneRecord> scenes() const { return table<SceneRecord>(TableKind::kScenes); }
  Table<uint32_t> scene_roots() const { return table<uint32_t>(TableKind::kSceneRoots); }
  Table<LeftOutRecord> left_out() const { return table<LeftOutRecord>(TableKind::kLeftOut); }
  /// One per entry of left_out(), or none.
  Table<uint64_t> left_out_costs() const { return table<uint64_t>(TableKind::kLeftOutCosts); }
  const SourceRecord& source() const { return table<SourceRecord>(TableKind::kSource)[0]; }

  /// The zero-terminated UTF-8 string at `offset` of the string table.
  std::string_view string(uint32_t offset) const;
  /// Whether the string at `offset` equals `text`. Reads no more of it than `text` has, because any number of records
  /// may have the same long name.
  bool string_is(uint32_t offset, std::string_view text) const;

  /// The stored bytes of a page, unchecked.
  std::span<const std::byte> stored_page(uint32_t page) const;

  /// Checks a page's checksum and returns its raw bytes: a view of the file if the page is raw, else of `scratch`,
  /// which is resized. Raw bytes of kGeometry start 16-byte aligned. Memory: raw_bytes, which a small file cannot make
  /// large (kMaxZstdRatio). While a split page is put together, kMaxSplitRatio times as much more, and 2.1 MiB per
  /// thread. Reentrant with different scratch. Errors kChecksum, kReserved (padding after the page that is not zero),
  /// kFormat, kTruncated, kTrailing (not exactly one zstd frame of raw_bytes), kRange (no such page; a split page's
  /// streams), kMemory.
  Result<std::span<const std::byte>> load_page(uint32_t page, std::vector<std::byte>& scratch) const;

  // The steps of load_page, for callers that keep pages in their own memory. `page` must be a page of the file.

  /// The stored bytes of a page and the padding after them, up to the next page or the first table; unchecked.
  std::span<const std::byte> padded_page(uint32_t page) const;
  /// Checks `padded`, which is padded_page() or a copy of it. Errors kChecksum, kReserved as load_page.
  Result<void> check_page(uint32_t page, std::span<const std::byte> padded) const;
  /// Unpacks a compressed page. `stored`: its stored bytes. `raw`: raw_bytes bytes for the result. Safe on any bytes;
  /// reentrant. Errors kFormat, kTruncated, kTrailing, kRange, kReserved, kMemory as load_page.
  Result<void> unpack_page(uint32_t page, std::span<const std::byte> stored, std::span<std::byte> raw) const;
  /// The same in two steps, for callers that join split pages themselves: bytes of a compressed page's frame, and the
  /// frame's content, exactly as many bytes.
  Result<uint64_t> content_bytes(uint32_t page, std::span<const std::byte> stored) const;
  Result<void> unpack_content(uint32_t page, std::span<const std::byte> stored, std::span<std::byte> content) const;

 private:
  struct Views;  // of all tables
  const TableView& view(TableKind kind) const;
  template <class Record>
  Table<Record> table(TableKind kind) const {
    return Table<Record>(view(kind));
  }

  std::span<const std::byte> file_;
  std::shared_ptr<const Views> views_;
};

/// The bytes of a page, compressed if that made them smaller, and the page's record without its offset in the file.
struct SealedPage {
  PageRecord record{};
  std::vector<std::byte> stored;
};

/// Compresses (zstd_level 1 to 22; 0 keeps the bytes raw) and checksums a page. `clusters`: the page's clusters in the
/// order in which they lie; a page with clusters is split if that is possible. The page stays raw if zstd does not make
/// it smaller (a page of images: by more than a twentieth), if a reader would refuse its size (kMaxZstdRatio), or if
/// memory is short. Equal arguments give equal bytes, except if memory is short.
SealedPage seal_page(PageKind kind, std::vector<std::byte> raw, int zstd_level,
                     std::span<const PageClusters> clusters = {});

/// All strings of a file. Equal strings are stored once; the empty string is at offset 0.
class StringTable {
 public:
  StringTable();
  uint32_t add(std::string_view text);  // up to 4 GiB in all; a zero byte ends the text
  std::span<const char> bytes() const;

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

/// All tables of a file. Pages are not part of it.
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
  std::vector<SurfaceRecord> surfaces;
  std::vector<LightRecord> lights;
  std::vector<MaskRecord> masks;
  std::vector<CameraRecord> cameras;
  std::vector<SceneRecord> scenes;
  std::vector<uint32_t> scene_roots;
  std::vector<LeftOutRecord> left_out;
  std::vector<uint64_t> left_out_costs;
  SourceRecord source{};
  StringTable strings;
};

/// Writes `path`.part and renames it to `path` in finish(). A writer that is destroyed before that, or had an error,
/// removes the .part; an earlier `path` is untouched until the rename. A .part in use by another writer is an error.
/// One that was left behind is overwritten, or continued by resume(). Errors name the file. Equal pages and tables give
/// equal bytes. Not thread-safe.
class ContainerWriter {
 public:
  /// Errors kFile.
  static Result<ContainerWriter> create(const std::string& path, Existing existing = Existing::kReplace);

  /// Continues a .part that a writer left behind after keep_log() with this id. The new writer keeps the pages of the
  /// .part up to the first damaged one. `take` is called for each entry that log() wrote, in the same order. Errors
  /// kFile; kFormat: nothing can be continued, with the reason.
  static Result<ContainerWriter> resume(const std::string& path, const PartId& id, const PartLog::Take& take,
                                        Existing existing = Existing::kReplace);

  /// Starts a log for resume(), at byte `most_bytes` of the .part. Called before the first page. If the log cannot be
  /// written, or the file grows past `most_bytes`, the writer continues without a log.
  void keep_log(const PartId& id, uint64_t most_bytes);

  /// Appends an entry of the caller's to the log, if there is one; `kind`: 16 and up.
  void log(uint32_t kind, std::span<const std::byte> entry);

  /// Keeps the .part if the writer is destroyed before finish().
  void keep_part();

  uint32_t page_count() const;

  /// Drops the pages from number `page_count` on and removes them from the file. Called before the first table.
  void drop_pages(uint32_t page_count);
  ContainerWriter(ContainerWriter&&) noexcept;
  ContainerWriter& operator=(ContainerWriter&&) noexcept;
  ~ContainerWriter();

  /// Appends a page and returns its number, which counts from 0 in the order of the calls. Errors kFile (disk full).
  Result<uint32_t> append(const SealedPage& page);

  /// Fills `out` with the page's bytes from `offset` on.
  using Read = std::function<Result<void>(uint64_t offset, std::span<std::byte> out)>;

  /// Appends a raw page of `bytes` bytes without holding it in memory: `read` fills at most 1 MiB at a time, in order.
  /// Errors kFile, and errors of `read`, after which the writer can only be destroyed.
  Result<uint32_t> append_raw(PageKind kind, uint64_t bytes, const Read& read);

  /// Appends records to a table without holding it in memory; consecutive calls for one kind make one table. Called
  /// after the last page. The TableSet given to finish() has no records of these kinds. Errors kFile, kRange (2^32 - 1
  /// records or more).
  Result<void> append_records(TableKind kind, uint32_t record_bytes, std::span<const std::byte> records);

  /// Bytes written so far.
  uint64_t bytes() const;
  /// Stored bytes of all pages of a kind.
  uint64_t page_bytes(PageKind kind) const;

  /// Checks the .part, which has all bytes of the finished file.
  using Check = std::function<Result<void>(const std::string& part)>;

  /// Writes the tables and the header, syncs and renames. Returns the file's size in bytes. Errors kFile; those of
  /// `check`, after which the file does not get its name. If another file has the name by then (Existing::kRefuse), the
  /// .part stays, because it is the whole file and took long to make.
  Result<uint64_t> finish(const TableSet& tables, const Check& check = {});

 private:
  struct Impl;
  explicit ContainerWriter(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace scree::format
