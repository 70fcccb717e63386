// Shards of a conversion. Each has a share of the images and windows; merge_pass.h joins them into the file of one run.
// A shard is a .scree file without a scene. It has the pages of its share and two more: a plan, which is equal in all
// shards of a conversion, and a description of this share.
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

/// Name, size and time of change of a file of the source.
struct FileStamp {
  std::string name;  // relative to the input's folder
  uint64_t bytes = 0;
  int64_t changed_s = 0;
  int64_t changed_ns = 0;
  bool operator==(const FileStamp&) const = default;
};
/// The absolute form of `path`; unchanged if the working directory is not available.
std::filesystem::path whole_path(const std::string& path);

/// `files`: from source_files(). A file that has vanished gets 0 bytes.
std::vector<FileStamp> stamp_files(const std::string& input, const std::set<std::string>& files);

/// Equal in all shards of a conversion.
struct ShardPlan {
  uint32_t count = 1;            // of shards
  ConvertOptions options;        // only options that change the bytes
  std::vector<FileStamp> files;  // of the source
  Measurement measurement;       // of all primitives, including equal meshes
  std::vector<uint32_t> sorted;  // primitives without locality
  ImagePlan images;              // before any image is stored
};

/// The share of one shard.
struct ShardShare {
  uint32_t index = 0;                     // below ShardPlan::count
  std::string input;                      // as an absolute path
  std::vector<StoredImageRecord> images;  // pages and images are numbered from the shard's first
  std::vector<WindowOutcome> windows;     // pages are numbered from the shard's first
};

std::vector<std::byte> pack_plan(const ShardPlan& plan);
std::vector<std::byte> pack_share(const ShardShare& share);
/// Safe on any bytes. Errors: kFormat; kVersion: made by another version of scree. check_shards() compares the numbers
/// with a scene.
Result<ShardPlan> unpack_plan(std::span<const std::byte> bytes);
Result<ShardShare> unpack_share(std::span<const std::byte> bytes);

/// Whether a .scree file is a shard.
bool is_shard(const format::Container& container);
/// Error kUnsupported if it is one: it has no scene.
Result<void> check_no_shard(const format::Container& container);

/// Items [first, end).
struct Part {
  uint64_t first = 0;
  uint64_t end = 0;
};
/// Divides items into `count` consecutive parts of about equal sums of `costs`, and returns part `index`. `costs`: per
/// item.
Part part_of(std::span<const uint64_t> costs, uint32_t index, uint32_t count);

/// Keep only the images, or the windows, of shard `index` of `count`. The second returns how many triangles earlier
/// shards have of the first kept window's primitive.
void keep_share(uint32_t index, uint32_t count, ImagePlan& images);
uint64_t keep_share(uint32_t index, uint32_t count, std::vector<WindowPlan>& windows);

/// Appends the plan and the share of a shard. `plan`: from pack_plan().
Result<void> append_shard_pages(std::span<const std::byte> plan, const ShardShare& share,
                                format::ContainerWriter& writer);

/// Whether `outcome` can be the result of `window`, of mesh `mesh`.
bool is_outcome_of(const WindowOutcome& outcome, const WindowPlan& window, uint32_t mesh);

/// An open shard.
struct ShardFile {
  runtime::MappedFile map;
  format::Container container;
  ShardShare share;
};

/// Reads and checks the stored bytes of a page. The page is read rather than mapped, to keep the resident part of the
/// map small. Errors name the shard: kFile, kChecksum, kReserved, kMemory.
Result<std::vector<std::byte>> read_page(const ShardFile& shard, uint32_t page);

/// All shards of a conversion, in order.
struct ShardSet {
  ShardPlan plan;
  std::vector<ShardFile> files;
};

/// Errors name the file: those of MappedFile, Container::open and unpack_plan; kUsage: a shard is missing, is given
/// twice, or is from another conversion.
Result<ShardSet> open_shards(const std::vector<std::string>& paths);

/// Checks that the plan of the shards fits `scene`. Errors kFormat.
Result<void> check_shards(const ShardSet& shards, const SourceScene& scene);

}  // namespace scree::convert
