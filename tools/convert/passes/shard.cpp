#include "tools/convert/passes/shard.h"

#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numeric>
#include <optional>
#include <utility>

#include "tools/convert/passes/log_entry.h"

namespace scree::convert {
namespace {

// Change this number whenever the packed data change, or the cutting or packing of a scene.
constexpr uint64_t kShardFormat = 2;

/// Write and read the fields of a struct one by one, in the same order.
struct Add {
  EntryWriter& entry;
  template <class T>
  void operator()(const T& value) const {
    if constexpr (std::is_enum_v<T> || std::is_same_v<T, bool>)
      entry.add(static_cast<uint32_t>(value));
    else
      entry.add(value);
  }
  void operator()(const std::string& text) const { entry.add_text(text); }
};
struct Take {
  EntryReader& entry;
  bool& is_good;
  template <class T>
  void operator()(T& value) const {
    if constexpr (std::is_enum_v<T> || std::is_same_v<T, bool>) {
      uint32_t number = 0;
      entry.take(number);
      is_good = is_good && number <= 2;  // no enumeration here has more than three values
      value = static_cast<T>(number);
    } else {
      entry.take(value);
    }
  }
  void operator()(std::string& text) const { entry.take_text(text); }
};

template <class Stream, class... Fields>
void visit_all(const Stream& stream, Fields&... fields) {
  (stream(fields), ...);
}

template <class Stream, class Options>
void visit_options(const Stream& stream, Options& options) {
  visit_all(stream, options.float32, options.position_bits, options.max_error, options.pixel_bound.pixels,
            options.pixel_bound.distance, options.pixel_bound.width, options.pixel_bound.height,
            options.pixel_bound.fov_degrees, options.grid, options.order, options.encoding, options.clusters,
            options.chunk_triangles, options.zstd_level, options.normals, options.source_ids, options.drop_nonfinite,
            options.weld, options.share, options.exclude, options.images.textures, options.images.quality,
            options.images.block_zstd_level, options.images.keep_going);
}

template <class Stream, class Window>
void visit_window(const Stream& stream, Window& window) {
  visit_all(stream, window.primitive, window.vertices, window.span, window.first, window.count, window.kept,
            window.box.lo, window.box.hi);
}

template <class Stream, class Primitive>
void visit_measured(const Stream& stream, Primitive& primitive) {
  visit_all(stream, primitive.triangles, primitive.dropped_degenerate, primitive.dropped_nonfinite, primitive.box.lo,
            primitive.box.hi, primitive.white, primitive.shows_normals, primitive.normals, primitive.shows_tangents,
            primitive.tangents);
}

template <class Stream, class Stamp>
void visit_stamp(const Stream& stream, Stamp& stamp) {
  visit_all(stream, stamp.name, stamp.bytes, stamp.changed_s, stamp.changed_ns);
}

std::string printed(const FileStamp& stamp) {
  return stamp.name + " of " + std::to_string(stamp.bytes) + " bytes, changed at " + std::to_string(stamp.changed_s) +
         " s";
}

Error damaged(const char* what) {
  return {ErrorCode::kFormat, std::string("a shard's ") + what + " is not as scree convert --shard writes it"};
}

/// The difference between the conversions of two shards: "was made with '...', but the first with '...'".
std::string difference(const ShardPlan& plan, const ShardPlan& first) {
  const std::string options = describe_options(plan.options), first_options = describe_options(first.options);
  if (options != first_options) return "was made with '" + options + "', but the first with '" + first_options + "'";
  if (plan.count != first.count)
    return "is one of " + std::to_string(plan.count) + ", but the first one of " + std::to_string(first.count);
  for (size_t i = 0; i < std::max(plan.files.size(), first.files.size()); ++i) {
    if (i >= plan.files.size()) return "was made without " + first.files[i].name;
    if (i >= first.files.size()) return "was made from " + plan.files[i].name + ", but the first was not";
    if (!(plan.files[i] == first.files[i]))
      return "was made from " + printed(plan.files[i]) + ", but the first from " + printed(first.files[i]);
  }
  return "measured the source differently from the first";
}

/// The only page of its kind in a shard.
Result<std::span<const std::byte>> find_page(const format::Container& container, format::PageKind kind,
                                             std::vector<std::byte>& scratch) {
  for (uint64_t i = container.pages().size(); i-- > 0;)
    if (container.pages()[i].kind == kind) return container.load_page(static_cast<uint32_t>(i), scratch);
  return Error{ErrorCode::kUsage, "is a .scree file, but no shard of a conversion"};
}

struct Opened {
  std::vector<std::byte> plan;
  ShardFile file;
};

Result<Opened> open_shard(const std::string& path) {
  Opened opened;
  opened.file.map = SCREE_TRY(runtime::MappedFile::open(path, runtime::Access::kSequential));
  opened.file.container = SCREE_TRY_AT(path, format::Container::open(opened.file.map.bytes()));
  std::vector<std::byte> scratch;
  const auto plan = SCREE_TRY_AT(path, find_page(opened.file.container, kShardPlanPage, scratch));
  opened.plan.assign(plan.begin(), plan.end());
  const auto share = SCREE_TRY_AT(path, find_page(opened.file.container, kShardSharePage, scratch));
  opened.file.share = SCREE_TRY_AT(path, unpack_share(share));
  return opened;
}

std::string shard_name(uint64_t index, uint64_t count) {
  return "shard " + std::to_string(index + 1) + " of " + std::to_string(count);
}

/// Removes the entries of `lists` outside the part.
void keep(Part part, auto&... lists) {
  (lists.erase(lists.begin() + static_cast<ptrdiff_t>(part.end), lists.end()), ...);
  (lists.erase(lists.begin(), lists.begin() + static_cast<ptrdiff_t>(part.first)), ...);
}

}  // namespace

bool is_shard(const format::Container& container) {
  for (uint64_t i = container.pages().size(); i-- > 0;)
    if (container.pages()[i].kind == kShardPlanPage) return true;
  return false;
}

Result<void> check_no_shard(const format::Container& container) {
  if (!is_shard(container)) return {};
  return Error{ErrorCode::kUnsupported, "is a shard of a conversion, without a scene; scree merge joins all shards"};
}

std::filesystem::path whole_path(const std::string& path) {
  std::error_code error;
  const std::filesystem::path whole = std::filesystem::absolute(path, error);
  return (error ? std::filesystem::path(path) : whole).lexically_normal();
}

std::vector<FileStamp> stamp_files(const std::string& input, const std::set<std::string>& files) {
  const std::filesystem::path folder = whole_path(input).parent_path();
  std::vector<FileStamp> stamps;
  for (const std::string& file : files) {
    FileStamp stamp;
    stamp.name = whole_path(file).lexically_proximate(folder).string();
    struct stat status {};
    if (::stat(file.c_str(), &status) == 0) {
      stamp.bytes = static_cast<uint64_t>(status.st_size);
      stamp.changed_s = status.st_mtim.tv_sec;
      stamp.changed_ns = status.st_mtim.tv_nsec;
    }
    stamps.push_back(stamp);
  }
  std::sort(stamps.begin(), stamps.end(), [](const FileStamp& a, const FileStamp& b) { return a.name < b.name; });
  return stamps;
}

std::vector<std::byte> pack_plan(const ShardPlan& plan) {
  EntryWriter entry;
  const Add add{entry};
  add(kShardFormat);
  entry.add_text(SCREE_VERSION);
  add(plan.count);
  visit_options(add, plan.options);
  add(uint64_t{plan.files.size()});
  for (const FileStamp& stamp : plan.files) visit_stamp(add, stamp);
  add(uint64_t{plan.measurement.windows.size()});
  for (const WindowPlan& window : plan.measurement.windows) visit_window(add, window);
  add(uint64_t{plan.measurement.primitives.size()});
  for (const Measured& primitive : plan.measurement.primitives) {
    visit_measured(add, primitive);
    add(primitive.content.has_value());
    add(primitive.content.value_or(ContentHash{}));
  }
  entry.add_list(plan.sorted);
  const ImagePlan& images = plan.images;
  entry.add_list(images.places);
  entry.add_list(images.sources);
  entry.add_list(images.records);
  entry.add_list(std::vector<char>(images.is_color.begin(), images.is_color.end()));
  entry.add_list(images.costs);
  entry.add_list(images.hashes);
  for (const std::vector<std::string>* texts : {&images.broken, &images.warnings}) {
    add(uint64_t{texts->size()});
    for (const std::string& text : *texts) add(text);
  }
  return {entry.bytes().begin(), entry.bytes().end()};
}

Result<ShardPlan> unpack_plan(std::span<const std::byte> bytes) {
  EntryReader entry(bytes);
  bool is_good = true;
  const Take take{entry, is_good};
  ShardPlan plan;
  uint64_t number = 0;
  std::string version;
  take(number);
  take(version);
  if (entry.failed() || number != kShardFormat || version != SCREE_VERSION)
    return Error{ErrorCode::kVersion, "was made by another version of scree than this, " SCREE_VERSION};
  take(plan.count);
  visit_options(take, plan.options);
  plan.files.resize(entry.take_count(32));
  for (FileStamp& stamp : plan.files) visit_stamp(take, stamp);
  plan.measurement.windows.resize(entry.take_count(60));
  for (WindowPlan& window : plan.measurement.windows) visit_window(take, window);
  plan.measurement.primitives.resize(entry.take_count(92));
  for (Measured& primitive : plan.measurement.primitives) {
    visit_measured(take, primitive);
    bool has_content = false;
    ContentHash content{};
    take(has_content);
    take(content);
    if (has_content) primitive.content = content;
  }
  entry.take_list(plan.sorted);
  ImagePlan& images = plan.images;
  entry.take_list(images.places);
  entry.take_list(images.sources);
  entry.take_list(images.records);
  std::vector<char> is_color;
  entry.take_list(is_color);
  images.is_color.assign(is_color.begin(), is_color.end());
  entry.take_list(images.costs);
  entry.take_list(images.hashes);
  for (std::vector<std::string>* texts : {&images.broken, &images.warnings}) {
    texts->resize(entry.take_count(8));
    for (std::string& text : *texts) take(text);
  }
  if (entry.failed() || entry.more() || !is_good || plan.count == 0) return damaged("plan");
  if (const Result<void> checked = check_options(plan.options); !checked) return damaged("plan");
  return plan;
}

std::vector<std::byte> pack_share(const ShardShare& share) {
  EntryWriter entry;
  entry.add(share.index);
  entry.add_text(share.input);
  entry.add(uint64_t{share.images.size()});
  for (const StoredImageRecord& image : share.images) add_image(entry, image);
  entry.add(uint64_t{share.windows.size()});
  for (const WindowOutcome& window : share.windows) add_window(entry, window);
  return {entry.bytes().begin(), entry.bytes().end()};
}

Result<ShardShare> unpack_share(std::span<const std::byte> bytes) {
  EntryReader entry(bytes);
  ShardShare share;
  entry.take(share.index);
  entry.take_text(share.input);
  bool is_good = true;
  share.images.resize(entry.take_count(48));
  for (StoredImageRecord& image : share.images) is_good = is_good && take_image(entry, image);
  share.windows.resize(entry.take_count(80));
  for (WindowOutcome& window : share.windows) is_good = is_good && take_window(entry, window);
  if (entry.failed() || entry.more() || !is_good) return damaged("share");
  return share;
}

Part part_of(std::span<const uint64_t> costs, uint32_t index, uint32_t count) {
  const double total = static_cast<double>(std::accumulate(costs.begin(), costs.end(), uint64_t{0}));
  Part part{costs.size(), costs.size()};
  uint64_t before = 0;
  for (uint64_t i = 0; i < costs.size(); ++i) {
    const double middle = static_cast<double>(before) + 0.5 * static_cast<double>(costs[i]);
    const auto owner = total > 0 ? std::min(count - 1, static_cast<uint32_t>(middle / total * count)) : 0;
    if (owner >= index) part.first = std::min(part.first, i);
    if (owner > index) part.end = std::min(part.end, i);
    before += costs[i];
  }
  return part;
}

void keep_share(uint32_t index, uint32_t count, ImagePlan& images) {
  const Part part = part_of(images.costs, index, count);
  keep(part, images.records, images.sources, images.is_color, images.costs, images.broken, images.hashes);
}

uint64_t keep_share(uint32_t index, uint32_t count, std::vector<WindowPlan>& windows) {
  std::vector<uint64_t> costs;
  for (const WindowPlan& window : windows) costs.push_back(window.count);
  const Part part = part_of(costs, index, count);
  uint64_t triangles = 0;
  for (uint64_t i = part.first;
       part.first < part.end && i-- > 0 && windows[i].primitive == windows[part.first].primitive;)
    triangles += windows[i].kept;
  keep(part, windows);
  return triangles;
}

Result<void> append_shard_pages(std::span<const std::byte> plan, const ShardShare& share,
                                format::ContainerWriter& writer) {
  const auto append = [&](format::PageKind kind, std::span<const std::byte> from) {
    return writer.append_raw(kind, from.size(), [from](uint64_t offset, std::span<std::byte> out) {
      std::copy_n(from.begin() + static_cast<ptrdiff_t>(offset), out.size(), out.begin());
      return Result<void>();
    });
  };
  SCREE_TRY(append(kShardPlanPage, plan));
  SCREE_TRY(append(kShardSharePage, pack_share(share)));
  return {};
}

bool is_outcome_of(const WindowOutcome& outcome, const WindowPlan& window, uint32_t mesh) {
  uint64_t triangles = 0;
  for (const format::ChunkRecord& chunk : outcome.chunks) {
    if (chunk.mesh != mesh) return false;
    triangles += chunk.triangle_count;
  }
  return triangles == window.kept && !outcome.chunks.empty();
}

Result<std::vector<std::byte>> read_page(const ShardFile& shard, uint32_t page) {
  const std::span<const std::byte> padded = shard.container.padded_page(page);
  std::vector<std::byte> bytes(padded.size());
  const auto offset = static_cast<uint64_t>(padded.data() - shard.map.bytes().data());
  SCREE_TRY_AT(shard.map.path(), shard.map.read(offset, bytes));
  SCREE_TRY_AT(shard.map.path(), shard.container.check_page(page, bytes));
  bytes.resize(shard.container.pages()[page].stored_bytes);
  return bytes;
}

Result<ShardSet> open_shards(const std::vector<std::string>& paths) {
  ShardSet set;
  std::vector<std::byte> first_plan;
  std::vector<std::optional<ShardFile>> places;
  for (const std::string& path : paths) {
    Opened opened = SCREE_TRY(open_shard(path));
    if (first_plan.empty()) {
      set.plan = SCREE_TRY_AT(path, unpack_plan(opened.plan));
      first_plan = opened.plan;
      if (set.plan.count > std::max<size_t>(4096, paths.size())) return at(path, damaged("plan"));
      places.resize(set.plan.count);
    } else if (opened.plan != first_plan) {
      const ShardPlan plan = SCREE_TRY_AT(path, unpack_plan(opened.plan));
      return Error{ErrorCode::kUsage,
                   path + ": is from another conversion than " + paths.front() + ": it " + difference(plan, set.plan)};
    }
    const uint32_t index = opened.file.share.index;
    if (index >= places.size()) return at(path, damaged("share"));
    if (places[index])
      return Error{ErrorCode::kUsage,
                   path + ": is " + shard_name(index, places.size()) + ", as " + places[index]->map.path() + " is"};
    places[index] = std::move(opened.file);
  }
  std::string missing;
  for (size_t i = 0; i < places.size(); ++i)
    if (!places[i]) missing += (missing.empty() ? "" : ", ") + std::to_string(i + 1);
  if (!missing.empty())
    return Error{ErrorCode::kUsage,
                 paths.front() + ": is one of " + std::to_string(places.size()) + " shards; missing: " + missing};
  for (std::optional<ShardFile>& file : places) set.files.push_back(std::move(*file));
  return set;
}

Result<void> check_shards(const ShardSet& shards, const SourceScene& scene) {
  const Measurement& measurement = shards.plan.measurement;
  const auto wrong = [&](const std::string& what) {
    return Error{ErrorCode::kFormat, shards.files.front().map.path() + ": " + what + " does not match the source"};
  };
  if (measurement.primitives.size() != scene.primitives.size()) return wrong("its number of primitives");
  std::vector<uint64_t> kept(scene.primitives.size());
  const WindowPlan* before = nullptr;
  for (const WindowPlan& window : measurement.windows) {
    if (window.primitive >= scene.primitives.size()) return wrong("primitive " + std::to_string(window.primitive));
    const uint64_t triangles = scene.primitives[window.primitive].triangle_count();
    const bool follows = before == nullptr || before->primitive < window.primitive ||
                         (before->primitive == window.primitive && before->first + before->count <= window.first);
    if (!follows || window.kept == 0 || window.kept > window.count || window.count > triangles ||
        window.first > triangles - window.count)
      return wrong("a window of primitive " + std::to_string(window.primitive));
    kept[window.primitive] += window.kept;
    before = &window;
  }
  for (size_t i = 0; i < kept.size(); ++i) {
    const Measured& primitive = measurement.primitives[i];
    if (kept[i] != primitive.triangles) return wrong("the number of triangles of primitive " + std::to_string(i));
    for (size_t axis = 0; primitive.triangles > 0 && axis < 3; ++axis)
      if (!std::isfinite(primitive.box.lo[axis]) || !std::isfinite(primitive.box.hi[axis]) ||
          primitive.box.lo[axis] > primitive.box.hi[axis])
        return wrong("the box of primitive " + std::to_string(i));
  }
  for (const uint32_t primitive : shards.plan.sorted)
    if (primitive >= scene.primitives.size()) return wrong("primitive " + std::to_string(primitive));
  const ImagePlan& images = shards.plan.images;
  const size_t count = images.records.size();
  if (images.places.size() != scene.images.size() || images.sources.size() != count || images.costs.size() != count ||
      images.is_color.size() != count || images.hashes.size() != count || images.broken.size() != count)
    return wrong("its number of images");
  for (const uint32_t place : images.places)
    if (place != format::kNone && place >= count) return wrong("an image");
  for (const uint32_t source : images.sources)
    if (source >= scene.images.size()) return wrong("an image");
  return {};
}

}  // namespace scree::convert
