// Shards of a conversion: files with a share of the images and windows each, of which merge_pass.h makes the file of
// one run. A shard is a .scree file without a scene: the pages of its share, and two of kinds of their own, with what
// all shards of a conversion have in common and what this one adds to it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "format/container/container.h"
#include "format/result.h"
#include "runtime/files/mapped_file.h"
#include "tools/convert/images/images.h"
#include "tools/convert/passes/resume.h"
#include "tools/convert/plan/convert_options.h"
#include "tools/convert/windows/measure.h"

namespace scree::convert {

inline constexpr auto kShardPlanPage = static_cast<format::PageKind>(256);
inline constexpr auto kShardSharePage = static_cast<format::PageKind>(257);

/// A file of the source as it was.
struct FileStamp {
  std::string name;  // from the input's folder
  uint64_t bytes = 0;
  int64_t changed_s = 0;
  int64_t changed_ns = 0;
  bool operator==(const FileStamp&) const = default;
};
/// `path` from the root on, or as it is where the working directory cannot be had.
std::filesystem::path whole_path(const std::string& path);

/// `files`: of source_files(). One that vanished has 0 bytes.
std::vector<FileStamp> stamp_files(const std::string& input, const std::set<std::string>& files);

/// Equal in all shards of a conversion.
struct ShardPlan {
  uint32_t count = 1;            // of shards
  ConvertOptions options;        // those that shape the bytes
  std::vector<FileStamp> files;  // of the source
  Measurement measurement;       // of all, equal meshes too
  std::vector<uint32_t> sorted;  // primitives without locality
  ImagePlan images;              // before any is stored
};

/// What one shard has of it.
struct ShardShare {
  uint32_t index = 0;                     // below ShardPlan::count
  std::string input;                      // as an absolute path
  std::vector<StoredImageRecord> images;  // pages and images count from the shard's first
  std::vector<WindowOutcome> windows;     // pages count from the shard's first
};

std::vector<std::byte> pack_plan(const ShardPlan& plan);
std::vector<std::byte> pack_share(const ShardShare& share);
/// Safe on any bytes. Errors kFormat; kVersion: of another version of the program. Numbers are not checked against a
/// scene.
Result<ShardPlan> unpack_plan(std::span<const std::byte> bytes);
Result<ShardShare> unpack_share(std::span<const std::byte> bytes);

/// Things [first, end).
struct Part {
  uint64_t first = 0;
  uint64_t end = 0;
};
/// Part `index` of `count` of things that lie in order and cost so much each; parts follow each other.
Part part_of(std::span<const uint64_t> costs, uint32_t index, uint32_t count);

/// An open shard.
struct ShardFile {
  runtime::MappedFile map;
  format::Container container;
  ShardShare share;
};

/// The stored bytes of a page of it, checked; read and not mapped, so that memory and the pages of the file that are
/// mapped stay few. Errors kFile, kChecksum, kReserved, kMemory, the shard named.
Result<std::vector<std::byte>> read_page(const ShardFile& shard, uint32_t page);

/// All shards of a conversion, in order.
struct ShardSet {
  ShardPlan plan;
  std::vector<ShardFile> files;
};

/// Errors those of MappedFile, Container::open and unpack_plan, the file named; kUsage: a shard is missing, is there
/// twice, or is of another conversion, and which.
Result<ShardSet> open_shards(const std::vector<std::string>& paths);

/// Whether what shards measured and stored can be of `scene`. Errors kFormat.
Result<void> check_shards(const ShardSet& shards, const SourceScene& scene);

}  // namespace scree::convert
